# SPDX-License-Identifier: Apache-2.0
"""Limit the memory and the cores of a job.

A file that needs more memory ends in an error with a remedy; without a limit the system would kill
the process without a word.
"""

import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from osl_analysis.base.errors import InputError, MemoryLimitError, listing

VARIABLE = "OSL_MEMORY_MB"  # memory that one job, or one call of the command line, may have [MB]
# Matrix libraries get one thread: products are small, two threads take three times as long on a
# busy machine, and Snakemake counts one core per job. A search for plugins would take 15 ms per
# process.
SET_TO_ONE = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "PYDANTIC_DISABLE_PLUGINS",
)


USUAL_SHARE = 0.8  # of the memory of the machine that jobs may have
LEAST_BYTES = 1_000_000_000  # of a job, also beside many; the longest trials take 400 MB
HARMLESS_BYTES = 50_000_000  # that any file may unpack to
MOST_UNPACKED = 200  # times the size of a file; of 20 channels, 19 of them dead, some 20


@contextmanager
def limited_memory(files: Sequence[Path | str], at_once: int = 1) -> Iterator[None]:
    """Limit the memory of this process within the block. Linux only.

    Parameters
    ----------
    files : Sequence of Path or str
        Those that are read, for the message.
    at_once : int
        How many processes share the memory of the machine or batch job.

    Raises
    ------
    MemoryLimitError
        More than `OSL_MEMORY_MB` is needed, else than its part of `USUAL_SHARE`. A lower limit set
        before stays.
    InputError
        The variable is no number of megabytes.
    """
    if sys.platform == "linux":
        import resource

        soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
        limit = allowed_memory(at_once)
        if soft != resource.RLIM_INFINITY:
            limit = min(limit, soft)
        resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
        try:
            yield
        except MemoryError as error:
            resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))  # the message needs some, too
            raise too_large(files, limit) from error
        finally:
            resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
    else:
        yield


def too_large(files: Sequence[Path | str], limit: float) -> MemoryLimitError:
    return MemoryLimitError(
        f"{listing([*map(str, files)], 3)}: not enough memory, a job may have {limit / 1e6:.0f}"
        " MB here",
        f"cut the recording, or ask for fewer samples, or allow more by {VARIABLE} or on a"
        " larger machine",
    )


def check_unpacked(path: Path, size: int) -> None:
    """Refuse a file by the `size` [bytes] to which it says that it unpacks, before it does.

    Raises
    ------
    InputError
        It is more than `MOST_UNPACKED` times the file.
    MemoryLimitError
        It is more than this process may have.
    """
    if size > max(MOST_UNPACKED * path.stat().st_size, HARMLESS_BYTES):
        raise InputError(
            f"{path}: would unpack to {size / 1e6:.0f} MB, more than {MOST_UNPACKED} times its"
            " size, as no recording does",
            "record it again, or save it without compression",
        )
    if size > allowed_memory():
        raise too_large([path], allowed_memory())


def allowed_memory(at_once: int = 1) -> int:
    """Memory [bytes] that a process may have beside others: what is stated, else a share of the
    machine's."""
    text = os.environ.get(VARIABLE, "")
    if not text:
        usual = USUAL_SHARE * min(memory_limits())
        return int(max(usual / at_once, min(usual, LEAST_BYTES)))
    if not re.fullmatch(r"0*[1-9]\d{0,11}", text):
        raise InputError(
            f"{VARIABLE}={text}: write a whole number of megabytes above 0, or unset it"
        )
    return 10**6 * int(text)


@cache
def memory_limits() -> list[int]:
    """Memory [bytes] of the machine, and of the control groups of a container or batch job."""
    limits = [sys.maxsize]
    if sys.platform == "linux":
        limits.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    with suppress(OSError):
        process_group = Path("/proc/self/cgroup").read_text(encoding="utf-8").rpartition(":")[2]
        group = Path("/sys/fs/cgroup", process_group.strip().lstrip("/"))
        for folder in (group, *group.parents):
            with suppress(OSError, ValueError):  # there is none, or it is `max`
                limits.append(int((folder / "memory.max").read_text(encoding="ascii")))
    return limits
