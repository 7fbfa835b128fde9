"""K, B and I of each condition, and of each group of crossings, as rows of the page."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from osl_analysis.judge.finding import ESTIMATES, Finding, Grade, WordedFinding
from osl_analysis.judge.words import without_names
from osl_analysis.report.page_text import in_words
from osl_analysis.report.shown_numbers import ShownEstimate, shown_estimate
from osl_analysis.report.typography import printed
from osl_analysis.stats.repeats import DOUBTFUL, counted, own_condition, summary_row

# ending of a fit's column, and column in a summary
IN_SUMMARY = {"": "mean", "_low": "low", "_high": "high"}
OF_CONDITION = ("joint", "side", "controller", "K_d", "B_d")
OF_FRICTION = ("B_viscous", "f_C")  # shown where every trial has them


@dataclass(frozen=True)
class ConditionRow:
    """A row of the page's table of conditions.

    Attributes
    ----------
    condition
        Commanded impedance and joint, or the group of crossings.
    trials
        Names; none of a group.
    doubt
        Causes of doubt about its fits; empty for none.
    n_unchecked
        Number of things that could not be checked on them.
    estimates
        By symbol: K, B and I, and friction where every trial has it.
    """

    condition: str
    trials: Sequence[str]
    doubt: str
    n_unchecked: int
    estimates: Mapping[str, ShownEstimate]


def condition_rows(
    tables: Mapping[str, pl.DataFrame], findings: Mapping[str, Sequence[WordedFinding]]
) -> list[ConditionRow]:
    """K, B and I of each group of crossings, and of each condition (commanded impedance and joint),
    with its trials and doubts.

    It is the mean of several trials (`summary_row`). A trial without a stated K_d has a row of its
    own (`own_condition`). `findings` are those on each trial.
    """
    rows = group_rows(tables, findings)
    impedance = tables.get("impedance")
    if impedance is None:
        return rows
    if "amplitude_deg" in impedance.columns:
        impedance = impedance.filter(pl.col("amplitude_deg").is_null())

    keys = []
    for name in OF_CONDITION:
        if name in impedance.columns and impedance[name].n_unique() > 1:
            keys.append(name)
    are_several = pl.len().over(*keys, pl.lit("all")) > 1
    alone = pl.when(are_several).then(own_condition(impedance)).otherwise(pl.lit(""))
    impedance = impedance.with_columns(own_condition=alone)
    for fits in impedance.partition_by([*keys, "own_condition"], maintain_order=True):
        rows.append(condition_row(fits, keys, findings))
    return rows


def condition_row(
    fits: pl.DataFrame, keys: Sequence[str], findings: Mapping[str, Sequence[WordedFinding]]
) -> ConditionRow:
    """The row of one condition, whose fits agree in the columns `keys`."""
    used = counted(fits)
    trials = fits["trial"].to_list()
    row = used.row(0, named=True)
    symbols = list(ESTIMATES)
    for name in OF_FRICTION:
        if name in fits.columns and not fits[name].null_count():
            symbols.append(name)
    if len(used) > 1:
        for symbol in symbols:
            mean = summary_row(used, symbol)
            for ending, column in IN_SUMMARY.items():
                row[f"{symbol}{ending}"] = mean[column]

    condition = []
    for key in keys:
        if row[key] is not None:
            condition.append(f"{key} {row[key]:g}" if key in ("K_d", "B_d") else row[key])
    if row["own_condition"]:
        condition += [f"trial {row['own_condition']}", motion_text(row)]

    of_trials = [worded for trial in trials for worded in findings.get(trial, ())]
    of_table = findings_in(of_trials, "impedance")
    doubts = [doubts_text(of_table, row, len(trials))]
    n_left_out = len(fits) - len(used)
    if n_left_out:
        doubts.append(f"{n_left_out} left out of the mean")
    return ConditionRow(
        condition=", ".join(condition) or "all",
        trials=trials,
        doubt="; ".join(filter(None, doubts)),
        n_unchecked=number_unchecked(of_table),
        estimates={symbol: shown_estimate(row, symbol) for symbol in symbols},
    )


def motion_text(row: Mapping[str, Any]) -> str:
    """What moved the joint in a trial, as measured."""
    kind = row.get("excitation") or "other"
    parts = ["motion without a period" if kind == "other" else kind]
    if row.get("band_low_hz") is not None:
        parts.append(f"{row['band_low_hz']:.2g} to {row['band_high_hz']:.2g} Hz")
    if row.get("theta_rms_deg") is not None:
        parts.append(f"{row['theta_rms_deg']:.2g}° RMS")
    return ", ".join(parts)


def group_rows(
    tables: Mapping[str, pl.DataFrame], findings: Mapping[str, Sequence[WordedFinding]]
) -> list[ConditionRow]:
    """The rows of the groups of crossings, by their ensembles."""
    summary = tables.get("walking_summary")
    if summary is None:
        return []
    judged = pl.DataFrame(schema=["trial", "group"])
    if "walking" in tables:
        judged = tables["walking"].drop_nulls(DOUBTFUL)
    rows = []
    of_ensemble = summary.filter(estimator="ensemble")
    for (group,), quantities in of_ensemble.group_by("group", maintain_order=True):
        row = {}
        for quantity in quantities.to_dicts():
            for ending, column in IN_SUMMARY.items():
                row[f"{quantity['quantity']}{ending}"] = quantity[column]
        of_group = findings_in(findings.get(str(group), ()), "walking_groups")
        crossings = judged.filter(group=group)["trial"].to_list()
        of_crossings = [worded for trial in crossings for worded in findings.get(trial, ())]
        doubts = [doubts_text(of_group, {}, 1)]
        doubt_of_crossings = doubts_text(findings_in(of_crossings, "walking"), {}, 0)
        if doubt_of_crossings:
            doubts.append(f"of {len(crossings)} perturbations {doubt_of_crossings}")
        rows.append(
            ConditionRow(
                condition="walking" if group == "all" else f"walking, {group}",
                trials=[],
                doubt="; ".join(filter(None, doubts)),
                n_unchecked=number_unchecked(of_group),
                estimates={symbol: shown_estimate(row, symbol) for symbol in ESTIMATES},
            )
        )
    return rows


def findings_in(findings: Sequence[WordedFinding], table: str) -> list[Finding]:
    """The findings about whole rows of a table."""
    of_table = []
    for worded in findings:
        if worded.finding.table == table and not worded.finding.is_of_part:
            of_table.append(worded.finding)
    return of_table


def number_unchecked(findings: Sequence[Finding]) -> int:
    """How many things could not be checked."""
    return len({finding.name for finding in findings if finding.grade is Grade.UNCHECKED})


def doubts_text(findings: Sequence[Finding], row: Mapping[str, Any], n: int) -> str:
    """The doubts about the fits of n trials (of one trial by its `row`; 0: their number is not
    written)."""
    doubts = [finding for finding in findings if finding.grade is Grade.DOUBTS]
    if n == 1:
        texts = [doubt_text(finding, row) for finding in doubts]
    else:
        once_per_trial = {(finding.subject, finding.cause) for finding in doubts}
        by_cause = Counter(cause for _, cause in once_per_trial)
        of_n = f" of {n}" if n else ""
        texts = [printed(f"{cause} ({k}{of_n})") for cause, k in sorted(by_cause.items())]
    return "; ".join(dict.fromkeys(texts))


def doubt_text(finding: Finding, row: Mapping[str, Any]) -> str:
    """A cause of doubt about a row, with the estimates of its fit and their units."""
    estimates = []
    for symbol, name in without_names(finding.name, row, finding.table).items():
        value = finding.without.get(symbol)
        ends = [finding.without.get(f"{symbol}_low"), finding.without.get(f"{symbol}_high")]
        numbers = [value] if None in ends else ends
        texts = dict.fromkeys(f"{number:.3g}" for number in numbers if number is not None)
        if texts:
            estimates.append(f"{name} {' to '.join(texts)}")
    if not estimates:
        return printed(finding.cause)
    return printed(f"{finding.cause} (with it in the model {in_words(estimates)})")
