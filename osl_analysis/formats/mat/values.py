"""What a variable of a MATLAB file is: numbers, text, structs, cells, and what no library reads."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from osl_analysis.errors import InputError, listing
from osl_analysis.trial import Array

NUMBERS = ("double", "single", "logical", *(f"{u}int{bits}" for u in ("", "u") for bits in (8, 16, 32, 64)))
"""Classes of MATLAB that hold numbers."""
REMEDIES = {
    "table": "save it as a struct: `s = table2struct(t, 'ToScalar', true)`",
    "timetable": "save it as a struct: `s = table2struct(timetable2table(t), 'ToScalar', true)`, its times as seconds",
    "string": "save it as numbers, or as text with `char(s)`",
    "datetime": "save it as numbers: `seconds(t - t(1))`",
    "duration": "save it as numbers: `seconds(t)`",
    "categorical": "save it as numbers: `double(c)`",
    "function_handle": "save the numbers that it gives",
    "sparse": "save it as `full(x)`",
    "char": "save it as numbers: `str2double(x)`",
    "timeseries": "save its `Time` and `Data` as numbers",
}
"""What to do in MATLAB about a class that is not read, or is no number."""
OBJECT = "save its numbers in a struct"
"""The same for any other class."""


@dataclass(frozen=True)
class Value:
    """One value of a MATLAB file."""

    kind: str
    """Its class in MATLAB, such as `double`, `struct`, `cell`, `table`; `sparse` for a sparse matrix."""
    shape: tuple[int, ...] = (1, 1)
    """Its size in MATLAB."""
    is_complex: bool = False
    """Whether its numbers are complex."""
    load: Callable[[], Array] | None = None
    """Reads its numbers, of its shape; None for anything but real numbers."""
    text: str = ""
    """Its text, for one row of characters."""
    fields: tuple[str, ...] = ()
    """Names of the fields of a struct."""
    elements: Sequence[Mapping[str, "Value"]] = field(default=())
    """Fields of each element of a struct, in MATLAB's order."""
    cells: Sequence["Value"] = field(default=())
    """Elements of a cell, in MATLAB's order."""

    @property
    def size(self) -> int:
        """Number of elements."""
        return int(np.prod(self.shape, dtype=np.int64)) if self.shape else 1

    def described(self) -> str:
        """Size and class for messages, as `12000x1 double`."""
        return f"{'x'.join(map(str, self.shape))} {'complex ' if self.is_complex else ''}{self.kind}"

    def remedy(self) -> str:
        """What to do in MATLAB where this stands in place of real numbers."""
        return "save `real(x)`" if self.is_complex else REMEDIES.get(self.kind, OBJECT)


def real_numbers(place: str, value: Value) -> Array:
    """The real numbers of a value, of its shape; `place` is for messages.

    Raises
    ------
    InputError
        It is empty, or something else than real numbers.
    """
    if value.kind == "struct":
        inside = f"name one of its fields ({listing(value.fields, 8)})"
        raise InputError(f"{place} is a {value.described()}, not numbers; {inside}")
    if value.kind == "cell":
        raise InputError(f"{place} is a {value.described()}, not numbers; name one of its cells, as `{{1}}`")
    if value.load is None:
        raise InputError(f"{place} is a {value.described()}, not real numbers; {value.remedy()}")
    if not value.size:
        raise InputError(f"{place} is empty ({value.described()}); name another variable, or record the trial again")
    return value.load()
