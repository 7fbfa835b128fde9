"""What an excitation does not show: the band that is missing, and jumps within a sample."""

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.record import Record
from osl_analysis.judge.impossible import REFUSALS, check_told, told_by
from osl_analysis.measured import usual_size
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Array

SPIKE = 8.0  # robust standard deviations of third differences that noise does not reach
ROUNDING_REACHES = 4.5  # steps of an encoder that its rounding does not reach in a third difference; four is the most
LARGEST_ALIAS = 0.01
"""Change of B, and of I, by jumps of the acceleration at an unknown instant within a sample, that is refused."""
BESIDE_SPIKE = 15
"""Samples to each side of a spike that it is far above: a hand, or a sweep, is as fast there without a jump."""
BESIDE_JUMP = 3  # samples on each side of a jump from which its size is read


def motion_in(record: Record) -> Array:
    """Angle, velocity and acceleration in the fitted rows of a record, (m, 3)."""
    motion = record.motion
    return np.column_stack([record.part(x) for x in (motion.theta, motion.omega, motion.alpha)])


def moments(record: Record) -> Array:
    """`motion_in` about its means."""
    X = motion_in(record)
    return np.asarray(X - X.mean(axis=0))


def check_band(record: Record, fit: LinearFit, largest_inertia_error: float | None) -> None:
    """Refuse a motion whose band cannot tell K from I; the message names the band that is missing."""
    theta, omega, alpha = moments(record).T
    change = told_by(theta, omega, alpha, float(np.std(record.part(record.filtered_torque))))
    check_told(f"trial {record.name}", record.band_hz, change, (fit["K"], fit.se("K")), largest_inertia_error)


def jumps(record: Record) -> tuple[NDArray[np.intp], Array]:
    """Rows at which the acceleration jumps within a sample, and by how much [rad/s^2]."""
    theta = record.theta
    third = np.abs(np.diff(theta, 3))
    noise = 1.4826 * usual_size(np.concatenate([third[piece] for piece in record.pieces]))
    step = record.steps[0] or 0.0
    high = np.flatnonzero(third > max(SPIKE * noise, ROUNDING_REACHES * step, np.finfo(float).tiny))
    near = np.clip(high[:, None] + np.arange(-BESIDE_SPIKE, BESIDE_SPIKE + 1), 0, len(third) - 1)
    high = high[third[high] > SPIKE * 1.4826 * np.median(third[near], axis=1)]
    if not high.size:
        return high, np.empty(0)
    first = high[np.diff(high, prepend=-10) > BESIDE_JUMP] + 1  # the middle of the four samples of the difference
    first = first[(first > BESIDE_JUMP + 1) & (first < len(theta) - BESIDE_JUMP - 3)]

    def alpha(start: int) -> float:  # its mean over some rows, of which the first one belongs to row start + 1
        return float(np.diff(theta[start : start + BESIDE_JUMP + 2], 2).mean()) * record.rate_hz**2

    return first, np.array([alpha(i + 1) - alpha(i - 1 - BESIDE_JUMP) for i in first])


def check_alias(record: Record, fit: LinearFit) -> float:
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
