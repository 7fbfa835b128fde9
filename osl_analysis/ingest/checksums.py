"""`SHA256SUMS` beside the recordings: what each file held when the list was made.

The list is that of `sha256sum`, which also checks it: `sha256sum -c SHA256SUMS`. It is exact, where
a look at the numbers only tells that some are odd."""

import hashlib
import re
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.files import write_text

SUMS = "SHA256SUMS"
LINE = re.compile(r"([0-9a-fA-F]{64}) [ *](.+)")


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_sums(path: Path, digest: str, top: Path) -> list[str]:
    """Hold a file against the list in its folder or in one above it.

    Parameters
    ----------
    digest
        The file's SHA-256.
    top
        The uppermost folder in which a list counts.

    Returns
    -------
    list
        A remark if there is a list and the file is not in it.

    Raises
    ------
    InputError
        The list has another SHA-256 for the file.
    """
    for folder in folders_between(path, top):
        listed = sums_in(folder)
        if listed is None:
            continue
        name = path.relative_to(folder).as_posix()
        if name not in listed:
            return [f"{name} is not listed in {folder / SUMS}: nothing tells if it was changed"]
        if listed[name] != digest:
            raise InputError(
                f"{path}: changed since {folder / SUMS} was written (SHA-256 {digest[:12]}..., the"
                f" list has {listed[name][:12]}...); copy the file again, or, if it was changed on"
                " purpose, write its line anew with `sha256sum`"
            )
        return []
    return []


def folders_between(path: Path, top: Path) -> Iterator[Path]:
    """The folders from that of a file up to `top`; that of the file alone where it is elsewhere."""
    folders = [path.parent, *path.parent.parents]
    if top not in folders:
        yield path.parent
        return
    for folder in folders:
        yield folder
        if folder == top:
            return


def sums_in(folder: Path) -> dict[str, str] | None:
    """SHA-256 by file name, of a folder's list; None without a list."""
    path = folder / SUMS
    if not path.is_file():
        return None
    return read_sums(path, path.stat().st_mtime_ns)


@lru_cache(16)
def read_sums(path: Path, changed_ns: int) -> dict[str, str]:
    """SHA-256 by file name; `changed_ns` makes a list that changed be read again.

    Raises
    ------
    InputError
        A line is not of such a list.
    """
    listed: dict[str, str] = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        found = LINE.fullmatch(line)
        if found is None and line.strip():
            raise InputError(
                f"{path}: line {number} is not a SHA-256 and the name of a file; write the list"
                f" anew, as with `sha256sum FILES > {SUMS}`"
            )
        if found is not None:
            listed[found[2].removeprefix("./")] = found[1].lower()
    return listed


def write_sums(folder: Path, files: Iterable[Path]) -> Path:
    """Write the list of some files of a folder, which has none yet.

    Raises
    ------
    InputError
        There is a list: it tells more than one that is made now.
    """
    path = folder / SUMS
    if path.exists():
        raise InputError(f"{path}: exists, and is kept; check it with `sha256sum -c {SUMS}`")
    lines = [f"{sha256_of(file)}  {file.relative_to(folder).as_posix()}\n" for file in files]
    write_text(path, "".join(lines))
    return path
