"""What each channel of a log may be: how likely every column is, by its name, unit and readings."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.errors import listing, printable
from osl_analysis.ingest.likely_clock import is_like_clock, span_ratio, ticks
from osl_analysis.ingest.overview import RecordedChannel
from osl_analysis.measured import usual_size, varies
from osl_analysis.trial import COLUMNS, Array
from osl_analysis.units import base_units, dimension, is_clock, name_and_ending, normalised

MOTOR = r"\b(motor|actuator|act|gear|mot)\b"
COMMAND = r"\b(command|commanded|cmd|desired|des|ref|reference|target|setpoint|goal)\b"
ANGLE = r"(angle|position|pos|theta|encoder|winkel|hoek)"
SPEED = r"(velocity|vel|speed|omega|geschwindigkeit|snelheid)"
EFFORT = r"(torque|moment|tau|effort|drehmoment|koppel)"
CURRENT = r"\b(current|amps|iq|i q)\b"
OTHER = r"\b(temperature|temp|voltage|battery|supply|humidity|pressure|ground|imu|roll|pitch|yaw)\b"
JOINTS = ("ankle", "knee", "hip")

# What a word of a name adds to the log-odds of columns (natural logarithm). 3 is 20 to 1
WORDS: Sequence[tuple[str, Mapping[str, float]]] = (
    (rf"\b{ANGLE}\b", {"theta": 3, "theta_m": 1, "theta_command": -1}),
    (r"\boutput\b", {"theta_m": 2, "theta": -1, "torque_m": 1}),
    (r"\bjoint\b", {"theta": 2, "theta_m": -2}),
    (r"\b(ankle|knee|hip|joint|foot|flexion)\b", {"theta": 2, "torque": 1, "theta_m": -2, "torque_m": -2}),
    (rf"\b({EFFORT}|load ?cell|reaction)\b", {"torque": 5, "torque_m": 2, "theta": -6, "current": -4, "theta_m": -6, "omega_m": -6}),
    (rf"\b{SPEED}\b", {"omega_m": 3, "theta": -6, "theta_m": -6, "torque": -6, "theta_command": -6}),
    (CURRENT, {"current": 5, "theta": -6, "theta_m": -6, "torque": -6, "theta_command": -6}),
    (MOTOR, {"theta_m": 3, "torque_m": 3, "omega_m": 3, "theta": -3, "torque": -3, "current": 1}),
    (COMMAND, {"theta_command": 3, **dict.fromkeys(("theta", "torque", "current", "theta_m", "omega_m", "torque_m"), -8)}),
    (r"\b(sync|ttl)", {"sync": 9}),
    (r"\btrig(ger)?\b", {"trigger": 9}),
    (OTHER, dict.fromkeys(("theta", "torque", "current", "theta_m", "omega_m", "torque_m"), -9)),
    (r"\b(phase|stiffness|damping)\b", dict.fromkeys(("theta", "torque", "current"), -6)),
)
LEVELS = ("sync", "trigger")
UNIT_FITS = 2.0
IS_ITS_NAME = 4.0  # a channel that is called as the column
UNIT_CONTRADICTS = -9.0
NO_SIGNAL = -9.0
UNSAID = -2.0  # before anything is known of a channel
LEAST = 0.0  # log-odds from which a column is offered
SURE = 1.5  # log-odds, and lead over the next channel, from which it is taken
COUNTS = ("", "dimensionless", "count")
FEWEST_READINGS = 100
LARGEST_READING = 1e30
HELD_LEVEL = 5.0
SPRING = 0.9
FALLING = -0.5
ALIKE = 0.005
TURN_UNITS = (2 * np.pi, 360.0, *2.0 ** np.arange(10, 25))

ATTRIBUTE = re.compile(
    r"(?P<part>\w+)(?:\[(?P<driver>[\w ]+)\]:|\.(?=(?:motor|output|joint)_position))(?P<attribute>\w+)"
)
"""A variable of opensourceleg's logger: object, class and attribute."""
ATTRIBUTE_UNITS = {
    "position": "rad", "velocity": "rad/s", "torque": "N*m", "current": "mA", "voltage": "mV",
    "temperature": "degC",
}


@dataclass(frozen=True)
class Guess:
    """The likeliest column of a channel, and why."""

    column: str = ""
    is_sure: bool = False
    why: str = ""
    sign: int = 1
    is_no_signal: bool = False
    wraps_at: float = 0.0
    log_odds: float = 0.0


def parted_name(name: str) -> str:
    """The words of a name in small letters: `JointAngle_deg` is `joint angle deg`."""
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name)
    return " ".join(re.findall(r"[a-z]+|\d+", parted.casefold()))


def name_of(channel: RecordedChannel) -> str:
    """What a channel is called, without its topic, its group or its unit."""
    if "field" in channel.address:
        return channel.address["field"]
    return channel.key if "*" in channel.key else channel.name or channel.key


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
    known = readings(channel)
    if attribute["driver"] is None and known.size and np.ptp(known) > 2 * np.pi:
        return channel
    unit = ATTRIBUTE_UNITS.get(attribute["attribute"].rpartition("_")[2], "")
    return replace(channel, likely_unit=unit or channel.likely_unit)


def readings(channel: RecordedChannel) -> Array:
    """The readings (n,) that are numbers of a sensor."""
    if channel.numbers is None:
        return np.empty(0)
    return channel.numbers[np.abs(channel.numbers) < LARGEST_READING]


def log_odds_of(channel: RecordedChannel) -> dict[str, float]:
    """Log-odds of every column for a channel, against that it is none."""
    words = words_of(channel)
    odds = {column: UNSAID for column in COLUMNS if column != "time"}
    if words.replace(" ", "_") in odds:
        odds[words.replace(" ", "_")] += IS_ITS_NAME
    for pattern, points in WORDS:
        if re.search(pattern, words):
            for column, value in points.items():
                odds[column] += value
    measured = (base_units(normalised(channel.unit or channel.likely_unit)) or (1.0, ""))[1]
    if measured not in COUNTS:
        for column in odds:
            fits = measured == dimension(COLUMNS[column])
            odds[column] += UNIT_FITS if fits else UNIT_CONTRADICTS * (column not in LEVELS)
    return odds


def why_no_signal(channel: RecordedChannel, may_be_held: bool) -> str:
    """Why the readings of a channel are no signal; empty if they may be one."""
    if re.search(OTHER, words_of(channel)):
        return "a temperature, voltage or the like, by its name"
    known = readings(channel)
    if known.size < FEWEST_READINGS:
        return ""
    if not varies(known):
        return "it does not move"
    about = (known - known.mean()) / np.ptp(known)
    tells_next = about[1:] @ about[:-1] > 0.2 * (about @ about)
    is_held = may_be_held and abs(known.mean()) > HELD_LEVEL * known.std()
    return "" if tells_next or is_held or np.unique(known).size == 2 else "nothing but noise"


def guessed_columns(channels: Sequence[RecordedChannel]) -> list[Guess]:
    """Take each column for the channel of which it is most likely; it is sure if no other channel
    is nearly as likely."""
    wraps = [wrapping_range(channel) for channel in channels]
    channels = [gone_on(channel, at) for channel, at in zip(channels, wraps, strict=True)]
    odds = [log_odds_of(channel) for channel in channels]
    reasons = []
    for channel, of_channel in zip(channels, odds, strict=True):
        best = max(of_channel, key=lambda column: of_channel[column])
        reason = why_no_signal(channel, best in ("current", "torque", "torque_m"))
        if reason and best not in LEVELS:
            for column in of_channel:
                of_channel[column] += NO_SIGNAL
        reasons.append("" if best in LEVELS else reason)
    if not any(of_channel["theta"] > LEAST for of_channel in odds):
        outputs = [k for k, channel in enumerate(channels) if "output" in words_of(channel).split()
                   and odds[k]["theta_m"] > LEAST]
        if len(outputs) == 1 and any(one["theta_m"] > LEAST for k, one in enumerate(odds) if k not in outputs):
            odds[outputs[0]]["theta"] = odds[outputs[0]].pop("theta_m")
    if any(of_channel["theta"] > LEAST for of_channel in odds):
        for of_channel in odds:  # beside a joint's angle those of its motor are no need
            of_channel["omega_m"] = of_channel["torque_m"] = UNSAID
    guesses = []
    for number, (channel, of_channel) in enumerate(zip(channels, odds, strict=True)):
        column = max(of_channel, key=lambda one: of_channel[one])
        own = of_channel[column]
        if reasons[number] or own <= LEAST:
            guesses.append(Guess(why=reasons[number], is_no_signal=bool(reasons[number])))
            continue
        others = [other.get(column, UNSAID) for other in odds if other is not of_channel]
        lead = own - max(others, default=UNSAID)
        guesses.append(Guess(column, own >= SURE and lead >= SURE, f"guessed from its name", wraps_at=wraps[number], log_odds=own))
    return with_spring(channels, as_actuator(guesses))


def as_actuator(guesses: list[Guess]) -> list[Guess]:
    """The guesses for an actuator alone, where no joint's angle is recorded: its torque is that at
    its output."""
    columns = {guess.column for guess in guesses}
    sure = {guess.column for guess in guesses if guess.is_sure}
    if "theta" in columns or not (columns & {"theta_m", "omega_m"} or {"current", "torque"} <= sure):
        return guesses
    return [replace(guess, column="torque_m") if guess.column == "torque" else guess for guess in guesses]


def with_spring(channels: Sequence[RecordedChannel], guesses: list[Guess]) -> list[Guess]:
    """The guesses, confirmed if exactly one torque follows one angle like a spring. A torque that
    falls as the angle rises has the other sign."""
    springs = []
    for n in places_of(guesses, "theta"):
        for m in places_of(guesses, "torque"):
            r = correlation(channels[n], channels[m])
            if abs(r) > SPRING or (guesses[n].is_sure and guesses[m].is_sure):
                springs.append((n, m, r))
    if len(springs) != 1:
        return guesses
    n, m, r = springs[0]
    for place, other in ((n, m), (m, n)):
        if not guesses[place].is_sure:
            name = json.dumps(name_of(channels[other]))
            why = f"a guess: as a spring with {name}, r = {abs(r):.3f}"
            guesses[place] = replace(guesses[place], is_sure=True, why=why)
    if r < FALLING:
        why = f"{guesses[m].why}: it falls as the angle rises"
        guesses[m] = replace(guesses[m], sign=-1, why=why)
    return guesses


def places_of(guesses: Sequence[Guess], column: str) -> list[int]:
    """The channels that may be a column; if one is sure, that one."""
    alike = [place for place, guess in enumerate(guesses) if guess.column == column]
    return [place for place in alike if guesses[place].is_sure] or alike


def correlation(theta: RecordedChannel, torque: RecordedChannel) -> float:
    """Correlation of the readings of two channels, by their times if they have any."""
    if torque.numbers is None or theta.numbers is None:
        return 0.0
    x = np.nan_to_num(theta.numbers, posinf=0.0, neginf=0.0)
    y = np.nan_to_num(torque.numbers, posinf=0.0, neginf=0.0)
    if theta.times is not None and torque.times is not None:
        x = np.interp(torque.times, theta.times, x)
    if len(x) != len(y) or len(x) <= FEWEST_READINGS or not (varies(x) and varies(y)):
        return 0.0
    return float(np.corrcoef(x, y)[0, 1])


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
    fits = (at for at in TURN_UNITS if span <= at and (np.abs(leaps / at - 1) < 0.2).all())
    return float(next(fits, 0.0))


def gone_on(channel: RecordedChannel, at: float) -> RecordedChannel:
    """The channel, unwrapped."""
    return replace(channel, numbers=np.unwrap(readings(channel), period=at)) if at else channel


def named_joint(channels: Iterable[RecordedChannel]) -> set[str]:
    """The joint in the names of channels, if they name only one."""
    words = {word for channel in channels for word in parted_name(name_of(channel)).split()}
    joints = words & set(JOINTS)
    return joints if len(joints) == 1 else set()


def turns_slowly(angle: RecordedChannel, clock: RecordedChannel) -> bool:
    """Whether an angle goes to and fro, and turns less often than every two seconds."""
    known = readings(angle)
    if clock.numbers is None or known.size < FEWEST_READINGS:
        return False
    second = (base_units(normalised(clock.unit or clock.likely_unit)) or (0.0, ""))[0]
    seconds = second * float(np.ptp(clock.numbers))
    at = np.linspace(0, known.size - 1, 150)
    speed = np.diff(np.interp(at, np.arange(known.size), known))
    moves = np.sign(speed[np.abs(speed) > 0.25 * usual_size(speed)])
    turns = int(np.count_nonzero(np.diff(moves)))
    return 2 <= turns < seconds / 2


def clock_among(channels: Sequence[RecordedChannel], stamps: Sequence[str]) -> tuple[RecordedChannel | None, list[str]]:
    """Choose the clock of a table by name and readings; questions if several contradict each
    other."""
    likely: dict[float, list[RecordedChannel]] = {}
    for channel in channels:
        known = readings(channel)
        rises = known.size > 1 and float(np.mean(np.diff(known) >= 0)) > 0.9
        odds = 3.0 * (channel.key in stamps) + 3.0 * is_clock(channel.name) + 2.0 * is_like_clock(channel.name)
        odds += 4.0 * ticks(known, channel.unit)
        if rises and odds > 0 and np.ptp(known) > 0:
            likely.setdefault(odds, []).append(channel)
    if not likely:
        return None, []
    ranked = [channel for odds in sorted(likely, reverse=True) for channel in likely[odds]]
    best = ranked[0]
    span = float(np.ptp(readings(best)))
    others = [one for one in likely[max(likely)] if one is not best]
    apart = [one for one in others if abs(span_ratio(float(np.ptp(readings(one))), span, ()) - 1) > ALIKE]
    names = listing([printable(one.key) for one in (best, *(apart or others))], 6)
    if apart:
        return None, [f"{names} may be the clock, and they contradict each other; name the one by which the signals were sampled"]
    if others:
        return best, [f"{names} may be the clock, to be checked; {printable(best.key)} is taken"]
    if max(likely) <= 4.0:
        return best, [f"time is a guess: {printable(best.key)} rises evenly"]
    return best, []
