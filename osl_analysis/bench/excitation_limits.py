"""What an excitation does not show well: noise of the angle in the acceleration, and jumps within a sample."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import sosfreqz

from osl_analysis.bench.moving_record import TERMS, MovingRecord, noise_beyond
from osl_analysis.judge.impossible import REFUSALS, check_told, own_part, told_by
from osl_analysis.measured import usual_size
from osl_analysis.signals import butterworth
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Array

SPIKE = 8.0  # robust standard deviations of third differences that noise does not reach
ROUNDING_REACHES = 4.5  # steps of an encoder that its rounding does not reach in a third difference; four is the most
LARGEST_ALIAS = 0.01
"""Change of B, and of I, by jumps of the acceleration at an unknown instant within a sample, that is refused."""
BESIDE_JUMP = 3  # samples on each side of a jump from which its size is read


def motion_in(record: MovingRecord) -> Array:
    """Angle, velocity and acceleration in the fitted rows of a record, (m, 3)."""
    motion = record.motion
    return np.column_stack([record.part(x) for x in (motion.theta, motion.omega, motion.alpha)])


def moments(record: MovingRecord) -> Array:
    """`motion_in` about its means."""
    X = motion_in(record)
    return np.asarray(X - X.mean(axis=0))


def check_band(record: MovingRecord, fit: LinearFit, largest_inertia_error: float | None) -> None:
    """Refuse a motion whose band cannot tell K from I; the message names the band that is missing."""
    theta, omega, alpha = moments(record).T
    change = told_by(theta, omega, alpha, float(np.std(record.part(record.filtered_torque))))
    check_told(f"trial {record.name}", record.band_hz, change, (fit["K"], fit.se("K")), largest_inertia_error)


def angle_noise_moments(record: MovingRecord) -> tuple[float, float, float]:
    """Variances of the angle's noise behind the filter, and of its first and second derivative. The noise is taken as
    white; its power beyond the filter is what the filter takes off the angle."""
    theta, low_pass, rate = record.motion.theta, record.low_pass, record.rate_hz
    off = record.part(noise_beyond(record.theta, theta, theta, low_pass, rate))
    f, response = sosfreqz(butterworth(low_pass.order, low_pass.cutoff_hz, rate), worN=4096, fs=rate)
    passed = np.abs(response) ** 2  # of the zero-phase filter
    density = float(np.var(off)) / float(np.trapezoid((1 - passed) ** (2 * TERMS + 2), f))
    w = 2 * np.pi * f
    still, moving, turning = (density * float(np.trapezoid(w**k * passed**2, f)) for k in (0, 2, 4))
    return still, moving, turning


def angle_noise_share(record: MovingRecord) -> float:
    """Share of the own part of the acceleration that is noise of the angle."""
    theta, omega, alpha = moments(record).T
    own = own_part(alpha, theta, omega)
    return float(angle_noise_moments(record)[2] / own**2) if own > 0 else np.inf


def angle_noise_bias(record: MovingRecord, fit: LinearFit) -> float:
    """By how much noise of the angle changes I [kg*m^2], to first order in its variance.

    Least squares take the columns for exact. With the covariance S of their noise the estimates are off by
    -(X'X/n)^-1 S times the estimates (Fuller, Measurement Error Models, 1987, ch. 2). The noise of angle and
    acceleration is correlated, so that a stiff joint has too large an I, and a light one too small.
    """
    still, moving, turning = angle_noise_moments(record)
    S = np.array([[still, 0, -moving], [0, moving, 0], [-moving, 0, turning]])
    X = moments(record)
    return float(-np.linalg.solve(X.T @ X / len(X), S @ [fit["K"], fit["B"], fit["I"]])[2])


def jumps(record: MovingRecord) -> tuple[NDArray[np.intp], Array]:
    """Rows at which the acceleration jumps within a sample, and by how much [rad/s^2]."""
    theta = record.theta
    third = np.abs(np.diff(theta, 3))
    noise = 1.4826 * usual_size(np.concatenate([third[piece] for piece in record.pieces]))
    step = record.steps[0] or 0.0
    high = np.flatnonzero(third > max(SPIKE * noise, ROUNDING_REACHES * step, np.finfo(float).tiny))
    if not high.size:
        return high, np.empty(0)
    first = high[np.diff(high, prepend=-10) > BESIDE_JUMP] + 1  # the middle of the four samples of the difference
    first = first[(first > BESIDE_JUMP + 1) & (first < len(theta) - BESIDE_JUMP - 3)]

    def alpha(start: int) -> float:  # its mean over some rows, of which the first one belongs to row start + 1
        return float(np.diff(theta[start : start + BESIDE_JUMP + 2], 2).mean()) * record.rate_hz**2

    return first, np.array([alpha(i + 1) - alpha(i - 1 - BESIDE_JUMP) for i in first])


def check_alias(record: MovingRecord, fit: LinearFit) -> float:
    """Largest change of B and I, as shares, by jumps of the acceleration that lie somewhere within a sample.

    The torque jumps with the acceleration. Without an anti-aliasing filter a sample shows the torque before or after
    the jump, so that its area is known to half a sample: a pseudo-random binary sequence that is clocked with the
    sampling is read late by half a sample in all of its jumps.

    Raises InputError: it is beyond `LARGEST_ALIAS`, and beyond the interval of noise.
    """
    rows, sizes = jumps(record)
    if not rows.size:
        return 0.0
    torque = record.torque
    steps = np.array([torque[i + 1 : i + 3].mean() - torque[i - 2 : i].mean() for i in rows])
    inertia = abs(float(steps @ sizes) / float(sizes @ sizes)) if sizes.any() else 0.0
    error = np.zeros(len(torque))
    np.add.at(error, rows, 0.5 * inertia * sizes)
    late = record.part(record.low_pass(error, record.rate_hz))
    _, *change = np.abs(np.linalg.lstsq(motion_in(record), late, rcond=None)[0])
    beyond = {x: abs(by / fit[x]) if by > fit.se(x) else 0.0 for x, by in zip("BI", change, strict=True)}
    worst = max(beyond, key=lambda name: beyond[name])
    if beyond[worst] > LARGEST_ALIAS:
        size, percent = float(np.median(np.abs(sizes))), 100 * beyond[worst]
        raise REFUSALS["alias"].of(trial=record.name, count=len(rows), size=size, symbol=worst, percent=percent)
    return beyond[worst]
