"""The findings on all trials of a campaign: `findings.csv`."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.config.experiments import doubts_of, judged_tables
from osl_analysis.errors import listing
from osl_analysis.judge.exclusions import HOW_TO_USE, exclusions
from osl_analysis.judge.finding import AnyRow, Beyond, Finding, Grade, WordedFinding, Words
from osl_analysis.judge.judging import judged, with_inherited
from osl_analysis.judge.known_findings import CHECKS, FINDINGS, known_finding
from osl_analysis.judge.limits import DoubtfulFits
from osl_analysis.judge.unchecked import unchecked_in
from osl_analysis.judge.words import component_changes_text, words_of
from osl_analysis.measured import SHORT, significant, unusual

# percent of the torque that a prediction may leave along angle, velocity and acceleration
LARGEST_MISFIT = 1.0
MOST_NAMED = 3  # number of trials that a line names
QUALITY = "quality"
PREDICTION_TABLE = "prediction"
JUDGED_FURTHER = (PREDICTION_TABLE, "prediction_causes")
"""Tables without limits that have findings."""


def campaign_findings(
    tables: Mapping[str, pl.DataFrame], verdicts: pl.DataFrame, limits: DoubtfulFits
) -> list[WordedFinding]:
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
    list of WordedFinding
        Findings that rows inherit from another table are listed once per trial and amplitude,
        without words: the original finding has these.

    Raises
    ------
    InputError
        A limit stands on a column that its table does not have.
    """
    worded = list(failed_checks(verdicts))
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
                key = finding.table, finding.subject, finding.amplitude_deg, finding.name
                if not finding.inherited:
                    worded.append(WordedFinding(finding, words_of(finding, row)))
                elif key not in listed:
                    listed.add(key)
                    worded.append(WordedFinding(finding, Words("", "", "")))
    for row in tables.get(PREDICTION_TABLE, pl.DataFrame()).iter_rows(named=True):
        for finding in unchecked_in(PREDICTION_TABLE, row):
            worded.append(WordedFinding(finding, words_of(finding, row)))
    worded.extend(causes_of_misfit(tables))
    worded.extend(recordings_of_another_length(fits.get("impedance", pl.DataFrame())))
    return worded


def failed_checks(verdicts: pl.DataFrame) -> Iterator[WordedFinding]:
    """The failed checks of recordings, whether or not they exclude the trial."""
    grades = {"flag": Grade.DOUBTS, "exclude": Grade.EXCLUDES}
    for row in verdicts.filter(pl.col("verdict").is_in(list(grades))).to_dicts():
        check = CHECKS[row["check"]]
        evidence = Beyond(check.name, row["value"], row.get("threshold") or 0.0, check.fails)
        grade = grades[row["verdict"]]
        size = f"{significant(row['value'], 3)} {row['unit']}"
        if row["remark"]:
            size = f"{size} ({row['remark']})"
        finding = Finding(check.finding, QUALITY, row["trial"], grade, (evidence,))
        yield WordedFinding(finding, words_of(finding, row)._replace(size=size))


def causes_of_misfit(tables: Mapping[str, pl.DataFrame]) -> Iterator[WordedFinding]:
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
                yield replace(misfit, finding=replace(misfit.finding, subject=trial))


def misfits_of_joint(rows: pl.DataFrame, predicted: pl.DataFrame) -> list[WordedFinding]:
    """The causes of one joint and side, from its rows of `prediction_causes.csv` and its predicted
    trials, yet without a trial."""
    is_delay = pl.col("component").str.ends_with("_delay")
    components = rows.filter("named", ~is_delay).to_dicts()
    delays = rows.filter(is_delay).to_dicts()  # named or not
    misfits: list[WordedFinding] = []
    if components:
        names = " or ".join(row["component"] for row in components)
        evidence = changes_beyond_zero(components)
        numbers = {"component_changes": component_changes_text(components)}
        misfits.append(misfit_of_joint("component_changed", evidence, numbers, names))
    if any(row["named"] for row in delays):
        angle_ms, velocity_ms = (1e3 * row["change"] for row in delays)
        numbers_of_delays = {"angle_ms": angle_ms, "velocity_ms": velocity_ms}
        evidence = changes_beyond_zero(delays)
        misfits.append(misfit_of_joint("late_controller", evidence, numbers_of_delays))
    unexplained_percent = max((row["left"] or 0.0 for row in delays), default=0.0)  # of the torque
    if not misfits and unexplained_percent > LARGEST_MISFIT:
        excess_percent = {
            "K_percent": measured_over_predicted(predicted, "K"),
            "B_percent": measured_over_predicted(predicted, "B"),
        }
        beyond = Beyond("left", unexplained_percent, LARGEST_MISFIT, "above")
        misfits.append(misfit_of_joint("components_misfit", (beyond,), excess_percent))
    return misfits


def misfit_of_joint(
    name: str, evidence: tuple[Beyond, ...], numbers: AnyRow, about: str = ""
) -> WordedFinding:
    """A cause, yet without a trial, for which components do not predict the torque; `numbers` fill
    its sentence, and `about` its title."""
    title = known_finding(name).title.format(about=about)
    finding = Finding(name, PREDICTION_TABLE, subject="", evidence=evidence, title=title)
    return WordedFinding(finding, words_of(finding, numbers))


def changes_beyond_zero(rows: Sequence[Mapping[str, Any]]) -> tuple[Beyond, ...]:
    """The changes of components, or of delays, that would explain the torque, as evidence."""
    return tuple(Beyond(row["component"], row["change"], 0.0, "above") for row in rows)


def measured_over_predicted(predicted: pl.DataFrame, symbol: str) -> float:
    """By how many percent K or B is measured above its prediction, the median of trials."""
    ratio = (predicted[f"{symbol}_measured"] / predicted[symbol]).to_numpy()
    return 100 * float(np.median(ratio)) - 100


def recordings_of_another_length(impedance: pl.DataFrame) -> Iterator[WordedFinding]:
    """Trials shorter or longer than most with their kind of motion: half of a file looks whole, and
    a wrongly stated rate changes the length."""
    if not {"recorded_s", "excitation"} <= set(impedance.columns):
        return
    whole = impedance.filter(pl.col("amplitude_deg").is_null(), pl.col("recorded_s") > 0)
    for rows in whole.partition_by("excitation"):
        is_unusual, usual_s = unusual(rows["recorded_s"].to_numpy())
        for row in rows.filter(is_unusual).select("trial", "recorded_s").to_dicts():
            if row["recorded_s"] < usual_s:
                evidence = Beyond("recorded_s", row["recorded_s"], SHORT * usual_s, "below")
            else:
                evidence = Beyond("recorded_s", row["recorded_s"], usual_s / SHORT, "above")
            finding = Finding(
                "recording_length", "impedance", row["trial"], Grade.NOTES, (evidence,)
            )
            yield WordedFinding(finding, words_of(finding, {**row, "usual_s": usual_s}))


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
        kind = FINDINGS[CHECKS[str(check)].finding]
        trials = listing([f"{trial} ({reasons[trial]})" for trial in rows["trial"]], MOST_NAMED)
        lines.append(
            f"excluded from tables and figures by quality control: {trials}:"
            f" {kind.title}, {kind.says}; {kind.remedy}"
        )
    if len(failed):
        lines.append(f"to change that: {HOW_TO_USE}")
    return "\n".join(lines)
