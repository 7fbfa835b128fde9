"""Refusals: tables of reasons in place of results that are missing because a recording was refused
or a job failed.

A refusal stands under the name of the result, and is a CSV table whatever that name ends with. It
has a row for each cause. Jobs over several trials go on without that result. Jobs that need it
leave the same refusal. The run ends with a list of them."""

import csv
import io
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from osl_analysis.errors import InputError, listing
from osl_analysis.files import write_text

MARK = "osl_analysis_refused"  # First column of a refusal. No result has a column of this name.
FAILED = "failed"  # outcome of a job that an unexpected error or the system ended
MOST_TOLD = 12  # largest number of trials or results named in one line


@dataclass(frozen=True)
class Refusal:
    """Why there is no result."""

    trial: str  # empty for a result over several trials
    file: str  # the file at fault
    job: str  # the command that refused it, `module.function`
    outcome: str  # as in a job's log: `refused` or `failed`
    reason: str  # what was wrong, on one line
    remedy: str  # what the user can do, on one line


COLUMNS = (MARK, *(field.name for field in fields(Refusal)))


def write_refusals(refusals: Iterable[Refusal], path: Path) -> None:
    """Write a refusal with a row per cause."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(("1", *astuple(cause)) for cause in refusals)
    write_text(path, text.getvalue())


def is_refused(path: Path | str) -> bool:
    """Whether a file is a refusal. A file that is missing or unreadable is none."""
    try:
        with open(path, "rb") as file:
            return file.read(len(MARK)) == MARK.encode()
    except OSError:
        return False


def read_refusals(path: Path | str) -> tuple[Refusal, ...]:
    """The causes in a refusal; none if the file is a result, or is not there."""
    if not is_refused(path):
        return ()
    with open(path, encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    return tuple(Refusal(*row[1:]) for row in rows[1:])


def check_not_refused(path: Path) -> None:
    """If a file is a refusal, raise its reason as an InputError."""
    for refusal in read_refusals(path):
        of_trial = f"trial {refusal.trial}: " if refusal.trial else ""
        raise InputError(
            f"{path}: there is no result: {of_trial}{refusal.reason}; {refusal.remedy}"
        )


def distinct_causes(refusals: Iterable[Refusal]) -> tuple[Refusal, ...]:
    """Every cause once, in the order given: jobs that refuse the same trial for the same reason
    count once."""
    causes: dict[tuple[str, str], Refusal] = {}
    for refusal in refusals:
        causes.setdefault((refusal.trial, refusal.reason), refusal)
    return tuple(causes.values())


def without_particulars(text: str, trial: str) -> str:
    """A message without numbers and the trial's name: equal for all trials with this cause."""
    if trial:
        name = rf"(^|[/'(]|trial ){re.escape(trial)}(?![A-Za-z0-9_])"
        text = re.sub(name, r"\1TRIAL", text)
    return re.sub(r"[-+]?\d[\d.,]*(e[-+]?\d+)?", "#", text)


def refused_trials(refusals: Sequence[Refusal]) -> dict[str, Refusal]:
    """The first cause of each trial, by trial."""
    return {refusal.trial: refusal for refusal in reversed(refusals) if refusal.trial}


def refusal_report(
    records: Collection[Path | str], recordings: Mapping[str, Sequence[str]], accept: bool
) -> str:
    """Report what has no result: a line per cause, what is missing because of it, what to do.

    Parameters
    ----------
    records
        Files that are refusals.
    recordings
        The raw files of every trial of the campaign.
    accept
        Whether a run with refusals ends as one without.

    Returns
    -------
    str
        Empty without refusals.
    """
    causes = distinct_causes(refusal for record in records for refusal in read_refusals(record))
    if not causes:
        return ""
    trials = {cause.trial for cause in causes if cause.trial}
    lines = ["", f"NOT ANALYSED: {len(trials)} of {len(recordings)} trials."]
    remedy = (
        "Correct these and run again. To change a source file for some of its trials, change a"
        " copy, and name that in the sample sheet. To go on without a trial, give a reason under"
        " `exclude` in the sample sheet; without all of these, write `failed_trials: accept` in"
        " the configuration."
    )
    if all(cause.outcome == FAILED for cause in causes):
        lines = ["", f"FAILED: {len(records)} results that jobs should have made."]
        remedy = "The next run tries again what failed."
    lines += cause_lines(causes, recordings)
    further = sorted({Path(record).stem for record in records} - trials)
    if further:
        lines.append(f"  therefore not made: {listing(further, MOST_TOLD)}")
    if accept:
        remedy = "accepted: `failed_trials: accept` in the configuration"
    return "\n".join([*lines, remedy])


def cause_lines(
    causes: Iterable[Refusal], recordings: Mapping[str, Sequence[str]]
) -> Iterator[str]:
    """A line per cause, one for all trials that have it. The file named is a trial's recording,
    which the user can correct."""
    line_of_trial_by_cause: dict[str, dict[str, str]] = {}
    for cause in sorted(causes, key=lambda cause: (not cause.trial, cause.trial)):
        files = recordings.get(cause.trial) or [cause.file]
        file = cause.file if cause.file in files else files[0]
        text = f"{cause.reason.removeprefix(f'{file}: ')}; remedy: {cause.remedy}"
        if cause.outcome == FAILED:
            text = f"job {cause.job}: {text}"
        subject = f"trial {cause.trial}, file {file}" if cause.trial else f"result {file}"
        same = without_particulars(text.replace(file, "FILE"), cause.trial)
        lines = line_of_trial_by_cause.setdefault(same, {})
        lines[cause.trial] = f"  {subject}: {text}"
    for lines in line_of_trial_by_cause.values():
        first, *others = lines
        also = f" (also trials {listing(others, MOST_TOLD)})" if others else ""
        yield lines[first] + also


def failed_results(records: Iterable[Path | str]) -> list[Path]:
    """The refusals of which a cause is a job that failed, and may not fail again."""
    return [
        Path(record)
        for record in records
        if any(cause.outcome == FAILED for cause in read_refusals(record))
    ]
