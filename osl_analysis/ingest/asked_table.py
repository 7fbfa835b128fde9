"""The channels of a table that a source file asks for, at the rows that count, and their times.

Channels of which the file tells other timings are at the instants of all, masked elsewhere. Rows of
another time are left out; a clock that stands still or stays back is refused.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, naming
from osl_analysis.ingest.likely_clock import unwrapped
from osl_analysis.ingest.stale_rows import find_stale_rows, remarks_on_stale_rows
from osl_analysis.recording import Channel, End, Kind, Recording, Rows
from osl_analysis.source_file import TableSource
from osl_analysis.trial import Array, check_time
from osl_analysis.units import si_factor

SECOND_NS = 1_000_000_000
STATE_RATE = "state the rate of the rows in Hz, as `time: {rate: HZ}`"
COARSE_STEP_S = 0.4  # stamps this far apart tell seconds, not samples
COARSE_ROWS = 20  # rows with one stamp: beyond it the stamps are coarse, or the clock stopped
COARSE_SHARE = 0.1  # of the rows with one stamp, as above


@dataclass(frozen=True)
class Table:
    """The channels of a log that a source file asks for, at the rows that count.

    Attributes
    ----------
    rows
        Of the file, for messages.
    time
        Times [s] (n,).
    values
        Readings (n,) by canonical column, NaN where one failed, masked where there is none.
    counters
        The device's count of samples (n,), by canonical column.
    clock
        Readings of the named clock (n,); None for rows at a rate.
    remarks
        What was left out, a sentence each.
    has_own_rows
        Whether channels have timings of their own, and the others are masked in their rows.
    """

    rows: Rows
    time: Array
    values: Mapping[str, NDArray[Any]]
    counters: Mapping[str, NDArray[Any]]
    clock: NDArray[Any] | None = None
    remarks: Sequence[str] = ()
    has_own_rows: bool = False

    def at(self, kept: NDArray[np.bool_], remarks: Sequence[str]) -> "Table":
        """The same at some of its rows, (n,), with further remarks."""
        if kept.all():
            return replace(self, remarks=[*self.remarks, *remarks])
        lines = np.arange(1, self.rows.count + 1) if self.rows.lines is None else self.rows.lines
        return replace(
            self,
            rows=replace(self.rows, count=int(kept.sum()), lines=lines[kept]),
            time=self.time[kept],
            values={column: values[kept] for column, values in self.values.items()},
            counters={column: counts[kept] for column, counts in self.counters.items()},
            clock=None if self.clock is None else self.clock[kept],
            remarks=[*self.remarks, *remarks],
        )


def read_table(
    recording: Recording,
    source: TableSource,
    channels: Mapping[str, Channel],
    clock: Channel | None,
) -> Table:
    """Read the asked channels to one table, at the instants of all if they differ.

    Raises
    ------
    InputError
        Channels have no timing, unequal lengths, or no row in common; or the clock has no reading
        in some row, stands still or stays back.
    """
    counters: dict[str, Channel] = {}
    for column, setting in source.channels.items():
        if setting.counter is not None:
            counters[column] = recording.find({**setting.address, setting.ADDRESS: setting.counter})
    asked = [*channels.values(), *counters.values()]
    if clock is not None:
        asked.append(clock)
    if not asked:
        raise InputError("nothing is read at its rate; name the column of time")
    own_timing = clock is None and source.time.rate is None
    if own_timing:
        check_own_timing(channels, source)
    of_one_timing: dict[object, list[Channel]] = {}
    for channel in asked:
        timing = (channel.rows.rate_hz, channel.rows.start_s) if own_timing else None
        of_one_timing.setdefault(timing, []).append(channel)
    if recording.loss.end != End.MISSING:  # else the file ends within the channels
        for alike in of_one_timing.values():
            check_equal_counts(alike)
    count = min(channel.rows.count for channel in asked)
    is_longer = any(channel.rows.count > count for channel in asked)
    if own_timing and (len(of_one_timing) > 1 or is_longer):
        return at_instants_of_all(channels, counters)
    rate_hz = source.time.rate if source.time.rate is not None else asked[0].rows.rate_hz
    table = Table(
        rows=replace(asked[0].rows, count=count),
        time=np.arange(count) / (rate_hz or 1.0),
        values={column: channel.values[:count] for column, channel in channels.items()},
        counters={column: channel.values[:count] for column, channel in counters.items()},
    )
    if clock is None:
        return replace(table, time=table.time + (asked[0].rows.start_s if own_timing else 0.0))
    table = without_empty_rows(replace(table, clock=clock.values[:count]))
    return with_clock(table, source, clock)


def check_own_timing(channels: Mapping[str, Channel], source: TableSource) -> None:
    """Refuse channels whose timing the file does not tell."""
    for column, channel in channels.items():
        if channel.rows.rate_hz is None:
            key = source.time.ADDRESS
            raise InputError(
                f"{source.channels[column].title} has no timing of its own; name the {key} of"
                f" time, as `time: {{{key}: NAME, unit: s}}`, or {STATE_RATE}"
            )


def check_equal_counts(channels: Sequence[Channel]) -> None:
    """Refuse channels of one timing with unequal counts.

    Some have lost values, nothing tells where, and all later ones would be early against the other
    channels.
    """
    shortest = min(channels, key=lambda one: one.rows.count)
    longest = max(channels, key=lambda one: one.rows.count)
    if shortest.rows.count < longest.rows.count:
        raise InputError(
            f"channel '{longest.key}' has {longest.rows.count} values and '{shortest.key}' has"
            f" {shortest.rows.count} for one time, and nothing tells which are lost: save channels"
            " of one length, as `torque = interp1(t_torque, torque, t_angle)`, and never cut to one"
            " length"
        )


def without_empty_rows(table: Table) -> Table:
    """The table without rows in which nothing that was asked for has a value: a longer channel
    that is not asked, or lines of another device."""
    is_empty = np.ones(table.rows.count, bool)
    for values in (table.clock, *table.values.values()):
        is_empty &= np.isnan(np.ma.filled(np.ma.asarray(values).astype(np.float64), np.nan))
        if not is_empty.any():
            return table
    if is_empty.all():
        return table
    last = int(np.flatnonzero(~is_empty)[-1])
    left_out = int(is_empty[:last].sum())
    remarks: list[str] = []
    if left_out:
        first = table.rows.place(int(np.argmax(is_empty)))
        remarks.append(
            f"{left_out} of {last + 1} {table.rows.noun}s have none of the asked values and were"
            f" left out, first {first}"
        )
    return table.at(~is_empty, remarks)


def at_instants_of_all(channels: Mapping[str, Channel], counters: Mapping[str, Channel]) -> Table:
    """Put channels with timings of their own at the instants of all, masked where one has no
    sample. All timings count from one origin."""
    stamps: dict[int, NDArray[np.int64]] = {}
    for channel in (*channels.values(), *counters.values()):
        rows = channel.rows
        after_ns = np.rint(np.arange(rows.count) / (rows.rate_hz or 1.0) * SECOND_NS)
        stamps[id(rows)] = round(rows.start_s * SECOND_NS) + after_ns.astype(np.int64)
    if max(own[0] for own in stamps.values()) > min(own[-1] for own in stamps.values()):
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
        time=union / SECOND_NS,
        values={column: placed(channel) for column, channel in channels.items()},
        counters={column: placed(channel) for column, channel in counters.items()},
        has_own_rows=True,
    )


def check_common_rows(table: Table) -> None:
    """Refuse columns of which no row has readings of both, as where several devices write rows of
    their own into one log."""
    lacking: dict[str, NDArray[np.bool_]] = {}
    for column, values in table.values.items():
        lacks = np.isnan(np.ma.getdata(values).astype(np.float64))
        if not lacks.all():
            lacking[column] = lacks
    for column, other in combinations(lacking, 2):
        if (lacking[column] | lacking[other]).all():
            raise InputError(
                f"no {table.rows.noun} has both {column} and {other}, as of two devices; export"
                " both at common times, such as `interp1` gives, or record one log of messages"
            )


def with_clock(table: Table, source: TableSource, clock: Channel) -> Table:
    """Give the rows that count at the times [s] that a named clock tells."""
    assert table.clock is not None
    what = source.time.title
    other = f"take another {source.time.ADDRESS}, or {STATE_RATE}"
    raw = np.ma.getdata(table.clock)
    lacks = np.isnan(raw.astype(np.float64)) | np.ma.getmaskarray(table.clock)
    if raw.dtype == bool or lacks.any():
        place = table.rows.place(int(np.argmax(lacks)))
        raise InputError(f"{what}: no time in {place}; remove it there, {other}")
    rate_hz = source.time.rate
    factor = 1 / rate_hz if rate_hz is not None else clock_factor(clock, source)
    if rate_hz is not None and (raw != np.rint(raw)).any():
        row = int(np.argmax(raw != np.rint(raw)))
        raise InputError(
            f"{what}: {raw[row]} in {table.rows.place(row)} is no count of samples, which a column"
            " beside `rate` is; state its unit in place of the rate"
        )
    if raw.dtype.kind == "f":  # single precision would round the differences
        raw = raw.astype(np.float64)
    raw, bits, turns = unwrapped(raw)
    remarks: list[str] = []
    if turns:
        remarks.append(
            f"{what} counts to 2**{bits} and began anew {turns} times; it is taken to go on"
        )
    stale = find_stale_rows(raw)
    remarks += remarks_on_stale_rows(table.rows, raw, stale, factor)
    table = table.at(~np.isin(np.arange(raw.size), stale), remarks)
    raw = np.delete(raw, stale)
    time = np.asarray((raw - raw[0]) * factor, dtype=np.float64)
    check_time(what, time)
    check_clock_runs(table.rows, source, time, float(raw[0]) * factor)
    return replace(table, time=time, clock=raw)


def clock_factor(clock: Channel, source: TableSource) -> float:
    """Seconds per unit of a clock."""
    place = source.place("time", "unit")
    if clock.kind == Kind.CLOCK and source.time.unit is not None:
        raise InputError(f"{source.time.title} is a stamp whose unit is known; remove {place}")
    unit = clock.unit if source.time.unit is None else source.time.unit
    with naming(source.time.title, f", as {place}"):
        return si_factor(unit, "s")


def check_clock_runs(rows: Rows, source: TableSource, time: Array, start_s: float) -> None:
    """Refuse a clock (n,) that stands still, or tells whole seconds and no less."""
    first = np.flatnonzero(np.diff(time, prepend=-1.0))  # rows with a stamp of their own
    counts = np.diff(first, append=time.size)
    steps = np.diff(time[first])
    most = int(counts.max())
    are_seconds = first.size > 3 and np.median(steps) > COARSE_STEP_S
    is_coarse = most > COARSE_ROWS and (most > COARSE_SHARE * time.size or are_seconds)
    if time.size == 1 or (first.size > 1 and not (is_coarse and source.time.repeated != "drop")):
        return
    other = f"take another {source.time.ADDRESS}, or {STATE_RATE}"
    if first.size > 3:  # whole seconds still tell the rate, from the first change to the last
        other += f": its stamps tell {(first[-1] - first[1]) / steps[1:].sum():.4g}"
    row = int(first[counts.argmax()])
    raise InputError(
        f"{source.time.title}: time stands still at {start_s + time[row]:.15g} s in {most} of"
        f" {time.size} {rows.noun}s, from {rows.place(row)} on: it stopped, or tells no less; cut"
        f" the log, {other}"
    )
