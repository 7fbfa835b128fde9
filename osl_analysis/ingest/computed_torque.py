"""The torques of a recording that a program computed from other signals of its log."""

import re
from collections.abc import Mapping
from typing import Any

from osl_analysis.ingest.conversion import numbers_of
from osl_analysis.measured import Quantity, Signal, computed_from
from osl_analysis.recording import Channel, Recording
from osl_analysis.source_file import Addressed
from osl_analysis.units import base_units, dimension, normalised

MOST_SIGNALS = 8  # each takes time to read; those that the source file names come first
TORQUES = ("torque", "torque_m")
# in the name of a channel without a unit
QUANTITY_WORDS: dict[Quantity, str] = {
    "speed": "vel|speed|omega",
    "angle": "angle|pos|theta|encoder",
    "current": r"current|\biq\b|\bi_q\b",
}
COMMAND = "(?i)com?ma?n?d|desired|ref|target|set_?point|goal|soll|consign|(^|_)des($|_)"


def name_computed_torques(
    recording: Recording, channels: Mapping[str, Addressed], origins: Mapping[str, dict[str, Any]]
) -> None:
    """Note in the provenance of a torque, `computed_from`, from which signals of the log it follows
    exactly.

    Parameters
    ----------
    channels
        By canonical column, as the source file names them.
    origins
        Where each column comes from.
    """
    asked = [recording.find(setting.address) for setting in channels.values()]
    candidates = sorted(recording.channels, key=lambda channel: channel not in asked)
    for column in TORQUES:
        if column not in channels:
            continue
        torque = recording.find(channels[column].address)
        signals: list[Signal] = []
        for channel in candidates:
            if channel is torque:  # its file may state the unit of an angle for every column
                continue
            quantity = quantity_of(channel) if channel.rows is torque.rows else None
            if quantity is not None and len(signals) < MOST_SIGNALS:
                signals.append(Signal(channel.name or channel.key, quantity, numbers_of(channel)))
        found = computed_from(numbers_of(torque), signals)
        if found:
            origins[column]["computed_from"] = found


def quantity_of(channel: Channel) -> Quantity | None:
    """What a channel may be by its unit, or else by its name."""
    name = channel.name or channel.key
    quantities: dict[str, Quantity] = {
        dimension("rad"): "angle",
        dimension("rad/s"): "speed",
        dimension("A"): "current",
    }
    unit = base_units(normalised(channel.unit or channel.likely_unit))
    quantity = quantities.get(unit[1]) if unit is not None else None
    if unit is None or unit[1] in ("", "dimensionless", "count"):
        by_name = (each for each, of in QUANTITY_WORDS.items() if re.search(of, name.casefold()))
        quantity = next(by_name, None)
    return "command" if quantity == "angle" and re.search(COMMAND, name) else quantity
