"""What an excitation cannot show: refused with the cause and the remedy, or measured for the table."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import sosfreqz

from osl_analysis.bench.moving_record import TERMS, MovingRecord, noise_beyond
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.measured import usual_size
from osl_analysis.signals import butterworth
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Array

TORQUE_ERROR = 1e-3  # error of the torque, as a share of its RMS, that calibrations and models leave
LARGEST_STIFFNESS_ERROR = 0.1  # change of K by such an error, as a share of K, from which a motion cannot tell K from I
MUCH_AMPLIFIED = 3.0
"""The same, as a multiple of what the error is of torque over angle: without stiffness there is no share of K. It
is 1.6 from 0.5 to 6 Hz."""
SPIKE = 8.0  # robust standard deviations of third differences that noise does not reach
ROUNDING_REACHES = 4.5  # steps of an encoder that its rounding does not reach in a third difference; four is the most
LARGEST_ALIAS = 0.01
"""Change of B, and of I, by jumps of the acceleration at an unknown instant within a sample, that is refused."""
BESIDE_JUMP = 3  # samples on each side of a jump from which its size is read


@dataclass(frozen=True)
class Tellable:
    """What a small error of the torque in its most harmful shape does to the estimates."""

    stiffness: float  # change of K [N*m/rad]
    inertia: float  # change of I [kg*m^2]
    amplified: float  # change of K over that of torque over angle: 1 where angle and acceleration are not alike


def moments(record: MovingRecord) -> Array:
    """`motion_in` about its means."""
    X = motion_in(record)
    return np.asarray(X - X.mean(axis=0))


def motion_in(record: MovingRecord) -> Array:
    """Angle, velocity and acceleration in the fitted rows of a record, (m, 3)."""
    motion = record.motion
    return np.column_stack([record.part(x) for x in (motion.theta, motion.omega, motion.alpha)])


def told_by(theta: Array, omega: Array, alpha: Array, torque_rms: float) -> Tellable:
    """The change of K and I by an error of `TORQUE_ERROR` that has the shape of their own parts of the motion.

    Angle [rad], velocity and acceleration are filtered and without their means, shape (n,) each; `torque_rms` [N*m] is
    that of the filtered torque. The own part of the acceleration is what angle and velocity do not explain. A slow
    motion has little of it.
    """
    error = TORQUE_ERROR * torque_rms
    sizes = [own_part(theta, omega, alpha), own_part(alpha, omega, theta)]
    stiffness, inertia = (error / max(size, np.finfo(float).tiny) for size in sizes)
    return Tellable(stiffness, inertia, rms(theta) / max(sizes[0], np.finfo(float).tiny))


def own_part(column: Array, *others: Array) -> float:
    """RMS of a column (n,) without what is proportional to others (n,)."""
    X = np.column_stack(others)
    return rms(column - X @ np.linalg.lstsq(X, column, rcond=None)[0])


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def check_band(record: MovingRecord, fit: LinearFit, largest_inertia_error: float | None) -> None:
    """Refuse a motion whose band cannot tell K from I; the message names the band that is missing."""
    theta, omega, alpha = moments(record).T
    change = told_by(theta, omega, alpha, float(np.std(record.part(record.filtered_torque))))
    check_told(f"trial {record.name}", record.band_hz, change, (fit["K"], fit.se("K")), largest_inertia_error)


def check_told(
    what: str,
    band_hz: tuple[float, float],
    change: Tellable,
    stiffness: tuple[float, float],
    largest_inertia_error: float | None,
) -> None:
    """The same of a band [Hz], with K and its standard error; `what` begins the message."""
    (low, high), (K, K_se) = band_hz, stiffness
    if largest_inertia_error is not None and change.inertia > largest_inertia_error:
        needed = max(high * np.sqrt(change.inertia / (0.5 * largest_inertia_error)), 1.5 * high)
        raise IdentifiabilityError(
            f"{what}: a motion of {low:.2g} to {high:.2g} Hz cannot tell K from I: an error of 0.1 % of "
            f"the torque changes I by {change.inertia:.2g} kg*m^2, more than the {largest_inertia_error:g} of "
            f"`largest_inertia_error` in the configuration; the band from {high:.2g} to about {needed:.2g} Hz is "
            "missing, excite it as well, or take the stiffness alone by experiment 'torque_angle'"
        )
    largest = max(LARGEST_STIFFNESS_ERROR * abs(K), K_se)
    if change.stiffness > largest and change.amplified > MUCH_AMPLIFIED:
        raise IdentifiabilityError(
            f"{what}: a motion of {low:.2g} to {high:.2g} Hz cannot tell K from I: an error of 0.1 % of "
            f"the torque changes K by {change.stiffness:.2g} N*m/rad; the band below {low:.2g} Hz is missing, excite "
            "it as well"
        )


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
        raise InputError(
            f"trial {record.name}: the acceleration jumps within a sample, {len(rows)} times by about "
            f"{np.median(np.abs(sizes)):.2g} rad/s^2, as under a binary sequence: without an anti-aliasing filter the "
            f"torque's samples change {worst} by up to {100 * beyond[worst]:.1f} %; smooth the command, or record "
            "angle and torque through the same low-pass and state it in the source file"
        )
    return beyond[worst]
