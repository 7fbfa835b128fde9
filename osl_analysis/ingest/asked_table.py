"""The channels of a table that a source file asks for, at the rows that count.

Those of several devices are at the instants of all, masked where a device has no sample.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, naming
from osl_analysis.ingest.likely_clock import TIME_UNITS, may_be_clock
from osl_analysis.recording import Channel, End, Kind, Recording, Rows
from osl_analysis.source_file import TableSource
from osl_analysis.trial import Array
from osl_analysis.units import name_and_ending, si_factor

SECOND_NS = 1_000_000_000
STATE_RATE = "state the rate of the rows in Hz, as `time: {rate: HZ}`"


@dataclass(frozen=True)
class Table:
    """The channels of a log that a source file asks for, at the rows that count.

    Attributes
    ----------
    rows
        Of the file, for messages.
    values
        Readings (n,) by canonical column, NaN where one failed, masked where there is none.
    counters
        The device's count of samples (n,), by canonical column.
    clock
        Readings of the named clock (n,); None for rows at a rate.
    time
        Times [s] (n,) where the recording tells them.
    remarks
        What was left out, a sentence each.
    has_own_rows
        Whether several devices have rows of their own, in which the others are masked.
    """

    rows: Rows
    values: Mapping[str, NDArray[Any]]
    counters: Mapping[str, NDArray[Any]]
    clock: NDArray[Any] | None = None
    time: Array | None = None
    remarks: Sequence[str] = ()
    has_own_rows: bool = False

    def at(self, kept: NDArray[np.bool_]) -> "Table":
        """The same at some of its rows, (n,)."""
        if kept.all():
            return self
        lines = np.arange(1, self.rows.count + 1) if self.rows.lines is None else self.rows.lines
        return replace(
            self,
            rows=replace(self.rows, count=int(kept.sum()), lines=lines[kept]),
            values={column: values[kept] for column, values in self.values.items()},
            counters={column: counts[kept] for column, counts in self.counters.items()},
            clock=None if self.clock is None else self.clock[kept],
            time=None if self.time is None else self.time[kept],
        )


def read_table(
    recording: Recording,
    source: TableSource,
    channels: Mapping[str, Channel],
    clock: Channel | None,
) -> Table:
    """Read the asked channels to one table, at the instants of all if they differ."""
    counters: dict[str, Channel] = {}
    for column, setting in source.channels.items():
        if setting.counter is not None:
            counters[column] = recording.find({**setting.address, setting.ADDRESS: setting.counter})
    asked = [*channels.values(), *counters.values()]
    if clock is not None:
        asked.append(clock)
    elif not channels:
        raise InputError("nothing is read at its rate; name the column of time")
    first = asked[-1] if clock is not None else asked[0]
    is_cut = recording.loss.end == End.MISSING
    counts = {one.rows.count for one in asked}
    own_timing = clock is None and source.time.rate is None
    if len(counts) > 1 and is_cut and not own_timing:  # the file ends within the channels
        counts = {min(counts)}
    if own_timing:
        check_own_timing(channels, source)
    if clock is None and not is_cut:
        check_equal_counts(asked, own_timing)
    timings = {(one.rows.rate_hz, one.rows.start_s) for one in asked}
    if len(counts) > 1 or (own_timing and len(timings) > 1):
        return at_instants_of_all(recording, source, channels, counters, clock)

    count = counts.pop()
    values = {column: channel.values[:count] for column, channel in channels.items()}
    counted = {column: channel.values[:count] for column, channel in counters.items()}
    time = None
    if own_timing:
        assert first.rows.rate_hz is not None
        time = first.rows.start_s + np.arange(count) / first.rows.rate_hz
    table = Table(
        rows=replace(first.rows, count=count),
        values=values,
        counters=counted,
        clock=None if clock is None else clock.values[:count],
        time=time,
    )
    return table if clock is None else without_empty_rows(table)


def check_own_timing(channels: Mapping[str, Channel], source: TableSource) -> None:
    """Refuse channels whose timing the file does not tell."""
    for column, channel in channels.items():
        if channel.rows.rate_hz is None:
            key = source.time.ADDRESS
            raise InputError(
                f"{source.channels[column].title} has no timing of its own; name the {key} of"
                f" time, as `time: {{{key}: NAME, unit: s}}`, or {STATE_RATE}"
            )


def check_equal_counts(channels: Sequence[Channel], own_timing: bool) -> None:
    """Refuse channels of one timing, their own or a stated rate, with unequal counts.

    Some have lost values, nothing tells where, and all later ones would be early against the other
    channels.
    """
    first: dict[tuple[float | None, float] | None, Channel] = {}
    for channel in channels:
        timing = (channel.rows.rate_hz, channel.rows.start_s) if own_timing else None
        other = first.setdefault(timing, channel)
        if other.rows.count != channel.rows.count:
            raise InputError(
                f"channel '{channel.key}' has {channel.rows.count} values and '{other.key}' has"
                f" {other.rows.count} for one time: a segment has lost some, nothing tells where,"
                " or they are of two recordings; copy the file again, or name channels of one"
                " length"
            )


def without_empty_rows(table: Table) -> Table:
    """The table without rows in which nothing that was asked for has a value: a longer channel
    that is not asked, or lines of another device."""
    columns = [*table.values.values()]
    if table.clock is not None:
        columns.insert(0, table.clock)
    is_masked = np.ones(table.rows.count, bool)
    is_empty = np.ones(table.rows.count, bool)
    for values in columns:
        mask = np.ma.getmaskarray(values)
        is_masked &= mask
        readings = np.ma.getdata(values)
        if readings.dtype.kind == "f":
            mask = mask | np.isnan(readings)
        is_empty &= mask
        if not is_empty.any():
            return table
    if is_empty.all():
        return table
    last = int(np.flatnonzero(~is_empty)[-1])
    kept = ~is_masked
    kept[last + 1 :] = False
    left_out = int(is_masked[: last + 1].sum())
    shorter = table.at(kept)
    if not left_out:
        return shorter
    first = table.rows.place(int(np.argmax(is_masked)))
    remark = (
        f"{left_out} of {last + 1} {table.rows.noun}s have none of the asked values and were left"
        f" out, first {first}"
    )
    return replace(shorter, remarks=[remark])


def at_instants_of_all(
    recording: Recording,
    source: TableSource,
    channels: Mapping[str, Channel],
    counters: Mapping[str, Channel],
    clock: Channel | None,
) -> Table:
    """Put the channels of several devices at the instants of all, masked where a device has no
    sample. All clocks are taken to count from one origin."""
    stamps: dict[int, NDArray[np.int64]] = {}
    for channel in [*channels.values(), *counters.values()]:
        if id(channel.rows) not in stamps:
            stamps[id(channel.rows)] = own_stamps_ns(recording, source, channel, channels, clock)
    latest_begin = max(int(own[0]) for own in stamps.values())
    earliest_end = min(int(own[-1]) for own in stamps.values())
    if latest_begin > earliest_end:
        raise InputError(
            f"its channels do not overlap in time; name those of one recording, or {STATE_RATE}"
        )
    union = np.unique(np.concatenate([*stamps.values()]))

    def placed(channel: Channel) -> NDArray[Any]:
        values = np.ma.array(np.zeros(union.size, channel.values.dtype), mask=True)
        values[np.searchsorted(union, stamps[id(channel.rows)])] = channel.values
        return np.ma.asarray(values)

    return Table(
        rows=Rows(count=union.size, noun="sample"),
        values={column: placed(channel) for column, channel in channels.items()},
        counters={column: placed(channel) for column, channel in counters.items()},
        time=union / SECOND_NS,
        has_own_rows=True,
    )


def own_stamps_ns(
    recording: Recording,
    source: TableSource,
    channel: Channel,
    channels: Mapping[str, Channel],
    clock: Channel | None,
) -> NDArray[np.int64]:
    """The instants [ns] of a channel, (n,): by its own timing, by the named clock, or by the only
    one beside it.

    Raises
    ------
    InputError
        No clock, or several clocks of its length are beside it.
    """
    rows = channel.rows
    if clock is None and source.time.rate is None:
        assert rows.rate_hz is not None
        after_ns = np.rint(np.arange(rows.count) / rows.rate_hz * SECOND_NS)
        return round(rows.start_s * SECOND_NS) + after_ns.astype(np.int64)
    own: list[Channel] = []
    if clock is not None and clock.rows.count == rows.count:
        own = [clock]
    elif clock is not None:
        own = [one for one in recording.channels if one.rows is rows and is_clock_beside(one)]
    readings = own[0].values if len(own) == 1 else np.zeros(0)
    if len(own) != 1 or np.ma.is_masked(readings) or not (np.diff(readings) > 0).all():
        reference = clock or next(iter(channels.values()))
        raise InputError(
            f"{channel.key} has {rows.count} numbers and {reference.key} has"
            f" {reference.rows.count}, and no one vector of time of its length is beside it;"
            " interpolate it to the times of the others, as `torque = interp1(t_torque, torque,"
            " t_angle)`, and never cut to one length"
        )
    assert clock is not None
    factor = clock_factor(clock, source)
    ending = name_and_ending(own[0].name or own[0].key)[1]
    if own[0] is not clock and (own[0].unit or ending in TIME_UNITS):
        factor = si_factor(own[0].unit or ending, "s")
    return np.asarray(np.rint(readings * factor * SECOND_NS).astype(np.int64))


def is_clock_beside(channel: Channel) -> bool:
    if channel.kind == Kind.CLOCK:
        return True
    values = np.ma.getdata(channel.values)
    if values.ndim != 1 or values.dtype.kind not in "iuf":
        return False
    return may_be_clock(channel.name or channel.key, channel.unit, values)


def clock_factor(clock: Channel, source: TableSource) -> float:
    """Seconds per unit of a clock."""
    if clock.kind == Kind.CLOCK:
        if source.time.unit is not None:
            raise InputError(
                f"{source.time.title} is a stamp whose unit is known; remove"
                f" {source.place('time', 'unit')}"
            )
        return 1 / SECOND_NS
    unit = clock.unit if source.time.unit is None else source.time.unit
    with naming(source.time.title, f", as {source.place('time', 'unit')}"):
        return si_factor(unit, "s")


def with_own_rows(table: Table) -> Table:
    """The table with failed readings masked where several devices write rows of their own into one
    log. Columns are of two such devices if no row has readings of both."""
    failed: dict[str, NDArray[np.bool_]] = {}
    for column, values in table.values.items():
        if values.dtype.kind == "f":
            is_failed = np.isnan(np.ma.getdata(values))
            if is_failed.any() and not is_failed.all():
                failed[column] = is_failed
    apart: list[str] = []
    for column, own in failed.items():
        for other in failed.values():
            if (own | other).all() and not other.all():
                apart.append(column)
                break
    if len(apart) < 2:
        return table
    masked = {column: np.ma.masked_where(failed[column], table.values[column]) for column in apart}
    return replace(table, values={**table.values, **masked})
