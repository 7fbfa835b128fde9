"""Recordings of gait laboratories as text: the CSV export of Vicon Nexus, markers in TRC, and
tables of OpenSim.

Nexus writes sections in any order, each with a rate, a row of names, each above the first of its
columns only, a header, a row of units, and samples. TRC has a header of five lines, OpenSim (.mot,
.sto) one down to `endheader`."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from osl_analysis.errors import InputError, listing
from osl_analysis.old_formats import csv_table
from osl_analysis.old_formats.table import Ledger
from osl_analysis.trial import Array


def column_of(
    rows: csv_table.Rows,
    place: int,
    missing: tuple[str, ...],
    what: str,
    remedy: str,
    decimal: str = ".",
) -> Array:
    """One column of rows, (rows,), NaN where a cell is one of the words in `missing` or the row is
    too short."""
    cells = [cells[place] if place < len(cells) else "" for _, cells in rows]
    try:
        return csv_table.cell_numbers(cells, missing, decimal)
    except csv_table.UnreadableCellError as error:
        text = cells[error.place]
        what = f"line {rows[error.place][0]}, {what}: '{text[:40]}' is not a number"
        raise InputError(
            f"{what}; {'export it as scalars' if text.count(',') > 1 else remedy}"
        ) from error


def check_last_line(ends: bool, rows: csv_table.Rows) -> None:
    """Refuse a file of which nothing tells that its last number is whole, as that the last line
    `ends` with a break."""
    last = [cells[-1] for _, cells in rows]
    # where all are empty, a tab ends every line
    if any(last) and not ends and not csv_table.is_last_whole(last):
        said = (
            f"line {rows[-1][0]}, the last one, has no line break and may be cut off within its"
            " last number"
        )
        raise InputError(f"{said}; export it again, or end the line where it is whole")


@dataclass(frozen=True)
class NexusSection:
    title: str  # Devices, Trajectories or Model Outputs
    rate: float  # rows per second [Hz]
    names: list[str]  # name of every column: `Anna:LTOE`, `EMG2000 - Voltage`
    components: list[str]  # component of every column: X, Y, Z, Fx ..
    units: list[str]  # unit of every column, as Nexus spells it
    # number of the line, and its cells; the first two are the numbers of frame and sub frame
    rows: csv_table.Rows
    decimal: str

    def column(self, name: str, component: str) -> tuple[Array, str]:
        """Values (rows,) and unit of the component of a name, with or without its subject."""
        wanted = [i for i, c in enumerate(self.components) if c.casefold() == component.casefold()]
        exact = [i for i in wanted if self.names[i] == name]
        found = exact or [i for i in wanted if without_subject(self.names[i]) == name]
        if len(found) == 1:
            return self.values(found[0]), self.units[found[0]]
        have = sorted({f"{n} {c}" for n, c in zip(self.names, self.components, strict=True) if n})
        count = f"occurs {len(found)} times" if found else "is missing"
        said = f"'{name}' {component} {count} under {self.title}; there are {listing(have)}"
        raise InputError(f"{said}; correct the name in the source file")

    def values(self, place: int) -> Array:
        title = f"{self.names[place]} {self.components[place]}"
        return column_of(
            self.rows, place, ("",), title, "repair it, or state `decimal`", self.decimal
        )

    def counts(self) -> tuple[int, int]:
        """First frame, and samples per frame."""
        frame, sub = (self.values(place) for place in (0, 1))
        per_frame = float(np.nanmax(sub, initial=0.0)) + 1
        for place in np.flatnonzero(
            (frame - frame[0]) * per_frame + sub != np.arange(frame.size)
        ).tolist():
            said = (
                f"line {self.rows[place][0]}: frame {frame[place]:g}, sub frame {sub[place]:g} does"
                " not follow"
            )
            raise InputError(f"{said} the line before; export the trial again with all its frames")
        return int(frame[0]), int(per_frame)


def is_nexus(begin: bytes) -> bool:
    """Whether a file that begins with these bytes is an export of Nexus: it has the header of a
    section."""
    lines = (
        csv_table.decoded_text(begin).casefold().replace('"', "").splitlines()
        if csv_table.is_text(begin)
        else []
    )
    return any(line.startswith("frame") and "sub frame" in line for line in lines)


def without_subject(name: str) -> str:
    return name.rpartition(":")[2]


def read_sections(
    path: Path, delimiter: str = "auto", decimal: str = "."
) -> dict[str, NexusSection]:
    """Sections by title; InputError if there is none, one has no samples, or stands twice."""
    lines, ends = csv_table.read_lines(path)
    header = [(n, text) for n, text in lines if text.lstrip('"').casefold().startswith("frame")]
    rows = csv_table.split_rows(lines, csv_table.delimiter_of(header[:1], delimiter))
    starts = []
    for i in range(len(rows) - 3):  # a title alone, a rate alone, names, and the header
        first, second, above = (rows[i + k][1] for k in (0, 1, 3))
        alone = bool(first[0]) and not any(first[1:]) and not any(second[1:])
        starts += [i] * (
            alone and tuple(cell.casefold() for cell in above[:2]) == ("frame", "sub frame")
        )
    if not starts:
        raise InputError(
            "no section of a Nexus export (Devices, Trajectories, ...); check the source's format"
        )
    found: dict[str, NexusSection] = {}
    check_last_line(ends, rows[starts[-1] + 5 :] or rows[-1:])
    for start, end in zip(starts, [*starts[1:], len(rows)], strict=True):
        (line, (title, *_)), (_, rates), (_, names), (_, components) = rows[start : start + 4]
        samples, width = rows[start + 5 : end], len(csv_table.unpadded(components, 0))
        if not csv_table.is_number_cell(rate := rates[0].replace(",", ".")):
            raise InputError(
                f"line {line + 1}: '{rate[:40]}' is not a rate; export the trial again"
            )
        if not samples or not (hertz := float(rate)) > 0:
            raise InputError(
                f"section {title[:40]} at {float(rate):g} Hz has no samples; export without it"
            )
        if title in found:
            raise InputError(f"line {line}: section {title} stands twice; export one of each")
        full = [""]  # the name of every column: the one above it, or else the nearest to the left
        for place in range(width):
            full.append((names[place] if place < len(names) else "") or full[-1])
        units = (rows[start + 4][1] + [""] * width)[:width]
        found[title] = NexusSection(
            title, hertz, full[1:], components[:width], units, samples, decimal
        )
    return found


@dataclass(frozen=True)
class TrcFile:
    labels: list[str]
    positions: Array  # (frames, markers, 3) in `unit`; NaN where a marker was not seen
    rate: float  # frames per second [Hz]
    unit: str  # unit of length, as the file spells it; empty where it gives none
    first_frame: int
    start: float  # time of the first frame [s]
    damage: Ledger = field(default_factory=Ledger)


def is_trc(begin: bytes) -> bool:
    start = csv_table.decoded_text(begin[:200]).lstrip().casefold()
    return csv_table.is_text(begin) and start.startswith("pathfiletype")


def read_trc(path: Path) -> TrcFile:
    """The markers of a file; InputError if its header is not that of TRC, or contradicts the
    rows."""
    (lines, ends), export = csv_table.read_lines(path), "export it again, or correct the header"
    if not lines or not lines[0][1].lstrip().casefold().startswith("pathfiletype"):
        raise InputError(
            "no TRC file: its first line does not begin with PathFileType; check the source's"
            " format"
        )
    if len(lines) < 6:
        raise InputError(f"holds no frames, only {len(lines)} lines of a header; export it again")
    cells = [
        [cell.strip() for cell in (text.split("\t") if "\t" in text else text.split())]
        for _, text in lines
    ]
    said, place = (
        {key.casefold(): value for key, value in zip(*cells[1:3], strict=False) if key},
        lines[2][0],
    )
    for key in ("NumFrames", "NumMarkers"):
        text = said.get(key.casefold(), "")
        if not (text.isascii() and text.isdigit() and 0 < int(text) < 10**8):
            raise InputError(
                f"line {place}: {key} is {text[:40]!r} and no count above zero; {export}"
            )
    frames, markers = int(said["numframes"]), int(said["nummarkers"])
    labels = [cell for cell in cells[3][2:] if cell]
    if len(labels) < markers:
        raise InputError(
            f"NumMarkers is {markers}, line {lines[3][0]} names {len(labels)}; {export}"
        )
    rows = [(line, row) for (line, _), row in zip(lines[5:], cells[5:], strict=True)]
    if len(rows) != frames:
        cut = ": the end is missing" if len(rows) < frames else ""
        raise InputError(f"NumFrames is {frames}, the file holds {len(rows)} rows{cut}; {export}")
    check_last_line(ends, rows)
    names = ["frame", "time", *(f"column {place + 3}" for place in range(3 * markers))]
    unseen = ("", "nan", "NaN", "NAN")  # cells of a marker that was not seen
    own = [
        column_of(rows, k, unseen * (k > 1), name, "export it again")
        for k, name in enumerate(names)
    ]
    (frame, time), columns = own[:2], own[2:]
    for line, padded in rows:
        count = len(csv_table.unpadded(padded, 0))
        if count > len(names) or (count - 2) % 3:
            raise InputError(
                f"line {line} has {count - 2} coordinates, its header names {markers} markers;"
                f" {export}"
            )
    text = said.get("datarate", "")
    rate = float(text) if csv_table.is_number_cell(text) else 0.0
    if rate <= 0:
        raise InputError(f"line {place}: DataRate is {text[:40]!r} and no rate in Hz; {export}")
    count_up = np.arange(frames)
    for row in np.flatnonzero(
        (frame != frame[0] + count_up) | (frame[0] != np.rint(frame[0]))
    ).tolist():
        what = f"line {rows[row][0]}: frame {frame[row]:g} does not follow the line before"
        raise InputError(f"{what}; export all frames")
    # OpenSim prints more decimals than its times have
    printed = [row[1].partition(".")[2] for _, row in rows]
    has, fine = (
        max(map(len, cells)) for cells in (printed, [cell.rstrip("0") for cell in printed])
    )
    # with fewer, no frame is told from the next
    decimals = min(has, max(fine, math.ceil(math.log10(rate))))
    # half of the last decimal, and a little for sums in single precision
    rounding = 0.6 * 10.0**-decimals
    wrong = (
        np.abs(time - time[0] - count_up / rate) > 2 * rounding + (1e-3 + 1e-4 * count_up) / rate
    )
    for row in np.flatnonzero(wrong).tolist():
        what = (
            f"line {rows[row][0]}: time {time[row]:g} s does not fit DataRate {rate:g} Hz from"
            f" {time[0]:g} s on"
        )
        raise InputError(f"{what}; correct DataRate or the times")
    positions = np.column_stack(columns).reshape(frames, markers, 3)
    positions[(positions == 0).all(axis=2)] = np.nan
    empty = (
        f"{len(labels) - markers} names after the {markers} markers have no positions, such as"
        f" {labels[-1][:40]}"
    )
    # Cortex names its virtual markers and leaves them out
    damage = Ledger(remarks=[empty] * (len(labels) > markers))
    return TrcFile(
        labels[:markers],
        positions,
        rate,
        said.get("units", ""),
        int(frame[0]),
        float(time[0]),
        damage,
    )


def is_opensim(begin: bytes) -> bool:
    end = r"(?im)^[ \t]*endheader[ \t\r]*$"
    return csv_table.is_text(begin) and re.search(end, csv_table.decoded_text(begin)) is not None


def read_opensim(
    path: Path, layout: csv_table.CsvLayout, is_unit: csv_table.IsUnit, most_rows: int | None = None
) -> csv_table.CsvTable:
    """A table, with its header as comments; InputError if the header has no end, or contradicts the
    rows."""
    data, ends = csv_table.read_text(path)
    end = re.search(rb"(?im)^[ \t]*endheader[ \t]*\n", data)
    if end is None:
        raise InputError("no line `endheader`: no table of OpenSim; check the source's format")
    below, above = data[end.end() :], data[: end.start()].decode(errors="replace").split("\n")
    by_tabs = re.match(rb"\s*\S[^\n]*\t[ \t]*\S", below) is not None
    layout = replace(layout, delimiter="tab" if by_tabs else "space", decimal=".")
    blank = b"\n" * data.count(b"\n", 0, end.end())  # the lines keep their numbers
    table = csv_table.table_of_text(blank + below, ends, layout, is_unit, most_rows)
    header = opensim_header(said := [text.strip() for text in above if text.strip()])
    is_part = most_rows is not None and len(table.lines) >= most_rows
    counts = {"rows": len(table.lines), "columns": len(table.names)}
    for what, found in counts.items():
        # or of older versions
        stated = next((header[key] for key in (f"n{what}", f"data{what}") if key in header), "")
        if stated and stated != str(found) and not (is_part and what == "rows"):
            cut = (
                ": the end is missing, or some are damaged"
                if stated.isdigit() and int(stated) > found
                else ""
            )
            told = f"its header states {stated[:20]} {what}, the file holds {found} whole ones{cut}"
            raise InputError(f"{told}; export it again, or correct the header")
        table.damage.end_unknown |= what == "rows" and not stated
    return replace(table, comments=[*said, *table.comments])


def opensim_header(lines: Sequence[str]) -> dict[str, str]:
    """What a header says, by key in small letters: `nRows=12`, or as older versions write it
    `datarows 12`."""
    parted = (text.partition("=" if "=" in text else " ") for text in lines)
    return {key.strip().casefold(): value.strip() for key, _, value in parted}
