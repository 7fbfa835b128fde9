# SPDX-License-Identifier: Apache-2.0
"""Collect the messages of a recorder by topic, from any container, and count the lost ones."""

from collections import Counter
from collections.abc import Mapping

import numpy as np
from mcap.records import Schema
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError, likeliest, listing
from osl_analysis.base.recording import End, Loss, Recording, Rows
from osl_analysis.base.source_file import MessageSource
from osl_analysis.formats.topic import LOG_TIME, PLACE_KEY, Bytes, Topic, stamp_fields


class TopicLog:
    """Topics of the files that are read, to which a container gives its messages.

    Parameters
    ----------
    source
        The source file, or None. It names the fields to read, and the stamp in the messages.

    Attributes
    ----------
    declared
        Messages by topic, as the container counts them.
    chunks_lost
        Parts of the container that cannot be read.
    """

    def __init__(self, source: MessageSource | None) -> None:
        self.wanted = None if source is None else _wanted_fields(source)
        self.stamp = "header.stamp" if source is None else source.time.field
        self.topics: dict[str, Topic] = {}
        self.topic_of: dict[int, Topic] = {}  # by number of the recorder's channel
        self.declared: Counter[str] = Counter()
        self.chunks_lost = 0
        self.end = End.WHOLE
        self.remarks: list[str] = []

    def declare_channel(self, number: int, topic: str, encoding: str, schema: Schema) -> None:
        """Take in a channel of the recorder, whose messages are of a topic."""
        if topic not in self.topics:
            fields = None if self.wanted is None else self.wanted.get(topic, {})
            self.topics[topic] = Topic(topic, encoding, schema, fields)
        self.topics[topic].types.add((encoding, schema.encoding, schema.name, schema.data))
        self.topic_of[number] = self.topics[topic]

    def add_messages(
        self, messages: Bytes, log_times_ns: NDArray[np.int64], channels: NDArray[np.integer]
    ) -> None:
        """Give messages to the topics of their channels; `log_times_ns` and `channels` have the
        shape (messages,)."""
        content, starts, lengths = messages
        for channel in np.flatnonzero(np.bincount(channels)).tolist():
            places = np.flatnonzero(channels == channel)
            if channel in self.topic_of:
                channel_messages = (content, starts[places], lengths[places])
                self.topic_of[channel].add(channel_messages, log_times_ns[places], channel)

    @property
    def read(self) -> Counter[str]:
        """Messages by topic."""
        return Counter({name: topic.count for name, topic in self.topics.items()})

    def recording(self, format_name: str, declared: Counter[str]) -> Recording:
        """Put together what was read, of the messages by topic that a file declares; none if it
        does not.

        Raises
        ------
        InputError
            Two publishers wrote into a topic that the source file names, or messages of two types.
        """
        counts = self.read
        read = counts.total()
        expected = declared.total() or None
        if expected not in (None, read):
            self.remarks.append(f"it declares {expected} messages and holds {read}")
        by_topic = {
            name: (count, declared[name] if expected else None)
            for name, count in sorted(counts.items())
        }
        channels = []
        for topic in self.topics.values():
            if not topic.is_wanted:
                continue
            if topic.lost:
                expected = declared[topic.name] or topic.count
                by_topic[topic.name] = (len(topic.table), expected)
                self.remarks.append(
                    f"{topic.lost} of {topic.count} messages of topic '{topic.name}' are lost:"
                    f" {topic.reason}"
                )
            try:
                topic.check_one_publisher()
            except InputError as error:
                if self.wanted is not None:
                    raise
                self.remarks.append(str(error))
            rows = Rows(
                count=len(topic.table),
                name=topic.name,
                stamps_ns=topic.table[LOG_TIME].to_numpy(),
                lines=topic.table[PLACE_KEY].to_numpy() + 1 if topic.lost else None,
                noun="message",
            )
            channels += topic.channels(rows, {"topic": topic.name}, [self.stamp])
        return Recording(
            format=format_name,
            channels=channels,
            loss=Loss(read, expected, self.end, by_topic, self.remarks),
            facts={
                "chunks_lost": self.chunks_lost,
                "messages": read,
            },
            find_unlisted=self._find_unlisted,
        )

    def _find_unlisted(self, address: Mapping[str, str]) -> None:
        """Say why a topic has no numbers for a field."""
        name, path = address.values()
        topic = self.topics.get(name)
        if topic is None or not topic.count:
            names = sorted(+self.read)
            raise InputError(
                f"no messages of '{name}' (the file has {listing(names)})",
                likeliest(name, names)
                or "correct `topic`, check that its sensor was on, or copy a file"
                " again that was cut off",
            )
        if topic.lost == topic.count:
            raise InputError(f"topic '{name}': {topic.reason}", topic.remedy)
        raise InputError(
            f"topic '{name}' has no number '{path}' (it has {listing([*topic.listed])})",
            likeliest(path, [*topic.listed]) or "correct `field` in the source file",
        )


def _wanted_fields(source: MessageSource) -> dict[str, dict[str, None]]:
    """The fields that a source file asks for, by topic, and the velocity beside each position."""
    stamps = []
    if source.time.source == "header":
        stamps = [path for parts in stamp_fields(source.time.field) for path in parts]
    wanted: dict[str, dict[str, None]] = {}  # in their order, each once
    for channel in source.channels.values():
        velocity_path = channel.field.replace("position", "velocity")
        paths = filter(None, (channel.field, channel.counter, velocity_path, *stamps))
        wanted.setdefault(channel.topic, {}).update(dict.fromkeys(paths))
    return wanted
