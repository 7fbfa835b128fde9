"""Torque against angle, quasi-static, of passive feet, springs and series elastic elements: cycles, zero and curves.

The torque's zero and the yielding of the bench itself are taken off first. A device with hysteresis that comes to rest
on its way keeps a torque of up to half the width of its loop there. One recording cannot tell it from an offset; a rest
before the motion, or the loop around it, says that it may be there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.analysis import Series, check_stiffer
from osl_analysis.bench.record import joint_angle
from osl_analysis.bench.settings import TorqueAngleAnalysis
from osl_analysis.errors import InputError
from osl_analysis.judge.impossible import check_changes
from osl_analysis.stats.regression import variance_accounted_for
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.stats.slow_motion import fit_slow_motion
from osl_analysis.timebase.grid import UniformSignals, uniform_signals
from osl_analysis.trial import Array, Trial

SMALLEST_SWING = 0.1  # part of the range of motion by which the angle must come back for a turning point
AT_AN_END = 0.1  # part of the range of motion within which a start counts as one end of the motion
CLOSED = 0.05  # largest distance of a cycle's ends, as a part of the range of motion
WHOLE = 0.9  # smallest range of a cycle, as a part of the range of motion
NO_RETURN = 0.005
"""Part of the range of torque by which a first cycle may miss its begin without differing from the later ones."""
MUCH_MORE = 3.0
"""Ratio of this distance to that of later cycles from which on the first one differs: drift makes them alike."""
RESTS = 0.01  # part of the range of motion within which the joint rests


@dataclass(frozen=True)
class Cycle:
    """One closed cycle: rows from `start` to `stop`, both included, and its turning points in between."""

    start: int
    stop: int
    turns: tuple[int, ...]

    @property
    def rows(self) -> slice:
        return slice(self.start, self.stop + 1)

    def pieces(self, theta: Array, direction: int) -> list[slice]:
        """Rows, piece by piece, in which the angle (n,) goes in a direction, 1 up or -1 down."""
        edges = [self.start, *self.turns, self.stop]
        return [slice(a, b + 1) for a, b in pairwise(edges) if (theta[b] - theta[a]) * direction > 0]


@dataclass(frozen=True)
class Cycles:
    """The cycles of a recording.

    used: those that are analysed. settled: number of first ones that are not. smaller: number of further ones of a
    smaller range. partial: number of further stretches that are no whole cycle. loading: direction in which the joint
    moves away from rest, 1 up or -1 down. starts_at: the angle [rad] at which a cycle begins.
    """

    used: tuple[Cycle, ...]
    settled: int
    smaller: int
    partial: int
    loading: int
    starts_at: float

    def settled_for(self, torque: Array) -> "Cycles":
        """Without the first cycle if it differs: its torque (n,) [N*m] does not come back, that of later ones does. A
        device with hysteresis that starts from rest begins within its loop and ends on it."""
        first, *later = (abs(float(torque[cycle.stop] - torque[cycle.start])) for cycle in self.used)
        if not later or first <= max(MUCH_MORE * max(later), NO_RETURN * float(np.ptp(torque))):
            return self
        return replace(self, used=self.used[1:], settled=self.settled + 1)


def find_cycles(theta: Array, settle: int = 0) -> Cycles:
    """The cycles of an angle theta (n,) [rad], filtered, without the first `settle` ones. A cycle begins where the
    recording begins, and ends where the angle comes back in the same direction; if the motion starts at one of its
    ends, where the angle comes back to this end. Loading is the way to the end that is farther from the start."""
    low, high = float(theta.min()), float(theta.max())
    span, start = high - low, float(theta[0])
    turns = turning_points(theta, SMALLEST_SWING * span)
    edges = cycle_edges(theta, turns, span)
    closed = [
        Cycle(a, b, tuple(t for t in turns if a < t < b))
        for a, b in pairwise(edges)
        if abs(theta[b] - theta[a]) <= CLOSED * span and np.ptp(theta[a : b + 1]) > SMALLEST_SWING * span
    ]
    found = [cycle for cycle in closed if np.ptp(theta[cycle.rows]) >= WHOLE * span]
    if not found:
        raise InputError(
            f"no whole cycle: the angle begins at {in_deg(start)} deg, goes to {in_deg(low)} and {in_deg(high)} deg, "
            f"and ends at {in_deg(theta[-1])} deg; record the way back to the start"
        )
    if len(found) <= settle:
        raise InputError(
            f"the first {settle} of {len(found)} whole cycles are not analysed; record more, or lower settle_cycles"
        )
    farther = 1 if high - theta[found[0].start] >= theta[found[0].start] - low else -1
    partial, smaller = partial_cycles(theta, edges, closed), len(closed) - len(found)
    return Cycles(tuple(found[settle:]), settle, smaller, partial, farther, start)


def in_deg(angle: float) -> str:
    return f"{round(np.rad2deg(angle), 2) + 0.0:.2f}"


def partial_cycles(theta: Array, edges: Sequence[int], found: Sequence[Cycle]) -> int:
    """Number of stretches of the angle (n,) between edges, or at its ends, that move and are no cycle."""
    swing = SMALLEST_SWING * float(np.ptp(theta))
    stretches = pairwise(sorted({0, *edges, len(theta) - 1}))
    moves = [(a, b) for a, b in stretches if np.ptp(theta[a : b + 1]) > swing]
    return sum((a, b) not in {(cycle.start, cycle.stop) for cycle in found} for a, b in moves)


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
    at_low, at_high = start - theta.min() < AT_AN_END * span, theta.max() - start < AT_AN_END * span
    if at_low or at_high:
        same = [turn for turn in turns if abs(theta[turn] - start) < AT_AN_END * span + CLOSED * span]
        return [0, *same, last]
    segments = list(pairwise([0, *turns, last]))
    direction = np.sign(theta[segments[0][1]] - start)
    closes = abs(theta[last] - start) <= CLOSED * span
    edges = [0]
    for a, b in segments[1 : -1 if closes else None]:
        if (start - theta[a]) * direction > 0 and (theta[b] - start) * direction > 0:
            edges.append(a + int(np.argmax((theta[a : b + 1] - start) * direction >= 0)))
    return [*edges, last]


def moving(theta: Array) -> slice:
    """The rows of an angle (n,) between its rests at both ends."""
    near = RESTS * np.ptp(theta)
    away, back = np.abs(theta - theta[0]) > near, np.abs(theta - theta[-1]) > near
    return slice(max(int(np.argmax(away)) - 1, 0), len(theta) - max(int(np.argmax(back[::-1])) - 1, 0))


def joined(pieces: Sequence[slice]) -> NDArray[np.intp]:
    """The rows of several pieces, one after the other."""
    return np.concatenate([np.arange(piece.start, piece.stop) for piece in pieces])


AT_REST = 0.01  # part of the range of motion by which the angle may change while the joint rests
OFF_MIDDLE = 0.25
"""Distance of the zero from the middle of the loop, as a part of its width there, from which it is said: 0.5 on a
branch, 0 where friction lets go at rest."""
LEAST_SHIFT = 0.005  # the same as a part of the range of torque, below which it is not worth a word
LEAST_LOOP = 0.02
"""Width of the loop, as a part of the range of torque, below which hysteresis leaves nothing worth a word."""
SMALL_ZERO = 0.1  # torque taken for zero, as a part of the width of the loop, below which it is no matter what it is


def torque_zero(theta: Array, torque: Array, rate_hz: float, settings: TorqueAngleAnalysis) -> float:
    """Torque [N*m] at rest, by the rule of the settings; 0 if there is none."""
    if settings.zero == "none":
        return 0.0
    count = max(round(settings.rest_s * rate_hz), 1)
    rows = slice(-count, None) if settings.zero == "end" else slice(count)
    moved = float(np.ptp(theta[rows]))
    if count >= len(theta) or moved > AT_REST * np.ptp(theta):
        other = "start" if settings.zero == "end" else "end"
        raise InputError(
            f"the joint does not rest at the {settings.zero} of the recording: the angle moves by "
            f"{np.rad2deg(moved):.2g} deg in {settings.rest_s:g} s; write `zero: {other}` under torque_angle, or "
            "`zero: none` if the torque was zeroed before, or a shorter `rest_s`"
        )
    return float(torque[rows].mean())


def rest_change(theta: Array, torque: Array, rate_hz: float, settings: TorqueAngleAnalysis) -> float | None:
    """Difference of the torque (n,) [N*m] between rest at the end and at the start, as a share of its range. None where
    the zero is not that of the end, or the joint does not rest at both at one angle (n,) [rad]. A zero at the start,
    before the device was moved, is right although hysteresis leaves a torque at the end."""
    count = max(round(settings.rest_s * rate_hz), 1)
    ends = np.concatenate([theta[:count], theta[-count:]])
    if settings.zero != "end" or float(np.ptp(ends)) > AT_REST * float(np.ptp(theta)):
        return None
    return float((torque[-count:].mean() - torque[:count].mean()) / np.ptp(torque))


@dataclass(frozen=True)
class Loop:
    """The loop at the angle of the rest, [N*m] from the zero."""

    middle: float  # mean of loading and unloading
    width: float  # their distance


def loop_at(at_deg: float, angle_deg: Array, loading: Array, unloading: Array) -> Loop | None:
    """The loop at an angle [deg], from the torques (m,) of both branches at the angles (m,); None beyond these."""
    if not angle_deg[0] <= at_deg <= angle_deg[-1]:
        return None
    one, other = (float(np.interp(at_deg, angle_deg, branch)) for branch in (loading, unloading))
    return Loop((one + other) / 2, abs(one - other))


def may_be_left(zero: float, loop: Loop | None, widest: float, torque_range: float) -> bool:
    """Whether the torque [N*m] at rest that was taken for zero may be what hysteresis leaves: it lies on a branch of
    the loop and not in its middle. Where the joint rests at an end of the motion the loop does not tell. There a `zero`
    that is small against the `widest` loop is no matter."""
    if loop is None:
        return widest > LEAST_LOOP * torque_range and abs(zero) > SMALL_ZERO * widest
    return abs(loop.middle) > max(OFF_MIDDLE * loop.width, LEAST_SHIFT * torque_range)


FEWEST_SAMPLES = 10  # samples around a point of a curve below which it stays empty
NORMAL = 1.96  # half-width of the 95 % interval, in standard errors, where the noise is known well
FEWEST_POINTS = 5  # points of a curve below which a trial is refused


@dataclass(frozen=True)
class Energies:
    """Energies of one cycle [J]: taken up from the bench, given back, and the difference."""

    stored: float
    returned: float

    @property
    def lost(self) -> float:
        return self.stored - self.returned


@dataclass(frozen=True)
class Curve:
    """One branch, over the cycles: (m,) each at the angles of the grid; NaN where the branch does not reach."""

    torque: Array  # torque [N*m], mean of the cycles
    stiffness: Array  # slope of torque over angle [N*m/rad], mean of the cycles
    torque_half: Array  # half-width of the 95 % interval of the torque
    stiffness_half: Array  # half-width of the 95 % interval of the slope
    torques: Array  # torque of each cycle (cycles, m)


def energies(theta: Array, torque: Array, cycle: Cycle) -> Energies:
    """Energies of a cycle: the integral of torque [N*m] over angle [rad], piece by piece. A piece ends where the angle
    turns or the torque changes its sign, so that noise is not counted as energy to and fro."""
    angle, load = theta[cycle.rows], torque[cycle.rows]
    work = np.concatenate([[0.0], np.cumsum((load[1:] + load[:-1]) / 2 * np.diff(angle))])
    signs = np.flatnonzero(np.diff(np.signbit(load))) + 1
    edges = np.unique([0, *signs, *(turn - cycle.start for turn in cycle.turns), len(work) - 1])
    pieces = np.diff(work[edges])
    return Energies(float(pieces[pieces > 0].sum()), float(-pieces[pieces < 0].sum()))


def grid_deg(theta: Array, branches: Sequence[Sequence[NDArray[np.intp]]], step_deg: float) -> Array:
    """The angles [deg], multiples of a step, that every branch of every cycle passes."""
    low = max(float(theta[rows].min()) for cycle in branches for rows in cycle)
    high = min(float(theta[rows].max()) for cycle in branches for rows in cycle)
    first, last = int(np.ceil(np.rad2deg(low) / step_deg)), int(np.floor(np.rad2deg(high) / step_deg))
    if last - first + 1 < FEWEST_POINTS:
        raise InputError(
            f"of the grid's angles {max(last - first + 1, 0)} lie within the motion ({np.rad2deg(low):.2f} to "
            f"{np.rad2deg(high):.2f} deg), expected {FEWEST_POINTS} or more; lower angle_step_deg from {step_deg:g} "
            f"deg to {np.rad2deg(high - low) / (2 * FEWEST_POINTS):.2g} deg or less"
        )
    return np.asarray(np.arange(first, last + 1) * step_deg, dtype=np.float64)


@dataclass(frozen=True)
class Smoothing:
    """How a point of a curve is fitted: samples within `window` [rad] to each side, of which noise is independent after
    `every` samples (`LowPass.independent_samples`)."""

    window: float
    every: int


@dataclass(frozen=True)
class Point:
    """A point of a curve: torque [N*m] and slope [N*m/rad], with what their errors are made of.

    unit: squared standard errors (2,) of both if the noise has a spectral density of 1 [(N*m)^2 per sample].
    noise: the density that the samples around show. freedom: its degrees of freedom. All NaN without enough samples.
    """

    torque: float
    slope: float
    unit: tuple[float, float]
    noise: float
    freedom: float


EMPTY = Point(np.nan, np.nan, (np.nan, np.nan), np.nan, np.nan)


def local_line(theta: Array, torque: Array, at: float, smoothing: Smoothing) -> Point:
    """Torque and slope at an angle [rad] of the samples (n,) of one branch: a parabola through those around. The slope
    is NaN where they do not reach as far as the window on both sides. What a cubic describes is not noise."""
    window = smoothing.window
    near = np.abs(theta - at) <= window
    x = (theta[near] - at) / window
    if x.size < FEWEST_SAMPLES:
        return EMPTY
    columns = {"torque": np.ones_like(x), "slope": x, "curvature": x**2}
    fit = fit_slow_motion(torque[near], columns, {"cubic": x**3}, smoothing.every)
    solution = np.linalg.pinv(np.column_stack(list(columns.values())))
    unit = np.sum(solution[:2] ** 2, axis=1)
    reaches = theta.min() <= at - window and theta.max() >= at + window
    slope = fit["slope"] / window if reaches else np.nan
    noise, freedom = float(fit.covariance[0, 0] / unit[0]), float(fit.degrees_of_freedom[0])
    return Point(fit["torque"], slope, (float(unit[0]), float(unit[1]) / window**2), noise, freedom)


def branch_curve(
    theta: Array, torque: Array, branches: Sequence[NDArray[np.intp]], at: Array, smoothing: Smoothing
) -> Curve:
    """A branch at the angles `at` (m,) [rad], from its rows in each cycle. With two cycles or more the intervals are
    those of their scatter (Student), with one those of its noise."""
    points = [[local_line(theta[rows], torque[rows], a, smoothing) for a in at] for rows in branches]
    torques = np.array([[point.torque for point in cycle] for cycle in points])
    slopes = np.array([[point.slope for point in cycle] for cycle in points])
    if len(branches) == 1:
        halves = NORMAL * np.sqrt(usual_noise(points[0]) * np.array([point.unit for point in points[0]]))
        return Curve(torques[0], slopes[0], halves[:, 0], halves[:, 1], torques)
    scatter = [np.array([half_width(values[:, k]) for k in range(len(at))]) for values in (torques, slopes)]
    return Curve(torques.mean(axis=0), slopes.mean(axis=0), scatter[0], scatter[1], torques)


def usual_noise(points: Sequence[Point]) -> float:
    """Spectral density of the noise of a branch [(N*m)^2 per sample]: the median over its points. At a kink of the
    curve, what the cubic cannot describe would count as noise. The median of few degrees of freedom is below their mean
    by the factor of Wilson and Hilferty (1931)."""
    found = np.array([(point.noise, point.freedom) for point in points if np.isfinite(point.noise)]).reshape(-1, 2)
    if not len(found):
        return np.nan
    density, freedom = np.median(found, axis=0)
    return float(density / (1 - 2 / (9 * freedom)) ** 3)


def half_width(values: Array) -> float:
    """Half-width of the 95 % interval of the mean of values (cycles,); NaN where one is."""
    if np.isnan(values).any():
        return np.nan
    repeats = over_repeats(values)
    return repeats.high - repeats.mean


def straight_line(theta: Array, torque: Array, pieces: Sequence[slice]) -> float:
    """Slope [N*m/rad] of the straight line through a branch by least squares over angle. Each sample counts by the
    angle that it covers, so that a rest on the way, or a slower end, does not weigh more."""
    rows = joined(pieces)
    weight = np.concatenate([np.abs(np.gradient(theta[piece])) for piece in pieces])
    angle, load = theta[rows], torque[rows]
    centred = angle - np.average(angle, weights=weight)
    return float(np.sum(weight * centred * load) / np.sum(weight * centred**2))


def secant(theta: Array, torque: Array, rows: NDArray[np.intp]) -> float:
    """Slope [N*m/rad] of the line between the lowest and the highest angle of a branch."""
    low, high = rows[np.argmin(theta[rows])], rows[np.argmax(theta[rows])]
    return float((torque[high] - torque[low]) / (theta[high] - theta[low]))


LEAST_VAF = 50.0  # VAF [percent] of the torque by its curve over angle below which the torque does not follow the angle


@dataclass(frozen=True)
class TorqueAngleTrial:
    """One trial: filtered signals, shape (n,) each, cycles, and curves at the angles of the grid, (m,)."""

    name: str  # name of the trial
    time: Array  # time [s]
    theta: Array  # angle of the joint [rad], without the bench's yielding
    bench_theta: Array  # angle of the bench [rad]
    torque: Array  # resisting torque [N*m] from its zero
    zero: float  # torque [N*m] that was taken for zero
    cycles: Cycles  # its cycles
    angle_deg: Array  # angles of the grid [deg]
    curves: tuple[Curve, Curve]  # loading and unloading
    settings: TorqueAngleAnalysis  # the choices of the analysis
    uniform: UniformSignals  # the signals on their time base

    def rows(self, branch: int) -> list[NDArray[np.intp]]:
        return [joined(pieces) for pieces in self.pieces(branch)]

    def pieces(self, branch: int) -> list[list[slice]]:
        """The same, piece by piece."""
        direction = self.cycles.loading * (1, -1)[branch]
        return [cycle.pieces(self.theta, direction) for cycle in self.cycles.used]

    def energies(self) -> list[Energies]:
        """Energies of each cycle."""
        return [energies(self.theta, self.torque, cycle) for cycle in self.cycles.used]

    def durations(self) -> Array:
        """Duration [s] of each cycle (k,), without the rests at the ends of the recording."""
        moves, step = moving(self.theta), float(self.time[1] - self.time[0])
        rows = [min(c.stop, moves.stop - 1) - max(c.start, moves.start) for c in self.cycles.used]
        return np.array(rows) * step

    def series(self) -> Series:
        """Torque beside its curve over angle, which the rows of all cycles have."""
        model = np.full(len(self.theta), np.nan)
        for branch, curve in enumerate(self.curves):
            for rows in self.rows(branch):
                model[rows] = along(np.rad2deg(self.theta[rows]), self.angle_deg, curve.torque)
        return Series(self.time, self.torque, model, self.theta, np.isfinite(model))

    def modelled(self) -> tuple[Array, Array]:
        """Torque [N*m] and its curve over angle, of the rows of all cycles, (n,) each."""
        series = self.series()
        return series.torque[series.fitted], series.torque_model[series.fitted]


def along(x: Array, at: Array, y: Array) -> Array:
    """Values at x (n,) of the broken line through y at rising places (m,), whose end pieces go on beyond the ends."""
    ends = np.array([min(x.min(), at[0] - 1), max(x.max(), at[-1] + 1)])
    first, last = (
        y[i] + (y[i] - y[j]) / (at[i] - at[j]) * (end - at[i]) for end, i, j in ((ends[0], 0, 1), (ends[1], -1, -2))
    )
    return np.asarray(np.interp(x, np.concatenate([ends[:1], at, ends[1:]]), np.concatenate([[first], y, [last]])))


def torque_angle_trial(trial: Trial, settings: TorqueAngleAnalysis) -> TorqueAngleTrial:
    """Filter one canonical trial, take torque's zero and the bench's yielding off, and find cycles and curves.

    Raises InputError: The joint hardly moves, there is no whole cycle or no rest, cycles are too fast, torque does not
    follow the angle or drives it, or the joint is stiffer than the bench; the message names the trial.
    """
    signals = uniform_signals(trial, ("theta", "torque"), settings.gap_limits)
    bench = settings.bench_stiffness
    try:
        found = analysed(signals, settings, bench.compliance if bench else 0.0)
    except InputError as error:
        raise InputError(f"trial {trial.name}: {error}") from error
    slopes = [straight_line(found.theta, found.torque, pieces) for pieces in found.pieces(0)]
    check_stiffer(trial.name, "K", float(np.mean(slopes)), bench)
    return found


def analysed(signals: UniformSignals, settings: TorqueAngleAnalysis, compliance: float) -> TorqueAngleTrial:
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
    branches = [[joined(c.pieces(theta, cycles.loading * sign)) for c in cycles.used] for sign in (1, -1)]
    at = grid_deg(theta, branches, settings.angle_step_deg)
    smoothing = Smoothing(settings.window_share * float(np.ptp(theta)), low_pass.independent_samples(rate))
    loading, unloading = (branch_curve(theta, torque, rows, np.deg2rad(at), smoothing) for rows in branches)
    name, time, curves = signals.trial, signals.time, (loading, unloading)
    found = TorqueAngleTrial(name, time, theta, bench_theta, torque, zero, cycles, at, curves, settings, signals)
    shortest = float(found.durations().min())
    if shortest < settings.shortest_cycle_s:
        raise InputError(
            f"a cycle takes {shortest:.2g} s, which is not quasi-static: below {settings.shortest_cycle_s:g} s "
            "(shortest_cycle_s) inertia and damping are in the torque; record it slower, or take experiment 'impedance'"
        )
    check_follows(found)
    return found


def check_follows(trial: TorqueAngleTrial) -> None:
    """Refuse a torque that does not follow the angle, and one that drives it."""
    torque, model = trial.modelled()
    vaf = variance_accounted_for(torque, torque - model)
    if vaf < LEAST_VAF:
        raise InputError(
            f"torque does not follow the angle: its curve over angle accounts for {vaf:.3g} % of its variance, and it "
            f"changes by {np.ptp(torque):.3g} N*m; check the torque's channel and the mounting of the load cell"
        )
    slope = straight_line(trial.theta, trial.torque, trial.pieces(0)[0])
    if slope < 0:
        raise InputError(
            f"K = {slope:.4g} N*m/rad is negative, so the torque drives the motion instead of resisting it; turn the "
            "`sign` of the torque, or of the angle, in the source file"
        )
