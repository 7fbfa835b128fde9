"""The torques of a recording that a program computed from other signals of its log."""

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.ingest.likely_column import COMMAND, EFFORT, TORQUES, kind_of, parted_name
from osl_analysis.ingest.torque_formula import Kind, Signal, computed_from
from osl_analysis.measured import varies
from osl_analysis.recording import Channel, Recording, Rows
from osl_analysis.recording import Kind as ChannelKind
from osl_analysis.source_file import Addressed
from osl_analysis.trial import Array
from osl_analysis.units import base_units, dimension, normalised

KIND_OF_COLUMN: dict[str, Kind] = {
    "theta": "angle", "theta_m": "angle", "theta_command": "angle", "omega_m": "speed",
    "current": "current",
}  # fmt: skip
MOST_UNNAMED = 6  # channels that the source file does not name
LOAD_CELL = rf"\b({EFFORT}|load|cell|force|strain|gauge|bridge|raw|volts?|[fm] ?[xyz])\b"
ALIKE = 0.9  # correlation with the torque


def name_computed_torques(
    recording: Recording, channels: Mapping[str, Addressed], origins: Mapping[str, dict[str, Any]]
) -> None:
    """Note in the provenance of a torque, `computed_from`, of which signals of the log it was
    computed.

    Parameters
    ----------
    channels
        By canonical column, as the source file names them.
    origins
        Where each column comes from.
    """
    named = {
        id(recording.find(setting.address)): column
        for column, setting in channels.items()
        if column in KIND_OF_COLUMN
    }
    for column in TORQUES:
        if column not in channels:
            continue
        torque = recording.find(channels[column].address)
        beside = [
            other
            for other in recording.channels
            if other is not torque and are_same_rows(other.rows, torque.rows)
        ]
        values = numbers_of(torque)
        if values is None:
            continue
        signals = signals_beside(values, beside, named)
        found = computed_from(values, signals)
        if found:
            origins[column]["computed_from"] = found
            origins[column]["measured_beside"] = measured_torques(beside, signals)


def signals_beside(
    torque: Array, channels: Sequence[Channel], named: Mapping[int, str]
) -> list[Signal]:
    """The signals of which a torque may be computed: those that the source file names, with their
    column by `id`, and a few others, since every column takes time to read."""
    signals: list[Signal] = []
    of_others: list[tuple[Channel, Kind]] = []
    for channel in channels:
        kind = KIND_OF_COLUMN.get(named.get(id(channel), ""))
        if kind is not None:
            signals += signal_of(channel, kind)
        elif id(channel) not in named and channel.kind is ChannelKind.SIGNAL:
            of_others.append((channel, kind_of(channel) or "other"))
    of_others.sort(key=lambda each: each[1] == "other")
    for channel, kind in of_others[:MOST_UNNAMED]:
        if kind == "other" and may_be_load_cell(channel):
            continue
        for signal in signal_of(channel, kind):
            if kind != "other" or not is_alike(signal.values, torque):
                signals.append(signal)
    return signals


def signal_of(channel: Channel, kind: Kind) -> list[Signal]:
    """A channel as a signal; none where its readings are no numbers."""
    values = numbers_of(channel)
    if values is None:
        return []
    name = channel.name or channel.key
    is_command = bool(re.search(COMMAND, parted_name(name)))
    return [Signal(name, kind, values, is_command)]


def may_be_load_cell(channel: Channel) -> bool:
    """Whether a channel has a unit or a name that a load cell's own readings have."""
    if base_units(normalised(channel.unit or channel.likely_unit)):
        return True
    return bool(re.search(LOAD_CELL, parted_name(channel.name or channel.key)))


def is_alike(values: Array, torque: Array) -> bool:
    """Whether readings (n,) follow a torque, as the raw readings of its load cell do."""
    is_known = np.isfinite(values) & np.isfinite(torque)
    if not is_known.all():
        values = values[is_known]
        torque = torque[is_known]
    if not varies(values):
        return True
    values = values - values.mean()
    torque = torque - torque.mean()
    squares = float(values @ values) * float(torque @ torque)
    return abs(float(values @ torque)) > ALIKE * math.sqrt(squares)


def measured_torques(channels: Sequence[Channel], signals: Sequence[Signal]) -> list[str]:
    """The channels in a unit of torque that move, and were not computed from the signals."""
    found: list[str] = []
    for channel in channels:
        unit = base_units(normalised(channel.unit or channel.likely_unit))
        values = numbers_of(channel)
        if unit is None or unit[1] != dimension("N*m") or values is None:
            continue
        if varies(values[np.isfinite(values)]) and not computed_from(values, signals):
            found.append(channel.name or channel.key)
    return found


def are_same_rows(rows: Rows, others: Rows) -> bool:
    """Whether channels have the same instants."""
    if rows is others:
        return True
    are_alike = (rows.count, rows.rate_hz, rows.start_s) == (
        others.count,
        others.rate_hz,
        others.start_s,
    )
    return are_alike and rows.stamps_ns is None and others.stamps_ns is None


def numbers_of(channel: Channel) -> Array | None:
    """The readings of a channel (n,), NaN where one is missing; None where they are no numbers."""
    values = np.empty(0, object)
    with suppress(InputError):  # of a column of texts that nobody asked for
        values = channel.values
    if values.ndim != 1 or values.dtype.kind not in "iuf":
        return None
    numbers = np.ma.getdata(values).astype(np.float64, copy=False)
    mask = np.ma.getmaskarray(values)
    return np.where(mask, np.nan, numbers) if mask.any() else numbers
