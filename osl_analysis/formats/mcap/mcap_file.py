"""MCAP files, read chunk by chunk. Every intact chunk is read, also if others are damaged."""

import mmap
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap.chunk import DamagedChunkError, MessageBlock, block_of, read_chunk
from osl_analysis.formats.mcap.damage import Damage
from osl_analysis.formats.mcap.scan import FileSection, Scan, scan_file
from osl_analysis.formats.mcap.walk import MAGIC, Buffer, index_offsets


@dataclass
class McapFile:
    """A file whose top level was scanned; `blocks` reads its messages."""

    path: Path
    """Where the file is."""
    data: Buffer
    """Its bytes."""
    scan: Scan
    """Where its chunks are."""
    channels: dict[int, Channel] = field(default_factory=dict)
    """Channels by number; complete once the blocks are read."""
    schemas: dict[int, Schema] = field(default_factory=dict)
    """Schemas by number; complete once the blocks are read."""
    damage: Damage = field(default_factory=Damage)
    """Losses; complete once the blocks are read."""

    def blocks(self) -> Iterator[MessageBlock]:
        """The messages of every intact chunk, and those outside of chunks, in the order of the file. Call it once."""
        if self.scan.finished and not self.scan.summary_damaged:  # a wrong schema would be wrong values
            self.adopt(self.data, self.scan.in_summary, trusted=False)
        begin_report(self.damage, self.scan)
        for section in self.scan.sections:
            block = self.block(section)
            if block is None:
                continue
            yield self.declared(block)

    def block(self, section: FileSection) -> MessageBlock | None:
        """The messages of a section; None if they are lost."""
        if "lost" in section.kind:
            where = f"{section.end - section.start} bytes from byte {section.start} on"
            self.lose(
                section, f"{where} are {'a damaged chunk' if 'chunk' in section.kind else 'not a readable record'}"
            )
            return None
        whole = self.scan.data_crc == "right"
        if section.walk is not None:
            block, verified, indexed = block_of(self.data, section.walk), False, True
        else:
            try:
                block, verified, indexed = read_chunk(self.data, section.start, section.end, section.indexes)
            except DamagedChunkError as error:
                self.lose(section, f"the chunk at byte {section.start} is damaged: it {error}")
                return None
        if not verified and self.untrusted():
            text = f"the checksum of the data section does not match, and no other covers byte {section.start} on"
            self.lose(section, text, block.starts.size)
            return None
        if not indexed:
            self.damage.remark(f"the index of the chunk at byte {section.start} is wrong; the chunk was walked")
        self.damage.chunks += section.kind == "chunk"
        self.damage.messages += block.starts.size
        self.damage.verified += block.starts.size if verified or whole else 0
        self.adopt(block.buffer, block.others, trusted=verified or whole or self.scan.summary_damaged)
        return block

    def untrusted(self) -> bool:
        """Whether the checksum of the whole file is wrong and nothing shows where the damage is."""
        return self.scan.data_crc == "wrong" and not any("lost" in section.kind for section in self.scan.sections)

    def lose(self, section: FileSection, remark: str, messages: int | None = None) -> None:
        """Count a section as lost."""
        lose_section(self.damage, self.data, section, remark, messages)

    def declared(self, block: MessageBlock) -> MessageBlock:
        """The block without messages of undeclared channels, whose content is unknown."""
        known = np.zeros(1 << 16, bool)
        known[list(self.channels)] = True
        known = known[block.channel]
        if known.all():
            return block
        strangers = int((~known).sum())
        number = block.channel[~known][0]
        self.damage.misfits += strangers
        self.damage.remark(f"{strangers} messages belong to channels that are not declared, such as {number}")
        channel, log_time = block.channel[known], block.log_time[known]
        starts, lengths = block.starts[known], block.lengths[known]
        return replace(block, channel=channel, log_time=log_time, starts=starts, lengths=lengths)

    def adopt(self, buffer: Buffer, records: list[tuple[int, int, int]], *, trusted: bool) -> None:
        """Store schemas and channels by number; a later one replaces an earlier one only if it can be trusted."""
        for opcode, start, end in records:
            stream = ReadDataStream(BytesIO(buffer[start:end]))
            try:
                if opcode == Opcode.SCHEMA:
                    schema = Schema.read(stream)
                    self.schemas[schema.id] = schema if trusted else self.schemas.get(schema.id, schema)
                else:
                    channel = Channel.read(stream)
                    self.channels[channel.id] = channel if trusted else self.channels.get(channel.id, channel)
            except Exception:  # the library raises many kinds of errors on damaged bytes
                self.damage.remark("a schema or a channel cannot be read")


def begin_report(damage: Damage, scan: Scan) -> None:
    """Report what the scan of the top level found."""
    damage.finished = scan.finished
    damage.gaps = scan.summary_damaged or any("lost" in section.kind for section in scan.sections)
    damage.bytes = scan.data_end - len(MAGIC)
    if scan.declared is not None:
        damage.declared_messages, damage.declared_chunks = scan.declared
    if scan.summary_damaged:
        damage.remark("the summary is damaged")
    if not scan.finished:
        damage.remark("no footer: the recorder did not finish, or the end is lost; how much is not known")
    if scan.data_crc == "wrong":
        damage.remark("the checksum of the data section does not match")


def lose_section(damage: Damage, data: Buffer, section: FileSection, remark: str, messages: int | None) -> None:
    """Count a section as lost, with as many messages as its index lists."""
    size = section.end - section.start
    if messages is None and section.indexes:
        messages = index_offsets(data, section.indexes).size
    damage.lose(remark, size, 0 if section.harmless else messages, int("chunk" in section.kind))


def read_mcap(path: Path) -> McapFile:
    """Scan a file; its messages are read by `blocks`.

    Raises
    ------
    InputError
        The file is empty, or no MCAP file.
    """
    with path.open("rb") as file:
        if path.stat().st_size == 0:
            raise InputError(f"{path}: the file is empty; copy or record it again, or exclude the trial")
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    opened = McapFile(path, data, Scan())
    if data[:8] != MAGIC and (len(data) < 64 or data[-8:] != MAGIC):
        raise InputError(
            f"{path}: not an MCAP file (it begins with {data[:8]!r}); check the path and the source's format"
        )
    if data[:8] != MAGIC:
        opened.damage.remark("the magic at the beginning is damaged")
    opened.scan = scan_file(data)
    return opened
