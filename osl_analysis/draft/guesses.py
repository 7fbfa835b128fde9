"""What each channel of a log is taken for. A guess is shown as one, and what leaves a doubt is
asked."""

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.draft.likelihood import (
    evidence_of,
    name_of,
    parted_name,
    probabilities,
    with_context,
)
from osl_analysis.draft.overview import RecordedChannel
from osl_analysis.ingest.computed_torque import TORQUES, quantity_of
from osl_analysis.measured import Signal, computed_from, factor_of, usual_size, varies

NOISE = "nothing but noise"
HELD_COLUMNS = ("current", "torque", "torque_m")  # which stand while an actuator is clamped
HELD_LEVEL = 5.0  # standard deviations of the noise
SURE = 0.8  # probability from which a channel is taken for a column
DOUBTFUL = 0.2  # probability from which another channel makes it a question
JOINTS = ("ankle", "knee", "hip")
FEWEST_READINGS = 100  # that show how a channel moves
SPRING = 0.9  # correlation with an angle: a fifth of the torque's power may be damping or friction
FALLING = -0.5  # correlation below which a torque falls as the angle rises
TURN_UNITS = (2 * np.pi, 360.0, *2.0 ** np.arange(10, 25))  # ranges at which encoders wrap


@dataclass(frozen=True)
class Guess:
    """A guess at what a channel is, and why.

    Attributes
    ----------
    column
        Canonical column; empty if nothing tells one.
    is_sure
        Whether no other channel is like the column, and the evidence leaves no doubt.
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


def guessed_columns(channels: Sequence[RecordedChannel]) -> list[Guess]:
    """Guess what each channel of a log is, the same for every recorder."""
    wraps = [wrapping_range(channel) for channel in channels]
    channels = [gone_on(channel, at) for channel, at in zip(channels, wraps, strict=True)]
    guesses = guesses_from(channels, evidence_in_log(channels))
    return [replace(guess, wraps_at=at) for guess, at in zip(guesses, wraps, strict=True)]


def guesses_from(channels: Sequence[RecordedChannel], evidence: Sequence[set[str]]) -> list[Guess]:
    """Guess what each channel of a log is by the evidence for its columns."""
    likely = [
        probabilities(channel, known) for channel, known in zip(channels, evidence, strict=True)
    ]
    columns = [max(each, key=lambda column: each[column], default="") for each in likely]

    left_out = [
        why_no_signal(channel, columns[place], channels) for place, channel in enumerate(channels)
    ]
    formulas = [
        formula_of(channel, channels)
        if columns[place] in TORQUES and likely[place][columns[place]] > DOUBTFUL
        else ""
        for place, channel in enumerate(channels)
    ]
    has_measured = any(
        column in TORQUES and each[column] > DOUBTFUL and not formula and not why
        for column, each, formula, why in zip(columns, likely, formulas, left_out, strict=True)
    )
    left_out = [
        why or (formula if has_measured else "")
        for why, formula in zip(left_out, formulas, strict=True)
    ]
    for each, why in zip(likely, left_out, strict=True):
        if why:
            each.clear()

    spring = the_spring(channels, likely)
    if spring is not None and spring.is_clear:
        for place in spring.places:
            likely[place] = probabilities(channels[place], {*evidence[place], "spring"})
    guesses: list[Guess] = []
    for place, channel in enumerate(channels):
        is_confirmed = spring is not None and spring.is_clear and place in spring.places
        guess = guess_of(place, likely, left_out[place], is_confirmed)
        guesses.append(replace(guess, formula=formulas[place]))
    return guesses if spring is None else with_spring(channels, guesses, spring)


def evidence_in_log(channels: Sequence[RecordedChannel]) -> list[set[str]]:
    """What speaks for and against columns, for each channel of a log."""
    return with_context([evidence_of(channel) for channel in channels])


def guess_of(
    place: int, likely: Sequence[dict[str, float]], why_not: str, is_confirmed: bool
) -> Guess:
    """The likeliest column of a channel. It is sure if the channel leaves no doubt, and no other
    one may be the same column, or it alone is `is_confirmed` as one of a spring."""
    if why_not:
        return Guess(why=why_not, is_no_signal=True)
    own = likely[place]
    column = max(own, key=lambda name: own[name], default="")
    if not column or own[column] < DOUBTFUL:
        return Guess()
    others = [each.get(column, 0.0) for k, each in enumerate(likely) if k != place]
    is_alone = is_confirmed or max(others, default=0.0) < DOUBTFUL
    is_sure = own[column] >= SURE and is_alone
    return Guess(column, is_sure, "guessed from its name" if is_sure else "")


def why_no_signal(
    channel: RecordedChannel, column: str, channels: Sequence[RecordedChannel]
) -> str:
    """Why a channel is no signal, in words; empty if it may be one. Of few readings nothing is
    said. A held current or torque may be noise, and so may the speed of an actuator that stands."""
    known = channel.readings
    if known.size < FEWEST_READINGS:
        return ""
    if not varies(known):
        return "it does not move"
    about = (known - known.mean()) / np.ptp(known)
    tells_next = about[1:] @ about[:-1] > 0.2 * (about @ about)
    is_held = column in HELD_COLUMNS and abs(known.mean()) > HELD_LEVEL * known.std()
    if not tells_next and not is_held and column != "omega_m" and np.unique(known).size > 2:
        return NOISE
    return copied_from(channel, channels)


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
        if np.count_nonzero(np.isfinite(whole)) > known.sum():
            if np.array_equal(own[known], whole[known]):
                return f"some readings of {json.dumps(name_of(other))}, which has more"
    return ""


def formula_of(torque: RecordedChannel, others: Sequence[RecordedChannel]) -> str:
    """Name the signals from which a torque was computed; empty of a measured one."""
    values = torque.numbers
    if values is None:
        return ""
    signals: list[Signal] = []
    for other in others:
        quantity = quantity_of(other)
        if quantity is None or other.numbers is None or other.group != torque.group:
            continue
        if quantity == "current" and factor_of(values, other.numbers) is not None:
            name = json.dumps(name_of(other))
            return f"it is proportional to {name}: computed, no measured torque"
        if other.numbers.shape == values.shape:
            signals.append(Signal(name_of(other), quantity, other.numbers))
    computed = computed_from(values, signals)
    return f"it follows exactly from {computed}: computed, no measured torque" if computed else ""


@dataclass(frozen=True)
class Spring:
    """The only angle and torque of a log that follow each other; their places among its channels,
    and their correlation."""

    angle: int
    torque: int
    r: float

    @property
    def places(self) -> tuple[int, int]:
        """Both places."""
        return self.angle, self.torque

    @property
    def is_clear(self) -> bool:
        """Whether they follow each other so closely that this confirms both."""
        return abs(self.r) > SPRING


def the_spring(
    channels: Sequence[RecordedChannel], likely: Sequence[dict[str, float]]
) -> Spring | None:
    """Find the one angle and the one torque that follow each other like a spring, or the only ones
    that there are."""
    pairs = [
        Spring(angle, torque, correlation(channels[angle], channels[torque]))
        for angle in places_of("theta", likely)
        for torque in places_of("torque", likely)
    ]
    springs = [pair for pair in pairs if pair.is_clear] or pairs
    return springs[0] if len(springs) == 1 else None


def places_of(column: str, likely: Sequence[dict[str, float]]) -> list[int]:
    """The channels that may be a column; if one alone is sure, that one."""
    alike = [place for place, each in enumerate(likely) if each.get(column, 0.0) > DOUBTFUL]
    sure = [place for place in alike if likely[place][column] >= SURE]
    return sure if len(sure) == 1 else alike


def with_spring(
    channels: Sequence[RecordedChannel], guesses: list[Guess], spring: Spring
) -> list[Guess]:
    """The guesses, with the reason of those that a spring confirms. A torque that falls as the
    angle rises gets the other sign, because a joint resists."""
    for place, other in (spring.places, spring.places[::-1]):
        if spring.is_clear and guesses[place].is_sure:
            name = json.dumps(name_of(channels[other]))
            why = f"a guess: as a spring with {name}, r = {abs(spring.r):.3f}"
            guesses[place] = replace(guesses[place], why=why)
    if spring.r < FALLING and guesses[spring.torque].column == "torque":
        why = f"{guesses[spring.torque].why}: it falls as the angle rises"
        guesses[spring.torque] = replace(guesses[spring.torque], sign=-1, why=why)
    return guesses


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


def wrapping_range(channel: RecordedChannel) -> float:
    """The range, a turn or a power of two, at which a channel wraps; 0 if it does not."""
    known = channel.readings
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
    if not at:
        return channel
    return replace(channel, numbers=np.unwrap(channel.readings, period=at))


def named_joint(channels: Iterable[RecordedChannel]) -> str:
    """The joint in the names of channels, if they name only one; else empty."""
    words = " ".join(parted_name(name_of(channel)) for channel in channels)
    joints = [joint for joint in JOINTS if re.search(rf"\b{joint}\b", words)]
    return joints[0] if len(joints) == 1 else ""


def turns_slowly(angle: RecordedChannel, clock: RecordedChannel) -> bool:
    """Whether an angle goes to and fro, and turns less often than every two seconds: it tells K, and
    not B and I."""
    known = angle.readings
    if clock.numbers is None or known.size < FEWEST_READINGS:
        return False
    seconds = clock.base[0] * float(np.ptp(clock.numbers))
    at = np.linspace(0, known.size - 1, 150)
    speed = np.diff(np.interp(at, np.arange(known.size), known))
    moves = np.sign(speed[np.abs(speed) > 0.25 * usual_size(speed)])
    turns = int(np.count_nonzero(np.diff(moves)))
    return 2 <= turns < seconds / 2
