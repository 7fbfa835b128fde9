"""The findings on all trials of a campaign as one table, `findings.csv`, and what a reader must
know of them: causes with their trials, in the same words at the end of a run, by `results` and on
the page.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.config.experiments import EXPERIMENTS, doubts_of, judged_tables
from osl_analysis.errors import listing
from osl_analysis.judge.causes import CAUSES
from osl_analysis.judge.exclusions import HOW_TO_USE, exclusions
from osl_analysis.judge.finding import (
    FINDING_NUMBERS,
    Beyond,
    Finding,
    Grade,
    findings_frame,
)
from osl_analysis.judge.judging import judged, unchecked_in, with_inherited
from osl_analysis.judge.limits import CHECKS, DoubtfulFits
from osl_analysis.judge.words import (
    Words,
    brief_remedy,
    capital,
    check_words,
    component_changes_text,
    misfit_words,
    sentence_of,
    words_of,
)
from osl_analysis.measured import SHORT, significant, unusual
from osl_analysis.stats.repeats import DOUBTFUL

# percent of the torque that a prediction may leave along angle, velocity and acceleration
LARGEST_MISFIT = 1.0
MOST_NAMED = 3  # number of trials that a line names
QUALITY = "quality"
PREDICTION_TABLE = "prediction"
JUDGED_FURTHER = (PREDICTION_TABLE, "prediction_causes")
"""Tables without limits that have findings."""


def campaign_findings(
    tables: Mapping[str, pl.DataFrame], verdicts: pl.DataFrame, limits: DoubtfulFits
) -> pl.DataFrame:
    """Judge all trials of a campaign.

    Parameters
    ----------
    tables : Mapping of str to polars.DataFrame
        Result tables by name, with their evidence.
    verdicts : polars.DataFrame
        `quality.csv`.
    limits : DoubtfulFits
        Accuracy and limits of the configuration.

    Returns
    -------
    polars.DataFrame
        `findings.csv`. Findings that rows inherit from another table are listed once per trial and
        amplitude, without words: the original finding has these.

    Raises
    ------
    InputError
        A limit stands on a column that its table does not have.
    """
    findings = list(failed_checks(verdicts))
    fits = {name: table for name, table in tables.items() if name in judged_tables()}
    own_findings = {name: judged(table, limits.of(name), name) for name, table in fits.items()}
    listed: set[object] = set()  # the inherited findings
    for name, table in fits.items():
        by_row = own_findings[name]
        origin = doubts_of().get(name, "")  # the table of the fits to the same trials
        if origin in fits:
            by_row = with_inherited(name, table, by_row, fits[origin], own_findings[origin])
        for row, of_row in zip(table.iter_rows(named=True), by_row, strict=True):
            # those of the row itself first
            for finding in sorted(of_row, key=lambda finding: bool(finding.inherited)):
                key = finding.table, finding.subject, finding.amplitude_deg, finding.cause
                if not finding.inherited:
                    findings.append((finding, words_of(finding, row)))
                elif key not in listed:
                    listed.add(key)
                    findings.append((finding, Words("", "", "")))
    for row in tables.get(PREDICTION_TABLE, pl.DataFrame()).iter_rows(named=True):
        for finding in unchecked_in(PREDICTION_TABLE, row):
            findings.append((finding, words_of(finding, row)))
    findings.extend(causes_of_misfit(tables))
    findings.extend(recordings_of_another_length(fits.get("impedance", pl.DataFrame())))
    return findings_frame(findings)


def failed_checks(verdicts: pl.DataFrame) -> Iterator[tuple[Finding, Words]]:
    """The failed checks of recordings, whether or not they exclude the trial."""
    grades = {"flag": Grade.DOUBTS, "exclude": Grade.EXCLUDES}
    for row in verdicts.filter(pl.col("verdict").is_in(list(grades))).to_dicts():
        check = CHECKS[row["check"]]
        evidence = Beyond(check.name, row["value"], row.get("threshold") or 0.0, check.fails)
        grade = grades[row["verdict"]]
        size = f"{significant(row['value'], 3)} {row['unit']}"
        if row["remark"]:
            size = f"{size} ({row['remark']})"
        words = check_words(check.cause)
        finding = Finding(QUALITY, row["trial"], check.cause, grade, (evidence,))
        yield finding, words._replace(size=size, remedy=capital(words.remedy))


@dataclass(frozen=True)
class PredictionMisfit:
    """What explains that the components of a joint do not predict the torque of its trials."""

    cause: str
    evidence: tuple[Beyond, ...]
    words: Words


def causes_of_misfit(tables: Mapping[str, pl.DataFrame]) -> Iterator[tuple[Finding, Words]]:
    """The component, or the late controller, that `prediction_causes.csv` names; or else, that the
    components of a joint and side do not predict the torque and no single cause explains it. One
    finding for each predicted trial."""
    causes = tables.get("prediction_causes", pl.DataFrame(schema=["joint", "side"]))
    for rows in causes.partition_by("joint", "side", maintain_order=True):
        same_joint = pl.col("joint").eq_missing(pl.lit(rows["joint"][0], pl.String))
        same_side = pl.col("side").eq_missing(pl.lit(rows["side"][0], pl.String))
        predicted = tables[PREDICTION_TABLE].filter(same_joint, same_side)
        predicted = predicted.filter(pl.col("VAF").is_not_null())
        for misfit in misfits_of_joint(rows, predicted):
            for trial in predicted["trial"]:
                finding = Finding(PREDICTION_TABLE, trial, misfit.cause, evidence=misfit.evidence)
                yield finding, misfit.words


def misfits_of_joint(rows: pl.DataFrame, predicted: pl.DataFrame) -> list[PredictionMisfit]:
    """The causes of one joint and side, from its rows of `prediction_causes.csv` and its predicted
    trials."""
    is_delay = pl.col("component").str.ends_with("_delay")
    components = rows.filter("named", ~is_delay).to_dicts()
    delays = rows.filter(is_delay).to_dicts()  # named or not
    misfits: list[PredictionMisfit] = []
    if components:
        cause = f"component {' or '.join(row['component'] for row in components)}"
        words = misfit_words("component", as_if=component_changes_text(components))
        misfits.append(PredictionMisfit(cause, changes_beyond_zero(components), words))
    if any(row["named"] for row in delays):
        angle_ms, velocity_ms = (1e3 * row["change"] for row in delays)
        words = misfit_words("late controller", angle=angle_ms, velocity=velocity_ms)
        misfits.append(PredictionMisfit("late controller", changes_beyond_zero(delays), words))
    unexplained_percent = max((row["left"] or 0.0 for row in delays), default=0.0)  # of the torque
    if not misfits and unexplained_percent > LARGEST_MISFIT:
        cause = "components that do not predict"
        words = misfit_words(
            cause,
            K=measured_over_predicted(predicted, "K"),
            B=measured_over_predicted(predicted, "B"),
        )
        evidence = Beyond("left", unexplained_percent, LARGEST_MISFIT, "above")
        misfits.append(PredictionMisfit(cause, (evidence,), words))
    return misfits


def changes_beyond_zero(rows: Sequence[Mapping[str, Any]]) -> tuple[Beyond, ...]:
    """The changes of components, or of delays, that would explain the torque, as evidence."""
    return tuple(Beyond(row["component"], row["change"], 0.0, "above") for row in rows)


def measured_over_predicted(predicted: pl.DataFrame, symbol: str) -> float:
    """By how many percent K or B is measured above its prediction, the median of trials."""
    ratio = (predicted[f"{symbol}_measured"] / predicted[symbol]).to_numpy()
    return 100 * float(np.median(ratio)) - 100


def recordings_of_another_length(impedance: pl.DataFrame) -> Iterator[tuple[Finding, Words]]:
    """Trials shorter or longer than most with their kind of motion: half of a file looks whole, and
    a wrongly stated rate changes the length."""
    cause = "recording of another length"
    if not {"recorded_s", "excitation"} <= set(impedance.columns):
        return
    whole = impedance.filter(pl.col("amplitude_deg").is_null(), pl.col("recorded_s") > 0)
    for rows in whole.partition_by("excitation"):
        is_unusual, usual = unusual(rows["recorded_s"].to_numpy())
        for trial, seconds in rows.filter(is_unusual).select("trial", "recorded_s").iter_rows():
            if seconds < usual:
                evidence = Beyond("recorded_s", seconds, SHORT * usual, "below")
            else:
                evidence = Beyond("recorded_s", seconds, usual / SHORT, "above")
            finding = Finding("impedance", trial, cause, Grade.NOTES, (evidence,))
            yield finding, misfit_words(cause, seconds=seconds, usual=usual)


Entry = dict[str, Any]
"""A finding of `findings.csv` by column, with its numbers under `evidence`, and `in_part`: whether
it concerns a single amplitude, frequency or result."""


@dataclass(frozen=True)
class CauseInCampaign:
    """A cause, or a thing that could not be checked, with its trials, as `summary.json` has it.

    Attributes
    ----------
    verdict
        On its trials: doubtful, doubtful in part, flagged, not checked, or remark.
    of
        What was judged, such as `impedance trials`.
    words
        For the worst of its trials.
    n
        Number of all trials that were judged.
    trials
        Those with this cause.
    line
        All of it in a sentence.
    measure, limit
        The columns of its evidence, and their limits.
    table, worst
        The table of the findings, and the trial farthest beyond its limits.
    numbers
        Effect and estimates of the worst trial, by column of `findings.csv`.
    """

    verdict: str
    of: str
    cause: str
    words: Words
    n: int
    trials: Sequence[str]
    line: str
    measure: str
    limit: str
    table: str
    worst: str
    numbers: Mapping[str, float]

    def to_entry(self) -> Entry:
        return {
            "verdict": self.verdict,
            "of": self.of,
            "cause": self.cause,
            **self.words._asdict(),
            "n": self.n,
            "brief": brief_remedy(self.cause),
            "trials": list(self.trials),
            "line": self.line,
            "measure": self.measure,
            "limit": self.limit,
            "table": self.table,
            "worst": self.worst,
            **self.numbers,
        }


def entries(findings: pl.DataFrame) -> list[Entry]:
    """The findings of `findings.csv`, each with its numbers under `evidence`: column, value, limit
    and side."""
    by_number: dict[int, Entry] = {}
    for row in findings.iter_rows(named=True):
        is_of_part = row["amplitude_deg"] is not None or row["frequency_hz"] is not None
        concerns_some_results = row["cause"] in CAUSES and bool(CAUSES[row["cause"]].of)
        if row["finding"] not in by_number:
            in_part = is_of_part or concerns_some_results
            by_number[row["finding"]] = {**row, "evidence": [], "in_part": in_part}
        if row["evidence"] is not None:
            number = Beyond(row["evidence"], row["value"], row["limit"], row["side"])
            by_number[row["finding"]]["evidence"].append(number)
    return list(by_number.values())


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


EntriesByTable = Mapping[tuple[str, str], Sequence[Entry]]
"""Findings by table and grade; empty where there are none."""


def causes_in_campaign(
    findings: pl.DataFrame, tables: Mapping[str, pl.DataFrame], verdicts: pl.DataFrame
) -> list[Entry]:
    """Gather what a reader must know of a campaign.

    Parameters
    ----------
    findings : polars.DataFrame
        `findings.csv`.
    tables : Mapping of str to polars.DataFrame
        Result tables by name, which give the numbers of trials.
    verdicts : polars.DataFrame
        `quality.csv`.

    Returns
    -------
    list of Entry
        Each cause by experiment with its trials (`CauseInCampaign`). Doubts come first, then failed
        checks of trials that are used, then what could not be checked; in each, the most frequent
        cause first.
    """
    present = {*subjects(verdicts), *chain(*map(subjects, tables.values()))}
    by_table: dict[tuple[str, str], list[Entry]] = defaultdict(list)
    for entry in entries(findings):
        if not entry["inherited"] and entry["trial"] in present:
            by_table[entry["table"], entry["grade"]].append(entry)

    doubts: list[CauseInCampaign] = []
    unchecked: list[CauseInCampaign] = []
    for table in judged_tables_of(tables):
        doubts += doubts_about_table(table, by_table)
        unchecked += unchecked_in_table(table, by_table)
    doubts += misfits_of_prediction(by_table)
    predicted_trials = subjects(tables.get(PREDICTION_TABLE, pl.DataFrame()))
    not_predicted = by_table[PREDICTION_TABLE, Grade.UNCHECKED]
    unchecked += by_cause(not_predicted, "not checked", "prediction trials", predicted_trials)
    flags = list(flags_by_check(by_table[QUALITY, Grade.DOUBTS], verdicts))
    ordered = [
        *most_frequent_first(doubts),
        *most_frequent_first(flags),
        *most_frequent_first(unchecked),
    ]
    return [cause.to_entry() for cause in ordered]


def doubts_about_table(table: JudgedTable, by_table: EntriesByTable) -> Iterator[CauseInCampaign]:
    """The causes of doubt about the rows of a table, without those that it shares with the table of
    the fits to the same trials."""
    of_table = by_table[table.name, Grade.DOUBTS]
    if table.doubts_of:
        yield from doubts_beside_origin(table, of_table, by_table[table.doubts_of, Grade.DOUBTS])
    else:
        yield from doubts_by_cause(table, of_table)


def unchecked_in_table(table: JudgedTable, by_table: EntriesByTable) -> Iterator[CauseInCampaign]:
    """What could not be checked on the whole trials of a table, and what was noted of them."""
    for grade, verdict in ((Grade.UNCHECKED, "not checked"), (Grade.NOTES, "remark")):
        of_whole = [entry for entry in by_table[table.name, grade] if not entry["in_part"]]
        yield from by_cause(of_whole, verdict, table.subject_of_unchecked, table.trials)


def misfits_of_prediction(by_table: EntriesByTable) -> Iterator[CauseInCampaign]:
    """The causes for which the components do not predict the torque."""
    doubts = by_table[PREDICTION_TABLE, Grade.DOUBTS]
    trials = list(dict.fromkeys(entry["trial"] for entry in doubts))
    yield from by_cause(doubts, "doubtful", "predicted trials", trials)


def flags_by_check(
    failed_checks: Sequence[Entry], verdicts: pl.DataFrame
) -> Iterator[CauseInCampaign]:
    """The failed checks of trials that are used, in the order of the checks."""
    for check in CHECKS.values():
        failed = []
        for entry in failed_checks:
            if [number.column for number in entry["evidence"]] == [check.name]:
                failed.append(entry)
        checked_trials = subjects(verdicts.filter(pl.col("check") == check.name))
        yield from by_cause(failed, "flagged", "trials", checked_trials)


def most_frequent_first(causes: Sequence[CauseInCampaign]) -> list[CauseInCampaign]:
    """Causes by how many trials have them; in their order where these are as many."""
    return sorted(causes, key=lambda cause: -len(cause.trials))


def doubts_by_cause(table: JudgedTable, doubts: Sequence[Entry]) -> Iterator[CauseInCampaign]:
    """Doubts about the rows of a table: those about whole trials, then those about single
    amplitudes, or about single results, of trials that are sound as a whole."""
    whole = {(entry["trial"], entry["cause"]) for entry in doubts if not entry["in_part"]}
    of_whole: list[Entry] = []
    of_part: list[Entry] = []
    for entry in doubts:
        if (entry["trial"], entry["cause"]) in whole:
            of_whole.append(entry)
        else:
            of_part.append(entry)
    yield from by_cause(of_whole, "doubtful", table.subject, table.trials)
    subject = table.subject
    if all(entry["amplitude_deg"] is not None for entry in of_part):
        subject = f"{subject}, at single amplitudes alone"
    yield from by_cause(of_part, "doubtful in part", subject, table.trials)


def doubts_beside_origin(
    table: JudgedTable, doubts: Sequence[Entry], doubts_of_origin: Sequence[Entry]
) -> Iterator[CauseInCampaign]:
    """Doubts about the rows of a table of single results, such as frequencies, that the table of
    the fits to the same trials does not have."""
    in_origin = {(entry["trial"], entry["cause"]) for entry in doubts_of_origin}
    further = [entry for entry in doubts if (entry["trial"], entry["cause"]) not in in_origin]
    subject = f"{table.subject}, in {table.name.replace('_', ' ')} alone"
    yield from by_cause(further, "doubtful in part", subject, table.trials)


def subjects(rows: pl.DataFrame) -> list[str]:
    """The trials, or groups, of a table."""
    for key in ("trial", "group"):
        if key in rows.columns:
            return rows[key].unique(maintain_order=True).to_list()
    return []


def largest_excess(entry: Entry) -> float:
    """How far the evidence of a finding is beyond its limits, as a factor; 0 without evidence."""
    return max((number.excess for number in entry["evidence"]), default=0.0)


def by_cause(
    findings: Sequence[Entry], verdict: str, subject: str, judged_trials: Sequence[str]
) -> Iterator[CauseInCampaign]:
    """What a reader must know of each cause, or of each thing that could not be checked, with its
    size in the worst trial. The last row of a trial counts, which is its fit to all."""
    causes: dict[str, dict[str, Entry]] = {}
    for entry in findings:
        causes.setdefault(entry["cause"], {})[entry["trial"]] = entry
    for cause, by_trial in causes.items():
        worst = max(by_trial, key=lambda trial: largest_excess(by_trial[trial]))
        entry = by_trial[worst]
        size = entry["size"] or ""
        if size and len(by_trial) > 1:
            size = f"{size}, most in {worst}"
        says = entry["says"]
        if len({of_trial["says"] for of_trial in by_trial.values()}) > 1:
            says = f"{says} (in {worst})"
        words = Words(says or "", size, entry["remedy"] or "")
        limits: dict[str, str] = {}  # by column
        for of_trial in by_trial.values():
            for number in of_trial["evidence"]:
                limits[number.column] = f"{number.side} {number.limit:g}"
        trials = list(by_trial)
        counts = f"{len(trials)} of {len(judged_trials)} {subject}"
        trial_names = named_trials(trials, judged_trials)
        yield CauseInCampaign(
            verdict=verdict,
            of=subject,
            cause=cause,
            words=words,
            n=len(judged_trials),
            trials=trials,
            line=f"{verdict}, {counts}: {sentence_of(words, cause)}{trial_names}",
            measure=", ".join(limits),
            limit=", ".join(limits.values()),
            table=entry["table"],
            worst=worst,
            numbers={name: entry[name] for name in FINDING_NUMBERS if entry[name] is not None},
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


def exclusion_report(verdicts: pl.DataFrame, by_sheet: Mapping[str, str]) -> str:
    """Tell which trials are excluded, for the end of a run.

    Parameters
    ----------
    verdicts : polars.DataFrame
        `quality.csv`.
    by_sheet : Mapping of str to str
        The reasons of the trials that the sample sheet excludes.

    Returns
    -------
    str
        A line per trial of the sheet; trials that fail the same check share one.
    """
    lines = [f"excluded by the sample sheet: {trial} ({why})" for trial, why in by_sheet.items()]
    is_excluded = pl.col("verdict") == "exclude"
    failed = verdicts.filter(is_excluded).unique("trial", keep="first", maintain_order=True)
    reasons = exclusions(verdicts)
    for (check,), rows in failed.group_by("check", maintain_order=True):
        cause = CHECKS[str(check)].cause
        words = check_words(cause)
        trials = listing([f"{trial} ({reasons[trial]})" for trial in rows["trial"]], MOST_NAMED)
        lines.append(
            f"excluded from tables and figures by quality control: {trials}: {cause},"
            f" {words.says}; {words.remedy}"
        )
    if len(failed):
        lines.append(f"to change that: {HOW_TO_USE}")
    return "\n".join(lines)
