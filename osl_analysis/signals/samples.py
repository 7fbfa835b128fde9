"""When the samples of a stream were taken: at true stamps, on the even clock of the device, or on
the clock of a slower source whose values the log repeats; and the drift between the clocks of two
devices.

The signal itself decides among three hypotheses. Even: the device samples evenly, and the stamps
scatter by latency. True: the stamps are right. Aged: the values were taken `age` loops before their
stamps, as if a bus answers a loop later. The slow part of the stamps (`stream.slow_part`) is
removed first. If the sampling time moves with a share g_k of the fast part f_k of the stamp k rows
earlier, the signal x moves by the sum of g_k x' f_k. All g_k are 0 for even stamps, g_0 is 1 for
true ones, and two neighbours share 1 for an age between them. One-sided scatter does not decide: a
loop with absolute deadlines is late, never early, and its stamps are true."""

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
    """Batches of samples that a host stamps together."""

    begins: SampleCount  # (k,) first row of each batch
    seconds: float  # [s] usual time from the first to the last sample of a batch
    # whether the samples of a batch share one stamp; else each has the time at which its row was
    # written
    shared: bool
    # whether a batch waits for its last sample only: its size matches the wait before its stamp
    prompt: bool


@dataclass(frozen=True)
class DeviceClock:
    """Stamps of a stream against the least-squares line through them."""

    stamps: Array  # (n,) [s]
    count: SampleCount  # (n,) place of every sample in the device's count
    counted: bool = False  # whether the device itself counted them

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
        """Robust standard deviation [s] of the residual, from quantiles: a few late stamps do not
        count."""
        return float(np.diff(np.quantile(self.residual, (0.05, 0.95)))[0]) / 3.29

    @cached_property
    def wander(self) -> float:
        """Standard deviation [s] of the residual averaged over 50 samples. Jitter averages out."""
        blocks = len(self.stamps) // 50
        return (
            float(np.std(self.residual[: blocks * 50].reshape(-1, 50).mean(axis=1)))
            if blocks > 1
            else self.sd
        )

    @cached_property
    def slow(self) -> tuple[Array, int]:
        """The slow part (n,) [s] of the stamps, and the number of places at which their rate
        changes for good."""
        return slow_part(self.stamps, self.count, self.step)

    @cached_property
    def decimal(self) -> float:
        """Decimal [s] to which the stamps were printed, 10 ms to 10 ns; 0 if none is seen."""
        after = self.stamps - self.stamps[0]
        for decimal in 10.0 ** -np.arange(2, 9):
            if all(
                np.max(np.abs(x / decimal - np.rint(x / decimal))) < 1e-3
                for x in (after[:99], after)
            ):
                return float(decimal)
        return 0.0

    @cached_property
    def batches(self) -> Batches | None:
        """The batches in which a host stamps; None if it does not. At least 40 % of the rows follow
        within 0.4 steps. Stamps rounded to decimals, or to ticks of a slow clock, are no batches:
        these waits are alike, whatever their numbers of samples."""
        steps = np.diff(self.stamps)
        begins = np.flatnonzero(np.append(True, steps > 0.4 * self.step))
        if not 3 < len(begins) <= 0.6 * len(self.stamps) or self.decimal > 0.5 * self.step:
            return None
        waits, sizes = np.diff(self.stamps[begins]), np.diff(begins)
        if np.std(waits) <= 0.1 * self.step * np.std(sizes):
            return None
        shared, ticks = (
            bool(np.median(np.delete(steps, begins[1:] - 1)) < 0.1 * self.step),
            waits[:-1] / self.step,
        )
        is_prompt = shared and bool(np.std(ticks - sizes[1:]) < 0.6 * np.std(ticks - sizes[:-1]))
        return Batches(begins, self.step * (float(np.median(sizes)) - 1), shared, is_prompt)

    @cached_property
    def scatter(self) -> float:
        """RMS [s] of the stamps about a curve that is smooth over 25 samples, without places where
        the rate changes."""
        (slow, kinks), length = self.slow, max(len(self.stamps) // 400, 25)
        power = (fast := self.stamps - slow) - savitzky_golay(fast, np.arange(len(fast)), 25, 0)
        blocks = (power[: len(power) // length * length] ** 2).reshape(-1, length).mean(axis=1)
        return (
            float(np.sqrt(np.mean(np.sort(blocks)[: max(len(blocks) - 3 * kinks, 1)])))
            if len(blocks)
            else self.sd
        )

    @cached_property
    def settles(self) -> bool:
        """Whether the stamps come back to their line, or to the line of each rate, within 2 s, as
        with latency."""
        length = int(np.clip(2 / self.step, 51, max(len(self.stamps) // 4, 1)))
        above = self.stamps - self.slow[0] if self.slow[1] else self.residual
        sums = np.cumsum(np.append(0.0, above))
        creep = np.abs(sums[length:] - sums[:-length]).max() / length
        return bool(creep <= max(self.step, 2 * self.scatter))

    @property
    def block(self) -> int:
        """Samples per block in `evidence_of`: those of 80 ms, but 9 to 24."""
        return int(np.clip(round(0.08 / self.step), 9, 24))

    @cached_property
    def fast(self) -> Array:
        """The fast part (n,) [s] of the stamps."""
        return without_smooth(self.stamps - self.slow[0], self.count, self.block)

    @property
    def missing(self) -> int:
        """Number of missing samples: places that the count leaves free."""
        return int(self.count[-1] - self.count[0] + 1 - len(self.count))

    def skew(self, residual: Array) -> float:
        """Skewness of a residual; 0 if it does not scatter."""
        apart, sd = residual - residual.mean(), float(np.std(residual))
        return float(apart @ (apart * apart)) / len(apart) / sd**3 if sd > 1e-6 * self.step else 0.0

    def times(self) -> Array:
        """When the samples were taken, (n,) [s], if the device samples evenly: on the least-squares
        line, without the few stamps that lie far off. If the rest is one-sided or in batches, the
        line is its lower edge instead, because a host's stamp is late by the message's wait. A
        device whose rate changes has a line for each rate."""
        base, x = self.stamps - self.residual, self.count
        if np.ptp(self.residual) > self.step and self.slow[1]:
            apart, fast = (
                np.abs(self.slow[0] - base).max(),
                float(np.std(self.stamps - self.slow[0])),
            )
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
            # The highest line below all points goes through one point on each side of the mean
            # count. The lowest point below the line replaces the point on its side, until none lies
            # below.
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
        """When values `age` loops older than their stamps were taken, (n,) [s]: interpolated
        between earlier stamps. Behind a gap or a very long loop these do not tell; there, `age`
        usual steps are taken off."""
        rows, whole = np.arange(len(self.stamps)), int(np.floor(age))
        near, far = (self.stamps[np.clip(rows - k, 0, len(rows) - 1)] for k in (whole, whole + 1))
        times = (1 - (age - whole)) * near + (age - whole) * far
        odd = np.abs(times - self.stamps) > 3 * abs(age) * self.step
        odd[1:] |= np.diff(self.count) > 1
        odd[:4] = odd[-4:] = True
        return (
            np.maximum.accumulate(np.where(odd, self.stamps - age * self.step, times))
            if age
            else self.stamps
        )


LAGS = np.arange(-1, 3)
"""Lags k, in rows, of the stamps that the sampling time of a value may follow."""
AGES = np.linspace(0, 2, 21)
HYPOTHESES = np.vstack([np.zeros(4), np.maximum(1 - np.abs(AGES[:, None] - LAGS), 0)])
"""Expected responses g_k (22, 4) at `LAGS`: of an even device, then of values of each of the
`AGES`."""
# standard error of a response, beside its noise, because the model is linear in the stamps
NOT_LINEAR = 0.05
# scatter, in steps, below which all hypotheses give the same samples: taken as even
NO_MATTER = 0.001


@dataclass(frozen=True)
class StampEvidence:
    """The evidence of one signal: the responses g_k (4,) of its sampling times to the fast part of
    the stamps, at `LAGS`, and their covariance (4, 4)."""

    response: Array
    covariance: Array

    @property
    def g(self) -> float:
        """Share of the stamps' scatter that the sampling times have: 1 for true stamps of any age,
        0 for even ones."""
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
    """The response of one signal (n,), by least squares in blocks of 80 ms, 9 to 24 samples.
    Polynomials of degree 5 take the smooth motion out of each block. The slope x' is that of a
    polynomial over 40 ms. The variance q^2/12 of stamps rounded to q is taken off the normal
    matrix. The covariance comes from the scatter of 20 chunks. None if the signal does not tell:
    too few blocks, stamps that hardly scatter, or noise in more than a fifth of the mean square of
    x', which would pull the response towards 0."""
    there, step = ~np.isnan(values), clock.step
    found = slice(None) if there.all() else there  # avoids copies, 0.1 GB for an hour
    x, stamps, count, slow = (
        values[found],
        clock.stamps[found],
        clock.count[found],
        clock.slow[0][found],
    )
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

    steps, long = (
        np.diff(stamps) / step / np.minimum(np.maximum(rate[1:], 0.2), 3),
        np.zeros(len(x), dtype=bool),
    )
    long[1:-1] = (steps[:-1] > 1.6) & (steps[1:] > 0.6)  # a pause that no short step makes up for
    pauses = np.cumsum(long) if np.mean(long) < 0.03 else np.zeros(len(x))
    whole = (count[ends[1]] - count[ends[0]] == ends[1] - ends[0]) & (
        pauses[ends[1]] == pauses[ends[0]]
    )
    first = first[
        whole & (np.abs(blocks(fast)).max(axis=1) < 20 * np.sqrt(np.mean(fast**2)) + 1e-12)
    ]
    # a signal that stands does not tell when it was sampled
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
    # one at a time: each takes 0.1 GB for an hour
    for own, lag in zip(push, LAGS.tolist(), strict=True):
        np.matmul(slopes * blocks(fast, lag), rest, out=own)
    columns = push.reshape(len(LAGS), -1)
    plain = columns @ columns.T
    normal = plain.copy()
    if clock.decimal:
        for i, j in combinations_with_replacement(range(len(LAGS)), 2):
            apart = j - i
            near = slice(0, size - apart), slice(apart, size)
            products = np.diagonal(rest, apart) * (slopes[:, near[0]] * slopes[:, near[1]]).sum(
                axis=0
            )
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
    """Lateness (n,) [s] of stamps, minus its curve that is smooth over four blocks of `size`
    samples."""
    return late - savitzky_golay(late, count, 4 * size + 1, 0)


def savitzky_golay(
    values: Array, count: SampleCount, window: int, order: int, degree: int = 3
) -> Array:
    """Value (order 0) or slope per step (order 1), (n,), of a polynomial through each `window` of
    samples by count. Missing samples are bridged linearly. A gap is shortened to two windows: a
    clock may jump by years."""
    place: SampleCount | slice = slice(None)
    if count[-1] - count[0] != len(values) - 1:
        place = np.concatenate([[0], np.cumsum(np.minimum(np.diff(count), 2 * window))])
        values = np.interp(np.arange(place[-1] + 1), place, values)
    window = min(window, (len(values) - 1) // 2 * 2 + 1)
    rows, half, found = (
        polynomial_rows(window, min(degree, window - 1), order),
        window // 2,
        np.empty(len(values)),
    )
    found[:half], found[len(values) - half :] = (
        rows[:half] @ values[:window],
        rows[half + 1 :] @ values[-window:],
    )
    found[half : len(values) - half] = np.correlate(values, rows[half], "valid")
    return found[place]


@lru_cache(16)
def polynomial_rows(window: int, degree: int, order: int) -> Array:
    """Matrix (window, window) from an odd number of samples to the values (order 0) or slopes per
    step (order 1) of the polynomial through them."""
    half = max(window // 2, 1)
    powers = np.vander((np.arange(window) - window // 2) / half, degree + 1, increasing=True)
    slopes = np.roll(powers, 1, axis=1) * np.arange(degree + 1) / half
    return np.asarray((slopes if order else powers) @ np.linalg.pinv(powers))


@dataclass(frozen=True)
class Taken:
    """Signals of a stream with the stream's clock, and how their stamps are taken."""

    stream: Stream
    clock: DeviceClock
    signals: tuple[str, ...]  # names; they lack values in the same rows
    even: bool  # whether the device samples evenly; else the stamps are true
    # whether this is stated, or seen in the signals; else the other hypothesis may be right
    firm: bool
    matters: bool  # whether the two hypotheses differ
    why: str  # one sentence for the provenance
    # per signal; empty if none was needed
    evidence: Mapping[str, StampEvidence] = field(default_factory=dict)
    repeated: int = 0  # number of rows that were written twice
    delay: float = 0.0  # [s] by which the samples are older than their times
    # [loops] by which samples are older than their true stamps, by the signals' evidence
    age: float = 0.0

    # rows per value if the log repeats each; None: every row has its own value
    held: float | None = None
    unsure: float = 0.0  # [s] by which held values or batches may be older than assumed

    def other(self) -> "Taken":
        """The same samples under the other hypothesis."""
        if self.unsure:
            return replace(self, delay=self.delay + self.unsure, unsure=-self.unsure)
        return replace(self, even=not self.even, why=f"the other hypothesis to: {self.why}")

    @property
    def times(self) -> Array:
        """When the rows were sampled, (n,) [s], without the delay."""
        return self.clock.times() if self.even else self.clock.aged(self.age)

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """Rows (n,) in which the signals have values."""
        return np.asarray(~np.isnan(self.stream.signals[self.signals[0]]))

    @cached_property
    def stride(self) -> int:
        """Rows from one value to the next: more than 1 if signals of a lower rate share the rows of
        a faster one."""
        return int(np.median(np.diff(self.clock.count[self.present])))

    @property
    def step(self) -> float:
        """Usual step [s] from one value to the next."""
        return self.clock.step * self.stride

    @cached_property
    def samples(self) -> tuple[Array, dict[str, Array], int]:
        """Rising times (k,) [s] of the samples, minus the delay; their values (k,) by signal,
        without silent ones; and the number of samples merged because their true stamps are so
        close: close knots of a spline amplify noise."""
        names = [
            name
            for name in self.signals
            if name in self.stream.signals and name not in self.stream.silent
        ]
        values = [self.stream.signals[name][self.present] for name in names]
        times, merged = self.times[self.present], 0
        begins = np.concatenate([[True], np.diff(times) >= (closest := 0.5 * self.step)])
        if not self.even and not begins.all():
            start = 0.0
            # a group is what lies within `closest` of its first sample
            for row in np.flatnonzero(~begins):
                start = times[row - 1] if begins[row - 1] else start
                begins[row] = times[row] - start >= closest
            first = np.flatnonzero(begins)
            size, merged = np.diff(np.append(first, len(times))), len(times) - len(first)
            times, *values = (np.add.reduceat(one, first) / size for one in (times, *values))
        return times - self.delay, dict(zip(names, values, strict=True)), merged


def take(streams: Sequence[Stream]) -> list[Taken]:
    """The decision for every stream. A stream is split by decision, by delay and by rows with
    missing values. Raises InputError as `places_of_samples` and `check_countable`."""
    taken: list[Taken] = []
    for stream in streams:
        fresh = stream.without_repeats()
        known = fresh.stamps.tobytes() + (b"" if fresh.counter is None else fresh.counter.tobytes())
        if (clock := fresh.clocks.get(known)) is None:
            clock = DeviceClock(fresh.stamps, places_of_samples(fresh), fresh.counter is not None)
            fresh.clocks[known] = clock
        # values of sources that are slower than the rows
        held, groups = dict[str, HeldValues](), []
        for name, values in fresh.signals.items():
            if (
                name not in fresh.silent
                and not np.isnan(values).any()
                and (one := held_values(values, clock.step))
            ):
                held[name] = one
        own_rows = {name: values for name, values in fresh.signals.items() if name not in held}
        decided = (
            decide(replace(fresh, signals=own_rows) if held else fresh, clock) if own_rows else []
        )
        for part in decided:
            kinds = {
                n: (fresh.delays.get(n, 0.0), np.isnan(fresh.signals[n]).tobytes())
                for n in part.signals
            }
            for kind in dict.fromkeys(kinds.values()):
                alike = tuple(name for name in part.signals if kinds[name] == kind)
                repeated = len(stream.stamps) - len(fresh.stamps)
                groups.append(replace(part, signals=alike, repeated=repeated, delay=kind[0]))
        if held:
            row_times = decided[0].times if decided else fresh.stamps
            taken += [
                held_taken(fresh, name, of, row_times, clock.step) for name, of in held.items()
            ]
        for part in groups:
            if len(groups) + len(held) > 1:  # the stream's name must say which signals it has
                own = {name: fresh.signals[name] for name in part.signals}
                part = replace(
                    part,
                    stream=replace(fresh, name=f"{fresh.name} [{', '.join(own)}]", signals=own),
                )
            taken.append(part)
    if len(streams) > 1 or len({part.even for part in taken}) > 1:
        fastest = max(1 / part.clock.step for part in taken)
        for part in taken:
            check_countable(part, fastest)
    return taken


def held_taken(stream: Stream, name: str, held: HeldValues, row_times: Array, step: float) -> Taken:
    """A held signal at its own rate. If its source samples evenly, each value was taken at its
    first row or less than one step of the log earlier. The beat of the two rates narrows this to
    one clock. If the rates keep step, the first rows are taken, and only a stated delay makes this
    firm. Values of an uneven source are taken half a step older."""
    stamps = np.interp(held.rows, np.arange(len(row_times)), row_times)
    own = replace(
        stream,
        name=f"{stream.name} [{name}]",
        stamps=stamps,
        signals={name: held.values},
        counter=None,
    )
    clock = DeviceClock(stamps, np.arange(len(stamps)))
    late = stamps - clock.times()
    low, high = (float(at) for at in np.quantile(late, (0.005, 0.995)))
    even, beat = high - low < 2 * step, step - (high - low)
    unsure = beat if beat > 0.05 * step and name not in stream.delays else 0.0
    why = f"held: each value stands for {held.period:.4g} rows, its time is "
    why += (
        f"the first of them, or up to {unsure * 1e3:.3g} ms before"
        if unsure
        else "known by where it changes"
    )
    if not even:
        older, why = step / 2, f"undecided, true: {why}, uneven"
    else:
        older = -low if beat > 0 else step / 2 - float(np.mean(late))
    delay, firm = stream.delays.get(name, 0.0) + older, even and not unsure
    return Taken(
        own, clock, (name,), even, firm, True, why, delay=delay, held=held.period, unsure=unsure
    )


class Reading(NamedTuple):
    """How stamps are read: even, or true with an age [loops]; whether that is firm; and why."""

    even: bool
    age: float
    firm: bool
    why: str


def reading_of(clock: DeviceClock, evidence: Mapping[str, StampEvidence]) -> Reading:
    """The hypothesis that fits the evidence of some signals. It is firm if its chi-square is not
    too large, and smaller than that of the other kind by 30. Otherwise the stamps are kept as true
    if the signals fit no hypothesis, or if the stamps wander slowly or scatter by more than a step:
    so nothing is moved far. They are also kept if the device seems even but its stamps do not come
    back to the line."""
    seen = ", ".join(
        f"{name} g = {round(e.g, 3) + 0.0:.3f} +- {e.se:.3f}" for name, e in evidence.items()
    )
    if clock.batches is not None and clock.settles and not clock.missing:
        why = "even: stamps of batches, in each of which the last sample waited least"
        other = (
            f"undecided, {why}, or another: nothing tells; state `stamps: even`, with a `delay` if"
            " it is another"
        )
        return Reading(True, 0.0, clock.batches.prompt, why if clock.batches.prompt else other)
    if not evidence:
        wanders = (
            clock.wander > 0.1 * clock.step
            or float(np.std(clock.stamps - clock.slow[0])) > clock.step
        )
        steps = f"the residual wanders by {clock.wander / clock.step:.3f} steps"
        return Reading(
            not wanders, 0.0, False, f"undecided, {'true' if wanders else 'even'}: {steps}"
        )
    misfit = np.sum([one.misfit for one in evidence.values()], axis=0)
    variance = np.diag(np.linalg.inv(np.sum([one.weight for one in evidence.values()], axis=0)))
    even, aged, now = float(misfit[0]), int(np.argmin(misfit[1:])), int(np.argmin(np.abs(AGES)))
    aged = now if misfit[1 + now] < misfit[1 + aged] + 9 else aged
    age, true = round(float(AGES[aged]), 3), float(misfit[1:].min())
    known = variance.max() < 0.25**2
    if known and min(even, true) > 22 * (0.4 + 0.6 * len(evidence)):
        return Reading(
            False,
            0.0,
            False,
            f"undecided, true: neither even sampling nor stamps of any age fit, {seen}",
        )
    if not known or abs(even - true) < 30:
        return reading_of(clock, {})._replace(why=f"{reading_of(clock, {}).why}, {seen}")
    if not any(abs(e.g - (even < true)) > 2 * e.se for e in evidence.values()):
        return Reading(
            False, 0.0, False, f"undecided, true: g is within its error of the other kind, {seen}"
        )
    if even > true:
        older = f", values {age:.1f} loops older than their stamps" if age else ""
        return Reading(False, age, True, f"true{older}: {seen}")
    if not clock.settles or (clock.missing and not clock.counted and clock.scatter > clock.step):
        why = "the stamps wander" if not clock.missing else "too late to count the missing samples"
        return Reading(
            False, 0.0, False, f"undecided, true: even by their scatter, but {why}, {seen}"
        )
    return Reading(True, 0.0, True, f"even: {seen}")


def decide(stream: Stream, clock: DeviceClock) -> list[Taken]:
    """One decision for all signals of a stream. It is split only if no decision fits all and single
    signals are firm on different ones; the others then follow the signal that finds its stamps
    true. A stated choice stands."""
    names = tuple(stream.signals)
    if stream.choice != "auto":
        return [
            Taken(
                stream,
                clock,
                names,
                stream.choice == "even",
                True,
                True,
                f"stated: {stream.choice}",
            )
        ]
    if clock.sd < NO_MATTER * clock.step:
        return [
            Taken(stream, clock, names, True, True, False, "even: the stamps lie on their line")
        ]
    # ingest saw that these scatter
    scatter = np.inf if any(stream.measured.values()) else clock.scatter
    # q/sqrt(12): 0.29 q
    still, rounded = scatter < NO_MATTER * clock.step, scatter < 0.36 * clock.decimal
    if (still or rounded) and clock.settles and clock.slow[1]:
        return [
            Taken(
                stream, clock, names, False, True, True, "true: only the rate of the stamps changes"
            )
        ]
    if rounded and clock.settles:
        return [
            Taken(
                stream,
                clock,
                names,
                True,
                True,
                True,
                "even: the stamps scatter by their rounding alone",
            )
        ]
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
        readings = {
            name: own.get(name, min(own.values(), key=lambda one: one.even)) for name in names
        }
    decisions = []
    for even, age in sorted({(one.even, one.age) for one in readings.values()}):
        group = tuple(name for name, one in readings.items() if (one.even, one.age) == (even, age))
        said = {name: evidence[name] for name in group if name in evidence}
        _, _, firm, why = reading_of(clock, said)
        # the stamp of a batch may belong to its first sample
        unsure = -clock.batches.seconds if clock.batches is not None and even and not firm else 0.0
        decisions.append(
            Taken(stream, clock, group, even, firm, True, why, said, age=age, unsure=unsure)
        )
    return decisions


def check_countable(taken: Taken, fastest_hz: float) -> None:
    """Refuse one of several devices if its host is late and loses samples, and no counter tells
    which. If waits hide the rhythm of the stamps, it is refused if samples seem to be missing, or
    if its rate is below the fastest one by a share too large for clocks and too small to be
    intended. If even stamps are late by more than three steps (SD), it is always refused: hardly a
    sample is prompt, and all times are late by an unknown wait."""
    clock, stream = taken.clock, taken.stream
    # beyond a tenth of a step, a missing sample may be taken for a late one
    best = min(taken.evidence.values(), key=lambda said: said.se, default=None)
    even = taken.even or not (taken.firm or best is None or best.g > 0.5)
    if not even or taken.held or stream.counter is not None or clock.usual <= 0.1 * clock.step:
        return
    late = f"the host's stamps are late by {clock.usual * 1e3:.2f} ms (SD)"
    remedy = (
        "state the device's sample counter in the source file, stamp on the device, or record"
        " without loss"
    )
    missing = missing_by_rhythm(stream.stamps)
    if missing or (missing is not None and clock.missing):
        gap = f"{stream.stamps[int(np.argmax(np.diff(clock.count)))]:.4f} s"
        where = f", the first long gap at {gap}" if clock.missing else ""
        raise InputError(
            f"{stream.name}: about {missing or clock.missing} samples are missing{where}, and"
            f" {late} at a step of {clock.step * 1e3:.2f} ms: beside another device nothing tells"
            f" which sample is which; {remedy}"
        )
    hidden = (
        taken.even
        and min(clock.usual, float(np.std(clock.stamps - clock.slow[0]))) > 3 * clock.step
    )
    if hidden or (
        missing is None and (clock.missing or 2e-4 < 1 - 1 / clock.step / fastest_hz < 0.1)
    ):
        mean = (len(stream.stamps) - 1) / (stream.stamps[-1] - stream.stamps[0])
        raise InputError(
            f"{stream.name}: {late}, too late to see whether some of its {mean:.2f} samples per"
            f" second are missing; {remedy}"
        )


NO_DRIFT = dict.fromkeys(("clock_drift_ppm", "clock_drift_se_ppm", "certain_clock_drift_ppm"))


def drift_row(ppm: float, se: float, freedom: float, largest_ppm: float) -> dict[str, float]:
    """How much faster the torque's clock runs than the angle's [ppm], its standard error, and the
    drift if it is certain, else 0. Certain is as improbable by Student's t, with these degrees of
    freedom, as 4 exact standard errors. Raises InputError: a certain drift beyond `largest_ppm`,
    which would make B and I wrong."""
    enough = (
        4.0
        if np.isinf(freedom)
        else float(-scipy.special.stdtrit(freedom, float(scipy.special.ndtr(-4.0))))
    )
    certain = ppm if abs(ppm) > enough * se else 0.0
    if abs(certain) > largest_ppm:
        raise InputError(
            f"the clocks of angle and torque drift apart by {ppm:.2f} +- {se:.2f} ppm, more than"
            f" {largest_ppm:g}: B and I would be wrong; synchronise the clocks, or record both"
            " channels with one device"
        )
    return dict(zip(NO_DRIFT, (ppm, se, certain), strict=True))
