"""Drafts of source files. Texts from files are quoted as JSON, which is valid YAML. What files do
not tell is left to the user, questions first."""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from osl_analysis.draft.guesses import Guess, gone_on, guessed_columns
from osl_analysis.draft.likelihood import COUNTS, LEVELS, likely_level, with_documented_unit
from osl_analysis.draft.overview import Overview, RecordedChannel
from osl_analysis.errors import listing
from osl_analysis.formats import known_formats
from osl_analysis.ingest.clock import MINIMUM_EDGES, find_edges
from osl_analysis.ingest.placeholders import NAME_OF_TIME, UNKNOWN
from osl_analysis.ingest.raw_files import is_capture
from osl_analysis.trial import COLUMNS
from osl_analysis.units import GON, dimension, is_unit

NAMED_ALWAYS = ("theta", "torque", *LEVELS)  # columns that a draft names without a unit
BETWEEN_LEVELS = 0.25  # share of its swing beside the middle, in which a pulse seldom is
MOST_BETWEEN = 0.02  # share of the samples that may be there
MOST_LISTED = 20  # channels that are left out for one reason
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


@dataclass
class Entry:
    """A channel in the draft of a source file, under the name of a column or one to be edited."""

    name: str
    fields: dict[str, object]
    remark: str = ""
    is_comment: bool = False

    @property
    def line(self) -> str:
        """The entry in YAML."""
        fields = (
            f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in self.fields.items()
        )
        text = f"  {self.name}: {{{', '.join(fields)}}}"
        text += f"  # {self.remark}" if self.remark else ""
        return f"# {text}" if self.is_comment else text


@dataclass
class DraftedSource:
    """The draft of a source file.

    Attributes
    ----------
    settings
        Its fields above those of channels.
    questions
        Comments above the channels.
    entries
        Channels under the key `channels` of a log, `analogs` of a capture.
    notes
        Comments below the entries.
    known
        Text of the shipped source file of the recorder, which has the place of the settings.
    """

    settings: dict[str, object]
    questions: list[str] = field(default_factory=list)
    entries: list[Entry] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    key: str = "channels"
    known: str = ""

    @property
    def named(self) -> list[Entry]:
        """The entries that are no comments."""
        return [entry for entry in self.entries if not entry.is_comment]

    @property
    def text(self) -> str:
        """The source file."""
        if self.known:
            further = [entry.line for entry in self.named if self.is_further(entry)]
            has_key = re.search(rf"^{self.key}:$", self.known, re.MULTILINE) is not None
            above = [f"{self.key}:"] if further and not has_key else []
            return self.known + "".join(f"{line}\n" for line in [*above, *further])
        lines = [f"{key}: {json.dumps(value)}" for key, value in self.settings.items()]
        lines = [lines[0].replace('"', ""), *lines[1:]]
        lines += [f"# {text}" for text in self.questions]
        if self.key == "channels" or self.entries:
            comment = "" if self.key == "channels" or self.named else "# "
            lines.append(f"{comment}{self.key}:")
        lines += [entry.line for entry in self.entries]
        lines += [f"#   {text}" for text in self.notes]
        return "\n".join([*lines, ""])

    def is_further(self, entry: Entry) -> bool:
        """Whether an entry has a name that the shipped source file does not have."""
        return entry.name.islower() and f"\n  {entry.name}: " not in self.known

    def has(self, *columns: str) -> bool:
        """Whether all columns are named."""
        names = {entry.name for entry in self.named}
        return all(column in names or f"\n  {column}: {{" in self.known for column in columns)

    @property
    def places(self) -> list[str]:
        """The places to be edited, with the column that no channel is like, unless the log stands
        beside captures."""
        if self.known or self.key != "channels":
            return []
        time: Any = self.settings.get("time", {})
        places = [f"time.{key}" for key, value in time.items() if value in (NAME_OF_TIME, UNKNOWN)]
        for entry in self.named:
            if not entry.name.islower() and entry.name.startswith("NAME_"):
                places.append(entry.name)
            elif entry.fields["unit"] == UNKNOWN:
                places.append(f"{entry.name}.unit")
        if not self.named:
            places.append("channels (none may be a signal: name them, as of the comments)")
        offered = {entry.name for entry in self.named}
        offered |= {entry.remark.partition("?")[0] for entry in self.entries}
        lacking = [column for column in ("theta", "torque") if column not in offered]
        is_alone = self.settings["clock"] == "master"
        if places and is_alone and len(lacking) == 1 and "torque_m" not in offered:
            places.append(f"{lacking[0]} (no channel is like it: name one, as of the comments)")
        return places


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
            signals.append(with_documented_unit(channel))
    return DraftedLog(signals, guessed_columns(signals), clock)


def draft_source(overview: Overview, name: str) -> str:
    """The text of the draft of a source file for a file `name`."""
    return drafted_source(overview, name).text


@np.errstate(all="ignore")
def drafted_source(overview: Overview, name: str, log: DraftedLog | None = None) -> DraftedSource:
    """Draft a source file.

    Channels that are the only one like a canonical column, and whose unit is known, have its name.

    Parameters
    ----------
    name
        Of the file.
    log
        What is guessed already.
    """
    source = DraftedSource(
        {
            "format": overview.format,
            "description": f"Drafted from {name}; complete it.",
            **overview.settings,
        },
        list(overview.open),
    )
    if is_capture(known_formats()[overview.format]):
        add_markers(source, overview)
    else:
        add_signals(source, log or drafted_log(overview))
    return source


def add_markers(source: DraftedSource, overview: Overview) -> None:
    """All markers; analog channels that are of no plate, and model outputs, as comments, for the
    user to name."""
    source.settings["markers"] = "all"
    source.key = "analogs"
    labels = [one.key for one in overview.channels if one.kind == "marker" and one.key]
    source.questions.append(f"or some: markers: {json.dumps(list(dict.fromkeys(labels)))}")
    pulses = pulse_channels(overview)
    analogs = [one for one in overview.channels if one.kind == "analog"]
    for column, channel in pulses.items():
        by_name = likely_level(channel) == column
        why = "guessed from its name" if by_name else "a guess: it is a train of pulses"
        guess = Guess(column, is_sure=True, why=why)
        source.entries.append(entry_of(0, with_number(channel, analogs), guess))
    for number, channel in enumerate(analogs, start=1):
        if not channel.group and not any(channel is pulse for pulse in pulses.values()):
            addressed = with_number(channel, analogs)
            label = Guess(why=channel.key if addressed is not channel else "")
            entry = entry_of(number, addressed, label)
            entry.is_comment = True
            source.entries.append(entry)
    of_plates = [one.group for one in analogs if one.group]
    if of_plates:
        plates = ", ".join(dict.fromkeys(of_plates))
        source.notes.append(f"{len(of_plates)} more are read as {plates}")
    outputs = [json.dumps(one.key) for one in overview.channels if one.kind == "model output"]
    if outputs:
        source.notes.append(f"outputs: of the labels {listing(outputs, MOST_LISTED)}")


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
        alike = [one for one in analogs if likely_level(one) == column]
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
    level = channel.readings
    swing = float(np.ptp(level)) if level.size else 0.0
    if not swing or channel.base[1] != dimension("V"):
        return False
    middle = float(level.min()) + 0.5 * swing
    is_between = np.abs(level - middle) < BETWEEN_LEVELS * swing
    if np.mean(is_between) > MOST_BETWEEN:
        return False
    edges, _, _ = find_edges(np.arange(level.size, dtype=np.float64), level)
    return edges.size >= MINIMUM_EDGES


def add_signals(source: DraftedSource, log: DraftedLog) -> None:
    """An entry for every channel of a log but the clock.

    It has a column's name if only this channel is like the column and nothing leaves a doubt. The
    user names the others, such as those that may be a command or another joint's angle. A channel
    like no column is a comment, if another channel is like one; so is, once angle and torque are
    known, a doubtful one, and one without a stated unit.
    """
    source.questions += timing_remarks(source, log)
    source.questions += [
        f"give each signal that you need its canonical name instead of NAME_n, state what is"
        f" {UNKNOWN}, delete the rest",
        f"canonical names: {', '.join(column for column in COLUMNS if column != 'time')}",
    ]
    sure = {guess.column for guess in log.guesses if guess.is_sure}
    of_actuator = {"torque_m", "current"} <= sure and bool(sure & {"theta_m", "omega_m"})
    is_complete = {"theta", "torque"} <= sure or of_actuator
    has_likely = any(guess.column for guess in log.guesses)
    left_out: dict[str, list[str]] = {}
    for number, (channel, guess) in enumerate(zip(log.signals, log.guesses, strict=True), start=1):
        if guess.is_no_signal:
            left_out.setdefault(guess.why, []).append(json.dumps(channel.key))
            continue
        entry = entry_of(number, channel, guess)
        has_unit = is_unit(channel.unit or channel.likely_unit)
        stands = guess.is_sure and (has_unit or guess.column in NAMED_ALWAYS)
        is_asked = bool(guess.column) and not is_complete
        entry.is_comment = has_likely and not stands and not is_asked
        source.entries.append(entry)
    for why, names in left_out.items():
        source.notes.append(f"left out, {why}: {listing(names, MOST_LISTED)}")


def timing_remarks(source: DraftedSource, log: DraftedLog) -> Iterator[str]:
    """What is to be checked of the time."""
    time: Any = source.settings.get("time", {})
    if NAME_OF_TIME in time.values():
        yield "time: name its column and unit, or state the rate of the rows, as {rate: HZ}"
    if log.clock and log.clock.likely_unit and not log.clock.unit:
        yield "time: its unit is guessed from its name or from the rate of its readings: check it"


def entry_of(number: int, channel: RecordedChannel, guess: Guess) -> Entry:
    """The entry of a channel by what it may be, with the column's name where that is sure."""
    stated = channel.unit or channel.likely_unit
    is_count = channel.base[1] in (COUNTS if guess.column else COUNTS[:1])
    unit = stated
    if is_count or stated.lower() in GON:
        unit = "V" if guess.column in LEVELS else UNKNOWN
    remarks: list[str] = []
    if guess.column and not guess.is_sure:
        remarks.append(f"{guess.column}?")
    if guess.why:
        remarks.append(guess.why)
    if channel.unit and unit == UNKNOWN:
        remarks.append(f"no known unit: {json.dumps(channel.unit)}")
    if channel.likely_unit and not channel.unit:
        remarks.append("the unit is guessed: check it")
    if guess.is_sure and unit == UNKNOWN and not stated:
        remarks.append("no unit is stated")
    fields: dict[str, object] = {**channel.address, "unit": unit}
    if guess.sign < 0:
        fields["sign"] = guess.sign
    if guess.wraps_at and guess.column.startswith("theta"):
        fields["wraps_at"] = guess.wraps_at
    name = guess.column if guess.is_sure else f"NAME_{number}"
    return Entry(name, fields, "; ".join(remarks))
