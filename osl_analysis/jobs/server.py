"""The warm server of a run: it imports once, forks once per job, and ends with the run. It has no threads.

A job begins with its work 0.8 s earlier than in a Python of its own, and is still a process of its own.
`server.py --serve SOCKET` serves, `--job REQUEST PID` runs one job; PID is a process that died over it, whose temporary
files are deleted.
"""

import ctypes
import gc
import importlib
import os
import selectors
import signal
import socket
import sys
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

if __name__ == "__main__":  # started by its path
    sys.path[0] = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

JOBS, OWNER = "OSL_JOBS", "OSL_JOBS_OWNER"
"""Variables of the environment: the server's socket, and the process that it ends with."""
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS", "NUMBA_NUM_THREADS")
"""Snakemake counts one core per job."""
OF_MOST_JOBS = (
    "osl_analysis.jobs.job",
    "scipy.signal",  # our modules name these at their use: the workflow is read without them
    "scipy.interpolate",
    "scipy.ndimage",
    "scipy.linalg",
    "scipy.fft",
    "osl_analysis.commands.trials",
    "osl_analysis.commands.bench",
    "osl_analysis.commands.tables",
)
"""Imported while no job waits, as when Snakemake plans."""
USED_WITH = {
    "simulate": [f"osl_analysis.simulator.{name}" for name in ("bench", "crossing", "preloaded")],
    "figure": [
        "osl_analysis.figures.names",
        "fontTools.subset",
        *(f"matplotlib.backends.backend_{name}" for name in ("pdf", "svg", "agg")),
    ],
}
"""By module of a command: what its functions import when they are called."""


def prepare(folder: str, request: str) -> None:
    """Import and parse what a job uses, which takes up to a second: the jobs that are forked later share it."""
    from osl_analysis.config.yaml_settings import read_mapping
    from osl_analysis.jobs.request import read_request

    with suppress(Exception):  # the job will say so
        job = read_request(Path(folder, request))
        command = job.command.partition(".")[0]
        for name in (f"osl_analysis.commands.{command}", *USED_WITH.get(command, ())):
            importlib.import_module(name)
        for file in job.request["made_of"]:
            if file.endswith(".yaml"):
                read_mapping(Path(folder, file))


def dies_with(parent: int) -> None:
    """Let the kernel kill this process when its parent ends (Linux; elsewhere its job comes to its end)."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
        if os.getppid() != parent:
            os._exit(1)


def receive(link: socket.socket) -> tuple[list[str], list[int]]:
    """Folder and request of a job, and its three standard files."""
    head, files, _, _ = socket.recv_fds(link, 4, 3)
    size, body = int.from_bytes(head, "big"), b""
    while len(body) < size:
        part = link.recv(size - len(body))
        if not part:
            raise OSError("the client is gone")
        body += part
    return body.decode().split("\0"), files


def forked(server: int, words: list[str], files: list[int]) -> NoReturn:
    """The forked process: in a group of its own, with the client's standard files and folder."""
    gc.enable()
    dies_with(server)
    os.setpgid(0, 0)
    for number in (signal.SIGTERM, signal.SIGCHLD):
        signal.signal(number, signal.SIG_DFL)
    signal.set_wakeup_fd(-1)
    for wanted, file in enumerate(files):
        os.dup2(file, wanted)
    code = 1
    try:
        from osl_analysis.jobs.job import run

        os.chdir(words[0])
        code = run(words[1])
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def goes_on(owner: int) -> bool:
    """Whether the process that this server is for goes on, and is not a zombie."""
    try:
        os.kill(owner, 0)
        return ") Z " not in Path(f"/proc/{owner}/stat").read_text(encoding="utf-8")
    except FileNotFoundError:
        return sys.platform != "linux"  # elsewhere is no /proc
    except OSError:
        return False


class Server:
    """Takes jobs at a socket until its owner has ended."""

    def __init__(self, path: str, owner: int) -> None:
        self.path, self.owner = path, owner
        self.clients: dict[int, socket.socket] = {}
        self.listener = socket.socket(socket.AF_UNIX)
        self.listener.bind(path)
        self.listener.listen(512)
        self.wake, woken = socket.socketpair()
        for end in (self.wake, woken):
            end.setblocking(False)
        self.woken = woken
        self.ready = selectors.DefaultSelector()
        for file in (self.listener, self.wake):
            self.ready.register(file, selectors.EVENT_READ)

    def serve(self) -> None:
        """Until the end of the run."""
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(self.woken.fileno())
        ahead = list(OF_MOST_JOBS)
        while self.clients or goes_on(self.owner):
            came = self.ready.select(0 if ahead else 2)  # [s] between two looks whether the run goes on
            if ahead and not came:
                with suppress(ImportError):  # a job that needs it will say so
                    importlib.import_module(ahead.pop(0))
            for key, _ in came:
                if key.fileobj is self.listener:
                    self.begin(self.listener.accept()[0])
                elif key.fileobj is self.wake:
                    self.wake.recv(4096)
                elif key.data in self.clients:  # a client says nothing more: it was killed
                    for kill in (os.killpg, os.kill):  # it may not have its group yet
                        with suppress(OSError):
                            kill(key.data, signal.SIGKILL)
                    self.end(key.data, None)
            self.reap()
        for left in (self.path, f"{self.path}.log"):
            with suppress(OSError):
                os.unlink(left)
        with suppress(OSError):
            os.rmdir(os.path.dirname(self.path))

    def begin(self, link: socket.socket) -> None:
        """Fork the process of a job, and tell its client the number of it."""
        try:
            words, files = receive(link)
        except (OSError, ValueError):
            link.close()
            return
        prepare(*words)
        gc.freeze()  # the jobs share this process's memory: no garbage collection of theirs looks (and writes) there
        server, pid = os.getpid(), os.fork()
        if not pid:
            self.listener.close()
            forked(server, words, files)
        for file in files:
            os.close(file)
        self.clients[pid] = link
        self.ready.register(link, selectors.EVENT_READ, pid)
        with suppress(OSError):
            link.send(pid.to_bytes(4, "big"))

    def reap(self) -> None:
        """Tell the clients of jobs that have ended: exit code, and the signal that killed the job."""
        with suppress(ChildProcessError):
            while (ended := os.waitpid(-1, os.WNOHANG))[0]:
                pid, status = ended
                killed = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
                self.end(pid, bytes([0 if killed else os.WEXITSTATUS(status), killed]))

    def end(self, pid: int, said: bytes | None) -> None:
        link = self.clients.pop(pid, None)
        if link is not None:
            self.ready.unregister(link)
            with suppress(OSError):
                link.send(said or b"")
            link.close()


def begin(what: str, argument: str, pid: str = "0") -> int:
    """Serve, or do one job."""
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if what == "--serve":
        server = Server(argument, int(os.environ[OWNER]))
        if not os.fork():  # who has started this process waits for its end: from now on it listens
            gc.disable()
            server.serve()
        return 0
    from osl_analysis.jobs import job

    dies_with(os.getppid())
    job.forget(argument, int(pid))
    return job.run(argument)


if __name__ == "__main__":
    sys.exit(begin(*sys.argv[1:]))
