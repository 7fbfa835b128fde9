"""Refusal records: what stands in place of a result that a refused recording, or a failed job, did not give.

A record is a small CSV file under the name of the result. Jobs over several trials go on without it, and jobs that need
it leave the same record. The run ends with a list of them (`osl_analysis/refusal_report.py`).
"""

import csv
import os
from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path

MAGIC = "osl_analysis_refused"
"""First column of a record. No other file begins with it."""
VERSION = "1"
LARGEST = 1 << 20
"""Size [bytes] above which a file is not a record."""
TRIED_AGAIN = ("died", "failed")
"""Outcomes after which a job is tried again in the next run. `refused` stays until inputs or settings change."""


@dataclass(frozen=True)
class Refusal:
    """Why there is no result."""

    trial: str
    """The trial; empty for a result over several trials."""
    file: str
    """The file that is to blame."""
    job: str
    """The command that refused it, `module.function`."""
    outcome: str
    """As in `JobLog`: `refused`, `failed` or `died`."""
    reason: str
    """What was wrong, on one line."""
    remedy: str
    """What the user can do, on one line."""


COLUMNS = (MAGIC, *(field.name for field in fields(Refusal)))


def write_refusals(refusals: Iterable[Refusal], path: Path) -> None:
    """Write a record with a row per cause, completely or not at all."""
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows((VERSION, *astuple(refusal)) for refusal in refusals)


def is_refused(path: Path | str) -> bool:
    """Whether a file is a refusal record, by its first bytes. A file that is missing or unreadable is none."""
    try:
        with open(path, "rb") as file:
            return file.read(len(MAGIC)) == MAGIC.encode() and os.fstat(file.fileno()).st_size < LARGEST
    except OSError:
        return False


def read_refusals(path: Path | str) -> tuple[Refusal, ...]:
    """The causes in a record; none if the file is not a record."""
    if not is_refused(path):
        return ()
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return tuple(Refusal(*(row.get(column) or "" for column in COLUMNS[1:])) for row in rows)


def check_not_refused(path: Path) -> None:
    """Raise the reason, as an `InputError`, if a file is a refusal record."""
    for refusal in read_refusals(path):
        who = f"trial {refusal.trial}: " if refusal.trial else ""
        raise InputError(f"{path}: there is no result: {who}{refusal.reason}; {refusal.remedy}")


def distinct(refusals: Iterable[Refusal]) -> tuple[Refusal, ...]:
    """Every cause once, in the order given: jobs that refuse the same trial for the same reason count once."""
    found: dict[tuple[str, str], Refusal] = {}
    for refusal in refusals:
        found.setdefault((refusal.trial, refusal.reason), refusal)
    return tuple(found.values())


def refused_trials(refusals: Iterable[Refusal]) -> dict[str, Refusal]:
    """The first cause of each trial, by trial."""
    found: dict[str, Refusal] = {}
    for refusal in refusals:
        if refusal.trial:
            found.setdefault(refusal.trial, refusal)
    return found
