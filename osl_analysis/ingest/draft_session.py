"""A draft of clocks where one log is of a whole session: the cameras' gate in it is as long as each
capture, and an angle that both recorded tells which capture it is."""

import json
import re
from collections.abc import Sequence

import numpy as np

from osl_analysis.ingest.clock import GATE_STEPS, angle_at, find_edges
from osl_analysis.ingest.draft import DraftedLog, times_of, with_number
from osl_analysis.ingest.draft_walking import segment_of
from osl_analysis.ingest.overview import Overview, RecordedChannel
from osl_analysis.trial import Array
from osl_analysis.units import base_units, dimension, normalised

HIGH_V = 1.0  # of a gate while cameras record; a line that nothing is connected to is near 0
MOST_NOISE = 0.02  # SD of its level, as a share
ANGLE_UNITS = {"rad": 1.0, "deg": float(np.rad2deg(1.0))}
LARGEST_UNIT_RATIO = 2.5  # of the ranges of encoder and markers; two units differ by 57


def gate_lengths(log: DraftedLog) -> Array:
    """Lengths (n,) [s] of the pulses of a log's sync line; none if it has none."""
    sync = log.sure("sync")
    level = None if sync is None else sync.numbers
    time = times_of(level, log.clock)
    if level is None or time is None:
        return np.zeros(0)
    edges, rising, _ = find_edges(time, level)
    return np.asarray(np.diff(edges)[rising[:-1]])


def is_gated(capture: Overview, lengths: Array) -> bool:
    """Whether one of the pulses (n,) [s] is as long as a capture."""
    for channel in capture.channels:
        if channel.kind == "marker" and channel.numbers is not None and channel.rate:
            seconds = len(channel.numbers) / channel.rate
            return bool((np.abs(lengths - seconds) <= GATE_STEPS / channel.rate).any())
    return False


def with_session_log(source: str, capture: Overview, side: str) -> str:
    """The drafted source file of captures, with the gate as `sync` and the angle that the log has,
    too, where the names of channels and markers tell them. `side`, R or L, is the leg's with the
    log; empty if markers have none."""
    analogs = [one for one in capture.channels if one.kind == "analog"]
    gates = [one for one in analogs if is_high_throughout(one)]
    if len(gates) == 1 and "\n# analogs:\n" in source:
        address = json.dumps(with_number(gates[0], analogs).key)
        line = f'  sync: {{channel: {address}, unit: "V"}}  # a guess: it is high throughout'
        source = source.replace("\n# analogs:\n", f"\nanalogs:\n{line}\n")
    markers = angle_markers([one for one in capture.channels if one.kind == "marker"], side)
    if markers:
        listed = ", ".join(json.dumps(name) for name in markers)
        source += f"shared: {{column: theta, markers: [{listed}]}}  # a guess, by their names\n"
    return source


def is_high_throughout(channel: RecordedChannel) -> bool:
    """Whether a channel of volts stands at one level far from 0."""
    measured = (base_units(normalised(channel.unit)) or (1.0, ""))[1]
    if channel.numbers is None or measured != dimension("V") or not channel.count:
        return False
    level = abs(float(np.mean(channel.numbers)))
    return level > HIGH_V and float(np.std(channel.numbers)) < MOST_NOISE * level


def angle_markers(channels: Sequence[RecordedChannel], side: str) -> list[str]:
    """Markers of knee, ankle and forefoot of the leg of a side; empty if the names do not tell one
    of each."""
    names = list(dict.fromkeys(one.name or one.key for one in channels))
    places = {name: segment_of(name) for name in names}
    knees = [
        name for name in names if re.fullmatch(rf"{side}[._ ]?(LAT[._ ]?)?KNEE?", name.upper())
    ]
    ankles = [name for name, place in places.items() if place == (side, "ankle_lateral")]
    feet = [
        name
        for name, place in places.items()
        if place == (side, "foot") and not re.search("HEE|CAL|FCC", name.upper())
    ]
    if len(knees) != 1 or len(ankles) != 1 or not feet:
        return []
    return [knees[0], ankles[0], feet[0]]


def with_angle_unit(source: str, log: DraftedLog, capture: Overview, side: str) -> str:
    """The drafted source file of a log, with the unit of theta that makes its range that of the
    angle of markers, where no unit is stated."""
    unstated = re.search(r'\n  theta: .*unit: "UNKNOWN".*', source)
    theta = log.sure("theta")
    tracks = {one.name or one.key: one.numbers for one in capture.channels if one.kind == "marker"}
    markers = angle_markers([one for one in capture.channels if one.kind == "marker"], side)
    points = [tracks[name] for name in markers]
    if unstated is None or theta is None or theta.numbers is None or not points:
        return source
    if any(track is None for track in points):
        return source
    seen = angle_at(*[np.asarray(track) for track in points])
    seen = seen[np.isfinite(seen)]
    if not seen.size or not np.ptp(seen) > 0:
        return source
    ratio = float(np.ptp(theta.numbers) / np.ptp(seen))
    for unit, factor in ANGLE_UNITS.items():
        if 1 / LARGEST_UNIT_RATIO < ratio / factor < LARGEST_UNIT_RATIO:
            line = unstated[0].replace("UNKNOWN", unit)
            told = line.replace("no unit is stated", "the unit is guessed from the markers")
            return source.replace(unstated[0], told)
    return source
