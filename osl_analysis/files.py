"""Results are written completely or not at all: write to a temporary file beside the target, then rename it."""

import hashlib
import os
import re
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from osl_analysis.errors import InputError, WriteError


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a path beside `path`, with the same suffix, that becomes `path` when the block succeeds, closed. When the
    block raises, what it wrote is deleted and an older `path` stays. Raises as `check_target`, and WriteError where its
    folder cannot be made, or the disk is full or fails."""
    check_target(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WriteError(f"{path}: cannot be written ({error.strerror}); choose another place") from error
    temporary = temporary_path(path, os.getpid())
    try:
        yield temporary
        temporary.replace(path)
    except Exception as error:
        # libraries raise theirs after the system's; Polars has an error of its own, with the number in its text
        cause: BaseException | None = error
        while cause is not None:
            reason, number = None, re.search(r"\(os error (\d+)\)", str(cause))
            if isinstance(cause, OSError) and cause.filename in (None, str(temporary)):
                reason = cause.strerror or " ".join(str(cause).split())
            elif number:
                reason = os.strerror(int(number[1]))
            if reason is not None:
                said = f"{path}: cannot be written ({reason}); make room, or choose another place"
                raise WriteError(said) from error
            cause = cause.__cause__ or cause.__context__
        raise
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a file of text in UTF-8. Raises as `atomic_path`."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def check_working_folder(results: Path = Path(".snakemake")) -> None:
    """Refuse folders in which a run cannot write results or Snakemake its notes: it would end with a traceback."""
    for folder in (Path(), *(one for top in {Path(".snakemake"), results} for one in (top, *top.glob("*/")))):
        if folder.is_dir() and not os.access(folder, os.W_OK):
            raise InputError(f"{folder.absolute()}: cannot be written to; make it writable, or copy the campaign")
    if (disk := os.statvfs(results if results.is_dir() else Path())).f_blocks and disk.f_bavail * disk.f_frsize < 10e6:
        raise InputError(f"{results.absolute()}: less than 10 MB free on its disk; make room, or work on another one")


def check_target(path: Path) -> None:
    """Refuse to replace anything but a regular file: a renamed file would delete a device for all of the machine."""
    try:
        str(path).encode()
    except UnicodeEncodeError as error:  # the libraries that write tables take text alone
        raise InputError(f"{path}: its name is not UTF-8; choose another name") from error
    kind = stat.S_IFREG
    with suppress(OSError):  # it does not exist, or making it will say why not
        kind = stat.S_IFMT(path.stat().st_mode)
    if kind != stat.S_IFREG:
        special = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a named pipe", stat.S_IFSOCK: "a socket"}
        raise InputError(f"{path}: is {special.get(kind, 'a device')}; name a file")


def check_output(path: Path) -> None:
    """Refuse an output that cannot be written, before anything is computed for it. Nothing is left behind."""
    check_target(path)
    folder = next(parent for parent in (*path.parents, Path()) if os.path.lexists(parent))
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        reason = f"no file can be made in {folder} ({error.strerror})"
        raise InputError(f"{path}: cannot be written, because {reason}; choose another place") from error


def temporary_path(path: Path, pid: int) -> Path:
    """The file that process `pid` writes before it becomes `path`."""
    return path.with_name(f".{path.stem}.{pid}{path.suffix}")


def file_state(path: Path) -> list[int] | None:
    """Size [bytes], date of the last change [ns] and whether it may be read (0 or 1); None if there is no such file."""
    with suppress(OSError):
        found = path.stat()
        return [found.st_size, found.st_mtime_ns, int(os.access(path, os.R_OK))]
    return None


def digest(path: Path) -> str | None:
    """SHA-256 of a file; None if there is no such file, or it cannot be read."""
    with suppress(OSError), path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
    return None


PACKAGE = Path(__file__).parent


def root() -> Path:
    """The folder of the shipped files."""
    return PACKAGE / "shipped" if (PACKAGE / "shipped").is_dir() else PACKAGE.parent


def shipped(path: Path | str) -> Path:
    """A path as it is if it is there, seen from the working folder; else the shipped file or folder of this name. One
    that is neither stays as it is, for the message that it is missing."""
    own, theirs = Path(path), root() / path
    return theirs if not own.exists() and theirs.exists() else own


CAMPAIGN = Path("config.yaml")  # The configuration in the folder of a campaign, as `osl-analysis init` writes it.


def config_here() -> Path:
    """The configuration of the campaign in the working folder; the default one where there is none."""
    return CAMPAIGN if CAMPAIGN.is_file() else default_config()


def default_config() -> Path:
    """The default configuration, which a campaign's own overrides."""
    return shipped("config/config.yaml")
