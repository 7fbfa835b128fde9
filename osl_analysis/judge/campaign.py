# SPDX-License-Identifier: Apache-2.0
"""Gather the findings of a campaign, and count trials by cause.

The end of a run, the command `results` and the page say these causes in the same words.

Example: `causes_in_campaign(findings, tables, verdicts)[0].sentence`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import polars as pl

from osl_analysis.base.errors import listing
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.judge.agreement import disagreements
from osl_analysis.judge.checks import CHECKS
from osl_analysis.judge.findings import Finding, fit_of
from osl_analysis.judge.joining import WHY_NO_FIT, with_findings
from osl_analysis.judge.judging import judged
from osl_analysis.judge.known_findings import FINDINGS, known_finding
from osl_analysis.judge.limits import Limits
from osl_analysis.judge.recording_checks import (
    BY_SHEET,
    CROSSING,
    HOW_TO_USE,
    REFUSED,
    exclusion_text,
)
from osl_analysis.judge.rules import Beyond, Grade
from osl_analysis.judge.wording import sentence_of, worded
from osl_analysis.stats.rounding import significant

MOST_NAMED = 3  # number of trials that a line names
QUALITY = "quality"
SHOWN_BY_SPRING = ("late_torque", "wrong_gain", "fixture_inertia")


def campaign_findings(
    on_tables: Sequence[Finding], verdicts: pl.DataFrame, is_calibrated: bool = False
) -> list[Finding]:
    """All findings of a campaign.

    Parameters
    ----------
    on_tables : Sequence of Finding
        Findings on the rows of its tables (`table_findings`).
    verdicts : polars.DataFrame
        `quality.csv`.
    is_calibrated : bool
        Whether the campaign has recorded a known spring or inertia.

    Returns
    -------
    list of Finding
        Failed checks of recordings, then the findings on tables. A check is left out where the fit
        to the same recording is doubtful by the same source.
    """
    doubts = [finding for finding in on_tables if finding.grade is Grade.DOUBTS]
    facts_of_fits = {fact_of(doubt) for doubt in doubts if not doubt.is_of_part}
    on_recordings = [
        check for check in failed_checks(verdicts) if fact_of(check) not in facts_of_fits
    ]
    if is_calibrated:
        return [*on_recordings, *map(with_its_calibration, on_tables)]
    return [*on_recordings, *on_tables]


def table_findings(
    table: pl.DataFrame,
    limits: Limits,
    name: str,
    faults: Mapping[str, str] | None = None,
    budget: pl.DataFrame | None = None,
) -> list[Finding]:
    """The findings on all rows of a table: those of each row (`judged`), and for trials of
    impedance those by comparison with other trials (`disagreements`)."""
    by_row = judged(table, limits, name, faults, budget)
    if name != "impedance":
        return list(chain(*by_row))
    whole_trials = {
        row["trial"]: row
        for row in with_findings(table, by_row).to_dicts()
        if row.get("amplitude_deg") is None and row.get(WHY_NO_FIT) is None
    }
    findings = list(chain(*by_row))
    for finding in disagreements(whole_trials.values(), limits.accuracy.model_dump()):
        row = whole_trials[finding.subject]
        placed = replace(finding, joint=row.get("joint"), side=row.get("side"))
        findings.append(worded(placed, row))
    return findings


def with_its_calibration(finding: Finding) -> Finding:
    """The finding with the remedy of a campaign that has recorded a known spring or inertia."""
    if finding.grade is not Grade.UNCHECKED or finding.source not in SHOWN_BY_SPRING:
        return finding
    remedy = "State what calibration.csv says of this bench (`to_state`), and run again"
    return replace(finding, remedy=remedy)


def fact_of(finding: Finding) -> tuple[str, str]:
    """The source and the trial of a finding."""
    return finding.source, finding.subject


def failed_checks(verdicts: pl.DataFrame) -> Iterator[Finding]:
    """The failed checks of recordings, whether or not they exclude the trial."""
    grades = {"flag": Grade.DOUBTS, "exclude": Grade.EXCLUDES}
    for row in verdicts.filter(pl.col("verdict").is_in(list(grades))).to_dicts():
        check = CHECKS[row["check"]]
        threshold = row.get("threshold") or 0.0
        evidence = Beyond(check.name, row["value"], threshold, check.source, check.fails)
        grade = grades[row["verdict"]]
        size = f"{significant(row['value'], 3)} {row['unit']}"
        if row["remark"]:
            size = f"{size} ({row['remark']})"
        finding = Finding(
            source=check.source,
            table=QUALITY,
            subject=row["trial"],
            joint=row.get("joint"),
            side=row.get("side"),
            grade=grade,
            evidence=(evidence,),
            size=size,
        )
        yield worded(finding, row)


def exclusion_report(excluded: pl.DataFrame) -> str:
    """List the excluded trials of `excluded.csv` for the end of a run.

    Refused trials are left out, also where they fail a check: they have lines of their own.

    Returns
    -------
    str
        A line for each trial that the sheet excludes, for each failed check, and for all crossings
        that cannot be used.
    """
    lines = [
        f"excluded by the sample sheet: {trial} ({why})"
        for trial, why in excluded.filter(check=BY_SHEET).select("trial", "remark").rows()
    ]
    crossings = excluded.filter(check=CROSSING)["trial"].to_list()
    if crossings:
        lines.append(f"crossings not used: {', '.join(crossings)}; tables/excluded.csv says why")
    refused = excluded.filter(check=REFUSED)["trial"].to_list()
    failed = excluded.drop_nulls("value").remove(pl.col("trial").is_in(refused))
    for (check,), rows in failed.group_by("check", maintain_order=True):
        kind = FINDINGS[CHECKS[str(check)].source]
        trials = [f"{row['trial']} ({exclusion_text(row)})" for row in rows.to_dicts()]
        lines.append(
            f"excluded from tables and figures by quality control: {listing(trials, MOST_NAMED)}:"
            f" {kind.title}, {kind.says}; {kind.remedy}"
        )
    if len(failed):
        lines.append(f"to change that: {HOW_TO_USE}")
    return "\n".join(lines)


RANKS = ("doubtful", "doubtful in part", "flagged", "remark", "not checked")
"""Verdicts in the order in which they are printed."""


@dataclass(frozen=True)
class CampaignFinding:
    """A cause, or a check that was not possible, with its trials, as `summary.json` has it.

    Attributes
    ----------
    verdict
        On its trials: doubtful, doubtful in part, flagged, not checked, or remark.
    subject
        What was judged, such as `impedance trials`, or `impedance trials, at single amplitudes
        alone`.
    source, cause
        Source and title, as in `Finding`.
    says, size, remedy
        What is wrong, how large it is, and what to do, for the trial `worst`.
    n
        Number of all trials that were judged.
    brief
        What to do, in a few words.
    trials
        Trials with this cause.
    worst
        The trial whose first number is farthest beyond its limit, or the first trial. Another trial
        may have a larger size in another number.
    """

    verdict: str
    subject: str
    source: str
    cause: str
    n: int
    brief: str
    trials: Sequence[str]
    worst: str
    says: str
    size: str
    remedy: str

    @property
    def counts(self) -> str:
        """The cause, and the number of its trials."""
        return f"{self.cause}: {len(self.trials)} of {self.n} {self.subject}"

    @property
    def size_in_trial(self) -> str:
        """The size, and the trial that it is of."""
        is_of_several = self.size and len(self.trials) > 1
        return f"as in {self.worst}, {self.size}" if is_of_several else self.size

    @property
    def sentence(self) -> str:
        """The whole finding in a sentence, with its first trials."""
        words = sentence_of(self.says, self.size_in_trial, self.remedy)
        trials = listing(self.trials, MOST_NAMED)
        return f"{self.verdict}, {self.counts}: {words} [{trials}]"

    @property
    def is_result(self) -> bool:
        """Whether the cause is a property of the device, and was checked."""
        return self.verdict != Grade.UNCHECKED and known_finding(self.source).is_result


def findings_in_summary(summary: Mapping[str, Any]) -> list[CampaignFinding]:
    """The findings that a `summary.json` lists."""
    return [CampaignFinding(**fields) for fields in summary["findings"]]


def judged_tables_of(tables: Mapping[str, pl.DataFrame]) -> dict[str, tuple[str, int]]:
    """The judged tables of a campaign, by name, in the order of the experiments.

    Each has what was judged, such as `impedance trials`, and the number of trials or groups.
    """
    judged = {}
    for facts in EXPERIMENTS.values():
        kinds = {table.name: " trials" for table in facts.tables if table.judged}
        for name, kind in {**kinds, **dict.fromkeys(facts.judged_further, "")}.items():
            if name in tables:
                rows = tables[name].to_dicts()
                subjects = {fit_of(row)[0] for row in rows if row.get(WHY_NO_FIT) is None}
                judged[name] = (name.replace("_", " ") + kind, len(subjects))
    return judged


def causes_in_campaign(
    findings: Sequence[Finding],
    tables: Mapping[str, pl.DataFrame],
    verdicts: pl.DataFrame,
) -> list[CampaignFinding]:
    """Count the trials of a campaign by cause.

    Parameters
    ----------
    findings : Sequence of Finding
        Findings of the campaign (`campaign_findings`).
    tables : Mapping of str to polars.DataFrame
        Result tables by name, which give the numbers of trials.
    verdicts : polars.DataFrame
        `quality.csv`.

    Returns
    -------
    list of CampaignFinding
        Each cause by experiment with its trials. Doubts come first, then failed checks of trials
        that are used, remarks, and what could not be checked; in each, the most frequent cause
        first. A trial that is doubtful is not among those that are doubtful in part.
    """
    judged = judged_tables_of(tables)
    doubts = [finding for finding in findings if finding.grade is Grade.DOUBTS]
    doubtful = {finding.subject for finding in doubts if not finding.is_of_part}
    verdicts_of = {Grade.DOUBTS: "doubtful", Grade.NOTES: "remark", Grade.UNCHECKED: "not checked"}

    # by the fields of a cause and the failed check; the last finding on a trial counts, which is
    # about the whole trial
    by_cause: dict[tuple[str, str, int, str, str], dict[str, Finding]] = {}
    for finding in findings:
        is_doubt = finding.grade is Grade.DOUBTS
        check = ""
        if finding.table in judged:
            subject, n = judged[finding.table]
            verdict = verdicts_of[finding.grade]
            if finding.is_of_part:
                if not is_doubt or finding.subject in doubtful:
                    continue
                subject = f"{subject}, at single amplitudes alone"
                verdict = "doubtful in part"
        elif finding.table == QUALITY and is_doubt:
            verdict = "flagged"
            subject = "trials"
            check = finding.evidence[0].column
            n = verdicts.filter(check=check)["trial"].n_unique()
        else:
            continue
        by_trial = by_cause.setdefault((verdict, subject, n, finding.source, check), {})
        by_trial[finding.subject] = finding
    causes = []
    for (verdict, subject, n, source, _), by_trial in by_cause.items():
        worst = max(by_trial, key=lambda trial: by_trial[trial].excess)
        worst_finding = by_trial[worst]
        says = str(worst_finding.says)
        if says and len({finding.says for finding in by_trial.values()}) > 1:
            says = f"{says} (in {worst})"
        kind = known_finding(source)
        remedy = str(worst_finding.remedy)
        is_in_part = verdict == "doubtful in part"
        causes.append(
            CampaignFinding(
                verdict=verdict,
                subject=subject,
                source=source,
                cause=kind.title,
                n=n,
                brief="leave out rows marked doubtful" if is_in_part else kind.brief or remedy,
                trials=list(by_trial),
                worst=worst,
                says=says,
                size=worst_finding.size,
                remedy=remedy,
            )
        )
    return sorted(causes, key=lambda cause: (RANKS.index(cause.verdict), -len(cause.trials)))
