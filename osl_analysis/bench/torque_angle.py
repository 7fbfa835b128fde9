"""Torque against angle, quasi-static, of passive feet, springs and series elastic elements: cycles,
zero and curves.

The torque's zero and the deflection of the bench are subtracted first. A device with hysteresis
that comes to rest on its way keeps a torque of up to half the width of its loop. One recording
cannot tell this from an offset; a rest before the motion, or the loop around the rest, shows that
it may be present."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
import polars as pl
import scipy

from osl_analysis.bench.analysis import (
    Series,
    check_changes,
    check_stiffer,
    timebase_table,
    torque_errors,
)
from osl_analysis.bench.record import joint_angle
from osl_analysis.bench.settings import NOT_STATED, TorqueAngleAnalysis
from osl_analysis.errors import InputError, naming
from osl_analysis.signals.grid import UniformSignals, uniform_signals
from osl_analysis.stats.regression import CONDITION_LIMIT, Row, variance_accounted_for
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.table import Places
from osl_analysis.trial import Array, Trial

Cycle = tuple[int, ...]
"""Rows at which a closed cycle begins, turns and ends."""
CLOSED = 0.05  # largest distance between the ends of a cycle, as a share of the range of motion
RESTS = 0.01  # share of the range of motion within which the joint is at rest


@dataclass(frozen=True)
class TorqueAngleTrial:
    """One trial: filtered signals, shape (n,) each, cycles, and curves at the angles of the
    grid."""

    uniform: UniformSignals  # the signals on their time base
    settings: TorqueAngleAnalysis  # the choices of the analysis
    theta: Array  # angle of the joint [rad], without the deflection of the bench
    bench_theta: Array  # angle of the bench [rad]
    torque: Array  # resisting torque [N*m] from its zero
    zero: float  # torque [N*m] taken as zero
    facts: Row  # numbers of cycles left out, and direction of loading, as columns of the table
    cycles: list[Cycle]  # the analysed ones
    # rows of loading and unloading, by cycle and piece
    branches: tuple[list[list[slice]], list[list[slice]]]
    curves: tuple[pl.DataFrame, pl.DataFrame]  # loading and unloading, as `branch_curve`

    def series(self) -> Series:
        """Torque and its curve over angle in the rows of all cycles; the curve's end pieces are
        extrapolated."""
        model = np.full(len(self.theta), np.nan)
        for cycles, curve in zip(self.branches, self.curves, strict=True):
            at, y = curve["angle_deg"].to_numpy(), curve["torque"].to_numpy()
            # the curve may contain NaN
            line = scipy.interpolate.make_interp_spline(at, y, k=1, check_finite=False)
            for pieces in cycles:
                rows = np.r_[*pieces]
                model[rows] = line(np.rad2deg(self.theta[rows]))
        return Series(self.uniform.time, self.torque, model, self.theta, np.isfinite(model))

    def vaf(self) -> float:
        """VAF [percent] of the torque by its curve over angle, in the rows of all cycles."""
        series = self.series()
        torque = series.torque[series.fitted]
        return variance_accounted_for(torque, torque - series.torque_model[series.fitted])

    def time_base(self) -> pl.DataFrame:
        """The trial's rows of `timebase.csv`."""
        return timebase_table(self.uniform, None, self.settings.bench_stiffness)

    def desired_torque(self, desired: str | None) -> Array:
        """Torque (m,) [N*m] of a desired curve at the angles of the grid; NaN beyond its ends, and
        of None. Raises InputError: The settings have no such curve."""
        angle, curves = self.curves[0]["angle_deg"].to_numpy(), self.settings.desired
        if desired is None:
            return np.full(len(angle), np.nan)
        if desired not in curves:
            raise InputError(
                f"trial {self.uniform.trial}: no desired curve '{desired}'; torque_angle.desired in"
                f" the configuration has {', '.join(curves) or 'none'}"
            )
        return curves[desired].at(angle)


def torque_angle_trial(trial: Trial, settings: TorqueAngleAnalysis) -> TorqueAngleTrial:
    """Filter one canonical trial, subtract the torque's zero and the bench's deflection, and find
    cycles and curves. Raises InputError: the joint hardly moves, there is no whole cycle or no
    rest, cycles are too fast, torque does not follow the angle or drives it, or the joint is
    stiffer than the bench; the message names the trial."""
    signals = uniform_signals(trial, ("theta", "torque"), settings.gap_limits)
    bench = settings.bench_stiffness
    with naming(f"trial {trial.name}"):
        found = torque_angle_of(signals, settings, bench.compliance if bench else 0.0)
    check_stiffer(trial.name, "K", float(cycle_table(found)["K"].to_numpy().mean()), bench)
    return found


def torque_angle_of(
    signals: UniformSignals, settings: TorqueAngleAnalysis, compliance: float
) -> TorqueAngleTrial:
    """The trial behind uniform signals on a bench of a compliance [rad/(N*m)]; raises as
    `torque_angle_trial`."""
    check_changes("torque", signals["torque"])
    check_changes("theta", signals["theta"])
    low_pass, rate = settings.low_pass, signals.rate_hz
    bench_theta, torque = low_pass(signals["theta"], rate), low_pass(signals["torque"], rate)
    if (range_deg := float(np.rad2deg(np.ptp(bench_theta)))) < settings.smallest_motion_deg:
        raise InputError(
            f"the angle moves by {range_deg:.3g} deg in all, expected"
            f" {settings.smallest_motion_deg:g} deg or more (smallest_motion_deg); check the"
            " channel of theta and its unit in the source file"
        )
    zero = torque_zero(bench_theta, torque, rate, settings)
    torque = torque - zero
    theta = joint_angle(bench_theta, torque, compliance)
    cycles, facts = find_cycles(theta, settings.settle_cycles or 0)
    if settings.settle_cycles is None:
        # A device with hysteresis that starts from rest begins within its loop. The first cycle
        # counts only if its torque closes to within three times the gap of later cycles, or 0.5 %
        # of the range of torque.
        first, *later = (abs(float(torque[cycle[-1]] - torque[cycle[0]])) for cycle in cycles)
        if later and first > max(3.0 * max(later), 0.005 * float(np.ptp(torque))):
            cycles, facts = cycles[1:], facts | {"settled_cycles": 1}
    way = 1 if facts["loading"] == "rising" else -1
    loading, unloading = (
        [
            [slice(a, b + 1) for a, b in pairwise(cycle) if (theta[b] - theta[a]) * sign > 0]
            for cycle in cycles
        ]
        for sign in (way, -way)
    )
    # grid angles, multiples of a step, that every branch of every cycle passes
    rows = [np.r_[*pieces] for pieces in (*loading, *unloading)]
    low = np.rad2deg(max(float(theta[one].min()) for one in rows))
    high = np.rad2deg(min(float(theta[one].max()) for one in rows))
    step, fewest = settings.angle_step_deg, 5
    steps = np.arange(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)
    if len(steps) < fewest:
        raise InputError(
            f"of the grid's angles {len(steps)} lie within the motion ({low:.2f} to "
            f"{high:.2f} deg), expected {fewest} or more; lower angle_step_deg from {step:g} "
            f"deg to {(high - low) / (2 * fewest):.2g} deg or less"
        )
    at = np.asarray(steps * step, dtype=np.float64)
    window, independent = (
        settings.window_share * float(np.ptp(theta)),
        low_pass.independent_samples(rate),
    )
    curves = tuple(
        branch_curve([(theta[one], torque[one]) for one in own], at, window, independent)
        for own in (rows[: len(cycles)], rows[len(cycles) :])
    )
    found = TorqueAngleTrial(
        signals,
        settings,
        theta,
        bench_theta,
        torque,
        zero,
        facts,
        cycles,
        (loading, unloading),
        (curves[0], curves[1]),
    )
    check_slow_and_followed(found)
    return found


def check_slow_and_followed(found: TorqueAngleTrial) -> None:
    """Refuse a trial that is not quasi-static, whose torque does not follow the angle, or drives
    it."""
    table, settings = cycle_table(found), found.settings
    if (shortest := float(table["duration_s"].to_numpy().min())) < settings.shortest_cycle_s:
        raise InputError(
            f"a cycle takes {shortest:.2g} s, which is not quasi-static: below"
            f" {settings.shortest_cycle_s:g} s (shortest_cycle_s) inertia and damping are in the"
            " torque; record it slower, or take experiment 'impedance'"
        )
    if (vaf := found.vaf()) < 50.0:
        rows = np.concatenate(
            [np.r_[piece] for branch in found.branches for cycle in branch for piece in cycle]
        )
        raise InputError(
            f"torque does not follow the angle: its curve over angle accounts for {vaf:.3g} % of"
            f" its variance, and it changes by {np.ptp(found.torque[rows]):.3g} N*m; check the"
            " torque's channel and the mounting of the load cell"
        )
    if (slope := table["K"][0]) < 0:
        raise InputError(
            f"K = {slope:.4g} N*m/rad is negative, so the torque drives the motion instead of"
            " resisting it; turn the `sign` of the torque, or of the angle, in the source file"
        )


ASSUMED_ZERO: Final = "end"  # of the torque, where none is stated


def torque_zero(
    theta: Array, torque: Array, rate_hz: float, settings: TorqueAngleAnalysis
) -> float:
    """Torque [N*m] at rest, by the rule of the settings; 0 if there is none. Raises InputError: the
    joint moves."""
    zero = settings.zero or ASSUMED_ZERO
    if zero == "none":
        return 0.0
    count = max(round(settings.rest_s * rate_hz), 1)
    rows = slice(-count, None) if zero == "end" else slice(count)
    moved = float(np.ptp(theta[rows]))
    if count >= len(theta) or moved > RESTS * np.ptp(theta):
        other = "start" if zero == "end" else "end"
        raise InputError(
            f"the joint does not rest at the {zero} of the recording: the angle moves by"
            f" {np.rad2deg(moved):.2g} deg in {settings.rest_s:g} s; write `zero: {other}` under"
            " torque_angle, or `zero: none` if the torque was zeroed before, or a shorter `rest_s`"
        )
    return float(torque[rows].mean())


def find_cycles(theta: Array, settle: int = 0) -> tuple[list[Cycle], Row]:
    """The cycles of a filtered angle theta (n,) [rad] without the first `settle` ones, and how many
    were left out: `settled_cycles`; `smaller_cycles`, of a smaller range; `partial_cycles`, other
    stretches that are no whole cycle.

    A cycle ends where the angle returns to its start in the same direction, or, if the motion
    starts at one of its ends, where it returns to this end. `loading` is the direction, `rising` or
    `falling`, to the end farther from the start. A whole cycle covers 90 % of the range of motion.
    Raises InputError: there is none to analyse."""
    low, high = float(theta.min()), float(theta.max())
    span = high - low
    swing = 0.1 * span  # return that makes a turning point
    turns = turning_points(theta, swing)
    edges = cycle_edges(theta, turns, span)
    closed = [
        (a, *(t for t in turns if a < t < b), b)
        for a, b in pairwise(edges)
        if abs(theta[b] - theta[a]) <= CLOSED * span and np.ptp(theta[a : b + 1]) > swing
    ]
    found = [cycle for cycle in closed if np.ptp(theta[cycle[0] : cycle[-1] + 1]) >= 0.9 * span]
    if not found:
        first, least, most, last = np.rad2deg([theta[0], low, high, theta[-1]]).round(2) + 0.0
        raise InputError(
            f"no whole cycle: the angle begins at {first:.2f} deg, goes to {least:.2f} and"
            f" {most:.2f} deg, and ends at {last:.2f} deg; record the way back to the start"
        )
    if len(found) <= settle:
        raise InputError(
            f"the first {settle} of {len(found)} whole cycles are not analysed; record more, or"
            " lower settle_cycles"
        )
    begin = theta[found[0][0]]
    ends = {(cycle[0], cycle[-1]) for cycle in closed}
    stretches = pairwise(sorted({0, *edges, len(theta) - 1}))
    facts: Row = {
        "settled_cycles": settle,
        "smaller_cycles": len(closed) - len(found),
        "partial_cycles": sum(
            (a, b) not in ends for a, b in stretches if np.ptp(theta[a : b + 1]) > swing
        ),
        "loading": "rising" if high - begin >= begin - low else "falling",
    }
    return found[settle:], facts


def turning_points(theta: Array, swing: float) -> list[int]:
    """Rows at which the angle (n,) turns and then returns by `swing` or more."""
    x, turns = theta.tolist(), list[int]()
    direction = top = bottom = 0  # rows of the highest and lowest angle since the last turn
    for row, value in enumerate(x):
        top = row if value > x[top] else top
        bottom = row if value < x[bottom] else bottom
        if direction >= 0 and value < x[top] - swing:
            turns += [top] if direction else []
            direction, bottom = -1, row
        elif direction <= 0 and value > x[bottom] + swing:
            turns += [bottom] if direction else []
            direction, top = 1, row
    return turns


def cycle_edges(theta: Array, turns: Sequence[int], span: float) -> list[int]:
    """Rows at which cycles of an angle (n,) may begin or end."""
    start, last = float(theta[0]), len(theta) - 1
    # share of the range of motion within which a start counts as an end of the motion
    at_an_end = 0.1
    if min(start - theta.min(), theta.max() - start) < at_an_end * span:
        same = [turn for turn in turns if abs(theta[turn] - start) < (at_an_end + CLOSED) * span]
        return [0, *same, last]
    segments = list(pairwise([0, *turns, last]))
    direction = np.sign(theta[segments[0][1]] - start)
    closes = abs(theta[last] - start) <= CLOSED * span
    edges = [0]
    for a, b in segments[1 : -1 if closes else None]:
        if (start - theta[a]) * direction > 0 and (theta[b] - start) * direction > 0:
            edges.append(a + int(np.argmax((theta[a : b + 1] - start) * direction >= 0)))
    return [*edges, last]


def between_rests(theta: Array) -> slice:
    """The rows of an angle (n,) between its rests at both ends."""
    near = RESTS * np.ptp(theta)
    away, back = np.abs(theta - theta[0]) > near, np.abs(theta - theta[-1]) > near
    return slice(
        max(int(np.argmax(away)) - 1, 0), len(theta) - max(int(np.argmax(back[::-1])) - 1, 0)
    )


def straight_line(theta: Array, torque: Array, pieces: Sequence[slice]) -> float:
    """Slope [N*m/rad] of a branch by least squares over angle. Each sample has the weight of the
    angle that it covers, so that a rest on the way, or a slower end, does not count more."""
    weight = np.concatenate([np.abs(np.gradient(theta[piece])) for piece in pieces])
    angle, load = theta[np.r_[*pieces]], torque[np.r_[*pieces]]
    centred = angle - np.average(angle, weights=weight)
    return float(np.sum(weight * centred * load) / np.sum(weight * centred**2))


def local_parabola(
    theta: Array, torque: Array, at: float, window: float, independent: int
) -> Array:
    """A parabola through the samples (n,) of a branch within a window [rad] to each side of an
    angle, (6,): torque [N*m] and slope [N*m/rad]; their squared standard errors in noise of density
    1 [(N*m)^2 per sample]; the density of a cubic's residual, as an AR(1) at steps after which
    noise is `independent`; and its degrees of freedom. NaN with too few samples; the slope also if
    they do not reach the ends of the window."""
    near = np.abs(theta - at) <= window
    x = (theta[near] - at) / window
    cubic = np.vander(x, 4, increasing=True)
    if x.size < 10 or np.linalg.cond(cubic[:, :3]) > CONDITION_LIMIT:
        return np.full(6, np.nan)
    solution = np.linalg.pinv(cubic[:, :3])
    unit = np.sum(solution[:2] ** 2, axis=1) / [1.0, window**2]
    left = torque[near] - cubic @ np.linalg.lstsq(cubic, torque[near])[0]
    alike = float(left[independent:] @ left[:-independent]) / max(
        float(left @ left), np.finfo(float).tiny
    )
    memory = independent * (1 + max(alike, 0.0)) / (1 - max(alike, 0.0))
    freedom = max(x.size / memory - 4, 1.0)
    value, slope = solution[:2] @ torque[near] / [1.0, window]
    reaches = theta.min() <= at - window and theta.max() >= at + window
    return np.array([value, slope if reaches else np.nan, *unit, left @ left / freedom, freedom])


def branch_curve(
    cycles: Sequence[tuple[Array, Array]], angle_deg: Array, window: float, independent: int
) -> pl.DataFrame:
    """One branch at angles (m,) [deg], from its angle [rad] and torque in each cycle; NaN out of
    its reach.

    Torque [N*m] and stiffness, its slope over angle [N*m/rad], are means over the cycles; `change`
    is the torque of the last cycle minus the first. 95 % intervals are from the cycles' scatter
    (Student). With one cycle they are from its noise: the median density of its points, since at a
    kink the misfit of the cubic would count as noise. With few degrees of freedom the median is
    below the mean by the factor of Wilson and Hilferty (1931)."""
    at = np.deg2rad(angle_deg)
    points = np.array(
        [[local_parabola(*one, angle, window, independent) for angle in at] for one in cycles]
    )
    if len(cycles) > 1:
        student = float(scipy.special.stdtrit(len(cycles) - 1, 0.975)) / np.sqrt(len(cycles))
        half = student * np.std(points[..., :2], axis=0, ddof=1)
    else:
        seen = points[0][np.isfinite(points[0, :, 4])]
        density, freedom = np.median(seen[:, 4:], axis=0) if len(seen) else (np.nan, np.nan)
        half = 1.96 * np.sqrt(density / (1 - 2 / (9 * freedom)) ** 3 * points[0, :, 2:4])
    columns = {"angle_deg": angle_deg}
    for name, value, error in zip(
        ("torque", "stiffness"), points[..., :2].mean(axis=0).T, half.T, strict=True
    ):
        columns |= {name: value, f"{name}_low": value - error, f"{name}_high": value + error}
    return pl.DataFrame(columns | {"change": points[-1, :, 0] - points[0, :, 0]})


def cycle_table(trial: TorqueAngleTrial) -> pl.DataFrame:
    """The trial's rows of `torque_angle_cycles.csv`: one per cycle."""
    theta, torque, time, rows = trial.theta, trial.torque, trial.uniform.time, []
    moves = between_rests(theta)
    for k, (cycle, loading, unloading) in enumerate(
        zip(trial.cycles, *trial.branches, strict=True)
    ):
        start, stop = cycle[0], cycle[-1]
        seconds = (min(stop, moves.stop - 1) - max(start, moves.start)) * float(time[1] - time[0])
        path = float(np.abs(np.diff(theta[[*cycle]])).sum())
        # Energies taken from the bench and returned: the integral of torque over angle, by pieces.
        # A piece ends where the angle turns or the torque changes sign, so that noise does not
        # count as energy in both directions.
        angle, load = theta[start : stop + 1], torque[start : stop + 1]
        work = np.concatenate([[0.0], np.cumsum((load[1:] + load[:-1]) / 2 * np.diff(angle))])
        signs = np.flatnonzero(np.diff(np.signbit(load))) + 1
        pieces = np.diff(work[np.unique([*signs, *(row - start for row in cycle)])])
        stored, returned = float(pieces[pieces > 0].sum()), float(-pieces[pieces < 0].sum())
        loaded = np.r_[*loading]
        low, high = loaded[np.argmin(theta[loaded])], loaded[np.argmax(theta[loaded])]
        rows.append(
            {
                "trial": trial.uniform.trial,
                "cycle": k + 1,
                "start_s": float(time[start]),
                "stop_s": float(time[stop]),
                "duration_s": seconds,
                "speed_deg_s": float(np.rad2deg(path) / seconds),
                "K": straight_line(theta, torque, loading),
                "K_secant": float((torque[high] - torque[low]) / (theta[high] - theta[low])),
                "K_unloading": straight_line(theta, torque, unloading),
                "energy_stored": stored,
                "energy_returned": returned,
                "energy_lost": stored - returned,
                "energy_per_ms": (
                    1e-3 * float(np.gradient(load) @ np.gradient(angle)) / float(time[1] - time[0])
                ),
                "closure_angle": float(abs(theta[stop] - theta[start]) / np.ptp(theta)),
                "closure_torque": float(abs(torque[stop] - torque[start]) / np.ptp(torque)),
            }
        )
    return pl.DataFrame(rows)


def torque_angle_table(trial: TorqueAngleTrial, desired: str | None = None) -> pl.DataFrame:
    """The trial's row of `torque_angle.csv`; `desired` names the curve that it should follow.

    Intervals are of the mean over cycles (Student), with the errors of the bench; null with one
    cycle. `cycle_drift` is the change of torque at equal angles from the first cycle to the last;
    `rate_change` the change of the energy lost from the slowest to the fastest
    (`change_with_speed`); `desired_rms` the distance [N*m] of the branches' mean from the desired
    curve; `desired_ratio` the ratio of their slopes. Raises InputError: no such curve."""
    cycles, bench, theta, torque = (
        cycle_table(trial),
        trial.settings.bench_stiffness,
        trial.theta,
        trial.torque,
    )
    of = {name: cycles[name].to_numpy() for name in cycles.columns if name != "trial"}
    several = len(cycles) > 1
    stated, moved = trial.settings.calibration, np.r_[trial.cycles[0][0] : trial.cycles[-1][-1]]
    errors = torque_errors(torque, trial.uniform.rate_hz, moved, stated)
    others = [cycle_table(replace(trial, torque=torque + error)) for error in errors if error.any()]
    if bench is not None and bench.compliance_error:  # a bench softer by one standard error
        compliance = bench.compliance + bench.compliance_error
        others.append(cycle_table(torque_angle_of(trial.uniform, trial.settings, compliance)))
    step = 0.01 * float(np.ptp(torque))
    # by a shift of the zero
    higher, lower = (cycle_table(replace(trial, torque=torque + by)) for by in (-step, step))
    means: Row = {
        f"{name}_per_zero": float((higher[name] - lower[name]).to_numpy().mean() / (2 * step))
        for name in ("energy_stored", "energy_returned")
    }
    as_load = (
        cycle_table(replace(trial, torque=torque + trial.zero))["energy_stored"].to_numpy().mean()
    )
    share = float(as_load / of["energy_stored"].mean() - 1)
    means |= {"assumed_zero_share": share if trial.settings.zero is None else None}
    for name in ("K", "K_secant", "K_unloading", "energy_stored", "energy_returned", "energy_lost"):
        means |= {
            name: float(of[name].mean()),
            **dict.fromkeys((f"{name}_se", f"{name}_low", f"{name}_high")),
        }
        mean = of[name].mean()
        changes = [
            stated.polar(0.0)[0] * mean,
            *(one[name].to_numpy().mean() - mean for one in others),
        ]
        shared = float(np.linalg.norm(changes))
        means |= {f"{name}_se_bench": shared}
        if several:
            found = over_repeats(of[name], [(shared**2, np.inf)] if shared else [])
            means |= {f"{name}_se": found.se, f"{name}_low": found.low, f"{name}_high": found.high}
    rate_change, late = change_with_speed(of["speed_deg_s"], of["energy_lost"], of["energy_per_ms"])
    loading, unloading = (curve["torque"].to_numpy() for curve in trial.curves)
    stiffness = trial.curves[0]["stiffness"].to_numpy()
    widest = float(np.nanmax(np.abs(loading - unloading)))
    drift = float(np.nanmean(trial.curves[0]["change"].to_numpy()) / np.ptp(torque))
    moved, bench_theta = np.rad2deg(theta[between_rests(theta)]), np.rad2deg(trial.bench_theta)
    uncorrected = [straight_line(trial.bench_theta, torque, pieces) for pieces in trial.branches[0]]
    middle, wanted = (loading + unloading) / 2, trial.desired_torque(desired)
    apart, both = middle - wanted, np.isfinite(middle + wanted)
    usable = np.concatenate(
        [trial.uniform.usable[cycle[0] : cycle[-1] + 1] for cycle in trial.cycles]
    )
    row: Row = {
        "trial": trial.uniform.trial,
        "cycles": len(cycles),
        **trial.facts,
        "angle_min_deg": float(moved.min()),
        "angle_max_deg": float(moved.max()),
        "bench_angle_min_deg": float(bench_theta.min()),
        "bench_angle_max_deg": float(bench_theta.max()),
        "torque_min": float(torque.min()),
        "torque_max": float(torque.max()),
        **zero_row(trial, widest),
        **means,
        "K_uncorrected": float(np.mean(uncorrected)),
        "K_lowest": float(np.nanmin(stiffness)),
        "K_highest": float(np.nanmax(stiffness)),
        "returned_share": float(np.sum(of["energy_returned"]) / np.sum(of["energy_stored"])),
        "hysteresis_torque": widest,
        "interval_method": "cycles" if several else None,
        "VAF": trial.vaf(),
        "speed_deg_s": float(np.mean(of["speed_deg_s"])),
        "shortest_cycle_s": float(of["duration_s"].min()),
        "closure_angle": float(of["closure_angle"].max()),
        "closure_torque": float(of["closure_torque"].max()),
        "cycle_drift": drift if several else None,
        "rate_change": rate_change,
        "late_s": late,
        "energy_per_ms": float(of["energy_per_ms"].mean()),
        "bridged_share": float(np.mean(~usable)),
        "desired": desired,
        "desired_rms": None if desired is None else float(np.sqrt(np.nanmean(apart**2))),
        "desired_ratio": (
            float(np.polyfit(wanted[both], middle[both], 1)[0])
            if np.count_nonzero(both) > 2
            else None
        ),
    }
    texts = dict.fromkeys(("interval_method", "desired"), pl.String)
    empty = {name: texts.get(name, pl.Float64) for name, value in row.items() if value is None}
    return pl.DataFrame([row], schema_overrides=empty)


def change_with_speed(
    speed: Array, lost: Array, per_ms: Array
) -> tuple[float | None, float | None]:
    """Change of the energy lost [J] in loops (n,) with their speed [deg/s], from the slowest to the
    fastest, as a share of its mean; and the lateness of the torque [s] that would make this change,
    if each ms takes off `per_ms` [J]. Null if speeds differ by less than 30 %."""
    if speed.max() < 1.3 * speed.min():
        return None, None
    slope = np.polyfit(np.log(speed), lost, 1)[0]
    change = float(slope * np.log(speed.max() / speed.min()) / abs(lost.mean()))
    return change, -1e-3 * float(np.polyfit(per_ms, lost, 1)[0])


def compared_with_repeats(table: pl.DataFrame, places: Places) -> pl.DataFrame:
    """The rows of `torque_angle.csv` of a campaign. Trials of one speed have `rate_change` and
    `late_s` from trials that repeat them: same joint, side and desired curve, K within 3 %, range
    within 2 %."""
    rows, ends = table.to_dicts(), ("angle_min_deg", "angle_max_deg")
    for row in (one for one in rows if one["rate_change"] is None):
        span = row["angle_max_deg"] - row["angle_min_deg"]
        alike = [
            one
            for one in rows
            if (one["desired"], places.get(one["trial"]))
            == (row["desired"], places.get(row["trial"]))
            and abs(one["K"] / row["K"] - 1) < 0.03
            and all(abs(one[end] - row[end]) < 0.02 * span for end in ends)
        ]
        of = (
            np.array([one[name] for one in alike])
            for name in ("speed_deg_s", "energy_lost", "energy_per_ms")
        )
        row["rate_change"], row["late_s"] = change_with_speed(*of)
    return pl.DataFrame(
        rows, schema=table.schema | dict.fromkeys(("rate_change", "late_s"), pl.Float64)
    )


def zero_row(trial: TorqueAngleTrial, widest: float) -> Row:
    """The torque taken as zero, and the evidence against it; `widest` [N*m] is the largest width of
    the loop.

    The torque at rest may be due to hysteresis, or, if no zero is stated, to a load at rest. A
    torque due to hysteresis lies on a branch of the loop, not in its middle, to which friction
    relaxes at rest. If the joint rests at an end of the motion, the loop cannot tell; then a zero
    that is small against the loop does not matter. `rest_change` is the torque at rest at the end
    minus the start, as a share of its range; null if the zero is not the end's, or if the joint
    does not rest at both, at one angle."""
    torque, settings, angle = trial.torque, trial.settings, trial.curves[0]["angle_deg"].to_numpy()
    zero = settings.zero or ASSUMED_ZERO
    rest = float(np.rad2deg(trial.theta[0 if zero == "start" else -1]))
    torque_range, middle = float(np.ptp(torque)), None
    if angle[0] <= rest <= angle[-1]:
        one, other = (
            float(np.interp(rest, angle, curve["torque"].to_numpy())) for curve in trial.curves
        )
        middle = (one + other) / 2
        left = abs(middle) > max(0.25 * abs(one - other), 0.005 * torque_range)
    else:
        left = widest > 0.02 * torque_range and abs(trial.zero) > 0.1 * widest
    # it may rest under load
    left |= settings.zero is None and abs(trial.zero) > 0.005 * torque_range
    count = max(round(settings.rest_s * trial.uniform.rate_hz), 1)
    ends = np.concatenate([trial.bench_theta[:count], trial.bench_theta[-count:]])
    rests = zero == "end" and float(np.ptp(ends)) <= RESTS * float(np.ptp(trial.bench_theta))
    return {
        "torque_zero": trial.zero,
        "zero_off_middle": None if zero == "none" or middle is None else -middle,
        "rest_change": (
            float((torque[-count:].mean() - torque[:count].mean()) / torque_range)
            if rests
            else None
        ),
        "zero_unsure": (
            abs(trial.zero if settings.zero is None else middle or trial.zero)
            if left and zero != "none"
            else None
        ),
    }


def curve_table(trial: TorqueAngleTrial, desired: str | None = None) -> pl.DataFrame:
    """The trial's rows of `torque_angle_curves.csv`: per branch and angle; raises as
    `torque_angle_table`."""
    wanted = pl.Series("desired_torque", trial.desired_torque(desired))
    frames, stated = [], trial.settings.calibration
    widths = {"torque": stated.slip * float(np.ptp(trial.torque)), "stiffness": 0.0}
    for branch, curve in zip(("loading", "unloading"), trial.curves, strict=True):
        texts = pl.lit(trial.uniform.trial).alias("trial"), pl.lit(branch).alias("branch")
        frame = curve.drop("change").with_columns(wanted).fill_nan(None)
        for name, width in widths.items() if stated != NOT_STATED else ():
            value, high = pl.col(name), pl.col(f"{name}_high")
            known = (stated.polar(0.0)[0] * value) ** 2 + width**2
            half = ((high - value) ** 2 + 1.96**2 * known).sqrt()
            frame = frame.with_columns(
                **{f"{name}_low": value - half, f"{name}_high": value + half}
            )
        frames.append(frame.select(*texts, pl.all(), pl.lit(desired, pl.String).alias("desired")))
    return pl.concat(frames)
