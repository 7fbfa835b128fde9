"""Drafts of source files. Texts from files are quoted as JSON, which is valid YAML. What files do
not tell is left to the user, questions first."""

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.formats import known_formats
from osl_analysis.ingest.clock import MINIMUM_EDGES, find_edges
from osl_analysis.ingest.draft_walking import draft_walking
from osl_analysis.ingest.likely_column import (
    COUNTS,
    LEVELS,
    Guess,
    as_actuator,
    gone_on,
    guessed_columns,
    likely_column,
    places_of,
    turns_slowly,
    with_known_unit,
)
from osl_analysis.ingest.overview import MOST_COLUMNS, Overview, RecordedChannel
from osl_analysis.ingest.placeholders import NAME_OF_TIME, UNKNOWN, open_places
from osl_analysis.ingest.raw_files import is_capture
from osl_analysis.signals.plateaus import (
    STANDS,
    is_clamped,
    plateaus_of,
)
from osl_analysis.trial import COLUMNS, Array
from osl_analysis.units import GON, base_units, dimension, is_unit, normalised
from osl_analysis.yaml_settings import read_mapping

NAMED_ALWAYS = ("theta", "torque", *LEVELS)  # columns that a draft names without a unit
BETWEEN_LEVELS = 0.25  # share of its swing beside the middle, in which a pulse seldom is
MOST_BETWEEN = 0.02  # share of the samples that may be there
FEWEST_TIMES = 4  # readings of a log that is looked at
MOST_OF_CLAMP = 0.05  # rad, by which a clamp yields under an actuator's torque
LEAST_AT_PLATEAUS = 0.5  # share of the readings: a stepped current changes seldom
TIME_KEYS = ("column", "variable", "field", "channel")


@dataclass(frozen=True)
class DraftedLog:
    """The channels of a log that may be signals, what each may be, and its clock."""

    signals: Sequence[RecordedChannel]
    guesses: Sequence[Guess]
    clock: RecordedChannel | None

    def sure(self, column: str) -> RecordedChannel | None:
        """The channel that is surely a column, unwrapped."""
        for channel, guess in zip(self.signals, self.guesses, strict=True):
            if guess.is_sure and guess.column == column:
                return gone_on(channel, guess.wraps_at)
        return None

    @property
    def is_slow(self) -> bool:
        """Whether the joint's angle goes slowly to and fro, at one speed."""
        angle = self.sure("theta")
        return angle is not None and self.clock is not None and turns_slowly(angle, self.clock)


def times_of(readings: Array | None, clock: RecordedChannel | None) -> Array | None:
    """Times (n,) [s] of readings, all of which are numbers; None if they are not known."""
    if readings is None or clock is None or clock.numbers is None:
        return None
    if len(clock.numbers) != len(readings) or len(readings) < FEWEST_TIMES:
        return None
    time = (clock.numbers - clock.numbers[0]) * unit_factor(clock)
    is_rising = bool((np.diff(time) >= 0).all())
    return time if is_rising and time[-1] > 0 and np.isfinite(readings).all() else None


def stands_at_plateaus(
    signals: Sequence[RecordedChannel], guesses: Sequence[Guess], clock: RecordedChannel | None
) -> bool:
    """Whether the only angle hardly turns while the only current stands at plateaus: both are of a
    clamped actuator, and not of a joint that is moved."""
    angles = places_of(guesses, "theta")
    currents = places_of(guesses, "current")
    if len(angles) != 1 or len(currents) != 1 or not places_of(guesses, "torque"):
        return False
    angle, current = signals[angles[0]], signals[currents[0]]
    time = times_of(current.numbers, clock)
    if time is None or current.numbers is None or angle.numbers is None:
        return False
    if not np.ptp(angle.numbers) * unit_factor(angle) < MOST_OF_CLAMP:
        return False
    plateaus = plateaus_of(time, current.numbers)
    at_plateaus = sum(rows.stop - rows.start for rows in plateaus) / len(time)
    is_stepped = at_plateaus > LEAST_AT_PLATEAUS
    return is_stepped and is_clamped(time, current.numbers, plateaus, None, True, STANDS)


def unit_factor(channel: RecordedChannel) -> float:
    """A channel's unit in SI units; 0 if it is not known."""
    return (base_units(normalised(channel.unit or channel.likely_unit)) or (0.0, ""))[0]


@np.errstate(all="ignore")  # what a damaged file holds may be of any size
def drafted_log(overview: Overview) -> DraftedLog:
    """Guess what the channels of a log are."""
    time: Any = overview.settings.get("time", {})
    name = next((time[key] for key in TIME_KEYS if key in time), "")
    listed = overview.channels if overview.drafted is None else overview.drafted
    clock = next((one for one in listed if name and name in one.address.values()), None)
    signals: list[RecordedChannel] = []
    for channel in listed:
        is_topic_alone = "topic" in channel.address and "field" not in channel.address
        has_no_numbers = channel.numbers is not None and not channel.count
        if channel is not clock and not is_topic_alone and not has_no_numbers:
            signals.append(with_known_unit(channel))
    guesses = guessed_columns(signals)
    if stands_at_plateaus(signals, guesses, clock):
        guesses = as_actuator(
            signals,
            [
                replace(guess, column="theta_m") if guess.column == "theta" else guess
                for guess in guesses
            ],
        )
    return DraftedLog(signals, guesses, clock)


@np.errstate(all="ignore")
def draft_source(
    overview: Overview,
    name: str,
    has_walking: bool = True,
    log: DraftedLog | None = None,
) -> str:
    """Draft a source file.

    Channels that are the only one like a canonical column, and whose unit is known, have its name.

    Parameters
    ----------
    name
        Of the file.
    has_walking
        Whether the draft for a capture has the section `walking` of a configuration, as comments.
    log
        What is guessed already.
    """
    lines = [
        f"format: {overview.format}",
        f"description: {json.dumps(f'Drafted from {name}; complete it.')}",
    ]
    lines += [f"{key}: {json.dumps(value)}" for key, value in overview.settings.items()]
    if is_capture(known_formats()[overview.format]):
        lines += capture_lines(overview)
        if has_walking:
            lines += [f"# {line}" for line in draft_walking([overview])]
    else:
        lines += log_lines(overview, log or drafted_log(overview))
    return "\n".join(lines) + "\n"


def capture_lines(overview: Overview) -> Iterator[str]:
    """All markers; analog channels that are of no plate, and model outputs, as comments, for the
    user to name."""
    labels = [json.dumps(one.key) for one in overview.channels if one.kind == "marker" and one.key]
    yield from (f"# {text}" for text in overview.open)
    yield "markers: all"
    yield f"# or some: markers: [{', '.join(dict.fromkeys(labels))}]"
    pulses = pulse_channels(overview)
    for key, kind in (("analogs", "analog"), ("outputs", "model output")):
        channels = [one for one in overview.channels if one.kind == kind]
        if not channels:
            continue
        named = pulses if key == "analogs" else {}
        yield f"{key}:" if named else f"# {key}:"
        for column, channel in named.items():
            by_name = likely_column(channel) == column
            why = "guessed from its name" if by_name else "a guess: it is a train of pulses"
            yield channel_line(
                0, with_number(channel, channels), Guess(column, is_sure=True, why=why)
            )
        of_plates = [one.group for one in channels if one.group]
        for number, channel in enumerate(channels, start=1):
            if channel.group or any(channel is pulse for pulse in named.values()):
                continue
            addressed = with_number(channel, channels)
            label = Guess(why=channel.key) if addressed is not channel else Guess()
            yield f"# {channel_line(number, addressed, label)}"
        if of_plates:
            plates = ", ".join(dict.fromkeys(of_plates))
            yield f"#   {len(of_plates)} more are read as {plates}"


def with_number(channel: RecordedChannel, channels: Sequence[RecordedChannel]) -> RecordedChannel:
    """Give an analog channel its number, from 1, for a label that others have too."""
    alike = [other for other in channels if other.address == channel.address]
    if "channel" not in channel.address or len(alike) == 1:
        return channel
    number = next(n for n, other in enumerate(channels, start=1) if other is channel)
    return replace(channel, address={**channel.address, "channel": str(number)})


def pulse_channels(overview: Overview) -> dict[str, RecordedChannel]:
    """The analog channels of a capture that are called like `sync` and `trigger`, where one alone
    is; or the only one with a train of pulses as `sync`."""
    analogs = [one for one in overview.channels if one.kind == "analog"]
    found: dict[str, RecordedChannel] = {}
    for column in LEVELS:
        alike = [one for one in analogs if likely_column(one) == column]
        if len(alike) == 1:
            found[column] = alike[0]
    if "sync" not in found:
        trains = [one for one in analogs if is_pulse_train(one)]
        if len(trains) == 1 and trains[0] not in found.values():
            found["sync"] = trains[0]
    return found


def is_pulse_train(channel: RecordedChannel) -> bool:
    """Whether a channel of volts stands at two levels, and changes between them often enough to
    align clocks."""
    measured = (base_units(normalised(channel.unit)) or (1.0, ""))[1]
    if channel.numbers is None or measured != dimension("V"):
        return False
    level = channel.numbers[np.isfinite(channel.numbers)]
    swing = float(np.ptp(level)) if level.size else 0.0
    middle = float(level.min()) + 0.5 * swing if swing else 0.0
    is_between = np.abs(level - middle) < BETWEEN_LEVELS * swing
    if not swing or np.mean(is_between) > MOST_BETWEEN:
        return False
    edges, _, _ = find_edges(np.arange(level.size, dtype=np.float64), level)
    return edges.size >= MINIMUM_EDGES


def log_lines(overview: Overview, log: DraftedLog) -> Iterator[str]:
    """An entry for every channel but the clock.

    It has a column's name if only this channel is like the column and its name leaves no doubt. The
    user names the others, such as those that may be a command or another joint's angle. A channel
    that is no signal is a comment; so is one like no column, if another channel is like one; and,
    once angle and torque are known, also a doubtful one, and one without a stated unit.
    """
    yield from (f"# {text}" for text in overview.open)
    time: Any = overview.settings.get("time", {})
    if NAME_OF_TIME in time.values():
        yield "# time: name its column and unit, or state the rate of the rows, as {rate: HZ}"
    if log.clock and log.clock.likely_unit and not log.clock.unit:
        yield "# time: its unit is guessed from its name or from the rate of its readings: check it"
    yield (
        f"# give each signal that you need its canonical name instead of NAME_n, state what is"
        f" {UNKNOWN}, delete the rest"
    )
    yield f"# canonical names: {', '.join(column for column in COLUMNS if column != 'time')}"
    yield "channels:"
    is_complete = is_complete_log(log)
    comment_others = any(guess.column for guess in log.guesses)
    noise = Counter(
        channel.matrix
        for channel, guess in zip(log.signals, log.guesses, strict=True)
        if guess.is_no_signal and channel.matrix
    )
    large = {matrix for matrix, count in noise.items() if count > MOST_COLUMNS}
    for number, (channel, guess) in enumerate(zip(log.signals, log.guesses, strict=True), start=1):
        if guess.is_no_signal and channel.matrix in large:
            continue
        has_unit = is_unit(channel.unit or channel.likely_unit)
        stands = guess.is_sure and (has_unit or guess.column in NAMED_ALWAYS)
        is_asked = stands or (bool(guess.column) and not is_complete)
        line = channel_line(number, channel, guess)
        is_comment = guess.is_no_signal or (comment_others and not is_asked)
        yield f"# {line}" if is_comment else line
    for matrix in sorted(large):
        yield f"#   {json.dumps(matrix)}: left out: {noise[matrix]} of its columns are no signal"


def is_complete_log(log: DraftedLog) -> bool:
    """Whether the signals of a joint, or of an actuator alone, are known."""
    sure = {guess.column for guess in log.guesses if guess.is_sure}
    of_joint = {"theta", "torque"} <= sure
    of_actuator = {"torque_m", "current"} <= sure and bool(sure & {"theta_m", "omega_m"})
    return of_joint or of_actuator


def channel_line(number: int, channel: RecordedChannel, guess: Guess) -> str:
    """One entry under `channels`, by what it may be, with the column's name where that is sure."""
    stated = channel.unit or channel.likely_unit
    measured = (base_units(normalised(stated)) or (1.0, ""))[1]
    is_count = measured in (COUNTS if guess.column else COUNTS[:1])
    unit = stated
    if is_count or stated.lower() in GON:
        unit = "V" if guess.column in LEVELS else UNKNOWN
    remarks: list[str] = []
    if guess.column and not guess.is_sure:
        remarks.append(f"{guess.column}?")
    if guess.why:
        remarks.append(f"left out: {guess.why}" if guess.is_no_signal else guess.why)
    if channel.unit and unit == UNKNOWN:
        remarks.append(f"no known unit: {json.dumps(channel.unit)}")
    if channel.likely_unit and not channel.unit:
        remarks.append("the unit is guessed: check it")
    if guess.is_sure and unit == UNKNOWN and not stated:
        remarks.append("no unit is stated")
    fields: dict[str, Any] = {**channel.address, "unit": unit}
    if guess.sign < 0:
        fields["sign"] = guess.sign
    if guess.wraps_at and guess.column.startswith("theta"):
        fields["wraps_at"] = guess.wraps_at
    entry = ", ".join(
        f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in fields.items()
    )
    name = guess.column if guess.is_sure else f"NAME_{number}"
    comment = f"  # {'; '.join(remarks)}" if remarks else ""
    return f"  {name}: {{{entry}}}{comment}"


def guessed_lines(draft: str) -> list[str]:
    """The lines of a drafted source file that give a channel the name of a column by a guess."""
    return [
        line.strip()
        for line in draft.splitlines()
        if re.search("# (a )?guess", line) and not line.startswith("#")
    ]


def to_be_edited(path: Path) -> list[str]:
    """The places of a drafted source file that are to be edited, with the column that no channel is
    like, unless the log stands beside captures."""
    text = path.read_text(encoding="utf-8")
    content = read_mapping(path)
    places = [".".join(place).removeprefix("channels.") for place in open_places(content)]
    if content.get("channels", 0) is None:
        places.append("channels (none may be a signal: name them, as of the comments)")
    lacking = [
        column
        for column in ("theta", "torque")
        if not re.search(rf"\n  ({column}: |NAME.*# {column}\?)", text)
    ]
    is_alone = content.get("clock", "master") == "master"
    if places and is_alone and len(lacking) == 1 and "\n  torque_m: " not in text:
        places.append(f"{lacking[0]} (no channel is like it: name one, as of the comments)")
    return places
