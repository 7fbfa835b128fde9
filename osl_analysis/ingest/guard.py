"""The guard of a trial's numbers: sizes that nothing can reach, values beyond a stated range, and
recordings of a bench that no fit can use are refused."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.errors import Change, InputError
from osl_analysis.measured import factor_of
from osl_analysis.signals.grid import origin
from osl_analysis.trial import Array, Trial, unit_of
from osl_analysis.units import si_factor

LARGEST_MEASURED = {  # largest possible size of a value, by its SI unit
    "m": 1e3,  # no laboratory is a kilometre long
    "rad": 1e6,  # 160 000 turns
    "rad/s": 1e5,  # a million turns per minute
    "N": 1e6,  # the weight of a hundred tonnes
    # moments of a plate in N*mm declared as N*m pass; the centre of pressure shows that error
    # better
    "N*m": 1e7,
    "A": 1e5,
    "V": 1e6,  # counts of a 16-bit converter declared as V pass
    "N*m/rad": 1e8,
    "N*m*s/rad": 1e8,
    "N*m/kg": 1e6,
    "1": 1e9,  # counts of a converter
}


BEYOND_RANGE = 0.01  # share of it; electronics reach a little further than data sheets


def check_sizes(samples: pl.DataFrame, origins: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse values beyond the range of the sensor as the source file states it, else beyond
    `LARGEST_MEASURED`. NaN passes: it marks a value that was not seen."""
    for column, origin_of_column in origins.items():
        unit = unit_of(column)
        bound = LARGEST_MEASURED[unit]
        low, high = origin_of_column.get("range", (-bound, bound))
        slack = BEYOND_RANGE * (high - low)
        values = samples[column].to_numpy()
        is_beyond = (values < low - slack) | (values > high + slack)
        if is_beyond.any():
            row = int(np.argmax(is_beyond))
            what = "the `range` of its sensor" if high < bound else "what anything here can reach"
            raise InputError(
                f"{column} is {values[row]:.4g} {unit} at {samples['time'][row]:.3f} s, beyond"
                f" {what}, {low:g} to {high:g}; correct its unit or scale in the source file, or"
                " repair the recording or the byte order it states"
            )


def recorded(trial: Trial, column: str | None) -> tuple[Array, Array]:
    """Time [s] and values of a column, (n,) each, where it was sampled; empty without the column.
    NaN is left out."""
    if column is None or column not in trial.columns:
        return np.empty(0), np.empty(0)
    time, values = trial.arrays(column)
    missing = np.isnan(values)
    return (time[~missing], values[~missing]) if missing.any() else (time, values)


def stated_range(trial: Trial, column: str) -> tuple[float, float] | None:
    """Lowest and highest value of a channel that its source file states, in the column's unit; None
    if not stated."""
    ends = origin(trial, column).get("range")
    return (float(ends[0]), float(ends[1])) if ends else None


# Recordings of a bench that are refused before a fit.

ANGLES = ("theta", "theta_m", "theta_command")
CONFUSED_UNITS = {"rad": ("rad", "deg", "mrad"), "N*m": ("N*m", "N*mm", "N*cm")}
"""By SI unit, the most usual ones first."""
SMALLEST_MOTION = math.radians(0.5)  # of an angle's range; no recording of a joint has less
SHORTEST_STEP_S = 1e-5  # no recorder of a joint is faster than 100 kHz
OF_BEGINNING_ANEW = 0.9  # share of its range that an angle jumps where an encoder begins anew


def check_own_torque(trial: Trial, torque: str = "torque") -> None:
    """Refuse a torque that is the motor's current times a constant, or another function of what the
    log has: a fit to it would be circular."""
    formula = ""
    others = origin(trial, torque).get("computed_from")
    if others:
        formula = f"follows exactly from {others}"
    elif {torque, "current"} <= set(trial.columns):
        factor = factor_of(*trial.arrays(torque, "current")[1:])
        if factor is not None:
            formula = f"is current times {factor:.4g} {unit_of(torque)}/A, to within rounding"
    if formula:
        raise InputError(
            f"trial {trial.name}: {torque} {formula}: it is computed, not measured, and a fit gives"
            f" the formula back; name the channel of a load cell as {torque} in the source file, or"
            " write experiment ingest_only"
        )


def check_recording(
    trial: Trial, limits: Any, torque: str = "torque", angle: str | None = "theta"
) -> None:
    """Refuse an angle beyond `limits.largest_angle` [rad]; a torque beyond `limits.load_cell_range`
    [N*m], constant while the joint turns, or computed from the current (`check_own_torque`); and
    samples less than 10 us apart."""
    who = f"trial {trial.name}:"
    time = trial.arrays()[0]
    # The mean step: stamps of a late host come in clusters, and the steps within one are
    # microseconds.
    step = float(np.ptp(time)) / (len(time) - 1) if len(time) > 1 else 0.0
    if 0 < step < SHORTEST_STEP_S:
        larger = Change("take a 1000 times larger `unit` of `time` (s for ms)", {"time": 1e3})
        raise InputError(
            f"{who} its samples are {step:.2g} s apart, {1 / step:.3g} in a second; correct the"
            " `unit` of `time` in the source file",
            [larger],
        )
    check_own_torque(trial, torque)
    turn = half_range(trial, angle)
    change = half_range(trial, torque)
    measured = recorded(trial, torque)[1]
    if turn and measured.size > 1 and not change:
        raise InputError(
            f"{who} {torque} is {measured[0]:.4g} N*m in all samples while {angle} turns by"
            f" {2 * turn:.2g} rad; is this the channel of the load cell? Correct it in the source"
            " file"
        )
    if angle is not None and turn > limits.largest_angle:
        raise InputError(
            f"{who} {angle} turns by +-{turn:.3g} rad ({math.degrees(turn):.0f} deg), more than the"
            f" {limits.largest_angle:g} rad of `largest_angle` in the configuration; is it another"
            f" channel or unit, or swapped with {torque}? Correct it in the source file, and where"
            " it jumps as an encoder that begins anew, state after how much, as `wraps_at: 360`",
            changes_of_angle(trial, torque, angle, limits.largest_angle),
        )
    largest = float(np.abs(measured).max(initial=0.0))
    if limits.load_cell_range is not None and largest > limits.load_cell_range:
        raise InputError(
            f"{who} {torque} reaches {largest:.4g} N*m, more than the {limits.load_cell_range:g}"
            " N*m of `load_cell_range` in the configuration; correct its `unit` or `scale` in the"
            " source file, or the range",
            in_other_units(trial, [torque]),
        )


def changes_of_angle(
    trial: Trial, torque: str, angle: str, largest_angle: float
) -> Sequence[Change]:
    """What may mend an angle beyond the largest. None does where it begins anew."""
    turned = recorded(trial, angle)[1]
    if np.abs(np.diff(turned)).max() > OF_BEGINNING_ANEW * np.ptp(turned):
        return ()
    if 0 < half_range(trial, torque) < largest_angle:
        return swapped_channels(trial, angle, torque)
    return in_other_units(
        trial, [name for name in ANGLES if half_range(trial, name) > largest_angle]
    )


def swapped_channels(trial: Trial, angle: str, torque: str) -> list[Change]:
    """The changes that exchange the channels of two columns, each of which keeps its unit; then
    with an angle in deg."""
    words = f"swap the channels of {angle} and {torque} in the source file"
    factor = float(origin(trial, angle).get("factor", 1))
    of_torque = float(origin(trial, torque).get("factor", 1))
    swapped = {angle: torque, torque: angle}
    in_deg = {angle: math.radians(1) / of_torque, torque: of_torque / factor}
    return [
        Change(words, {**in_deg, angle: factor / of_torque}, swapped),
        Change(f"{words}, and state `unit: deg` of {angle}", in_deg, swapped, rank=1),
    ]


def half_range(trial: Trial, column: str | None) -> float:
    """Half of the range of a column; 0 of one without readings."""
    values = recorded(trial, column)[1]
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) / 2 if finite.size else 0.0


def in_other_units(trial: Trial, columns: Sequence[str]) -> list[Change]:
    """The changes that take columns for numbers of another unit than they are declared in, the more
    usual unit first. A unit with which the joint hardly moves is none of them."""
    si_unit = unit_of(columns[0])
    declared = float(origin(trial, columns[0]).get("factor", 1))
    turn = 2 * half_range(trial, "theta") if "theta" in trial.columns else math.inf
    changes: list[Change] = []
    for unit in CONFUSED_UNITS[si_unit]:
        factor = si_factor(unit, si_unit) / declared
        moves = turn * (factor if "theta" in columns else 1) > SMALLEST_MOTION
        if moves and not math.isclose(factor, 1):
            words = f"state `unit: {unit}` of {' and '.join(columns)} in the source file"
            changes.append(Change(words, dict.fromkeys(columns, factor), rank=len(changes)))
    return changes
