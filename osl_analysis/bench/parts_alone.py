# SPDX-License-Identifier: Apache-2.0
"""Parts of the drivetrain alone on their benches: the actuator (Eqs. 1-2), turning or clamped, and
the transmission, with the motor detached (Eq. 4)."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError, naming
from osl_analysis.base.trial import Array, Trial
from osl_analysis.bench.bench_settings import ActuatorAnalysis
from osl_analysis.bench.budgets import alternatives, fit_tables, other_stamps, stated_models
from osl_analysis.bench.friction import coulomb_fit, inferred_of_joint
from osl_analysis.bench.impedance import Analysis, fit_all_groups
from osl_analysis.bench.motion import blocks_of
from osl_analysis.bench.plausibility import check_changes
from osl_analysis.bench.record import Record, unlike_groups
from osl_analysis.bench.regression import (
    SLOW,
    TRANSMISSION,
    Model,
    Sums,
    gram_sums,
    offset_and_drift,
    sums_of,
    with_effects,
)
from osl_analysis.inference import ModelName
from osl_analysis.signals.filters import Motion, differentiate, runs
from osl_analysis.signals.grid import UniformSignals, uniform_signals
from osl_analysis.signals.plateaus import FEWEST_PARTS, is_clamped, plateaus_of
from osl_analysis.stats.budget import Budget, Contribution, Row, unknown
from osl_analysis.stats.linear_fit import LinearFit
from osl_analysis.stats.sources import Source

PROPERTIES_OF_LOSSES = {"B_j": Source.FRICTION, "J_j": Source.WEIGHT_ON_JOINT}
LOSSES = ("B_j", "J_j")  # of a transmission; its table has no K
ACTUATOR_PARAMETERS = ("k_tau_n_m", "f_C", "f_G", "B_m", "J_m")
"""Torque per current k_tau n_m [N*m/A], Coulomb friction [N*m], gear friction [N*m/A], damping,
inertia."""
ACTUATOR_ALONE: Model = {**{name: name for name in ACTUATOR_PARAMETERS}, **SLOW}
"""torque_m = k_tau n_m I_q - f - B_m omega_m - J_m alpha_m + offset + drift (Eqs. 1-2)"""
SLOWEST = 0.5  # rad/s; slower samples are not fitted: friction may be below its limit there
FEWEST_MOVING_S = 1.0  # s; shortest total duration of the fitted samples
ACTUATOR_EDGE_PERIODS = 3.0  # of the cut-off at both ends, where the filter extrapolates
FAR_BETTER = 0.5  # of what is left of the torque, with the current at another time
SMALLEST_STEP = 0.02  # of the current's range: a smaller one has no direction


def actuator_trial(trial: Trial, settings: ActuatorAnalysis) -> Analysis:
    """Filter one canonical trial, and fit Eqs. 1-2.

    Parameters
    ----------
    trial
        Its motion is theta_m [rad] of the actuator's output, or omega_m [rad/s] if the bench logs
        no angle; the torque is torque_m [N*m], the current I_q [A].
    settings
        How it is analysed.

    Raises
    ------
    InputError
        A signal is missing, or the actuator hardly moves. The message names the trial.
    IdentifiabilityError
        The motion cannot tell two parameters apart.
    """
    moved = next((name for name in ("theta_m", "omega_m") if name in trial.columns), None)
    trial.check_columns("current", "torque_m")
    with naming(f"trial {trial.name}"):
        time, current, *motion = trial.signals("current", *([moved] if moved else []))
        levels = plateaus_of(time, current)
        of_shaft = motion[0] if motion else None
        if is_clamped(time, current, levels, of_shaft, moved == "theta_m", SLOWEST):
            return clamped_of(trial, settings, levels)
        if moved is None:
            raise InputError(
                "the actuator's motion is not recorded, and its current has fewer than"
                f" {FEWEST_PARTS} plateaus of 0.3 s or more",
                "drive the actuator and name theta_m or omega_m in the source file, or step the"
                " current more often",
            )
        signals = uniform_signals(trial, (moved, "current", "torque_m"), settings)
        fit = actuator_of(signals, settings, moved)
        if signals.is_decided:
            return fit
        return replace(fit, other=actuator_of(signals.with_other_reading(), settings, moved))


def actuator_of(signals: UniformSignals, settings: ActuatorAnalysis, moved: str) -> Analysis:
    """The fit to uniform signals.

    The velocity's sign is tanh(omega_m/sign_width), taken before the filter, so that the column
    smears friction's jumps as the torque does. f_G can be told from k_tau n_m only if the current
    both drives and brakes: else sign(omega_m) |I_q| equals I_q. The drift is the torque
    transducer's; left in the residual, it would quadruple the standard error of f_G.
    """
    measured = signals.signals["torque_m"]
    current = signals.signals["current"]
    check_changes("torque_m", measured)
    usable, time, rate = signals.usable, signals.time, signals.rate_hz
    low_pass = settings.low_pass
    raw = signals.signals[moved]
    smooth = differentiate(time, low_pass(raw, rate))
    omega = smooth.omega
    alpha = smooth.alpha
    if moved == "omega_m":
        omega = smooth.theta
        alpha = smooth.omega

    is_fast = np.abs(omega) > SLOWEST
    direction = np.tanh(omega / settings.sign_width)
    columns = {
        "k_tau_n_m": low_pass(current, rate),
        "f_C": -low_pass(direction, rate),
        "f_G": -low_pass(direction * np.abs(current), rate),
        "B_m": -omega,
        "J_m": -alpha,
        **offset_and_drift(time),
    }
    # below it friction may have any value up to its limit
    moving = is_fast & usable
    edge = int(np.ceil(ACTUATOR_EDGE_PERIODS * rate / settings.cutoff_hz))
    moving[:edge] = moving[-edge:] = False
    fitted = np.flatnonzero(moving)
    if len(fitted) < FEWEST_MOVING_S * rate:
        raise InputError(
            f"the actuator is faster than {SLOWEST:g} rad/s in {len(fitted)} of {len(time)}"
            f" samples, and its current has fewer than {FEWEST_PARTS} plateaus",
            "drive it faster or longer, or check the unit of theta_m or omega_m in the source file",
        )
    record = Record(
        name=signals.trial,
        time=time,
        theta=raw,
        torque=measured,
        motion=Motion(smooth.theta, omega, alpha),
        filtered_torque=low_pass(measured, rate),
        usable=usable,
        groups=blocks_of(runs(moving), rate),
        rate_hz=rate,
        signals=signals,
        settings=settings,
        actuator={moved: raw},
    )
    check_prompt(columns, record.filtered_torque, moving, rate)
    return fit_all_groups(record, ACTUATOR_ALONE, gram_sums(record, columns))


def check_prompt(
    columns: Mapping[str, Array], torque: Array, moving: NDArray[np.bool_], rate_hz: float
) -> None:
    """Refuse a late or early current, which makes the torque per current too small, or negative
    like a wrong sign. By correlations: what the torque (n,) in the rows `moving` gains from the
    current at each lag beside the motion's columns."""
    torque = np.where(moving, torque, 0.0)
    names = ("f_C", "B_m", "J_m", "one", "ramp")
    of_motion = np.zeros((len(names), len(torque)))
    of_motion[:, moving] = np.linalg.qr(np.array([columns[name][moving] for name in names]).T)[0].T
    left = torque - of_motion.T @ (of_motion @ torque)
    current = columns["k_tau_n_m"]
    at_lags = partial(scipy.signal.correlate, mode="same")  # half of the rows overlap, or more
    in_motion = np.array([at_lags(column, current) for column in of_motion])
    own = at_lags(moving.astype(float), current**2) - np.sum(in_motion**2, axis=0)
    unexplained = left @ left - at_lags(left, current) ** 2 / own
    lags = scipy.signal.correlation_lags(len(torque), len(torque), mode="same")
    lag = -lags[np.argmin(unexplained)]
    if unexplained.min() < FAR_BETTER * unexplained[lags == 0]:
        way, late = ("earlier", "current") if lag > 0 else ("later", "torque_m")
        size = f"{1e3 * abs(lag) / rate_hz:.0f} ms"
        raise InputError(
            f"the current fits the torque far better {size} {way}",
            f"state `delay: {size}` of {late} in the source file",
        )


def clamped_of(trial: Trial, settings: ActuatorAnalysis, levels: list[slice]) -> Analysis:
    """k_tau n_m of an actuator at rest with a stepped current.

    Its mean torque in each plateau of the current, which are the interval's units, is k_tau n_m I_q
    - T s + offset + drift. T is the friction that lags behind steps up (s = 1) and down (s = -1);
    without it k_tau n_m would absorb it. T and drift are left out if all steps go one way. Behind a
    pause a step comes from 0, since the drive may have been off.

    Raises
    ------
    InputError
        The torque is constant.
    IdentifiabilityError
        The plateaus do not tell k_tau n_m from friction and offset.
    """
    time, current, torque = trial.signals("current", "torque_m")
    check_changes("torque_m", torque)
    means = np.array([current[level].mean() for level in levels])
    between = [np.diff(time[a.stop - 1 : b.start + 1]) for a, b in pairwise(levels)]
    is_pause = np.array([steps.max() > settings.time_base.longest_gap_s for steps in between])
    steps = means - np.append(0.0, np.where(is_pause, 0.0, means[:-1]))
    # a start at 0 has no direction
    way = np.where(np.abs(steps) > SMALLEST_STEP * np.ptp(means), np.sign(steps), 0.0)

    rows = np.concatenate([np.r_[level] for level in levels])
    counts = np.array([level.stop - level.start for level in levels])
    time = time[rows]
    columns = {
        "k_tau_n_m": np.repeat(means, counts),
        "hysteresis": np.repeat(-way, counts),
        **offset_and_drift(time),
    }
    model = {"k_tau_n_m": "k_tau_n_m", "offset": "one"}
    if {-1.0, 1.0} <= set(way):
        model |= {"hysteresis": "hysteresis", "drift": "ramp"}

    stops = np.cumsum(counts).astype(float)
    still = np.zeros_like(time)
    of_plateaus = np.repeat([torque[level].mean() for level in levels], counts)
    record = Record(
        name=trial.name,
        time=time,
        theta=still,
        torque=of_plateaus,
        motion=Motion(still, still, still),
        filtered_torque=of_plateaus,
        usable=np.ones(len(time), dtype=bool),
        groups=unlike_groups(stops - counts, stops),
        rate_hz=(len(time) - 1) / float(time[-1] - time[0]),
        settings=settings,
    )
    return fit_all_groups(record, model, gram_sums(record, columns))


def actuator_table(actuator: Analysis) -> dict[str, pl.DataFrame]:
    """The trial's row of `actuator.csv`, what an actuator at rest does not tell is null, and its
    rows of `budget.csv`."""
    told = [name for name in ACTUATOR_PARAMETERS if name in actuator.whole.names]
    row: Row = {
        "trial": actuator.record.name,
        "motion": next(iter(actuator.record.actuator), None),
        "VAF": actuator.whole.vaf,
    }
    budgets = {
        name: budget.plus(*other_stamps(actuator, name))
        for name, budget in actuator.budgets(None, *told).items()
    }
    return fit_tables("actuator", (row, budgets))


def with_faults(analysis: Analysis, budgets: Mapping[str, Budget], s: Sums) -> dict[str, Budget]:
    """The losses of a whole trial with what friction and a weight, which acts as a spring, change,
    and what a fault would."""
    joint = inferred_of_joint(analysis.record)
    stated = stated_models(analysis.record)
    weight = with_effects(s, TRANSMISSION, "theta")
    others = {"B_j": budgets["B_j_viscous"].value, "J_j": budgets["J_j"].value}
    if weight.certain("theta"):
        others["J_j"] = weight["J_j"]
    complete = {}
    for k, (name, source) in enumerate(PROPERTIES_OF_LOSSES.items(), start=1):
        half = abs(budgets[name].value - others[name]) / 2
        complete[name] = budgets[name].plus(
            Contribution(source, half, basis="measured", part="motion"),
            *other_stamps(analysis, name),
            *alternatives(joint, stated, k, budgets[name].value),
        )
    if ModelName.DELAY not in stated:
        of_delay = unknown(Source.LATE_TORQUE, "ms", J_j=1e-3 * budgets["B_j"].value)
        complete["J_j"] = complete["J_j"].plus(of_delay["J_j"])
    return complete


def transmission_table(analysis: Analysis) -> dict[str, pl.DataFrame]:
    """The trial's rows of `transmission.csv`, one per amplitude [deg] and one for all of them
    (amplitude null), and of `budget.csv`.

    A late torque reduces J_j by B_j times the lag, and leaves a third derivative of the angle,
    which shows it."""
    record = analysis.record
    s = sums_of(record)
    without = coulomb_fit(s, analysis).without
    fits = []
    for label in analysis.fits:
        budgets = analysis.budgets(label, *LOSSES)
        row: Row = {
            **analysis.place(label),
            **analysis.diagnostics(label),
            "load_cell_drift": 60 * analysis.whole["drift"],
        }
        if label is None:
            viscous: LinearFit = without or analysis.calibrated[label]
            budgets["B_j_viscous"] = viscous.budget("B_j")
            budgets |= with_faults(analysis, budgets, s)
            row["T_C"] = without["T_C"] if without else None
        fits.append((row, budgets))
    return fit_tables("transmission", *fits)
