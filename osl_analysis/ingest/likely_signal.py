"""Which canonical column a recorded channel may be, from its name and unit: a guess, for the draft of a source file."""

import re

from osl_analysis.columns import COLUMNS
from osl_analysis.ingest.overview import RecordedChannel
from osl_analysis.ingest.units import base_units, dimension, normalised

MOTOR = r"\b(motor|actuator|act|output|gear|mot)\b"
COMMAND = r"\b(command|commanded|cmd|desired|des|ref|reference|target|setpoint|goal)\b"
ANGLE = r"(angle|position|pos|theta|encoder)"
SPEED = r"(velocity|vel|speed|omega)"
EFFORT = r"(torque|moment|tau|effort)"
PATTERNS = {
    "sync": (r"\bsync", ""),
    "trigger": (r"\btrig(ger)?\b", ""),
    "theta_command": (COMMAND, rf"\b({EFFORT}|{SPEED}|current|stiffness|damping)\b"),
    "theta_m": (rf"{MOTOR}.*\b{ANGLE}\b|\b{ANGLE} (m\b|{MOTOR})", COMMAND),
    "omega_m": (rf"{MOTOR}.*\b{SPEED}\b|\bomega m\b", COMMAND),
    "torque_m": (rf"{MOTOR}.*\b{EFFORT}\b|\b{EFFORT} m\b", COMMAND),
    "current": (r"\b(current|amps|iq|i q)\b", COMMAND),
    "torque": (rf"\b({EFFORT}|load ?cell)\b", rf"{COMMAND}|{MOTOR}|ground"),
    "theta": (rf"\b({ANGLE}|ankle|knee|hip|joint)\b", rf"{COMMAND}|{MOTOR}|\b{SPEED}\b"),
}
"""By column: what the words of a name contain, and what they do not. The first that fits is the guess."""


BY_UNIT = {dimension("rad"): "theta", dimension("N*m"): "torque", dimension("A"): "current"}
"""What is guessed of a name that tells nothing, by what its unit measures."""
OTHER = rf"\b(ground|battery|supply|imu|roll|pitch|yaw|phase|current|{ANGLE}|{SPEED}|{EFFORT})\b"
"""Words of names of which only a unit does not tell enough."""


def likely_column(channel: RecordedChannel) -> str:
    """The canonical column that a channel may be; empty where name and unit tell none.

    A stated or likely unit must be one of the column's.
    """
    words = words_of(" ".join(value for key, value in channel.address.items() if key != "topic"))
    unit = channel.unit or channel.likely_unit
    measured = base_units(normalised(unit)) if unit else None
    for column, (wanted, unwanted) in PATTERNS.items():
        is_level = column in ("sync", "trigger")
        fits = is_level or measured is None or measured[1] == dimension(COLUMNS[column].unit)
        if fits and re.search(wanted, words) and not (unwanted and re.search(unwanted, words)):
            return column
    known = BY_UNIT.get(measured[1], "") if measured else ""
    unwanted = f"{COMMAND}|{OTHER}" if known == "current" else f"{COMMAND}|{OTHER}|{MOTOR}"
    return "" if re.search(unwanted, words) else known


PLAIN = {
    "theta": "ankle foot joint angle position pos theta encoder measured meas name",
    "theta_m": "actuator motor output angle position pos theta m encoder measured meas",
    "torque": "ankle foot joint torque moment tau load cell loadcell measured meas sensor",
    "current": "motor actuator current iq i q amps measured meas",
    "sync": "sync", "trigger": "trigger trig",
}  # fmt: skip
"""By column: the words of a name that leave no doubt. `theta_d` may be a command, `knee_angle` is another joint's."""


def is_certain(channel: RecordedChannel, column: str) -> bool:
    """Whether the name of a channel has no word that could make it another quantity than `column`.

    The words of its unit do not count.
    """
    name = " ".join(value for key, value in channel.address.items() if key != "topic")
    words, unit = words_of(name).split(), words_of(channel.likely_unit).split()
    if unit and not channel.unit and words[-len(unit) :] == unit:
        words = words[: -len(unit)]
    return bool(words) and set(words) <= set(PLAIN.get(column, "").split())


def words_of(name: str) -> str:
    """The words of a name in small letters: `JointAngle_deg` is `joint angle deg`."""
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name)
    return " ".join(re.findall(r"[a-z]+|\d+", parted.casefold()))
