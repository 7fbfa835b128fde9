"""What a reader must know of a campaign: causes with their trials, in the same words at the end of
a run, by `results` and on the page."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import chain
from typing import Any

import polars as pl

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.judge.campaign import MOST_NAMED, QUALITY
from osl_analysis.judge.finding import Finding, Grade, WordedFinding, Words
from osl_analysis.judge.known_findings import CHECKS, known_finding
from osl_analysis.judge.words import sentence_of
from osl_analysis.stats.repeats import DOUBTFUL


@dataclass(frozen=True)
class CampaignFinding:
    """A cause, or a thing that could not be checked, with its trials, as `summary.json` has it.

    Attributes
    ----------
    verdict
        On its trials: doubtful, doubtful in part, flagged, not checked, or remark.
    subject
        What was judged, such as `impedance trials`.
    name, cause
        As of a `Finding`.
    words
        For the worst of its trials.
    n
        Number of all trials that were judged.
    brief
        What to do, in a few words.
    trials
        Those with this cause.
    line
        All of it in a sentence.
    """

    verdict: str
    subject: str
    name: str
    cause: str
    words: Words
    n: int
    brief: str
    trials: Sequence[str]
    line: str

    @property
    def kind(self) -> str:
        """What was judged, without the part of it, as in `impedance trials, at single amplitudes
        alone`."""
        return self.subject.partition(",")[0]

    @property
    def counts(self) -> str:
        """The cause, and on how many of the trials it is."""
        return f"{self.cause}: {len(self.trials)} of {self.n} {self.kind}"

    @property
    def is_result(self) -> bool:
        """Whether it is a property of the device."""
        return known_finding(self.name).is_result

    def to_json(self) -> dict[str, Any]:
        """An object under `findings` of `summary.json`."""
        content = asdict(self)
        content["of"] = content.pop("subject")
        words = content.pop("words")
        return {**content, **words._asdict()}


def findings_in_summary(summary: Mapping[str, Any]) -> list[CampaignFinding]:
    """The findings that a `summary.json` lists."""
    findings = []
    for listed in summary.get("findings", ()):
        content = dict(listed)
        words = Words(*(content.pop(part) for part in Words._fields))
        findings.append(CampaignFinding(subject=content.pop("of"), words=words, **content))
    return findings


@dataclass(frozen=True)
class JudgedTable:
    """A result table with the column `DOUBTFUL`, and what its findings are about."""

    name: str
    subject: str  # of its doubts, such as `impedance trials`
    subject_of_unchecked: str  # of what could not be checked, such as `phasors trials`
    trials: Sequence[str]  # those that were judged, or groups
    doubts_of: str  # the table of the same trials whose doubts its rows share; empty for none


def judged_tables_of(tables: Mapping[str, pl.DataFrame]) -> Iterator[JudgedTable]:
    """The judged tables of a campaign, in the order of the experiments."""
    for experiment, facts in EXPERIMENTS.items():
        origins = {table.name: table.doubts_of for table in facts.tables if table.judged}
        of_groups = dict.fromkeys(facts.judged_further, "")
        for name, origin in {**origins, **of_groups}.items():
            rows = tables.get(name, pl.DataFrame())
            if DOUBTFUL not in rows.columns:
                continue
            trials = subjects(rows.filter(pl.col(DOUBTFUL).is_not_null()))
            title = name.replace("_", " ")
            if name in of_groups:
                yield JudgedTable(name, title, title, trials, origin)
            else:
                of_experiment = f"{experiment.replace('_', ' ')} trials"
                yield JudgedTable(name, of_experiment, f"{title} trials", trials, origin)


FindingsByTable = Mapping[tuple[str, Grade], Sequence[WordedFinding]]
"""Findings by table and grade; empty where there are none."""


def causes_in_campaign(
    findings: Sequence[WordedFinding],
    tables: Mapping[str, pl.DataFrame],
    verdicts: pl.DataFrame,
) -> list[CampaignFinding]:
    """Gather what a reader must know of a campaign.

    Parameters
    ----------
    findings : Sequence of WordedFinding
        Those of `findings.csv`.
    tables : Mapping of str to polars.DataFrame
        Result tables by name, which give the numbers of trials.
    verdicts : polars.DataFrame
        `quality.csv`.

    Returns
    -------
    list of CampaignFinding
        Each cause by experiment with its trials. Doubts come first, then failed checks of trials
        that are used, remarks, and what could not be checked; in each, the most frequent cause
        first.
    """
    present = {*subjects(verdicts), *chain(*map(subjects, tables.values()))}
    by_table: dict[tuple[str, Grade], list[WordedFinding]] = defaultdict(list)
    for worded in findings:
        finding = worded.finding
        if finding.subject in present:
            by_table[finding.table, finding.grade].append(worded)

    doubts: list[CampaignFinding] = []
    remarks: list[CampaignFinding] = []
    unchecked: list[CampaignFinding] = []
    for table in judged_tables_of(tables):
        doubts += doubts_about_table(table, by_table)
        remarks += about_whole_trials(table, by_table[table.name, Grade.NOTES], "remark")
        unchecked += about_whole_trials(table, by_table[table.name, Grade.UNCHECKED], "not checked")
    flags = list(flags_by_check(by_table[QUALITY, Grade.DOUBTS], verdicts))
    return [
        *most_frequent_first(doubts),
        *most_frequent_first(flags),
        *most_frequent_first(remarks),
        *most_frequent_first(unchecked),
    ]


def doubts_about_table(table: JudgedTable, by_table: FindingsByTable) -> Iterator[CampaignFinding]:
    """The causes of doubt about the rows of a table, without those that it shares with the table of
    the fits to the same trials."""
    of_table = by_table[table.name, Grade.DOUBTS]
    if table.doubts_of:
        yield from doubts_beside_origin(table, of_table, by_table[table.doubts_of, Grade.DOUBTS])
    else:
        yield from doubts_by_cause(table, of_table)


def about_whole_trials(
    table: JudgedTable, findings: Sequence[WordedFinding], verdict: str
) -> Iterator[CampaignFinding]:
    """What was noted of the whole trials of a table, or could not be checked on them."""
    of_whole = [worded for worded in findings if not worded.finding.is_of_part]
    yield from by_cause(of_whole, verdict, table.subject_of_unchecked, table.trials)


def flags_by_check(
    failed_checks: Sequence[WordedFinding], verdicts: pl.DataFrame
) -> Iterator[CampaignFinding]:
    """The failed checks of trials that are used, in the order of the checks."""
    for check in CHECKS:
        failed = []
        for worded in failed_checks:
            if [number.column for number in worded.finding.evidence] == [check]:
                failed.append(worded)
        checked_trials = subjects(verdicts.filter(pl.col("check") == check))
        yield from by_cause(failed, "flagged", "trials", checked_trials)


def most_frequent_first(causes: Sequence[CampaignFinding]) -> list[CampaignFinding]:
    """Causes by how many trials have them; in their order where these are as many."""
    return sorted(causes, key=lambda cause: -len(cause.trials))


def doubts_by_cause(
    table: JudgedTable, doubts: Sequence[WordedFinding]
) -> Iterator[CampaignFinding]:
    """Doubts about the rows of a table: those about whole trials, then those about single
    amplitudes, or about single results, of trials that are sound as a whole."""
    whole = {trial_and_cause(doubt) for doubt in doubts if not doubt.finding.is_of_part}
    of_whole = [doubt for doubt in doubts if trial_and_cause(doubt) in whole]
    of_part = [doubt for doubt in doubts if trial_and_cause(doubt) not in whole]
    yield from by_cause(of_whole, "doubtful", table.subject, table.trials)
    subject = table.subject
    if all(doubt.finding.amplitude_deg is not None for doubt in of_part):
        subject = f"{subject}, at single amplitudes alone"
    yield from by_cause(of_part, "doubtful in part", subject, table.trials)


def doubts_beside_origin(
    table: JudgedTable, doubts: Sequence[WordedFinding], doubts_of_origin: Sequence[WordedFinding]
) -> Iterator[CampaignFinding]:
    """Doubts about the rows of a table of single results, such as frequencies, that the table of
    the fits to the same trials does not have."""
    in_origin = {trial_and_cause(doubt) for doubt in doubts_of_origin}
    further = [doubt for doubt in doubts if trial_and_cause(doubt) not in in_origin]
    subject = f"{table.subject}, in {table.name.replace('_', ' ')} alone"
    yield from by_cause(further, "doubtful in part", subject, table.trials)


def trial_and_cause(worded: WordedFinding) -> tuple[str, str]:
    return worded.finding.subject, worded.finding.cause


def subjects(rows: pl.DataFrame) -> list[str]:
    """The trials, or groups, of a table."""
    for key in ("trial", "group"):
        if key in rows.columns:
            return rows[key].unique(maintain_order=True).to_list()
    return []


def largest_excess(finding: Finding) -> float:
    """How far the evidence of a finding is beyond its limits, as a factor; 0 without evidence."""
    return max((number.excess for number in finding.evidence), default=0.0)


def by_cause(
    findings: Sequence[WordedFinding], verdict: str, subject: str, judged_trials: Sequence[str]
) -> Iterator[CampaignFinding]:
    """What a reader must know of each cause, or of each thing that could not be checked, with its
    size in the worst trial. The last row of a trial counts, which is its fit to all."""
    causes: dict[str, dict[str, WordedFinding]] = {}
    for worded in findings:
        trial, cause = trial_and_cause(worded)
        causes.setdefault(cause, {})[trial] = worded
    for cause, by_trial in causes.items():
        worst = max(by_trial, key=lambda trial: largest_excess(by_trial[trial].finding))
        finding = by_trial[worst].finding
        words = by_trial[worst].words
        if words.size and len(by_trial) > 1:
            words = words._replace(size=f"{words.size}, most in {worst}")
        if words.says and len({of_trial.words.says for of_trial in by_trial.values()}) > 1:
            words = words._replace(says=f"{words.says} (in {worst})")
        trials = list(by_trial)
        counts = f"{len(trials)} of {len(judged_trials)} {subject}"
        trial_names = named_trials(trials, judged_trials)
        yield CampaignFinding(
            verdict=verdict,
            subject=subject,
            name=finding.name,
            cause=cause,
            words=words,
            n=len(judged_trials),
            brief=known_finding(finding.name).brief,
            trials=trials,
            line=f"{verdict}, {counts}: {sentence_of(words, cause)}{trial_names}",
        )


def named_trials(trials: Sequence[str], judged_trials: Sequence[str]) -> str:
    """Some of the trials with a cause, in brackets, or the few judged ones without it; empty where
    all have it."""
    without_cause = [trial for trial in judged_trials if trial not in trials]
    if not without_cause:
        return ""
    are_nearly_all = len(without_cause) <= MOST_NAMED < len(trials)
    names = without_cause if are_nearly_all else trials
    text = ", ".join(names[:MOST_NAMED])
    if len(names) > MOST_NAMED:
        text += ", ..."
    return f" [all but {text}]" if are_nearly_all else f" [{text}]"
