"""MATLAB files of version 7.3, which are HDF5, read by h5py.

MATLAB writes arrays transposed, text as 16-bit numbers, and the elements of cells and of struct arrays as references.
The attribute `MATLAB_class` says what a dataset or group is.
"""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.formats.mat.limits import DEEPEST, REMEDY, MatBudget
from osl_analysis.formats.mat.values import NUMBERS, Value
from osl_analysis.trial import Array

OPAQUE = "MATLAB_object_decode"
"""Attribute of what only MATLAB can read, such as tables."""
HIDDEN = ("#refs#", "#subsystem#")
"""Groups of the file that are no variables."""
LONGEST_TEXT = 1000
"""Characters of a text that are read, for a name by which an element is chosen."""
DAMAGED = "copy the file again, or save it again in MATLAB"


def read_version73(path: Path, file_bytes: int, wanted: str | None = None) -> dict[str, Value]:
    """The variables of a file, or the `wanted` one alone. Numbers are read when they are asked for.

    Raises
    ------
    InputError
        The file is damaged, or holds too much or too deep.
    """
    try:
        with h5py.File(path, "r") as file:
            reader = Reader(path, MatBudget(file_bytes))
            names = [name for name in file if name not in HIDDEN and wanted in (None, name)]
            return {name: reader.member(file, name, 0) for name in names}
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        if isinstance(error, InputError):
            raise
        reason = " ".join(str(error).split())
        raise InputError(f"cannot be read ({type(error).__name__}: {reason}); {DAMAGED}") from error


def variable_names73(path: Path) -> list[str]:
    """Names of the variables; raises as `read_version73`."""
    try:
        with h5py.File(path, "r") as file:
            return [name for name in file if name not in HIDDEN]
    except (OSError, RuntimeError) as error:
        raise InputError(f"cannot be read ({' '.join(str(error).split())}); {DAMAGED}") from error


class Reader:
    """Reads the tree of one open file within a budget."""

    def __init__(self, path: Path, budget: MatBudget) -> None:
        """The file, and what may still be taken from it."""
        self.path, self.budget = path, budget

    def member(self, group: h5py.Group, name: str, depth: int) -> Value:
        """One member of a group. A link to another place or file is not followed."""
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            return Value("link")
        return self.value(group[name], depth)

    def value(self, item: Any, depth: int) -> Value:
        """A dataset or a group as a value."""
        self.budget.take_elements(1)
        if depth > DEEPEST:
            raise InputError(f"holds structs more than {DEEPEST} deep; {REMEDY}")
        kind = text_of(item.attrs.get("MATLAB_class", ""))
        if OPAQUE in item.attrs:
            return Value(kind or "object")
        if isinstance(item, h5py.Group):
            return Value("sparse") if "MATLAB_sparse" in item.attrs else self.struct(item, depth)
        if "MATLAB_empty" in item.attrs:
            shape = tuple(int(size) for size in np.ravel(item[()])) if item.size <= DEEPEST else (0, 0)
            return Value(kind or "double", shape, load=lambda: np.zeros(shape) if 0 in shape else np.zeros((0, 0)))
        if holds_references(item):
            cells = [self.value(item.file[reference], depth + 1) for reference in self.references(item)]
            return Value("cell", tuple(reversed(item.shape)), cells=cells)
        return self.numbers(item, kind)

    def references(self, dataset: h5py.Dataset) -> list[Any]:
        """The references of a dataset in MATLAB's order."""
        self.budget.take_elements(dataset.size)
        self.check_inside(dataset)
        return list(np.ravel(dataset[()]))

    def struct(self, group: h5py.Group, depth: int) -> Value:
        """A group as a struct; members that are all datasets of references without a class make it an array."""
        fields = tuple(group)
        shapes = {shape_of_array(group, name) for name in fields}
        if len(shapes) != 1 or None in shapes:
            elements = [{name: self.member(group, name, depth + 1) for name in fields}]
            return Value("struct", (1, 1), fields=fields, elements=elements)
        (shape,) = shapes
        columns = [[self.value(group.file[one], depth + 1) for one in self.references(group[name])] for name in fields]
        rows = [dict(zip(fields, row, strict=True)) for row in zip(*columns, strict=True)]
        return Value("struct", tuple(reversed(shape or ())), fields=fields, elements=rows)

    def numbers(self, dataset: h5py.Dataset, kind: str) -> Value:
        """A dataset of numbers or characters."""
        shape = tuple(reversed(dataset.shape)) or (1, 1)
        if kind == "char":
            short = dataset.size <= LONGEST_TEXT and dataset.dtype.kind == "u" and 1 in shape
            text = "".join(map(chr, np.ravel(dataset[()]))) if short else ""
            return Value("char", shape, text=text)
        if dataset.dtype.names == ("real", "imag"):
            return Value(kind or "double", shape, is_complex=True)
        if dataset.dtype.kind not in "fiub":
            return Value(kind or "object", shape)
        self.check_inside(dataset)
        name = dataset.name
        return Value(kind if kind in NUMBERS else "double", shape, load=lambda: self.load(name))

    def load(self, name: str) -> Array:
        """The numbers of the dataset at a place in the file, in MATLAB's shape."""
        try:
            with h5py.File(self.path, "r") as file:
                self.budget.take_bytes(f"'{name}'", int(file[name].nbytes))
                raw: NDArray[Any] = np.atleast_2d(file[name][()])
        except (OSError, RuntimeError) as error:
            reason = " ".join(str(error).split())
            raise InputError(f"{self.path}: '{name}' cannot be read ({reason}); {DAMAGED}") from error
        return np.asarray(raw.T, dtype=np.float64)

    def check_inside(self, dataset: h5py.Dataset) -> None:
        """Refuse a dataset whose numbers stand in another file."""
        if dataset.external or dataset.is_virtual:
            raise InputError(f"the numbers of '{dataset.name}' stand in another file; save them in this one")


def holds_references(dataset: h5py.Dataset) -> bool:
    """Whether a dataset holds references to others; texts of any length have the same type for numpy."""
    return h5py.check_ref_dtype(dataset.dtype) is h5py.Reference


def shape_of_array(group: h5py.Group, name: str) -> tuple[int, ...] | None:
    """Shape of the array of structs of which a dataset holds one field of all elements; None if it is no such field."""
    if not isinstance(group.get(name, getlink=True), h5py.HardLink):
        return None
    item = group[name]
    if isinstance(item, h5py.Dataset) and holds_references(item) and "MATLAB_class" not in item.attrs:
        return tuple(item.shape)
    return None


def text_of(attribute: Any) -> str:
    """An attribute as text."""
    return attribute.decode("latin-1") if isinstance(attribute, bytes) else str(attribute)
