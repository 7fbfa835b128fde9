"""Drafts of source files, of the section `walking`, and of a sample sheet, from files and their names. Texts from
files are quoted as JSON, which is valid YAML. Nothing is taken as told that is not."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from osl_analysis.ingest.captures import is_labelled
from osl_analysis.ingest.overview import Overview, RecordedChannel
from osl_analysis.ingest.raw_files import FORMATS
from osl_analysis.ingest.source import NAME_OF_TIME, UNKNOWN
from osl_analysis.ingest.units import base_units, dimension, is_unit, normalised
from osl_analysis.measured import factor_of, rms, varies
from osl_analysis.signals import LowPass, runs
from osl_analysis.trial import COLUMNS, Array

COMPUTED = "computed from the current, no measured torque"
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
    "current": (r"\b(current|amps|iq|i q)\b", COMMAND, "motor actuator current iq i q amps measured meas"),
    "torque": (
        rf"\b({EFFORT}|load ?cell)\b",
        rf"{COMMAND}|{MOTOR}|ground",
        "ankle foot joint torque moment tau load cell loadcell measured meas sensor",
    ),
    "theta": (
        rf"\b({ANGLE}|ankle|knee|hip|joint)\b",
        rf"{COMMAND}|{MOTOR}|\b{SPEED}\b",
        "ankle foot joint angle position pos theta encoder measured meas name",
    ),
}
"""By column: what the words of a name contain, and what they do not; and the words of a name that leave no doubt:
`theta_d` may be a command, `knee_angle` is another joint's. The first that fits is the guess."""


def likely_column(channel: RecordedChannel) -> str:
    """The canonical column that a channel may be; empty where name and unit tell none. A stated or likely unit must be
    one of the column's; where the name tells nothing, what the unit measures is the guess."""
    words, (_, measured) = words_of(name_of(channel)), measure_of(channel)
    for column, (wanted, unwanted, _) in PATTERNS.items():
        fits = column in ("sync", "trigger") or not measured or measured == dimension(COLUMNS[column])
        if fits and re.search(wanted, words) and not (unwanted and re.search(unwanted, words)):
            return column
    known = {dimension("rad"): "theta", dimension("N*m"): "torque", dimension("A"): "current"}.get(measured, "")
    tell_too_little = rf"\b(ground|battery|supply|imu|roll|pitch|yaw|phase|current|{ANGLE}|{SPEED}|{EFFORT})\b"
    unwanted = f"{COMMAND}|{tell_too_little}" + f"|{MOTOR}" * (known != "current")
    return "" if re.search(unwanted, words) else known


def measure_of(channel: RecordedChannel) -> tuple[float, str]:
    """Factor of a channel's stated or likely unit to base units, and their product; empty where it has none."""
    return base_units(normalised(channel.unit or channel.likely_unit)) or (1.0, "")


def words_of(name: str) -> str:
    """The words of a name in small letters: `JointAngle_deg` is `joint angle deg`."""
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name)
    return " ".join(re.findall(r"[a-z]+|\d+", parted.casefold()))


def draft_source(overview: Overview, name: str, walking: bool = True) -> str:
    """A source file for the file `name`. Channels that are the only one like a canonical column, and whose unit is
    known, have its name; the user names the others. walking: with the section for captures as comments."""
    lines = [
        f"format: {overview.format}",
        f"description: {json.dumps(f'Drafted from {name}; complete it.')}",
        *(f"{key}: {json.dumps(value)}" for key, value in overview.settings.items()),
    ]
    if not FORMATS[overview.format].is_capture:
        return "\n".join([*lines, *log_lines(overview)]) + "\n"
    # all markers; analog channels and model outputs as comments, for the user to name; so is a walking section
    labels = [json.dumps(c.address["label"]) for c in overview.channels if c.kind == "marker"]
    lines += ["markers: all", f"# or some: markers: [{', '.join(dict.fromkeys(labels))}]"]
    for key, kinds in (("analogs", ("analog", "device")), ("outputs", ("model output",))):
        channels = [c for c in overview.channels if c.kind in kinds]
        pulses = pulse_channels(overview) if key == "analogs" else {}
        lines += [f"{key}:" if pulses else f"# {key}:"] * bool(channels)
        lines += [channel_line(0, one, Guess(column, True, "guessed from its name")) for column, one in pulses.items()]
        lines += [
            f"# {channel_line(n, c, Guess())}" for n, c in enumerate(channels, start=1) if c not in pulses.values()
        ]
    return "\n".join([*lines, *(f"# {line}" for line in (draft_walking([overview]) if walking else []))]) + "\n"


def pulse_channels(overview: Overview) -> dict[str, RecordedChannel]:
    """The analog channels of a capture that are called like `sync` and `trigger`, where one alone is."""
    channels = [c for c in overview.channels if c.kind == "analog"]
    alike = {column: [c for c in channels if likely_column(c) == column] for column in ("sync", "trigger")}
    return {column: found[0] for column, found in alike.items() if len(found) == 1}


def guessed_lines(draft: str) -> list[str]:
    """The lines of a drafted source file that give a channel the name of a column by a guess."""
    return [line.strip() for line in draft.splitlines() if re.search("# (a )?guess", line) and not line.startswith("#")]


def log_lines(overview: Overview) -> Iterator[str]:
    """An entry for every channel but the clock, for the user to name; topics without messages and empty arrays are left
    out, and what is no signal is a comment. Where a channel is like a canonical column, so are those that are like
    none. An entry has its column's name where only this channel is like it and its name, or how it moves, leaves no
    doubt. One that may be another quantity, as a command or another joint's angle, is left to the user; where angle and
    torque are known, as a comment."""
    time: Any = overview.settings.get("time", {})
    clock = next((time[key] for key in ("column", "variable", "field", "channel") if key in time), "")
    listed = overview.channels if overview.drafted is None else overview.drafted
    yield from (f"# {text}" for text in overview.open)
    if clock == NAME_OF_TIME:
        yield "# time: name its column and unit, or state the rate of the rows instead, as {rate: HZ}"
    if any(c.likely_unit and not c.unit for c in listed if clock in c.address.values()):
        yield "# time: its unit is guessed from its name or from the rate of its readings: check it"
    todo = f"give each signal that you need its canonical name instead of NAME_n, state what is {UNKNOWN}"
    yield f"# {todo}, delete the rest"
    yield f"# canonical names: {', '.join(column for column in COLUMNS if column != 'time')}"
    yield "channels:"
    channels = [c for c in listed if not clock or clock not in c.address.values()]
    channels = [c for c in channels if "topic" not in c.address or ("field" in c.address and c.count)]
    guesses = guessed_columns(channels, next((c for c in listed if clock and clock in c.address.values()), None))
    comment_others = any(guess.column for guess in guesses)
    complete = {"theta", "torque"} <= {guess.column for guess in guesses if guess.sure}
    for number, (channel, guess) in enumerate(zip(channels, guesses, strict=True), start=1):
        line, is_needed = channel_line(number, channel, guess), guess.sure or (guess.column and not complete)
        yield f"# {line}" if guess.no_signal or (comment_others and not is_needed) else line


@dataclass(frozen=True)
class Guess:
    """What a channel may be, and why."""

    column: str = ""  # canonical column; empty where nothing tells one
    sure: bool = False  # whether no other channel is as likely, and its name or how it moves leaves no doubt
    said: str = ""  # the evidence, in words
    sign: int = 1  # by which it would be turned
    no_signal: bool = False  # whether it stands still, is noise, or is computed from another


FEWEST_READINGS, LARGEST_READING = 100, 1e30  # how many tell how a channel moves; beyond the other, none is one
FOLLOWS = 0.9  # correlation from which one signal follows another: a fifth of its power may be noise or friction
AS_LIKELY = 4.0  # factor between what a pair and its reverse leave unexplained up to which both may be
UNITS_BY_SIZE = {
    "rad": (("rad", 0.0, 0.9), ("deg", 2.5, 200.0)), "N*m": (("N*m", 0.0, 300.0), ("N*mm", 1500.0, np.inf)),
    "A": (("A", 0.0, 60.0), ("mA", 300.0, np.inf)),
}  # fmt: skip
"""By the unit of a column: units of a channel that states none, and the ranges of readings that tell them. On a bench a
joint turns by 2.5 degrees to 0.9 rad, and its torque changes by 1.5 to 300 N*m."""


def name_of(channel: RecordedChannel) -> str:
    return " ".join(value for key, value in channel.address.items() if key != "topic")


def readings(channel: RecordedChannel) -> Array:
    """The readings (n,) that are numbers of a sensor, in the unit of the channel; none where they were not read."""
    return np.empty(0) if channel.numbers is None else channel.numbers[np.abs(channel.numbers) < LARGEST_READING]


def unit_by_size(channel: RecordedChannel, column: str) -> str:
    """The unit that the range of a channel's readings tells, for a column; empty where it tells none."""
    known = readings(channel)
    size = float(np.ptp(known)) if known.size >= FEWEST_READINGS else 0.0
    units = UNITS_BY_SIZE.get(COLUMNS.get(column, ""), ())
    return next((unit for unit, low, high in units if low < size <= high), "")


def no_signal(channel: RecordedChannel) -> str:
    """Why a channel is no signal, in words; empty if it may be one. Of few readings nothing is said."""
    known = readings(channel)
    if known.size < FEWEST_READINGS:
        return ""
    if not varies(known):
        return "it does not move"
    about = (known - known.mean()) / np.ptp(known)
    tells_next = about[1:] @ about[:-1] > 0.2 * (about @ about)  # one reading of the next: their correlation
    return "" if tells_next or np.unique(known).size == 2 else "it is noise"  # the other is a level


def on_a_grid(channels: Mapping[int, RecordedChannel], clock: RecordedChannel | None) -> tuple[dict[int, Array], float]:
    """Readings of channels at common times, without what is faster than 15 Hz, by number, and their rate [Hz]; of long
    recordings the middle. `clock` is that of rows; for those without times any rate is as good."""
    factor, measured = measure_of(clock) if clock else (1.0, "")
    rows = factor * np.asarray(clock.numbers) if clock and measured == dimension("s") else None
    stamped = dict[int, tuple[Array, Array]]()
    for number, one in channels.items():
        own, numbers = rows if one.times is None else one.times, np.asarray(one.numbers)
        times = np.arange(numbers.size) / 250 if own is None or own.size != numbers.size else own
        known = (np.abs(numbers) < LARGEST_READING) & np.isfinite(times)
        stamped[number] = times[known], numbers[known]
    first, last = max(t[0] for t, _ in stamped.values()), min(t[-1] for t, _ in stamped.values())
    step = float(np.median([np.median(np.diff(t)) for t, _ in stamped.values()]))
    count = min(int((last - first) / step), 30_000) if step > 0 else 0
    if count * step < 1.0 or 1 / step < 40:  # [s, Hz]
        return {}, 0.0
    grid = (first + last) / 2 + step * (np.arange(count) - count / 2)
    return {k: LowPass(15)(np.interp(grid, *pair), 1 / step) for k, pair in stamped.items()}, 1 / step


def following(x: Array, y: Array, rate: float) -> tuple[float, float, float]:
    """How y (n,) follows x (n,) and its derivatives, as a joint's torque follows its angle (Eq. 15): the multiple
    correlation, the slope of x, and the largest correlation with one of the derivatives alone."""
    velocity = np.gradient(x) * rate
    columns, about = np.stack([x, velocity, np.gradient(velocity) * rate], axis=1), y - y.mean()
    columns -= columns.mean(axis=0)
    size = np.sqrt(np.mean(columns**2, axis=0))
    slopes = np.linalg.lstsq(columns / size, about, rcond=None)[0]
    left = rms(about - columns / size @ slopes) / rms(about)
    alone = np.abs(about @ columns) / (len(y) * rms(about) * size)
    return float(np.sqrt(max(1 - left**2, 0.0))), float(slopes[0] / size[0]), float(alone[1:].max())


class Pair(NamedTuple):
    """Two channels, by number, of which one follows the other as a joint's torque follows its angle (`following`)."""

    told: int  # how much of it names and units tell
    r: float
    slope: float
    theta: int
    torque: int


def may_be(channel: RecordedChannel, column: str) -> bool:
    """Whether neither unit nor name of a channel say that it is another quantity than a column, theta or torque."""
    (_, measured), other = measure_of(channel), EFFORT if column == "theta" else ANGLE
    told = rf"{PATTERNS[column][1]}|\b({SPEED}|{other}|current|amps|imu|roll|pitch|yaw|battery|force)\b"
    is_like = measured == dimension(COLUMNS[column]) if measured else unit_by_size(channel, column) and not channel.unit
    is_read = readings(channel).size >= FEWEST_READINGS
    return is_read and bool(is_like) and not re.search(told, words_of(name_of(channel)))


def guessed_columns(channels: Sequence[RecordedChannel], clock: RecordedChannel | None) -> list[Guess]:
    """What each channel of a log may be, the same for every recorder: by its name and unit (`likely_column`), and where
    one channel follows another as a joint's torque follows its angle, and no other pair that names and units tell as
    little. What does not move, is noise, or a torque computed from a current is no signal. `clock` is that of rows."""
    named = [likely_column(one) for one in channels]
    guesses = guesses_by_name(channels, named)
    pairs, signals = following_pairs(channels, named, guesses, clock)
    if not pairs:
        return guesses
    alike = likeliest(pairs, channels, signals)
    for column, other, how in (("theta", "torque", "{} follows it"), ("torque", "theta", "it follows {}")):
        best = {getattr(one, column): one for one in alike}
        for place, one in best.items():
            rivals = ", ".join(json.dumps(name_of(channels[n])) for n in best if n != place)
            said = "guessed from its name" if guesses[place].sure else "a guess"
            said += f": {how.format(json.dumps(name_of(channels[getattr(one, other)])))} as a spring, r = {one.r:.3f}"
            said += f"; as likely is {rivals}" * bool(rivals)
            guesses[place] = Guess(column, not rivals, said, -1 if column == "torque" and one.slope < 0 else 1)
    for column in ("theta", "torque"):  # a name and a motion may tell different channels
        several = [n for n, guess in enumerate(guesses) if guess.sure and guess.column == column]
        for n in several:
            guesses[n] = replace(guesses[n], sure=len(several) == 1)
    return guesses


def guesses_by_name(channels: Sequence[RecordedChannel], named: Sequence[str]) -> list[Guess]:
    """What names and units tell of channels, of which some are no signals."""
    currents = [one for one, column in zip(channels, named, strict=True) if column == "current"]
    without, guesses = list[str](), list[Guess]()
    for channel, column in zip(channels, named, strict=True):
        is_torque = column in ("torque", "torque_m") or may_be(channel, "torque")
        without.append(no_signal(channel) or (made_of(channel, currents) if is_torque else ""))
    known = Counter(column for column, why in zip(named, without, strict=True) if not why)
    for channel, column, why in zip(channels, named, without, strict=True):
        unit = "" if channel.unit else words_of(channel.likely_unit)  # its words do not count
        words = words_of(name_of(channel)).removesuffix(unit).split()
        sure = bool(words) and column != "" and set(words) <= set(PATTERNS[column][2].split())
        by_name = Guess(column, sure and known[column] == 1, "guessed from its name" * sure)
        guesses.append(Guess(said=why, no_signal=True) if why else by_name)
    return guesses


def following_pairs(
    channels: Sequence[RecordedChannel], named: Sequence[str], guesses: Sequence[Guess], clock: RecordedChannel | None
) -> tuple[list[Pair], dict[int, Array]]:
    """The pairs of channels of which one may be an angle and the other its torque; and the signals of all."""
    moving = {
        k: c for k, c in enumerate(channels) if not guesses[k].no_signal and (may_be(c, "theta") or may_be(c, "torque"))
    }
    signals, rate = on_a_grid(moving, clock) if len(moving) > 1 else ({}, 0.0)
    pairs = list[Pair]()
    for k, m in permutations(signals, 2):
        if may_be(channels[k], "theta") and may_be(channels[m], "torque"):
            r, slope, alone = following(signals[k], signals[m], rate)
            told = (named[k] == "theta") + (named[m] == "torque") + bool(guesses[k].said) + bool(guesses[m].said)
            is_derivative = alone > 0.99 and named[m] != "torque"
            if r > FOLLOWS and not is_derivative and factor_of(signals[m], signals[k]) is None:
                pairs.append(Pair(told, r, slope, k, m))
    return pairs, signals


def likeliest(pairs: Sequence[Pair], channels: Sequence[RecordedChannel], signals: Mapping[int, Array]) -> list[Pair]:
    """The pairs that are as likely as the one of which names and units tell most."""
    most, units = max(pairs), {channels[one.torque].unit or channels[one.torque].likely_unit for one in pairs}
    alike = sorted(one for one in pairs if one.told == most.told)
    alike = [one for one in alike if one[:2:-1] != most[3:] or 1 - one.r**2 <= AS_LIKELY * (1 - most.r**2)]
    if "" not in units:  # what leaks into other directions of a load cell is smaller
        largest = max(np.std(signals[one.torque]) for one in alike)
        alike = [one for one in alike if np.std(signals[one.torque]) > largest / 3]
    return alike


def made_of(channel: RecordedChannel, currents: Sequence[RecordedChannel]) -> str:
    """Of which current a torque is a constant times, in words; empty of none: that is no torque that was measured."""
    for current in currents:
        none = np.empty(0)
        y, x = (none if one.numbers is None else one.numbers for one in (channel, current))
        if (factor := factor_of(y, x)) is not None:
            name = json.dumps(list(current.address.values())[-1])
            return f"{name} times {factor:.4g}, to within rounding: {COMPUTED}"
    return ""


def channel_line(number: int, channel: RecordedChannel, guess: Guess) -> str:
    """One entry under `channels`, by what it may be, with the column's name where that is sure."""
    stated, is_guessed = channel.unit or channel.likely_unit, bool(channel.likely_unit and not channel.unit)
    by_size = unit_by_size(channel, guess.column) if guess.sure and not stated else ""
    unit = stated if stated and is_unit(stated) else "V" if guess.column in ("sync", "trigger") else by_size or UNKNOWN
    sure = guess.sure and unit != UNKNOWN
    said = [*[f"{guess.column}?"] * (bool(guess.column) and not sure), f"{'left out: ' * guess.no_signal}{guess.said}"]
    said += [f"no known unit: {json.dumps(channel.unit)}"] * (bool(channel.unit) and unit == UNKNOWN)
    said += [f"the unit is guessed{' from its size' * bool(by_size)}: check it"] * (is_guessed or bool(by_size))
    fields = {**channel.address, "unit": unit} | ({"sign": guess.sign} if guess.sign < 0 else {})
    entry = ", ".join(f"{key}: {json.dumps(value)}" for key, value in fields.items())
    comment = f"  # {'; '.join(filter(None, said))}" if any(said) else ""
    return f"  {guess.column if sure else f'NAME_{number}'}: {{{entry}}}{comment}"


SEGMENTS = {
    "platform": ("PLAT|HEXAPOD|STEWART", ""),
    "ankle_medial": (r"(?=.*((?<!SH)ANK|MAL)).*(MED|(^|_)M(_|MAL|$))", "MED|MMA|MMAL|TAM|AM|MM"),
    "ankle_lateral": ("(?<!SH)ANK|MAL", "LMA|LMAL|FAL|AL|LM"),
    "foot": (r"FOOT|SHOE|HEEL|CALC|TOE|META?\d", r"FCC|F[ML]\d?|FT\d|MT\d|MET|PM\d|HEE|CAL\d?|H"),
    "shank": (r"SHANK|SHIN|TIB|PYLON|(?<!UP)(?<!UPPER)(?<!UPPER_)LEG", r"SK\d|S\d|TTC|TTB?|TB\d|SHA|HF|FAX"),
}
"""What the names of a segment's markers begin with, and their codes behind an R or L in Plug-in Gait, OpenSim's models
and Qualisys' (CAST). A marker called `ankle` and no more is the lateral one in all of them."""


def segment_of(label: str) -> tuple[str, str]:
    """Side, R or L, and segment of `SEGMENTS` that a marker's name tells; empty where it tells none. The name of the
    subject before a colon does not count."""
    name = re.sub(r"[^A-Z0-9]+", "_", label.rpartition(":")[2].upper()).strip("_")
    forms = re.findall(r"^(RIGHT|LEFT|R|L)_?(.+)$", name)
    forms += [(side, rest) for rest, side in re.findall(r"^(.+)_(RIGHT|LEFT|R|L)$", name)]
    for side, rest in [*forms, ("", name)]:
        for segment, (words, codes) in SEGMENTS.items():
            if re.search(rf"(^|_)({words})" if side else words, rest) or (side and re.fullmatch(codes, rest)):
                return side[:1], segment
    return "", ""


def tracks_of(overview: Overview) -> dict[str, Array]:
    """Positions (frames, 3) [m], z up, of each marker of a capture that has a name and was seen."""
    order, signs = ([0, 2, 1], [1, -1, 1]) if "axes" in overview.settings else ([0, 1, 2], [1, 1, 1])
    found = {}
    for one in (one for one in overview.channels if one.kind == "marker" and is_labelled(one.address["label"])):
        if one.count and one.numbers is not None:
            factor, _ = base_units(normalised(one.unit)) or (1e-3, "")
            found[one.address["label"]] = factor * one.numbers[:, order] * signs
    return found


def travel(track: Array) -> float:
    """The longest way of a track (frames, n) along an axis but for its outer 2 %; infinite if it was hardly seen."""
    seen = track[np.isfinite(track).all(axis=1)]
    ends = np.quantile(seen, [0.02, 0.98], axis=0) if 2 * len(seen) > len(track) else [[0.0], [np.inf]]
    return float(np.ptp(ends, axis=0).max())


def platform_in(captures: Sequence[dict[str, Array]]) -> tuple[list[str], str]:
    """The platform's markers, and by what: their names; or else that people walk past them while they keep within
    15 cm, less than 30 cm above the lowest marker, and that each moves by 3 mm or more in some capture."""
    every = dict.fromkeys(label for tracks in captures for label in tracks)
    if named := [label for label in every if segment_of(label)[1] == "platform"]:
        return named, "named so"
    crossings = [tracks for tracks in captures if any(1 < travel(track) < np.inf for track in tracks.values())]
    resting = [label for label in every if not segment_of(label)[1] and any(label in one for one in crossings)]
    for tracks in crossings:
        lowest = min(float(np.nanquantile(track[:, 2], 0.02)) for track in tracks.values())
        low = [x for x in resting if x in tracks and np.nanmedian(tracks[x][:, 2]) < lowest + 0.3]
        resting = [x for x in resting if x not in tracks or (x in low and travel(tracks[x]) < 0.15)]
    moved = [x for x in resting if any(travel(tracks[x]) > 0.003 for tracks in captures if x in tracks)]
    return moved, "a guess to be confirmed: low, and at rest but for small motions" * bool(moved)


def told_by_motion(overview: Overview, platform: Sequence[str]) -> dict[str, str]:
    """The cells of the sheet that the motion in a capture tells; none where it tells no experiment."""
    tracks, turn, steps = tracks_of(overview), 0.0, list[int]()
    own = [tracks[label] for label in platform if label in tracks]
    for first, second in combinations(own, 2):  # the turn [rad] of the line between two markers
        if (way := travel(first - second)) < np.inf:
            turn = max(turn, way / float(np.linalg.norm(np.nanmedian(first - second, axis=0))))
    turns, legs = turn > np.radians(1), any(segment_of(label)[1] in ("foot", "shank") for label in tracks)
    frames = max(map(len, tracks.values()), default=0)
    rate = max((one.rate or 0.0 for one in overview.channels if one.kind == "marker"), default=0.0)
    for force in (c.numbers for c in overview.channels if c.kind == "plate" and c.numbers is not None):
        loaded = runs(force - np.quantile(force, 0.02) > 100)  # [N]
        steps.append(sum((run.stop - run.start) * frames > 0.3 * rate * force.size for run in loaded))
    if legs and not turns and all(travel(track) < 0.03 for track in tracks.values()):
        return {"experiment": "static"}
    if own and legs and 1 in steps:
        return {"experiment": "walking", "perturbed": str(turns).lower()}
    if own and turns and not legs and not any(steps):
        return {"experiment": "plate"}
    return {"experiment": "overground"} if legs and any(steps) and not own else {}


def draft_walking(overviews: Sequence[Overview]) -> list[str]:
    """Lines of YAML: the section `walking` of a configuration by the captures of one laboratory. What neither names nor
    motion tell is UNKNOWN. None unless markers are named as a foot's or shank's."""
    markers = [one for overview in overviews for one in overview.channels if one.kind == "marker"]
    told = {label: segment_of(label) for label in dict.fromkeys(one.address["label"] for one in markers)}
    platform, by = platform_in([tracks_of(overview) for overview in overviews])
    side = max((side for side, segment in told.values() if segment in ("foot", "shank")), default="")  # R before L
    leg = {"R": "right", "L": "left", "": UNKNOWN}[side]
    of_leg = [(label, own) for label, (of, own) in told.items() if not side or of in ("", side)]
    clusters = {segment: [label for label, own in of_leg if own == segment] for segment in SEGMENTS}
    if not (clusters["foot"] or clusters["shank"]):
        return []
    clusters["platform"] = platform
    # the plate on the platform: with load, on which somebody stepped; of several with load the nearest to the markers
    every = [[channel for channel in one.channels if channel.kind == "plate"] for one in overviews]
    plates = max(every, key=lambda plates: max((one.load or 0.0 for one in plates), default=-1.0))
    loaded = [one for one in plates if (one.load or 0.0) > 100.0]
    own = [c.centre for c in markers if c.centre and c.address["label"] in platform]
    plate, why = ("1", "the only one") if len(plates) == 1 else (UNKNOWN, f"of {len(plates)} force plates in this file")
    if len(plates) > 1 and loaded:
        guess, why = max(loaded, key=lambda one: one.load or 0.0), "the one with the load"
        if own and len(loaded) > 1:
            guess = min(loaded, key=lambda one: float(np.linalg.norm(np.subtract(one.centre, np.mean(own, axis=0)))))
            why = "with load the one that is nearest to the platform's markers"
        plate, why = guess.address["plate"], f"a guess, to be confirmed: of {len(plates)} force plates {why}"
    lines = [
        "walking:  # a draft, from names and motion of markers: check every line",
        f"  side: {leg}  # the leg that steps on the platform" + ", a guess to be confirmed" * bool(side),
        f"  plate: {plate}  # {why}",
        "  markers:",
    ]
    for key, found in clusters.items():
        names, said = [json.dumps(name) for name in found], "named so" if found else "none is known"
        if key.startswith("ankle"):
            said = (
                f"one of {', '.join(names)}" if len(names) > 1 else said + ": named in the static trial?" * (not names)
            )
            value = names[0] if len(names) == 1 else UNKNOWN
        else:
            value = f"[{', '.join(names + [UNKNOWN] * (len(names) < 3))}]"
            said = (by if key == "platform" and by else said) + "; a cluster has 3 or more" * (len(names) < 3)
        lines.append(f"    {key}: {value}  # {said}")
    lines += ["# no platform: does a belt, a boot or the leg perturb (`walking.perturbed_by`)?"] * (not platform)
    return lines


WORDS_OF_EXPERIMENTS = {
    "torque_angle": r"\b(torque angle|quasi ?static)\b",
    "plate": r"\b(plate|unloaded)\b",
    "static": r"(?<!quasi )\b(static|standing|stand|calibration|calib)\b",
    "calibration": r"\b(calibration|calib)\b",
    "walking": r"\b(walk|walking|cross|crossing|perturb|perturbed|perturbation|pert|unperturbed|unpert|gait)\b",
    "belt": r"\bbelt\b",
    "transmission": r"\b(transmission|drivetrain)\b",
    "actuator": r"\b(actuator|motor)\b",
    "impedance": r"\b(impedance|imp|stiffness|multisine|chirp|sines?)\b",
}
"""By experiment: what the words of a file's name contain. A name that tells several tells none."""
UNNAMED = "ingest_only"  # the experiment of a trial whose name tells none


def trial_name(path: Path) -> str:
    """A name for the trial of a file: that of the file without its ending, with `_` for what a name may not have."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", path.stem if path.suffix else path.name).lstrip("_.-")[:90] or "trial"


def draft_trials(
    recordings: Iterable[tuple[Path, str, bool]], moved: Mapping[Path, Mapping[str, str]] | None = None
) -> list[tuple[dict[str, str], list[str]]]:
    """The trials that recordings are, by what the words of their names tell, or else the motion of markers, `moved`
    (`told_by_motion` of each file): the cells of each in a sheet, and what of it the user has to decide. recordings:
    file or folder of each, relative to the folder of all, the name of its source file, and whether it comes from motion
    capture. A log and a capture of the same name are one. Sorted by name. A stated stiffness tells an impedance trial,
    but for one who walks. `k1` states none: it is a number of a file."""
    several: dict[str, dict[str, tuple[Path, str]]] = {}
    for path, source, is_capture in sorted(recordings, key=lambda recorded: recorded[0].as_posix()):
        number, name, role = 1, trial_name(path), "mocap" if is_capture else "log"
        free = name
        while role in several.get(free, ()):
            number += 1
            free = f"{name}_{number}"
        several.setdefault(free, {})[role] = path, source
    trials = []
    for name, files in several.items():
        path = next(iter(files.values()))[0]
        cells, said, still_open = {"trial": name}, path.stem if path.suffix else path.name, list[str]()
        for role, (file, source) in files.items():
            cells |= {role: file.as_posix(), f"{role}_source": source}
        words, numbers, begin = words_of(said.replace("_", " ")), {}, "(?<![A-Za-z])"
        for column, letter, smallest in (("K_d", "K", 10.0), ("B_d", "B", 0.0)):
            behind = r"(?=$|[_\s-]|[.,](?!\d)|[BbKk]_?d?[_=-]?\d)"
            found = set(re.findall(rf"{begin}{letter}_?d?[_=-]?(\d+(?:\.\d+)?){behind}", said, re.IGNORECASE))
            if len(found) == 1 and float(*found) >= smallest:
                (numbers[column],) = found
        wrong = {"static", "plate"} if "mocap" not in files else set()  # a log alone is of a bench, a boot or a leg
        wrong |= {*WORDS_OF_EXPERIMENTS} - {"static", "plate", "walking"} if "log" not in files else set()
        told = [known for known, word in WORDS_OF_EXPERIMENTS.items() if known not in wrong and re.search(word, words)]
        told += ["impedance"] * ("K_d" in numbers and not {"walking", "impedance"} & {*told, *wrong})
        experiment = told[0] if len(told) == 1 else UNNAMED
        calm = re.search(r"\b(unperturbed|unpert|baseline|normal|level|free|no ?pert)\b", words)
        perturbed = "false" if calm else "true" * bool(re.search(r"\b(perturb|perturbed|perturbation|pert)\b", words))
        role = "mocap" if "mocap" in files else "log"
        motion = (moved or {}).get(files[role][0], {})
        is_open = experiment == UNNAMED or (experiment == "walking" and not perturbed)
        if motion and is_open and (role == "mocap" or not told):
            experiment, guessed = motion["experiment"], " and ".join(map(" ".join, motion.items()))
            if experiment == "overground" and "log" in files:
                guessed += "; if a belt, a boot or the leg perturbs: walking, with `walking.perturbed_by`"
            cells |= motion
            by = "the motion of markers and plates" if role == "mocap" else "angle and torque"
            still_open.append(f"to be confirmed, guessed from {by}: {guessed}")
        elif experiment == UNNAMED:
            what = f"the name may tell {' or '.join(told)}" if told else "the name tells none"
            still_open.append(f"experiment: {what}; it stands as {UNNAMED}, which is not analysed")
        elif experiment == "impedance":
            for column in ("K_d", "B_d"):
                if column not in numbers:
                    still_open.append(f"{column}: the name does not tell; empty, nothing is compared with it")
            cells |= numbers
            controller = re.search(rf"{begin}(un|non[-_]?)?comp(?:ensated)?(?![A-Za-z])", said, re.IGNORECASE)
            if controller:
                cells["controller"] = "uncompensated" if controller[1] else "compensated"
        elif experiment == "calibration":
            experiment, remedy = UNNAMED, "write calibration, and its known_K or known_I"
            still_open.append(
                f"experiment: a calibration whose spring or inertia is not told stands as {UNNAMED}: {remedy}"
            )
        elif experiment == "walking" and perturbed:
            cells["perturbed"] = perturbed
        elif experiment == "walking":
            experiment, remedy = UNNAMED, "write walking, and true or false"
            still_open.append(f"perturbed: the name does not tell; it stands as {UNNAMED}: {remedy}")
        trials.append((cells | {"experiment": experiment}, still_open))
    return trials
