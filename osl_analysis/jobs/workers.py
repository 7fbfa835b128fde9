# SPDX-License-Identifier: Apache-2.0
"""Warm workers: processes that have imported what jobs need, and do one job after another.

A `run:` block of a rule calls `do_job`, as `job`, in a thread of Snakemake, which waits until a
worker has done it. To import anew for each job would take 1.4 s. A worker ends with Snakemake,
however that ends.
"""

import gc
import multiprocessing
import os
import signal
import sys
import threading
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any
from unittest.mock import patch

from osl_analysis.base.files import temporary_path
from osl_analysis.base.memory import SET_TO_ONE
from osl_analysis.jobs.progress import Files, Job, write_log

# of workers alone: Snakemake may have jobs of other workflows
ENVIRONMENT = dict.fromkeys((*SET_TO_ONE, "POLARS_MAX_THREADS", "NUMBA_NUM_THREADS"), "1") | {
    # glibc keeps this many bytes of freed memory for the next arrays: new pages cost time, because
    # the system clears them
    "MALLOC_MMAP_THRESHOLD_": "33554432",
    "MALLOC_TRIM_THRESHOLD_": "268435456",
    # Polars has an allocator of its own, which keeps freed memory for so long
    "_RJEM_MALLOC_CONF": "dirty_decay_ms:10000,muzzy_decay_ms:10000",
}
PRELOADED = [
    "osl_analysis.jobs.perform",
    "scipy.signal",
    "osl_analysis.commands.trials",
    "osl_analysis.commands.fit",
    "osl_analysis.commands.tables",
    "osl_analysis.commands.figure",
    "osl_analysis.figures.style",  # with matplotlib, which each worker would import that draws
    "matplotlib.backends.backend_pdf",
    "matplotlib.backends.backend_svg",
]
"""What workers share: the process from which they are forked imports it once."""
IF_KILLED = (
    "run again; if memory was short, with fewer jobs at once (`--cores 1`); if a library crashes on"
    " the recording each time, give a reason under `exclude` in the sample sheet"
)
ASKING = threading.Lock()
"""Held by the one thread that may ask how processes ended. Each tells it only once, and to start
another process asks it of all."""


class Worker:
    """A process that does one job after another."""

    def __init__(self) -> None:
        # Windows has no fork, and libraries of macOS crash in forked processes
        can_fork = hasattr(os, "fork") and sys.platform != "darwin"
        context: Any = multiprocessing.get_context("forkserver" if can_fork else "spawn")
        context.set_forkserver_preload(PRELOADED)
        self.connection, far_end = context.Pipe()
        self.process = context.Process(target=serve, args=(far_end,), daemon=True)
        with ASKING, patch.dict(os.environ, ENVIRONMENT):
            self.process.start()
        far_end.close()  # so that the end of the process ends the connection

    def end(self) -> str:
        """End the process when it has done its job; the name of the signal, if one has killed
        it."""
        self.connection.close()
        with ASKING:
            self.process.join()
            exit_code = self.process.exitcode
        return signal.Signals(-exit_code).name if exit_code < 0 else "from outside"


IDLE: defaultdict[bool, list[Worker]] = defaultdict(list)
"""Workers without a job, by whether they simulate: one that does has imported 200 MB that all
others do without. Threads of Snakemake take one, and put it back."""


def serve(connection: Connection) -> None:
    """Do jobs in a worker until the connection ends, as Snakemake does. Ctrl-C is for Snakemake,
    which lets begun jobs end."""
    from osl_analysis.jobs.perform import perform

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.freeze()  # to look for garbage in all that is imported takes a twentieth of a fit
    with suppress(EOFError, ConnectionError):  # Snakemake has ended
        while True:
            given = connection.recv()
            try:
                perform(given)
                connection.send(None)
            except Exception as error:
                connection.send(error)


def do_job(
    command: Callable[..., Any],
    input: Any,
    output: Any,
    params: Any,
    log: Any,
    tell: str = "",
    at_once: int = 1,
) -> None:
    """Have a job of a rule done by a worker.

    Parameters
    ----------
    command
        A function of a module: workers are told its name.
    input, output, params, log
        As Snakemake has them in a `run:` block. Inputs, outputs and params are the arguments of the
        function by their names.
    tell
        The name of an argument that gets the causes of what was not analysed of the inputs:
        `refused` of a function that is called whatever is missing, `not_analysed` of another one.
    at_once
        How many jobs share the memory of the machine.

    Raises
    ------
    RuntimeError
        There is no result, and the input is not at fault.
    """
    do_in_worker(
        Job(
            command,
            plain_files(input),
            plain_files(output),
            dict(params.items()),
            files=[*map(Path, output)],
            log=Path(log[0]),
            tell=tell,
            at_once=at_once,
        )
    )


def do_in_worker(given: Job) -> None:
    """Do a job in a worker; of one that was killed, this writes the log."""
    idle = IDLE[given.simulates]
    try:
        worker = idle.pop()
    except IndexError:  # not asked for before: another thread may take the last one meanwhile
        worker = Worker()
    try:
        worker.connection.send(given)
        failure = worker.connection.recv()
    except (EOFError, ConnectionError):
        for file in given.files:
            temporary_path(file, worker.process.pid).unlink(missing_ok=True)
        error = f"the process of this job was killed ({worker.end()})"
        write_log(
            given.log,
            {"job": given.name, "outcome": "killed", "error": error, "remedy": IF_KILLED},
        )
        raise RuntimeError(error) from None
    idle.append(worker)
    if failure:
        raise failure


def plain_files(files: Any) -> dict[str, Files]:
    """Files by name, as a worker can be sent them."""
    return {
        name: str(file) if isinstance(file, str) else list(map(str, file))
        for name, file in files.items()
    }
