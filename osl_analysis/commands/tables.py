"""Tables over trials: rows brought together, and their mean with scatter and interval."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import polars as pl

from osl_analysis.doubtful import Doubt, doubtful_row, marked
from osl_analysis.errors import InputError
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.table import read_table, write_table


def gather(rows: Sequence[Path], output: Path, limits: Doubt | None = None) -> None:
    """One table from the tables of single trials, in the order given, with what is doubtful where there are `limits`.

    Raises
    ------
    InputError
        There is none, or a limit stands on a column that the table does not have.
    """
    if not rows:
        raise InputError(f"{output}: no trials fill this table; add some to the sample sheet")
    table = pl.concat([read_table(path) for path in rows], how="diagonal_relaxed")
    write_table(table if limits is None else marked(table, limits, output.stem), output)


def summary_table(table: pl.DataFrame, quantities: Sequence[str]) -> pl.DataFrame:
    """Per quantity (a column): n, mean, sd, se, and the 95 % interval of the mean; one trial has only a mean.

    `n_doubtful` of the trials are doubtful, and in the mean all the same.
    """
    doubtful = doubtful_row(table)
    return pl.DataFrame([{"quantity": name, **one_summary(table[name]), **doubtful} for name in quantities])


def one_summary(values: pl.Series) -> dict[str, float | str | None]:
    """n, mean, sd, se, low, high of one column and what the interval is from; what one trial cannot give is null."""
    found = values.cast(pl.Float64).drop_nulls().drop_nans()
    if len(found) >= 2:
        return asdict(over_repeats(found.to_numpy())) | {"interval_method": "Student"}
    mean = float(found[0]) if len(found) else None
    return {"n": len(found), "mean": mean, **dict.fromkeys(("sd", "se", "low", "high", "interval_method"))}
