"""What a recording holds, of any format: channels with ranges, rates and gaps, what is odd, and
what of a source file it tells."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis import formats
from osl_analysis.draft.clock_choice import (
    choose_clock,
    clock_unit,
    gaps_text,
    rate_in_words,
)
from osl_analysis.errors import InputError, listing, naming, printable
from osl_analysis.formats import known_formats
from osl_analysis.ingest.capture import is_labelled, vertical_axis
from osl_analysis.ingest.conversion import share_above
from osl_analysis.ingest.force_plates import convert_plate
from osl_analysis.ingest.likely_clock import (
    is_like_clock,
    likely_unit,
    rate_of,
    ticks,
)
from osl_analysis.ingest.placeholders import NAME_OF_TIME, UNKNOWN
from osl_analysis.measured import LARGEST_SIGNAL
from osl_analysis.recording import Channel, End, Kind, Plate, Recording
from osl_analysis.source_file import MarkerSource, Source
from osl_analysis.trial import Array, plate_columns
from osl_analysis.units import base_units, dimension, is_clock, normalised

SECOND_NS = 1_000_000_000
MOST_COLUMNS = 6  # of a matrix that are listed one by one
MOST_NOTES = 20  # lines of a file's own text that are shown
MOST_WORDS = 5  # words in place of numbers that are shown of a channel
RARE_WORD = 0.01  # share of the rows in which a word may stand for a failed reading
FEWEST_READINGS = 10  # a variable with fewer numbers is no signal
Y_UP = ["x", "-z", "y"]  # `axes` where y points up
# written as no table is read, unlike Windows' `1.#QNAN`
OTHER_NUMBER = re.compile(r"[+-]?\d[^#]*$")
# what a text says of a counter without a unit
TICK = re.compile(r"(?i)\bticks?\b\D*(\d+) ?([nuµm]?s)\b")


@dataclass(frozen=True)
class RecordedChannel:
    """One channel as a user is shown it.

    Attributes
    ----------
    kind
        `marker`, `model output`, `analog`, `plate`, `clock`, or how a source file names it:
        `column`, `field`, `variable`, `channel`.
    address
        How a source file names it: `topic` and `field`, `column`, `channel`, `label` ...
    unit
        As the file spells it; empty where it gives none.
    rate
        Median rate [Hz]; None where nothing tells it.
    type
        Type of the numbers and length of the array that they stand in, such as `float64[4]`.
    likely_unit
        What its name or its readings tell of its unit; a guess, for the user to check.
    numbers
        Readings (n,), positions (n, 3), size of a force (n,) [N].
    times
        Of its readings (n,) [s]; None: those of the rows.
    name
        Without its place, as a table's column may tell a clock or a unit by it.
    group
        What it is a part of: a topic, a struct.
    corners
        Of a plate (4, 3), in the unit of the markers.
    words
        Texts in place of numbers, and how often each stands there.
    """

    kind: str
    address: Mapping[str, str]
    unit: str = ""
    count: int = 0
    rate: float | None = None
    note: str = ""
    type: str = ""
    likely_unit: str = ""
    numbers: Array | None = field(default=None, compare=False, repr=False)
    times: Array | None = field(default=None, compare=False, repr=False)
    name: str = ""
    group: str = ""
    corners: Array | None = field(default=None, compare=False, repr=False)
    words: Mapping[str, int] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """What a source file calls it."""
        return next(iter(self.address.values()))

    @property
    def readings(self) -> Array:
        """The readings (n,) that are numbers of a sensor, in the channel's unit; none where they
        were not read."""
        if self.numbers is None:
            return np.empty(0)
        return self.numbers[np.abs(self.numbers) < LARGEST_SIGNAL]

    @property
    def base(self) -> tuple[float, str]:
        """Factor of the stated or likely unit to base units, and these; 0 and empty if unknown."""
        return base_units(normalised(self.unit or self.likely_unit)) or (0.0, "")

    @property
    def matrix(self) -> str:
        """The matrix of which it may be a column or a row, as of `data(:,3)` and `data 3`; empty if
        it is none."""
        found = re.fullmatch(r"(.+?)(?:\((?::,\d+|\d+,:)\)| \d+)", self.key)
        return found[1] if found else ""


@dataclass(frozen=True)
class Overview:
    """What a recording holds.

    Attributes
    ----------
    format
        The format's name in source files.
    facts
        About the whole file.
    channels
        What it recorded, in the order of the file.
    remarks
        Damage and oddities, a sentence each.
    settings
        Fields of a source file that the file tells.
    drafted
        The channels of the draft, where it has one trial of several.
    open
        What the user decides, as which of its clocks counts, a sentence each.
    """

    format: str
    facts: Mapping[str, str]
    channels: Sequence[RecordedChannel]
    remarks: Sequence[str] = ()
    settings: Mapping[str, object] = field(default_factory=dict)
    drafted: Sequence[RecordedChannel] | None = None
    open: Sequence[str] = ()


@np.errstate(all="ignore")  # values of a damaged file may be of any size
def inspect_recording(path: Path) -> Overview:
    """List what a file holds, without a source file. Raises InputError, which names the file."""
    recording = formats.read(path)
    with naming(path):
        if issubclass(source_model(recording), MarkerSource):
            return overview_of_capture(recording)
        if any("topic" in channel.address for channel in recording.channels):
            return overview_of_messages(recording)
        if recording.loss.by_topic:
            return overview_of_messages(recording)
        return overview_of_table(recording)


def source_model(recording: Recording) -> type[Source]:
    """The model of the source files of a recording."""
    model: type[Source] = known_formats()[recording.format].source
    return model


def describe_channel(channel: Channel, what: str) -> RecordedChannel:
    """Show a channel of a log with range, missing readings and rate.

    Raises
    ------
    InputError
        Its readings are no numbers.
    """
    rows = channel.rows
    values = channel.values
    numbers = np.ma.compressed(values).astype(np.float64)
    known = numbers[np.isfinite(numbers)]
    notes = [f"from {known.min():.6g} to {known.max():.6g}" if known.size else "no numbers"]
    if known.size < numbers.size:
        notes.append(f"{numbers.size - known.size} x NaN or infinity")
    if numbers.size < rows.count:
        notes.append(f"in {numbers.size} of {rows.count} {rows.noun}s")
    words = Counter(channel.count_words() if channel.count_words else {})
    notes += [f"{count} x '{word}'" for word, count in words.most_common(MOST_WORDS)]
    filled = np.ma.filled(np.ma.asarray(values).astype(np.float64), np.nan)
    times = None
    rate = rows.rate_hz
    if rows.stamps_ns is not None:
        times = rows.stamps_ns / SECOND_NS
        since_start = (rows.stamps_ns - rows.stamps_ns[:1].sum()) / SECOND_NS
        rate = rate_of(since_start)
        gaps = gaps_text(since_start)
        notes = [gaps] if gaps else notes
    elif rows.rate_hz:
        times = rows.start_s + np.arange(rows.count) / rows.rate_hz
    unit = channel.unit
    name = channel.name or channel.key
    return RecordedChannel(
        kind=what,
        address=channel.address,
        unit=unit,
        count=int(known.size),
        rate=rate,
        note=", ".join(notes),
        type=channel.type,
        likely_unit="" if unit else channel.likely_unit or likely_unit(name),
        numbers=filled,
        times=times,
        name=name,
        group=rows.name,
        words=words,
    )


def describe_positions(channel: Channel) -> RecordedChannel:
    """Show a marker or a model output with the share of frames in which it is missing."""
    values = channel.values
    seen = ~np.isnan(values).any(axis=1)
    missing = 1.0 - float(seen.mean()) if seen.size else 0.0
    return RecordedChannel(
        kind=str(channel.kind),
        address=channel.address,
        unit=channel.unit,
        count=int(seen.sum()),
        rate=channel.rows.rate_hz,
        note=f"missing in {missing:.1%} of the frames" if missing else "",
        numbers=values,
        name=channel.name or channel.key,
    )


def as_clock(channel: RecordedChannel) -> RecordedChannel:
    """Show a column as the clock of its table: its rate and gaps."""
    assert channel.numbers is not None
    known = channel.numbers[np.isfinite(channel.numbers)]
    unit = base_units(normalised(channel.unit))
    if unit is not None and unit[1] == dimension("s"):
        known = (known - known[:1].sum()) * unit[0]
    rate = rate_of(known)
    per = "unit" if unit is None else "s"
    note = f"a clock, {rate:g} per {per}" if rate else "a clock that stands still"
    gaps = gaps_text(known)
    if gaps:
        note = f"{note}, {gaps}"
    likely_unit = "" if channel.unit else clock_unit(channel.name, known)
    return replace(channel, note=note, likely_unit=likely_unit)


def facts_of(recording: Recording) -> dict[str, str]:
    """The facts on a recording, in words."""
    facts = {name.replace("_", " "): str(value) for name, value in recording.facts.items()}
    if recording.loss.checksums:
        facts["checksums"] = recording.loss.checksums
    if recording.loss.by_topic:
        lost = recording.loss.lost
        facts["messages lost"] = "the file does not tell" if lost is None else str(lost)
    if recording.loss.end == End.UNKNOWN:
        facts["end"] = "unknown: the file does not tell whether rows are missing there"
    for number, text in enumerate(recording.notes[:MOST_NOTES], start=1):
        facts[f"comment {number}"] = text
    return facts


def overview_of_capture(recording: Recording) -> Overview:
    """List markers, model outputs, analog channels and plates."""
    plate_of = {
        id(channel): f"plate {plate.number}"
        for plate in recording.plates
        for channel in plate.channels
    }
    channels: list[RecordedChannel] = []
    for channel in recording.channels:
        if channel.kind in (Kind.MARKER, Kind.MODEL_OUTPUT):
            channels.append(describe_positions(channel))
        else:
            described = describe_channel(channel, "analog")
            channels.append(replace(described, group=plate_of.get(id(channel), "")))
    channels += [describe_plate(plate) for plate in recording.plates]
    settings = dict(recording.settings)
    markers = [one for one in recording.channels if one.kind == Kind.MARKER]
    is_told = bool(recording.facts.get("vertical_on_screen"))
    if not is_told and vertical_axis(markers, recording.plates) == "y":
        settings["axes"] = Y_UP
    return Overview(
        format=recording.format,
        facts=facts_of(recording),
        channels=channels,
        remarks=recording.loss.remarks,
        settings=settings,
        open=[*recording.questions, *repeated_markers(markers)],
    )


def repeated_markers(markers: Sequence[Channel]) -> Iterator[str]:
    """Ask which of the markers with one name is read."""
    counts = Counter(marker.name for marker in markers if is_labelled(marker.key))
    repeated = [name for name, count in counts.items() if count > 1]
    if repeated:
        yield (
            f"several markers are called {listing(repeated)}: list those to read under `markers` in"
            " the source file, and these by full label or number"
        )


def describe_plate(plate: Plate) -> RecordedChannel:
    """Show a plate with its type, its channels, and its force [N], as far as they can be known."""
    names = ", ".join(channel.name or channel.key for channel in plate.channels)
    note = f"type {plate.type}, {names}"
    size = None
    try:
        load = convert_plate(plate, Source(format="any"), np.eye(3))
    except InputError as error:
        note = f"{note}: {error}"
    else:
        force = [load.columns[name] for name in plate_columns(plate.number, "force")]
        size = np.linalg.norm(force, axis=0)
        note = f"{note}, force changes by {float(np.ptp(size)):.0f} N"
    return RecordedChannel(
        kind="plate",
        address={"plate": str(plate.number)},
        note=note,
        numbers=size,
        corners=plate.corners,
    )


def overview_of_messages(recording: Recording) -> Overview:
    """List the numbers of every topic, one by one as a source file names them; the topic alone
    where there are none."""
    channels: list[RecordedChannel] = []
    has_stamp = False
    shown = set[str]()
    for channel in recording.channels:
        if channel.kind == Kind.CLOCK:
            has_stamp = True
        elif not channel.address["field"].startswith("header."):  # no signal is in it
            channels.append(describe_channel(channel, "field"))
            shown.add(channel.address["topic"])
    for topic, (count, _) in recording.loss.by_topic.items():
        if topic not in shown:
            note = "" if count else "empty"
            channels.append(RecordedChannel("topic", {"topic": topic}, count=count, note=note))
    settings = {"clock": "master", "time": {"source": "header" if has_stamp else "log"}}
    return Overview(
        recording.format,
        facts_of(recording),
        channels,
        recording.loss.remarks,
        {**settings, **recording.settings},
    )


def overview_of_table(recording: Recording) -> Overview:
    """List the columns of a table, with the likely clock among those that a draft has, and what is
    guessed."""
    what = address_key(recording)
    remarks = [*recording.loss.remarks]
    shown: dict[int, RecordedChannel] = {}
    for channel in recording.channels:
        try:
            shown[id(channel)] = describe_channel(with_tick(channel, recording), what)
        except InputError as error:
            remarks.append(str(error))
    offered, part, settings, questions = drafted_part(recording)
    stamps = [one.key for one in recording.channels if one.kind == Kind.CLOCK]
    offered = [
        channel
        for channel in offered
        if id(channel) in shown and not any(channel.key.startswith(f"{key}.") for key in stamps)
    ]
    drafted = [within_part(shown[id(channel)], part) for channel in offered]
    timing, clock, asked = timing_of(recording, offered, drafted, what)
    if clock is not None:
        lengths = {id(shown): own.rows.count for own, shown in zip(offered, drafted, strict=True)}
        untimed = [one for one in drafted if lengths[id(one)] != lengths[id(clock)]]
        drafted = [one for one in drafted if lengths[id(one)] == lengths[id(clock)]]
        if untimed:
            names = ", ".join(printable(one.key) for one in untimed)
            asked.append(
                f"{names}: of another length than the clock; interpolate them to its times, or"
                " leave them out"
            )
    questions = [*recording.questions, *repeated_headers(shown.values()), *questions, *asked]
    settings = {
        "clock": "master",
        **recording.settings,
        **settings,
        **layout_of(recording, shown),
        **timing,
    }
    if clock is not None:
        drafted = [as_clock(one) if one is clock else one for one in drafted]
        for key, one in shown.items():
            if one.key.endswith(clock.key) and one.numbers is clock.numbers:
                shown[key] = as_clock(one)
    guessed = [one for one in shown.values() if one.likely_unit and one.count]
    if guessed:
        units = ", ".join(f"{one.key} [{one.likely_unit}]" for one in guessed)
        remarks.append(f"units guessed from the names, to be checked: {units}")
    return Overview(
        recording.format,
        facts_of(recording),
        list(shown.values()),
        remarks,
        settings,
        drafted if part or len(drafted) < len(shown) else None,
        questions,
    )


def address_key(recording: Recording) -> str:
    """The key by which a source file of the format names a channel, as `column`."""
    time = source_model(recording).model_fields["time"].annotation
    return str(getattr(time, "ADDRESS", "")) or "column"


def with_tick(channel: Channel, recording: Recording) -> Channel:
    """The channel with the unit of a counter, where the file's text tells it, as `tick of 10
    us`."""
    if channel.unit:
        return channel
    for text in recording.notes:
        told = TICK.search(text)
        if told is None:
            continue
        unit = f"{told[1]} {told[2]}"
        values = np.ma.getdata(channel.values)
        if values.ndim == 1 and values.dtype.kind in "iuf" and ticks(values, unit):
            return replace(channel, unit=unit)
    return channel


def repeated_headers(channels: Iterable[RecordedChannel]) -> Iterator[str]:
    """Say where the header stands again among the rows."""
    for channel in channels:
        if has_title(channel):
            yield (
                "the header stands again among the rows, as where a recorder begins anew: cut the"
                " file in two, a log each"
            )
            return


def has_title(channel: RecordedChannel) -> bool:
    """Whether the title of a channel, with or without its unit, is among its words."""
    name = channel.name
    return any(word == name or word.startswith(f"{name} ") for word in channel.words)


def drafted_part(
    recording: Recording,
) -> tuple[list[Channel], str, dict[str, object], list[str]]:
    """The channels of a draft, which is of one part, and that part: of parts that hold the same
    signals one, of others the one with most; what of a source file that tells; and questions."""
    parts: dict[str, dict[str, Channel]] = {}
    settings: dict[str, object]
    for channel in recording.channels:
        if channel.rows.count >= FEWEST_READINGS:
            parts.setdefault(channel.rows.name, {})[channel.name or channel.key] = channel
    if len(parts) < 2 or "log_part" not in source_model(recording).model_fields:
        part = next(iter(parts), "") if "log_part" in source_model(recording).model_fields else ""
        settings = {"log_part": part} if part else {}
        return list(recording.channels), part, settings, []
    groups: dict[tuple[str, ...], list[str]] = {}
    for part, own in parts.items():
        groups.setdefault(tuple(own), []).append(part)
    alike = max(groups.values(), key=lambda names: sum(len(parts[name]) for name in names))
    chosen = list(parts[alike[0]].values())
    settings = {}
    questions: list[str] = []
    if len(alike) > 1:
        questions.append(
            f"{len(alike)} parts hold the same variables: name one per trial in the column"
            f" `log_part` of the sheet: {', '.join(alike)}"
        )
    elif alike[0]:
        settings["log_part"] = alike[0]
    others = [part for part in parts if part not in alike]
    if others:
        address = list(parts[others[0]].values())[-1].key
        questions.append(
            "a draft is of one part; to read a variable of another, write its address with `/`, as"
            f" `/{address.removeprefix('/')}`"
        )
    return chosen, alike[0], settings, questions


def within_part(channel: RecordedChannel, part: str) -> RecordedChannel:
    """The channel, called as within a part of the file."""
    key = next(iter(channel.address))
    name = channel.address[key]
    if not part or not name.startswith(part):
        return channel
    return replace(channel, address={key: name.removeprefix(part).removeprefix(".")})


def timing_of(
    recording: Recording,
    offered: Sequence[Channel],
    drafted: Sequence[RecordedChannel],
    what: str,
) -> tuple[dict[str, object], RecordedChannel | None, list[str]]:
    """The field `time` of a draft, its channel, and questions."""
    if offered and all(one.rows.rate_hz is not None for one in offered):
        return {}, None, []
    stamps = [
        shown
        for channel, shown in zip(offered, drafted, strict=True)
        if channel.kind == Kind.CLOCK and shown.count
    ]
    numbered = [one for one in drafted if one.count]
    named = [one for one in stamps if is_clock(one.name)]
    if len(stamps) == 1 and not any(is_clock(one.name) for one in numbered if one is not stamps[0]):
        named = stamps
    questions: list[str] = []
    has_clock = any(
        is_like_clock(one.name) or ticks(np.asarray(one.numbers), one.unit) for one in numbered
    )
    if not has_clock and not named:
        rate, questions = rate_in_words(recording.notes)
        if rate is not None:
            return {"time": {"rate": rate}}, None, questions
    choice = choose_clock(
        {one.key: np.asarray(one.numbers) for one in numbered},
        {one.key: one.name for one in numbered},
        {one.key: one.unit for one in numbered},
        f"{what}s",
        [one.key for one in named[:1]],
    )
    questions += choice.questions
    clock = next((one for one in numbered if one.key == choice.key), None)
    if clock is None:
        return {"time": {what: NAME_OF_TIME, "unit": UNKNOWN}}, None, questions
    if any(clock is one for one in stamps):
        return {"time": {what: clock.address[what]}}, clock, questions
    unit = clock.unit or as_clock(clock).likely_unit or UNKNOWN
    return {"time": {what: clock.address[what], "unit": unit}}, clock, questions


def layout_of(recording: Recording, shown: Mapping[int, RecordedChannel]) -> dict[str, object]:
    """What of a source file the rows of a table tell: words for failed readings, rows that do not
    fit."""
    fields = source_model(recording).model_fields
    settings: dict[str, object] = {}
    lost = recording.loss.lost
    if lost and recording.loss.end != End.MISSING:
        if "ragged" in fields:
            settings["ragged"] = "skip"
        settings["most_missing"] = share_above(lost, recording.loss.expected or 1)
    if "missing" not in fields or "more" in str(recording.facts.get("rows", "")):
        return settings
    words: dict[str, None] = {}
    for channel in shown.values():
        if has_title(channel):
            return settings
        total = channel.count + sum(channel.words.values())
        for word, count in channel.words.items():
            if count < RARE_WORD * total and not OTHER_NUMBER.match(word):
                words[word] = None
    known: Any = fields["missing"].default
    if any(word not in known for word in words):
        settings["missing"] = list(dict.fromkeys([*known, *words]))
    return settings
