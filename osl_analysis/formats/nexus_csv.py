"""The CSV export of Vicon Nexus: sections with a rate, a row of names, a header, a row of units, and samples.

Sections come in any order, with or without commas that pad every line to the longest one. A name is written above the
first of its columns only.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from osl_analysis.errors import InputError, listing
from osl_analysis.formats.csv_table import (
    Rows,
    UnreadableCellError,
    decoded_text,
    delimiter_of,
    is_text,
    number,
    numbers,
    read_lines,
    split_rows,
)
from osl_analysis.trial import Array

HEADER = ("frame", "sub frame")


@dataclass(frozen=True)
class NexusSection:
    """One section of an export."""

    title: str  # Devices, Trajectories or Model Outputs
    rate: float  # rows per second [Hz]
    names: list[str]  # name of every column: `Anna:LTOE`, `EMG2000 - Voltage`
    components: list[str]  # component of every column: X, Y, Z, Fx ..
    units: list[str]  # unit of every column, as Nexus spells it
    rows: Rows  # number of the line in the file, and its cells; the first two are the numbers of frame and sub frame
    decimal: str

    def place(self, name: str, component: str) -> int:
        """Column of a name, with or without its subject, and component."""
        wanted = [i for i, c in enumerate(self.components) if c.casefold() == component.casefold()]
        found = [i for i in wanted if self.names[i] == name] or [
            i for i in wanted if without_subject(self.names[i]) == name
        ]
        if len(found) != 1:
            have = sorted({f"{n} {c}" for n, c in zip(self.names, self.components, strict=True) if n})
            count = f"occurs {len(found)} times" if found else "is missing"
            raise InputError(
                f"'{name}' {component} {count} under {self.title}; there are {listing(have)}; correct the name in the "
                "source file"
            )
        return found[0]

    def column(self, name: str, component: str) -> tuple[Array, str]:
        """Values (rows,) and unit of a name's component."""
        place = self.place(name, component)
        return self.values(place), self.units[place]

    def values(self, place: int) -> Array:
        """One column (rows,), NaN where a cell is empty."""
        cells = [cells[place] if place < len(cells) else "" for _, cells in self.rows]
        try:
            return numbers(cells, ("",), self.decimal)[0]
        except UnreadableCellError as error:
            raise InputError(
                f"line {self.rows[error.place][0]}, {self.names[place]} {self.components[place]}: "
                f"'{cells[error.place][:40]}' is not a number; repair it, or state `decimal`"
            ) from error

    def counts(self) -> tuple[int, int]:
        """First frame, and samples per frame."""
        frame, sub = (self.values(place) for place in (0, 1))
        per_frame = float(np.nanmax(sub, initial=0.0)) + 1
        goes_on = (frame - frame[0]) * per_frame + sub == np.arange(frame.size)
        if not goes_on.all():
            place = int(np.argmin(goes_on))
            raise InputError(
                f"line {self.rows[place][0]}: frame {frame[place]:g}, sub frame {sub[place]:g} does not follow the "
                "line before; export the trial again with all its frames"
            )
        return int(frame[0]), int(per_frame)


def is_nexus(begin: bytes) -> bool:
    """Whether a file that begins with these bytes is an export of Nexus: it has the header of a section."""
    lines = decoded_text(begin).casefold().replace('"', "").splitlines() if is_text(begin) else []
    return any(line.startswith(HEADER[0]) and HEADER[1] in line for line in lines)


def without_subject(name: str) -> str:
    return name.rpartition(":")[2]


def read_sections(path: Path, delimiter: str = "auto", decimal: str = ".") -> dict[str, NexusSection]:
    """Sections by title; InputError if there is none, one has no samples, or stands twice."""
    lines = read_lines(path)
    header = [(n, text) for n, text in lines if text.lstrip('"').casefold().startswith("frame")]
    rows = split_rows(path, lines, delimiter_of(header[:1], delimiter))
    starts = []
    for i in range(len(rows) - 3):  # a title alone, a rate alone, names, and the header
        title, rate, above = (rows[i + k][1] for k in (0, 1, 3))
        alone = bool(title[0]) and not any(title[1:]) and not any(rate[1:])
        starts += [i] * (alone and tuple(cell.casefold() for cell in above[:2]) == HEADER)
    if not starts:
        raise InputError(
            f"{path}: no section of a Nexus export (Devices, Trajectories, ...); check the source's format"
        )
    found: dict[str, NexusSection] = {}
    for start, end in zip(starts, [*starts[1:], len(rows)], strict=True):
        section = nexus_section(path, rows[start:end], decimal)
        if section.title in found:
            raise InputError(f"{path}: line {rows[start][0]}: section {section.title} stands twice; export one of each")
        found[section.title] = section
    return found


def nexus_section(path: Path, rows: Rows, decimal: str) -> NexusSection:
    (line, title), (_, rate), (_, names), (_, header) = rows[:4]
    samples = rows[5:]
    try:
        hertz = number(rate[0].replace(",", "."), 0)
    except UnreadableCellError as error:
        raise InputError(f"{path}: line {line + 1}: '{rate[0][:40]}' is not a rate; export the trial again") from error
    if not samples or not hertz > 0:
        raise InputError(f"{path}: section {title[0][:40]} at {hertz:g} Hz has no samples; export without it")
    width = max(i + 1 for i, cell in enumerate(header) if cell)
    units = (rows[4][1] + [""] * width)[:width]
    return NexusSection(title[0], hertz, repeated_names(names, width), header[:width], units, samples, decimal)


def repeated_names(names: list[str], width: int) -> list[str]:
    """The name of every column: the one above it, or else the nearest to the left."""
    full: list[str] = []
    for place in range(width):
        here = names[place] if place < len(names) else ""
        full.append(here or (full[-1] if full else ""))
    return full
