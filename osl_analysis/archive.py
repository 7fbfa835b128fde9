"""The further tables of a trial in one file: a ZIP archive of CSV files, which every file manager opens.

A trial has up to seven tables beside that of its fit. As files of their own they are most of what a large campaign
leaves, and of what Snakemake looks at. A table in an archive has the path `ARCHIVE.zip/TABLE.csv`.
"""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path

SUFFIX = ".zip"
SAME_DATE = (1980, 1, 1, 0, 0, 0)
"""Of every part, so that the same tables make the same archive."""
OPEN: ContextVar[dict[Path, dict[str, bytes]] | None] = ContextVar("open_archives", default=None)
"""The parts of the archives that are written at the end of the block, by archive and name."""


@contextmanager
def archives() -> Iterator[None]:
    """A block at whose end the archives of its tables are written, each completely; after an error, none is."""
    token = OPEN.set({})
    try:
        yield
        for path, parts in (OPEN.get() or {}).items():
            with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:  # without compression
                for name, content in parts.items():
                    archive.writestr(zipfile.ZipInfo(name, SAME_DATE), content)
    finally:
        OPEN.reset(token)


def is_part(path: Path) -> bool:
    """Whether a path names a table in an archive."""
    return path.parent.suffix == SUFFIX


def add_part(path: Path, content: bytes) -> None:
    """Keep a table for its archive, which is written at the end of the block (`archives`)."""
    opened = OPEN.get()
    if opened is None:
        raise LookupError(f"{path}: written outside of the block `archives`")
    opened.setdefault(path.parent, {})[path.name] = content


def read_part(path: Path) -> bytes:
    """The content of a table in an archive."""
    try:
        with zipfile.ZipFile(path.parent) as archive:
            return archive.read(path.name)
    except (OSError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: no such table ({error}); run the step that writes it, or check the path") from error
