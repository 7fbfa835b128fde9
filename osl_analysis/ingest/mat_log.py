"""A log in a MATLAB file: its source file, its reader, and what it holds."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field, field_validator, model_validator

from osl_analysis.errors import InputError, listing, nearest, printable
from osl_analysis.formats.mat import LISTED, Address, MatFile, Value, find, open_mat, parsed, vector
from osl_analysis.ingest.overview import (
    NAME_OF_TIME,
    UNKNOWN,
    Overview,
    RecordedChannel,
    gaps_text,
    is_clock,
    likely_clock,
    likely_unit,
    rate_of,
    unit_of_clock,
)
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.table_log import (
    Share,
    Table,
    TableChannel,
    TableColumn,
    TableSource,
    TableTime,
    read_table_log,
)
from osl_analysis.ingest.units import Unit
from osl_analysis.trial import Array


def checked_address(text: str) -> str:
    """The text of an address as it is; refused if it is none."""
    parsed(text, inside=True)
    return text


AddressText = Annotated[str, AfterValidator(checked_address)]


class MatChannel(TableChannel):
    """One variable. A MATLAB file states no units, so that each channel needs one."""

    ADDRESS: ClassVar[str] = "variable"

    variable: AddressText
    """Its address in MATLAB's notation: `torque`, `Test.run(2).torque`, `data(:,3)`, `runs{2}.torque`. It is within
    `log_part`, unless it begins with `/`."""
    unit: Unit
    """Unit of the numbers, as laboratories spell it."""
    counter: AddressText | None = None
    """Address of the device's count of its samples. It tells which samples are missing."""

    @property
    def title(self) -> str:
        return self.variable


class MatTime(TableTime):
    """Where the time of a sample comes from: a variable, or the rate."""

    ADDRESS: ClassVar[str] = "variable"

    variable: AddressText | None = None
    """Address of the variable that holds time, as in `channels`."""

    @property
    def title(self) -> str:
        return str(self.variable)

    @model_validator(mode="after")
    def _one(self) -> "MatTime":
        if (self.variable is None) == (self.rate is None):
            raise ValueError(
                "state either the variable that holds time, with its unit, or the rate of the samples [Hz]"
            )
        if (self.variable is None) != (self.unit is None):
            raise ValueError("a variable of time needs its unit, and a rate has none; write as {variable: t, unit: s}")
        return self


class MatSource(TableSource):
    """A log in a MATLAB file of version 5 (`save -v6`, `-v7`) or 7.3."""

    format: Literal["mat"]
    """Format of the file."""
    log_part: str = ""
    """Address of the struct or cell that holds the trial, where the file holds several. That of the sample
    sheet replaces it."""
    most_missing: Share = 0.01
    """Largest share of a variable's numbers that may be NaN."""
    time: MatTime
    """Where the time of a sample comes from."""
    channels: dict[str, MatChannel] = Field(min_length=1)
    """The variable of each canonical column."""

    @field_validator("log_part")
    @classmethod
    def _is_part(cls, text: str) -> str:
        if text:
            parsed(text)
        return text

    def address(self, text: str) -> Address:
        part = parsed(self.log_part) if self.log_part else None
        return parsed(text, inside=part is not None and not text.startswith("/")).below(part)


def read_mat_log(path: Path, source: MatSource) -> Recording:
    """The variables that the source file maps, in SI units; time [s] counts from the first sample."""
    file, channels = open_mat(path), source.channels
    texts = [text for one in channels.values() for text in (one.variable, one.counter) if text]
    addresses = {text: within_part(path, source, text) for text in [*texts, *filter(None, [source.time.variable])]}
    variables = file.read({address.variable for address in addresses.values()})
    vectors = {text: vector_at(file, variables, address, source) for text, address in addresses.items()}
    reference = source.time.variable or texts[0]
    rows = vectors[reference].size
    for text, values in vectors.items():
        if values.size != rows:
            raise InputError(
                f"{path}: {text} has {values.size} numbers and {reference} has {rows}; name variables of one "
                "recording, or cut them to one length in MATLAB"
            )
    facts = {"version": file.version, "header": file.header, "log_part": source.log_part}
    recording = read_table_log(
        Table(path, rows, lambda text: TableColumn(vectors[text]), facts=facts, noun="sample"), source
    )
    found = {name: {"variable": addresses[one.variable].text} for name, one in channels.items()}
    return replace(recording, columns={name: {**one, **found[name]} for name, one in recording.columns.items()})


def within_part(path: Path, source: MatSource, text: str) -> Address:
    """An address of the source file; every refusal names the file."""
    try:
        return source.address(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def vector_at(file: MatFile, variables: Mapping[str, Value], address: Address, source: MatSource) -> Array:
    """The numbers (n,) at an address of the source file."""
    if address.variable not in file.names and not source.log_part:
        raise InputError(
            f"{file.path}: no variable '{address.variable}'; it has {listing(file.names, LISTED)}"
            f"{nearest(address.variable, file.names)}; if one of these holds it, name this one as `log_part`, "
            "in the sample sheet where it differs from trial to trial"
        )
    try:
        return vector(address, find(variables, file.names, address))
    except InputError as error:
        raise InputError(str(error) if str(file.path) in str(error) else f"{file.path}: {error}") from error


MOST_LISTED = 500  # largest number of variables that are listed
MOST_PARTS = 40  # largest number of parts that are named
FEWEST = 10  # numbers in the shortest vector that may be a signal
CLOCK = re.compile(r"(time|t|stamp|clock)(?![a-z])|time", re.IGNORECASE)
"""How the name of a variable of time begins."""


@dataclass(frozen=True)
class Leaf:
    """One variable or field that is no struct and no cell."""

    part: str  # address of what it is in; empty for the file itself
    name: str  # its own name, or the choice of a cell
    value: Value

    @property
    def address(self) -> str:
        joint = "." if self.part and not self.name.startswith("{") else ""
        return f"{self.part}{joint}{self.name}"


def inspect_mat(path: Path) -> Overview:
    """Variables, fields and cells with size, range and likely unit; what cannot be read; parts that are alike."""
    file = open_mat(path)
    leaves = [leaf for name, value in file.read(file.names).items() for leaf in leaves_of("", name, value)]
    facts = {"version": file.version, "header": file.header, "variables": str(len(file.names))}
    remarks = [
        f"{leaf.address} is a {leaf.value.described()}, which is not read; {leaf.value.remedy()}"
        for leaf in leaves
        if leaf.value.load is None and leaf.value.kind not in ("char", "struct", "cell")
    ]
    if len(leaves) > MOST_LISTED:
        remarks.append(f"and {len(leaves) - MOST_LISTED} more variables")
    alike = parts_alike(leaves)
    drafted = next(iter(alike.values()), [])
    channels = [channel_of(leaf) for leaf in leaves[:MOST_LISTED]]
    note, clocks = note_on_parts(list(alike)), clocks_of(drafted)
    named, questions = likely_clock({leaf.name: readings_of(leaf) for leaf in clocks}, "variables")
    left_open = [*[note] * bool(note), *questions]
    settings = settings_of(list(alike), next((leaf for leaf in clocks if leaf.name == named), None))
    return Overview("mat", facts, channels, remarks, settings, list(draft_channels(drafted)), left_open)


def note_on_parts(parts: Sequence[str]) -> str:
    """What to do about parts of a file that hold the same variables; empty for a single one."""
    named = listing([printable(part) for part in parts], MOST_PARTS)
    what = f"{len(parts)} parts hold the same variables: name one per trial in the column `log_part` of the sheet"
    return f"{what}: {named}" if len(parts) > 1 else ""


def leaves_of(part: str, name: str, value: Value) -> Iterator[Leaf]:
    here = Leaf(part, name, value)
    if value.kind == "struct" and value.elements:
        several = len(value.elements) > 1
        for number, fields in enumerate(value.elements, start=1):
            inside = f"{here.address}({number})" if several else here.address
            for field in value.fields:
                yield from leaves_of(inside, field, fields[field])
    elif value.kind == "cell" and value.cells:
        for number, cell in enumerate(value.cells, start=1):
            yield from leaves_of(here.address, f"{{{number}}}", cell)
    else:
        yield here


def readings_of(leaf: Leaf) -> Array:
    """The numbers of a variable, (n,); none if it has none."""
    value = leaf.value
    return np.asarray(value.load().ravel()) if value.load is not None and value.size else np.empty(0)


def channel_of(leaf: Leaf) -> RecordedChannel:
    value, note = leaf.value, ""
    values = readings_of(leaf)
    known = values[np.isfinite(values)]
    if known.size:
        note = f"from {known.min():.6g} to {known.max():.6g}" if known.size > 1 else f"{known[0]:.6g}"
        note += f", {values.size - known.size} x NaN or Inf" if known.size < values.size else ""
    is_time = is_signal(value) and seems_clock(leaf.name)
    rate, unit = rate_of(values) if is_time else None, likely_unit(leaf.name)
    if rate is not None:
        note += f", a clock, {rate:.6g} per unit{', ' * bool(gaps_text(values))}{gaps_text(values)}"
    note = f"'{value.text}'" if value.text else note
    size = value.described()
    return RecordedChannel(
        "variable",
        {"variable": leaf.address},
        "",
        value.size,
        None,
        note,
        size,
        likely_unit=unit or (unit_of_clock(values) if is_time else ""),
    )


def seems_clock(name: str) -> bool:
    """Whether a variable is called like a clock: `t`, `time_ms`, `timeJIM`."""
    return is_clock(name) or CLOCK.match(name) is not None


def is_signal(value: Value) -> bool:
    """Whether a value may be a signal: a vector of real numbers, or a matrix of columns."""
    return value.load is not None and len(value.shape) == 2 and max(value.shape) >= FEWEST


def parts_alike(leaves: Sequence[Leaf]) -> Mapping[str, list[Leaf]]:
    """The signals of the parts of the file that hold the same signals, by part: of the largest such group."""
    by_part: dict[str, list[Leaf]] = {}
    for leaf in leaves:
        if is_signal(leaf.value):
            by_part.setdefault(leaf.part, []).append(leaf)
    groups: dict[tuple[str, ...], dict[str, list[Leaf]]] = {}
    for part, own in by_part.items():
        groups.setdefault(tuple(leaf.name for leaf in own), {})[part] = own
    return max(groups.values(), key=lambda group: sum(map(len, group.values())), default={})


def clocks_of(drafted: Sequence[Leaf]) -> list[Leaf]:
    return [leaf for leaf in drafted if seems_clock(leaf.name) and 1 in leaf.value.shape]


def settings_of(parts: Sequence[str], clock: Leaf | None) -> dict[str, object]:
    """The fields of a source file that the file tells. Of several parts none is chosen."""
    part = parts[0] if len(parts) == 1 else ""
    time = {"variable": NAME_OF_TIME, "unit": UNKNOWN}
    if clock is not None:
        time = {"variable": clock.name, "unit": channel_of(clock).likely_unit or UNKNOWN}
    return {"clock": "master", **({"log_part": part} if part else {}), "time": time}


def draft_channels(drafted: Sequence[Leaf]) -> Iterator[RecordedChannel]:
    """The signals of one part by their names within it; each column of a matrix, or row if it has more columns."""
    for leaf in drafted:
        rows, columns = leaf.value.shape
        lines = [f"(:,{k + 1})" for k in range(columns)] if rows >= columns else [f"({k + 1},:)" for k in range(rows)]
        for line in lines if min(rows, columns) > 1 else [""]:
            yield replace(channel_of(leaf), address={"variable": f"{leaf.name}{line}"})
