# SPDX-License-Identifier: Apache-2.0
"""Errors that the user can correct. Every message is one line with the cause and the remedy."""

import json
import re
import shlex
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

quoted = partial(json.dumps, ensure_ascii=False)
"""A text or a setting as JSON, which is valid YAML, with its signs as they are."""


def printable(text: str) -> str:
    """Text for a terminal or a log: control characters and line breaks are written as escapes."""
    return "".join(
        sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in text
    )


def printable_lines(text: str) -> str:
    return "\n".join(map(printable, text.split("\n")))


def on_one_line(fault: object) -> str:
    """The words of a library, a file or a person, without line breaks and repeated blanks."""
    return printable(" ".join(str(fault).split()))


def listing(names: Sequence[str], most: int = 10) -> str:
    """Names for a message to the user, at most `most` of them, each printable and shortened."""
    text = printable(", ".join(map(shortened, names[:most]))) or "none"
    if len(names) > most:
        text += f", ... ({len(names)} in all)"
    return text


def first_of(texts: Sequence[str], most: int, where: str = "") -> list[str]:
    """The first texts, and how many more there are, and `where`."""
    more = len(texts) - most
    return [*texts[:most], f"and {more} more{where}"] if more > 0 else [*texts]


def shortened(text: str, most: int = 60) -> str:
    """A text of at most so many characters and dots, cut between words if it has any."""
    if len(text) <= most:
        return text
    whole_words = text[:most].rpartition(" ")[0]
    return f"{whole_words or text[:most]} ..."


def nearest(name: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """The end of a message about an unknown name: a question with the most similar known name, or
    empty."""
    like = likeliest(name, known, cutoff)
    return f"; {like}" if like else ""


def likeliest(name: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """A question with the known name that is most similar to an unknown one, or empty."""
    folded = {shortened(known_name).casefold(): known_name for known_name in known}
    near = get_close_matches(shortened(name).casefold(), folded, n=1, cutoff=cutoff)
    return f"did you mean '{folded[near[0]]}'?" if near and folded[near[0]] != name else ""


def without_particulars(text: str, trial: str) -> str:
    """A message without numbers and the trial's name: equal for all trials with this cause."""
    if trial:
        name = rf"(^|[/'(]|trial ){re.escape(trial)}(?![A-Za-z0-9_])"
        text = re.sub(name, r"\1TRIAL", text)
    return re.sub(r"[-+]?\d[\d.,]*(e[-+]?\d+)?", "#", text)


def unexpected(fault: BaseException) -> str:
    """A fault of the program for a log or a terminal, on one line."""
    return printable(f"unexpected {type(fault).__name__}: {fault}")


@dataclass(frozen=True)
class Change:
    """A change of the source file that may mend a recording. It is tried on the recording, and
    advised where it helps (`commands/fit.py`)."""

    words: str  # what the user does
    factors: Mapping[str, float] = field(default_factory=dict)  # of columns: a sign or a unit
    renamed: Mapping[str, str] = field(default_factory=dict)  # columns: channels that are swapped
    # column whose numbers may be of another unit than is declared; stands for a change per unit
    other_unit_of: str = ""
    rank: int = 0  # tried only where no change of a lower rank helps


class OslAnalysisError(ValueError):
    """A mistake or a limit that the user can correct.

    The message is the `reason`, what is wrong, and behind a semicolon the `remedy`, what to do; it
    may be empty. Both are made printable. The `changes` are tried, and those that help replace the
    remedy. `settings` are the names of those at fault, and `trial` that of the one at fault where a
    job reads several; empty for none.

    Examples
    --------
    >>> try:
    ...     osl.read_trial("none.parquet")
    ... except osl.OslAnalysisError as error:
    ...     print(error.reason)
    none.parquet: no such trial
    """

    def __init__(
        self,
        reason: str,
        remedy: str = "",
        *,
        changes: Sequence[Change] = (),
        settings: Sequence[str] = (),
        trial: str = "",
    ) -> None:
        self.reason = printable(reason)
        self.remedy = printable(remedy)
        super().__init__("; ".join(filter(None, [self.reason, self.remedy])))
        self.changes = tuple(changes)
        self.settings = tuple(settings)
        self.trial = trial


@contextmanager
def naming(what: object, behind: str = "", trial: str = "") -> Iterator[None]:
    """Within the block, a user's error gets the file or setting at fault before its message,
    `behind` after it, and its `trial`. An error that names this already stays as it is."""
    try:
        yield
    except OslAnalysisError as error:
        error.trial = trial or error.trial
        begin = printable(f"{what}: ")
        names_file = isinstance(what, Path) and printable(str(what)) in str(error)
        if names_file or error.reason.startswith(begin):
            raise
        raise type(error)(
            f"{begin}{error.reason}{'' if error.remedy else behind}",
            error.remedy and f"{error.remedy}{behind}",
            changes=error.changes,
            settings=error.settings,
            trial=error.trial,
        ) from error


class InputError(OslAnalysisError):
    """A file, channel, field or value is not as expected.

    Examples
    --------
    >>> osl.fit("none.parquet")
    Traceback (most recent call last):
    osl_analysis.base.errors.InputError: none.parquet: no such trial; ingest it first ...
    """


class NotWeighedError(InputError):
    """The inference cannot weigh candidate models of Eq. 15 by a recording, which least squares
    alone fit."""


class WriteError(InputError):
    """A file cannot be written, as on a full disk. The input is not at fault, so the next run tries
    again."""


class MemoryLimitError(InputError):
    """A file needs more memory than the job may have."""


def optional_module(name: str, what: str, library: str = "") -> Any:
    """The module `name` of a library that most campaigns do not need. Raises InputError: it, or a
    library that it needs, is not installed, and `what` needs it."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise not_installed(what, library or name) from error


def not_installed(what: str, library: str) -> InputError:
    """An error whose remedy is that of this very Python. By the name of this package and an extra,
    pip may fetch a stranger's package of that name."""
    return InputError(
        f"{what} needs {library}, which is not installed",
        f"{shlex.quote(sys.executable)} -m pip install {library}",
    )


class Advice(UserWarning):
    """A warning of this package."""


def advise(text: str) -> None:
    """Warn of what the user may want to change."""
    warnings.warn(text, Advice, stacklevel=3)


def show_advice_alone() -> None:
    """Show no warnings of libraries, on which a user cannot act."""
    warnings.simplefilter("ignore")
    warnings.simplefilter("default", Advice)


class IdentifiabilityError(OslAnalysisError):
    """The data cannot tell the requested parameters apart.

    Examples
    --------
    >>> osl.fit(trial_of_one_frequency)
    Traceback (most recent call last):
    osl_analysis.base.errors.IdentifiabilityError: ...
    """


class UnreachableImpedanceError(OslAnalysisError):
    """No control gains render the requested impedance.

    Examples
    --------
    >>> desired = osl.DesiredImpedance("compensated", K_d=3000, B_d=5)
    >>> osl.fit(trial, desired=desired, parameters="config/parameters/default.yaml")
    Traceback (most recent call last):
    osl_analysis.base.errors.UnreachableImpedanceError: ...
    """
