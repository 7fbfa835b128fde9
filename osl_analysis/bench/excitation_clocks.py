"""The clocks of angle and torque in a trial of any excitation, where two devices recorded them."""

import numpy as np

from osl_analysis.bench.excitation_lag import noise_behind
from osl_analysis.bench.moving_record import MovingRecord
from osl_analysis.bench.torque_lag import ONLY_NOISE
from osl_analysis.errors import InputError
from osl_analysis.spectral.lines import lines_of
from osl_analysis.spectral.realisations import PeriodicMotion
from osl_analysis.stats.fit_row import Row
from osl_analysis.timebase.drift import ClockDrift, check_drift, chunked_slope


def record_clock_row(record: MovingRecord) -> Row:
    """As `clock_drift_row`; all null where one device recorded both, or the motion does not show a drift.

    Raises
    ------
    InputError
        The drift is beyond what the configuration allows; the message names the trial.
    """
    drift = drift_between(record)
    if drift is None:
        return dict.fromkeys(("clock_drift_ppm", "clock_drift_se_ppm", "certain_clock_drift_ppm"))
    try:
        check_drift(drift, record.largest_drift_ppm)
    except InputError as error:
        raise InputError(f"trial {record.name}: {error}") from error
    return {
        "clock_drift_ppm": drift.ppm,
        "clock_drift_se_ppm": drift.se,
        "certain_clock_drift_ppm": drift.certain_ppm,
    }


def drift_between(record: MovingRecord) -> ClockDrift | None:
    """The drift of the torque's clock against the angle's; None where the record does not show it.

    A motion that repeats itself shows it whatever the joint is. Any other one does so only for a joint of second order:
    what is left of another one changes with the motion, and would pass for tens of ppm in a sweep.
    """
    if record.uniform.one_device("theta", "torque"):
        return None
    found = drift_beside_impedance(record) if record.periodic is None else drift_of_periods(record.periodic)
    return found if found is not None and np.isfinite(found.se) else None


def drift_of_periods(motion: PeriodicMotion) -> ClockDrift | None:
    """The drift from the phases of torque over angle, which turn from period to period by -2 pi f times the lag."""
    x, y, w = [], [], []
    at = np.flatnonzero(lines_of(motion.realisations).excited)
    for one in motion.realisations:
        ratio = one.torque[:, at] / one.theta[:, at]
        mean = ratio.mean(axis=0)
        elapsed = (np.arange(one.periods) - (one.periods - 1) / 2) * one.period
        x.append(-2 * np.pi * elapsed[:, None] * one.frequency_hz[at])
        y.append(np.angle(ratio / mean))
        w.append(np.broadcast_to(np.abs(one.torque[:, at].mean(axis=0)), ratio.shape))
    weight = np.concatenate([part.ravel() for part in w])
    return in_ppm(*chunked_slope(*(weight * np.concatenate([part.ravel() for part in each]) for each in (x, y))))


def drift_beside_impedance(record: MovingRecord) -> ClockDrift | None:
    """The drift from what a torque that gets later and later adds, beside Eq. 15, a lag, and a change of K.

    None where this leaves more than the noise.
    """
    step = max(record.low_pass.independent_samples(record.rate_hz) // 4, 1)
    motion, slope = record.motion, np.gradient(record.filtered_torque, record.time)
    signals = motion.theta, motion.omega, motion.alpha, slope, record.time, record.filtered_torque
    theta, omega, alpha, slope, time, torque = (record.part(signal)[::step] for signal in signals)
    late = time - time.mean()
    X = np.column_stack([theta, omega, alpha, slope, late, late * theta, np.ones_like(late)])
    Q, _ = np.linalg.qr(X / np.linalg.norm(X, axis=0))
    both = np.stack([-late * slope, torque], axis=1)
    rest = both - Q @ (Q.T @ both)
    slope_of_drift, se = chunked_slope(rest[:, 0], rest[:, 1])
    left = float(np.std(rest[:, 1] - slope_of_drift * rest[:, 0]))
    return in_ppm(slope_of_drift, se) if left < ONLY_NOISE * noise_behind(record, record.low_pass) else None


def in_ppm(slope: float, se: float) -> ClockDrift:
    """A drift and its standard error, of 1."""
    return ClockDrift(1e6 * slope, 1e6 * se)
