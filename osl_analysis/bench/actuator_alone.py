"""The actuator alone on its bench (Eqs. 1-2), turning or clamped."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.analysis import Analysis, analysed
from osl_analysis.bench.bench_settings import ActuatorAnalysis
from osl_analysis.bench.effects import Model
from osl_analysis.bench.motion import stretches_of
from osl_analysis.bench.plausibility import check_changes
from osl_analysis.bench.record import Groups, Record, Stratum
from osl_analysis.bench.regression import gram_sums
from osl_analysis.dictionary import table_of
from osl_analysis.errors import InputError, naming
from osl_analysis.signals import Motion, differentiate, runs
from osl_analysis.signals.grid import UniformSignals, uniform_signals
from osl_analysis.signals.plateaus import FEWEST_PLATEAUS, is_clamped, plateaus_of
from osl_analysis.stats.linear_fit import without
from osl_analysis.stats.table_rows import Row, estimates_row
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
SMALLEST_STEP = 0.02  # of the current's range: a smaller one has no direction
HIGHEST_CUTOFF = 0.4  # of the sampling rate
SHORTEST_PAUSE = 1e-6  # s, beyond rounding of times
SHORTENED = 0.8  # of the longest bridged gap, to which longer pauses are shortened


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
    columns = (*motion[:1], "current", "torque_m")
    trial.check_columns(*columns)
    with naming(f"trial {trial.name}"):
        # pauses of the logger, in which a clamped actuator shows nothing, are shortened, so that
        # one grid bridges them
        longest_s = settings.gap_limits.longest_s
        recorded_time = trial.arrays()[0]
        steps = np.diff(recorded_time)
        excess = np.where(steps > longest_s, steps - SHORTENED * longest_s, 0.0)
        time = recorded_time - np.append(0.0, np.cumsum(excess))
        shortened = trial.samples.with_columns(time=pl.Series(time))
        gapless = Trial(trial.name, shortened, trial.provenance) if excess.any() else trial
        signals = uniform_signals(gapless, columns, settings.gap_limits)
        levels = levels_of(signals, settings.slowest)
        if levels:
            of_log = np.interp(signals.time, time, recorded_time)
            return clamped_of(signals, settings, levels, of_log)
        if excess.any():
            signals = uniform_signals(trial, columns, settings.gap_limits)  # says which gap
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
        count = len(plateaus_of(time[usable], current[usable]))
        raise InputError(
            f"the actuator stands, and its current has {count} plateaus of 0.3 s or more,"
            f" {FEWEST_PLATEAUS} are needed; drive the actuator and name theta_m or omega_m in the"
            " source file, or step the current up and down more often"
        )
    raw = signals[moved]
    smooth = differentiate(time, low_pass(raw, rate))
    omega, alpha = smooth.omega, smooth.alpha
    if moved == "omega_m":
        omega, alpha = smooth.theta, smooth.omega

    is_fast = np.abs(omega) > settings.slowest
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
        late = "current" if lag_s > 0 else f"torque_m, or of torque_m and {moved},"
        raise InputError(
            f"k_tau_n_m is {found}, and the current fits far better {1e3 * abs(lag_s):.0f} ms"
            f" {'earlier' if lag_s > 0 else 'later'}; state `delay: {1e3 * abs(lag_s):.0f} ms` of"
            f" {late} in the source file"
        )


def levels_of(signals: UniformSignals, slowest: float) -> list[slice]:
    """Rows of the plateaus of a clamped actuator's current; none if it is driven, or has too
    few."""
    kept = np.flatnonzero(signals.usable)
    time, current = signals.time[kept], signals["current"][kept]
    moved = moved_by(signals)
    motion = None if moved is None else signals[moved][kept]
    levels = plateaus_of(time, current)
    if not is_clamped(time, current, levels, motion, moved == "theta_m", slowest):
        return []
    return [slice(int(kept[rows.start]), int(kept[rows.stop - 1]) + 1) for rows in levels]


def clamped_of(
    signals: UniformSignals,
    settings: ActuatorAnalysis,
    levels: list[slice],
    time: Array,
) -> Analysis:
    """k_tau n_m of an actuator at rest with a stepped current.

    Its torque in the plateaus (`levels_of`), which are the interval's units, is k_tau n_m I_q - T s
    + offset + drift. T is the friction that lags behind steps up (s = 1) and down (s = -1); without
    it k_tau n_m would absorb it. T and drift are left out if all steps go one way. Behind a pause a
    step comes from 0, since the drive may have been off. `time` (n,) [s] is the log's, with its
    pauses. When stamps were taken matters to no plateau.

    Raises
    ------
    InputError
        The torque is constant.
    IdentifiabilityError
        The plateaus do not tell k_tau n_m from friction and offset.
    """
    current, torque = signals["current"], signals["torque_m"]
    # a plateau is no motion: a log of few rows per second shows it as well
    cutoff_hz = min(settings.cutoff_hz, HIGHEST_CUTOFF * signals.rate_hz)
    low_pass = replace(settings.low_pass, cutoff_hz=cutoff_hz)
    check_changes("torque_m", torque)
    means = np.array([current[rows].mean() for rows in levels])
    starts = [rows.start for rows in levels]
    pauses = np.diff(time[starts]) - np.diff(signals.time[starts])
    before = np.append(0.0, np.where(pauses > SHORTEST_PAUSE, 0.0, means[:-1]))
    steps = means - before
    # a start at 0 has no direction
    way = np.where(np.abs(steps) > SMALLEST_STEP * np.ptp(means), np.sign(steps), 0.0)

    side = np.zeros_like(current)
    for rows, up in zip(levels, way, strict=True):
        side[rows] = -up
    # a mean at each plateau: noise of single rows would lower k_tau n_m
    of_current = low_pass(current, signals.rate_hz)
    for rows in levels:
        of_current[rows] = of_current[rows].mean()
    columns = {
        "k_tau_n_m": of_current,
        "hysteresis": side,
        "one": np.ones_like(current),
        "ramp": time - time.mean(),
    }
    model = {"k_tau_n_m": "k_tau_n_m", "offset": "one"}
    goes_both_ways = {-1.0, 1.0} <= set(way.tolist())
    if goes_both_ways:
        model["hysteresis"] = "hysteresis"
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
        time=time,
        theta=still,
        torque=torque,
        motion=Motion(still, still, still),
        filtered_torque=low_pass(torque, signals.rate_hz),
        low_pass=low_pass,
        usable=signals.usable,
        groups=groups,
        uniform=signals,
        settings=settings,
    )
    return analysed(record, gram_sums(record, columns, list(model.values())), model)


def moved_by(signals: UniformSignals) -> str | None:
    """The column of the actuator's motion; None if the bench logs none."""
    return next((name for name in ("theta_m", "omega_m") if name in signals.signals), None)


def actuator_table(actuator: Analysis) -> pl.DataFrame:
    """The trial's row of `actuator.csv`; what an actuator at rest does not tell is null."""
    fit, record = actuator.calibrated(actuator.whole), actuator.record
    assert record.uniform is not None
    told = [name for name in ACTUATOR_PARAMETERS if name in fit.names]
    row: Row = {
        "trial": record.name,
        "motion": moved_by(record.uniform) if "J_m" in told else None,
        **estimates_row(fit, *told),
        **actuator.beside_estimates(None, *told),
        **actuator.time_base_row(None, told),
    }
    return table_of([row], "actuator", complete=True)
