"""Refusals: tables of reasons in place of results that are missing because a recording was refused
or a job failed.

A refusal stands under the name of the result, in its format (CSV, Parquet, a ZIP of a CSV, JSON),
so that any program opens it. It has no row of the result, and a row for each cause. Jobs over
several trials go on without that result. Jobs that need it leave the same refusal. The run ends
with a list of them."""

import csv
import io
import json
import os
import re
import zipfile
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, fields
from pathlib import Path

from osl_analysis.errors import InputError, listing
from osl_analysis.files import atomic_path

MARK = "osl_analysis_refused"  # First column of a refusal. No result has a column of this name.
LARGEST = 1 << 20  # bytes; no refusal is larger, so that large results need not be looked into
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
    """Write a refusal with a row per cause, in the format that the suffix of `path` names."""
    causes = list(refusals)
    with atomic_path(path) as temporary:
        if path.suffix == ".parquet":
            import polars as pl  # takes 0.3 s, of commands that need no table

            rows = [(1, *astuple(cause)) for cause in causes]
            pl.DataFrame(rows, schema=COLUMNS, orient="row").write_parquet(temporary)
        elif path.suffix == ".zip":
            with zipfile.ZipFile(temporary, "w") as archive:
                archive.writestr(zipfile.ZipInfo(f"{MARK}.csv"), csv_text(causes))
        elif path.suffix == ".json":
            temporary.write_text(
                json.dumps({MARK: [asdict(cause) for cause in causes]}), encoding="utf-8"
            )
        else:
            temporary.write_text(csv_text(causes), encoding="utf-8")


def csv_text(causes: Sequence[Refusal]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(("1", *astuple(cause)) for cause in causes)
    return text.getvalue()


def is_refused(path: Path | str) -> bool:
    """Whether a file is a refusal. A file that is missing, unreadable or large is none."""
    try:
        with open(path, "rb") as file:
            begin = file.read(64)
            if begin.startswith((MARK.encode(), b'{"' + MARK.encode())):
                return os.fstat(file.fileno()).st_size < LARGEST
            if begin.startswith(b"PK"):
                return MARK.encode() in begin  # the name of the first file in the archive
            if begin.startswith(b"PAR1") and os.fstat(file.fileno()).st_size < LARGEST:
                return has_column_of_refusals(path, file.read())
    except OSError:
        pass
    return False


def has_column_of_refusals(path: Path | str, content: bytes) -> bool:
    """Whether a Parquet file with this content is a refusal."""
    if MARK.encode() not in content:
        return False
    import polars as pl

    return MARK in pl.read_parquet_schema(path)


def read_refusals(path: Path | str) -> tuple[Refusal, ...]:
    """The causes in a refusal; none if the file is a result, or is not there."""
    if not is_refused(path):
        return ()
    content = Path(path).read_bytes()
    if content.startswith(b"PAR1"):
        import polars as pl

        return tuple(Refusal(*row[1:]) for row in pl.read_parquet(path).rows())
    if content.startswith(b"{"):
        return tuple(Refusal(**cause) for cause in json.loads(content)[MARK])
    if content.startswith(b"PK"):
        with zipfile.ZipFile(path) as archive:
            content = archive.read(f"{MARK}.csv")
    rows = list(csv.reader(io.StringIO(content.decode("utf-8"), newline="")))
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
    files = [Path(record) for record in records]
    missing = {cause.trial for cause in causes if cause.trial}
    trials_without = sorted({file.stem for file in files} & set(recordings) - missing)
    results_without = names_of_results(file for file in files if file.stem not in recordings)
    lines = ["", first_line(causes, len(trials_without), len(recordings), len(files))]
    lines += cause_lines(causes, recordings)
    if trials_without:
        lines.append(f"  therefore without a result: {listing(trials_without, MOST_TOLD)}")
    if results_without:
        lines.append(f"  therefore not made: {listing(results_without, MOST_TOLD)}")
    lines += what_to_do(causes, accept)
    return "\n".join(lines)


def first_line(
    causes: Sequence[Refusal], trials_without: int, all_trials: int, results: int
) -> str:
    """How much is missing; `trials_without` are those whose result needs a refused one."""
    if all(cause.outcome == FAILED for cause in causes):
        return f"FAILED: {results} results that jobs should have made."
    refused = len(refused_trials(causes))
    first = f"{refused} of {all_trials} trials" if refused else "some results"
    if trials_without:
        first += f", and {trials_without} more that need them"
    if 0 < refused + trials_without < all_trials:
        first += "; results are of the others"
    return f"NOT ANALYSED: {first}."


def names_of_results(files: Iterable[Path]) -> list[str]:
    """Tables and figures as a user knows them; a figure of several formats counts once."""
    named = set()
    drawn = set()
    for file in files:
        if file.parent.name == "figures":
            drawn.add(f"figure {file.stem}")
        elif file.parent.name == "tables" or file.suffix in (".json", ".tex"):
            named.add(file.name)
    return sorted(named) + sorted(drawn)


def what_to_do(causes: Sequence[Refusal], accept: bool) -> list[str]:
    """The last lines of the report."""
    if accept:
        return ["accepted: `failed_trials: accept` in the configuration"]
    if all(cause.outcome == FAILED for cause in causes):
        return ["The next run tries again what failed."]
    return [
        "Correct these and run again. To change a source file for some of its trials, change a"
        " copy, and name that in the sample sheet. To go on without a trial, give a reason under"
        " `exclude`"
        " in the sample sheet; without all of these, write `failed_trials: accept` in the"
        " configuration."
    ]


@dataclass(frozen=True)
class CauseOfTrial:
    """A cause as a line of the report names it."""

    trial: str
    subject: str  # the trial and its file, or the result
    text: str  # reason and remedy


def cause_lines(
    causes: Iterable[Refusal], recordings: Mapping[str, Sequence[str]]
) -> Iterator[str]:
    """A line per cause, one for all trials that have it. The file named is a trial's recording,
    which the user can correct."""
    groups: dict[tuple[str, str], list[CauseOfTrial]] = {}
    for cause in sorted(causes, key=lambda cause: (not cause.trial, cause.trial)):
        file = file_at_fault(cause, recordings.get(cause.trial, ()))
        reason = cause.reason
        for begin in (f"{file}: ", f"trial {cause.trial}: ", f"{cause.trial}: "):
            reason = reason.removeprefix(begin)
        text = f"{reason}; remedy: {cause.remedy}"
        if not cause.trial:
            subject = f"result {file}"
            kind = (file, text)
        else:
            subject = f"trial {cause.trial}, file {file}"
            if cause.outcome == FAILED:
                text = f"{reason}; job {cause.job}; remedy: {cause.remedy}"
            kind = (cause.outcome, without_particulars(text.replace(file, "FILE"), cause.trial))
        groups.setdefault(kind, []).append(CauseOfTrial(cause.trial, subject, text))
    for first, *same in groups.values():
        also = ""
        if same:
            names = listing([each.trial for each in same], MOST_TOLD)
            also = f", and {len(same)} more trials with the same cause, {names}"
        yield f"  {first.subject}{also}: {first.text}"


def file_at_fault(cause: Refusal, recordings: Sequence[str]) -> str:
    """The recording that the reason names; else the file of the cause, if it is a recording or
    there is none."""
    named = next((file for file in recordings if file in cause.reason), None)
    if named is not None:
        return named
    if cause.file in recordings or not recordings:
        return cause.file
    return recordings[0]


def failed_results(records: Iterable[Path | str]) -> list[Path]:
    """The refusals of which a cause is a job that failed, and may not fail again."""
    return [
        Path(record)
        for record in records
        if any(cause.outcome == FAILED for cause in read_refusals(record))
    ]
