"""How likely a channel is each canonical column, by one table, `likelihoods.yaml`: the words of its
name in several languages, its unit, what its readings do, and what else its log holds.

`benchmarks/draft_weights.py` fits the weights of the table on one half of labelled recordings, and
judges them by the other half.
"""

import math
import re
import unicodedata
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from osl_analysis.draft.recorded_channel import RecordedChannel
from osl_analysis.trial import COLUMNS
from osl_analysis.units import dimension, name_and_ending

TABLE = Path(__file__).with_name("likelihoods.yaml")
LEVELS = ("sync", "trigger")  # columns of volts, whose unit nobody states
COUNTS = ("", "dimensionless", "count")  # what may be of any quantity measures nothing, or this
SI_UNITS = ("rad", "rad/s", "N*m", "A", "V")  # that speak for a column
# of what is no angle, or none that was measured
NO_ANGLE = {"speed", "torque", "current", "derived", "other", "in rad/s", "in N*m", "in A"}
ONE_TURN = 2 * np.pi  # rad; a joint turns less, a motor may turn more
LEAST_TURN = 0.02  # rad; a clamped actuator turns less, a joint that is moved seldom

# of opensourceleg's logger: `knee[DephyActpack]:output_position`; or `knee.output_position`
ATTRIBUTE = re.compile(
    r"(?P<part>\w+)(?:\[(?P<driver>[\w ]+)\]:|\.(?=(?:motor|output|joint)_position))"
    r"(?P<attribute>\w+)"
)


@cache
def likelihoods() -> dict[str, Any]:
    """The table: `words` by what they tell, and `weights`, log-odds of columns by evidence."""
    table: dict[str, Any] = yaml.safe_load(TABLE.read_text(encoding="utf-8"))
    return table


@cache
def word_patterns() -> dict[str, re.Pattern[str]]:
    """A pattern for the words of each kind; `*` stands for any letters, `_` for the next word."""
    patterns: dict[str, re.Pattern[str]] = {}
    for kind, words in likelihoods()["words"].items():
        spelled = words.replace("*", "[a-z]*").replace("_", " ").split(", ")
        patterns[kind] = re.compile(rf"(?<![a-z])(?:{'|'.join(spelled)})(?![a-z])")
    return patterns


def parted_name(name: str) -> str:
    """The words of a name in small letters without accents: `JointAngle_deg` is `joint angle
    deg`."""
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name)
    plain = unicodedata.normalize("NFKD", parted.casefold())
    letters = "".join(sign for sign in plain if not unicodedata.combining(sign))
    return " ".join(re.findall(r"[a-z]+|\d+", letters))


def name_of(channel: RecordedChannel) -> str:
    """What a channel is called, without its topic, its group or its unit."""
    if "field" in channel.address:
        return channel.address["field"]
    if "*" in channel.key:  # a pattern for a name with a number that changes
        return channel.key
    return channel.name or " ".join(channel.address.values())


def words_of(channel: RecordedChannel) -> str:
    """The words of a channel's name; of an attribute without the class of its object."""
    name = name_of(channel)
    attribute = ATTRIBUTE.search(name)
    if attribute:
        return parted_name(f"{attribute['part']} {attribute['attribute']}")
    return parted_name(name_and_ending(name)[0])


def with_documented_unit(channel: RecordedChannel) -> RecordedChannel:
    """The channel with the unit that the library of its logger documents, as a likely one."""
    attribute = ATTRIBUTE.search(name_of(channel))
    if attribute is None or channel.unit:
        return channel
    known = channel.readings
    if attribute["driver"] is None and known.size and np.ptp(known) > ONE_TURN:
        return channel  # of another logger, and as of degrees
    unit = likelihoods()["attribute_units"].get(attribute["attribute"].rpartition("_")[2], "")
    return replace(channel, likely_unit=unit or channel.likely_unit)


def likely_level(channel: RecordedChannel) -> str:
    """The column of pulses that a channel is called like; empty if none."""
    kinds = kinds_of_words(words_of(channel))
    return next((column for column in LEVELS if column in kinds), "")


def kinds_of_words(words: str) -> set[str]:
    """What the words of a name tell; `unknown` if there are words of no kind."""
    patterns = word_patterns()
    kinds = {kind for kind, pattern in patterns.items() if pattern.search(words)}
    left = words
    for pattern in patterns.values():
        left = pattern.sub(" ", left)
    if re.search("[a-z]{2}", left):
        kinds.add("unknown")
    return kinds - {"neutral"}


def evidence_of(channel: RecordedChannel) -> set[str]:
    """What speaks for and against columns: name, unit and readings of one channel."""
    evidence = kinds_of_words(words_of(channel))
    factor, base = channel.base
    for unit in SI_UNITS:
        if base == dimension(unit):
            evidence.add(f"in {unit}")
    readings = channel.readings
    if readings.size and "in rad" in evidence:
        turned = float(np.ptp(readings)) * factor
        if turned > ONE_TURN:
            evidence.add("turns round")
        if turned < LEAST_TURN:
            evidence.add("hardly turns")
    if len(np.unique(readings)) == 2:
        evidence.add("two levels")
    return evidence


def with_context(evidence: Sequence[set[str]]) -> list[set[str]]:
    """The evidence for the channels of one log, with what the others tell.

    The output of an actuator turns with the joint where the motor's own angle is beside it, or no
    current and torque: the log is then of a joint that markers follow. An actuator is alone where
    something moves it and no joint's angle, measured or commanded, is beside it.
    """
    angles = [kinds for kinds in evidence if kinds & {"angle", "in rad"} and not kinds & NO_ANGLE]
    measured = [kinds for kinds in angles if "command" not in kinds]
    outputs = [kinds for kinds in measured if "output" in kinds]
    of_motor = [kinds for kinds in measured if "motor" in kinds]
    has_joint = not all(kinds & {"motor", "output"} for kinds in angles)
    is_driven = {"current", "torque"} <= set().union(*evidence)
    turns_with = "motor"
    if not has_joint and len(outputs) == 1 and (of_motor or not is_driven):
        turns_with = "joint"
        has_joint = True
    is_alone = not has_joint and bool(of_motor or outputs or is_driven)
    in_context = [set(kinds) for kinds in evidence]
    for kinds in in_context:
        if "output" in kinds:
            kinds.remove("output")
            kinds.add(turns_with)
        if "motor" in kinds:
            kinds.discard("joint")  # the motor of an ankle is no ankle
        if is_alone:
            kinds.add("actuator alone")
    return in_context


def probabilities(channel: RecordedChannel, evidence: Set[str]) -> dict[str, float]:
    """The probability that a channel is each of the columns that its unit does not contradict; the
    rest is that it is none."""
    weights: Mapping[str, Mapping[str, float]] = likelihoods()["weights"]
    odds: dict[str, float] = {}
    for column in allowed_columns(channel):
        kinds = ("always", *sorted(evidence))
        odds[column] = math.exp(sum(weights.get(kind, {}).get(column, 0.0) for kind in kinds))
    total = 1.0 + sum(odds.values())
    return {column: value / total for column, value in odds.items()}


def allowed_columns(channel: RecordedChannel) -> list[str]:
    """The columns of the table that the unit of a channel does not contradict."""
    return [
        column
        for column in likelihoods()["columns"]
        if column in LEVELS or channel.base[1] in (*COUNTS, dimension(COLUMNS[column]))
    ]
