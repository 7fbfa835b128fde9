"""MATLAB files of version 5 and 7.3, with tables and objects in them, by mat-io."""

import struct
import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from osl_analysis.errors import InputError, not_installed, optional_module
from osl_analysis.formats._cells import name_and_unit
from osl_analysis.formats._mat_values import (
    FEWEST_SAMPLES,
    Value,
    Variable,
    checked_address,
    lines_of,
    steps_in,
    value_at,
    value_of,
    variables_in,
    vector_of,
)
from osl_analysis.formats.binary_table import check_written, titles_by_width
from osl_analysis.recording import Channel, End, Format, Loss, Recording, Rows
from osl_analysis.source_file import LogChannel, RowTime, TableSource
from osl_analysis.units import name_and_ending

HEADER = 128  # bytes; of version 7.3 HDF5 begins behind 512
ELEMENT = 8  # bytes before each variable of version 5: type, length
MOST_LISTED = 500  # variables
NOT_VARIABLES = ("#refs#", "#subsystem#")  # groups of a file of version 7.3
SAVE_AGAIN = "copy the file again, or save it again in MATLAB, with the numbers in it"

AddressText = Annotated[str, AfterValidator(checked_address)]


def _checked_part(text: str) -> str:
    if text:
        steps_in(text)
    return text


class VariableChannel(LogChannel):
    """A variable, or a field, a cell or a column in one."""

    ADDRESS = "variable"
    variable: AddressText
    """Its address in MATLAB's notation: `torque`, `Test.run(2).torque`, `data(:,3)`,
    `runs{2}.torque`. It is within `log_part`, unless it begins with `/`."""
    # Where the device counts its samples, which tells the missing ones.
    counter: AddressText | None = None
    unit: str  # Unit of the numbers, as laboratories spell it.


class VariableTime(RowTime):
    """A variable of time, or the rate of the samples."""

    ADDRESS = "variable"
    # Address of the variable that holds time, as in `channels`.
    variable: AddressText | None = None


class MatSource(TableSource):
    """The source file of MATLAB files."""

    channels: Mapping[str, VariableChannel] = Field(min_length=1)
    time: VariableTime
    log_part: Annotated[str, AfterValidator(_checked_part)] = ""
    """Address of the struct or cell that holds the trial, where there are several; the sample
    sheet's replaces it."""

    def of_part(self, part: str) -> "MatSource":
        """The source file for one part, as the sample sheet names it."""
        return self.model_copy(update={"log_part": part}) if part else self


def read(path: Path, source: MatSource | None) -> Recording:
    """Read the variables of a file; with a `log_part` those in it, by their addresses there."""
    with path.open("rb") as file:
        begin = file.read(HEADER)
    is_73 = begin.startswith(b"MATLAB 7.") or 2 in begin[124:126]
    end = End.WHOLE
    cut = 0 if is_73 else _end_of_whole_variables(path, begin)
    if is_73:
        _check_all_written(path)
    with warnings.catch_warnings(action="ignore"):  # of the library's import, and of odd objects
        if cut:
            end = End.MISSING
            if cut == HEADER:
                raise InputError(
                    f"the file is cut off within its first variable, at byte {path.stat().st_size};"
                    " copy it again from the recorder, or exclude the trial"
                )
            raw, remarks = _load_beginning(path, cut)
        else:
            raw, remarks = _load(path)
    variables = {name: value_of(raw_value) for name, raw_value in raw.items()}
    listed = list(variables_in(variables))
    part = source.log_part if source is not None else ""
    channels = _channels_of(listed, part)
    remarks += [*_not_read(listed), *_of_programs(variables)]
    most = max((channel.rows.count for channel in channels), default=0)
    facts = {
        "version": "7.3" if is_73 else "5",
        "header": begin[:116].split(b"\0")[0].decode("latin-1").strip(),
        "variables": str(len(variables)),
    }
    return Recording(
        format="mat",
        channels=channels,
        loss=Loss(most, most, end, remarks=remarks),
        notes=_short_numbers(listed),
        facts=facts,
        find_unlisted=partial(_find_unlisted, variables, part, channels),
    )


def _load(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Read all variables, or those that can be read; gives also a remark on each other one."""
    try:
        from matio import load_from_mat, whosmat
    except ModuleNotFoundError:
        raise not_installed("a MATLAB file", "mat-io") from None
    options: Any = {"raw_data": True, "spmatrix": False}
    remarks: list[str] = []
    try:
        raw = load_from_mat(str(path), **options)
    except Exception as error:  # whatever the library meets in a damaged file
        if isinstance(error.__cause__ or error, MemoryError):  # the library wraps it
            raise MemoryError from error
        raw = {}
        for name, *_ in whosmat(str(path)):
            try:
                raw |= load_from_mat(str(path), variable_names=[name], **options)
            except Exception as own_error:
                reason = " ".join(str(own_error).split())[:100]
                remarks.append(f"{name} cannot be read ({reason})")
        if not raw:
            reason = " ".join(str(error).split())[:100]
            raise InputError(f"cannot be read ({reason}); {SAVE_AGAIN}") from error
    return {
        name: raw_value for name, raw_value in raw.items() if not name.startswith("__")
    }, remarks


def _end_of_whole_variables(path: Path, begin: bytes) -> int:
    """Where the last whole variable of a cut file of version 5 ends; 0 of a file that is not cut.

    Each variable tells its length.
    """
    data = path.read_bytes()
    order = "<" if begin[126:128] == b"IM" else ">"
    end = HEADER
    while end + ELEMENT <= len(data):
        (length,) = struct.unpack_from(f"{order}I", data, end + 4)
        if end + ELEMENT + length > len(data):
            return end
        end += ELEMENT + length
    return 0 if end == len(data) else end


def _load_beginning(path: Path, end: int) -> tuple[dict[str, Any], list[str]]:
    """Read the variables before a place [bytes]: the library refuses a file that is cut."""
    with TemporaryDirectory() as folder:
        whole = Path(folder) / path.name
        whole.write_bytes(path.read_bytes()[:end])
        raw, remarks = _load(whole)
    size = path.stat().st_size
    remarks.append(
        f"the last whole variable ends at byte {end}, the file at byte {size}: its end is missing"
    )
    return raw, remarks


def _check_all_written(path: Path) -> None:
    """Refuse a file of version 7.3 with numbers that a killed recorder never wrote."""
    h5py = optional_module("h5py", "a MATLAB file of version 7.3")

    def visit(name: str, item: Any) -> None:
        is_array = isinstance(item, h5py.Dataset) and item.shape and item.dtype.kind in "fiu"
        if is_array and not name.startswith(NOT_VARIABLES) and "MATLAB_empty" not in item.attrs:
            check_written(name.replace("/", "."), item)

    with h5py.File(path, "r") as file:
        file.visititems(visit)


def _channels_of(listed: Sequence[Variable], part: str) -> list[Channel]:
    """Make a channel of each vector, and each column of a matrix, that is long enough.

    Those of one length in one struct or cell share rows.
    """
    titles = _titles_in(listed)
    rows_by_place: dict[tuple[str, int], Rows] = {}
    channels: list[Channel] = []
    for variable in listed:
        is_array = variable.value.numbers is not None and len(variable.value.shape) == 2
        if not is_array or max(variable.value.shape) < FEWEST_SAMPLES:
            continue
        lines = list(lines_of(variable))
        names = titles.get(len(lines), ()) if len(lines) > 1 else ()
        for place, line in enumerate(lines):
            address = _inside(line.address, part)
            if address is None:
                continue
            title = names[place] if names else line.name.rpartition(".")[2]
            name, unit = name_and_unit(title)
            unit = line.value.unit or unit
            count = line.value.size
            key = (variable.part, count)
            if key not in rows_by_place:
                rows_by_place[key] = Rows(count, name=variable.part, noun="sample")
            values = vector_of(line.address, line.value)
            kind = variable.value.described()
            channels.append(_vector(address, rows_by_place[key], values, name, unit, kind))
    return channels


def _vector(
    address: str, rows: Rows, values: NDArray[Any], name: str, unit: str, kind: str
) -> Channel:
    return Channel(
        address={"variable": address},
        rows=rows,
        read=partial(np.asanyarray, values),
        name=name,
        unit=unit,
        likely_unit="" if unit else name_and_ending(name)[1],
        type=kind,
    )


def _inside(address: str, part: str) -> str | None:
    """An address within a part; None where it is elsewhere."""
    if not part:
        return address
    steps = steps_in(address)
    above = steps_in(part)
    if steps[: len(above)] != above or len(steps) == len(above):
        return None
    place = "".join(f".{step}" if step[0] not in "({" else step for step in steps[len(above) :])
    return place.removeprefix(".")


def _titles_in(listed: Sequence[Variable]) -> dict[int, Sequence[str]]:
    """Texts in a cell that name the columns of the only matrix of this width."""
    texts: dict[str, list[str]] = {}
    for variable in listed:
        if variable.name.startswith("{"):
            texts.setdefault(variable.part, []).append(variable.value.text)
    return titles_by_width(list(texts.values()))


def _short_numbers(listed: Sequence[Variable]) -> list[str]:
    """Single numbers and short lists, such as a rate, in words."""
    notes: list[str] = []
    for variable in listed:
        numbers = variable.value.numbers
        if numbers is not None and 0 < numbers.size < FEWEST_SAMPLES:
            shown = " ".join(str(number) for number in np.ravel(numbers))
            notes.append(f"{variable.address}={shown}")
    return notes


def _not_read(listed: Sequence[Variable]) -> list[str]:
    """Say which variables are not read, and what to do."""
    remarks = [
        f"{variable.address} is a {variable.value.described()}, which is not read;"
        f" {variable.value.remedy()}"
        for variable in listed[:MOST_LISTED]
        if variable.value.numbers is None and variable.value.kind not in ("char", "struct", "cell")
    ]
    if len(listed) > MOST_LISTED:
        remarks.append(f"and {len(listed) - MOST_LISTED} more variables")
    return remarks


def _of_programs(variables: Mapping[str, Value]) -> list[str]:
    """Say what to do with logs of Simulink and ControlDesk, whose signals have no names here."""
    remarks: list[str] = []
    for name, value in variables.items():
        fields = set(value.fields)
        if {"time", "signals"} <= fields:
            remarks.append(
                f"{name} is a log of Simulink, a structure with time; log a timetable instead, or"
                " save each signal as a variable"
            )
        elif {"X", "Y"} <= fields:
            remarks.append(f"{name} is an export of ControlDesk; export its signals as CSV")
    return remarks


def _find_unlisted(
    variables: Mapping[str, Value],
    part: str,
    channels: Sequence[Channel],
    address: Mapping[str, str],
) -> Channel:
    """Find what stands at any address."""
    whole, value = value_at(variables, address["variable"], part)
    values = vector_of(whole, value)
    place = whole.rpartition(".")[0]
    rows = Rows(values.size, name=place, noun="sample")
    for channel in channels:
        if (channel.rows.name, channel.rows.count) == (place, values.size):
            rows = channel.rows
    name = whole.rpartition(".")[2]
    return _vector(whole, rows, values, name, value.unit, value.described())


def _begins(begin: bytes) -> bool:
    return begin.startswith((b"MATLAB 5.0 MAT", b"MATLAB 7.")) and b"\0" in begin[:HEADER]


FORMAT = Format(name="mat", suffixes=(".mat",), begins=_begins, source=MatSource, read=read)
