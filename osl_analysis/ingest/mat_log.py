"""A log in a MATLAB file: its source file, its reader, and what it holds."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import polars as pl
from pydantic import Field, field_validator, model_validator

from osl_analysis.columns import counter_column, unit_of
from osl_analysis.errors import InputError, listing, nearest, printable
from osl_analysis.formats.mat.address import LISTED, Address, find, parsed, vector
from osl_analysis.formats.mat.mat_file import MatFile, open_mat
from osl_analysis.formats.mat.values import Value
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
from osl_analysis.ingest.recording import Recording, check_values
from osl_analysis.ingest.source_fields import Conversion, LogSource
from osl_analysis.ingest.table_log import RowStamps, RowTime, Share, since_first
from osl_analysis.ingest.units import Unit, si_factor
from osl_analysis.trial import Array


def checked_address(text: str | None) -> str | None:
    """The text of an address as it is; refused if it is none."""
    if text is not None:
        parsed(text, inside=True)
    return text


class MatChannel(Conversion):
    """One variable. A MATLAB file states no units, so that each channel needs one."""

    variable: str
    """Its address in MATLAB's notation: `torque`, `Test.run(2).torque`, `data(:,3)`, `runs{2}.torque`. It is within
    `log_part`, unless it begins with `/`."""
    unit: Unit
    """Unit of the numbers, as laboratories spell it."""
    counter: str | None = None
    """Address of the device's count of its samples. It tells which samples are missing."""

    @field_validator("variable", "counter")
    @classmethod
    def _is_address(cls, text: str | None) -> str | None:
        return checked_address(text)


class MatTime(RowTime):
    """Where the time of a sample comes from: a variable, or the rate."""

    variable: str | None = None
    """Address of the variable that holds time, as in `channels`."""

    @field_validator("variable")
    @classmethod
    def _is_address(cls, text: str | None) -> str | None:
        return checked_address(text)

    @model_validator(mode="after")
    def _one(self) -> "MatTime":
        if (self.variable is None) == (self.rate is None):
            raise ValueError(
                "state either the variable that holds time, with its unit, or the rate of the samples [Hz]"
            )
        if (self.variable is None) != (self.unit is None):
            raise ValueError("a variable of time needs its unit, and a rate has none; write as {variable: t, unit: s}")
        return self


class MatSource(LogSource):
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
        """An address of the source file within the part of the trial."""
        part = parsed(self.log_part) if self.log_part else None
        return parsed(text, inside=part is not None and not text.startswith("/")).below(part)


class Signals:
    """The vectors of one file that a source file asks for."""

    def __init__(self, file: MatFile, source: MatSource) -> None:
        """Reads the variables of all addresses of the source file; an address of another file's kind is refused."""
        self.file, self.source = file, source
        texts = [channel.variable for channel in source.channels.values()]
        texts += [channel.counter for channel in source.channels.values() if channel.counter]
        texts += [source.time.variable] if source.time.variable else []
        addresses = [self.within_part(text) for text in texts]
        self.variables: Mapping[str, Value] = file.read({address.variable for address in addresses})

    def within_part(self, text: str) -> Address:
        """An address of the source file; every refusal names the file."""
        try:
            return self.source.address(text)
        except InputError as error:
            raise InputError(f"{self.file.path}: {error}") from error

    def vector(self, text: str) -> Array:
        """The numbers (n,) at an address of the source file.

        Raises
        ------
        InputError
            There is nothing, or no vector of real numbers.
        """
        address = self.within_part(text)
        if address.variable not in self.file.names and not self.source.log_part:
            raise InputError(
                f"{self.file.path}: no variable '{address.variable}'; it has {listing(self.file.names, LISTED)}"
                f"{nearest(address.variable, self.file.names)}; if one of these holds it, name this one as `log_part`, "
                "in the sample sheet where it differs from trial to trial"
            )
        try:
            return vector(address, find(self.variables, self.file.names, address))
        except InputError as error:
            raise InputError(
                str(error) if str(self.file.path) in str(error) else f"{self.file.path}: {error}"
            ) from error


def read_mat_log(path: Path, source: MatSource) -> Recording:
    """The variables that the source file maps, in SI units; time [s] counts from the first sample.

    Raises
    ------
    InputError
        The file is damaged, a variable is missing or holds no vector of real numbers, vectors differ in length, too
        many numbers are NaN, or time goes back.
    """
    signals = Signals(open_mat(path), source)
    raw = {column: signals.vector(channel.variable) for column, channel in source.channels.items()}
    time, start = time_of(signals, next(iter(raw.values())).size)
    check_lengths(signals, raw, time)
    check_own_variables(path, source)
    columns, origins = [pl.Series("time", time)], {}
    for column, channel in source.channels.items():
        check_values(f"{path}: {channel.variable}", raw[column], time, source.most_missing)
        columns.append(pl.Series(column, channel.to_si(raw[column], unit_of(column))))
        if channel.counter is not None:
            columns.append(counter_of(signals, channel.counter, time).alias(counter_column(column)))
        origins[column] = {**channel.origin(column), "variable": signals.within_part(channel.variable).text}
    stamps = RowStamps(time, source.time)
    missing = {column: int(np.isnan(values).sum()) for column, values in raw.items()}
    facts = {
        **stamps.facts(path.name, start),
        "missing": missing,
        "version": signals.file.version,
        "header": signals.file.header,
        "log_part": source.log_part,
    }
    warnings = [f"{path.name}: {column} is NaN in {n} of {time.size} samples" for column, n in missing.items() if n]
    repeats = f"{path.name}: {stamps.repeats} samples repeat the stamp of the sample before"
    warnings += stamps.repeats_text(repeats, source.place("time"))
    return Recording(pl.DataFrame(columns).filter(pl.Series(stamps.kept)), origins, facts, warnings)


def time_of(signals: Signals, samples: int) -> tuple[Array, float]:
    """Time [s] of every sample since the first one, and the reading of the clock at the first one."""
    path, source = signals.file.path, signals.source.time
    if source.rate is not None:
        return np.arange(samples) / source.rate, 0.0
    raw = signals.vector(str(source.variable))
    factor, what = si_factor(str(source.unit), "s"), f"{path}: {source.variable}"
    advice = "samples; take another variable, or state the rate of the samples: `time: {rate: 1000}`"
    return since_first(raw, factor, what, advice), float(raw[0])


def check_lengths(signals: Signals, raw: Mapping[str, Array], time: Array) -> None:
    """Refuse vectors (n,) of other lengths than time, or than the first of them where there is no time."""
    source = signals.source
    reference = source.time.variable or next(iter(source.channels.values())).variable
    for column, values in raw.items():
        if values.size != time.size:
            raise InputError(
                f"{signals.file.path}: {source.channels[column].variable} has {values.size} numbers and {reference} "
                f"has {time.size}; name variables of one recording, or cut them to one length in MATLAB"
            )


def check_own_variables(path: Path, source: MatSource) -> None:
    """Refuse two signals of different units, such as angle and torque, from one variable."""
    by_address: dict[str, str] = {}
    for column, channel in source.channels.items():
        other = by_address.setdefault(str(source.address(channel.variable).steps), column)
        if unit_of(other) != unit_of(column):
            raise InputError(
                f"{path}: {channel.variable} is {other} and {column} in the source file; correct "
                f"{source.place('channels', column, 'variable')}"
            )


def counter_of(signals: Signals, text: str, time: Array) -> pl.Series:
    """The device's count of its samples, (n,); refused where it is missing or not whole."""
    raw = signals.vector(text)
    wrong = raw != np.rint(raw)
    if wrong.any() or raw.size != time.size:
        what = f"{raw[np.argmax(wrong)]} is no count" if wrong.any() else f"{raw.size} counts of {time.size} samples"
        raise InputError(f"{signals.file.path}: {text}: {what}; remove `counter` from the source file")
    return pl.Series(raw.astype(np.int64))


MOST_LISTED = 500
"""Largest number of variables that are listed."""
MOST_PARTS = 40
"""Largest number of parts that are named."""
FEWEST = 10
"""Numbers in the shortest vector that may be a signal."""
CLOCK = re.compile(r"(time|t|stamp|clock)(?![a-z])|time", re.IGNORECASE)
"""How the name of a variable of time begins."""


@dataclass(frozen=True)
class Leaf:
    """One variable or field that is no struct and no cell."""

    part: str
    """Address of what it is in; empty for the file itself."""
    name: str
    """Its own name, or the choice of a cell."""
    value: Value
    """What it is."""

    @property
    def address(self) -> str:
        """Its address in the file."""
        joint = "." if self.part and not self.name.startswith("{") else ""
        return f"{self.part}{joint}{self.name}"


def inspect_mat(path: Path) -> Overview:
    """Variables, fields and cells with size, range and likely unit; what cannot be read; parts that are alike.

    Raises
    ------
    InputError
        The file is damaged, or would unpack to too much.
    """
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
    """The variables below one of them, in the order of the file."""
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
    """One variable for the list."""
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
    """The signals of a part that may be its time."""
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
