"""A run of the workflow: the server of its jobs at its begin, each job, and what is said at the end.

A thread of Snakemake hands a job to the warm server of the run (`server.py`), and waits. Where there is no server, the
job runs in a Python of its own, which takes 0.8 s of imports more. If Snakemake is killed, the server kills its jobs.
"""

import atexit
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from osl_analysis.errors import OslAnalysisError
from osl_analysis.jobs import server

NO_JOBS = {"--lint", "--dag", "--rulegraph", "--filegraph", "--d3dag", "--summary", "--unlock", "--report", "--list"}
NO_JOBS |= {"-n", "--dry-run", "--dryrun", "--touch", "--delete-all-output", "--archive", "--print-compilation"}
"""Options of Snakemake with which it runs no job."""
STARTED = time.time()  # Start of this run [s]. Its report covers the logs that were written after this time.


class JobError(OslAnalysisError):
    """A job could write neither a result nor a record of why there is none."""


def start_server() -> None:
    """Start the server of this run's jobs while the workflow is still read: its imports take another core.

    Where Snakemake runs no job, there is none. A run that a test starts uses the server of this test.
    """
    if os.environ.get(server.OWNER) == str(os.getppid()):
        return
    os.environ |= {server.OWNER: str(os.getpid()), server.JOBS: ""}
    places = [place for place in (tempfile.gettempdir(), "/tmp", "/var/tmp", "/dev/shm") if os.access(place, os.W_OK)]
    short = [place for place in places if len(os.fsencode(place)) <= 70]  # bytes: a socket's path has 107
    if short and NO_JOBS.isdisjoint(sys.argv):
        with suppress(OSError):
            os.environ[server.JOBS] = f"{tempfile.mkdtemp(prefix='osl-jobs-', dir=short[0])}/jobs"
            start(os.environ[server.JOBS])


def run_job(request: str) -> None:
    """Have the job of a request done. A killed one leaves records, as one does that refuses its input.

    Raises JobError where there is neither a result nor a record, as on a full disk; the job itself has said why.
    """
    code, number, pid = served(request)
    if code is None:
        job = apart("--job", request, str(pid))  # the process `pid` died over it
        code, pid = job.wait(), job.pid
        number = max(-code, 0)
    if number:
        from osl_analysis.jobs.job import died

        died(request, pid, number)
    elif code:
        raise JobError(f"{request}: this job could write no result; see above, and run again")


def served(request: str) -> tuple[int | None, int, int]:
    """Exit code of the job in the server, the signal that killed it (0: none) and its process; no code without one."""
    pid = 0
    try:
        with socket.socket(socket.AF_UNIX) as link:
            link.connect(os.environ[server.JOBS])
            body = "\0".join([os.getcwd(), request]).encode()
            socket.send_fds(link, [len(body).to_bytes(4, "big")], [0, 1, 2])
            link.sendall(body)
            pid = int.from_bytes(link.recv(4), "big")
            said = link.recv(2)
        return (said[0], said[1], pid) if len(said) == 2 else (None, 0, pid)
    except (OSError, AttributeError, KeyError):  # there is no server, or a system without such sockets
        return None, 0, pid


def start(path: str) -> None:
    """Start the server, in a folder that belongs to this user alone. It listens when this returns, and does its imports
    while jobs wait."""
    with open(f"{path}.log", "ab") as log:  # who reads the run's lines to their end shall not wait for the server
        apart("--serve", path, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=log).wait()


def apart(*arguments: str, **files: Any) -> subprocess.Popen[bytes]:
    """Start `server.py` in a session of its own: Ctrl-C in a terminal is for Snakemake, which lets begun jobs end."""
    return subprocess.Popen([sys.executable, server.__file__, *arguments], start_new_session=True, **files)


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
        from osl_analysis.jobs.job_log import read_logs, run_report
        from osl_analysis.jobs.refusal import is_refused, unfinished

        files = [str(file) for job in workflow.dag.jobs for file in job.output]
        records = [file for file in files if is_refused(file)]
        texts = [run_report(read_logs(logs, STARTED)), unfinished(files), said(records)]
        if interrupted.is_set():
            texts = ["interrupted: what had begun was brought to its end; run again to go on from here"]
        print("\n".join(filter(None, texts)), file=sys.stderr, flush=True)
        if records and not accept:
            sys.stdout.flush()
            os._exit(1)  # at the exit of Python there is no other way

    atexit.register(end)
