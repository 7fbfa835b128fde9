"""A log that is a table of rows as canonical columns. Its time is a channel, a stated rate, or the
timing that the file itself tells. Nothing is interpolated or held."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError, naming
from osl_analysis.ingest.conversion import (
    Converted,
    canonical_column,
    check_finite_values,
    checked_counts,
    losses_of,
    origin_of,
    remark_on_gaps,
    share_above,
)
from osl_analysis.ingest.force_plates import convert_exported_plate
from osl_analysis.ingest.likely_clock import TIME_UNITS, may_be_clock, rate_of, unwrapped
from osl_analysis.ingest.other_clocks import check_other_clocks
from osl_analysis.ingest.stale_rows import find_stale_rows
from osl_analysis.recording import Channel, End, Kind, Recording, Rows
from osl_analysis.source_file import LEVEL_UNIT, InAxes, TableSource
from osl_analysis.trial import Array, check_time, counter_column, unit_of
from osl_analysis.units import name_and_ending, si_factor

SECOND_NS = 1_000_000_000
STATE_RATE = "state the rate of the rows in Hz, as `time: {rate: HZ}`"
MOST_NOTES = 100  # lines of a file's own text that the provenance keeps
COARSE_STEP_S = 0.4  # stamps this far apart tell seconds, not samples
COARSE_ROWS = 20  # rows with one stamp: beyond it the stamps are coarse, or the clock stopped
COARSE_SHARE = 0.1  # of the rows with one stamp, as above
MOST_COPIED_SHARE = 0.1  # of rows that repeat the row before; more were read twice
FEWEST_COPIED = 20  # such rows that are refused


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


def convert_table(recording: Recording, source: TableSource, file_name: str) -> Converted:
    """Convert the channels of a table that a source file asks for.

    Parameters
    ----------
    file_name
        Under which the provenance keeps the rate of the rows.

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
    clock = recording.find(source.time.address) if source.time.name else None
    channels = {
        column: recording.find(setting.address) for column, setting in source.channels.items()
    }
    check_each_channel_once(channels, source)
    table = read_table(recording, source, channels, clock)
    if table.rows.count < 2:
        raise InputError(
            f"holds one {table.rows.noun} of data: nothing to analyse; record the trial again, or"
            " exclude it"
        )
    table, time, start = with_time(table, source, clock)
    apart, warnings = check_other_clocks(recording, source, clock, table.rows, time, channels)
    table = with_own_rows(table)

    samples = [pl.Series("time", time)]
    origins: dict[str, dict[str, Any]] = {}
    missing: dict[str, int] = {}
    warnings = [*recording.loss.remarks, *table.remarks, *warnings]
    for column, channel in channels.items():
        setting = source.channels[column]
        raw = table.values[column]
        series = canonical_column(column, channel, raw, table.rows, time, source)
        samples.append(series)
        if not table.has_own_rows:
            warnings += remark_on_gaps(setting, raw, table.rows)
        if column in table.counters:
            counts = checked_counts(setting, table.counters[column], table.rows, time)
            samples.append(pl.Series(counter_column(column), counts))
        missing[column] = int(series.is_nan().sum())
        origins[column] = origin_of(setting, column, channel.unit)
        full = channel.key
        if full == setting.name and "*" in full:  # a pattern stands for a name that changes
            full = channel.name
        is_with_unit = setting.name.startswith(f"{channel.name} ")  # as `torque [Nm]`
        if setting.name != full and not is_with_unit:
            origins[column]["found"] = full
    for column, count in missing.items():
        if count:
            warnings.append(f"{column} is missing in {count} of {time.size} {table.rows.noun}s")
    for column, channel in channels.items():
        unit = source.channels[column].unit
        if unit and channel.unit and unit != channel.unit:
            warnings.append(f"{column} is read in {unit}; the file says {channel.unit}")

    frame = pl.DataFrame(samples)
    is_fresh = np.concatenate([[True], np.diff(time) != 0])
    kept, remark = rows_to_keep(frame, is_fresh, source, table.rows.noun)
    warnings += remark
    facts: dict[str, Any] = {
        "time": {**source.time.model_dump(exclude_none=True), "start": start},
        "rates_hz": rates_of(table, channels, source) or {file_name: rate_of(time[kept])},
        "repeated_stamps": int((~is_fresh).sum()),
        "missing": missing,
    }
    if apart:
        facts["clocks_apart"] = apart
    facts.update(recording.facts)
    if recording.notes:
        facts["comments"] = list(recording.notes[:MOST_NOTES])
    frame = frame.filter(pl.Series(kept))
    if recording.plates:
        frame, plate_origins, facts["plates"] = with_plates(recording, source, table, frame, time)
        origins.update(plate_origins)
    losses = losses_of(recording.loss, of_messages=False)
    return Converted(frame, origins, facts, warnings, losses)


def check_loss(recording: Recording, source: TableSource) -> None:
    """Refuse a table that has lost more rows than the source file allows. A missing end counts
    nothing: nobody knows what it held."""
    loss = recording.loss
    if loss.end == End.MISSING or not loss.lost:
        return
    by_rate = source.time.rate is not None and not source.time.name
    allowed = 0.0 if by_rate else source.most_missing
    if loss.share <= allowed:
        return
    advice = "repair the log"
    if by_rate:
        advice += ", or name its time: all rows behind the lost ones would be early"
    else:
        share = share_above(loss.lost, loss.expected or 1)
        advice += f", or write `most_missing: {share:g}` in the source file"
    raise InputError(
        f"{loss.lost} of {loss.expected} rows cannot be used: {'; '.join(loss.remarks)}; {advice}"
    )


def check_each_channel_once(channels: Mapping[str, Channel], source: TableSource) -> None:
    """Refuse one channel under two columns, as by its name and by its number, but for levels."""
    taken: dict[int, str] = {}
    for column, channel in channels.items():
        other = taken.setdefault(id(channel), column)
        if other == column or LEVEL_UNIT in (unit_of(other), unit_of(column)):
            continue
        setting = source.channels[column]
        where = source.place("channels", column, setting.ADDRESS)
        raise InputError(
            f"{setting.title} is {other} and {column} in the source file; correct {where}"
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
        if not is_cut:
            check_equal_counts(asked)
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


def check_equal_counts(channels: Sequence[Channel]) -> None:
    """Refuse channels of one timing with unequal counts. Some have lost values, nothing tells
    where, and all later ones would be early against the other channels."""
    first: dict[tuple[float | None, float], Channel] = {}
    for channel in channels:
        other = first.setdefault((channel.rows.rate_hz, channel.rows.start_s), channel)
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
        columns.append(table.clock)
    is_masked = np.ones(table.rows.count, bool)
    is_empty = np.ones(table.rows.count, bool)
    for values in columns:
        mask = np.ma.getmaskarray(values)
        is_masked &= mask
        readings = np.ma.getdata(values)
        if readings.dtype.kind == "f":
            mask = mask | np.isnan(readings)
        is_empty &= mask
    if is_empty.all() or not is_empty.any():
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


def with_time(
    table: Table, source: TableSource, clock: Channel | None
) -> tuple[Table, Array, float]:
    """Give the rows that count, their times (rows,) [s] since the first one, and the reading of the
    clock in that row."""
    stated = source.time
    if table.clock is None or clock is None:
        time = table.time
        if time is None:
            assert stated.rate is not None
            time = np.arange(table.rows.count) / stated.rate
        return table, time - time[0], float(time[0])

    what = stated.title
    raw = np.ma.getdata(table.clock)
    check_no_reading_lacks(table, what, f"take another {stated.ADDRESS}, or {STATE_RATE}")
    factor = 1 / stated.rate if stated.rate is not None else clock_factor(clock, source)
    if stated.rate is not None and (raw != np.rint(raw)).any():
        row = int(np.argmax(raw != np.rint(raw)))
        raise InputError(
            f"{what}: {raw[row]} in {table.rows.place(row)} is no count of samples, which a column"
            " beside `rate` is; state its unit in place of the rate"
        )
    # single precision would round the differences
    if raw.dtype.kind == "f":
        raw = raw.astype(np.float64)
    raw, bits, turns = unwrapped(raw)
    remarks = [*table.remarks]
    if turns:
        remarks.append(
            f"{what} counts to 2**{bits} and began anew {turns} times; it is taken to go on"
        )
    stale = find_stale_rows(raw)
    if stale.size:
        remarks += remarks_on_stale_rows(table.rows, stale, raw, factor)
        kept = np.ones(raw.size, bool)
        kept[stale] = False
        table = table.at(kept)
        raw = raw[kept]
    time = np.asarray((raw - raw[0]) * factor, dtype=np.float64)
    check_time(what, time)
    check_clock_runs(table, source, time, raw, factor if clock.kind == Kind.CLOCK else 1.0)
    return replace(table, remarks=remarks), time, float(raw[0])


def check_no_reading_lacks(table: Table, what: str, remedy: str) -> None:
    """Refuse a clock of truth values, or one without a reading in some row."""
    assert table.clock is not None
    if table.clock.dtype == bool:
        raise InputError(f"{what}: no time but truth values; remove it there, {remedy}")
    lacking = np.isnan(np.ma.getdata(table.clock).astype(np.float64))
    lacking |= np.ma.getmaskarray(table.clock)
    if lacking.any():
        place = table.rows.place(int(np.argmax(lacking)))
        raise InputError(f"{what}: no time in {place}; remove it there, {remedy}")


def remarks_on_stale_rows(
    rows: Rows, stale: NDArray[np.int64], raw: NDArray[Any], factor: float
) -> Iterator[str]:
    """Name the rows that were left out, and how far their stamps are off."""
    for row in stale[:5].tolist():
        neighbour = row - 1 if row else row + 1
        off = float(raw[row] - raw[neighbour]) * factor
        yield (
            f"{rows.place(row)} is left out: its stamp is {abs(off):.4g} s"
            f" {'before' if off < 0 else 'behind'} those beside it, as of a packet that waited in a"
            " buffer"
        )
    if stale.size > 5:
        yield f"and {stale.size - 5} more {rows.noun}s like it"


def check_clock_runs(
    table: Table, source: TableSource, time: Array, raw: NDArray[Any], shown_factor: float
) -> None:
    """Refuse a clock (n,) that stands still, or tells whole seconds and no less."""
    _, first, counts = np.unique(time, return_index=True, return_counts=True)
    most = int(counts.max())
    row = int(first[counts.argmax()])
    distinct = time[first]
    many_alike = most > COARSE_SHARE * time.size
    far_apart = first.size > 3 and np.median(np.diff(distinct)) > COARSE_STEP_S
    is_coarse = most > COARSE_ROWS and (many_alike or far_apart)
    if most < time.size and not (is_coarse and source.time.repeated != "drop"):
        return
    other = f"take another {source.time.ADDRESS}, or {STATE_RATE}"
    if first.size > 3:  # whole seconds still tell the rate, from the first change to the last
        rate = (first[-1] - first[1]) / (distinct[-1] - distinct[1])
        other += f": its stamps tell {rate:.4g}"
    unit = "" if shown_factor == 1.0 else " s"
    raise InputError(
        f"{source.time.title}: time stands still at {raw[row] * shown_factor:.15g}{unit} in {most}"
        f" of {time.size} {table.rows.noun}s, from {table.rows.place(row)} on: it stopped, or"
        f" tells no less; cut the log, {other}"
    )


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


def rows_to_keep(
    frame: pl.DataFrame, is_fresh: NDArray[np.bool_], source: TableSource, noun: str
) -> tuple[NDArray[np.bool_], list[str]]:
    """Choose among rows with the stamp of the row before, and say what was done with them.

    Parameters
    ----------
    is_fresh
        Rows (n,) with a stamp of their own.

    Raises
    ------
    InputError
        Many rows repeat stamp and values of the row before: they were read twice.
    """
    repeated = int((~is_fresh).sum())
    if not repeated:
        return is_fresh, []
    begin = f"{repeated} of {is_fresh.size} {noun}s repeat the stamp of the {noun} before and"
    if source.time.repeated == "drop":
        return is_fresh, [f"{begin} were left out"]
    place = source.place("time")
    values = frame.drop("time")
    equal = (values[1:] == values[:-1]).select(pl.all_horizontal(pl.all().fill_null(True)))
    copied = int((~is_fresh[1:] & equal.to_series().to_numpy()).sum())
    if copied > max(FEWEST_COPIED, MOST_COPIED_SHARE * is_fresh.size):
        raise InputError(
            f"{copied} of {is_fresh.size} {noun}s have time and values of the {noun} before; write"
            f" `repeated: drop` under {place}, to read each once"
        )
    remark = (
        f"{begin} are taken for samples whose stamps were rounded; if the device was read faster"
        f" than it sampled, write `repeated: drop` under {place}"
    )
    return np.ones_like(is_fresh), [remark]


def rates_of(
    table: Table, channels: Mapping[str, Channel], source: TableSource
) -> dict[str, float]:
    """Rates [Hz] of channels with a timing of their own, by address; empty where one time holds for
    all."""
    if not table.has_own_rows or source.time.name or source.time.rate is not None:
        return {}
    return {one.key: one.rows.rate_hz for one in channels.values() if one.rows.rate_hz is not None}


def with_plates(
    recording: Recording, source: TableSource, table: Table, frame: pl.DataFrame, time: Array
) -> tuple[pl.DataFrame, dict[str, dict[str, Any]], list[dict[str, Any]]]:
    """The samples with the force plates of a table, where each column comes from, and facts on each
    plate."""
    assert isinstance(source, InAxes)
    if len(frame) != time.size or time.size != recording.plates[0].channels[0].rows.count:
        raise InputError(
            "rows that repeat a stamp were left out, but the plates need all; remove `repeated:"
            f" drop`, as {source.place('time', 'repeated')}"
        )
    rate = float(1 / np.median(np.diff(time))) if time.size > 1 else 1.0
    origins: dict[str, dict[str, Any]] = {}
    facts: list[dict[str, Any]] = []
    for plate in recording.plates:
        for channel in plate.channels:
            check_finite_values(f"column '{channel.key}'", channel.values, time)
        load = convert_exported_plate(plate, source.rotation, rate)
        frame = frame.with_columns(pl.Series(name, one) for name, one in load.columns.items())
        origins.update(load.origins)
        facts.append(load.facts)
    return frame, origins, facts
