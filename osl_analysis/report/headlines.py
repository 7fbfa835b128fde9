"""Headline numbers of a campaign, computed from its result tables."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from itertools import count

import numpy as np
import polars as pl

from osl_analysis.campaign.origin import ABOUT_MACROS
from osl_analysis.judge.causes import doubts_of_result
from osl_analysis.report.headline import (
    LABELS,
    Example,
    Headline,
    HeadlineLabel,
    HeadlineValue,
    letters,
    of_group,
    with_end,
)
from osl_analysis.report.headline_statistics import (
    BOOTSTRAP,
    OF_CYCLES,
    over_fits,
    summary_means,
)
from osl_analysis.report.impedance_headlines import impedance_headlines
from osl_analysis.stats.repeats import DOUBTFUL

DRAFT_JOINT = "ankle"  # the joint whose numbers the draft prints

# its bias decreases with the number of crossings, unlike that of the mean of fits
HEADLINE_ESTIMATOR = "ensemble"

# endings of the macros of a number
ENDINGS = ("", "Low", "High", "AmplitudesLow", "AmplitudesHigh", "Verdict")


def headline_numbers(
    tables: Mapping[str, pl.DataFrame], example: Example | None = None, beside_draft: bool = True
) -> list[Headline]:
    """Compute the headline numbers of a campaign.

    Parameters
    ----------
    tables : Mapping of str to polars.DataFrame
        Its result tables, by name.
    example : Example or None
        The desired impedance of Fig. 4; None: that of the draft.
    beside_draft : bool
        Whether the numbers of the draft stand beside them.

    Returns
    -------
    list of Headline
        Names and macros are unique: macros have only letters, so of `PD 1` and `PD-1` the second
        becomes `PDOneB`.

    Raises
    ------
    InputError
        A summary table has no finite mean for a quantity that it lists.
    """
    names: set[str] = set()
    macros = set(ABOUT_MACROS.values())
    numbers: list[Headline] = []
    for table in LABELS:
        if table not in tables:
            continue
        for number in placed_numbers(table, tables[table], example or Example()):
            label = number.label
            name = free_name(label.name, names)
            macro = free_macro(label.macro, macros)
            names.add(name)
            macros.update(macros_of(macro))
            draft = label.draft if beside_draft else None
            label = replace(label, name=name, macro=macro, draft=draft)
            numbers.append(replace(number, label=label))
    return numbers


def placed_numbers(name: str, table: pl.DataFrame, example: Example) -> Iterator[Headline]:
    """The numbers of one table; on the bench by joint and side, if these differ. The draft's joint
    is an ankle."""
    places = ("joint", "side")
    is_of_bench = name != "claims" and not name.startswith("walking")
    if not is_of_bench or not set(places) <= set(table.columns):
        yield from numbers_of(name, table, example)
        return
    parts = table.partition_by(places, maintain_order=True)
    for part in parts:
        joint, side = part.select(places).row(0)
        joint = joint or DRAFT_JOINT
        place = place_text(joint, side)
        for number in numbers_of(name, part, example):
            label = number.label
            draft = label.draft if joint == DRAFT_JOINT else None
            if len(parts) > 1:
                label = of_group(label, place)
            elif place != DRAFT_JOINT:
                label = with_end(label, place)
            yield replace(number, label=replace(label, draft=draft))


def place_text(joint: str | None, side: str | None) -> str:
    return ", ".join(filter(None, [joint, side]))


def numbers_of(name: str, table: pl.DataFrame, example: Example) -> Iterator[Headline]:
    """The headline numbers of the table `name`, of one joint and side on the bench."""
    labels = LABELS[name]
    if name == "impedance":
        yield from impedance_headlines(table, example)
    elif name == "torque_angle":
        yield from torque_angle_headlines(table)
    elif name == "walking_summary":
        yield from walking_headlines(table)
    elif name == "claims":
        yield from claim_headlines(table)
    elif name == "transmission":
        whole = table.filter(pl.col("amplitude_deg").is_null())
        yield from over_fits(labels["VAF"], whole["VAF"], np.mean, whole)
    elif name == "walking":
        yield from over_fits(labels["VAF"], table["VAF"])
    else:
        yield from summary_means(table, labels)


def torque_angle_headlines(table: pl.DataFrame) -> Iterator[Headline]:
    """Stiffness and energies of each trial of torque against angle."""
    labels = LABELS["torque_angle"]
    for row in table.drop_nulls(list(labels)).iter_rows(named=True):
        for quantity, label in labels.items():
            doubt = doubts_of_result(row[DOUBTFUL] or "", quantity)
            cycles = int(row.get("cycles", 1))
            estimate = HeadlineValue(row[quantity], n=cycles, doubt=doubt or None)
            low, high = row[f"{quantity}_low"], row[f"{quantity}_high"]
            estimate = estimate.with_interval(low, high, OF_CYCLES)
            yield Headline(of_group(label, row["trial"]), estimate)


def walking_headlines(table: pl.DataFrame) -> Iterator[Headline]:
    """K, B and I of each group of crossings, and by how much turns up differ from turns down."""
    labels_of_estimator = {
        HEADLINE_ESTIMATOR: LABELS["walking_summary"],
        # rows of walking_summary, too: no table has this name
        "up minus down": LABELS["walking_symmetry"],
    }
    with_mean = table.filter(pl.col("mean").is_not_null())
    for rows in with_mean.partition_by("group", maintain_order=True):
        for estimator, labels in labels_of_estimator.items():
            of_estimator = rows.filter(pl.col("estimator") == estimator)
            for number in summary_means(of_estimator, labels, BOOTSTRAP):
                yield replace(number, label=of_group(number.label, rows["group"][0]))


def claim_headlines(table: pl.DataFrame) -> Iterator[Headline]:
    """The claims on the campaign, each with its verdict; those on single trials are in
    `claims.csv`."""
    claims = table.filter(pl.col("subject").is_null())
    for row in claims.drop_nulls("value").iter_rows(named=True):
        label = HeadlineLabel(
            name=row["name"],
            unit=row["unit"],
            draft=None,
            macro=letters(row["name"].replace("_", " ")),
            meaning=f"{row['claim']}, {row['quantity']}",
        )
        if len(claims.filter(name=row["name"])) > 1:
            label = of_group(label, place_text(row["joint"], row["side"]))
        estimate = HeadlineValue(
            value=row["value"],
            interval=row["interval"],
            n=int(row["n"] or 0),
            verdict=row["verdict"],
        )
        yield Headline(label, estimate.with_interval(row["low"], row["high"], row["interval"]))


def free_name(name: str, taken: Collection[str]) -> str:
    """The name, with a number if it is taken."""
    if name not in taken:
        return name
    return next(f"{name} ({k})" for k in count(2) if f"{name} ({k})" not in taken)


def free_macro(macro: str, taken: set[str]) -> str:
    """The macro, with as many letters B at its end as make all of its macros new."""
    while not taken.isdisjoint(macros_of(macro)):
        macro += "B"
    return macro


def macros_of(macro: str) -> list[str]:
    """All macros of a number."""
    return [macro + ending for ending in ENDINGS]
