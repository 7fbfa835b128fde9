"""Result tables from the tables of single trials."""

import json
from collections.abc import Sequence
from pathlib import Path

import polars as pl

from osl_analysis.doubtful import Doubt, marked, with_doubts_of
from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.refusal import Refusal, refused_trials
from osl_analysis.table import Places, read_table, with_places, write_table


def gather(
    rows: Sequence[Path],
    output: Path,
    limits: Doubt | None = None,
    fits: Sequence[Path] = (),
    limits_of_fits: Doubt | None = None,
    places: Places | None = None,
) -> None:
    """One table from the tables of single trials, in the order given; with `limits`, doubtful fits are marked.

    `rows` are their files, or the archives with a table of the same name as `output`. `fits` are the trials' fits of
    the table whose doubts the rows share, if any, with the limits of that table. `places` has joint and side of each
    trial, which become columns.
    """
    if not rows:
        raise InputError(f"{output}: no trials fill this table; add some to the sample sheet")
    table = pl.concat([read_table(path, of=output.stem) for path in rows], how="diagonal_relaxed")
    if limits is not None:
        table = marked(table, limits, output.stem)
    if limits_of_fits is not None and fits:
        of = pl.concat([read_table(path) for path in fits], how="diagonal_relaxed")
        table = with_doubts_of(table, of, limits_of_fits, fits[0].parent.name)
    write_table(with_places(table, places or {}), output)


def list_fits(fits: Sequence[Path], output: Path, refused: Sequence[Refusal] = ()) -> None:
    """Write which trials of an experiment were fitted, and why the others were not, as JSON.

    `fits` has one file of the results of each trial. Whatever uses the results of all of them is made again with it.
    """
    reasons = {trial: cause.reason for trial, cause in refused_trials(refused).items()}
    with atomic_path(output) as temporary:
        said = {"fitted": [path.stem for path in fits], "refused": reasons}
        temporary.write_text(json.dumps(said, indent=1) + "\n", encoding="utf-8")
