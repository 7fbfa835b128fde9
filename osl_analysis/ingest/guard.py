# SPDX-License-Identifier: Apache-2.0
"""Refuse the numbers of a trial that no recording of a joint has.

These are sizes that nothing can reach, values beyond a stated range, and recordings of a bench that
no fit can use. Example: a torque that was computed from the current is no measured torque.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
import polars as pl
import scipy

from osl_analysis.base.errors import Change, InputError
from osl_analysis.base.measured import (
    SMALLEST_SIGNAL,
    cycle_duration,
    noise_of,
    rms,
    spoiled,
    usual_step,
    varies,
)
from osl_analysis.base.trial import Array, Trial, unit_of
from osl_analysis.base.units import si_factor
from osl_analysis.signals.grid import origin

# Largest possible size of a value, by its SI unit
LARGEST: Mapping[str, float] = {
    "m": 1e3,  # no laboratory is a kilometre long
    "rad": 1e6,  # 160 000 turns
    "rad/s": 1e5,  # a million turns per minute
    "N": 1e6,  # the weight of a hundred tonnes
    "N*m": 1e7,  # moments of a plate in N*mm pass; the centre of pressure shows that error better
    "A": 1e5,
    "V": 1e6,  # counts of a 16-bit converter declared as V pass
    "N*m/rad": 1e8,
    "N*m*s/rad": 1e8,
    "N*m/kg": 1e6,
    "1": 1e9,  # counts of a converter
}
# Units that are declared for one another, by SI unit, the most usual ones first
CONFUSED_UNITS: Mapping[str, Sequence[str]] = {
    "rad": ("rad", "deg", "mrad"),
    "N*m": ("N*m", "N*mm", "N*cm"),
    "s": ("s", "ms", "us", "ns"),
}


@dataclass(frozen=True)
class PossibleRecording:
    """What no recording of a joint exceeds."""

    # share of a stated range; electronics reach a little further than data sheets
    beyond_range: float = 0.01
    # [rad] of an angle's range, half a degree; no recording of a joint has less
    smallest_motion_rad: float = 0.0087
    shortest_step_s: float = 1e-5  # [s]; no recorder of a joint is faster than 100 kHz
    # share of its range that an angle jumps where an encoder begins anew
    wrap_share: float = 0.9


POSSIBLE = PossibleRecording()


def check_sizes(samples: pl.DataFrame, origins: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse values beyond the range of the sensor as the source file states it, else beyond the
    largest possible ones. NaN passes: it marks a value that was not seen."""
    for column, facts in origins.items():
        unit = unit_of(column)
        bound = LARGEST[unit]
        low, high = facts.get("range", (-bound, bound))
        slack = POSSIBLE.beyond_range * (high - low)
        values = samples[column].to_numpy()
        is_beyond = (values < low - slack) | (values > high + slack)
        if is_beyond.any():
            row = int(np.argmax(is_beyond))
            what = "the `range` of its sensor" if "range" in facts else "what anything can reach"
            raise InputError(
                f"{column} is {values[row]:.4g} {unit} at {samples['time'][row]:.3f} s, beyond"
                f" {what}, {low:g} to {high:g}",
                "correct its unit or scale in the source file, or repair the recording or the"
                " byte order it states",
            )


def recorded(trial: Trial, column: str | None) -> tuple[Array, Array]:
    """Time [s] and values of a column, (n,) each, where it was sampled; empty without the column.
    NaN is left out."""
    if column is None or column not in trial.samples:
        return np.empty(0), np.empty(0)
    if column not in trial.readings:
        time, values = trial.arrays(column)
        is_seen = ~np.isnan(values)
        trial.readings[column] = time[is_seen], values[is_seen]
    return trial.readings[column]


# Recordings of a bench that are refused before a fit.

ANGLES = ("theta", "theta_m", "theta_command")


@dataclass(frozen=True)
class ComputedTorque:
    """Limits that part a torque that a program computed from one that a load cell measured."""

    # of a torque's SD; load cells leave more, rounding of both signals less
    least_of_sensor: float = 6e-4
    # the same beside a current with its arm and friction, of which no load cell leaves so little
    least_beside_current: float = 2e-3
    # the same in the torque's own noise: a load cell leaves twice that, a formula takes the noise
    # of the current
    least_of_own_noise: float = 0.3
    # of the RMS speed, from which friction no longer sets in; a sine is above in half of its time
    moves_well: float = 1.0
    # of a load cell's own noise in a torque's; of joints simulated at 40 Hz or more half is left
    least_of_noise: float = 0.1
    # of the differences that tell noise; motion of 6 Hz at 50 Hz has 1e-3 of its size in them
    order_of_noise: int = 8
    rows_tried: int = 10_000  # that tell a filter; all rows of an hour take as long as the fit
    # [s] over which rows are summed before they are compared; a tenth of a period of 6 Hz
    averaged_s: float = 0.016
    fewest_compared: int = 100  # of these sums
    most_rows: float = 0.95  # share of them in which a torque is followed
    highest_power: int = 5  # of a signal that a program takes


COMPUTED_TORQUE = ComputedTorque()


@np.errstate(all="ignore")  # values of damaged files may be of any size
def check_own_torque(trial: Trial, torque: str = "torque", angle: str | None = "theta") -> None:
    """Refuse a torque that is a function of angle, current and the actuator's speed, or that a
    program filtered from them: a fit to it would be circular. A torque that is stated to be
    `measured` passes."""
    if origin(trial, torque).get("measured"):
        return
    names = tuple(name for name in trial.columns if name in (angle, "current", "omega_m"))
    # each alone and all together, which may be sampled at different times
    for explaining in dict.fromkeys([*((name,) for name in names), names]):
        time, measured, *values = trial.arrays(torque, *explaining)
        if time.size < COMPUTED_TORQUE.fewest_compared:
            continue
        least = COMPUTED_TORQUE.least_of_sensor
        signals = dict(zip(explaining, values, strict=True))
        sums = sums_of_formula(time, measured, signals)
        # a load cell has noise of its own, and a simulated joint none
        noise = np.float64(noise_of(measured, COMPUTED_TORQUE.order_of_noise)) / np.std(measured)
        share_of_noise = unexplained_share(rows_of_filter(measured, values)) / min(noise, least)
        share_by_current = 1.0
        if "current" in signals:
            share_by_current = unexplained_share(
                rows_of_current(time, measured, signals, angle or "")
            )
        least_of_current = max(
            COMPUTED_TORQUE.least_beside_current, COMPUTED_TORQUE.least_of_own_noise * noise
        )
        is_formula = unexplained_share(sums) < least or share_by_current < least_of_current
        if is_formula or share_of_noise < COMPUTED_TORQUE.least_of_noise:
            raise InputError(
                f"trial {trial.name}: {torque} follows from {' and '.join(explaining)} more exactly"
                " than a sensor's noise allows: it is computed, not measured, and a fit gives the"
                " formula back",
                f"name the channel of a load cell as {torque} in the source file, or state"
                " `measured: true` of it there if it is one, or write experiment ingest_only",
            )


def sums_of_formula(time: Array, torque: Array, signals: Mapping[str, Array]) -> Array:
    """Sums over a short time of a torque (n,), and of what a formula may hold: powers of signals
    (n,), and the speed of an angle. An inertia is left: a simulated joint without noise is no
    circle."""
    columns = [torque, np.ones_like(torque)]
    for name, values in signals.items():
        columns += accumulate([values] * COMPUTED_TORQUE.highest_power, np.multiply)
        if name not in ("current", "omega_m"):
            columns.append(np.gradient(values, time))
    # a formula still holds for sums, and rounding of an angle hardly makes speed
    begins = np.arange(0, time.size, rows_averaged(time))
    sums = np.array([np.add.reduceat(column, begins) for column in columns])
    return sums[:, :-1]  # the last is shorter, so that a constant torque would vary


def rows_averaged(time: Array) -> int:
    """How many rows of times (n,) [s] are averaged."""
    return max(time.size // int(np.ptp(time) / COMPUTED_TORQUE.averaged_s + 1), 1)


def rows_of_current(time: Array, torque: Array, signals: Mapping[str, Array], angle: str) -> Array:
    """Rows of a torque (n,) and of the torque of a current (n,) through a linkage.

    The linkage's arm changes with the angle, and friction opposes the motion. Only rows in which
    the joint moves well count, so that it does not matter how friction sets in from rest: as a
    sign, a tanh or Stribeck's curve.
    """
    current = signals["current"]
    turned = signals.get(angle, np.zeros_like(torque))
    speeds = [signals["omega_m"]] if "omega_m" in signals else []
    if angle in signals:
        speeds.append(np.gradient(scipy.ndimage.uniform_filter1d(turned, rows_averaged(time))))
    columns = [torque, np.ones_like(torque), current, current * turned, current * turned**2]
    moves = np.ones(torque.size, dtype=bool)
    for speed in speeds:
        moves &= np.abs(speed) >= COMPUTED_TORQUE.moves_well * rms(speed)
        way = np.sign(speed)
        columns += [way, way * abs(current), speed]
    step = max(np.count_nonzero(moves) // COMPUTED_TORQUE.rows_tried, 1)
    return np.array(columns)[:, moves][:, ::step]


def rows_of_filter(torque: Array, signals: Sequence[Array]) -> Array:
    """The rows of a torque (n,) with what a program's filter of first order takes: the torque in
    the row before, and four rows of each signal (n,)."""
    step = max(torque.size // COMPUTED_TORQUE.rows_tried, 1)
    around = [values[k : k - 3 or None : step] for values in signals for k in range(4)]
    now = torque[2:-1:step]
    return np.array([now, np.ones_like(now), torque[1:-2:step], *around])


def unexplained_share(columns: Array) -> float:
    """Residual of the first column after least squares on the others, (columns, n).

    It is the residual that most rows do not exceed, as a share of the column's SD; 1 of too few
    rows.
    """
    y, *explaining = columns[:, np.isfinite(columns).all(axis=0)]
    X = np.column_stack(explaining)
    if len(y) < COMPUTED_TORQUE.fewest_compared or not varies(y):
        return 1.0
    X = X / (np.abs(X).max(axis=0) + SMALLEST_SIGNAL)
    residual = y - X @ np.linalg.lstsq(X, y)[0]
    return float(np.quantile(np.abs(residual), COMPUTED_TORQUE.most_rows) / np.std(y))


@np.errstate(all="ignore")  # values of damaged files may be of any size
def check_recording(
    trial: Trial, limits: Any, torque: str = "torque", angle: str | None = "theta"
) -> None:
    """Refuse an angle beyond `limits.largest_angle` [rad]; a torque beyond `limits.load_cell_range`
    [N*m], or constant while the joint turns; and samples less than 10 us apart."""
    who = f"trial {trial.name}:"
    time = trial.arrays()[0]
    # The mean step: stamps of a late host come in clusters, and the steps within one are
    # microseconds.
    step = np.ptp(time) / max(len(time) - 1, 1)
    if 0 < step < POSSIBLE.shortest_step_s:
        raise InputError(
            f"{who} its samples are {step:.2g} s apart",
            "correct the `unit` of `time` in the source file",
            changes=[Change("take a 1000 times larger `unit` of `time` (s for ms)", {"time": 1e3})],
        )
    turn = half_range(trial, angle)
    measured = recorded(trial, torque)[1]
    if turn and measured.size > 1 and not np.ptp(measured):
        raise InputError(
            f"{who} {torque} is {measured[0]:.4g} N*m in all samples while {angle} turns",
            "is this the channel of the load cell? Correct it in the source file",
        )
    check_sign(trial, torque, angle)
    if angle is not None and turn > limits.largest_angle:
        check_not_spoiled(trial, angle)
        raise InputError(
            f"{who} {angle} turns by +-{turn:.3g} rad ({math.degrees(turn):.0f} deg), more than"
            f" the {limits.largest_angle:g} rad of `largest_angle` in the configuration",
            f"is it another channel or unit, or swapped with {torque}? Correct it in the source"
            " file, and where it jumps as an encoder that begins anew, state after how much, as"
            " `wraps_at: 360`",
            changes=changes_of_angle(trial, torque, angle, limits.largest_angle),
        )
    largest = np.abs(measured).max(initial=0.0)
    if limits.load_cell_range is not None and largest > limits.load_cell_range:
        check_not_spoiled(trial, torque)
        raise InputError(
            f"{who} {torque} reaches {largest:.4g} N*m, more than the {limits.load_cell_range:g}"
            " N*m of `load_cell_range` in the configuration",
            "correct its `unit` or `scale` in the source file, or the range",
            changes=in_other_units(trial, [torque]),
        )


@dataclass(frozen=True)
class LostSign:
    """Limits by which a torque that was logged without its sign is recognised."""

    # residual of the motion with the signs put back over that without: |K theta| leaves all of its
    # SD without them, and its noise with them; a preloaded joint leaves the same with both
    smaller_residual: float = 0.3
    rows_of_cycle: int = 40  # to which rows are averaged, so that speed and acceleration are smooth
    rounds: int = 10  # of putting signs and fitting; three or four are usual


LOST_SIGN = LostSign()


def check_sign(trial: Trial, torque: str, angle: str | None) -> None:
    """Refuse a torque of one sign that the motion explains once it has two."""
    time, measured = recorded(trial, torque)
    moved = recorded(trial, angle)[1]
    is_of_one_sign = measured.size and not measured.min() < 0 < measured.max()
    if not is_of_one_sign or moved.size != measured.size or not varies(moved):
        return
    step_s = usual_step(time)
    rows = max(round(cycle_duration(moved, step_s) / LOST_SIGN.rows_of_cycle / step_s), 1)
    count = measured.size // rows
    if count < LOST_SIGN.rows_of_cycle:
        return
    theta, size = (
        values[: count * rows].reshape(-1, rows).mean(axis=1) for values in (moved, measured)
    )
    speed = np.gradient(theta)
    motion = np.column_stack([theta, speed, np.gradient(speed), np.ones(count)])
    motion[:, :3] -= motion[:, :3].mean(axis=0)
    _, without = followed(motion, size)
    explained = motion[:, 0]
    for _ in range(LOST_SIGN.rounds):
        explained, residual = followed(motion, np.copysign(size, explained))
    if residual < LOST_SIGN.smaller_residual * without:
        side = "negative" if measured.max() > 0 else "positive"
        raise InputError(
            f"trial {trial.name}: {torque} is never {side}, and the motion leaves"
            f" {residual:.3g} N*m of it with a sign and {without:.3g} N*m without: its sign is"
            " lost",
            "log it with its sign, or exclude the trial",
        )


def followed(motion: Array, torque: Array) -> tuple[Array, float]:
    """What a motion (n, columns) explains of a torque (n,), and the RMS that it leaves."""
    explained = motion @ np.linalg.lstsq(motion, torque)[0]
    return explained, rms(torque - explained)


def check_not_spoiled(trial: Trial, column: str) -> None:
    """Refuse values that no sensor gave, before another unit is proposed for them."""
    values = recorded(trial, column)[1]
    bad = spoiled(values)
    if bad.any():
        raise InputError(
            f"trial {trial.name}: {column} leaps or recurs, as {values[bad][0]:.6g}, in {bad.sum()}"
            f" of {values.size} samples",
            "write `damaged: skip` in the source file, which leaves them out",
        )


def changes_of_angle(
    trial: Trial, torque: str, angle: str, largest_angle: float
) -> Sequence[Change]:
    """What may mend an angle beyond the largest. None does where it begins anew."""
    turned = recorded(trial, angle)[1]
    if np.abs(np.diff(turned)).max() > POSSIBLE.wrap_share * np.ptp(turned):
        return ()
    if 0 < half_range(trial, torque) < largest_angle:
        return swapped_channels(trial, angle, torque)
    return in_other_units(
        trial, [name for name in ANGLES if half_range(trial, name) > largest_angle]
    )


def swapped_channels(trial: Trial, angle: str, torque: str) -> list[Change]:
    """The changes that exchange the channels of two columns, each of which keeps its unit; then
    with an angle in deg. The units are named: a swapped name may end in another one."""
    angle_origin = {"unit": "rad", "factor": 1, **origin(trial, angle)}
    torque_origin = {"unit": "N*m", "factor": 1, **origin(trial, torque)}
    changes: list[Change] = []
    for unit in dict.fromkeys([angle_origin["unit"], "deg"]):
        words = (
            f"swap the channels of {angle} and {torque} in the source file, and state `unit:"
            f" {unit}` of {angle} and `unit: {torque_origin['unit']}` of {torque}"
        )
        factors = {
            angle: si_factor(unit, "rad") / torque_origin["factor"],
            torque: si_factor(torque_origin["unit"], "N*m") / angle_origin["factor"],
        }
        changes.append(Change(words, factors, {angle: torque, torque: angle}, rank=len(changes)))
    return changes


def half_range(trial: Trial, column: str | None) -> float:
    """Half of the range of a column; 0 of one without readings."""
    values = recorded(trial, column)[1]
    return float(np.ptp(values)) / 2 if values.size else 0.0


def in_other_units(trial: Trial, columns: Sequence[str]) -> list[Change]:
    """The changes that take columns for numbers of another unit than they are declared in: of an
    angle the more usual unit first, of a torque all alike, since nothing tells N*mm from N*cm. A
    unit with which the joint hardly moves is none of them."""
    si_unit = unit_of(columns[0])
    declared = origin(trial, columns[0]).get("factor", 1)
    turn = 2 * half_range(trial, "theta") if "theta" in trial.columns else math.inf
    changes: list[Change] = []
    for unit in CONFUSED_UNITS[si_unit]:
        factor = si_factor(unit, si_unit) / declared
        turned = turn * factor if "theta" in columns else turn
        if turned > POSSIBLE.smallest_motion_rad and not math.isclose(factor, 1):
            words = f"state `unit: {unit}` of {' and '.join(columns)} in the source file"
            rank = len(changes) if si_unit == "rad" else 0
            changes.append(Change(words, dict.fromkeys(columns, factor), rank=rank))
    return changes
