"""The samples of a stream at the times that its decision gives them: true stamps, the even clock of the device, or the
clock of a source whose values a faster log repeats; and by how much the clocks of two devices drift apart.

The signal itself decides among three hypotheses. The device samples evenly and latency is in the stamps; the stamps are
true; the values were taken `age` loops before their stamp, as where a bus answers a loop later. The slow part of the
stamps (`stream.slow_part`) is set apart. If the sampling times move with g_k of the fast part f of the stamp k rows
earlier, a signal moves by the sum of g_k x' f_k: all g_k are 0, g_0 is 1, or two neighbours share 1 as the age lies
between them. How one-sided the scatter is does not decide: a loop with absolute targets is late, never early, and its
stamps true."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.signals.stream import (
    HeldValues,
    SampleCount,
    Stream,
    held_values,
    line_through,
    missing_by_rhythm,
    places_of_samples,
    slow_part,
)  # fmt: skip
from osl_analysis.trial import Array


@dataclass(frozen=True)
class Batches:
    """Samples that a host stamps together."""

    begins: SampleCount  # first row of each (k,)
    seconds: float  # [s] usual time from the first to the last sample of one
    shared: bool  # whether the samples of one have one stamp; else each has that at which its row was written
    prompt: bool  # whether their sizes tell that each waits for its last sample: they are as long as the time before


@dataclass(frozen=True)
class DeviceClock:
    """Stamps of a stream against the least-squares line through them."""

    stamps: Array  # (n,) [s]
    count: SampleCount  # (n,) place of every sample in the device's count
    counted: bool = False  # by the device itself

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
    def usual(self) -> float:
        """Standard deviation [s] of the residual by quantiles, but for a handful of late ones."""
        return float(np.diff(np.quantile(self.residual, (0.05, 0.95)))[0]) / 3.29

    @cached_property
    def wander(self) -> float:
        """Standard deviation [s] of the residual averaged over 50 samples, in which jitter averages out."""
        blocks = len(self.stamps) // 50
        return float(np.std(self.residual[: blocks * 50].reshape(-1, 50).mean(axis=1))) if blocks > 1 else self.sd

    @cached_property
    def slow(self) -> tuple[Array, int]:
        """The slow part (n,) [s] of the stamps, and at how many places their rate changes for good."""
        return slow_part(self.stamps, self.count, self.step)

    @cached_property
    def decimal(self) -> float:
        """Last decimal [s] with which the stamps were printed, down to 10 ns; 0 where none is seen."""
        after = self.stamps - self.stamps[0]
        for decimal in 10.0 ** -np.arange(2, 9):
            if all(np.max(np.abs(x / decimal - np.rint(x / decimal))) < 1e-3 for x in (after[:99], after)):
                return float(decimal)
        return 0.0

    @cached_property
    def batches(self) -> Batches | None:
        """Those that a host stamps: two in five rows are within 0.4 step of the one before. None where none are, as
        with printed decimals, or ticks of a slow clock, which are alike, their samples not."""
        steps = np.diff(self.stamps)
        begins = np.flatnonzero(np.append(True, steps > 0.4 * self.step))
        if not 3 < len(begins) <= 0.6 * len(self.stamps) or self.decimal > 0.5 * self.step:
            return None
        waits, sizes = np.diff(self.stamps[begins]), np.diff(begins)
        if np.std(waits) <= 0.1 * self.step * np.std(sizes):
            return None
        shared, ticks = bool(np.median(np.delete(steps, begins[1:] - 1)) < 0.1 * self.step), waits[:-1] / self.step
        is_prompt = shared and bool(np.std(ticks - sizes[1:]) < 0.6 * np.std(ticks - sizes[:-1]))
        return Batches(begins, self.step * (float(np.median(sizes)) - 1), shared, is_prompt)

    @cached_property
    def scatter(self) -> float:
        """RMS [s] of the stamps about what is smooth over 25 samples, but for where their rate changes."""
        (slow, kinks), length = self.slow, max(len(self.stamps) // 400, 25)
        power = (fast := self.stamps - slow) - savitzky_golay(fast, np.arange(len(fast)), 25, 0)
        blocks = (power[: len(power) // length * length] ** 2).reshape(-1, length).mean(axis=1)
        return float(np.sqrt(np.mean(np.sort(blocks)[: max(len(blocks) - 3 * kinks, 1)]))) if len(blocks) else self.sd

    @cached_property
    def settles(self) -> bool:
        """Whether the stamps come back to their line, or to that of each rate, within two seconds. Latency does."""
        length = int(np.clip(2 / self.step, 51, max(len(self.stamps) // 4, 1)))
        above = self.stamps - self.slow[0] if self.slow[1] else self.residual
        sums = np.cumsum(np.append(0.0, above))
        creep = np.abs(sums[length:] - sums[:-length]).max() / length
        return bool(creep <= max(self.step, 2 * self.scatter))

    @property
    def block(self) -> int:
        """Samples of 80 ms, 9 to 24, in which a signal tells whether it follows the fast part of the stamps."""
        return int(np.clip(round(0.08 / self.step), 9, 24))

    @cached_property
    def fast(self) -> Array:
        """The fast part (n,) [s] of the stamps."""
        return without_smooth(self.stamps - self.slow[0], self.count, self.block)

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
        is late by what the message waited, or in batches. A device whose rate changes has a line for each."""
        base, x = self.stamps - self.residual, self.count
        if np.ptp(self.residual) > self.step and self.slow[1]:
            apart, fast = np.abs(self.slow[0] - base).max(), float(np.std(self.stamps - self.slow[0]))
            base = self.slow[0] if apart > max(self.step, 2 * fast) else base
        residual = self.stamps - base
        if self.batches is not None and not self.batches.shared:
            begins = self.batches.begins
            residual -= self.stamps - np.repeat(self.stamps[begins], np.diff(begins, append=len(x)))
        low, middle, high = (float(at) for at in np.quantile(residual, (0.05, 0.5, 0.95)))
        spread = (high - low) / 3.29
        near = np.abs(residual - middle) <= 5 * spread + 1e-6 * self.step
        place, late = x[near], residual[near]
        step = line_through(place, late)[0]
        start = float(np.mean(late) - step * np.mean(place))
        if self.batches is not None or self.skew(late) > 0.5:
            # the highest line below all points: one point is held on each side of the mean count; the lowest point
            # below the line through them replaces the one on its side, until none lies below
            left, right, middle = 0, len(place) - 1, float(np.mean(place))
            for _ in range(len(place)):
                step = float((late[right] - late[left]) / (place[right] - place[left]))
                above = late - late[left] - step * (place - place[left])
                lowest = int(np.argmin(above))
                if above[lowest] >= 0 or lowest in (left, right):
                    break
                left, right = (lowest, right) if place[lowest] <= middle else (left, lowest)
            start = float(late[left] - step * place[left])
        return np.asarray(base + step * x + start, dtype=np.float64)

    def aged(self, age: float) -> Array:
        """When values that are `age` loops older than their stamps were taken, (n,) [s]: at the stamps of rows before.
        Behind a gap, and where a loop took far longer, these say nothing; the age is then that of usual loops."""
        rows, whole = np.arange(len(self.stamps)), int(np.floor(age))
        near, far = (self.stamps[np.clip(rows - k, 0, len(rows) - 1)] for k in (whole, whole + 1))
        times = (1 - (age - whole)) * near + (age - whole) * far
        odd = np.abs(times - self.stamps) > 3 * abs(age) * self.step
        odd[1:] |= np.diff(self.count) > 1
        odd[:4] = odd[-4:] = True
        return np.maximum.accumulate(np.where(odd, self.stamps - age * self.step, times)) if age else self.stamps


LAGS = np.arange(-1, 3)
"""Rows before a value whose stamps its sampling time may follow."""
AGES = np.linspace(0, 2, 21)
HYPOTHESES = np.vstack([np.zeros(4), np.maximum(1 - np.abs(AGES[:, None] - LAGS), 0)])
"""Responses (22, 4) to the stamps `LAGS` before: of an even device, and of values of the `AGES`."""
NOT_LINEAR = 0.05  # standard error of each response beside its noise, by what a first-order response leaves out
NO_MATTER = 0.001  # scatter, in steps, below which all hypotheses are the same samples: the device counts as even


@dataclass(frozen=True)
class StampEvidence:
    """What one signal says: by how much its sampling times move with the fast part of the stamps `LAGS` before, (4,),
    and the covariance (4, 4)."""

    response: Array
    covariance: Array

    @property
    def g(self) -> float:
        """Share of the stamps' scatter that is in the samples: 1 of true stamps, whatever their age, 0 if even."""
        return float(self.response.sum())

    @property
    def se(self) -> float:
        return float(np.sqrt(self.covariance.sum()))

    @cached_property
    def weight(self) -> Array:
        return np.asarray(np.linalg.inv(self.covariance + NOT_LINEAR**2 * np.eye(4)))

    @cached_property
    def misfit(self) -> Array:
        """Chi-square (22,) of the `HYPOTHESES`."""
        apart = self.response - HYPOTHESES
        return np.asarray(np.einsum("hi,ij,hj->h", apart, self.weight, apart))


def evidence_of(values: Array, clock: DeviceClock) -> StampEvidence | None:
    """The response of one signal (n,), by least squares in blocks of 9 to 24 consecutive samples of 80 ms, from which
    polynomials of degree 5 take the smooth motion. The slope x' is that of a polynomial over 40 ms. What rounding of
    printed stamps adds to the normal matrix, q^2/12, is taken off. The covariance is from the scatter of 20 chunks.
    None where the signal does not tell: too few blocks, stamps without scatter of their own, or more than a fifth of
    the mean square of x' is noise, which would pull the response towards 0."""
    there, step = ~np.isnan(values), clock.step
    found = slice(None) if there.all() else there  # a copy of each is 0.1 GB of an hour
    x, stamps, count, slow = values[found], clock.stamps[found], clock.count[found], clock.slow[0][found]
    size, window = clock.block, max(2 * round(0.02 / step) + 1, 7)
    if len(x) < 60 * size:
        return None
    degree = 3 if window > 11 else 5
    fast = clock.fast if there.all() else without_smooth(stamps - slow, count, size)
    rate = np.gradient(stamps - fast, count) / step
    slope = savitzky_golay(x, count, window, 1, degree) / np.maximum(rate, 0.2) / step
    back, ahead = LAGS[-1], -LAGS[0]
    first = np.arange(back, len(x) - ahead - size, size)
    ends = (first - back, first + size - 1 + ahead)

    def blocks(values: Array, lag: int = 0) -> Array:
        return np.asarray(np.lib.stride_tricks.sliding_window_view(values, size)[first - lag])

    steps, long = np.diff(stamps) / step / np.minimum(np.maximum(rate[1:], 0.2), 3), np.zeros(len(x), dtype=bool)
    long[1:-1] = (steps[:-1] > 1.6) & (steps[1:] > 0.6)  # a pause that no short step makes good
    pauses = np.cumsum(long) if np.mean(long) < 0.03 else np.zeros(len(x))
    whole = (count[ends[1]] - count[ends[0]] == ends[1] - ends[0]) & (pauses[ends[1]] == pauses[ends[0]])
    first = first[whole & (np.abs(blocks(fast)).max(axis=1) < 20 * np.sqrt(np.mean(fast**2)) + 1e-12)]
    # where a signal stands, it is the same whenever it is taken
    first = first[np.mean(blocks(slope) ** 2, axis=1) > 0.01 * np.mean(slope**2)]
    if len(first) < 60:
        return None
    smooth = np.linalg.qr(np.vander(np.linspace(-1, 1, size), 6))[0]
    rest = np.eye(size) - smooth @ smooth.T
    seen = blocks(x) @ rest
    largest = np.abs(seen).max(axis=1)
    kept = largest < 8 * np.median(largest) + 1e-12  # without the corners of the motion itself
    seen, first = seen[kept], first[kept]
    slopes = blocks(slope)
    push = np.empty((len(LAGS), *slopes.shape))
    for own, lag in zip(push, LAGS.tolist(), strict=True):  # one at a time: 0.1 GB of an hour
        np.matmul(slopes * blocks(fast, lag), rest, out=own)
    columns = push.reshape(len(LAGS), -1)
    plain = columns @ columns.T
    normal = plain.copy()
    if clock.decimal:
        for i, j in combinations_with_replacement(range(len(LAGS)), 2):
            apart = j - i
            near = slice(0, size - apart), slice(apart, size)
            products = np.diagonal(rest, apart) * (slopes[:, near[0]] * slopes[:, near[1]]).sum(axis=0)
            normal[i, j] = normal[j, i] = plain[i, j] - clock.decimal**2 / 12 * products.sum()
    sizes, plain_sizes = np.linalg.eigvalsh(normal), np.linalg.eigvalsh(plain)
    if sizes[0] <= max(0.02 * plain_sizes[0] * (clock.decimal > 0), 1e-9 * plain_sizes[-1]):
        return None
    inverse = np.linalg.inv(normal)
    response = inverse @ (columns @ seen.ravel())
    left = seen - np.tensordot(response, push, 1)
    weights = polynomial_rows(window, degree, 1)[window // 2]
    noise = np.mean(left**2) * size / (size - 6) * np.sum(weights**2) / step**2
    if not noise <= 0.2 * np.mean(slopes**2):
        return None
    push *= left
    scores = np.array([chunk.sum(axis=(1, 2)) for chunk in np.array_split(push, 20, axis=1)])
    return StampEvidence(response, inverse @ (scores.T @ scores) @ inverse * 20 / 19)


def without_smooth(late: Array, count: SampleCount, size: int) -> Array:
    """What stamps (n,) [s] are late by without what is smooth over four blocks of `size` samples."""
    return late - savitzky_golay(late, count, 4 * size + 1, 0)


def savitzky_golay(values: Array, count: SampleCount, window: int, order: int, degree: int = 3) -> Array:
    """Value (order 0) or slope per step (order 1), (n,), of a polynomial through each `window` of counted samples,
    missing ones bridged linearly. A gap is shortened to two windows, lest a clock that jumps by years fill memory."""
    place: SampleCount | slice = slice(None)
    if count[-1] - count[0] != len(values) - 1:
        place = np.concatenate([[0], np.cumsum(np.minimum(np.diff(count), 2 * window))])
        values = np.interp(np.arange(place[-1] + 1), place, values)
    window = min(window, (len(values) - 1) // 2 * 2 + 1)
    rows, half, found = polynomial_rows(window, min(degree, window - 1), order), window // 2, np.empty(len(values))
    found[:half], found[len(values) - half :] = rows[:half] @ values[:window], rows[half + 1 :] @ values[-window:]
    found[half : len(values) - half] = np.correlate(values, rows[half], "valid")
    return found[place]


@lru_cache(16)
def polynomial_rows(window: int, degree: int, order: int) -> Array:
    """What gives value (order 0) or slope per step (order 1) of the polynomial through a window, an odd number, of
    samples at each of them, (window, window)."""
    half = max(window // 2, 1)
    powers = np.vander((np.arange(window) - window // 2) / half, degree + 1, increasing=True)
    slopes = np.roll(powers, 1, axis=1) * np.arange(degree + 1) / half
    return np.asarray((slopes if order else powers) @ np.linalg.pinv(powers))


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
    age: float = 0.0  # [loops] by which they are older than true stamps, by what the signals say

    held: float | None = None  # rows of a faster log for which each value stands; None: every row has its own
    unsure: float = 0.0  # [s] by which held values, or stamped batches, may be older than they are taken to be

    def other(self) -> "Taken":
        """The same samples under the other hypothesis."""
        if self.unsure:
            return replace(self, delay=self.delay + self.unsure, unsure=-self.unsure)
        return replace(self, even=not self.even, why=f"the other hypothesis to: {self.why}")

    @property
    def times(self) -> Array:
        """When the rows were sampled, (n,) [s], before the delay is taken out."""
        return self.clock.times() if self.even else self.clock.aged(self.age)

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
        times, merged = self.times[self.present], 0
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
        known = fresh.stamps.tobytes() + (b"" if fresh.counter is None else fresh.counter.tobytes())
        if (clock := fresh.clocks.get(known)) is None:
            clock = DeviceClock(fresh.stamps, places_of_samples(fresh), fresh.counter is not None)
            fresh.clocks[known] = clock
        held, groups = dict[str, HeldValues](), []  # of sources that are slower than the rows
        for name, values in fresh.signals.items():
            if name not in fresh.silent and not np.isnan(values).any() and (one := held_values(values, clock.step)):
                held[name] = one
        own_rows = {name: values for name, values in fresh.signals.items() if name not in held}
        decided = decide(replace(fresh, signals=own_rows) if held else fresh, clock) if own_rows else []
        for part in decided:
            kinds = {n: (fresh.delays.get(n, 0.0), np.isnan(fresh.signals[n]).tobytes()) for n in part.signals}
            for kind in dict.fromkeys(kinds.values()):
                alike = tuple(name for name in part.signals if kinds[name] == kind)
                repeated = len(stream.stamps) - len(fresh.stamps)
                groups.append(replace(part, signals=alike, repeated=repeated, delay=kind[0]))
        if held:
            row_times = decided[0].times if decided else fresh.stamps
            taken += [held_taken(fresh, name, of, row_times, clock.step) for name, of in held.items()]
        for part in groups:
            if len(groups) + len(held) > 1:  # a stream whose name says which signals it has
                own = {name: fresh.signals[name] for name in part.signals}
                part = replace(part, stream=replace(fresh, name=f"{fresh.name} [{', '.join(own)}]", signals=own))
            taken.append(part)
    if len(streams) > 1 or len({part.even for part in taken}) > 1:
        fastest = max(1 / part.clock.step for part in taken)
        for part in taken:
            check_countable(part, fastest)
    return taken


def held_taken(stream: Stream, name: str, held: HeldValues, row_times: Array, step: float) -> Taken:
    """A held signal at its own rate. Where its source samples evenly, its clock lies at or below the first rows of all
    values, and above what is one step of the log earlier: the beat of the two rates leaves one place for it. Where they
    keep step, the first rows are taken, and only a stated delay behind these is firm. Of an uneven source each value is
    half a step older."""
    stamps = np.interp(held.rows, np.arange(len(row_times)), row_times)
    own = replace(stream, name=f"{stream.name} [{name}]", stamps=stamps, signals={name: held.values}, counter=None)
    clock = DeviceClock(stamps, np.arange(len(stamps)))
    late = stamps - clock.times()
    low, high = (float(at) for at in np.quantile(late, (0.005, 0.995)))
    even, beat = high - low < 2 * step, step - (high - low)
    unsure = beat if beat > 0.05 * step and name not in stream.delays else 0.0
    why = f"held: each value stands for {held.period:.4g} rows, its time is "
    why += f"the first of them, or up to {unsure * 1e3:.3g} ms before" if unsure else "known by where it changes"
    if not even:
        older, why = step / 2, f"undecided, true: {why}, uneven"
    else:
        older = -low if beat > 0 else step / 2 - float(np.mean(late))
    delay, firm = stream.delays.get(name, 0.0) + older, even and not unsure
    return Taken(own, clock, (name,), even, firm, True, why, delay=delay, held=held.period, unsure=unsure)


class Reading(NamedTuple):
    """How stamps are read: even, or true at an age [loops]; whether that is firm; and why."""

    even: bool
    age: float
    firm: bool
    why: str


def reading_of(clock: DeviceClock, evidence: Mapping[str, StampEvidence]) -> Reading:
    """The hypothesis that fits the evidence of some signals. It is firm where its chi-square is usual, and smaller by
    30 than that of the other kind. Else the stamps are kept if the signals fit none, or if the stamps wander slowly or
    scatter by more than a step: nothing is then moved far. Of a device that seems even, and whose stamps do not come
    back to its line, they are kept too."""
    seen = ", ".join(f"{name} g = {round(e.g, 3) + 0.0:.3f} +- {e.se:.3f}" for name, e in evidence.items())
    if clock.batches is not None and clock.settles and not clock.missing:
        why = "even: stamps of batches, in each of which the last sample waited least"
        other = f"undecided, {why}, or another: nothing tells; state `stamps: even`, with a `delay` if it is another"
        return Reading(True, 0.0, clock.batches.prompt, why if clock.batches.prompt else other)
    if not evidence:
        wanders = clock.wander > 0.1 * clock.step or float(np.std(clock.stamps - clock.slow[0])) > clock.step
        steps = f"the residual wanders by {clock.wander / clock.step:.3f} steps"
        return Reading(not wanders, 0.0, False, f"undecided, {'true' if wanders else 'even'}: {steps}")
    misfit = np.sum([one.misfit for one in evidence.values()], axis=0)
    variance = np.diag(np.linalg.inv(np.sum([one.weight for one in evidence.values()], axis=0)))
    even, aged, now = float(misfit[0]), int(np.argmin(misfit[1:])), int(np.argmin(np.abs(AGES)))
    aged = now if misfit[1 + now] < misfit[1 + aged] + 9 else aged
    age, true = round(float(AGES[aged]), 3), float(misfit[1:].min())
    known = variance.max() < 0.25**2
    if known and min(even, true) > 22 * (0.4 + 0.6 * len(evidence)):
        return Reading(False, 0.0, False, f"undecided, true: neither even sampling nor stamps of any age fit, {seen}")
    if not known or abs(even - true) < 30:
        return reading_of(clock, {})._replace(why=f"{reading_of(clock, {}).why}, {seen}")
    if not any(abs(e.g - (even < true)) > 2 * e.se for e in evidence.values()):
        return Reading(False, 0.0, False, f"undecided, true: g is within its error of the other kind, {seen}")
    if even > true:
        older = f", values {age:.1f} loops older than their stamps" if age else ""
        return Reading(False, age, True, f"true{older}: {seen}")
    if not clock.settles or (clock.missing and not clock.counted and clock.scatter > clock.step):
        why = "the stamps wander" if not clock.missing else "too late to count the missing samples"
        return Reading(False, 0.0, False, f"undecided, true: even by their scatter, but {why}, {seen}")
    return Reading(True, 0.0, True, f"even: {seen}")


def decide(stream: Stream, clock: DeviceClock) -> list[Taken]:
    """One decision for all signals of a stream; several where no decision fits all, and single signals are firm on
    different ones: all others then take the stamps. A stated choice stands."""
    names = tuple(stream.signals)
    if stream.choice != "auto":
        return [Taken(stream, clock, names, stream.choice == "even", True, True, f"stated: {stream.choice}")]
    if clock.sd < NO_MATTER * clock.step:
        return [Taken(stream, clock, names, True, True, False, "even: the stamps lie on their line")]
    scatter = np.inf if any(stream.measured.values()) else clock.scatter  # ingest saw that these scatter
    still, rounded = scatter < NO_MATTER * clock.step, scatter < 0.36 * clock.decimal  # q/sqrt(12): 0.29 q
    if (still or rounded) and clock.settles and clock.slow[1]:
        return [Taken(stream, clock, names, False, True, True, "true: only the rate of the stamps changes")]
    if rounded and clock.settles:
        return [Taken(stream, clock, names, True, True, True, "even: the stamps scatter by their rounding alone")]
    evidence = dict[str, StampEvidence]()
    for name in (name for name in names if name not in stream.silent):
        if name not in stream.measured:
            one = evidence_of(stream.signals[name], clock)
        else:
            one = StampEvidence(*known) if (known := stream.measured[name]) else None
        evidence |= {} if one is None else {name: one}
    readings = dict.fromkeys(names, reading_of(clock, evidence))
    single = {name: reading_of(clock, {name: said}) for name, said in evidence.items()}
    own = {name: one for name, one in single.items() if one.firm}
    if not readings[names[0]].firm and len({(one.even, one.age) for one in own.values()}) > 1:
        readings = {name: own.get(name, min(own.values(), key=lambda one: one.even)) for name in names}
    decisions = []
    for even, age in sorted({(one.even, one.age) for one in readings.values()}):
        group = tuple(name for name, one in readings.items() if (one.even, one.age) == (even, age))
        said = {name: evidence[name] for name in group if name in evidence}
        _, _, firm, why = reading_of(clock, said)
        # the stamp of a batch may be that of its first sample
        unsure = -clock.batches.seconds if clock.batches is not None and even and not firm else 0.0
        decisions.append(Taken(stream, clock, group, even, firm, True, why, said, age=age, unsure=unsure))
    return decisions


def check_countable(taken: Taken, fastest_hz: float) -> None:
    """Refuse one of several devices behind a host that is late and loses samples, where no counter says which. Where
    waits hide the rhythm of the stamps, it is refused if steps seem to be missing, or if it is slower than the fastest
    one by a share that is too large for clocks and too small to be meant; beyond three steps (SD) in any case: hardly
    a sample is then prompt, and the time of all is late by an unknown wait."""
    clock, stream = taken.clock, taken.stream
    # a tenth of a step: from there on a missing sample may be taken for a late one
    best = min(taken.evidence.values(), key=lambda said: said.se, default=None)
    even = taken.even or not (taken.firm or best is None or best.g > 0.5)
    if not even or taken.held or stream.counter is not None or clock.usual <= 0.1 * clock.step:
        return
    late = f"the host's stamps are late by {clock.usual * 1e3:.2f} ms (SD)"
    remedy = "state the device's sample counter in the source file, stamp on the device, or record without loss"
    missing = missing_by_rhythm(stream.stamps)
    if missing or (missing is not None and clock.missing):
        gap = f"{stream.stamps[int(np.argmax(np.diff(clock.count)))]:.4f} s"
        where = f", the first long gap at {gap}" if clock.missing else ""
        raise InputError(
            f"{stream.name}: about {missing or clock.missing} samples are missing{where}, and {late} at a "
            f"step of {clock.step * 1e3:.2f} ms: beside another device nothing tells which sample is which; {remedy}"
        )
    hidden = taken.even and min(clock.usual, float(np.std(clock.stamps - clock.slow[0]))) > 3 * clock.step
    if hidden or (missing is None and (clock.missing or 2e-4 < 1 - 1 / clock.step / fastest_hz < 0.1)):
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
