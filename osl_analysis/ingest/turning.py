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
from osl_analysis.base.units import EXAMPLES, si_factor
from osl_analysis.draft.likelihood import kinds_of_words, parted_name
from osl_analysis.draft.recorded_channel import likely_unit, name_and_ending
from osl_analysis.signals.agreement import turn_ratio, turns

BESIDE = "beside "  # begins the key of a channel that turns, and that no column reads
SI_UNITS = {"speed": "rad/s", "angle": "rad"}
SIDES = ("joint", "motor")  # of a gear
NOT_MEASURED = {"command", "derived", "other"}  # by the words of a name without a unit


@dataclass(frozen=True, eq=False)
class Turning:
    """What turns in a recording.

    Attributes
    ----------
    name
        Its column, or its key in the file.
    side
        That of a gear: `motor` or `joint`; empty where nothing tells it.
    turned
        How far in short times, shape (spans,), in its unit.
    factors
        Those that its unit may have to the SI unit (units,).
    """

    name: str
    is_speed: bool
    side: str
    turned: Array
    factors: Array


def turns_beside(recording: Recording, asked: Mapping[str, Channel]) -> dict[str, Channel]:
    """The channels that turn in the rows of asked ones, and that none of these is, by the key that
    tells them from columns."""
    if not any(unit_of(column) in SI_UNITS.values() for column in asked):
        return {}
    rows = {(channel.rows.name, channel.rows.count) for channel in asked.values()}
    keys = {channel.key for channel in asked.values()}
    return {
        BESIDE + channel.key: channel
        for channel in recording.channels
        if (channel.rows.name, channel.rows.count) in rows
        and channel.key not in keys
        and kind_of(channel)
    }


def kinds_of(channel: Channel) -> set[str]:
    """What the words of a channel's name tell."""
    name = channel.address.get("field", channel.name or channel.key)
    return kinds_of_words(parted_name(name_and_ending(name)[0]))


def told_unit(channel: Channel) -> str:
    """The unit of a channel: stated, or by its name."""
    return channel.unit or channel.likely_unit or likely_unit(channel.name)


def kind_of(channel: Channel) -> str:
    """Whether a channel is an `angle` or a `speed`, by its unit, or by its name where it has none;
    empty if neither, and of a command."""
    unit = told_unit(channel)
    kinds = kinds_of(channel)
    if unit:
        is_measured = "command" not in kinds
        kinds = {kind for kind in SI_UNITS if factor_or_nan(unit, SI_UNITS[kind]) > 0}
    else:
        is_measured = kinds.isdisjoint(NOT_MEASURED)
    return next((kind for kind in SI_UNITS if is_measured and kind in kinds), "")


def factor_or_nan(unit: str, si_unit: str) -> float:
    """The factor of a file's unit; NaN where that is not known, as of the raw channel that `scale`
    converts."""
    try:
        return si_factor(unit, si_unit)
    except InputError:
        return np.nan


def turning_column(column: str, time: Array, in_si: Array) -> Turning:
    """A column in its SI unit (n,) at times (n,) [s]."""
    is_speed = unit_of(column) == SI_UNITS["speed"]
    side = "motor" if column.endswith("_m") else "joint"
    return Turning(column, is_speed, side, turns(time, in_si, is_speed), np.ones(1))


def turning_channel(channel: Channel, time: Array, readings: Array) -> Turning:
    """A channel that no column reads, by its readings (n,) at times (n,) [s]. A unit that nobody
    states may be any usual one."""
    kind = kind_of(channel)
    si_unit = SI_UNITS[kind]
    unit = told_unit(channel)
    factors = [si_factor(unit, si_unit)] if unit else [*EXAMPLES[si_unit].values()]
    turned = turns(time, readings, kind == "speed")
    sides = kinds_of(channel).intersection(SIDES)
    side = max(sides, default="")  # the motor of a joint is the motor's side
    return Turning(f"'{channel.key}'", kind == "speed", side, turned, np.array(factors))


def ratio_of(one: Turning, other: Turning) -> float:
    """How many times as far another turns: of units that may be, in those by which it is nearest to
    1. NaN where it does not follow."""
    units = np.divide.outer(other.factors, one.factors).ravel()
    possible = turn_ratio(one.turned, other.turned) * units
    return float(possible[np.abs(np.log(possible)).argmin()])


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
    own = [
        turning_column(column, time, in_si)
        for column, in_si in columns.items()
        if unit_of(column) in SI_UNITS.values() and "command" not in column
    ]
    others = [
        turning_channel(channel, time, readings)
        for channel, readings in beside
        if told_unit(channel) or (readings != np.rint(readings)).any()  # else counts of an encoder
    ]
    speeds = {}
    for angle, other in product([*own, *others], repeat=2):
        ratio = np.nan if angle.is_speed else ratio_of(angle, other)
        is_gear = angle.name == "theta" and other.side == "motor"
        if np.isfinite(ratio) and is_gear and other.factors.size == 1:
            yield angle.name, "gears", other.name, ratio
        elif np.isfinite(ratio) and other.is_speed and {angle.side, other.side} != {*SIDES}:
            speeds[angle, other] = ratio
    for pair, ratio in speeds.items():
        # where either is nearer to another one, as to that of another joint, they are of two
        sharing = [other for two, other in speeds.items() if {*pair} & {*two}]
        is_nearest = abs(np.log(ratio)) <= np.abs(np.log(sharing)).min()
        for column, other in (pair, pair[::-1]):
            if is_nearest and column in own:
                yield column.name, "speeds", other.name, ratio
                break
