"""Tables of torque against angle: a row per trial, per cycle, and per angle of the curves."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.analysis import torque_errors
from osl_analysis.bench.bench_settings import NOT_STATED
from osl_analysis.bench.branch_curve import NORMAL_QUANTILE, straight_line
from osl_analysis.bench.loop_cycles import Cycle, between_rests
from osl_analysis.bench.torque_angle import (
    TorqueAngleTrial,
    duration_s,
    torque_angle_of,
    zero_row,
)
from osl_analysis.dictionary import table_of
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.stats.table_rows import Row
from osl_analysis.table import Places
from osl_analysis.trial import Array

WITH_INTERVAL = (
    *("K", "K_secant", "K_unloading"),
    *("energy_stored", "energy_returned", "energy_lost"),
)
"""Estimates of a cycle whose mean over cycles has an interval."""
SPEED_RANGE = 1.3  # fastest over slowest loop, below which their speeds do not tell a change
# finite difference of the zero, as a share of the range of torque, from which the effect of the
# zero on energies is taken
ZERO_SHIFT = 0.01
REPEATED_K, REPEATED_RANGE = 0.03, 0.02
"""Differences of K and of the ends of the range, as shares, within which trials repeat one
another."""


@dataclass(frozen=True)
class LoopCycle:
    """What one cycle gives; its fields are columns of `torque_angle_cycles.csv`."""

    cycle: int  # number, from 1
    start_s: float
    stop_s: float
    duration_s: float  # without rests before and after the motion
    speed_deg_s: float  # mean speed
    K: float  # slope of the loading branch by least squares over angle [N*m/rad]
    K_secant: float  # slope between the ends of the loading branch [N*m/rad]
    K_unloading: float  # slope of the unloading branch [N*m/rad]
    energy_stored: float  # taken from the bench [J]
    energy_returned: float  # given back to it [J]
    energy_lost: float  # the difference [J]
    energy_per_ms: float  # what each ms by which the torque is late takes off `energy_lost` [J]
    closure_angle: float  # distance between the cycle's ends over its range
    closure_torque: float


def loop_cycles(trial: TorqueAngleTrial) -> list[LoopCycle]:
    """Measure slopes and energies of every cycle."""
    return [
        measured_cycle(trial, number, cycle, loading, unloading)
        for number, (cycle, loading, unloading) in enumerate(
            zip(
                trial.cycles.analysed,
                trial.loading.pieces,
                trial.unloading.pieces,
                strict=True,
            ),
            start=1,
        )
    ]


def measured_cycle(
    trial: TorqueAngleTrial,
    number: int,
    cycle: Cycle,
    loading: Sequence[slice],
    unloading: Sequence[slice],
) -> LoopCycle:
    """Slopes and energies of a cycle, of which `loading` and `unloading` are the rows."""
    theta, torque, time = trial.theta, trial.torque, trial.uniform.time
    angle, load = theta[cycle.all_rows], torque[cycle.all_rows]
    seconds = duration_s(trial, cycle)
    path = float(np.abs(np.diff(theta[[*cycle.rows]])).sum())
    turns = [row - cycle.start for row in cycle.rows]
    stored, returned = energies(angle, load, turns)
    loaded = np.r_[*loading]
    lowest, highest = loaded[np.argmin(theta[loaded])], loaded[np.argmax(theta[loaded])]
    # the loop's area changes by -dt times the integral of d(torque)/dt times d(theta)/dt
    step_s = float(time[1] - time[0])
    per_ms = 1e-3 * float(np.gradient(load) @ np.gradient(angle)) / step_s
    return LoopCycle(
        cycle=number,
        start_s=float(time[cycle.start]),
        stop_s=float(time[cycle.stop]),
        duration_s=seconds,
        speed_deg_s=float(np.rad2deg(path) / seconds),
        K=straight_line(theta, torque, loading),
        K_secant=float((torque[highest] - torque[lowest]) / (theta[highest] - theta[lowest])),
        K_unloading=straight_line(theta, torque, unloading),
        energy_stored=stored,
        energy_returned=returned,
        energy_lost=stored - returned,
        energy_per_ms=per_ms,
        closure_angle=float(abs(angle[-1] - angle[0]) / np.ptp(theta)),
        closure_torque=float(abs(load[-1] - load[0]) / np.ptp(torque)),
    )


def energies(angle: Array, load: Array, turns: Sequence[int]) -> tuple[float, float]:
    """Energies [J] that a cycle takes from the bench and returns: the integral of the torque
    `load` [N*m] over the angle [rad], (n,) each, by pieces.

    A piece ends where the angle turns or the torque changes sign, so that noise does not count as
    energy in both directions.
    """
    steps = (load[1:] + load[:-1]) / 2 * np.diff(angle)
    work = np.concatenate([[0.0], np.cumsum(steps)])
    sign_changes = np.flatnonzero(np.diff(np.signbit(load))) + 1
    of_pieces = np.diff(work[np.unique([*sign_changes, *turns])])
    return float(of_pieces[of_pieces > 0].sum()), float(-of_pieces[of_pieces < 0].sum())


def cycle_table(trial: TorqueAngleTrial) -> pl.DataFrame:
    """The trial's rows of `torque_angle_cycles.csv`: one per cycle."""
    name = trial.uniform.trial
    return pl.DataFrame([{"trial": name, **asdict(cycle)} for cycle in loop_cycles(trial)])


def over_cycles(cycles: Sequence[LoopCycle], quantity: str) -> Array:
    """One quantity of the cycles, (m,)."""
    return np.array([getattr(cycle, quantity) for cycle in cycles])


def torque_angle_table(trial: TorqueAngleTrial, desired: str | None = None) -> pl.DataFrame:
    """The trial's row of `torque_angle.csv`.

    Parameters
    ----------
    trial : TorqueAngleTrial
        The analysed trial.
    desired : str, optional
        Name of the curve that it should follow, of `torque_angle.desired` in the configuration.

    Returns
    -------
    pl.DataFrame
        One row. Intervals are of the mean over cycles (Student), with the errors of the bench; null
        with one cycle. `cycle_drift` is the change of torque at equal angles from the first cycle
        to the last; `rate_change` that of the energy lost from the slowest to the fastest.

    Raises
    ------
    InputError
        No such curve.
    """
    cycles = loop_cycles(trial)
    several = len(cycles) > 1
    speed_deg_s = over_cycles(cycles, "speed_deg_s")
    lost, per_ms = over_cycles(cycles, "energy_lost"), over_cycles(cycles, "energy_per_ms")
    with_speed = change_with_speed(speed_deg_s, lost, per_ms)

    loading = trial.loading.curve["torque"].to_numpy()
    unloading = trial.unloading.curve["torque"].to_numpy()
    widest = float(np.nanmax(np.abs(loading - unloading)))
    drift = float(np.nanmean(trial.loading.curve["change"].to_numpy()) / np.ptp(trial.torque))
    moved_deg = np.rad2deg(trial.theta[between_rests(trial.theta)])
    usable = np.concatenate(
        [trial.uniform.usable[cycle.all_rows] for cycle in trial.cycles.analysed]
    )
    stored = over_cycles(cycles, "energy_stored")
    row: Row = {
        "trial": trial.uniform.trial,
        "cycles": len(cycles),
        "settled_cycles": trial.cycles.settled,
        "smaller_cycles": trial.cycles.smaller,
        "partial_cycles": trial.cycles.partial,
        "loading": trial.cycles.loading,
        "angle_min_deg": float(moved_deg.min()),
        "angle_max_deg": float(moved_deg.max()),
        **zero_row(trial, widest),
        **change_by_zero_row(trial),
        **means_row(trial, cycles),
        "returned_share": float(np.sum(over_cycles(cycles, "energy_returned")) / np.sum(stored)),
        "interval_method": "cycles" if several else None,
        "VAF": trial.vaf(),
        "speed_deg_s": float(np.mean(speed_deg_s)),
        "closure_angle": max(cycle.closure_angle for cycle in cycles),
        "closure_torque": max(cycle.closure_torque for cycle in cycles),
        "cycle_drift": drift if several else None,
        "rate_change": with_speed.rate_change,
        "late_s": with_speed.late_s,
        "energy_per_ms": float(per_ms.mean()),
        "bridged_share": float(np.mean(~usable)),
        **desired_row(trial, desired),
    }
    return table_of([row], "torque_angle")


def change_by_zero_row(trial: TorqueAngleTrial) -> Row:
    """How energies change with the torque's zero [J per N*m], and what an assumed zero takes off
    the energy stored if the torque at rest is a load, as a share."""
    step = ZERO_SHIFT * float(np.ptp(trial.torque))
    row: Row = {}
    for name in ("energy_stored", "energy_returned"):
        higher, lower = over_shift(trial, name, -step), over_shift(trial, name, step)
        row[f"{name}_per_zero"] = float((higher - lower).mean() / (2 * step))
    row["assumed_zero_share"] = None
    if trial.settings.zero is None and trial.zero_at != "none":
        as_load = over_shift(trial, "energy_stored", trial.zero).mean()
        as_zero = over_shift(trial, "energy_stored", 0.0).mean()
        row["assumed_zero_share"] = float(as_load / as_zero - 1)
    return row


def over_shift(trial: TorqueAngleTrial, quantity: str, shift: float) -> Array:
    """A quantity of the cycles (m,) with the torque shifted [N*m]."""
    return over_cycles(loop_cycles(replace(trial, torque=trial.torque + shift)), quantity)


def means_row(trial: TorqueAngleTrial, cycles: Sequence[LoopCycle]) -> Row:
    """Means over the cycles with 95 % intervals, and the errors of the bench
    (`_se_bench`) that all cycles share."""
    changed = cycles_by_bench_errors(trial)
    gain_error = trial.settings.calibration.polar(0.0)[0]
    row: Row = {}
    for name in WITH_INTERVAL:
        values = over_cycles(cycles, name)
        mean = values.mean()
        changes = [over_cycles(others, name).mean() - mean for others in changed]
        shared = float(np.linalg.norm([gain_error * mean, *changes]))
        low = high = None
        if len(cycles) > 1:
            repeats = over_repeats(values, [(shared**2, np.inf)] if shared else [])
            low, high = repeats.low, repeats.high
        row[name] = float(mean)
        row[f"{name}_low"] = low
        row[f"{name}_high"] = high
        row[f"{name}_se_bench"] = shared
    return row


def cycles_by_bench_errors(trial: TorqueAngleTrial) -> list[list[LoopCycle]]:
    """The cycles as each error of the bench would change them, by one standard uncertainty: of the
    load cell's hysteresis and delay, and of the bench's stiffness."""
    settings = trial.settings
    analysed = trial.cycles.analysed
    moved = np.r_[analysed[0].start : analysed[-1].stop]
    errors = torque_errors(trial.torque, trial.uniform.rate_hz, moved, settings.calibration)
    changed = [
        loop_cycles(replace(trial, torque=trial.torque + error)) for error in errors if error.any()
    ]
    bench = settings.bench_stiffness
    if bench is not None and bench.compliance_error:
        softer = bench.compliance + bench.compliance_error
        changed.append(loop_cycles(torque_angle_of(trial.uniform, settings, softer)))
    return changed


def desired_row(trial: TorqueAngleTrial, desired: str | None) -> Row:
    """The name of the desired curve; `desired_ratio`, the slope of the branches' mean over its."""
    wanted = trial.desired_torque(desired)
    loading, unloading = (
        branch.curve["torque"].to_numpy() for branch in (trial.loading, trial.unloading)
    )
    middle = (loading + unloading) / 2
    both = np.isfinite(middle + wanted)
    ratio = None
    if np.count_nonzero(both) > 2:
        ratio = float(np.polyfit(wanted[both], middle[both], 1)[0])
    return {"desired": desired, "desired_ratio": ratio}


@dataclass(frozen=True)
class ChangeWithSpeed:
    """What loops of several speeds tell; None if their speeds are too near one another."""

    rate_change: float | None = None
    """Change of the energy lost from the slowest loop to the fastest, as a share of its mean."""
    late_s: float | None = None  # lateness of the torque that would make this change [s]


def change_with_speed(speed_deg_s: Array, lost: Array, per_ms: Array) -> ChangeWithSpeed:
    """Compare the energy lost [J] in loops (n,) of several speeds; each ms by which the torque is
    late takes `per_ms` [J] off it."""
    if speed_deg_s.max() < SPEED_RANGE * speed_deg_s.min():
        return ChangeWithSpeed()
    slope = np.polyfit(np.log(speed_deg_s), lost, 1)[0]
    change = slope * np.log(speed_deg_s.max() / speed_deg_s.min()) / abs(lost.mean())
    late_ms = -np.polyfit(per_ms, lost, 1)[0]
    return ChangeWithSpeed(float(change), float(1e-3 * late_ms))


def compared_with_repeats(table: pl.DataFrame, places: Places) -> pl.DataFrame:
    """The rows of `torque_angle.csv` of a campaign. Trials of one speed get `rate_change` and
    `late_s` from trials that repeat them: same joint, side and desired curve, K within 3 %, range
    within 2 %."""
    rows = table.to_dicts()
    for row in rows:
        if row["rate_change"] is not None:
            continue
        alike = [other for other in rows if repeats(row, other, places)]
        with_speed = change_with_speed(
            np.array([other["speed_deg_s"] for other in alike]),
            np.array([other["energy_lost"] for other in alike]),
            np.array([other["energy_per_ms"] for other in alike]),
        )
        row["rate_change"] = with_speed.rate_change
        row["late_s"] = with_speed.late_s
    types = dict.fromkeys(("rate_change", "late_s"), pl.Float64)
    return pl.DataFrame(rows, schema={**table.schema, **types})


def repeats(row: dict[str, Any], other: dict[str, Any], places: Places) -> bool:
    """Whether a trial repeats another one."""
    if places.get(other["trial"]) != places.get(row["trial"]):
        return False
    if other["desired"] != row["desired"]:
        return False
    span = row["angle_max_deg"] - row["angle_min_deg"]
    same_range = all(
        abs(other[end] - row[end]) < REPEATED_RANGE * span
        for end in ("angle_min_deg", "angle_max_deg")
    )
    return same_range and abs(other["K"] / row["K"] - 1) < REPEATED_K


def curve_table(trial: TorqueAngleTrial, desired: str | None = None) -> pl.DataFrame:
    """The trial's rows of `torque_angle_curves.csv`: per branch and angle; raises as
    `torque_angle_table`."""
    wanted = pl.Series("desired_torque", trial.desired_torque(desired))
    calibration = trial.settings.calibration
    hysteresis = calibration.slip * float(np.ptp(trial.torque))
    frames = []
    for name, branch in (("loading", trial.loading), ("unloading", trial.unloading)):
        frame = branch.curve.drop("change").with_columns(wanted).fill_nan(None)
        if calibration != NOT_STATED:
            gain_error = calibration.polar(0.0)[0]
            frame = widened(frame, "torque", gain_error, hysteresis)
            frame = widened(frame, "stiffness", gain_error, 0.0)
        frames.append(
            frame.select(
                pl.lit(trial.uniform.trial).alias("trial"),
                pl.lit(name).alias("branch"),
                pl.all(),
                pl.lit(desired, pl.String).alias("desired"),
            )
        )
    return pl.concat(frames)


def widened(frame: pl.DataFrame, name: str, gain_error: float, width: float) -> pl.DataFrame:
    """The curve with the load cell's standard uncertainties in an interval: of its gain, and of its
    hysteresis (`width`)."""
    value, high = pl.col(name), pl.col(f"{name}_high")
    known = (gain_error * value) ** 2 + width**2
    half = ((high - value) ** 2 + NORMAL_QUANTILE**2 * known).sqrt()
    return frame.with_columns(**{f"{name}_low": value - half, f"{name}_high": value + half})
