"""Whether a motion that is no stepped sine tells K, B and I: refusals that name what is missing."""

import numpy as np

from osl_analysis.bench.record import Record
from osl_analysis.bench.regression import GroupFit, Sums
from osl_analysis.errors import Change, IdentifiabilityError, InputError
from osl_analysis.stats.power_density import power_density

STIFFNESS_ALONE = "or take experiment 'torque_angle' in the sheet, for the stiffness alone"
OTHER_UNITS = (Change("", other_unit_of="theta"), Change("", other_unit_of="torque"))
STIFFEST_JOINT = 5e3  # N*m/rad; ankles and prosthetic feet have up to 1500
USUAL_ERROR = 1e-3  # of the torque's RMS, as calibrations and models leave
# RMS of the angle over that of its part orthogonal to omega and alpha; below, K hardly depends on I
OWN_ANGLE = 1.25
FAR_TOO_LARGE = 10.0  # multiples of the largest error of I above which units are wrong
LARGE_CHANGE_OF_K = 0.1  # share of K by which the usual error may change it
# the same ratio as OWN_ANGLE, from which a change of K by more is refused; 1.6 from 0.5 to 6 Hz
MOSTLY_INERTIA = 3.0
FEWEST_STEPS = 20.0  # of the encoder; of fewer, rounding is no noise but part of the motion
MOST_NOISE = 0.1  # of the power of the acceleration's own part that may be noise of the encoder


def error_of_inertia(record: Record, sums: Sums, fit: GroupFit) -> float:
    """Refuse a motion that moves too little, or whose band cannot tell K from I.

    The criterion is the usual error of 0.1 % of the torque's RMS in the shape of the part of a
    column that is orthogonal to the others. Slow motion has little of it. If the angle is nearly
    all such a part, as in ramps between levels, K is known without I. With a few steps of the
    encoder rounding is no noise, but part of the motion.

    Parameters
    ----------
    record, sums
        What was fitted.
    fit
        Of Eq. 15 to all of it.

    Returns
    -------
    float
        The error of I [kg*m^2] that its interval must include if the motion hardly determines I,
        else 0.

    Raises
    ------
    InputError
        The joint hardly moves.
    IdentifiabilityError
        The message names the missing band.
    """
    moved = np.ptp(record.part(record.theta))
    if moved < FEWEST_STEPS * record.encoder_step:
        raise InputError(
            f"trial {record.name}: the joint hardly moves: theta turns by"
            f" {moved / record.encoder_step:.0f} steps of its encoder, {FEWEST_STEPS:g} are needed;"
            " move it by more, and check the unit of theta in the source file"
        )
    covariance = sums.covariance(None, ["theta", "omega", "alpha"])
    torque_rms = np.sqrt(covariance[3, 3])
    theta_rms = np.sqrt(covariance[0, 0])
    size = np.sqrt(np.diag(covariance)[:3])
    scaled = covariance[:3, :3] / np.outer(size, size)
    own_theta, _, own_alpha = size / np.sqrt(np.diag(np.linalg.inv(scaled)))
    error_of_K = USUAL_ERROR * torque_rms / own_theta
    error_of_I = USUAL_ERROR * torque_rms / own_alpha

    low_hz, high_hz = record.band_hz
    band = f"{low_hz:.2g} to {high_hz:.2g} Hz"
    cannot = f"trial {record.name}: a motion of {band} cannot tell K from I"
    noise_share = acceleration_noise(record) / own_alpha**2
    if noise_share > MOST_NOISE:
        raise IdentifiabilityError(
            f"{cannot}: noise of the encoder has {noise_share:.2g} times the power of the"
            f" acceleration's own part behind the filter, at most {MOST_NOISE:g} is allowed; move"
            " the joint by more or faster, by 0.5 to 6 Hz, and check the unit of theta in the"
            f" source file, {STIFFNESS_ALONE}"
        )
    cannot += ": an error of 0.1 % of the torque"
    most = getattr(record.settings, "largest_inertia_error", None) or np.inf
    tells_K_alone = theta_rms < OWN_ANGLE * own_theta and error_of_I < FAR_TOO_LARGE * most
    if error_of_I > most and not tells_K_alone:
        needed_hz = max(high_hz * np.sqrt(error_of_I / (0.5 * most)), 1.5 * high_hz)
        raise IdentifiabilityError(
            f"{cannot} changes I by {error_of_I:.2g} kg*m^2, more than the {most:g} of"
            f" `largest_inertia_error` in the configuration; the band from {high_hz:.2g} to about"
            f" {needed_hz:.2g} Hz is missing, excite it as well, or check the units of theta and"
            f" torque, by which K would be {fit['K']:.3g} N*m/rad, {STIFFNESS_ALONE}",
            OTHER_UNITS if abs(fit["K"]) > STIFFEST_JOINT else (),
        )
    # without stiffness a tenth of K is no limit
    changes_K = error_of_K > max(LARGE_CHANGE_OF_K * abs(fit["K"]), fit.se("K"))
    if changes_K and theta_rms > MOSTLY_INERTIA * own_theta:
        raise IdentifiabilityError(
            f"{cannot} changes K by {error_of_K:.2g} N*m/rad; the band below {low_hz:.2g} Hz is"
            " missing, excite it as well"
        )
    return float(error_of_I) if error_of_I > most else 0.0


def acceleration_noise(record: Record) -> float:
    """Variance [rad^2/s^4] that white noise of the angle leaves in the filtered acceleration.

    The density of the noise is the median of what the filter removes from two to four cut-offs or,
    if the motion itself reaches these frequencies, its level at the highest ones.
    """
    rate_hz, cutoff_hz = record.rate_hz, record.low_pass.cutoff_hz
    removed = record.part(record.theta - record.motion.theta)
    frequency, density = power_density(removed, rate_hz, min(round(rate_hz), len(removed)))
    level = float(np.median(density[frequency > 0.35 * rate_hz]))
    beyond = (frequency > 2 * cutoff_hz) & (frequency < min(4 * cutoff_hz, 0.45 * rate_hz))
    if beyond.any():
        level = min(level, float(np.median(density[beyond])))
    f = np.linspace(0, min(8 * cutoff_hz, rate_hz / 2), 2000)
    passed = level * record.low_pass.gain(f) ** 2
    return float(np.trapezoid((2 * np.pi * f) ** 4 * passed, f))
