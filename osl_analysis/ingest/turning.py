# SPDX-License-Identifier: Apache-2.0
"""Angles and speeds of one recording, whether a column reads them or not: a speed is the change of
an angle, and both sides of a gear differ by its ratio, or one of them has a wrong scale."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from osl_analysis.base.errors import InputError
from osl_analysis.base.recording import Channel, Recording
from osl_analysis.base.trial import Array, unit_of
from osl_analysis.base.units import in_si, normalised, si_factor
from osl_analysis.draft.likelihood import kinds_of_words, parted_name
from osl_analysis.draft.recorded_channel import likely_unit
from osl_analysis.signals.agreement import turn_ratio, turns

BESIDE = "beside "  # begins the key of a channel that turns, and that no column reads
SPEED = "rad/s"
TURNING = ("rad", SPEED)  # SI units of what turns


@dataclass(frozen=True, eq=False)
class Turning:
    """What turns in a recording.

    Attributes
    ----------
    name
        Its column, or its key in the file.
    is_of_motor
        Whether it is called so.
    turned
        How far in short times [rad], shape (spans,).
    """

    name: str
    is_speed: bool
    is_of_motor: bool
    turned: Array


def turns_beside(recording: Recording, asked: Mapping[str, Channel]) -> dict[str, Channel]:
    """The channels that turn in the rows of asked ones, and that none of these is, by the key that
    tells them from columns."""
    rows = {(channel.rows.name, channel.rows.count) for channel in asked.values()}
    keys = {channel.key for channel in asked.values()}
    return {
        BESIDE + channel.key: channel
        for channel in recording.channels
        if (channel.rows.name, channel.rows.count) in rows
        and channel.key not in keys
        and unit_of_turning(channel)[0]
        and "command" not in kinds_of(channel)
    }


def kinds_of(channel: Channel) -> set[str]:
    """What the words of a channel's name tell."""
    return kinds_of_words(parted_name(channel.key))


def unit_of_turning(channel: Channel) -> tuple[str, float]:
    """The SI unit of an angle or a speed, by the unit that is stated or that the name tells, and
    its factor; empty for anything else."""
    unit = channel.unit or channel.likely_unit or likely_unit(channel.name)
    factor, si_unit = in_si(normalised(unit))
    return (si_unit, factor) if si_unit in TURNING else ("", 0.0)


def factor_or_nan(unit: str, si_unit: str) -> float:
    """The factor of a file's unit; NaN where that is not known, as of the raw channel that `scale`
    converts."""
    try:
        return si_factor(unit, si_unit)
    except InputError:
        return np.nan


def told_of_turns(
    time: Array, columns: Mapping[str, Array], beside: Sequence[tuple[Channel, Array]]
) -> Iterator[tuple[str, str, str, float]]:
    """Hold angles and speeds of the same rows against each other.

    Parameters
    ----------
    time
        Shape (n,) [s].
    columns
        Readings (n,) of columns in SI units.
    beside
        Other channels that turn, and their readings (n,).

    Yields
    ------
    column, kind, other, ratio
        Of `speeds`, a speed over the change of its angle, one of which is the column; of `gears`,
        how many times as far the motor's side turns as the column, the joint's angle.
    """
    turning = []
    for column, readings in columns.items():
        unit = unit_of(column)
        if unit in TURNING and "command" not in column:
            turned = turns(time, readings, unit == SPEED)
            turning.append(Turning(column, unit == SPEED, column.endswith("_m"), turned))
    for channel, readings in beside:
        unit, factor = unit_of_turning(channel)
        turned = factor * turns(time, readings, unit == SPEED)
        is_of_motor = "motor" in kinds_of(channel)
        turning.append(Turning(f"'{channel.key}'", unit == SPEED, is_of_motor, turned))

    speeds = {}
    for angle, other in product(turning, turning):
        ratio = turn_ratio(angle.turned, other.turned)
        if angle.is_speed or np.isnan(ratio):
            continue
        if angle.name == "theta" and other.is_of_motor:
            yield "theta", "gears", other.name, ratio
        elif other.is_speed:
            speeds[angle, other] = ratio
    for pair, ratio in speeds.items():
        # where either is nearer to another one, as to that of another joint, they are of two
        sharing = [each for two, each in speeds.items() if {*pair} & {*two}]
        is_nearest = abs(np.log(ratio)) <= np.abs(np.log(sharing)).min()
        angle_name, speed_name = (each.name for each in pair)
        if is_nearest and angle_name in columns:
            yield angle_name, "speeds", speed_name, ratio
        elif is_nearest and speed_name in columns:
            yield speed_name, "speeds", angle_name, ratio
