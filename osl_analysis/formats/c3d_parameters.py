"""The parameter section of a C3D file, and its numbers in the format of three processors."""

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.trial import Array

ENDIAN = {"Intel": "<", "DEC": "<", "MIPS": ">"}
SIZES = (-1, 1, 2, 4)  # type of a parameter: text, byte, integer, real

Parameters = dict[str, "Array | list[str]"]


@dataclass(frozen=True)
class ParameterRecord:
    """One record of the section: a group (`group` below 0), or a parameter with its value."""

    group: int
    name: str
    value: Array | list[str] | None
    value_end: int
    """First byte behind its value."""
    own_end: int
    """First byte behind its description, which some writers leave out."""
    following: int
    """First byte of the next record, as the record says; 0 if it says that it is the last."""


def parse_parameters(data: bytes, position: int, end: int, processor: str) -> tuple[Parameters, str]:
    """The parameters by `GROUP:NAME`, and a remark where the section has no end mark.

    The section begins at `position` and ends before `end`, where the data begin. Some writers leave the mark at its end
    out: the section then ends where no record follows. Groups may follow their parameters.

    Raises
    ------
    InputError
        A record is damaged, or points to a place that is not the next record although one follows.
    """
    records = list(section_records(data, position, end, processor))
    groups = {-record.group: record.name for record in records if record.group < 0}
    values = {
        f"{groups.get(record.group, record.group)}:{record.name}": record.value
        for record in records
        if record.value is not None
    }
    last = records[-1] if records else None
    marked = last is None or last.following == 0 or (last.following < end and data[last.following] == 0)
    return values, "" if marked or last is None else f"its parameter section has no end mark and ends after {last.name}"


def section_records(data: bytes, position: int, end: int, processor: str) -> Iterator[ParameterRecord]:
    """The records from `position` on; raises as `parse_parameters`."""
    while data[position] != 0:
        record = parameter_record(data, position, processor)
        yield record
        position = record.following
        if position == 0 or (position == record.own_end and not is_record(data, position)):
            return
        if not record.value_end <= position < end:
            if position < record.value_end or (record.own_end < end and is_record(data, record.own_end)):
                raise InputError(f"the parameter section is damaged after {record.name!r}")
            return


def is_record(data: bytes, position: int) -> bool:
    """Whether a record seems to begin at a place: a length, a group, and a name that can be read."""
    if position + 2 >= len(data):
        return False
    length, group = struct.unpack_from("bb", data, position)
    name = data[position + 2 : position + 2 + abs(length)]
    return length != 0 and group != 0 and all(32 <= sign < 127 for sign in name)


def parameter_record(data: bytes, position: int, processor: str) -> ParameterRecord:
    """The record at a place."""
    length, group = struct.unpack_from("bb", data, position)
    end = position + 2 + abs(length)
    name = data[position + 2 : end].decode("latin-1").strip().upper()
    (step,) = struct.unpack_from(f"{ENDIAN[processor]}h", data, end)
    if step < 0 or group == 0:
        raise InputError(f"the parameter section is damaged after {name!r}")
    value, value_end = (None, end + 2) if group < 0 else parameter_value(data, end + 2, processor, name)
    own_end = value_end + 1 + data[value_end] if value_end < len(data) else value_end
    return ParameterRecord(group, name, value, value_end, own_end, end + step if step else 0)


def parameter_value(data: bytes, position: int, processor: str, name: str) -> tuple[Array | list[str], int]:
    """One parameter from its type byte on, and the first byte behind it."""
    kind, dimensions = struct.unpack_from("bB", data, position)
    if kind not in SIZES or dimensions > 7:
        raise InputError(f"the parameter '{name}' has type {kind} and {dimensions} dimensions: the section is damaged")
    shape = tuple(data[position + 2 : position + 2 + dimensions])
    begin = position + 2 + dimensions
    content = data[begin : begin + abs(kind) * math.prod(shape)]
    if len(content) != abs(kind) * math.prod(shape):
        raise InputError(f"the parameter '{name}' reaches beyond the end of the file")
    if kind == -1:
        return text_values(content, shape[0] if shape else 1), begin + len(content)
    whole = "u1" if kind == 1 else f"{ENDIAN[processor]}i2"
    values = reals(content, processor) if kind == 4 else np.frombuffer(content, whole)
    with np.errstate(invalid="ignore"):  # a damaged real may be no number
        return values.astype(np.float64).reshape(shape, order="F"), begin + len(content)


def text_values(content: bytes, length: int) -> list[str]:
    """Strings of equal length, stripped; in UTF-8, or else in Latin-1."""
    parts = [content[i : i + length] for i in range(0, len(content), length or 1)]
    return [text_of(part).strip(" \0") for part in parts]


def text_of(text: bytes) -> str:
    """Text in UTF-8, or else in Latin-1."""
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1")


def reals(content: bytes, processor: str) -> NDArray[np.float32]:
    """32-bit reals; DEC stores the two halves swapped, and an exponent that is larger by two."""
    if processor != "DEC":
        return np.frombuffer(content, f"{ENDIAN[processor]}f4").astype(np.float32)
    halves = np.frombuffer(content, "<u2").reshape(-1, 2)[:, ::-1]
    with np.errstate(invalid="ignore"):
        return np.ascontiguousarray(halves).view("<f4")[:, 0] * np.float32(0.25)
