"""Clocks that stand beside the time of a table, and rates that its text states: where they
contradict the stated time, B and I depend on which of them is right."""

from collections.abc import Iterator, Mapping

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.ingest.conversion import numbers_of
from osl_analysis.ingest.likely_clock import (
    is_like_clock,
    span_ratio,
    stated_rate,
    tells_time,
    ticks,
    unwrapped,
)
from osl_analysis.recording import Channel, Kind, Recording, Rows
from osl_analysis.source_file import TableSource
from osl_analysis.trial import Array

SECOND_NS = 1_000_000_000
WRONG_RATE = 0.05  # share by which a stated rate may be off a clock before it is refused
OTHER_RATE = 0.01  # share by which a stated rate may be off one that the file states
CLOCK_APART = 0.005  # share by which two clocks may differ: I is then 1 % wrong
MOST_TRIED = 1000  # first rows of a column that decide whether it may be a clock
LONGEST_STEP = 0.02  # of a clock, as a share of its span; less than three mean steps is usual


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
        A clock contradicts a stated rate, or tells the time of what stands beside it.
    """
    key, rate = source.time.ADDRESS, source.time.rate
    apart: dict[str, float] = {}
    remarks: list[str] = []
    is_compared = False
    if rate is not None:
        for name, other in rates_in_file(recording, asked):
            is_compared = True
            if abs(rate / other - 1) > OTHER_RATE:
                raise InputError(
                    f"`rate: {rate:g}` of time, but the file says {other:.6g} Hz ({name}); correct"
                    " the rate"
                )
    for channel, readings in clocks_beside(recording, source, clock, rows, asked):
        known = np.isfinite(readings)
        if known.sum() < 3 or known.size != time.size:
            continue
        steps = np.diff(unwrapped(readings[known])[0])
        span = float(np.ptp(time[known]))
        largest = max(3 * steps.mean(), LONGEST_STEP * steps.sum())
        if steps.min() < 0 or not 0 < steps.max() <= largest or not span:
            continue
        is_compared = True
        if clock is not None and channel.name == clock.name and channel.kind != Kind.CLOCK:
            late = np.nanmedian(np.abs(readings - numbers_of(clock)[: readings.size]))
            if late > 0.5 * np.median(steps):
                raise InputError(
                    f"{key} '{channel.key}' tells another time for what stands beside it; export"
                    " the channels of each rate on their own, or each with the time of all"
                )
        ratio = span_ratio(float(steps.sum()), span)
        if rate is not None and abs(ratio - 1) > WRONG_RATE:
            raise InputError(
                f"`rate: {rate:g}` of time, but {key} '{channel.key}' rises by"
                f" {steps.mean():.4g} a row; write `time: {{{key}: {channel.key}}}` with its unit,"
                " or correct the rate"
            )
        if abs(ratio - 1) > CLOCK_APART + steps.max() / steps.sum():
            apart[channel.key] = abs(ratio - 1) * span / 12**0.5
            remarks.append(
                f"{key} '{channel.key}' goes on {ratio:.4g} times as fast as time"
                f" ({source.time.title}): B and I depend on which of them is right"
            )
    if rate is not None and not is_compared:
        remarks.append(
            f"`rate: {rate:g}` of time is compared with nothing: no clock and no rate stand in the"
            " file; by one that is 10 % wrong B is 10 % and I 21 % wrong"
        )
    return apart, remarks


def clocks_beside(
    recording: Recording,
    source: TableSource,
    clock: Channel | None,
    rows: Rows,
    asked: Mapping[str, Channel],
) -> Iterator[tuple[Channel, Array]]:
    """The channels that may be clocks, as long as the table, with their readings (n,). An asked
    signal may be one only by its name, and beside a clock only what tells time: a signal may rise
    as evenly."""
    for channel in recording.channels:
        if channel is clock or channel.rows.count != rows.count:
            continue
        name = channel.name or channel.key
        is_named = channel.kind == Kind.CLOCK or is_like_clock(name)
        if not is_named and any(channel is signal for signal in asked.values()):
            continue
        if source.time.rate is None and not tells_time(name, channel.unit):
            continue
        readings = numbers_of(channel) / (SECOND_NS if channel.kind == Kind.CLOCK else 1)
        if is_named or ticks(readings[:MOST_TRIED], channel.unit):
            yield channel, readings


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
            values = numbers_of(channel)
            if values[0] > 0:
                yield channel.key, float(values[0])
