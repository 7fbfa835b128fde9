# SPDX-License-Identifier: Apache-2.0
"""Recognise the format of a file, and read it as a recording.

Example: `read(Path("walk.c3d"))`.
"""

import pkgutil
import re
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.base.errors import InputError, naming, on_one_line, shortened
from osl_analysis.base.files import PACKAGE, package_yaml
from osl_analysis.base.recording import Format, Recording
from osl_analysis.formats.text_cells import decoded

FIRST_BYTES = 65_536  # of a file, by which its format is recognised
ENTRY_POINTS = "osl_analysis.formats"  # entry points of other packages
COPY_AGAIN = "copy the file again, or export it anew"
# what a mistake in a program raises
FAULTS = (TypeError, AttributeError, NameError, LookupError, ArithmeticError, AssertionError)


@cache
def known_formats() -> Mapping[str, Format]:
    """The formats by name; tables of any text come last."""
    formats = []
    for module in pkgutil.iter_modules([str(Path(__file__).parent)]):
        members = vars(import_module(f"{__package__}.{module.name}")).values()
        formats += [member for member in members if isinstance(member, Format)]
    formats += [point.load() for point in entry_points(group=ENTRY_POINTS)]
    formats.sort(key=lambda known: known.is_any_text)
    return {known.name: known for known in formats}


def beginning(path: Path) -> bytes:
    """Read the first bytes of a file; none of a folder."""
    if path.is_dir():
        return b""
    with path.open("rb") as file:
        return file.read(FIRST_BYTES)


def formats_of(path: Path) -> list[Format]:
    """The formats that a file or folder may be of, by what it begins with; the likeliest first."""
    if path.is_dir():
        return [known for known in known_formats().values() if known.is_folder(path)]
    begin = beginning(path)
    return [known for known in known_formats().values() if known.begins(begin)]


def recognise(path: Path, stated_format: str = "") -> Format:
    """Tell the format of a file by its first bytes.

    `stated` is the format that its source file names, which may be one of several that fit.

    Raises
    ------
    InputError
        It is of no format that is read, or not of the stated one.
    """
    formats = formats_of(path)
    refuse_others(path, formats)
    if not formats:
        raise InputError(
            f"of no known format (it begins with {beginning(path)[:10]!r})",
            f"export it as one of {', '.join(known_formats())}, or name the recording itself",
        )
    is_any_text = formats[0].is_any_text  # what begins as a special format is no other text
    named_formats = [
        known_format
        for known_format in formats
        if known_format.name == stated_format and known_format.is_any_text <= is_any_text
    ]
    likely = [*named_formats, *formats][0]
    if stated_format not in ("", likely.name):
        raise InputError(
            f"is {likely.name}, its source file says {stated_format}",
            f"write `format: {likely.name}`, or name another source file or recording in the sheet",
        )
    return likely


@np.errstate(all="ignore")  # values may be of any size: checks tell them, not NumPy
def read(path: Path, source: Any = None) -> Recording:
    """Read a file, or a folder that is a recording.

    Parameters
    ----------
    source
        Its source file, a model of its format; None to list what it holds.

    Raises
    ------
    InputError
        The file is of no known format, damaged, or not as its source file says.
    """
    with naming(path):
        chosen = recognise(path, "" if source is None else source.format)
        with in_one_sentence():
            return chosen.read(path, source)


@contextmanager
def in_one_sentence() -> Iterator[None]:
    """Turn an error about a damaged file into one sentence; a fault of this program stays one."""
    try:
        yield
    except (InputError, MemoryError, KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # also a panic of Rust
        if isinstance(error.__context__, MemoryError):  # in the words of a library
            raise error.__context__ from error
        if not is_of_file(error):
            raise
        reason = shortened(on_one_line(error)) or type(error).__name__
        raise InputError(f"cannot be read ({reason})", COPY_AGAIN) from error


def is_of_file(error: BaseException) -> bool:
    """Tell whether an error is of decoding, or of a library that met a damaged file.

    A TypeError in a module of this package, for example, is a fault of the program: the traceback
    tells where, and no copy of the file mends it.
    """
    if not isinstance(error, FAULTS):
        return True
    places = traceback.extract_tb(error.__traceback__)
    return not places or not Path(places[-1].filename).is_relative_to(PACKAGE)


def refuse_others(path: Path, formats: Sequence[Format]) -> None:
    """Refuse an empty file, and one of a format that is not read, which would else pass for a table
    of text.

    `formats` are those that the file may be of.
    """
    if path.is_dir() or any(not candidate.is_any_text for candidate in formats):
        return
    begin = beginning(path)
    if not begin:
        raise InputError(
            "the file is empty",
            "copy or record it again, or exclude the trial in the sheet",
        )
    for name, description in package_yaml(Path(__file__).with_name("not_read.yaml")).items():
        if re.search(description["begins"], decoded(begin), re.MULTILINE | re.IGNORECASE):
            raise InputError(f"{name}, which is not read", description["instead"])
