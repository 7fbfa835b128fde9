"""A run of the workflow: the server of its jobs at its begin, and what is said at its end."""

import atexit
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from osl_analysis.jobs import client
from osl_analysis.jobs.server import OF_DRAWINGS, OF_SIMULATOR

NO_JOBS = {"--lint", "--dag", "--rulegraph", "--filegraph", "--d3dag", "--summary", "--unlock", "--report", "--list"}
NO_JOBS |= {"-n", "--dry-run", "--dryrun", "--touch", "--delete-all-output", "--archive", "--print-compilation"}
"""Options of Snakemake with which it runs no job."""
STUDY = {"study", "validate"}
"""Targets that simulate in every campaign."""
TABLES = {".csv", ".parquet", ".zip"}
"""Suffixes of targets for which nothing is drawn."""
LONGEST_PLACE = 70
"""Largest length [bytes] of the folder for temporary files: a socket's path has 107."""
INTERRUPTED = "interrupted: what had begun was brought to its end; run again to go on from here"
STARTED = time.time()
"""Start of this run [s]. Its report covers the logs that were written after this time."""


def start_server(config: Mapping[str, Any]) -> None:
    """Name the server of this run's jobs, and start it while the workflow is still read: its imports take another core.

    Where Snakemake runs no job, it is only named. `config` are the fields that override the default. A run that a test
    starts uses the server of this test.
    """
    os.environ["OSL_PYTHON"], os.environ["OSL_CLIENT"] = sys.executable, client.__file__
    if os.environ.get(client.OWNER) == str(os.getppid()):
        return
    places = [place for place in (tempfile.gettempdir(), "/tmp", "/var/tmp", "/dev/shm") if os.access(place, os.W_OK)]
    short = [place for place in places if len(os.fsencode(place)) <= LONGEST_PLACE]
    os.environ[client.JOBS] = f"{short[0]}/osl-jobs-{os.getuid()}-{os.getpid()}/jobs" if short else ""
    os.environ[client.OWNER] = str(os.getpid())
    os.environ[client.SPARED] = " ".join(rarely_used(config, sys.argv))
    if short and NO_JOBS.isdisjoint(sys.argv):
        with suppress(OSError):
            if client.is_ours(os.environ[client.JOBS]):
                client.start(os.environ[client.JOBS])


def rarely_used(config: Mapping[str, Any], arguments: Sequence[str]) -> list[str]:
    """Modules that no job, or hardly one, uses in a run; each job that does so imports them itself.

    The default simulates. Whose `arguments` ask Snakemake for a table has none drawn.
    """
    simulates = config.get("simulation", True) is not None or not STUDY.isdisjoint(arguments)
    draws = not any(Path(one).suffix in TABLES and "=" not in one for one in arguments)
    unused = [(simulates, OF_SIMULATOR), (draws, OF_DRAWINGS)]
    return [name for used, names in unused if not used for name in names]


def noticed_interrupt() -> threading.Event:
    """What is set when the user ends the run by Ctrl-C. Snakemake goes on to handle it as it does."""
    pressed = threading.Event()
    handle = signal.getsignal(signal.SIGINT)
    if not callable(handle) or threading.current_thread() is not threading.main_thread():
        return pressed
    go_on: Callable[[int, Any], Any] = handle

    def interrupt(number: int, frame: Any) -> Any:
        pressed.set()
        return go_on(number, frame)

    signal.signal(signal.SIGINT, interrupt)
    return pressed


def at_end_of_run(
    workflow: Any,
    logs: Path,
    said: Callable[[Sequence[str]], str],
    expected: Callable[[Iterable[Any]], str],
    accept: bool,
) -> None:
    """Let a run of Snakemake end with our report, and with exit code 1 if something that was asked for is refused.

    `said` writes the report, from the names of the refusal records among the files that the run was to bring up to
    date. `accept`: refusals do not count. A dry run ends with what `expected` says of the jobs that it would run.

    Snakemake's own `onsuccess` and `onerror` are not called where nothing is left to do, as in the run after a refusal.
    """
    interrupted = noticed_interrupt()

    def end() -> None:
        if workflow.scheduler is None or not workflow.is_main_process:  # an unknown target, another run's lock
            return
        if workflow.dryrun:
            text = expected(workflow.dag.needrun_jobs(exclude_finished=False))
            print(text, file=sys.stderr, end="\n" * bool(text), flush=True)
            return
        from osl_analysis.job_log import read_logs, run_report
        from osl_analysis.refusal import records_in, unfinished

        files = [str(file) for job in workflow.dag.jobs for file in job.output]
        records = records_in(files)
        times = run_report(read_logs(logs, STARTED))
        texts = [INTERRUPTED] if interrupted.is_set() else [times, unfinished(files), said(records)]
        print("\n".join(filter(None, texts)), file=sys.stderr, flush=True)
        if records and not accept:
            sys.stdout.flush()
            os._exit(1)  # at the exit of Python there is no other way

    atexit.register(end)
