"""The components of the drivetrain, each alone on its bench: belt (Fig. 3), transmission (Eq. 4),
actuator (Eqs. 1-2).

A component consists of its equation's columns and of the groups of rows where this holds.
Regression, interval and diagnostics are those of every record (gram.py, analysis.py)."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench import effects
from osl_analysis.bench.analysis import (
    Analysis,
    analysed,
    check_changes,
    check_stiffer,
    torque_errors,
    widened,
)
from osl_analysis.bench.coulomb import CoulombFit, coulomb_fits
from osl_analysis.bench.effects import TRANSMISSION, Model
from osl_analysis.bench.gram import GroupFit, estimates_of, fit_groups, gram_sums
from osl_analysis.bench.groups import Groups, Label, Stratum, stretches_of
from osl_analysis.bench.joint_fit import (
    LOSSES_SYMBOLS,
    Estimate,
    estimate_columns,
    misfit_columns,
)
from osl_analysis.bench.joint_inference import misfit_of_losses
from osl_analysis.bench.record import Record, joint_angle
from osl_analysis.bench.settings import ActuatorAnalysis, BeltAnalysis
from osl_analysis.errors import InputError, naming
from osl_analysis.model.drivetrain import DrivetrainParameters, belt_deflection
from osl_analysis.signals import Motion, differentiate, filtered_motion, runs
from osl_analysis.signals.grid import BRIDGE_MORE, UniformSignals, uniform_signals
from osl_analysis.stats.regression import Row, covariance_row, estimates_row, without
from osl_analysis.stats.repeats import summary_of_trials
from osl_analysis.trial import Array, Trial

PLACE = ("joint", "side")
LOSSES = ("B_j", "J_j")
ACTUATOR_PARAMETERS = ("k_tau_n_m", "f_C", "f_G", "B_m", "J_m")
"""Torque per current k_tau n_m [N*m/A], Coulomb friction [N*m], gear friction [N*m/A], damping,
inertia."""
SUMMARISED = {
    "belt": ("K_s", "unloading", "hysteresis_area", "quadratic_K_s2"),
    "transmission": (*LOSSES, "VAF", "T_C", "VAF_coulomb"),
    "actuator": (*ACTUATOR_PARAMETERS, "VAF"),
}
"""Columns of each part's table for which a summary has mean, scatter and interval over the
trials."""


def part_summary(part: str, table: pl.DataFrame) -> pl.DataFrame:
    """Summary of the fits to whole trials in `belt.csv`, `transmission.csv` or `actuator.csv`,
    separately for each joint and side, which have columns."""
    whole = (
        table.filter(pl.col("amplitude_deg").is_null())
        if "amplitude_deg" in table.columns
        else table
    )
    parts = whole.partition_by(PLACE, maintain_order=True)
    found = [
        own.select(PLACE).head(1).join(summary_of_trials(own, SUMMARISED[part]), how="cross")
        for own in parts
    ]
    return pl.concat(found, how="vertical_relaxed")


def belt_trial(trial: Trial, p: DrivetrainParameters | None, settings: BeltAnalysis) -> Analysis:
    """Filter and fit one canonical trial. Without parameters (None) the ratio n_T is not known: the
    shaft must rest. Raises InputError, IdentifiabilityError: as `branches_of` and `fit_groups`, or
    the bench is softer than the belt."""
    signals = uniform_signals(trial, ("theta", "theta_m", "torque"), settings.gap_limits)
    other, bench = signals.other(), settings.bench_stiffness
    with naming(f"trial {trial.name}"):
        belt = belt_of(signals, p, settings)
        if bench is not None:  # the error of its stiffness enters the intervals as type B
            softer = belt_of(signals, p, settings, bench.compliance_error).fits
            fits = {
                x: widened(fit, softer[x].estimates - fit.estimates, shared=True)
                for x, fit in belt.fits.items()
            }
            belt = replace(belt, fits=fits)
        return belt if other is None else replace(belt, others=belt_of(other, p, settings).fits)


def belt_of(
    signals: UniformSignals,
    p: DrivetrainParameters | None,
    settings: BeltAnalysis,
    more_compliance: float = 0.0,
) -> Analysis:
    """The fits to uniform signals; the bench is softer than its settings by `more_compliance`
    [rad/(N*m)]."""
    low_pass, rate, bench = settings.low_pass, signals.rate_hz, settings.bench_stiffness
    check_changes("torque", signals["torque"])
    theta = joint_angle(
        signals["theta"], signals["torque"], (bench.compliance if bench else 0.0) + more_compliance
    )
    if p is None:
        check_locked(low_pass(theta, rate), low_pass(signals["theta_m"], rate))
    deflection = theta if p is None else belt_deflection(theta, signals["theta_m"], p)
    motion, torque = filtered_motion(signals.time, deflection, signals["torque"], low_pass)
    groups = branches_of(motion.theta, rate, signals.usable, low_pass.cutoff_hz)
    raw = deflection, signals["torque"], motion, torque
    both = *raw, low_pass, signals.usable, groups
    record = Record(signals.trial, signals.time, *both, uniform=signals, settings=settings)
    belt = fit_branches(record, settings.load_cell_drift / 60)
    check_stiffer(signals.trial, "K_s", belt.whole["K_s"], bench)
    return belt


def fit_branches(record: Record, drift: float = 0.0) -> Analysis:
    """Fit one load-unload cycle, whose groups are those of `branches_of` and whose angle is the
    belt's deflection. `loading` stands for the trial: a straight line `K_s` and `offset`, with the
    joint's damping `B_j` if the velocity varies. `unloading` is the same; `quadratic` adds `K_s2`
    [N*m/rad^2] times theta_s |theta_s| while loading.

    The load cell's drift has the standard deviation `drift` [N*m/s]. A line cannot tell drift from
    stiffness, and no scatter shows it: it enters the intervals as type B (JCGM 100:2008, 4.3)."""
    motion = record.motion
    x = motion.theta - motion.theta[0]
    columns = {"theta": x, "omega": motion.omega, "one": np.ones_like(x), "square": x * np.abs(x)}
    columns["ramp"] = record.time - record.time.mean()
    s = gram_sums(record, columns, ["theta", "omega", "one", "square"])
    # On a raised cosine damping and curvature are collinear, so that the quadratic belt has no
    # damping.
    quadratic: Model = {"K_s": "theta", "K_s2": "square", "offset": "one"}
    models: dict[str, tuple[Model, Label]] = {"quadratic": (quadratic, "loading")}
    # Without its column B_j omega shifts K_s by 0.12 N*m/rad on a raised cosine, because loading
    # begins at a velocity and ends at rest. A constant velocity makes a constant torque, which the
    # offset contains.
    for way in ("loading", "unloading"):
        velocity = motion.omega[record.rows(way)]
        constant = float(np.std(velocity)) <= 0.05 * abs(float(np.mean(velocity)))
        models[way] = (
            {"K_s": "theta", "offset": "one"} | ({} if constant else {"B_j": "omega"}),
            way,
        )
    fits: dict[Label, GroupFit] = {}
    for name, (model, label) in models.items():
        taken = estimates_of(s.over(label), s.index(list(model.values())), s.names.index("ramp"))
        found = widened(fit_groups(s, model, label), drift * taken)
        fits[name] = (
            replace(found, interval_method=f"{found.interval_method} + drift") if drift else found
        )
    return Analysis(record, s, models["loading"][0], fits, {}, "loading")


def branches_of(
    theta_s: Array, rate_hz: float, usable: NDArray[np.bool_], cutoff_hz: float
) -> Groups:
    """Stretches of loading and unloading of a deflection theta_s (n,) [rad] in usable rows: about
    sixteen per branch, whose scatter gives its interval. Raises InputError: as `loaded_rows`, or a
    branch is empty."""
    onset, peak, release = loaded_rows(theta_s - theta_s[0])
    found = []
    for label, rows in (("loading", slice(onset, peak + 1)), ("unloading", slice(peak, release))):
        inside = np.zeros(len(theta_s), dtype=np.bool_)
        inside[rows] = usable[rows]
        if not inside.any():
            raise InputError(
                f"no row while {label} is free of gaps that are too long to be bridged;"
                f" {BRIDGE_MORE}"
            )
        seconds = max((rows.stop - rows.start) / rate_hz / 16, 0.5 / cutoff_hz)
        found.append(stretches_of(runs(inside), rate_hz, seconds, label))
    first, stop = (
        np.concatenate([getattr(one, edge) for one in found]) for edge in ("first", "stop")
    )
    number = np.repeat([0, 1], [len(one.first) for one in found])
    return Groups("stretches", first, stop, number, tuple(one.strata[0] for one in found))


def loaded_rows(deflection: Array) -> tuple[int, int, int]:
    """Rows of one load-unload cycle: onset of loading, peak, and the row after unloading. Loading
    begins at 5 % of the peak, since the belt's hysteresis reverses below. Raises InputError: the
    belt hardly deflects, is not unloaded again, or is loaded more than once."""
    peak = int(np.argmax(np.abs(deflection)))
    if abs(deflection[peak]) < np.deg2rad(0.5):
        raise InputError(
            f"the belt deflects by {np.rad2deg(abs(deflection[peak])):.3f} deg at most, expected"
            " 0.5 deg or more; check the angle channels and their units in the source file"
        )
    loaded = np.abs(deflection) >= 0.05 * abs(deflection[peak])
    onset = int(np.argmax(loaded))
    release = len(loaded) - int(np.argmax(loaded[::-1]))
    if release - peak < 10 or release == len(loaded):
        raise InputError("the trial ends while the belt is still loaded; record the way back too")
    way = deflection[onset : peak + 1] * np.sign(deflection[peak])
    fall = float(np.max(np.maximum.accumulate(way) - way))
    if fall > 0.2 * abs(float(way[-1])):
        raise InputError(
            f"the belt falls back by {np.rad2deg(fall):.2f} deg before its peak of"
            f" {np.rad2deg(abs(way[-1])):.2f} deg: this is no single loading; check that the trial"
            " is of experiment 'belt'"
        )
    return onset, peak, release


def check_locked(theta: Array, theta_m: Array) -> None:
    """Refuse a shaft that turns if n_T is not known: its share of the deflection is unknown. Angles
    are (n,) [rad]. A turn below 1 % of the joint's counts as rest: K_s is off by 1 % at most."""
    turned, whole = float(np.ptp(theta_m)), float(np.ptp(theta))
    if turned > 0.01 * whole:
        raise InputError(
            f"theta_m turns by {turned:.3g} rad while theta turns by {whole:.3g} rad, and without a"
            " parameter file its ratio n_T to the joint is not known; lock the shaft, or name a"
            " parameter file under `parameters` in the configuration"
        )


def belt_table(belt: Analysis) -> pl.DataFrame:
    """The trial's row of `belt.csv`: slopes of loading and unloading, loop area [J], quadratic
    belt. `energy_lost` is the loop's area over the energy K_s theta_s^2/2 at the peak. `stiffening`
    is the relative increase of the quadratic belt's slope from rest to the peak."""
    ways = {"loading": "loading", "unloading": "unloading", "quadratic": "loading"}
    loading, unloading, quadratic = (
        belt.calibrated(belt.fits[name], way) for name, way in ways.items()
    )
    record, theta, torque = belt.record, belt.record.motion.theta, belt.record.filtered_torque
    peak, area = (
        float(np.max(np.abs(belt.sums.columns["theta"]))),
        float(np.trapezoid(torque, theta)),
    )
    errors = np.trapezoid(
        torque_errors(torque, record.rate_hz, record.rows(), record.calibration), theta
    )
    of_area = float(np.hypot(area * record.calibration.polar(0.0)[0], np.linalg.norm(errors)))
    damped = "B_j" in loading.names
    row: Row = {
        "trial": belt.record.name,
        **estimates_row(loading, "K_s", "offset"),
        **covariance_row(loading, "K_s", "offset"),
        "K_s_se_bench": loading.se_bench("K_s"),
        **(
            estimates_row(loading, "B_j")
            if damped
            else dict.fromkeys(("B_j", "B_j_se", "B_j_low", "B_j_high"))
        ),
        **belt.judged("loading"),
        "unloading": unloading["K_s"],
        "unloading_se": unloading.se("K_s"),
        "unloading_se_bench": unloading.se_bench("K_s"),
        "hysteresis_area": area,
        "hysteresis_area_se_bench": of_area,
        "quadratic_K_s": quadratic["K_s"],
        "quadratic_K_s2": quadratic["K_s2"],
        "quadratic_K_s2_se": quadratic.se("K_s2"),
        "quadratic_K_s2_se_bench": quadratic.se_bench("K_s2"),
        "quadratic_VAF": quadratic.vaf,
        "energy_lost": area / (loading["K_s"] * peak**2 / 2),
        "shaft_turn": shaft_turn(belt.record),
        "stiffening": 2 * quadratic["K_s2"] * peak / quadratic["K_s"],
        **belt.time_base_row("loading", ["K_s"]),
    }
    return pl.DataFrame([row])


def shaft_turn(record: Record) -> float | None:
    """Turn of the actuator's shaft per turn of the joint, while the belt is loaded; None without a
    file."""
    if record.uniform is None:
        return None
    rows = record.rows("loading")
    return float(np.polyfit(record.uniform["theta"][rows], record.uniform["theta_m"][rows], 1)[0])


def belt_curve(belt: Analysis) -> pl.DataFrame:
    """Deflection [deg] and torque [N*m] from rest, by branch, for Fig. 3: 50 points per second."""
    record = belt.record
    step = slice(None, None, max(round(record.rate_hz / 50.0), 1))
    theta_s, torque = record.motion.theta[step], record.filtered_torque[step]
    deflection = np.rad2deg(theta_s - theta_s[0])
    branch = np.where(
        np.arange(len(theta_s)) <= np.argmax(np.abs(deflection)), "loading", "unloading"
    )
    shown = {
        "trial": record.name,
        "branch": branch,
        "theta_s_deg": deflection,
        "torque": torque - torque[0],
    }
    return pl.DataFrame(shown)


def belt_figure_points(
    curves: pl.DataFrame, table: pl.DataFrame, summary: pl.DataFrame
) -> pl.DataFrame:
    """The numbers of Fig. 3 for each joint and side: the curves (`belt_curve`) with their
    `deviation` of torque [N*m] from the mean slope, and why a fit is doubtful; the mean slope as
    two points, from 0 to the largest deflection, with the loops' mean area [J]. `table` is
    `belt.csv`, `summary` its summary."""
    found = []
    marked_curves = curves.join(
        table.select("trial", *PLACE, "doubtful"), "trial", how="left", maintain_order="left"
    )
    bounds = {"": "mean", "_low": "low", "_high": "high"}
    for one in marked_curves.partition_by(PLACE, maintain_order=True):
        place = one.select(PLACE).head(1)
        means = {
            row["quantity"]: row for row in summary.join(place, PLACE, nulls_equal=True).to_dicts()
        }
        numbers = {
            f"{x}{end}": pl.lit(means[x][of], pl.Float64)
            for x in ("K_s", "hysteresis_area")
            for end, of in bounds.items()
        }
        slope, deflection = means["K_s"]["mean"] * np.pi / 180, one["theta_s_deg"]
        ends = np.array([0.0, deflection[int(np.argmax(deflection.abs().to_numpy()))]])
        line = pl.DataFrame(
            {
                "trial": "mean slope",
                "branch": "loading",
                "theta_s_deg": ends,
                "torque": slope * ends,
            }
        )
        line = line.join(place, how="cross").with_columns(**numbers)
        found += [
            one.with_columns(deviation=pl.col("torque") - slope * pl.col("theta_s_deg")),
            line,
        ]
    return pl.concat(found, how="diagonal")


def transmission_of(record: Record) -> Analysis:
    """Losses with the motor detached, Eq. 4 with theta_s = 0, fitted to a stepped sine; raises as
    `analysed`."""
    return analysed(record, effects.plain_sums(record, TRANSMISSION), TRANSMISSION)


def transmission_table(analysis: Analysis) -> pl.DataFrame:
    """The trial's rows of `transmission.csv`: one per amplitude [deg], and one for all of them
    (amplitude null).

    A late torque reduces J_j by B_j times the lag, and leaves a third derivative of the angle,
    which shows it."""
    record, s = analysis.record, effects.sums_of(analysis.record, TRANSMISSION)
    repeats = effects.repeats_row(record, s, TRANSMISSION)
    del repeats["K_drift"]  # losses have no stiffness
    friction = coulomb_fits(s, analysis)
    misfit = misfit_of_losses(record)
    rows = list[Row]()
    for label, fit in analysis.fits.items():
        beside_friction = effects.with_effects(s, TRANSMISSION, ("T_C",), label)
        weight = effects.with_effects(s, TRANSMISSION, ("weight",), label)
        taken = 0.0
        if weight.certain("weight", effects.FALSE_ALARM):
            taken = 1 - fit["J_j"] / weight["J_j"]
        rows.append(
            {
                **analysis.row(label, *LOSSES),
                **losses_friction_columns(
                    friction.get(label), analysis.calibrated(beside_friction, label)
                ),
                **estimates_row(analysis.calibrated(weight, label), "weight"),
                "J_j_weightless": weight["J_j"],
                "weight_share": taken,
                "B_j_coulomb": beside_friction["B_j"],
                "VAF_coulomb": beside_friction.vaf,
                **analysis.shared(label, *LOSSES),
                **repeats,
                **misfit_columns(misfit, LOSSES_SYMBOLS),
                "VAF_in_band": misfit.VAF_held_out if misfit else None,
                "delay_told_s": misfit.delay_told_s if misfit else None,
            }
        )
    texts = dict.fromkeys(("fault", "fault_family", "explanations"), pl.String)
    table = pl.DataFrame(rows, infer_schema_length=None, schema_overrides=texts)
    return table.with_columns(pl.col(pl.Null).cast(pl.Float64))


def losses_friction_columns(coulomb: CoulombFit | None, beside: GroupFit) -> Row:
    """The columns of friction beside losses; `beside` is the model with friction, certain or
    not."""
    certain = coulomb.certain if coulomb else None
    viscous = Estimate.of_fit(certain, "B_j") if certain is not None else None
    size = Estimate.of_fit(beside if certain is None else certain, "T_C")
    return {
        **size.columns("T_C"),
        "T_C_se_bench": beside.se_bench("T_C"),
        "coulomb_torque": coulomb.torque if coulomb else None,
        "coulomb_damping": coulomb.damping if coulomb else None,
        "coulomb_share": coulomb.share if coulomb else None,
        **estimate_columns("B_j_viscous", viscous),
    }


ACTUATOR_ALONE: Model = {
    **{name: name for name in ACTUATOR_PARAMETERS},
    "offset": "one",
    "drift": "drift",
}
"""torque_m = k_tau n_m I_q - f - B_m omega_m - J_m alpha_m + offset + drift (Eqs. 1-2)"""
FEWEST_MOVING_S = 1.0  # shortest total duration [s] of the fitted samples


def actuator_trial(trial: Trial, settings: ActuatorAnalysis) -> Analysis:
    """Filter one canonical trial, and fit Eqs. 1-2. The motion is theta_m [rad] of the actuator's
    output, or omega_m [rad/s] if the bench logs no angle; the torque is torque_m [N*m], the current
    I_q [A]. Raises InputError: a signal is missing, or the actuator hardly moves;
    IdentifiabilityError: the motion cannot tell two parameters apart. The message names the
    trial."""
    moved = [name for name in ("theta_m", "omega_m") if name in trial.samples.columns][:1]
    uniform = uniform_signals(trial, (*moved, "current", "torque_m"), settings.gap_limits)
    with naming(f"trial {trial.name}"):
        found, other = actuator_of(uniform, settings), uniform.other()
        return found if other is None else replace(found, others=actuator_of(other, settings).fits)


def actuator_of(signals: UniformSignals, settings: ActuatorAnalysis) -> Analysis:
    """The fit to uniform signals. The velocity's sign is tanh(omega_m/sign_width), taken before the
    filter, so that the column smears friction's jumps as the torque does. f_G can be told from
    k_tau n_m only if the current both drives and brakes: else sign(omega_m) |I_q| equals I_q. The
    drift is the torque transducer's; left in the residual, it would quadruple the standard error of
    f_G."""
    check_changes("torque_m", signals["torque_m"])
    moved, usable, time = moved_by(signals), signals.usable, signals.time
    low_pass, rate, current = settings.low_pass, signals.rate_hz, signals["current"]
    if moved is None or not np.ptp(signals[moved]):
        return stalled_of(signals, settings, levels_of(current, rate, usable))
    raw = signals[moved]
    smooth = differentiate(time, low_pass(raw, rate))
    omega, alpha = (
        (smooth.theta, smooth.omega) if moved == "omega_m" else (smooth.omega, smooth.alpha)
    )
    direction, fast = np.tanh(omega / settings.sign_width), np.abs(omega) > settings.slowest
    levels = levels_of(current, rate, usable & ~fast)
    if len(levels) >= FEWEST_LEVELS and np.count_nonzero(fast) < sum(
        rows.stop - rows.start for rows in levels
    ):
        return stalled_of(signals, settings, levels)  # the shaft twitches between the steps
    columns = {
        "k_tau_n_m": low_pass(current, rate),
        "f_C": -low_pass(direction, rate),
        "f_G": -low_pass(direction * np.abs(current), rate),
        "B_m": -omega,
        "J_m": -alpha,
        "one": np.ones_like(time),
        "drift": time - np.mean(time),
    }
    # away from the ends, where the filter extrapolates, and above the settings' slowest velocity:
    # below it friction may have any value up to its limit
    moving, edge = fast & usable, int(np.ceil(3 * rate / settings.cutoff_hz))
    moving[:edge] = moving[-edge:] = False
    if np.count_nonzero(moving) < FEWEST_MOVING_S * rate:
        raise InputError(
            f"the actuator is faster than {settings.slowest:g} rad/s in {np.count_nonzero(moving)}"
            f" of {len(time)} samples; drive it faster or longer, or check the unit of theta_m or"
            " omega_m in the source file"
        )
    measured, groups = signals["torque_m"], stretches_of(runs(moving), rate)
    filtered = Motion(smooth.theta, omega, alpha), low_pass(measured, rate)
    both = raw, measured, *filtered, low_pass, usable, groups
    record = Record(signals.trial, time, *both, uniform=signals, settings=settings)
    found = analysed(record, gram_sums(record, columns, list(columns)), ACTUATOR_ALONE)
    check_prompt(columns, filtered[1], np.flatnonzero(moving), rate, found.whole["k_tau_n_m"])
    return found


def check_prompt(
    columns: Mapping[str, Array],
    torque: Array,
    moving: NDArray[np.intp],
    rate_hz: float,
    k_tau_n_m: float,
) -> None:
    """Refuse a late or early current, which makes the torque per current too small, or negative
    like a wrong sign."""
    moving, lags = moving[:: max(len(moving) // 10_000, 1)], np.arange(-60, 61) / 200
    beside = without(
        np.stack([columns[name] for name in ("f_C", "B_m", "J_m", "one", "drift")], axis=1)[moving]
    )
    y = beside(torque[moving])
    shifted = beside(
        np.stack(
            [np.roll(columns["k_tau_n_m"], -round(lag * rate_hz))[moving] for lag in lags], axis=1
        )
    )
    slopes = (along := y @ shifted) / np.sum(shifted**2, axis=0)
    left = np.where((lags == 0) | (slopes > 0), y @ y - slopes * along, np.inf)
    lag = float(lags[np.argmin(left)])
    if left.min() < 0.5 * left[lags == 0]:
        found = "negative" if k_tau_n_m < 0 else f"{k_tau_n_m:.3g} N*m/A"
        raise InputError(
            f"k_tau_n_m is {found}, and the current fits far better {1e3 * abs(lag):.0f} ms"
            f" {'earlier' if lag > 0 else 'later'}; state `delay: {1e3 * lag:.0f} ms` of the"
            " current in the source file"
        )


INTERVAL_ENDS = ("", "_se", "_low", "_high")  # suffixes of the columns of an estimate
FEWEST_LEVELS = 8  # fewest plateaus of the current, the interval's leave-one-out units
LEVEL_S = 0.05  # averaging time [s] of the current in the search for plateaus


def levels_of(current: Array, rate_hz: float, usable: NDArray[np.bool_]) -> list[slice]:
    """Rows of the plateaus of a stepped current (n,) [A]: its means over `LEVEL_S` stay within 2 %
    of its range for 0.3 s or more. The first 0.15 s, where the torque settles, and the last 0.1 s,
    into which the filter spreads the steps, are left out."""
    each = max(round(LEVEL_S * rate_hz), 1)
    means = current[: len(current) // each * each].reshape(-1, each).mean(axis=1)
    good = np.asarray(usable[: len(means) * each].reshape(-1, each).all(axis=1))
    steady = np.asarray(good[1:] & good[:-1] & (np.abs(np.diff(means)) < 0.02 * np.ptp(current)))
    return [
        slice((run.start + 3) * each, (run.stop - 1) * each)
        for run in runs(steady)
        if run.stop - run.start >= 5
    ]


def stalled_of(
    signals: UniformSignals, settings: ActuatorAnalysis, levels: list[slice]
) -> Analysis:
    """k_tau n_m of an actuator at rest with a stepped current. Its torque in the plateaus
    (`levels_of`), which are the interval's units, is k_tau n_m I_q - (T + T_G |I_q|) s + offset +
    drift. T and T_G are the friction that lags behind steps up (s = 1) and down (s = -1); without
    them k_tau n_m would absorb it. They are left out if all steps go one way."""
    low_pass, rate, current = settings.low_pass, signals.rate_hz, signals["current"]
    if len(levels) < FEWEST_LEVELS:
        raise InputError(
            f"the actuator stands, and its current has {len(levels)} plateaus of 0.3 s or more,"
            f" {FEWEST_LEVELS} are needed; step the current up and down, or drive the actuator and"
            " name theta_m or omega_m in the source file"
        )
    means, torques = (
        np.array([x[rows].mean() for rows in levels]) for x in (current, signals["torque_m"])
    )
    steps, side = np.diff(means, prepend=0.0), np.zeros_like(current)
    # a start at 0 has none
    way = np.where(np.abs(steps) > 0.02 * np.ptp(current), np.sign(steps), 0.0)
    # after a turn the torque stays constant until friction has reversed
    follows = (
        np.diff(torques, prepend=torques[0]) * way / np.maximum(np.abs(steps), np.finfo(float).tiny)
    )
    slid = (follows > 0.7 * np.median(follows)) | (way == 0)
    # to tell T_G beside T; with fewer, all levels are used
    enough = int(slid.sum()) >= 1.5 * FEWEST_LEVELS
    slid |= not enough
    levels, means = [rows for rows, one in zip(levels, slid, strict=True) if one], means[slid]
    for rows, up in zip(levels, way[slid], strict=True):
        side[rows] = -up
    columns = {
        "k_tau_n_m": low_pass(current, rate),
        "hysteresis": side,
        "one": np.ones_like(current),
    }
    columns["load_hysteresis"] = side * np.abs(columns["k_tau_n_m"])
    columns["drift"] = signals.time - signals.time.mean()
    both_ways = (
        ("hysteresis", *["load_hysteresis"] * enough, "drift")
        if np.ptp(np.sign(np.diff(means)))
        else ()
    )
    model: Model = {"k_tau_n_m": "k_tau_n_m", "offset": "one", **{name: name for name in both_ways}}
    groups = Groups(
        "stretches",
        np.array([float(rows.start) for rows in levels]),
        np.array([float(rows.stop) for rows in levels]),
        np.zeros(len(levels), dtype=np.intp),
        (Stratum(slice(levels[0].start, levels[-1].stop)),),
    )
    still, torque, usable = np.zeros_like(current), signals["torque_m"], signals.usable
    filtered = Motion(still, still, still), low_pass(torque, rate)
    record = Record(
        signals.trial,
        signals.time,
        still,
        torque,
        *filtered,
        low_pass,
        usable,
        groups,
        uniform=signals,
    )
    return analysed(record, gram_sums(record, columns, list(model.values())), model)


def moved_by(signals: UniformSignals) -> str | None:
    """The column of the actuator's motion; None if the bench logs none."""
    return next((name for name in ("theta_m", "omega_m") if name in signals.signals), None)


def actuator_table(actuator: Analysis) -> pl.DataFrame:
    """The trial's row of `actuator.csv`."""
    fit, record = actuator.calibrated(actuator.whole), actuator.record
    assert record.uniform is not None
    told = [name for name in ACTUATOR_PARAMETERS if name in fit.names]
    row = {
        "trial": record.name,
        "motion": moved_by(record.uniform) if "J_m" in told else None,
        **dict.fromkeys(
            f"{name}{end}"
            for name in (*ACTUATOR_PARAMETERS, "offset", "drift")
            for end in INTERVAL_ENDS
        ),
        **{f"cov_{a}_{b}": None for a, b in combinations(ACTUATOR_PARAMETERS, 2)},
        **estimates_row(fit, *told, *(name for name in ("offset", "drift") if name in fit.names)),
        **covariance_row(fit, *told),
        **{
            f"{name}_se_bench": fit.se_bench(name) if name in told else None
            for name in ACTUATOR_PARAMETERS
        },
        **actuator.judged(),
        "correlation_k_f_G": fit.correlation("k_tau_n_m", "f_G") if "f_G" in told else None,
        **actuator.time_base_row(None, told),
    }
    table = pl.DataFrame(
        [row], schema_overrides={"motion": pl.String, "time_base_shift": pl.Float64}
    )
    return table.with_columns(pl.col(pl.Null).cast(pl.Float64))
