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
# Functions with their options, by module and name, of modules without a call yet: numba takes 0.3 s
WAITING: dict[str, dict[str, tuple[Callable[..., Any], dict[str, Any]]]] = {}


def compiled(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    """Compile a function on its first call; the result is kept on disk where a folder can be
    written.

    Numba looks for changes in the function's own file only: compiled functions that call one
    another share one.
    """
    if not HAS_COMPILER:
        return function
    module = function.__module__
    name = function.__name__
    WAITING.setdefault(module, {})[name] = (function, options)

    @wraps(function)
    def compiled_function(*arguments: P.args, **named: P.kwargs) -> R:
        for waiting_name, (python, its_options) in WAITING.pop(module, {}).items():
            function.__globals__[waiting_name] = compile_with_numba(python, its_options)
        result: R = function.__globals__[name](*arguments, **named)
        return result

    return compiled_function


def compile_with_numba(python: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Compile a function; where no folder can be written, each process does so anew."""
    numba = import_module("numba")
    try:
        return numba.njit(python, cache=True, error_model="numpy", **options)
    except (RuntimeError, OSError):
        return numba.njit(python, error_model="numpy", **options)


def fused(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, but a product and a sum are one operation, rounded once, on processors that
    have it.

    A long chain of operations takes an eighth less time. On other processors results differ in the
    last bit.
    """
    return compiled(function, fastmath={"contract"})


def require_compiler() -> None:
    """Refuse to simulate without numba, which takes a hundredth of the time of plain Python."""
    if not HAS_COMPILER:
        raise not_installed("the simulator", "numba")
