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

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.signals.device_clock import DeviceClock, savitzky_golay
from osl_analysis.signals.stream import SampleCount
from osl_analysis.trial import Array

# lags k, in rows, of the stamps that the sampling time of a value may follow
LAGS = np.arange(-1, 3)
MOST_BEFORE = int(LAGS[-1])  # rows before a block that a lag reaches
MOST_BEHIND = int(-LAGS[0])  # rows behind it
AGES = np.linspace(0, 2, 21)  # loops
# Expected responses g_k (22, 4) at `LAGS`: of an even device, then of values of each of the `AGES`.
HYPOTHESES = np.vstack(
    [np.zeros(len(LAGS)), np.maximum(1 - np.abs(AGES[:, None] - LAGS), 0)],
)
# standard error of a response, beside its noise, because the model is linear in the stamps
NOT_LINEAR = 0.05

SLOPE_HALF_WINDOW_S = 0.02  # the slope x' is that of a polynomial over 40 ms
FEWEST_IN_WINDOW = 7
# rows; below some 275 Hz they are far apart, and the motion bends more from one to the next
LONGEST_SHORT_WINDOW = 11
DEGREE_OF_SHORT_WINDOW = 5
DEGREE_OF_LONG_WINDOW = 3  # which averages more of the noise
ABOVE_ZERO = 1e-12  # [s, rad, N*m] added to a limit of which 0 must be below, also where it is 0
MOTION_DEGREE = 5  # of the polynomial that takes the smooth motion out of a block
FEWEST_BLOCKS = 60
BLOCKS_SMOOTHED = 4  # over which the curve about which stamps scatter is smooth
SLOWEST_RATE = 0.2  # of the usual rate; a pause does not make a slope infinite
FASTEST_RATE = 3.0
PAUSE_STEPS = 1.6  # a longer step is a pause, unless the next one is shorter than `CATCHING_UP`
CATCHING_UP = 0.6
MOST_PAUSES = 0.03  # share of the rows; a device that pauses more often pauses by its nature
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
    by_signal = dict[str, StampEvidence]()
    stamps_by_rows = dict[bytes, StampsOfValues]()
    for name, values in signals.items():
        has_value = ~np.isnan(values)
        if np.count_nonzero(has_value) < FEWEST_BLOCKS * clock.block:
            continue
        rows = has_value.tobytes()
        if rows not in stamps_by_rows:
            stamps_by_rows[rows] = stamps_of_values(clock, has_value)
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
    window = max(2 * round(SLOPE_HALF_WINDOW_S / clock.step) + 1, FEWEST_IN_WINDOW)
    degree = DEGREE_OF_LONG_WINDOW if window > LONGEST_SHORT_WINDOW else DEGREE_OF_SHORT_WINDOW
    slope = savitzky_golay(values, stamps.count, window, 1, degree) / stamps.local_step
    # a signal that stands does not tell when it was sampled
    power = np.mean(blocks_of(slope, stamps.numbers, size) ** 2, axis=1)
    numbers = stamps.numbers[power > STANDING * np.mean(slope**2)]
    if len(numbers) < FEWEST_BLOCKS:
        return None

    polynomials = np.linalg.qr(np.vander(np.linspace(-1, 1, size), MOTION_DEGREE + 1))[0]
    without_motion = np.eye(size) - polynomials @ polynomials.T
    fluctuations = blocks_of(values, numbers, size) @ without_motion
    largest = np.abs(fluctuations).max(axis=1)
    is_smooth = largest < CORNER * np.median(largest) + ABOVE_ZERO
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
    if not slope_noise <= MOST_NOISE * np.trace(slope_products) / fluctuations.size:
        return None
    covariance = inverse @ (scores.T @ scores) @ inverse * CHUNKS / (CHUNKS - 1)
    return StampEvidence(response, covariance)


def stamps_of_values(clock: DeviceClock, rows: NDArray[np.bool_]) -> StampsOfValues:
    """Take the fast part and the local step of the stamps in some rows (n,), and the blocks that
    tell."""
    stamps = clock.stamps[rows]
    count = clock.count[rows]
    size = clock.block
    late = stamps - clock.slow.stamps[rows]
    fast = late - savitzky_golay(late, count, BLOCKS_SMOOTHED * size + 1, 0)

    # local step of the stamps without their fast part, in usual steps
    rate = np.gradient(stamps - fast, count) / clock.step
    steps = np.diff(stamps) / clock.step / np.clip(rate[1:], SLOWEST_RATE, FASTEST_RATE)
    first_rows = np.arange(MOST_BEFORE, len(stamps) - MOST_BEHIND - size, size)
    begins = first_rows - MOST_BEFORE
    ends = first_rows + size - 1 + MOST_BEHIND
    is_whole = count[ends] - count[begins] == ends - begins

    is_pause = np.zeros(len(stamps), dtype=bool)
    # a pause that no short step makes up for
    is_pause[1:-1] = (steps[:-1] > PAUSE_STEPS) & (steps[1:] > CATCHING_UP)
    if np.mean(is_pause) < MOST_PAUSES:
        pauses = np.cumsum(is_pause)
        is_whole = is_whole & (pauses[ends] == pauses[begins])

    local_step = np.maximum(rate, SLOWEST_RATE) * clock.step
    return StampsOfValues(count, fast, local_step, np.flatnonzero(is_whole), size)


def blocks_of(values: Array, numbers: NDArray[np.intp], size: int, lag: int = 0) -> Array:
    """Blocks (k, size) of values (n,) by their numbers (k,), or of the values `lag` rows before."""
    first = MOST_BEFORE - lag
    count = (len(values) - first) // size
    return np.asarray(values[first : first + count * size].reshape(count, size)[numbers])


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
    normal = plain.copy()
    for i, j in product(range(len(LAGS)), repeat=2):
        shared = np.diagonal(without_motion, j - i) * np.diagonal(slope_products, j - i)
        normal[i, j] -= decimal**2 / 12 * shared.sum()
    smallest = np.linalg.eigvalsh(normal)[0]
    plain_values = np.linalg.eigvalsh(plain)
    least = LEAST_EIGENVALUE * plain_values[-1]
    if decimal:
        least = max(least, LEAST_NOT_ROUNDING * plain_values[0])
    return None if smallest <= least else normal
