"""Results are written completely or not at all: write to a temporary file beside the target, then rename it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from osl_analysis.errors import InputError


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a path beside `path`, with the same suffix, that becomes `path` when the block succeeds.

    Parent folders are created. When the block raises, what it wrote is deleted and an older `path` stays as it
    was. The block must have closed the file when it ends.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); choose another place") from error
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name a file")
    temporary = temporary_path(path, os.getpid())
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def temporary_path(path: Path, pid: int) -> Path:
    """The file that process `pid` writes before it becomes `path`."""
    return path.with_name(f".{path.stem}.{pid}{path.suffix}")


def file_state(path: Path) -> list[int] | None:
    """Size [bytes], date of the last change [ns] and whether it may be read (0 or 1); None if there is no such file."""
    try:
        found = path.stat()
    except OSError:
        return None
    return [found.st_size, found.st_mtime_ns, int(os.access(path, os.R_OK))]
