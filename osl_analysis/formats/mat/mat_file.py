"""A MATLAB file of version 5 or 7.3: the names of its variables, and their values when they are asked for."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from osl_analysis.errors import InputError
from osl_analysis.formats.mat.values import Value
from osl_analysis.formats.mat.version5 import read_version5, variable_classes

MARK5, MARK73 = b"MATLAB 5.0 MAT", b"MATLAB 7."


def is_mat(begin: bytes) -> bool:
    """Whether a file that begins with these bytes is a MATLAB file of version 5 or 7.3."""
    return begin.startswith((MARK5, MARK73)) and b"\0" in begin[:128]


@dataclass(frozen=True)
class MatFile:
    """An open-ended view on a MATLAB file; every refusal names the file."""

    path: Path
    """The file."""
    data: bytes
    """Its bytes, for version 5; the header alone for version 7.3."""
    size: int
    """Its number of bytes."""

    @property
    def version(self) -> str:
        """Version of the format."""
        return "7.3" if self.data.startswith(MARK73) else "5"

    @property
    def header(self) -> str:
        """What MATLAB wrote about itself."""
        return self.data[:116].split(b"\0")[0].decode("latin-1").strip()

    @property
    def names(self) -> list[str]:
        """Names of the variables, in the order of the file; raises as `classes`."""
        return list(self.classes)

    @cached_property
    def classes(self) -> Mapping[str, str]:
        """The variables in the order of the file: name -> class of one that only MATLAB can read; else empty.

        Raises
        ------
        InputError
            The file is damaged, or would unpack to too much.
        """
        try:
            return self._names73() if self.version == "7.3" else variable_classes(self.data)
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from error

    def read(self, wanted: Collection[str]) -> Mapping[str, Value]:
        """The wanted variables; raises as `names`."""
        known = [name for name in self.names if name in wanted]
        try:
            if self.version == "7.3":
                return self._read73(known)
            objects = {name: Value(self.classes[name]) for name in known if self.classes[name]}
            return objects | read_version5(self.data, [name for name in known if name not in objects])
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from error

    def _names73(self) -> Mapping[str, str]:
        """The names in a file of version 7.3, which tells the classes when the variables are read."""
        return dict.fromkeys(version73().variable_names73(self.path), "")

    def _read73(self, known: list[str]) -> Mapping[str, Value]:
        """The variables of a file of version 7.3."""
        found: dict[str, Value] = {}
        for name in known:
            found |= version73().read_version73(self.path, self.size, name)
        return found


def version73() -> Any:
    """The reader of version 7.3, whose library is an optional extra and takes a fifth of a second to import.

    Raises
    ------
    InputError
        The library is not installed.
    """
    try:
        from osl_analysis.formats.mat import version73 as reader
    except ModuleNotFoundError as error:
        if error.name != "h5py":
            raise
        raise InputError(
            "a MATLAB file of version 7.3 needs h5py, which is not installed; pip install 'osl-analysis[mat73]', or "
            "save the file with `-v7`"
        ) from error
    return reader


def open_mat(path: Path) -> MatFile:
    """The MATLAB file at a path. Of version 7.3, whose variables are read one by one, the header alone is read.

    Raises
    ------
    InputError
        It is of another version, or no MATLAB file.
    """
    with path.open("rb") as file:
        begin = file.read(128)
        data = begin if begin.startswith(MARK73) else begin + file.read()
    if not is_mat(begin):
        raise InputError(f"{path}: no MATLAB file of version 5 or 7.3; save it again in MATLAB with `-v7`")
    return MatFile(path, data, path.stat().st_size)
