# SPDX-License-Identifier: Apache-2.0
"""Guess which canonical column each channel of a log is.

The log-odds of a column are a sum of weights over the evidence, in the table `likelihoods.yaml`:
the words of the channel's name in several languages, its unit, its readings, and the other channels
of the log. A guess is shown as one, and a doubt becomes a question. `benchmarks/draft_weights.py`
fits the weights on one half of labelled recordings, and judges them by the other half.
"""

import math
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.base.errors import quoted
from osl_analysis.base.files import package_yaml
from osl_analysis.base.measured import cycle_duration, spoiled, varies
from osl_analysis.base.source_file import COMPUTED
from osl_analysis.base.trial import COLUMNS, Array
from osl_analysis.draft.recorded_channel import RecordedChannel, name_and_ending
from osl_analysis.signals.filters import power_density, unfollowed_density
from osl_analysis.stats.linear_fit import FALSE_ALARM

TABLE = Path(__file__).with_name("likelihoods.yaml")
LEVELS = ("sync", "trigger")  # columns of volts, whose unit nobody states
COUNTS = ("", "1", "count")  # what may be of any quantity measures nothing, or this
SI_UNITS = ("rad", "rad/s", "N*m", "A", "V")  # that speak for a column
# of what is no angle, or none that was measured
NO_ANGLE = {"speed", "torque", "current", "derived", "other", "in rad/s", "in N*m", "in A"}
ONE_TURN = 2 * np.pi  # rad; a joint turns less, a motor may turn more
LEAST_TURN = 0.02  # rad; a clamped actuator turns less, a joint that is moved seldom
HELD_COLUMNS = ("current", "torque", "torque_m")  # which stand while an actuator is clamped
HELD_LEVEL = 5.0  # standard deviations of the noise
SURE = 0.8  # probability from which a channel is taken for a column
LEAST_PROBABLE = 0.2  # probability from which a channel may be a column
JOINTS = ("ankle", "knee", "hip")
FEWEST_READINGS = 100  # that show how a channel moves
LEAST_REPEATED = 0.2  # correlation of a signal with the reading before; noise has none
# of a channel, over which coherence is judged: of noise 1 % is then taken for coherent
SEGMENTS = 20
SPRING = 0.9  # correlation with an angle: a fifth of the torque's power may be damping or friction
FALLING = -0.5  # correlation below which a torque falls as the angle rises
COARSE_ROWS = 600  # of a recording; from sample to sample noise passes for speed
SLOW_CYCLE_S = 3.5  # that of a sine of 0.23 Hz by its mean speed; a hand takes 1 to 2.5 s
FEWEST_COUNTS = 1024  # of an encoder within a turn
SELDOM = 0.2  # share of the steps of an encoder that wrap, and of its range that such a step lacks

# of opensourceleg's logger: `knee[DephyActpack]:output_position`; or `knee.output_position`
ATTRIBUTE = re.compile(
    r"(?P<part>\w+)(?:\[(?P<driver>[\w ]+)\]:|\.(?=(?:motor|output|joint)_position))"
    r"(?P<attribute>\w+)"
)


def likelihoods() -> dict[str, Any]:
    """The table: `words` by what they tell, and `weights`, log-odds of columns by evidence."""
    return package_yaml(TABLE)


@cache
def word_patterns() -> dict[str, re.Pattern[str]]:
    """A pattern for the words of each kind; `*` stands for any letters, `_` for the next word."""
    patterns = {}
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


def words_of_channel(channel: RecordedChannel) -> str:
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
    kinds = kinds_of_words(words_of_channel(channel))
    return next((column for column in LEVELS if column in kinds), "")


def kinds_of_words(words: str) -> set[str]:
    """What the words of a name tell; `unknown` if there are words of no kind."""
    kinds = set()
    left = words
    for kind, pattern in word_patterns().items():
        if pattern.search(words):
            kinds.add(kind)
        left = pattern.sub(" ", left)
    if re.search("[a-z]{2}", left):
        kinds.add("unknown")
    return kinds - {"neutral"}


def evidence_of_channel(channel: RecordedChannel) -> set[str]:
    """What speaks for and against columns: name, unit and readings of one channel."""
    evidence = kinds_of_words(words_of_channel(channel))
    factor, unit = channel.base
    if unit in SI_UNITS:
        evidence.add(f"in {unit}")
    levels = np.unique(channel.readings)
    if levels.size and "in rad" in evidence:
        turned = (levels[-1] - levels[0]) * factor
        if turned > ONE_TURN:
            evidence.add("turns round")
        if turned < LEAST_TURN:
            evidence.add("hardly turns")
    if levels.size == 2:
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
    motor_kinds = [kinds for kinds in measured if "motor" in kinds]
    has_joint = not all(kinds & {"motor", "output"} for kinds in angles)
    is_driven = {"current", "torque"} <= set().union(*evidence)
    turns_with = "motor"
    if not has_joint and len(outputs) == 1 and (motor_kinds or not is_driven):
        turns_with = "joint"
        has_joint = True
    is_alone = not has_joint and bool(motor_kinds or outputs or is_driven)
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
    odds = {}
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
        if column in LEVELS or channel.base[1] in (*COUNTS, COLUMNS[column])
    ]


@dataclass
class Guess:
    """A guess at what a channel is, and why.

    Attributes
    ----------
    channel
        Unwrapped.
    evidence
        What speaks for and against columns.
    wraps_at
        Range after which the channel wraps; 0 if it does not.
    likely
        The probability of each column that may be it.
    why_not
        Why it is no signal: it stands still, or is noise.
    is_sure
        Whether no other channel is like its column, and the evidence leaves no doubt.
    why
        The evidence for its column, in words.
    sign
        Of the channel in the source file; 0: the motion does not tell it.
    """

    channel: RecordedChannel
    evidence: set[str]
    wraps_at: float = 0.0
    why_not: str = ""
    is_sure: bool = False
    why: str = "guessed from its name"
    sign: int = 0

    def __post_init__(self) -> None:
        self.likely = probabilities(self.channel, self.evidence)

    @property
    def column(self) -> str:
        """The likeliest column; empty if none is likely."""
        column = max(self.likely, key=lambda name: self.likely[name], default="")
        return column if self.may_be(column) else ""

    def may_be(self, column: str, at_least: float = LEAST_PROBABLE) -> bool:
        """Whether the channel is a signal that may be the column."""
        return not self.why_not and self.likely.get(column, 0.0) >= at_least


def guessed_columns(channels: Sequence[RecordedChannel]) -> list[Guess]:
    """Guess what each channel of a log is, the same for every recorder, by its sound readings."""
    channels = [
        replace(channel, numbers=np.where(spoiled(channel.numbers), np.nan, channel.numbers))
        for channel in channels
    ]
    wraps = [wrapping_range(channel) for channel in channels]
    channels = [
        replace(channel, numbers=np.unwrap(channel.readings, period=at)) if at else channel
        for channel, at in zip(channels, wraps, strict=True)
    ]
    evidence = with_context([evidence_of_channel(channel) for channel in channels])
    guesses = [Guess(*fields) for fields in zip(channels, evidence, wraps, strict=True)]
    for guess in guesses:
        guess.why_not = why_no_signal(guess, channels)
    decide_columns(guesses)
    return guesses


def decide_columns(guesses: Sequence[Guess]) -> None:
    """Make those guesses sure that leave no doubt: no other channel may be the same column, or an
    angle and a torque alone follow each other like a spring. What may also be a column that another
    channel surely is, is it not."""
    pairs = [
        (angle, torque, correlation(angle.channel, torque.channel))
        for angle in candidates(guesses, "theta")
        for torque in candidates(guesses, "torque")
    ]
    springs = [pair for pair in pairs if abs(pair[2]) > SPRING]
    confirmed = springs[0][:2] if len(springs) == 1 else ()
    for guess in confirmed:
        guess.likely = probabilities(guess.channel, {*guess.evidence, "spring"})
    taken: set[str] = set()
    for guess in sorted(guesses, key=lambda guess: guess.likely.get(guess.column, 0), reverse=True):
        rivals = [rival for rival in guesses if rival is not guess and rival.may_be(guess.column)]
        free = 1 - sum(guess.likely.get(column, 0) for column in taken)
        guess.is_sure = guess.may_be(guess.column, SURE * free) and (
            guess in confirmed or not rivals
        )
        if guess.is_sure:
            taken.add(guess.column)

    sure = [pair for pair in pairs if pair[0].is_sure and pair[1].is_sure]
    for angle, torque, r in sure[:1]:
        if confirmed:
            for guess, partner in ((angle, torque), (torque, angle)):
                name = quoted(name_of(partner.channel))
                guess.why = f"a guess: as a spring with {name}, r = {abs(r):.3f}"
        elif len(joints_named([angle.channel, torque.channel])) > 1:
            angle.is_sure = torque.is_sure = False
        if "turns round" in angle.evidence:
            angle.why += ": more than a turn, are unit and names right?"
        # a joint resists: the torque of an inertia falls, too, but its losses go with the speed
        power = correlation(angle.channel, torque.channel, with_speed=True)
        if min(r, power) > 0:
            torque.sign = 1
        elif r < FALLING and power < 0:
            torque.sign = -1
            torque.why += ": it falls as the angle rises, and drives the motion"


def candidates(guesses: Sequence[Guess], column: str) -> list[Guess]:
    """The guesses that may be a column; if the evidence for one alone leaves no doubt, that one. A
    torque that is called computed, as `effort`, is none beside one that is not."""
    clear = [guess for guess in guesses if guess.may_be(column, SURE)]
    likely = [guess for guess in guesses if guess.may_be(column)]
    if len(clear) == 1:
        likely = clear
    if column == "torque":
        measured = [guess for guess in likely if not COMPUTED.search(name_of(guess.channel))]
        likely = measured or likely
    return likely


def why_no_signal(guess: Guess, channels: Sequence[RecordedChannel]) -> str:
    """Why a channel is no signal, in words; empty if it may be one. Of few readings nothing is
    said. A held current or torque may be noise, and so may the speed of an actuator that stands.
    What follows another of the `channels` is motion, however fast it changes."""
    known = guess.channel.readings
    if known.size < FEWEST_READINGS:
        return ""
    if not varies(known):
        return "it does not move"
    tells_next = np.corrcoef(known[1:], known[:-1])[0, 1] > LEAST_REPEATED
    is_held = guess.column in HELD_COLUMNS and abs(known.mean()) > HELD_LEVEL * known.std()
    is_noise = not (tells_next or is_held or guess.column == "omega_m")
    if not is_noise or np.unique(known).size <= 2:
        return ""
    is_followed = any(follows(known, other_channel.readings) for other_channel in channels)
    return "" if is_followed else "nothing but noise"


def follows(readings: Array, other_readings: Array) -> bool:
    """Whether most of the power of a channel is coherent with another one of the same rows; a
    channel that is the same tells nothing."""
    if (
        len(readings) != len(other_readings)
        or np.array_equal(readings, other_readings)
        or not varies(other_readings)
    ):
        return False
    rows = len(readings) // SEGMENTS
    _, powers = power_density(readings, 1.0, rows)
    _, left = unfollowed_density(readings, other_readings, 1.0, rows, FALSE_ALARM)
    return bool(left.sum() < powers.sum() / 2)


def correlation(theta: RecordedChannel, torque: RecordedChannel, with_speed: bool = False) -> float:
    """Correlation of the readings of two channels, or of the first one's speed, by their times if
    they have any; 0 if they cannot be compared."""
    x = np.nan_to_num(theta.numbers, posinf=0.0, neginf=0.0)
    y = np.nan_to_num(torque.numbers, posinf=0.0, neginf=0.0)
    if theta.times is not torque.times and theta.times is not None and torque.times is not None:
        x = np.interp(torque.times, theta.times, x)
    if len(x) != len(y) or len(x) <= FEWEST_READINGS or not (varies(x) and varies(y)):
        return 0.0
    if with_speed:
        x = np.gradient(x)
    return float(np.corrcoef(x, y)[0, 1])


def wrapping_range(channel: RecordedChannel) -> float:
    """The range, a turn or a power of two, at which a channel wraps; 0 if it does not."""
    steps = np.abs(np.diff(channel.readings))
    span = np.ptp(channel.readings) if steps.size else 0.0
    leaps = steps[steps > 0.5 * span]
    if 0 < leaps.size < SELDOM * steps.size:
        counts = 2.0 ** math.ceil(math.log2(max(span, FEWEST_COUNTS)))
        for turn in (ONE_TURN, 360.0, counts):
            if span <= turn and (np.abs(leaps / turn - 1) < SELDOM).all():
                return turn
    return 0.0


def joints_named(channels: Iterable[RecordedChannel]) -> list[str]:
    """The joints in the names of channels."""
    words = " ".join(parted_name(name_of(channel)) for channel in channels)
    return [joint for joint in JOINTS if re.search(rf"\b{joint}\b", words)]


def turns_slowly(guesses: Sequence[Guess], clock: RecordedChannel | None) -> bool:
    """Whether the angle goes to and fro in slow cycles: they tell K alone. A log whose clock or
    angle is not known does not tell."""
    angles = [guess.channel for guess in guesses if guess.is_sure and guess.column == "theta"]
    if clock is None or not angles or angles[0].readings.size < FEWEST_READINGS:
        return False
    known = angles[0].readings
    coarse = known[np.linspace(0, known.size - 1, COARSE_ROWS).astype(int)]  # without noise
    turns = np.count_nonzero(np.diff(coarse > coarse.mean()))
    step_s = clock.base[0] * np.ptp(clock.numbers) / (COARSE_ROWS - 1)
    return bool(turns >= 2 and cycle_duration(coarse, step_s) > SLOW_CYCLE_S)
