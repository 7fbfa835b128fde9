# SPDX-License-Identifier: Apache-2.0
"""How stamps are read: as even samples of a device, or as true times of some age.

The signal itself decides among three hypotheses. Even: the device samples evenly, and the stamps
scatter by latency. True: the stamps are right. Aged: the values were taken `age` loops before their
stamps, as if a bus answers a loop later.

The slow part of the stamps (`sample_count.slow_part`) is removed first. If the sampling time moves
with a share g_k of the fast part f_k of the stamp k rows earlier, the signal x moves by the sum of
g_k x' f_k. All g_k are 0 for even stamps, g_0 is 1 for true ones, and two neighbours share 1 for an
age between them. One-sided scatter does not decide: a loop with absolute deadlines is late, never
early, and its stamps are true.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.signals.device_clock import DeviceClock
from osl_analysis.signals.sample_count import SampleCount
from osl_analysis.trial import Array

# lags k, in rows, of the stamps that the sampling time of a value may follow
LAGS = np.arange(-1, 3)
MOST_BEFORE = LAGS[-1]  # rows before a block that a lag reaches
MOST_BEHIND = -LAGS[0]  # rows behind it
AGES = np.linspace(0, 2, 21)  # loops
# Expected responses g_k (22, 4) at `LAGS`: of an even device, then of values of each of the `AGES`.
HYPOTHESES = np.vstack(
    [np.zeros(len(LAGS)), np.maximum(1 - np.abs(AGES[:, None] - LAGS), 0)],
)
MOTION_DEGREE = 5  # of the polynomial that takes the smooth motion out of a block
FEWEST_BLOCKS = 60
CHUNKS = 20  # whose scatter gives the covariance


class StampEvidence(NamedTuple):
    """Evidence of one signal: how its sampling times respond to the fast part of the stamps."""

    # share of the stamps' scatter that the sampling times have: 1 for true stamps of any age, 0 for
    # even ones
    g: float
    se: float  # standard error of g
    weight: Array  # (4, 4), inverse of the covariance at `LAGS`, with that of the model's error
    misfit: Array  # (22,), chi-square of the `HYPOTHESES`


def evidence_from(response: Array, covariance: Array) -> StampEvidence:
    """Evidence by the responses g_k (4,) at `LAGS`, and their covariance (4, 4)."""
    not_linear = 0.05  # standard error beside the noise: the model is linear in the stamps
    weight = np.asarray(np.linalg.inv(covariance + not_linear**2 * np.eye(len(LAGS))))
    deviation = response - HYPOTHESES
    misfit = np.einsum("hi,ij,hj->h", deviation, weight, deviation)
    return StampEvidence(response.sum(), np.sqrt(covariance.sum()), weight, misfit)


@dataclass(frozen=True)
class StampsOfValues:
    """What the stamps do in the rows in which signals have values, and blocks of these rows."""

    count: SampleCount  # (m,)
    fast: Array  # (m,) [s] fast part of the stamps
    local_step: Array  # (m,) [s] of the stamps without their fast part
    # (k,) of blocks of `size` rows without missing samples or pauses
    numbers: NDArray[np.intp]
    size: int


def evidence_by_signal(
    signals: Mapping[str, Array], clock: DeviceClock
) -> dict[str, StampEvidence]:
    """Estimate the responses of signals' sampling times to the scatter of their stamps.

    Parameters
    ----------
    signals : Mapping
        (n,) each, NaN where the row has no value.
    clock : DeviceClock
        Of the stamps (n,).

    Returns
    -------
    dict
        By signal, without those that do not tell: too few blocks, stamps that hardly scatter, or
        noise in more than a fifth of the mean square of x'.
    """
    block_s = 0.08  # in which the signals tell how the stamps scatter
    fewest_rows, most_rows = 9, 24
    size = int(np.clip(round(block_s / clock.step), fewest_rows, most_rows))
    by_signal = {}
    stamps_by_rows = {}
    for name, values in signals.items():
        has_value = ~np.isnan(values)
        if np.count_nonzero(has_value) < FEWEST_BLOCKS * size:
            continue
        rows = has_value.tobytes()
        if rows not in stamps_by_rows:
            stamps_by_rows[rows] = stamps_of_values(clock, has_value, size)
        evidence = evidence_of(values[has_value], clock, stamps_by_rows[rows])
        if evidence is not None:
            by_signal[name] = evidence
    return by_signal


def evidence_of(values: Array, clock: DeviceClock, stamps: StampsOfValues) -> StampEvidence | None:
    """Estimate the response of one signal's sampling times to the scatter of its stamps.

    Parameters
    ----------
    values : Array
        (m,), in the rows of `stamps`.

    Notes
    -----
    Least squares in blocks of 80 ms. Orthonormal polynomials Q of degree 5 take the smooth motion
    out of each: of blocks X remains X (I - Q Q'). The variance q^2/12 of stamps rounded to q is
    taken off the normal matrix.
    """
    size = stamps.size
    slope_half_window_s = 0.02  # the slope x' is that of a polynomial over 40 ms
    fewest_in_window = 7
    window = max(2 * round(slope_half_window_s / clock.step) + 1, fewest_in_window)
    # rows; below some 275 Hz they are far apart, and the motion bends more from one to the next
    longest_short_window = 11
    degree_of_short, degree_of_long = 5, 3  # which averages more of the noise
    degree = degree_of_long if window > longest_short_window else degree_of_short
    slope = savitzky_golay(values, stamps.count, window, 1, degree) / stamps.local_step
    # a signal that stands does not tell when it was sampled
    standing = 0.01  # mean square of a slope, as a share of the usual one
    power = np.mean(blocks_of(slope, stamps.numbers, size) ** 2, axis=1)
    numbers = stamps.numbers[power > standing * np.mean(slope**2)]
    if len(numbers) < FEWEST_BLOCKS:
        return None

    polynomials = np.linalg.qr(np.vander(np.linspace(-1, 1, size), MOTION_DEGREE + 1))[0]
    without_motion = np.eye(size) - polynomials @ polynomials.T
    fluctuations = blocks_of(values, numbers, size) @ without_motion
    corner = 8  # medians of what is left of a block; more is a corner of the motion itself
    largest = np.abs(fluctuations).max(axis=1)
    above_zero = 1e-12  # [s, rad, N*m], so that 0 is below the limit also where this is 0
    is_smooth = largest < corner * np.median(largest) + above_zero
    fluctuations = fluctuations[is_smooth]
    numbers = numbers[is_smooth]

    # by chunk: the normal matrix of what the stamps move, and its products with what the signal
    # does
    normals = np.zeros((CHUNKS, len(LAGS), len(LAGS)))
    products = np.zeros((CHUNKS, len(LAGS)))
    slope_products = np.zeros((size, size))
    for chunk, rows in enumerate(np.array_split(np.arange(len(numbers)), CHUNKS)):
        slopes = blocks_of(slope, numbers[rows], size)
        slope_products += slopes.T @ slopes
        moved = np.array(
            [slopes * blocks_of(stamps.fast, numbers[rows], size, lag) for lag in LAGS.tolist()]
        )
        moved -= (moved @ polynomials) @ polynomials.T
        columns = moved.reshape(len(LAGS), -1)
        normals[chunk] = columns @ columns.T
        products[chunk] = columns @ fluctuations[rows].ravel()

    normal = normal_matrix(normals.sum(axis=0), slope_products, without_motion, clock.decimal)
    if normal is None:
        return None
    inverse = np.linalg.inv(normal)
    response = inverse @ products.sum(axis=0)
    # what is left of the signal: its square, and its products by chunk
    squares = np.vdot(fluctuations, fluctuations)
    squares += (normals @ response - 2 * products).sum(axis=0) @ response
    scores = products - normals @ response

    slope_weights = scipy.signal.savgol_coeffs(window, degree, 1)
    residual_variance = squares / fluctuations.size * size / (size - (MOTION_DEGREE + 1))
    slope_noise = residual_variance * np.sum(slope_weights**2) / clock.step**2
    most_noise = 0.2  # share of the mean square of x'; noise pulls a response towards 0
    if not slope_noise <= most_noise * np.trace(slope_products) / fluctuations.size:
        return None
    covariance = inverse @ (scores.T @ scores) @ inverse * CHUNKS / (CHUNKS - 1)
    return evidence_from(response, covariance)


def stamps_of_values(clock: DeviceClock, rows: NDArray[np.bool_], size: int) -> StampsOfValues:
    """Take the fast part and the local step of the stamps in some rows (n,), and the blocks that
    tell, of so many rows."""
    stamps = clock.stamps[rows]
    count = clock.count[rows]
    late = stamps - clock.slow.stamps[rows]
    blocks_smoothed = 4  # over which the curve about which stamps scatter is smooth
    fast = late - savitzky_golay(late, count, blocks_smoothed * size + 1, 0)

    # local step of the stamps without their fast part, in usual steps
    rate = np.gradient(stamps - fast, count) / clock.step
    slowest_rate, fastest_rate = 0.2, 3.0  # a pause does not make a slope infinite
    steps = np.diff(stamps) / clock.step / np.clip(rate[1:], slowest_rate, fastest_rate)
    first_rows = np.arange(MOST_BEFORE, len(stamps) - MOST_BEHIND - size, size)
    begins = first_rows - MOST_BEFORE
    ends = first_rows + size - 1 + MOST_BEHIND
    is_whole = count[ends] - count[begins] == ends - begins

    pause_steps = 1.6  # a longer step is a pause, unless the next one is shorter than this:
    catching_up = 0.6
    most_pauses = 0.03  # share of the rows; a device that pauses more often pauses by its nature
    is_pause = np.zeros(len(stamps), dtype=bool)
    is_pause[1:-1] = (steps[:-1] > pause_steps) & (steps[1:] > catching_up)
    if np.mean(is_pause) < most_pauses:
        pauses = np.cumsum(is_pause)
        is_whole = is_whole & (pauses[ends] == pauses[begins])

    local_step = np.maximum(rate, slowest_rate) * clock.step
    return StampsOfValues(count, fast, local_step, np.flatnonzero(is_whole), size)


def blocks_of(values: Array, numbers: NDArray[np.intp], size: int, lag: int = 0) -> Array:
    """Blocks (k, size) of values (n,) by their numbers (k,), or of the values `lag` rows before."""
    first = MOST_BEFORE - lag
    count = (len(values) - first) // size
    return values[first : first + count * size].reshape(count, size)[numbers]


def normal_matrix(
    plain: Array, slope_products: Array, without_motion: Array, decimal: float
) -> Array | None:
    """Normal matrix (4, 4) of the lags, without the part of rounded stamps.

    None if the stamps hardly scatter by more than their rounding to `decimal` [s]. As I - Q Q' is
    its own square, a product of two remainders X (I - Q Q') is that of one of them with the other X
    as it is: here `without_motion` stands once, beside plain products of the slopes.

    Parameters
    ----------
    plain : Array
        (4, 4), with that part.
    slope_products : Array
        (size, size), sums over blocks of the products of their slopes.
    without_motion : Array
        (size, size), what takes the motion out of a block.
    """
    rounding = [
        np.diagonal(without_motion, rows) @ np.diagonal(slope_products, rows)
        for rows in range(len(LAGS))
    ]
    normal = plain - decimal**2 / 12 * scipy.linalg.toeplitz(rounding)
    smallest = np.linalg.eigvalsh(normal)[0]
    plain_values = np.linalg.eigvalsh(plain)
    least_eigenvalue = 1e-9  # of the largest: less is no information
    least_not_rounding = 0.02  # share that the rounding of stamps must leave
    least = max(least_eigenvalue * plain_values[-1], least_not_rounding * plain_values[0])
    return None if smallest <= least else normal


def savitzky_golay(
    values: Array, count: SampleCount, window: int, order: int, degree: int = 3
) -> Array:
    """Smooth or differentiate samples by polynomials through their neighbours.

    Parameters
    ----------
    values : Array
        (n,).
    count : SampleCount
        (n,) places of the samples. Missing samples are bridged linearly. A gap is shortened to two
        windows: a clock may jump by years.
    window : int
        Samples of a polynomial, odd.
    order : int
        0 for the value, 1 for the slope per step.
    degree : int
        Of the polynomials.

    Returns
    -------
    Array
        (n,).
    """
    place: SampleCount | slice = slice(None)
    if count[-1] - count[0] != len(values) - 1:
        steps = np.minimum(np.diff(count), 2 * window)
        place = np.append(0, np.cumsum(steps))
        values = np.interp(np.arange(place[-1] + 1), place, values)
    window = min(window, (len(values) - 1) // 2 * 2 + 1)
    smooth = scipy.signal.savgol_filter(values, window, min(degree, window - 1), order)
    return smooth[place]


# ---- The decision: even samples of a device, or true times of some age

# scatter, in steps, below which all hypotheses give the same samples: taken as even
NO_MATTER = 0.001


class Reading(NamedTuple):
    """How stamps are read."""

    even: bool  # whether the device samples evenly; else the stamps are true
    age: float  # [loops] by which values are older than true stamps
    firm: bool  # whether this is stated, or the other kind is excluded
    why: str  # one sentence for the provenance
    g: float | None = None  # of the signal with the smallest standard error, if signals told

    def times(self, clock: DeviceClock) -> Array:
        """When the rows of a clock were sampled, (n,) [s].

        Values older than true stamps were taken between earlier ones. Behind a gap or a very long
        loop these do not tell; there, `age` usual steps are taken off.
        """
        if self.even:
            return clock.times()
        stamps = clock.stamps
        if not self.age:
            return stamps
        rows = np.arange(len(stamps))
        older = stamps - np.interp(rows - self.age, rows, stamps)
        is_behind_gap = np.diff(clock.count, prepend=clock.count[0]) > 1
        of_age = self.age * clock.step
        tells_nothing = is_behind_gap | (older > 3 * of_age) | (rows < self.age)
        return np.maximum.accumulate(stamps - np.where(tells_nothing, of_age, older))


def decide(signals: Mapping[str, Array], clock: DeviceClock) -> Reading:
    """Make one decision for all signals (n,) of a device: by the stamps where they tell, else by
    the signals."""
    if np.std(clock.residual) < NO_MATTER * clock.step:
        return Reading(True, 0.0, True, "even: the stamps lie on their line")
    is_still = clock.scatter < NO_MATTER * clock.step
    rounded = 0.36  # decimals of scatter that rounding explains: 1/sqrt(12) = 0.29, and some noise
    is_rounded = clock.scatter < rounded * clock.decimal
    if clock.settles and (is_still or is_rounded):
        if clock.slow.kinks:
            return Reading(False, 0.0, True, "true: only the rate of the stamps changes")
        if is_rounded:
            return Reading(True, 0.0, True, "even: the stamps scatter by their rounding alone")

    evidence = evidence_by_signal(signals, clock)
    reading = reading_of(clock, evidence)
    if not evidence:
        return reading
    clearest = min(evidence.values(), key=lambda signal: signal.se)
    return reading._replace(g=clearest.g)


def reading_of(clock: DeviceClock, evidence: Mapping[str, StampEvidence]) -> Reading:
    """Choose the hypothesis that fits the evidence of some signals.

    Parameters
    ----------
    clock : DeviceClock
        That the signals share.
    evidence : Mapping
        By signal; may be empty.

    Returns
    -------
    Reading
        It is firm if its chi-square is not too large, and smaller than that of the other kind by
        30. Otherwise the stamps are kept as true if the signals fit no hypothesis, or if the stamps
        wander slowly or scatter by more than a step: so nothing is moved far. They are also kept if
        the device seems even but its stamps do not come back to the line.
    """
    if clock.has_prompt_batches is False and clock.settles and not clock.missing:
        why = (
            "undecided, even: the last sample of each batch is taken for that which waited least;"
            " state `stamps: even`, with a `delay` if it is another"
        )
        return Reading(even=True, age=0.0, firm=False, why=why)
    if not evidence:
        return reading_without_evidence(clock)

    responses = ", ".join(
        f"{name} g = {round(signal.g, 3) + 0.0:.3f} +- {signal.se:.3f}"
        for name, signal in evidence.items()
    )
    misfit = np.sum([signal.misfit for signal in evidence.values()], axis=0)
    misfit_of_even = misfit[0]
    misfit_of_true = misfit[1:].min()
    weight = np.sum([signal.weight for signal in evidence.values()], axis=0)

    known_response = 0.25  # standard error of a response above which no hypothesis is told apart
    is_known = np.diag(np.linalg.inv(weight)).max() < known_response**2
    # chi-square of a hypothesis that fits one signal, and by each further one
    largest_misfit, per_signal = 22, 0.6
    limit = largest_misfit * (1 - per_signal + per_signal * len(evidence))
    if is_known and min(misfit_of_even, misfit_of_true) > limit:
        return undecided_true(f"neither even sampling nor stamps of any age fit, {responses}")
    decisive = 30  # chi-square between even and true samples that makes a decision firm
    if not is_known or abs(misfit_of_even - misfit_of_true) < decisive:
        by_stamps = reading_without_evidence(clock)
        return by_stamps._replace(why=f"{by_stamps.why}, {responses}")
    g_of_other_kind = 1.0 if misfit_of_even < misfit_of_true else 0.0
    errors_apart = 2  # standard errors that g must lie away from the other kind
    if not any(
        abs(signal.g - g_of_other_kind) > errors_apart * signal.se for signal in evidence.values()
    ):
        return undecided_true(f"g is within its error of the other kind, {responses}")

    if misfit_of_even > misfit_of_true:
        worth_an_age = 9  # chi-square by which it must fit better than none: three standard errors
        has_age = misfit[1] >= misfit_of_true + worth_an_age
        age = round(AGES[np.argmin(misfit[1:])], 3) if has_age else 0.0
        older = f", values {age:.1f} loops older than their stamps" if age else ""
        return Reading(even=False, age=age, firm=True, why=f"true{older}: {responses}")
    cannot_count = clock.missing and not clock.counted and clock.scatter > clock.step
    if not clock.settles or cannot_count:
        why = "too late to count the missing samples" if clock.missing else "the stamps wander"
        return undecided_true(f"even by their scatter, but {why}, {responses}")
    return Reading(even=True, age=0.0, firm=True, why=f"even: {responses}")


def reading_without_evidence(clock: DeviceClock) -> Reading:
    """Keep the stamps as true if they wander or scatter by more than a step, else take them as
    even."""
    steps = clock.wander / clock.step
    wandering_step = 0.1  # steps by which a residual may wander with even stamps
    wanders = steps > wandering_step or clock.scatter > clock.step
    kind = "true" if wanders else "even"
    why = f"undecided, {kind}: the residual wanders by {steps:.3f} steps"
    return Reading(even=not wanders, age=0.0, firm=False, why=why)


def undecided_true(why: str) -> Reading:
    return Reading(even=False, age=0.0, firm=False, why=f"undecided, true: {why}")
