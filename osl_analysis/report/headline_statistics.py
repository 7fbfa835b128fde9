"""Headline numbers over several fits: means, ranges, kinds of intervals and what these contain."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.report.decimal_places import RANGE
from osl_analysis.report.headline import Headline, HeadlineLabel, HeadlineValue
from osl_analysis.stats.repeats import RULE_OF_MEANS, doubtful_count
from osl_analysis.trial import Array

STUDENT = "95 % of the mean (Student)"
OF_CYCLES = "95 % of the mean of cycles (Student)"
FOR_MOTION = "95 % for another motion of this kind"
FOR_REPETITION = "95 % for a repetition of this motion"
OF_NOISE = "95 % of this recording's noise"
KIND_OF_FIT = {"repeats": FOR_REPETITION, "white noise": OF_NOISE}
"""The interval of a fit by its `interval_method`; of any other it is `FOR_MOTION`."""

BOOTSTRAP = "95 % (bootstrap)"


def over_fits(
    label: HeadlineLabel,
    values: pl.Series,
    middle: Callable[[Array], np.floating] = np.mean,
    candidates: pl.DataFrame | None = None,
    used: pl.DataFrame | None = None,
) -> list[Headline]:
    """Summarise one number per fit.

    Parameters
    ----------
    label : HeadlineLabel
    values : polars.Series
        One per fit, in the unit of the label; those that are not finite do not count.
    middle : Callable
        Mean or median.
    candidates : polars.DataFrame or None
        Rows among which doubtful ones are counted; None: not judged.
    used : polars.DataFrame or None
        Rows that count; the others of `candidates` are left out.

    Returns
    -------
    list of Headline
        One number, with the range of the values if there are several; none without finite values.
    """
    not_null = values.drop_nulls()
    finite = not_null.filter(not_null.is_finite()).to_numpy()
    if not len(finite):
        return []
    estimate = HeadlineValue(float(middle(finite)), n=len(finite))
    if candidates is not None:
        estimate = replace(estimate, n_doubtful=doubtful_count(candidates)[0])
        if used is not None:
            estimate = replace(estimate, n_left_out=len(candidates) - len(used))
    if len(finite) > 1:
        estimate = estimate.with_interval(float(finite.min()), float(finite.max()), RANGE)
    return [Headline(label, estimate)]


def summary_means(
    table: pl.DataFrame, labels: Mapping[str, HeadlineLabel], interval: str = STUDENT
) -> list[Headline]:
    """The means of a summary table with their intervals, for the labelled quantities."""
    rows = {row["quantity"]: row for row in table.drop_nulls("mean").iter_rows(named=True)}
    numbers = []
    for quantity, label in labels.items():
        if quantity not in rows:
            continue
        row = rows[quantity]
        if not math.isfinite(row["mean"]):
            raise InputError(
                f"summary table: the mean of '{quantity}' is {row['mean']}; look for a fit without"
                " a result in its trials"
            )
        estimate = HeadlineValue(
            value=row["mean"],
            n=int(row["n"]),
            sd=row.get("sd"),
            n_doubtful=int(row.get("n_doubtful") or 0),
            n_left_out=int(row.get("n_left_out") or 0),
            doubt=row.get("doubt") or None,
        )
        estimate = estimate.with_interval(row["low"], row["high"], interval)
        numbers.append(Headline(label, estimate))
    return numbers


def rule_of_means(numbers: Iterable[Headline]) -> str:
    """The sentence on which doubtful trials a mean counts; empty where none is doubtful."""
    is_any_doubtful = any(number.estimate.n_doubtful for number in numbers)
    return RULE_OF_MEANS if is_any_doubtful else ""


def include_bench_errors(tables: Mapping[str, pl.DataFrame]) -> bool | None:
    """Whether the intervals of the result tables include the stated errors of the bench; None
    without a bench."""
    largest_errors = []
    for table in tables.values():
        for name in table.columns:
            if name.endswith("_se_bench"):
                largest_errors.append(table[name].max())
    return any(largest_errors) if largest_errors else None


def intervals_text(tables: Mapping[str, pl.DataFrame]) -> str:
    """A text on which errors of calibration the intervals of a bench's tables include; empty
    without a bench."""
    are_included = include_bench_errors(tables)
    if are_included is None:
        return ""
    if are_included:
        return (
            "Intervals on the bench contain what is stated of its errors; differences within the"
            " campaign have none."
        )
    return (
        "Intervals on the bench are of noise, repeatability and what the model misses alone. Errors"
        " that all of its trials share (gains, alignment, hysteresis, delay) are not in them until"
        " `calibration` states them in the configuration."
    )
