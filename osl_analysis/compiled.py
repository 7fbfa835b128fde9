"""Functions that numba compiles on their first call and keeps on disk. A cache that is broken or read-only harms not.

Numba itself ends with a traceback if the file of its cache is damaged, as after a full disk or a power failure.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import caching
from numba.core.registry import cpu_target

P = ParamSpec("P")
R = TypeVar("R")
FunctionCache: Any = caching.FunctionCache


class HealingCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache of one function; what cannot be read is deleted, and the function compiled anew."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for a signature; None if it is not in the cache, or cannot be read from it."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # whatever a damaged file makes of pickle and LLVM
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the compiled function, if the disk takes it."""
        with suppress(OSError):
            super().save_overload(sig, data)


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """The function, compiled on its first call. The result is kept on disk where a folder can be written.

    Numba looks for changes in the function's own file only: compiled functions that call one another share a file.
    """
    return kept_on_disk(function, numba.njit(error_model="numpy")(function))


def fused(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, but a product and a sum are one operation, rounded once, on processors that have it.

    A long chain of operations takes an eighth less time. On other processors results differ in the last bit.
    """
    return kept_on_disk(function, numba.njit(error_model="numpy", fastmath={"contract"})(function))


def kept_on_disk(function: Callable[P, R], fast: Any) -> Callable[P, R]:
    """The compiled function `fast` of a function, with a cache that heals."""
    with suppress(RuntimeError, OSError):  # no folder can be written: each process compiles anew
        fast._cache = HealingCache(function)
    return cast(Callable[P, R], fast)


def load_numba() -> None:
    """Load what numba needs for the first call of a compiled function, 0.4 s, before processes are forked."""
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()
