"""How a public name, a field of a configuration or a column of a table gets another name.

The old name works, with a `RenamedWarning`, until the release that its `NewName` states; from then
on it is an error that names the new one. CONTRIBUTING.md says what is stable.
"""

import os
import re
import sys
import warnings
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from osl_analysis.errors import NO_REMOVAL, InputError, Removal

PACKAGE = f"{Path(__file__).parent}{os.sep}"  # how the paths of its files begin


class NewName(NamedTuple):
    """What something is called since a release."""

    name: str
    goes_in: str  # release in which the old name becomes an error, as "1.1"

    @property
    def old_one_works(self) -> bool:
        return minor_release(version("osl-analysis")) < minor_release(self.goes_in)


# of `osl_analysis`, by old name
PUBLIC_NAMES = {"Response": NewName("FrequencyResponse", "1.1")}
# columns of result tables, by table and old name
RENAMED_COLUMNS: Mapping[str, Mapping[str, NewName]] = {}
# a field of a configuration stands in `RENAMED` of its model, one of limits in `judge/limits.py`


class RenamedWarning(FutureWarning):
    """A name that goes was used. `removal` is the field of a configuration, if it is one."""

    def __init__(self, message: str, removal: Removal = NO_REMOVAL) -> None:
        super().__init__(message)
        self.removal = removal


def minor_release(text: str) -> tuple[int, int]:
    """The first two numbers of a version, also of one as "1.1rc1"."""
    numbers = re.match(r"(\d+)\.(\d+)", text)
    if numbers is None:
        raise ValueError(f"'{text}' is no version; write one as 1.1")
    major, minor = numbers.groups()
    return int(major), int(minor)


def warn_caller(warning: Warning) -> None:
    """Warn, and point at the line outside of this package that led here: the user's own.

    `skip_file_prefixes` does it, but needs Python 3.12.
    """
    stacklevel = 2  # of who calls this function
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(PACKAGE):
        frame = frame.f_back
        stacklevel += 1
    warnings.warn(warning, stacklevel=stacklevel)


def current_name(old: str, new: NewName, error: type[Exception] = InputError) -> str:
    """Tell the present name of what was called `old`, with a warning, or, once the old name is
    gone, as an error of this type."""
    if not new.old_one_works:
        raise error(f"{old} is called {new.name} since an earlier release; write {new.name}")
    warn_caller(RenamedWarning(f"{old} is called {new.name} now; it goes in release {new.goes_in}"))
    return new.name
