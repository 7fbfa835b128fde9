# SPDX-License-Identifier: Apache-2.0
"""Decide whether a device sampled evenly or at its time stamps.

With f the fast part of the stamps, their deviation from a curve that is smooth over four blocks, a
signal that was sampled at even times is independent of f. If the sampling time follows a share g_k
of the fast part of the stamp k rows earlier, the signal x moves by

    sum over k of g_k x'(t) f_k

All g_k are 0 of even samples, and g_0 alone is 1 of true stamps. Least squares in blocks of 24 rows
estimate g; a chi-square that is smaller by 30 decides. Values that are older than their stamps, as
of a bus that answers a loop later, fit neither.

One-sided scatter does not decide: a loop with absolute deadlines is late, never early, and its
stamps are true.

Example: with stamps 5 ms late at random at 100 Hz K is off by up to 2 % by the wrong choice, and by
0.02 % by the right one.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.trial import Array
from osl_analysis.signals.device_clock import DeviceClock

# lags k, in rows, of the stamps that the sampling time of a value may follow
LAGS = np.arange(-1, 3)
MOST_BEFORE = LAGS[-1]  # rows before a block that a lag reaches
MOST_BEHIND = -LAGS[0]  # rows behind it
# expected responses g_k (2, 4) at `LAGS`: of an even device, then of true stamps
HYPOTHESES = np.vstack([np.zeros(len(LAGS)), LAGS == 0])
ROWS = 24  # of a block, in which the signals tell how the stamps scatter
CHUNKS = 20  # whose scatter gives the covariance; three blocks in each are the fewest
MOTION_DEGREE = 5  # of the polynomials that a smooth motion follows in a block or a slope's window
LEFT_BY_MOTION = 1 - (MOTION_DEGREE + 1) / ROWS  # share of white noise that these polynomials leave
BLOCKS_SMOOTHED = 4  # over which the curve about which stamps scatter is smooth
SLOPE_S = 0.04  # s over which the slope of a signal is that of a polynomial
LEAST_NOT_ROUNDING = 0.02  # share of the stamps' scatter that their rounding must leave
MOST_SPEED_NOISE = 0.2  # share of the mean square of x'; noise pulls a response towards 0
KNOWN = 0.25  # standard error of a response above which a signal tells no hypothesis apart
NOT_LINEAR = 0.05  # standard error beside the noise: the model is linear in the stamps
# What decides
# chi-square between even and true samples that makes a decision firm, and by each signal beyond
# which a hypothesis does not fit: 22 once in 5000 times
DECISIVE = 30
ROUNDED = 0.36  # decimals of scatter that rounding explains: 1/sqrt(12) = 0.29, and some noise
# s by which the clock of an even device creeps at most, as 1000 ppm do in 400 s; a rate that
# changes for good leaves its line by more
NO_CLOCK_S = 0.1


class StampEvidence(NamedTuple):
    """Evidence of one signal: how its sampling times respond to the fast part of the stamps."""

    # share of the stamps' scatter that the sampling times have: 1 for true stamps, 0 for even ones
    g: float
    se: float  # standard error of g
    lack_of_fit: Array  # (2,), chi-square of the `HYPOTHESES`


def estimate_response(signal: Array, clock: DeviceClock, fast_part: Array) -> StampEvidence | None:
    """Estimate the response of one signal's sampling times to the scatter of its stamps.

    Parameters
    ----------
    signal : Array
        (n,), NaN where the row has no value.
    clock : DeviceClock
        Of the stamps (n,).
    fast_part : Array
        Fast part of the stamps (n,) [s].

    Returns
    -------
    StampEvidence or None
        None if the signal is no evidence: too few blocks, stamps that hardly scatter, or noise in
        more than a fifth of the mean square of x'.

    Notes
    -----
    Least squares in blocks of 24 rows. Orthonormal polynomials Q of degree 5 take the smooth motion
    out of each block: X becomes X (I - Q Q'). The variance q^2/12 of stamps rounded to q is
    subtracted from the normal matrix.
    """
    has_value = ~np.isnan(signal)
    values = signal[has_value]
    count = clock.count[has_value]
    fast = fast_part[has_value]
    slope_window = max(2 * round(SLOPE_S / 2 / clock.step) + 1, MOTION_DEGREE + 2)
    slope = smoothed(values, slope_window, 1) / clock.step
    begins = whole_blocks(count)
    if len(begins) < 3 * CHUNKS:
        return None

    moments = block_moments(values, slope, fast, begins)
    plain_normal = moments.normals.sum(axis=0)
    # rounded stamps scatter by their decimal over the root of 12, whatever the samples do
    by_rounding = clock.decimal**2 / 12 * moments.slope_square * LEFT_BY_MOTION
    normal = plain_normal - by_rounding * np.eye(len(LAGS))
    least_plain = np.linalg.eigvalsh(plain_normal)[0]
    if np.linalg.eigvalsh(normal)[0] <= LEAST_NOT_ROUNDING * least_plain:
        return None
    inverse = np.linalg.inv(normal)
    response = inverse @ moments.products.sum(axis=0)

    change_by_fit = (moments.normals @ response - 2 * moments.products).sum(axis=0) @ response
    residual_variance = (moments.square + change_by_fit) / moments.samples / LEFT_BY_MOTION
    slope_weights = scipy.signal.savgol_coeffs(slope_window, MOTION_DEGREE, 1)
    slope_noise = residual_variance * np.sum(slope_weights**2) / clock.step**2
    # `not <=`: a NaN is no evidence
    if not slope_noise <= MOST_SPEED_NOISE * moments.slope_square / moments.samples:
        return None

    # covariance from the scatter of chunks, whose noise need not be white (sandwich estimator)
    scores = moments.products - moments.normals @ response
    covariance = inverse @ (scores.T @ scores) @ inverse * CHUNKS / (CHUNKS - 1)
    if covariance.diagonal().max() > KNOWN**2:
        return None
    weight = np.linalg.inv(covariance + NOT_LINEAR**2 * np.eye(len(LAGS)))
    deviation = response - HYPOTHESES
    lack_of_fit = np.einsum("hi,ij,hj->h", deviation, weight, deviation)
    return StampEvidence(response.sum(), np.sqrt(covariance.sum()), lack_of_fit)


def whole_blocks(count: NDArray[np.int64]) -> NDArray[np.intp]:
    """First rows (k,) of the blocks that miss no sample, nor do the rows that their lags reach;
    `count` (n,) is the place of each sample in the device's count."""
    begins = np.arange(MOST_BEFORE, len(count) - MOST_BEHIND - ROWS, ROWS)
    last = ROWS - 1 + MOST_BEHIND
    places = count[begins + last] - count[begins - MOST_BEFORE]
    return begins[places == MOST_BEFORE + last]


class BlockMoments(NamedTuple):
    """Sums of products over blocks without their smooth motion, by chunk of blocks."""

    normals: Array  # (CHUNKS, 4, 4), normal matrix of g_k: products of x' f_k
    products: Array  # (CHUNKS, 4), products of x' f_k with the signal
    square: float  # square of the signal
    slope_square: float  # square of its slope x', with the smooth motion
    samples: int  # number of samples in the blocks


def block_moments(
    values: Array, slope: Array, fast: Array, begins: NDArray[np.intp]
) -> BlockMoments:
    """Sum products of a signal, and of what the stamps move in it, over blocks.

    Parameters
    ----------
    values, slope : Array
        The signal x, and its slope x' [1/s], (n,).
    fast : Array
        Fast part of the stamps, (n,) [s].
    begins : Array
        First rows of the blocks, (k,).
    """
    fluctuations = without_motion(blocks_of(values, begins))
    normals = np.zeros((CHUNKS, len(LAGS), len(LAGS)))
    products = np.zeros((CHUNKS, len(LAGS)))
    slope_square = 0.0
    for chunk, rows in enumerate(np.array_split(np.arange(len(begins)), CHUNKS)):
        slopes = blocks_of(slope, begins[rows])
        slope_square += float(np.vdot(slopes, slopes))
        moved = np.array([slopes * blocks_of(fast, begins[rows] - lag) for lag in LAGS])
        columns = without_motion(moved).reshape(len(LAGS), -1)
        normals[chunk] = columns @ columns.T
        products[chunk] = columns @ fluctuations[rows].ravel()
    square = float(np.vdot(fluctuations, fluctuations))
    return BlockMoments(normals, products, square, slope_square, fluctuations.size)


def without_motion(blocks: Array) -> Array:
    """Blocks (..., ROWS) less the polynomial of `MOTION_DEGREE` that fits each."""
    polynomials = np.linalg.qr(np.vander(np.linspace(-1, 1, ROWS), MOTION_DEGREE + 1))[0]
    return blocks - (blocks @ polynomials) @ polynomials.T


def blocks_of(values: Array, begins: NDArray[np.intp]) -> Array:
    """Blocks (k, ROWS) of values (n,) that begin at these rows (k,)."""
    return np.lib.stride_tricks.sliding_window_view(values, ROWS)[begins]


def smoothed(values: Array, window: int, derivative: int = 0) -> Array:
    """Values (n,), or their slope per row, of polynomials through as many neighbours as an
    odd window has."""
    window = min(window, (len(values) - 1) // 2 * 2 + 1)
    return scipy.signal.savgol_filter(values, window, MOTION_DEGREE, derivative)


# scatter, in steps, below which all hypotheses give the same samples: taken as even
NO_MATTER = 0.001


class Reading(NamedTuple):
    """How stamps are read."""

    even: bool  # whether the device samples evenly; else the stamps are true
    firm: bool  # whether this is stated, or the other kind is excluded
    why: str  # one sentence for the provenance

    def times(self, clock: DeviceClock) -> Array:
        """When the rows of a clock were sampled, (n,) [s]: those of an even device on its line,
        or, where the stamps do not come back to it, about it as they creep."""
        if self.even:
            on_line = clock.times()
            return on_line if clock.settles else on_line + clock.creep
        return clock.stamps


def decide(signals: Mapping[str, Array], clock: DeviceClock) -> Reading:
    """Make one decision for all signals (n,) of a device: by the stamps where they tell, else by
    the signals."""
    if np.std(clock.residual) < NO_MATTER * clock.step:
        return Reading(True, True, "even: the stamps lie on their line")
    creep = np.abs(clock.creep).max()
    if creep > NO_CLOCK_S:
        why = f"true: the stamps leave an even line by {creep:.2g} s, more than a clock does"
        return Reading(False, True, why)
    if clock.settles and clock.scatter < ROUNDED * clock.decimal:
        return Reading(True, True, "even: the stamps scatter by their rounding alone")

    fast_part = clock.residual - smoothed(clock.residual, BLOCKS_SMOOTHED * ROWS + 1)
    evidence = {
        name: estimate_response(signal, clock, fast_part) for name, signal in signals.items()
    }
    return reading_of(clock, {name: response for name, response in evidence.items() if response})


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
        do not come back to their line; else the device is taken as even.
    """
    responses = [
        f"{name} g = {round(signal.g, 3) + 0.0:.3f} +- {signal.se:.3f}"
        for name, signal in evidence.items()
    ]
    lack_of_fit = np.zeros(len(HYPOTHESES))
    for signal in evidence.values():
        lack_of_fit += signal.lack_of_fit
    lack_of_fit_of_even, lack_of_fit_of_true = lack_of_fit
    wanders = f"the residual wanders by {np.std(clock.creep) / clock.step:.3f} steps"
    if min(lack_of_fit_of_even, lack_of_fit_of_true) > DECISIVE * len(evidence):
        reading = Reading(False, False, "undecided, true: neither even nor true samples fit")
    elif lack_of_fit_of_even >= lack_of_fit_of_true + DECISIVE:
        return Reading(False, True, f"true: {', '.join(responses)}")
    elif lack_of_fit_of_true >= lack_of_fit_of_even + DECISIVE:
        return Reading(True, True, f"even: {', '.join(responses)}")
    elif not clock.settles:
        reading = Reading(False, False, f"undecided, true: {wanders}")
    else:
        reading = Reading(True, False, f"undecided, even: {wanders}")
    return reading._replace(why=", ".join([reading.why, *responses]))
