# SPDX-License-Identifier: Apache-2.0
"""Doubts about the rows of a result table, and the rows that a mean counts.

A table has the column `DOUBTS` once findings are joined to it (`judge/joining.py`): a list of
doubts, each with its source and the estimates that it concerns. A table without that column has no
doubts.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import polars as pl

DOUBTS = "doubts"
DOUBT_TYPE = pl.Struct({"source": pl.String, "estimates": pl.List(pl.String)})
JUDGED_ESTIMATES = ("K", "B", "I", "J_j")
"""Estimates that are judged each for itself, and with them those whose names begin as theirs, as
`K_s`, `B_viscous` and `K_low`. Any other column, as VAF, rests on the whole fit."""

Doubt = Mapping[str, Any]
"""A cell of `DOUBT_TYPE`."""


def is_of_estimate(column: str, estimate: str) -> bool:
    """Whether a column is an estimate, or belongs to it, as `B_viscous` and `B_low` to `B`."""
    return column == estimate or column.startswith(f"{estimate}_")


def is_judged(column: str) -> bool:
    """Whether a column belongs to an estimate that is judged for itself."""
    return any(is_of_estimate(column, estimate) for estimate in JUDGED_ESTIMATES)


def concerns(doubt: Doubt, columns: Collection[str] = ()) -> bool:
    """Whether a doubt is about one of some columns, or about any where none is named.

    A doubt without estimates is about the whole fit. A column that rests on the whole fit, as VAF,
    is concerned by every doubt.
    """
    if not columns or not doubt["estimates"]:
        return True
    if not all(map(is_judged, columns)):
        return True
    return any(
        is_of_estimate(column, estimate) for estimate in doubt["estimates"] for column in columns
    )


def doubts_about(doubts: Sequence[Doubt] | None, columns: Collection[str] = ()) -> list[Doubt]:
    """The doubts in a cell of `DOUBTS` that concern one of some columns."""
    return [doubt for doubt in doubts or () if concerns(doubt, columns)]


def is_doubtful(table: pl.DataFrame, columns: Collection[str] = ()) -> pl.Series:
    """Whether estimates in some columns are doubtful, by row; without columns, whether any is."""
    if DOUBTS not in table.columns:
        return pl.repeat(False, len(table), dtype=pl.Boolean, eager=True)
    marks = [bool(doubts_about(doubts, columns)) for doubts in table[DOUBTS].to_list()]
    return pl.Series(marks, dtype=pl.Boolean)


def counted(table: pl.DataFrame, columns: Collection[str] = ()) -> pl.DataFrame:
    """The rows that a mean of some columns counts: those whose estimates there are not doubtful."""
    return table.filter(~is_doubtful(table, columns))
