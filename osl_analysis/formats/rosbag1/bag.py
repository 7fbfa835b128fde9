"""A ROS 1 bag, read chunk by chunk in the order of recording. Every intact chunk is read, also if others are damaged.

The library `rosbags` gives messages in the order of their times, so that a clock that was set back would not be seen,
and reads no bag whose recorder was killed. It is the judge in the tests.
"""

import bz2
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import lz4.frame
import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from osl_analysis.formats.mcap.chunk import MessageBlock
from osl_analysis.formats.mcap.damage import Damage
from osl_analysis.formats.mcap.declared import Declared
from osl_analysis.formats.mcap.limits import Budget, RefusedFileError
from osl_analysis.formats.rosbag1.records import Buffer, Record, named_fields, walk_chunk

REMEDY = "unpack it with `rosbag decompress`, or keep the topics that you need with `rosbag filter`, if you trust it"
MOST_CONNECTIONS = 1 << 12


@dataclass(frozen=True)
class Section:
    """A chunk, or a stretch of the file that cannot be read."""

    start: int
    """First byte of its record."""
    end: int
    """Where it ends."""
    chunk: Record | None
    """The chunk's record; None for a stretch that cannot be read."""


@dataclass
class Bag:
    """A bag whose top level was scanned; `blocks` reads its messages."""

    path: Path
    """Where the file is."""
    data: Buffer
    """Its bytes."""
    budget: Budget
    """What may still be unpacked."""
    sections: list[Section] = field(default_factory=list)
    """Its chunks and unreadable stretches, in order."""
    counts: dict[int, Counter[int]] = field(default_factory=dict)
    """Messages of each connection in the chunk at a byte, as the bag's index says."""
    numbers: dict[int, int] = field(default_factory=dict)
    """Channel by number of a connection."""
    declared: Declared = field(default_factory=Declared)
    """Its connections as channels, and their message definitions; complete once the blocks are read."""
    damage: Damage = field(default_factory=Damage)
    """Losses; complete once the blocks are read."""
    kind: str = "bag"
    """What it is, for messages."""

    def blocks(self) -> Iterator[MessageBlock]:
        """The messages of every intact chunk, in the order of the file. Call it once.

        Raises
        ------
        InputError
            A chunk would unpack to more than is allowed, or a connection has two meanings.
        """
        for section in self.sections:
            if section.chunk is None:
                where = f"bytes {section.start} to {section.end}"
                self.damage.lose(f"{where} are no chunk of messages", section.end - section.start, None, 0)
                continue
            try:
                content = self.unpacked(section.chunk)
                block = self.block_of(content, section)
            except DamagedError as error:
                lost = self.counts.get(section.start)
                text = f"the chunk at byte {section.start} is damaged: it {error}"
                self.damage.lose(text, section.end - section.start, lost and self.by_channel(lost), 1)
                continue
            self.damage.chunks += 1
            self.damage.read.update(block.counts)
            yield block

    def by_channel(self, counts: Counter[int]) -> Counter[int]:
        """Counts by channel, of counts by connection."""
        return Counter({self.numbers[one]: count for one, count in counts.items() if one in self.numbers})

    def unpacked(self, chunk: Record) -> bytes:
        """The content of a chunk, which must be of the declared size."""
        size, packed = chunk.number(b"size"), self.data[chunk.start : chunk.end]
        compression = chunk.fields.get(b"compression", b"")
        if compression == b"none":
            return packed
        if compression not in (b"bz2", b"lz4"):
            raise DamagedError(
                f"says it is compressed with {compression[:20].decode('latin1')!a}; bz2 and lz4 are read"
            )
        self.budget.take_chunk(chunk.start, len(packed), size)
        unpacker = bz2.BZ2Decompressor() if compression == b"bz2" else lz4.frame.LZ4FrameDecompressor()
        try:
            content: bytes = unpacker.decompress(packed, max_length=size + 1)
        except (OSError, RuntimeError, EOFError, ValueError) as error:
            raise DamagedError(f"cannot be decompressed ({' '.join(str(error).split())})") from error
        if len(content) != size:
            raise DamagedError(f"holds {len(content)} of {size} bytes")
        return content

    def block_of(self, content: bytes, section: Section) -> MessageBlock:
        """The messages of an unpacked chunk."""
        walk = walk_chunk(content, self.budget.left_records() + 1)
        self.budget.take_records(section.start, walk.starts.size + walk.unknown + len(walk.connections))
        if walk.end != len(content):
            raise DamagedError(f"holds no record at byte {walk.end} of its {len(content)} bytes")
        for record in walk.connections:
            self.declare(content, record)
        if walk.unknown:
            self.damage.remark(f"{walk.unknown} records of the chunk at byte {section.start} are of no known kind")
        known = np.isin(walk.connection, list(self.numbers))
        if not known.all():
            stranger = int(walk.connection[~known][0])
            raise DamagedError(f"has messages of connection {stranger}, which is not declared")
        channel = np.array([self.numbers[one] for one in walk.connection.tolist()], np.uint16)
        none = np.zeros(channel.size, np.uint32)
        return MessageBlock(content, channel, none, walk.time, walk.starts, walk.lengths)

    def declare(self, data: Buffer, record: Record) -> None:
        """Take in a connection: a topic and the definition of its messages.

        Raises
        ------
        RefusedFileError
            Its number has two meanings: two bags were joined, or the bag is damaged.
        """
        connection = record.number(b"conn")
        number = self.numbers.setdefault(connection, len(self.numbers))
        if number >= MOST_CONNECTIONS:
            raise RefusedFileError(f"more than {MOST_CONNECTIONS} connections; {REMEDY}")
        about = named_fields(data, record.start, record.end)
        name, text = (about.get(key, b"").decode(errors="replace") for key in (b"type", b"message_definition"))
        topic = record.fields.get(b"topic", b"").decode(errors="replace")
        self.declared.take(Opcode.SCHEMA, Schema(number + 1, text.encode(), "ros1msg", name), provisional=False)
        self.declared.take(Opcode.CHANNEL, Channel(number, topic, "ros1", {}, number + 1), provisional=False)


class DamagedError(Exception):
    """A chunk cannot be read. The message completes the sentence "it ..."."""
