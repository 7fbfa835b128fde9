"""The torques of a recording that a program computed from other signals of its log."""

from collections.abc import Mapping
from typing import Any

from osl_analysis.ingest.conversion import numbers_of
from osl_analysis.ingest.likely_column import TORQUES, quantity_of
from osl_analysis.measured import Signal, computed_from
from osl_analysis.recording import Recording
from osl_analysis.source_file import Addressed

MOST_SIGNALS = 8  # each takes time to read; those that the source file names come first


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
            quantity = quantity_of(channel) if channel.rows is torque.rows else None
            if quantity is not None and len(signals) < MOST_SIGNALS:
                signals.append(Signal(channel.name or channel.key, quantity, numbers_of(channel)))
        found = computed_from(numbers_of(torque), signals)
        if found:
            origins[column]["computed_from"] = found
