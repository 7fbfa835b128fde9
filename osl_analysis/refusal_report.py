"""What a user reads of refused trials at the end of a run, and which outputs of a run are refusal records."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from osl_analysis.refusal import Refusal, distinct, read_refusals

ACCEPTED = "accepted: `failed_trials: accept` in the configuration"
WAYS_OUT = (
    "Correct these and run again. To go on without a trial, give a reason under `exclude` in the sample sheet; without "
    "all of these, write `failed_trials: accept` in the configuration."
)


def refusals_in(files: Iterable[Path | str]) -> tuple[Refusal, ...]:
    """The causes in the records among these files, each once: trials in order of name, then other results."""
    found = distinct(refusal for file in files for refusal in read_refusals(file))
    return tuple(sorted(found, key=lambda refusal: (not refusal.trial, refusal.trial)))


def refusal_report(refusals: Sequence[Refusal], recordings: Mapping[str, Sequence[str]], accept: bool) -> str:
    """A line per cause with trial, file, reason and remedy, and what to do; empty without refusals.

    `recordings` has the raw files of every trial of the campaign.
    """
    if not refusals:
        return ""
    missing = {refusal.trial for refusal in refusals if refusal.trial}
    trials = f"{len(missing)} of {len(recordings)} trials; results are of the others"
    first = f"NOT ANALYSED: {trials if missing else 'some results'}."
    lines = [line(refusal, recordings.get(refusal.trial, ())) for refusal in refusals]
    return "\n".join(["", first, *lines, ACCEPTED if accept else WAYS_OUT])


def line(refusal: Refusal, recordings: Sequence[str]) -> str:
    """One cause. The file is the trial's recording if there is one: it is what the user can correct."""
    file = next((name for name in recordings if name in refusal.reason), "") or (
        refusal.file if refusal.file in recordings or not recordings else recordings[0]
    )
    reason = refusal.reason.removeprefix(f"{file}: ").removeprefix(f"trial {refusal.trial}: ")
    reason = reason.removeprefix(f"{refusal.trial}: ")
    who = f"trial {refusal.trial}, file {file}" if refusal.trial else f"result {file}"
    return f"  {who}: {reason}; remedy: {refusal.remedy}"
