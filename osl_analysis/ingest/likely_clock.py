# SPDX-License-Identifier: Apache-2.0
"""Find out whether a channel is a clock: by its name, readings and unit, and by the file's text.

A draft proposes such a clock, and a check compares it with the stated time. It is never taken for
the time of a recording unasked. Where it contradicts the stated time, B and I depend on which of
the two is right. Example: `Delta_X 0.002` in a header states 500 Hz.
"""

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError, listing
from osl_analysis.base.measured import UNIFORM_WIDTH, usual_step
from osl_analysis.base.recording import SECOND_NS, Channel, Kind, Recording, Rows
from osl_analysis.base.source_file import TableSource
from osl_analysis.base.trial import Array
from osl_analysis.base.units import (
    EXAMPLES,
    LONG_TIMES,
    in_si,
    is_clock,
    normalised,
)
from osl_analysis.ingest.conversion import numbers_of

TIME_UNITS = EXAMPLES["s"]  # [s], of clocks


def looks_like_time(name: str) -> bool:
    """Whether a column may be a clock by its name, such as `LabVIEW time`, `Date` or `sec`. Its
    readings decide."""
    last = re.split(r"[./]", name)[-1]
    return is_clock(last) or bool(re.search(r"(?i)time|date|clock|stamp|zeit|^[mu]?secs?$", last))


def is_time_unit(unit: str) -> bool:
    """Whether a unit is a unit of time, or a multiple of one, such as `second` and `10 us`."""
    return in_si(normalised(unit))[1] == "s"


# Fewest bits of a counter, by its tick in the unit of the readings
FEWEST_BITS: Mapping[float, int] = {1.0: 8, 1e-3: 16, 1e-6: 16}


@dataclass(frozen=True)
class CounterOverflow:
    """Limit by which a fall of readings is the overflow of a counter."""

    most_steps: float = 10.0  # usual steps by which a counter may go on where it overflows


OVERFLOW = CounterOverflow()


WITHIN_A_SECOND = (10**3, 10**6, 10**9)  # ticks, after which ms, us and ns of a second begin anew


def unwrapped(readings: NDArray[Any]) -> tuple[NDArray[Any], str]:
    """Let a counter that overflowed at a power of two of its ticks, or that counts within a second,
    go on.

    A step back is an overflow if adding the smallest such period beyond it makes it about as short
    as the other steps. Of several periods that do, the one counts that makes it the most usual.

    Parameters
    ----------
    readings
        Shape (n,).

    Returns
    -------
    readings
        Shape (n,), without overflows.
    period
        By what it fell, in words; empty if it did not overflow.
    """
    steps = np.diff(np.asarray(readings, float))
    falls = -steps[steps < 0]
    longest = OVERFLOW.most_steps * usual_step(readings)
    if not falls.size:
        return readings, ""
    are_whole = bool((readings == np.rint(readings)).all())
    periods = {}  # in words, by period and tick
    for tick, fewest_bits in FEWEST_BITS.items():
        bits = math.ceil(math.log2(falls.max() / tick))
        if bits >= fewest_bits and (tick < 1 or are_whole):
            periods[2**bits * tick, tick] = f"2**{bits} ticks of {tick:g}"
    for period in WITHIN_A_SECOND:
        if are_whole and readings.min() >= 0 and period > readings.max() >= falls.max():
            periods[period, 1.0] = f"{period:g} ticks, a second"
    possible = [key for key in periods if key[0] - falls.min() <= longest]
    if not possible:
        return readings, ""
    usual = usual_step(readings)
    # a first one of powers of two stays where several make the step as usual
    period, tick = min(possible, key=lambda key: abs(key[0] - np.median(falls) - usual))
    turns = np.append(0, np.cumsum(steps < 0))
    whole = readings.astype(np.int64) if tick == 1 else readings
    return whole + turns * period, periods[period, tick]


FEWEST_IN_RECORDING = 20  # rows from one beginning of a clock to the next: fewer are a fault


def beginnings(readings: NDArray[Any]) -> NDArray[np.intp]:
    """Rows at which a clock (n,) begins anew about where it began first, as where several
    recordings stand in one file; with the first row. One row alone where it does not."""
    steps = np.diff(np.asarray(readings, float))
    falls = np.flatnonzero(steps < 0) + 1
    if not falls.size:
        return falls[:0] if not readings.size else np.zeros(1, np.intp)
    starts = np.concatenate([[0], falls])
    near = OVERFLOW.most_steps * usual_step(readings)
    begin_alike = bool((np.abs(readings[starts] - readings[0]) <= near).all())
    lengths = np.diff(np.append(starts, readings.size))
    if begin_alike and lengths.min() >= FEWEST_IN_RECORDING:
        return starts
    return starts[:1]


def begins_anew(rows: Rows, starts: NDArray[np.intp], first: object) -> InputError:
    """The refusal of a file with several recordings, whose clock begins anew in some rows."""
    places = listing([rows.place(row) for row in starts[1:]], 5)
    return InputError(
        f"time begins anew at {first} in {places}: the file holds {starts.size} recordings",
        "cut the file there, and give each part a row of the sheet; of one recording, log a clock"
        " that goes on",
    )


@dataclass(frozen=True)
class ClockLimits:
    """Limits by which a column is a clock, and two clocks differ."""

    # [Hz] rates of recorders of joints: less than a factor of 1000
    recorded_hz: tuple[float, float] = (50.0, 5000.0)
    fewest_ticks: int = 20  # readings that show whether a column rises like a clock
    even_step: float = 0.2  # a step differs from the median by less than this share of it
    even_share: float = 0.8  # of the steps of a clock are even
    wrong_rate: float = 0.05  # share by which a stated rate may be off a clock before it is refused
    other_rate: float = 0.01  # share by which a stated rate may be off one that the file states
    rate_difference: float = 0.005  # share by which two clocks may differ: I is then 1 % wrong
    most_tried: int = 1000  # first rows of a column that decide whether it may be a clock
    longest_step: float = 0.06  # share of its span; one of `fewest_ticks` even steps is shorter


CLOCK = ClockLimits()


def ticks(values: NDArray[Any], unit: str) -> bool:
    """Whether readings (n,) rise like a clock, apart from counter overflows. Without a unit,
    `time_unit` must find one that fits."""
    known = values[np.isfinite(values)]
    steps = np.diff(unwrapped(known)[0])
    if steps.size < CLOCK.fewest_ticks or not (steps >= 0).all():
        return False
    usual = np.median(steps)
    is_even = np.mean(np.abs(steps - usual) < CLOCK.even_step * usual) > CLOCK.even_share
    return bool(is_even and (is_time_unit(unit) if unit else time_unit(values)))


def rate_of(time: NDArray[Any], second: float = 1.0) -> float | None:
    """Usual rate [Hz] of stamps (n,), with `second` units per second; None if time stands still."""
    step = usual_step(time)
    return second / step if step > 0 else None


def time_unit(clock: Array) -> str:
    """The likely unit of the readings (n,) of a clock; else empty.

    Recorders of joints run at `recorded_hz`: only one unit gives such a rate. Readings that rise by
    one are left out: they may count rows, or be the whole seconds of a stamp in two parts.
    """
    rate = rate_of(clock)
    steps = np.diff(clock)
    counts = rate == 1 and (steps == np.rint(steps)).all()
    if rate is None or clock.size < CLOCK.fewest_ticks or counts:
        return ""
    lowest, highest = CLOCK.recorded_hz
    units = {**TIME_UNITS, "d": LONG_TIMES["d"]}
    return next((unit for unit, s in units.items() if lowest <= rate / s <= highest), "")


WRITTEN_NUMBER = r"(\d+(?:,\d{3})*(?:[.,]\d+)?(?:e[+-]?\d+)?)"
OF_ROWS = (
    r"(?:sampl\w*|scan|acquisition|recording|data|output)["
    r" _]*(?:rate|frequency|freq)|fs\b|^(?:rate|frequency)\b"
    r"|(?:abtast|mess)(?:rate|frequenz)|fr\w+ d.\w*chantillonnage|f_s\b|log(?:ging)? rate"
    r"|samples? per second|recorded at"
)
UNIT_AHEAD = rf"[\[(]([\w/]+)[\])]\W*{WRITTEN_NUMBER}"  # as in `Period (ms): 2`
INTERVAL = (
    r"(?i)(?:\b(?:delta_x|dt|h_?resolution|x_?increment|(?:sampl\w*[ _]*)?(?:interval|period)"
    r"|sampl\w* time|abtast(?:zeit|intervall|periode))|[Δ∆]t)\b"
    rf"\D*?{WRITTEN_NUMBER}(?:\s*([muµμ]?s)\b)?"
)
NOT_OF_ROWS = (
    r"(?i)decimat|(down|sub|over)-?sampl|\bevery\W+(\d|other|second|n)|averag(ing|ed)|\bthinn"
    r"|\b(device|internal|sensor|adc|emg|hardware)\b.*(rate|freq)"
)
RATE_ALONE = (
    r"[\s:=\x22[]*(?P<alone>\d{2,5}(?:\.\d*)?|\d\.\d+e[+-]?\d+)(?: (?P=alone))*(?:$|[\]};]|, )"
)
IN_HZ = rf"\D*?{WRITTEN_NUMBER}\s*(k?)(?:hz|s/s|sps|samples?/s)"
RATE_IN_WORDS = rf"(?i)\b(?:{OF_ROWS})(?:{IN_HZ}|{RATE_ALONE})"


def stated_rate(texts: Sequence[str]) -> float | None:
    """The rate of the rows [Hz] that texts state, such as `Sample rate: 500 Hz` or LabVIEW's
    `Delta_X`. None if they state several, or mention a device or a decimation: the rate may then
    not be that of the rows."""
    rates = set()
    for written in texts:
        text = re.sub(UNIT_AHEAD, r"\2 \1", written)
        interval = re.search(INTERVAL, text)
        words = re.search(RATE_IN_WORDS, text)
        if re.search(NOT_OF_ROWS, text):
            return None
        if interval and number_in(interval[1]) > 0:
            unit = normalised((interval[2] or "s").lower())
            rate = 1 / (number_in(interval[1]) * TIME_UNITS[unit])
            rates.add(float(f"{rate:.9g}"))
        elif words:
            rates.add(number_in(words[1] or words[3]) * (1000 if words[2] else 1))
    return rates.pop() if len(rates) == 1 and 1 < min(rates) < 1e6 else None


def number_in(text: str) -> float:
    """The number of a match of `WRITTEN_NUMBER`: with a decimal point or comma, or commas between
    thousands, as `1,000`."""
    return float(re.sub(r"(?<!^0),(?=\d{3}\b)", "", text).replace(",", "."))


def span_ratio(
    span: float, other_span: float, more_units: Collection[float] = LONG_TIMES.values()
) -> float:
    """Ratio of two spans of time in unknown units: the one nearest to 1 over all units of time and
    those of `more_units` [s]."""
    units = np.array([*TIME_UNITS.values(), *more_units])
    ratios = np.divide.outer(units, units).ravel() * span / other_span
    return float(ratios[np.argmin(np.abs(np.log(ratios)))])


def check_other_clocks(
    recording: Recording,
    source: TableSource,
    clock: Channel | None,
    time: Array,
    asked: Mapping[str, Channel],
    clocks_asked: Collection[Channel | None],
) -> tuple[dict[str, float], list[str]]:
    """Hold the time of a table against the other clocks in it.

    Parameters
    ----------
    clock
        The channel of time; None for rows at a rate.
    time
        Of the rows that are used [s], (rows,).
    asked
        The channels that the source file names, and those beside them.
    clocks_asked
        The clocks of all channels of the table, of which each tells the time of its own.

    Returns
    -------
    differences_s
        RMS [s] of the difference of each clock whose rate differs by `rate_difference` or more.
    remarks
        A sentence each.

    Raises
    ------
    InputError
        A clock contradicts a stated rate, or tells the time of what stands beside it.
    """
    key = source.time.ADDRESS
    rate = source.time.rate
    differences_s: dict[str, float] = {}
    remarks = []
    rates = {f"timing of '{channel.key}'": channel.rows.rate_hz for channel in asked.values()}
    rates["in words"] = stated_rate(recording.notes)
    other_clocks = other_clocks_in(recording, source, clocks_asked, time.size, asked)

    for channel, readings, steps in other_clocks:
        if clock is not None and channel.name == clock.name and channel.kind != Kind.CLOCK:
            late = np.nanmedian(np.abs(readings - numbers_of(clock)[: readings.size]))
            if late > 0.5 * np.median(steps):
                raise InputError(
                    f"{key} '{channel.key}' tells another time for what stands beside it",
                    f"state it with that channel, as `time: {{{key}: {channel.key}, unit: s}}`",
                )
        span = np.ptp(time[np.isfinite(readings)])
        ratio = span_ratio(steps.sum(), span)
        deviation = abs(ratio - 1)
        if rate and deviation > CLOCK.wrong_rate:
            rates[f"{key} '{channel.key}'"] = rate / ratio
        if deviation > CLOCK.rate_difference + steps.max() / steps.sum():
            differences_s[channel.key] = deviation * span / UNIFORM_WIDTH
            remarks.append(
                f"{key} '{channel.key}' goes on {ratio:.4g} times as fast as time"
                f" ({source.time.title}): B and I depend on which of them is right"
            )
    for name, file_rate in rates.items():
        if rate and file_rate and abs(rate / file_rate - 1) > CLOCK.other_rate:
            raise InputError(
                f"`rate: {rate:g}` of time, but the file says {file_rate:.3g} Hz ({name})",
                "correct the rate, or name that clock under `time`",
            )
    return differences_s, remarks


def other_clocks_in(
    recording: Recording,
    source: TableSource,
    clocks_asked: Collection[Channel | None],
    count: int,
    asked: Mapping[str, Channel],
) -> Iterator[tuple[Channel, Array, Array]]:
    """Other channels that may be clocks, as long as the table (`count`), with their readings (n,)
    and steps. An asked signal may be one only by its name, and beside a clock only what tells
    time: a signal may rise as evenly."""
    for channel in recording.channels:
        is_stamp = channel.kind == Kind.CLOCK
        is_named = is_stamp or looks_like_time(channel.name or channel.key)
        unit = channel.unit or channel.likely_unit
        may_be = is_named or (
            channel not in asked.values() and (source.time.rate is not None or is_time_unit(unit))
        )
        if channel in clocks_asked or channel.rows.count != count or not may_be:
            continue
        readings = numbers_of(channel) / (SECOND_NS if is_stamp else 1)
        steps = np.diff(unwrapped(readings[np.isfinite(readings)])[0])
        if steps.size < 2 or not 0 <= steps.min() <= steps.max() > 0:
            continue
        goes_on = steps.max() <= CLOCK.longest_step * steps.sum()
        if goes_on and (is_named or ticks(readings[: CLOCK.most_tried], channel.unit)):
            yield channel, readings, steps
