# SPDX-License-Identifier: Apache-2.0
"""Estimates of a fit as columns of tables."""

from osl_analysis.stats.linear_fit import LinearFit

# one row of a result table, by column. None becomes an empty field.
Row = dict[str, float | str | None]


def estimates_row(fit: LinearFit, *names: str) -> Row:
    """`name`, and the bounds `name_low` and `name_high` of its 95 % interval, for each name, in SI
    units."""
    row: Row = {}
    for name in names:
        row |= fit.budget(name).columns(name)
    return row
