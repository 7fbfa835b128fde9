"""The samples of a stream at the times that its decision gives them: true stamps, or the even clock of the device.

The signal itself decides. With delta the residual of the stamps to their line, a signal x sampled at its true stamps is
x(line) + x' delta: sixth differences D6 take the smooth motion away and leave D6(x' delta). Of a device that samples
evenly they leave nothing. The slope g of D6 x on D6(x' delta) is therefore 1 or 0. How one-sided or slow the residual
is does not decide: a loop that waits for absolute targets is late, never early, and its stamps are true.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from math import comb

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.timebase.device_clock import DeviceClock, device_clock
from osl_analysis.timebase.stream import SampleCount, Stream, missing_by_rhythm, places_of_samples
from osl_analysis.trial import Array

TRUE_ABOVE, EVEN_BELOW, LARGEST_ERROR = 0.75, 0.25, 0.1
"""Bounds of g, and of its standard error, from which a signal is firm; 1727 of 1730 cases so decided, none wrongly."""
NO_MATTER = 0.001  # residual, in steps, below which both answers are the same samples
SIXTH = 6
DIFFERENCE = np.array([(-1.0) ** k * comb(SIXTH, k) for k in range(SIXTH + 1)])
"""Weights of seven samples in a sixth difference."""
LARGEST_NOISE = 0.2  # share of the slope's mean square that may be noise
SLOPE_S = 0.02  # half the stretch [s] over which the signal's slope is taken
CHUNKS, FEWEST_CHUNKS = 20, 5  # chunks that give the error of g, and the fewest of them that tell one
TIE = 1e-9  # share of x^2 by which two chunks may differ


@dataclass(frozen=True)
class StampEvidence:
    """What one signal says: g, 1 where the stamps are true and 0 where the device is even, and its standard error."""

    g: float
    se: float

    @property
    def true(self) -> bool:
        return self.g > TRUE_ABOVE and self.se < LARGEST_ERROR

    @property
    def even(self) -> bool:
        return self.g < EVEN_BELOW and self.se < LARGEST_ERROR


def evidence_of(values: Array, clock: DeviceClock) -> StampEvidence:
    """g and its standard error of one signal (n,), by the regression of D6 x on D6(x' delta).

    The slope x' is that of a cubic over 40 ms. The slow part of delta is subtracted first: sixth differences remove it,
    but not its product with the noise of x'. A difference needs seven consecutive samples; others are left out.

    The error is infinite, so that the signal decides nothing, where delta does not scatter, or where more than a fifth
    of the mean square of x' is noise: noise in the regressor would pull g towards 0.
    """
    there = ~np.isnan(values)
    x, late, count = values[there], clock.residual[there] / clock.step, clock.count[there]
    window = max(2 * round(SLOPE_S / clock.step) + 1, 7)
    slope, jitter = savitzky_golay(x, count, window, 1), late - savitzky_golay(late, count, window, 0)
    whole = count[SIXTH:] - count[:-SIXTH] == SIXTH
    push, seen = (np.correlate(signal, DIFFERENCE, "valid")[whole] for signal in (slope * jitter, x))
    g, se = chunked_slope(push, seen)
    noise = float(np.sum((seen - g * push) ** 2)) / comb(2 * SIXTH, SIXTH) / max(len(seen), 1)
    moves, scatter = float(slope @ slope) / len(x), float(np.var(jitter))
    slope_noise = float(np.sum(savgol_weights(window, 1)[window // 2] ** 2))  # per variance of white noise
    if noise * slope_noise > LARGEST_NOISE * moves or scatter < NO_MATTER**2:
        return StampEvidence(0.0, np.inf)
    return StampEvidence(g, se)


def savitzky_golay(values: Array, count: SampleCount, window: int, order: int) -> Array:
    """Value (order 0) or slope per step (order 1), (n,), of a cubic through each `window` of evenly counted samples
    (Savitzky-Golay), missing ones bridged linearly. A gap is shortened to two windows, so that a clock that jumps by
    years costs no memory. Half a window at each end is on the cubic of the last window."""
    place: SampleCount = np.arange(len(values))
    if count[-1] - count[0] != len(values) - 1:
        place = np.concatenate([[0], np.cumsum(np.minimum(np.diff(count), 2 * window))])
        values = np.interp(np.arange(place[-1] + 1), place, values)
    window = min(window, (len(values) - 1) // 2 * 2 + 1)
    weights, half = savgol_weights(window, order), window // 2
    found = np.empty_like(values)
    found[half:-half] = np.correlate(values, weights[half], "valid")
    found[:half], found[-half:] = weights[:half] @ values[:window], weights[-half:] @ values[-window:]
    return found[place]


@lru_cache
def savgol_weights(window: int, order: int) -> Array:
    """Weights (window, window) of a window's samples in the value (order 0), or slope per step, at each of them."""
    return np.asarray(scipy.signal.savgol_filter(np.eye(window), window, 3, deriv=order, axis=0))


def chunked_slope(x: Array, y: Array) -> tuple[float, float]:
    """Slope of y on x, (n,) each, through the origin, and its standard error from the scatter of 20 chunks. The chunks
    carry equal shares of x^2. Where fewer than five can be made, since a few samples carry everything, or x is zero,
    the error is infinite."""
    total = float(x @ x)
    if not total > 0:
        return 0.0, np.inf
    # motions that repeat themselves have ties: which row is the first is not left to rounding
    shares = np.searchsorted(np.cumsum(x**2), total * (np.arange(CHUNKS) / CHUNKS - TIE))
    edges = np.unique(np.minimum(shares, len(x) - 1))
    if len(edges) < FEWEST_CHUNKS:
        return 0.0, np.inf
    slope = float(x @ y) / total
    chunks = [slice(*ends) for ends in pairwise([*edges.tolist(), len(x)])]
    left = np.array([x[rows] @ (y[rows] - slope * x[rows]) for rows in chunks])
    return slope, float(np.sqrt(left @ left * len(left) / (len(left) - 1)) / total)


WANDERS = 0.1  # slow wander of the residual, in steps, from which an undecided stream keeps its stamps


@dataclass(frozen=True)
class Decision:
    """How the stamps of some signals of a stream are taken."""

    signals: tuple[str, ...]
    even: bool  # the device samples evenly; else the stamps are true
    firm: bool  # stated, or seen in the signals; else the other hypothesis may be right
    matters: bool  # the two hypotheses differ
    why: str  # one sentence for provenance
    evidence: Mapping[str, StampEvidence]  # per signal; empty where none was sought


def decide(stream: Stream, clock: DeviceClock) -> list[Decision]:
    """One decision for all signals of a stream; two where one signal is firmly true and one firmly even, which was held
    by its own device: all others then take the stamps.

    A stated choice stands. A residual that does not matter, below a thousandth of a step, leaves the device even. Where
    no signal moves enough to tell, stamps that wander slowly are kept, stamps that only scatter are not.
    """
    names = tuple(stream.signals)
    if stream.choice != "auto":
        return [Decision(names, stream.choice == "even", True, True, f"stated: {stream.choice}", {})]
    if clock.sd < NO_MATTER * clock.step:
        return [Decision(names, True, True, False, "even: the stamps lie on their line", {})]
    evidence = {n: evidence_of(values, clock) for n, values in stream.signals.items() if n not in stream.silent}
    even = tuple(name for name, one in evidence.items() if one.even)
    if not even and not any(one.true for one in evidence.values()):
        wanders = clock.wander > WANDERS * clock.step
        steps = f"the residual wanders by {clock.wander / clock.step:.3f} steps"
        why = f"undecided, {'true' if wanders else 'even'}: {steps}"
        return [Decision(names, not wanders, False, True, why, evidence)]
    kinds = [(names, bool(even))]
    if even and any(one.true for one in evidence.values()):
        kinds = [(tuple(name for name in names if name not in even), False), (even, True)]
    decisions = []
    for group, is_even in kinds:
        said = {name: evidence[name] for name in group if name in evidence}
        seen = ", ".join(f"{name} g = {e.g:.3f} +- {e.se:.3f}" for name, e in said.items())
        decisions.append(Decision(group, is_even, True, True, f"{'even' if is_even else 'true'}: {seen}", said))
    return decisions


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
        why = f"the other hypothesis to: {self.decision.why}"
        return replace(self, decision=replace(self.decision, even=not self.decision.even, why=why))

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """Rows (n,) in which the signals have values."""
        return np.asarray(~np.isnan(self.stream.signals[self.decision.signals[0]]))

    @cached_property
    def stride(self) -> int:
        """Rows from one value to the next: 1, or more where signals of a lower rate share the rows of a faster one."""
        return int(np.median(np.diff(self.clock.count[self.present])))

    @property
    def empty(self) -> int:
        return max(round(np.count_nonzero(~self.present) - len(self.present) * (1 - 1 / self.stride)), 0)

    def samples(self) -> "Samples":
        """The samples of the signals that are not silent at their times, the delay taken out; true stamps that lie
        close are averaged."""
        there, silent = self.present, self.stream.silent
        names = tuple(n for n in self.decision.signals if n in self.stream.signals and n not in silent)
        values = [self.stream.signals[name][there] for name in names]
        if self.decision.even:
            times, merged = self.clock.times()[there], 0
        else:
            stamps = self.stream.stamps[there]
            times, values = averaged_where_close(stamps, values, CLOSE * self.clock.step * self.stride)
            merged = len(stamps) - len(times)
        return Samples(self, names, times - self.delay, tuple(values), merged)


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
    """The decision for every stream; a stream of two minds becomes two, as one for each delay and for each set of
    missing values.

    Raises InputError: As `places_of_samples`; or one of several streams has a host's latency *and* missing samples and
    no counter, so that nothing tells which of its samples is which.
    """
    taken = []
    for stream in streams:
        fresh = stream.without_repeats()
        clock = device_clock(fresh.stamps, places_of_samples(fresh))
        groups = []
        for decision in decide(fresh, clock):
            kinds = {n: (fresh.delays.get(n, 0.0), np.isnan(fresh.signals[n]).tobytes()) for n in decision.signals}
            for kind in dict.fromkeys(kinds.values()):
                alike = tuple(name for name in decision.signals if kinds[name] == kind)
                groups.append((replace(decision, signals=alike), kind[0]))
        for decision, delay in groups:
            part = fresh if len(groups) == 1 else fresh.only(decision.signals)
            taken.append(Taken(part, clock, decision, len(stream.stamps) - len(fresh.stamps), delay))
    if len(streams) > 1 or len({part.decision.even for part in taken}) > 1:
        fastest = max(part.clock.rate_hz for part in taken)
        for one in taken:
            check_countable(one, fastest)
    return taken


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
    """Stamps (n,) [s] and values (n,) of each signal; samples within `closest` of the first of a group are averaged."""
    begins = np.concatenate([[True], np.diff(stamps) >= closest])
    if begins.all():
        return stamps, values
    start = 0.0
    for row in np.flatnonzero(~begins):
        start = stamps[row - 1] if begins[row - 1] else start
        begins[row] = stamps[row] - start >= closest
    first = np.flatnonzero(begins)
    size = np.diff(np.append(first, len(stamps)))
    times, *averaged = (np.add.reduceat(one, first) / size for one in (stamps, *values))
    return times, averaged
