"""Values in MATLAB files, and addresses of numbers in them.

An address is written as in MATLAB: `Test.Slow(2).data(:,3)`, `runs{2}.torque`.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing, nearest

REMEDIES = {
    "string": "save it as numbers, or as text with `char(s)`",
    "sparse": "save it as `full(x)`",
    "char": "save it as numbers: `str2double(x)`",
    "timeseries": "save its numbers: `t = x.Time; y = x.Data; save('x.mat', 't', 'y', '-v7')`",
    "Dataset": (
        "save its numbers: `s = x{1}.Values; t = s.Time; y = s.Data; save('x.mat', 't', 'y',"
        " '-v7')`"
    ),
}
"""What to do in MATLAB about a class that is not read, or is no number."""
FEWEST_SAMPLES = 10  # of a signal, or structs of single numbers that are samples of a recording
STEP = re.compile(r"\.?[A-Za-z]\w*|\{N\}|\((?:N|:,N|N,:)\)".replace("N", r"[1-9]\d{0,8}"))


@dataclass(frozen=True)
class Value:
    """A value of any class.

    Attributes
    ----------
    kind
        Its class in MATLAB, such as `double`, `struct`, `cell`, `nldat`.
    numbers
        Of its shape; None for anything but real numbers.
    text
        For one row of characters.
    elements
        Fields of each element of a struct or object, in MATLAB's order.
    cells
        Elements of a cell, in MATLAB's order.
    unit
        Of its numbers, where a table states it; `s` of times.
    """

    kind: str
    shape: tuple[int, ...] = (1, 1)
    numbers: NDArray[Any] | None = None
    text: str = ""
    elements: Sequence[Mapping[str, "Value"]] = ()
    cells: Sequence["Value"] = ()
    unit: str = ""

    @property
    def fields(self) -> list[str]:
        """Names of the fields of its first element."""
        return [*self.elements[0]] if self.elements else []

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)

    def described(self) -> str:
        """Size and class for messages, as `12000x1 double`."""
        return f"{'x'.join(map(str, self.shape))} {self.kind}"

    def remedy(self) -> str:
        """What to do in MATLAB where it is no real number."""
        if self.kind.startswith("complex"):
            return "save `real(x)`"
        return REMEDIES.get(self.kind.rpartition(".")[2], "save its numbers in a struct")


# values as mat-io gives them ----------------------------------------------------------------


def value_of(raw: Any) -> Value:
    """Describe a value as mat-io gives it: arrays of numpy, and objects of its own."""
    from scipy.sparse import issparse

    if raw is None:  # an element of a struct without fields
        return Value("struct")
    if hasattr(raw, "properties"):
        # of no known release
        with suppress(AttributeError, LookupError, ValueError):
            return _object_of(raw.classname, raw.properties)
        return Value(raw.classname or "object")
    if type(raw).__name__ == "MatlabFunction":
        return Value("function_handle")
    if issparse(raw):
        return Value("sparse")
    array: NDArray[Any] = np.atleast_2d(np.asarray(raw))
    class_name = getattr(raw, "classname", "")
    if array.dtype.names is not None:
        elements = [
            {name: value_of(element[name]) for name in array.dtype.names}
            for element in array.ravel(order="F")
        ]
        columns = _columns_of_samples(elements)
        if columns:
            return Value(class_name or "struct", elements=[columns])
        return Value(class_name or "struct", array.shape, elements=elements)
    if array.dtype == object:
        cells = [value_of(element) for element in array.ravel(order="F")]
        if class_name:  # an array of objects
            elements = [dict(*cell.elements) for cell in cells]
            return Value(class_name, array.shape, elements=elements)
        return Value("cell", array.shape, cells=cells)
    return _array_of(array)


def _array_of(array: NDArray[Any]) -> Value:
    if array.dtype.kind == "U":
        rows = array.ravel().tolist()
        width = max((len(row) for row in rows), default=0)
        text = rows[0].replace("\0", "") if len(rows) == 1 else ""
        return Value("char", (len(rows), width), text=text)
    kinds = {"float64": "double", "float32": "single", "bool": "logical"}
    if array.dtype.kind == "c":
        kind = "single" if array.dtype.name == "complex64" else "double"
        return Value(f"complex {kind}", array.shape)
    kind = kinds.get(array.dtype.name, array.dtype.name)
    if array.dtype.kind not in "biuf":
        return Value(kind if array.dtype.kind not in "OV" else "object", array.shape)
    return Value(kind, array.shape, array)


def _object_of(kind: str, properties: Mapping[str, Any]) -> Value:
    """An object of a class by what is stored of it.

    Times are in s (those of a `datetime` since 1970, in UTC if it has a zone), tables structs of
    their columns, by the names that MATLAB makes valid, others structs of their properties.
    """
    if kind in ("duration", "datetime"):
        # in ms; the imaginary part is what the real one lost by rounding
        stored = np.atleast_2d(properties["millis" if kind == "duration" else "data"])
        return Value(kind, stored.shape, (stored.real + stored.imag) / 1e3, unit="s")
    if kind == "string":  # version, number of dimensions, these, lengths, text
        return Value(kind, tuple(np.ravel(properties["any"])[2:4].tolist()))
    fields = {name: value_of(stored_property) for name, stored_property in properties.items()}
    if kind == "timetable":
        return Value(kind, elements=[_timetable_of(fields["any"].elements[0])])
    if kind == "table":
        inside = {**fields["props"].elements[0], **fields}
        names = [cell.text for cell in inside["varnames"].cells]
        units = [cell.text for cell in inside["VariableUnits"].cells]
        return Value(kind, elements=[_with_units(names, inside["data"].cells, units)])
    return Value(kind, elements=[fields])


def _with_units(
    names: Sequence[str], values: Sequence[Value], units: Sequence[str]
) -> dict[str, Value]:
    units_of_columns = units or [""] * len(names)
    return {
        name: replace(value, unit=value.unit or unit)
        for name, value, unit in zip(names, values, units_of_columns, strict=True)
    }


def _timetable_of(inside: Mapping[str, Value]) -> dict[str, Value]:
    names = [cell.text for cell in inside["varNames"].cells]
    units = [cell.text for cell in inside["varUnits"].cells]
    data = inside["data"].cells
    times = inside["rowTimes"]
    if times.kind == "struct":  # the first one, with a step or a rate
        rule: dict[str, Any] = {name: value.numbers for name, value in times.elements[0].items()}
        step_s = 1 / rule["sampleRate"] if rule["specifiedAsRate"].any() else rule["stepSize"]
        rows = np.arange(float(data[0].shape[0]))[:, None]
        origin = times.elements[0]["origin"]
        times = replace(origin, shape=rows.shape, numbers=rule["origin"] + rows * step_s)
    return {inside["dimNames"].cells[0].text: times, **_with_units(names, data, units)}


def _columns_of_samples(elements: Sequence[Mapping[str, Value]]) -> dict[str, Value]:
    """Columns of structs of single numbers, one per sample; empty where they are none."""
    if len(elements) < FEWEST_SAMPLES:
        return {}
    names = [
        name
        for name in elements[0]
        if all(name in element and _is_number(element[name]) for element in elements)
    ]
    if len(names) < 2:
        return {}
    columns: dict[str, Value] = {}
    for name in names:
        numbers = [np.ravel(element[name].numbers)[0] for element in elements]  # type: ignore[arg-type]
        column = np.array(numbers, np.float64)
        columns[name] = Value("double", (column.size, 1), column[:, None])
    return columns


def _is_number(value: Value) -> bool:
    return value.numbers is not None and value.numbers.size == 1


# addresses ----------------------------------------------------------------------------------


def address_with(place: str, step: str) -> str:
    """Put a step behind an address."""
    return f"{place}.{step}" if place and step[0] not in "({" else place + step


def steps_in(text: str, is_inside: bool = False) -> tuple[str, ...]:
    """Split an address into its steps: names, `(2)`, `{1}`, `(:,3)`, `(1,:)`.

    One inside a part may also begin with a choice of a column, as `(:,2)`.

    Raises
    ------
    InputError
        It is no address.
    """
    plain = re.sub(r"\s*([(){}.,:=])\s*", r"\1", text.strip()).removeprefix("/")
    steps = tuple(step.removeprefix(".") for step in STEP.findall(plain))
    is_whole = bool(steps) and reduce(address_with, steps, "") == plain
    if not is_whole or not (is_inside or steps[0][0] not in "({"):
        raise InputError(
            f"'{text}' is no address in a MATLAB file; write it as in MATLAB, such as"
            " `Test.run(2).torque`, `Test.data(:,3)` or `runs{2}.torque`"
        )
    return steps


def checked_address(text: str) -> str:
    """Give the text of an address as it is; refused if it is none."""
    steps_in(text, is_inside=True)
    return text


def parts_of(value: Value) -> dict[str, Value]:
    """What stands in a value, by the step that leads to it: `torque`, `(2)`, `{1}`, `(:,3)`,
    `(1,:)`."""
    if value.numbers is not None and value.numbers.ndim == 2:
        lines = {f"(:,{n})": line for n, line in enumerate(value.numbers.T, start=1)}
        lines |= {f"({n},:)": line for n, line in enumerate(value.numbers, start=1)}
        return {
            step: Value(value.kind, (line.size, 1), line.reshape(-1, 1), unit=value.unit)
            for step, line in lines.items()
        }
    parts = dict(value.elements[0]) if len(value.elements) == 1 else {}
    for number, cell in enumerate(value.cells, start=1):
        parts[f"{{{number}}}"] = cell
    for number, fields in enumerate(value.elements, start=1):
        parts[f"({number})"] = Value("struct", elements=[fields])
    return parts


def value_at(variables: Mapping[str, Value], address: str, part: str = "") -> tuple[str, Value]:
    """Find what stands at an address.

    Parameters
    ----------
    part
        Address of the struct or cell in which an address without `/` is.

    Returns
    -------
    str
        The whole address.
    Value

    Raises
    ------
    InputError
        There is nothing.
    """
    is_within = bool(part) and not address.startswith("/")
    if is_within:
        steps = (*steps_in(part), *steps_in(address, is_inside=True))
        whole = address_with(part.strip(), address.strip())
    else:
        steps = steps_in(address)
        whole = address.strip().removeprefix("/")
    if steps[0] not in variables and not part:
        names = [*variables]
        raise InputError(
            f"no variable '{steps[0]}'; it has {listing(names, 12)}{nearest(steps[0], names)};"
            " correct it, state the rate if it is that of time, as `time: {rate: HZ}`, or if one of"
            " these holds it, name this one as `log_part`, in the sample sheet where it differs"
            " from trial to trial"
        )
    value = Value("struct", elements=[variables])
    place = ""
    for step in steps:
        below = parts_of(value)
        if step not in below:
            names = [*below] if place else [*variables]
            has = value.remedy()
            if names:
                has = f"it has {listing(names, 12)}{nearest(step, names)}"
            what = f"{place} is a {value.described()} and" if place else "the file"
            raise InputError(f"{whole}: {what} has no {step}; {has}")
        value = below[step]
        place = address_with(place, step)
    return whole, value


def vector_of(address: str, value: Value) -> NDArray[Any]:
    """The real numbers (n,) of a signal; refused if it is empty or something else."""
    numbers = value.numbers
    is_a = f"{address} is a {value.described()}"
    if value.elements or value.kind == "struct":
        raise InputError(
            f"{is_a}, not numbers; name one of its fields ({listing(value.fields, 8)})"
        )
    if value.kind == "cell":
        raise InputError(f"{is_a}, not numbers; name one of its cells, as `{{1}}`")
    if numbers is None:
        raise InputError(f"{is_a}, not real numbers; {value.remedy()}")
    if not value.size:
        raise InputError(
            f"{address} is empty ({value.described()}); name another variable, or record the trial"
            " again"
        )
    if numbers.ndim > 2:
        raise InputError(f"{is_a}; save each of its matrices as a variable of its own")
    if max(numbers.shape) != numbers.size:
        raise InputError(
            f"{is_a}; choose one column, as {address}(:,1), or one row, as {address}(1,:)"
        )
    return numbers.ravel()


@dataclass(frozen=True)
class Variable:
    """What is no struct and no cell in a file."""

    part: str  # address of what it is in; empty for the file itself
    name: str
    address: str
    value: Value
    title: str = field(default="", compare=False)  # of a column of a matrix, from texts beside it


def variables_in(variables: Mapping[str, Value]) -> Iterator[Variable]:
    """List what stands in a file, down to arrays."""
    for name, value in variables.items():
        yield from _variables_in("", name, value)


def _variables_in(part: str, name: str, value: Value) -> Iterator[Variable]:
    address = address_with(part, name)
    if value.elements:
        for number, fields in enumerate(value.elements, start=1):
            inside = f"{address}({number})" if len(value.elements) > 1 else address
            for field_name, field_value in fields.items():
                yield from _variables_in(inside, field_name, field_value)
    elif value.kind == "cell" and value.cells:
        for number, cell in enumerate(value.cells, start=1):
            yield from _variables_in(address, f"{{{number}}}", cell)
    else:
        yield Variable(part, name, address, value)


def lines_of(variable: Variable) -> Iterator[Variable]:
    """The columns of a matrix, or the rows if it has more columns; a vector itself."""
    value = variable.value
    if value.numbers is None or 1 in value.shape or len(value.shape) != 2:
        yield variable
        return
    rows, columns = value.shape
    is_upright = rows >= columns
    for step, line in parts_of(value).items():
        if step.startswith("(:") == is_upright:
            yield Variable(variable.part, step, f"{variable.address}{step}", line)
