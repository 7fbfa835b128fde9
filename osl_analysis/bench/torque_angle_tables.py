"""The tables of torque against angle: a row per trial, per cycle, and per branch and angle."""

import numpy as np
import polars as pl

from osl_analysis.bench.analysis import timebase_table
from osl_analysis.bench.torque_angle import (
    TorqueAngleTrial,
    analysed,
    joined,
    loop_at,
    may_be_left,
    moving,
    rest_change,
    secant,
    straight_line,
)
from osl_analysis.errors import InputError
from osl_analysis.stats.regression import variance_accounted_for
from osl_analysis.stats.repeats import CommonError, over_repeats
from osl_analysis.trial import Array

BRANCHES = ("loading", "unloading")
OTHER_SPEED = 1.3
"""Ratio of the speeds of the fastest and slowest cycle from which on they say whether torque depends on speed."""
TEXTS = ("interval_method", "desired", "not_checked")  # columns of a trial's row that hold text and may be empty
SMALLER = "smaller_cycles, whole but smaller than the largest, are not analysed: record each amplitude as its own trial"
"""Said of a trial with cycles of several amplitudes."""
LEFT = (
    "whether the torque at rest is the load cell's offset or what hysteresis leaves in the device (zero_off_middle): "
    "torque_min, torque_max, energy_stored and energy_returned depend on it"
)
"""Said of a zero that lies on a branch of the loop."""
OVER_CYCLES = ("K", "K_secant", "K_unloading", "energy_stored", "energy_returned", "energy_lost")
"""Columns of the table of cycles of which the trial's row has mean and interval."""


def cycle_table(trial: TorqueAngleTrial) -> pl.DataFrame:
    """The trial's rows of `torque_angle_cycles.csv`: one per cycle."""
    theta, torque, rows = trial.theta, trial.torque, []
    durations, loading, unloading = trial.durations(), trial.pieces(0), trial.pieces(1)
    for k, (cycle, energy) in enumerate(zip(trial.cycles.used, trial.energies(), strict=True)):
        path = float(np.abs(np.diff(theta[[cycle.start, *cycle.turns, cycle.stop]])).sum())
        rows.append(
            {
                "trial": trial.name,
                "cycle": k + 1,
                "start_s": float(trial.time[cycle.start]),
                "stop_s": float(trial.time[cycle.stop]),
                "duration_s": float(durations[k]),
                "speed_deg_s": float(np.rad2deg(path) / durations[k]),
                "K": straight_line(theta, torque, loading[k]),
                "K_secant": secant(theta, torque, joined(loading[k])),
                "K_unloading": straight_line(theta, torque, unloading[k]),
                "energy_stored": energy.stored,
                "energy_returned": energy.returned,
                "energy_lost": energy.lost,
                "closure_angle": float(abs(theta[cycle.stop] - theta[cycle.start]) / np.ptp(theta)),
                "closure_torque": float(abs(torque[cycle.stop] - torque[cycle.start]) / np.ptp(torque)),
            }
        )
    return pl.DataFrame(rows)


def torque_angle_table(trial: TorqueAngleTrial, desired: str | None = None) -> pl.DataFrame:
    """The trial's row of `torque_angle.csv`; `desired` is the name of the curve that it should follow.

    Intervals are those of the mean over cycles (Student), with the error of the bench's stiffness where it is stated;
    null with one cycle.

    Raises InputError: The settings have no such curve.
    """
    cycles = cycle_table(trial)
    bench = trial.settings.bench_stiffness
    softer = None  # the cycles with a bench that is softer by one standard error
    if bench is not None and bench.compliance_error:
        softer = cycle_table(analysed(trial.uniform, trial.settings, bench.compliance + bench.compliance_error))
    loading, unloading = trial.curves
    moved, torque = trial.theta[moving(trial.theta)], trial.torque
    measured, model = trial.modelled()
    widest = float(np.nanmax(np.abs(loading.torque - unloading.torque)))
    stored, returned = (cycles[name].to_numpy() for name in ("energy_stored", "energy_returned"))
    row: dict[str, float | str | None] = {
        "trial": trial.name,
        "cycles": len(cycles),
        "settled_cycles": trial.cycles.settled,
        "smaller_cycles": trial.cycles.smaller,
        "partial_cycles": trial.cycles.partial,
        "loading": "rising" if trial.cycles.loading > 0 else "falling",
        "angle_min_deg": float(np.rad2deg(moved.min())),
        "angle_max_deg": float(np.rad2deg(moved.max())),
        "bench_angle_min_deg": float(np.rad2deg(trial.bench_theta.min())),
        "bench_angle_max_deg": float(np.rad2deg(trial.bench_theta.max())),
        "torque_min": float(torque.min()),
        "torque_max": float(torque.max()),
        **zero_row(trial, widest),
        **{key: value for name in OVER_CYCLES for key, value in mean_over_cycles(name, cycles, softer).items()},
        "K_uncorrected": float(
            np.mean([straight_line(trial.bench_theta, torque, pieces) for pieces in trial.pieces(0)])
        ),
        "K_lowest": float(np.nanmin(loading.stiffness)),
        "K_highest": float(np.nanmax(loading.stiffness)),
        "returned_share": float(np.sum(returned) / np.sum(stored)),
        "hysteresis_torque": widest,
        "interval_method": "cycles" if len(cycles) > 1 else None,
        "VAF": variance_accounted_for(measured, measured - model),
        "speed_deg_s": float(np.mean(cycles["speed_deg_s"].to_numpy())),
        "shortest_cycle_s": float(trial.durations().min()),
        "closure_angle": float(cycles["closure_angle"].to_numpy().max()),
        "closure_torque": float(cycles["closure_torque"].to_numpy().max()),
        "cycle_drift": cycle_drift(trial),
        "rate_change": rate_change(cycles),
        "bridged_share": bridged_share(trial),
        **desired_row(trial, desired),
    }
    empty = {name: pl.String if name in TEXTS else pl.Float64 for name, value in row.items() if value is None}
    return pl.DataFrame([row], schema_overrides=empty)


def zero_row(trial: TorqueAngleTrial, widest: float) -> dict[str, float | str | None]:
    """The torque taken for zero, and what speaks against it; the loop is `widest` [N*m] at its widest."""
    torque, zero, settings = trial.torque, trial.zero, trial.settings
    rest = float(np.rad2deg(trial.theta[0 if settings.zero == "start" else -1]))
    loop = loop_at(rest, trial.angle_deg, *(curve.torque for curve in trial.curves))
    stated = settings.zero == "none"
    left = not stated and may_be_left(zero, loop, widest, float(np.ptp(torque)))
    reasons = [*([SMALLER] if trial.cycles.smaller else []), *([LEFT] if left else [])]
    return {
        "torque_zero": zero,
        "zero_off_middle": None if stated or loop is None else -loop.middle,
        "rest_change": rest_change(trial.bench_theta, torque, trial.uniform.rate_hz, settings),
        "not_checked": "; ".join(reasons) or None,
    }


def mean_over_cycles(name: str, cycles: pl.DataFrame, softer: pl.DataFrame | None) -> dict[str, float | None]:
    """Mean of a column over the cycles with standard error and bounds of its 95 % interval; null with one cycle."""
    values = cycles[name].to_numpy()
    if len(values) < 2:
        return {name: float(values[0]), **dict.fromkeys((f"{name}_se", f"{name}_low", f"{name}_high"))}
    change = 0.0 if softer is None else float(softer[name].to_numpy().mean() - values.mean())
    found = over_repeats(values, [CommonError(change**2, np.inf)] if change else [])
    return {name: found.mean, f"{name}_se": found.se, f"{name}_low": found.low, f"{name}_high": found.high}


def cycle_drift(trial: TorqueAngleTrial) -> float | None:
    """Change of torque at the same angles from the first cycle to the last, as a part of its range; None for one."""
    torques = trial.curves[0].torques
    return float(np.nanmean(torques[-1] - torques[0]) / np.ptp(trial.torque)) if len(torques) > 1 else None


def rate_change(cycles: pl.DataFrame) -> float | None:
    """Relative change of the energy lost from the slowest cycle to the fastest; None where their speeds are alike."""
    speed, lost = cycles["speed_deg_s"].to_numpy(), cycles["energy_lost"].to_numpy()
    if speed.max() < OTHER_SPEED * speed.min():
        return None
    slope = np.polyfit(np.log(speed), lost, 1)[0]
    return float(slope * np.log(speed.max() / speed.min()) / abs(lost.mean()))


def bridged_share(trial: TorqueAngleTrial) -> float:
    """Share of the rows of the cycles in gaps of the recording, or near them, where signals are interpolated."""
    return float(np.mean(~np.concatenate([trial.uniform.usable[cycle.rows] for cycle in trial.cycles.used])))


def desired_row(trial: TorqueAngleTrial, desired: str | None) -> dict[str, float | str | None]:
    """Distance [N*m] of the mean of both branches from the desired curve, RMS over its angles; null without one."""
    if desired is None:
        return {"desired": None, "desired_rms": None}
    wanted = desired_torque(trial, desired)
    middle = (trial.curves[0].torque + trial.curves[1].torque) / 2
    return {"desired": desired, "desired_rms": float(np.sqrt(np.nanmean((middle - wanted) ** 2)))}


def desired_torque(trial: TorqueAngleTrial, desired: str) -> Array:
    """Torque (m,) [N*m] of a desired curve at the angles of the grid; NaN beyond its ends; raises as the table."""
    curves = trial.settings.desired
    if desired not in curves:
        raise InputError(
            f"trial {trial.name}: no desired curve '{desired}'; torque_angle.desired in the configuration has "
            f"{', '.join(curves) or 'none'}"
        )
    return curves[desired].at(trial.angle_deg)


def curve_table(trial: TorqueAngleTrial, desired: str | None = None) -> pl.DataFrame:
    """The trial's rows of `torque_angle_curves.csv`: per branch and angle; raises as `torque_angle_table`."""
    wanted = np.full(len(trial.angle_deg), np.nan) if desired is None else desired_torque(trial, desired)
    frames = []
    for branch, curve in zip(BRANCHES, trial.curves, strict=True):
        columns = {
            "angle_deg": trial.angle_deg,
            "torque": curve.torque,
            "torque_low": curve.torque - curve.torque_half,
            "torque_high": curve.torque + curve.torque_half,
            "stiffness": curve.stiffness,
            "stiffness_low": curve.stiffness - curve.stiffness_half,
            "stiffness_high": curve.stiffness + curve.stiffness_half,
            "desired_torque": wanted,
        }
        texts = {"trial": pl.lit(trial.name), "branch": pl.lit(branch), "desired": pl.lit(desired, pl.String)}
        frames.append(pl.DataFrame(columns).fill_nan(None).with_columns(**texts))
    order = ("trial", "branch", *frames[0].columns[:-3], "desired")
    return pl.concat(frames).select(order)


def torque_angle_time_base(trial: TorqueAngleTrial) -> pl.DataFrame:
    """The trial's rows of `timebase.csv`."""
    return timebase_table(trial.uniform, None, trial.settings.bench_stiffness)
