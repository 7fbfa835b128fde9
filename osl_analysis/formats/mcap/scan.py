"""The top level of an MCAP file, from the front and past damage: where its chunks are, and what is lost between.

The summary is never needed to find them, so that the file of a recorder that was killed takes the same path.
"""

import re
import struct
import zlib
from dataclasses import dataclass, field
from typing import Literal

from mcap.opcode import Opcode

from osl_analysis.formats.mcap.walk import (
    MAGIC,
    MOST_MESSAGES,
    NUMBERED,
    RECORD,
    Buffer,
    RecordWalk,
    is_chunk,
    is_message_index,
    walk_records,
)

LENGTHS = {Opcode.DATA_END: 4, Opcode.FOOTER: 20}
STATISTICS = struct.Struct("<Q14xI20x")  # messages, chunks
PRIVATE = 0x80
OF_CHUNKS = (Opcode.CHUNK, Opcode.MESSAGE_INDEX)
TO_RESUME_AT = re.compile(rb"[\x06\x07\x0b].{6}\0\0|\x0f\x04\0{7}|\x02\x14\0{7}", re.DOTALL)
TO_RESUME_AT_UNCHUNKED = re.compile(rb"[\x03-\x07\x0b].{6}\0\0|\x0f\x04\0{7}|\x02\x14\0{7}", re.DOTALL)
MOST_CANDIDATES = 500_000  # to look at when searching for where to resume: a second of work


@dataclass
class FileSection:
    """A chunk (`start` and `end` of its content), loose messages outside of chunks, or a stretch that is lost.

    `walk` is where the loose messages stand; `indexes` are the message index records that follow a chunk. What is
    lost may be no chunk; `harmless` if it is sure to have held no message.
    """

    kind: Literal["chunk", "loose", "lost chunk", "lost"]
    start: int
    end: int
    walk: RecordWalk | None = None
    indexes: list[tuple[int, int]] = field(default_factory=list)
    harmless: bool = False


@dataclass
class Scan:
    """What was found; `data_crc` is None if the data section has no checksum.

    `in_summary` are the summary's schemas and channels, `declared` how many messages and chunks it says there are.
    """

    sections: list[FileSection] = field(default_factory=list)
    in_summary: list[tuple[int, int, int]] = field(default_factory=list)
    data_end: int = 0
    data_crc: Literal["right", "wrong"] | None = None
    declared: tuple[int, int] | None = None
    finished: bool = False
    chunked: bool = False
    summary_damaged: bool = False
    candidates: int = MOST_CANDIDATES


def scan_file(data: Buffer) -> Scan:
    """All of a file, whose first bytes are its magic."""
    found, position = Scan(), len(MAGIC)
    while position < len(data) and not found.finished:
        position = step(found, data, position)
    found.data_end = found.data_end or len(data)
    return found


def step(found: Scan, data: Buffer, position: int) -> int:
    """Take in what stands at `position`; where to go on."""
    start = position + RECORD.size
    if start > len(data):
        return lost(found, data, position)
    opcode, length = record_header(data, position)
    end = start + length
    if end <= len(data) and not found.data_end and record_follows(data, end):
        if opcode != Opcode.CHUNK and is_chunk(data, start, end):
            found.sections.append(FileSection("lost chunk", position, end))
            return end
        if found.chunked and is_message_index(data, start, end):
            opcode = Opcode.MESSAGE_INDEX  # a flipped opcode would make it a message
    if opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
        walk = walk_records(data, position, len(data), MOST_MESSAGES)
        if walk.end > position:
            loose(found, position, walk)
            return walk.end
    if end > len(data) or not sound(data, opcode, start, end):
        return lost(found, data, position)
    take(found, data, opcode, start, end)
    return end


def loose(found: Scan, position: int, walk: RecordWalk) -> None:
    """Records outside of chunks; after the data's end they are the summary's."""
    if found.data_end:
        found.in_summary += walk.others
    else:
        found.sections.append(FileSection("loose", position, walk.end, walk))


def take(found: Scan, data: Buffer, opcode: int, start: int, end: int) -> None:
    """Take in one sound record."""
    if opcode == Opcode.CHUNK:
        if found.data_end:  # there is no chunk after the data's end: it was none
            found.data_end, found.data_crc, found.summary_damaged = 0, None, True
        found.chunked = True
        found.sections.append(FileSection("chunk", start, end))
    elif opcode == Opcode.MESSAGE_INDEX and not found.data_end:
        of_chunk = next((section for section in reversed(found.sections) if "chunk" in section.kind), None)
        if of_chunk:
            of_chunk.indexes.append((start, end))
    elif opcode == Opcode.DATA_END and not found.data_end:
        found.data_end = start - RECORD.size
        (expected,) = struct.unpack_from("<I", data, start)
        if expected:
            found.data_crc = "right" if crc_of(data, 0, found.data_end) == expected else "wrong"
    elif opcode == Opcode.STATISTICS:
        found.declared = STATISTICS.unpack_from(data, start)
    elif opcode == Opcode.FOOTER:
        found.finished = len(data) - end == len(MAGIC) and data[end:] == MAGIC
        check_summary(found, data, start)


def check_summary(found: Scan, data: Buffer, start: int) -> None:
    """Check the summary against its checksum (0 means that there is none); a damaged one declares nothing."""
    summary, _, expected = struct.unpack_from("<QQI", data, start)
    if expected and (summary > start or crc_of(data, summary or start - RECORD.size, start + 16) != expected):
        found.declared, found.summary_damaged = None, True


def crc_of(data: Buffer, start: int, end: int) -> int:
    """CRC-32 of a stretch, taken in pieces: a slice of a mapped file is a copy."""
    crc = 0
    for position in range(start, end, 1 << 20):
        crc = zlib.crc32(data[position : min(position + (1 << 20), end)], crc)
    return crc


def record_header(data: Buffer, position: int) -> tuple[int, int]:
    """Opcode and length of the record at `position`."""
    opcode, length = RECORD.unpack_from(data, position)
    return opcode, length


def lost(found: Scan, data: Buffer, position: int) -> int:
    """Note that nothing can be read at `position`; where the next sound record is, or the file's end.

    Where there are chunks, none of the messages found between them counts: they stand in a damaged chunk, of
    which the checksum cannot be checked.
    """
    resume = resume_at(found, data, position + 1, TO_RESUME_AT)
    found.chunked |= data[position] == Opcode.CHUNK or (resume < len(data) and data[resume] in OF_CHUNKS)
    if not found.chunked:
        resume = resume_at(found, data, position + 1, TO_RESUME_AT_UNCHUNKED)
    if found.data_end:
        found.summary_damaged = True
    elif data[position] == Opcode.CHUNK:
        found.sections.append(FileSection("lost chunk", position, resume))
    else:
        found.sections.append(FileSection("lost", position, resume, harmless=data[position] == Opcode.MESSAGE_INDEX))
    return resume


def resume_at(found: Scan, data: Buffer, begin: int, pattern: re.Pattern[bytes]) -> int:
    """The next sound record of a kind that is worth going on at, or the end of the file."""
    while found.candidates and (match := pattern.search(data, begin)):
        found.candidates -= 1
        opcode, length = record_header(data, match.start())
        start = match.start() + RECORD.size
        if start + length <= len(data) and sound(data, opcode, start, start + length):
            return match.start()
        begin = match.start() + 1
    return len(data)


def sound(data: Buffer, opcode: int, start: int, end: int) -> bool:
    """Whether the content of a record is what its opcode promises; where that tells little, what follows must."""
    if opcode == Opcode.CHUNK:
        return is_chunk(data, start, end)
    if opcode == Opcode.MESSAGE_INDEX:
        return is_message_index(data, start, end)
    if opcode in LENGTHS:
        return end - start == LENGTHS[Opcode(opcode)]
    if opcode == Opcode.STATISTICS and end - start < STATISTICS.size:
        return False
    return opcode != 0 and record_follows(data, end)


def record_follows(data: Buffer, end: int) -> bool:
    """Whether a record, or nothing, follows."""
    return end == len(data) or data[end] in NUMBERED or data[end] >= PRIVATE
