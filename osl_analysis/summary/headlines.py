"""Headline numbers of a campaign, computed from its result tables, each with its interval."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np
import polars as pl

from osl_analysis.doubtful import DOUBTFUL, counted, doubtful_count
from osl_analysis.errors import InputError
from osl_analysis.experiments import judged_tables
from osl_analysis.summary.labels import (
    ACTUATOR_LABELS,
    BELT_LABELS,
    CONTROLLERS,
    EXAMPLE_B_D,
    EXAMPLE_K_D,
    SYMMETRY_LABELS,
    TRANSMISSION_LABELS,
    TRANSMISSION_VAF,
    WALKING_LABELS,
    WALKING_VAF,
    Label,
    doubtful_label,
    impedance_labels,
    model_gain_labels,
    of_group,
)
from osl_analysis.trial import Array

STUDENT = "95 % of the mean (Student)"
FIT = "95 % of the fit (its noise; without errors of the model)"
BOOTSTRAP = "95 % (bootstrap over crossings and trials of the unloaded plate)"
PAIRED = "95 % of the mean difference of the same trials (Student)"
RANGE = "lowest to highest"
COUNT = "count"
ENSEMBLE = "ensemble"
"""Estimator of the walking summary that is the headline. Its bias decreases with the number of crossings; the bias of
the mean over perturbations does not."""

UP_MINUS_DOWN = "up minus down"
"""Estimator of the walking summary that compares the directions of the platform."""

SUMMARY_COLUMNS = ("quantity", "n", "mean", "low", "high")
TABLES = {
    "belt_summary": SUMMARY_COLUMNS,
    "transmission_summary": SUMMARY_COLUMNS,
    "transmission": ("amplitude_deg", "VAF"),
    "actuator_summary": SUMMARY_COLUMNS,
    "impedance": (
        "controller", "K_d", "B_d", "amplitude_deg", "K", "K_low", "K_high", "K_amplitudes_low", "K_amplitudes_high",
        "B", "B_low", "B_high", "B_amplitudes_low", "B_amplitudes_high", "VAF",
    ),
    "model_comparison_summary": (
        "experiment", "controller", "model", "trials", "VAF_gain", "VAF_gain_low", "VAF_gain_high",
    ),
    "walking_summary": ("group", "quantity", "estimator", "n", "mean", "low", "high"),
    "walking": ("VAF",),
}  # fmt: skip
"""The tables with headline numbers, and the columns that these need."""


@dataclass(frozen=True)
class Interval:
    """Bounds of a number, in its unit."""

    low: float | None
    high: float | None
    kind: str


@dataclass(frozen=True)
class Headline(Label):
    """A headline number."""

    value: float
    """In `unit`."""
    low: float | None
    high: float | None
    interval: str | None
    """Kind of the interval; None if there is none."""
    n: int
    """Number of trials or fits that the number is computed from."""
    n_doubtful: int = 0
    """Number of doubtful trials or fits among those that could be in the number."""
    n_left_out: int = 0
    """Number of these that are not in it."""
    doubt: str | None = None
    """Why the number itself is doubtful; None if it is not, or not judged."""
    amplitudes_low: float | None = None
    """Lowest result of the fits to single amplitudes; None if there are none."""
    amplitudes_high: float | None = None
    """Highest result of the fits to single amplitudes; None if there are none."""


def needed_columns(table: str) -> tuple[str, ...] | None:
    """Columns of a result table that the summary needs; None for a table that it does not read.

    The summary counts the doubtful fits of every table that can have them.
    """
    judged = (DOUBTFUL,) if table in judged_tables() else ()
    return (*TABLES.get(table, ()), *judged) or None


def headline_numbers(tables: Mapping[str, pl.DataFrame]) -> list[Headline]:
    """Headline numbers of the experiments that the campaign has; `tables` by name.

    Raises
    ------
    InputError
        A summary table has no finite mean for a quantity that it lists.
    """
    numbers = [number for name, of_table in HEADLINES if name in tables for number in of_table(tables[name])]
    return numbers + [doubtful_fits(name, table) for name, table in tables.items() if name in judged_tables()]


def transmission_headlines(table: pl.DataFrame) -> list[Headline]:
    """VAF of the transmission model over trials."""
    trials = over_all_amplitudes(table)
    return said_of(over_fits(TRANSMISSION_VAF, trials["VAF"], np.mean), trials)


def walking_summary_headlines(table: pl.DataFrame) -> list[Headline]:
    """The ensemble's K, B and I of each group with a result, and the differences between directions."""
    found = table.filter(pl.col("mean").is_not_null())
    numbers = []
    for rows in found.partition_by("group", maintain_order=True):
        for estimator, labels in ((ENSEMBLE, WALKING_LABELS), (UP_MINUS_DOWN, SYMMETRY_LABELS)):
            own = {quantity: of_group(label, rows["group"][0]) for quantity, label in labels.items()}
            numbers += summary_means(rows.filter(pl.col("estimator") == estimator), own, BOOTSTRAP)
    return numbers


def impedance_headlines(impedance: pl.DataFrame) -> list[Headline]:
    """Per controller VAF over trials and amplitudes, errors of K and B over trials, and the example of Fig. 4."""
    return [number for controller in CONTROLLERS for number in controller_headlines(controller, impedance)]


def controller_headlines(controller: str, impedance: pl.DataFrame) -> list[Headline]:
    """The numbers of the rendered impedance with one controller."""
    fits, labels = impedance.filter(pl.col("controller") == controller), impedance_labels(controller)
    other = pl.col("excitation") != "stepped sine" if "excitation" in fits.columns else pl.lit(False)  # no amplitudes
    trials, single = over_all_amplitudes(fits), fits.filter(pl.col("amplitude_deg").is_not_null() | other)
    used = counted(trials)
    errors = (
        *over_fits(labels["K_error"], 100 * (used["K"] / used["K_d"] - 1).abs(), np.mean),
        *over_fits(labels["B_error"], (used["B"] - used["B_d"]).abs(), np.mean),
    )
    return [
        *said_of(over_fits(labels["VAF_median"], single["VAF"], np.median), single),
        *said_of(over_fits(labels["VAF_mean"], single["VAF"], np.mean), single),
        *said_of(errors, trials, used),
        *example_headlines("K", labels["K_example"], trials),
        *example_headlines("B", labels["B_example"], trials),
    ]


def example_headlines(symbol: str, label: Label, trials: pl.DataFrame) -> list[Headline]:
    """K or B of the trial that Fig. 4 shows; the mean over its repeats, if there are several."""
    rows = trials.filter((pl.col("K_d") == EXAMPLE_K_D) & (pl.col("B_d") == EXAMPLE_B_D))
    if len(rows) != 1:
        used = counted(rows)
        return said_of(over_fits(label, used[symbol], np.mean), rows, used)
    value, low, high = rows.select(symbol, f"{symbol}_low", f"{symbol}_high").row(0)
    lowest, highest = rows.select(f"{symbol}_amplitudes_low", f"{symbol}_amplitudes_high").row(0)
    number = headline(label, value, 1, Interval(low, high, FIT))
    return said_of([replace(number, amplitudes_low=lowest, amplitudes_high=highest)], rows)


def said_of(numbers: Iterable[Headline], candidates: pl.DataFrame, used: pl.DataFrame | None = None) -> list[Headline]:
    """The numbers with the count of doubtful rows among their candidates, and of those that are not in `used`.

    A VAF uses all rows: to leave out fits that are doubtful for a low VAF would raise it.
    """
    left_out = 0 if used is None else len(candidates) - len(used)
    return [replace(n, n_doubtful=doubtful_count(candidates)[0], n_left_out=left_out) for n in numbers]


def model_gain_headlines(table: pl.DataFrame) -> list[Headline]:
    """Differences in held-out VAF between rival models and the draft's model, for the comparisons that have a mean."""
    numbers, labels = [], model_gain_labels()
    for row in table.drop_nulls("VAF_gain").iter_rows(named=True):
        label = labels.get((row["experiment"], row["controller"], row["model"]))
        if label is not None:
            interval = Interval(row["VAF_gain_low"], row["VAF_gain_high"], PAIRED)
            numbers.append(headline(label, row["VAF_gain"], int(row["trials"]), interval))
    return numbers


def doubtful_fits(name: str, table: pl.DataFrame) -> Headline:
    """Number of doubtful fits of a table; `n` is the number of all its fits."""
    doubtful, n = doubtful_count(table)
    return Headline(**asdict(doubtful_label(name)), value=doubtful, low=None, high=None, interval=COUNT, n=n)


def over_all_amplitudes(table: pl.DataFrame) -> pl.DataFrame:
    """The rows that were fitted to all amplitudes of their trial together."""
    return table.filter(pl.col("amplitude_deg").is_null())


def summary_means(table: pl.DataFrame, labels: Mapping[str, Label], interval: str = STUDENT) -> list[Headline]:
    """The labelled quantities that a summary table lists, with their intervals."""
    rows = {row["quantity"]: row for row in table.iter_rows(named=True)}
    numbers = []
    for quantity, label in labels.items():
        if quantity not in rows:
            continue
        n, mean, low, high = (rows[quantity][column] for column in ("n", "mean", "low", "high"))
        if mean is None or not math.isfinite(mean):
            raise InputError(
                f"summary table: the mean of '{quantity}' is {mean}; look for a fit without a result in its trials"
            )
        found = headline(label, mean, int(n), Interval(low, high, interval))
        doubtful, left_out = (int(rows[quantity].get(column) or 0) for column in ("n_doubtful", "n_left_out"))
        doubt = rows[quantity].get("doubt") or None
        numbers.append(replace(found, n_doubtful=doubtful, n_left_out=left_out, doubt=doubt))
    return numbers


def over_fits(label: Label, values: pl.Series, middle: Callable[[Array], np.floating]) -> list[Headline]:
    """Mean or median of the finite values, with their range if there are several. Empty without finite values."""
    finite = values.filter(values.is_finite()).to_numpy()
    if not len(finite):
        return []
    low, high = (float(finite.min()), float(finite.max())) if len(finite) > 1 else (None, None)
    return [headline(label, float(middle(finite)), len(finite), Interval(low, high, RANGE))]


def headline(label: Label, value: float, n: int, interval: Interval) -> Headline:
    """A number, without an interval where a bound is missing (a single trial has no scatter)."""
    if interval.low is None or interval.high is None or not np.isfinite([interval.low, interval.high]).all():
        return Headline(**asdict(label), value=value, low=None, high=None, interval=None, n=n)
    return Headline(**asdict(label), value=value, low=interval.low, high=interval.high, interval=interval.kind, n=n)


HEADLINES: tuple[tuple[str, Callable[[pl.DataFrame], list[Headline]]], ...] = (
    ("belt_summary", lambda table: summary_means(table, BELT_LABELS)),
    ("transmission_summary", lambda table: summary_means(table, TRANSMISSION_LABELS)),
    ("transmission", transmission_headlines),
    ("actuator_summary", lambda table: summary_means(table, ACTUATOR_LABELS)),
    ("impedance", impedance_headlines),
    ("model_comparison_summary", model_gain_headlines),
    ("walking_summary", walking_summary_headlines),
    ("walking", lambda table: over_fits(WALKING_VAF, table["VAF"], np.mean)),
)
"""The tables with headline numbers, and what computes these, in the order of the summary."""
