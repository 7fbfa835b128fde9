# SPDX-License-Identifier: Apache-2.0
"""Verdicts on trials, trials without a result, and the summary of a run in about ten lines.

Page, `summary.json` and terminal count verdicts by `verdict_on`, so that they agree.

Example: `verdict_on("impedance", findings, left_out=None)` is one of `VERDICTS`.
"""

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
MOST_LINES = 9  # at the end of a run; one more says where the page is
NOT_CHECKED = "not checked"
LINE = 110  # letters of a line at the end of a run
VERDICTS = (CLEAR, FLAGGED, DOUBTFUL, IN_PART, REFUSED, EXCLUDED, NOT_JUDGED)


class LeftOut(NamedTuple):
    """Why a trial has no result."""

    by_job: bool  # whether a job refused it or failed; else it was excluded
    reasons: list[str]


def left_out_trials(excluded: pl.DataFrame) -> dict[str, LeftOut]:
    """The trials of `excluded.csv` with their distinct reasons, by trial."""
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
    """The trials without a row in a table that their fit writes."""
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
    """The trials without a result of their own that other fits need, as static trials."""
    experiment_of = {trial: EXPERIMENTS[row["experiment"]] for trial, row in sheet.items()}
    return [trial for trial, facts in experiment_of.items() if facts.place and not facts.tables]


def used_and_missing(
    sheet: Mapping[str, Mapping[str, Any]], left_out: Mapping[str, LeftOut]
) -> dict[str, dict[str, Any]]:
    """By experiment: the number `of` trials in the sheet, the number `used`, and the `missing`
    trials with their reasons."""
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
        The findings on the trial.
    left_out : LeftOut or None
        Why the trial has no result; None if it has one.

    Returns
    -------
    str
        One of `VERDICTS`. A doubt about the recording alone makes a trial flagged. A doubt about
        the fit to the whole trial makes it doubtful. A doubt about one amplitude, frequency or
        further table makes it doubtful in part.
    """
    if left_out is not None:
        return REFUSED if left_out.by_job else EXCLUDED
    if not EXPERIMENTS[experiment].place:
        return NOT_JUDGED
    doubts = [finding for finding in findings if finding.grade is Grade.DOUBTS]
    doubted_tables = [doubt.table for doubt in doubts if not doubt.is_of_part]
    if doubted_tables:
        return FLAGGED if {*doubted_tables} == {QUALITY} else DOUBTFUL
    return IN_PART if doubts else CLEAR


def results_on(findings: Sequence[Finding]) -> list[Finding]:
    """The findings that the device of a trial is not of second order, as friction."""
    return [finding for finding in findings if finding.is_result and not finding.is_of_part]


def verdict_counts(
    sheet: Mapping[str, Mapping[str, Any]],
    findings: Iterable[Finding],
    left_out: Mapping[str, LeftOut],
) -> tuple[dict[str, int], dict[str, int]]:
    """Count the trials of the sheet by verdict, in the order of `VERDICTS`, and by the source of
    their `results_on`."""
    by_trial = findings_by_trial(findings)
    counts: Counter[str] = Counter()
    results: Counter[str] = Counter()
    for trial, row in sheet.items():
        trial_findings = by_trial.get(trial, ())
        verdict = verdict_on(row["experiment"], trial_findings, left_out.get(trial))
        counts[verdict] += 1
        results.update({finding.source for finding in results_on(trial_findings)})
    return {verdict: counts[verdict] for verdict in VERDICTS}, dict(results.most_common())


def verdicts_sentence(counts: Mapping[str, int], results: Mapping[str, int]) -> str:
    """`9 trials, 3 doubtful; what matters: friction in 4.` A trial may have several sources in
    `results`."""
    total = sum(counts.values())
    other_verdicts = [f"{n} {verdict}" for verdict, n in counts.items() if n and verdict != CLEAR]
    text = ", ".join(
        [f"{total} trial{'s' if total != 1 else ''}", *(other_verdicts or ["none doubtful"])]
    )
    causes = ", ".join(f"{known_finding(source).title} in {n}" for source, n in results.items())
    return f"{text}; what matters: {causes}." if causes else f"{text}."


def changed_lines(summary: Mapping[str, Any]) -> list[str]:
    """A line on settings that decide verdicts and differ from the shipped defaults; else none."""
    texts = [f"{row['setting']} {row['value']} ({row['default']})" for row in summary["changed"]]
    begin = "not as shipped, and decides verdicts (default in brackets): "
    return [begin + ", ".join(texts)] if texts else []


def brief_lines(summary: Mapping[str, Any]) -> list[str]:
    """The lines at the end of a run, from its `summary.json`.

    They have the answer, the number of trials by verdict, headline numbers, and the first findings
    with what to do. The last line counts further findings and checks that were not possible.
    """
    numbers = numbers_in_summary(summary)
    lines = [
        *textwrap.wrap(summary["answer"], LINE),
        verdicts_sentence(summary["verdicts"], summary["results_of_clear"]),
        *headline_sentences(numbers, by_condition=not summary["answer"]),
        *changed_lines(summary),
    ]
    findings = findings_in_summary(summary)
    shown = [finding for finding in findings if finding.verdict != NOT_CHECKED]
    room = max(MOST_LINES - len(lines) - 1, 1)
    lines += map(finding_line, shown[:room])
    not_shown = []
    if len(shown) > room:
        not_shown.append(f"further findings on the page: {len(shown) - room}")
    unchecked = causes_not_checked(findings)
    if unchecked:
        texts = first_of(unchecked, 1, " that the page lists")
        not_shown.append(f"not checked: {' '.join(texts)}")
    if not_shown:
        lines.append("; ".join(not_shown))
    return [line if len(line) <= LINE else shortened(line, LINE - len(" ...")) for line in lines]


def finding_line(finding: CampaignFinding) -> str:
    """A line on a finding, with what to do."""
    mark = "·" if finding.verdict == "remark" else "⚠"
    return " → ".join(filter(None, [f"{mark} {finding.counts}", finding.brief]))


def causes_not_checked(findings: Sequence[CampaignFinding]) -> list[str]:
    """The distinct causes that could not be checked."""
    return list(dict.fromkeys(f.cause for f in findings if f.verdict == NOT_CHECKED))


# The first sentence of the page and of a run's end


def answer(tables: Mapping[str, pl.DataFrame]) -> str:
    """Say how near K and B are to what was asked for, in one sentence.

    It has the largest errors of trials by controller, and the number of pairs in which compensation
    is nearer. It is empty where nothing was asked for, or all trials are doubtful.

    Parameters
    ----------
    tables
        `impedance`, with the findings on its rows, and `compensation`, if the campaign has them.
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
    if texts and len(pairs):  # columns of an empty file have no types to sum
        nearer = []
        for symbol in ("K", "B"):
            comparison = pairs.filter(of="trials", quantity=f"{symbol}_error")
            better, count = comparison.select(pl.sum("better", "pairs")).row(0)
            if count:
                nearer.append(f"in {symbol} in {better} of {count}")
        if nearer:
            texts.append(f"compensation is nearer {', '.join(nearer)} pairs")
    if not texts:
        return ""
    return f"Over whole trials, {'; '.join(texts)}."
