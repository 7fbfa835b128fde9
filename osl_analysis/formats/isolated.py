"""Decoders in C in a process of their own: on a damaged file they may crash, or ask for all memory there is."""

import os
import pickle
import signal
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from osl_analysis.errors import InputError
from osl_analysis.formats.table import LIBRARY_REMEDY, MOST_BYTES, reason_of

Result = TypeVar("Result")


def isolated(work: Callable[[], Result]) -> Result:
    """What `work` returns in a fork of this process, or its refusal; InputError if the fork dies or needs more memory
    than a recording may. Where there are no forks it is done here."""
    if not hasattr(os, "fork"):
        return work()
    reader, writer = os.pipe()
    with warnings.catch_warnings(action="ignore"):  # of threads, which the fork does not use
        child = os.fork()
    if child == 0:
        answer(work, writer)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        said = pipe.read()
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status) or not said:
        name = signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else "no answer"
        raise InputError(f"its decoder broke down ({name}): the file is damaged; {LIBRARY_REMEDY}")
    is_whole, result = pickle.loads(said)  # by our own fork
    if is_whole is None:
        raise MemoryError
    if not is_whole:
        raise InputError(result)
    return result  # type: ignore[no-any-return]


def answer(work: Callable[[], object], writer: int) -> None:
    """In the fork: do the work within the limit of memory, write its result, and end as if nothing had been."""
    is_lower = False  # whether this process may have less than a recording
    try:
        with suppress(OSError, ValueError, ImportError, AttributeError):
            import resource

            pages = int(Path("/proc/self/statm").read_text().split()[0])
            limit = pages * resource.getpagesize() + MOST_BYTES
            resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))
            is_lower = 0 <= resource.getrlimit(resource.RLIMIT_DATA)[0] < MOST_BYTES
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        try:
            said = pickle.dumps((True, work()))
        except MemoryError:
            more = f"it takes more than {MOST_BYTES / 1e9:g} GB of memory: damaged, or no recording"
            more += "; save the signals of one trial in a file of their own"
            said = pickle.dumps((None if is_lower else False, more))
        except InputError as error:
            said = pickle.dumps((False, str(error)))
        except Exception as error:
            said = pickle.dumps((False, f"cannot be read ({reason_of(error)}); {LIBRARY_REMEDY}"))
        with os.fdopen(writer, "wb") as pipe:
            pipe.write(said)
    finally:
        os._exit(0)
