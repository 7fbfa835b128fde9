"""The samples of a stream at the times that its decision gives them: true stamps, or the even clock of the device."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.timebase.counting import counted, missing_by_rhythm
from osl_analysis.timebase.decision import Decision, decide
from osl_analysis.timebase.device_clock import DeviceClock, device_clock
from osl_analysis.timebase.stream import Stream, without_repeats
from osl_analysis.trial import Array

CLOSE = 0.5
"""Distance of true stamps, in steps, below which samples are averaged: close knots of a spline amplify noise."""
COUNTABLE = 0.1
"""Spread of a host's latency, in steps, from which a missing sample without a counter may be taken for a late one."""
CLOCKS_DIFFER, NOT_MEANT = 2e-4, 0.1
"""Relative difference of two rates that no clocks have, and from which it is the devices' intention."""


@dataclass(frozen=True)
class Taken:
    """A stream with its clock and the decision how its stamps are taken. `repeated` rows were written twice. Its
    samples are `delay` [s] older than their stamps."""

    stream: Stream
    clock: DeviceClock
    decision: Decision
    repeated: int
    delay: float = 0.0

    def other(self) -> "Taken":
        """The same samples under the other hypothesis."""
        flipped = replace(
            self.decision, even=not self.decision.even, why=f"the other hypothesis to: {self.decision.why}"
        )
        return replace(self, decision=flipped)

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """Rows (n,) in which the signals have values."""
        return np.asarray(~np.isnan(self.stream.signals[self.decision.signals[0]]))

    @cached_property
    def stride(self) -> int:
        """Rows from one value to the next: 1, or more where signals of a lower rate share the rows of a faster one."""
        if self.present.all() and self.clock.counted is None:
            return 1
        return int(np.median(np.diff(self.clock.count[self.present])))

    @property
    def empty(self) -> int:
        return max(round(np.count_nonzero(~self.present) - len(self.present) * (1 - 1 / self.stride)), 0)

    def samples(self) -> "Samples":
        """The samples of the signals that are not silent at their times, the delay taken out; true stamps that lie
        close are averaged."""
        there = slice(None) if self.present.all() else self.present
        names = tuple(n for n in self.decision.signals if n in self.stream.signals.keys() - self.stream.silent)
        values = [self.stream.signals[name][there] for name in names]
        if self.decision.even:
            times, merged = self.clock.times()[there], 0
        else:
            stamps = self.stream.stamps[there]
            times, values = averaged_where_close(stamps, values, CLOSE * self.clock.step * self.stride)
            merged = len(stamps) - len(times)
        return Samples(self, names, times - self.delay if self.delay else times, tuple(values), merged)


@dataclass(frozen=True)
class Samples:
    """What the grid is made from: rising times (k,) [s] and values (k,) of each signal; `merged` were averaged."""

    taken: Taken
    names: tuple[str, ...]
    times: Array
    values: tuple[Array, ...]
    merged: int

    @property
    def name(self) -> str:
        return self.taken.stream.name

    @property
    def step(self) -> float:
        return self.taken.clock.step * self.taken.stride


def take(streams: Sequence[Stream]) -> list[Taken]:
    """The decision for every stream; a stream of two minds becomes two.

    Raises InputError: As `counted`; or one of several streams has a host's latency *and* missing samples and no
    counter, so that nothing tells which of its samples is which.
    """
    taken = [part for stream in streams for part in take_stream(stream)]
    if len(streams) > 1 or len({part.decision.even for part in taken}) > 1:
        fastest = max(part.clock.rate_hz for part in taken)
        for part in taken:
            check_countable(part, fastest)
    return taken


def take_stream(stream: Stream) -> list[Taken]:
    """The decision, or the two decisions, for one stream; a part for each delay and for each set of missing values."""
    fresh = without_repeats(stream)
    repeated = len(stream.stamps) - len(fresh.stamps)
    clock = device_clock(fresh.stamps, counted(fresh))
    decisions = decide(fresh, clock)
    groups = [(replace(d, signals=names), delay) for d in decisions for delay, names in alike(fresh, d.signals)]
    parts = [fresh] if len(groups) == 1 else [fresh.only(d.signals) for d, _ in groups]
    return [Taken(part, clock, d, repeated, delay) for part, (d, delay) in zip(parts, groups, strict=True)]


def alike(stream: Stream, names: Sequence[str]) -> list[tuple[float, tuple[str, ...]]]:
    """The signals that have the same delay [s] and lack values in the same rows."""
    kinds = {name: (stream.delays.get(name, 0.0), np.isnan(stream.signals[name]).tobytes()) for name in names}
    return [(one[0], tuple(n for n in names if kinds[n] == one)) for one in dict.fromkeys(kinds.values())]


def check_countable(taken: Taken, fastest_hz: float) -> None:
    """Refuse an even device behind a host that is late and loses samples, where no counter says which. Waits of three
    steps and more hide the rhythm of the stamps. The device is then refused if steps seem to be missing, or if it is
    slower than the fastest one by a share that is too large for clocks and too small to be meant."""
    clock, stream = taken.clock, taken.stream
    if not taken.decision.even or stream.counter is not None or clock.usual_spread <= COUNTABLE * clock.step:
        return
    late = f"the host's stamps are late by {clock.usual_spread * 1e3:.2f} ms (SD)"
    remedy = "state the device's sample counter in the source file, stamp on the device, or record without loss"
    missing = missing_by_rhythm(stream.stamps)
    if missing or (missing is not None and clock.missing):
        gap = f"{stream.stamps[int(np.argmax(np.diff(clock.count)))]:.4f} s"
        where = f", the first long gap at {gap}" if clock.missing else ""
        raise InputError(
            f"{stream.name}: about {missing or clock.missing} samples are missing{where}, and {late} at a "
            f"step of {clock.step * 1e3:.2f} ms: beside another device nothing tells which sample is which; {remedy}"
        )
    slower = 1 - clock.rate_hz / fastest_hz
    if missing is None and (clock.missing or CLOCKS_DIFFER < slower < NOT_MEANT):
        mean = (len(stream.stamps) - 1) / (stream.stamps[-1] - stream.stamps[0])
        raise InputError(
            f"{stream.name}: {late}, too late to see whether some of its {mean:.2f} samples per second are missing; "
            f"{remedy}"
        )


def averaged_where_close(stamps: Array, values: list[Array], closest: float) -> tuple[Array, list[Array]]:
    """Stamps (n,) [s] and values (n,) of each signal; samples within `closest` of the first of them are averaged."""
    if (np.diff(stamps) >= closest).all():
        return stamps, values
    first = first_of_each(stamps, closest)
    size = np.diff(np.append(first, len(stamps)))
    times, *averaged = (np.add.reduceat(one, first) / size for one in (stamps, *values))
    return times, averaged


def first_of_each(stamps: Array, closest: float) -> NDArray[np.intp]:
    """Rows that begin a group: every row at least `closest` [s] behind the first row of the group before."""
    begins = np.concatenate([[True], np.diff(stamps) >= closest])
    start = 0.0
    for row in np.flatnonzero(~begins):
        start = stamps[row - 1] if begins[row - 1] else start
        begins[row] = stamps[row] - start >= closest
    return np.flatnonzero(begins)
