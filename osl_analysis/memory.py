"""Limits of memory and cores of a job. A file that needs more memory ends in an error, not by the
OOM killer."""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from osl_analysis.errors import InputError, MemoryLimitError

VARIABLE = "OSL_MEMORY_MB"  # memory that one job, or one call of the command line, may have [MB]
SET_TO_ONE = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "PYDANTIC_DISABLE_PLUGINS",
)
"""Matrix libraries get one thread: products are small, two threads take three times as long on a
busy machine, and Snakemake counts one core per job. A search for plugins would take 15 ms per
process."""


@contextmanager
def limited_memory(files: Sequence[Path | str]) -> Iterator[None]:
    """Within the block, this process gets no more memory than `OSL_MEMORY_MB`, else 0.8 of that of
    the machine or batch job. Beyond it, raises MemoryLimitError, which names `files`, those that
    are read. A lower limit set before stays. Linux only."""
    if sys.platform != "linux":
        yield
        return
    import resource

    # of the machine; a container may have less
    found = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    with suppress(OSError, ValueError):
        for line in Path("/proc/self/cgroup").read_text(encoding="utf-8").splitlines():
            own = Path("/sys/fs/cgroup", line.split(":", 2)[2].lstrip("/"))
            limits = [one / "memory.max" for one in (own, *own.parents)]
            texts = [one.read_text(encoding="ascii").strip() for one in limits if one.is_file()]
            found += [int(text) for text in texts if text.isdigit()]
    allowed = 0.8 * min(found)
    if text := os.environ.get(VARIABLE, ""):
        allowed = 0.0
        with suppress(ValueError):
            allowed = 1e6 * float(text)
        if not 0 < allowed < sys.maxsize:
            raise InputError(f"{VARIABLE}={text}: write a number of megabytes above 0, or unset it")
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    limit = min(
        int(allowed), *(one for one in (soft, hard) if one != resource.RLIM_INFINITY), sys.maxsize
    )
    resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
    try:
        yield
    except MemoryError as error:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))  # the message needs some, too
        named = ", ".join(map(str, files[:3])) + " ..." * (len(files) > 3) + ": " * bool(files)
        raise MemoryLimitError(
            f"{named}not enough memory, a job may have {limit / 1e6:.0f} MB here; cut the"
            f" recording, or ask for fewer samples, or allow more by {VARIABLE} or on a larger"
            " machine"
        ) from error
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
