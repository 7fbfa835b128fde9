"""The channels of a table that a source file asks for, at the rows that count.

Channels of which the file tells other timings are at the instants of all, masked elsewhere.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, naming
from osl_analysis.recording import Channel, End, Kind, Recording, Rows
from osl_analysis.source_file import TableSource
from osl_analysis.trial import Array
from osl_analysis.units import si_factor

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
        Whether channels have timings of their own, and the others are masked in their rows.
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
    if own_timing and (len(counts) > 1 or len(timings) > 1):
        return at_instants_of_all(channels, counters)
    if len(counts) > 1:
        shortest = min(asked, key=lambda one: one.rows.count)
        longest = max(asked, key=lambda one: one.rows.count)
        raise InputError(
            f"{shortest.key} has {shortest.rows.count} numbers and {longest.key} has"
            f" {longest.rows.count}: save channels of one length, as `torque ="
            " interp1(t_torque, torque, t_angle)`, and never cut to one length"
        )

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


def at_instants_of_all(channels: Mapping[str, Channel], counters: Mapping[str, Channel]) -> Table:
    """Put channels with timings of their own at the instants of all, masked where one has no
    sample. All timings count from one origin."""
    stamps: dict[int, NDArray[np.int64]] = {}
    for channel in [*channels.values(), *counters.values()]:
        rows = channel.rows
        assert rows.rate_hz is not None
        after_ns = np.rint(np.arange(rows.count) / rows.rate_hz * SECOND_NS)
        stamps[id(rows)] = round(rows.start_s * SECOND_NS) + after_ns.astype(np.int64)
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


def check_common_rows(table: Table) -> None:
    """Refuse columns of which no row has readings of both, as where several devices write rows of
    their own into one log."""
    failed: dict[str, NDArray[np.bool_]] = {}
    for column, values in table.values.items():
        if values.dtype.kind == "f":
            failed[column] = np.isnan(np.ma.getdata(values))
    for column, other in combinations(failed, 2):
        is_apart = (failed[column] | failed[other]).all()
        if is_apart and not failed[column].all() and not failed[other].all():
            raise InputError(
                f"no {table.rows.noun} has both {column} and {other}, as of two devices; export"
                " both at common times, such as `interp1` gives, or record one log of messages"
            )
