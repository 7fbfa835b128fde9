"""Memory that is free within the process, given back to the system."""

import ctypes
from contextlib import suppress


def return_memory() -> None:
    """Give the system what was freed between arrays that are still there, where its library can do that (glibc).

    After many small arrays, as those of the chunks of a log, a third of the memory of a long recording stays in such
    gaps, which the large arrays that follow do not fit in.
    """
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
