# SPDX-License-Identifier: Apache-2.0
"""Score the answers of any method against the truth of the recordings:
python benchmarks/peers/score.py ANSWERS [TRUTH]

ANSWERS is a CSV file with the columns of `answers.COLUMNS`; TRUTH is `truth.csv` beside it unless
named. A row per method, over all recordings and over each group of them, says how many were
answered, missed without a doubt (silent) and with one (announced), and doubted though nothing is
wrong (false_alarms); the median errors [%], the share of intervals that hold the truth [%], and the
half-width of the widest of K, B and I as a multiple of what counts as a miss (median). A recording
without a line is not answered.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import polars as pl
from polars import col

from osl_analysis.base.errors import InputError, nearest
from osl_analysis.base.table import read_table
from osl_analysis.report.typography import aligned

LARGEST_ERRORS = {"K": 1.0, "B": 2.0, "I": 10.0}
"""Percent: an estimate that is off by more is a miss, if its interval denies it."""
ENDS = [f"{name}{end}" for name in LARGEST_ERRORS for end in ("", "_low", "_high")]
ANSWER = ["trial", *ENDS, "doubtful", "seconds", "megabytes"]
FIRST_LINE = 2  # of a table, below its header


def score_answers(answers: Path, truth: Path, made_by: Sequence[str] = ()) -> pl.DataFrame:
    """Score the answers of every method.

    Parameters
    ----------
    answers, truth : Path
        CSV files of the answers and of what made the recordings.
    made_by : sequence of str, optional
        The generators whose recordings are scored; all unless named.

    Returns
    -------
    pl.DataFrame
        A row per method and group, `all` first.

    Raises
    ------
    InputError
        A line is of no recording, answers one twice, holds no number, or an interval ends below
        its beginning.
    """
    given = read_table(answers, ANSWER)
    if "version" not in given.columns:  # a method need not state it
        given = given.with_columns(version=pl.lit(None, pl.String))
    known = read_table(truth, ["trial", "group", *LARGEST_ERRORS, "cause"])
    check_lines(given, answers, known["trial"].to_list(), truth)
    if made_by:
        known = known.filter(col("made_by").is_in(made_by))
    without_nan = given.with_columns(col(*ENDS).cast(pl.Float64).fill_nan(None))
    check_ends(without_nan, answers)
    all_of_each = given.select(col("method").unique(maintain_order=True)).join(known, how="cross")
    rows = all_of_each.rename({name: f"{name}_true" for name in LARGEST_ERRORS}).join(
        without_nan, on=["method", "trial"], how="left"
    )
    of_all = rows.group_by("method", pl.lit("all").alias("group"), maintain_order=True)
    of_each = rows.group_by("method", "group", maintain_order=True)
    return pl.concat([of_all.agg(scores()), of_each.agg(scores())])


def check_lines(given: pl.DataFrame, answers: Path, trials: list[str], truth: Path) -> None:
    """Refuse an answer to a recording that is not known, or that its method has answered before."""
    before = set()
    for line, (method, trial) in enumerate(given.select("method", "trial").iter_rows(), FIRST_LINE):
        where = f"{answers}: line {line}: column 'trial' holds '{trial}', which"
        if trial not in trials:
            like = nearest(str(trial), trials)
            raise InputError(f"{where} is not in {truth}{like}", "correct it, or delete the line")
        if (method, trial) in before:
            raise InputError(f"{where} {method} has answered before", "delete a line")
        before.add((method, trial))


def check_ends(given: pl.DataFrame, answers: Path) -> None:
    """Refuse an interval that ends below its beginning."""
    for name in LARGEST_ERRORS:
        is_wrong = (given[f"{name}_low"] > given[f"{name}_high"]).fill_null(False)
        if is_wrong.any():
            row = is_wrong.arg_max() or 0
            low, high = given[f"{name}_low"][row], given[f"{name}_high"][row]
            raise InputError(
                f"{answers}: line {row + FIRST_LINE}: column '{name}_low' holds {low:g}, above"
                f" '{name}_high', {high:g}",
                "exchange them",
            )


def scores() -> list[pl.Expr]:
    """The columns of the scores, from rows that have an answer and the truth (`K_true`) of it."""
    errors = {name: 100 * (col(name) / col(f"{name}_true") - 1) for name in LARGEST_ERRORS}
    held = {
        name: col(f"{name}_true").is_between(f"{name}_low", f"{name}_high")
        for name in LARGEST_ERRORS
    }
    half_widths = [
        50 * (col(f"{name}_high") - col(f"{name}_low")) / col(f"{name}_true") / largest
        for name, largest in LARGEST_ERRORS.items()
    ]
    missed = pl.any_horizontal(
        (errors[name].abs() > largest).fill_null(False) & ~held[name].fill_null(False)
        for name, largest in LARGEST_ERRORS.items()
    )
    answered = pl.any_horizontal(col(*LARGEST_ERRORS).is_not_null())
    doubted = col("doubtful").fill_null("") != ""
    is_sound = col("cause").fill_null("") == ""
    return [
        pl.len().alias("trials"),
        answered.sum().alias("answered"),
        (missed & ~doubted).sum().alias("silent"),
        (missed & doubted).sum().alias("announced"),
        (answered & ~missed & doubted & is_sound).sum().alias("false_alarms"),
        *(error.median().alias(f"bias_{name}") for name, error in errors.items()),
        (100 * pl.mean_horizontal(*held.values()).mean()).alias("coverage"),
        pl.max_horizontal(half_widths).median().alias("half_width"),
        col("seconds").median(),
        col("megabytes").max(),
        col("version").drop_nulls().first(),
    ]


def score_text(table: pl.DataFrame) -> str:
    """The scores as aligned columns; a dash where a method states nothing."""
    return aligned([table.columns, *([cell(value) for value in row] for row in table.rows())])


def cell(value: object) -> str:
    if value is None:
        return "–"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    answers_path = Path(sys.argv[1])
    truth_path = Path(sys.argv[2]) if len(sys.argv) > 2 else answers_path.with_name("truth.csv")
    try:
        print(score_text(score_answers(answers_path, truth_path)), end="")
    except InputError as error:
        sys.exit(f"error: {error}")
