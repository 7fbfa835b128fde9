# SPDX-License-Identifier: Apache-2.0
"""Read text as cells, and cells as numbers and times.

Encoding, delimiter, decimal sign and forms of times are found from the text, as programs of many
countries write them. Example: `1,5` is 1.5 where semicolons part the cells.
"""

import csv
import re
from collections.abc import Collection, Iterable, Sequence
from itertools import zip_longest
from pathlib import Path
from statistics import mode
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError
from osl_analysis.base.recording import SECOND_NS
from osl_analysis.base.units import is_unit

# bytes that no text has; byte 26 is allowed, it ends files of DOS
CONTROL = re.compile(rb"[\x00-\x08\x0e-\x19]")
UTF_16 = (b"\xff\xfe", b"\xfe\xff")  # its marks
SPOILED = re.compile("[Â-ô][^\x00-\x7f]+")  # what UTF-8 becomes as read in a western code page
MINUS = "\u2212"  # a minus sign that is no hyphen
# lines of a text that tell its header, the sign between cells and the decimal sign, and its footer
LONGEST_LINE = 1_000_000  # letters; 10,000 columns of 100 letters each
FIRST_LINES, LAST_LINES = 300, 60
MISSING = (
    "",
    "nan",
    "NaN",
    "NAN",
    "NA",
    "N/A",
    "#N/A",
    "null",
    "NULL",
    "None",
    "<NA>",
    "NaT",
    "-nan",
    "nan(ind)",
    "-nan(ind)",
)
"""Cells that programs write for a failed reading."""
NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eEdD][+-]?\d{1,3})?", re.ASCII)
WHOLE = r"^[+-]?\d+$"
TRUTHS = ("true", "false")  # in any case, as loggers in Python write them
# a time of day, minutes with seconds, or seconds as MATLAB writes those of a timetable
TIME = (
    r"^(?:(?P<matlab_s>\d+(?:\.\d+)?(?:[eE][+-]?\d+)?) sec|"
    r"(?P<minutes_alone>\d{1,4}):(?P<seconds_alone>\d{2})[.,](?P<fraction_alone>\d{1,9})|"
    r"(?:\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[T ]\s*)?(?:(?P<days>\d+) days?,? )?"
    r"\+?(?P<hours>\d{1,3}):(?P<minutes>\d{2}):(?P<seconds>\d{1,2})"
    r"(?:[.,:](?P<fraction>\d{1,9}))?\d*(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?"
    r"\s*(?:Z|UTC|[+-]\d{2}:?(?:\d{2})?)?)$"
)
TIME_OF_CELL = re.compile(TIME)
DAY_NS = 86_400 * SECOND_NS


class Line(NamedTuple):
    """A line of a file."""

    number: int  # counted from 1
    text: str


class TextRow(NamedTuple):
    """The cells of a line."""

    number: int  # of the line
    cells: list[str]


class Text(NamedTuple):
    """The text of a file, in UTF-8 with Unix line breaks."""

    data: bytes
    is_ended: bool  # whether its last line has a break


def is_text(begin: bytes) -> bool:
    """Tell whether a file that begins so is text, by its first line: later zero bytes may come
    from a loss of power."""
    return begin.startswith(UTF_16) or CONTROL.search(begin.partition(b"\n")[0]) is None


def decoded(data: bytes) -> str:
    """Decode text, and repair what programs spoiled in it by another encoding."""
    return SPOILED.sub(repaired, as_written(data))


def as_written(data: bytes) -> str:
    """Decode text in UTF-8, UTF-16 with its mark, or else the western code page of Windows."""
    try:
        if data.startswith(UTF_16):
            data = data.decode("utf-16", errors="replace").encode()
        return data.removeprefix(b"\xef\xbb\xbf").decode()
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def repaired(match: re.Match[str]) -> str:
    """A match of `SPOILED` as it was, such as `°` for `Â°`; itself where it was never spoiled."""
    try:
        return match[0].encode("cp1252").decode()
    except UnicodeError:
        return match[0]


def begins_with_text(pattern: str, begin: bytes) -> bool:
    """Tell whether a file that begins so is text in which a pattern of ASCII stands near its
    beginning. To repair the text would take long where these are numbers of a program."""
    return is_text(begin) and re.search(pattern, as_written(begin)) is not None


def read_text(path: Path) -> Text:
    """Read the text of a file.

    Raises
    ------
    InputError
        It holds zero bytes.
    """
    data = path.read_bytes()
    if not data.isascii():
        data = decoded(data).encode().replace(MINUS.encode(), b"-")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    data = data.rstrip(b"\x1a")
    zero = data.find(b"\0")
    if zero >= 0:
        line = data.count(b"\n", 0, zero) + 1
        raise InputError(
            f"line {line} holds zero bytes, as a loss of power leaves them",
            "delete the file from there on, or name a text file",
        )
    return Text(data, data.rstrip(b" \t").endswith(b"\n"))


def numbered(data: bytes, first: int = 1) -> list[Line]:
    """The lines that are not blank. `first` is the number of the first line."""
    lines = data.decode(errors="replace").split("\n")
    return [Line(number, text) for number, text in enumerate(lines, start=first) if text.strip()]


def delimiter_of(lines: Sequence[Line]) -> str:
    """Find the sign between cells.

    It is the one of tab, `;`, `|`, `,` and blank with which most cells are numbers, times or
    missing, and most lines have as many. Without numbers it is the first of tab, `;` and `|` that
    every line has, or else `,`.
    """
    sample = [line.text.strip() for line in lines[:FIRST_LINES]]
    if any(len(text) > LONGEST_LINE for text in sample):
        raise InputError(
            f"has a line of more than {LONGEST_LINE} letters", "write a row per sample"
        )
    scores = {sign: _score(sample, sign) for sign in "\t;|, "}
    best = max(scores, key=lambda sign: scores[sign])
    if scores[best] > 0:
        return best
    return next((sign for sign in "\t;|" if all(sign in text for text in sample)), ",")


def _score(sample: Sequence[str], sign: str) -> float:
    """Share of lines with the most frequent number of cells, times that of values among these."""
    rows = [text.split(None if sign == " " else sign) for text in sample]
    width = mode([*map(len, rows), 0])
    if width < 2:
        return 0.0
    typical = [row for row in rows if len(row) == width]
    filled = [cell.strip(' "') for row in typical for cell in row if cell.strip(' "')]
    values = sum(is_value(cell) or is_number_with_unit(cell) for cell in filled)
    return len(typical) / len(rows) * values / max(1, len(filled))


def split_rows(lines: Sequence[Line], delimiter: str) -> list[TextRow]:
    """Split lines into stripped cells; lines of empty cells are left out.

    Raises
    ------
    InputError
        A quote is not closed on its line, or a cell is too long.
    """
    rows = []
    for number, text in lines:
        if delimiter == " ":
            text = re.sub(r"\s+", " ", text.strip())
        try:
            (cells,) = csv.reader([text], delimiter=delimiter, skipinitialspace=True, strict=True)
        except csv.Error as error:
            raise InputError(f"line {number}: {error}", "repair its quotes or its cells") from error
        stripped = [cell.strip() for cell in cells]
        if any(stripped):
            rows.append(TextRow(number, stripped))
    return rows


def unpadded(cells: Sequence[str], width: int = 0) -> list[str]:
    """Leave out empty cells at the end, beyond a width: some programs pad lines with them."""
    kept = list(cells)
    while len(kept) > width and not kept[-1]:
        kept.pop()
    return kept


def padded_to(length: int, values: Iterable[Any], filling: Any) -> list[Any]:
    """The first values, with others for those that lack."""
    return [*values, *[filling] * length][:length]


def check_last_line(is_ended: bool, rows: Sequence[TextRow]) -> None:
    """Refuse a file of which nothing tells that its last number is whole."""
    if not is_ended and may_be_cut(rows):
        raise InputError(
            f"line {rows[-1].number}, the last one, has no line break and may be cut off within"
            " its last number",
            "export it again, or end the line where it is whole",
        )


def is_number_cell(cell: str) -> bool:
    """Tell whether a cell is a number with a decimal point, or a whole one."""
    return NUMBER.fullmatch(cell) is not None


def is_number_with_unit(cell: str) -> bool:
    """Tell whether a cell is a number and a unit, as `8.9 Nm`."""
    number, _, unit = cell.partition(" ")
    return is_number_cell(number) and is_unit(unit)


def is_value(cell: str) -> bool:
    """Tell whether a cell may be one of a column of numbers or times."""
    if cell in MISSING or cell.casefold() in TRUTHS:
        return True
    return is_number_cell(cell.replace(",", ".", 1)) or TIME_OF_CELL.match(cell) is not None


def name_and_unit(title: str) -> tuple[str, str]:
    """Split `torque [Nm]`, `torque (Nm)`, `torque {Nm}` or `torque / Nm` into name and unit; the
    unit is empty if there is none. The index of `q[5]` is none, nor the joint of a topic's
    `/states/effort[ankle]`."""
    index = re.search(r"\w\[(\d+)\]$|^/.*\w\[(\w+)\]$", title)
    if index and (index[1] or not is_unit(index[2])):
        return title, ""
    in_brackets = r"\[[^\[\]]*\]|\([^()]*\)|\{[^{}]*\}"
    match = re.fullmatch(rf"(.*\S)\s*({in_brackets})|(.*\S)\s+/\s+(\S.*)", title, re.DOTALL)
    if not match:
        return title, ""
    return (match[1], match[2][1:-1]) if match[1] else (match[3], match[4])


def may_be_cut(rows: Sequence[TextRow]) -> bool:
    """Tell whether the last cell of a file without a final line break may be cut off.

    It is whole if it has as many decimals as all others of its column, or if all are empty since a
    tab ends every line. Whole numbers do not tell.
    """
    cells = [row.cells[-1] for row in rows]
    decimals = {len(cell.replace(",", ".").partition(".")[2]) for cell in cells}
    return any(cells) and (len(cells) < 2 or len(decimals) > 1 or 0 in decimals)


def decimal_of(rows: Sequence[Sequence[str]]) -> str:
    """Find the decimal sign of the cells of rows.

    It is a comma if numbers have commas and no stops, unless all commas may separate thousands.

    Raises
    ------
    InputError
        Stops separate thousands: read as decimals, they would be silently wrong.
    """
    cells = set()
    columns = zip_longest(*rows[:FIRST_LINES], *rows[-LAST_LINES:], fillvalue="")
    for place, column in enumerate(columns, start=1):
        numbers = {cell for cell in column if re.fullmatch(r"[+-]?(\d+([.,]\d+)?|[.,]\d+)", cell)}
        # as a decimal sign the stop would stand in every number if three decimals are written, and
        # no number would end in 0 if zeros are left out
        small = [number for number in numbers if re.fullmatch(r"[+-]?\d{1,3}", number)]
        grouped = [
            number for number in numbers if re.fullmatch(r"[+-]?[1-9]\d{0,2}\.\d{3}", number)
        ]
        ends_in_zero = any(number.endswith("0") for number in grouped)
        if small and ends_in_zero and len(small) + len(grouped) == len(numbers):
            raise InputError(
                f"column {place}: '{max(grouped)}' stands beside '{small[0]}', as with a sign"
                " between thousands",
                "write numbers without it",
            )
        cells |= {*column}
    if any(re.fullmatch(r"[+-]?\d*\.\d+([eEdD][+-]?\d+)?", cell) for cell in cells):
        return "."
    commas = [cell for cell in cells if re.fullmatch(r"[+-]?\d*,\d+([eE][+-]?\d+)?", cell)]
    may_be_thousands = all(re.fullmatch(r"[+-]?[1-9]\d{0,2},\d{3}", cell) for cell in commas)
    return "." if may_be_thousands else ","


def cell_values(
    cells: pl.Series, missing: Collection[str], decimal: str
) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """Read a column of cells.

    Parameters
    ----------
    cells
        Text, (n,), or numbers where the format has them.
    missing
        Words for a failed reading.
    decimal
        `.` or `,`.

    Returns
    -------
    values
        Shape (n,): truth values, whole numbers, or else numbers with NaN for missing ones.
    unread
        Places of the cells that are no numbers; they are NaN, too.
    """
    none_unread = np.zeros(0, np.intp)
    if cells.dtype != pl.String:
        if not cells.null_count() and cells.dtype != pl.Float32:
            return cells.to_numpy(), none_unread
        return cells.cast(pl.Float64).fill_null(np.nan).to_numpy(), none_unread
    first = cells[:FIRST_LINES]
    if first.str.to_lowercase().is_in(TRUTHS).any():
        is_missing = cells.is_null() | cells.is_in(list(missing))
        words = cells.str.to_lowercase()
        if (words.is_in(TRUTHS) | is_missing).all():
            truths = (words == "true").fill_null(False).to_numpy()
            return np.ma.array(truths, mask=is_missing.to_numpy()), none_unread
    if first.str.contains(WHOLE).all():  # floats would round nanoseconds since 1970
        whole_numbers = cells.cast(pl.Int64, strict=False)
        if not whole_numbers.null_count():
            return whole_numbers.to_numpy(), none_unread
    return cell_numbers(cells, missing, decimal)


def cell_numbers(
    cells: pl.Series, missing: Collection[str], decimal: str
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Read cells of text as numbers (n,), NaN where a cell is null, one of the missing words, or no
    number; the places of the latter are given, too."""
    is_missing = (cells.is_null() | cells.is_in(list(missing))).to_numpy()
    if decimal == ",":  # a full stop separates thousands then: the cell is no plain number
        cells = cells.str.replace(".", "?", literal=True).str.replace(",", ".", literal=True)
    values = cells.cast(pl.Float64, strict=False).fill_null(np.nan).to_numpy()
    is_read = np.isfinite(values) & ~is_missing
    return np.where(is_read, values, np.nan), np.flatnonzero(~is_read & ~is_missing)


def are_times(cells: pl.Series) -> bool:
    """Tell whether all cells of a column are times of day or dates; the first ones are tried
    first."""
    if cells.dtype.is_temporal():
        return cells.null_count() == 0
    if cells.dtype != pl.String or not len(cells):
        return False
    parts = (cells[:FIRST_LINES], cells)
    return all(part.str.contains(TIME).fill_null(False).all() for part in parts)


def cell_stamps(cells: pl.Series) -> NDArray[np.int64]:
    """Read cells for which `are_times` holds as whole nanoseconds, (n,).

    Times such as `10:12:13.002`, `2024-05-01T10:12:13Z`, `0 days 00:00:00.002` and `0.002 sec`.
    Dates and zones are ignored: times just go on past midnight.
    """
    if cells.dtype.is_temporal():
        is_date = cells.dtype in (pl.Date, pl.Datetime)
        in_ns = cells.cast(pl.Datetime("ns") if is_date else pl.Duration("ns"))
        return in_ns.cast(pl.Int64).to_numpy()
    parts = cells.str.extract_groups(TIME).struct.unnest()
    fraction = pl.coalesce("fraction", "fraction_alone")
    fraction_ns = fraction.str.pad_end(9, "0").cast(pl.Int64)
    matlab_ns = pl.col("matlab_s").cast(pl.Float64) * SECOND_NS
    numbers = parts.select(
        pl.col("days", "hours").cast(pl.Int64),
        pl.coalesce("minutes", "minutes_alone").cast(pl.Int64),
        pl.coalesce("seconds", "seconds_alone").cast(pl.Int64),
        fraction_ns.fill_null(matlab_ns.round().cast(pl.Int64)),
        pl.col("half").str.to_lowercase(),
    ).fill_null(0)
    hours_of_day = pl.col("hours") % 12 + 12 * (pl.col("half") == "p")
    since_midnight = pl.duration(
        days="days",
        hours=hours_of_day.fill_null(pl.col("hours")),
        minutes="minutes",
        seconds="seconds",
        nanoseconds="fraction",
        time_unit="ns",
    )
    stamps = numbers.select(since_midnight.cast(pl.Int64)).to_series().to_numpy()
    begins_anew = np.diff(stamps, prepend=stamps[:1]) < -DAY_NS // 2
    return stamps + DAY_NS * np.cumsum(begins_anew)
