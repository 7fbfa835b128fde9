"""Clocks that stand beside the time of a table, and rates that its text states: where they
contradict the stated time, B and I depend on which of them is right."""

from collections.abc import Iterator, Mapping

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.ingest.likely_clock import (
    is_like_clock,
    may_be_clock,
    span_ratio,
    stated_rate,
    tells_time,
    unwrapped,
)
from osl_analysis.recording import Channel, Kind, Recording, Rows
from osl_analysis.source_file import TableSource
from osl_analysis.trial import Array

WRONG_RATE = 0.05  # share by which a stated rate may be off a clock before it is refused
OTHER_RATE = 0.01  # share by which a stated rate may be off one that the file states
CLOCK_APART = 0.005  # share by which two clocks may differ: I is then 1 % wrong
SECOND_NS = 1_000_000_000
COUNTS_ROWS = 0.9  # share of the steps of a counter that are 1
MOST_TRIED = 1000  # first rows of a column that decide whether it may be a clock


def check_other_clocks(
    recording: Recording,
    source: TableSource,
    clock: Channel | None,
    rows: Rows,
    time: Array,
    asked: Mapping[str, Channel],
) -> tuple[dict[str, float], list[str]]:
    """Hold the time of a table against the other clocks in it.

    Parameters
    ----------
    clock
        The channel of time; None for rows at a rate.
    rows
        Those that are used.
    time
        Their times [s], (rows,).
    asked
        The channels of signals by column.

    Returns
    -------
    apart
        RMS [s] of the difference of each clock whose rate differs by `CLOCK_APART` or more.
    remarks
        A sentence each.

    Raises
    ------
    InputError
        A clock contradicts a stated rate, or one of the same name begins at another time.
    """
    apart: dict[str, float] = {}
    remarks: list[str] = []
    rate = source.time.rate
    is_confirmed = False
    for other in clocks_beside(recording, source, clock, rows, asked):
        name = other.key
        readings = np.ma.getdata(other.values)
        if other.kind == Kind.CLOCK:
            readings = readings / SECOND_NS
        known = np.isfinite(readings.astype(np.float64)) & ~np.ma.getmaskarray(other.values)
        if known.sum() < 3 or known.size != time.size:
            continue
        if rate is None and not tells_time(other.name, other.unit):  # a signal may rise as evenly
            continue
        values = unwrapped(readings[known])[0].astype(np.float64)
        own = time[known]
        steps = np.diff(values)
        if not runs_on(steps) or own[-1] == own[0]:
            continue
        is_confirmed = True
        span = float(own[-1] - own[0])
        ratio = span_ratio(float(steps.sum()), span)
        if not known[-1] and abs(ratio - 1) > WRONG_RATE:
            last = rows.place(int(np.flatnonzero(known)[-1]))
            raise InputError(
                f"{source.time.ADDRESS} '{name}' ends at {last} and tells another time for what"
                " stands beside it; export the channels of each rate on their own"
            )
        if clock is not None and other.name == clock.name:
            check_same_beginning(other, readings, clock)
        if rate is not None and abs(ratio - 1) > WRONG_RATE:
            raise InputError(
                f"`rate: {rate:g}` of time, but {source.time.ADDRESS} '{name}' rises by"
                f" {steps.mean():.4g} a row; write `time: {{{source.time.ADDRESS}: {name}}}` with"
                " its unit, or correct the rate"
            )
        if abs(ratio - 1) > CLOCK_APART + steps.max() / steps.sum():
            apart[name] = abs(ratio - 1) * span / 12**0.5
            remarks.append(
                f"{source.time.ADDRESS} '{name}' goes on {ratio:.4g} times as fast as"
                f" {time_in_words(source)}: B and I depend on which of them is right"
            )
    if rate is not None:
        remarks += check_rate(rate, recording, asked, is_confirmed)
    return apart, remarks


def check_same_beginning(other: Channel, readings: Array, clock: Channel) -> None:
    """Refuse two clocks of one name of which one is late, as in tables side by side: the other one
    is then the time of the columns next to it."""
    own = np.ma.getdata(clock.values)
    if clock.kind == Kind.CLOCK or own.size != readings.size:
        return
    late = float(np.nanmedian(readings - own))
    if abs(late) > 0.5 * float(np.nanmedian(np.abs(np.diff(own)))):
        raise InputError(
            f"another '{other.key}' is {late:.4g} after time: what stands beside it is of its time;"
            " export each with the time of all"
        )


def check_counts_rows(channel: Channel, values: Array, source: TableSource) -> None:
    """Refuse a stated rate if a channel (n,) counts the rows and shows that some are missing."""
    if not np.mean(np.diff(values[:MOST_TRIED]) == 1) > COUNTS_ROWS:
        return
    steps = np.diff(unwrapped(values)[0])
    absent = int(steps.sum()) - steps.size
    if (steps > 0).all() and absent:
        key = source.time.ADDRESS
        raise InputError(
            f"{key} '{channel.key}' counts {absent} rows that are missing, and those behind would"
            f" be early; write `time: {{{key}: {channel.key}, rate: {source.time.rate:g}}}`"
        )


def time_in_words(source: TableSource) -> str:
    return f"time ({source.time.title})" if source.time.name else "time"


def runs_on(steps: Array) -> bool:
    """Whether the steps (n,) of a clock never go back, and none of them is most of its span."""
    if not steps.size or not (steps >= 0).all():
        return False
    mean = float(steps.mean())
    largest = max(3 * mean, 0.02 * float(steps.sum()))
    return mean > 0 and float(steps.max()) <= largest


def clocks_beside(
    recording: Recording,
    source: TableSource,
    clock: Channel | None,
    rows: Rows,
    asked: Mapping[str, Channel],
) -> Iterator[Channel]:
    """The channels that may be clocks, as long as the table. An asked signal may be one only by its
    name."""
    for channel in recording.channels:
        if channel is clock or channel.rows.count != rows.count:
            continue
        if channel.kind == Kind.CLOCK:
            yield channel
            continue
        name = channel.name or channel.key
        is_asked = any(channel is one for one in asked.values())
        if is_asked and not is_like_clock(name):
            continue
        values = numbers_of(channel)
        if values is None:
            continue
        if may_be_clock(name, channel.unit, values[:MOST_TRIED]):
            yield channel
        elif source.time.rate is not None and not source.time.name:
            check_counts_rows(channel, values, source)


def numbers_of(channel: Channel) -> Array | None:
    """The readings (n,) of a channel; None if they are no numbers."""
    try:
        values = np.ma.getdata(channel.read())
    except InputError:  # a column of words
        return None
    if values.ndim != 1 or values.dtype.kind not in "iuf":
        return None
    return values


def check_rate(
    rate: float, recording: Recording, asked: Mapping[str, Channel], is_confirmed: bool
) -> list[str]:
    """Refuse a stated rate [Hz] that the file contradicts. Remark on it if nothing in the file
    confirms it."""
    stated = dict(rates_in_file(recording, asked))
    for name, other in stated.items():
        if abs(rate / other - 1) > OTHER_RATE:
            raise InputError(
                f"`rate: {rate:g}` of time, but the file says {other:.6g} Hz ({name}); correct the"
                " rate"
            )
    if is_confirmed or stated:
        return []
    return [
        f"`rate: {rate:g}` of time is compared with nothing: no clock and no rate stand in the"
        " file; by one that is 10 % wrong B is 10 % and I 21 % wrong"
    ]


def rates_in_file(
    recording: Recording, asked: Mapping[str, Channel]
) -> Iterator[tuple[str, float]]:
    """Rates [Hz] of the rows that a file states, with where it does."""
    in_words = stated_rate(recording.notes)
    if in_words is not None:
        yield "in words", in_words
    for channel in asked.values():
        if channel.rows.rate_hz is not None:
            yield f"timing of '{channel.key}'", channel.rows.rate_hz
    for channel in recording.channels:  # a variable `fs`
        if channel.rows.count == 1 and (channel.name or channel.key).lower().endswith("fs"):
            values = np.ma.getdata(channel.values).ravel()
            if values.size == 1 and values.dtype.kind in "iuf" and values[0] > 0:
                yield channel.key, float(values[0])
