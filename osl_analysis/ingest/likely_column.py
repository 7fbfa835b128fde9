"""What each channel of a log may be, by its name, its unit and its readings, for the draft of a
source file. A guess is shown as one, and what leaves a doubt is asked."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from osl_analysis.ingest.overview import RecordedChannel
from osl_analysis.measured import (
    Quantity,
    Signal,
    computed_from,
    factor_of,
    usual_size,
    varies,
)
from osl_analysis.recording import Channel
from osl_analysis.trial import COLUMNS, Array
from osl_analysis.units import base_units, dimension, name_and_ending, normalised

MOTOR = r"\b(motor|actuator|act|output|gear|mot)\b"
COMMAND = r"\b(command|commanded|cmd|desired|des|ref|reference|target|setpoint|goal)\b"
ANGLE = r"(angle|position|pos|theta|encoder|winkel|hoek)"
SPEED = r"(velocity|vel|speed|omega|geschwindigkeit|snelheid)"
EFFORT = r"(torque|moment|tau|effort|drehmoment|koppel)"
QUANTITY_WORDS: dict[Quantity, str] = {
    "speed": SPEED,
    "angle": ANGLE,
    "current": r"(current|iq|i q)",
}
NO_SIGNAL = r"\b(temperature|temp|voltage|battery|supply|humidity|pressure)\b"
NOISE = "nothing but noise"
HELD_COLUMNS = ("current", "torque", "torque_m")  # which stand while an actuator is clamped
HELD_LEVEL = 5.0  # standard deviations of the noise


@dataclass(frozen=True)
class ColumnWords:
    """The words of a name by which a canonical column is told.

    Attributes
    ----------
    wanted, unwanted
        What a name contains, and what it does not.
    certain
        The words of a name that leave no doubt: `theta_d` may be a command, `knee_angle` another
        joint's.
    """

    wanted: str
    unwanted: str = ""
    certain: str = ""


WORDS = {
    "sync": ColumnWords(r"\b(sync|ttl)", "", "sync in"),
    "trigger": ColumnWords(r"\btrig(ger)?\b", "", "trigger trig"),
    "theta_command": ColumnWords(COMMAND, rf"\b({EFFORT}|{SPEED}|current|stiffness|damping)\b"),
    "theta_m": ColumnWords(
        rf"{MOTOR}.*\b{ANGLE}\b|\b{ANGLE} (m\b|{MOTOR})",
        COMMAND,
        "actuator motor output angle position pos theta m encoder measured meas",
    ),
    "omega_m": ColumnWords(rf"{MOTOR}.*\b{SPEED}\b|\bomega m\b", COMMAND),
    "torque_m": ColumnWords(rf"{MOTOR}.*\b{EFFORT}\b|\b{EFFORT} m\b", COMMAND),
    "current": ColumnWords(
        r"\b(current|amps|iq|i q)\b",
        COMMAND,
        "motor actuator current iq i q amps measured meas",
    ),
    "torque": ColumnWords(
        rf"\b({EFFORT}|load ?cell)\b",
        rf"{COMMAND}|{MOTOR}|ground",
        "ankle foot joint torque moment tau load cell loadcell reaction mz drehmoment koppel"
        " measured meas sensor",
    ),
    "theta": ColumnWords(
        rf"\b({ANGLE}|ankle|knee|hip|joint)\b",
        rf"{COMMAND}|{MOTOR}|\b{SPEED}\b",
        "ankle foot joint shaft output angle position pos theta encoder flexion winkel hoek"
        " measured meas name",
    ),
}
"""By column. The first that fits is the guess."""
LEVELS = ("sync", "trigger")  # columns of volts, whose unit nobody states
TORQUES = ("torque", "torque_m")
COUNTS = ("", "dimensionless", "count")  # what may be of any quantity measures nothing, or this
JOINTS = ("ankle", "knee", "hip")
FEWEST_READINGS = 100  # that show how a channel moves
LARGEST_READING = 1e30  # a number beyond it is no reading
SPRING = 0.9  # correlation with an angle: a fifth of the torque's power may be damping or friction
FALLING = -0.5  # correlation below which a torque falls as the angle rises
ONE_SINE = 0.9  # of an angle's power in one line, whose sides rests and ramps fill
LINE_WIDTH = 3  # lines at each side of it
TURN_UNITS = (2 * np.pi, 360.0, *2.0 ** np.arange(10, 25))  # ranges at which encoders wrap

# of opensourceleg's logger: `knee[DephyActpack]:output_position`; or `knee.output_position`
ATTRIBUTE = re.compile(
    r"(?P<part>\w+)(?:\[(?P<driver>[\w ]+)\]:|\.(?=(?:motor|output|joint)_position))"
    r"(?P<attribute>\w+)"
)
ATTRIBUTE_UNITS = {
    "position": "rad",
    "velocity": "rad/s",
    "torque": "N*m",
    "current": "mA",
    "voltage": "mV",
    "temperature": "degC",
}
"""Units of the attributes of its actuators, by the last word, as its documentation says."""


@dataclass(frozen=True)
class Guess:
    """A guess at what a channel is, and why.

    Attributes
    ----------
    column
        Canonical column; empty if nothing tells one.
    is_sure
        Whether no other channel is like the column, and the name leaves no doubt.
    why
        The evidence, in words.
    sign
        Of the channel in the source file.
    is_no_signal
        Whether it stands still, is noise, or is computed from another one.
    wraps_at
        Range after which it wraps; 0 if it does not.
    formula
        By which a torque was computed, where no measured one is beside it; else empty.
    """

    column: str = ""
    is_sure: bool = False
    why: str = ""
    sign: int = 1
    is_no_signal: bool = False
    wraps_at: float = 0.0
    formula: str = ""


def parted_name(name: str) -> str:
    """The words of a name in small letters: `JointAngle_deg` is `joint angle deg`."""
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name)
    return " ".join(re.findall(r"[a-z]+|\d+", parted.casefold()))


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


def with_known_unit(channel: RecordedChannel) -> RecordedChannel:
    """The channel with the unit that the library of its logger documents, as a likely one."""
    attribute = ATTRIBUTE.search(name_of(channel))
    if attribute is None or channel.unit:
        return channel
    unit = ATTRIBUTE_UNITS.get(attribute["attribute"].rpartition("_")[2], "")
    known = readings(channel)
    if attribute["driver"] is None and known.size and np.ptp(known) > 2 * np.pi:
        return channel  # of another logger, and as of degrees
    return replace(channel, likely_unit=unit or channel.likely_unit)


def likely_column(channel: RecordedChannel) -> str:
    """The canonical column that a channel may be; empty if name and unit tell none.

    A stated or likely unit must fit the column. If the name tells nothing, the unit's quantity is
    the guess.
    """
    words = words_of(channel)
    stated = normalised(channel.unit or channel.likely_unit)
    measured = (base_units(stated) or (1.0, ""))[1]
    for column, known in WORDS.items():
        is_level = column in LEVELS
        if not is_level and re.search(NO_SIGNAL, words):
            return ""
        fits = is_level or measured in (*COUNTS, dimension(COLUMNS[column]))
        is_unwanted = known.unwanted and re.search(known.unwanted, words)
        if fits and re.search(known.wanted, words) and not is_unwanted:
            return column
    by_quantity = {
        dimension("rad"): "theta",
        dimension("N*m"): "torque",
        dimension("A"): "current",
    }
    column = by_quantity.get(measured, "")
    tells_other = (
        rf"{COMMAND}|\b(ground|battery|supply|imu|roll|pitch|yaw|phase|current|{ANGLE}|{SPEED}"
        rf"|{EFFORT})\b"
    )
    if column != "current":
        tells_other = f"{tells_other}|{MOTOR}"
    return "" if re.search(tells_other, words) else column


def quantity_of(channel: Channel | RecordedChannel) -> Quantity | None:
    """What a channel may be by its unit, or else by its name."""
    unit = base_units(normalised(channel.unit or channel.likely_unit))
    words = parted_name(channel.name or " ".join(channel.address.values()))
    by_unit = {dimension("rad"): "angle", dimension("rad/s"): "speed", dimension("A"): "current"}
    quantity = by_unit.get(unit[1]) if unit is not None else None
    if unit is None or unit[1] in COUNTS:
        by_name = (each for each, of in QUANTITY_WORDS.items() if re.search(rf"\b{of}\b", words))
        quantity = next(by_name, None)
    is_command = quantity == "angle" and re.search(COMMAND, words)
    return "command" if is_command else cast(Quantity | None, quantity)


def readings(channel: RecordedChannel) -> Array:
    """The readings (n,) that are numbers of a sensor, in the unit of the channel; none where they
    were not read."""
    if channel.numbers is None:
        return np.empty(0)
    return channel.numbers[np.abs(channel.numbers) < LARGEST_READING]


def wrapping_range(channel: RecordedChannel) -> float:
    """The range, a turn or a power of two, at which a channel wraps; 0 if it does not."""
    known = readings(channel)
    if not known.size:
        return 0.0
    steps = np.abs(np.diff(known))
    span = float(np.ptp(known))
    leaps = steps[steps > 0.5 * span]
    if not 0 < leaps.size < 0.2 * steps.size:
        return 0.0
    for at in TURN_UNITS:
        if span <= at and (np.abs(leaps / at - 1) < 0.2).all():
            return float(at)
    return 0.0


def gone_on(channel: RecordedChannel, at: float) -> RecordedChannel:
    """The channel, unwrapped."""
    if not at:
        return channel
    return replace(channel, numbers=np.unwrap(readings(channel), period=at))


def why_no_signal(channel: RecordedChannel) -> str:
    """Why a channel is no signal, in words; empty if it may be one. Of few readings nothing is
    said."""
    if re.search(NO_SIGNAL, words_of(channel)) and likely_column(channel) not in LEVELS:
        return "a temperature, voltage or the like, by its name"
    known = readings(channel)
    if known.size < FEWEST_READINGS:
        return ""
    if not varies(known):
        return "it does not move"
    about = (known - known.mean()) / np.ptp(known)
    tells_next = about[1:] @ about[:-1] > 0.2 * (about @ about)
    is_level = np.unique(known).size == 2
    return "" if tells_next or is_level else NOISE


def is_held(channel: RecordedChannel) -> bool:
    """Whether readings that are noise lie about a level far from zero, as of a current that is
    held."""
    known = readings(channel)
    return bool(abs(known.mean()) > HELD_LEVEL * known.std())


def made_of_current(channel: RecordedChannel, currents: Iterable[RecordedChannel]) -> str:
    """Name the current to which a torque is proportional, so that it was not measured; empty if
    none."""
    for current in currents:
        if channel.numbers is None or current.numbers is None:
            continue
        factor = factor_of(channel.numbers, current.numbers)
        if factor is not None:
            name = json.dumps(list(current.address.values())[-1])
            return (
                f"{name} times {factor:.4g}, to within rounding: computed from the current, no"
                " measured torque"
            )
    return ""


def made_of_others(channel: RecordedChannel, others: Sequence[RecordedChannel]) -> str:
    """Name the signals of which a torque was computed; empty if none."""
    torque = channel.numbers
    if torque is None:
        return ""
    signals: list[Signal] = []
    for other in others:
        quantity = quantity_of(other)
        values = other.numbers
        if quantity is None or values is None or other.group != channel.group:
            continue
        if values.shape == torque.shape:
            signals.append(Signal(name_of(other), quantity, values))
    found = computed_from(torque, signals)
    return f"it follows exactly from {found}: computed, no measured torque" if found else ""


def copied_from(channel: RecordedChannel, others: Iterable[RecordedChannel]) -> str:
    """Name the channel of which another one is every second, fifth, ... reading; empty if none."""
    own = channel.numbers
    if own is None:
        return ""
    known = np.isfinite(own)
    for other in others:
        whole = other.numbers
        if other is channel or whole is None or whole.shape != own.shape:
            continue
        has_more = np.count_nonzero(np.isfinite(whole)) > known.sum() >= FEWEST_READINGS
        if has_more and np.array_equal(own[known], whole[known]):
            name = json.dumps(list(other.address.values())[-1])
            return f"some readings of {name}, which has more"
    return ""


def named_joint(channels: Iterable[RecordedChannel]) -> set[str]:
    """The joint in the names of channels, if they name only one."""
    words: set[str] = set()
    for channel in channels:
        words.update(parted_name(name_of(channel)).split())
    joints = words & set(JOINTS)
    return joints if len(joints) == 1 else set()


def guessed_columns(channels: Sequence[RecordedChannel]) -> list[Guess]:
    """Guess what each channel of a log may be, the same for every recorder.

    What does not move, is noise, or a torque computed from a current is no signal.
    """
    columns = with_output_as_joint(channels, [likely_column(channel) for channel in channels])
    wraps = [wrapping_range(channel) for channel in channels]
    channels = [gone_on(channel, at) for channel, at in zip(channels, wraps, strict=True)]
    currents = [one for one, column in zip(channels, columns, strict=True) if column == "current"]
    reasons: list[str] = []
    for channel, column in zip(channels, columns, strict=True):
        reason = why_no_signal(channel)
        if reason == NOISE and column in HELD_COLUMNS and is_held(channel):
            reason = ""
        if not reason and column in TORQUES:
            reason = made_of_current(channel, currents)
        if not reason and column:
            alike = [one for one, other in zip(channels, columns, strict=True) if other == column]
            reason = copied_from(channel, alike)
        reasons.append(reason)
    computed = [
        made_of_others(channel, channels) if column in TORQUES and not reason else ""
        for channel, column, reason in zip(channels, columns, reasons, strict=True)
    ]
    for place, formula in enumerate(computed):
        others = [k for k, column in enumerate(columns) if column == columns[place]]
        if formula and any(not reasons[k] and not computed[k] for k in others):
            reasons[place] = formula
    counts = Counter(column for column, reason in zip(columns, reasons, strict=True) if not reason)
    joint = named_joint(channels)
    guesses: list[Guess] = []
    for channel, column, reason, formula, at in zip(
        channels, columns, reasons, computed, wraps, strict=True
    ):
        if reason:
            guesses.append(Guess(why=reason, is_no_signal=True))
            continue
        words = set(words_of(channel).split())
        known = set(WORDS[column].certain.split()) | joint if column else set()
        is_certain = bool(words) and words <= known
        guesses.append(
            Guess(
                column,
                is_sure=is_certain and counts[column] == 1,
                why="guessed from its name" if is_certain else "",
                wraps_at=at,
                formula=formula,
            )
        )
    guesses = as_actuator(channels, guesses)
    if any(guess.column == "theta" for guess in guesses):
        return with_spring(channels, guesses)
    return guesses


def with_output_as_joint(channels: Sequence[RecordedChannel], columns: list[str]) -> list[str]:
    """The columns, with the angle of an actuator's output as that of the joint where the motor's
    own angle is beside it, or no current and torque: the log is then of a joint that markers
    follow."""
    angles = [place for place, column in enumerate(columns) if column == "theta_m"]
    outputs = [place for place in angles if "output" in words_of(channels[place]).split()]
    if "theta" in columns or len(outputs) != 1:
        return columns
    if len(angles) < 2 and {"current", *TORQUES} & {*columns}:
        return columns
    return ["theta" if place in outputs else column for place, column in enumerate(columns)]


def as_actuator(channels: Sequence[RecordedChannel], guesses: list[Guess]) -> list[Guess]:
    """The guesses for an actuator alone, where no joint's angle is recorded: its torque is that at
    the actuator's output, and a speed beside a current and a torque is the actuator's, also where
    it stands, so that its speed is noise. One of which current and torque alone are sure is
    clamped."""
    columns = {guess.column for guess in guesses}
    if "theta" in columns:
        return guesses
    moves = bool(columns & {"theta_m", "omega_m"})
    if not moves and {"current", "torque"} <= columns:
        speeds = [
            place
            for place, channel in enumerate(channels)
            if not guesses[place].column
            and re.search(rf"\b{SPEED}\b", words_of(channel))
            and not re.search(COMMAND, words_of(channel))
        ]
        if len(speeds) == 1:
            moves = True
            guesses[speeds[0]] = replace(
                guesses[speeds[0]],
                column="omega_m",
                is_sure=True,
                is_no_signal=False,
                why="a guess: no angle is beside it",
            )
    sure = {guess.column for guess in guesses if guess.is_sure}
    if not moves and not {"current", "torque"} <= sure:
        return guesses
    return [
        replace(guess, column="torque_m") if guess.column == "torque" else guess
        for guess in guesses
    ]


def with_spring(channels: Sequence[RecordedChannel], guesses: list[Guess]) -> list[Guess]:
    """The guesses, confirmed if exactly one torque follows one angle like a spring. A torque that
    falls as the angle rises gets the other sign, because a joint resists."""
    angles = places_of(guesses, "theta")
    torques = places_of(guesses, "torque")
    springs: list[tuple[int, int, float]] = []
    for n in angles:
        for m in torques:
            r = correlation(channels[n], channels[m])
            if abs(r) > SPRING or (guesses[n].is_sure and guesses[m].is_sure):
                springs.append((n, m, r))
    if len(springs) != 1:
        return guesses
    n, m, r = springs[0]
    for place, other in ((n, m), (m, n)):
        if not guesses[place].is_sure:
            name = json.dumps(name_of(channels[other]))
            guesses[place] = replace(
                guesses[place],
                is_sure=True,
                why=f"a guess: as a spring with {name}, r = {abs(r):.3f}",
            )
    if r < FALLING:
        why = f"{guesses[m].why}: it falls as the angle rises"
        guesses[m] = replace(guesses[m], sign=-1, why=why)
    return guesses


def places_of(guesses: Sequence[Guess], column: str) -> list[int]:
    """The channels that may be a column; if one is sure, that one."""
    alike = [place for place, guess in enumerate(guesses) if guess.column == column]
    sure = [place for place in alike if guesses[place].is_sure]
    return sure or alike


def correlation(theta: RecordedChannel, torque: RecordedChannel) -> float:
    """Correlation of the readings of two channels, by their times if they have any; 0 if they
    cannot be compared."""
    if torque.numbers is None or theta.numbers is None:
        return 0.0
    x = np.nan_to_num(theta.numbers, posinf=0.0, neginf=0.0)
    y = np.nan_to_num(torque.numbers, posinf=0.0, neginf=0.0)
    if theta.times is not None and torque.times is not None:
        x = np.interp(torque.times, theta.times, x)
    if len(x) != len(y) or len(x) <= FEWEST_READINGS or not (varies(x) and varies(y)):
        return 0.0
    return float(np.corrcoef(x, y)[0, 1])


def turns_slowly(angle: RecordedChannel, clock: RecordedChannel) -> bool:
    """Whether an angle goes to and fro at one speed or in one sine, and turns less often than every
    two seconds: it tells K, and not B and I."""
    known = readings(angle)
    if clock.numbers is None or known.size < FEWEST_READINGS:
        return False
    second = (base_units(normalised(clock.unit or clock.likely_unit)) or (0.0, ""))[0]
    seconds = second * float(np.ptp(clock.numbers))
    power = np.abs(np.fft.rfft(known - known.mean())) ** 2
    cycles = int(np.argmax(power))
    in_one_line = power[max(cycles - LINE_WIDTH, 0) : cycles + LINE_WIDTH + 1].sum()
    if in_one_line > ONE_SINE * power.sum():
        return 1 <= cycles < seconds / 4
    at = np.linspace(0, known.size - 1, 150)
    speed = np.diff(np.interp(at, np.arange(known.size), known))
    usual = usual_size(speed)
    share_at_one_speed = float(np.mean(np.abs(np.abs(speed) - usual) < 0.25 * usual))
    turns = int(np.count_nonzero(np.diff(np.sign(speed))))
    return share_at_one_speed > 0.8 and 2 <= turns < seconds / 2
