"""What a user must know at the end of a run."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from osl_analysis.commands.tables import read_summary
from osl_analysis.errors import listing, without_particulars
from osl_analysis.files import write_text
from osl_analysis.judge.campaign import exclusion_report
from osl_analysis.report.verdicts import brief_lines
from osl_analysis.table import read_table

MOST_TOLD = 12
"""Trials that are named in a line."""
REMEDY = (
    "Correct these and run again. To change a source file for some of its trials, change a copy,"
    " and name that in the sample sheet. To go on without a trial, give a reason under `exclude`"
    " in the sample sheet; without all of these, write `failed_trials: accept` in the"
    " configuration."
)


def write_brief(
    summary: Path,
    excluded: Path,
    verdicts: Path,
    page: Path,
    by_sheet: Mapping[str, str],
    recordings: Mapping[str, Sequence[str]],
    left_out: str,
    failed_trials: str,
    output: Path,
) -> None:
    """Write what a user must know at the end of a run.

    Parameters
    ----------
    summary, excluded, verdicts, page
        `summary.json`, `excluded.csv`, `quality.csv` and the page.
    by_sheet
        Trials that the sheet excludes, and why.
    recordings
        The raw files of every trial of the campaign.
    left_out
        On recordings that are not analysed.
    failed_trials
        `refuse` or `accept` trials that could not be analysed.
    output
    """
    content = read_summary(summary)
    refused = read_table(excluded).filter(check="refused")
    reasons = dict(refused.select("trial", "remark").iter_rows())
    failures = failure_lines(reasons, content["missing_results"], recordings)
    lines = [
        *brief_lines(content),
        exclusion_report(read_table(verdicts), by_sheet),
        left_out,
        *failures,
    ]
    if failures:
        is_accepted = failed_trials == "accept"
        accepted = "accepted: `failed_trials: accept` in the configuration"
        lines.append(accepted if is_accepted else REMEDY)
    lines.append(f"open {page} in a browser: every number, figure and trial")
    write_text(output, "\n".join(filter(None, lines)) + "\n")


def failure_lines(
    reasons: Mapping[str, str],
    missing_results: Mapping[str, Any],
    recordings: Mapping[str, Sequence[str]],
) -> list[str]:
    """What has no result: a line per cause, one for all trials that have it. The file named is a
    trial's recording, which the user can correct."""
    by_cause: dict[str, dict[str, str]] = {}
    for trial, reason in sorted(reasons.items()):
        files = recordings.get(trial) or ["none"]
        file = next((file for file in files if file in reason), files[0])
        text = reason.removeprefix(f"{file}: ")
        cause = without_particulars(text.replace(file, "FILE"), trial)
        by_cause.setdefault(cause, {})[trial] = f"  trial {trial}, file {file}: {text}"
    lines = []
    if reasons or missing_results:
        lines.append(f"\nNOT ANALYSED: {len(reasons)} of {len(recordings)} trials.")
    for of_cause in by_cause.values():
        first, *others = of_cause
        also = f" (also trials {listing(others, MOST_TOLD)})" if others else ""
        lines.append(of_cause[first] + also)
    lines += [f"  result {file}: {reason}" for file, reason in missing_results.items()]
    return lines
