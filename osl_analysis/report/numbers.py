"""Numbers of the page, rounded by their intervals, and the estimates of a trial from the rows of its table."""

import math
from collections.abc import Mapping
from typing import Any

import polars as pl

from osl_analysis.dictionary import DescribedTable
from osl_analysis.summary.text import decimals, fixed

QUALITY_OF_FIT = ("VAF", "R2")
"""Numbers of a fit without an interval that stand beside its estimates."""
UNKNOWN = "–"


def shown(value: Any) -> str:
    """A cell of a table as the page has it: numbers with six digits, text as it is."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return UNKNOWN
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def estimate(value: float | None, low: float | None = None, high: float | None = None) -> tuple[str, str]:
    """A value with as many digits as its interval allows, and the interval; empty where it has none."""
    if value is None or not math.isfinite(value):
        return UNKNOWN, ""
    if low is None or high is None:
        return f"{value:.4g}", ""
    digits = decimals(value, low, high, None)
    return fixed(value, digits), f"[{fixed(low, digits)}, {fixed(high, digits)}]"


def estimated(table: pl.DataFrame) -> list[str]:
    """The columns of a table that are estimates with an interval."""
    return [name for name in table.columns if {f"{name}_low", f"{name}_high"} <= set(table.columns)]


def estimates_of(table: pl.DataFrame, described: DescribedTable | None) -> dict[str, Any]:
    """The estimates of one trial: `columns` with name, unit and meaning, and a row of texts per fit."""
    with_interval = estimated(table)
    names = [*with_interval, *(name for name in QUALITY_OF_FIT if name in table.columns)]
    columns = [{"name": name, **said_of(name, described)} for name in names]
    first = ["amplitude_deg"] * ("amplitude_deg" in table.columns)
    rows = []
    for row in table.iter_rows(named=True):
        head = ["all" if row[name] is None else f"{row[name]:g}" for name in first]
        ends = [(row[name], row.get(f"{name}_low"), row.get(f"{name}_high")) for name in names]
        rows.append([*head, *(" ".join(estimate(*number)).strip() for number in ends)])
    return {"columns": [{"name": name, **said_of(name, described)} for name in first] + columns, "rows": rows}


def every_column(table: pl.DataFrame, described: DescribedTable | None) -> list[list[str]]:
    """Every filled column of the last row of a trial, which is the fit to all of it: name, value, unit, meaning."""
    row = table.row(-1, named=True) if len(table) else {}
    return [
        [name, shown(value), *said_of(name, described).values()]
        for name, value in row.items()
        if value not in (None, "")
    ]


def said_of(column: str, described: DescribedTable | None) -> dict[str, str]:
    """Unit and meaning of a column; empty where nobody describes it."""
    known = described.columns.get(column) if described else None
    return {"unit": printed(known.unit) if known else "", "meaning": known.meaning if known else ""}


def printed(unit: str) -> str:
    """A unit as it is printed; empty for 1."""
    return "" if unit == "1" else unit.replace("*", "·").replace("^2", "²")


def number_cell(row: Mapping[str, Any], column: str) -> dict[str, str]:
    """An estimate of a row as a cell: `column`, the value by which it is sorted, its `text` and `interval`."""
    value = row.get(column)
    if not isinstance(value, int | float) or not math.isfinite(value):
        return {"column": column, "sort": "", "text": UNKNOWN, "interval": ""}
    text, interval = estimate(float(value), row.get(f"{column}_low"), row.get(f"{column}_high"))
    return {"column": column, "sort": repr(value), "text": text, "interval": interval}
