# SPDX-License-Identifier: Apache-2.0
"""Compare angles and speeds of one recording, also of channels that no column reads.

A speed is the change of an angle, and both sides of a gear differ by its ratio. Another ratio shows
a wrong scale. Example: a speed in rpm that is declared as rad/s is 9.55 times too large.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from osl_analysis.base.errors import InputError
from osl_analysis.base.recording import Channel, Recording
from osl_analysis.base.trial import Array, unit_of
from osl_analysis.base.units import in_si, normalised, si_factor
from osl_analysis.draft.likelihood import kinds_of_words, parted_name
from osl_analysis.draft.recorded_channel import likely_unit
from osl_analysis.signals.agreement import turn_ratio, turns

OTHER_TURNING = "beside "  # begins the key of a channel that turns, and that no column reads
SPEED = "rad/s"
TURNING = ("rad", SPEED)  # SI units of what turns


@dataclass(frozen=True, eq=False)
class Turning:
    """What turns in a recording.

    Attributes
    ----------
    name
        Its column, or its key in the file.
    is_motor_side
        Whether its name says that it is of the motor.
    turned
        How far in short times [rad], shape (spans,).
    """

    name: str
    is_speed: bool
    is_motor_side: bool
    turned: Array


def other_turning_channels(
    recording: Recording, asked: Mapping[str, Channel]
) -> dict[str, Channel]:
    """Find the angles and speeds that nobody asked for, in the rows of asked channels.

    Their keys begin with `OTHER_TURNING`, which no column does.
    """
    rows = {(channel.rows.name, channel.rows.count) for channel in asked.values()}
    keys = {channel.key for channel in asked.values()}
    return {
        OTHER_TURNING + channel.key: channel
        for channel in recording.channels
        if (channel.rows.name, channel.rows.count) in rows
        and channel.key not in keys
        and unit_of_turning(channel)[0]
        and "command" not in kinds_of(channel)
    }


def kinds_of(channel: Channel) -> set[str]:
    """The kinds of signal that the words of a channel's name state."""
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


class TurnRatio(NamedTuple):
    """How far one thing turns for another one of the same rows."""

    column: str
    kind: str  # `speeds`: speed over the change of its angle; `gears`: motor's side over joint's
    compared_with: str  # the other column, or the key of a channel
    ratio: float  # [1]


def compare_turning(
    time: Array,
    columns: Mapping[str, Array],
    other_channels: Sequence[tuple[Channel, Array]],
) -> Iterator[TurnRatio]:
    """Compare angles and speeds of the same rows.

    Parameters
    ----------
    time
        Shape (n,) [s].
    columns
        Readings (n,) of columns in SI units.
    other_channels
        Other channels that turn, and their readings (n,).

    Yields
    ------
    TurnRatio
        Of a column that is an angle and its speed, or a speed and its angle; of the joint's angle
        and each thing on the motor's side.
    """
    turning = []
    for column, readings in columns.items():
        unit = unit_of(column)
        if unit in TURNING and "command" not in column:
            turned = turns(time, readings, unit == SPEED)
            turning.append(Turning(column, unit == SPEED, column.endswith("_m"), turned))
    for channel, readings in other_channels:
        unit, factor = unit_of_turning(channel)
        turned = factor * turns(time, readings, unit == SPEED)
        is_motor_side = "motor" in kinds_of(channel)
        turning.append(Turning(f"'{channel.key}'", unit == SPEED, is_motor_side, turned))

    speeds = {}
    for angle, other_turning in product(turning, turning):
        ratio = turn_ratio(angle.turned, other_turning.turned)
        if angle.is_speed or np.isnan(ratio):
            continue
        if angle.name == "theta" and other_turning.is_motor_side:
            yield TurnRatio("theta", "gears", other_turning.name, ratio)
        elif other_turning.is_speed:
            speeds[angle, other_turning] = ratio
    for pair, ratio in speeds.items():
        # where either is nearer to another one, as to that of another joint, they are of two
        ratios_of_same = [
            other_ratio for other_pair, other_ratio in speeds.items() if {*pair} & {*other_pair}
        ]
        is_nearest = abs(np.log(ratio)) <= np.abs(np.log(ratios_of_same)).min()
        angle, speed = pair
        if is_nearest and angle.name in columns:
            yield TurnRatio(angle.name, "speeds", speed.name, ratio)
        elif is_nearest and speed.name in columns:
            yield TurnRatio(speed.name, "speeds", angle.name, ratio)
