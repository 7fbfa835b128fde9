"""Beside a file `unlucky` the job that opens one recording is ended, and another one cannot be
read: tests may run as root. Python imports it in every process of `snakemake_runs.py`."""

import errno
import os
import signal
import sys


def unlucky(event: str, arguments: tuple[object, ...]) -> None:
    name = os.path.basename(str(arguments[0])) if event == "open" else ""
    if name == "walking_04.c3d" and os.path.exists("unlucky"):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(arguments[0]))
    if name == "walking_05.c3d" and os.path.exists("unlucky") and sys.argv[0] == "-c":
        os.kill(os.getpid(), signal.SIGKILL)


sys.addaudithook(unlucky)
