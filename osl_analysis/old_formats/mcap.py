"""MCAP files: the records of the top level are walked, also past damage; then every intact chunk is
read.

The summary at the end is not needed. It is the evidence of what was lost, beside the message
indexes behind a chunk."""

import re
import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from osl_analysis.errors import InputError, naming, quoted
from osl_analysis.old_formats.message_fields import Indices, numbers_at
from osl_analysis.old_formats.messages import MessageBlock, MessageFile, RefusedFileError

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")  # opcode, length of the content
MESSAGE = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("pub", "<u8"),
    ]
)
MESSAGE_HEAD = MESSAGE.itemsize - RECORD.size  # within the content
# times of first and last message, size, checksum, length of the name
CHUNK_HEAD = struct.Struct("<QQQII")
# messages, chunks, bytes of the map of messages by channel
STATISTICS = struct.Struct("<Q14xI16xI")
MOST_UNPACKED = 1_000_000_000  # bytes of one chunk: recorders write a few million
# higher opcodes are private or of a later version: skipped
NUMBERED = range(Opcode.HEADER, Opcode.DATA_END + 1)
# beginnings of records at which reading can go on after damage
RESUME = re.compile(rb"[\x03-\x07\x0b].{6}\0\0|\x0f\x04\0{7}|\x02\x14\0{7}", re.DOTALL)
# records within a chunk, or in a file without chunks
LOOSE = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)


class DamagedChunkError(Exception):
    """The chunk cannot be read, or does not hold what was written. The message completes the
    sentence "it ..."."""


# the messages of a stretch of a file, and opcode and content of the schemas and channels among them
Stretch = tuple[MessageBlock, list[tuple[int, bytes]]]
# messages that follow one another to the byte, by the place of the first: their places, and where
# the last one ends
Runs = Mapping[int, tuple[Indices, int]]


class ChunkHead(NamedTuple):
    size: int  # bytes that it holds
    crc: int  # checksum of these; 0 if there is none
    name: bytes  # its compression; empty for none
    begin: int  # first byte of the compressed records in the file
    end: int


@dataclass
class Section:
    """One part of a file's data section: a chunk, messages outside of chunks, or neither, if it is
    lost."""

    start: int  # first byte: of the content of a chunk, else of the section
    end: int
    is_chunk: bool = False
    head: ChunkHead | None = None  # what a chunk declares of itself
    loose: Stretch | None = None  # the messages outside of chunks
    # messages of each channel that its message indexes list
    indexed: Counter[int] = field(default_factory=Counter)
    # where in the chunk these say that their messages stand
    places: list[Indices] = field(default_factory=list)


@dataclass
class McapFile(MessageFile):
    """A file whose top level was scanned."""

    data: bytes = b""
    sections: list[Section] = field(default_factory=list)  # the parts of the data section, in order
    data_end: int = 0  # where the data section ends; 0 until that is known
    is_data_right: bool | None = None  # by the checksum of the data section; None if there is none
    # schemas and channels in the summary
    described: list[tuple[int, bytes]] = field(default_factory=list)
    chunked: bool = False
    finished: bool = False  # the recorder closed the file
    summary_begin: int = 0  # where the summary begins: after the record that ends the data
    summary_damaged: bool = False
    # bytes by which the summary stands before the place at which it was written; negative if after
    missing: int = 0

    def scan(self) -> None:
        """Find the parts of the file, and note their damage; RefusedFileError if another log
        follows."""
        position, damage = len(MAGIC), self.damage
        while position < len(self.data) and not self.finished:
            position = self.scan_record(position)
        damage.end_missing = not self.finished
        self.data_end = self.data_end or len(self.data)
        lost = [one for one in self.sections if one.head is None and one.loose is None]
        if damage.end_missing and lost and lost[-1].end == len(self.data):
            # the record in which the file was cut off: nobody knows what it held
            self.sections.remove(lost.pop())
        damage.gaps |= self.summary_damaged or self.missing != 0 or bool(lost)
        damage.bytes = self.data_end - len(MAGIC) + max(0, self.missing)
        second = self.data.find(MAGIC + b"\1", 1) if damage.gaps or damage.end_missing else 0
        if second > 0:
            raise two_logs(second)
        if damage.end_missing:
            damage.remarks.append(
                "no footer: the recorder did not finish, or the end is lost; how much is not known"
            )
        elif self.summary_damaged:
            damage.remarks.append("the summary is damaged")
        if damage.end_missing or self.summary_damaged:  # what they declare is not to be trusted
            damage.expected, damage.declared, damage.declared_chunks = None, None, None
        if self.is_data_right is False:
            damage.remarks.append("the checksum of the data section does not match")
        if self.missing < 0:
            damage.remarks.append(f"{-self.missing} bytes were inserted before the summary")
        elif self.missing:
            damage.lose(
                f"{self.missing} bytes are missing before the summary", self.missing, None, 0
            )

    def scan_record(self, position: int) -> int:
        """Take in the record at a position; returns the position of the next one."""
        data, start = self.data, position + RECORD.size
        if start > len(data):
            return self.take_lost(position)
        opcode, length = RECORD.unpack_from(data, position)
        end = start + length
        if opcode in LOOSE:
            stretch, reached = walk_records(data, position)
            if reached > position:
                if self.data_end:
                    self.described += stretch[1]
                else:
                    self.sections.append(Section(position, reached, loose=stretch))
                return reached
        if end > len(data) or not self.is_sound(opcode, start, end):
            return self.take_lost(position)
        if opcode == Opcode.CHUNK:
            if self.data_end:  # a chunk after the end of the data shows that this was not the end
                self.data_end, self.is_data_right, self.summary_damaged = 0, None, True
            self.chunked = True
            self.sections.append(
                Section(start, end, is_chunk=True, head=chunk_head(data, start, end))
            )
        elif opcode == Opcode.MESSAGE_INDEX and not self.data_end:
            chunk = next((one for one in reversed(self.sections) if one.is_chunk), None)
            channel, size = struct.unpack_from("<HI", data, start)
            if chunk is not None:
                chunk.indexed[channel] += size // 16  # each entry has log time and place
                chunk.places.append(np.frombuffer(data, "<i8", size // 8, start + 6)[1::2])
        elif opcode == Opcode.DATA_END and not self.data_end:
            self.data_end, self.summary_begin = position, end
            (expected,) = struct.unpack_from("<I", data, start)
            self.is_data_right = zlib.crc32(data[:position]) == expected if expected else None
        elif (
            opcode == Opcode.HEADER
            and position > len(MAGIC)
            and data[position - len(MAGIC) : position] == MAGIC
        ):
            # the record before was cut off and reaches into another log
            raise two_logs(position - len(MAGIC))
        elif opcode == Opcode.FOOTER:
            self.take_footer(start, end)
        elif opcode == Opcode.STATISTICS:
            self.damage.expected, self.damage.declared_chunks, size = STATISTICS.unpack_from(
                data, start
            )
            entries = data[start + STATISTICS.size : min(start + STATISTICS.size + size, end)]
            by_channel = Counter(
                dict(struct.iter_unpack("<HQ", entries[: len(entries) // 10 * 10]))
            )
            if by_channel.total() == self.damage.expected:  # the map may be left empty
                self.damage.declared = by_channel
        return int(end)

    def take_footer(self, start: int, end: int) -> None:
        """Check that nothing follows, and the summary by its checksum and by the place where the
        footer says it is. If it stands elsewhere, bytes are missing before it, or were inserted; it
        still tells what the recorder wrote."""
        data, after = self.data, end + len(MAGIC)
        self.finished = data[end:after] == MAGIC
        if self.finished and len(data) > after:
            raise RefusedFileError(
                f"ends at byte {after} and has {len(data) - after} bytes after it; keep what is"
                f" before them (`head -c {after}`), and if they are another log, give that a file"
                " and a trial of its own (`tail -c`)"
            )
        declared, _, expected = struct.unpack_from("<QQI", data, start)
        is_wrong = expected and zlib.crc32(data[self.summary_begin : start + 16]) != expected
        self.summary_damaged |= not self.summary_begin or bool(is_wrong)
        self.missing = declared - self.summary_begin if declared and not self.summary_damaged else 0

    def take_lost(self, position: int) -> int:
        """Note that nothing can be read at `position`; returns the place of the next sound record
        or of the end. In a file with chunks, messages found outside of them belong to a damaged
        chunk, and nothing checks them."""
        data, is_chunk = self.data, self.data[position] == Opcode.CHUNK
        head = data[position : position + RECORD.size].ljust(RECORD.size, b"\xff")
        is_cut = (
            is_chunk
            and not data.endswith(MAGIC)
            and position + sum(RECORD.unpack(head)) > len(data)
        )
        resume = self.resume_at(position + 1, loose=False)
        # but a part of the chunk that was cut
        while is_cut and resume < len(data) and not self.holds_chunk(resume):
            resume = self.resume_at(resume + 1, loose=False)
        self.chunked |= is_chunk
        self.chunked |= resume < len(data) and data[resume] in (Opcode.CHUNK, Opcode.MESSAGE_INDEX)
        if not self.chunked:
            resume = self.resume_at(position + 1, loose=True)
        if self.data_end:
            self.summary_damaged = True
        else:
            self.sections.append(Section(position, resume, is_chunk=is_chunk))
        return resume

    def holds_chunk(self, position: int) -> bool:
        start = position + RECORD.size
        head = chunk_head(self.data, start, start + RECORD.unpack_from(self.data, position)[1])
        with suppress(DamagedChunkError):
            return (
                self.data[position] == Opcode.CHUNK
                and head is not None
                and bool(self.stretch_of(head))
            )
        return False

    def resume_at(self, begin: int, *, loose: bool) -> int:
        """Where the next sound record begins, `loose` ones too if asked for, or the end of the
        file."""
        while match := RESUME.search(self.data, begin):
            begin = match.start() + 1
            opcode, length = RECORD.unpack_from(self.data, match.start())
            end = match.end() + length
            if (
                end <= len(self.data)
                and (loose or opcode not in LOOSE)
                and self.is_sound(opcode, match.end(), end)
            ):
                return match.start()
        return len(self.data)

    def is_sound(self, opcode: int, start: int, end: int) -> bool:
        """Whether the content of a record fits its opcode; where nothing tells, another record must
        follow."""
        data, least = (
            self.data,
            {Opcode.DATA_END: 4, Opcode.FOOTER: 20, Opcode.STATISTICS: STATISTICS.size},
        )
        if opcode == 0 or any(
            opcode == kind and end - start < size for kind, size in least.items()
        ):
            return False
        if opcode == Opcode.CHUNK:
            return chunk_head(data, start, end) is not None
        if opcode == Opcode.MESSAGE_INDEX:
            size = struct.unpack_from("<I", data, start + 2)[0] if end - start >= 6 else 1
            return size % 16 == 0 and size <= end - start - 6
        if end == len(data) or data[end] in NUMBERED or opcode in (Opcode.DATA_END, Opcode.FOOTER):
            return True
        is_next = data[end] != 0 and end + RECORD.size <= len(data)
        return is_next and bool(end + RECORD.size + RECORD.unpack_from(data, end)[1] <= len(data))

    def intact_blocks(self) -> Iterator[MessageBlock]:
        """The messages of every intact chunk, and those outside of chunks, in the order of the
        file."""
        damage = self.damage
        if self.finished and not self.summary_damaged:  # a wrong schema would be wrong values
            self.take_declarations(self.described)
        any_lost = any(one.head is None and one.loose is None for one in self.sections)
        for section in self.sections:
            stretch, remark, lost = section.loose, "", section.indexed or None
            if section.head is not None:
                try:
                    # a frame of nothing
                    if section.head.size == 0 and (held := section.end - section.head.begin) > 32:
                        raise DamagedChunkError(f"declares no content and holds {held} bytes")
                    stretch = self.stretch_of(section.head, section.places)
                except DamagedChunkError as error:
                    if (second := self.data.find(MAGIC + b"\1", section.start, section.end)) > 0:
                        # the chunk was cut off and reaches into another log
                        raise two_logs(second) from error
                    remark = f"the chunk at byte {section.start} is damaged: it {error}"
            elif stretch is None:
                what = "a damaged chunk" if section.is_chunk else "not a readable record"
                remark = (
                    f"{section.end - section.start} bytes from byte {section.start} on are {what}"
                )
            is_covered = self.is_data_right or bool(section.head and section.head.crc)
            if stretch and self.is_data_right is False and not is_covered and not any_lost:
                what = "the checksum of the data section does not match, and no other covers byte"
                remark, lost = f"{what} {section.start} on", lost or stretch[0].counts
            if stretch is None or remark:
                damage.lose(remark, section.end - section.start, lost, int(section.is_chunk))
                continue
            block, declarations = stretch
            damage.chunks += section.is_chunk
            missed = section.indexed - block.counts
            # without a checksum a flipped opcode passes for a private one
            if missed and not is_covered:
                damage.lose(
                    f"{missed.total()} messages in the index of a chunk are not in it", 0, missed, 0
                )
            damage.read.update(block.counts)
            damage.verified += block.starts.size if is_covered else 0
            self.take_declarations(declarations)
            # the content of other messages is unknown
            if not block.counts.keys() <= self.channels.keys():
                known = np.isin(block.channel, list(self.channels))
                strangers = block.channel[~known]
                damage.misfits.update(strangers.tolist())
                text = "messages belong to channels that are not declared"
                damage.remarks.append(f"{strangers.size} {text}, such as {strangers[0]}")
                block = block.only(known)
            yield block
        self.data = b""  # an hour at 1 kHz is a third of a gigabyte
        is_missed = (damage.declared_chunks or 0) > damage.chunks + damage.chunks_lost
        damage.uncounted |= damage.expected is None and is_missed

    def stretch_of(self, head: ChunkHead, indexed: Sequence[Indices] = ()) -> Stretch:
        """The records of a chunk, with the places of its messages by its indexes; raises
        DamagedChunkError."""
        content = self.data[head.begin : head.end]
        if head.size > MOST_UNPACKED:
            raise DamagedChunkError(
                f"unpacks to {head.size / 1e9:.3g} GB, at most {MOST_UNPACKED / 1e9:g} GB are read"
            )
        try:
            if head.name == b"zstd":
                content = (
                    zstandard.ZstdDecompressor().decompress(content, head.size)
                    if head.size
                    else b""
                )
            elif head.name == b"lz4":
                content = lz4.frame.LZ4FrameDecompressor().decompress(content, head.size + 1)
            elif head.name != b"":
                name = head.name[:20].decode("latin1")
                raise DamagedChunkError(
                    f"says it is compressed with {name!a}; zstd and lz4 are read"
                )
        except (
            zstandard.ZstdError,
            OSError,
            RuntimeError,
            EOFError,
            ValueError,
            MemoryError,
            OverflowError,
        ) as error:
            raise DamagedChunkError("cannot be decompressed") from error
        if len(content) != head.size:
            raise DamagedChunkError(f"holds {len(content)} of {head.size} bytes")
        if head.crc and zlib.crc32(content) != head.crc:
            raise DamagedChunkError("does not match its checksum")
        runs = runs_of_messages(content, np.concatenate(indexed)) if indexed else {}
        stretch, reached = walk_records(content, 0, is_chunk=True, runs=runs)
        if reached != len(content):
            raise DamagedChunkError(
                f"holds no record at byte {reached} of its {len(content)} bytes"
            )
        return stretch

    def take_declarations(self, records: Sequence[tuple[int, bytes]]) -> None:
        """Take in schemas and channels; the library raises many kinds of errors on damaged
        bytes."""
        for opcode, content in dict.fromkeys(records):
            try:
                one = (Schema if opcode == Opcode.SCHEMA else Channel).read(
                    ReadDataStream(BytesIO(content))
                )
            except Exception:
                self.damage.remarks.append("a schema or a channel cannot be read")
            else:
                self.declare(one)


def read_mcap(path: Path) -> McapFile:
    """Scan a file. InputError if it is empty or no MCAP file."""
    data = path.read_bytes()
    if data[:8] != MAGIC and (len(data) < 64 or data[-8:] != MAGIC):
        said = f"{path}: not an MCAP file (it begins with {quoted(data[:8])})"
        raise InputError(f"{said}; check the path and the source's format")
    opened = McapFile(path, len(data), "MCAP", data=data)
    opened.blocks = opened.intact_blocks()
    opened.damage.remarks += ["the magic at the beginning is damaged"] * (data[:8] != MAGIC)
    with naming(path):
        opened.scan()
    return opened


def two_logs(place: int) -> RefusedFileError:
    """The number of a channel means one topic in the first log and may mean another in the
    second."""
    remedy = (
        "split them into two files there (`head -c`, `tail -c`) and give each a trial of its own"
    )
    return RefusedFileError(f"holds two logs, the second from byte {place} on: {remedy}")


def message_heads(buffer: bytes, places: Indices) -> NDArray[np.void]:
    # bytes are taken fastest
    return numbers_at(buffer, places, np.dtype(f"V{MESSAGE.itemsize}")).view(MESSAGE)


def runs_of_messages(buffer: bytes, places: Indices) -> Runs:
    """The messages at places (n,) that an index lists, as far as there are messages there."""
    places = np.sort(
        places[(places >= 0) & (places <= len(buffer) - MESSAGE.itemsize)], kind="stable"
    )
    heads = message_heads(buffer, places)
    lengths = heads["length"].astype(np.int64)
    within = (lengths >= MESSAGE_HEAD) & (lengths <= len(buffer) - RECORD.size - places)
    there = within & (heads["opcode"] == Opcode.MESSAGE)
    places, ends = places[there], (places + RECORD.size + lengths)[there]
    cuts = [0, *(np.flatnonzero(places[1:] != ends[:-1]) + 1).tolist(), len(places)]
    return {int(places[a]): (places[a:b], int(ends[b - 1])) for a, b in pairwise(cuts) if b}


def walk_records(
    buffer: bytes, begin: int, *, is_chunk: bool = False, runs: Runs = MappingProxyType({})
) -> tuple[Stretch, int]:
    """Walk from record to record to what is no record; in a chunk past opcodes that the format does
    not define. `runs` of messages are passed at one go. Gives also where the walk ended."""
    others, messages, position, end = list[tuple[int, bytes]](), list[int](), begin, len(buffer)
    passed = list[Indices]()
    while position + RECORD.size <= end:
        if position in runs:
            run, position = runs[position]
            passed.append(run)
            continue
        opcode, length = RECORD.unpack_from(buffer, position)
        start = position + RECORD.size
        if start + length > end:
            break
        if opcode == Opcode.MESSAGE and length >= MESSAGE_HEAD:
            messages.append(position)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            others.append((opcode, buffer[start : start + length]))
        elif not is_chunk or opcode in NUMBERED or opcode == 0:
            break
        position = start + length
    places = np.sort(np.concatenate([np.array(messages, np.int64), *passed]), kind="stable")
    heads = message_heads(buffer, places)
    lengths, logged = (heads[name].astype(np.int64) for name in ("length", "log_time"))
    channel, sequence = heads["channel"].astype(np.uint16), heads["sequence"].astype(np.uint32)
    starts = places + MESSAGE.itemsize
    block = MessageBlock(buffer, channel, sequence, logged, starts, lengths - MESSAGE_HEAD)
    return (block, others), position


def chunk_head(data: bytes, start: int, end: int) -> ChunkHead | None:
    """The head of the chunk that is the content of a record, maybe of a later version; None if it
    does not fit in."""
    if end - start < CHUNK_HEAD.size + 8:
        return None
    _, _, size, crc, length = CHUNK_HEAD.unpack_from(data, start)
    begin = start + CHUNK_HEAD.size + length + 8
    if length > 32 or begin > end:  # a longer name of a compression is damage
        return None
    stop = begin + struct.unpack_from("<Q", data, begin - 8)[0]
    return (
        ChunkHead(size, crc, data[begin - 8 - length : begin - 8], begin, stop)
        if stop <= end
        else None
    )
