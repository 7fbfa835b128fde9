"""Cells of text as numbers and times, as programs of all countries write them."""

import math
import re
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
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
WITH_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
WITH_STOP = re.compile(r"[+-]?\d*\.\d+([eEdD][+-]?\d+)?")
# by decimal sign: numbers whose thousands are separated by the other sign
THOUSANDS = {
    ".": re.compile(r"([+-]?\d{1,3}(?:,\d{3})+)\.(\d+)"),
    ",": re.compile(r"([+-]?\d{1,3}(?:\.\d{3})+),(\d+)"),
}
# whole numbers, by the sign between their thousands
WHOLE_THOUSANDS = {
    ",": re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+"),
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+"),
}
SMALL_WHOLE = re.compile(r"[+-]?\d{1,3}")
WHOLE = r"^[+-]?\d+$"
TRUTHS = ("true", "false")  # in any case, as loggers in Python write them
CLOCK = (
    r"(?:(\d+) days?,? )?\+?(\d{1,3}):(\d{2})(?::(\d{1,2}))?(?:[.,:](\d{1,9}))?\d*(?:"
    r" ?([AaPp])\.?[Mm]\.?)?"
)
TIME = (
    r"^(?:\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[T"
    rf" ]\s*)?{CLOCK}\s*(?:Z|UTC|([+-]\d{{2}}):?(\d{{2}}))?$"
)
# MATLAB writes the times of a timetable so
SECONDS = r"^(\d{1,12}(?:\.\d{1,15})?(?:[eE][+-]?\d{1,3})?) sec$"
DAY_NS = 86_400_000_000_000
HOUR_NS = 3_600_000_000_000
FIRST_TRIED = 9  # cells that are looked at before a whole column is
FIRST_ROWS, LAST_ROWS = 300, 60  # of a table, by which its decimal sign is found


def is_number_cell(cell: str) -> bool:
    """Tell whether a cell is a number with a decimal point, or a whole one."""
    return NUMBER.fullmatch(cell) is not None and math.isfinite(_number(cell))


def _number(cell: str) -> float:
    return float(cell.replace("d", "e").replace("D", "e"))  # Fortran writes `1.0D-3`


def is_value(cell: str) -> bool:
    """Tell whether a cell may be one of a column of numbers or times."""
    if is_number_cell(cell.replace(",", ".", 1)):
        return True
    if cell in MISSING or cell.casefold() in TRUTHS:
        return True
    if any(pattern.fullmatch(cell) for pattern in THOUSANDS.values()):
        return True
    return re.match(TIME, cell) is not None or re.match(SECONDS, cell) is not None


def name_and_unit(title: str) -> tuple[str, str]:
    """Split `torque [Nm]`, `torque (Nm)`, `torque {Nm}` or `torque / Nm` into name and unit; the
    unit is empty if there is none."""
    match = re.fullmatch(
        r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\)|\{([^{}]*)\})|(.*\S)\s+/\s+(\S.*)",
        title,
        re.DOTALL,
    )
    if not match:
        return title, ""
    name = match[1] or match[5]
    unit = match[2] or match[3] or match[4] or match[6] or ""
    return name, unit


def without_brackets(unit: str) -> str:
    """Write a unit from a row of units without its brackets: `[deg]` and `(deg)` become `deg`."""
    is_bracketed = unit[:1] + unit[-1:] in ("[]", "()", "{}")
    return unit[1:-1].strip() if is_bracketed else unit


def is_last_whole(cells: Sequence[str]) -> bool:
    """Tell whether the last cell of a file without a final line break is complete.

    It is if it has as many decimals as all others of its column. Whole numbers do not tell.
    """
    decimals: set[int] = set()
    for cell in cells:
        _, sign, behind = cell.replace(",", ".").partition(".")
        decimals.add(len(behind) if sign else 0)
    return len(cells) > 1 and len(decimals) == 1 and 0 not in decimals


def decimal_of(rows: Sequence[Sequence[str | None]]) -> str:
    """Find the decimal sign of the cells of rows.

    It is a comma if numbers have commas and no stops, unless all of these may separate thousands.
    """
    columns = zip_longest(*rows[:FIRST_ROWS], *rows[-LAST_ROWS:])
    numbers: list[list[str]] = []
    for column in columns:
        cells = {cell or "" for cell in column} - set(MISSING)
        numbers.append([cell for cell in cells if is_value(cell)])
    ungrouped = [column for column in numbers if not are_whole_thousands(column, ".")]
    cells = {cell for column in ungrouped for cell in column}
    if any(THOUSANDS[","].fullmatch(cell) for cell in cells):
        return ","
    has_stops = any(WITH_STOP.fullmatch(cell) for cell in cells)
    if len(ungrouped) < len(numbers):  # a column has stops between its thousands
        return "." if has_stops else ","
    commas = [cell for cell in cells if WITH_COMMA.fullmatch(cell)]
    may_be_thousands = all(WHOLE_THOUSANDS[","].fullmatch(cell) for cell in commas)
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
        and all(WHOLE_THOUSANDS[sign].fullmatch(cell) for cell in grouped)
    )


@dataclass
class UnreadableCellError(Exception):
    """A cell that is not a number."""

    place: int  # in the column, from 0


def cell_values(cells: pl.Series, missing: Collection[str], decimal: str) -> NDArray[Any]:
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
    ndarray
        Shape (n,): truth values, whole numbers, or else numbers with NaN for missing ones.

    Raises
    ------
    UnreadableCellError
    """
    if cells.dtype == pl.Boolean and not cells.null_count():
        return cells.to_numpy()
    is_number = cells.dtype == pl.Float64 or cells.dtype.is_integer()
    if is_number and not cells.null_count():
        return cells.to_numpy()
    if cells.dtype != pl.String:
        return cells.cast(pl.Float64).fill_null(np.nan).to_numpy()
    if cells[:FIRST_TRIED].str.to_lowercase().is_in(TRUTHS).any():
        words = cells.str.to_lowercase()
        is_missing: NDArray[np.bool_] = (cells.is_null() | cells.is_in(list(missing))).to_numpy()
        if (words.is_in(TRUTHS).fill_null(False).to_numpy() | is_missing).all():
            truths: NDArray[np.bool_] = (words == "true").fill_null(False).to_numpy()
            return np.ma.array(truths, mask=is_missing) if is_missing.any() else truths
    if cells[:FIRST_TRIED].str.contains(WHOLE).fill_null(False).all():
        # floats would round nanoseconds since 1970
        whole_numbers = cells.cast(pl.Int64, strict=False)
        if not whole_numbers.null_count():
            return whole_numbers.to_numpy()
    return cell_numbers(cells, missing, decimal)


def cell_numbers(cells: pl.Series, missing: Collection[str], decimal: str) -> NDArray[np.float64]:
    """Read cells of text as numbers (n,): NaN where a cell is null or one of the missing words.

    Raises
    ------
    UnreadableCellError
    """
    is_missing = (cells.is_null() | cells.is_in(list(missing))).to_numpy()
    with_stop = cells
    if decimal == ",":
        # a full stop separates thousands, or `decimal` is wrong: the cell is then no plain number
        with_stop = cells.str.replace(".", "?", literal=True).str.replace(",", ".", literal=True)
    values = with_stop.cast(pl.Float64, strict=False).to_numpy().copy()
    values[is_missing] = np.nan
    unread = np.flatnonzero(~np.isfinite(values) & ~is_missing).tolist()
    if not unread:
        return values
    other_sign = "." if decimal == "," else ","
    if WHOLE_THOUSANDS[other_sign].fullmatch(str(cells[unread[0]])):
        filled_cells = cells.filter(~pl.Series(is_missing)).to_list()
        if are_whole_thousands(filled_cells, other_sign):
            plain = cells.str.replace_all(other_sign, "", literal=True)
            return cell_numbers(plain, missing, decimal)
    for place in unread:  # polars does not read `+1.5` and `1.0D-3`
        cell = str(with_stop[place])
        grouped = THOUSANDS[decimal].fullmatch(str(cells[place]))
        if grouped:  # in `12.681,27` it is clear which sign is which
            cell = f"{re.sub('[.,]', '', grouped[1])}.{grouped[2]}"
        if not is_number_cell(cell):
            raise UnreadableCellError(place)
        values[place] = _number(cell)
    return values


def readable_numbers(cells: pl.Series, decimal: str) -> NDArray[np.float64]:
    """Read the cells that are numbers, (n,); NaN elsewhere."""
    if cells.dtype == pl.String:
        with_stop = cells.str.replace(decimal, ".", literal=True)
        plain = with_stop.str.replace(r"^([+-]?[\d.]+)[dD]([+-]?\d+)$", "${1}e$2")
        cells = plain.str.strip_prefix("+")
    return cells.cast(pl.Float64, strict=False).fill_null(np.nan).to_numpy()


def are_times(cells: pl.Series) -> bool:
    """Tell whether all cells of a column are times of day or dates; the first ones are tried
    first."""
    if cells.dtype.is_temporal():
        return cells.null_count() == 0
    if cells.dtype != pl.String or not len(cells):
        return False
    for pattern in (SECONDS, TIME):
        if all(
            some.str.contains(pattern).fill_null(False).all()
            for some in (cells[:FIRST_TRIED], cells)
        ):
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
    parts = [cells.str.extract(TIME, group) for group in range(1, 9)]
    days, hours, minutes, seconds = (
        part.cast(pl.Int64).fill_null(0).to_numpy() for part in parts[:4]
    )
    are_minutes_first = parts[3].null_count() == len(cells) and parts[4].null_count() < len(cells)
    if are_minutes_first:
        seconds = minutes
        minutes = hours
        hours = np.zeros_like(hours)
    fraction_ns = parts[4].fill_null("").str.pad_end(9, "0").cast(pl.Int64).to_numpy()
    if not parts[5].null_count():
        is_afternoon = parts[5].str.to_lowercase().eq("p").to_numpy()
        hours = hours % 12 + 12 * is_afternoon
    zone_hours, zone_minutes = (part.cast(pl.Int64).fill_null(0).to_numpy() for part in parts[6:8])
    zone = 60 * zone_hours + zone_minutes
    total_s = ((days * 24 + hours) * 60 + minutes - zone) * 60 + seconds
    stamps = total_s * 1_000_000_000 + fraction_ns
    turn = DAY_NS if hours.any() else HOUR_NS
    begins_anew = np.diff(stamps, prepend=stamps[:1]) < -turn // 2
    return np.asarray(stamps + turn * np.cumsum(begins_anew))


def most_common_width(rows: Sequence[Sequence[str]]) -> int:
    """The number of cells that most rows have; 0 without rows."""
    widths = Counter(len(cells) for cells in rows).most_common(1)
    return widths[0][0] if widths else 0
