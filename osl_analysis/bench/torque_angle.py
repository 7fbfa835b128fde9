"""Torque against angle, quasi-static, of passive feet, springs and series elastic elements: cycles and curves.

Torque's zero and the yielding of the bench itself are taken off first.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.alternatives import check_stiffer, joint_angle
from osl_analysis.bench.angle_cycles import Cycles, find_cycles, joined, moving
from osl_analysis.bench.diagnostics import check_changes
from osl_analysis.bench.series import Series
from osl_analysis.bench.torque_angle_curve import (
    Curve,
    Energies,
    Smoothing,
    branch_curve,
    energies,
    grid_deg,
    straight_line,
)
from osl_analysis.bench.torque_angle_settings import TorqueAngleAnalysis
from osl_analysis.bench.torque_angle_zero import torque_zero
from osl_analysis.errors import InputError
from osl_analysis.stats.regression import variance_accounted_for
from osl_analysis.trial import Array, Trial
from osl_analysis.uniform import UniformSignals, uniform_signals

LEAST_VAF = 50.0
"""VAF [percent] of the torque by its curve over angle below which the torque does not follow the angle."""


@dataclass(frozen=True)
class TorqueAngleTrial:
    """One trial: filtered signals, shape (n,) each, cycles, and curves at the angles of the grid, (m,)."""

    name: str
    """Name of the trial."""
    time: Array
    """Time [s]."""
    theta: Array
    """Angle of the joint [rad], without the bench's yielding."""
    bench_theta: Array
    """Angle of the bench [rad]."""
    torque: Array
    """Resisting torque [N*m] from its zero."""
    zero: float
    """Torque [N*m] that was taken for zero."""
    cycles: Cycles
    """Its cycles."""
    angle_deg: Array
    """Angles of the grid [deg]."""
    curves: tuple[Curve, Curve]
    """Loading and unloading."""
    settings: TorqueAngleAnalysis
    """The choices of the analysis."""
    uniform: UniformSignals
    """The signals on their time base."""

    def rows(self, branch: int) -> list[NDArray[np.intp]]:
        """Rows of a branch, 0 loading or 1 unloading, cycle by cycle."""
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

    Raises
    ------
    InputError
        The joint hardly moves, there is no whole cycle or no rest, cycles are too fast, torque does not follow the
        angle or drives it, or the joint is stiffer than the bench; the message names the trial.
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
    check_moves(bench_theta, settings)
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
    found = TorqueAngleTrial(
        signals.trial,
        signals.time,
        theta,
        bench_theta,
        torque,
        zero,
        cycles,
        at,
        (loading, unloading),
        settings,
        signals,
    )
    check_slow(found)
    check_follows(found)
    return found


def check_moves(theta: Array, settings: TorqueAngleAnalysis) -> None:
    """Refuse an angle (n,) [rad] that hardly moves."""
    if (range_deg := float(np.rad2deg(np.ptp(theta)))) < settings.smallest_motion_deg:
        raise InputError(
            f"the angle moves by {range_deg:.3g} deg in all, expected {settings.smallest_motion_deg:g} deg or more "
            "(smallest_motion_deg); check the channel of theta and its unit in the source file"
        )


def check_slow(trial: TorqueAngleTrial) -> None:
    """Refuse cycles whose torque has inertia and damping in it."""
    shortest = float(trial.durations().min())
    if shortest < trial.settings.shortest_cycle_s:
        raise InputError(
            f"a cycle takes {shortest:.2g} s, which is not quasi-static: below {trial.settings.shortest_cycle_s:g} s "
            "(shortest_cycle_s) inertia and damping are in the torque; record it slower, or take experiment 'impedance'"
        )


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
