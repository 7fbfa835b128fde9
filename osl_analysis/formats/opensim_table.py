"""Tables of OpenSim, .mot and .sto: lines of a header down to `endheader`, names of columns, and rows of numbers."""

import re
from dataclasses import dataclass
from pathlib import Path

from osl_analysis.errors import InputError, listing, nearest
from osl_analysis.formats.csv_table import Rows, UnreadableCellError, decoded_text, is_text, numbers, read_lines
from osl_analysis.trial import Array

END = re.compile(r"^[ \t]*endheader[ \t\r]*$", re.MULTILINE | re.IGNORECASE)
FAILED = ("nan", "NaN", "NAN", "-nan", "nan(ind)", "-nan(ind)")
"""How the C++ that OpenSim is compiled with writes a value that is none."""
COUNTS = {"rows": ("nrows", "datarows"), "columns": ("ncolumns", "datacolumns")}
"""How the header's versions call the size of the table."""
MOST_COLUMNS = 16384


@dataclass(frozen=True)
class OpenSimTable:
    """One table."""

    path: Path
    header: dict[str, str]  # what the header says, by key in small letters; a line without a value stands under itself
    names: list[str]
    rows: Rows  # number of the line in the file, and its cells, of every row

    @property
    def angles(self) -> str:
        """Unit of its angles, `deg` or `rad`; empty where the header does not tell."""
        return {"yes": "deg", "no": "rad"}.get(self.header.get("indegrees", "").casefold(), "")

    def column(self, name: str) -> Array:
        """The numbers (rows,) of a column, NaN where the value is none."""
        places = [place for place, one in enumerate(self.names) if one == name]
        if len(places) != 1:
            count = f"occurs {len(places)} times" if places else "is missing"
            advice = "" if places else nearest(name, self.names)
            raise InputError(
                f"{self.path}: column '{name[:80]}' {count}; the file has {listing(self.names)}"
                f"{advice or '; correct the name in the source file'}"
            )
        cells = [row[places[0]] for _, row in self.rows]
        try:
            return numbers(cells, FAILED, ".")[0]
        except UnreadableCellError as error:
            text = cells[error.place]
            remedy = "export it as scalars" if "," in text else "repair the line"
            raise InputError(
                f"{self.path}: line {self.rows[error.place][0]}, column '{name}': '{text[:40]}' is not a number; "
                f"{remedy}"
            ) from error


def is_opensim(begin: bytes) -> bool:
    return is_text(begin) and END.search(decoded_text(begin)) is not None


def read_opensim(path: Path) -> OpenSimTable:
    """A table; InputError if its header has no end, or contradicts the rows."""
    lines = read_lines(path)
    end = next((place for place, (_, text) in enumerate(lines) if text.strip().casefold() == "endheader"), None)
    if end is None:
        raise InputError(f"{path}: no line `endheader`: no table of OpenSim; check the source's format")
    header = {}
    for text in (text.strip() for _, text in lines[:end]):  # `nRows=12`, or as older versions write it `datarows 12`
        key, _, value = text.partition("=" if "=" in text else " ")
        header[key.strip().casefold()] = value.strip()
    if len(lines) < end + 3:
        raise InputError(f"{path}: holds no rows below its header; export it again, or exclude the trial")
    (line, titles), rows = lines[end + 1], [(number, text.split()) for number, text in lines[end + 2 :]]
    names = [name.strip() for name in titles.rstrip().split("\t")] if "\t" in titles.strip() else titles.split()
    if len(names) > MOST_COLUMNS:
        raise InputError(f"{path}: line {line} names {len(names)} columns, at most {MOST_COLUMNS} are read")
    check_counts(path, header, len(rows), len(names))
    for number, cells in rows:
        if len(cells) != len(names):
            cut = ": the file is cut off" if number == rows[-1][0] and len(cells) < len(names) else ""
            raise InputError(
                f"{path}: line {number} has {len(cells)} cells under {len(names)} names{cut}; export it again, or "
                "repair it"
            )
    return OpenSimTable(path, header, names, rows)


def check_counts(path: Path, header: dict[str, str], rows: int, columns: int) -> None:
    """Refuse a table whose header counts other rows or columns than there are."""
    for what, found in (("rows", rows), ("columns", columns)):
        key = next((key for key in COUNTS[what] if key in header), None)
        if key is not None and header[key] != str(found):
            cut = ": the end is missing" if header[key].isdigit() and int(header[key]) > found else ""
            raise InputError(
                f"{path}: {key} in its header is {header[key][:20]}, the file holds {found} {what}{cut}; export it "
                "again, or correct the header"
            )
