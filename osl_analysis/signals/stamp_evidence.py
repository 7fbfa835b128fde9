"""What a signal tells about its stamps: whether its samples were taken when they say.

The signal itself decides among three hypotheses. Even: the device samples evenly, and the stamps
scatter by latency. True: the stamps are right. Aged: the values were taken `age` loops before their
stamps, as if a bus answers a loop later.

The slow part of the stamps (`sample_count.slow_part`) is removed first. If the sampling time moves
with a share g_k of the fast part f_k of the stamp k rows earlier, the signal x moves by the sum of
g_k x' f_k. All g_k are 0 for even stamps, g_0 is 1 for true ones, and two neighbours share 1 for an
age between them. One-sided scatter does not decide: a loop with absolute deadlines is late, never
early, and its stamps are true.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from osl_analysis.signals.device_clock import (
    DeviceClock,
    polynomial_rows,
    savitzky_golay,
    without_smooth,
)
from osl_analysis.signals.stream import SampleCount
from osl_analysis.trial import Array

# lags k, in rows, of the stamps that the sampling time of a value may follow
LAGS = np.arange(-1, 3)
AGES = np.linspace(0, 2, 21)  # loops
# Expected responses g_k (22, 4) at `LAGS`: of an even device, then of values of each of the `AGES`.
HYPOTHESES = np.vstack(
    [np.zeros(len(LAGS)), np.maximum(1 - np.abs(AGES[:, None] - LAGS), 0)],
)
# standard error of a response, beside its noise, because the model is linear in the stamps
NOT_LINEAR = 0.05

SLOPE_HALF_WINDOW_S = 0.02  # the slope x' is that of a polynomial over 40 ms
FEWEST_IN_WINDOW = 7
MOTION_DEGREE = 5  # of the polynomial that takes the smooth motion out of a block
FEWEST_BLOCKS = 60
SLOWEST_RATE = 0.2  # of the usual rate; a pause does not make a slope infinite
FASTEST_RATE = 3.0
PAUSE_STEPS = 1.6  # a longer step is a pause, unless the next one is shorter than `CATCHING_UP`
CATCHING_UP = 0.6
MOST_PAUSES = 0.03  # share of the rows; a device that pauses more often pauses by its nature
FAR_OFF_STAMP = 20  # RMS of the fast part; a stamp that lies further off moves its block too far
STANDING = 0.01  # mean square of a slope, as a share of the usual one, that does not tell
CORNER = 8  # medians of what is left of a block; more is a corner of the motion itself
MOST_NOISE = 0.2  # share of the mean square of x' that may be noise: it pulls a response towards 0
CHUNKS = 20  # whose scatter gives the covariance
LEAST_NOT_ROUNDING = 0.02  # share of the smallest eigenvalue that the rounding of stamps must leave
LEAST_EIGENVALUE = 1e-9  # of the largest: less is no information


@dataclass(frozen=True)
class StampEvidence:
    """Evidence of one signal: how its sampling times respond to the fast part of the stamps."""

    response: Array  # (4,) g_k at `LAGS`
    covariance: Array  # (4, 4)

    @property
    def g(self) -> float:
        """Share of the stamps' scatter that the sampling times have: 1 for true stamps of any age,
        0 for even ones."""
        return float(self.response.sum())

    @property
    def se(self) -> float:
        """Standard error of g."""
        return float(np.sqrt(self.covariance.sum()))

    @cached_property
    def weight(self) -> Array:
        """Inverse (4, 4) of the covariance, with that of the model's error."""
        return np.asarray(np.linalg.inv(self.covariance + NOT_LINEAR**2 * np.eye(len(LAGS))))

    @cached_property
    def misfit(self) -> Array:
        """Chi-square (22,) of the `HYPOTHESES`."""
        deviation = self.response - HYPOTHESES
        return np.asarray(np.einsum("hi,ij,hj->h", deviation, self.weight, deviation))


def evidence_of(values: Array, clock: DeviceClock) -> StampEvidence | None:
    """Estimate the response of one signal's sampling times to the scatter of its stamps.

    Parameters
    ----------
    values : Array
        (n,), NaN where the row has no value.
    clock : DeviceClock
        Of the stamps (n,).

    Returns
    -------
    StampEvidence or None
        None if the signal does not tell: too few blocks, stamps that hardly scatter, or noise in
        more than a fifth of the mean square of x'.

    Notes
    -----
    Least squares in blocks of 80 ms. Polynomials of degree 5 take the smooth motion out of each
    block. The variance q^2/12 of stamps rounded to q is taken off the normal matrix.
    """
    size = clock.block
    if np.count_nonzero(~np.isnan(values)) < FEWEST_BLOCKS * size:
        return None
    signal = signal_at_stamps(values, clock)
    first_rows = telling_blocks(signal, size)
    if len(first_rows) < FEWEST_BLOCKS:
        return None

    smooth = np.linalg.qr(np.vander(np.linspace(-1, 1, size), MOTION_DEGREE + 1))[0]
    without_motion = np.eye(size) - smooth @ smooth.T
    fluctuations = blocks_of(signal.values, first_rows, size) @ without_motion
    largest = np.abs(fluctuations).max(axis=1)
    is_smooth = largest < CORNER * np.median(largest) + 1e-12
    fluctuations = fluctuations[is_smooth]
    first_rows = first_rows[is_smooth]

    slopes = blocks_of(signal.slope, first_rows, size)
    moved = np.empty((len(LAGS), *slopes.shape))
    # one lag at a time: each takes 0.1 GB for an hour
    for number, lag in enumerate(LAGS.tolist()):
        fast = blocks_of(signal.fast, first_rows - lag, size)
        np.matmul(slopes * fast, without_motion, out=moved[number])
    columns = moved.reshape(len(LAGS), -1)

    normal = normal_matrix(columns, slopes, without_motion, clock.decimal)
    if normal is None:
        return None
    inverse = np.linalg.inv(normal)
    response = inverse @ (columns @ fluctuations.ravel())
    residual = fluctuations - np.tensordot(response, moved, 1)

    slope_weights = polynomial_rows(signal.window, signal.degree, 1)[signal.window // 2]
    residual_variance = np.mean(residual**2) * size / (size - (MOTION_DEGREE + 1))
    slope_noise = residual_variance * np.sum(slope_weights**2) / clock.step**2
    if not slope_noise <= MOST_NOISE * np.mean(slopes**2):
        return None

    moved *= residual
    chunks = np.array_split(moved, CHUNKS, axis=1)
    scores = np.array([chunk.sum(axis=(1, 2)) for chunk in chunks])
    covariance = inverse @ (scores.T @ scores) @ inverse * CHUNKS / (CHUNKS - 1)
    return StampEvidence(response, covariance)


@dataclass(frozen=True)
class SignalAtStamps:
    """A signal where it has values, with what its stamps do there."""

    values: Array  # (m,)
    slope: Array  # (m,) of the values, per second
    fast: Array  # (m,) [s] fast part of the stamps
    steps: Array  # (m - 1,) of the stamps, in usual steps at the local rate
    count: SampleCount  # (m,)
    window: int  # samples of the polynomial that gives the slope
    degree: int  # of this polynomial


def signal_at_stamps(values: Array, clock: DeviceClock) -> SignalAtStamps:
    """Take the slope of a signal (n,) where it has a value, and the fast part of its stamps."""
    has_value = ~np.isnan(values)
    is_complete = bool(has_value.all())
    # a slice avoids copies, 0.1 GB for an hour
    rows = slice(None) if is_complete else has_value
    x = values[rows]
    stamps = clock.stamps[rows]
    count = clock.count[rows]
    if is_complete:
        fast = clock.fast
    else:
        fast = without_smooth(stamps - clock.slow.stamps[rows], count, clock.block)

    window = max(2 * round(SLOPE_HALF_WINDOW_S / clock.step) + 1, FEWEST_IN_WINDOW)
    degree = 3 if window > 11 else 5
    # local step of the stamps without their fast part, in usual steps
    local_step = np.gradient(stamps - fast, count) / clock.step
    slope_per_step = savitzky_golay(x, count, window, 1, degree)
    return SignalAtStamps(
        values=x,
        slope=slope_per_step / np.maximum(local_step, SLOWEST_RATE) / clock.step,
        fast=fast,
        steps=np.diff(stamps) / clock.step / np.clip(local_step[1:], SLOWEST_RATE, FASTEST_RATE),
        count=count,
        window=window,
        degree=degree,
    )


def blocks_of(values: Array, first_rows: NDArray[np.intp], size: int) -> Array:
    """Blocks (k, size) of values (n,) from these first rows (k,)."""
    return np.asarray(np.lib.stride_tricks.sliding_window_view(values, size)[first_rows])


def telling_blocks(signal: SignalAtStamps, size: int) -> NDArray[np.intp]:
    """First rows (k,) of blocks without missing samples, pauses or far-off stamps, in which the
    signal moves."""
    most_before = int(LAGS[-1])
    most_behind = int(-LAGS[0])
    first_rows = np.arange(most_before, len(signal.values) - most_behind - size, size)
    begins = first_rows - most_before
    ends = first_rows + size - 1 + most_behind
    is_whole = signal.count[ends] - signal.count[begins] == ends - begins

    is_pause = np.zeros(len(signal.values), dtype=bool)
    # a pause that no short step makes up for
    is_pause[1:-1] = (signal.steps[:-1] > PAUSE_STEPS) & (signal.steps[1:] > CATCHING_UP)
    if np.mean(is_pause) < MOST_PAUSES:
        pauses = np.cumsum(is_pause)
        is_whole = is_whole & (pauses[ends] == pauses[begins])

    largest = np.abs(blocks_of(signal.fast, first_rows, size)).max(axis=1)
    is_near = largest < FAR_OFF_STAMP * np.sqrt(np.mean(signal.fast**2)) + 1e-12
    first_rows = first_rows[is_whole & is_near]

    # a signal that stands does not tell when it was sampled
    slope_power = np.mean(blocks_of(signal.slope, first_rows, size) ** 2, axis=1)
    moves = slope_power > STANDING * np.mean(signal.slope**2)
    return np.asarray(first_rows[moves])


def normal_matrix(
    columns: Array, slopes: Array, without_motion: Array, decimal: float
) -> Array | None:
    """Normal matrix (4, 4) of the lags' columns (4, m), without the part of rounded stamps.

    None if the stamps hardly scatter by more than their rounding to `decimal` [s].
    """
    plain = columns @ columns.T
    normal = plain.copy()
    size = slopes.shape[1]
    if decimal:
        for i, j in combinations_with_replacement(range(len(LAGS)), 2):
            lag = j - i
            products = (slopes[:, : size - lag] * slopes[:, lag:]).sum(axis=0)
            shared = np.diagonal(without_motion, lag) * products
            normal[i, j] = plain[i, j] - decimal**2 / 12 * shared.sum()
            normal[j, i] = normal[i, j]
    smallest = np.linalg.eigvalsh(normal)[0]
    plain_values = np.linalg.eigvalsh(plain)
    least = LEAST_EIGENVALUE * plain_values[-1]
    if decimal:
        least = max(least, LEAST_NOT_ROUNDING * plain_values[0])
    return None if smallest <= least else normal
