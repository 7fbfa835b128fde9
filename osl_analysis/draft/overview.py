"""What a recording holds, of any format: channels with ranges, rates and gaps, what is odd, and
what of a source file it tells."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis import formats
from osl_analysis.draft.clock_choice import choose_clock, gaps_text, rate_in_words
from osl_analysis.draft.recorded_channel import Overview, RecordedChannel
from osl_analysis.errors import InputError, listing, naming, printable
from osl_analysis.formats import known_formats
from osl_analysis.ingest.capture import is_labelled, vertical_axis
from osl_analysis.ingest.conversion import share_above
from osl_analysis.ingest.force_plates import convert_plate
from osl_analysis.ingest.likely_clock import is_like_clock, likely_unit, rate_of, ticks, time_unit
from osl_analysis.ingest.placeholders import NAME_OF_TIME, UNKNOWN
from osl_analysis.recording import Channel, End, Kind, Plate, Recording
from osl_analysis.source_file import MarkerSource, Source
from osl_analysis.trial import plate_columns
from osl_analysis.units import dimension

SECOND_NS = 1_000_000_000
MOST_COLUMNS = 6  # of a matrix that are listed one by one
MOST_NOTES = 20  # lines of a file's own text that are shown
MOST_WORDS = 5  # words in place of numbers that are shown of a channel
RARE_WORD = 0.01  # share of the rows in which a word may stand for a failed reading
FEWEST_READINGS = 10  # a variable with fewer numbers is no signal
STANDS_STILL = "a clock that stands still"
Y_UP = ["x", "-z", "y"]  # `axes` where y points up
# written as no table is read, unlike Windows' `1.#QNAN`
OTHER_NUMBER = re.compile(r"[+-]?\d[^#]*$")
# what a text says of a counter without a unit
TICK = re.compile(r"(?i)\bticks?\b\D*(\d+) ?([nuµm]?s)\b")


@np.errstate(all="ignore")  # values of a damaged file may be of any size
def inspect_recording(path: Path) -> Overview:
    """List what a file holds, without a source file. Raises InputError, which names the file."""
    recording = formats.read(path)
    with naming(path):
        if issubclass(source_model(recording), MarkerSource):
            return overview_of_capture(recording)
        has_topics = any("topic" in channel.address for channel in recording.channels)
        if has_topics or recording.loss.by_topic:
            return overview_of_messages(recording)
        return overview_of_table(recording)


def source_model(recording: Recording) -> type[Source]:
    """The model of the source files of a recording."""
    model: type[Source] = known_formats()[recording.format].source
    return model


def describe_channel(channel: Channel, kind: str) -> RecordedChannel:
    """Show a channel of a log with range, missing readings and rate.

    Raises
    ------
    InputError
        Its readings are no numbers.
    """
    rows = channel.rows
    values = np.ma.filled(np.ma.asarray(channel.values).astype(np.float64), np.nan)
    finite = values[np.isfinite(values)]
    read = int(np.ma.count(channel.values))
    notes = [f"from {finite.min():.6g} to {finite.max():.6g}" if finite.size else "no numbers"]
    if finite.size < read:
        notes.append(f"{read - finite.size} x NaN or infinity")
    if read < rows.count:
        notes.append(f"in {read} of {rows.count} {rows.noun}s")
    words = Counter(channel.count_words() if channel.count_words else {})
    notes += [f"{count} x '{word}'" for word, count in words.most_common(MOST_WORDS)]
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
    name = channel.name or channel.key
    return RecordedChannel(
        kind=kind,
        address=channel.address,
        unit=channel.unit,
        count=int(finite.size),
        rate=rate,
        note=", ".join(notes),
        type=channel.type,
        likely_unit="" if channel.unit else channel.likely_unit or likely_unit(name),
        numbers=values,
        times=times,
        name=name,
        group=rows.name,
        words=words,
        is_stamp=channel.kind == Kind.CLOCK,
    )


def describe_positions(channel: Channel) -> RecordedChannel:
    """Show a marker or a model output with the share of frames in which it is missing."""
    values = channel.values
    is_seen = ~np.isnan(values).any(axis=1)
    missing = 1.0 - float(is_seen.mean()) if is_seen.size else 0.0
    return RecordedChannel(
        kind=str(channel.kind),
        address=channel.address,
        unit=channel.unit,
        count=int(is_seen.sum()),
        rate=channel.rows.rate_hz,
        note=f"missing in {missing:.1%} of the frames" if missing else "",
        numbers=values,
        name=channel.name or channel.key,
    )


def as_clock(channel: RecordedChannel) -> RecordedChannel:
    """Show a column as the clock of its table: its rate and gaps; that of stamps in seconds."""
    readings = channel.readings
    factor, base = channel.base
    is_of_time = base == dimension("s")
    if is_of_time:
        readings = (readings - readings[:1].sum()) * factor
    rate = rate_of(readings)
    note = f"a clock, {rate:g} per {'s' if is_of_time else 'unit'}" if rate else STANDS_STILL
    gaps = gaps_text(readings)
    if channel.is_stamp:
        channel = replace(channel, unit="s", numbers=channel.numbers * factor)
    return replace(
        channel,
        note=f"{note}, {gaps}" if gaps else note,
        likely_unit="" if channel.unit else likely_unit(channel.name) or time_unit(readings),
    )


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
            analog = describe_channel(channel, "analog")
            channels.append(replace(analog, group=plate_of.get(id(channel), "")))
    channels += [describe_plate(plate) for plate in recording.plates]
    settings = dict(recording.settings)
    markers = [channel for channel in recording.channels if channel.kind == Kind.MARKER]
    is_told = bool(recording.facts.get("vertical_on_screen"))
    if not is_told and vertical_axis(markers, recording.plates) == "y":
        settings["axes"] = Y_UP
    return Overview(
        format=recording.format,
        facts=facts_of(recording),
        channels=channels,
        remarks=recording.loss.remarks,
        settings=settings,
        open=[*recording.questions, *questions_on_markers(markers)],
    )


def questions_on_markers(markers: Sequence[Channel]) -> Iterator[str]:
    """Ask for markers where there are none, and which of those with one name is read."""
    if not markers:
        yield "the file has no marker: export positions of markers or joints, not rotations alone"
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
    described = RecordedChannel("plate", {"plate": str(plate.number)}, corners=plate.corners)
    try:
        load = convert_plate(plate, Source(format="any"), np.eye(3))
    except InputError as error:
        return replace(described, note=f"{note}: {error}")
    force = [load.columns[name] for name in plate_columns(plate.number, "force")]
    size = np.linalg.norm(force, axis=0)
    note = f"{note}, force changes by {float(np.ptp(size)):.0f} N"
    return replace(described, note=note, numbers=size)


def overview_of_messages(recording: Recording) -> Overview:
    """List the numbers of every topic, one by one as a source file names them; the topic alone
    where there are none."""
    channels = [
        describe_channel(channel, "field")
        for channel in recording.channels
        if channel.kind != Kind.CLOCK
        and not channel.address["field"].startswith("header.")  # no signal is in it
    ]
    topics_shown = {channel.address["topic"] for channel in channels}
    for topic, (count, _) in recording.loss.by_topic.items():
        if topic not in topics_shown:
            note = "" if count else "empty"
            channels.append(RecordedChannel("topic", {"topic": topic}, count=count, note=note))
    has_stamp = any(channel.kind == Kind.CLOCK for channel in recording.channels)
    time = {"source": "header" if has_stamp else "log"}
    return Overview(
        recording.format,
        facts_of(recording),
        channels,
        recording.loss.remarks,
        {"clock": "master", "time": time, **recording.settings},
    )


def overview_of_table(recording: Recording) -> Overview:
    """List the columns of a table, with the likely clock among those that a draft has, and what is
    guessed."""
    remarks = [*recording.loss.remarks]
    shown: list[RecordedChannel] = []
    for channel in recording.channels:
        try:
            shown.append(describe_channel(with_tick(channel, recording), address_key(recording)))
        except InputError as error:
            remarks.append(str(error))
    questions = [*recording.questions]
    is_begun_anew = any(has_title(channel) for channel in shown)
    if is_begun_anew:
        questions.append(
            "the header stands again among the rows, as where a recorder begins anew: cut the file"
            " in two, a log each"
        )
    part, settings, of_parts = drafted_part(recording, shown)
    drafted = [within_part(channel, part) for channel in shown if is_of_part(channel, part, shown)]
    timing, clock, of_timing = timing_of(recording, drafted, shown)
    questions += [*of_parts, *of_timing]
    if clock is not None:
        signals = [channel for channel in drafted if channel.address != clock.address]
        length = clock.numbers.size
        untimed = [channel.key for channel in signals if channel.numbers.size != length]
        if untimed:
            questions.append(
                f"{', '.join(map(printable, untimed))}: of another length than the clock;"
                " interpolate them to its times, or leave them out"
            )
        drafted = [clock, *(channel for channel in signals if channel.key not in untimed)]
        shown = [
            as_clock(channel) if channel.numbers is clock.numbers else channel for channel in shown
        ]
        drafted[0] = as_clock(clock)
    guessed = [
        f"{channel.key} [{channel.likely_unit}]"
        for channel in shown
        if channel.likely_unit and channel.count
    ]
    if guessed:
        remarks.append(f"units guessed from the names, to be checked: {', '.join(guessed)}")
    return Overview(
        recording.format,
        facts_of(recording),
        shown,
        remarks,
        {
            "clock": "master",
            **recording.settings,
            **settings,
            **layout_of(recording, [] if is_begun_anew else shown),
            **timing,
        },
        drafted,
        questions,
    )


def is_of_part(
    channel: RecordedChannel, part: str | None, channels: Sequence[RecordedChannel]
) -> bool:
    """Whether a channel is of the part that is drafted, if a file has parts, and not itself a part
    of a stamp."""
    stamps = [other.key for other in channels if other.is_stamp]
    is_in_stamp = any(channel.key.startswith(f"{key}.") for key in stamps)
    return part in (None, channel.group) and not is_in_stamp


def address_key(recording: Recording) -> str:
    """The key by which a source file of the format names a channel, as `column`."""
    time = source_model(recording).model_fields["time"].annotation
    return str(getattr(time, "ADDRESS", "")) or "column"


def with_tick(channel: Channel, recording: Recording) -> Channel:
    """The channel with the unit of a counter, where the file's text tells it, as `tick of 10
    us`."""
    values = np.ma.getdata(channel.values)
    is_counter = not channel.unit and values.ndim == 1 and values.dtype.kind in "iuf"
    for text in recording.notes:
        tick = TICK.search(text)
        if tick and is_counter and ticks(values, f"{tick[1]} {tick[2]}"):
            return replace(channel, unit=f"{tick[1]} {tick[2]}")
    return channel


def has_title(channel: RecordedChannel) -> bool:
    """Whether the title of a channel, with or without its unit, is among its words."""
    name = channel.name
    return any(word == name or word.startswith(f"{name} ") for word in channel.words)


def drafted_part(
    recording: Recording, shown: Sequence[RecordedChannel]
) -> tuple[str | None, dict[str, object], list[str]]:
    """The part of a file that a draft describes: of parts that hold the same signals one, of others
    the one with most; None where a file has no parts. And what of a source file that tells, and
    questions."""
    parts: dict[str, list[str]] = {}
    if "log_part" in source_model(recording).model_fields:
        for channel in shown:
            if channel.numbers.size >= FEWEST_READINGS:
                parts.setdefault(channel.group, []).append(channel.name)
    if not parts:
        return None, {}, []
    layouts = [*parts.values()]
    largest = max(layouts, key=lambda names: len(names) * layouts.count(names))
    alike = [part for part, names in parts.items() if names == largest]
    part = alike[0]
    questions: list[str] = []
    if len(alike) > 1:
        questions.append(
            f"{len(alike)} parts hold the same variables: name one per trial in the column"
            f" `log_part` of the sheet: {', '.join(alike)}"
        )
    others = [channel.key for channel in shown if channel.group in parts.keys() - {*alike}]
    if others:
        questions.append(
            "a draft is of one part; to read a variable of another, write its address with `/`, as"
            f" `{from_root(others[-1])}`"
        )
    is_named = bool(part) and len(alike) == 1
    return part, {"log_part": part} if is_named else {}, questions


def within_part(channel: RecordedChannel, part: str | None) -> RecordedChannel:
    """The channel, called as within a part of the file."""
    name = channel.key.removeprefix(part or "").removeprefix(".") if part else channel.key
    return replace(channel, address={next(iter(channel.address)): name})


def from_root(address: str) -> str:
    """The address of a variable in the whole file, as a source file names it in any part."""
    return f"/{address.removeprefix('/')}"


def timing_of(
    recording: Recording, drafted: Sequence[RecordedChannel], shown: Sequence[RecordedChannel]
) -> tuple[dict[str, object], RecordedChannel | None, list[str]]:
    """The field `time` of a draft, its channel, and questions. Where no clock is among what is
    drafted, one that is as long in another part of the file goes before a rate in its text."""
    if drafted and all(channel.times is not None for channel in drafted):
        return {}, None, []
    what = address_key(recording)
    numbered = [channel for channel in drafted if channel.count]
    questions: list[str] = []
    if not any(may_be_clock(channel) for channel in numbered):
        lengths = {channel.numbers.size for channel in numbered}
        numbered = [
            replace(channel, address={what: from_root(channel.key)})
            for channel in shown
            if channel.numbers.size in lengths and is_like_clock(channel.name) and rises(channel)
        ]
        rate, questions = rate_in_words(recording.notes)
        if rate is not None and not numbered:
            return {"time": {"rate": rate}}, None, questions
        if numbered:
            questions = ["time is of another part of the file, which is as long: check it"]
    choice = choose_clock(numbered)
    questions += choice.questions
    clock = choice.channel
    if clock is None:
        return {"time": {what: NAME_OF_TIME, "unit": UNKNOWN}}, None, questions
    time: dict[str, object] = {what: clock.key}
    if not clock.is_stamp:
        time["unit"] = clock.unit or as_clock(clock).likely_unit or UNKNOWN
    return {"time": time}, clock, questions


def may_be_clock(channel: RecordedChannel) -> bool:
    """Whether a channel may tell the time of its rows, by its kind, its name or its readings."""
    return channel.is_stamp or is_like_clock(channel.name) or rises(channel)


def rises(channel: RecordedChannel) -> bool:
    """Whether the readings of a channel rise like a clock."""
    return ticks(channel.numbers, channel.unit)


def layout_of(recording: Recording, shown: Sequence[RecordedChannel]) -> dict[str, object]:
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
    known: Any = fields["missing"].default
    missing = list(known)
    for channel in shown:
        total = channel.count + sum(channel.words.values())
        for word, count in channel.words.items():
            is_rare = count < RARE_WORD * total and not OTHER_NUMBER.match(word)
            if is_rare and word not in missing:
                missing.append(word)
    if len(missing) > len(known):
        settings["missing"] = missing
    return settings
