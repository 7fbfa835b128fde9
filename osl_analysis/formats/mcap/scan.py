"""Scan of the top level of an MCAP file from the front, also past damage: places of its chunks, and losses.

The summary at the end is not needed. The file of a recorder that was killed is therefore read in the same way.
"""

import struct
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from mcap.opcode import Opcode

from osl_analysis.formats.mcap.chunk import DamagedChunkError, unpacked
from osl_analysis.formats.mcap.joined import refuse_more, refuse_second_header, refuse_second_log
from osl_analysis.formats.mcap.limits import Budget
from osl_analysis.formats.mcap.resume import MOST_CANDIDATES, is_sound, record_follows, resume_at
from osl_analysis.formats.mcap.summary import Summary, check_footer, take_summary_record
from osl_analysis.formats.mcap.walk import (
    MAGIC,
    MESSAGE,
    MOST_RECORDS,
    RECORD,
    Buffer,
    RecordWalk,
    crc_of,
    index_entries,
    is_disguised_chunk,
    is_message_index,
    message_heads,
    walk_records,
)

OF_CHUNKS = (Opcode.CHUNK, Opcode.MESSAGE_INDEX)


@dataclass
class FileSection:
    """One part of a file's data section."""

    kind: Literal["chunk", "loose", "lost chunk", "lost"]
    """A chunk, loose messages outside of chunks, a chunk that is lost, or lost bytes of which nothing is known."""
    start: int
    """First byte: of the content of a chunk, else of the section."""
    end: int
    """The byte after the last one."""
    walk: RecordWalk | None = None
    """Places of the loose messages."""
    indexes: list[tuple[int, int]] = field(default_factory=list)
    """Start and end of the message index records that follow a chunk."""
    harmless: bool = False
    """Lost, but it held no message."""


@dataclass
class Scan:
    """Result of the scan of a file's top level."""

    sections: list[FileSection] = field(default_factory=list)
    """The parts of the data section, in order."""
    summary: Summary = field(default_factory=Summary)
    """What the summary says."""
    data_end: int = 0
    """Where the data section ends [bytes]."""
    data_crc: Literal["right", "wrong"] | None = None
    """The checksum of the data section; None if there is none."""
    finished: bool = False
    """The file ends with a footer and the magic."""
    chunked: bool = False
    """The file has chunks."""
    candidates: int = MOST_CANDIDATES
    """How many more places may be tried when searching for the next sound record."""
    after_data: list[FileSection] = field(default_factory=list)
    """Schemas and channels of the summary as parts of the data, should these go on after all."""
    previous: int = len(MAGIC)
    """Where the last sound record, or the last stretch of records outside of chunks, began."""
    unpacked: tuple[int, bytes | None] = (0, None)
    """Place and content of the chunk that was unpacked last, None if it is damaged."""

    def last_chunk(self) -> FileSection | None:
        """The last chunk so far, lost or not."""
        return next((section for section in reversed(self.sections) if "chunk" in section.kind), None)


def scan_file(data: Buffer) -> Scan:
    """Scan a whole file, whose first bytes are its magic.

    Raises
    ------
    InputError
        The file holds two logs, or would unpack to more than is allowed.
    """
    scan, position = Scan(), len(MAGIC)
    while position < len(data) and not scan.finished:
        begin, position = position, scan_record(scan, data, position)
        scan.previous = begin
    scan.data_end = scan.data_end or len(data)
    last = scan.sections[-1] if scan.sections else None
    if not scan.finished and last and "lost" in last.kind and last.end == len(data):
        scan.sections.pop()  # the record in which the file was cut off: nobody knows what it held
    return scan


def scan_record(scan: Scan, data: Buffer, position: int) -> int:
    """Take in the record at `position`; returns the position of the next one."""
    start = position + RECORD.size
    if start > len(data):
        return take_lost(scan, data, position)
    opcode, length = RECORD.unpack_from(data, position)
    end = int(start + length)
    if end <= len(data) and not scan.data_end and record_follows(data, end):
        if opcode != Opcode.CHUNK and is_disguised_chunk(data, start, end):
            scan.sections.append(FileSection("lost chunk", position, end))
            return end
        if opcode != Opcode.MESSAGE_INDEX and is_disguised_index(scan, data, start, end):
            opcode = Opcode.MESSAGE_INDEX
    if opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
        walk = walk_records(data, position, len(data), MOST_RECORDS, in_chunk=False)
        if walk.end > position:
            take_loose(scan, position, walk)
            return walk.end
    if end > len(data) or not is_sound(data, opcode, start, end):
        return take_lost(scan, data, position)
    take_record(scan, data, opcode, start, end)
    return end


def is_disguised_index(scan: Scan, data: Buffer, start: int, end: int) -> bool:
    """Whether a record of another opcode is the message index of the last chunk: a flipped bit makes it a message.

    A message may look like an index. It is one only if each of its entries leads to a message of that channel and log
    time in the chunk.
    """
    chunk = scan.last_chunk()
    if chunk is None or not is_message_index(data, start, end, exact=True):
        return False
    channel, entries = index_entries(data, start)
    offsets = entries["offset"]
    if chunk.kind == "chunk" and scan.unpacked[0] != chunk.start:
        try:
            scan.unpacked = chunk.start, unpacked(data, chunk.start, Budget(len(data)))
        except DamagedChunkError:
            scan.unpacked = chunk.start, None
    content = scan.unpacked[1] if chunk.kind == "chunk" else None
    if content is None:
        return bool((offsets < np.uint64(1 << 32)).all())  # nothing can be compared; two times are no offsets
    if offsets.size == 0 or int(offsets.max()) > len(content) - MESSAGE.itemsize:
        return False
    heads = message_heads(content, offsets.astype(np.int64))
    same = (heads["channel"] == channel) & (heads["log_time"] == entries["log_time"])
    return bool((same & (heads["opcode"] == Opcode.MESSAGE)).all())


def take_loose(scan: Scan, position: int, walk: RecordWalk) -> None:
    """Take in records outside of chunks; after the end of the data they belong to the summary."""
    section = FileSection("loose", position, walk.end, walk)
    if scan.data_end:
        scan.summary.described += walk.others
        scan.after_data.append(section)
    else:
        scan.sections.append(section)


def take_record(scan: Scan, data: Buffer, opcode: int, start: int, end: int) -> None:
    """Take in one sound record."""
    if opcode == Opcode.CHUNK:
        if scan.data_end:  # a chunk after the end of the data shows that this was not the end
            refuse_second_log(data, scan.data_end, start)
            scan.sections += scan.after_data
            scan.data_end, scan.data_crc, scan.summary.damaged = 0, None, True
        scan.chunked = True
        scan.sections.append(FileSection("chunk", start, end))
    elif opcode == Opcode.MESSAGE_INDEX and not scan.data_end:
        of_chunk = scan.last_chunk()
        if of_chunk:
            of_chunk.indexes.append((start, end))
    elif opcode == Opcode.DATA_END and not scan.data_end:
        scan.data_end, scan.summary.begin = start - RECORD.size, end
        (expected,) = struct.unpack_from("<I", data, start)
        if expected:
            scan.data_crc = "right" if crc_of(data, 0, scan.data_end) == expected else "wrong"
    elif opcode == Opcode.HEADER and start > len(MAGIC) + RECORD.size:
        refuse_second_header(data, start, end)
    elif opcode == Opcode.FOOTER:
        refuse_more(data, end)
        scan.finished = data[end : end + len(MAGIC)] == MAGIC
        check_footer(scan.summary, data, start)
    else:
        take_summary_record(scan.summary, data, opcode, start, end)


def take_lost(scan: Scan, data: Buffer, position: int) -> int:
    """Note that nothing can be read at `position`. Returns the place of the next sound record or of the file's end.

    In a file with chunks, messages found outside of them are not used: they belong to a damaged chunk, whose checksum
    cannot be checked.
    """
    resume, scan.candidates = resume_at(data, position + 1, scan.candidates, chunked=True)
    scan.chunked |= data[position] == Opcode.CHUNK or (resume < len(data) and data[resume] in OF_CHUNKS)
    if not scan.chunked:
        resume, scan.candidates = resume_at(data, position + 1, scan.candidates, chunked=False)
    refuse_second_log(data, scan.previous, resume)  # a record that was cut off may reach into the next log
    if scan.data_end:
        scan.summary.damaged = True
    elif data[position] == Opcode.CHUNK:
        scan.sections.append(FileSection("lost chunk", position, resume))
    else:
        scan.sections.append(FileSection("lost", position, resume, harmless=data[position] == Opcode.MESSAGE_INDEX))
    return resume
