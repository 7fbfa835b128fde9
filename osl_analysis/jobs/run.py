"""A run of the workflow: the server of its jobs, each job, and the report at the end.

The server starts as soon as it is known that a job will run. It imports once and forks processes
for the jobs, which saves 0.8 s of start per job. A thread of Snakemake hands it a request and waits
for the end of the job. The server ends with Snakemake, however that ends. On Linux its jobs end
too; elsewhere they go on."""

import atexit
import ctypes
import fcntl
import gc
import importlib
import json
import os
import platform
import re
import select
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import gettempdir, mkdtemp
from typing import IO, Any, NoReturn

from osl_analysis.errors import OslAnalysisError, listing
from osl_analysis.files import PACKAGE
from osl_analysis.jobs.memory import SET_TO_ONE

# Start of this run [s]. Its report covers the logs that were written after this time.
STARTED = time.time()
# bytes
KEPT_BY_PROCESS = {"MALLOC_MMAP_THRESHOLD_": "33554432", "MALLOC_TRIM_THRESHOLD_": "268435456"}
"""glibc keeps this much freed memory for the next arrays: new pages cost time, because the system
clears them."""
PRELOADED = frozenset(("trials", "bench", "tables"))
"""Modules of commands that are imported while Snakemake plans. A process that lacks one is
replaced, in 0.1 s."""
# begin of commands that use numba, which takes 100 MB
COMPILING = ("simulate.", "bench.gather_predictions")
MOST_JOBS = 400  # jobs per process, because libraries keep memory until it ends
PLANNED = "osl_analysis_planned_"  # begin of the name of a dry run's folder of requests
MOST_SERVERS = 3  # servers that may be killed under a job before the job counts as killed
STARTING = threading.Lock()


@cache
def job_server() -> tuple[socket.socket, subprocess.Popen[bytes]]:
    """Start the server of this run and the socket for its jobs; the server ends when the socket is
    closed. It has its own session: Ctrl-C in a terminal only reaches Snakemake, which lets begun
    jobs end."""
    ours, theirs = socket.socketpair()
    code = (
        f"import sys; sys.path.insert(0, {str(PACKAGE.parent)!r}); from osl_analysis.jobs.run"
        " import serve"
    )
    server = subprocess.Popen(
        [sys.executable, "-P", "-c", f"{code}; serve({theirs.fileno()})"],
        pass_fds=[theirs.fileno()],
        env=os.environ
        | dict.fromkeys((*SET_TO_ONE, "POLARS_MAX_THREADS", "NUMBA_NUM_THREADS"), "1")
        | KEPT_BY_PROCESS,
        start_new_session=True,
        stdin=subprocess.DEVNULL,
    )
    theirs.close()
    return ours, server


def run_job(request: str) -> None:
    """Have the job of a request done. A killed job leaves records, like one that refuses its input.
    A job that a killed server had not begun is done by a new server. Raises if there is neither a
    result nor a record, as on a full disk; the job itself has said why."""
    said = b""
    for _ in range(MOST_SERVERS):
        link, server = running_server()
        if said := answer_to(link, request):
            break
        with suppress(subprocess.TimeoutExpired):
            server.wait(10)
    end_timers()
    pid, _, ended = said.decode().partition(" ")
    code = int(ended or -signal.SIGKILL)  # a killed server sends no exit code: its jobs die with it
    if code < 0:
        from osl_analysis.jobs.job import died

        died(Path(request), int(pid or 0), -code)
    elif code:
        raise OslAnalysisError(
            f"{request}: this job could write no result; see above, and run again"
        )


def running_server() -> tuple[socket.socket, subprocess.Popen[bytes]]:
    """The server of this run; a new one if it has ended."""
    with STARTING:
        if job_server()[1].poll() is not None:
            job_server.cache_clear()
        return job_server()


def answer_to(server: socket.socket, request: str) -> bytes:
    """The server's answer about a job: `pid exit_code`; only `pid` if it was killed meanwhile; or
    nothing."""
    ours, theirs = socket.socketpair()
    with ours, suppress(OSError):
        with theirs:
            socket.send_fds(server, [b"+"], [theirs.fileno(), 1, 2])
        ours.sendall(f"{os.getcwd()}\0{request}".encode())
        ours.shutdown(socket.SHUT_WR)
        with ours.makefile("rb") as answer:
            return answer.read()
    return b""


@dataclass
class Worker:
    """A process that does one job after another."""

    pid: int
    compiles: bool  # whether its jobs are of `COMPILING`: it does only these, or none of these
    known: frozenset[str]  # modules of commands that it has imported; empty if it is to end
    link: socket.socket | None = None  # socket of the thread that waits for the end of its job


def serve(number: int) -> NoReturn:
    """Take jobs from the socket with this number until its other end is closed. Forked processes do
    the jobs, one after another. The process and the job's exit code are sent to the job's own
    socket."""
    control, workers, known = socket.socket(fileno=number), dict[socket.socket, Worker](), PRELOADED
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()
    preload(
        "osl_analysis.jobs.job",
        "scipy.signal",
        *(f"osl_analysis.commands.{module}" for module in sorted(known)),
    )
    while True:
        ready, _, _ = select.select([control, *workers], [], [])
        for channel in {*ready} - {control}:
            job_ended(workers, channel)
        if control not in ready:
            continue
        head, files, _, _ = socket.recv_fds(control, 1, 3)
        if not head:
            os._exit(0)
        link = socket.socket(fileno=files.pop(0))
        with link.makefile("rb") as asked_for:
            job = asked_for.read()
        if (module := (command := command_of(job)).partition(".")[0]) not in known:
            preload(f"osl_analysis.commands.{module}")
            known |= {module}
        if (able := idle_worker(workers, command)) is None:
            able, theirs = socket.socketpair()
            if not (pid := fork()):
                for other in (
                    control,
                    able,
                    link,
                    *workers,
                    *(one.link for one in workers.values() if one.link),
                ):
                    other.close()  # the listener waits until no process holds it
                for file in files:
                    os.close(file)
                work(theirs)
            theirs.close()
            workers[able] = Worker(pid, command.startswith(COMPILING), known)
        worker = workers[able]
        worker.link = link
        with suppress(OSError):  # the end of a killed worker is handled below
            link.sendall(f"{worker.pid} ".encode())
            socket.send_fds(able, [job], files)
        for file in files:
            os.close(file)


def idle_worker(workers: dict[socket.socket, Worker], command: str) -> socket.socket | None:
    """The channel of a waiting worker for a command. If none fits, those that wait are ended."""
    compiles, module = command.startswith(COMPILING), command.partition(".")[0]
    idle = [
        one for one, worker in workers.items() if not worker.link and worker.compiles == compiles
    ]
    for one in idle:
        if compiles or module in workers[one].known:
            return one
    for one in idle:
        workers[one].known = frozenset()
        with suppress(OSError):  # it has ended
            one.shutdown(socket.SHUT_WR)
    return None


def preload(*modules: str) -> None:
    """Import modules, and call their `preload`. No garbage collection of a job looks (and writes)
    there."""
    for name in modules:
        with suppress(ImportError):  # a job that needs it will say so
            getattr(importlib.import_module(name), "preload", int)()
    gc.freeze()


def command_of(job: bytes) -> str:
    """The command of a job, of which folder and request are told; empty if that cannot be read."""
    with suppress(OSError, ValueError, KeyError):
        return str(
            json.loads(Path(*job.decode().split("\0")).read_text(encoding="utf-8"))["command"]
        )
    return ""


def job_ended(workers: dict[socket.socket, Worker], channel: socket.socket) -> None:
    """Tell who waits for it how the job of a channel's worker ended; also that of one that was
    killed."""
    worker, said = workers[channel], b""
    with suppress(ConnectionResetError):  # it was killed before it took the job
        said = channel.recv(1)
    if not said:
        del workers[channel]
        channel.close()
    code = said[0] if said else os.waitstatus_to_exitcode(os.waitpid(worker.pid, 0)[1])
    if worker.link:
        with worker.link, suppress(OSError):  # nobody may listen any more
            worker.link.sendall(str(code).encode())
        worker.link = None


def work(channel: socket.socket) -> NoReturn:
    """Do `MOST_JOBS`, as they arrive at a socket, in this process, which ends then, and say there
    how each ended."""
    gc.enable()
    code = 0
    with suppress(OSError):  # of a server that was killed
        for left in reversed(range(MOST_JOBS)):
            job, files, _, _ = socket.recv_fds(channel, 1 << 16, 2)
            if not job:
                break
            for wanted, file in enumerate(files, start=1):
                os.dup2(file, wanted)
                os.close(file)
            code = do(*job.decode().split("\0"))
            gc.collect()
            gc.freeze()  # what this job has imported stays: looking through numba takes 25 ms
            if left:
                channel.sendall(bytes([code]))
    os._exit(code)


def fork() -> int:
    """As `os.fork`. The kernel kills the new process when this one ends (Linux)."""
    parent, pid = os.getpid(), os.fork()
    if not pid:
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
        if os.getppid() != parent:
            os._exit(1)
    return pid


def do(folder: str, request: str) -> int:
    """Do the job of a request in this process. The exit code is 1 where nothing can be written, as
    on a full disk."""
    try:
        os.chdir(folder)
        from osl_analysis.jobs.job import perform
        from osl_analysis.jobs.request import read_request

        perform(read_request(Path(request)))
        return 0
    except (OslAnalysisError, OSError) as error:
        print(f"error: {Path(request).parent.name}: {error}", file=sys.stderr)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
    return 1


RUNS = Path(".snakemake/osl_runs")
"""A line of JSON for each run since one was alone in this folder: host, process, temporary folder.
Every run holds a shared lock of this file, which ends with its process, however that ends."""


def runs_before(file: IO[str]) -> list[dict[str, Any]] | None:
    """The runs that ended before this one, if none is at work; the file is then locked. None if one
    is."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return None
    file.seek(0)
    with suppress(ValueError):
        return [json.loads(line) for line in file]
    return []


@cache
def begin(temporary: Path) -> tuple[IO[str], bool]:
    """Begin a run with this temporary folder, and say that it is at work, as long as the file is
    open. Remove the temporary folders of killed ones. The second is whether all runs before were on
    this machine, and have ended."""
    RUNS.parent.mkdir(exist_ok=True)
    file = RUNS.open("a+", encoding="utf-8")
    if (before := runs_before(file)) is not None:
        planned = Path(gettempdir()).glob(f"{PLANNED}*_*")
        left = [
            one
            for one in planned
            if not is_alive(int(one.name.removeprefix(PLANNED).partition("_")[0]))
        ]
        for folder in (
            *left,
            *(Path(one["temporary"]) for one in before if one["host"] == platform.node()),
        ):
            shutil.rmtree(folder, ignore_errors=True)
        file.truncate(0)
    fcntl.flock(file, fcntl.LOCK_SH)
    known = {"host": platform.node(), "pid": os.getpid(), "temporary": str(temporary)}
    print(json.dumps(known), file=file, flush=True)
    return file, {one["host"] for one in before or ()} == {platform.node()}


def remove_half_written(folders: Sequence[Path]) -> None:
    """Remove the files that processes which were killed on this machine wrote in some folders."""
    for path in (one for folder in folders for one in folder.rglob(".*")):
        name = re.fullmatch(r"\..+\.(\d+)(\.\w+)?", path.name)
        if name and not is_alive(int(name[1])) and path.is_file():
            path.unlink(missing_ok=True)


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except OSError as error:
        return isinstance(error, PermissionError)  # another user's
    return True


def locked_by_killed_run() -> bool:
    """Whether Snakemake's lock of this folder is that of killed runs on this machine; it is then
    removed."""
    locks = [*Path(".snakemake/locks").glob("*.lock")]
    if not locks or not RUNS.is_file():
        return False
    with RUNS.open("a+", encoding="utf-8") as file:
        before = runs_before(file)
        if not before or any(one["host"] != platform.node() for one in before):
            return False
        for lock in locks:
            lock.unlink()
    return True


def planned_folder() -> Path:
    """A temporary folder for the requests of jobs that are planned alone, until the end of this
    process."""
    folder = Path(mkdtemp(prefix=f"{PLANNED}{os.getpid()}_"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def at_end_of_run(
    workflow: Any, logs: Path, said: Callable[[Sequence[str]], str], accept: bool
) -> None:
    """Let a run of Snakemake end with our report, and with exit code 1 if something that was asked
    for is refused, unless refusals are to `accept`. `said` writes the report, from the refusal
    records of the run; a dry run ends with what is `expected` of its jobs. Snakemake's `onsuccess`
    and `onerror` are not called where nothing is left to do."""

    def end() -> None:
        if workflow.dryrun or workflow.scheduler is None or not workflow.is_main_process:
            return  # without a scheduler the target is unknown, or another run has the lock
        from osl_analysis.jobs.job_log import run_report
        from osl_analysis.refusal import MOST_TOLD, is_refused

        files = [str(file) for job in workflow.dag.jobs for file in job.output]
        records = [file for file in files if is_refused(file)]
        # as of a job that was killed with Snakemake
        lost = [file for file in files if not Path(file).exists()]
        not_made = (
            f"not made: {listing(lost, MOST_TOLD)}; run again, what is finished stays"
            if lost
            else ""
        )
        try:
            told = filter(None, [run_report(logs, STARTED), not_made, said(records)])
            print("\n".join(told), file=sys.stderr, flush=True)
            failed = bool(records) and not accept
        except Exception:  # by a fault of ours the run must not end as if all were well
            traceback.print_exc()
            failed = True
        if failed:
            shutil.rmtree(workflow.snakemake_tmp_dir, ignore_errors=True)
            sys.stdout.flush()
            os._exit(1)  # at the exit of Python there is no other way

    atexit.register(end)
    # a closed terminal leaves no lock, as after SIGTERM
    if signal.getsignal(signal.SIGHUP) == signal.SIG_DFL:
        signal.signal(signal.SIGHUP, lambda *_: signal.raise_signal(signal.SIGTERM))


def end_timers() -> None:
    """End the timers by which Snakemake would look for further jobs (`max-jobs-per-timespan` of the
    profile). It looks at the end of every job anyway, each look would start a timer more, and a
    process waits for them at its end."""
    for timer in (one for one in threading.enumerate() if isinstance(one, threading.Timer)):
        timer.cancel()
