"""The clock that a draft names among the channels of a table, and what the user has to decide."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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


def choose_clock(
    readings: Mapping[str, NDArray[Any]],
    names: Mapping[str, str],
    units: Mapping[str, str],
    what: str,
    stamps: Sequence[str] = (),
) -> ClockChoice:
    """Choose the clock of a table.

    It is the first of those that are named like a clock, or else of those that rise as one, a
    guess. It is none if another one that tells time spans another time in s, ms, us or ns: B and I
    depend on the choice.

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
    rising = [key for key in ordered if ticks(readings[key], units[key])]
    named = (
        list(stamps)
        or [key for key in ordered if is_clock(names[key])]
        or [key for key in rising if is_like_clock(names[key])]
    )
    candidates = running(readings, named or rising)
    if not candidates:
        return ClockChoice()
    telling = [key for key in rising if named and tells_time(names[key], units[key])]
    others = [key for key in telling if is_apart(readings[key], readings[candidates[0]])]
    if others and span_of(readings[candidates[0]]) > 0:
        candidates = running(readings, [candidates[0], *others])
    first = candidates[0]
    if any(is_apart(readings[key], readings[first]) for key in candidates):
        spans = [f"{printable(key)} spans {span_of(readings[key]):.6g}" for key in candidates]
        question = (
            f"{len(candidates)} {what} may be the clock, and they contradict each other:"
            f" {listing(spans, MOST_SHOWN)}; name the one by which the signals were sampled"
        )
        return ClockChoice(None, [question])
    if len(candidates) > 1:
        named_so = listing([printable(key) for key in candidates], MOST_SHOWN)
        question = f"{len(candidates)} {what} may be the clock, to be checked: {named_so};"
        return ClockChoice(first, [f"{question} {printable(first)} is taken"])
    if named:
        return ClockChoice(first)
    step = float(np.median(np.diff(readings[first])))
    unit = units[first] or time_unit(readings[first])
    return ClockChoice(
        first, [f"time is a guess: {printable(first)} rises by {step:.4g} {unit} a row"]
    )


def running(readings: Mapping[str, NDArray[Any]], keys: Sequence[str]) -> list[str]:
    """Those of some clocks that run, if any does, and that rise in most rows, if any does: others
    are of whole seconds."""
    moving = [key for key in keys if span_of(readings[key]) > 0] or list(keys)
    fine = [key for key in moving if 2 * (np.diff(readings[key]) > 0).sum() > len(readings[key])]
    return fine or moving


def is_apart(clock: Array, other: Array) -> bool:
    """Whether two clocks (n,) span other times, where both have readings, in s, ms, us or ns."""
    if clock.shape == other.shape:
        known = np.isfinite(clock) & np.isfinite(other)
        clock, other = clock[known], other[known]
    span, other_span = span_of(clock), span_of(other)
    if min(span, other_span) <= 0:
        return span != other_span
    return abs(span_ratio(span, other_span, ()) - 1) > ALIKE


def span_of(values: Array) -> float:
    """Last minus first of the readings (n,) of a clock, in its unit; 0 if many steps go back."""
    known = values[np.isfinite(values)].astype(np.float64)
    if known.size < 2 or float(np.mean(np.diff(known) >= 0)) <= 1 - MOST_BACK:
        return 0.0
    return max(float(known[-1] - known[0]), 0.0)


def gaps_text(time: Array) -> str:
    """Gaps, steps of more than 1.5 usual ones, stamps that go back and repeated ones, in words;
    empty if none."""
    steps = np.diff(np.sort(time))
    usual = float(np.median(steps)) if steps.size else 0.0
    wide = steps[(steps > 1.5 * usual) & (usual > 0)]
    gaps = f" gaps, the longest {wide.max(initial=0.0):.3f} s"
    counts = {
        gaps: wide.size,
        " stamps out of order": int((np.diff(time) < 0).sum()),
        " stamps twice": int((steps == 0).sum()),
    }
    return ", ".join(f"{count}{words}" for words, count in counts.items() if count)


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
