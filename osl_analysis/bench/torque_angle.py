"""Torque against angle, quasi-static, of passive feet, springs and series elastic elements.

The torque's zero and the deflection of the bench are subtracted first. A device with hysteresis
that comes to rest on its way keeps a torque of up to half the width of its loop. One recording
cannot tell this from an offset; the loop around the rest shows that it may be present.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import polars as pl

from osl_analysis.bench.analysis import torque_errors
from osl_analysis.bench.bench_settings import TorqueAngleAnalysis
from osl_analysis.bench.fit_tables import Series, timebase_table
from osl_analysis.bench.loops import Cycle, energies, find_cycles
from osl_analysis.bench.plausibility import check_changes, check_resists, check_stiffer
from osl_analysis.bench.record import joint_angle
from osl_analysis.dictionary import table_of
from osl_analysis.errors import Change, InputError, naming
from osl_analysis.signals.grid import UniformSignals, uniform_signals
from osl_analysis.stats.linear_fit import variance_accounted_for
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.stats.table_rows import Row
from osl_analysis.trial import Array, Trial

BRANCHES = ("loading", "unloading")
FEWEST_ANGLES = 5  # of a curve
FEWEST_SAMPLES = 10  # of a parabola
LEAST_VAF = 50.0  # [percent] of the torque by its curve; below it the torque does not follow
SMALL_ZERO = 0.1  # of the widest loop: a smaller zero does not matter
OFF_MIDDLE = 0.25  # of the loop's width: a torque at rest beyond it is not in the middle
RESTS = 0.01  # of the range of motion: the joint is at rest within it
GAP_OF_FIRST_CYCLE = 3.0  # times the largest gap of later ones: a first cycle beyond is settling
SMALLEST_GAP = 0.005  # of the range of torque: a gap, or a zero, that does not matter


@dataclass(frozen=True)
class TorqueAngle:
    """One trial: filtered signals, shape (n,) each, cycles, and curves at the angles of the grid.

    Attributes
    ----------
    signals : UniformSignals
        On their time base.
    settings : TorqueAngleAnalysis
    theta : Array
        Angle of the joint [rad], without the deflection of the bench.
    torque : Array
        Resisting torque from its zero [N*m].
    zero : float or None
        Recorded torque that was taken as zero [N*m]; None: it is as recorded, since nobody states
        a zero and the joint rests at neither end.
    rest : int or None
        Row of the rest, 0 or -1; None: there is none.
    cycles : sequence of Cycle
    others : int
        Further stretches of motion, which are smaller or do not close.
    loading : int
        1 if the angle rises while loading, to the end that is farther from the start; else -1.
    angle_deg : Array
        Angles (m,) of the curves [deg].
    curves : Array
        Torque [N*m] and its slope [N*m/rad] at them, by branch and cycle, (2, cycles, 2, m). NaN
        out of a branch's reach.
    """

    signals: UniformSignals
    settings: TorqueAngleAnalysis
    theta: Array
    torque: Array
    zero: float | None
    rest: Literal[0, -1] | None
    cycles: Sequence[Cycle]
    others: int
    loading: int
    angle_deg: Array
    curves: Array

    def series(self) -> Series:
        """Torque and its mean curve over angle in the rows of all cycles."""
        model = np.full(len(self.theta), np.nan)
        theta_deg = np.rad2deg(self.theta)
        for curve, direction in zip(self.mean_torque, (self.loading, -self.loading), strict=True):
            rows = np.concatenate([cycle.branch(self.theta, direction) for cycle in self.cycles])
            model[rows] = np.interp(theta_deg[rows], self.angle_deg, curve, np.nan, np.nan)
        return Series(self.signals.time, self.torque, model, self.theta, np.isfinite(model))

    @property
    def mean_torque(self) -> Array:
        """Means over the cycles of the curves of loading and unloading, (2, m) [N*m]."""
        return np.asarray(self.curves[:, :, 0].mean(axis=1))

    def time_base(self) -> pl.DataFrame:
        """The trial's rows of `timebase.csv`."""
        return timebase_table(self.signals)

    def desired_torque(self, desired: str | None) -> Array:
        """Torque (m,) [N*m] of a desired curve at the angles of the grid; NaN beyond its ends, and
        of None. Raises InputError: the settings have no such curve."""
        curves = self.settings.desired
        if desired is None:
            return np.full(len(self.angle_deg), np.nan)
        if desired not in curves:
            raise InputError(
                f"trial {self.signals.trial}: no desired curve '{desired}'; torque_angle.desired in"
                f" the configuration has {', '.join(curves) or 'none'}"
            )
        return curves[desired].at(self.angle_deg)


def torque_angle_trial(trial: Trial, settings: TorqueAngleAnalysis) -> TorqueAngle:
    """Filter a trial, subtract torque's zero and bench's deflection, find cycles and curves.

    Parameters
    ----------
    trial : Trial
        A recording with `theta` and `torque`.
    settings : TorqueAngleAnalysis

    Raises
    ------
    InputError
        The joint hardly moves, there is no whole cycle or no rest, cycles are too fast, torque does
        not follow the angle or drives it, or the joint is stiffer than the bench; the message names
        the trial.
    """
    signals = uniform_signals(trial, ("theta", "torque"), settings.gap_limits)
    rate_hz = signals.rate_hz
    bench = settings.bench_stiffness
    with naming(f"trial {trial.name}"):
        for column in ("torque", "theta"):
            check_changes(column, signals[column])
        bench_theta = settings.low_pass(signals["theta"], rate_hz)
        torque = settings.low_pass(signals["torque"], rate_hz)
        check_moves(bench_theta, settings)
        rest_samples = max(round(settings.rest_s * rate_hz), 1)
        rest = place_of_rest(bench_theta, rest_samples, settings)
        zero = 0.0 if settings.zero == "none" else None
        if rest is not None:
            zero = float(torque[rest_rows(rest, rest_samples)].mean())
        torque = torque - (zero or 0.0)
        theta = joint_angle(bench_theta, torque, bench.compliance if bench else 0.0)

        cycles, others = find_cycles(theta)
        check_slow(theta, cycles, settings, rate_hz)
        settled = settings.settle_cycles
        if settled is None:
            settled = int(first_cycle_settles(torque, cycles))
        if len(cycles) <= settled:
            raise InputError(
                f"the first {settled} of {len(cycles)} whole cycles are not analysed; record more,"
                " or lower settle_cycles"
            )
        cycles = cycles[settled:]
        begin = theta[cycles[0].edges[0]]
        loading = 1 if theta.max() - begin >= begin - theta.min() else -1
        angle_deg = angles_of_curves_deg(theta, settings)
        window = settings.window_share * float(np.ptp(theta))
        curves = []
        for direction in (loading, -loading):
            branches = [cycle.branch(theta, direction) for cycle in cycles]
            curves.append(
                [curve_of(theta[b], torque[b], np.deg2rad(angle_deg), window) for b in branches]
            )
        analysed = TorqueAngle(
            signals=signals,
            settings=settings,
            theta=theta,
            torque=torque,
            zero=zero,
            rest=rest,
            cycles=cycles,
            others=others,
            loading=loading,
            angle_deg=angle_deg,
            curves=np.array(curves),
        )
        check_followed(analysed)
    K = measured_cycles(theta, torque, cycles, loading)["K"]
    check_resists(trial.name, "K", float(K.mean()))
    check_stiffer(trial.name, "K", float(K.mean()), bench)
    return analysed


def first_cycle_settles(torque: Array, cycles: Sequence[Cycle]) -> bool:
    """Whether the torque (n,) of the first cycle does not come back while that of later ones does:
    a device with hysteresis that starts from rest begins within its loop."""
    gaps = [abs(float(torque[cycle.edges[-1]] - torque[cycle.edges[0]])) for cycle in cycles]
    if len(gaps) < 2:
        return False
    smallest = SMALLEST_GAP * float(np.ptp(torque))
    return gaps[0] > max(GAP_OF_FIRST_CYCLE * max(gaps[1:]), smallest)


def rest_rows(rest: Literal[0, -1], count: int) -> slice:
    """The `count` rows at the start (0) or the end (-1) of a recording."""
    return slice(count) if rest == 0 else slice(-count, None)


def place_of_rest(theta: Array, count: int, settings: TorqueAngleAnalysis) -> Literal[0, -1] | None:
    """Where the joint rests for `count` rows, as stated, else at the end, at the start, or nowhere.

    Raises
    ------
    InputError
        The joint moves where it should rest.
    """
    if settings.zero == "none":
        return None
    places: dict[str, Literal[0, -1]] = {"end": -1, "start": 0}
    for name, place in places.items():
        if settings.zero not in (None, name):
            continue
        moved = float(np.ptp(theta[rest_rows(place, count)]))
        if count < len(theta) and moved <= RESTS * np.ptp(theta):
            return place
        if settings.zero == name:
            raise InputError(
                f"the joint does not rest at the {name} of the recording: the angle moves by"
                f" {np.rad2deg(moved):.2g} deg in {settings.rest_s:g} s; record a rest there, or"
                " state another torque_angle.zero"
            )
    return None


def angles_of_curves_deg(theta: Array, settings: TorqueAngleAnalysis) -> Array:
    """Angles [deg] within the motion, multiples of a step. Raises InputError: they are too few."""
    step_deg = settings.angle_step_deg
    low, high = np.rad2deg([theta.min(), theta.max()]) / step_deg
    steps = np.arange(np.ceil(low), np.floor(high) + 1)
    if len(steps) < FEWEST_ANGLES:
        raise InputError(
            f"{len(steps)} multiples of angle_step_deg = {step_deg:g} lie within the motion,"
            f" expected {FEWEST_ANGLES} or more; lower it",
            [Change("", other_unit_of="theta")],
        )
    return np.asarray(steps * step_deg)


def curve_of(theta: Array, torque: Array, angles: Array, window: float) -> Array:
    """Torque [N*m] and slope [N*m/rad] of a branch at angles (m,) [rad], (2, m).

    They are those of parabolas through the samples of angle and torque (n,) within a window [rad].
    The torque is NaN with too few of them, the slope also where the branch does not reach both ends
    of the window.
    """
    curve = np.full((2, len(angles)), np.nan)
    for k, at in enumerate(angles):
        near = np.abs(theta - at) <= window
        if np.count_nonzero(near) < FEWEST_SAMPLES or np.ptp(theta[near]) < window / 2:
            continue
        _, slope, value = np.polyfit((theta[near] - at) / window, torque[near], 2)
        reaches_ends = theta.min() <= at - window and theta.max() >= at + window
        curve[:, k] = value, slope / window if reaches_ends else np.nan
    return curve


def check_moves(theta: Array, settings: TorqueAngleAnalysis) -> None:
    """Refuse a trial whose joint hardly moves."""
    range_deg = float(np.rad2deg(np.ptp(theta)))
    if range_deg < settings.smallest_motion_deg:
        raise InputError(
            f"the angle moves by {range_deg:.3g} deg in all, expected"
            f" {settings.smallest_motion_deg:g} deg or more; check the"
            " channel of theta and its unit in the source file",
            [Change("", other_unit_of="theta")],
        )


def speed_of(theta: Array, rate_hz: float) -> float:
    """Mean speed [rad/s] over the way of an angle (n,), so that rests do not count."""
    steps = np.abs(np.diff(theta))
    return float(steps @ steps / steps.sum()) * rate_hz


def check_slow(
    theta: Array, cycles: Sequence[Cycle], settings: TorqueAngleAnalysis, rate_hz: float
) -> None:
    """Refuse cycles that are not quasi-static."""
    for cycle in cycles:
        angle = theta[cycle.rows]
        duration_s = np.abs(np.diff(angle)).sum() / speed_of(angle, rate_hz)
        if duration_s < settings.shortest_cycle_s:
            raise InputError(
                f"a cycle takes {duration_s:.2g} s, which is not quasi-static: below"
                f" {settings.shortest_cycle_s:g} s (shortest_cycle_s) inertia and damping are in"
                " the torque; record it slower, or take experiment 'impedance' in the sheet"
            )


def check_followed(trial: TorqueAngle) -> None:
    """Refuse a trial whose torque does not follow the angle."""
    vaf = vaf_of(trial)
    if vaf < LEAST_VAF:
        raise InputError(
            f"torque does not follow the angle: its curve over angle accounts for {vaf:.3g} % of"
            f" its variance, and it changes by {np.ptp(trial.torque):.3g} N*m; check the torque's"
            " channel and the mounting of the load cell"
        )


def vaf_of(trial: TorqueAngle) -> float:
    """VAF [percent] of the torque by its curve over angle, in the rows of all cycles."""
    series = trial.series()
    torque = series.torque[series.fitted]
    return variance_accounted_for(torque, torque - series.torque_model[series.fitted])


def measured_cycles(
    theta: Array, torque: Array, cycles: Sequence[Cycle], loading: int
) -> dict[str, Array]:
    """Slopes [N*m/rad] and energies [J] of each cycle, (cycles,), by the columns of the table.

    K is that of least squares over angle: each sample has the weight of the angle that it covers,
    so that a rest on the way, or a slower end, does not count more.
    """
    rows = []
    for cycle in cycles:
        slopes = []
        for direction in (loading, -loading):
            branch = cycle.branch(theta, direction)
            covered = np.sqrt(np.abs(np.gradient(theta)[branch]))
            slopes.append(np.polyfit(theta[branch], torque[branch], 1, w=covered)[0])
        loaded = cycle.branch(theta, loading)
        ends = loaded[[np.argmin(theta[loaded]), np.argmax(theta[loaded])]]
        secant = np.ptp(torque[ends]) / np.ptp(theta[ends])
        stored, returned = energies(theta[cycle.rows], torque[cycle.rows])
        rows.append((*slopes, secant, stored, returned, stored - returned))
    names = ("K", "K_unloading", "K_secant", "energy_stored", "energy_returned", "energy_lost")
    return dict(zip(names, np.transpose(rows), strict=True))


def torque_angle_table(trial: TorqueAngle, desired: str | None = None) -> pl.DataFrame:
    """The trial's row of `torque_angle.csv`.

    Parameters
    ----------
    trial : TorqueAngle
    desired : str, optional
        Name of the curve that it should follow, of `torque_angle.desired` in the configuration.

    Returns
    -------
    pl.DataFrame
        One row. Intervals are of the mean over cycles (Student), with the errors of the bench; null
        with one cycle.

    Raises
    ------
    InputError
        No such curve.
    """
    theta, torque, cycles = trial.theta, trial.torque, trial.cycles
    theta_range, torque_range = float(np.ptp(theta)), float(np.ptp(torque))
    begins = [cycle.edges[0] for cycle in cycles]
    ends = [cycle.edges[-1] for cycle in cycles]
    of_cycles = np.concatenate([np.r_[cycle.rows] for cycle in cycles])
    wanted = trial.desired_torque(desired)
    middle = trial.mean_torque.mean(axis=0)
    is_compared = np.isfinite(middle + wanted)
    desired_ratio = None
    if np.count_nonzero(is_compared) > 2:
        desired_ratio = float(np.polyfit(wanted[is_compared], middle[is_compared], 1)[0])
    row: Row = {
        "trial": trial.signals.trial,
        "cycles": len(cycles),
        "other_cycles": trial.others,
        "loading": "rising" if trial.loading == 1 else "falling",
        "angle_min_deg": float(np.rad2deg(theta.min())),
        "angle_max_deg": float(np.rad2deg(theta.max())),
        **zero_row(trial),
        **means_row(trial),
        "interval_method": "cycles" if len(cycles) > 1 else None,
        "VAF": vaf_of(trial),
        "speed_deg_s": np.rad2deg(speed_of(theta[of_cycles], trial.signals.rate_hz)),
        "closure_angle": float(np.abs(theta[ends] - theta[begins]).max()) / theta_range,
        "closure_torque": float(np.abs(torque[ends] - torque[begins]).max()) / torque_range,
        "bridged_share": float(np.mean(~trial.signals.usable[of_cycles])),
        "desired": desired,
        "desired_ratio": desired_ratio,
    }
    return table_of([row], "torque_angle")


def means_row(trial: TorqueAngle) -> Row:
    """Means over the cycles with 95 % intervals, which hold the stated errors of the bench: of
    torque and angle, of the load cell's hysteresis and delay, and of the bench's stiffness."""
    theta, torque, settings = trial.theta, trial.torque, trial.settings
    moved = np.r_[trial.cycles[0].edges[0] : trial.cycles[-1].edges[-1]]
    gain_error = settings.calibration.polar(0.0)[0]
    errors = torque_errors(torque, trial.signals.rate_hz, moved, settings.calibration)
    changed = [(theta, torque + error) for error in (gain_error * torque, *errors)]
    if settings.bench_stiffness is not None:
        changed.append((theta - settings.bench_stiffness.compliance_error * torque, torque))

    by_cycle = measured_cycles(theta, torque, trial.cycles, trial.loading)
    others = [measured_cycles(*signals, trial.cycles, trial.loading) for signals in changed]
    row: Row = {}
    for name, values in by_cycle.items():
        changes = [other[name].mean() - values.mean() for other in others]
        row[name] = float(values.mean())
        row[f"{name}_low"] = row[f"{name}_high"] = None
        if len(values) > 1:
            repeats = over_repeats(values, [(float(np.square(changes).sum()), np.inf)])
            row[f"{name}_low"] = repeats.low
            row[f"{name}_high"] = repeats.high
    row["returned_share"] = float(
        by_cycle["energy_returned"].sum() / by_cycle["energy_stored"].sum()
    )
    return row


def zero_row(trial: TorqueAngle) -> Row:
    """The torque taken as zero, and the evidence against it, as columns of the table.

    The torque at rest may be due to hysteresis: then it lies on a branch of the loop, not in its
    middle, to which friction relaxes at rest. At an end of the motion the loop cannot tell, and a
    zero that is small against it does not matter. If nobody states a zero, it may be load.
    """
    row: Row = {"torque_zero": trial.zero, "zero_unsure": None, "assumed_zero_share": None}
    if trial.rest is None or trial.zero is None:
        return row
    torque_range = float(np.ptp(trial.torque))
    if trial.settings.zero is None:
        row["assumed_zero_share"] = abs(trial.zero) / torque_range
    loading, unloading = trial.mean_torque
    width = np.abs(loading - unloading)
    unsure = trial.zero
    least = SMALL_ZERO * float(np.nanmax(width))
    rest = trial.theta[trial.rest]
    window = trial.settings.window_share * float(np.ptp(trial.theta))
    if trial.theta.min() + window < rest < trial.theta.max() - window:
        at_rest = np.argmin(np.abs(np.deg2rad(trial.angle_deg) - rest))
        unsure = float(loading[at_rest] + unloading[at_rest]) / 2
        least = OFF_MIDDLE * width[at_rest]
    if abs(unsure) > max(least, SMALLEST_GAP * torque_range):
        row["zero_unsure"] = abs(unsure)
    return row


def curve_table(trial: TorqueAngle, desired: str | None = None) -> pl.DataFrame:
    """The trial's rows of `torque_angle_curves.csv`, the means over the cycles per branch and
    angle; raises as `torque_angle_table`."""
    frames = []
    for branch, (torque, stiffness) in zip(BRANCHES, trial.curves.mean(axis=1), strict=True):
        columns = {
            "angle_deg": trial.angle_deg,
            "torque": torque,
            "stiffness": stiffness,
            "desired_torque": trial.desired_torque(desired),
        }
        texts = {"trial": trial.signals.trial, "branch": branch, "desired": desired}
        constants = {name: pl.lit(text, pl.String) for name, text in texts.items()}
        frames.append(pl.DataFrame(columns).with_columns(**constants))
    return pl.concat(frames).fill_nan(None)
