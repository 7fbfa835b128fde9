"""The law that a controller ran, from the logged current and the motor's angle: no component of the drivetrain, and no
torque of the bench, has a part in it.

The controller of Eq. 5 asks for k_tau n_m I_q - s f_G |I_q| - s f_C = -K_1 theta_m - B_1 omega_m, in the numbers that
it was programmed with; s is the smoothed sign of the velocity. Of a velocity that is t seconds old the acceleration
bears B_1 t. A loop that acts d seconds late takes K_1 d off B_1.
"""

import numpy as np
import polars as pl

from osl_analysis.bench.record import Record, logged
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.model.compensator import Gains
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.stats.regression import estimates_row, linear_fit, thinned_rows
from osl_analysis.trial import Array, Trial

LAW_GAINS = ("K_1", "B_1", "f_C", "f_G")
GAIN_COLUMNS = tuple(f"{name}{end}" for name in LAW_GAINS for end in ("", "_se", "_low", "_high", "_programmed"))
OTHER_LAW = {"K_1_error": 0.02, "B_1_gap_s": 3e-3, "feedforward_error": 0.5}
"""How far each gain is off, and from which size on another law ran than was programmed: shares of K_1 and f_C, and the
lateness [s] of the loop that explains B_1; a loop of 500 Hz with a filtered velocity acts as late."""
LAW_COLUMNS = {"trial": pl.String} | dict.fromkeys((*GAIN_COLUMNS, "VAF", *OTHER_LAW), pl.Float64)


def law_table(
    record: Record, trial: Trial, p: DrivetrainParameters, programmed: Gains, sign_width: float
) -> pl.DataFrame:
    """The row of a trial: its gains [N*m/rad, N*m*s/rad, N*m, 1] with 95 % intervals beside the `programmed` ones, and
    by how much each is off for certain. `p` is what the controller was programmed with, `sign_width` [rad/s] that of
    the sign of its velocity. No row of a trial without a current or an angle of the motor that come to a time base with
    its torque, nor where the motion does not tell the gains apart."""
    nothing = pl.DataFrame(schema=LAW_COLUMNS)
    if record.theta_m is None or "current" not in trial.columns:
        return nothing
    theta_m, rate, low_pass = record.theta_m, record.rate_hz, record.low_pass
    omega = np.gradient(theta_m, 1 / rate)
    sign = np.tanh(omega / sign_width)

    def fitted(signal: Array) -> Array:
        own = record.part(signal)
        return own[thinned_rows(len(own), rate, low_pass)]

    try:
        current = logged(record, trial, "current")
        columns = {"K_1": -theta_m, "B_1": -omega, "lag": -np.gradient(omega, 1 / rate), "one": np.ones(len(omega))}
        columns |= {"f_C": low_pass(sign, rate), "f_G": low_pass(sign * np.abs(current), rate)}
        fit = linear_fit(fitted(p.k_tau * p.n_m * current), {name: fitted(x) for name, x in columns.items()})
    except (InputError, IdentifiabilityError):
        return nothing
    feedforward = float(programmed.cancels_friction)
    asked = dict(
        zip(LAW_GAINS, (programmed.K_1, programmed.B_1, feedforward * p.f_C, feedforward * p.f_G), strict=True)
    )
    off = {name: max(abs(fit[name] - asked[name]) - 2 * fit.se(name), 0.0) for name in LAW_GAINS}
    scales = {"K_1": programmed.K_1, "B_1": programmed.K_1, "f_C": p.f_C}
    errors = [off[name] / scale if scale else None for name, scale in scales.items()]
    row = {"trial": trial.name, **estimates_row(fit, *LAW_GAINS), "VAF": fit.vaf}
    row |= {f"{name}_programmed": value for name, value in asked.items()}
    return pl.DataFrame([row | dict(zip(OTHER_LAW, errors, strict=True))], LAW_COLUMNS)


def law_that_ran(table: pl.DataFrame, programmed: Gains) -> Gains:
    """The programmed gains, or those of `law_table` where other ones ran for certain."""
    if table.is_empty() or all((table[name][0] or 0.0) <= most for name, most in OTHER_LAW.items()):
        return programmed
    K_1, B_1, friction, stated = (table[name][0] for name in ("K_1", "B_1", "f_C", "f_C_programmed"))
    return Gains(K_1, B_1, friction > 0.5 * stated if stated else False)
