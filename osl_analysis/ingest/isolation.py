"""Run a decoder that may crash the process in a child, and get its arrays or a sentence back."""

import faulthandler
import os
import select
import signal
import tempfile
import warnings
from collections.abc import Callable
from typing import IO, NoReturn

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Array

FAILED = 1  # exit status of a child that wrote its exception instead of arrays


def isolated(work: Callable[[], list[Array]], timeout: float) -> list[Array]:
    """Arrays that `work` returns, computed in a forked child whose output is silenced; `timeout` in [s].

    Forking costs milliseconds, works inside forked and daemonic processes alike, and needs nothing pickled.
    Where there is no fork (Windows) the work is done here, unprotected. The child may use numpy and the decoder
    only: threads of the parent, such as polars's, do not exist in it.

    Raises
    ------
    InputError
        The work raised, crashed or ran out of time; the message says which.
    """
    if not hasattr(os, "fork"):
        return work()
    with tempfile.TemporaryFile() as file:
        read_end, write_end = os.pipe()
        child = fork()
        if child == 0:
            os.close(read_end)
            run_child(work, file)
        os.close(write_end)
        try:
            status = wait(child, read_end, timeout)
        finally:
            os.close(read_end)
        file.seek(0)
        return results(file, status)


def fork() -> int:
    """Fork without Python's warning about threads, which `isolated` answers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()


def run_child(work: Callable[[], list[Array]], file: IO[bytes]) -> NoReturn:
    """Do the work, write its arrays or its exception, and leave without the parent's exit handlers."""
    status = FAILED
    try:
        silence = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silence, 1)
        os.dup2(silence, 2)
        faulthandler.disable()
        try:
            for array in work():
                np.save(file, array, allow_pickle=False)
            status = 0
        except Exception as error:
            file.seek(0)
            file.truncate()
            file.write(str(error).encode(errors="replace"))
        file.flush()
    finally:
        os._exit(status)


def wait(child: int, pipe: int, timeout: float) -> int:
    """Exit code of the child; the pipe ends when the child does, however that happens."""
    ended, _, _ = select.select([pipe], [], [], timeout)
    if not ended:
        os.kill(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def results(file: IO[bytes], status: int) -> list[Array]:
    """The arrays in the child's file, or its failure as an error."""
    if status == FAILED:
        raise InputError(" ".join(file.read().decode(errors="replace").split()))
    if status == -signal.SIGKILL:
        raise InputError("the decoder was stopped: it ran out of time or memory")
    if status != 0:
        raise InputError(f"the decoder crashed ({signal.Signals(-status).name if status < 0 else status})")
    arrays = []
    size = os.fstat(file.fileno()).st_size
    while file.tell() < size:
        arrays.append(np.load(file, allow_pickle=False))
    return arrays
