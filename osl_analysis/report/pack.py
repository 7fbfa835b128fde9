"""Signals as short text that a page unpacks: differences of 14-bit counts, deflated, in base64."""

import json
import zlib
from base64 import b64encode
from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.trial import Array

NO_VALUE = -32768
"""Count of a sample that has no value."""
LARGEST = 8191
"""Largest count: two more bits would make the page a quarter larger, and show nothing more."""
FEWEST_PACKED = 200
"""Rows from which on a table is packed; a shorter one is written as numbers."""
DIGITS = 7
"""Significant digits of a number that is written."""
EVEN = 1e-6
"""Relative departure from even steps up to which a column is written as its first value and its step."""

Packed = dict[str, Any]


def packed_table(table: pl.DataFrame) -> Packed:
    """A table of numbers for the page: `rows`, `plain` columns as lists, `even` ones as start and step, and `counts`.

    `counts` has, per column, the value of count 0 and that of one count. `data` holds, one column after the other, the
    differences of its counts modulo 2^16: all low bytes, then all high bytes, which deflates better than pairs.
    Rounding to counts costs at most 1/32 000 of a column's range.
    """
    if len(table) < FEWEST_PACKED:
        return {"rows": len(table), "plain": {name: plain(table[name]) for name in table.columns}}
    even: dict[str, list[float]] = {}
    counts: dict[str, list[float]] = {}
    data = []
    for name in table.columns:
        values = table[name].cast(pl.Float64).fill_null(np.nan).to_numpy()
        step = even_step(values)
        if step is None:
            numbers, centre, unit = counted(values)
            differences = np.diff(numbers, prepend=np.int16(0)).astype("<i2").tobytes()
            data += [differences[0::2], differences[1::2]]
            counts[name] = [centre, unit]
        else:
            even[name] = [float(values[0]), step]
    return {"rows": len(table), "even": even, "counts": counts, "data": deflated(b"".join(data))}


def plain(values: pl.Series) -> list[Any]:
    """The values of a short column; null for what is not finite."""
    if not values.dtype.is_numeric():
        return values.to_list()
    return [rounded(value) for value in values.cast(pl.Float64).to_list()]


def rounded(value: float | None) -> float | None:
    """A number with as many digits as the page has; None for what is not finite."""
    return None if value is None or not np.isfinite(value) else float(f"{value:.{DIGITS}g}")


def even_step(values: Array) -> float | None:
    """Step of values (n,) that are even; None if they are not."""
    steps = np.diff(values)
    step = float((values[-1] - values[0]) / len(steps))
    return step if step > 0 and np.abs(steps - step).max() <= EVEN * len(steps) * step else None


def counted(values: Array) -> tuple[np.ndarray[Any, np.dtype[np.int16]], float, float]:
    """Counts (n,) of values, `NO_VALUE` where they are not finite, the value of count 0, and that of one count."""
    known = np.isfinite(values)
    low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (0.0, 0.0)
    centre, unit = (low + high) / 2, (high - low) / (2 * LARGEST) or 1.0
    counts = np.full(len(values), NO_VALUE, dtype=np.int16)
    counts[known] = np.round((values[known] - centre) / unit).clip(-LARGEST, LARGEST).astype(np.int16)
    return counts, centre, unit


def deflated(content: bytes) -> str:
    """Bytes as the page's `DecompressionStream("deflate")` reads them, in base64."""
    return b64encode(zlib.compress(content, 9)).decode("ascii")


def deflated_json(content: Mapping[str, Any]) -> str:
    """A mapping of text, numbers, lists and mappings, deflated."""
    return deflated(json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode())
