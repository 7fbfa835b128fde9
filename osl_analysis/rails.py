"""Sensors at the end of their range: load cells, currents and encoders that stand at a rail."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.columns import unit_of
from osl_analysis.errors import InputError
from osl_analysis.measured import usual_size
from osl_analysis.plateaus import longest_at_extreme
from osl_analysis.signals import longest_run, runs
from osl_analysis.trial import Array, Trial

AT_RAIL = 1e-3  # distance from a stated end of a sensor's range, as a share of the range, that counts as the end
BEYOND_RANGE = 0.01
"""Share of a sensor's range by which a value may lie beyond it: electronics reach a little further than data sheets."""
IS_COMMAND = 0.3  # share of samples that repeat their predecessor, beside the longest run, in a commanded current
FEWEST = 5  # samples at an extreme from which an angle is examined further
CERTAIN = 10.0  # standard deviations of the torque's noise by which it must change while a clipped angle stands
CREEP = 0.02  # share of the torque's range by which it may change while a joint rests
CORNER = 8.0
"""Steps by which a clipped angle moves within half of its standing time before it, or after it. A sine that is rounded
to steps moves by four at most."""


def stated_range(trial: Trial, column: str) -> tuple[float, float] | None:
    """Lowest and highest value of a channel that its source file states, in the column's unit; None if not stated."""
    found: Mapping[str, Any] = trial.provenance.get("columns", {}).get(column, {})
    ends = found.get("range")
    return (float(ends[0]), float(ends[1])) if ends else None


def check_ranges(trial: Trial) -> None:
    """Refuse values that no sensor of the range that the source file states can measure.

    Raises InputError: The message names trial, channel, values, and range.
    """
    for column in trial.columns:
        if (ends := stated_range(trial, column)) is None or not (values := sampled(trial, column)[1]).size:
            continue
        (low, high), (least, most) = ends, (float(values.min()), float(values.max()))
        slack = BEYOND_RANGE * (high - low)
        if least < low - slack or most > high + slack:
            raise InputError(
                f"trial {trial.name}: {column} goes from {least:.4g} to {most:.4g} {unit_of(column)}, beyond the "
                f"`range` of its sensor, {low:g} to {high:g}; correct `unit`, `scale` or `range` in the source file"
            )


def samples_at_rail(trial: Trial, column: str, torque: str | None = None) -> int:
    """Longest run [samples] of a channel at an end of its range, stated or seen; 0 for a command, which has levels.

    A channel with noise is at an end where it repeats its lowest or highest value. An angle also rests at an extreme:
    it is clipped only where `torque` goes on to change meanwhile. This holds for an angle that a bench drives; a motor
    behind a belt may stand by its own friction while the torque changes.
    """
    if column not in trial.columns:
        return 0
    time, values = sampled(trial, column)
    if not np.isfinite(values).all():  # the fit refuses it
        return 0
    at_stated = longest_at_stated(values, stated_range(trial, column))
    if column.startswith("theta"):
        seen = 0 if torque is None else longest_clipped_angle(time, values, sampled(trial, torque))
    else:
        seen = 0 if column == "current" and is_command(values) else longest_at_extreme(values)
    return max(at_stated, seen)


def sampled(trial: Trial, column: str) -> tuple[Array, Array]:
    """Time [s] and values of a column, (n,) each, where it was sampled; empty without the column."""
    if column not in trial.columns:
        return np.empty(0), np.empty(0)
    time, values = trial.arrays(column)
    missing = np.isnan(values)
    return (time[~missing], values[~missing]) if missing.any() else (time, values)


def longest_at_stated(values: Array, ends: tuple[float, float] | None) -> int:
    """Longest run [samples] of a channel (n,) at a stated end of its range, or beyond it."""
    if ends is None or not values.size:
        return 0
    near = AT_RAIL * (ends[1] - ends[0])
    found = (longest_run(values <= ends[0] + near), longest_run(values >= ends[1] - near))
    return max(int(run.stop - run.start) for run in found)


def is_command(values: Array) -> bool:
    """Whether a channel (n,) goes from level to level without noise: most of its samples repeat their predecessor."""
    repeated = np.diff(values) == 0
    elsewhere = repeated.copy()
    elsewhere[longest_run(repeated)] = False
    return bool(elsewhere.sum() > IS_COMMAND * elsewhere.size)


def longest_clipped_angle(time: Array, theta: Array, torque: tuple[Array, Array]) -> int:
    """Longest run [samples] of an angle (n,) at its lowest or highest value while the torque changes. `torque` are
    times [s] and values. The angle must come to the extreme, and leave it, with a corner."""
    when, values = torque
    if not theta.size or not np.ptp(theta) or not when.size or not np.isfinite(values).all() or not np.ptp(values):
        return 0
    noise = usual_size(np.diff(values, 3)) / 3.016 if values.size > 3 else np.inf  # of white noise
    changes = max(CERTAIN * noise, CREEP * float(np.ptp(values)))
    longest = 0
    for end in (theta.min(), theta.max()):
        for run in runs(theta == end):
            count = run.stop - run.start
            within = values[slice(*np.searchsorted(when, (time[run.start], time[run.stop - 1])))]
            if count > max(FEWEST, longest) and within.size > 1 and np.ptp(within) > changes:
                sides = (run.start - count // 2, run.stop - 1 + count // 2)
                moved = [abs(theta[at] - end) for at in sides if 0 <= at < theta.size]
                longest = count if moved and min(moved) > CORNER * smallest_step(theta) else longest
    return longest


def smallest_step(values: Array) -> float:
    """Smallest difference between two values (n,), but for errors of rounding."""
    span = float(np.ptp(values))
    apart = np.diff(pl.Series(values).unique().sort().to_numpy())
    return float(np.min(apart[apart > 1e-9 * span], initial=span))
