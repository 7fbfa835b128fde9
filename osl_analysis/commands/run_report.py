"""What a user must know at the end of a run."""

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from osl_analysis.campaign.campaign_trials import Campaign
from osl_analysis.campaign.result_files import ResultFiles
from osl_analysis.errors import listing
from osl_analysis.judge.campaign import exclusion_report
from osl_analysis.judge.exclusions import Judge
from osl_analysis.refusal import distinct_causes, read_refusals, refusal_report
from osl_analysis.report.brief import brief_lines

MOST_TOLD = 12
"""Trials that are named in a line of the report."""


@dataclass(frozen=True)
class RunReport:
    """The report of a run of a campaign."""

    campaign: Campaign
    judge: Judge
    unnamed: str  # on recordings that no row of the sheet names

    def text(self, files: Sequence[str], refused: Sequence[str]) -> str:
        """The report, from all `files` of the run, and those of them that are `refused`."""
        campaign = self.campaign
        results = campaign.config.results
        trials = campaign.trials()
        checks = ResultFiles(campaign).checks(trials)
        verdicts = self.judge.verdicts(Path(file) for file in checks)
        stored = (results / "trials").glob("*.parquet")
        recordings = {trial: [str(log) for log in campaign.logs(trial)] for trial in trials}
        sources = {trial: campaign.sources(trial) for trial in trials}
        is_accepted = campaign.config.failed_trials == "accept"
        lines = [
            exclusion_report(verdicts, campaign.excluded),
            self.unnamed,
            left_behind_report(stored, [*trials, *campaign.excluded]),
            refusal_report(refused, recordings, is_accepted),
            shared_source_report(sources, trials_by_remedy(refused, "source file")),
            shared_log_report(recordings, trials_by_remedy(refused, "the log is this capture's")),
        ]
        summary = results / "summary.json"
        was_made = str(summary) in files and summary.exists()  # not where the run was ended before
        if was_made and str(summary) not in refused:
            lines = [*brief_lines(json.loads(summary.read_text())), *lines]
        return "\n".join(line for line in lines if line)


def trials_by_remedy(refused: Iterable[str], words: str) -> list[str]:
    """The refused trials whose remedy has these words."""
    causes = distinct_causes(refusal for file in refused for refusal in read_refusals(file))
    return sorted({cause.trial for cause in causes if cause.trial and words in cause.remedy})


def shared_log_report(recordings: Mapping[str, Sequence[str]], to_check: Sequence[str]) -> str:
    """Lines on recordings of the trials `to_check` that other trials have, too; empty if there are
    none. `recordings` are the files of each trial."""
    lines = []
    for trial in to_check:
        for file in recordings.get(trial, ()):
            others = [other for other, files in recordings.items() if file in files]
            others.remove(trial)
            if others:
                lines.append(
                    f"{file} of {trial} is also that of {listing(others, MOST_TOLD)}: see whose"
                    " it is"
                )
    return "\n".join(lines)


def shared_source_report(sources: Mapping[str, Sequence[Path]], to_mend: Sequence[str]) -> str:
    """Lines on source files that other trials have, too, which the change for a refused trial would
    refuse; empty if there are none.

    Parameters
    ----------
    sources
        The source files of each trial.
    to_mend
        Trials whose remedy is a change of their source file.
    """
    lines = []
    for source in dict.fromkeys(file for files in sources.values() for file in files):
        trials = [trial for trial, files in sources.items() if source in files]
        of_source = [trial for trial in trials if trial in to_mend]
        others = [trial for trial in trials if trial not in to_mend]
        if of_source and others:
            lines.append(
                f"{source.name} is the source file of {listing(others, MOST_TOLD)}, too. To change"
                f" it for {listing(of_source, MOST_TOLD)} alone, change a copy, and name the copy"
                " in the sample sheet."
            )
    return "\n".join(lines)


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
