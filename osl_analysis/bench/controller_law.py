"""The law that a controller ran, from the logged current and the motor's angle alone.

No component of the drivetrain and no torque of the bench is needed. The controller of Eq. 5 asks
for

    k_tau n_m I_q - s f_G |I_q| - s f_C = -K_1 theta_m - B_1 omega_m

in the numbers of its program; s is the smoothed sign of the velocity. The left side is regressed on
the right one, beside what lateness adds:

* A loop that acts d seconds late takes K_1 d off B_1.
* A velocity that is t seconds old adds B_1 t to the coefficient of the acceleration.
* The sign is as old as the velocity. It is read from a velocity with `QUICK` times the cut-off,
  since a motor that sticks and slides turns faster than the joint. Its age is the one that explains
  most of the current.

The next link is the motor: the belt's torque per current. A current that reads too high scales the
whole law up and the motor's constant down, by one factor.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.record import Record
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.model.compensator import Gains
from osl_analysis.model.drivetrain import DrivetrainParameters
from osl_analysis.stats.covariance import Covariance
from osl_analysis.stats.regression import LinearFit, linear_fit, with_shared_error, without
from osl_analysis.stats.table_rows import estimates_row, thinned_rows
from osl_analysis.trial import Array

CHUNKS = 24  # parts of a recording; the covariance comes from the scatter of their scores
LAW_GAINS = ("K_1", "B_1", "f_C", "f_G")
MOTOR_CONSTANT = "k_tau_n_m"
GAIN_COLUMNS = tuple(
    f"{name}{end}"
    for name in (*LAW_GAINS, MOTOR_CONSTANT)
    for end in ("", "_se", "_low", "_high", "_programmed")
)
OTHER_LAW = {"K_1_error": 0.02, "B_1_gap_s": 3e-3, "feedforward_error": 0.2}
"""Errors of the gains, each with the size from which on another law ran than was programmed: a
share of K_1, the lateness [s] that would explain B_1, a share of the cancelled friction."""
OTHER_LINK = ("loop_late_s", "current_error")
"""What passes for another law: a late loop [s], and the relative error of the current."""
LAW_COLUMNS = {
    "trial": pl.String,
    **dict.fromkeys((*GAIN_COLUMNS, "VAF", *OTHER_LAW, *OTHER_LINK), pl.Float64),
}
LEAST_SE = {"K_1": 1e-3, "B_1": 2e-3, "f_C": 5e-3, "f_G": 2e-2, MOTOR_CONSTANT: 1e-2}
"""Relative standard errors due to sampling and hold of the loop, and to a slipping belt, which all
chunks share."""
AGE_MATTERS = 4.0  # standard errors of f_C above which the age of the velocity's sign is sought
OLDEST_SIGN_S = 0.02  # s; upper bound of that age
AGE_TOLERANCE_S = 2e-4  # s
AGE_ERROR = 0.1  # standard deviation of that age's effect, as a share of the effect
CERTAIN = 2.0  # standard errors that an error of a gain must exceed


def law_table(
    record: Record, p: DrivetrainParameters, programmed: Gains, sign_width: float
) -> pl.DataFrame:
    """Identify the gains that a controller ran.

    Parameters
    ----------
    record
        Trial with the actuator's angle, and its current if it was logged.
    p
        The numbers of the controller's program.
    programmed
        Gains K_1 [N*m/rad] and B_1 [N*m*s/rad] of the program.
    sign_width
        That of the velocity's smoothed sign [rad/s].

    Returns
    -------
    polars.DataFrame
        A row with the gains and the motor's torque per current, 95 % intervals, the programmed
        values, and by how much each is certainly off. No row if the trial has no current or motor
        angle on a time base with its torque, or if the motion cannot tell the gains apart.
    """
    nothing = pl.DataFrame(schema=LAW_COLUMNS)
    if "current" not in record.actuator:
        return nothing
    try:
        identified = identified_law(record, p, sign_width)
    except (InputError, IdentifiabilityError):
        return nothing

    constant = p.k_tau * p.n_m
    in_program = {
        "K_1": programmed.K_1,
        "B_1": programmed.B_1,
        "f_C": p.f_C,
        "f_G": p.f_G,
        MOTOR_CONSTANT: constant,
    }
    law, motor = with_least_errors(identified, in_program)
    asked = dict(in_program)
    for name in ("f_C", "f_G"):
        asked[name] = programmed.cancels_friction * in_program[name]

    typical_current = float(np.sqrt(np.mean(record.part(record.actuator["current"]) ** 2)))
    reads = constant / motor[MOTOR_CONSTANT]
    row = {
        "trial": record.name,
        **estimates_row(law, *LAW_GAINS),
        **estimates_row(motor, MOTOR_CONSTANT),
        "VAF": law.vaf,
        **{f"{name}_programmed": value for name, value in asked.items()},
        **certain_errors(law, reads, asked, p, typical_current),
    }
    return pl.DataFrame([row], LAW_COLUMNS)


@dataclass(frozen=True)
class IdentifiedLaw:
    """Fits to a controller's current."""

    law: LinearFit  # K_1, B_1, f_C, f_G and what lateness adds, at the sign's age
    at_once: LinearFit  # the same with a sign that is not old
    motor: LinearFit  # the belt's torque by current: k_tau n_m, friction and losses


def identified_law(record: Record, p: DrivetrainParameters, sign_width: float) -> IdentifiedLaw:
    """Regress current on motion, and the belt's torque on current.

    Raises
    ------
    InputError, IdentifiabilityError
        As `linear_fit`.
    """
    rate, low_pass = record.rate_hz, record.low_pass
    rows = record.rows()[thinned_rows(record.samples, rate, low_pass)]
    current = record.actuator["current"]
    theta_m = record.actuator["theta_m"]
    omega_m = np.gradient(theta_m, 1 / rate)
    alpha_m = np.gradient(omega_m, 1 / rate)
    jerk_m = np.gradient(alpha_m, 1 / rate)
    one = np.ones(len(theta_m))
    moved = {"K_1": -theta_m, "B_1": -omega_m, "lag": alpha_m, "third": jerk_m, "one": one}
    quick_omega = np.gradient(record.actuator["wide_band_theta_m"], 1 / rate)

    def friction(age_s: float) -> dict[str, Array]:
        """Columns (n,) of the friction that is cancelled, with the sign of a velocity of before."""
        velocity = np.interp(record.time - age_s, record.time, quick_omega)
        sign = np.tanh(velocity / sign_width)
        return {"f_C": low_pass(sign, rate), "f_G": low_pass(sign * np.abs(current), rate)}

    def fitted(y: Array, columns: Mapping[str, Array]) -> LinearFit:
        return linear_fit(y[rows], {name: x[rows] for name, x in columns.items()}, by_chunks)

    commanded = p.k_tau * p.n_m * current
    friction_of_now = friction(0.0)
    at_once = fitted(commanded, {**moved, **friction_of_now})
    law = at_once
    if abs(at_once["f_C"]) > AGE_MATTERS * at_once.se("f_C"):
        age_s = sought_age(record.time, rows, commanded, moved, friction_of_now)
        law = fitted(commanded, {**moved, **friction(age_s)})

    of_belt = record.filtered_torque - p.B_j * record.motion.omega - p.J_j * record.motion.alpha
    columns = {MOTOR_CONSTANT: current}
    for name, column in friction_of_now.items():
        columns[f"motor's {name}"] = -column
    losses = {"B_m": -omega_m, "J_m": -alpha_m, "one": one}
    motor = fitted(-of_belt / p.n_T, {**columns, **losses})
    return IdentifiedLaw(law, at_once, motor)


def sought_age(
    time: Array,
    rows: NDArray[np.intp],
    commanded: Array,
    moved: Mapping[str, Array],
    friction_of_now: Mapping[str, Array],
) -> float:
    """The age [s] of the velocity's sign that leaves least of the commanded torque (n,)."""
    beside = without(np.column_stack([x[rows] for x in moved.values()]))
    y = beside(commanded[rows])

    def left(age_s: float) -> float:
        # a filtered column of a later sign is the filtered column, later
        late = [np.interp(time[rows] - age_s, time, column) for column in friction_of_now.values()]
        columns = beside(np.column_stack(late))
        return float(np.sum((y - columns @ np.linalg.lstsq(columns, y)[0]) ** 2))

    best = scipy.optimize.minimize_scalar(
        left, bounds=(0.0, OLDEST_SIGN_S), method="bounded", options={"xatol": AGE_TOLERANCE_S}
    )
    return float(best.x)


def by_chunks(X: Array, inverse: Array, residual: Array) -> Covariance:
    """The covariance from the scatter of scores of chunks: what a model lacks differs between
    them."""
    edges = np.arange(CHUNKS) * len(residual) // CHUNKS
    scores = np.add.reduceat(X * residual[:, None], edges) @ inverse
    covariance = scores.T @ scores * CHUNKS / (CHUNKS - 1)
    freedom = np.full(X.shape[1], CHUNKS - 1.0)
    return Covariance(covariance, freedom, "chunks", len(residual) // CHUNKS)


def with_least_errors(
    identified: IdentifiedLaw, in_program: Mapping[str, float]
) -> tuple[LinearFit, LinearFit]:
    """The fits of law and motor with the errors that all chunks share: of the sign's age, and
    `LEAST_SE` of the numbers in the program."""
    by_age = identified.law.estimates - identified.at_once.estimates
    law = with_shared_error(identified.law, AGE_ERROR * by_age)
    least = np.array([LEAST_SE.get(name, 0.0) * in_program.get(name, 0.0) for name in law.names])
    law = replace(law, covariance=law.covariance + np.diag(least**2))
    motor = identified.motor
    least_of_motor = np.zeros(len(motor.names))
    at_constant = motor.names.index(MOTOR_CONSTANT)
    least_of_motor[at_constant] = LEAST_SE[MOTOR_CONSTANT] * in_program[MOTOR_CONSTANT]
    return law, with_shared_error(motor, least_of_motor)


def certainly_off(value: float, known: float, se: float) -> float:
    """By how much a value differs from a known one beyond `CERTAIN` standard errors."""
    return max(abs(value - known) - CERTAIN * se, 0.0)


def certain_errors(
    fit: LinearFit,
    reads: float,
    asked: Mapping[str, float],
    p: DrivetrainParameters,
    current: float,
) -> dict[str, float | None]:
    """By how much a law certainly differs from the one that was asked for.

    If the current's ratio explains K_1, the current is wrong, and the law is what remains. A late
    loop has the right K_1, too small a B_1, and a coefficient of the acceleration of B_1 times its
    lateness.

    Parameters
    ----------
    fit
        The law.
    reads
        Ratio of the logged current to the motor's, by its torque.
    asked
        The gains that were asked for, by name.
    p
        The numbers of the program.
    current
        A typical one [A].

    Returns
    -------
    dict
        The errors by the names of `OTHER_LAW` and `OTHER_LINK`; None where nothing tells them.
    """
    K_1 = asked["K_1"]
    B_1 = asked["B_1"]
    is_off = certainly_off(fit["K_1"], K_1, fit.se("K_1")) > OTHER_LAW["K_1_error"] * K_1
    is_explained = abs(fit["K_1"] / reads - K_1) < 0.5 * abs(fit["K_1"] - K_1)
    is_current = is_off and is_explained
    ratio = reads if is_current else 1.0
    row: dict[str, float | None] = dict.fromkeys((*OTHER_LAW, *OTHER_LINK))
    row["current_error"] = ratio - 1

    if K_1:
        se_of_ratio = K_1 * LEAST_SE[MOTOR_CONSTANT] if is_current else 0.0
        K_1_error = certainly_off(fit["K_1"] / ratio, K_1, fit.se("K_1") + se_of_ratio) / K_1
        late_s = certainly_off(fit["B_1"] / ratio, B_1, fit.se("B_1")) / K_1
        # what a late loop adds to the coefficient of the acceleration, at most
        of_acceleration = (fit["lag"] + CERTAIN * fit.se("lag")) / ratio + K_1 * late_s**2 / 2
        is_late = (
            K_1_error <= OTHER_LAW["K_1_error"]
            and fit["B_1"] / ratio < B_1
            and of_acceleration > 0.5 * B_1 * late_s
        )
        row["K_1_error"] = K_1_error
        row["B_1_gap_s"] = 0.0 if is_late else late_s
        row["loop_late_s"] = late_s if is_late else 0.0

    in_program = p.f_C + p.f_G * current
    if in_program:
        cancelled = fit["f_C"] + fit["f_G"] * current
        variance = (
            fit.se("f_C") ** 2
            + 2 * current * fit.cov("f_C", "f_G")
            + (current * fit.se("f_G")) ** 2
        )
        se = float(np.sqrt(max(variance, 0.0)))
        known = asked["f_C"] + asked["f_G"] * current
        row["feedforward_error"] = certainly_off(cancelled / ratio, known, se) / in_program
    return row


def law_that_ran(
    table: pl.DataFrame, programmed: Gains, p: DrivetrainParameters
) -> tuple[Gains, DrivetrainParameters]:
    """Choose the law that counts for a trial.

    A late loop and a current that reads wrong do not change the law.

    Parameters
    ----------
    table
        Its row of `law_table`, or none.
    programmed, p
        Gains and numbers of the program.

    Returns
    -------
    gains
        As programmed, or as identified if another law certainly ran.
    parameters
        Those of the program, with the friction that the controller cancels.
    """
    if table.is_empty():
        return programmed, p
    row = table.row(0, named=True)
    reads = 1 + row["current_error"]
    other = {name for name, most in OTHER_LAW.items() if (row[name] or 0.0) > most}
    if "feedforward_error" in other:
        f_C = float(max(row["f_C"], 0.0) / reads)
        f_G = float(np.clip(row["f_G"], 0.0, 0.5 * row[MOTOR_CONSTANT]))
        p = replace(p, f_C=f_C, f_G=f_G)
        in_program = row["f_C_programmed"] + row["f_G_programmed"]
        programmed = replace(programmed, cancels_friction=p.f_C + p.f_G > 0.1 * in_program)
    if other & {"K_1_error", "B_1_gap_s"}:
        programmed = replace(programmed, K_1=row["K_1"] / reads, B_1=row["B_1"] / reads)
    return programmed, p
