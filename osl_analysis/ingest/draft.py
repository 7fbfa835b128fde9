"""Drafts of source files, of the section `walking`, and of a sample sheet, from files and their
names. Texts from files are quoted as JSON, which is valid YAML. What files do not tell is left to
the user."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from osl_analysis.ingest.captures import is_labelled
from osl_analysis.ingest.overview import Overview, RecordedChannel
from osl_analysis.ingest.raw_files import FORMATS
from osl_analysis.ingest.source import NAME_OF_TIME, UNKNOWN, open_places
from osl_analysis.signals import runs
from osl_analysis.trial import COLUMNS, Array, factor_of, usual_size, varies
from osl_analysis.units import (
    GON,
    base_units,
    dimension,
    is_unit,
    name_and_ending,
    normalised,
)
from osl_analysis.yaml_settings import read_mapping

MOTOR = r"\b(motor|actuator|act|output|gear|mot)\b"
COMMAND = r"\b(command|commanded|cmd|desired|des|ref|reference|target|setpoint|goal)\b"
ANGLE = r"(angle|position|pos|theta|encoder|winkel|hoek)"
SPEED = r"(velocity|vel|speed|omega|geschwindigkeit|snelheid)"
EFFORT = r"(torque|moment|tau|effort|drehmoment|koppel)"
PATTERNS = {
    "sync": (r"\b(sync|ttl)", "", "sync"),
    "trigger": (r"\btrig(ger)?\b", "", "trigger trig"),
    "theta_command": (COMMAND, rf"\b({EFFORT}|{SPEED}|current|stiffness|damping)\b", ""),
    "theta_m": (
        rf"{MOTOR}.*\b{ANGLE}\b|\b{ANGLE} (m\b|{MOTOR})",
        COMMAND,
        "actuator motor output angle position pos theta m encoder measured meas",
    ),
    "omega_m": (rf"{MOTOR}.*\b{SPEED}\b|\bomega m\b", COMMAND, ""),
    "torque_m": (rf"{MOTOR}.*\b{EFFORT}\b|\b{EFFORT} m\b", COMMAND, ""),
    "current": (
        r"\b(current|amps|iq|i q)\b",
        COMMAND,
        "motor actuator current iq i q amps measured meas",
    ),
    "torque": (
        rf"\b({EFFORT}|load ?cell)\b",
        rf"{COMMAND}|{MOTOR}|ground",
        (
            "ankle foot joint torque moment tau load cell loadcell reaction mz drehmoment koppel"
            " measured meas sensor"
        ),
    ),
    "theta": (
        rf"\b({ANGLE}|ankle|knee|hip|joint)\b",
        rf"{COMMAND}|{MOTOR}|\b{SPEED}\b",
        (
            "ankle foot joint shaft angle position pos theta encoder flexion winkel hoek measured"
            " meas name"
        ),
    ),
}
"""By column: what the words of a name contain, and what they do not; and the words of a name that
leave no doubt: `theta_d` may be a command, `knee_angle` another joint's (`named_joint`). The first
that fits is the guess."""


COUNTS = ("", "dimensionless", "count")  # what may be of any quantity measures nothing, or this


def likely_column(channel: RecordedChannel) -> str:
    """The canonical column that a channel may be; empty if name and unit tell none. A stated or
    likely unit must fit the column. If the name tells nothing, the unit's quantity is the guess."""
    words, stated = (
        parted_name(name_and_ending(name_of(channel))[0]),
        normalised(channel.unit or channel.likely_unit),
    )
    _, measured = base_units(stated) or (1.0, "")
    for column, (wanted, unwanted, _) in PATTERNS.items():
        fits = column in ("sync", "trigger") or measured in (*COUNTS, dimension(COLUMNS[column]))
        if fits and re.search(wanted, words) and not (unwanted and re.search(unwanted, words)):
            return column
    known = {dimension("rad"): "theta", dimension("N*m"): "torque", dimension("A"): "current"}.get(
        measured, ""
    )
    tell_too_little = (
        rf"\b(ground|battery|supply|imu|roll|pitch|yaw|phase|current|{ANGLE}|{SPEED}|{EFFORT})\b"
    )
    unwanted = f"{COMMAND}|{tell_too_little}" + f"|{MOTOR}" * (known != "current")
    return "" if re.search(unwanted, words) else known


def parted_name(name: str) -> str:
    """The words of a name in small letters: `JointAngle_deg` is `joint angle deg`."""
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name)
    return " ".join(re.findall(r"[a-z]+|\d+", parted.casefold()))


@np.errstate(all="ignore")  # what a damaged file holds may be of any size
def draft_source(
    overview: Overview, name: str, walking: bool = True, log: "DraftedLog | None" = None
) -> str:
    """A source file for the file `name`. Channels that are the only one like a canonical column,
    and whose unit is known, have its name. walking: with the section for captures as comments; log:
    what is guessed already."""
    lines = [
        f"format: {overview.format}",
        f"description: {json.dumps(f'Drafted from {name}; complete it.')}",
    ]
    lines += [f"{key}: {json.dumps(value)}" for key, value in overview.settings.items()]
    if not FORMATS[overview.format].is_capture:
        return "\n".join([*lines, *log_lines(overview, log or drafted_log(overview))]) + "\n"
    # all markers; analog channels and model outputs as comments, for the user to name; so is a
    # walking section
    labels = [json.dumps(c.address["label"]) for c in overview.channels if c.kind == "marker"]
    lines += ["markers: all", f"# or some: markers: [{', '.join(dict.fromkeys(labels))}]"]
    for key, kinds in (("analogs", ("analog", "device")), ("outputs", ("model output",))):
        channels = [c for c in overview.channels if c.kind in kinds]
        pulses = pulse_channels(overview) if key == "analogs" else {}
        lines += [f"{key}:" if pulses else f"# {key}:"] * bool(channels)
        lines += [
            channel_line(0, one, Guess(column, True, "guessed from its name"))
            for column, one in pulses.items()
        ]
        others = [(n, one) for n, one in enumerate(channels, start=1) if one not in pulses.values()]
        lines += [f"# {channel_line(n, one, Guess())}" for n, one in others]
    return (
        "\n".join(
            [*lines, *(f"# {line}" for line in (draft_walking([overview]) if walking else []))]
        )
        + "\n"
    )


def pulse_channels(overview: Overview) -> dict[str, RecordedChannel]:
    """The analog channels of a capture that are called like `sync` and `trigger`, where one alone
    is."""
    channels = [c for c in overview.channels if c.kind == "analog"]
    alike = {
        column: [c for c in channels if likely_column(c) == column]
        for column in ("sync", "trigger")
    }
    return {column: found[0] for column, found in alike.items() if len(found) == 1}


def guessed_lines(draft: str) -> list[str]:
    """The lines of a drafted source file that give a channel the name of a column by a guess."""
    return [
        line.strip()
        for line in draft.splitlines()
        if re.search("# (a )?guess", line) and not line.startswith("#")
    ]


def to_be_edited(path: Path) -> list[str]:
    """The places of a drafted source file that are to be edited, with the column that no channel is
    like."""
    text, named = path.read_text(encoding="utf-8"), ("theta", "torque")
    content = read_mapping(path)
    places = [".".join(place).removeprefix("channels.") for place in open_places(content)]
    places += ["channels (none may be a signal: name them, as of the comments)"] * (
        content.get("channels", 0) is None
    )
    lacking = [one for one in named if not re.search(rf"\n  ({one}: |NAME.*# {one}\?)", text)]
    lacks = len(lacking) == 1 and bool(places)
    return places + [
        f"{one} (no channel is like it: name one, as of the comments)" for one in lacking * lacks
    ]


def log_lines(overview: Overview, log: "DraftedLog") -> Iterator[str]:
    """An entry for every channel but the clock. Topics without messages and empty arrays are left
    out. An entry has a column's name if only this channel is like the column and its name leaves no
    doubt. The user names the others, such as those that may be a command or another joint's angle.
    A channel that is no signal is a comment; so is one like no column, if another channel is like
    one; and, once angle and torque are known, also a doubtful one, and one without a stated
    unit."""
    yield from (f"# {text}" for text in overview.open)
    time: Any = overview.settings.get("time", {})
    if NAME_OF_TIME in time.values():
        yield (
            "# time: name its column and unit, or state the rate of the rows instead, as {rate: HZ}"
        )
    if log.clock and log.clock.likely_unit and not log.clock.unit:
        yield "# time: its unit is guessed from its name or from the rate of its readings: check it"
    todo = (
        "give each signal that you need its canonical name instead of NAME_n, state what is"
        f" {UNKNOWN}"
    )
    yield f"# {todo}, delete the rest"
    yield f"# canonical names: {', '.join(column for column in COLUMNS if column != 'time')}"
    yield "channels:"
    complete = {"theta", "torque"} <= {guess.column for guess in log.guesses if guess.sure}
    comment_others = any(guess.column for guess in log.guesses)
    for number, (channel, guess) in enumerate(zip(log.signals, log.guesses, strict=True), start=1):
        line, stated = (
            channel_line(number, channel, guess),
            is_unit(channel.unit or channel.likely_unit),
        )
        stands = guess.sure and (stated or guess.column in ("theta", "torque", "sync", "trigger"))
        is_needed = stands or (bool(guess.column) and not complete)
        yield f"# {line}" if guess.no_signal or (comment_others and not is_needed) else line


@dataclass(frozen=True)
class Guess:
    """A guess at what a channel is, and why."""

    column: str = ""  # canonical column; empty if nothing tells one
    sure: bool = False  # whether no other channel is like the column, and the name leaves no doubt
    said: str = ""  # the evidence, in words
    sign: int = 1  # `sign` of the channel in the source file
    no_signal: bool = False  # whether it stands still, is noise, or is computed from another
    wraps_at: float = 0.0  # range after which it wraps; 0 if it does not


class DraftedLog(NamedTuple):
    """The channels of a log that may be signals, what each may be, and its clock."""

    signals: list[RecordedChannel]
    guesses: list[Guess]
    clock: RecordedChannel | None


@np.errstate(all="ignore")
def drafted_log(overview: Overview) -> DraftedLog:
    time: Any = overview.settings.get("time", {})
    of_time = next(
        (time[key] for key in ("column", "variable", "field", "channel") if key in time), ""
    )
    listed = overview.channels if overview.drafted is None else overview.drafted
    clock = next((c for c in listed if of_time and of_time in c.address.values()), None)
    signals = [
        c
        for c in listed
        if c is not clock and ("topic" not in c.address or ("field" in c.address and c.count))
    ]
    return DraftedLog(signals, guessed_columns(signals), clock)


# fewest readings that show how a channel moves; largest valid reading
FEWEST_READINGS, LARGEST_READING = 100, 1e30


def name_of(channel: RecordedChannel) -> str:
    """What a channel is called, without its topic or, in TDMS, its group; a column of a matrix by
    its title."""
    if channel.key.endswith(")") and channel.name not in channel.key:
        return channel.name
    return " ".join(value for key, value in channel.address.items() if key != "topic").rpartition(
        "/"
    )[2]


def readings(channel: RecordedChannel) -> Array:
    """The readings (n,) that are numbers of a sensor, in the unit of the channel; none where they
    were not read."""
    return (
        np.empty(0)
        if channel.numbers is None
        else channel.numbers[np.abs(channel.numbers) < LARGEST_READING]
    )


def wraps_at(channel: RecordedChannel) -> float:
    """The range, a turn or a power of two, at which a channel wraps; 0 if it does not."""
    steps, span = (
        np.abs(np.diff(known := readings(channel))),
        float(np.ptp(known)) if known.size else 0.0,
    )
    leaps = steps[steps > 0.5 * span]
    for at in (
        (2 * np.pi, 360.0, *2.0 ** np.arange(10, 25)) if 0 < leaps.size < 0.2 * steps.size else ()
    ):
        if span <= at and (np.abs(leaps / at - 1) < 0.2).all():
            return float(at)
    return 0.0


def gone_on(channel: RecordedChannel, at: float) -> RecordedChannel:
    """The channel, unwrapped."""
    return replace(channel, numbers=np.unwrap(readings(channel), period=at)) if at else channel


def no_signal(channel: RecordedChannel) -> str:
    """Why a channel is no signal, in words; empty if it may be one. Of few readings nothing is
    said."""
    known = readings(channel)
    if known.size < FEWEST_READINGS:
        return ""
    if not varies(known):
        return "it does not move"
    about = (known - known.mean()) / np.ptp(known)
    # one reading of the next: their correlation
    tells_next = about[1:] @ about[:-1] > 0.2 * (about @ about)
    return "" if tells_next or np.unique(known).size == 2 else "it is noise"  # the other is a level


def named_joint(channels: Sequence[RecordedChannel]) -> set[str]:
    """The joint in the names of channels, if they name only one."""
    words = {word for one in channels for word in parted_name(name_of(one)).split()} & {
        "ankle",
        "knee",
        "hip",
    }
    return words if len(words) == 1 else set()


def guessed_columns(channels: Sequence[RecordedChannel]) -> list[Guess]:
    """What each channel of a log may be, the same for every recorder, by its name and unit
    (`likely_column`). What does not move, is noise, or a torque computed from a current is no
    signal."""
    named = [likely_column(one) for one in channels]
    currents = [one for one, column in zip(channels, named, strict=True) if column == "current"]
    pairs = [(one, wraps_at(one)) for one in channels]
    channels = [gone_on(*one) for one in pairs]
    without, guesses = list[str](), list[Guess]()
    for channel, column in zip(channels, named, strict=True):
        made = made_of(channel, currents * (column in ("torque", "torque_m")))
        without.append(no_signal(channel) or made)
    known = Counter(column for column, why in zip(named, without, strict=True) if not why)
    own = named_joint(channels)
    for (channel, at), column, why in zip(pairs, named, without, strict=True):
        words = parted_name(name_and_ending(name_of(channel))[0]).split()
        sure = bool(words and column) and {*words} <= {*PATTERNS[column][2].split(), *own}
        by_name = Guess(
            column, sure and known[column] == 1, "guessed from its name" * sure, wraps_at=at
        )
        guesses.append(Guess(said=why, no_signal=True) if why else by_name)
    columns = {guess.column for guess in guesses}
    if "theta" not in columns and columns & {"theta_m", "omega_m"}:  # an actuator alone
        return [
            replace(one, column="torque_m") if one.column == "torque" else one for one in guesses
        ]
    return with_spring(channels, guesses)


def with_spring(channels: Sequence[RecordedChannel], guesses: list[Guess]) -> list[Guess]:
    """The guesses, confirmed if exactly one torque follows one angle like a spring. A torque that
    falls as the angle rises gets the other sign, because a joint resists."""
    likely = {
        column: [
            n for n, one in enumerate(guesses) if one.column == column and (one.sure or not sure)
        ]
        for column, sure in (
            (name, any(g.sure and g.column == name for g in guesses))
            for name in ("theta", "torque")
        )
    }
    pairs = [
        (n, m, correlation(channels[n], channels[m]))
        for n in likely["theta"]
        for m in likely["torque"]
    ]
    # it follows from 0.9 on: a fifth of its power may be damping or friction
    springs = [
        (n, m, r) for n, m, r in pairs if abs(r) > 0.9 or (guesses[n].sure and guesses[m].sure)
    ]
    if len(springs) != 1:
        return guesses
    n, m, r = springs[0]
    for place, other in ((n, m), (m, n)):
        if not guesses[place].sure:
            said = (
                f"a guess: as a spring with {json.dumps(name_of(channels[other]))}, r ="
                f" {abs(r):.3f}"
            )
            guesses[place] = replace(guesses[place], sure=True, said=said)
    if r < -0.5:
        guesses[m] = replace(
            guesses[m], sign=-1, said=f"{guesses[m].said}: it falls as the angle rises"
        )
    return guesses


def correlation(theta: RecordedChannel, torque: RecordedChannel) -> float:
    """Correlation of the readings of two channels, by their times if they have any; 0 if they
    cannot be compared."""
    if torque.numbers is None or theta.numbers is None:
        return 0.0
    x, y = (np.nan_to_num(one, posinf=0.0, neginf=0.0) for one in (theta.numbers, torque.numbers))
    if theta.times is not None and torque.times is not None:
        x = np.interp(torque.times, theta.times, x)
    return (
        float(np.corrcoef(x, y)[0, 1])
        if len(x) == len(y) > FEWEST_READINGS and varies(x) and varies(y)
        else 0.0
    )


def turns_slowly(log: DraftedLog) -> bool:
    """Whether the angle of a log goes to and fro at one speed, and turns less often than every two
    seconds."""
    pairs, clock = zip(log.signals, log.guesses, strict=True), log.clock
    angles = [
        gone_on(one, guess.wraps_at)
        for one, guess in pairs
        if guess.sure and guess.column == "theta"
    ]
    known = readings(angles[0]) if angles else np.empty(0)
    if clock is None or clock.numbers is None or known.size < FEWEST_READINGS:
        return False
    speed = np.diff(np.interp(np.linspace(0, known.size - 1, 150), np.arange(known.size), known))
    at_one_speed = (
        np.mean(np.abs(np.abs(speed) - usual_size(speed)) < 0.25 * usual_size(speed)) > 0.8
    )
    factor, _ = base_units(normalised(clock.unit or clock.likely_unit)) or (0.0, "")
    turns = np.count_nonzero(np.diff(np.sign(speed)))
    return bool(at_one_speed and 2 <= turns < factor * np.ptp(clock.numbers) / 2)


def made_of(channel: RecordedChannel, currents: Sequence[RecordedChannel]) -> str:
    """A text that names the current to which a torque is proportional, so that it was not measured;
    empty if none."""
    for current in currents:
        none = np.empty(0)
        y, x = (none if one.numbers is None else one.numbers for one in (channel, current))
        if (factor := factor_of(y, x)) is not None:
            name = json.dumps(list(current.address.values())[-1])
            return (
                f"{name} times {factor:.4g}, to within rounding: computed from the current, no"
                " measured torque"
            )
    return ""


def channel_line(number: int, channel: RecordedChannel, guess: Guess) -> str:
    """One entry under `channels`, by what it may be, with the column's name where that is sure."""
    stated, is_guessed = (
        channel.unit or channel.likely_unit,
        bool(channel.likely_unit and not channel.unit),
    )
    is_known = (base_units(normalised(stated)) or (1.0, ""))[1] not in (
        COUNTS if guess.column else COUNTS[:1]
    )
    is_known &= stated.lower() not in GON
    unit = stated if is_known else "V" if guess.column in ("sync", "trigger") else UNKNOWN
    said = [f"{guess.column}?"] * (bool(guess.column) and not guess.sure)
    said += [f"{'left out: ' * guess.no_signal}{guess.said}"]
    said += [f"no known unit: {json.dumps(channel.unit)}"] * (
        bool(channel.unit) and unit == UNKNOWN
    )
    said += ["the unit is guessed: check it"] * is_guessed
    said += ["no unit is stated"] * (guess.sure and unit == UNKNOWN and not stated)
    fields: dict[str, Any] = {**channel.address, "unit": unit} | (
        {"sign": guess.sign} if guess.sign < 0 else {}
    )
    fields |= (
        {"wraps_at": guess.wraps_at} if guess.column.startswith("theta") and guess.wraps_at else {}
    )
    entry = ", ".join(
        f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in fields.items()
    )
    comment = f"  # {'; '.join(filter(None, said))}" if any(said) else ""
    return f"  {guess.column if guess.sure else f'NAME_{number}'}: {{{entry}}}{comment}"


SEGMENT_WORDS = {
    "platform": ("PLAT|HEXAPOD|STEWART", ""),
    "ankle_medial": (r"(?=.*((?<!SH)ANK|MAL)).*(MED|(^|_)M(_|MAL|$))", "MED|MMA|MMAL|TAM|AM|MM"),
    "ankle_lateral": ("(?<!SH)ANK|MAL", "LMA|LMAL|FAL|AL|LM"),
    "foot": (r"FOOT|SHOE|HEEL|CALC|TOE|META?\d", r"FCC|F[ML]\d?|FT\d|MT\d|MET|PM\d|HEE|CAL\d?|H"),
    "shank": (
        r"SHANK|SHIN|TIB|PYLON|(?<!UP)(?<!UPPER)(?<!UPPER_)LEG",
        r"SK\d|S\d|TTC|TTB?|TB\d|SHA|HF|FAX",
    ),
}
"""What the names of a segment's markers begin with, and their codes behind an R or L in Plug-in
Gait, OpenSim's models and Qualisys' (CAST). A marker called `ankle` and no more is the lateral one
in all of them."""


def segment_of(label: str) -> tuple[str, str]:
    """Side, R or L, and segment of `SEGMENT_WORDS` that a marker's name tells behind the subject's;
    empty for none."""
    name = re.sub(r"[^A-Z0-9]+", "_", label.rpartition(":")[2].upper()).strip("_")
    forms = re.findall(r"^(RIGHT|LEFT|R|L)_?(.+)$", name)
    forms += [(side, rest) for rest, side in re.findall(r"^(.+)_(RIGHT|LEFT|R|L)$", name)]
    for side, rest in [*forms, ("", name)]:
        for segment, (words, codes) in SEGMENT_WORDS.items():
            if re.search(rf"(^|_)({words})" if side else words, rest) or (
                side and re.fullmatch(codes, rest)
            ):
                return side[:1], segment
    return "", ""


def tracks_of(overview: Overview) -> dict[str, Array]:
    """Positions (frames, 3) [m], z up, of each marker of a capture that has a name and was seen."""
    order, signs = (
        ([0, 2, 1], [1, -1, 1]) if "axes" in overview.settings else ([0, 1, 2], [1, 1, 1])
    )
    found = {}
    for one in (
        one
        for one in overview.channels
        if one.kind == "marker" and is_labelled(one.address["label"])
    ):
        if one.count and one.numbers is not None:
            factor, _ = base_units(normalised(one.unit)) or (1e-3, "")
            found[one.address["label"]] = factor * one.numbers[:, order] * signs
    return found


def longest_way(track: Array) -> float:
    """The longest range of a track (frames, n) along an axis, without its outer 2 %; infinite if it
    was hardly seen."""
    seen = track[np.isfinite(track).all(axis=1)]
    ends = (
        np.quantile(seen, [0.02, 0.98], axis=0) if 2 * len(seen) > len(track) else [[0.0], [np.inf]]
    )
    return float(np.ptp(ends, axis=0).max())


def told_by_motion(overview: Overview) -> dict[str, str]:
    """The cells of the sheet that the motion in a capture tells; none where it tells no
    experiment."""
    tracks = tracks_of(overview)
    own = [track for label, track in tracks.items() if segment_of(label)[1] == "platform"]
    legs = any(segment_of(label)[1] in ("foot", "shank") for label in tracks)
    turns = any(  # a line between two markers
        np.inf
        > longest_way(line)
        > np.radians(1) * float(np.linalg.norm(np.nanmedian(line, axis=0)))
        for line in (first - second for first, second in combinations(own, 2))
    )
    steps = steps_on_plates(overview)
    if legs and not turns and all(longest_way(track) < 0.03 for track in tracks.values()):
        return {"experiment": "static"}
    if own and legs and 1 in steps:
        return {"experiment": "walking", "perturbed": str(turns).lower()}
    if own and turns and not legs and not any(steps):
        return {"experiment": "plate"}
    return {"experiment": "overground"} if legs and any(steps) and not own else {}


def steps_on_plates(overview: Overview) -> list[int]:
    """How often each plate was loaded for 0.3 s or more."""
    steps, markers = list[int](), [one for one in overview.channels if one.kind == "marker"]
    frames = max((len(one.numbers) for one in markers if one.numbers is not None), default=0)
    rate = max((one.rate or 0.0 for one in markers), default=0.0)
    for force in (
        c.numbers for c in overview.channels if c.kind == "plate" and c.numbers is not None
    ):
        loaded = runs(force - np.quantile(force, 0.02) > 100)  # [N]
        steps.append(
            sum((run.stop - run.start) * frames > 0.3 * rate * force.size for run in loaded)
        )
    return steps


def draft_walking(overviews: Sequence[Overview]) -> list[str]:
    """Lines of YAML: the section `walking` of a configuration by the captures of one laboratory.
    What neither names nor motion tell is UNKNOWN. None unless markers are named as a foot's or
    shank's."""
    labels = [
        one.address["label"]
        for overview in overviews
        for one in overview.channels
        if one.kind == "marker"
    ]
    told = {label: segment_of(label) for label in dict.fromkeys(labels)}
    # R before L
    side = max(
        (side for side, segment in told.values() if segment in ("foot", "shank")), default=""
    )
    of_leg = [(label, own) for label, (of, own) in told.items() if not side or of in ("", side)]
    clusters = {
        segment: [label for label, own in of_leg if own == segment] for segment in SEGMENT_WORDS
    }
    if not (clusters["foot"] or clusters["shank"]):
        return []
    plates = max(sum(channel.kind == "plate" for channel in one.channels) for one in overviews)
    plate = (
        "1  # the only one"
        if plates == 1
        else f"{UNKNOWN}  # of {plates} force plates in this file"
    )
    leg = {"R": "right", "L": "left", "": UNKNOWN}[side]
    lines = [
        "walking:  # a draft, from names and motion of markers: check every line",
        f"  side: {leg}  # the leg that steps on the platform"
        + ", a guess to be confirmed" * bool(side),
        f"  plate: {plate}",
        "  markers:",
        *(f"    {segment}: {markers_of(segment, found)}" for segment, found in clusters.items()),
    ]
    if not clusters["platform"]:
        lines.append(
            "# no platform: does a belt, a boot or the leg perturb (`walking.perturbed_by`)?"
        )
    return lines


def markers_of(segment: str, found: Sequence[str]) -> str:
    names, said = [json.dumps(name) for name in found], "named so" if found else "none is known"
    if not segment.startswith("ankle"):
        said += "; a cluster has 3 or more" * (len(names) < 3)
        return f"[{', '.join(names + [UNKNOWN] * (len(names) < 3))}]  # {said}"
    if len(names) == 1:
        return f"{names[0]}  # {said}"
    said = f"one of {', '.join(names)}" if names else "none is known: named in the static trial?"
    return f"{UNKNOWN}  # {said}"


WORDS_OF_EXPERIMENTS = {
    "torque_angle": r"\b(torque angle|quasi ?static)\b",
    "plate": r"\b(plate|unloaded)\b",
    "static": r"(?<!quasi )\b(static|standing|stand|calibration|calib)\b",
    "calibration": r"\b(calibration|calib)\b",
    "walking": (
        r"\b(walk|walking|cross|crossing|perturb|perturbed|perturbation|pert|unperturbed|unpert|gait)\b"
    ),
    "belt": r"\bbelt\b",
    "transmission": r"\b(transmission|drivetrain)\b",
    "actuator": r"\b(actuator|motor)\b",
    "impedance": r"\b(impedance|imp|stiffness|multisine|chirp|sines?)\b",
}
"""By experiment: words in a file's name. A name with words of several experiments tells none."""
UNNAMED = "ingest_only"  # the experiment of a trial whose name tells none


def trial_name(path: Path) -> str:
    """A name for the trial of a file: that of the file without its ending, with `_` for what a name
    may not have."""
    return (
        re.sub(r"[^A-Za-z0-9_.-]+", "_", path.stem if path.suffix else path.name).lstrip("_.-")[:90]
        or "trial"
    )


# file and name of the source file of a trial's log, and of its capture
Recordings = Mapping[str, tuple[Path, str]]


def draft_trials(
    recordings: Iterable[tuple[Path, str, bool]],
    moved: Mapping[Path, Mapping[str, str]] | None = None,
) -> list[tuple[dict[str, str], list[str]]]:
    """The trials that recordings are, by what the words of their names tell, or else the motion of
    markers, `moved` (`told_by_motion` of each file): the cells of each in a sheet, and what of it
    the user has to decide. recordings: file or folder of each, relative to the folder of all, the
    name of its source file, and whether it comes from motion capture. A log and a capture of the
    same name are one. Sorted by name. A stated stiffness tells an impedance trial, but for one who
    walks. `k1` states none: it is a number of a file."""
    several: dict[str, dict[str, tuple[Path, str]]] = {}
    for path, source, is_capture in sorted(recordings, key=lambda recorded: recorded[0].as_posix()):
        number, name, role = 1, trial_name(path), "mocap" if is_capture else "log"
        free = name
        while role in several.get(free, ()):
            number += 1
            free = f"{name}_{number}"
        several.setdefault(free, {})[role] = path, source
    return [draft_trial(name, files, moved or {}) for name, files in several.items()]


def draft_trial(
    name: str, files: Recordings, moved: Mapping[Path, Mapping[str, str]]
) -> tuple[dict[str, str], list[str]]:
    """The cells of one trial, and what the user has to decide."""
    path, role = next(iter(files.values()))[0], "mocap" if "mocap" in files else "log"
    said = path.stem if path.suffix else path.name
    words, numbers = parted_name(said.replace("_", " ")), stated_impedance(said)
    cells = {"trial": name, "experiment": UNNAMED}
    for column, (file, source) in files.items():
        cells |= {column: file.as_posix(), f"{column}_source": source}
    told = experiments_told(words, files, "K_d" in numbers)
    experiment = told[0] if len(told) == 1 else UNNAMED
    perturbed = perturbation_told(words)
    motion = moved.get(files[role][0], {})
    is_open = experiment == UNNAMED or (experiment == "walking" and not perturbed)
    if motion and is_open and (role == "mocap" or not told):
        by = "the motion of markers and plates" if role == "mocap" else "angle and torque"
        guessed = " and ".join(map(" ".join, motion.items()))
        if motion["experiment"] == "overground" and "log" in files:
            guessed += (
                "; if a belt, a boot or the leg perturbs: walking, with `walking.perturbed_by`"
            )
        return {**cells, **motion}, [f"to be confirmed, guessed from {by}: {guessed}"]
    if experiment == UNNAMED:
        one_of = ", ".join(possible_experiments(files)[::-1])
        asked = (
            f"may tell {' or '.join(told)}, write which"
            if told
            else f"tells none, write one of {one_of}"
        )
        return cells, [
            f"experiment: the name {asked}; it stands as {UNNAMED}, which is not analysed"
        ]
    if experiment == "calibration":
        remedy = "write calibration, and its known_K or known_I"
        said = (
            f"experiment: a calibration whose spring or inertia is not told stands as {UNNAMED}:"
            f" {remedy}"
        )
        return cells, [said]
    if is_open:
        remedy = "write walking, and true or false"
        return cells, [f"perturbed: the name does not tell; it stands as {UNNAMED}: {remedy}"]
    cells["experiment"] = experiment
    if experiment == "impedance":
        return impedance_cells(cells | numbers, said)
    return cells | ({"perturbed": perturbed} if experiment == "walking" else {}), []


def impedance_cells(cells: dict[str, str], said: str) -> tuple[dict[str, str], list[str]]:
    """The cells of an impedance trial with the controller that its name tells, and what it does not
    tell."""
    if controller := re.search(
        r"(?<![A-Za-z])(un|non[-_]?)?comp(?:ensated)?(?![A-Za-z])", said, re.IGNORECASE
    ):
        cells["controller"] = "uncompensated" if controller[1] else "compensated"
    asked = "the name does not tell; empty, nothing is compared with it"
    return cells, [f"{column}: {asked}" for column in ("K_d", "B_d") if column not in cells]


def perturbation_told(words: str) -> str:
    """Whether a name tells a perturbed crossing, `true` or `false`; empty if it does not say."""
    if re.search(r"\b(unperturbed|unpert|baseline|normal|level|free|no ?pert)\b", words):
        return "false"
    return "true" * bool(re.search(r"\b(perturb|perturbed|perturbation|pert)\b", words))


def stated_impedance(said: str) -> dict[str, str]:
    """K_d and B_d as a name states them, once each: `K300_B2.5`."""
    numbers = {}
    for column, letter, smallest in (("K_d", "K", 10.0), ("B_d", "B", 0.0)):
        behind = r"(?=$|[_\s-]|[.,](?!\d)|[BbKk]_?d?[_=-]?\d)"
        number = rf"(?<![A-Za-z]){letter}_?d?[_=-]?(\d+(?:\.\d+)?){behind}"
        found = set(re.findall(number, said, re.IGNORECASE))
        if len(found) == 1 and float(*found) >= smallest:
            (numbers[column],) = found
    return numbers


def possible_experiments(files: Recordings) -> list[str]:
    """What a trial of these files can be: a log alone is of a bench, a boot or a leg, a capture
    alone of a walkway."""
    wrong = {"static", "plate"} if "mocap" not in files else set()
    wrong |= (
        {*WORDS_OF_EXPERIMENTS} - {"static", "plate", "walking"} if "log" not in files else set()
    )
    return [name for name in WORDS_OF_EXPERIMENTS if name not in wrong]


def experiments_told(words: str, files: Recordings, states_K: bool) -> list[str]:
    """The experiments that a name tells by its words or a stiffness."""
    possible = possible_experiments(files)
    told = [known for known in possible if re.search(WORDS_OF_EXPERIMENTS[known], words)]
    return told + ["impedance"] * (
        states_K and "impedance" in possible and not {"walking", "impedance"} & {*told}
    )
