"""MCAP files, read chunk by chunk. Every intact chunk is read, also if others are damaged."""

import mmap
import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap.chunk import (
    DamagedChunkError,
    MessageBlock,
    ReadChunk,
    block_of,
    check_budget,
    read_chunk,
)
from osl_analysis.formats.mcap.damage import Damage
from osl_analysis.formats.mcap.declared import Declared
from osl_analysis.formats.mcap.joined import refuse_second_log
from osl_analysis.formats.mcap.limits import Budget
from osl_analysis.formats.mcap.scan import FileSection, Scan, scan_file
from osl_analysis.formats.mcap.walk import MAGIC, Buffer, indexed_messages

HELD = 256 << 20
"""Bytes up to which a file is held in memory. A larger one is mapped: if it is cut short meanwhile, reading crashes."""


@dataclass
class McapFile:
    """A file whose top level was scanned; `blocks` reads its messages."""

    path: Path
    """Where the file is."""
    data: Buffer
    """Its bytes."""
    scan: Scan
    """Where its chunks are."""
    budget: Budget
    """What may still be unpacked."""
    declared: Declared = field(default_factory=Declared)
    """Its channels and schemas; complete once the blocks are read."""
    damage: Damage = field(default_factory=Damage)
    """Losses; complete once the blocks are read."""
    kind: str = "MCAP"
    """What it is, for messages."""

    def blocks(self) -> Iterator[MessageBlock]:
        """The messages of every intact chunk, and those outside of chunks, in the order of the file. Call it once.

        Raises
        ------
        InputError
            A chunk would unpack to more than is allowed, or a channel has two meanings.
        """
        begin_report(self.damage, self.scan)
        chunks = (section.start for section in self.scan.sections if section.kind == "chunk")
        check_budget(self.data, chunks, Budget(len(self.data)))
        if self.scan.finished and not self.scan.summary.damaged:  # a wrong schema would be wrong values
            self.adopt(self.data, self.scan.summary.described, provisional=not self.scan.summary.checked)
        for section in self.scan.sections:
            read = self.read_section(section)
            if read is not None:
                self.count(section, read)
                self.adopt(read.block.buffer, read.block.others)
                yield self.of_declared_channels(read.block)
                release(self.data, section)
        if self.damage.knows_of_missing_chunks():
            self.damage.uncounted = True

    def read_section(self, section: FileSection) -> ReadChunk | None:
        """The messages of a section; None if they are lost."""
        if "lost" in section.kind:
            where = f"{section.end - section.start} bytes from byte {section.start} on"
            what = "a damaged chunk" if "chunk" in section.kind else "not a readable record"
            self.lose(section, f"{where} are {what}")
            return None
        if section.walk is not None:
            self.budget.take_records(section.start, section.walk.messages.size + len(section.walk.others))
            read = ReadChunk(block_of(self.data, section.walk))
        else:
            try:
                read = read_chunk(self.data, section.start, section.indexes, self.budget)
            except DamagedChunkError as error:
                refuse_second_log(self.data, section.start, section.end)  # a cut chunk may reach into the next log
                self.lose(section, f"the chunk at byte {section.start} is damaged: it {error}")
                return None
        if not read.verified and self.untrusted():
            text = f"the checksum of the data section does not match, and no other covers byte {section.start} on"
            self.lose(section, text, read.block.counts)
            return None
        return read

    def count(self, section: FileSection, read: ReadChunk) -> None:
        """Count a section that was read."""
        cut_off = section is self.scan.sections[-1] and not self.scan.finished  # so is its index
        if not read.index_is_right and not cut_off:
            self.damage.remark(f"the index of the chunk at byte {section.start} is wrong; the chunk was walked")
        if read.lost:
            text = f"{read.lost.total()} messages of the chunk at byte {section.start} are records of unknown opcodes"
            self.damage.lose(text, 0, read.lost, 0)
        self.damage.chunks += section.kind == "chunk"
        self.damage.read.update(read.block.counts)
        whole = self.scan.data_crc == "right"
        self.damage.verified += read.block.starts.size if read.verified or whole else 0

    def untrusted(self) -> bool:
        """Whether the checksum of the whole file is wrong and nothing shows where the damage is."""
        return self.scan.data_crc == "wrong" and not any("lost" in section.kind for section in self.scan.sections)

    def lose(self, section: FileSection, remark: str, messages: Counter[int] | None = None) -> None:
        """Count a section as lost, with as many messages as its index lists."""
        if messages is None and section.indexes:
            messages = indexed_messages(self.data, section.indexes)
        none = Counter[int]()
        size, chunks = section.end - section.start, int("chunk" in section.kind)
        self.damage.lose(remark, size, none if section.harmless else messages, chunks)

    def adopt(self, buffer: Buffer, records: list[tuple[int, int, int]], *, provisional: bool = False) -> None:
        """Take in schemas and channels."""
        for remark in self.declared.adopt(buffer, records, provisional=provisional):
            self.damage.remark(remark)

    def of_declared_channels(self, block: MessageBlock) -> MessageBlock:
        """The block without messages of undeclared channels, whose content is unknown."""
        if all(number in self.declared.channels for number in block.counts):
            return block
        known = np.isin(block.channel, list(self.declared.channels))
        strangers = block.channel[~known]
        self.damage.misfits.update(strangers.tolist())
        example = strangers[0]
        self.damage.remark(f"{strangers.size} messages belong to channels that are not declared, such as {example}")
        return block.of(np.flatnonzero(known))


def begin_report(damage: Damage, scan: Scan) -> None:
    """Report what the scan of the top level found."""
    summary = scan.summary
    damage.finished = scan.finished
    damage.gaps = summary.damaged or summary.missing != 0 or any("lost" in one.kind for one in scan.sections)
    damage.bytes = scan.data_end - len(MAGIC)
    if not scan.finished:
        damage.remark("no footer: the recorder did not finish, or the end is lost; how much is not known")
    elif summary.damaged:
        damage.remark("the summary is damaged")
    if scan.finished:
        damage.declared_messages, damage.declared = summary.messages, summary.by_channel
        damage.declared_chunks = summary.all_chunks()
    if scan.data_crc == "wrong":
        damage.remark("the checksum of the data section does not match")
    if summary.missing > 0:
        damage.lose(f"{summary.missing} bytes are missing before the summary", summary.missing, None, 0)
        damage.bytes += summary.missing
    elif summary.missing:
        damage.remark(f"{-summary.missing} bytes were inserted before the summary")


def release(data: Buffer, section: FileSection) -> None:
    """Take the pages of a section that has been read out of memory, where the file is mapped."""
    if isinstance(data, mmap.mmap) and hasattr(data, "madvise"):
        first = -(-section.start // mmap.PAGESIZE) * mmap.PAGESIZE
        if section.end > first:
            data.madvise(mmap.MADV_DONTNEED, first, section.end - first)


def read_mcap(path: Path) -> McapFile:
    """Scan a file; its messages are read by `blocks`.

    Raises
    ------
    InputError
        The file is empty, no MCAP file, or two logs.
    """
    with path.open("rb") as file:
        is_held = os.fstat(file.fileno()).st_size <= HELD
        data: Buffer = file.read() if is_held else mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    if not data:
        raise InputError(f"{path}: the file is empty; copy or record it again, or exclude the trial")
    if data[:8] != MAGIC and (len(data) < 64 or data[-8:] != MAGIC):
        raise InputError(
            f"{path}: not an MCAP file (it begins with {data[:8]!r}); check the path and the source's format"
        )
    try:
        opened = McapFile(path, data, scan_file(data), Budget(len(data)))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    if data[:8] != MAGIC:
        opened.damage.remark("the magic at the beginning is damaged")
    return opened
