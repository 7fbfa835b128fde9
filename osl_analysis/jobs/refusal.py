"""Refusal records: what stands in place of a result that a refused recording, or a failed job, did not give.

A record is a small CSV file under the name of the result. Jobs over several trials go on without it, and jobs that need
it leave the same record. The run ends with a list of them.
"""

import csv
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from osl_analysis.errors import InputError, listing
from osl_analysis.files import atomic_path

RECORD_MARK = "osl_analysis_refused"  # First column of a record. No other file begins with it.
TRIED_AGAIN = ("died", "failed")
"""Outcomes after which a job is tried again in the next run. `refused` stays until inputs or settings change."""


@dataclass(frozen=True)
class Refusal:
    """Why there is no result."""

    trial: str  # empty for a result over several trials
    file: str  # the file that is to blame
    job: str  # the command that refused it, `module.function`
    outcome: str  # as in `JobLog`: `refused`, `failed` or `died`
    reason: str  # what was wrong, on one line
    remedy: str  # what the user can do, on one line


RECORD_COLUMNS = (RECORD_MARK, *(field.name for field in fields(Refusal)))


def write_refusals(refusals: Iterable[Refusal], path: Path) -> None:
    """Write a record with a row per cause, completely or not at all."""
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(RECORD_COLUMNS)
        writer.writerows(("1", *astuple(refusal)) for refusal in refusals)


def is_refused(path: Path | str) -> bool:
    """Whether a file is a refusal record, by its first bytes. One above 1 MB, missing or unreadable is none."""
    try:
        with open(path, "rb") as file:
            return file.read(len(RECORD_MARK)) == RECORD_MARK.encode() and os.fstat(file.fileno()).st_size < 1 << 20
    except OSError:
        return False


def read_refusals(path: Path | str) -> tuple[Refusal, ...]:
    """The causes in a record; none if the file is not a record."""
    if not is_refused(path):
        return ()
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return tuple(Refusal(*(row.get(column) or "" for column in RECORD_COLUMNS[1:])) for row in rows)


def check_not_refused(path: Path) -> None:
    """Raise the reason, as an `InputError`, if a file is a refusal record."""
    for refusal in read_refusals(path):
        who = f"trial {refusal.trial}: " if refusal.trial else ""
        raise InputError(f"{path}: there is no result: {who}{refusal.reason}; {refusal.remedy}")


def distinct_causes(refusals: Iterable[Refusal]) -> tuple[Refusal, ...]:
    """Every cause once, in the order given: jobs that refuse the same trial for the same reason count once."""
    found: dict[tuple[str, str], Refusal] = {}
    for refusal in refusals:
        found.setdefault((refusal.trial, refusal.reason), refusal)
    return tuple(found.values())


def refused_trials(refusals: Sequence[Refusal]) -> dict[str, Refusal]:
    """The first cause of each trial, by trial."""
    causes = {one.trial: one for one in reversed(refusals)}
    return {one.trial: causes[one.trial] for one in refusals if one.trial}


MOST_TOLD = 12  # trials, or results, that are named in one line


def unfinished(files: Iterable[str]) -> str:
    """A line on results of a run that are not there, as of a job that was killed from outside; empty without."""
    missing = [file for file in files if not Path(file).exists()]
    return f"not made: {listing(missing, MOST_TOLD)}; run again, what is finished stays" if missing else ""


def refusals_in(files: Iterable[Path | str], more: Iterable[Refusal] = ()) -> tuple[Refusal, ...]:
    """The causes in the records among these files and `more`, each once: trials in order of name, then others."""
    found = distinct_causes([*(refusal for file in files for refusal in read_refusals(file)), *more])
    return tuple(sorted(found, key=lambda refusal: (not refusal.trial, refusal.trial)))


def refusal_report(
    refusals: Sequence[Refusal],
    recordings: Mapping[str, Sequence[str]],
    accept: bool,
    records: Collection[Path | str] = (),
) -> str:
    """A line per cause with trial, file, reason and remedy, what else has no result, and what to do; empty without
    refusals.

    `recordings` has the raw files of every trial of the campaign, `records` are the files with these refusals.
    """
    if not refusals:
        return ""
    missing = {refusal.trial for refusal in refusals if refusal.trial}
    stems = {Path(record).stem for record in records}
    files = [Path(record) for record in records if Path(record).stem not in recordings]
    named = {f.name for f in files if f.parent.name == "tables" or f.suffix in (".json", ".tex")}
    drawn = {f"figure {f.stem}" for f in files if f.parent.name == "figures"}  # in several formats, named once
    trials, results = sorted(stems & set(recordings) - missing), sorted(named) + sorted(drawn)
    first = f"{len(missing)} of {len(recordings)} trials" if missing else "some results"
    more = f", and for want of them {len(trials)} of {len(recordings)} trials" if trials and not missing else ""
    more = f", and for want of them {len(trials)} more" if trials and missing else more
    rest = "; results are of the others" if missing or trials else ""
    lines = [line(refusal, recordings.get(refusal.trial, ())) for refusal in refusals]
    lines += [f"  therefore without a result: {listing(trials, MOST_TOLD)}"] if trials else []
    lines += [f"  therefore not made: {listing(results, MOST_TOLD)}"] if results else []
    ways_out = (
        "Correct these and run again. To go on without a trial, give a reason under `exclude` in the sample sheet; "
        "without all of these, write `failed_trials: accept` in the configuration."
    )
    end = "accepted: `failed_trials: accept` in the configuration" if accept else ways_out
    return "\n".join(["", f"NOT ANALYSED: {first}{more}{rest}.", *lines, end])


def line(refusal: Refusal, recordings: Sequence[str]) -> str:
    """One cause. The file is the trial's recording if there is one: it is what the user can correct."""
    file = next((name for name in recordings if name in refusal.reason), "") or (
        refusal.file if refusal.file in recordings or not recordings else recordings[0]
    )
    reason = refusal.reason.removeprefix(f"{file}: ").removeprefix(f"trial {refusal.trial}: ")
    reason = reason.removeprefix(f"{refusal.trial}: ")
    who = f"trial {refusal.trial}, file {file}" if refusal.trial else f"result {file}"
    return f"  {who}: {reason}; remedy: {refusal.remedy}"
