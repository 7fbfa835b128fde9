"""Functions that numba (extra `simulator`) compiles on their first call and keeps on disk; else
plain Python."""

from collections.abc import Callable
from functools import wraps
from importlib import import_module
from importlib.util import find_spec
from typing import Any, ParamSpec, TypeVar

from osl_analysis.errors import not_installed

HAS_COMPILER = find_spec("numba") is not None
P = ParamSpec("P")
R = TypeVar("R")
WAITING: dict[str, dict[str, tuple[Callable[..., Any], dict[str, Any]]]] = {}
"""Functions with their options, by module and name, of modules without a call yet: numba takes 0.3
s."""


def compiled(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    """The function, compiled on its first call. The result is kept on disk where a folder can be
    written. Numba looks for changes in the function's own file only: compiled functions that call
    one another share one."""
    if not HAS_COMPILER:
        return function
    module, name = function.__module__, function.__name__
    WAITING.setdefault(module, {})[name] = function, options

    @wraps(function)
    def fast(*arguments: P.args, **named: P.kwargs) -> R:
        for other, (python, its) in WAITING.pop(module, {}).items():
            numba = import_module("numba")
            try:
                made = numba.njit(python, cache=True, error_model="numpy", **its)
            except (RuntimeError, OSError):  # no folder can be written: each process compiles anew
                made = numba.njit(python, error_model="numpy", **its)
            function.__globals__[other] = made
        result: R = function.__globals__[name](*arguments, **named)
        return result

    return fast


def fused(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, but a product and a sum are one operation, rounded once, on processors that
    have it. A long chain of operations takes an eighth less time. On other processors results
    differ in the last bit."""
    return compiled(function, fastmath={"contract"})


def require_compiler() -> None:
    """Refuse to simulate without numba, which takes a hundredth of the time of plain Python."""
    if not HAS_COMPILER:
        raise not_installed("the simulator", "numba")
