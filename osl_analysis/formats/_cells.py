"""Cells of text as numbers and times, as programs of all countries write them."""

import re
from collections import Counter
from collections.abc import Collection, Sequence
from itertools import zip_longest
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError

MISSING = (
    "", "nan", "NaN", "NAN", "NA", "N/A", "#N/A", "null", "NULL", "None", "<NA>", "NaT",
    "-nan", "nan(ind)", "-nan(ind)",
)  # fmt: skip
"""Cells that programs write for a failed reading."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d{1,3})?", re.ASCII)
WHOLE = r"^[+-]?\d+$"
TRUTHS = ("true", "false")  # in any case, as loggers in Python write them
# a time of day, or seconds as MATLAB writes those of a timetable
TIME = (
    r"^(?:(?P<matlab_s>\d+(?:\.\d+)?(?:[eE][+-]?\d+)?) sec|"
    r"(?:\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[T ]\s*)?(?:(?P<days>\d+) days?,? )?"
    r"\+?(?P<hours>\d{1,3}):(?P<minutes>\d{2}):(?P<seconds>\d{1,2})"
    r"(?:[.,:](?P<fraction>\d{1,9}))?\d*(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?"
    r"\s*(?:Z|UTC|[+-]\d{2}:?(?:\d{2})?)?)$"
)
TIME_OF_CELL = re.compile(TIME)
SECONDS_IN = {"days": 86_400, "hours": 3600, "minutes": 60, "seconds": 1}
SECOND_NS = 1_000_000_000
DAY_NS = 86_400 * SECOND_NS
FIRST_TRIED = 9  # cells that are looked at before a whole column is
FIRST_ROWS, LAST_ROWS = 300, 60  # of a table, by which its decimal sign is found


def is_number_cell(cell: str) -> bool:
    """Tell whether a cell is a number with a decimal point, or a whole one."""
    return NUMBER.fullmatch(cell) is not None


def is_value(cell: str) -> bool:
    """Tell whether a cell may be one of a column of numbers or times."""
    if cell in MISSING or cell.casefold() in TRUTHS:
        return True
    return is_number_cell(cell.replace(",", ".", 1)) or TIME_OF_CELL.match(cell) is not None


def name_and_unit(title: str) -> tuple[str, str]:
    """Split `torque [Nm]`, `torque (Nm)`, `torque {Nm}` or `torque / Nm` into name and unit; the
    unit is empty if there is none. The index of `q[5]` is none."""
    if re.search(r"\w\[\d+\]$", title):
        return title, ""
    in_brackets = r"\[[^\[\]]*\]|\([^()]*\)|\{[^{}]*\}"
    match = re.fullmatch(rf"(.*\S)\s*({in_brackets})|(.*\S)\s+/\s+(\S.*)", title, re.DOTALL)
    if not match:
        return title, ""
    return (match[1], match[2][1:-1]) if match[1] else (match[3], match[4])


def without_brackets(unit: str) -> str:
    """Write a unit from a row of units without its brackets: `[deg]` and `(deg)` become `deg`."""
    return re.sub(r"^(\[.*\]|\(.*\)|\{.*\})$", lambda match: match[0][1:-1].strip(), unit)


def is_last_whole(cells: Sequence[str]) -> bool:
    """Tell whether the last cell of a file without a final line break is complete.

    It is if it has as many decimals as all others of its column. Whole numbers do not tell.
    """
    decimals = {len(cell.replace(",", ".").partition(".")[2]) for cell in cells}
    return len(cells) > 1 and len(decimals) == 1 and 0 not in decimals


def decimal_of(rows: Sequence[Sequence[str]]) -> str:
    """Find the decimal sign of the cells of rows.

    It is a comma if numbers have commas and no stops, unless all commas may separate thousands.

    Raises
    ------
    InputError
        Stops separate thousands: read as decimals, they would be silently wrong.
    """
    cells: set[str] = set()
    columns = zip_longest(*rows[:FIRST_ROWS], *rows[-LAST_ROWS:], fillvalue="")
    for place, column in enumerate(columns, start=1):
        numbers = {cell for cell in column if re.fullmatch(r"[+-]?\d*[.,]?\d+", cell)}
        _check_thousands(place, numbers)
        cells |= {*column}
    if any(re.fullmatch(r"[+-]?\d*\.\d+([eEdD][+-]?\d+)?", cell) for cell in cells):
        return "."
    commas = [cell for cell in cells if re.fullmatch(r"[+-]?\d*,\d+([eE][+-]?\d+)?", cell)]
    may_be_thousands = all(re.fullmatch(r"[+-]?[1-9]\d{0,2},\d{3}", cell) for cell in commas)
    return "." if may_be_thousands else ","


def _check_thousands(place: int, numbers: Collection[str]) -> None:
    """Refuse a column in which `1.000` stands beside `998`.

    As a decimal sign the stop would stand in every number if three decimals are written, and no
    number would end in 0 if zeros are left out.
    """
    small = [number for number in numbers if re.fullmatch(r"[+-]?\d{1,3}", number)]
    grouped = [number for number in numbers if re.fullmatch(r"[+-]?[1-9]\d{0,2}\.\d{3}", number)]
    ends_in_zero = any(number.endswith("0") for number in grouped)
    if small and ends_in_zero and len(small) + len(grouped) == len(numbers):
        raise InputError(
            f"column {place}: '{max(grouped)}' stands beside '{small[0]}', as with a sign between"
            " thousands; write numbers without it"
        )


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
    first = cells[:FIRST_TRIED]
    if first.str.to_lowercase().is_in(TRUTHS).any():
        is_missing = cells.is_null() | cells.is_in(list(missing))
        words = cells.str.to_lowercase()
        if (words.is_in(TRUTHS) | is_missing).all():
            truths = np.ma.array((words == "true").fill_null(False).to_numpy())
            if is_missing.any():
                truths.mask = is_missing.to_numpy()
            return truths, none_unread
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
    parts = (cells[:FIRST_TRIED], cells)
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
    numbers = {name: parts[name].cast(pl.Int64).fill_null(0).to_numpy() for name in SECONDS_IN}
    half = parts["half"].str.to_lowercase().fill_null("").to_numpy()
    hours_of_half = numbers["hours"] % 12 + 12 * (half == "p")
    numbers["hours"] = np.where(half == "", numbers["hours"], hours_of_half)
    whole_s = sum(number * SECONDS_IN[name] for name, number in numbers.items())
    fraction_ns = parts["fraction"].fill_null("").str.pad_end(9, "0").cast(pl.Int64).to_numpy()
    matlab_ns = (parts["matlab_s"].cast(pl.Float64).fill_null(0.0) * SECOND_NS).round()
    stamps = whole_s * SECOND_NS + fraction_ns + matlab_ns.cast(pl.Int64).to_numpy()
    begins_anew = np.diff(stamps, prepend=stamps[:1]) < -DAY_NS // 2
    return np.asarray(stamps + DAY_NS * np.cumsum(begins_anew))


def most_common_width(rows: Sequence[Sequence[str]]) -> int:
    """The number of cells that most rows have; 0 without rows."""
    widths = Counter(len(cells) for cells in rows).most_common(1)
    return widths[0][0] if widths else 0
