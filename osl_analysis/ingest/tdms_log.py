"""A log in LabVIEW's TDMS: its source file, its reader, and what it holds."""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Literal, NamedTuple

import numpy as np
import polars as pl
from pydantic import Field

from osl_analysis.errors import InputError
from osl_analysis.formats.tdms import TdmsChannel, TdmsFile, read_tdms
from osl_analysis.ingest.message_log import joined_on_stamp
from osl_analysis.ingest.overview import (
    NAME_OF_TIME,
    UNKNOWN,
    Overview,
    RecordedChannel,
    clocks_among,
    likely_clock,
    likely_unit,
)
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.stamps import SECOND
from osl_analysis.ingest.table_log import Table, TableChannel, TableColumn, TableSource, TableTime, read_table_log
from osl_analysis.trial import Array


class Timing(NamedTuple):
    """When a channel was sampled."""

    begin: int
    """Instant from which `offset` counts, since 1970 [us]."""
    offset: float
    """Time of the first value [s]."""
    step: float | None
    """Time between two values [s]; None where the source file tells it."""
    length: int
    """Number of values; 0 where the source file tells their time."""


class TdmsLogChannel(TableChannel):
    """One channel. Without `unit`, the unit in its properties is used (`unit_string`)."""

    ADDRESS: ClassVar[str] = "channel"

    channel: str
    """Group and name, as `Measured Data/Torque`, or the name alone where one group only has it."""


class TdmsTime(TableTime):
    """Where the time of a value comes from. Without anything: the channels' own timing (`wf_increment`)."""

    ADDRESS: ClassVar[str] = "channel"
    IN_FILE: ClassVar[bool] = True

    channel: str | None = None
    """The channel that holds time. LabVIEW's time stamps need no unit."""


class TdmsSource(TableSource):
    """A log in TDMS."""

    format: Literal["tdms"]
    """Format of the file."""
    time: TdmsTime = TdmsTime()
    """Where the time of a value comes from."""
    channels: dict[str, TdmsLogChannel] = Field(min_length=1)
    """The channel of each canonical column."""


def read_tdms_log(path: Path, source: TdmsSource) -> Recording:
    """The columns that the source file maps, in SI units; time [s] counts from the first value.

    Channels of another timing have rows of their own, null in the columns of the others. Nothing is interpolated.
    """
    file = read_tdms(path)
    alike: dict[Timing, list[str]] = defaultdict(list)
    for column, channel in source.channels.items():
        alike[timing_of(file, file.channel(channel.channel), source)].append(column)
    first = min(timing.begin for timing in alike)
    parts = []
    for timing, columns in alike.items():
        some = source.model_copy(update={"channels": {name: source.channels[name] for name in columns}})
        parts.append((timing.offset + (timing.begin - first) * 1e-6, part_of(file, some, timing)))
    return parts[0][1] if len(parts) == 1 else joined(path, parts)


def timing_of(file: TdmsFile, channel: TdmsChannel, source: TdmsSource) -> Timing:
    """When a channel was sampled, by its own properties; its length alone where the source file tells the time."""
    if source.time.channel is not None or source.time.rate is not None:
        return Timing(0, 0.0, None, 0)
    if channel.step is None:
        raise InputError(
            f"{file.path}: channel '{channel.address}' has no timing (`wf_increment` among its properties); name the "
            "channel of time, as `time: {channel: GROUP/NAME, unit: s}`, or state the rate: `time: {rate: 1000}`"
        )
    return Timing(channel.begin, channel.offset, channel.step, channel.count)


def part_of(file: TdmsFile, source: TdmsSource, timing: Timing) -> Recording:
    names = [name for one in source.channels.values() for name in (one.channel, one.counter) if name]
    wanted = [file.channel(name) for name in dict.fromkeys([*names, *filter(None, [source.time.channel])])]
    for one in wanted:
        if one.count != wanted[0].count:
            raise InputError(
                f"{file.path}: channel '{one.address}' has {one.count} values and '{wanted[0].address}' has "
                f"{wanted[0].count}; name channels of one recording, or export those of each length on their own"
            )
    values = file.values(wanted)

    def column(name: str) -> TableColumn:
        """A channel of the file."""
        channel = file.channel(name)
        return TableColumn(values[channel.address], unit="s" if channel.holds_times else channel.unit)

    damage = {"damage": {"complete": False, "messages_lost": None, "remarks": list(file.notes)}} if file.notes else {}
    table = Table(file.path, wanted[0].count, column, [f"{file.path.name}: {note}" for note in file.notes], damage)
    own = None if timing.step is None else np.asarray(np.arange(timing.length) * timing.step, dtype=np.float64)
    return read_table_log(table, source, own)


def joined(path: Path, parts: Sequence[tuple[float, Recording]]) -> Recording:
    """Recordings of several timings as one, each with the time [s] by which it begins after the first."""
    last = max(start for start, _ in parts)
    lasts = min(start + float(one.samples["time"][-1]) for start, one in parts)
    if last > lasts:
        raise InputError(
            f"{path}: its channels begin up to {last:.3f} s apart and do not overlap; name channels of one task, or "
            "state the rate: `time: {rate: 1000}`"
        )
    stamps = []
    for start, one in parts:
        stamp = ((pl.col("time") + start) * SECOND).round().cast(pl.Int64).alias("stamp")
        stamps.append(one.samples.select(stamp, pl.exclude("time")))
    table = joined_on_stamp(stamps)
    time = ((table["stamp"] - int(table["stamp"][0])) / SECOND).alias("time")
    recordings = [one for _, one in parts]
    rates = {", ".join(one.columns): one.facts["rates_hz"][path.name] for one in recordings}
    facts = {**recordings[0].facts, "rates_hz": rates}
    facts["missing"] = {name: count for one in recordings for name, count in one.facts["missing"].items()}
    warnings = list(dict.fromkeys(text for one in recordings for text in one.warnings))
    origins = {name: origin for one in recordings for name, origin in one.columns.items()}
    return Recording(table.select(time, pl.exclude("stamp")), origins, facts, warnings)


def inspect_tdms(path: Path) -> Overview:
    """Channels with unit, range and rate by their own timing; raises InputError as `read_tdms`."""
    file = read_tdms(path)
    stamps = [one.address for one in file.channels if one.holds_times and one.count]
    timed = any(one.step is not None for one in file.channels)
    remarks = list(file.notes)
    notes = ranges_of(file, remarks)
    channels = [
        RecordedChannel(
            "channel",
            {"channel": one.address},
            one.unit,
            one.count,
            1 / one.step if one.step else None,
            notes.get(one.address, "no numbers"),
            np.dtype(one.kind).name,
            "" if one.unit else likely_unit(one.name),
        )
        for one in file.channels
    ]
    settings: dict[str, object] = {"clock": "master"}
    left_open = list[str]()
    if not timed:
        named, left_open = likely_clock(clock_readings(file), "channels")
        clock = named or ("" if left_open else next(iter(stamps), "")) or NAME_OF_TIME
        settings["time"] = {"channel": clock, "unit": UNKNOWN if clock not in stamps else "s"}
    facts = {"channels": str(len(file.channels)), "own timing": "yes" if timed else "no", **file.properties}
    drafted = [one for one, own in zip(channels, file.channels, strict=True) if own.count and own.holds_numbers]
    return Overview("tdms", facts, channels, remarks, settings, drafted, left_open)


def clock_readings(file: TdmsFile) -> dict[str, Array]:
    """The readings of all channels that are called like a clock, by address, the shortest way first."""
    addresses = {one.address.replace(".", "_").replace("/", "."): one for one in file.channels}
    called = [addresses[path] for path in clocks_among(list(addresses)) if addresses[path].count]
    try:
        values = file.values([one for one in called if one.holds_numbers or one.holds_times])
    except InputError:  # what cannot be read is remarked beside its range
        values = {}
    return {one.address: np.asarray(values.get(one.address, np.empty(0)), np.float64) for one in called}


def ranges_of(file: TdmsFile, remarks: list[str]) -> dict[str, str]:
    """Smallest and largest value of each channel that holds numbers, in words; what cannot be read is remarked."""
    readable = [one for one in file.channels if one.count and one.holds_numbers]
    try:
        values = file.values(readable)
    except InputError:
        values = {}
        for one in readable:
            try:
                values |= file.values([one])
            except InputError as error:
                remarks.append(str(error).removeprefix(f"{file.path}: "))
    found = {}
    for address, numbers in values.items():
        known = numbers[np.isfinite(numbers)].astype(np.float64)
        lost = f", {numbers.size - known.size} x NaN or infinity" if known.size < numbers.size else ""
        found[address] = f"from {known.min():.6g} to {known.max():.6g}{lost}" if known.size else f"no numbers{lost}"
    return found
