"""The samples of a stream at the times that its decision gives them: true stamps, or the even clock of the device; and
by how much the clocks of two devices drift apart.

The signal itself decides. With delta the residual of the stamps to their line, a signal x sampled at its true stamps is
x(line) + x' delta: sixth differences D6 take the smooth motion away and leave D6(x' delta). Of a device that samples
evenly they leave nothing: the slope g of D6 x on D6(x' delta) is 1 or 0. How one-sided or slow the residual is does not
decide: a loop that waits for absolute targets is late, never early, and its stamps are true."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from math import comb

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.signals.stream import SampleCount, Stream, line_through, missing_by_rhythm, places_of_samples
from osl_analysis.trial import Array


@dataclass(frozen=True)
class DeviceClock:
    """Stamps of a stream against the least-squares line through them."""

    stamps: Array  # (n,) [s]
    count: SampleCount  # (n,) place of every sample in the device's count

    @cached_property
    def step(self) -> float:
        """Slope [s] of the line."""
        return line_through(self.count, self.stamps)[0]

    @cached_property
    def start(self) -> float:
        """The line's value [s] at count 0."""
        return float(np.mean(self.stamps) - self.step * np.mean(self.count))

    @cached_property
    def residual(self) -> Array:
        """Stamp minus line (n,) [s]."""
        return np.asarray(self.stamps - self.step * self.count - self.start)

    @cached_property
    def sd(self) -> float:
        """Standard deviation [s] of the residual."""
        return float(np.std(self.residual))

    @cached_property
    def usual(self) -> tuple[float, float]:
        """Median [s] of the residual, and by quantiles its standard deviation [s] but for a handful of late ones."""
        low, middle, high = (float(at) for at in np.quantile(self.residual, (0.05, 0.5, 0.95)))
        return middle, (high - low) / 3.29

    @cached_property
    def wander(self) -> float:
        """Standard deviation [s] of the residual averaged over 50 samples, in which jitter averages out."""
        blocks = len(self.stamps) // 50
        return float(np.std(self.residual[: blocks * 50].reshape(-1, 50).mean(axis=1))) if blocks > 1 else self.sd

    @property
    def missing(self) -> int:
        """Samples that the count leaves free."""
        return int(self.count[-1] - self.count[0] + 1 - len(self.count))

    def skew(self, residual: Array) -> float:
        """Skewness of a residual; 0 where it does not scatter."""
        apart, sd = residual - residual.mean(), float(np.std(residual))
        return float(apart @ (apart * apart)) / len(apart) / sd**3 if sd > 1e-6 * self.step else 0.0

    def times(self) -> Array:
        """When the samples were taken, (n,) [s], if the device samples evenly: the least-squares line through all but
        the few samples that lie far off, or along their lower edge where they are still one-sided, since a host's stamp
        is late by what the message waited."""
        x, residual, (middle, spread) = self.count, self.residual, self.usual
        near = np.abs(residual - middle) <= 5 * spread + 1e-6 * self.step
        step = line_through(x[near], residual[near])[0]
        start = float(np.mean(residual[near]) - step * np.mean(x[near]))
        if self.skew(residual[near]) > 0.5:
            # the highest line below all points: one point is held on each side of the mean count; the lowest point
            # below the line through them replaces the one on its side, until none lies below
            left, right, middle = 0, len(x) - 1, float(np.mean(x))
            for _ in range(len(x)):
                step = float((residual[right] - residual[left]) / (x[right] - x[left]))
                above = residual - residual[left] - step * (x - x[left])
                lowest = int(np.argmin(above))
                if above[lowest] >= 0 or lowest in (left, right):
                    break
                left, right = (lowest, right) if x[lowest] <= middle else (left, lowest)
            start = float(residual[left] - step * x[left])
        return np.asarray((self.step + step) * x + (self.start + start), dtype=np.float64)


@dataclass(frozen=True)
class StampEvidence:
    """What one signal says: g, 1 where the stamps are true and 0 where the device is even, and its standard error. Of
    1730 cases that these bounds call firm, 1727 are right, and none is wrong."""

    g: float
    se: float

    @property
    def true(self) -> bool:
        return self.g > 0.75 and self.se < 0.1

    @property
    def even(self) -> bool:
        return self.g < 0.25 and self.se < 0.1


NO_MATTER = 0.001  # residual, in steps, below which both answers are the same samples: the device counts as even


def evidence_of(values: Array, clock: DeviceClock) -> StampEvidence:
    """g and its standard error of one signal (n,), by the regression of D6 x on D6(x' delta) through the origin. The
    slope x' is that of a cubic over 40 ms. The slow part of delta is subtracted first: sixth differences remove it, but
    not its product with the noise of x'. The error, from the scatter of 20 chunks of equal shares of D6(x' delta)^2, is
    infinite where delta does not scatter, where a few samples carry everything, or where more than a fifth of the mean
    square of x' is noise, which would pull g towards 0."""
    there = ~np.isnan(values)
    x, late, count = values[there], clock.residual[there] / clock.step, clock.count[there]
    window = max(2 * round(0.02 / clock.step) + 1, 7)
    slope, jitter = savitzky_golay(x, count, window, 1), late - savitzky_golay(late, count, window, 0)
    whole, weights = count[6:] - count[:-6] == 6, np.array([(-1.0) ** k * comb(6, k) for k in range(7)])
    push, seen = (np.correlate(signal, weights, "valid")[whole] for signal in (slope * jitter, x))
    total = float(push @ push)
    if not total > 0:
        return StampEvidence(0.0, np.inf)
    # motions that repeat themselves have ties: which row is the first is not left to rounding
    shares = np.searchsorted(np.cumsum(push**2), total * (np.arange(20) / 20 - 1e-9))
    edges = np.unique(np.minimum(shares, len(push) - 1))
    g = float(push @ seen) / total
    noise = float(np.sum((seen - g * push) ** 2)) / comb(12, 6) / max(len(seen), 1)
    slope_noise = float(np.sum(scipy.signal.savgol_coeffs(window, 3, 1) ** 2))  # per variance of white noise
    drowned = noise * slope_noise > 0.2 * float(slope @ slope) / len(x)
    if len(edges) < 5 or drowned or float(np.var(jitter)) < NO_MATTER**2:
        return StampEvidence(0.0, np.inf)
    chunks = [slice(*ends) for ends in pairwise([*edges.tolist(), len(push)])]
    left = np.array([push[rows] @ (seen[rows] - g * push[rows]) for rows in chunks])
    return StampEvidence(g, float(np.sqrt(left @ left * len(left) / (len(left) - 1)) / total))


def savitzky_golay(values: Array, count: SampleCount, window: int, order: int) -> Array:
    """Value (order 0) or slope per step (order 1), (n,), of a cubic through each `window` of evenly counted samples,
    missing ones bridged linearly. A gap is shortened to two windows, lest a clock that jumps by years fill memory."""
    place: SampleCount | slice = slice(None)
    if count[-1] - count[0] != len(values) - 1:
        place = np.concatenate([[0], np.cumsum(np.minimum(np.diff(count), 2 * window))])
        values = np.interp(np.arange(place[-1] + 1), place, values)
    window = min(window, (len(values) - 1) // 2 * 2 + 1)
    return np.asarray(scipy.signal.savgol_filter(values, window, 3, deriv=order)[place])


@dataclass(frozen=True)
class Taken:
    """Signals of a stream with the stream's clock, and how their stamps are taken."""

    stream: Stream
    clock: DeviceClock
    signals: tuple[str, ...]  # their names; they lack values in the same rows
    even: bool  # the device samples evenly; else the stamps are true
    firm: bool  # stated, or seen in the signals; else the other hypothesis may be right
    matters: bool  # the two hypotheses differ
    why: str  # one sentence for provenance
    evidence: Mapping[str, StampEvidence] = field(default_factory=dict)  # per signal; empty where none was sought
    repeated: int = 0  # rows that were written twice
    delay: float = 0.0  # [s] by which the samples are older than their stamps

    def other(self) -> "Taken":
        """The same samples under the other hypothesis."""
        return replace(self, even=not self.even, why=f"the other hypothesis to: {self.why}")

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """Rows (n,) in which the signals have values."""
        return np.asarray(~np.isnan(self.stream.signals[self.signals[0]]))

    @cached_property
    def stride(self) -> int:
        """Rows from one value to the next: 1, or more where signals of a lower rate share the rows of a faster one."""
        return int(np.median(np.diff(self.clock.count[self.present])))

    @property
    def step(self) -> float:
        """Usual step [s] from one value to the next."""
        return self.clock.step * self.stride

    @cached_property
    def samples(self) -> tuple[Array, dict[str, Array], int]:
        """Rising times (k,) [s] of the samples, the delay taken out; their values (k,) by signal, without the silent
        ones; and how many true stamps lay so close that they were averaged: close knots of a spline amplify noise."""
        names = [name for name in self.signals if name in self.stream.signals and name not in self.stream.silent]
        values = [self.stream.signals[name][self.present] for name in names]
        times, merged = (self.clock.times() if self.even else self.stream.stamps)[self.present], 0
        begins = np.concatenate([[True], np.diff(times) >= (closest := 0.5 * self.step)])
        if not self.even and not begins.all():
            start = 0.0
            for row in np.flatnonzero(~begins):  # a group is what lies within `closest` of its first sample
                start = times[row - 1] if begins[row - 1] else start
                begins[row] = times[row] - start >= closest
            first = np.flatnonzero(begins)
            size, merged = np.diff(np.append(first, len(times))), len(times) - len(first)
            times, *values = (np.add.reduceat(one, first) / size for one in (times, *values))
        return times - self.delay, dict(zip(names, values, strict=True)), merged


def take(streams: Sequence[Stream]) -> list[Taken]:
    """The decision for every stream; a stream of two minds becomes two, as one for each delay and for each set of
    missing values. Raises InputError: As `places_of_samples` and `check_countable`."""
    taken: list[Taken] = []
    for stream in streams:
        fresh = stream.without_repeats()
        groups = []
        for one in decide(fresh, DeviceClock(fresh.stamps, places_of_samples(fresh))):
            kinds = {n: (fresh.delays.get(n, 0.0), np.isnan(fresh.signals[n]).tobytes()) for n in one.signals}
            for kind in dict.fromkeys(kinds.values()):
                alike = tuple(name for name in one.signals if kinds[name] == kind)
                repeated = len(stream.stamps) - len(fresh.stamps)
                groups.append(replace(one, signals=alike, repeated=repeated, delay=kind[0]))
        for one in groups:
            if len(groups) > 1:  # a stream whose name says which signals it has
                own = {name: fresh.signals[name] for name in one.signals}
                one = replace(one, stream=replace(fresh, name=f"{fresh.name} [{', '.join(own)}]", signals=own))
            taken.append(one)
    if len(streams) > 1 or len({part.even for part in taken}) > 1:
        fastest = max(1 / part.clock.step for part in taken)
        for one in taken:
            check_countable(one, fastest)
    return taken


def decide(stream: Stream, clock: DeviceClock) -> list[Taken]:
    """One decision for all signals of a stream; two where one signal is firmly true and one firmly even, which was held
    by its own device: all others then take the stamps. A stated choice stands. Where no signal moves enough to tell,
    stamps that wander slowly are kept, stamps that only scatter are not."""
    names = tuple(stream.signals)
    if stream.choice != "auto":
        return [Taken(stream, clock, names, stream.choice == "even", True, True, f"stated: {stream.choice}")]
    if clock.sd < NO_MATTER * clock.step:
        return [Taken(stream, clock, names, True, True, False, "even: the stamps lie on their line")]
    evidence = {n: evidence_of(values, clock) for n, values in stream.signals.items() if n not in stream.silent}
    even, is_true = tuple(name for name, one in evidence.items() if one.even), any(e.true for e in evidence.values())
    if not even and not is_true:
        wanders = clock.wander > 0.1 * clock.step
        steps = f"the residual wanders by {clock.wander / clock.step:.3f} steps"
        why = f"undecided, {'true' if wanders else 'even'}: {steps}"
        return [Taken(stream, clock, names, not wanders, False, True, why, evidence)]
    kinds = [(names, bool(even))]
    if even and is_true:
        kinds = [(tuple(name for name in names if name not in even), False), (even, True)]
    decisions = []
    for group, is_even in kinds:
        said = {name: evidence[name] for name in group if name in evidence}
        seen = ", ".join(f"{name} g = {e.g:.3f} +- {e.se:.3f}" for name, e in said.items())
        why = f"{'even' if is_even else 'true'}: {seen}"
        decisions.append(Taken(stream, clock, group, is_even, True, True, why, said))
    return decisions


def check_countable(taken: Taken, fastest_hz: float) -> None:
    """Refuse one of several devices behind a host that is late and loses samples, where no counter says which. Where
    waits of three steps and more hide the rhythm of the stamps, it is refused if steps seem to be missing, or if it is
    slower than the fastest one by a share that is too large for clocks and too small to be meant."""
    clock, stream = taken.clock, taken.stream
    # a tenth of a step: from there on a missing sample may be taken for a late one
    if not taken.even or stream.counter is not None or clock.usual[1] <= 0.1 * clock.step:
        return
    late = f"the host's stamps are late by {clock.usual[1] * 1e3:.2f} ms (SD)"
    remedy = "state the device's sample counter in the source file, stamp on the device, or record without loss"
    missing = missing_by_rhythm(stream.stamps)
    if missing or (missing is not None and clock.missing):
        gap = f"{stream.stamps[int(np.argmax(np.diff(clock.count)))]:.4f} s"
        where = f", the first long gap at {gap}" if clock.missing else ""
        raise InputError(
            f"{stream.name}: about {missing or clock.missing} samples are missing{where}, and {late} at a "
            f"step of {clock.step * 1e3:.2f} ms: beside another device nothing tells which sample is which; {remedy}"
        )
    if missing is None and (clock.missing or 2e-4 < 1 - 1 / clock.step / fastest_hz < 0.1):
        mean = (len(stream.stamps) - 1) / (stream.stamps[-1] - stream.stamps[0])
        raise InputError(
            f"{stream.name}: {late}, too late to see whether some of its {mean:.2f} samples per second are missing; "
            f"{remedy}"
        )


NO_DRIFT = dict.fromkeys(("clock_drift_ppm", "clock_drift_se_ppm", "certain_clock_drift_ppm"))


def drift_row(ppm: float, se: float, freedom: float, largest_ppm: float) -> dict[str, float]:
    """How much faster the torque's clock runs than the angle's [ppm], its standard error of some degrees of freedom,
    and the drift if it is certain, else 0: beyond as many standard errors as are as rare (Student) as 4 that are known
    exactly. Raises InputError: a drift beyond what B and I bear."""
    enough = 4.0 if np.isinf(freedom) else float(-scipy.special.stdtrit(freedom, float(scipy.special.ndtr(-4.0))))
    certain = ppm if abs(ppm) > enough * se else 0.0
    if abs(certain) > largest_ppm:
        raise InputError(
            f"the clocks of angle and torque drift apart by {ppm:.2f} +- {se:.2f} ppm, more than {largest_ppm:g}: B "
            "and I would be wrong; synchronise the clocks, or record both channels with one device"
        )
    return dict(zip(NO_DRIFT, (ppm, se, certain), strict=True))
