# SPDX-License-Identifier: Apache-2.0
"""A pool of processes that keep the package imported.

Snakemake runs each `run:` block in a thread (`force-use-threads` in the shipped profiles), which
sends one job to an idle process and waits. Importing takes about 1.4 s, a fit a fraction of it. A
killed process fails its own job only; the next job starts a new one. All end with Snakemake,
however that ends. A library's pool (`loky`) was tried: `docs/decisions.md` says what it did.

Example: `run_in_worker(Job(derive, [Path("a.csv")], Path("a.log"), {"table": Path("b.csv")}))`.
"""

import gc
import multiprocessing
import os
import signal
import sys
import threading
from collections import defaultdict
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any
from unittest.mock import patch

from osl_analysis.base.files import temporary_path
from osl_analysis.base.memory import SET_TO_ONE
from osl_analysis.jobs.job import Job
from osl_analysis.jobs.progress import write_log

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
            job = connection.recv()
            try:
                perform(job)
                connection.send(None)
            except Exception as error:
                connection.send(error)


def run_in_worker(job: Job) -> None:
    """Have a job done by an idle worker, or by a new one; of a worker that was killed, write the
    log.

    Raises
    ------
    RuntimeError
        There is no result, and the input is not at fault.
    """
    idle = IDLE[job.simulates]
    try:
        worker = idle.pop()
    except IndexError:  # not asked for before: another thread may take the last one meanwhile
        worker = Worker()
    try:
        worker.connection.send(job)
        failure = worker.connection.recv()
    except (EOFError, ConnectionError):
        for file in job.outputs:
            temporary_path(file, worker.process.pid).unlink(missing_ok=True)
        error = f"the process of this job was killed ({worker.end()})"
        write_log(
            job.log,
            {"job": job.name, "outcome": "killed", "error": error, "remedy": IF_KILLED},
        )
        raise RuntimeError(error) from None
    idle.append(worker)
    if failure:
        raise failure
