# SPDX-License-Identifier: Apache-2.0
"""Torque against angle, quasi-static, of passive feet, springs and series elastic elements.

The torque's zero and the deflection of the bench are subtracted first. A device with hysteresis
that comes to rest on its way keeps a torque of up to half the width of its loop. One recording
cannot tell this from an offset.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
import scipy

from osl_analysis.base.errors import Change, InputError, naming
from osl_analysis.base.measured import cycle_duration
from osl_analysis.base.trial import Array, Trial
from osl_analysis.base.yaml_settings import check_known
from osl_analysis.bench.bench_settings import TorqueAngleAnalysis
from osl_analysis.bench.cycles import BRANCHES, Loop, find_loop, loop_errors, whole
from osl_analysis.bench.plausibility import check_changes, check_resists, check_stiffer
from osl_analysis.dictionary.described import table_of
from osl_analysis.signals.grid import UniformSignals, uniform_signals
from osl_analysis.stats.budget import Budget, Contribution, Row, scatter
from osl_analysis.stats.linear_fit import variance_accounted_for
from osl_analysis.stats.sources import Source

ESTIMATED_OF_CYCLES = ("K", "K_unloading", "energy_stored", "energy_returned", "energy_lost")
FEWEST_ANGLES = 5  # of a curve
FEWEST_OF_PARABOLA = 10  # of a parabola
PARABOLA_SHARE = 0.05  # of the range of motion, to each side of the angle of a parabola
RESTS = 0.01  # of the range of motion: the joint is at rest within it


@dataclass(frozen=True)
class TorqueAngle:
    """What one trial tells."""

    samples: pl.DataFrame  # torque, and its curve over angle in the rows of all cycles
    signals: UniformSignals  # of the trial, on their time base
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
    signals = uniform_signals(trial, ("theta", "torque"), settings)
    measured = signals.signals
    rate_hz = signals.rate_hz
    with naming(f"trial {trial.name}"):
        if desired is not None:
            check_known(settings.desired, "curve of torque_angle.desired", desired)
        for column in ("torque", "theta"):
            check_changes(column, measured[column])
        bench_theta = settings.low_pass(measured["theta"], rate_hz)
        recorded = settings.low_pass(measured["torque"], rate_hz)
        zero = torque_at_rest(bench_theta, recorded, rate_hz, settings)
        torque = recorded - (zero or 0.0)
        theta = settings.joint_angle(bench_theta, torque)
        angle_deg = angles_of_curves_deg(theta, settings.angle_step_deg)
        loop = find_loop(theta, settings.settle_cycles)
        cycles = loop.cycles
        for cycle in cycles:
            duration_s = cycle_duration(theta[whole(cycle)], 1 / rate_hz)
            if duration_s < settings.shortest_cycle_s:
                raise InputError(
                    f"a cycle takes {duration_s:.2g} s, which is not quasi-static: below"
                    f" {settings.shortest_cycle_s:g} s (shortest_cycle_s) inertia and damping are"
                    " in the torque",
                    "record it slower, or take experiment 'impedance' in the sheet",
                )
        estimates = means_row(theta, torque, loop, rate_hz, settings)
    check_stiffer(trial.name, "K", estimates["K"], settings.bench_stiffness)
    check_resists(trial.name, "K", estimates["K"])

    angles = np.deg2rad(angle_deg)
    theta_deg = np.rad2deg(theta)
    model = np.full_like(theta, np.nan)
    curves = []
    for branch in BRANCHES:
        rows = loop.rows(theta, branch)
        curve, slope = curve_of(theta[rows], torque[rows], angles)
        model[rows] = np.interp(theta[rows], angles, curve, np.nan, np.nan)
        columns = {
            "trial": trial.name,
            "branch": branch,
            "angle_deg": angle_deg,
            "torque": curve,
            "stiffness": slope,
            "desired_torque": settings.desired[desired].at(angle_deg) if desired else np.nan,
            "desired": desired,
        }
        curves.append(pl.DataFrame(columns, schema_overrides={"desired": pl.String}))
    fitted = np.isfinite(model)
    ends = [[cycle[0], cycle[-1]] for cycle in cycles]
    row: Row = {
        "trial": trial.name,
        "cycles": len(cycles),
        "loading": "rising" if loop.loading == 1 else "falling",
        "angle_min_deg": theta_deg.min(),
        "angle_max_deg": theta_deg.max(),
        "torque_zero": zero,
        **estimates,
        "interval_method": "cycles" if len(cycles) > 1 else None,
        "VAF": variance_accounted_for(torque[fitted], torque[fitted] - model[fitted]),
        "closure_torque": np.ptp(torque[ends], axis=1).max() / np.ptp(torque),
        "desired": desired,
    }
    samples = {
        "time": signals.time,
        "theta_deg": theta_deg,
        "torque": torque,
        "torque_model": model,
        "is_fitted": fitted,
    }
    return TorqueAngle(
        pl.DataFrame(samples),
        signals,
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
    moved = np.ptp(theta[rest])
    if count >= len(theta) or moved > RESTS * np.ptp(theta):
        raise InputError(
            f"the joint does not rest at the {settings.zero} of the recording: the angle moves"
            f" by {np.rad2deg(moved):.2g} deg in {settings.rest_s:g} s",
            "record a rest there, or state another torque_angle.zero",
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
            " more",
            "check the channel of theta and its unit in the source file, or lower it",
            changes=[Change("", other_unit_of="theta")],
        )
    return steps * step_deg


def curve_of(theta: Array, torque: Array, angles: Array) -> tuple[Array, Array]:
    """Torque [N*m] and slope [N*m/rad] of a branch at angles (m,) [rad].

    They are those of parabolas through the samples of angle and torque (n,) within `PARABOLA_SHARE`
    of the range to each side; NaN with too few of them, the slope also where a side is beyond the
    range.
    """
    low, high = theta.min(), theta.max()
    window = PARABOLA_SHARE * (high - low)
    value, slope = np.full((2, len(angles)), np.nan)
    for k, at in enumerate(angles):
        near = np.abs(theta - at) <= window
        if np.count_nonzero(near) >= FEWEST_OF_PARABOLA:
            _, slope[k], value[k] = np.polyfit((theta[near] - at) / window, torque[near], 2)
    slope[(angles < low + window) | (angles > high - window)] = np.nan
    return value, slope / window


def measured(theta: Array, torque: Array, loop: Loop) -> Array:
    """Slopes [N*m/rad] and energies [J] of each cycle, (cycles, 5), in the order of
    `ESTIMATED_OF_CYCLES`.

    Slopes are those of least squares over angle: each sample has the weight of the angle that it
    covers, so that a rest on the way, or a slower end, does not count more.
    """
    covered = np.sqrt(np.abs(np.gradient(theta)))
    rows = []
    for cycle in loop.cycles:
        branches = [loop.rows(theta, branch, cycle) for branch in BRANCHES]
        slopes = [np.polyfit(theta[b], torque[b], 1, w=covered[b])[0] for b in branches]
        stored, returned = energies(theta[whole(cycle)], torque[whole(cycle)])
        rows.append((*slopes, stored, returned, stored - returned))
    return np.array(rows)


def means_row(
    theta: Array, torque: Array, loop: Loop, rate_hz: float, settings: TorqueAngleAnalysis
) -> dict[str, Any]:
    """Means over the cycles with 95 % intervals, which hold the stated errors of the bench: of
    torque and angle, of the load cell's hysteresis and delay, and of the bench's stiffness; and
    the drift by which cycles do not close, which a line cannot tell from stiffness."""
    bench = settings.bench_stiffness
    values = measured(theta, torque, loop)
    first, last = loop.cycles[0][0], loop.cycles[-1][-1]
    means = values.mean(axis=0)
    errors = loop_errors(torque, rate_hz, np.r_[first:last], settings.calibration)
    of_angle = means[0] * (theta[last] - theta[first])
    drift_per_row = (torque[last] - torque[first] - of_angle) / (last - first)
    zero_row = len(torque) if settings.zero == "end" else 0
    errors.append(drift_per_row * (zero_row - np.arange(len(torque))))  # without it
    others = [measured(theta, torque + error, loop) for error in errors]
    yielded = (bench.compliance_error if bench else 0.0) * torque
    others.append(measured(theta - yielded, torque, loop))
    shared = np.linalg.norm(np.mean(others, axis=1) - means, axis=0)

    row = dict[str, Any]()
    for name, of_cycles, error in zip(ESTIMATED_OF_CYCLES, values.T, shared, strict=True):
        n = len(of_cycles)
        if n == 1:
            row |= {name: of_cycles[0], f"{name}_low": None, f"{name}_high": None}
        else:
            of_repeats = scatter(of_cycles.std(ddof=1) / np.sqrt(n), n - 1.0)
            of_bench = Contribution(Source.BENCH, error, shared=True)
            row |= Budget(of_cycles.mean(), (of_repeats, of_bench)).columns(name)
    _, _, stored, returned, _ = means
    return {**row, "returned_share": returned / stored}


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
    return of_pieces[of_pieces > 0].sum(), -of_pieces[of_pieces < 0].sum()
