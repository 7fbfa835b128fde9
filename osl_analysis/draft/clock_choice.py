"""The clock that a draft names among the channels of a table, and what the user has to decide."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from osl_analysis.draft.recorded_channel import RecordedChannel
from osl_analysis.errors import listing, printable
from osl_analysis.ingest.likely_clock import (
    is_like_clock,
    span_ratio,
    tells_time,
    ticks,
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
    candidates = named or rising
    telling = [clock for clock in rising if named and tells_time(clock.name, clock.unit)]
    possible = [*candidates, *(clock for clock in telling if clock not in candidates)]
    clocks = [clock for clock in possible if runs(clock)] or possible[:1]
    if not clocks:
        return ClockChoice()

    first = clocks[0]
    rivals = [clock for clock in clocks if is_apart(clock, first)]
    alike = [clock for clock in clocks[1:] if clock in candidates]
    asked = [first, *(rivals or alike)]
    if len(asked) > 1:
        spans = [f"{printable(clock.key)} spans {np.ptp(clock.readings):.6g}" for clock in asked]
        what = f"{printable(first.key)} is taken, check it"
        if rivals:
            what = "they contradict each other, name the one by which the signals were sampled"
        question = (
            f"{len(asked)} {first.kind}s may be the clock: {listing(spans, MOST_SHOWN)}; {what}"
        )
        return ClockChoice(None if rivals else first, [question])
    if named:
        return ClockChoice(first)
    return ClockChoice(first, [f"time is a guess: {printable(first.key)} rises evenly"])


def runs(clock: RecordedChannel) -> bool:
    """Whether a clock rises in most rows and seldom goes back; one of whole seconds does not."""
    steps = np.diff(clock.numbers[np.isfinite(clock.numbers)])
    return bool(np.sum(steps > 0) > clock.count / 2 and np.mean(steps < 0) < MOST_BACK)


def is_apart(clock: RecordedChannel, other: RecordedChannel) -> bool:
    """Whether two clocks of the same rows span other times, where both have readings, in s, ms, us
    or ns."""
    if clock.numbers.shape != other.numbers.shape:
        return False
    both = np.isfinite(clock.numbers + other.numbers)
    span = float(np.ptp(clock.numbers[both]))
    other_span = float(np.ptp(other.numbers[both]))
    return min(span, other_span) > 0 and abs(span_ratio(span, other_span, ()) - 1) > ALIKE


def gaps_text(time: Array) -> str:
    """Gaps, steps of more than 1.5 usual ones, stamps that go back and repeated ones, in words;
    empty if none."""
    steps = np.diff(np.sort(time))
    usual = float(np.median(steps)) if steps.size else 0.0
    wide = steps[(steps > 1.5 * usual) & (usual > 0)]
    counts = {
        f"gaps, the longest {wide.max(initial=0.0):.3f} s": wide.size,
        "stamps out of order": np.sum(np.diff(time) < 0),
        "stamps twice": np.sum(steps == 0),
    }
    return ", ".join(f"{count} {words}" for words, count in counts.items() if count)
