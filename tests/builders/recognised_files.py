"""A file of any format, read as a user's is: its content says the format, a source file says the
rest."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from conftest import said_in_refusal

from osl_analysis.formats import recognise
from osl_analysis.ingest.conversion import Converted
from osl_analysis.ingest.raw_files import read_converted


def read_recognised(path: Path, **described: Any) -> Converted:
    """The canonical columns of a file or folder; `described` are the fields of its source file."""
    known = recognise(path)
    return read_converted(path, known.source.model_validate({"format": known.name, **described}))


def refusal_by(read: Callable[..., object], path: Path, *given: object, **stated: object) -> str:
    """What is said to a file that is refused: one line that begins with the file, of a length that
    can be read."""
    message = said_in_refusal(read, path, *given, **stated)
    assert message.startswith(str(path))
    assert len(message) < 1000
    return message


def refusal_of(path: Path, **described: Any) -> str:
    return refusal_by(partial(read_recognised, **described), path)
