"""Drafts of source files. Texts from files are quoted as JSON, which is valid YAML. What files do
not tell is left to the user, questions first."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from osl_analysis.draft.guesses import Guess, guessed_columns
from osl_analysis.draft.likelihood import COUNTS, LEVELS, likely_level, with_documented_unit
from osl_analysis.draft.recorded_channel import Overview, RecordedChannel
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
    """What the channels of a log may be, and its clock."""

    guesses: Sequence[Guess]
    clock: RecordedChannel | None

    def sure(self, column: str) -> RecordedChannel | None:
        """The channel that is surely a column, unwrapped."""
        sure = (guess.channel for guess in self.guesses if guess.is_sure and guess.column == column)
        return next(sure, None)


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

    @property
    def guess(self) -> str:
        """Its column, unit and sign, if these are a guess; else empty."""
        if "guess" not in self.remark.partition(";")[0]:
            return ""
        sign = ", sign -1: it falls as the angle rises" if "sign" in self.fields else ""
        return f"{self.name} in {self.fields['unit']}{sign}"


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
        Text of the shipped source file of the recorder, which is taken as it is.
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
            return self.known
        lines = [f"{key}: {json.dumps(value)}" for key, value in self.settings.items()]
        lines[0] = lines[0].replace('"', "")
        lines += [f"# {text}" for text in self.questions]
        if self.key == "channels" or self.entries:
            lines.append(f"{self.key}:")
        lines += [entry.line for entry in self.entries]
        lines += [f"#   {text}" for text in self.notes]
        return "\n".join([*lines, ""])

    def has(self, *columns: str) -> bool:
        """Whether all columns are named."""
        names = {entry.name for entry in self.named}
        return all(column in names or f"\n  {column}: {{" in self.known for column in columns)

    @property
    def places(self) -> list[str]:
        """The places to be edited."""
        if self.known or self.key != "channels":
            return []
        time: Any = self.settings.get("time", {})
        places = [f"time.{key}" for key, value in time.items() if value in (NAME_OF_TIME, UNKNOWN)]
        for entry in self.named:
            if entry.name.startswith("NAME_"):
                places.append(entry.name)
            elif entry.fields["unit"] == UNKNOWN:
                places.append(f"{entry.name}.unit")
        if not self.named:
            places.append("channels (none may be a signal: name them, as of the comments)")
        return places


@np.errstate(all="ignore")  # what a damaged file holds may be of any size
def drafted_log(overview: Overview) -> DraftedLog:
    """Guess what the channels of a log are."""
    time: Any = overview.settings.get("time", {})
    name = next((time[key] for key in TIME_KEYS if key in time), "")
    listed = overview.channels if overview.drafted is None else overview.drafted
    clock = next((channel for channel in listed if name and name in channel.address.values()), None)
    signals = [
        with_documented_unit(channel)
        for channel in listed
        if channel is not clock and np.isfinite(channel.numbers).any()
    ]
    return DraftedLog(guessed_columns(signals), clock)


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
    keys_of: dict[str, list[str]] = {"marker": [], "analog": [], "model output": [], "plate": []}
    for channel in overview.channels:
        if not channel.group and channel.key:
            keys_of[channel.kind].append(channel.key)
    labels = list(dict.fromkeys(keys_of["marker"]))
    source.questions.append(f"or some: markers: {json.dumps(labels)}")
    pulses = pulse_channels(overview)
    for column, channel in pulses.items():
        by_name = likely_level(channel) == column
        why = "guessed from its name" if by_name else "a guess: it is a train of pulses"
        source.entries.append(Entry(column, {**channel.address, "unit": "V"}, why))
        keys_of["analog"].remove(channel.key)
    for kind, keys in (("further analog channels", "analog"), ("outputs", "model output")):
        if keys_of[keys]:
            names = [json.dumps(key) for key in keys_of[keys]]
            source.notes.append(f"{kind}: {listing(names, MOST_LISTED)}")


def pulse_channels(overview: Overview) -> dict[str, RecordedChannel]:
    """The analog channels of a capture that are called like `sync` and `trigger`, where one alone
    is; or the only one with a train of pulses as `sync`. A label that stands twice tells none."""
    analogs = [channel for channel in overview.channels if channel.kind == "analog"]
    keys = Counter(channel.key for channel in analogs)
    pulses: dict[str, RecordedChannel] = {}
    for column in LEVELS:
        alike = [channel for channel in analogs if likely_level(channel) == column]
        if column == "sync" and len(alike) != 1:
            alike = [channel for channel in analogs if is_pulse_train(channel)]
        if len(alike) == 1 and keys[alike[0].key] == 1:
            pulses[column] = alike[0]
    return pulses


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
    time: Any = source.settings.get("time", {})
    if NAME_OF_TIME in time.values():
        source.questions.append(
            "time: name its column and unit, or state the rate of the rows, as {rate: HZ}"
        )
    elif log.clock and log.clock.likely_unit:
        source.questions.append(
            "time: its unit is guessed from its name or from the rate of its readings: check it"
        )
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
    for number, guess in enumerate(log.guesses, start=1):
        if guess.why_not:
            left_out.setdefault(guess.why_not, []).append(json.dumps(guess.channel.key))
            continue
        entry = entry_of(number, guess)
        has_unit = is_unit(guess.channel.unit or guess.channel.likely_unit)
        stands = guess.is_sure and (has_unit or guess.column in NAMED_ALWAYS)
        is_asked = bool(guess.column) and not is_complete
        entry.is_comment = has_likely and not stands and not is_asked
        source.entries.append(entry)
    for why, names in left_out.items():
        source.notes.append(f"left out, {why}: {listing(names, MOST_LISTED)}")


def entry_of(number: int, guess: Guess) -> Entry:
    """The entry of a channel by what it may be, with the column's name where that is sure."""
    channel = guess.channel
    unit = channel.unit or channel.likely_unit
    remarks = [guess.why if guess.is_sure else f"{guess.column}?"] if guess.column else []
    if channel.base[1] in (COUNTS if guess.column else COUNTS[:1]) or unit.lower() in GON:
        remarks.append(f"no known unit: {json.dumps(unit)}" if unit else "no unit is stated")
        unit = "V" if guess.column in LEVELS else UNKNOWN
    elif not channel.unit:
        remarks.append("the unit is guessed: check it")
    fields: dict[str, object] = {**channel.address, "unit": unit}
    if guess.sign < 0:
        fields["sign"] = guess.sign
    if guess.wraps_at and guess.column.startswith("theta"):
        fields["wraps_at"] = guess.wraps_at
    name = guess.column if guess.is_sure else f"NAME_{number}"
    return Entry(name, fields, "; ".join(remarks))
