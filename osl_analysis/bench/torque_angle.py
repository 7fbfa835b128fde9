"""Torque against angle, quasi-static, of passive feet, springs and series elastic elements; and the
cycles of any slow motion to and fro: where each begins, turns and ends, and the energy in it.

The torque's zero and the deflection of the bench are subtracted first. A device with hysteresis
that comes to rest on its way keeps a torque of up to half the width of its loop. One recording
cannot tell this from an offset.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.bench_settings import TorqueAngleAnalysis
from osl_analysis.bench.impedance import torque_errors
from osl_analysis.bench.motion import signals_of
from osl_analysis.bench.plausibility import check_changes, check_resists, check_stiffer
from osl_analysis.dictionary import table_of
from osl_analysis.errors import Change, InputError, naming
from osl_analysis.stats.estimates import Row
from osl_analysis.stats.linear_fit import variance_accounted_for
from osl_analysis.stats.repeats import summary_row
from osl_analysis.trial import Array, Trial

MEASURED = ("K", "K_unloading", "energy_stored", "energy_returned", "energy_lost")
FEWEST_ANGLES = 5  # of a curve
FEWEST_SAMPLES = 10  # of a parabola
RESTS = 0.01  # of the range of motion: the joint is at rest within it
TURNING_SHARE = 0.1  # of the range of motion: a smaller return is no turning point
AT_AN_END = 0.1  # of the range of motion: a start this near an end counts as this end
CLOSED = 0.02  # of the range of motion: largest distance between the ends of a cycle
WHOLE = 0.9  # of the range of motion: a cycle that covers less is a smaller one


Cycle = tuple[int, ...]
"""A closed cycle of an angle, by rows: where it begins, turns (once or more often) and ends."""


@dataclass(frozen=True)
class TorqueAngle:
    """What one trial tells."""

    samples: pl.DataFrame  # torque, and its curve over angle in the rows of all cycles
    streams: Sequence[Mapping[str, Any]]  # how its signals came on their time base
    table: pl.DataFrame  # the trial's row of `torque_angle.csv`
    curves: pl.DataFrame  # its rows of `torque_angle_curves.csv`


def torque_angle_trial(
    trial: Trial, settings: TorqueAngleAnalysis, desired: str | None = None
) -> TorqueAngle:
    """Filter a trial, subtract torque's zero and bench's deflection, find cycles and curves.

    Parameters
    ----------
    trial : Trial
        A recording with `theta` and `torque`.
    settings : TorqueAngleAnalysis
    desired : str, optional
        Name of the curve that it should follow, of `torque_angle.desired` in the configuration.

    Returns
    -------
    TorqueAngle
        Its intervals are of the mean over cycles (Student), with the errors of the bench; null with
        one cycle.

    Raises
    ------
    InputError
        The joint hardly moves, there is no whole cycle or no rest, cycles are too fast, the torque
        drives the angle, the joint is stiffer than the bench, or no curve has this name; the
        message names the trial.
    """
    signals = signals_of(trial, ("theta", "torque"), settings)
    rate_hz = signals.rate_hz
    bench = settings.bench_stiffness
    with naming(f"trial {trial.name}"):
        if desired not in (None, *settings.desired):
            raise InputError(
                f"no desired curve '{desired}'; torque_angle.desired in the configuration has"
                f" {', '.join(settings.desired) or 'none'}"
            )
        for column in ("torque", "theta"):
            check_changes(column, signals[column])
        bench_theta = settings.low_pass(signals["theta"], rate_hz)
        recorded = settings.low_pass(signals["torque"], rate_hz)
        zero = torque_at_rest(bench_theta, recorded, rate_hz, settings)
        torque = recorded - (zero or 0.0)
        theta = settings.joint_angle(bench_theta, torque)
        angle_deg = angles_of_curves_deg(theta, settings.angle_step_deg)
        found, others = find_cycles(theta)
        cycles = found[settings.settle_cycles :]
        if not cycles:
            raise InputError(
                f"all {len(found)} whole cycles are left out by settle_cycles; lower it, or record"
                " more"
            )
        check_slow(theta, cycles, settings.shortest_cycle_s, rate_hz)
        begin = theta[cycles[0][0]]
        loading = 1 if theta.max() - begin >= begin - theta.min() else -1
        estimates = means_row(theta, torque, cycles, loading, rate_hz, settings)
    check_resists(trial.name, "K", estimates["K"])
    check_stiffer(trial.name, "K", estimates["K"], bench)

    angles = np.deg2rad(angle_deg)
    model = np.full(len(theta), np.nan)
    curves = []
    for branch, direction in (("loading", loading), ("unloading", -loading)):
        rows = branch_rows(cycles, theta, direction)
        curve, slope = curve_of(theta[rows], torque[rows], angles, settings.window_share)
        model[rows] = np.interp(theta[rows], angles, curve, np.nan, np.nan)
        columns = {
            "trial": trial.name,
            "branch": branch,
            "angle_deg": angle_deg,
            "torque": curve,
            "stiffness": slope,
            "desired_torque": settings.desired[desired].at(angle_deg) if desired else np.nan,
        }
        curves.append(pl.DataFrame(columns).with_columns(desired=pl.lit(desired, pl.String)))
    fitted = np.isfinite(model)
    of_cycles = np.concatenate([np.r_[whole(cycle)] for cycle in cycles])
    ends = [[cycle[0], cycle[-1]] for cycle in cycles]
    row: Row = {
        "trial": trial.name,
        "cycles": len(cycles),
        "other_cycles": others,
        "loading": "rising" if loading == 1 else "falling",
        "angle_min_deg": np.rad2deg(theta.min()),
        "angle_max_deg": np.rad2deg(theta.max()),
        "torque_zero": zero,
        **estimates,
        "interval_method": "cycles" if len(cycles) > 1 else None,
        "VAF": variance_accounted_for(torque[fitted], torque[fitted] - model[fitted]),
        "closure_torque": np.ptp(torque[ends], axis=1).max() / np.ptp(torque),
        "bridged_share": np.mean(~signals.usable[of_cycles]),
        "desired": desired,
    }
    samples = {
        "time": signals.time,
        "theta_deg": np.rad2deg(theta),
        "torque": torque,
        "torque_model": model,
        "is_fitted": fitted,
    }
    return TorqueAngle(
        pl.DataFrame(samples),
        signals.streams,
        table_of([row], "torque_angle"),
        pl.concat(curves).fill_nan(None),
    )


def torque_at_rest(
    theta: Array, torque: Array, rate_hz: float, settings: TorqueAngleAnalysis
) -> float | None:
    """Mean torque [N*m] where the joint rests as stated; 0 of a torque that is stated to have its
    zero, None where nothing is stated. Raises InputError: the joint moves there."""
    if settings.zero in (None, "none"):
        return 0.0 if settings.zero else None
    count = max(round(settings.rest_s * rate_hz), 1)
    rest = slice(count) if settings.zero == "start" else slice(-count, None)
    moved = float(np.ptp(theta[rest]))
    if count >= len(theta) or moved > RESTS * np.ptp(theta):
        raise InputError(
            f"the joint does not rest at the {settings.zero} of the recording: the angle moves by"
            f" {np.rad2deg(moved):.2g} deg in {settings.rest_s:g} s; record a rest there, or"
            " state another torque_angle.zero"
        )
    return float(torque[rest].mean())


def angles_of_curves_deg(theta: Array, step_deg: float) -> Array:
    """Angles [deg] within the motion, multiples of a step. Raises InputError: they are too few."""
    low, high = np.rad2deg([theta.min(), theta.max()]) / step_deg
    steps = np.arange(np.ceil(low), np.floor(high) + 1)
    if len(steps) < FEWEST_ANGLES:
        raise InputError(
            f"the angle moves by {(high - low) * step_deg:.3g} deg in all, and {len(steps)}"
            f" multiples of angle_step_deg = {step_deg:g} lie within, expected {FEWEST_ANGLES} or"
            " more; check the channel of theta and its unit in the source file, or lower it",
            [Change("", other_unit_of="theta")],
        )
    return np.asarray(steps * step_deg)


def curve_of(
    theta: Array, torque: Array, angles: Array, window_share: float
) -> tuple[Array, Array]:
    """Torque [N*m] and slope [N*m/rad] of a branch at angles (m,) [rad].

    They are those of parabolas through the samples of angle and torque (n,) within a share of the
    range to each side; NaN with too few of them, the slope also where a side is beyond the range.
    """
    low, high = theta.min(), theta.max()
    window = window_share * (high - low)
    value, slope = np.full((2, len(angles)), np.nan)
    for k, at in enumerate(angles):
        near = np.abs(theta - at) <= window
        if np.count_nonzero(near) >= FEWEST_SAMPLES:
            _, slope[k], value[k] = np.polyfit((theta[near] - at) / window, torque[near], 2)
    slope[(angles < low + window) | (angles > high - window)] = np.nan
    return value, slope / window


def check_slow(theta: Array, cycles: Sequence[Cycle], shortest_s: float, rate_hz: float) -> None:
    """Refuse cycles that are not quasi-static."""
    for cycle in cycles:
        angle = theta[whole(cycle)]
        steps = np.abs(np.diff(angle))
        # by the mean speed over the way, so that rests do not count
        duration_s = 2 * np.ptp(angle) * steps.sum() / (steps @ steps * rate_hz)
        if duration_s < shortest_s:
            raise InputError(
                f"a cycle takes {duration_s:.2g} s, which is not quasi-static: below"
                f" {shortest_s:g} s (shortest_cycle_s) inertia and damping are in the torque;"
                " record it slower, or take experiment 'impedance' in the sheet"
            )


def measured(theta: Array, torque: Array, cycles: Sequence[Cycle], loading: int) -> Array:
    """Slopes [N*m/rad] and energies [J] of each cycle, (cycles, 5), in the order of `MEASURED`.

    Slopes are those of least squares over angle: each sample has the weight of the angle that it
    covers, so that a rest on the way, or a slower end, does not count more.
    """
    covered = np.sqrt(np.abs(np.gradient(theta)))
    rows = []
    for cycle in cycles:
        branches = [branch_rows([cycle], theta, direction) for direction in (loading, -loading)]
        slopes = [np.polyfit(theta[b], torque[b], 1, w=covered[b])[0] for b in branches]
        stored, returned = energies(theta[whole(cycle)], torque[whole(cycle)])
        rows.append((*slopes, stored, returned, stored - returned))
    return np.array(rows)


def means_row(
    theta: Array,
    torque: Array,
    cycles: Sequence[Cycle],
    loading: int,
    rate_hz: float,
    settings: TorqueAngleAnalysis,
) -> dict[str, Any]:
    """Means over the cycles with 95 % intervals, which hold the stated errors of the bench: of
    torque and angle, of the load cell's hysteresis and delay, and of the bench's stiffness."""
    calibration, bench = settings.calibration, settings.bench_stiffness
    moved = np.r_[cycles[0][0] : cycles[-1][-1]]
    gain_error = calibration.polar(0.0)[0]
    errors = torque_errors(torque, rate_hz, moved, calibration)
    changed = [(theta, torque + error) for error in (gain_error * torque, *errors)]
    changed.append((theta - (bench.compliance_error if bench else 0.0) * torque, torque))
    values = measured(theta, torque, cycles, loading)
    others = [measured(*signals, cycles, loading).mean(axis=0) for signals in changed]
    shared = np.linalg.norm(others - values.mean(axis=0), axis=0)

    row = dict[str, Any]()
    for name, of_cycles, error in zip(MEASURED, values.T, shared, strict=True):
        summary = summary_row(pl.DataFrame({name: of_cycles, f"{name}_se_bench": error}), name)
        ends = {f"{name}_{end}": summary[end] for end in ("low", "high")}
        row |= {name: summary["mean"], **ends}
    returned, stored = values.mean(axis=0)[[3, 2]]
    return {**row, "returned_share": returned / stored}


def whole(cycle: Cycle) -> slice:
    """All rows of a cycle, with the last one."""
    return slice(cycle[0], cycle[-1] + 1)


def branch_rows(cycles: Sequence[Cycle], theta: Array, direction: int) -> NDArray[np.intp]:
    """The rows of cycles in which the angle (n,) rises (1) or falls (-1) from turn to turn."""
    parts = [
        np.arange(first, last + 1)
        for cycle in cycles
        for first, last in pairwise(cycle)
        if (theta[last] - theta[first]) * direction > 0
    ]
    return np.concatenate(parts)


def find_cycles(theta: Array) -> tuple[list[Cycle], int]:
    """Find the whole cycles of a slow motion, and the number of its other stretches.

    A cycle ends where the angle returns to its start in the same direction, or, if the motion
    starts at one of its ends, where it returns to this end. Other stretches cover less than
    `WHOLE` of the range, or do not close.

    Parameters
    ----------
    theta : Array
        Filtered angle (n,) [rad].

    Raises
    ------
    InputError
        There is no whole cycle.
    """
    span = float(np.ptp(theta))
    swing = TURNING_SHARE * span
    highest, _ = scipy.signal.find_peaks(theta, prominence=swing)
    lowest, _ = scipy.signal.find_peaks(-theta, prominence=swing)
    turns = np.sort(np.concatenate([highest, lowest])).tolist()
    edges = cycle_edges(theta, turns, span)
    cycles: list[Cycle] = []
    others = 0
    for first, last in pairwise(edges):
        range_of_stretch = np.ptp(theta[first : last + 1])
        is_closed = abs(theta[last] - theta[first]) <= CLOSED * span
        if is_closed and range_of_stretch >= WHOLE * span:
            cycles.append((first, *(turn for turn in turns if first < turn < last), last))
        elif range_of_stretch > swing:
            others += 1
    if not cycles:
        first_deg, low_deg, high_deg, last_deg = (
            np.rad2deg([theta[0], theta.min(), theta.max(), theta[-1]]).round(2) + 0.0
        )  # without "-0.00"
        raise InputError(
            f"no whole cycle: the angle begins at {first_deg:.2f} deg, goes to {low_deg:.2f} and"
            f" {high_deg:.2f} deg, and ends at {last_deg:.2f} deg; record the way back to the start"
        )
    return cycles, others


def cycle_edges(theta: Array, turns: list[int], span: float) -> list[int]:
    """Rows at which cycles of an angle (n,) with a range `span` [rad] may begin or end."""
    start = float(theta[0])
    last_row = len(theta) - 1
    if min(start - theta.min(), theta.max() - start) < AT_AN_END * span:
        at_start = [
            turn for turn in turns if abs(theta[turn] - start) < (AT_AN_END + CLOSED) * span
        ]
        return [0, *at_start, last_row]
    between_turns = list(pairwise([0, *turns, last_row]))
    direction = np.sign(theta[between_turns[0][1]] - start)
    if abs(theta[last_row] - start) <= CLOSED * span:  # the end counts, and is no crossing
        between_turns = between_turns[:-1]
    beyond_start = (theta - start) * direction
    edges = [0]
    for first, last in between_turns[1:]:
        if beyond_start[first] < 0 < beyond_start[last]:
            edges.append(first + int(np.argmax(beyond_start[first : last + 1] >= 0)))
    return [*edges, last_row]


def energies(angle: Array, torque: Array) -> tuple[float, float]:
    """Energies [J] that a cycle takes from the bench and returns: the integral of the torque [N*m]
    over the angle [rad], (n,) each.

    It is summed by pieces, which end where the angle turns or the torque changes sign, so that
    noise does not count as energy in both directions.
    """
    work = scipy.integrate.cumulative_trapezoid(torque, angle, initial=0)
    sign_changes = np.flatnonzero(np.diff(np.signbit(torque))) + 1
    ends = [0, np.argmin(angle), np.argmax(angle), len(angle) - 1, *sign_changes]
    of_pieces = np.diff(work[np.unique(ends)])
    return float(of_pieces[of_pieces > 0].sum()), float(-of_pieces[of_pieces < 0].sum())
