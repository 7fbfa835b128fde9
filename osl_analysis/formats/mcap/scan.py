"""Scan of the top level of an MCAP file from the front, also past damage: places of its chunks, and losses.

The summary at the end is not needed. The file of a recorder that was killed is therefore read in the same way.
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
    in_summary: list[tuple[int, int, int]] = field(default_factory=list)
    """Opcode, start and end of the summary's schemas and channels."""
    data_end: int = 0
    """Where the data section ends [bytes]."""
    data_crc: Literal["right", "wrong"] | None = None
    """The checksum of the data section; None if there is none."""
    declared: tuple[int, int] | None = None
    """How many messages and chunks the file has, according to its summary."""
    finished: bool = False
    """The file ends with a footer and the magic."""
    chunked: bool = False
    """The file has chunks."""
    summary_damaged: bool = False
    """The summary cannot be trusted."""
    candidates: int = MOST_CANDIDATES
    """How many more places may be tried when searching for the next sound record."""


def scan_file(data: Buffer) -> Scan:
    """Scan a whole file, whose first bytes are its magic."""
    scan, position = Scan(), len(MAGIC)
    while position < len(data) and not scan.finished:
        position = scan_record(scan, data, position)
    scan.data_end = scan.data_end or len(data)
    return scan


def scan_record(scan: Scan, data: Buffer, position: int) -> int:
    """Take in the record at `position`; returns the position of the next one."""
    start = position + RECORD.size
    if start > len(data):
        return take_lost(scan, data, position)
    opcode, length = record_header(data, position)
    end = start + length
    if end <= len(data) and not scan.data_end and record_follows(data, end):
        if opcode != Opcode.CHUNK and is_chunk(data, start, end):
            scan.sections.append(FileSection("lost chunk", position, end))
            return end
        if scan.chunked and is_message_index(data, start, end):
            opcode = Opcode.MESSAGE_INDEX  # a flipped opcode would make it a message
    if opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
        walk = walk_records(data, position, len(data), MOST_MESSAGES)
        if walk.end > position:
            take_loose(scan, position, walk)
            return walk.end
    if end > len(data) or not is_sound(data, opcode, start, end):
        return take_lost(scan, data, position)
    take_record(scan, data, opcode, start, end)
    return end


def take_loose(scan: Scan, position: int, walk: RecordWalk) -> None:
    """Take in records outside of chunks; after the end of the data they belong to the summary."""
    if scan.data_end:
        scan.in_summary += walk.others
    else:
        scan.sections.append(FileSection("loose", position, walk.end, walk))


def take_record(scan: Scan, data: Buffer, opcode: int, start: int, end: int) -> None:
    """Take in one sound record."""
    if opcode == Opcode.CHUNK:
        if scan.data_end:  # a chunk after the end of the data shows that this was not the end
            scan.data_end, scan.data_crc, scan.summary_damaged = 0, None, True
        scan.chunked = True
        scan.sections.append(FileSection("chunk", start, end))
    elif opcode == Opcode.MESSAGE_INDEX and not scan.data_end:
        of_chunk = next((section for section in reversed(scan.sections) if "chunk" in section.kind), None)
        if of_chunk:
            of_chunk.indexes.append((start, end))
    elif opcode == Opcode.DATA_END and not scan.data_end:
        scan.data_end = start - RECORD.size
        (expected,) = struct.unpack_from("<I", data, start)
        if expected:
            scan.data_crc = "right" if crc_of(data, 0, scan.data_end) == expected else "wrong"
    elif opcode == Opcode.STATISTICS:
        scan.declared = STATISTICS.unpack_from(data, start)
    elif opcode == Opcode.FOOTER:
        scan.finished = len(data) - end == len(MAGIC) and data[end:] == MAGIC
        check_summary(scan, data, start)


def check_summary(scan: Scan, data: Buffer, start: int) -> None:
    """Check the summary against its checksum, where 0 means that it has none; ignore what a damaged one declares."""
    summary, _, expected = struct.unpack_from("<QQI", data, start)
    if expected and (summary > start or crc_of(data, summary or start - RECORD.size, start + 16) != expected):
        scan.declared, scan.summary_damaged = None, True


def crc_of(data: Buffer, start: int, end: int) -> int:
    """CRC-32 of a stretch, computed piece by piece because a slice of a mapped file is a copy."""
    crc = 0
    for position in range(start, end, 1 << 20):
        crc = zlib.crc32(data[position : min(position + (1 << 20), end)], crc)
    return crc


def record_header(data: Buffer, position: int) -> tuple[int, int]:
    """Opcode and length of the record at `position`."""
    opcode, length = RECORD.unpack_from(data, position)
    return opcode, length


def take_lost(scan: Scan, data: Buffer, position: int) -> int:
    """Note that nothing can be read at `position`. Returns the place of the next sound record or of the file's end.

    In a file with chunks, messages found outside of them are not used: they belong to a damaged chunk, whose checksum
    cannot be checked.
    """
    resume = resume_at(scan, data, position + 1, TO_RESUME_AT)
    scan.chunked |= data[position] == Opcode.CHUNK or (resume < len(data) and data[resume] in OF_CHUNKS)
    if not scan.chunked:
        resume = resume_at(scan, data, position + 1, TO_RESUME_AT_UNCHUNKED)
    if scan.data_end:
        scan.summary_damaged = True
    elif data[position] == Opcode.CHUNK:
        scan.sections.append(FileSection("lost chunk", position, resume))
    else:
        scan.sections.append(FileSection("lost", position, resume, harmless=data[position] == Opcode.MESSAGE_INDEX))
    return resume


def resume_at(scan: Scan, data: Buffer, begin: int, pattern: re.Pattern[bytes]) -> int:
    """Where the next sound record begins at which the scan can go on, or the end of the file."""
    while scan.candidates and (match := pattern.search(data, begin)):
        scan.candidates -= 1
        opcode, length = record_header(data, match.start())
        start = match.start() + RECORD.size
        if start + length <= len(data) and is_sound(data, opcode, start, start + length):
            return match.start()
        begin = match.start() + 1
    return len(data)


def is_sound(data: Buffer, opcode: int, start: int, end: int) -> bool:
    """Whether the content of a record fits its opcode. If this is uncertain, another record must follow."""
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
    """Whether a record, or the end of the file, follows."""
    return end == len(data) or data[end] in NUMBERED or data[end] >= PRIVATE
