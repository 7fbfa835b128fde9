"""Headline numbers of a campaign, computed from its result tables, each with its interval."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace

import numpy as np
import polars as pl

from osl_analysis.doubtful import DOUBTFUL, counted, doubtful_count
from osl_analysis.experiments import judged_tables
from osl_analysis.summary.labels import (
    ACTUATOR_LABELS,
    BELT_LABELS,
    CONTROLLERS,
    DRAFT_EXAMPLE,
    SYMMETRY_LABELS,
    TORQUE_ANGLE_LABELS,
    TRANSMISSION_LABELS,
    TRANSMISSION_VAF,
    WALKING_LABELS,
    WALKING_VAF,
    Example,
    Label,
    doubtful_label,
    impedance_labels,
    model_gain_label,
    of_group,
    of_place,
)
from osl_analysis.summary.number import (
    BOOTSTRAP,
    COUNT,
    CYCLES,
    FIT,
    PAIRED,
    Headline,
    Interval,
    headline,
    label_of,
    over_all_amplitudes,
    over_fits,
    said_of,
    summary_means,
    with_own_names,
)

ENSEMBLE = "ensemble"
"""Estimator of the walking summary that is the headline. Its bias decreases with the number of crossings; the bias of
the mean over perturbations does not."""

UP_MINUS_DOWN = "up minus down"
"""Estimator of the walking summary that compares the directions of the platform."""

PLACE = ("joint", "side")
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
    "torque_angle": (
        "trial", "cycles", "K", "K_low", "K_high", "energy_stored", "energy_stored_low", "energy_stored_high",
        "energy_returned", "energy_returned_low", "energy_returned_high", "energy_lost", "energy_lost_low",
        "energy_lost_high",
    ),
    "model_comparison_summary": (
        "experiment", "controller", "model", "trials", "VAF_gain", "VAF_gain_low", "VAF_gain_high",
    ),
    "walking_summary": ("group", "quantity", "estimator", "n", "mean", "low", "high"),
    "walking": ("VAF",),
}  # fmt: skip
"""The tables with headline numbers, and the columns that these need."""


def needed_columns(table: str) -> tuple[str, ...] | None:
    """Columns of a result table that the summary needs; None for a table that it does not read.

    The summary counts the doubtful fits of every table that can have them.
    """
    judged = (DOUBTFUL,) if table in judged_tables() else ()
    return (*TABLES.get(table, ()), *judged) or None


def headline_numbers(tables: Mapping[str, pl.DataFrame], example: Example = DRAFT_EXAMPLE) -> list[Headline]:
    """Headline numbers of the experiments that the campaign has; `tables` by name, `example` of Fig. 4.

    The bench's numbers are of one joint and side each. No two have one name or one macro.

    Raises
    ------
    InputError
        A summary table has no finite mean for a quantity that it lists.
    """
    numbers = [
        number for name, of_table in BENCH if name in tables for number in by_place(tables[name], of_table, example)
    ]
    numbers += [number for name, of_table in WALKING if name in tables for number in of_table(tables[name])]
    doubts = [doubtful_fits(name, table) for name, table in tables.items() if name in judged_tables()]
    return with_own_names([*numbers, *doubts])


def by_place(
    table: pl.DataFrame, of_table: Callable[[pl.DataFrame, Example], list[Headline]], example: Example
) -> list[Headline]:
    """The numbers of each joint and side of a table of the bench."""
    if not set(PLACE) <= set(table.columns):
        return of_table(table, example)
    numbers, parts = [], table.partition_by(PLACE, maintain_order=True)
    for part in parts:
        joint, side = part.select(PLACE).row(0)
        for number in of_table(part, example):
            label = of_place(label_of(number), joint, side, several=len(parts) > 1)
            numbers.append(replace(number, **asdict(label)))
    return numbers


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


def impedance_headlines(impedance: pl.DataFrame, example: Example) -> list[Headline]:
    """Per controller VAF over trials and amplitudes, errors of K and B over trials, and the example of Fig. 4."""
    found = set(impedance["controller"])
    others = sorted(name for name in found if name is not None and name not in CONTROLLERS)
    known = [*(name for name in CONTROLLERS if name in found), *others, *([None] if None in found else [])]
    return [number for controller in known for number in controller_headlines(controller, impedance, example)]


def controller_headlines(controller: str | None, impedance: pl.DataFrame, example: Example) -> list[Headline]:
    """The numbers of the rendered impedance with one controller; None: without one."""
    fits = impedance.filter(pl.col("controller").eq_missing(pl.lit(controller, pl.String)))
    labels, trials = impedance_labels(controller, example), over_all_amplitudes(fits)
    alone = pl.len().over("trial") == 1 if "trial" in fits.columns else pl.lit(False)
    single = fits.filter(pl.col("amplitude_deg").is_not_null() | alone)
    used = counted(trials)
    errors = (
        *over_fits(labels["K_error"], 100 * (used["K"] / used["K_d"] - 1).abs().drop_nulls(), np.mean),
        *over_fits(labels["B_error"], (used["B"] - used["B_d"]).abs().drop_nulls(), np.mean),
    )
    return [
        *said_of(over_fits(labels["VAF_median"], single["VAF"], np.median), single),
        *said_of(over_fits(labels["VAF_mean"], single["VAF"], np.mean), single),
        *said_of(errors, trials, used),
        *example_headlines("K", labels["K_example"], trials, example),
        *example_headlines("B", labels["B_example"], trials, example),
    ]


def example_headlines(symbol: str, label: Label, trials: pl.DataFrame, example: Example) -> list[Headline]:
    """K or B of the trial that Fig. 4 shows; the mean over its repeats, if there are several."""
    asked = {"K_d": example.K_d, "B_d": example.B_d}
    rows = trials.filter(pl.col(name).eq_missing(pl.lit(value, pl.Float64)) for name, value in asked.items())
    if len(rows) != 1:
        used = counted(rows)
        return said_of(over_fits(label, used[symbol], np.mean), rows, used)
    value, low, high = rows.select(symbol, f"{symbol}_low", f"{symbol}_high").row(0)
    lowest, highest = rows.select(f"{symbol}_amplitudes_low", f"{symbol}_amplitudes_high").row(0)
    number = headline(label, value, 1, Interval(low, high, FIT))
    return said_of([replace(number, amplitudes_low=lowest, amplitudes_high=highest)], rows)


def model_gain_headlines(table: pl.DataFrame) -> list[Headline]:
    """Differences in held-out VAF between rival models and the draft's model, for the comparisons that have a mean."""
    numbers = []
    for row in table.drop_nulls("VAF_gain").iter_rows(named=True):
        label = model_gain_label(row["experiment"], row["controller"], row["model"])
        if label is not None:
            interval = Interval(row["VAF_gain_low"], row["VAF_gain_high"], PAIRED)
            numbers.append(headline(label, row["VAF_gain"], int(row["trials"]), interval))
    return numbers


def torque_angle_headlines(table: pl.DataFrame) -> list[Headline]:
    """K and the energies of every trial: its means over cycles, which need not be those of one device."""
    numbers = []
    for row in table.iter_rows(named=True):
        for quantity, label in TORQUE_ANGLE_LABELS.items():
            interval = Interval(row[f"{quantity}_low"], row[f"{quantity}_high"], CYCLES)
            number = headline(of_group(label, row["trial"]), row[quantity], int(row["cycles"]), interval)
            numbers.append(replace(number, doubt=row[DOUBTFUL] or None))
    return numbers


def doubtful_fits(name: str, table: pl.DataFrame) -> Headline:
    """Number of doubtful fits of a table; `n` is the number of all its fits."""
    doubtful, n = doubtful_count(table)
    return Headline(**asdict(doubtful_label(name)), value=doubtful, low=None, high=None, interval=COUNT, n=n)


BENCH: tuple[tuple[str, Callable[[pl.DataFrame, Example], list[Headline]]], ...] = (
    ("belt_summary", lambda table, _: summary_means(table, BELT_LABELS)),
    ("transmission_summary", lambda table, _: summary_means(table, TRANSMISSION_LABELS)),
    ("transmission", lambda table, _: transmission_headlines(table)),
    ("actuator_summary", lambda table, _: summary_means(table, ACTUATOR_LABELS)),
    ("impedance", impedance_headlines),
    ("torque_angle", lambda table, _: torque_angle_headlines(table)),
    ("model_comparison_summary", lambda table, _: model_gain_headlines(table)),
)
"""The tables of the bench with headline numbers, and what computes these, in the order of the summary."""
WALKING: tuple[tuple[str, Callable[[pl.DataFrame], list[Headline]]], ...] = (
    ("walking_summary", walking_summary_headlines),
    ("walking", lambda table: over_fits(WALKING_VAF, table["VAF"], np.mean)),
)
"""Those of the walkway, which follow."""
