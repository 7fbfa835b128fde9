"""Cells of text as numbers and times, as programs of all countries write them."""

import re
from collections import Counter
from collections.abc import Collection, Sequence
from itertools import zip_longest
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

MISSING = (
    "", "nan", "NaN", "NAN", "NA", "N/A", "#N/A", "null", "NULL", "None", "<NA>", "NaT",
    "-nan", "nan(ind)", "-nan(ind)",
)  # fmt: skip
"""Cells that programs write for a failed reading."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d{1,3})?", re.ASCII)
OTHER_SIGN = {".": ",", ",": "."}  # which separates thousands, by the decimal sign
SMALL_WHOLE = re.compile(r"[+-]?\d{1,3}")
WHOLE = r"^[+-]?\d+$"
TRUTHS = ("true", "false")  # in any case, as loggers in Python write them
TIME = (
    r"^(?:\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[T ]\s*)?(?:(?<days>\d+) days?,? )?"
    r"\+?(?<hours>\d{1,3}):(?<minutes>\d{2})(?::(?<seconds>\d{1,2}))?"
    r"(?:[.,:](?<fraction>\d{1,9}))?\d*(?: ?(?<half>[AaPp])\.?[Mm]\.?)?"
    r"\s*(?:Z|UTC|(?<zone>[+-]\d{2}):?(?<zone_minutes>\d{2}))?$"
)
TIME_OF_CELL = re.compile(TIME.replace("(?<", "(?P<"))
# MATLAB writes the times of a timetable so
SECONDS = r"^(\d{1,12}(?:\.\d{1,15})?(?:[eE][+-]?\d{1,3})?) sec$"
DAY_NS = 86_400_000_000_000
HOUR_NS = 3_600_000_000_000
FIRST_TRIED = 9  # cells that are looked at before a whole column is
FIRST_ROWS, LAST_ROWS = 300, 60  # of a table, by which its decimal sign is found


def is_number_cell(cell: str) -> bool:
    """Tell whether a cell is a number with a decimal point, or a whole one."""
    return NUMBER.fullmatch(cell) is not None


def has_thousands(cell: str, decimal: str) -> bool:
    """Tell whether a number has both signs: `12.681,27`."""
    other = OTHER_SIGN[decimal]
    return re.fullmatch(rf"[+-]?\d{{1,3}}(\{other}\d{{3}})+\{decimal}\d+", cell) is not None


def is_grouped(cell: str, sign: str) -> bool:
    """Tell whether a sign may separate the thousands of a whole number: `1.000`."""
    return re.fullmatch(rf"[+-]?[1-9]\d{{0,2}}(\{sign}\d{{3}})+", cell) is not None


def is_value(cell: str) -> bool:
    """Tell whether a cell may be one of a column of numbers or times."""
    if is_number_cell(cell.replace(",", ".", 1)):
        return True
    if cell in MISSING or cell.casefold() in TRUTHS:
        return True
    if any(has_thousands(cell, decimal) for decimal in OTHER_SIGN):
        return True
    return TIME_OF_CELL.match(cell) is not None or re.match(SECONDS, cell) is not None


def name_and_unit(title: str) -> tuple[str, str]:
    """Split `torque [Nm]`, `torque (Nm)`, `torque {Nm}` or `torque / Nm` into name and unit; the
    unit is empty if there is none."""
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


def decimal_of(rows: Sequence[Sequence[str | None]]) -> str:
    """Find the decimal sign of the cells of rows.

    It is a comma if numbers have commas and no stops, unless all of these may separate thousands.
    """
    columns = zip_longest(*rows[:FIRST_ROWS], *rows[-LAST_ROWS:])
    numbers = [[cell for cell in {*column} if cell and is_value(cell)] for column in columns]
    ungrouped = [column for column in numbers if not are_whole_thousands(column, ".")]
    cells = {cell for column in ungrouped for cell in column}
    if any(has_thousands(cell, ",") for cell in cells):
        return ","
    has_stops = any(re.fullmatch(r"[+-]?\d*\.\d+([eEdD][+-]?\d+)?", cell) for cell in cells)
    if len(ungrouped) < len(numbers):  # a column has stops between its thousands
        return "." if has_stops else ","
    commas = [cell for cell in cells if re.fullmatch(r"[+-]?\d*,\d+([eE][+-]?\d+)?", cell)]
    may_be_thousands = all(is_grouped(cell, ",") for cell in commas)
    return "," if commas and not has_stops and not may_be_thousands else "."


def are_whole_thousands(cells: Collection[str], sign: str) -> bool:
    """Tell whether a sign separates thousands of whole numbers in a column: `998` and `1.000`.

    As a decimal sign it would stand in every number if three decimals are written, and no number
    would end in 0 if zeros are left out.
    """
    grouped = [cell for cell in cells if not SMALL_WHOLE.fullmatch(cell)]
    has_final_zero = any(cell.endswith("0") for cell in grouped)
    return (
        len(grouped) < len(cells)
        and has_final_zero
        and all(is_grouped(cell, sign) for cell in grouped)
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
        is_number = cells.dtype in (pl.Boolean, pl.Float64) or cells.dtype.is_integer()
        if is_number and not cells.null_count():
            return cells.to_numpy(), none_unread
        return cells.cast(pl.Float64).fill_null(np.nan).to_numpy(), none_unread
    if cells[:FIRST_TRIED].str.to_lowercase().is_in(TRUTHS).any():
        words = cells.str.to_lowercase()
        is_missing: NDArray[np.bool_] = (cells.is_null() | cells.is_in(list(missing))).to_numpy()
        if (words.is_in(TRUTHS).fill_null(False).to_numpy() | is_missing).all():
            truths: NDArray[np.bool_] = (words == "true").fill_null(False).to_numpy()
            values = np.ma.array(truths, mask=is_missing) if is_missing.any() else truths
            return values, none_unread
    if cells[:FIRST_TRIED].str.contains(WHOLE).fill_null(False).all():
        # floats would round nanoseconds since 1970
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
    filled = cells.filter(~pl.Series(is_missing))
    values = np.full(len(cells), np.nan)
    for write_plainly in (_with_point, _without_thousands):
        numbers = write_plainly(filled, decimal).cast(pl.Float64, strict=False).to_numpy()
        is_read = np.isfinite(numbers)
        if is_read.all():
            break
    values[~is_missing] = np.where(is_read, numbers, np.nan)
    return values, np.flatnonzero(~is_missing)[~is_read]


def _with_point(cells: pl.Series, decimal: str) -> pl.Series:
    if decimal == ".":
        return cells
    # a full stop separates thousands, or `decimal` is wrong: the cell is then no plain number
    return cells.str.replace(".", "?", literal=True).str.replace(",", ".", literal=True)


def _without_thousands(cells: pl.Series, decimal: str) -> pl.Series:
    """Write numbers as `12,681.27` and `1.0D-3` in the way of today."""
    other = OTHER_SIGN[decimal]
    is_grouped_cell = cells.str.contains(rf"^[+-]?\d{{1,3}}(\{other}\d{{3}})+\{decimal}\d+$")
    if are_whole_thousands(cells.to_list(), other):
        is_grouped_cell = is_grouped_cell | True
    plain = cells.str.replace_all(other, "", literal=True).zip_with(is_grouped_cell, cells)
    return _with_point(plain, decimal).str.replace(r"^([+-]?[\d.]+)[dD]([+-]?\d+)$", "${1}e$2")


def are_times(cells: pl.Series) -> bool:
    """Tell whether all cells of a column are times of day or dates; the first ones are tried
    first."""
    if cells.dtype.is_temporal():
        return cells.null_count() == 0
    if cells.dtype != pl.String or not len(cells):
        return False
    for pattern in (SECONDS, TIME):
        first, every = (
            some.str.contains(pattern).fill_null(False) for some in (cells[:FIRST_TRIED], cells)
        )
        if first.all() and every.all():
            return True
    return False


def cell_stamps(cells: pl.Series) -> NDArray[np.int64]:
    """Read cells for which `are_times` holds as whole nanoseconds, (n,).

    Times such as `10:12:13.002`, `2024-05-01T10:12:13Z`, `0 days 00:00:00.002` and `12:13.5`
    (minutes and seconds). Dates are ignored: times just go on past midnight.
    """
    if cells.dtype.is_temporal():
        is_date = cells.dtype in (pl.Date, pl.Datetime)
        in_ns = cells.cast(pl.Datetime("ns") if is_date else pl.Duration("ns"))
        return in_ns.cast(pl.Int64).to_numpy()
    if cells.str.contains(SECONDS).all():
        in_s = cells.str.extract(SECONDS).cast(pl.Float64)
        return (in_s * 1e9).round().cast(pl.Int64).to_numpy()
    parts = cells.str.extract_groups(TIME).struct.unnest()
    names = ("days", "hours", "minutes", "seconds", "zone", "zone_minutes")
    days, hours, minutes, seconds, zone_hours, zone_minutes = (
        parts[name].cast(pl.Int64).fill_null(0).to_numpy() for name in names
    )
    half = parts["half"].str.to_lowercase().fill_null("").to_numpy()
    hours = np.where(half == "", hours, hours % 12 + 12 * (half == "p"))
    whole_min = (days * 24 + hours - zone_hours) * 60 + minutes - zone_minutes
    whole_s = whole_min * 60 + seconds
    turn = DAY_NS
    has_no_seconds = parts["seconds"].null_count() == len(cells)
    if has_no_seconds and parts["fraction"].null_count() < len(cells):
        turn = HOUR_NS
        whole_s = whole_min  # what stands first are minutes
    fraction_ns = parts["fraction"].fill_null("").str.pad_end(9, "0").cast(pl.Int64).to_numpy()
    stamps = whole_s * 1_000_000_000 + fraction_ns
    begins_anew = np.diff(stamps, prepend=stamps[:1]) < -turn // 2
    return np.asarray(stamps + turn * np.cumsum(begins_anew))


def most_common_width(rows: Sequence[Sequence[str]]) -> int:
    """The number of cells that most rows have; 0 without rows."""
    widths = Counter(len(cells) for cells in rows).most_common(1)
    return widths[0][0] if widths else 0
