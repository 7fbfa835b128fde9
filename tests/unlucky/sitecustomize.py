"""Beside a file `unlucky` a worker cannot read one recording, and is killed by another one: tests
may run as root. Each kill takes a line of that file. Python imports this in every process of
`snakemake_runs.py`."""

import errno
import os
import signal
import sys
from pathlib import Path

UNLUCKY = Path("unlucky")


NOTED = Path("note_reads")


def note(file: str, mode: object) -> None:
    """Note the log of the job that reads a file of the results: a line of `note_reads`."""
    perform = sys.modules.get("osl_analysis.outcomes.perform")
    frame = sys._getframe()
    while frame is not None and (perform is None or frame.f_code is not perform.perform.__code__):
        frame = frame.f_back  # type: ignore[assignment]
    if frame is not None and file.startswith("results/") and mode in ("r", "rb", None):
        descriptor = os.open(NOTED, os.O_WRONLY | os.O_APPEND)
        os.write(descriptor, f"{frame.f_locals['job'].log}\t{file}\n".encode())
        os.close(descriptor)


def is_worker() -> bool:
    parent = getattr(sys.modules.get("multiprocessing.process"), "parent_process", None)
    return parent is not None and parent() is not None


def unlucky(event: str, arguments: tuple[object, ...]) -> None:
    name = os.path.basename(str(arguments[0])) if event == "open" else ""
    if event == "open" and NOTED.exists() and is_worker():
        note(str(arguments[0]), arguments[1])
    if name == "walking_04.c3d" and UNLUCKY.exists() and is_worker():
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(arguments[0]))
    if name == "walking_05.c3d" and UNLUCKY.exists() and is_worker():
        kills = UNLUCKY.read_text().splitlines()
        if kills:
            UNLUCKY.write_text("\n".join(kills[1:]))
            os.kill(os.getpid(), getattr(signal, kills[0]))


sys.addaudithook(unlucky)
