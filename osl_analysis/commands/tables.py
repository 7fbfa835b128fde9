"""Result tables from the tables of single trials."""

from collections.abc import Sequence
from pathlib import Path

import polars as pl

from osl_analysis.doubtful import Doubt, marked
from osl_analysis.errors import InputError
from osl_analysis.table import read_table, write_table


def gather(rows: Sequence[Path], output: Path, limits: Doubt | None = None) -> None:
    """One table from the tables of single trials, in the order given; with `limits`, doubtful fits are marked.

    Raises
    ------
    InputError
        There is no trial, or there is a limit on a column that the table does not have.
    """
    if not rows:
        raise InputError(f"{output}: no trials fill this table; add some to the sample sheet")
    table = pl.concat([read_table(path) for path in rows], how="diagonal_relaxed")
    write_table(table if limits is None else marked(table, limits, output.stem), output)
