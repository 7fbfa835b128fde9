"""A draft of a source file, from the content of the file that it describes.

Texts from files are untrusted and therefore quoted. They are written as JSON strings, which are valid YAML and have
every control character as an escape.
"""

import json
from collections import Counter
from collections.abc import Iterator, Sequence

from osl_analysis.columns import COLUMNS
from osl_analysis.ingest.draft_places import NAME_OF_TIME, UNKNOWN
from osl_analysis.ingest.draft_walking import draft_walking
from osl_analysis.ingest.known_formats import FORMATS
from osl_analysis.ingest.likely_signal import is_certain, likely_column
from osl_analysis.ingest.overview import Overview, RecordedChannel
from osl_analysis.ingest.units import base_units, normalised

HINT = (
    f"# give each signal that you need its canonical name instead of NAME_n, state what is {UNKNOWN}, delete the rest"
)
NAMES_OF_TIME = ("column", "variable", "field", "channel")
"""Fields of `time` that name a column, in some format."""
MOST_ACTIVE = 8
"""Largest number of channels of which all are entries."""
GUESSED_CLOCK = "# time: its unit is guessed from its name or from the rate of its readings: check it"
NO_CLOCK = "# time: name its column and unit, or state the rate of the rows instead, as {rate: 1000}"


def draft_source(overview: Overview, name: str, named: bool = False) -> str:
    """A source file for the file `name`, in which the user still has to name the channels.

    named: a channel that is the only one like a canonical column, and whose unit is known, has this column's name.
    Those that are like none are comments.
    """
    lines = [
        f"format: {overview.format}",
        f"description: {json.dumps(f'Drafted from {name}; complete it.')}",
        *(f"{key}: {json.dumps(value)}" for key, value in overview.settings.items()),
    ]
    is_capture = FORMATS[overview.format].is_capture
    return "\n".join([*lines, *(capture_lines(overview) if is_capture else log_lines(overview, named))]) + "\n"


def guessed_lines(draft: str) -> list[str]:
    """The lines of a drafted source file that give a channel the name of a column by a guess."""
    return [line.strip() for line in draft.splitlines() if "# guessed" in line and not line.startswith("#")]


def log_lines(overview: Overview, named: bool) -> list[str]:
    """Every channel but the clock, for the user to name; topics without messages and empty arrays are left out."""
    clock = overview.settings.get("time")
    clock_column = next((clock[key] for key in NAMES_OF_TIME if key in clock), "") if isinstance(clock, dict) else ""
    listed = overview.channels if overview.drafted is None else overview.drafted
    channels = [c for c in listed if not clock_column or clock_column not in c.address.values()]
    channels = [c for c in channels if "topic" not in c.address or ("field" in c.address and c.count)]
    known = ", ".join(column for column in COLUMNS if column != "time")
    return [
        *(f"# {text}" for text in (*overview.open, overview.draft_note) if text),
        *[NO_CLOCK] * (clock_column == NAME_OF_TIME),
        *[GUESSED_CLOCK] * any(c.likely_unit and not c.unit for c in listed if clock_column in c.address.values()),
        HINT,
        f"# canonical names: {known}",
        "channels:",
        *(named_lines(channels) if named else channel_lines(channels)),
    ]


def channel_lines(channels: Sequence[RecordedChannel]) -> Iterator[str]:
    """An entry per channel. Of many, those that are like no canonical column by name and unit are comments."""
    guesses = [likely_column(channel) for channel in channels]
    many = len(channels) > MOST_ACTIVE and any(guesses)
    for number, (channel, guess) in enumerate(zip(channels, guesses, strict=True), start=1):
        line = channel_line(number, channel, guess)
        yield f"# {line}" if many and not guess else line


def named_lines(channels: Sequence[RecordedChannel]) -> Iterator[str]:
    """An entry per channel, under its column's name where only this one is like it and its name leaves no doubt.

    One that may be another quantity, as a command or another joint's angle, is left to the user; those like none are
    comments.
    """
    guesses = [likely_column(channel) for channel in channels]
    times = Counter(guesses)
    for number, (channel, guess) in enumerate(zip(channels, guesses, strict=True), start=1):
        is_told = times[guess] == 1 and unit_of(channel) != UNKNOWN and is_certain(channel, guess)
        line = channel_line(number, channel, guess)
        if guess and is_told:
            yield line.replace(f"NAME_{number}:", f"{guess}:", 1).replace(
                f"# {guess}?",
                "# guessed from its name;" if channel.likely_unit and not channel.unit else "# guessed from its name",
                1,
            )
        else:
            yield line if guess or not any(guesses) else f"# {line}"


def capture_lines(overview: Overview) -> list[str]:
    """All markers; analog channels and model outputs as comments, for the user to name; so is a walking section."""
    labels = [json.dumps(c.address["label"]) for c in overview.channels if c.kind == "marker"]
    lines = ["markers: all", f"# or some: markers: [{', '.join(dict.fromkeys(labels))}]"]
    for key, kinds in (("analogs", ("analog", "device")), ("outputs", ("model output",))):
        channels = [c for c in overview.channels if c.kind in kinds]
        lines += [f"# {key}:"] if channels else []
        lines += [f"# {channel_line(number, channel)}" for number, channel in enumerate(channels, start=1)]
    return [*lines, *draft_walking(overview)]


def channel_line(number: int, channel: RecordedChannel, guess: str = "") -> str:
    """One entry under `channels`; `guess` is the canonical column that it may be."""
    address = {**channel.address, "unit": unit_of(channel)}
    guessed = [f"{guess}?"] * bool(guess)
    guessed += [f"no known unit: {json.dumps(channel.unit)}"] * (bool(channel.unit) and unit_of(channel) == UNKNOWN)
    guessed += ["the unit is guessed: check it"] * bool(channel.likely_unit and not channel.unit)
    comment = f"  # {' '.join(guessed)}" if guessed else ""
    return f"  NAME_{number}: {{{', '.join(f'{key}: {json.dumps(value)}' for key, value in address.items())}}}{comment}"


def unit_of(channel: RecordedChannel) -> str:
    """The unit of a channel as the file or its name tells it, where it is a known one."""
    unit = channel.unit or channel.likely_unit
    return unit if unit and base_units(normalised(unit)) is not None else UNKNOWN
