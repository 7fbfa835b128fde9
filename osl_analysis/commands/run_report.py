"""What a user must know at the end of a run."""

import json
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

from osl_analysis.campaign.campaign_trials import Campaign
from osl_analysis.campaign.result_files import ResultFiles
from osl_analysis.errors import listing
from osl_analysis.judge.campaign import exclusion_report
from osl_analysis.judge.exclusions import Judge
from osl_analysis.refusal import refusal_report
from osl_analysis.report.brief import brief_lines

MOST_TOLD = 12
"""Trials that are named in a line of the report."""


def report_of_run(
    campaign: Campaign, judge: Judge, unnamed: str, files: Sequence[str], refused: Sequence[str]
) -> str:
    """The report of a run of a campaign.

    Parameters
    ----------
    campaign
    judge
    unnamed
        On recordings that no row of the sheet names.
    files
        All files of the run.
    refused
        Those of them that are refused.
    """
    results = campaign.config.results
    trials = campaign.trials()
    checks = ResultFiles(campaign).checks(trials)
    verdicts = judge.verdicts(Path(file) for file in checks)
    stored = (results / "trials").glob("*.parquet")
    recordings = {trial: [str(log) for log in campaign.logs(trial)] for trial in trials}
    is_accepted = campaign.config.failed_trials == "accept"
    lines = [
        exclusion_report(verdicts, campaign.excluded),
        unnamed,
        left_behind_report(stored, [*trials, *campaign.excluded]),
        refusal_report(refused, recordings, is_accepted),
    ]
    summary = results / "summary.json"
    name = summary.as_posix()
    was_made = name in files and summary.exists()  # not where the run was ended before
    if was_made and name not in refused:
        content = json.loads(summary.read_text(encoding="utf-8"))
        lines = [*brief_lines(content), *lines]
    return "\n".join(line for line in lines if line)


def left_behind_report(stored: Iterable[Path], trials: Collection[str]) -> str:
    """A line on trials with `stored` files that are not in the sheet, as after a renaming; empty if
    there are none."""
    unknown = sorted({path.stem for path in stored} - set(trials))
    if not unknown:
        return ""
    return (
        f"not in the sample sheet, and in no table or figure: {listing(unknown, MOST_TOLD)};"
        " files of theirs are left below the results; delete them, or enter the trials again"
    )
