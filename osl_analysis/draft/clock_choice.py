"""The clock that a draft names among the channels of a table, and what the user has to decide."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.draft.recorded_channel import RecordedChannel
from osl_analysis.errors import listing, printable
from osl_analysis.ingest.likely_clock import (
    NOT_OF_ROWS,
    OF_ROWS,
    is_like_clock,
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
    """The clock; None if none is, or several contradict each other. And what the user has to
    decide."""

    channel: RecordedChannel | None = None
    questions: Sequence[str] = ()


def choose_clock(channels: Sequence[RecordedChannel]) -> ClockChoice:
    """Choose the clock of a table.

    It is the first of those that hold times of day, or that are named like a clock, or else of
    those that rise as one, a guess. It is none if another one that tells time spans another time in
    s, ms, us or ns: B and I depend on the choice.
    """
    # the shortest first: those of a message before those of its parts
    ordered = sorted(channels, key=lambda channel: channel.key.count("."))
    rising = [clock for clock in ordered if clock.is_stamp or ticks(clock.numbers, clock.unit)]
    named = (
        [channel for channel in ordered if channel.is_stamp][:1]
        or [channel for channel in ordered if is_clock(channel.name)]
        or [channel for channel in rising if is_like_clock(channel.name)]
    )
    clocks = running(named or rising)
    if not clocks:
        return ClockChoice()
    first = clocks[0]
    if named and span_of(first) > 0:
        telling = [channel for channel in rising if tells_time(channel.name, channel.unit)]
        rivals = [channel for channel in telling if is_apart(channel, first)]
        clocks = running([first, *rivals]) if rivals else clocks
    first = clocks[0]
    what = f"{len(clocks)} {first.kind}s may be the clock"
    if any(is_apart(channel, first) for channel in clocks):
        spans = [f"{printable(clock.key)} spans {span_of(clock):.6g}" for clock in clocks]
        question = (
            f"{what}, and they contradict each other: {listing(spans, MOST_SHOWN)}; name the one by"
            " which the signals were sampled"
        )
        return ClockChoice(None, [question])
    name = printable(first.key)
    if len(clocks) > 1:
        names = listing([printable(clock.key) for clock in clocks], MOST_SHOWN)
        return ClockChoice(first, [f"{what}, to be checked: {names}; {name} is taken"])
    if named:
        return ClockChoice(first)
    step = float(np.median(np.diff(first.numbers)))
    unit = first.unit or time_unit(first.numbers)
    return ClockChoice(first, [f"time is a guess: {name} rises by {step:.4g} {unit} a row"])


def running(clocks: Sequence[RecordedChannel]) -> list[RecordedChannel]:
    """Those of some clocks that run, if any does, and that rise in most rows, if any does: others
    are of whole seconds."""
    moving = [clock for clock in clocks if span_of(clock) > 0] or list(clocks)
    fine = [clock for clock in moving if (np.diff(clock.numbers) > 0).sum() > clock.count / 2]
    return fine or moving


def is_apart(clock: RecordedChannel, other: RecordedChannel) -> bool:
    """Whether two clocks span other times, where both have readings, in s, ms, us or ns."""
    spans = [span_of(clock), span_of(other)]
    if clock.numbers.shape == other.numbers.shape:
        both = np.isfinite(clock.numbers + other.numbers)
        spans = [span_of(replace(each, numbers=each.numbers[both])) for each in (clock, other)]
    if min(spans) <= 0:
        return spans[0] != spans[1]
    return abs(span_ratio(spans[0], spans[1], ()) - 1) > ALIKE


def span_of(clock: RecordedChannel) -> float:
    """Last minus first of the readings of a clock, in its unit; 0 if many steps go back."""
    known = clock.numbers[np.isfinite(clock.numbers)]
    if known.size < 2 or np.mean(np.diff(known) >= 0) <= 1 - MOST_BACK:
        return 0.0
    return max(float(known[-1] - known[0]), 0.0)


def gaps_text(time: Array) -> str:
    """Gaps, steps of more than 1.5 usual ones, stamps that go back and repeated ones, in words;
    empty if none."""
    steps = np.diff(np.sort(time))
    usual = float(np.median(steps)) if steps.size else 0.0
    wide = steps[(steps > 1.5 * usual) & (usual > 0)]
    counts = {
        f" gaps, the longest {wide.max(initial=0.0):.3f} s": wide.size,
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
