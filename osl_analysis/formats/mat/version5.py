"""MATLAB files of version 5: their sizes are checked here, then scipy reads them.

scipy allocates what a file declares before it looks whether the file has it. So every declared size is compared with
the bytes that are there, and compressed variables are unpacked within the limits of `limits.py`, before scipy reads.
The layout is MathWorks' "MAT-File Format" (R2023a), chapter 1.
"""

import io
import struct
import zlib
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing
from osl_analysis.formats.mat.limits import DEEPEST, REMEDY, MatBudget
from osl_analysis.formats.mat.values import Value

HEADER = 128
"""Bytes before the first variable."""
MATRIX, COMPRESSED = 14, 15
ITEM_BYTES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8, 16: 1, 17: 2, 18: 4}
"""Bytes of one number of each type that a file may hold."""
CELL, STRUCT, OBJECT, CHAR, SPARSE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17
NUMERIC = range(6, 16)
COMPLEX = 0x800
SMALLEST_MATRIX = 8
"""Bytes of an empty array, which is a tag without content."""
MOST_BLANKS = 1000
"""Largest number of characters that a file may declare without holding them. MATLAB writes some texts so."""
DAMAGED = "copy the file again, or save it again in MATLAB"


class Structure:
    """The structure of one variable, whose declared sizes are compared with its bytes."""

    def __init__(self, data: bytes | memoryview, order: str, budget: MatBudget) -> None:
        """The bytes of a whole matrix element without its tag; `order` is `<` or `>`."""
        self.data, self.order, self.budget = memoryview(data), order, budget
        self.object_class = ""
        """Class of the variable itself, if it is an object, such as `table`."""

    def part(self, at: int, stop: int) -> tuple[int, int, int, int]:
        """Type, first byte and number of bytes of the part at byte `at`, and where the next one begins."""
        if at + 8 > stop:
            raise InputError(f"ends within a variable; {DAMAGED}")
        kind, size = struct.unpack_from(f"{self.order}II", self.data, at)
        start, small = at + 8, kind >> 16
        if small:  # up to four bytes stand in the tag itself
            kind, size, start = kind & 0xFFFF, small, at + 4
        if start + size > stop or small > 4:
            raise InputError(f"declares {size} bytes where {stop - start} are left; {DAMAGED}")
        after = at + 8 if small else start + size + (-size % 8 if kind != COMPRESSED else 0)
        return kind, start, size, min(after, stop)

    def integers(self, at: int, stop: int) -> tuple[tuple[int, ...], int]:
        """A part of 32-bit integers, and where the next part begins."""
        _, start, size, after = self.part(at, stop)
        return struct.unpack_from(f"{self.order}{size // 4}i", self.data, start), after

    def check_matrix(self, at: int, stop: int, depth: int = 0) -> str:
        """The name of the matrix whose content lies from byte `at` to `stop`, after a check of all that it declares.

        Raises
        ------
        InputError
            It declares more than it holds, or holds too much or too deep.
        """
        self.budget.take_elements(1)
        if at == stop:
            return ""
        if depth > DEEPEST:
            raise InputError(f"holds structs more than {DEEPEST} deep; {REMEDY}")
        flags, at = self.integers(at, stop)
        kind = flags[0] & 0xFF if flags else 0
        if kind == OPAQUE:
            return self.check_opaque(at, stop, depth)
        dimensions, at = self.integers(at, stop)
        _, start, size, at = self.part(at, stop)
        name = bytes(self.data[start : start + size]).decode("latin-1")
        if len(dimensions) not in range(2, 33) or min(dimensions) < 0:
            raise InputError(f"variable '{name}' has an impossible size {list(dimensions)}; {DAMAGED}")
        count = int(np.prod(np.array(dimensions, dtype=object)))
        if kind in NUMERIC or kind == CHAR:
            self.check_numbers(at, stop, count, 2 if flags[0] & COMPLEX else 1, exact=kind != CHAR)
        elif kind == SPARSE:
            self.check_numbers(self.part(at, stop)[3], stop, dimensions[1] + 1, 1, exact=False)
        elif kind in (CELL, STRUCT, OBJECT, FUNCTION):
            self.check_children(at, stop, (kind, count, depth))
        else:
            raise InputError(f"variable '{name}' is of an unknown class {kind}; {DAMAGED}")
        return name

    def check_opaque(self, at: int, stop: int, depth: int) -> str:
        """An object of a class: three names, of which the first is the variable's, and a matrix."""
        names = []
        for _ in range(3):
            _, start, size, at = self.part(at, stop)
            names.append(bytes(self.data[start : start + size]).decode("latin-1"))
        self.check_child(at, stop, depth)
        self.object_class = names[2] or "object" if depth == 0 else self.object_class
        return names[0]

    def check_numbers(self, at: int, stop: int, count: int, parts: int, exact: bool) -> None:
        """The real part, or both, of `count` numbers. Characters may take several bytes, and blanks none."""
        for _ in range(parts):
            kind, _, size, at = self.part(at, stop)
            there = size // ITEM_BYTES.get(kind, 8)
            if not (exact or size) and count <= MOST_BLANKS:
                continue
            if there < count or (exact and there > count):
                raise InputError(f"declares {count} numbers where {there} are; {DAMAGED}")

    def check_children(self, at: int, stop: int, matrix: tuple[int, int, int]) -> None:
        """The cells of a cell, the fields of a struct or object, or what a function handle holds.

        `matrix` is its class, the number of its elements, and its depth.
        """
        kind, count, depth = matrix
        fields = 1
        if kind == FUNCTION:
            count = 1
        if kind == OBJECT:
            at = self.part(at, stop)[3]
        if kind in (STRUCT, OBJECT):
            (length, *_), at = self.integers(at, stop)
            _, _, size, at = self.part(at, stop)
            fields = size // length if length > 0 else 0
        self.budget.take_elements(count)
        if count * fields * SMALLEST_MATRIX > stop - at:
            raise InputError(f"declares {count * fields} arrays in {stop - at} bytes; {DAMAGED}")
        for _ in range(count * fields):
            at = self.check_child(at, stop, depth)

    def check_child(self, at: int, stop: int, depth: int) -> int:
        """A matrix inside another one; where the next one begins."""
        kind, start, size, after = self.part(at, stop)
        if kind != MATRIX:
            raise InputError(f"holds a part of type {kind} where an array is expected; {DAMAGED}")
        self.check_matrix(start, start + size, depth + 1)
        return after


def variable_classes(data: bytes) -> dict[str, str]:
    """The variables of a file, in its order, after a check of all declared sizes: name -> class of an object, or empty.

    Raises
    ------
    InputError
        A size is wrong, the file is truncated, or it would unpack to too much.
    """
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise InputError(f"the header of a MATLAB file is damaged at byte 126; {DAMAGED}")
    found, at, budget = dict[str, str](), HEADER, MatBudget(len(data))
    outer = Structure(data, order, budget)
    while at < len(data):
        kind, start, size, at = outer.part(at, len(data))
        content: bytes | memoryview = outer.data[start : start + size]
        if kind == COMPRESSED:
            content = unpacked(content, order, budget, start)
        elif kind != MATRIX:
            raise InputError(f"holds a part of type {kind} at byte {start} where a variable is expected; {DAMAGED}")
        structure = Structure(content, order, budget)
        name = structure.check_matrix(0, len(content))
        if name and name in found:
            raise InputError(f"variable '{name}' stands twice in the file; {DAMAGED}")
        found[name] = structure.object_class
    return {name: kind for name, kind in found.items() if name}


def unpacked(packed: bytes | memoryview, order: str, budget: MatBudget, at: int) -> bytes:
    """The content of a compressed variable at byte `at` of the file, without its tag; raises as `variable_classes`."""
    stream = zlib.decompressobj()
    try:
        tag = stream.decompress(packed, 8)
        kind, size = struct.unpack(f"{order}II", tag)
        budget.take_bytes(f"the variable at byte {at}", size)
        content = stream.decompress(stream.unconsumed_tail, size) if size else b""
    except (zlib.error, struct.error) as error:
        raise InputError(f"the compressed variable at byte {at} is damaged ({error}); {DAMAGED}") from error
    if kind != MATRIX or len(content) < size:
        raise InputError(f"the compressed variable at byte {at} is damaged ({len(content)} of {size} bytes); {DAMAGED}")
    return content


def read_version5(data: bytes, wanted: Sequence[str]) -> dict[str, Value]:
    """The wanted variables of a file whose sizes were checked.

    Raises
    ------
    InputError
        scipy cannot read one.
    """
    from scipy.io import loadmat  # half a second, which other commands need not wait for

    try:
        stream: Any = io.BytesIO(data)
        raw = loadmat(stream, variable_names=list(wanted), spmatrix=False)
    except Exception as error:  # on a damaged file scipy raises whatever its parser comes across
        raise InputError(f"{listing(wanted, 4)} cannot be read ({type(error).__name__}: {error}); {DAMAGED}") from error
    return {name: value_of(raw[name]) for name in wanted if name in raw}


def value_of(raw: Any) -> Value:
    """A value as scipy gives it."""
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque
    from scipy.sparse import issparse

    if raw is None:  # an element of a struct without fields
        return Value("struct")
    if isinstance(raw, MatlabOpaque):
        return Value(bytes(raw.flat[0]["s2"]).decode("latin-1") or "object")
    if isinstance(raw, MatlabFunction):
        return Value("function_handle")
    if issparse(raw):
        return Value("sparse")
    if isinstance(raw, MatlabObject):
        return Value(str(raw.classname), raw.shape)
    array: NDArray[Any] = np.asarray(raw)
    if array.dtype.names is not None:
        elements = [{name: value_of(one[name]) for name in array.dtype.names} for one in in_order(array)]
        return Value("struct", array.shape, fields=array.dtype.names, elements=elements)
    if array.dtype == object:
        return Value("cell", array.shape, cells=[value_of(one) for one in in_order(array)])
    if array.dtype.kind == "U":
        rows = array.ravel().tolist()
        width = max((len(row) for row in rows), default=0)
        return Value("char", (len(rows), width), text=rows[0] if len(rows) == 1 else "")
    return numbers_value(array)


def in_order(array: NDArray[Any]) -> Iterator[Any]:
    """The elements of an array in MATLAB's order, column by column."""
    return iter(array.ravel(order="F"))


def numbers_value(array: NDArray[Any]) -> Value:
    """Real or complex numbers, or truth values."""
    names = {"float64": "double", "float32": "single", "bool": "logical", "complex128": "double", "complex64": "single"}
    kind, complex_ = names.get(array.dtype.name, array.dtype.name), array.dtype.kind == "c"
    load = None if complex_ else lambda: np.asarray(array, dtype=np.float64)
    return Value(kind, array.shape, complex_, load)
