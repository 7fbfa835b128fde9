"""Torque against angle, quasi-static, of passive feet, springs and series elastic elements: one
trial's filtered signals, zero, cycles and curves.

The torque's zero and the deflection of the bench are subtracted first. A device with hysteresis
that comes to rest on its way keeps a torque of up to half the width of its loop. One recording
cannot tell this from an offset; a rest before the motion, or the loop around the rest, shows that
it may be present."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.bench_settings import TorqueAngleAnalysis
from osl_analysis.bench.branch_curve import branch_curve, straight_line
from osl_analysis.bench.fit_tables import Series, timebase_table
from osl_analysis.bench.loop_cycles import RESTS, Cycle, Cycles, between_rests, find_cycles
from osl_analysis.bench.plausibility import TURN_TORQUE, check_changes, check_stiffer
from osl_analysis.bench.record import joint_angle
from osl_analysis.errors import Change, InputError, naming
from osl_analysis.signals.grid import UniformSignals, uniform_signals
from osl_analysis.stats.regression import variance_accounted_for
from osl_analysis.stats.table_rows import Row
from osl_analysis.trial import Array, Trial

ZeroAt = Literal["end", "start", "none"]

FEWEST_ANGLES = 5  # of a curve
LEAST_VAF = 50.0  # [percent] of the torque by its curve; below it the torque does not follow
GAP_OF_FIRST_CYCLE = 3.0  # times the largest gap of later ones: a first cycle beyond is settling
SMALLEST_GAP = 0.005  # of the range of torque: a first cycle that closes to within it is settled
ASSUMED_ZEROS: tuple[ZeroAt, ...] = ("end", "start")
"""Where the torque's zero is taken, if none is stated: the first at which the joint rests."""


@dataclass(frozen=True)
class Branch:
    """Loading or unloading of all cycles."""

    pieces: tuple[tuple[slice, ...], ...]  # rows, by cycle and piece
    curve: pl.DataFrame  # as of `branch_curve`

    @property
    def rows(self) -> list[NDArray[np.intp]]:
        """The rows of each cycle."""
        return rows_by_cycle(self.pieces)


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
    zero_at: ZeroAt  # where it was taken
    cycles: Cycles
    loading: Branch
    unloading: Branch

    def series(self) -> Series:
        """Torque and its curve over angle in the rows of all cycles; the curve's end pieces are
        extrapolated."""
        model = np.full(len(self.theta), np.nan)
        for branch in (self.loading, self.unloading):
            angle_deg, torque = branch.curve["angle_deg"], branch.curve["torque"]
            line = scipy.interpolate.make_interp_spline(
                angle_deg.to_numpy(),
                torque.to_numpy(),
                k=1,
                check_finite=False,  # the curve may contain NaN
            )
            for rows in branch.rows:
                model[rows] = line(np.rad2deg(self.theta[rows]))
        return Series(self.uniform.time, self.torque, model, self.theta, np.isfinite(model))

    def vaf(self) -> float:
        """VAF [percent] of the torque by its curve over angle, in the rows of all cycles."""
        series = self.series()
        torque = series.torque[series.fitted]
        return variance_accounted_for(torque, torque - series.torque_model[series.fitted])

    def time_base(self) -> pl.DataFrame:
        """The trial's rows of `timebase.csv`."""
        return timebase_table(self.uniform)

    def desired_torque(self, desired: str | None) -> Array:
        """Torque (m,) [N*m] of a desired curve at the angles of the grid; NaN beyond its ends, and
        of None. Raises InputError: The settings have no such curve."""
        angle_deg = self.loading.curve["angle_deg"].to_numpy()
        curves = self.settings.desired
        if desired is None:
            return np.full(len(angle_deg), np.nan)
        if desired not in curves:
            raise InputError(
                f"trial {self.uniform.trial}: no desired curve '{desired}'; torque_angle.desired in"
                f" the configuration has {', '.join(curves) or 'none'}"
            )
        return curves[desired].at(angle_deg)


def torque_angle_trial(trial: Trial, settings: TorqueAngleAnalysis) -> TorqueAngleTrial:
    """Filter a trial, subtract torque's zero and bench's deflection, find cycles and curves.

    Parameters
    ----------
    trial : Trial
        A recording with `theta` and `torque`.
    settings : TorqueAngleAnalysis
        The choices of the analysis.

    Returns
    -------
    TorqueAngleTrial
        Its signals, cycles and curves.

    Raises
    ------
    InputError
        The joint hardly moves, there is no whole cycle or no rest, cycles are too fast, torque does
        not follow the angle or drives it, or the joint is stiffer than the bench; the message names
        the trial.
    """
    signals = uniform_signals(trial, ("theta", "torque"), settings.gap_limits)
    bench = settings.bench_stiffness
    with naming(f"trial {trial.name}"):
        analysed = torque_angle_of(signals, settings, bench.compliance if bench else 0.0)
    slopes = [straight_line(analysed.theta, analysed.torque, p) for p in analysed.loading.pieces]
    check_stiffer(trial.name, "K", float(np.mean(slopes)), bench)
    return analysed


def torque_angle_of(
    signals: UniformSignals, settings: TorqueAngleAnalysis, compliance: float
) -> TorqueAngleTrial:
    """Analyse uniform signals on a bench of a compliance [rad/(N*m)]; raises as
    `torque_angle_trial`."""
    check_changes("torque", signals["torque"])
    check_changes("theta", signals["theta"])
    low_pass, rate_hz = settings.low_pass, signals.rate_hz
    bench_theta = low_pass(signals["theta"], rate_hz)
    filtered_torque = low_pass(signals["torque"], rate_hz)
    check_moves(bench_theta, settings)

    zero_at = place_of_zero(bench_theta, rate_hz, settings)
    zero = 0.0
    if zero_at != "none":
        zero = float(filtered_torque[rest_rows(zero_at, rate_hz, settings)].mean())
    torque = filtered_torque - zero
    theta = joint_angle(bench_theta, torque, compliance)

    cycles = find_cycles(theta, settings.settle_cycles or 0)
    if settings.settle_cycles is None and first_cycle_settles(torque, cycles.analysed):
        cycles = cycles.without_first()

    loading = pieces_of(theta, cycles, cycles.loading_direction)
    unloading = pieces_of(theta, cycles, -cycles.loading_direction)
    rows_of_branches = rows_by_cycle(loading), rows_by_cycle(unloading)
    angle_deg = common_angles_deg(theta, [*rows_of_branches[0], *rows_of_branches[1]], settings)
    loading_curve, unloading_curve = (
        branch_curve(
            [(theta[of_cycle], torque[of_cycle]) for of_cycle in rows],
            angle_deg,
            settings.window_share * float(np.ptp(theta)),
            low_pass.independent_samples(rate_hz),
        )
        for rows in rows_of_branches
    )
    trial = TorqueAngleTrial(
        uniform=signals,
        settings=settings,
        theta=theta,
        bench_theta=bench_theta,
        torque=torque,
        zero=zero,
        zero_at=zero_at,
        cycles=cycles,
        loading=Branch(loading, loading_curve),
        unloading=Branch(unloading, unloading_curve),
    )
    check_slow(trial)
    check_followed(trial)
    return trial


def first_cycle_settles(torque: Array, cycles: Sequence[Cycle]) -> bool:
    """Whether the torque (n,) of the first cycle does not come back while that of later ones does.

    A device with hysteresis that starts from rest begins within its loop.
    """
    first_gap, *later_gaps = (abs(float(torque[c.stop] - torque[c.start])) for c in cycles)
    if not later_gaps:
        return False
    smallest = SMALLEST_GAP * float(np.ptp(torque))
    return first_gap > max(GAP_OF_FIRST_CYCLE * max(later_gaps), smallest)


def pieces_of(theta: Array, cycles: Cycles, direction: int) -> tuple[tuple[slice, ...], ...]:
    """Rows in which the angle (n,) rises (1) or falls (-1), by cycle and piece."""
    return tuple(tuple(cycle.pieces(theta, direction)) for cycle in cycles.analysed)


def rows_by_cycle(pieces: Sequence[Sequence[slice]]) -> list[NDArray[np.intp]]:
    """The rows of the pieces of each cycle."""
    return [np.r_[*of_cycle] for of_cycle in pieces]


def common_angles_deg(
    theta: Array, rows: Sequence[NDArray[np.intp]], settings: TorqueAngleAnalysis
) -> Array:
    """Angles [deg], multiples of a step, that every branch of every cycle passes. Raises
    InputError: they are too few."""
    low_deg = np.rad2deg(max(float(theta[of_branch].min()) for of_branch in rows))
    high_deg = np.rad2deg(min(float(theta[of_branch].max()) for of_branch in rows))
    step_deg = settings.angle_step_deg
    steps = np.arange(int(np.ceil(low_deg / step_deg)), int(np.floor(high_deg / step_deg)) + 1)
    if len(steps) < FEWEST_ANGLES:
        raise InputError(
            f"of the grid's angles {len(steps)} lie within the motion ({low_deg:.2f} to"
            f" {high_deg:.2f} deg), expected {FEWEST_ANGLES} or more; lower angle_step_deg from"
            f" {step_deg:g} deg to {(high_deg - low_deg) / (2 * FEWEST_ANGLES):.2g} deg or less",
            [Change("", other_unit_of="theta")],
        )
    return np.asarray(steps * step_deg, dtype=np.float64)


def place_of_zero(theta: Array, rate_hz: float, settings: TorqueAngleAnalysis) -> ZeroAt:
    """Where the torque's zero is taken: as stated, else where the joint rests, else nowhere. Raises
    InputError: the joint moves where it should rest."""
    stated = settings.zero
    if stated == "none":
        return stated
    places = (stated,) if stated else ASSUMED_ZEROS
    for place in places:
        rows = rest_rows(place, rate_hz, settings)
        moved = float(np.ptp(theta[rows]))
        is_shorter = rest_samples(rate_hz, settings) < len(theta)
        if is_shorter and moved <= RESTS * np.ptp(theta):
            return place
    if not stated:
        return "none"
    others = [place for place in (*ASSUMED_ZEROS, "none") if place != stated]
    raise InputError(
        f"the joint does not rest at the {stated} of the recording: the angle moves by"
        f" {np.rad2deg(moved):.2g} deg in {settings.rest_s:g} s; record a rest there, or write"
        f" torque_angle.zero: {' or '.join(others)}"
    )


def rest_rows(place: ZeroAt, rate_hz: float, settings: TorqueAngleAnalysis) -> slice:
    """The rows of the rest at the start or end of a recording."""
    count = rest_samples(rate_hz, settings)
    return slice(-count, None) if place == "end" else slice(count)


def rest_samples(rate_hz: float, settings: TorqueAngleAnalysis) -> int:
    """Number of samples of the rest over which the zero is averaged."""
    return max(round(settings.rest_s * rate_hz), 1)


def check_moves(bench_theta: Array, settings: TorqueAngleAnalysis) -> None:
    """Refuse a trial whose joint hardly moves."""
    range_deg = float(np.rad2deg(np.ptp(bench_theta)))
    if range_deg < settings.smallest_motion_deg:
        raise InputError(
            f"the angle moves by {range_deg:.3g} deg in all, expected"
            f" {settings.smallest_motion_deg:g} deg or more; check the"
            " channel of theta and its unit in the source file",
            [Change("", other_unit_of="theta")],
        )


def check_slow(trial: TorqueAngleTrial) -> None:
    """Refuse a trial that is not quasi-static."""
    shortest_s = min(duration_s(trial, cycle) for cycle in trial.cycles.analysed)
    if shortest_s < trial.settings.shortest_cycle_s:
        raise InputError(
            f"a cycle takes {shortest_s:.2g} s, which is not quasi-static: below"
            f" {trial.settings.shortest_cycle_s:g} s (shortest_cycle_s) inertia and damping are in"
            " the torque; record it slower, or take experiment 'impedance' in the sheet"
        )


def check_followed(trial: TorqueAngleTrial) -> None:
    """Refuse a trial whose torque does not follow the angle, or drives it."""
    vaf = trial.vaf()
    if vaf < LEAST_VAF:
        rows = np.concatenate([*trial.loading.rows, *trial.unloading.rows])
        raise InputError(
            f"torque does not follow the angle: its curve over angle accounts for {vaf:.3g} % of"
            f" its variance, and it changes by {np.ptp(trial.torque[rows]):.3g} N*m; check the"
            " torque's channel and the mounting of the load cell"
        )
    slope = straight_line(trial.theta, trial.torque, trial.loading.pieces[0])
    if slope < 0:
        raise InputError(
            f"K = {slope:.4g} N*m/rad is negative, so the torque drives the motion instead of"
            " resisting it; check the channels of torque and angle in the source file",
            [TURN_TORQUE],
        )


def duration_s(trial: TorqueAngleTrial, cycle: Cycle) -> float:
    """Duration [s] of a cycle without the rests before and after the motion."""
    moves = between_rests(trial.theta)
    time = trial.uniform.time
    rows: int = min(cycle.stop, moves.stop - 1) - max(cycle.start, moves.start)
    return rows * float(time[1] - time[0])


def zero_row(trial: TorqueAngleTrial, widest: float) -> Row:
    """The torque taken as zero, and the evidence against it, as columns of the table.

    `widest` [N*m] is the largest width of the loop. The torque at rest may be due to hysteresis,
    or, if no zero is stated, to a load at rest. A torque due to hysteresis lies on a branch of the
    loop, not in its middle, to which friction relaxes at rest. If the joint rests at an end of the
    motion, the loop cannot tell; then a zero that is small against the loop does not matter.
    """
    zero = trial.zero_at
    torque_range = float(np.ptp(trial.torque))
    middle = middle_of_loop_at_rest(trial, zero)
    if middle is None:
        is_unsure = widest > 0.02 * torque_range and abs(trial.zero) > 0.1 * widest
    else:
        is_unsure = abs(middle.torque) > max(0.25 * middle.width, 0.005 * torque_range)
    if trial.settings.zero is None and abs(trial.zero) > 0.005 * torque_range:
        is_unsure = True  # it may rest under load
    zero_unsure = None
    if is_unsure and zero != "none":
        evidence = trial.zero
        if trial.settings.zero is not None and middle is not None and middle.torque:
            evidence = middle.torque
        zero_unsure = abs(evidence)
    return {
        "torque_zero": None if zero == "none" and trial.settings.zero is None else trial.zero,
        "zero_off_middle": None if zero == "none" or middle is None else -middle.torque,
        "rest_change": change_between_rests(trial) if zero == "end" else None,
        "zero_unsure": zero_unsure,
    }


@dataclass(frozen=True)
class LoopAtRest:
    """The loop at the angle at which the joint rests."""

    torque: float  # in the middle of the two branches [N*m]
    width: float  # [N*m]


def middle_of_loop_at_rest(trial: TorqueAngleTrial, zero: str) -> LoopAtRest | None:
    """The loop around the rest at the start or end; None if the joint rests beyond its angles."""
    angle_deg = trial.loading.curve["angle_deg"].to_numpy()
    rest_deg = float(np.rad2deg(trial.theta[0 if zero == "start" else -1]))
    if not angle_deg[0] <= rest_deg <= angle_deg[-1]:
        return None
    loading, unloading = (
        float(np.interp(rest_deg, angle_deg, branch.curve["torque"].to_numpy()))
        for branch in (trial.loading, trial.unloading)
    )
    return LoopAtRest((loading + unloading) / 2, abs(loading - unloading))


def change_between_rests(trial: TorqueAngleTrial) -> float | None:
    """The torque at rest at the end minus that at the start, as a share of its range; None if the
    joint does not rest at both, at one angle."""
    count = rest_samples(trial.uniform.rate_hz, trial.settings)
    both_rests = np.concatenate([trial.bench_theta[:count], trial.bench_theta[-count:]])
    if float(np.ptp(both_rests)) > RESTS * float(np.ptp(trial.bench_theta)):
        return None
    change = trial.torque[-count:].mean() - trial.torque[:count].mean()
    return float(change / float(np.ptp(trial.torque)))
