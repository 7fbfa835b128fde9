"""The functions that open files: each reads, calls the packages below, and writes. A rule of the
workflow calls one by its name (`rules/common.smk`), the command line another (`cli.py`)."""

from collections.abc import Callable
from importlib import import_module
from typing import Any


def command_of(place: str) -> Callable[..., Any]:
    """The function at a place, `module.function`, of this package."""
    module, _, name = place.partition(".")
    command: Callable[..., Any] = getattr(import_module(f"osl_analysis.commands.{module}"), name)
    return command
