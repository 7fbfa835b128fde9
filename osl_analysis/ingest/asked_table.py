"""The channels of a table that a source file asks for, at the rows that count, and their times.

Rows of another time are left out; a clock that stands still or stays back is refused.
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
        Times [s] (n,), from 0 on.
    start
        Reading of the clock in the first row; its time [s] for rows at a rate.
    values
        Readings (n,) by canonical column, NaN where one failed, masked where there is none.
    remarks
        What was left out, a sentence each.
    """

    rows: Rows
    time: Array
    start: float
    values: Mapping[str, NDArray[Any]]
    remarks: Sequence[str] = ()


def read_table(
    recording: Recording,
    source: TableSource,
    asked: Mapping[str, Channel],
    clock: Channel | None,
) -> Table:
    """Read the asked channels, by canonical column, to one table.

    Raises
    ------
    InputError
        Channels have no timing, or several, or unequal lengths; or the clock has no reading in some
        row, stands still or stays back.
    """
    channels = [*asked.values()]
    if clock is not None:
        channels.append(clock)
    if not channels:
        raise InputError("nothing is read at its rate; name the column of time")
    rows, rate_hz = channels[0].rows, source.time.rate
    start_s = 0.0
    if clock is None and rate_hz is None:
        check_own_timing(channels, source)
        rate_hz, start_s = rows.rate_hz, rows.start_s
    if recording.loss.end != End.MISSING:  # else the file ends within the channels
        check_equal_counts(channels)
    rows = replace(rows, count=min(channel.rows.count for channel in channels))
    values = {column: channel.values[: rows.count] for column, channel in asked.items()}
    if clock is not None:
        return at_clock(rows, values, clock, source)
    return Table(rows, np.arange(rows.count) / (rate_hz or 1.0), start_s, values)


def check_own_timing(channels: Sequence[Channel], source: TableSource) -> None:
    """Refuse channels whose timing the file does not tell, or that have several timings."""
    for channel in channels:
        rows, first = channel.rows, channels[0].rows
        if rows.rate_hz is None:
            key = source.time.ADDRESS
            raise InputError(
                f"{key} '{channel.key}' has no timing of its own; name the {key} of"
                f" time, as `time: {{{key}: NAME, unit: s}}`, or {STATE_RATE}"
            )
        if (rows.rate_hz, rows.start_s) != (first.rate_hz, first.start_s):
            raise InputError(
                f"'{channel.key}' is at {rows.rate_hz:g} Hz from {rows.start_s:g} s on, and"
                f" '{channels[0].key}' at {first.rate_hz:g} Hz from {first.start_s:g} s on: save"
                " channels at common times, as `interp1` gives"
            )


def check_equal_counts(channels: Sequence[Channel]) -> None:
    """Refuse channels of one timing with unequal counts.

    Some have lost values, nothing tells where, and all later ones would be early against the other
    channels.
    """
    shortest = min(channels, key=lambda channel: channel.rows.count)
    longest = max(channels, key=lambda channel: channel.rows.count)
    if shortest.rows.count < longest.rows.count:
        raise InputError(
            f"channel '{longest.key}' has {longest.rows.count} values and '{shortest.key}' has"
            f" {shortest.rows.count} for one time, and nothing tells which are lost: save channels"
            " of one length, as `torque = interp1(t_torque, torque, t_angle)`, and never cut to one"
            " length"
        )


def check_common_rows(table: Table, columns: Sequence[str]) -> None:
    """Refuse columns of which no row has readings of both, as where several devices write rows of
    their own into one log."""
    lacking: dict[str, NDArray[np.bool_]] = {}
    for column in columns:
        lacks = np.isnan(np.ma.getdata(table.values[column]).astype(np.float64))
        if not lacks.all():
            lacking[column] = lacks
    for column, other in combinations(lacking, 2):
        if (lacking[column] | lacking[other]).all():
            raise InputError(
                f"no {table.rows.noun} has both {column} and {other}, as of two devices; export"
                " both at common times, such as `interp1` gives, or record one log of messages"
            )


def at_clock(
    rows: Rows, values: Mapping[str, NDArray[Any]], clock: Channel, source: TableSource
) -> Table:
    """Give the rows that count at the times that a named clock tells."""
    what = source.time.title
    other = f"take another {source.time.ADDRESS}, or {STATE_RATE}"
    remarks: list[str] = []
    raw = np.ma.asarray(clock.values[: rows.count])
    places = np.flatnonzero(~lacks_all([raw, *values.values()]))
    if places.size and places.size < rows.count:
        left_out = int(places[-1]) + 1 - places.size
        if left_out:
            first = rows.place(int(np.argmax(np.diff(places, prepend=-1) > 1)))
            remarks.append(
                f"{left_out} of {places[-1] + 1} {rows.noun}s have none of the asked values and"
                f" were left out, first {first}"
            )
        rows, raw = rows_at(rows, places), raw[places]
    lacks = lacks_all([raw])
    if raw.dtype == bool or lacks.any():
        place = rows.place(int(np.argmax(lacks)))
        raise InputError(f"{what}: no time in {place}; remove it there, {other}")
    rate_hz = source.time.rate
    is_broken = raw != np.rint(raw)
    if rate_hz is not None and is_broken.any():
        row = int(np.argmax(is_broken))
        raise InputError(
            f"{what}: {raw[row]} in {rows.place(row)} is no count of samples, which a column"
            " beside `rate` is; state its unit in place of the rate"
        )
    factor = 1 / rate_hz if rate_hz is not None else clock_factor(clock, source)
    numbers = np.ma.getdata(raw)
    if numbers.dtype.kind == "f":  # single precision would round the differences
        numbers = numbers.astype(np.float64)
    numbers, bits, turns = unwrapped(numbers)
    if turns:
        remarks.append(
            f"{what} counts to 2**{bits} and began anew {turns} times; it is taken to go on"
        )
    stale = find_stale_rows(numbers)
    if stale.size:
        remarks += remarks_on_stale_rows(rows, numbers, stale, factor)
        fresh = np.delete(np.arange(rows.count), stale)
        rows, numbers, places = rows_at(rows, fresh), numbers[fresh], places[fresh]
    time = np.asarray((numbers - numbers[0]) * factor, dtype=np.float64)
    check_time(what, time)
    check_clock_runs(rows, source, time, float(numbers[0]) * factor)
    kept = {column: readings[places] for column, readings in values.items()}
    return Table(rows, time, float(numbers[0]), kept, remarks)


def lacks_all(channels: Sequence[NDArray[Any]]) -> NDArray[np.bool_]:
    """Rows (n,) in which none of the channels has a value: those of a longer channel that is not
    asked, or lines of another device."""
    lacks = np.ones(channels[0].size, bool)
    for values in channels:
        lacks &= np.isnan(np.ma.filled(np.ma.asarray(values).astype(np.float64), np.nan))
        if not lacks.any():
            break
    return lacks


def rows_at(rows: Rows, places: NDArray[np.int64]) -> Rows:
    """Some of the rows, which keep their numbers in the file."""
    lines = np.arange(1, rows.count + 1) if rows.lines is None else rows.lines
    return replace(rows, count=places.size, lines=lines[places])


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
