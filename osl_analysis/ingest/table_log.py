# SPDX-License-Identifier: Apache-2.0
"""Convert a log that is a table of rows to canonical columns.

Its time is a channel, a stated rate, or the timing that the file itself states; channels may have
times of their own. Nothing is interpolated or held.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError, naming
from osl_analysis.base.recording import Channel, End, Kind, Recording, Rows
from osl_analysis.base.source_file import TableSource
from osl_analysis.base.trial import Array, check_time, unit_of
from osl_analysis.base.units import si_factor
from osl_analysis.ingest.conversion import (
    Converted,
    asked_channels,
    canonical_columns,
    checked_counts,
    floats_of,
    fresh_rows,
    losses_of,
    numbers_of,
    share_above,
)
from osl_analysis.ingest.force_plates import convert_plates
from osl_analysis.ingest.guard import POSSIBLE
from osl_analysis.ingest.likely_clock import (
    CLOCK,
    beginnings,
    begins_anew,
    check_other_clocks,
    rate_of,
    unwrapped,
)
from osl_analysis.ingest.several_clocks import joined_clocks
from osl_analysis.ingest.turning import OTHER_TURNING, factor_or_nan


@dataclass(frozen=True)
class SlowerChannel:
    """What makes a channel one of another rate in the rows of a table."""

    # share of the time in steps that are no usual one, of a channel that lacks hardly a sample
    most_irregular: float = 0.01
    printed_s: float = 1e-6  # [s] to which exporters round stamps after they interpolated
    # first rows that tell it; all of an hour would take as long as reading them
    rows_tried: int = 10_000


SLOWER_CHANNEL = SlowerChannel()


def with_own_rows(
    values: Mapping[str, NDArray[Any]], rows: Rows, time: Array
) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Mask the readings of rows in which a channel was not sampled.

    Parameters
    ----------
    values
        Readings (n,) by canonical column and counter.
    time
        (n,) [s].

    Returns
    -------
    values
        The same, masked where a channel has no sample.
    remarks
        A sentence for each channel with rows of its own, by column.
    """
    sampled_values = dict(values)
    remarks = {}
    for column, readings in values.items():
        is_sampled = sampled_rows(time, floats_of(readings))
        count = is_sampled.sum()
        is_slower = rows.count - count > SLOWER_CHANNEL.most_irregular * rows.count
        if is_slower and keeps_step(time[is_sampled]):
            sampled_values[column] = np.ma.masked_array(readings, ~is_sampled)
            step_ms = 1e3 * np.median(np.diff(time[is_sampled]))
            remarks[column] = (
                f"{column} has a sample of its own every {step_ms:.4g} ms, in {count} of"
                f" {rows.count} {rows.noun}s; others are blank, or lie on the line between two"
            )
    return sampled_values, remarks


def keeps_step(stamps: Array) -> bool:
    """Whether stamps (n,) [s] are those of one clock, of which hardly one is missing."""
    steps = np.diff(stamps)
    if steps.size < CLOCK.fewest_ticks:
        return False
    usual = np.median(steps)
    off = np.abs(steps - usual)
    return bool(off[off > 0.5 * usual].sum() <= SLOWER_CHANNEL.most_irregular * steps.sum())


def sampled_rows(time: Array, values: Array) -> NDArray[np.bool_]:
    """Rows (n,) that are not blank, and do not change along the line between their neighbours, as
    interpolated ones do. The others must keep step: those of a coarse or smooth channel do not."""
    is_sampled = np.isfinite(values)
    if not is_sampled.all():
        time = time[is_sampled]
        values = values[is_sampled]
    few = slice(SLOWER_CHANNEL.rows_tried)
    is_of_few = on_line(time[few], values[few])
    is_often = is_of_few.sum() > SLOWER_CHANNEL.most_irregular * is_of_few.size
    if is_often and keeps_step(time[few][~is_of_few]):
        is_on_line = on_line(time, values)
        if keeps_step(time[~is_on_line]):
            is_sampled[is_sampled] = ~is_on_line | (np.diff(values, prepend=0) == 0)
    return is_sampled


def on_line(time: Array, values: Array) -> NDArray[np.bool_]:
    """Whether values (n,) at times (n,) [s] lie on the line through both neighbours, as near as
    they are printed."""
    changes = np.abs(np.diff(values))
    printed = changes.min(where=changes > 0, initial=np.inf)
    slope = (values[2:] - values[:-2]) / np.maximum(time[2:] - time[:-2], POSSIBLE.shortest_step_s)
    off = np.abs(values[1:-1] - values[:-2] - slope * (time[1:-1] - time[:-2]))
    is_near = off <= printed + np.abs(slope) * SLOWER_CHANNEL.printed_s
    return np.concatenate([[False], is_near, [False]])[: values.size]


STATE_RATE = "state the rate of the rows in Hz, as `time: {rate: HZ}`"


@dataclass(frozen=True)
class LogTable:
    """The channels of a log that a source file asks for, at the rows that count.

    Attributes
    ----------
    rows
        Of the file, for messages.
    time
        Times [s] (n,), from 0 on.
    start
        Reading of the clock in the first row; its time [s] for rows at a rate.
    start_s
        That time [s].
    values
        Readings (n,) by canonical column, NaN where one failed, masked where there is none.
    remarks
        What was left out, a sentence each.
    """

    rows: Rows
    time: Array
    start: float
    start_s: float
    values: Mapping[str, NDArray[Any]]
    remarks: Sequence[str] = ()


def convert_table(recording: Recording, source: TableSource) -> Converted:
    """Convert the channels of a table that a source file asks for, each by its own clock.

    Returns
    -------
    Converted
        Time [s] starts at 0 in the first row.

    Raises
    ------
    InputError
        A channel is missing, time stands still or goes back, readings are no numbers, or more of
        them are missing than the source file allows.
    """
    check_loss(recording, source)
    parts = sources_by_clock(recording, source)
    clocks = [recording.find(part.time.address) if part.time.name else None for part in parts]
    converted = [
        convert_rows(recording, part, clock, clocks)
        for part, clock in zip(parts, clocks, strict=True)
    ]
    return converted[0] if len(converted) == 1 else joined_clocks(converted)


def sources_by_clock(recording: Recording, source: TableSource) -> list[TableSource]:
    """Part a source file by clock: channels share one if they share a stated time, or else the
    timing that the file states for them."""
    parts: dict[str, TableSource] = {}
    for column, setting in source.channels.items():
        time = getattr(setting, "time", None) or source.time
        clock = repr(time)
        if not time.name and time.rate is None:
            rows = recording.find(setting.address).rows
            clock += f" {rows.rate_hz} {rows.start_s}"
        known = parts[clock].channels if clock in parts else {}
        update = {"time": time, "channels": {**known, column: setting}}
        parts[clock] = source.model_copy(update=update)
    return [*parts.values()] or [source]  # force plates alone


def convert_rows(
    recording: Recording,
    source: TableSource,
    clock: Channel | None,
    clocks: Sequence[Channel | None],
) -> Converted:
    """Convert the channels of one clock of a table, of `clocks` in all; None are rows at a rate."""
    asked = asked_channels(recording, source.channels)
    table = read_log_table(recording, source, asked, clock)
    rows = table.rows
    time = table.time
    if rows.count < 2:
        raise InputError(
            f"holds one {rows.noun} of data: nothing to analyse",
            "record the trial again, or exclude it",
        )
    clock_differences_s, remarks = check_other_clocks(recording, source, clock, time, asked, clocks)
    values, at_own_rate = with_own_rows(table.values, rows, time)

    converted = canonical_columns(source, asked, values, rows, time, at_own_rate)
    origins = converted.origins
    frame = pl.DataFrame([pl.Series("time", time), *converted.columns])
    rates = [text for column, text in at_own_rate.items() if column in origins]
    warnings = [*recording.loss.remarks, *table.remarks, *remarks, *rates, *converted.remarks]
    for column, origin in origins.items():
        channel = asked[column]
        origin["found"] = channel.title or channel.key
        ratio = origin["scale"] * origin["factor"] / factor_or_nan(channel.unit, unit_of(column))
        # in the unit of the file no joint could have it, so that the stated one corrects it
        largest = frame[column].abs().max() or 0.0
        low, high = SIZE_OF_JOINT.get(column, (0.0, np.inf))
        is_possible = low <= largest / abs(ratio) <= high
        if is_possible and abs(ratio - 1) > TABLE.largest_calibration:
            origin["unit_of_file"] = channel.unit

    plates = recording.plates
    if plates and time.size != plates[0].channels[0].rows.count:
        raise InputError(
            f"{rows.noun}s without values or with a stamp of another time are left out, but the"
            " plates need all",
            "repair the log, or remove `plates` from the source file",
        )
    loads = convert_plates(plates, source, rate_hz=rate_of(time))
    frame = frame.with_columns(*loads.samples)
    origins.update(loads.origins)
    frame, repeats = with_stamps_once(frame, source, rows.noun)
    facts = {
        "time": {**source.time.model_dump(exclude_none=True), "start": table.start},
        "rates_hz": {"rows": rate_of(frame["time"].to_numpy())},
        **recording.facts,
        **loads.facts,
        "clocks_apart": clock_differences_s,
        "damage": [*recording.loss.remarks, *table.remarks, *converted.remarks],
    }
    losses = losses_of(recording.loss)
    return Converted(frame, origins, facts, [*warnings, *repeats], losses, table.start_s)


# Least and largest value of a joint [N*m, rad]; beyond it another unit is proposed. No recording of
# a joint turns by less than a quarter of a degree.
SIZE_OF_JOINT: Mapping[str, tuple[float, float]] = {"torque": (0.0, 1e3), "theta": (0.0044, 1.2)}


@dataclass(frozen=True)
class TableLimits:
    """What a table of rows may be."""

    most_copied_share: float = 0.1  # of rows that repeat the row before; more were read twice
    # by which a `scale` corrects a channel that is in the file's unit
    largest_calibration: float = 0.1
    coarse_step_s: float = 0.4  # [s] stamps this far apart tell seconds, not samples
    # rows with one stamp: beyond it the stamps are coarse, or the clock stopped
    coarse_rows: int = 20
    coarse_share: float = 0.1  # of the rows with one stamp, as above


TABLE = TableLimits()


def check_loss(recording: Recording, source: TableSource) -> None:
    """Refuse a table that has lost more rows than the source file allows. A missing end counts
    nothing: nobody knows what it held."""
    loss = recording.loss
    by_rate = source.time.rate is not None and not source.time.name
    allowed = 0.0 if by_rate else source.allowed_missing
    if loss.end == End.MISSING or loss.share <= allowed:
        return
    share = share_above(loss.share)
    advice = f"write `most_missing: {share:g}` in the source file"
    if by_rate:
        advice = "name its time: all rows behind the lost ones would be early"
    raise InputError(
        f"{loss.lost} of {loss.expected} rows cannot be used: {'; '.join(loss.remarks)}",
        f"repair the log, or {advice}",
    )


def with_stamps_once(
    frame: pl.DataFrame, source: TableSource, noun: str
) -> tuple[pl.DataFrame, list[str]]:
    """Leave out rows that were written twice, and those with the stamp of the row before if the
    source file says so, and say what was done with them.

    Raises
    ------
    InputError
        Many rows repeat stamp and values of the row before: they were read twice.
    """
    repeated = (frame["time"].diff() == 0).sum()
    begin = f"{repeated} of {len(frame)} {noun}s repeat the stamp of the {noun} before and"
    if not repeated:
        return frame, []
    if source.time.repeated == "drop":
        once = frame.unique(subset="time", keep="first", maintain_order=True)
        return once, [f"{begin} were left out"]
    advice = f"write `repeated: drop` under {source.place('time')}"
    written_once = frame.unique(keep="first", maintain_order=True)
    copied = len(frame) - len(written_once)
    if copied > TABLE.most_copied_share * len(frame):
        raise InputError(
            f"{copied} of {len(frame)} {noun}s have time and values of the {noun} before",
            f"{advice}, to read each once",
        )
    return written_once, [
        f"{begin} are taken for samples whose stamps were rounded; if the device was read faster"
        f" than it sampled, {advice}"
    ]


def read_log_table(
    recording: Recording,
    source: TableSource,
    asked: Mapping[str, Channel],
    clock: Channel | None,
) -> LogTable:
    """Read the asked channels, by canonical column, to one table.

    Raises
    ------
    InputError
        Channels have no timing, or several, or unequal lengths; or the clock has no reading in some
        row, stands still or stays back.
    """
    channels = [*asked.values(), *filter(None, [clock])]
    if not channels:
        raise InputError("nothing is read at its rate", "name the column of time")
    is_own = clock is None and source.time.rate is None
    check_one_timing(channels, source, is_own, is_whole=recording.loss.end != End.MISSING)
    rows = replace(channels[0].rows, count=min(channel.rows.count for channel in channels))
    values = {}
    for column, channel in asked.items():
        # what nobody asked for is no reason to refuse the rest
        readings = numbers_of(channel) if column.startswith(OTHER_TURNING) else channel.values
        values[column] = readings[: rows.count]
    if clock is not None:
        return at_clock(rows, values, clock, source)
    rate_hz, start_s = (rows.rate_hz, rows.start_s) if is_own else (source.time.rate, 0.0)
    return LogTable(rows, np.arange(rows.count) / (rate_hz or 1.0), start_s, start_s, values)


def check_one_timing(
    channels: Sequence[Channel], source: TableSource, is_own: bool, is_whole: bool
) -> None:
    """Refuse channels whose own timing the file does not tell; and of a whole file unequal counts.
    Some have then lost values, nothing tells where, and all later ones would be early against the
    other channels."""
    key = source.time.ADDRESS
    first = channels[0]
    shared = first.rows
    for channel in channels:
        rows = channel.rows
        if is_own and rows.rate_hz is None:
            raise InputError(
                f"{key} '{channel.key}' has no timing of its own",
                f"name the {key} of time, as `time: {{{key}: NAME, unit: s}}`, or {STATE_RATE}",
            )
        if is_whole and rows.count != shared.count:
            raise InputError(
                f"channel '{first.key}' has {shared.count} values and '{channel.key}' has"
                f" {rows.count} for one time, and nothing tells which are lost: state with each"
                f" channel its own time, as `time: {{{key}: NAME, unit: s}}`, or save both at"
                " common times, as `interp1` gives, and never cut to one length"
            )


def at_clock(
    rows: Rows, values: Mapping[str, NDArray[Any]], clock: Channel, source: TableSource
) -> LogTable:
    """Give the rows that count at the times that a named clock tells."""
    what = source.time.title
    skips = source.damaged == "skip"
    remarks = []
    raw = np.ma.asarray(clock.values[: rows.count])
    # those of a longer channel that is not asked, or lines of another device
    lacks = ~np.isfinite(floats_of(raw))
    is_empty = lacks
    if lacks.any() and not skips:
        is_empty = lacks & ~np.any(
            [np.isfinite(floats_of(readings)) for readings in values.values()], axis=0
        )
    if is_empty.any() and not is_empty.all():
        remarks.append(f"rows without time were left out: {rows.counted(is_empty)}")
        places = np.flatnonzero(~is_empty)
        rows, values = kept_rows(rows, values, places)
        raw, lacks = raw[places], lacks[places]
    if raw.dtype == bool or lacks.any():
        raise InputError(
            f"{what}: no time in {rows.place(np.argmax(lacks))}",
            f"remove it there, take another {source.time.ADDRESS}, or {STATE_RATE}",
        )
    numbers = np.ma.getdata(raw)
    if numbers.dtype.kind == "f":  # single precision would round the differences
        numbers = np.asarray(numbers, float)
    if source.time.rate is None:
        unit = clock.unit if clock.kind == Kind.CLOCK else source.time.unit or clock.unit
        with naming(what, f", as {source.place('time', 'unit')}"):
            factor = si_factor(unit, "s")
    else:
        factor = 1 / source.time.rate
        numbers = checked_counts(what, numbers, rows, "state its unit in place of the rate")
    if source.time.each == "interval":
        numbers = np.cumsum(numbers)
    numbers, period = unwrapped(numbers)
    if period:
        remarks.append(f"{what} fell by {period} and is taken to go on")
    starts = beginnings(numbers)
    if starts.size > 1:
        with naming(what):
            raise begins_anew(rows, starts, numbers[0])
    fresh, stale = fresh_rows(rows, numbers, skips=skips)
    if stale:
        numbers = numbers[fresh]
        rows, values = kept_rows(rows, values, fresh)
    factor /= 1 + 1e-6 * source.time.drift_ppm
    time = (numbers - numbers[0]) * factor
    check_time(what, time)
    check_clock_runs(rows, source, time, numbers[0] * factor)
    start_s = numbers[0] * factor
    return LogTable(rows, time, numbers[0].item(), start_s, values, [*remarks, *stale])


def kept_rows(
    rows: Rows, values: Mapping[str, NDArray[Any]], places: NDArray[np.int64]
) -> tuple[Rows, dict[str, NDArray[Any]]]:
    """Some of the rows, which keep their numbers in the file, with their values by column."""
    lines = np.arange(1, rows.count + 1) if rows.lines is None else rows.lines
    return (
        replace(rows, count=places.size, lines=lines[places]),
        {column: readings[places] for column, readings in values.items()},
    )


def check_clock_runs(rows: Rows, source: TableSource, time: Array, start_s: float) -> None:
    """Refuse a clock (n,) that stands still, or tells whole seconds and no less."""
    if (np.diff(time) > 0).all():
        return
    _, first, counts = np.unique(time, return_index=True, return_counts=True)
    most = counts.max()
    tells_seconds = time[-1] > TABLE.coarse_step_s * counts.size
    is_coarse = tells_seconds or most > TABLE.coarse_share * time.size
    may_repeat = most <= TABLE.coarse_rows or source.time.repeated == "drop"
    if most < time.size and (may_repeat or not is_coarse):
        return
    row = first[counts.argmax()]
    raise InputError(
        f"{source.time.title}: time stands still at {start_s + time[row]:.15g} s in {most} of"
        f" {time.size} {rows.noun}s, from {rows.place(row)} on: it stopped, or tells no less",
        f"cut the log, take another {source.time.ADDRESS}, or {STATE_RATE}",
    )
