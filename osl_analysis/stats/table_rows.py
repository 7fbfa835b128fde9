"""A fit as columns of a result table: estimates with their intervals, and diagnostics."""

from osl_analysis.stats.linear_fit import LinearFit

# one row of a result table, by column. None becomes an empty field.
Row = dict[str, float | str | None]

INTERVAL_ENDS = ("", "_low", "_high")
"""Endings of the columns of an estimate: its value and the ends of its 95 % interval."""


def estimates_row(fit: LinearFit, *names: str) -> dict[str, float]:
    """`name`, and the bounds `name_low` and `name_high` of its 95 % interval, for each name, in SI
    units."""
    row: dict[str, float] = {}
    for name in names:
        low, high = fit.interval(name)
        row[name] = fit[name]
        row[f"{name}_low"] = low
        row[f"{name}_high"] = high
    return row


def diagnostics_row(fit: LinearFit, interval_method: str) -> Row:
    """The diagnostics of a fit and its interval in all tables, VAF in percent."""
    return {
        "interval_method": interval_method,
        "VAF": fit.vaf,
        "condition_number": fit.condition_number,
        "largest_correlation": fit.largest_correlation,
    }
