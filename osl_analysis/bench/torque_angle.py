"""Torque against angle, quasi-static, of passive feet, springs and series elastic elements: cycles, zero and curves.

The torque's zero and the yielding of the bench itself are taken off first. A device with hysteresis that comes to rest
on its way keeps a torque of up to half the width of its loop there. One recording cannot tell it from an offset; a rest
before the motion, or the loop around it, says that it may be there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import stdtrit

from osl_analysis.bench.analysis import Series, check_stiffer, timebase_table
from osl_analysis.bench.record import joint_angle
from osl_analysis.bench.settings import TorqueAngleAnalysis
from osl_analysis.errors import InputError
from osl_analysis.judge.doubts import check_changes
from osl_analysis.signals.grid import UniformSignals, uniform_signals
from osl_analysis.stats.fit_row import Row
from osl_analysis.stats.regression import CONDITION_LIMIT, variance_accounted_for
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.trial import Array, Trial

RowNumbers = NDArray[np.intp]
SWING = 0.1  # part of the range of motion by which the angle must come back for a turning point
CLOSED = 0.05  # largest distance of a cycle's ends, as a part of the range of motion
RESTS = 0.01  # part of the range of motion within which the joint rests


@dataclass(frozen=True)
class LoadingCycle:
    """One closed cycle: rows from `start` to `stop`, both included, and its turning points in between."""

    start: int
    stop: int
    turns: tuple[int, ...]

    def pieces(self, theta: Array, direction: int) -> list[slice]:
        """Rows, piece by piece, in which the angle (n,) goes in a direction, 1 up or -1 down."""
        edges = [self.start, *self.turns, self.stop]
        return [slice(a, b + 1) for a, b in pairwise(edges) if (theta[b] - theta[a]) * direction > 0]


@dataclass(frozen=True)
class FoundCycles:
    """The cycles of a recording."""

    used: tuple[LoadingCycle, ...]  # those that are analysed
    settled: int  # number of first ones that are not
    smaller: int  # number of further ones of a smaller range
    partial: int  # number of further stretches that are no whole cycle
    loading: int  # direction in which the joint moves away from rest, 1 up or -1 down

    def settled_for(self, torque: Array) -> "FoundCycles":
        """Without the first cycle if it differs: its torque (n,) [N*m] does not come back, that of later ones does. A
        device with hysteresis that starts from rest begins within its loop and ends on it. It may miss its begin by
        three times as much as later cycles, which drift makes alike, or by 0.5 % of the range of torque."""
        first, *later = (abs(float(torque[cycle.stop] - torque[cycle.start])) for cycle in self.used)
        if not later or first <= max(3.0 * max(later), 0.005 * float(np.ptp(torque))):
            return self
        return replace(self, used=self.used[1:], settled=self.settled + 1)


def find_cycles(theta: Array, settle: int = 0) -> FoundCycles:
    """The cycles of an angle theta (n,) [rad], filtered, without the first `settle` ones. A cycle begins where the
    recording begins, and ends where the angle comes back in the same direction; if the motion starts at one of its
    ends, where the angle comes back to this end. Loading is the way to the end that is farther from the start. A whole
    cycle has nine tenths of the range of motion.

    Raises InputError: there is no whole cycle, or none behind the first ones.
    """
    low, high, start = float(theta.min()), float(theta.max()), float(theta[0])
    span = high - low
    turns = turning_points(theta, SWING * span)
    edges = cycle_edges(theta, turns, span)
    closed = [
        LoadingCycle(a, b, tuple(t for t in turns if a < t < b))
        for a, b in pairwise(edges)
        if abs(theta[b] - theta[a]) <= CLOSED * span and np.ptp(theta[a : b + 1]) > SWING * span
    ]
    found = [cycle for cycle in closed if np.ptp(theta[cycle.start : cycle.stop + 1]) >= 0.9 * span]
    if not found:
        start_deg, low_deg, high_deg, last_deg = (
            f"{round(np.rad2deg(angle), 2) + 0.0:.2f}" for angle in (start, low, high, theta[-1])
        )
        raise InputError(
            f"no whole cycle: the angle begins at {start_deg} deg, goes to {low_deg} and {high_deg} deg, "
            f"and ends at {last_deg} deg; record the way back to the start"
        )
    if len(found) <= settle:
        raise InputError(
            f"the first {settle} of {len(found)} whole cycles are not analysed; record more, or lower settle_cycles"
        )
    farther = 1 if high - theta[found[0].start] >= theta[found[0].start] - low else -1
    ends = {(cycle.start, cycle.stop) for cycle in closed}
    stretches = pairwise(sorted({0, *edges, len(theta) - 1}))
    partial = sum((a, b) not in ends for a, b in stretches if np.ptp(theta[a : b + 1]) > SWING * span)
    return FoundCycles(tuple(found[settle:]), settle, len(closed) - len(found), partial, farther)


def turning_points(theta: Array, swing: float) -> list[int]:
    """Rows at which the angle (n,) turns, and comes back by `swing` or more before it goes on."""
    turns: list[int] = []
    highest = lowest = 0
    direction = 0
    top = bottom = float(theta[0])
    for row, value in enumerate(theta.tolist()):
        if value > top:
            highest, top = row, value
        if value < bottom:
            lowest, bottom = row, value
        if direction >= 0 and value < top - swing:
            turns += [highest] if direction else []
            direction, lowest, bottom = -1, row, value
        elif direction <= 0 and value > bottom + swing:
            turns += [lowest] if direction else []
            direction, highest, top = 1, row, value
    return turns


def cycle_edges(theta: Array, turns: Sequence[int], span: float) -> list[int]:
    """Rows at which cycles of an angle (n,) may begin or end."""
    start, last = float(theta[0]), len(theta) - 1
    at_an_end = 0.1  # part of the range of motion within which a start counts as one end of the motion
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
    return slice(max(int(np.argmax(away)) - 1, 0), len(theta) - max(int(np.argmax(back[::-1])) - 1, 0))


def rows_of_pieces(pieces: Sequence[slice]) -> RowNumbers:
    return np.concatenate([np.arange(piece.start, piece.stop) for piece in pieces])


def energies(theta: Array, torque: Array, cycle: LoadingCycle) -> tuple[float, float]:
    """Energies of a cycle [J], taken up from the bench and given back: the integral of torque [N*m] over angle [rad],
    piece by piece. A piece ends where the angle turns or the torque changes its sign, so that noise is not counted as
    energy to and fro."""
    rows = slice(cycle.start, cycle.stop + 1)
    angle, load = theta[rows], torque[rows]
    work = np.concatenate([[0.0], np.cumsum((load[1:] + load[:-1]) / 2 * np.diff(angle))])
    signs = np.flatnonzero(np.diff(np.signbit(load))) + 1
    edges = np.unique([0, *signs, *(turn - cycle.start for turn in cycle.turns), len(work) - 1])
    pieces = np.diff(work[edges])
    return float(pieces[pieces > 0].sum()), float(-pieces[pieces < 0].sum())


@dataclass(frozen=True)
class Curve:
    """One branch, over the cycles: (m,) each at the angles of the grid; NaN where the branch does not reach."""

    torque: Array  # torque [N*m], mean of the cycles
    stiffness: Array  # slope of torque over angle [N*m/rad], mean of the cycles
    torque_half: Array  # half-width of the 95 % interval of the torque
    stiffness_half: Array  # half-width of the 95 % interval of the slope
    change: Array  # torque of the last cycle minus that of the first


def local_parabola(theta: Array, torque: Array, at: float, window: float, independent: int) -> Array:
    """What the samples (n,) of one branch within a window [rad] to each side of an angle say of it, by a parabola (6,):
    torque [N*m] and slope [N*m/rad], their squared standard errors in noise of a density of 1 [(N*m)^2 per sample],
    the density of what a cubic leaves, as an AR(1) at steps after which the filter leaves noise `independent`, and its
    degrees of freedom. NaN where samples are too few, and a slope where they do not reach as far as the window."""
    near = np.abs(theta - at) <= window
    x = (theta[near] - at) / window
    cubic = np.vander(x, 4, increasing=True)
    if x.size < 10 or np.linalg.cond(cubic[:, :3]) > CONDITION_LIMIT:
        return np.full(6, np.nan)
    solution = np.linalg.pinv(cubic[:, :3])
    unit = np.sum(solution[:2] ** 2, axis=1) / [1.0, window**2]
    left = torque[near] - cubic @ np.linalg.lstsq(cubic, torque[near])[0]
    alike = float(left[independent:] @ left[:-independent]) / max(float(left @ left), np.finfo(float).tiny)
    memory = independent * (1 + max(alike, 0.0)) / (1 - max(alike, 0.0))
    freedom = max(x.size / memory - 4, 1.0)
    value, slope = solution[:2] @ torque[near] / [1.0, window]
    reaches = theta.min() <= at - window and theta.max() >= at + window
    return np.array([value, slope if reaches else np.nan, *unit, left @ left / freedom, freedom])


def branch_curve(
    theta: Array, torque: Array, branches: Sequence[RowNumbers], at: Array, window: float, independent: int
) -> Curve:
    """A branch at the angles `at` (m,) [rad], from its rows in each cycle. With two cycles or more the intervals are
    those of their scatter (Student), with one those of its noise: the median density of its points, since at a kink
    what the cubic cannot describe would count. The median of few degrees of freedom is below their mean by the factor
    of Wilson and Hilferty (1931)."""
    points = np.array([[local_parabola(theta[r], torque[r], a, window, independent) for a in at] for r in branches])
    mean, change = points[..., :2].mean(axis=0).T, points[-1, :, 0] - points[0, :, 0]
    if len(branches) > 1:
        student = float(stdtrit(len(branches) - 1, 0.975)) / np.sqrt(len(branches))
        half = student * np.std(points[..., :2], axis=0, ddof=1)
    else:
        seen = points[0][np.isfinite(points[0, :, 4])]
        density, freedom = np.median(seen[:, 4:], axis=0) if len(seen) else (np.nan, np.nan)
        half = 1.96 * np.sqrt(density / (1 - 2 / (9 * freedom)) ** 3 * points[0, :, 2:4])
    return Curve(mean[0], mean[1], half[:, 0], half[:, 1], change)


def straight_line(theta: Array, torque: Array, pieces: Sequence[slice]) -> float:
    """Slope [N*m/rad] of the straight line through a branch by least squares over angle. Each sample counts by the
    angle that it covers, so that a rest on the way, or a slower end, does not weigh more."""
    rows = rows_of_pieces(pieces)
    weight = np.concatenate([np.abs(np.gradient(theta[piece])) for piece in pieces])
    angle, load = theta[rows], torque[rows]
    centred = angle - np.average(angle, weights=weight)
    return float(np.sum(weight * centred * load) / np.sum(weight * centred**2))


@dataclass(frozen=True)
class TorqueAngleTrial:
    """One trial: filtered signals, shape (n,) each, cycles, and curves at the angles of the grid, (m,)."""

    theta: Array  # angle of the joint [rad], without the bench's yielding
    bench_theta: Array  # angle of the bench [rad]
    torque: Array  # resisting torque [N*m] from its zero
    zero: float  # torque [N*m] that was taken for zero
    cycles: FoundCycles  # its cycles
    angle_deg: Array  # angles of the grid [deg]
    curves: tuple[Curve, Curve]  # loading and unloading
    settings: TorqueAngleAnalysis  # the choices of the analysis
    uniform: UniformSignals  # the signals on their time base

    @property
    def name(self) -> str:
        return self.uniform.trial

    def pieces(self, branch: int) -> list[list[slice]]:
        """The rows of a branch, 0 loading or 1 unloading, in each cycle, piece by piece."""
        direction = self.cycles.loading * (1, -1)[branch]
        return [cycle.pieces(self.theta, direction) for cycle in self.cycles.used]

    def durations(self) -> Array:
        """Duration [s] of each cycle (k,), without the rests at the ends of the recording."""
        moves, time = between_rests(self.theta), self.uniform.time
        rows = [min(c.stop, moves.stop - 1) - max(c.start, moves.start) for c in self.cycles.used]
        return np.array(rows) * float(time[1] - time[0])

    def series(self) -> Series:
        """Torque beside its curve over angle, whose end pieces go on beyond its ends, in the rows of all cycles."""
        at, model = self.angle_deg, np.full(len(self.theta), np.nan)
        for branch, curve in enumerate(self.curves):
            y = curve.torque
            for pieces in self.pieces(branch):
                rows = rows_of_pieces(pieces)
                x = np.rad2deg(self.theta[rows])
                ends = np.array([min(x.min(), at[0] - 1), max(x.max(), at[-1] + 1)])
                first = y[0] + (y[0] - y[1]) / (at[0] - at[1]) * (ends[0] - at[0])
                last = y[-1] + (y[-1] - y[-2]) / (at[-1] - at[-2]) * (ends[1] - at[-1])
                model[rows] = np.interp(x, np.array([ends[0], *at, ends[1]]), np.array([first, *y, last]))
        return Series(self.uniform.time, self.torque, model, self.theta, np.isfinite(model))

    def vaf(self) -> float:
        """VAF [percent] of the torque by its curve over angle, in the rows of all cycles."""
        series = self.series()
        torque = series.torque[series.fitted]
        return variance_accounted_for(torque, torque - series.torque_model[series.fitted])

    def time_base(self) -> pl.DataFrame:
        """The trial's rows of `timebase.csv`."""
        return timebase_table(self.uniform, None, self.settings.bench_stiffness)

    def desired_torque(self, desired: str) -> Array:
        """Torque (m,) [N*m] of a desired curve at the angles of the grid; NaN beyond its ends.

        Raises InputError: The settings have no such curve.
        """
        curves = self.settings.desired
        if desired not in curves:
            raise InputError(
                f"trial {self.name}: no desired curve '{desired}'; torque_angle.desired in the configuration has "
                f"{', '.join(curves) or 'none'}"
            )
        return curves[desired].at(self.angle_deg)


def torque_angle_trial(trial: Trial, settings: TorqueAngleAnalysis) -> TorqueAngleTrial:
    """Filter one canonical trial, take torque's zero and the bench's yielding off, and find cycles and curves.

    Raises InputError: The joint hardly moves, there is no whole cycle or no rest, cycles are too fast, torque does not
    follow the angle or drives it, or the joint is stiffer than the bench; the message names the trial.
    """
    signals = uniform_signals(trial, ("theta", "torque"), settings.gap_limits)
    bench = settings.bench_stiffness
    try:
        found = torque_angle_of(signals, settings, bench.compliance if bench else 0.0)
    except InputError as error:
        raise InputError(f"trial {trial.name}: {error}") from error
    slopes = [straight_line(found.theta, found.torque, pieces) for pieces in found.pieces(0)]
    check_stiffer(trial.name, "K", float(np.mean(slopes)), bench)
    return found


def torque_angle_of(signals: UniformSignals, settings: TorqueAngleAnalysis, compliance: float) -> TorqueAngleTrial:
    """The trial behind uniform signals on a bench of a compliance [rad/(N*m)]; raises as `torque_angle_trial`."""
    check_changes("torque", signals["torque"])
    check_changes("theta", signals["theta"])
    low_pass, rate = settings.low_pass, signals.rate_hz
    bench_theta, torque = low_pass(signals["theta"], rate), low_pass(signals["torque"], rate)
    if (range_deg := float(np.rad2deg(np.ptp(bench_theta)))) < settings.smallest_motion_deg:
        raise InputError(
            f"the angle moves by {range_deg:.3g} deg in all, expected {settings.smallest_motion_deg:g} deg or more "
            "(smallest_motion_deg); check the channel of theta and its unit in the source file"
        )
    zero = torque_zero(bench_theta, torque, rate, settings)
    torque = torque - zero
    theta = joint_angle(bench_theta, torque, compliance)
    cycles = find_cycles(theta, settings.settle_cycles or 0)
    if settings.settle_cycles is None:
        cycles = cycles.settled_for(torque)
    branches = [[rows_of_pieces(c.pieces(theta, cycles.loading * sign)) for c in cycles.used] for sign in (1, -1)]
    # the angles of the grid, multiples of a step, that every branch of every cycle passes
    low = np.rad2deg(max(float(theta[rows].min()) for cycle in branches for rows in cycle))
    high = np.rad2deg(min(float(theta[rows].max()) for cycle in branches for rows in cycle))
    step, fewest = settings.angle_step_deg, 5
    steps = np.arange(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)
    if len(steps) < fewest:
        raise InputError(
            f"of the grid's angles {len(steps)} lie within the motion ({low:.2f} to "
            f"{high:.2f} deg), expected {fewest} or more; lower angle_step_deg from {step:g} "
            f"deg to {(high - low) / (2 * fewest):.2g} deg or less"
        )
    at = np.asarray(steps * step, dtype=np.float64)
    around = settings.window_share * float(np.ptp(theta)), low_pass.independent_samples(rate)
    loading, unloading = (branch_curve(theta, torque, rows, np.deg2rad(at), *around) for rows in branches)
    curves = loading, unloading
    found = TorqueAngleTrial(theta, bench_theta, torque, zero, cycles, at, curves, settings, signals)
    shortest = float(found.durations().min())
    if shortest < settings.shortest_cycle_s:
        raise InputError(
            f"a cycle takes {shortest:.2g} s, which is not quasi-static: below {settings.shortest_cycle_s:g} s "
            "(shortest_cycle_s) inertia and damping are in the torque; record it slower, or take experiment 'impedance'"
        )
    if (vaf := found.vaf()) < 50.0:
        follows = torque[found.series().fitted]
        raise InputError(
            f"torque does not follow the angle: its curve over angle accounts for {vaf:.3g} % of its variance, and it "
            f"changes by {np.ptp(follows):.3g} N*m; check the torque's channel and the mounting of the load cell"
        )
    slope = straight_line(theta, torque, found.pieces(0)[0])
    if slope < 0:
        raise InputError(
            f"K = {slope:.4g} N*m/rad is negative, so the torque drives the motion instead of resisting it; turn the "
            "`sign` of the torque, or of the angle, in the source file"
        )
    return found


def torque_zero(theta: Array, torque: Array, rate_hz: float, settings: TorqueAngleAnalysis) -> float:
    """Torque [N*m] at rest, by the rule of the settings; 0 if there is none. Raises InputError: the joint moves."""
    if settings.zero == "none":
        return 0.0
    count = max(round(settings.rest_s * rate_hz), 1)
    rows = slice(-count, None) if settings.zero == "end" else slice(count)
    moved = float(np.ptp(theta[rows]))
    if count >= len(theta) or moved > RESTS * np.ptp(theta):
        other = "start" if settings.zero == "end" else "end"
        raise InputError(
            f"the joint does not rest at the {settings.zero} of the recording: the angle moves by "
            f"{np.rad2deg(moved):.2g} deg in {settings.rest_s:g} s; write `zero: {other}` under torque_angle, or "
            "`zero: none` if the torque was zeroed before, or a shorter `rest_s`"
        )
    return float(torque[rows].mean())


def cycle_table(trial: TorqueAngleTrial) -> pl.DataFrame:
    """The trial's rows of `torque_angle_cycles.csv`: one per cycle."""
    theta, torque, time, rows = trial.theta, trial.torque, trial.uniform.time, []
    durations, loading, unloading = trial.durations(), trial.pieces(0), trial.pieces(1)
    for k, cycle in enumerate(trial.cycles.used):
        path = float(np.abs(np.diff(theta[[cycle.start, *cycle.turns, cycle.stop]])).sum())
        stored, returned = energies(theta, torque, cycle)
        rising = rows_of_pieces(loading[k])
        low, high = rising[np.argmin(theta[rising])], rising[np.argmax(theta[rising])]
        rows.append(
            {
                "trial": trial.name,
                "cycle": k + 1,
                "start_s": float(time[cycle.start]),
                "stop_s": float(time[cycle.stop]),
                "duration_s": float(durations[k]),
                "speed_deg_s": float(np.rad2deg(path) / durations[k]),
                "K": straight_line(theta, torque, loading[k]),
                "K_secant": float((torque[high] - torque[low]) / (theta[high] - theta[low])),
                "K_unloading": straight_line(theta, torque, unloading[k]),
                "energy_stored": stored,
                "energy_returned": returned,
                "energy_lost": stored - returned,
                "closure_angle": float(abs(theta[cycle.stop] - theta[cycle.start]) / np.ptp(theta)),
                "closure_torque": float(abs(torque[cycle.stop] - torque[cycle.start]) / np.ptp(torque)),
            }
        )
    return pl.DataFrame(rows)


def torque_angle_table(trial: TorqueAngleTrial, desired: str | None = None) -> pl.DataFrame:
    """The trial's row of `torque_angle.csv`; `desired` is the name of the curve that it should follow.

    Intervals are those of the mean over cycles (Student), with the error of the bench's stiffness where it is stated;
    null with one cycle. `cycle_drift` is the change of torque at the same angles from the first cycle to the last,
    `rate_change` that of the energy lost from the slowest cycle to the fastest, null where their speeds differ by less
    than 30 %, and `bridged_share` the share of the rows of the cycles in gaps of the recording, or near them.

    Raises InputError: The settings have no such curve.
    """
    cycles = cycle_table(trial)
    of = {name: cycles[name].to_numpy() for name in cycles.columns if name != "trial"}
    bench = trial.settings.bench_stiffness
    softer = None  # the cycles with a bench that is softer by one standard error
    if bench is not None and bench.compliance_error:
        softer = cycle_table(torque_angle_of(trial.uniform, trial.settings, bench.compliance + bench.compliance_error))
    means: Row = {}
    for name in ("K", "K_secant", "K_unloading", "energy_stored", "energy_returned", "energy_lost"):
        if len(cycles) > 1:
            change = 0.0 if softer is None else float(softer[name].to_numpy().mean() - of[name].mean())
            found = over_repeats(of[name], [(change**2, np.inf)] if change else [])
            means |= {name: found.mean, f"{name}_se": found.se, f"{name}_low": found.low, f"{name}_high": found.high}
        else:
            means |= {name: float(of[name][0]), **dict.fromkeys((f"{name}_se", f"{name}_low", f"{name}_high"))}
    rate_change, speed, lost = None, of["speed_deg_s"], of["energy_lost"]
    if speed.max() >= 1.3 * speed.min():
        slope = np.polyfit(np.log(speed), lost, 1)[0]
        rate_change = float(slope * np.log(speed.max() / speed.min()) / abs(lost.mean()))
    loading, unloading = trial.curves
    moved, torque = trial.theta[between_rests(trial.theta)], trial.torque
    widest = float(np.nanmax(np.abs(loading.torque - unloading.torque)))
    drift = float(np.nanmean(loading.change) / np.ptp(torque))
    uncorrected = [straight_line(trial.bench_theta, torque, pieces) for pieces in trial.pieces(0)]
    distance = None  # [N*m] of the mean of both branches from the desired curve, RMS over its angles
    if desired is not None:
        apart = (loading.torque + unloading.torque) / 2 - trial.desired_torque(desired)
        distance = float(np.sqrt(np.nanmean(apart**2)))
    usable = np.concatenate([trial.uniform.usable[cycle.start : cycle.stop + 1] for cycle in trial.cycles.used])
    row: Row = {
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
        **means,
        "K_uncorrected": float(np.mean(uncorrected)),
        "K_lowest": float(np.nanmin(loading.stiffness)),
        "K_highest": float(np.nanmax(loading.stiffness)),
        "returned_share": float(np.sum(of["energy_returned"]) / np.sum(of["energy_stored"])),
        "hysteresis_torque": widest,
        "interval_method": "cycles" if len(cycles) > 1 else None,
        "VAF": trial.vaf(),
        "speed_deg_s": float(np.mean(speed)),
        "shortest_cycle_s": float(trial.durations().min()),
        "closure_angle": float(of["closure_angle"].max()),
        "closure_torque": float(of["closure_torque"].max()),
        "cycle_drift": drift if len(cycles) > 1 else None,
        "rate_change": rate_change,
        "bridged_share": float(np.mean(~usable)),
        "desired": desired,
        "desired_rms": distance,
    }
    texts = dict.fromkeys(("interval_method", "desired", "not_checked"), pl.String)
    empty = {name: texts.get(name, pl.Float64) for name, value in row.items() if value is None}
    return pl.DataFrame([row], schema_overrides=empty)


def zero_row(trial: TorqueAngleTrial, widest: float) -> Row:
    """The torque taken for zero, and what speaks against it; the loop is `widest` [N*m] at its widest.

    The torque at rest may be what hysteresis leaves: then it lies on a branch of the loop (0.5 of its width there from
    its middle) and not in its middle, where friction lets go at rest. Where the joint rests at an end of the motion the
    loop does not tell; a zero that is small against it is no matter there. `rest_change` is the difference of the
    torque between rest at the end and at the start, as a share of its range; null where the zero is not that of the
    end, or the joint does not rest at both at one angle. A zero at the start, before the device was moved, is right
    although hysteresis leaves a torque at the end.
    """
    torque, settings, angle = trial.torque, trial.settings, trial.angle_deg
    rest = float(np.rad2deg(trial.theta[0 if settings.zero == "start" else -1]))
    reasons, torque_range, middle = [], float(np.ptp(torque)), None
    if trial.cycles.smaller:
        reasons.append(
            "smaller_cycles, whole but smaller than the largest, are not analysed: record each amplitude as its own "
            "trial"
        )
    if angle[0] <= rest <= angle[-1]:
        one, other = (float(np.interp(rest, angle, curve.torque)) for curve in trial.curves)
        middle = (one + other) / 2
        left = abs(middle) > max(0.25 * abs(one - other), 0.005 * torque_range)
    else:
        left = widest > 0.02 * torque_range and abs(trial.zero) > 0.1 * widest
    if left and settings.zero != "none":
        reasons.append(
            "whether the torque at rest is the load cell's offset or what hysteresis leaves in the device "
            "(zero_off_middle): torque_min, torque_max, energy_stored and energy_returned depend on it"
        )
    count = max(round(settings.rest_s * trial.uniform.rate_hz), 1)
    ends = np.concatenate([trial.bench_theta[:count], trial.bench_theta[-count:]])
    rests = settings.zero == "end" and float(np.ptp(ends)) <= RESTS * float(np.ptp(trial.bench_theta))
    return {
        "torque_zero": trial.zero,
        "zero_off_middle": None if settings.zero == "none" or middle is None else -middle,
        "rest_change": float((torque[-count:].mean() - torque[:count].mean()) / torque_range) if rests else None,
        "not_checked": "; ".join(reasons) or None,
    }


def curve_table(trial: TorqueAngleTrial, desired: str | None = None) -> pl.DataFrame:
    """The trial's rows of `torque_angle_curves.csv`: per branch and angle; raises as `torque_angle_table`."""
    wanted = np.full(len(trial.angle_deg), np.nan) if desired is None else trial.desired_torque(desired)
    frames = []
    for branch, curve in zip(("loading", "unloading"), trial.curves, strict=True):
        columns = {"angle_deg": trial.angle_deg}
        pairs = ("torque", curve.torque, curve.torque_half), ("stiffness", curve.stiffness, curve.stiffness_half)
        for name, value, half in pairs:
            columns |= {name: value, f"{name}_low": value - half, f"{name}_high": value + half}
        frame = pl.DataFrame(columns | {"desired_torque": wanted}).fill_nan(None)
        texts = pl.lit(trial.name).alias("trial"), pl.lit(branch).alias("branch")
        frames.append(frame.select(*texts, pl.all(), pl.lit(desired, pl.String).alias("desired")))
    return pl.concat(frames)
