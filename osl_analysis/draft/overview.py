# SPDX-License-Identifier: Apache-2.0
"""Show what a recording of any format holds: channels with ranges, rates and gaps, and oddities.

It also drafts the settings of a source file that the recording itself states, as its time.
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from osl_analysis import formats
from osl_analysis.base.errors import InputError, listing, naming, printable, shortened
from osl_analysis.base.measured import usual_step
from osl_analysis.base.recording import SECOND_NS, Channel, Kind, Recording
from osl_analysis.base.source_file import MarkerSource
from osl_analysis.base.trial import Array
from osl_analysis.base.units import is_clock
from osl_analysis.base.yaml_settings import NAME_OF_TIME, UNKNOWN
from osl_analysis.draft.recorded_channel import Overview, RecordedChannel, likely_unit
from osl_analysis.formats import known_formats
from osl_analysis.ingest.capture import is_labelled, vertical_axis
from osl_analysis.ingest.conversion import floats_of
from osl_analysis.ingest.likely_clock import (
    CLOCK,
    beginnings,
    begins_anew,
    is_time_unit,
    looks_like_time,
    rate_of,
    span_ratio,
    stated_rate,
    ticks,
    time_unit,
    unwrapped,
)
from osl_analysis.ingest.quality import GAPS

MOST_NOTES = 20  # lines of a file's own text that are shown
MOST_BACK = 0.1  # share of the steps of a clock that may go back
# what a text says of a counter without a unit
INTERVALS = r"(?i)interval|^[dΔ∆]_?t|delta|period|since|elapsed"  # in the name of a column of them
GEAR = (
    r"(?i)(\bgear|transmission|reduction|getriebe|[üu]bersetzung)\D*\d"  # in a text that tells it
)
TICK = re.compile(r"(?i)\b(?:ticks?|resolution)\b\D*(\d+(?:\.\d+)?) ?([nuµm]?s)\b")


@np.errstate(all="ignore")  # values of a damaged file may be of any size
def inspect_recording(path: Path) -> Overview:
    """List what a file holds, without a source file. Raises InputError, which names the file."""
    recording = formats.read(path)
    with naming(path):
        if issubclass(known_formats()[recording.format].source, MarkerSource):
            return overview_of_capture(recording)
        return overview_of_log(recording)


def describe_channel(channel: Channel, kind: str) -> RecordedChannel:
    """Show a channel with range, missing readings, rate and gaps.

    Raises
    ------
    InputError
        Its readings are no numbers.
    """
    rows = channel.rows
    values = np.ma.asarray(channel.values)
    is_stamp = channel.kind == Kind.CLOCK
    if is_stamp:  # since the first, as a float tells days to 0.2 us alone
        values = (values - values.min()) / SECOND_NS
    numbers = floats_of(values)
    # a marker has three numbers in each row
    is_read = np.isfinite(numbers).all(axis=tuple(range(1, numbers.ndim)))
    count = int(is_read.sum())

    times = None
    rate = rows.rate_hz
    notes = []
    if rows.stamps_ns is not None:
        times = rows.stamps_ns / SECOND_NS
        rate = rate_of(rows.stamps_ns, SECOND_NS)
        notes.append(gaps_text(rows.stamps_ns / SECOND_NS))
    elif rows.rate_hz:
        times = rows.start_s + np.arange(rows.count) / rows.rate_hz
    if numbers.ndim == 1 and count:
        notes.append(f"from {numbers[is_read].min():.6g} to {numbers[is_read].max():.6g}")
    if count < rows.count:
        notes.append(f"no number in {rows.count - count} of {rows.count} {rows.noun}s")
    name = channel.name or channel.key
    unit = "s" if is_stamp else channel.unit
    return RecordedChannel(
        kind=kind,
        address=channel.address,
        unit=unit,
        count=count,
        rate=rate,
        note=", ".join(notes),
        likely_unit="" if unit else channel.likely_unit or likely_unit(name),
        numbers=numbers,
        times=times,
        name=name,
        group=rows.name,
        is_stamp=is_stamp,
    )


def facts_of(recording: Recording) -> dict[str, str]:
    """The facts on a recording, in words."""
    facts = {name.replace("_", " "): str(value) for name, value in recording.facts.items()}
    if recording.loss.by_topic:
        lost = recording.loss.lost
        facts["messages lost"] = "the file does not tell" if lost is None else str(lost)
        facts["topics"] = listing([*recording.loss.by_topic], MOST_NOTES)
    for number, text in enumerate(recording.notes[:MOST_NOTES], start=1):
        facts[f"comment {number}"] = text
    return facts


def overview_of_capture(recording: Recording) -> Overview:
    """List markers, model outputs, analog channels and plates."""
    channels = []
    for channel in recording.channels:
        kind = "analog" if channel.kind == Kind.SIGNAL else channel.kind
        channels.append(describe_channel(channel, kind))
    for plate in recording.plates:
        names = ", ".join(channel.name or channel.key for channel in plate.channels)
        note = f"type {plate.type}, {names}"
        address = {"plate": str(plate.number)}
        channels.append(RecordedChannel("plate", address, note=note, numbers=plate.corners))
    settings = dict(recording.settings)
    markers = [channel for channel in recording.channels if channel.kind == Kind.MARKER]
    up = vertical_axis(markers, recording.plates)
    if not recording.facts.get("vertical_on_screen") and up:
        settings["axes"] = ["x", "-z", "y"] if up == "y" else ["x", "y", "z"]
    return Overview(
        format=recording.format,
        facts=facts_of(recording),
        channels=channels,
        remarks=recording.loss.remarks,
        settings=settings,
        open=[*recording.questions, *questions_on_markers(markers)],
        is_capture=True,
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


def time_of_messages(recording: Recording) -> tuple[dict[str, object], list[str]]:
    """The field `time` of a draft for messages, and a question where their stamps are zero."""
    stamps = [channel for channel in recording.channels if channel.kind == Kind.CLOCK]
    zero = [channel.key for channel in stamps if not np.ma.getdata(channel.values).any()]
    source = "header" if stamps and not zero else "log"
    remark = f"stamps are zero, so that time is the recorder's: {listing(zero)}"
    return {"source": source}, [remark] if zero else []


def overview_of_log(recording: Recording) -> Overview:
    """List the columns of a table, or the numbers of every topic, and draft those of one trial with
    the likely clock."""
    model = known_formats()[recording.format].source
    key = getattr(model.model_fields["time"].annotation, "ADDRESS", "column")
    has_messages = bool(recording.loss.by_topic)
    remarks = [*recording.loss.remarks]
    shown = []
    for channel in recording.channels:
        # no signal is in the header of a message
        if has_messages and channel.address[key].startswith("header."):
            continue
        try:
            shown.append(describe_channel(channel, key))
        except InputError as error:
            remarks.append(str(error))
    for described in shown:
        if not has_messages and looks_like_time(described.name):
            readings = described.readings
            starts = beginnings(readings)
            if starts.size > 1:
                rows = recording.channels[0].rows
                remarks.append(f"{described.key}: {begins_anew(rows, starts, readings[0])}")
    settings = {"clock": "master", **recording.settings}
    drafted = [channel for channel in shown if channel.count]
    facts = facts_of(recording)
    questions = [*recording.questions]
    questions += [
        f"'{printable(shortened(text))}': state it as n_T in the file of `parameters`, so that both"
        " sides of the gear are compared"
        for text in recording.notes
        if re.search(GEAR, text)
    ]
    if "log_part" in model.model_fields:
        parts, drafted = split_parts(drafted)
        if parts:
            settings["log_part"] = parts[0]
            questions.append(
                f"{len(parts)} parts hold the same variables: name one per trial in the column"
                f" `log_part` of the sheet: {', '.join(parts)}"
            )
    clock = None
    if has_messages:
        settings["time"], questions = time_of_messages(recording)
    elif not drafted or any(channel.times is None for channel in drafted):
        settings["time"], clock, time_questions = drafted_time(recording, drafted, key)
        questions += time_questions
    if clock is not None:
        signals = [channel for channel in drafted if channel.address != clock.address]
        times = (clock.numbers - clock.numbers[:1].sum()) * clock.base[0]
        drafted = [
            replace(channel, times=times)
            for channel in signals
            if channel.numbers.size == times.size
        ]
        untimed = [channel.key for channel in signals if channel.numbers.size != times.size]
        if untimed:
            questions.append(
                f"{listing(untimed)}: of another length than the clock; state the `time` of each"
                " with it, or leave them out"
            )
        facts["clock"] = f"{clock.key}, {clock.note}"
    return Overview(recording.format, facts, shown, remarks, settings, drafted, clock, questions)


def split_parts(
    channels: Sequence[RecordedChannel],
) -> tuple[list[str], list[RecordedChannel]]:
    """The parts of a file that hold the same signals, a trial each; none where it holds one trial.
    And the channels of the first of them with those that belong to all, as a source file names
    them within a part."""
    names_in: dict[str, list[str]] = {}
    for channel in channels:
        names_in.setdefault(channel.group, []).append(channel.name)
    layouts = [*names_in.values()]
    most = max(layouts, key=lambda names: len(names) * layouts.count(names), default=[])
    parts = [part for part, names in names_in.items() if names == most]
    if len(parts) < 2:
        return [], [*channels]
    within = []
    for channel in channels:
        if channel.group == parts[0]:
            within.append(channel.at(channel.key.removeprefix(parts[0]).removeprefix(".")))
        elif channel.group not in parts:
            within.append(channel.at(f"/{channel.key}"))
    return parts, within


def drafted_time(
    recording: Recording, channels: Sequence[RecordedChannel], key: str
) -> tuple[dict[str, object], RecordedChannel | None, list[str]]:
    """The field `time` of a draft, the clock if it is a channel, and questions. A rate in the text
    of the file counts where nothing may be a clock, or its stamps stand still."""
    clock, question = choose_clock(channels)
    intervals = [channel for channel in channels if are_intervals(channel)]
    time: dict[str, object] = {}
    if intervals and (clock is None or not is_running(clock)):
        question = f"time is a guess: the sum of the intervals in {printable(intervals[0].key)}"
        clock = replace(intervals[0], numbers=np.cumsum(intervals[0].numbers))
        time["each"] = "interval"
    questions = [question] if question else []
    if clock is None or not np.ptp(clock.readings):
        rate = None if question else stated_rate(recording.notes)
        if clock is not None:
            questions.append(f"the stamps in {printable(clock.key)} stand still")
        if rate is not None:
            questions.append(f"time by the file's own words: {rate:g} rows a second")
            return {"rate": rate}, None, questions
        return {key: NAME_OF_TIME, "unit": UNKNOWN}, None, questions
    clock = as_clock(clock, recording.notes)
    time[key] = clock.key
    if not clock.is_stamp:
        time["unit"] = clock.spelled_unit or UNKNOWN
    return time, clock, questions


def are_intervals(channel: RecordedChannel) -> bool:
    """Whether a channel holds the time since the row before."""
    is_named = re.search(INTERVALS, channel.name) and (channel.readings >= 0).all()
    unit = channel.spelled_unit or time_unit(np.cumsum(channel.readings))
    return bool(is_named) and not is_running(channel) and is_time_unit(unit)


def as_clock(channel: RecordedChannel, notes: Sequence[str]) -> RecordedChannel:
    """A channel as the clock of its table, with its rate and gaps as note and its likely unit: one
    that the file's text tells, as `tick of 10 us`, or that of its name or rate."""
    if not channel.spelled_unit:
        is_counter = (channel.readings == np.rint(channel.readings)).all()
        ticks = filter(None, map(TICK.search, notes if is_counter else []))
        stated_unit = next((f"{tick[1]} {tick[2]}" for tick in ticks), "")
        channel = replace(channel, likely_unit=stated_unit or time_unit(channel.readings))
    factor, _ = channel.base
    channel = replace(channel, numbers=unwrapped(channel.numbers)[0])
    seconds = channel.readings * factor
    rate = rate_of(seconds)
    notes = [f"{rate:.6g} Hz", gaps_text(seconds)] if rate else ["of no known unit"]
    return replace(channel, note=", ".join(filter(None, notes)))


# The clock that a draft names among the channels of a table, and what the user has to decide.


def choose_clock(channels: Sequence[RecordedChannel]) -> tuple[RecordedChannel | None, str]:
    """Choose the clock of a table, and say what the user has to decide.

    It is the first of those that hold times of day, or that are named like a clock, or else of
    those that rise as one, a guess. It is none if another one that tells time spans another time in
    s, ms, us or ns: B and I depend on the choice.
    """
    rising = [clock for clock in channels if clock.is_stamp or ticks(clock.numbers, clock.unit)]
    named = (
        [channel for channel in channels if channel.is_stamp][:1]
        or [channel for channel in channels if is_clock(channel.name)]
        or [channel for channel in rising if looks_like_time(channel.name)]
    )
    candidates = named or rising
    telling = [
        clock
        for clock in rising
        if clock not in candidates
        and (looks_like_time(clock.name) or is_time_unit(clock.spelled_unit))
    ]
    possible = [*candidates, *telling]
    clocks = [clock for clock in possible if is_running(clock)] or possible[:1]
    if not clocks:
        return None, ""

    first = clocks[0]
    taken = printable(first.key)
    candidate_models = [clock for clock in clocks if spans_other_time(clock, first)]
    alike = [clock for clock in clocks[1:] if clock in candidates]
    asked = [first, *(candidate_models or alike)]
    spans = [f"{printable(clock.key)} spans {np.ptp(clock.readings):.6g}" for clock in asked]
    several = f"{len(asked)} {first.kind}s may be the clock: {listing(spans)}"
    if candidate_models:
        return None, (
            f"{several}; they contradict each other, name the one by which the signals were"
            " sampled, or `time` with each channel"
        )
    if alike:
        return first, f"{several}; {taken} is taken, check it"
    return first, "" if named else f"time is a guess: {taken} rises evenly"


def is_running(clock: RecordedChannel) -> bool:
    """Whether a clock rises in most rows and seldom goes back; one of whole seconds does not."""
    steps = np.diff(clock.numbers[np.isfinite(clock.numbers)])
    return bool(np.sum(steps > 0) > clock.count / 2 and np.mean(steps < 0) < MOST_BACK)


def spans_other_time(clock: RecordedChannel, other_clock: RecordedChannel) -> bool:
    """Whether two clocks of the same rows span other times, where both have readings, in s, ms, us
    or ns."""
    if clock.numbers.shape != other_clock.numbers.shape:
        return False
    both = np.isfinite(clock.numbers + other_clock.numbers)
    span = float(np.ptp(clock.numbers[both]))
    other_span = float(np.ptp(other_clock.numbers[both]))
    return (
        min(span, other_span) > 0
        and abs(span_ratio(span, other_span, ()) - 1) > CLOCK.rate_difference
    )


def gaps_text(time: Array) -> str:
    """Gaps, stamps that go back and repeated ones, in words; empty if none."""
    steps = np.diff(np.sort(time))
    wide = steps[steps > GAPS.steps * usual_step(time)]
    counts = {
        f"gaps, the longest {wide.max(initial=0.0):.3f} s": wide.size,
        "stamps out of order": np.sum(np.diff(time) < 0),
        "stamps twice": np.sum(steps == 0),
    }
    return ", ".join(f"{count} {words}" for words, count in counts.items() if count)
