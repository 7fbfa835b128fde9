"""Answers of any method beside the truth of the recordings (docs/peers.md): bias, coverage, what nothing announced."""

from pathlib import Path

import polars as pl
from polars import col

from osl_analysis.errors import InputError, nearest
from osl_analysis.report.headlines import aligned
from osl_analysis.table import read_table

OFF = {"K": 1.0, "B": 2.0, "I": 10.0}  # percent: an estimate that is off by more is a miss, if its interval denies it


def score_answers(answers: Path, truth: Path) -> pl.DataFrame:
    """A row per method, over all its recordings and over those of each group: how many were answered, missed without a
    doubt (silent) and with one (announced), and doubted though nothing is wrong (false_alarms); median errors [%], and
    the share of the intervals that hold the truth [%]. Raises InputError: a line cannot be judged."""
    numbers = [f"{name}{end}" for name in OFF for end in ("", "_low", "_high")]
    given = read_table(answers, ["method", "trial", *numbers, "doubtful", "seconds", "megabytes"])
    known, before = read_table(truth, ["trial", "group", *OFF, "cause"]), set[tuple[str, str]]()
    for line, (method, trial) in enumerate(given.select("method", "trial").iter_rows(), 2):
        if trial not in (trials := known["trial"].to_list()) or (method, trial) in before:
            said = f"is not in {truth}{nearest(str(trial), trials)}; correct it, or delete the line"
            said = f"{method} has answered before; delete a line" if trial in trials else said
            raise InputError(f"{answers}: line {line}: column 'trial' holds '{trial}', which {said}")
        before.add((method, trial))
    rows = given.with_columns(col(*numbers).cast(pl.Float64).fill_nan(None)).join(known, on="trial", suffix="_true")
    errors = {name: 100 * (col(name) / col(f"{name}_true") - 1) for name in OFF}
    held = {name: col(f"{name}_true").is_between(f"{name}_low", f"{name}_high") for name in OFF}
    off = pl.any_horizontal((errors[n].abs() > OFF[n]).fill_null(False) & ~held[n].fill_null(False) for n in OFF)
    answered, doubted = pl.any_horizontal(col(*OFF).is_not_null()), col("doubtful").fill_null("") != ""
    counts = {"answered": answered, "silent": off & ~doubted, "announced": off & doubted}
    counts["false_alarms"] = answered & ~off & doubted & (col("cause").fill_null("") == "")
    found = [pl.len().alias("trials"), *(count.sum().alias(name) for name, count in counts.items())]
    found += [error.median().alias(f"bias_{name}") for name, error in errors.items()]
    found += [(100 * pl.mean_horizontal(*held.values()).mean()).alias("coverage")]
    found += [col("seconds").median(), col("megabytes").max()]
    by_group = rows.group_by("method", "group", maintain_order=True).agg(found)
    return pl.concat([rows.group_by("method", pl.lit("all").alias("group"), maintain_order=True).agg(found), by_group])


def score_text(scores: pl.DataFrame) -> str:
    cells = [["–" if v is None else f"{v:.3g}" if isinstance(v, float) else str(v) for v in r] for r in scores.rows()]
    return aligned([scores.columns, *cells]).rstrip()
