"""MATLAB files of version 5 (by scipy) and 7.3 (HDF5, by h5py), objects in them (by mat-io), and
addresses of numbers.

An address is written as in MATLAB: `Test.Slow(2).data(:,3)`, `runs{2}.torque`. MATLAB writes into
HDF5 arrays transposed, text as 16-bit numbers, and the elements of cells and of struct arrays as
references; the attribute `MATLAB_class` says what a dataset or group is."""

import io
import math
import re
import struct
import warnings
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.errors import EXTRAS, InputError, listing, nearest, optional_module
from osl_analysis.old_formats.binary_table import never_written, tell_bytes_behind
from osl_analysis.old_formats.table import Ledger, check_memory, in_one_sentence, isolated
from osl_analysis.trial import Array

DAMAGED = "copy the file again, or save it again in MATLAB, with the numbers in it"
REMEDIES = {
    "string": "save it as numbers, or as text with `char(s)`",
    "sparse": "save it as `full(x)`",
    "char": "save it as numbers: `str2double(x)`",
    "timeseries": "save its numbers: `t = x.Time; y = x.Data; save('x.mat', 't', 'y', '-v7')`",
    "Dataset": (
        "save its numbers: `s = x{1}.Values; t = s.Time; y = s.Data; save('x.mat', 't', 'y',"
        " '-v7')`"
    ),
    "array that was never written": "record the trial again, or name another variable",
}
"""What to do in MATLAB about a class that is not read, or is no number."""
FEWEST_SAMPLES = 10  # structs of single numbers that are taken for the samples of a recording


@dataclass(frozen=True)
class Value:
    # its class in MATLAB, such as `double`, `struct`, `cell`, `nldat`; `sparse` for a sparse matrix
    kind: str
    shape: tuple[int, ...] = (1, 1)
    # of its shape, masked where never written; None for anything but real numbers
    numbers: Array | None = None
    is_complex: bool = False
    text: str = ""  # its text, for one row of characters
    # fields of each element of a struct or object, in MATLAB's order
    elements: Sequence[Mapping[str, "Value"]] = ()
    cells: Sequence["Value"] = ()  # elements of a cell, in MATLAB's order
    unit: str = ""  # of its numbers, where a table states it; `s` of times
    is_opaque: bool = False  # an object of a class whose content is not read

    @property
    def fields(self) -> list[str]:
        return [*self.elements[0]] if self.elements else []

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    def described(self) -> str:
        """Size and class for messages, as `12000x1 double`."""
        return (
            f"{'x'.join(map(str, self.shape))} {'complex ' if self.is_complex else ''}{self.kind}"
        )

    def remedy(self) -> str:
        install = f"pip install 'osl-analysis[{EXTRAS['mat-io']}]', which reads it, or "
        own = REMEDIES.get(self.kind.rpartition(".")[2], "save its numbers in a struct")
        saved = "save `real(x)`" if self.is_complex else own
        return install * (self.is_opaque and not find_spec("matio")) + saved

    def holds_opaque(self) -> bool:
        inside = [*self.cells, *(value for fields in self.elements for value in fields.values())]
        return self.is_opaque or any(one.holds_opaque() for one in inside)


def is_mat(begin: bytes) -> bool:
    return begin.startswith((b"MATLAB 5.0 MAT", b"MATLAB 7.")) and b"\0" in begin[:128]


told_as_damage = partial(in_one_sentence, remedy=DAMAGED)


@dataclass(frozen=True)
class MatFile:
    """A MATLAB file whose variables are read when they are asked for."""

    path: Path
    version: str
    header: str
    names: Sequence[str]  # of its variables, in order
    damage: Ledger
    content: dict[str, Value] = field(default_factory=dict)  # what was read

    def read(self, wanted: Collection[str]) -> Mapping[str, Value]:
        """The wanted variables that it has; InputError if one is damaged."""
        known = [name for name in self.names if name in wanted and name not in self.content]
        found = (
            isolated(partial(read73 if self.version == "7.3" else read5, self.path, known))
            if known
            else {}
        )
        opaque = [name for name, value in found.items() if value.holds_opaque()]
        if opaque and find_spec("matio"):
            with suppress(InputError):
                read = isolated(partial(read_objects, self.path, opaque))
                found |= {name: with_objects(found[name], read[name]) for name in opaque}
        self.content.update({name: simplified(value) for name, value in found.items()})
        return {name: self.content[name] for name in self.names if name in wanted}

    def signals(self, texts: Sequence[str], part: str = "") -> dict[str, tuple[str, Array, str]]:
        """The numbers (n,) at addresses, each with its whole address and stated unit; those without
        `/` are in `part`. InputError if there is nothing, or something else than a row or a column
        of real numbers."""
        found, above = dict[str, tuple[str, Array, str]](), steps_in(part) if part else ()
        within = {text: bool(above) and not text.startswith("/") for text in texts}
        ways = {
            text: (*above, *steps_in(text, inside=True)) if within[text] else steps_in(text)
            for text in texts
        }
        variables = self.read({way[0] for way in ways.values()})
        for text, way in ways.items():
            if way[0] not in self.names and not part:
                raise InputError(
                    f"no variable '{way[0]}'; it has"
                    f" {listing(self.names, 12)}{nearest(way[0], self.names)}; correct it, state"
                    " the rate if it is that of time, as `time: {rate: HZ}`, or if one of these"
                    " holds it, name this one as `log_part`, in the sample sheet where it differs"
                    " from trial to trial"
                )
            address = address_with(part.strip(), text.strip()) if within[text] else text.strip()
            value, place = Value("struct", elements=[variables]), ""
            for step in way:
                below = parts_of(value)
                if step not in below:
                    known = [*below] if place else self.names
                    has = (
                        f"it has {listing(known, 12)}{nearest(step, known)}"
                        if known
                        else value.remedy()
                    )
                    what = f"{place} is a {value.described()} and" if place else "the file"
                    raise InputError(f"{address}: {what} has no {step}; {has}")
                value, place = below[step], address_with(place, step)
            found[text] = address, vector(address, value), value.unit
        return found


def open_mat(path: Path) -> MatFile:
    """The MATLAB file at a path; InputError if it is of another version, none, or damaged."""
    with path.open("rb") as file:
        begin = file.read(128)
    if not is_mat(begin):
        raise InputError(
            f"{path}: no MATLAB file of version 5 or 7.3; save it again in MATLAB with `-v7`"
        )
    header, damage = begin[:116].split(b"\0")[0].decode("latin-1").strip(), Ledger()
    with told_as_damage():
        if begin.startswith(b"MATLAB 7.") or 2 in begin[124:126]:
            h5py()  # once for all forks
            names = isolated(partial(names73, path))
            tell_bytes_behind(path, 512, damage)
            return MatFile(path, "7.3", header, names, damage)
        data, end = path.read_bytes(), 128
        # each element tells its length; scipy is silent about what lies beyond the end
        while end + 8 <= len(data):
            end += (
                8 + struct.unpack_from("<I" if begin[126:128] == b"IM" else ">I", data, end + 4)[0]
            )
        if end != len(data):
            damage.miss_end(
                f"the last variable ends at byte {end}, the file at byte {len(data)}: its end is"
                " missing"
            )
        return MatFile(path, "5", header, isolated(partial(names5, path)), damage)


def streams5(path: Path) -> dict[str, Any]:
    """The part of a file of version 5 that holds each variable."""
    from scipy.io.matlab import MatlabOpaque, loadmat, varmats_from_mat

    variables, parts = (
        dict[str, Any](),
        list[tuple[str, Any]](varmats_from_mat(io.BytesIO(path.read_bytes()))),
    )
    for called, stream in parts:
        name, raw = called, loadmat(stream)["None"] if called == "None" else None
        # of an object that only MATLAB can read, scipy before 1.18 tells no name
        if isinstance(raw, MatlabOpaque):
            name = bytes(raw.flat[0]["s0"]).decode("latin-1")
        if name in variables:
            raise InputError(f"variable '{name}' stands twice in the file; {DAMAGED}")
        if name:
            variables[name] = stream
    return variables


def names5(path: Path) -> list[str]:
    with told_as_damage():
        return [*streams5(path)]


def read5(path: Path, names: Sequence[str]) -> dict[str, Value]:
    from scipy.io import loadmat

    found, streams = dict[str, Value](), streams5(path)
    for name in names:
        with told_as_damage(f"{name} "):
            raw: Any = loadmat(streams[name], spmatrix=False)
            found[name] = value5(next(one for key, one in raw.items() if not key.startswith("__")))
    return found


def read_objects(path: Path, names: Sequence[str]) -> dict[str, Value]:
    """Some variables with the objects in them as mat-io reads them."""
    with told_as_damage(), warnings.catch_warnings(action="ignore"):
        from matio import load_from_mat

        raw = load_from_mat(path, variable_names=[*names], raw_data=True, spmatrix=False)
        return {name: value5(raw[name]) for name in names}


def simplified(value: Value) -> Value:
    """A value whose arrays of structs of single numbers, one per sample, are structs of columns,
    and whose structures with time, as Simulink logs them, have a field per signal, called by its
    label."""
    cells = [simplified(one) for one in value.cells]
    if len(value.elements) >= FEWEST_SAMPLES:
        names = [
            name
            for name in value.fields
            if all(name in one and is_number(one[name]) for one in value.elements)
        ]
        if len(names) > 1:
            fields = {}
            for name in names:
                numbers = [one[name].numbers for one in value.elements]
                column = np.array([float(one.item()) for one in numbers if one is not None])
                fields[name] = Value("double", (column.size, 1), column[:, None])
            return replace(value, shape=(1, 1), elements=[fields])
    elements: list[dict[str, Value]] = [
        {name: simplified(own) for name, own in one.items()} for one in value.elements
    ]
    if len(elements) == 1 and {"X", "Y"} <= elements[0].keys():
        elements = [exported_signals(elements[0]) or elements[0]]
    if len(elements) == 1 and {"time", "signals"} <= elements[0].keys():
        elements = [{**elements[0], **logged_signals(elements[0]["signals"])}]
    return replace(value, cells=cells, elements=elements)


def exported_signals(fields: Mapping[str, Value]) -> dict[str, Value]:
    """The signals that ControlDesk exports, a struct each under X and Y, by their names; empty if
    they are none."""
    every = [one for key in "XY" for one in fields[key].elements if {"Name", "Data"} <= one.keys()]
    units = [one["Unit"].text if "Unit" in one else "" for one in every]
    names = [re.sub(r"\W+", "_", one["Name"].text).strip("_") for one in every]
    found = {
        n: replace(one["Data"], unit=unit) for n, one, unit in zip(names, every, units, strict=True)
    }
    return found if len(found) == len(every) > 1 else {}


def is_number(value: Value) -> bool:
    return value.numbers is not None and value.numbers.size == 1


def logged_signals(signals: Value) -> dict[str, Value]:
    """The columns of the field `signals` of a structure with time, by the labels of the signals."""
    found = dict[str, Value]()
    for number, one in enumerate(signals.elements, start=1):
        values = one["values"].numbers if "values" in one else None
        if values is None or not values.size:
            continue
        # of a scalar, time is last
        columns = values.reshape(-1, values.shape[-1]).T if values.ndim > 2 else values
        labels = re.split(r"\s*,\s*", one["label"].text) if "label" in one else []
        for place, column in enumerate(columns.T):
            label = (
                labels[place]
                if len(labels) == columns.shape[1]
                else f"{(labels or [''])[0]}_{place + 1}"
            )
            name = re.sub(r"\W+", "_", label).strip("_")
            name = name if name[:1].isalpha() else f"signal_{number}_{place + 1}"
            found[name] = Value("double", (column.size, 1), column.reshape(-1, 1))
    return found


def value5(raw: Any) -> Value:
    """A value as scipy, or mat-io as its like, gives it."""
    from scipy.io.matlab import MatlabOpaque
    from scipy.sparse import issparse

    if raw is None:  # an element of a struct without fields
        return Value("struct")
    if isinstance(raw, MatlabOpaque):
        class_name = raw.flat[0][-2]  # bytes before scipy 1.18
        kind = class_name.decode("latin-1") if isinstance(class_name, bytes) else class_name
        return Value(kind or "object", is_opaque=True)
    if type(raw).__name__ == "MatlabFunction":
        return Value("function_handle")
    if hasattr(raw, "properties"):
        # none, or of no known release
        with suppress(AttributeError, IndexError, KeyError, TypeError, ValueError):
            return object_of(raw.classname, raw.properties)
        return Value(raw.classname or "object", is_opaque=True)
    if issparse(raw):
        return Value("sparse")
    array: np.ndarray[Any, np.dtype[Any]] = np.atleast_2d(np.asarray(raw))
    in_order, of_class = array.ravel(order="F"), getattr(raw, "classname", "")
    if array.dtype.names is not None:
        elements = [{name: value5(one[name]) for name in array.dtype.names} for one in in_order]
        return Value(of_class or "struct", array.shape, elements=elements)
    if array.dtype == object:
        cells = [value5(one) for one in in_order]
        inside: Any = (
            {"elements": [dict(*one.elements) for one in cells]} if of_class else {"cells": cells}
        )
        return Value(of_class or "cell", array.shape, **inside)
    if array.dtype.kind == "U":
        rows = array.ravel().tolist()
        width = max((len(row) for row in rows), default=0)
        return Value("char", (len(rows), width), text=rows[0] if len(rows) == 1 else "")
    if array.dtype.kind == "c":
        return Value(
            {"complex64": "single"}.get(array.dtype.name, "double"), array.shape, is_complex=True
        )
    kind = {"float64": "double", "float32": "single", "bool": "logical"}.get(
        array.dtype.name, array.dtype.name
    )
    return Value(kind, array.shape, np.asarray(array, dtype=np.float64))


def with_objects(own: Value, read: Value) -> Value:
    """A value with the objects in it as mat-io read them; of those that it cannot read it gives
    their numbers there."""
    if own.is_opaque:
        return own if read.is_opaque or read.kind in ("uint32", "char") else read
    if not own.holds_opaque():
        return own
    cells = [with_objects(*pair) for pair in zip(own.cells, read.cells, strict=True)]
    pairs = zip(own.elements, read.elements, strict=True)
    elements = [
        {name: with_objects(one, there[name]) for name, one in fields.items()}
        for fields, there in pairs
    ]
    return replace(own, cells=cells, elements=elements)


def object_of(kind: str, properties: Mapping[str, Any]) -> Value:
    """An object of a class by what is stored of it: times in s (those of a `datetime` since 1970,
    in UTC if it has a zone), tables as structs of their columns, by the names that MATLAB makes
    valid, others as structs of properties."""
    # in ms; the imaginary part is what the real one lost by rounding
    if kind in ("duration", "datetime"):
        stored = np.atleast_2d(properties["millis" if kind == "duration" else "data"])
        return Value(kind, stored.shape, (stored.real + stored.imag) / 1e3, unit="s")
    if kind == "string":  # version, number of dimensions, these, lengths, text
        return Value(kind, tuple(np.ravel(properties["any"])[2:4].tolist()))
    fields = {name: value5(one) for name, one in properties.items()}
    if kind not in ("table", "timetable"):
        return Value(kind, elements=[fields])
    inside = (
        fields["any"].elements[0]
        if kind == "timetable"
        else {**fields["props"].elements[0], **fields}
    )
    keys = ("varNames", "varUnits") if kind == "timetable" else ("varnames", "VariableUnits")
    names, units = ([one.text for one in inside[key].cells] for key in keys)
    values = zip(inside["data"].cells, units or [""] * len(names), strict=True)
    columns = dict(
        zip(names, [replace(one, unit=one.unit or unit) for one, unit in values], strict=True)
    )
    if kind == "timetable":
        times, rows = (
            inside["rowTimes"],
            np.arange(float(inside["data"].cells[0].shape[0]))[:, None],
        )
        if times.kind == "struct":  # the first one, with a step or a rate
            rule: dict[str, Any] = {
                name: value.numbers for name, value in times.elements[0].items()
            }
            step = 1 / rule["sampleRate"] if rule["specifiedAsRate"].any() else rule["stepSize"]
            times = replace(
                times.elements[0]["origin"], shape=rows.shape, numbers=rule["origin"] + rows * step
            )
        columns = {inside["dimNames"].cells[0].text: times} | columns
    return Value(kind, elements=[columns])


def h5py() -> Any:
    """The library, an optional extra that takes a fifth of a second to import."""
    return optional_module("h5py", "a MATLAB file of version 7.3 (not one saved with `-v7`)")


def names73(path: Path) -> list[str]:
    with told_as_damage(), h5py().File(path, "r") as file:  # some of its groups are no variables
        return [name for name in file if name not in ("#refs#", "#subsystem#")]


def read73(path: Path, names: Sequence[str]) -> dict[str, Value]:
    found = dict[str, Value]()
    with told_as_damage(), h5py().File(path, "r") as file:
        for name in names:
            link = getattr(file.get(name, getlink=True), "path", "")
            with told_as_damage(f"{name} {f'is a link to {link} and ' * bool(link)}"):
                found[name] = value73(file[name])
    return found


def value73(item: Any) -> Value:
    kind = item.attrs.get("MATLAB_class", "")
    kind = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
    if "MATLAB_object_decode" in item.attrs or (
        hasattr(item, "dtype") and not hasattr(item, "shape")
    ):
        # 1: a function
        return Value(kind or "object", is_opaque=item.attrs.get("MATLAB_object_decode", 1) > 1)
    return dataset73(item, kind) if hasattr(item, "dtype") else group73(item)


def group73(item: Any) -> Value:
    """A struct, or an array of them if all members are bare references."""
    members = [
        one for one in item.values() if holds_references(one) and "MATLAB_class" not in one.attrs
    ]
    if "MATLAB_sparse" in item.attrs:
        return Value("sparse")
    if not members or len(members) < len(item) or len({one.shape for one in members}) > 1:
        return Value("struct", elements=[{name: value73(one) for name, one in item.items()}])
    columns = [[value73(item.file[one]) for one in np.ravel(member[()])] for member in members]
    elements = [dict(zip(item, row, strict=True)) for row in zip(*columns, strict=True)]
    return Value("struct", tuple(reversed(members[0].shape)), elements=elements)


def dataset73(item: Any, kind: str) -> Value:
    if item.shape is None:
        return Value(kind or "double", (0, 0), np.zeros((0, 0)))
    shape = tuple(reversed(item.shape)) or (1, 1)
    if "MATLAB_empty" in item.attrs:
        empty = tuple(int(size) for size in np.ravel(item[()])) if item.size <= 32 else (0, 0)
        return Value(kind or "double", empty, np.zeros(empty) if 0 in empty else np.zeros((0, 0)))
    if holds_references(item):
        return Value("cell", shape, cells=[value73(item.file[one]) for one in np.ravel(item[()])])
    if kind == "char":  # 1000 characters are enough for a name by which an element is chosen
        short = item.size <= 1000 and item.dtype.kind == "u" and 1 in shape
        return Value("char", shape, text="".join(map(chr, np.ravel(item[()]))) if short else "")
    if item.dtype.names == ("real", "imag"):
        return Value(kind or "double", shape, is_complex=True)
    if item.dtype.kind not in "fiub":
        return Value(kind or "object", shape)
    if item.size and not item.is_virtual and not item.id.get_storage_size():
        return Value("array that was never written", shape)
    check_memory(8 * item.size)
    lacking = never_written(item)
    numbers = np.asarray(np.atleast_2d(item[()]).T, dtype=np.float64)
    if lacking is not None:
        numbers = np.ma.array(numbers, mask=np.atleast_2d(lacking).T)
    is_known = re.fullmatch("double|single|logical|u?int(8|16|32|64)", kind)
    return Value(kind if is_known else "double", shape, numbers)


def holds_references(item: Any) -> bool:
    """Whether an item is a dataset of references to others; texts of any length have the same type
    for numpy."""
    return (
        isinstance(item, h5py().Dataset) and h5py().check_ref_dtype(item.dtype) is h5py().Reference
    )


STEP = re.compile(r"\.?[A-Za-z]\w*|\{N\}|\((?:N|:,N|N,:)\)".replace("N", r"[1-9]\d{0,8}"))


def address_with(place: str, step: str) -> str:
    return f"{place}.{step}" if place and step[0] not in "({" else place + step


def steps_in(text: str, inside: bool = False) -> tuple[str, ...]:
    """The steps of an address: names, `(2)`, `{1}`, `(:,3)`, `(1,:)`; refused if it is none. One
    `inside` a part may also begin with a choice of a column, as `(:,2)`."""
    plain = re.sub(r"\s*([(){}.,:=])\s*", r"\1", text.strip()).removeprefix("/")
    steps = tuple(step.removeprefix(".") for step in STEP.findall(plain))
    is_whole = steps and reduce(address_with, steps, "") == plain
    if not is_whole or not (inside or steps[0][0] not in "({"):
        said = f"'{text}' is no address in a MATLAB file; write it as in MATLAB"
        raise InputError(
            f"{said}, such as `Test.run(2).torque`, `Test.data(:,3)` or `runs{{2}}.torque`"
        )
    return steps


def checked_address(text: str, inside: bool = True) -> str:
    """The text of an address as it is; refused if it is none."""
    steps_in(text, inside)
    return text


def parts_of(value: Value) -> dict[str, Value]:
    """What stands in a value, by the step that leads to it: `torque`, `(2)`, `{1}`, `(:,3)`,
    `(1,:)`."""
    if value.numbers is not None and value.numbers.ndim == 2:
        lines = [(f"(:,{n})", one) for n, one in enumerate(value.numbers.T, 1)]
        lines += [(f"({n},:)", one) for n, one in enumerate(value.numbers, 1)]
        return {
            step: Value(value.kind, (one.size, 1), one.reshape(-1, 1), unit=value.unit)
            for step, one in lines
        }
    parts = dict(value.elements[0]) if len(value.elements) == 1 else {}
    parts |= {f"{{{number}}}": one for number, one in enumerate(value.cells, 1)}
    parts |= {
        f"({number})": Value("struct", elements=[one])
        for number, one in enumerate(value.elements, 1)
    }
    return parts


def vector(address: str, value: Value) -> Array:
    """The real numbers (n,) of a signal; refused if it is empty or something else."""
    numbers, is_a = value.numbers, f"{address} is a {value.described()}"
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
