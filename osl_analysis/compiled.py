"""Functions that numba compiles on their first call and keeps on disk. A cache that is broken or read-only harms not.

Numba is installed with the extra `simulator`. Without it the same functions run as plain Python.
"""

from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from typing import Any, ParamSpec, TypeVar, cast

from osl_analysis.errors import InputError

numba: Any = import_module("numba") if find_spec("numba") else None
P = ParamSpec("P")
R = TypeVar("R")
FunctionCache: Any = import_module("numba.core.caching").FunctionCache if numba else object
Dispatcher: Any = import_module("numba.core.registry").CPUDispatcher if numba else object


class HealingCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache of one function. A damaged file, as after a full disk, would end numba with a traceback."""

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


class Compiled(Dispatcher):  # type: ignore[misc]
    """What `numba.njit` makes of a function, with a cache that heals."""

    def enable_caching(self) -> None:
        """Keep what is compiled on disk."""
        self._cache = HealingCache(self.py_func)


def compiled(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    """The function, compiled on its first call. The result is kept on disk where a folder can be written. Numba looks
    for changes in the function's own file only: compiled functions that call one another share a file."""
    if numba is None:
        return function
    fast = Compiled(function, targetoptions={"nopython": True, "error_model": "numpy", **options})
    with suppress(RuntimeError, OSError):  # no folder can be written: each process compiles anew
        fast.enable_caching()
    return cast(Callable[P, R], fast)


def fused(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, but a product and a sum are one operation, rounded once, on processors that have it. A long chain
    of operations takes an eighth less time. On other processors results differ in the last bit."""
    return compiled(function, fastmath={"contract"})


def require_compiler() -> None:
    """Refuse to simulate without numba, which takes a hundredth of the time of plain Python."""
    if numba is None:
        raise InputError("the simulator needs numba, which is not installed; pip install 'osl-analysis[simulator]'")
