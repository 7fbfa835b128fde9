# SPDX-License-Identifier: Apache-2.0
"""MATLAB files of version 5 and 7.3, with tables and objects in them, by mat-io.

An address is written as in MATLAB: `Test.Slow(2).data(:,3)`, `runs{2}.torque`.
"""

import re
import struct
import warnings
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from operator import methodcaller
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field

from osl_analysis.base.errors import InputError, listing, nearest, optional_module
from osl_analysis.base.memory import check_unpacked
from osl_analysis.base.recording import Channel, Format, Recording
from osl_analysis.base.source_file import LogChannel, Name, RowTime, TableSource
from osl_analysis.formats.binary_table import (
    FEWEST_OF_SIGNAL,
    Variable,
    check_hdf5,
    recording_of_variables,
    variable_of,
)
from osl_analysis.formats.reading import beginning

HEADER_BYTES = 128  # of a file of version 5; at its end are the version and the byte order
OF_HDF5 = 2  # version
COMPRESSED = 15  # kind of a variable of version 5
NAME_FIELDS = ("name", "label", "title", "signalname", "blockname")
DATA_FIELDS = ("data", "values", "value", "samples")
"""Fields, in any case, of a struct that holds one signal: its name, of which the first that is not
empty counts, and its numbers. ControlDesk writes Y(k).Name and Y(k).Data, Simulink
signals(k).label, signals(k).blockName and signals(k).values."""
UNIT_FIELDS = ("unit", "units")
PORT = re.compile(r"(in|out)\d*", re.IGNORECASE)  # of a block, which ends the path of a signal
COLUMN = re.compile(r"\((\d+,:|:,\d+)\)$")  # or a row, of a matrix


class VariableChannel(LogChannel):
    """A variable, or a field, a cell or a column in one."""

    ADDRESS = "variable"
    variable: Name
    """Its address in MATLAB's notation: `torque`, `Test.run(2).torque`, `data(:,3)`,
    `runs{2}.torque`. It is within `log_part`, unless it begins with `/`."""
    # Where the device counts its samples, which tells the missing ones.
    counter: Name | None = None
    unit: str  # Unit of the numbers, as laboratories spell it.
    time: "VariableTime | None" = None  # Its own time, where it is not that of the others.


class VariableTime(RowTime):
    """A variable of time, or the rate of the samples."""

    ADDRESS = "variable"
    # Address of the variable that holds time, as in `channels`.
    variable: Name | None = None


class MatSource(TableSource):
    """The source file of MATLAB files."""

    channels: Mapping[str, VariableChannel] = Field(min_length=1)
    time: VariableTime
    log_part: str = ""
    """Address of the struct or cell that holds the trial, where there are several; the sample
    sheet's replaces it."""

    def for_part(self, part: str) -> "MatSource":
        """The source file for one part, as the sample sheet names it."""
        return self.model_copy(update={"log_part": part}) if part else self


def read(path: Path, source: MatSource | None) -> Recording:
    """Read the variables of a file; with a `log_part` those in it, by their addresses there."""
    # that of Qualisys has the beginning of any other, and reads it by this module
    from osl_analysis.formats import qualisys

    raw = load_variables(path)
    if source is None and qualisys.is_export(raw):
        return qualisys.recording_of_export(raw, None)
    variables: dict[str, Variable] = {}
    for name, value in raw.items():
        variables |= {variable.address: variable for variable in _variables_in(value, "", name)}
    whole = recording_of_variables("mat", "variable", [*variables.values()], noun="sample")
    part = "" if source is None else _plain(source.log_part)
    channels = []
    for channel in whole.channels:
        within = channel.key.removeprefix(part)
        if not part or (within != channel.key and within.startswith((".", "(", "{"))):
            channels.append(replace(channel, address={"variable": within.removeprefix(".")}))
    return replace(
        whole, channels=channels, find_unlisted=partial(_find, variables, part, whole.channels)
    )


def load_variables(path: Path) -> dict[str, Any]:
    """The variables of a file as mat-io gives them. Raises InputError: it leads elsewhere, or
    unpacks to too much."""
    if OF_HDF5 in beginning(path)[:HEADER_BYTES][-4:-2]:  # in either order
        check_hdf5(path)
    else:
        check_unpacked(path, _stated_size(path.read_bytes()))
    with warnings.catch_warnings(action="ignore"):  # of the library's import, and of odd objects
        matio = optional_module("matio", "a MATLAB file", "mat-io")
        raw = matio.load_from_mat(str(path), add_table_attrs=True, spmatrix=False)
    return {name: value for name, value in raw.items() if not name.startswith("__")}


def _stated_size(data: bytes) -> int:
    """The bytes to which the variables of a file of version 5 say that they unpack."""
    order = "<" if data[:HEADER_BYTES].endswith(b"IM") else ">"
    tag = struct.Struct(f"{order}II")  # kind, and bytes that follow
    size = len(data)
    position = HEADER_BYTES
    while position + tag.size <= len(data):
        kind, length = tag.unpack_from(data, position)
        position += tag.size
        if kind == COMPRESSED:
            begin = zlib.decompressobj().decompress(data[position : position + length], tag.size)
            size += tag.unpack(begin)[1] - length
        position += length
    return size


def _variables_in(value: Any, group: str, name: str, unit: str = "") -> Iterator[Variable]:
    """What stands in a value, down to arrays; times are in s, those of a day since 1970."""
    address = _joined(group, name)
    if hasattr(value, "attrs"):  # a table
        if value.index.dtype.kind in "mM":
            yield from _variables_in(value.index.to_numpy(), address, value.index.name)
        units = value.attrs.get("VariableUnits") or value.attrs.get("varUnits") or ()
        is_complete = len(units) == value.shape[1]  # a matrix in a table becomes several columns
        for place, column in enumerate(value):
            numbers = value[column].to_numpy()
            if numbers.dtype == object:
                numbers = numbers.astype(str)
            yield from _variables_in(numbers, address, column, units[place] if is_complete else "")
        return
    if isinstance(getattr(value, "properties", None), dict):  # an object
        for field, stored in value.properties.items():
            yield from _variables_in(stored, address, field)
        return
    if scipy.sparse.issparse(value):
        yield Variable(group, address, "sparse")
        return
    array: NDArray[Any] = np.atleast_1d(np.asarray(value))
    elements = array.ravel(order="F")
    kind = array.dtype.kind
    if array.dtype.names is not None:
        for number, element in enumerate(elements, start=1):
            inside = address if elements.size == 1 else f"{address}({number})"
            label = _signal_name(element, name)
            for field in array.dtype.names:
                if label and field.casefold() in (*NAME_FIELDS, *UNIT_FIELDS):
                    continue
                variables = _variables_in(element[field], inside, field)
                if label and field.casefold() in DATA_FIELDS:
                    unit = _first_text(element, UNIT_FIELDS)
                    variables = (
                        replace(variable, group=group, label=label, unit=unit or variable.unit)
                        for variable in variables
                    )
                yield from variables
    elif kind == "O":
        for number, element in enumerate(elements, start=1):
            if element is not None:  # as in a struct without fields
                yield from _variables_in(element, address, f"{{{number}}}")
    elif kind in "mM":
        ns = array.astype(f"{kind}8[ns]").astype(np.int64)
        yield variable_of(address, ns * 1e-9, "s", group)
    else:
        yield variable_of(address, array, unit, group)


def _signal_name(element: np.void, name: str) -> str:
    """The name of the signal that a struct holds; empty where it holds anything else.

    Parameters
    ----------
    element
        The struct.
    name
        Its own name, which stands for a signal whose name is empty, as that of time.
    """
    fields = {field.casefold() for field in element.dtype.names or ()}
    if fields.isdisjoint(NAME_FIELDS) or fields.isdisjoint(DATA_FIELDS):
        return ""
    path = _first_text(element, NAME_FIELDS) or name
    steps = re.split(r"/(?![^\[(]*[\])])", path)  # a slash in brackets is one of a unit
    blocks = [step for step in steps if step and not PORT.fullmatch(step)]
    return blocks[-1] if blocks else path


def _first_text(element: np.void, keys: Sequence[str]) -> str:
    """The first text that is not empty in some fields of a struct, in their order."""
    fields = {field.casefold(): field for field in element.dtype.names or ()}
    for key in keys:
        content = np.ravel(element[fields[key]]) if key in fields else np.empty(0)
        if content.size == 1 and isinstance(content[0], str) and content[0].strip():
            return str(content[0]).strip()
    return ""


def _find(
    variables: Mapping[str, Variable],
    part: str,
    everywhere: Sequence[Channel],
    asked: Mapping[str, str],
) -> Channel:
    """Find what stands at an address outside of the part, or say why it is no channel."""
    address = _plain(asked["variable"])
    if not asked["variable"].startswith("/"):
        address = _joined(part, address)
    for channel in everywhere:
        if channel.key == address:
            return channel
    whole = COLUMN.sub("", address)
    if whole in variables:
        raise _refusal(variables[whole])
    similar_names = [name for name in variables if name.startswith(address)] or [*variables]
    raise InputError(
        f"nothing stands at '{address}'",
        f"the file has {listing(similar_names)}{nearest(address, similar_names)}; correct it, state"
        " the rate"
        " if it is that of time, as `time: {rate: HZ}`, or if one of these holds it, name that"
        " one as `log_part`, in the sample sheet where it differs from trial to trial",
    )


def _refusal(variable: Variable) -> InputError:
    """Why a variable is no vector of real numbers, and what to do."""
    size = "x".join(map(str, getattr(variable.numbers, "shape", ())))
    return InputError(
        f"{variable.address} is {variable.kind} {size}".rstrip(),
        f"choose one column of a matrix, as {variable.address}(:,1), of at least {FEWEST_OF_SIGNAL}"
        " samples, or save it as real numbers, such as `real(x)`, `full(x)` or `str2double(x)`",
    )


def _joined(group: str, name: str) -> str:
    """The address of what is in a struct or a cell."""
    return f"{group}.{name}" if group and name[0] not in "({" else group + name


def _plain(address: str) -> str:
    """An address without spaces, from the top of the file."""
    return re.sub(r"\s", "", address).removeprefix("/")


FORMAT = Format(
    name="mat",
    suffixes=(".mat",),
    begins=methodcaller("startswith", (b"MATLAB 5.0 MAT", b"MATLAB 7.")),
    source=MatSource,
    read=read,
)
