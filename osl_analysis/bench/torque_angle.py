"""Torque against angle, quasi-static, of passive feet, springs and series elastic elements.

The torque's zero and the deflection of the bench are subtracted first. A device with hysteresis
that comes to rest on its way keeps a torque of up to half the width of its loop. One recording
cannot tell this from an offset.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.bench_settings import TorqueAngleAnalysis
from osl_analysis.bench.evidence import Series
from osl_analysis.bench.impedance import torque_errors
from osl_analysis.bench.loops import Cycle, branch_rows, energies, find_cycles, whole
from osl_analysis.bench.motion import signals_of
from osl_analysis.bench.plausibility import check_changes, check_resists, check_stiffer
from osl_analysis.dictionary import table_of
from osl_analysis.errors import Change, InputError, naming
from osl_analysis.stats.estimates import Row
from osl_analysis.stats.linear_fit import variance_accounted_for
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.trial import Array, Trial

MEASURED = ("K", "K_unloading", "energy_stored", "energy_returned", "energy_lost")
FEWEST_ANGLES = 5  # of a curve
FEWEST_SAMPLES = 10  # of a parabola
RESTS = 0.01  # of the range of motion: the joint is at rest within it


@dataclass(frozen=True)
class TorqueAngle:
    """What one trial tells."""

    series: Series  # torque, and its curve over angle in the rows of all cycles
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
        desired_torque = torque_of_design(angle_deg, desired, settings)
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
            "desired_torque": desired_torque,
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
    return TorqueAngle(
        Series(
            trial.name,
            signals.time,
            torque,
            model,
            {"theta_deg": np.rad2deg(theta)},
            fitted,
            signals.streams,
        ),
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


def torque_of_design(angle_deg: Array, desired: str | None, settings: TorqueAngleAnalysis) -> Array:
    """Torque (m,) [N*m] of a desired curve at angles [deg]; NaN beyond its ends, and of None."""
    if desired is None:
        return np.full(len(angle_deg), np.nan)
    if desired not in settings.desired:
        raise InputError(
            f"no desired curve '{desired}'; torque_angle.desired in the configuration has"
            f" {', '.join(settings.desired) or 'none'}"
        )
    return settings.desired[desired].at(angle_deg)


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
        slopes = []
        for direction in (loading, -loading):
            branch = branch_rows([cycle], theta, direction)
            slopes.append(np.polyfit(theta[branch], torque[branch], 1, w=covered[branch])[0])
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
    means = values.mean(axis=0)
    others = [measured(*signals, cycles, loading).mean(axis=0) for signals in changed]
    shared = np.sum(np.square(others - means), axis=0)

    row: dict[str, Any] = dict(zip(MEASURED, means.tolist(), strict=True))
    row["returned_share"] = row["energy_returned"] / row["energy_stored"]
    for name, of_cycles, variance in zip(MEASURED, values.T, shared, strict=True):
        row[f"{name}_low"] = row[f"{name}_high"] = None
        if len(cycles) > 1:
            repeats = over_repeats(of_cycles, [(float(variance), np.inf)])
            row |= {f"{name}_low": repeats.low, f"{name}_high": repeats.high}
    return row
