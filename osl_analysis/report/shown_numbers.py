"""Cells and estimates of result tables as the page shows them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from osl_analysis.dictionary import described_tables_by_name
from osl_analysis.report.decimal_places import digits_of, fixed
from osl_analysis.report.typography import printed

NO_VALUE = "–"


def cell_text(value: Any) -> str:
    """A cell of a table as the page has it: numbers with six digits, text as it is."""
    if value is None:
        return NO_VALUE
    if not isinstance(value, float):
        return str(value)
    # the blank behind it tells the end of a power
    return printed(f"{value:.6g} ").rstrip() if math.isfinite(value) else NO_VALUE


def unit_and_meaning(column: str, table: str) -> dict[str, str]:
    """`unit` and `meaning` of a column of a result table; empty if it is not described."""
    tables = described_tables_by_name()
    if table not in tables or column not in tables[table].columns:
        return {"unit": "", "meaning": ""}
    described = tables[table].columns[column]
    return {"unit": printed(described.unit), "meaning": described.meaning}


@dataclass(frozen=True)
class ShownEstimate:
    """A number of a result table with its interval, as the page shows it and in full."""

    column: str
    text: str  # with as many digits as its interval allows
    interval: str  # empty where it has none
    full: Sequence[float | None]  # value and ends of the interval; None where one is missing


def shown_estimate(row: Mapping[str, Any], column: str) -> ShownEstimate:
    """A column of a row, with the ends `_low` and `_high` of its interval."""
    full: list[float | None] = []
    for name in (column, f"{column}_low", f"{column}_high"):
        number = row.get(name)
        is_number = isinstance(number, int | float) and math.isfinite(number)
        full.append(number if is_number else None)
    value, low, high = row.get(column), row.get(f"{column}_low"), row.get(f"{column}_high")
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ShownEstimate(column, NO_VALUE, "", full)
    if low is None or high is None:
        text = f"{value:.4g}" if full[0] is not None else cell_text(value)
        return ShownEstimate(column, text, "", full)
    places = digits_of(value, low, high)
    interval = f"[{fixed(low, places.ends)}, {fixed(high, places.ends)}]"
    return ShownEstimate(column, printed(fixed(value, places.value)), printed(interval), full)
