"""The actuator alone on its bench (Eqs. 1-2), turning or clamped."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.analysis import Analysis, analysed
from osl_analysis.bench.bench_settings import ActuatorAnalysis
from osl_analysis.bench.effects import Model
from osl_analysis.bench.group_sums import gram_sums
from osl_analysis.bench.plausibility import check_changes
from osl_analysis.bench.record import Record
from osl_analysis.bench.row_groups import Groups, Stratum, stretches_of
from osl_analysis.errors import Change, InputError, naming
from osl_analysis.signals import Motion, differentiate, runs
from osl_analysis.signals.grid import UniformSignals, uniform_signals
from osl_analysis.stats.regression import (
    INTERVAL_ENDS,
    Row,
    covariance_row,
    estimates_row,
    without,
)
from osl_analysis.trial import Array, Trial

ACTUATOR_PARAMETERS = ("k_tau_n_m", "f_C", "f_G", "B_m", "J_m")
"""Torque per current k_tau n_m [N*m/A], Coulomb friction [N*m], gear friction [N*m/A], damping,
inertia."""
ACTUATOR_ALONE: Model = {
    **{name: name for name in ACTUATOR_PARAMETERS},
    "offset": "one",
    "drift": "ramp",
}
"""torque_m = k_tau n_m I_q - f - B_m omega_m - J_m alpha_m + offset + drift (Eqs. 1-2)"""
FEWEST_MOVING_S = 1.0  # s; shortest total duration of the fitted samples
EDGE_PERIODS = 3.0  # of the cut-off at both ends, where the filter extrapolates
SOUGHT_LAGS_S = np.arange(-60, 61) / 200  # s; of the current behind the torque
FAR_BETTER = 0.5  # of what is left of the torque, with the current at another time
MOST_TRIED = 10_000  # rows of the search for a late current
FEWEST_LEVELS = 8  # fewest plateaus of the current, the interval's leave-one-out units
LEVEL_S = 0.05  # s; averaging time of the current in the search for plateaus
LEVEL_CHANGE = 0.02  # of the current's range, by which means of a plateau differ at most
SHORTEST_LEVEL = 5  # changes between such means: a plateau of 0.3 s
SETTLING, ENDING = 3, 1  # means left out: the torque settles, and the filter spreads the next step
SLIDES = 0.7  # of the median of the torque's steps per step of the current: friction has reversed
WITH_LOAD = 1.5  # times the fewest plateaus, to tell T_G beside T


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
    motion = [name for name in ("theta_m", "omega_m") if name in trial.samples.columns]
    signals = uniform_signals(trial, (*motion[:1], "current", "torque_m"), settings.gap_limits)
    with naming(f"trial {trial.name}"):
        found = actuator_of(signals, settings)
        other = signals.other()
        if other is not None:
            found = replace(found, fits_with_other_stamps=actuator_of(other, settings).fits)
    return found


def actuator_of(signals: UniformSignals, settings: ActuatorAnalysis) -> Analysis:
    """The fit to uniform signals.

    The velocity's sign is tanh(omega_m/sign_width), taken before the filter, so that the column
    smears friction's jumps as the torque does. f_G can be told from k_tau n_m only if the current
    both drives and brakes: else sign(omega_m) |I_q| equals I_q. The drift is the torque
    transducer's; left in the residual, it would quadruple the standard error of f_G.
    """
    measured, current = signals["torque_m"], signals["current"]
    check_changes("torque_m", measured)
    usable, time, rate = signals.usable, signals.time, signals.rate_hz
    low_pass = settings.low_pass
    moved = moved_by(signals)
    if moved is None or not np.ptp(signals[moved]):
        return stalled_of(signals, settings, levels_of(current, rate, usable))
    raw = signals[moved]
    smooth = differentiate(time, low_pass(raw, rate))
    omega, alpha = smooth.omega, smooth.alpha
    if moved == "omega_m":
        omega, alpha = smooth.theta, smooth.omega

    is_fast = np.abs(omega) > settings.slowest
    levels = levels_of(current, rate, usable & ~is_fast)
    rows_at_levels = sum(rows.stop - rows.start for rows in levels)
    if len(levels) >= FEWEST_LEVELS and np.count_nonzero(is_fast) < rows_at_levels:
        return stalled_of(signals, settings, levels)  # the shaft twitches between the steps

    direction = np.tanh(omega / settings.sign_width)
    columns = {
        "k_tau_n_m": low_pass(current, rate),
        "f_C": -low_pass(direction, rate),
        "f_G": -low_pass(direction * np.abs(current), rate),
        "B_m": -omega,
        "J_m": -alpha,
        "one": np.ones_like(time),
        "ramp": time - time.mean(),
    }
    # below the settings' slowest velocity friction may have any value up to its limit
    moving = is_fast & usable
    edge = int(np.ceil(EDGE_PERIODS * rate / settings.cutoff_hz))
    moving[:edge] = False
    moving[-edge:] = False
    if np.count_nonzero(moving) < FEWEST_MOVING_S * rate:
        raise InputError(
            f"the actuator is faster than {settings.slowest:g} rad/s in {np.count_nonzero(moving)}"
            f" of {len(time)} samples; drive it faster or longer, or check the unit of theta_m or"
            " omega_m in the source file"
        )
    record = Record(
        name=signals.trial,
        time=time,
        theta=raw,
        torque=measured,
        motion=Motion(smooth.theta, omega, alpha),
        filtered_torque=low_pass(measured, rate),
        low_pass=low_pass,
        usable=usable,
        groups=stretches_of(runs(moving), rate),
        uniform=signals,
        settings=settings,
    )
    found = analysed(record, gram_sums(record, columns, list(columns)), ACTUATOR_ALONE)
    fitted = np.flatnonzero(moving)
    check_prompt(columns, record.filtered_torque, fitted, rate, found.whole["k_tau_n_m"], moved)
    return found


def check_prompt(
    columns: Mapping[str, Array],
    torque: Array,
    moving: NDArray[np.intp],
    rate_hz: float,
    k_tau_n_m: float,
    moved: str,
) -> None:
    """Refuse a late or early current, which makes the torque per current too small, or negative
    like a wrong sign. `moved` is the column of the motion."""
    rows = moving[:: max(len(moving) // MOST_TRIED, 1)]
    others = [columns[name] for name in ("f_C", "B_m", "J_m", "one", "ramp")]
    beside = without(np.stack(others, axis=1)[rows])
    rest = beside(torque[rows])
    current = columns["k_tau_n_m"]
    shifted = [np.roll(current, -round(lag * rate_hz))[rows] for lag in SOUGHT_LAGS_S]
    tried = beside(np.stack(shifted, axis=1))

    along = rest @ tried
    slopes = along / np.sum(tried**2, axis=0)
    is_now = SOUGHT_LAGS_S == 0
    left = np.where(is_now | (slopes > 0), rest @ rest - slopes * along, np.inf)
    lag_s = float(SOUGHT_LAGS_S[np.argmin(left)])
    if left.min() < FAR_BETTER * left[is_now]:
        found = "negative" if k_tau_n_m < 0 else f"{k_tau_n_m:.3g} N*m/A"
        late = [("current",)] if lag_s > 0 else [("torque_m",), ("torque_m", moved)]
        delay = f"`delay: {1e3 * abs(lag_s):.0f} ms`"
        raise InputError(
            f"k_tau_n_m is {found}, and the current fits far better {1e3 * abs(lag_s):.0f} ms"
            f" {'earlier' if lag_s > 0 else 'later'}; measure the delays of the channels",
            [
                Change(
                    f"state {delay} of {' and '.join(columns)} in the source file",
                    delays=dict.fromkeys(columns, abs(lag_s)),
                )
                for columns in late
            ],
        )


def levels_of(current: Array, rate_hz: float, usable: NDArray[np.bool_]) -> list[slice]:
    """Rows of the plateaus of a stepped current (n,) [A].

    Its means over `LEVEL_S` stay within 2 % of its range for 0.3 s or more. The first 0.15 s, where
    the torque settles, and the last 0.1 s, into which the filter spreads the steps, are left out.
    """
    each = max(round(LEVEL_S * rate_hz), 1)
    whole = len(current) // each * each
    means = current[:whole].reshape(-1, each).mean(axis=1)
    is_usable = np.asarray(usable[:whole].reshape(-1, each).all(axis=1))
    is_steady = np.abs(np.diff(means)) < LEVEL_CHANGE * np.ptp(current)
    both_usable = is_usable[1:] & is_usable[:-1]
    found = []
    for run in runs(np.asarray(both_usable & is_steady)):
        if run.stop - run.start >= SHORTEST_LEVEL:
            found.append(slice((run.start + SETTLING) * each, (run.stop - ENDING) * each))
    return found


def stalled_of(
    signals: UniformSignals, settings: ActuatorAnalysis, levels: list[slice]
) -> Analysis:
    """k_tau n_m of an actuator at rest with a stepped current.

    Its torque in the plateaus (`levels_of`), which are the interval's units, is k_tau n_m I_q - (T
    + T_G |I_q|) s + offset + drift. T and T_G are the friction that lags behind steps up (s = 1)
    and down (s = -1); without them k_tau n_m would absorb it. They are left out if all steps go one
    way.
    """
    low_pass, rate, current = settings.low_pass, signals.rate_hz, signals["current"]
    torque = signals["torque_m"]
    if len(levels) < FEWEST_LEVELS:
        raise InputError(
            f"the actuator stands, and its current has {len(levels)} plateaus of 0.3 s or more,"
            f" {FEWEST_LEVELS} are needed; step the current up and down, or drive the actuator and"
            " name theta_m or omega_m in the source file"
        )
    means = np.array([current[rows].mean() for rows in levels])
    torques = np.array([torque[rows].mean() for rows in levels])
    way, has_slid = steps_of_levels(means, torques, float(np.ptp(current)))
    tells_load = int(has_slid.sum()) >= WITH_LOAD * FEWEST_LEVELS
    if not tells_load:
        has_slid[:] = True
    levels = [rows for rows, is_used in zip(levels, has_slid, strict=True) if is_used]
    means = means[has_slid]

    side = np.zeros_like(current)
    for rows, up in zip(levels, way[has_slid], strict=True):
        side[rows] = -up
    of_current = low_pass(current, rate)
    columns = {
        "k_tau_n_m": of_current,
        "hysteresis": side,
        "one": np.ones_like(current),
        "load_hysteresis": side * np.abs(of_current),
        "ramp": signals.time - signals.time.mean(),
    }
    model = {"k_tau_n_m": "k_tau_n_m", "offset": "one"}
    goes_both_ways = np.ptp(np.sign(np.diff(means))) > 0
    if goes_both_ways:
        model["hysteresis"] = "hysteresis"
        if tells_load:
            model["load_hysteresis"] = "load_hysteresis"
        model["drift"] = "ramp"

    groups = Groups(
        "stretches",
        np.array([float(rows.start) for rows in levels]),
        np.array([float(rows.stop) for rows in levels]),
        np.zeros(len(levels), dtype=np.intp),
        (Stratum(slice(levels[0].start, levels[-1].stop)),),
    )
    still = np.zeros_like(current)
    record = Record(
        name=signals.trial,
        time=signals.time,
        theta=still,
        torque=torque,
        motion=Motion(still, still, still),
        filtered_torque=low_pass(torque, rate),
        low_pass=low_pass,
        usable=signals.usable,
        groups=groups,
        uniform=signals,
        settings=settings,
    )
    return analysed(record, gram_sums(record, columns, list(model.values())), model)


def steps_of_levels(
    means: Array, torques: Array, range_of_current: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Direction (m,) of the step to each plateau, and whether friction has reversed by then: after
    a turn the torque stays constant until it has."""
    steps = np.diff(means, prepend=0.0)
    # a start at 0 has none
    way = np.where(np.abs(steps) > LEVEL_CHANGE * range_of_current, np.sign(steps), 0.0)
    sizes = np.maximum(np.abs(steps), np.finfo(float).tiny)
    follows = np.diff(torques, prepend=torques[0]) * way / sizes
    has_slid = (follows > SLIDES * np.median(follows)) | (way == 0)
    return way, has_slid


def moved_by(signals: UniformSignals) -> str | None:
    """The column of the actuator's motion; None if the bench logs none."""
    return next((name for name in ("theta_m", "omega_m") if name in signals.signals), None)


def actuator_table(actuator: Analysis) -> pl.DataFrame:
    """The trial's row of `actuator.csv`; what an actuator at rest does not tell is null."""
    fit, record = actuator.calibrated(actuator.whole), actuator.record
    assert record.uniform is not None
    told = [name for name in ACTUATOR_PARAMETERS if name in fit.names]
    slow = [name for name in ("offset", "drift") if name in fit.names]
    row: Row = {"trial": record.name, "motion": None}
    if "J_m" in told:
        row["motion"] = moved_by(record.uniform)
    for name in (*ACTUATOR_PARAMETERS, "offset", "drift"):
        for ending in INTERVAL_ENDS:
            row[f"{name}{ending}"] = None
    for first, second in combinations(ACTUATOR_PARAMETERS, 2):
        row[f"cov_{first}_{second}"] = None
    row.update(estimates_row(fit, *told, *slow))
    row.update(covariance_row(fit, *told))
    for name in ACTUATOR_PARAMETERS:
        row[f"{name}_se_bench"] = fit.se_bench(name) if name in told else None
    row.update(actuator.judged())
    row["correlation_k_f_G"] = fit.correlation("k_tau_n_m", "f_G") if "f_G" in told else None
    row.update(actuator.time_base_row(None, told))
    table = pl.DataFrame(
        [row], schema_overrides={"motion": pl.String, "time_base_shift": pl.Float64}
    )
    return table.with_columns(pl.col(pl.Null).cast(pl.Float64))
