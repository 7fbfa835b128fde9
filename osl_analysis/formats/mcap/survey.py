"""What every channel of an MCAP file holds: when its messages were logged, and its first message."""

from dataclasses import dataclass, field

import numpy as np
from mcap.records import Channel, Schema

from osl_analysis.formats.message_file import MessageFile
from osl_analysis.formats.messages.leaves import Indices

MOST_STAMPS = 10_000_000
"""Largest number of log times that are kept. Later messages are only counted."""


@dataclass
class ChannelSurvey:
    """One channel of a file, as far as it was gone through."""

    channel: Channel
    """Its topic and encoding."""
    schema: Schema | None
    """Schema of its messages; None for JSON."""
    messages: int = 0
    """How many messages it has."""
    first: bytes | None = None
    """Its first message."""
    stamps: list[Indices] = field(default_factory=list)
    """Log times of its messages [ns], chunk by chunk."""

    def log_time(self) -> Indices:
        """Log times of its messages [ns], in the order of the file."""
        return np.concatenate([np.empty(0, np.int64), *self.stamps])


def survey_channels(file: MessageFile) -> list[ChannelSurvey]:
    """All channels of a file, also those without messages. The file is read once, chunk by chunk."""
    surveys: dict[int, ChannelSurvey] = {}
    kept = 0
    for block in file.blocks():
        for number in block.counts:
            one = surveys.setdefault(number, survey_of(file, number))
            rows = np.flatnonzero(block.channel == number)
            if one.first is None:
                start = int(block.starts[rows[0]])
                one.first = bytes(block.buffer[start : start + int(block.lengths[rows[0]])])
            one.messages += rows.size
            one.stamps += [block.log_time[rows]] if kept < MOST_STAMPS else []
            kept += rows.size
    return [surveys.get(number, survey_of(file, number)) for number in sorted(file.declared.channels)]


def survey_of(file: MessageFile, number: int) -> ChannelSurvey:
    """A channel of which no message was seen so far."""
    channel = file.declared.channels[number]
    return ChannelSurvey(channel, file.declared.schemas.get(channel.schema_id))
