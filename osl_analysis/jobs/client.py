"""One job, as Snakemake starts it: `client.py REQUEST`. It hands the job to the warm server of this run, or runs it.

The variable OSL_JOBS names the server's socket. Without a server the job runs in a Python of its own, which takes 0.8 s
of imports more. The client ends with the job's exit code. If it is killed, the server kills the job. If the server is
killed, the kernel kills its jobs, and the client runs its job itself. It imports little, since it starts for each job.
"""

import os
import signal
import sys

SERVER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "server.py")
JOBS, OWNER, SPARED = "OSL_JOBS", "OSL_JOBS_OWNER", "OSL_JOBS_SPARED"
"""Variables of the environment: the server's socket, the process it ends with, and modules that it need not import."""


def main(request: str) -> int:
    """Run the job of a request; its exit code. Ctrl-C is for Snakemake, which lets begun jobs come to their end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    code, number, pid = served(request)
    if code is None:
        code, number, pid = alone("--job", request, str(pid))
    if number:
        code, *_ = alone("--died", request, str(pid), str(number))
    return code or 0


def served(request: str) -> tuple[int | None, int, int]:
    """Exit code of the job in the server, the signal that killed it (0: none) and its process; no code without one."""
    pid, path = 0, os.environ.get(JOBS)
    try:
        import socket

        if not path or not is_ours(path):
            return None, 0, 0
        with connected(path) as link:
            body = "\0".join([os.getcwd(), request]).encode()
            socket.send_fds(link, [len(body).to_bytes(4, "big")], [0, 1, 2])
            link.sendall(body)
            pid = int.from_bytes(link.recv(4), "big")
            said = link.recv(2)
        return (said[0], said[1], pid) if len(said) == 2 else (None, 0, pid)
    except (OSError, AttributeError, ImportError):  # no server can be had, or a system without such sockets
        return None, 0, pid


def connected(path: str):  # type: ignore[no-untyped-def]  # the type would import `socket`
    """A connection to the server, which is started if need be."""
    import socket

    link = socket.socket(socket.AF_UNIX)
    try:
        link.connect(path)
    except OSError:
        start(path)
        link.connect(path)
    return link


def is_ours(path: str) -> bool:
    """Whether the socket's folder, which is made, belongs to this user alone: another one could answer there."""
    folder = os.path.dirname(path)
    os.makedirs(folder, 0o700, exist_ok=True)
    found = os.stat(folder)
    return found.st_uid == os.getuid() and not found.st_mode & 0o077


def start(path: str) -> None:
    """Start the server if there is none. It listens when this returns, and does its imports while clients wait."""
    import fcntl
    import socket
    import subprocess

    with open(f"{path}.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        try:
            with socket.socket(socket.AF_UNIX) as probe:
                probe.connect(path)
            return
        except OSError:
            pass
        # In a session of its own: Ctrl-C in a terminal is not for it.
        arguments = [sys.executable, SERVER, "--serve", path]
        with open(f"{path}.log", "ab") as log:  # who reads the run's lines to their end shall not wait for the server
            it = subprocess.Popen(
                arguments, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=log, start_new_session=True
            )
        it.stdout.read(1)  # type: ignore[union-attr]


def alone(*arguments: str) -> tuple[int, int, int]:
    """Exit code of a job in a Python of its own, the signal that killed it and its process."""
    import subprocess

    job = subprocess.Popen([sys.executable, SERVER, *arguments])
    code = job.wait()
    return (0, -code, job.pid) if code < 0 else (code, 0, job.pid)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
