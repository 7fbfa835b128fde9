"""The clock that a draft names among the channels of a table, and what the user has to decide."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import listing, printable
from osl_analysis.ingest.likely_clock import (
    NOT_OF_ROWS,
    OF_ROWS,
    is_like_clock,
    likely_unit,
    span_ratio,
    stated_rate,
    tells_time,
    ticks,
    time_unit,
)
from osl_analysis.trial import Array
from osl_analysis.units import is_clock

ALIKE = 0.005  # by which the spans of two clocks may differ: I is then 1 % wrong
MOST_BACK = 0.1  # share of the steps of a clock that may go back
MOST_SHOWN = 6  # clocks in a question


@dataclass(frozen=True)
class ClockChoice:
    """The clock, by the key of its channel; None if none is, or several contradict each other. And
    what the user has to decide."""

    key: str | None = None
    questions: Sequence[str] = ()


def likely_clock(readings: Mapping[str, NDArray[Any]], what: str = "columns") -> ClockChoice:
    """Choose among channels that may be the clock.

    It is the first of several, if they span the same time in s, ms, us or ns. It is none if they
    contradict each other, as then B and I depend on the choice. What does not run, or stands still
    in most rows, is no clock beside others.

    Parameters
    ----------
    readings
        By key, shape (n,) each.
    what
        What a channel is called, for messages.
    """
    clocks = {key: values.astype(np.float64) for key, values in readings.items()}
    spans = {key: span_of(values) for key, values in clocks.items()}
    running = [key for key, span in spans.items() if span > 0] or list(readings)
    fine = [key for key in running if rises_mostly(clocks[key])]  # others are of whole seconds
    running = fine or running
    if len(running) < 2:
        return ClockChoice(next(iter(running), None))
    first = running[0]
    begin = f"{len(running)} {what} may be the clock"
    if all(spans_alike(clocks[key], clocks[first]) for key in running):
        named = listing([printable(key) for key in running], MOST_SHOWN)
        return ClockChoice(first, [f"{begin}, to be checked: {named}; {printable(first)} is taken"])
    spanning = [f"{printable(key)} spans {spans[key]:.6g}" for key in running]
    return ClockChoice(
        None,
        [
            f"{begin}, and they contradict each other: {listing(spanning, MOST_SHOWN)}; name the"
            " one by which the signals were sampled"
        ],
    )


def rises_mostly(clock: Array) -> bool:
    """Whether readings (n,) rise in most rows."""
    return bool(2 * np.count_nonzero(np.diff(clock) > 0) > clock.size)


def spans_alike(clock: Array, other: Array) -> bool:
    """Whether two clocks (n,) span the same time, where both have readings, in s, ms, us or ns."""
    if clock.shape == other.shape:
        known = np.isfinite(clock) & np.isfinite(other)
        clock = clock[known]
        other = other[known]
    span = span_of(clock)
    other_span = span_of(other)
    if min(span, other_span) <= 0:
        return span == other_span
    return abs(span_ratio(span, other_span, ()) - 1) <= ALIKE


def span_of(values: Array) -> float:
    """Last minus first of the readings (n,) of a clock, in its unit; 0 if many steps go back."""
    known = values[np.isfinite(values)]
    if known.size < 2 or float(np.mean(np.diff(known) >= 0)) <= 1 - MOST_BACK:
        return 0.0
    return max(float(known[-1] - known[0]), 0.0)


def choose_clock(
    readings: Mapping[str, NDArray[Any]],
    names: Mapping[str, str],
    units: Mapping[str, str],
    what: str,
    stamps: Sequence[str] = (),
) -> ClockChoice:
    """Choose the clock of a table.

    It is among those that are named like a clock, unless another one that tells time contradicts
    it, or else among those that rise as one, a guess.

    Parameters
    ----------
    readings
        Shape (n,) each, by the key of the channel.
    names, units
        Of the channels, as the file states them, by key.
    what
        What a channel is called, for messages.
    stamps
        Keys of channels that hold times of day, which go before others.
    """
    # the shortest first: those of a message before those of its parts
    ordered = sorted(readings, key=lambda key: key.count("."))
    named = list(stamps) or [key for key in ordered if is_clock(names[key])]
    rising = {key: readings[key] for key in ordered if ticks(readings[key], units[key])}
    if not named:
        named = [key for key in rising if is_like_clock(names[key])]
    if not named:
        return guessed_clock(rising, units, what)
    choice = likely_clock({key: readings[key] for key in named}, what)
    if choice.key is None:
        return choice
    span = span_of(readings[choice.key].astype(np.float64))
    others = {
        key: values
        for key, values in rising.items()
        if span > 0
        and tells_time(names[key], units[key])
        and abs(span_ratio(span_of(values), span) - 1) > ALIKE
    }
    if not others:
        return choice
    return likely_clock({choice.key: readings[choice.key], **others}, what)


def guessed_clock(
    rising: Mapping[str, NDArray[Any]], units: Mapping[str, str], what: str
) -> ClockChoice:
    """Choose among channels that rise like a clock, and ask."""
    choice = likely_clock(rising, what)
    if choice.key is None or choice.questions:
        return choice
    readings = rising[choice.key]
    step = float(np.median(np.diff(readings)))
    unit = units[choice.key] or time_unit(readings)
    question = f"time is a guess: {printable(choice.key)} rises by {step:.4g} {unit} a row"
    return replace(choice, questions=[question])


def gaps_text(time: Array) -> str:
    """Gaps, steps of more than 1.5 usual ones, stamps that go back and repeated ones, in words;
    empty if none."""
    steps = np.diff(np.sort(time))
    usual = float(np.median(steps)) if steps.size else 0.0
    oddities: list[str] = []
    wide = steps[steps > 1.5 * usual] if usual > 0 else steps[:0]
    if wide.size:
        oddities.append(f"{wide.size} gaps, the longest {wide.max():.3f} s")
    out_of_order = int((np.diff(time) < 0).sum())
    if out_of_order:
        oddities.append(f"{out_of_order} stamps out of order")
    twice = int((steps == 0).sum())
    if twice:
        oddities.append(f"{twice} stamps twice")
    return ", ".join(oddities)


def rate_in_words(texts: Sequence[str]) -> tuple[float | None, list[str]]:
    """The rate of the rows [Hz] that texts state, and what the user has to check or decide."""
    rate = stated_rate(texts)
    if rate is not None:
        return rate, [f"time by the file's own words: {rate} rows a second"]
    telling = [text for text in texts if re.search(rf"{NOT_OF_ROWS}|{OF_ROWS}", text)]
    if not telling:
        return None, []
    return None, [
        "which rate is that of the rows? State it, as `time: {rate: HZ}`:"
        f" {printable(listing(telling, 4))}"
    ]


def clock_unit(name: str, readings: Array) -> str:
    """The likely unit of a clock without a stated one; empty if nothing tells it."""
    return likely_unit(name) or time_unit(readings)
