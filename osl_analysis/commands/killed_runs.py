"""Notes of the runs that are at work in a folder, by which the next one knows those that were
killed, and removes what they have left."""

import atexit
import json
import platform
import re
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from os import getpid
from pathlib import Path

import psutil

NOTES = Path(".snakemake/osl_at_work")
"""A file for each run that is at work in this folder. One whose process has ended was killed."""
LOCKS = Path(".snakemake/locks")
SAME_START_S = 1.0
"""A process that began within this time of the noted one is the same: numbers are used again."""


@dataclass(frozen=True)
class Run:
    """A run of the workflow, as its note has it."""

    host: str
    pid: int
    began: float  # when its process began [s since 1970]
    temporary: str  # its temporary folder

    @property
    def is_at_work(self) -> bool:
        """Whether its process is alive."""
        try:
            began: float = psutil.Process(self.pid).create_time()
        except psutil.NoSuchProcess:
            return False
        except psutil.AccessDenied:  # on Windows and macOS, to a process of another user
            return True
        return abs(began - self.began) < SAME_START_S


def begin_run(temporary: Path, written: Sequence[Path]) -> None:
    """Note that a run is at work here, and remove what killed ones on this machine have left.

    Parameters
    ----------
    temporary
        The temporary folder of this run.
    written
        Folders into which jobs write.
    """
    killed = killed_runs()
    for note, run in killed.items():
        shutil.rmtree(run.temporary, ignore_errors=True)
        note.unlink(missing_ok=True)
    if killed:
        remove_half_written(written)
    run = Run(platform.node(), getpid(), psutil.Process().create_time(), str(temporary))
    NOTES.mkdir(parents=True, exist_ok=True)
    note = NOTES / f"{run.host}_{run.pid}.json"
    note.write_text(json.dumps(asdict(run)), encoding="utf-8")
    atexit.register(note.unlink, missing_ok=True)


def killed_runs() -> dict[Path, Run]:
    """The runs in this folder that were killed on this machine, by their notes."""
    killed = {}
    for note in NOTES.glob("*.json"):
        run = Run(**json.loads(note.read_text(encoding="utf-8")))
        if run.host == platform.node() and not run.is_at_work:
            killed[note] = run
    return killed


def remove_half_written(folders: Iterable[Path]) -> None:
    """Remove the temporary files (`files.temporary_path`) of processes that have ended, such as
    `.belt_01.4711.csv` of process 4711."""
    for folder in folders:
        for path in folder.rglob(".*"):
            name = re.fullmatch(r"\..+\.(\d+)(\.\w+)?", path.name)
            if name and not psutil.pid_exists(int(name[1])) and path.is_file():
                path.unlink(missing_ok=True)


def take_over_lock() -> bool:
    """Remove Snakemake's lock of this folder if all runs that may hold it were killed on this
    machine; whether it was removed."""
    locks = list(LOCKS.glob("*.lock"))
    killed = killed_runs()
    if not locks or not killed or killed.keys() < {*NOTES.glob("*.json")}:
        return False
    for lock in locks:
        lock.unlink(missing_ok=True)
    return True
