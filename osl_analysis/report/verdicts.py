# SPDX-License-Identifier: Apache-2.0
"""The trials of a campaign that have no result, and why; the verdict on each trial, which page,
summary and terminal count alike; and what a run found, in about ten lines for a terminal."""

import textwrap
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import polars as pl

from osl_analysis.base.errors import first_of, shortened
from osl_analysis.bench.summaries import COMPARED
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.figures.drawing import look_numbers
from osl_analysis.judge.campaign import (
    QUALITY,
    CampaignFinding,
    findings_in_summary,
)
from osl_analysis.judge.findings import Finding
from osl_analysis.judge.known_findings import known_finding
from osl_analysis.judge.recording_checks import BY_JOB, REFUSED, exclusion_text
from osl_analysis.judge.rules import Grade
from osl_analysis.report.numbers import MOST_IN_SENTENCE, headline_sentences, numbers_in_summary
from osl_analysis.stats.budget import CLEAR
from osl_analysis.stats.doubts import counted
from osl_analysis.stats.rounding import rounded_up

FLAGGED = "flagged"
DOUBTFUL = "doubtful"
IN_PART = "doubtful in part"
EXCLUDED = "excluded"
NOT_JUDGED = "not judged"  # recordings that are read and not analysed
MOST_LINES = 9  # at the end of a run, beside the one that says where the page is
NOT_CHECKED = "not checked"
LINE = 110  # letters of a line at the end of a run
VERDICTS = (CLEAR, FLAGGED, DOUBTFUL, IN_PART, REFUSED, EXCLUDED, NOT_JUDGED)


class LeftOut(NamedTuple):
    """Why a trial has no result."""

    by_job: bool  # whether a job refused or failed; else it was excluded
    reasons: list[str]


def left_out_trials(excluded: pl.DataFrame) -> dict[str, LeftOut]:
    """The trials that are left out, by trial, from `excluded.csv`; each reason once."""
    left_out: dict[str, LeftOut] = {}
    for row in excluded.iter_rows(named=True):
        by_job = row["check"] in BY_JOB
        reason = exclusion_text(row)
        reasons = left_out.setdefault(row["trial"], LeftOut(by_job, [])).reasons
        if reason not in reasons:
            reasons.append(reason)
    return left_out


def trials_without_result(
    sheet: Mapping[str, Mapping[str, Any]], tables: Mapping[str, pl.DataFrame]
) -> list[str]:
    """The trials that lack a row of a table that their fit fills."""
    trials_of = {name: {*table["trial"]} for name, table in tables.items() if "trial" in table}
    without = []
    for trial, row in sheet.items():
        experiment = EXPERIMENTS[row["experiment"]]
        filled = ["walking_crossings"] if row["experiment"] == "walking" else []
        if experiment.fit or row.get("perturbed"):
            filled += [table.name for table in experiment.tables[:1]]
        if any(trial not in trials_of.get(name, ()) for name in filled):
            without.append(trial)
    return without


def serving_trials(sheet: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The trials that have no result of their own and that fits of others need, as static ones."""
    experiment_of = {trial: EXPERIMENTS[row["experiment"]] for trial, row in sheet.items()}
    return [trial for trial, facts in experiment_of.items() if facts.place and not facts.tables]


def used_and_missing(
    sheet: Mapping[str, Mapping[str, Any]], left_out: Mapping[str, LeftOut]
) -> dict[str, dict[str, Any]]:
    """By experiment: number `of` trials in the sheet, number `used`, and why others are
    `missing`."""
    by_experiment = {}
    for experiment in EXPERIMENTS:
        trials = [trial for trial, row in sheet.items() if row["experiment"] == experiment]
        missing = {trial: left_out[trial].reasons[0] for trial in trials if trial in left_out}
        used = len(trials) - len(missing)
        if trials:
            by_experiment[experiment] = {"used": used, "of": len(trials), "missing": missing}
    return by_experiment


def missing_lines(content: Mapping[str, Any]) -> list[str]:
    """A line per experiment with missing trials and their reasons, and per missing result."""
    lines = []
    for experiment, counts in content["trials"].items():
        trials = [f"{trial} ({reason})" for trial, reason in counts["missing"].items()]
        if trials:
            used = f"{counts['used']} of {counts['of']} {experiment} trials"
            lines.append(f"{used}; without {', '.join(trials)}")
    missing_results = content["missing_results"].items()
    return [*lines, *(f"no {file}: {reason}" for file, reason in missing_results)]


# Verdicts


def findings_by_trial(findings: Iterable[Finding]) -> dict[str, list[Finding]]:
    """The findings on each trial or group."""
    by_trial: dict[str, list[Finding]] = {}
    for finding in findings:
        by_trial.setdefault(finding.subject, []).append(finding)
    return by_trial


def verdict_on(experiment: str, findings: Sequence[Finding], left_out: LeftOut | None) -> str:
    """The verdict on one trial.

    Parameters
    ----------
    experiment : str
    findings : Sequence of Finding
        Those on the trial.
    left_out : LeftOut or None
        Why it has no result.

    Returns
    -------
    str
        One of `VERDICTS`. It is flagged by a doubt about its recording alone, doubtful by one about
        the fit to all of it, and doubtful in part by one about one amplitude, frequency or further
        table.
    """
    if left_out is not None:
        return REFUSED if left_out.by_job else EXCLUDED
    if not EXPERIMENTS[experiment].place:
        return NOT_JUDGED
    doubts = [finding for finding in findings if finding.grade is Grade.DOUBTS]
    of_whole = [doubt.table for doubt in doubts if not doubt.is_of_part]
    if of_whole:
        return FLAGGED if {*of_whole} == {QUALITY} else DOUBTFUL
    return IN_PART if doubts else CLEAR


def results_on(findings: Sequence[Finding]) -> list[Finding]:
    """Why the device of a trial is not of second order, as friction."""
    return [finding for finding in findings if finding.is_result and not finding.is_of_part]


def verdict_counts(
    sheet: Mapping[str, Mapping[str, Any]],
    findings: Iterable[Finding],
    left_out: Mapping[str, LeftOut],
) -> tuple[dict[str, int], dict[str, int]]:
    """How many trials of the sheet have each verdict, in the order of `VERDICTS`, and on how many
    there is each source of `results_on`."""
    by_trial = findings_by_trial(findings)
    counts: Counter[str] = Counter()
    results: Counter[str] = Counter()
    for trial, row in sheet.items():
        of_trial = by_trial.get(trial, ())
        verdict = verdict_on(row["experiment"], of_trial, left_out.get(trial))
        counts[verdict] += 1
        results.update({finding.source for finding in results_on(of_trial)})
    return {verdict: counts[verdict] for verdict in VERDICTS}, dict(results.most_common())


def verdicts_sentence(counts: Mapping[str, int], results: Mapping[str, int]) -> str:
    """`9 trials, 3 doubtful; what matters: friction in 4.` A trial may have two causes; `results`
    has their sources."""
    total = sum(counts.values())
    others = [f"{n} {verdict}" for verdict, n in counts.items() if n and verdict != CLEAR]
    text = ", ".join([f"{total} trial{'s' if total != 1 else ''}", *(others or ["none doubtful"])])
    causes = ", ".join(f"{known_finding(source).title} in {n}" for source, n in results.items())
    return f"{text}; what matters: {causes}." if causes else f"{text}."


def changed_lines(summary: Mapping[str, Any]) -> list[str]:
    """What decides verdicts and differs from the shipped defaults, in a line; none without any."""
    texts = [f"{row['setting']} {row['value']} ({row['default']})" for row in summary["changed"]]
    begin = "not as shipped, and decides verdicts (default in brackets): "
    return [begin + ", ".join(texts)] if texts else []


def brief_lines(summary: Mapping[str, Any]) -> list[str]:
    """The answer, how many trials are doubtful or left out, the headline numbers, and the first
    findings with what to do, from a `summary.json`, in lines of a terminal; how many findings there
    are more, and how much could not be checked."""
    numbers = numbers_in_summary(summary)
    lines = [
        *textwrap.wrap(summary["answer"], LINE),
        verdicts_sentence(summary["verdicts"], summary["results_of_clear"]),
        *headline_sentences(numbers, by_condition=not summary["answer"]),
        *changed_lines(summary),
    ]
    findings = findings_in_summary(summary)
    told = [finding for finding in findings if finding.verdict != NOT_CHECKED]
    room = max(MOST_LINES - len(lines) - 1, 1)
    lines += map(finding_line, told[:room])
    rest = []
    if len(told) > room:
        rest.append(f"further findings on the page: {len(told) - room}")
    unchecked = causes_not_checked(findings)
    if unchecked:
        texts = first_of(unchecked, 1, " that the page lists")
        rest.append(f"not checked: {' '.join(texts)}")
    if rest:
        lines.append("; ".join(rest))
    return [line if len(line) <= LINE else shortened(line, LINE - len(" ...")) for line in lines]


def finding_line(finding: CampaignFinding) -> str:
    """A finding and what to do."""
    mark = "·" if finding.verdict == "remark" else "⚠"
    return " → ".join(filter(None, [f"{mark} {finding.counts}", finding.brief]))


def causes_not_checked(findings: Sequence[CampaignFinding]) -> list[str]:
    """What could not be checked, each once."""
    return list(dict.fromkeys(f.cause for f in findings if f.verdict == NOT_CHECKED))


# The sentence that a page and a run begin with: does the joint render what was asked for,
# and better with compensation than without.


def answer(tables: Mapping[str, pl.DataFrame]) -> str:
    """How far K and B of the trials are at most from what was asked for, by controller, and in how
    many pairs compensation is nearer; empty where nothing was asked for, or all is doubtful.

    Parameters
    ----------
    tables
        `impedance`, with the findings on its rows, and `compensation`, as far as the campaign has
        them.
    """
    if "impedance" not in tables:
        return ""
    whole = tables["impedance"].filter(
        pl.col("amplitude_deg").is_null() & (pl.col("K_d") > 0) & pl.col("B_d").is_not_null()
    )
    whole = whole.with_columns(look_numbers(whole["controller"])).sort("look", nulls_last=True)
    texts: list[str] = []
    for trials in whole.partition_by("controller")[:MOST_IN_SENTENCE]:
        clauses = []
        for symbol in ("K", "B"):
            unit, error, _ = COMPARED[f"{symbol}_error"]
            worst = counted(trials, [symbol]).select(error.max()).item()
            if worst is not None:
                size = f"within {rounded_up(worst)} {unit}"
                clauses.append(f"{symbol} {size}" if texts else f"{symbol} is {size} of {symbol}_d")
        if clauses:
            texts.append(", ".join(filter(None, [trials["controller"][0], " and ".join(clauses)])))
    pairs = tables.get("compensation", pl.DataFrame())
    if texts and len(pairs):  # an empty file has no types
        nearer = []
        for symbol in ("K", "B"):
            of_quantity = pairs.filter(of="trials", quantity=f"{symbol}_error")
            better, count = of_quantity.select(pl.sum("better", "pairs")).row(0)
            if count:
                nearer.append(f"in {symbol} in {better} of {count}")
        if nearer:
            texts.append(f"compensation is nearer {', '.join(nearer)} pairs")
    if not texts:
        return ""
    return f"Over whole trials, {'; '.join(texts)}."
