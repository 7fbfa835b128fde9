"""Formats of recordings: from bytes to arrays of numbers. Nothing here knows a leg, a signal or an SI unit."""

from importlib import import_module
from typing import Any

from osl_analysis.errors import InputError


def optional_module(name: str, extra: str, what: str) -> Any:
    """The module `name` of a library that an extra of the package installs; `what` cannot be read without it."""
    library = name.partition(".")[0]
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != library:
            raise
        raise InputError(
            f"{what} needs {library}, which is not installed; pip install 'osl-analysis[{extra}]'"
        ) from None
