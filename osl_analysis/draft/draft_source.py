# SPDX-License-Identifier: Apache-2.0
"""Draft source files.

Texts from files are quoted as JSON, which is valid YAML. A fact that no file states is a question
to the user; questions stand first.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from osl_analysis.base.errors import quoted
from osl_analysis.base.source_file import COMPUTED
from osl_analysis.base.trial import COLUMNS
from osl_analysis.base.units import is_unit
from osl_analysis.base.yaml_settings import UNKNOWN
from osl_analysis.draft.likelihood import (
    COUNTS,
    LEVELS,
    Guess,
    guessed_columns,
    likely_level,
    with_documented_unit,
)
from osl_analysis.draft.recorded_channel import Overview, RecordedChannel

NAMED_ALWAYS = ("theta", "torque", *LEVELS)  # columns that a draft names without a unit
TORQUE_NAME = re.compile("(?i)torque|moment|effort|tau")  # in the name of one


@dataclass
class Entry:
    """A channel in the draft of a source file, under the name of a column or one to be edited."""

    name: str
    fields: dict[str, object]
    channel_name: str
    remark: str
    is_comment: bool = False

    @property
    def line(self) -> str:
        """The entry in YAML."""
        fields = (f"{key}: {quoted(value)}" for key, value in self.fields.items())
        text = f"  {self.name}: {{{', '.join(fields)}}}"
        text += f"  # {self.remark}" if self.remark else ""
        return f"# {text}" if self.is_comment else text

    @property
    def guess(self) -> str:
        """Its column, unit and sign."""
        sign = ", sign -1" if "sign" in self.fields else ""
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
    """

    settings: dict[str, object]
    questions: list[str]
    entries: list[Entry] = field(default_factory=list)
    key: str = "channels"

    @property
    def named(self) -> dict[str, Entry]:
        """The entries that are no comments, by name."""
        return {entry.name: entry for entry in self.entries if not entry.is_comment}

    @property
    def computed(self) -> list[str]:
        """A question on a torque whose name or unit is of none that was measured."""
        torques = [entry for name, entry in self.named.items() if name.startswith("torque")]
        if not torques:  # the only one may be no measurement
            torques = [entry for entry in self.entries if TORQUE_NAME.search(f"{entry.fields}")]
        questions = [
            f"{entry.channel_name} is called like a current, an estimate or a command: name the"
            " torque of a load cell, or state `measured: true` of it, and of a current `scale`"
            for entry in torques
            if COMPUTED.search(f"{entry.fields} [{entry.fields['unit']}]")
        ]
        return [*dict.fromkeys(questions)]  # the joints of one message have one name

    @property
    def text(self) -> str:
        """The source file."""
        lines = [f"{key}: {quoted(value)}" for key, value in self.settings.items()]
        lines += [f"# {text}" for text in (*self.questions, *self.computed)]
        if self.entries:
            lines += [f"{self.key}:", *(entry.line for entry in self.entries)]
        return "\n".join([*lines, ""])


@np.errstate(all="ignore")  # what a damaged file holds may be of any size
def guesses_of(*overviews: Overview) -> list[Guess]:
    """Guess what the channels of a log, or of both logs of a trial, are."""
    signals = [channel for overview in overviews for channel in overview.drafted if channel.count]
    return guessed_columns([with_documented_unit(channel) for channel in signals])


def draft_source(overview: Overview, name: str) -> str:
    """The text of the draft of a source file for a file `name`."""
    return drafted_source(overview, name, guesses_of(overview)).text


@np.errstate(all="ignore")
def drafted_source(overview: Overview, name: str, guesses: Sequence[Guess]) -> DraftedSource:
    """Draft a source file for a file `name`, by what is guessed of its channels.

    Channels that are the only one like a canonical column, and whose unit is known, have its name.
    """
    source = DraftedSource(
        {
            "format": overview.format,
            "description": f"Drafted from {name}; complete it.",
            **overview.settings,
        },
        list(overview.open),
    )
    if overview.is_capture:
        source.settings["markers"] = "all"
        if overview.format == "trc" and "axes" not in source.settings:
            source.settings["axes"] = UNKNOWN
            source.questions.append("axes: [x, -z, y] where y points up, as in OpenSim")
        source.key = "analogs"
        source.questions.append("`osl-analysis inspect` lists further `analogs` and `outputs`")
        source.entries = [
            Entry(
                column,
                {**channel.address, "unit": "V"},
                channel.name,
                "a guess by its name",
            )
            for column, channel in pulse_channels(overview).items()
        ]
    else:
        if overview.clock is not None and overview.clock.likely_unit:
            source.questions.append("time: its unit is guessed by its name or rate: check it")
        names = ", ".join(column for column in COLUMNS if column != "time")
        source.questions.append(
            f"give each signal that you need its canonical name instead of NAME_n ({names}), state"
            f" what is {UNKNOWN}, name or state time, as {{rate: HZ}}, delete the rest"
        )
        source.entries = entries_of(guesses)
    return source


def pulse_channels(overview: Overview) -> dict[str, RecordedChannel]:
    """The analog channels of a capture that are called like `sync` and `trigger`, where one alone
    is."""
    analogs = [channel for channel in overview.channels if channel.kind == "analog"]
    pulses = {}
    for column in LEVELS:
        alike = [channel for channel in analogs if likely_level(channel) == column]
        if len(alike) == 1:
            pulses[column] = alike[0]
    return pulses


def entries_of(guesses: Sequence[Guess]) -> list[Entry]:
    """An entry for every channel of a log but the clock.

    It has a column's name if only this channel is like the column and nothing leaves a doubt. The
    user names those that may be a column while angle and torque are not known, and all that move
    where none is likely, or all. The others are comments.
    """
    sure = {guess.column for guess in guesses if guess.is_sure}
    is_complete = {"theta", "torque"} <= sure or {"torque_m", "current"} <= sure
    named = []
    for guess in guesses:
        has_unit = is_unit(guess.channel.spelled_unit)
        stands = guess.is_sure and (has_unit or guess.column in NAMED_ALWAYS)
        is_asked = bool(guess.column) and not is_complete
        if stands or is_asked:
            named.append(guess)
    moving = [guess for guess in guesses if not guess.why_not]
    shown = named or moving or guesses
    return [
        entry_of(number, guess, is_comment=guess not in shown)
        for number, guess in enumerate(guesses, start=1)
    ]


def entry_of(number: int, guess: Guess, is_comment: bool) -> Entry:
    """The entry of a channel by what it may be, with the column's name where that is sure."""
    channel = guess.channel
    unit = channel.spelled_unit
    remarks = [guess.why_not]
    if guess.column:
        remarks = [guess.why if guess.is_sure else f"{guess.column}?"]
    if channel.base[1] in COUNTS:
        remarks.append(f"no known unit: {quoted(unit)}" if unit else "no unit is stated")
        unit = "V" if guess.column in LEVELS else UNKNOWN
        if channel.base[1] == "dimensionless":
            remarks.append("of what? state its unit, and `scale` by the rated value")
    elif not channel.unit:
        remarks.append("the unit is guessed: check it")
    fields: dict[str, object] = {**channel.address, "unit": unit}
    is_whole = (channel.readings == np.rint(channel.readings)).all()
    if unit == UNKNOWN and guess.column.startswith("theta") and is_whole:
        fields |= {"unit": "rev", "scale": UNKNOWN}
        remarks.append("counts: `scale` is 1/COUNTS of a turn, as 1/4096")
    if guess.sign < 0:
        fields["sign"] = guess.sign
    if guess.wraps_at and guess.column.startswith("theta"):
        fields["wraps_at"] = guess.wraps_at
    name = guess.column if guess.is_sure else f"NAME_{number}"
    return Entry(name, fields, channel.name, "; ".join(filter(None, remarks)), is_comment)
