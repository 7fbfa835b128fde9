"""The actuator alone: torque_m = k_tau n_m I_q - f - B_m omega_m - J_m alpha_m + offset + drift (Eqs. 1-2)."""

from collections.abc import Mapping

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass, differentiate, sampling_rate
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array

PARAMETERS = ("k_tau_n_m", "f_C", "f_G", "B_m", "J_m")
"""Torque per current k_tau n_m [N*m/A], Coulomb friction [N*m], gear friction [N*m/A], damping, inertia."""
FEWEST_MOVING_S = 1.0
EDGE_PERIODS = 3
"""Periods of the filter's cut-off left out at both ends, where the filter had to invent what came before and after."""


def fit_actuator(
    columns: Mapping[str, Array], torque: Array, rate_hz: float, low_pass: LowPass, slowest: float
) -> LinearFit:
    """Fit `PARAMETERS`, `offset` [N*m] and `drift` [N*m/s] to what `actuator_columns` makes of a trial.

    Samples slower than `slowest` [rad/s], where friction may be anything up to its limit, are left out, and so are the
    filter's edges. f_G is told from k_tau n_m only where the current both drives and brakes: while it always has the
    direction of the motion, sign(omega_m) |I_q| is I_q. The drift is the transducer's: left in the residual it would
    cost f_G four times its standard error.

    Raises
    ------
    InputError
        As `linear_fit`, or the actuator hardly moves.
    IdentifiabilityError
        The schedule cannot tell two parameters apart; the message names them.
    """
    moving = np.abs(columns["B_m"]) > slowest
    edge = int(np.ceil(EDGE_PERIODS * rate_hz / low_pass.cutoff_hz))
    moving[:edge] = moving[-edge:] = False
    if np.count_nonzero(moving) < FEWEST_MOVING_S * rate_hz:
        raise InputError(
            f"the actuator is faster than {slowest:g} rad/s in {np.count_nonzero(moving)} of {len(torque)} samples; "
            "drive it faster or longer, or check the unit of theta_m or omega_m in the source file"
        )
    fitted = {name: column[moving] for name, column in columns.items()}
    return linear_fit(torque[moving], fitted, every=low_pass.independent_samples(rate_hz))


def actuator_columns(
    time: Array,
    motion: Array,
    current: Array,
    torque_m: Array,
    low_pass: LowPass,
    sign_width: float,
    is_velocity: bool = False,
) -> tuple[Mapping[str, Array], Array]:
    """Columns with their signs in Eqs. 1-2, and the torque [N*m], from motion, I_q [A], torque; shape (n,) each.

    `motion` is the angle [rad], or the velocity [rad/s], which then is differentiated once instead of twice. All pass
    the same filter, the friction's after its sign, tanh(omega_m/sign_width), is taken: a jump that is smeared on both
    sides biases nothing.

    Raises
    ------
    InputError
        As `LowPass`, or the stamps are not uniform.
    """
    rate = sampling_rate(time)
    smooth = differentiate(time, low_pass(motion, rate))
    omega, alpha = (smooth.theta, smooth.omega) if is_velocity else (smooth.omega, smooth.alpha)
    direction = np.tanh(omega / sign_width)
    columns = {
        "k_tau_n_m": low_pass(current, rate),
        "f_C": -low_pass(direction, rate),
        "f_G": -low_pass(direction * np.abs(current), rate),
        "B_m": -omega,
        "J_m": -alpha,
        "offset": np.ones_like(time),
        "drift": time - np.mean(time),
    }
    return columns, low_pass(torque_m, rate)


def correlation(fit: LinearFit, first: str, second: str) -> float:
    """Correlation of two estimates, between -1 and 1: near the ends only their combination is known."""
    i, j = fit.names.index(first), fit.names.index(second)
    return float(fit.covariance[i, j] / (fit.se(first) * fit.se(second)))
