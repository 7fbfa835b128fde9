"""A draft of clocks where one log is of a whole session: the cameras' gate in it is as long as each
capture, and an angle that both recorded tells which capture it is."""

import json
import re

import numpy as np

from osl_analysis.draft.draft_source import DraftedLog, DraftedSource, Entry, with_number
from osl_analysis.draft.draft_walking import segment_of
from osl_analysis.draft.recorded_channel import Overview, RecordedChannel
from osl_analysis.ingest.clock import GATE_STEPS, find_edges
from osl_analysis.trial import Array
from osl_analysis.units import dimension

HIGH_V = 1.0  # of a gate while cameras record; a line that nothing is connected to is near 0
MOST_NOISE = 0.02  # SD of its level, as a share


def gate_lengths(log: DraftedLog) -> Array:
    """Lengths (n,) [s] of the pulses of a log's sync line; none if it has none."""
    sync = log.sure("sync")
    clock = log.clock
    if sync is None or sync.numbers is None or clock is None or clock.numbers is None:
        return np.zeros(0)
    if not np.isfinite(sync.numbers).all() or not (np.diff(clock.numbers) >= 0).all():
        return np.zeros(0)
    edges, rising, _ = find_edges(clock.numbers * clock.base[0], sync.numbers)
    return np.asarray(np.diff(edges)[rising[:-1]])


def is_gated(capture: Overview, lengths: Array) -> bool:
    """Whether one of the pulses (n,) [s] is as long as a capture."""
    for channel in capture.channels:
        if channel.kind == "marker" and channel.numbers is not None and channel.rate:
            seconds = len(channel.numbers) / channel.rate
            return bool((np.abs(lengths - seconds) <= GATE_STEPS / channel.rate).any())
    return False


def join_session_log(source: DraftedSource, capture: Overview, side: str) -> None:
    """State in the drafted source file of captures the gate as `sync`, and the angle that the log
    has, too, where the names of channels and markers tell them. `side`, R or L, is the leg's with
    the log; empty if markers have none."""
    analogs = [one for one in capture.channels if one.kind == "analog"]
    gates = [one for one in analogs if is_high_throughout(one)]
    if len(gates) == 1 and not source.named:
        fields: dict[str, object] = {"channel": with_number(gates[0], analogs).key, "unit": "V"}
        source.entries.insert(0, Entry("sync", fields, "a guess: it is high throughout"))
    markers = angle_markers(capture, side)
    if markers:
        source.settings["shared"] = {"column": "theta", "markers": markers}
        source.questions.append(f"shared: a guess, by the names {json.dumps(markers)}")


def is_high_throughout(channel: RecordedChannel) -> bool:
    """Whether a channel of volts stands at one level far from 0."""
    if channel.numbers is None or channel.base[1] != dimension("V") or not channel.count:
        return False
    level = abs(float(np.mean(channel.numbers)))
    return level > HIGH_V and float(np.std(channel.numbers)) < MOST_NOISE * level


def angle_markers(capture: Overview, side: str) -> list[str]:
    """The names of the markers of knee, ankle and forefoot of the leg of a side; empty if the names
    do not tell one of each."""
    markers = [one.name or one.key for one in capture.channels if one.kind == "marker"]
    names = list(dict.fromkeys(markers))
    knee = rf"{side}[._ ]?(LAT[._ ]?)?KNEE?"
    knees = [name for name in names if re.fullmatch(knee, name.upper())]
    ankles = [name for name in names if segment_of(name) == (side, "ankle_lateral")]
    feet = [
        name
        for name in names
        if segment_of(name) == (side, "foot") and not re.search("HEE|CAL|FCC", name.upper())
    ]
    return [knees[0], ankles[0], feet[0]] if len(knees) == len(ankles) == 1 and feet else []
