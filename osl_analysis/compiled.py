"""Functions that numba, of the extra `simulator`, compiles on their first call and keeps on disk; without it they run
as plain Python."""

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import Any, ParamSpec, TypeVar, cast

from osl_analysis.errors import not_installed

numba: Any = import_module("numba") if find_spec("numba") else None
P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    """The function, compiled on its first call. The result is kept on disk where a folder can be written. Numba looks
    for changes in the function's own file only: compiled functions that call one another share a file."""
    if numba is None:
        return function
    try:
        fast = numba.njit(function, cache=True, error_model="numpy", **options)
    except (RuntimeError, OSError):  # no folder can be written: each process compiles anew
        fast = numba.njit(function, error_model="numpy", **options)
    return cast(Callable[P, R], fast)


def fused(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, but a product and a sum are one operation, rounded once, on processors that have it. A long chain
    of operations takes an eighth less time. On other processors results differ in the last bit."""
    return compiled(function, fastmath={"contract"})


def require_compiler() -> None:
    """Refuse to simulate without numba, which takes a hundredth of the time of plain Python."""
    if numba is None:
        raise not_installed("the simulator", "numba")
