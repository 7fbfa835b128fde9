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

from osl_analysis.base.trial import Array
from osl_analysis.signals.device_clock import DeviceClock
from osl_analysis.signals.sample_count import in_blocks

# lags k, in rows, of the stamps that the sampling time of a value may follow
LAGS = np.arange(-1, 3)
MOST_BEFORE = LAGS[-1]  # rows before a block that a lag reaches
MOST_BEHIND = -LAGS[0]  # rows behind it
AGES = np.linspace(0, 2, 21)  # loops
# Expected responses g_k (22, 4) at `LAGS`: of an even device, then of values of each of the `AGES`.
HYPOTHESES = np.vstack(
    [np.zeros(len(LAGS)), np.maximum(1 - np.abs(AGES[:, None] - LAGS), 0)],
)
ROWS = 24  # of a block, in which the signals tell how the stamps scatter
CHUNKS = 20  # whose scatter gives the covariance; three blocks in each are the fewest
MOTION_DEGREE = 5  # of the polynomial that takes the smooth motion out of a block
BLOCKS_SMOOTHED = 4  # over which the curve about which stamps scatter is smooth
SLOPE_S = 0.04  # s over which the slope of a signal is that of a polynomial
SLOPE_DEGREE = 3
LEAST_NOT_ROUNDING = 0.02  # share of the stamps' scatter that their rounding must leave
MOST_SPEED_NOISE = 0.2  # share of the mean square of x'; noise pulls a response towards 0
KNOWN = 0.25  # standard error of a response above which a signal tells no hypothesis apart
NOT_LINEAR = 0.05  # standard error beside the noise: the model is linear in the stamps
# What decides
# chi-square between even and true samples that makes a decision firm, and by each signal beyond
# which a hypothesis does not fit: 22 once in 5000 times
DECISIVE = 30
WORTH_AN_AGE = 9  # chi-square by which an age must fit better than none: three standard errors
ROUNDED = 0.36  # decimals of scatter that rounding explains: 1/sqrt(12) = 0.29, and some noise
# s by which the clock of an even device creeps at most, as 1000 ppm do in 400 s; a rate that
# changes for good leaves its line by more
NO_CLOCK_S = 0.1
WANDERING = 0.1  # steps by which a residual may creep with even stamps, where nothing decides


class StampEvidence(NamedTuple):
    """Evidence of one signal: how its sampling times respond to the fast part of the stamps."""

    # share of the stamps' scatter that the sampling times have: 1 for true stamps of any age, 0 for
    # even ones
    g: float
    se: float  # standard error of g
    misfit: Array  # (22,), chi-square of the `HYPOTHESES`


def evidence_from(response: Array, covariance: Array) -> StampEvidence:
    """Evidence by the responses g_k (4,) at `LAGS`, and their covariance (4, 4)."""
    weight = np.asarray(np.linalg.inv(covariance + NOT_LINEAR**2 * np.eye(len(LAGS))))
    deviation = response - HYPOTHESES
    misfit = np.einsum("hi,ij,hj->h", deviation, weight, deviation)
    return StampEvidence(response.sum(), np.sqrt(covariance.sum()), misfit)


@dataclass(frozen=True)
class StampsOfValues:
    """What the stamps do in the rows in which signals have values, and blocks of these rows."""

    fast: Array  # (m,) [s] fast part of the stamps
    numbers: NDArray[np.intp]  # (k,) of blocks of `ROWS` without missing samples


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
    by_signal = {}
    for name, values in signals.items():
        evidence = evidence_of(values, clock)
        if evidence is not None:
            by_signal[name] = evidence
    return by_signal


def evidence_of(signal: Array, clock: DeviceClock) -> StampEvidence | None:
    """Estimate the response of one signal's sampling times to the scatter of its stamps.

    Notes
    -----
    Least squares in blocks of 24 rows. Orthonormal polynomials Q of degree 5 take the smooth motion
    out of each: of blocks X remains X (I - Q Q'). The variance q^2/12 of stamps rounded to q is
    taken off the normal matrix.
    """
    has_value = ~np.isnan(signal)
    values = signal[has_value]
    stamps = stamps_of_values(clock, has_value)
    numbers = stamps.numbers
    if len(numbers) < 3 * CHUNKS:
        return None
    slope_window = max(2 * round(SLOPE_S / 2 / clock.step) + 1, SLOPE_DEGREE + 2)
    slope = smoothed(values, slope_window, 1) / clock.step
    polynomials = np.linalg.qr(np.vander(np.linspace(-1, 1, ROWS), MOTION_DEGREE + 1))[0]
    fluctuations = blocks_of(values, numbers)
    fluctuations = fluctuations - (fluctuations @ polynomials) @ polynomials.T

    # by chunk: the normal matrix of what the stamps move, and its products with what the signal
    # does
    normals = np.zeros((CHUNKS, len(LAGS), len(LAGS)))
    products = np.zeros((CHUNKS, len(LAGS)))
    slope_square = 0.0
    for chunk, rows in enumerate(np.array_split(np.arange(len(numbers)), CHUNKS)):
        slopes = blocks_of(slope, numbers[rows])
        slope_square += float(np.vdot(slopes, slopes))
        moved = np.array(
            [slopes * blocks_of(stamps.fast, numbers[rows], lag) for lag in LAGS.tolist()]
        )
        moved -= (moved @ polynomials) @ polynomials.T
        columns = moved.reshape(len(LAGS), -1)
        normals[chunk] = columns @ columns.T
        products[chunk] = columns @ fluctuations[rows].ravel()

    left_by_motion = 1 - (MOTION_DEGREE + 1) / ROWS
    # rounded stamps scatter by their decimal over the root of 12, whatever the samples do
    by_rounding = clock.decimal**2 / 12 * slope_square * left_by_motion
    plain = normals.sum(axis=0)
    normal = plain - by_rounding * np.eye(len(LAGS))
    if np.linalg.eigvalsh(normal)[0] <= LEAST_NOT_ROUNDING * np.linalg.eigvalsh(plain)[0]:
        return None
    inverse = np.linalg.inv(normal)
    response = inverse @ products.sum(axis=0)
    # what is left of the signal: its square, and its products by chunk
    squares = np.vdot(fluctuations, fluctuations)
    squares += (normals @ response - 2 * products).sum(axis=0) @ response
    scores = products - normals @ response

    slope_weights = scipy.signal.savgol_coeffs(slope_window, SLOPE_DEGREE, 1)
    residual_variance = squares / fluctuations.size / left_by_motion
    slope_noise = residual_variance * np.sum(slope_weights**2) / clock.step**2
    if not slope_noise <= MOST_SPEED_NOISE * slope_square / fluctuations.size:
        return None
    covariance = inverse @ (scores.T @ scores) @ inverse * CHUNKS / (CHUNKS - 1)
    if covariance.diagonal().max() > KNOWN**2:
        return None
    return evidence_from(response, covariance)


def stamps_of_values(clock: DeviceClock, rows: NDArray[np.bool_]) -> StampsOfValues:
    """Take the fast part and the local step of the stamps in some rows (n,), and the blocks that
    tell."""
    stamps = clock.stamps[rows]
    count = clock.count[rows]
    late = clock.residual[rows]
    fast = late - smoothed(late, BLOCKS_SMOOTHED * ROWS + 1)
    first_rows = np.arange(MOST_BEFORE, len(stamps) - MOST_BEHIND - ROWS, ROWS)
    begins = first_rows - MOST_BEFORE
    ends = first_rows + ROWS - 1 + MOST_BEHIND
    is_whole = count[ends] - count[begins] == ends - begins
    return StampsOfValues(fast, np.flatnonzero(is_whole))


def blocks_of(values: Array, numbers: NDArray[np.intp], lag: int = 0) -> Array:
    """Blocks (k, ROWS) of values (n,) by their numbers (k,), or of the values `lag` rows before."""
    first = MOST_BEFORE - lag
    return in_blocks(values[first:], ROWS)[numbers]


def smoothed(values: Array, window: int, derivative: int = 0) -> Array:
    """Values (n,), or their slope per row, of cubics through as many neighbours as an odd window
    has."""
    window = min(window, (len(values) - 1) // 2 * 2 + 1)
    return np.asarray(scipy.signal.savgol_filter(values, window, SLOPE_DEGREE, derivative))


# ---- The decision: even samples of a device, or true times of some age

# scatter, in steps, below which all hypotheses give the same samples: taken as even
NO_MATTER = 0.001


class Reading(NamedTuple):
    """How stamps are read."""

    even: bool  # whether the device samples evenly; else the stamps are true
    age: float  # [loops] by which values are older than true stamps
    firm: bool  # whether this is stated, or the other kind is excluded
    why: str  # one sentence for the provenance

    def times(self, clock: DeviceClock) -> Array:
        """When the rows of a clock were sampled, (n,) [s]: values older than true stamps were taken
        between earlier ones."""
        if self.even:
            return clock.times()
        if not self.age:
            return clock.stamps
        older = np.interp(clock.count - self.age, clock.count, clock.stamps)
        return np.where(clock.count < self.age, clock.stamps - self.age * clock.step, older)


def decide(signals: Mapping[str, Array], clock: DeviceClock) -> Reading:
    """Make one decision for all signals (n,) of a device: by the stamps where they tell, else by
    the signals."""
    if np.std(clock.residual) < NO_MATTER * clock.step:
        return Reading(True, 0.0, True, "even: the stamps lie on their line")
    creep = np.abs(clock.creep).max()
    if creep > NO_CLOCK_S:
        why = f"true: the stamps leave an even line by {creep:.2g} s, more than a clock does"
        return Reading(False, 0.0, True, why)
    if clock.settles and clock.scatter < ROUNDED * clock.decimal:
        return Reading(True, 0.0, True, "even: the stamps scatter by their rounding alone")

    return reading_of(clock, evidence_by_signal(signals, clock))


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
    if min(misfit_of_even, misfit_of_true) > DECISIVE * len(evidence):
        return undecided_true(f"neither even sampling nor stamps of any age fit, {responses}")
    if abs(misfit_of_even - misfit_of_true) < DECISIVE:
        by_stamps = reading_without_evidence(clock)
        return by_stamps._replace(why=f"{by_stamps.why}, {responses}")
    if misfit_of_even > misfit_of_true:
        has_age = misfit[1] >= misfit_of_true + WORTH_AN_AGE
        age = round(AGES[np.argmin(misfit[1:])], 3) if has_age else 0.0
        older = f", values {age:.1f} loops older than their stamps" if age else ""
        return Reading(even=False, age=age, firm=True, why=f"true{older}: {responses}")
    if not clock.settles:
        return undecided_true(f"even by their scatter, but the stamps wander, {responses}")
    return Reading(even=True, age=0.0, firm=True, why=f"even: {responses}")


def reading_without_evidence(clock: DeviceClock) -> Reading:
    """Keep the stamps as true if they wander or scatter by more than a step, else take them as
    even."""
    steps = np.std(clock.creep) / clock.step
    wanders = steps > WANDERING or clock.scatter > clock.step
    kind = "true" if wanders else "even"
    why = f"undecided, {kind}: the residual wanders by {steps:.3f} steps"
    return Reading(even=not wanders, age=0.0, firm=False, why=why)


def undecided_true(why: str) -> Reading:
    """Stamps that are kept as true."""
    return Reading(even=False, age=0.0, firm=False, why=f"undecided, true: {why}")
