# SPDX-License-Identifier: Apache-2.0
"""Write files completely or not at all, and find the files of the package.

A file is written under a temporary name in the folder of its target, and renamed: an interrupted
run leaves no half of a file. Example:

    with atomic_path(path) as temporary:
        table.write_csv(temporary)
"""

import hashlib
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

from osl_analysis.base.errors import InputError, WriteError


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`, with the same suffix, and rename it if all goes well.

    Parameters
    ----------
    path : Path
        When the block succeeds, the temporary file is renamed to it; the block must have closed it.
        When the block raises, it is deleted and an older `path` stays.

    Raises
    ------
    InputError
        As `check_target`.
    WriteError
        The folder cannot be made, or the disk is full or fails.
    """
    check_target(path)
    temporary = temporary_path(path, os.getpid())
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(path)
    except Exception as error:
        reason = reason_of_disk(error, temporary)
        if reason is None:
            raise
        raise WriteError(
            f"{path}: cannot be written ({reason})", "make room, or choose another place"
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def reason_of_disk(error: BaseException, temporary: Path) -> str | None:
    """The system's reason why a file could not be written; None if an error has another cause.

    The system's error may be the cause of a library's own. Polars only quotes its number in the
    text.
    """
    cause: BaseException | None = error
    while cause is not None:
        # a folder above the file, if not the file itself; a library may name none
        if isinstance(cause, OSError) and str(temporary).startswith(cause.filename or ""):
            return cause.strerror or str(cause)
        number = re.search(r"\(os error (\d+)\)", str(cause))
        if number:
            return os.strerror(int(number[1]))
        cause = cause.__cause__ or cause.__context__
    return None


def write_text(path: Path, text: str) -> None:
    """Write a file of text in UTF-8, with the same bytes on every system. Raises as
    `atomic_path`."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def seen_from(folder: Path, path: Path) -> Path:
    """A path relative to a folder; on another drive of Windows, where there is none, from the
    root."""
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve()))
    except ValueError:
        return path.resolve()


def check_target(path: Path) -> None:
    """Refuse to replace anything but a regular file. Renaming onto `/dev/null` would delete it for
    everybody."""
    check_name(path)
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is a folder or a device", "name a file")


def check_name(path: Path) -> None:
    """Refuse a name that is not UTF-8, which the libraries that write tables do not take."""
    try:
        str(path).encode()
    except UnicodeEncodeError as error:
        raise InputError(f"{path}: its name is not UTF-8", "choose another name") from error


def temporary_path(path: Path, pid: int) -> Path:
    """The temporary file that process `pid` writes and then renames to `path`."""
    return path.with_name(f".{path.stem}.{pid}{path.suffix}")


def digest(path: Path) -> str | None:
    """SHA-256 of a file; None if there is no such file, or it cannot be read."""
    with suppress(OSError), path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
    return None


DISTRIBUTION = "osl-impedance"
"""What `pip` calls this package: on the package index `osl-analysis` is another project's."""

PACKAGE = Path(__file__).parents[1]
IN_PACKAGE = PACKAGE / "shipped"
ROOT = IN_PACKAGE if IN_PACKAGE.is_dir() else PACKAGE.parent
"""The folder of the shipped files: in an installed package, else in the repository."""


@cache
def package_yaml(path: Path) -> dict[str, Any]:
    """A YAML file of this package, by the reader in C: every process reads them, a fifth of a
    second by the other."""
    import yaml

    content: dict[str, Any] = yaml.load(path.read_bytes(), yaml.CSafeLoader)
    return content


def shipped(path: Path | str) -> Path:
    """The path itself if it exists, seen from the working folder; else the shipped file or folder
    of this name.

    If neither exists, the path itself: the message about the missing file then names it.
    """
    local_path = Path(path)
    shipped_path = ROOT / path
    if not local_path.exists() and shipped_path.exists():
        return shipped_path
    return local_path


# the configuration in the folder of a campaign, as `osl-analysis init` writes it
CAMPAIGN = Path("config.yaml")


def default_config() -> Path:
    """The default configuration, which a campaign's own overrides: that of a clone in the working
    folder, which may have been edited, else the shipped one, as beside another workflow's."""
    here = Path("config/config.yaml")
    is_clone = here.is_file() and Path(PACKAGE.name).is_dir()
    return here if is_clone else ROOT / here
