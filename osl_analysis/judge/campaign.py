"""The findings on all trials of a campaign: `findings.csv`."""

from collections.abc import Iterator, Mapping

import polars as pl

from osl_analysis.config.experiments import judged_tables
from osl_analysis.errors import listing
from osl_analysis.judge.finding import Beyond, Finding, Grade, WordedFinding
from osl_analysis.judge.judging import judged
from osl_analysis.judge.known_findings import CHECKS, FINDINGS
from osl_analysis.judge.limits import DoubtfulFits
from osl_analysis.judge.recording_checks import HOW_TO_USE, exclusions, spoiled_trials
from osl_analysis.judge.words import words_of
from osl_analysis.measured import significant

MOST_NAMED = 3  # number of trials that a line names
QUALITY = "quality"


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
        Without those that rows share with another table of the same trials, which has them.

    Raises
    ------
    InputError
        A limit stands on a column that its table does not have.
    """
    worded = list(failed_checks(verdicts))
    faults = spoiled_trials(verdicts)
    fits = {name: table for name, table in tables.items() if name in judged_tables()}
    for name, table in fits.items():
        by_row = judged(table, limits.of(name), name, faults)
        for row, of_row in zip(table.iter_rows(named=True), by_row, strict=True):
            worded.extend(WordedFinding(finding, words_of(finding, row)) for finding in of_row)
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
