# SPDX-License-Identifier: Apache-2.0
"""What befalls the workers of a campaign in the tests, by two places in its folder.

`unlucky/`: a file `NAME.refused` in it refuses the recording NAME to each worker, since tests may
run as root; a file `NAME.SIGKILL` kills the first worker that opens it, and so do other signals.
`note_reads`: each file of the results that a job opens becomes a line of it, with the job's log.

Python imports this module in every process of `snakemake_runs.py`.
"""

import errno
import glob
import os
import signal
import sys
from pathlib import Path

UNLUCKY = Path("unlucky")
NOTED = Path("note_reads")


def on_event(event: str, arguments: tuple[object, ...]) -> None:
    """Be the hook that Python calls at each event of `sys.audit`."""
    if event != "open" or not is_worker():
        return
    file = str(arguments[0])
    mode = arguments[1]
    if file.startswith("results/") and mode in ("r", "rb", None) and NOTED.exists():
        note_read(file)
    if UNLUCKY.is_dir():
        meet_fate(file)


def is_worker() -> bool:
    parent = getattr(sys.modules.get("multiprocessing.process"), "parent_process", None)
    return parent is not None and parent() is not None


def note_read(file: str) -> None:
    """Note that the job of this process reads a file, if it is in one."""
    perform = sys.modules.get("osl_analysis.jobs.perform")
    frame = sys._getframe()
    while frame is not None and (perform is None or frame.f_code is not perform.perform.__code__):
        frame = frame.f_back  # type: ignore[assignment]
    if frame is None:
        return
    descriptor = os.open(NOTED, os.O_WRONLY | os.O_APPEND)
    os.write(descriptor, f"{frame.f_locals['job'].log}\t{file}\n".encode())
    os.close(descriptor)


def meet_fate(file: str) -> None:
    """Refuse a recording that `unlucky` names, or kill this process."""
    for fate in UNLUCKY.glob(f"{glob.escape(os.path.basename(file))}.*"):
        if fate.suffix == ".refused":
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), file)
        fate.unlink()
        os.kill(os.getpid(), getattr(signal, fate.suffix[1:]))


sys.addaudithook(on_event)
