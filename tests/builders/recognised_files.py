# SPDX-License-Identifier: Apache-2.0
"""A file of any format, read as a user's is: its content says the format, a source file says the
rest."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from conftest import said_in_refusal

from osl_analysis.base.errors import naming
from osl_analysis.base.source_file import Source
from osl_analysis.formats import known_formats, recognise
from osl_analysis.ingest.conversion import Converted
from osl_analysis.ingest.raw_files import read_converted


def source_of(name: str, **described: Any) -> Source:
    """What a source file of a format says."""
    return known_formats()[name].source.model_validate({"format": name, **described})


def read_recognised(path: Path, **described: Any) -> Converted:
    """The canonical columns of a file or folder; `described` are the fields of its source file."""
    with naming(path):
        name = recognise(path).name
    return read_converted(path, source_of(name, **described))


def refusal_by(read: Callable[..., object], path: Path, *given: object, **stated: object) -> str:
    """What is said to a file that is refused: one line that begins with the file, of a length that
    can be read."""
    message = said_in_refusal(read, path, *given, **stated)
    assert message.startswith(str(path))
    assert len(message) < 1000
    return message


def refusal_of(path: Path, **described: Any) -> str:
    return refusal_by(partial(read_recognised, **described), path)
