"""The law that a controller ran, from the logged current and the motor's angle: no component of the drivetrain, and no
torque of the bench, has a part in it.

The controller of Eq. 5 asks for k_tau n_m I_q - s f_G |I_q| - s f_C = -K_1 theta_m - B_1 omega_m, in the numbers that
it was programmed with; s is the smoothed sign of the velocity. A loop that acts d seconds late takes K_1 d off B_1, and
of a velocity that is t seconds old the acceleration bears B_1 t. Its sign is as old: it is read from a velocity behind
`SIGN_CUTOFF` times the cut-off, for a motor that sticks and slides turns faster than the joint, so long ago as explains
most of the current.

The next link is the motor: what torque the belt takes for a current. A current that reads too much makes all of the law
larger and the motor weaker, by one factor.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import polars as pl
import scipy

from osl_analysis.bench.record import Record, logged
from osl_analysis.bench.witness import CHUNKS
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.model.compensator import Gains
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.stats.covariance import Covariance
from osl_analysis.stats.regression import LinearFit, estimates_row, linear_fit, thinned_rows, with_shared_error
from osl_analysis.trial import Array, Trial

LAW_GAINS = ("K_1", "B_1", "f_C", "f_G")
CONSTANT = "k_tau_n_m"
GAIN_COLUMNS = tuple(f"{x}{end}" for x in (*LAW_GAINS, CONSTANT) for end in ("", "_se", "_low", "_high", "_programmed"))
OTHER_LAW = {"K_1_error": 0.02, "B_1_gap_s": 3e-3, "feedforward_error": 0.2}
"""How far gains are off, and from which size on another law ran than was programmed: a share of K_1, the lateness [s]
that would explain B_1, a share of the friction that is cancelled."""
OTHER_LINK = ("loop_late_s", "current_error")
"""What passes for another law: a loop that is late [s], and a current that reads too much, as a share."""
LAW_COLUMNS = {"trial": pl.String} | dict.fromkeys((*GAIN_COLUMNS, "VAF", *OTHER_LAW, *OTHER_LINK), pl.Float64)
SIGN_CUTOFF = 4.0  # cut-offs of the low-pass behind which the sign of the velocity is read
OLDEST = 0.02  # s, the age of the sign
LEAST_SE = {"K_1": 1e-3, "B_1": 2e-3, "f_C": 5e-3, "f_G": 2e-2, CONSTANT: 1e-2}
"""Standard error, as a share, of what sampling and hold of the loop, and a belt that slips, leave in every chunk."""
LEFT_OF_AGE = 0.1  # share (SD) of what the age of the sign moves, by which it may be wrong


def law_table(
    record: Record, trial: Trial, p: DrivetrainParameters, programmed: Gains, sign_width: float
) -> pl.DataFrame:
    """The row of a trial: its gains [N*m/rad, N*m*s/rad, N*m, 1] with 95 % intervals beside the `programmed` ones, the
    motor's torque for a current [N*m/A], and by how much each is off for certain. `p` is what the controller was
    programmed with, `sign_width` [rad/s] that of the sign of its velocity. No row of a trial without a current or an
    angle of the motor that come to a time base with its torque, nor where the motion does not tell the gains apart."""
    nothing = pl.DataFrame(schema=LAW_COLUMNS)
    if record.theta_m is None or "current" not in trial.columns:
        return nothing
    rate, low_pass = record.rate_hz, record.low_pass
    motion = [record.theta_m]
    for _ in range(3):
        motion.append(np.gradient(motion[-1], 1 / rate))
    moved = {"K_1": -motion[0], "B_1": -motion[1], "lag": motion[2], "third": motion[3], "one": np.ones(len(motion[0]))}
    belt = record.filtered_torque - p.B_j * record.motion.omega - p.J_j * record.motion.alpha
    times = record.part(record.time)
    rows = thinned_rows(len(times), rate, low_pass)

    def fitted(y: Array, columns: Mapping[str, Array]) -> LinearFit:
        return linear_fit(record.part(y)[rows], {name: record.part(x)[rows] for name, x in columns.items()}, by_chunks)

    try:
        current = logged(record, trial, "current")
        quick = replace(low_pass, cutoff_hz=min(SIGN_CUTOFF * low_pass.cutoff_hz, 0.2 * rate))
        omega = np.gradient(logged(record, trial, "theta_m", quick), 1 / rate)

        def friction(age: float) -> dict[str, Array]:
            sign = np.tanh(np.interp(record.time - age, record.time, omega) / sign_width)
            return {"f_C": low_pass(sign, rate), "f_G": low_pass(sign * np.abs(current), rate)}

        commanded, of_now = p.k_tau * p.n_m * current, friction(0.0)
        at_once = fit = fitted(commanded, moved | of_now)
        if abs(at_once["f_C"]) > 4 * at_once.se("f_C"):
            y, beside = record.part(commanded)[rows], {name: record.part(x)[rows] for name, x in moved.items()}

            def missed(age: float) -> float:  # a filtered column is that of a later sign, later
                late = {name: np.interp(times[rows] - age, record.time, x) for name, x in of_now.items()}
                return -linear_fit(y, beside | late, by_chunks).vaf

            best = scipy.optimize.minimize_scalar(
                missed, bounds=(0.0, OLDEST), method="bounded", options={"xatol": 2e-4}
            )
            fit = fitted(commanded, moved | friction(float(best.x)))
        against = {f"motor's {name}": -column for name, column in of_now.items()}
        losses = {"B_m": -motion[1], "J_m": -motion[2], "one": moved["one"]}
        motor = fitted(-belt / p.n_T, {CONSTANT: current} | against | losses)
    except (InputError, IdentifiabilityError):
        return nothing
    known = {"K_1": programmed.K_1, "B_1": programmed.B_1, "f_C": p.f_C, "f_G": p.f_G, CONSTANT: p.k_tau * p.n_m}
    least = np.array([LEAST_SE.get(name, 0.0) * known.get(name, 0.0) for name in fit.names])
    fit = with_shared_error(fit, LEFT_OF_AGE * (fit.estimates - at_once.estimates))
    fit = replace(fit, covariance=fit.covariance + np.diag(least**2))
    motor = with_shared_error(motor, np.array([LEAST_SE[CONSTANT] * known[CONSTANT], *np.zeros(len(motor.names) - 1)]))
    asked = known | {name: programmed.cancels_friction * known[name] for name in ("f_C", "f_G")}
    row = {"trial": trial.name, **estimates_row(fit, *LAW_GAINS), **estimates_row(motor, CONSTANT), "VAF": fit.vaf}
    row |= {f"{name}_programmed": value for name, value in asked.items()}
    typical = float(np.sqrt(np.mean(record.part(current) ** 2)))
    return pl.DataFrame([row | certain_errors(fit, known[CONSTANT] / motor[CONSTANT], asked, p, typical)], LAW_COLUMNS)


def by_chunks(X: Array, inverse: Array, residual: Array) -> Covariance:
    """The covariance by the scatter of the scores of chunks: what a model lacks is another one in each."""
    edges = np.arange(CHUNKS) * len(residual) // CHUNKS
    scores = np.add.reduceat(X * residual[:, None], edges) @ inverse
    freedom = np.full(X.shape[1], CHUNKS - 1.0)
    return scores.T @ scores * CHUNKS / (CHUNKS - 1), freedom, "chunks", len(residual) // CHUNKS


def certain_errors(
    fit: LinearFit, reads: float, asked: Mapping[str, float], p: DrivetrainParameters, current: float
) -> dict[str, float | None]:
    """What is certainly off, by the names of `OTHER_LAW` and `OTHER_LINK`. `reads` is the factor between the current of
    the log and the motor's, by its torque, `current` [A] a usual one.

    Where that factor explains K_1, the current is wrong and the law is what is left. A loop that is late has the right
    K_1, too small a B_1, and an acceleration that bears B_1 times its lateness."""

    def off(value: float, known: float, se: float) -> float:
        return max(abs(value - known) - 2 * se, 0.0)

    K_1, B_1 = asked["K_1"], asked["B_1"]
    is_current = off(fit["K_1"], K_1, fit.se("K_1")) > OTHER_LAW["K_1_error"] * K_1 and (
        abs(fit["K_1"] / reads - K_1) < 0.5 * abs(fit["K_1"] - K_1)
    )
    by = reads if is_current else 1.0
    row: dict[str, float | None] = dict.fromkeys((*OTHER_LAW, *OTHER_LINK))
    row["current_error"] = by - 1
    if K_1:
        apart = K_1 * LEAST_SE[CONSTANT] * is_current
        share = off(fit["K_1"] / by, K_1, fit.se("K_1") + apart) / K_1
        late = off(fit["B_1"] / by, B_1, fit.se("B_1")) / K_1
        borne = (fit["lag"] + 2 * fit.se("lag")) / by + K_1 * late**2 / 2
        is_late = share <= OTHER_LAW["K_1_error"] and fit["B_1"] / by < B_1 and borne > 0.5 * B_1 * late
        row |= {"K_1_error": share, "B_1_gap_s": late * (not is_late), "loop_late_s": late * is_late}
    if stated := p.f_C + p.f_G * current:
        with_load = fit["f_C"] + fit["f_G"] * current
        variance = fit.se("f_C") ** 2 + 2 * current * fit.cov("f_C", "f_G") + (current * fit.se("f_G")) ** 2
        known = asked["f_C"] + asked["f_G"] * current
        row["feedforward_error"] = off(with_load / by, known, float(np.sqrt(max(variance, 0.0)))) / stated
    return row


def law_that_ran(table: pl.DataFrame, programmed: Gains, p: DrivetrainParameters) -> tuple[Gains, DrivetrainParameters]:
    """The gains, and parameters with the friction that the controller cancels: what was programmed, or what `law_table`
    has where it is certainly another. A loop that is late, and a current that reads wrong, leave the law as it was."""
    if table.is_empty():
        return programmed, p
    row = table.row(0, named=True)
    reads = 1 + row["current_error"]
    other = [name for name, most in OTHER_LAW.items() if (row[name] or 0.0) > most]
    if "feedforward_error" in other:
        f_C, f_G = float(max(row["f_C"], 0.0) / reads), float(np.clip(row["f_G"], 0.0, 0.5 * row[CONSTANT]))
        p = replace(p, f_C=f_C, f_G=f_G)
        cancels = p.f_C + p.f_G > 0.1 * (row["f_C_programmed"] + row["f_G_programmed"])
        programmed = replace(programmed, cancels_friction=cancels)
    if {"K_1_error", "B_1_gap_s"} & {*other}:
        programmed = replace(programmed, K_1=row["K_1"] / reads, B_1=row["B_1"] / reads)
    return programmed, p
