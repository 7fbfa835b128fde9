"""By how much the torque lags the angle in a trial of any excitation: a fourth parameter beside K, B and I."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from osl_analysis.bench.frequency_response import Admittance
from osl_analysis.bench.moving_record import MovingRecord, estimates_of, fit_of, left_by
from osl_analysis.bench.phasor_lag import OF_CERTAIN_LAG, lag_row
from osl_analysis.bench.torque_lag import (
    CERTAIN_LAG,
    LAG_STEPS,
    LARGEST_YIELD,
    MUCH_BETTER,
    ONLY_NOISE,
    TorqueLag,
)
from osl_analysis.errors import OslAnalysisError
from osl_analysis.signals import LowPass, differentiate
from osl_analysis.stats.fit_row import Row, lag_damping_row
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Array

CERTAIN_IN_NOISE = 3.0
"""Standard errors from which a lag is certain where the fit leaves only noise."""
BEYOND = 3.0
"""Cut-offs of the filter up to which the linear model is taken into account."""
SETTLED = 0.01
"""Standard errors by which the last step to the lag changes it."""
KEPT, WIDER = 0.25, 1.5
"""Share of a sampling rate [Hz] below which a cubic between samples keeps their noise; least cut-off, in cut-offs."""
MOST = 0.5
"""Share of what the fit leaves without a lag, below which it leaves with one, so that the lag explains most of it."""


@dataclass(frozen=True)
class RecordLag:
    """The lag [s] of the torque, its standard error [s], and the RMS [N*m] of what fits with and without it leave."""

    lag: float
    se: float
    misfit: float
    without: float


def lag_beside(record: MovingRecord, base: Array | None, jerk: Array) -> RecordLag | None:
    """The lag d if the torque is that of `base` (n,) [N*m] and of K, B and I, late by d; None: no base.

    The `jerk` (n,) [rad/s^3] is that of the filtered motion.

    A lag adds -d times the torque's derivative. Its parts K omega and B alpha look like damping and inertia: only the
    rest, the base's derivative and I times the jerk, tells a lag. Each step takes the lag found so far off the torque.
    None if the lag is no longer small against the fastest motion: it then stands for other dynamics.
    """
    largest = 1 / (2 * np.pi * record.band_hz[1])
    lag = first_lag(record, jerk, largest) if base is None else 0.0
    slope = 0.0 if base is None else np.gradient(base, record.time)
    for _ in range(LAG_STEPS):
        rest = without_torque(advanced(record, lag) if lag else record, base)
        fit = fit_of(rest, {"lag": -(estimates_of(rest)["I"] * jerk + slope)})
        step, se, misfit = fit["lag"], fit.se("lag"), float(np.std(fit.residual))
        lag += step
        if abs(lag) > largest:
            return None
        if abs(step) < SETTLED * se:
            break
    return RecordLag(lag, se, misfit, left_by(without_torque(record, base)))


def jerk_of(record: MovingRecord) -> Array:
    """Jerk (n,) [rad/s^3] of the filtered motion."""
    return differentiate(record.time, record.motion.omega).alpha


def first_lag(record: MovingRecord, jerk: Array, largest: float) -> float:
    """The lag [s] of a second-order joint from a fit with the jerk (n,) as a fourth column, below the `largest`.

    By the series of exp(-s d) the four coefficients of a late torque, K, B', I' and J', obey
    K d^3/6 + B' d^2/2 + I' d + J' = 0. Two of its real roots explain the torque to third order. The smaller one counts,
    unless the torque made earlier by another leaves certainly less.
    """
    fit = estimates_of(record, {"J": jerk})
    roots = np.roots([fit["K"] / 6, fit["B"] / 2, fit["I"], fit["J"]])
    tried = sorted((float(r.real) for r in roots if abs(r.imag) < 1e-9 and abs(r.real) < largest), key=abs)
    if len(tried) < 2:
        return tried[0] if tried else 0.0
    left = [left_by(advanced(record, lag)) for lag in tried]
    return next(lag for lag, size in zip(tried, left, strict=True) if size < certainly_more(record) * min(left))


def certainly_more(record: MovingRecord) -> float:
    """Factor by which what one model leaves is certainly more than what another one does, if both leave noise."""
    independent = 2 * record.low_pass.noise_bandwidth_hz * record.seconds
    return float(1 + CERTAIN_IN_NOISE / np.sqrt(independent))


def advanced(record: MovingRecord, lag: float) -> MovingRecord:
    """The record with a torque that is earlier by `lag` [s]."""
    time = record.time
    both = CubicSpline(time, np.array([record.torque, record.filtered_torque]), axis=1)
    torque, filtered = both(np.clip(time + lag, time[0], time[-1]))
    return replace(record, torque=torque, filtered_torque=filtered)


def without_torque(record: MovingRecord, base: Array | None) -> MovingRecord:
    """The record with a torque (n,) [N*m] taken off; None: none."""
    if base is None:
        return record
    return replace(record, torque=record.torque - base, filtered_torque=record.filtered_torque - base)


def linear_torque(record: MovingRecord, expected: Admittance) -> Array:
    """Torque (n,) [N*m] of the linear model of admittance `expected` for the filtered motion, without its K, B, I.

    The record is continued by its mirror image, so that its ends fit together.
    """
    n, theta = len(record.time), record.motion.theta
    mirrored = np.fft.rfft(np.concatenate([theta, theta[::-1]]))
    s = np.asarray(2j * np.pi * np.fft.rfftfreq(2 * n, 1 / record.rate_hz), dtype=np.complex128)
    kept = np.abs(s) < 2 * np.pi * BEYOND * record.low_pass.cutoff_hz
    response = np.zeros(len(s), dtype=np.complex128)
    response[kept] = 1 / expected(s[kept])
    return np.asarray(np.fft.irfft(response * mirrored, 2 * n)[:n])


def record_lag(record: MovingRecord, expected: Admittance | None) -> RecordLag | None:
    """The lag, by a second-order joint or by the linear model with other K, B and I, whichever fits better.

    A joint of second order that leaves only noise decides alone where the other model leaves more. Where neither fits
    much better than the other, the difference of their lags is part of the standard error. None where it cannot be
    estimated: a lag and what a model misses look alike. Beside friction a lag is seen only if it explains most of what
    the linear model leaves; without that model the lag of a device that is not of second order is not seen.
    """
    try:
        bases = [None] if expected is None else [None, linear_torque(record, expected)]
        jerk = jerk_of(record)
        tried = [lag for base in bases if (lag := lag_beside(record, base, jerk)) is not None]
    except OslAnalysisError:
        return None
    found = sorted(tried, key=lambda lag: lag.misfit)
    if not found:
        return None
    only_noise = found[0].misfit < ONLY_NOISE * noise_behind(record, record.low_pass)
    if not only_noise and (expected is None or found[0].misfit > MOST * found[0].without):
        return None
    if len(found) == 1:
        return found[0]
    better, worse = found
    enough = certainly_more(record) if only_noise else MUCH_BETTER
    doubt = better.lag - worse.lag if worse.misfit < enough * better.misfit else 0.0
    return replace(better, se=float(np.hypot(better.se, doubt)))


def record_lag_row(record: MovingRecord, fit: LinearFit, expected: Admittance | None) -> Row:
    """As `torque_lag_row`.

    A frame in series looks like a lag up to the third power of s.
    """
    found = record_lag(record, expected)
    if found is None:
        return {**lag_damping_row(None, None, fit["K"]), **dict.fromkeys(OF_CERTAIN_LAG)}
    beside_noise = found.misfit < ONLY_NOISE * noise_behind(record, record.low_pass)
    certain_from = CERTAIN_IN_NOISE if beside_noise else CERTAIN_LAG
    certain = abs(found.lag) > certain_from * found.se
    frame = yielding_in(estimates_of(record, {"J": jerk_of(record)})) if certain else None
    return lag_row(TorqueLag(found.lag, found.se, found.misfit, frame), certain_from, fit)


def yielding_in(series: Mapping[str, float]) -> float | None:
    """Stiffness [N*m/rad] of a frame in series with a second-order joint of which K, B, I and J are measured.

    1/measured = 1/joint + 1/stiffness, to the third power of s, where the joint has none. None if there is none.
    """
    K, B, I, J = (series[name] for name in "KBIJ")
    b, i, j = B / K, I / K, J / K
    first, second, third = -b, b**2 - i, 2 * b * i - b**3 - j
    left = np.roots([third, -2 * first * second, first**3])
    yielded = [1 - float(share.real) for share in left if abs(share.imag) < 1e-9]
    return K / min(sound) if (sound := [share for share in yielded if 0 < share < LARGEST_YIELD]) else None


def noise_behind(record: MovingRecord, low_pass: LowPass) -> float:
    """RMS [N*m] of the torque's noise behind the filter, from what the filter takes off; the noise is white.

    Where the samples are not the rows, the spline between them has taken off noise near half their rate: then from
    what the filter takes off of the torque up to a quarter of that rate, below which the spline keeps 97 % of it.
    """
    samples = record.uniform.sampled("torque")
    if samples is record.time:
        whole, passed = record.torque, 2 * low_pass.noise_bandwidth_hz / record.rate_hz
        over = passed / max(1 - passed, 1e-3)
    else:
        rate = (len(samples) - 1) / float(samples[-1] - samples[0])
        wide = LowPass(max(KEPT * rate, WIDER * low_pass.cutoff_hz), low_pass.order)
        whole, over = wide(record.torque, record.rate_hz), passed_over_taken(low_pass, wide, record.rate_hz)
    off = np.concatenate([whole[piece] - record.filtered_torque[piece] for piece in record.pieces])
    return float(np.std(off) * np.sqrt(over))


def passed_over_taken(low_pass: LowPass, wide: LowPass, rate_hz: float) -> float:
    """Power of white noise behind a filter over that of what it takes off behind a `wide` one, at a rate [Hz]."""
    impulse = np.zeros(2 * low_pass.remembers(rate_hz) + 1)
    impulse[len(impulse) // 2] = 1.0
    passed = low_pass(impulse, rate_hz)
    taken = wide(impulse, rate_hz) - passed
    return float(passed @ passed / (taken @ taken))
