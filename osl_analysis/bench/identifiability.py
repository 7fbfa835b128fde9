"""Whether a motion tells K, B and I: refusals that name what is missing."""

import numpy as np

from osl_analysis.bench.effects import noise_of_angle
from osl_analysis.bench.record import Label, Record
from osl_analysis.bench.regression import Sums
from osl_analysis.errors import Change, IdentifiabilityError, InputError
from osl_analysis.measured import rms
from osl_analysis.trial import Array

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
SLOW_STEPS = 200.0  # steps of the encoder from which a motion is not small, but may be slow
MOST_NOISE = 0.1  # of the power of the acceleration's own part that may be noise of the encoder


def check_told(
    what: str,
    band_hz: tuple[float, float],
    motion: Array,
    torque_rms: float,
    stiffness: tuple[float, float],
    largest_inertia_error: float | None,
) -> float:
    """Refuse a motion whose band cannot tell K from I.

    The criterion is the usual error of 0.1 % of the torque's RMS in the shape of the part of a
    column that is orthogonal to the others. Slow motion has little of it. If the angle is nearly
    all such a part, as in ramps between levels, K is known without I.

    Parameters
    ----------
    what
        With which the message begins.
    band_hz
        Lowest and highest frequency of the motion.
    motion : Array (3, n)
        Filtered angle [rad], velocity and acceleration, without means.
    torque_rms
        Of the filtered torque [N*m].
    stiffness
        K and its standard error [N*m/rad].
    largest_inertia_error
        As the configuration allows it [kg*m^2]; None: any.

    Returns
    -------
    float
        The error of I [kg*m^2] that its interval must include if the motion hardly determines I,
        else 0.

    Raises
    ------
    IdentifiabilityError
        The message names the missing band.
    """
    theta, omega, alpha = motion
    own_theta = rms_of_own_part(theta, omega, alpha)
    own_alpha = rms_of_own_part(alpha, omega, theta)
    error_of_K = USUAL_ERROR * torque_rms / own_theta
    error_of_I = USUAL_ERROR * torque_rms / own_alpha
    low_hz, high_hz = band_hz
    K, K_se = stiffness
    cannot = (
        f"{what}: a motion of {low_hz:.2g} to {high_hz:.2g} Hz cannot tell K from I: an error of"
        " 0.1 % of the torque"
    )
    most = np.inf if largest_inertia_error is None else largest_inertia_error
    tells_K_alone = rms(theta) < OWN_ANGLE * own_theta and error_of_I < FAR_TOO_LARGE * most
    if error_of_I > most and not tells_K_alone:
        needed_hz = max(high_hz * np.sqrt(error_of_I / (0.5 * most)), 1.5 * high_hz)
        raise IdentifiabilityError(
            f"{cannot} changes I by {error_of_I:.2g} kg*m^2, more than the {most:g} of"
            f" `largest_inertia_error` in the configuration; the band from {high_hz:.2g} to about"
            f" {needed_hz:.2g} Hz is missing, excite it as well, or check the units of theta and"
            f" torque, by which K would be {K:.3g} N*m/rad, {STIFFNESS_ALONE}",
            OTHER_UNITS if abs(K) > STIFFEST_JOINT else (),
        )
    # without stiffness a tenth of K is no limit
    changes_K = error_of_K > max(LARGE_CHANGE_OF_K * abs(K), K_se)
    if changes_K and rms(theta) > MOSTLY_INERTIA * own_theta:
        raise IdentifiabilityError(
            f"{cannot} changes K by {error_of_K:.2g} N*m/rad; the band below {low_hz:.2g} Hz is"
            " missing, excite it as well"
        )
    return error_of_I if error_of_I > most else 0.0


def rms_of_own_part(column: Array, *others: Array) -> float:
    """RMS of the part of a column (n,) that is orthogonal to others; never 0."""
    X = np.column_stack(others)
    explained = X @ np.linalg.lstsq(X, column, rcond=None)[0]
    return max(rms(column - explained), float(np.finfo(float).tiny))


def check_moves(record: Record, sums: Sums) -> None:
    """Refuse a record that moves too little or too slowly.

    With a few steps of the encoder rounding is no noise, but part of the motion. In slow motion the
    encoder's noise is a tenth or more of the power of the acceleration's part that is not
    proportional to angle and velocity.
    """
    step = record.steps[0]
    measured = record.part(record.bench_angle)
    steps = np.inf if step is None else float(np.ptp(measured) / step)
    check_encoder_steps(record.name, measured, steps)
    share = noise_of_angle(record)[2] / own_acceleration(sums)
    if share <= MOST_NOISE:
        return
    how = "hardly moves"
    remedy = "move it by more, or faster, and check the unit of theta in the source file"
    if steps >= SLOW_STEPS:  # the motion is not small
        how = "moves too slowly"
        remedy = f"move it faster, by 0.5 to 6 Hz, {STIFFNESS_ALONE}"
    raise InputError(
        f"trial {record.name}: the joint {how}: theta turns by {turn_deg(sums):.2g} deg RMS, and"
        f" noise of the encoder has {share:.2g} times the power of the acceleration's own part"
        f" behind the filter, at most {MOST_NOISE:g} is allowed; {remedy}"
    )


def check_encoder_steps(trial: str, measured: Array, steps: float) -> None:
    """Refuse a motion of few steps of its encoder, or of few values (n,) in all."""
    values = float(len(np.unique(measured)))
    levels = values if values <= SLOW_STEPS else np.inf  # slow motion has more of them
    if min(steps, levels) >= FEWEST_STEPS:
        return
    said = f"theta has {levels:g} values in all, as of steps too quick for its rate"
    remedy = "move it more slowly"
    if steps < FEWEST_STEPS:
        said = f"the joint hardly moves: theta turns by {steps:.0f} steps of its encoder"
        remedy = "move it by more"
    raise InputError(
        f"trial {trial}: {said}, {FEWEST_STEPS:g} are needed; {remedy}, and check the unit of theta"
        " in the source file"
    )


def own_acceleration(sums: Sums) -> float:
    """Mean square of the part of the acceleration that angle and velocity do not explain
    [rad^2/s^4]; never 0."""
    A = sums.total
    alpha, one = sums.index(("alpha", "one"))
    others = sums.index(("theta", "omega", "one"))
    slopes = np.linalg.lstsq(A[np.ix_(others, others)], A[others, alpha], rcond=1e-14)[0]
    left = A[alpha, alpha] - A[alpha, others] @ slopes
    return max(float(left / A[one, one]), float(np.finfo(float).tiny))


def turn_deg(sums: Sums, label: Label = None) -> float:
    """RMS [deg] of the filtered angle about its mean in the rows of a label."""
    A = sums.over(label)
    theta, one = sums.index(["theta", "one"])
    n = A[one, one]
    return float(np.rad2deg(np.sqrt(max(A[theta, theta] / n - (A[theta, one] / n) ** 2, 0.0))))
