"""The actuator alone: torque_m = k_tau n_m I_q - f - B_m omega_m - J_m alpha_m + offset + drift (Eqs. 1-2)."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.analysis import Series, time_base_row, time_base_words, timebase_table
from osl_analysis.bench.settings import ActuatorAnalysis
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.judge.doubts import summary_of_trials
from osl_analysis.judge.impossible import check_changes
from osl_analysis.signals import LowPass, differentiate, sampling_rate
from osl_analysis.stats.covariance import ResidualCorrelation
from osl_analysis.stats.fit_row import covariance_row, diagnostics_row, estimates_row
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.timebase.grid import UniformSignals, uniform_signals
from osl_analysis.trial import Array, Trial

PARAMETERS = ("k_tau_n_m", "f_C", "f_G", "B_m", "J_m")
"""Torque per current k_tau n_m [N*m/A], Coulomb friction [N*m], gear friction [N*m/A], damping, inertia."""
FEWEST_MOVING_S = 1.0  # shortest duration [s] of the samples that are fitted
EDGE_PERIODS = 3
"""Periods of the filter's cut-off at both ends that are not fitted: there the filter had to extrapolate."""


@dataclass(frozen=True)
class ActuatorSignals:
    """Signals of one trial on the actuator's bench, shape (n,) each."""

    time: Array  # time [s]
    motion: Array  # angle [rad] or velocity [rad/s] at the actuator's output
    current: Array  # q-axis current I_q [A]
    torque_m: Array  # torque that the actuator exerts at its output [N*m]
    is_velocity: bool = False  # whether `motion` is the velocity; it is then differentiated once instead of twice


@dataclass(frozen=True)
class ActuatorTrial:
    """Filtered torques of one trial, shape (n,) each, and the fit."""

    name: str  # name of the trial
    motion: str  # column that the motion is from: theta_m, or omega_m of a bench that logs no angle
    time: Array  # time [s]
    torque: Array  # filtered torque [N*m]
    modelled: Array  # torque of the fitted model [N*m]
    fitted: NDArray[np.bool_]  # rows that are fitted
    fit: LinearFit  # the fit
    low_pass: LowPass  # the filter of all signals
    uniform: UniformSignals | None = None
    """The signals on their time base, with what the recorders did; None for a trial that no file holds."""
    other: LinearFit | None = None  # the fit if undecided stamps were taken the other way; None where all are decided


def actuator_trial(trial: Trial, settings: ActuatorAnalysis) -> ActuatorTrial:
    """Filter and fit one canonical trial.

    Raises InputError, IdentifiabilityError: As `actuator_columns` and `fit_actuator`, or a signal is missing; the
    message names the trial.
    """
    made = actuator_alone(trial, settings)
    assert made.uniform is not None
    try:
        other = made.uniform.other()
        return replace(made, other=None if other is None else actuator_of(other, made.motion, settings).fit)
    except (InputError, IdentifiabilityError) as error:
        raise type(error)(f"trial {trial.name}: {error}") from error


def actuator_alone(trial: Trial, settings: ActuatorAnalysis) -> ActuatorTrial:
    """As `actuator_trial`, without `other`, which costs as much again."""
    motion = next((name for name in ("theta_m", "omega_m") if name in trial.samples.columns), "theta_m")
    uniform = uniform_signals(trial, (motion, "current", "torque_m"), settings.gap_limits)
    try:
        return actuator_of(uniform, motion, settings)
    except (InputError, IdentifiabilityError) as error:
        raise type(error)(f"trial {trial.name}: {error}") from error


def actuator_of(uniform: UniformSignals, motion: str, settings: ActuatorAnalysis) -> ActuatorTrial:
    """The trial behind uniform signals, `motion` among them; raises as `actuator_trial`, without the trial's name."""
    check_changes("torque_m", uniform["torque_m"])
    measured = (uniform[motion], uniform["current"], uniform["torque_m"])
    signals = ActuatorSignals(uniform.time, *measured, is_velocity=motion == "omega_m")
    columns, torque = actuator_columns(signals, settings.low_pass, settings.sign_width)
    fit = fit_actuator(columns, torque, uniform.rate_hz, settings.low_pass, settings.slowest, uniform.usable)
    modelled = fit.predicted(columns)
    fitted = moving_rows(columns["B_m"], uniform.rate_hz, settings.low_pass, settings.slowest, uniform.usable)
    return ActuatorTrial(uniform.trial, motion, uniform.time, torque, modelled, fitted, fit, settings.low_pass, uniform)


def actuator_series(actuator: ActuatorTrial) -> Series:
    """Measured torque and that of Eqs. 1-2."""
    assert actuator.uniform is not None
    motion = actuator.uniform[actuator.motion]
    return Series(
        actuator.time, actuator.torque, actuator.modelled, motion, actuator.fitted, actuator.motion == "omega_m"
    )


def fit_actuator(
    columns: Mapping[str, Array],
    torque: Array,
    rate_hz: float,
    low_pass: LowPass,
    slowest: float,
    usable: NDArray[np.bool_] | None = None,
) -> LinearFit:
    """Fit `PARAMETERS`, `offset` [N*m] and `drift` [N*m/s] to the columns and the torque of `actuator_columns`.

    Samples slower than `slowest` [rad/s] are not fitted, because friction may have any value up to its limit there;
    nor are the edges of the filter, nor rows that are not `usable` (n,). f_G can be told from k_tau n_m only if the
    current both drives and brakes: as long as it has the direction of the motion, sign(omega_m) |I_q| equals I_q. The
    drift is that of the torque transducer. Left in the residual it would multiply the standard error of f_G by four.

    Raises InputError: As `linear_fit`, or the actuator hardly moves. Raises IdentifiabilityError: The schedule cannot
    tell two parameters apart; the message names them.
    """
    moving = moving_rows(columns["B_m"], rate_hz, low_pass, slowest, usable)
    if np.count_nonzero(moving) < FEWEST_MOVING_S * rate_hz:
        raise InputError(
            f"the actuator is faster than {slowest:g} rad/s in {np.count_nonzero(moving)} of {len(torque)} samples; "
            "drive it faster or longer, or check the unit of theta_m or omega_m in the source file"
        )
    chosen = {name: column[moving] for name, column in columns.items()}
    return linear_fit(torque[moving], chosen, ResidualCorrelation(every=low_pass.independent_samples(rate_hz)))


def moving_rows(
    velocity: Array, rate_hz: float, low_pass: LowPass, slowest: float, usable: NDArray[np.bool_] | None = None
) -> NDArray[np.bool_]:
    """The rows (n,) that `fit_actuator` fits: faster than `slowest` [rad/s], usable, and away from both ends."""
    moving = (np.abs(velocity) > slowest) & (True if usable is None else usable)
    edge = int(np.ceil(EDGE_PERIODS * rate_hz / low_pass.cutoff_hz))
    moving[:edge] = moving[-edge:] = False
    return moving


def actuator_columns(
    signals: ActuatorSignals, low_pass: LowPass, sign_width: float
) -> tuple[Mapping[str, Array], Array]:
    """Columns of Eqs. 1-2 with their signs, and the torque [N*m], all filtered, shape (n,) each. The sign of the
    velocity is tanh(omega_m/sign_width), `sign_width` in rad/s. It is taken before the filter, so that friction's jumps
    are smeared in the column as they are in the torque, which biases nothing."""
    time, rate = signals.time, sampling_rate(signals.time)
    smooth = differentiate(time, low_pass(signals.motion, rate))
    omega, alpha = (smooth.theta, smooth.omega) if signals.is_velocity else (smooth.omega, smooth.alpha)
    direction = np.tanh(omega / sign_width)
    columns = {
        "k_tau_n_m": low_pass(signals.current, rate),
        "f_C": -low_pass(direction, rate),
        "f_G": -low_pass(direction * np.abs(signals.current), rate),
        "B_m": -omega,
        "J_m": -alpha,
        "offset": np.ones_like(time),
        "drift": time - np.mean(time),
    }
    return columns, low_pass(signals.torque_m, rate)


def actuator_table(trial: ActuatorTrial) -> pl.DataFrame:
    """The trial's row of `actuator.csv`."""
    row = {
        "trial": trial.name,
        "motion": trial.motion,
        **estimates_row(trial.fit, *PARAMETERS, "offset", "drift"),
        **covariance_row(trial.fit, *PARAMETERS),
        **diagnostics_row(trial.fit, sampling_rate(trial.time), trial.low_pass),
        "correlation_k_f_G": trial.fit.correlation("k_tau_n_m", "f_G"),
        **time_base_row(trial.fit, trial.other, PARAMETERS),
    }
    return pl.DataFrame([row], schema_overrides={"time_base_shift": pl.Float64})


def actuator_time_base(trial: ActuatorTrial) -> pl.DataFrame:
    return timebase_table(trial.uniform, time_base_words(trial.fit, trial.other, PARAMETERS))


def actuator_summary(table: pl.DataFrame) -> pl.DataFrame:
    return summary_of_trials(table, (*PARAMETERS, "VAF"))
