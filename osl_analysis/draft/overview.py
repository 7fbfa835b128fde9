"""What a recording holds, of any format: channels with ranges, rates and gaps, what is odd, and
what of a source file it tells."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
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
    values = np.ma.filled(np.ma.asarray(channel.values).astype(np.float64), np.nan)
    numbers = np.ma.compressed(channel.values).astype(np.float64)
    known = numbers[np.isfinite(numbers)]
    notes = [f"from {known.min():.6g} to {known.max():.6g}" if known.size else "no numbers"]
    if known.size < numbers.size:
        notes.append(f"{numbers.size - known.size} x NaN or infinity")
    if numbers.size < rows.count:
        notes.append(f"in {numbers.size} of {rows.count} {rows.noun}s")
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
        kind=what,
        address=channel.address,
        unit=channel.unit,
        count=int(known.size),
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
    """Show a column as the clock of its table: its rate and gaps, those of stamps in seconds."""
    known = channel.readings
    factor, base = channel.base
    is_of_time = base == dimension("s")
    if is_of_time:
        known = (known - known[:1].sum()) * factor
    rate = rate_of(known)
    note = f"a clock, {rate:g} per {'s' if is_of_time else 'unit'}" if rate else STANDS_STILL
    gaps = gaps_text(known)
    return replace(
        channel,
        unit="s" if channel.is_stamp else channel.unit,
        note=f"{note}, {gaps}" if gaps else note,
        likely_unit="" if channel.unit else likely_unit(channel.name) or time_unit(known),
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
    remarks = [*recording.loss.remarks]
    shown: list[RecordedChannel] = []
    for channel in recording.channels:
        try:
            shown.append(describe_channel(with_tick(channel, recording), address_key(recording)))
        except InputError as error:
            remarks.append(str(error))
    part, settings, questions = drafted_part(recording)
    drafted = [one for one in shown if is_of_part(one, part, shown)]
    questions = [*recording.questions, *repeated_headers(shown), *questions]
    timing, clock, asked = timing_of(recording, drafted, part or "")
    questions += asked
    if clock is not None and clock.numbers is not None:
        length = len(clock.numbers)
        untimed = [one for one in drafted if one.numbers is None or len(one.numbers) != length]
        drafted = [one for one in drafted if one not in untimed]
        if untimed:
            names = ", ".join(printable(one.key) for one in untimed)
            questions.append(
                f"{names}: of another length than the clock; interpolate them to its times, or"
                " leave them out"
            )
        shown = [as_clock(one) if one is clock else one for one in shown]
        drafted = [as_clock(one) if one is clock else one for one in drafted]
    settings = {
        "clock": "master",
        **recording.settings,
        **settings,
        **layout_of(recording, shown),
        **timing,
    }
    guessed = [one for one in shown if one.likely_unit and one.count]
    if guessed:
        units = ", ".join(f"{one.key} [{one.likely_unit}]" for one in guessed)
        remarks.append(f"units guessed from the names, to be checked: {units}")
    is_all = not part and len(drafted) == len(shown)
    return Overview(
        recording.format,
        facts_of(recording),
        shown,
        remarks,
        settings,
        None if is_all else [within_part(one, part or "") for one in drafted],
        questions,
    )


def is_of_part(
    channel: RecordedChannel, part: str | None, channels: Sequence[RecordedChannel]
) -> bool:
    """Whether a channel is of the part that is drafted, if a file has parts, and not itself a part
    of a stamp."""
    stamps = [one.key for one in channels if one.is_stamp]
    is_in_stamp = any(channel.key.startswith(f"{key}.") for key in stamps)
    return part in (None, channel.group) and not is_in_stamp


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


def drafted_part(recording: Recording) -> tuple[str | None, dict[str, object], list[str]]:
    """The part of a file that a draft describes: of parts that hold the same signals one, of others
    the one with most; None where a file has no parts. And what of a source file that tells, and
    questions."""
    if "log_part" not in source_model(recording).model_fields:
        return None, {}, []
    parts: dict[str, dict[str, Channel]] = {}
    for channel in recording.channels:
        if channel.rows.count >= FEWEST_READINGS:
            parts.setdefault(channel.rows.name, {})[channel.name or channel.key] = channel
    groups: dict[tuple[str, ...], list[str]] = {}
    for name, channels in parts.items():
        groups.setdefault(tuple(channels), []).append(name)
    if len(parts) < 2:
        part = next(iter(parts), "")
        return (part if part else None), ({"log_part": part} if part else {}), []
    alike = max(groups.values(), key=lambda names: sum(len(parts[name]) for name in names))
    questions: list[str] = []
    settings: dict[str, object] = {}
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
    return alike[0], settings, questions


def within_part(channel: RecordedChannel, part: str) -> RecordedChannel:
    """The channel, called as within a part of the file."""
    ((key, name),) = channel.address.items()
    return replace(channel, address={key: name.removeprefix(part).removeprefix(".")})


def timing_of(
    recording: Recording, drafted: Sequence[RecordedChannel], part: str
) -> tuple[dict[str, object], RecordedChannel | None, list[str]]:
    """The field `time` of a draft, its channel, and questions."""
    if drafted and all(one.times is not None for one in drafted):
        return {}, None, []
    numbered = [one for one in drafted if one.count]
    rises = [one for one in numbered if ticks(np.asarray(one.numbers), one.unit)]
    if not rises and not any(one.is_stamp or is_like_clock(one.name) for one in numbered):
        rate, questions = rate_in_words(recording.notes)
        if rate is not None:
            return {"time": {"rate": rate}}, None, questions
    else:
        questions = []
    choice = choose_clock(numbered)
    questions += choice.questions
    clock = choice.channel
    what = address_key(recording)
    if clock is None:
        return {"time": {what: NAME_OF_TIME, "unit": UNKNOWN}}, None, questions
    address = within_part(clock, part).address[what]
    if clock.is_stamp:
        return {"time": {what: address}}, clock, questions
    unit = clock.unit or as_clock(clock).likely_unit or UNKNOWN
    return {"time": {what: address, "unit": unit}}, clock, questions


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
    words: dict[str, None] = {}
    for channel in shown:
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
