"""Whether a motion that is no stepped sine tells K, B and I, and how well at most."""

import numpy as np
import scipy

from osl_analysis.bench.record import Record
from osl_analysis.bench.regression import GroupFit, Sums
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.trial import Array

STIFFNESS_ALONE = "or take experiment 'torque_angle' in the sheet, for the stiffness alone"
USUAL_ERROR = 1e-3  # of the torque's RMS, as calibrations and models leave
LARGE_CHANGE_OF_K = 0.1  # share of K by which the usual error may change it
FEWEST_STEPS = 20.0  # of the encoder; of fewer, rounding is no noise but part of the motion
MOST_NOISE = 0.1  # of the power of the acceleration's own part that may be noise of the encoder


def usual_errors(record: Record, sums: Sums, fit: GroupFit) -> Array:
    """Errors (p,) of estimates that their intervals must include, since the motion hardly tells K
    from I; 0 where it does.

    The criterion is the usual error of 0.1 % of the torque's RMS in the shape of the part of a
    column that is orthogonal to the others. Slow motion has little of it. With a few steps of the
    encoder rounding is no noise, but part of the motion.

    Parameters
    ----------
    record, sums
        What was fitted.
    fit
        Of Eq. 15 to all of it.

    Raises
    ------
    InputError
        The joint hardly moves.
    IdentifiabilityError
        The acceleration is mostly noise of the encoder.
    """
    moved = np.ptp(record.theta[record.rows()])
    if moved < FEWEST_STEPS * record.encoder_step:
        raise InputError(
            f"trial {record.name}: the joint hardly moves: theta turns by"
            f" {moved / record.encoder_step:.0f} steps of its encoder, {FEWEST_STEPS:g} are needed;"
            " move it by more, and check the unit of theta in the source file"
        )
    covariance = sums.covariance(None, ["theta", "omega", "alpha"])
    size = np.sqrt(np.diag(covariance))
    correlation = covariance[:3, :3] / np.outer(size[:3], size[:3])
    own_theta, _, own_alpha = size[:3] / np.sqrt(np.diag(np.linalg.inv(correlation)))
    noise_share = acceleration_noise(record) / own_alpha**2
    if noise_share > MOST_NOISE:
        low_hz, high_hz = record.band_hz
        raise IdentifiabilityError(
            f"trial {record.name}: a motion of {low_hz:.2g} to {high_hz:.2g} Hz"
            f" cannot tell K from I: noise of the encoder has {noise_share:.2g} times the power of"
            f" the acceleration's own part behind the filter, at most {MOST_NOISE:g} is allowed;"
            " move the joint by more or faster, by 0.5 to 6 Hz, and check the unit of theta in the"
            f" source file, {STIFFNESS_ALONE}"
        )
    error_of_K, error_of_I = USUAL_ERROR * size[3] / np.array([own_theta, own_alpha])
    errors = dict.fromkeys(fit.names, 0.0)
    # without stiffness a tenth of K is no limit
    if error_of_K > max(LARGE_CHANGE_OF_K * abs(fit["K"]), fit.se("K")):
        errors["K"] = error_of_K
    if error_of_I > (getattr(record.settings, "largest_inertia_error", None) or np.inf):
        errors["I"] = error_of_I
    return np.array(list(errors.values()))


def acceleration_noise(record: Record) -> float:
    """Variance [rad^2/s^4] that white noise of the angle leaves in the filtered acceleration.

    The density of the noise is the median of what the filter removes from two to four cut-offs or,
    if the motion itself reaches these frequencies, its level at the highest ones.
    """
    rate_hz, cutoff_hz = record.rate_hz, record.settings.cutoff_hz
    removed = (record.theta - record.motion.theta)[record.rows()]
    rows = min(round(rate_hz), len(removed))
    frequency, density = scipy.signal.welch(removed, rate_hz, nperseg=rows)
    level = float(np.median(density[frequency > 0.35 * rate_hz]))
    beyond = (frequency > 2 * cutoff_hz) & (frequency < min(4 * cutoff_hz, 0.45 * rate_hz))
    if beyond.any():
        level = min(level, float(np.median(density[beyond])))
    f = np.linspace(0, min(8 * cutoff_hz, rate_hz / 2), 2000)
    passed = level * record.settings.low_pass.gain(f) ** 2
    return float(np.trapezoid((2 * np.pi * f) ** 4 * passed, f))
