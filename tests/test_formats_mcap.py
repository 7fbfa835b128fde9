"""MCAP files: of damaged ones every intact chunk is recovered, what is lost is said, and nothing that is read is wrong.

Legal and rare ones are read as the official reader does; two logs in one are refused. What no writer writes is written
here byte by byte.
"""

import random
import struct
import zlib
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType
from mcap_builder import stamped, write_log
from recognised_files import refusal_by
from test_ingest_every_log import mutilated

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap import CHUNK_HEAD, MAGIC, RECORD, read_mcap
from osl_analysis.formats.messages import read_channels
from osl_analysis.ingest.raw_files import FORMATS
from osl_analysis.ingest.source import Recording, Source


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value)) + value


def schema(content: bytes = b"float64 a", more: bytes = b"") -> bytes:
    body = struct.pack("<H", 1) + text(b"lab_msgs/msg/S") + text(b"ros2msg") + text(content)
    return record(Opcode.SCHEMA, body + more)


def channel(number: int, topic: bytes, more: bytes = b"") -> bytes:
    return record(Opcode.CHANNEL, struct.pack("<HH", number, 1) + text(topic) + text(b"cdr") + text(b"") + more)


def cdr(value: float) -> bytes:
    return b"\0\1\0\0" + struct.pack("<d", value)


def message(number: int, time: int, payload: bytes, sequence: int = 0, publish: int = 0) -> bytes:
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", number, sequence, time, publish) + payload)


def messages(number: int, values: range) -> bytes:
    """One per millisecond, each with its own value."""
    return b"".join(message(number, i * MILLISECOND, cdr(float(i)), i) for i in values)


def chunk(content: bytes, crc: bool = True, more: bytes = b"") -> bytes:
    packed = zstandard.ZstdCompressor().compress(content)
    head = struct.pack("<QQQI", 0, 1 << 62, len(content), zlib.crc32(content) if crc else 0)
    return record(Opcode.CHUNK, head + text(b"zstd") + struct.pack("<Q", len(packed)) + packed + more)


def index(number: int, entries: list[tuple[int, int]], more: bytes = b"") -> bytes:
    packed = b"".join(struct.pack("<QQ", *entry) for entry in entries)
    return record(Opcode.MESSAGE_INDEX, struct.pack("<H", number) + text(packed) + more)


def statistics(counts: dict[int, int], chunks: int, more: bytes = b"", of_channels: bool = True) -> bytes:
    by_channel = b"".join(struct.pack("<HQ", *count) for count in counts.items()) if of_channels else b""
    head = struct.pack("<QHIIIIQQ", sum(counts.values()), 1, len(counts), 0, 0, chunks, 0, 0)
    return record(Opcode.STATISTICS, head + text(by_channel) + more)


def header(more: bytes = b"") -> bytes:
    return record(Opcode.HEADER, text(b"") + text(b"") + more)


def log(*parts: bytes, summary: bytes = b"", more: bytes = b"", shift: int = 0, crc: bool = True) -> bytes:
    """A whole file of these parts; the footer says that the summary begins `shift` bytes later than it does."""
    data = MAGIC + header(more) + b"".join(parts) + DATA_END[:1] + struct.pack("<Q", 4 + len(more)) + bytes(4) + more
    begin = len(data) + shift if summary else 0
    opening = struct.pack("<BQ", Opcode.FOOTER, 20 + len(more)) + struct.pack("<QQ", begin, 0)
    return data + summary + opening + struct.pack("<I", zlib.crc32(summary + opening) if crc else 0) + more + MAGIC


MESSAGES, MILLISECOND = 60, 1_000_000
DATA_END = record(Opcode.DATA_END, bytes(4))
ANY_PACKING = pytest.mark.parametrize("packing", [CompressionType.ZSTD, CompressionType.NONE, CompressionType.LZ4])


def source(field: str, topic: str, time: str, **options: Any) -> Source:
    channels = {"theta": {"topic": topic, "field": field, "unit": "rad"}}
    described = {"format": "mcap", "time": {"source": time}, "channels": channels, **options}
    return FORMATS["mcap"].source.model_validate(described)


def written(folder: Path, packing: CompressionType = CompressionType.ZSTD) -> bytes:
    """A log of 60 messages, ten or so in a chunk; theta is 1 + the number of milliseconds since the first stamp."""
    log = [stamped(i * MILLISECOND, angle=1.0 + i, torque=0.0, sync=False) for i in range(MESSAGES)]
    return write_log(folder / "log.mcap", log, chunk_size=800, compression=packing).read_bytes()


def top_level(content: bytes, *opcodes: int) -> list[tuple[int, int]]:
    """Start and end of each whole record of some opcodes, headers included."""
    position, found = 8, []
    while position + 9 <= len(content) - 8:
        opcode, length = RECORD.unpack_from(content, position)
        found += [(position, position + 9 + length)] * (opcode in opcodes)
        position += 9 + length
    return found


def chunks(content: bytes) -> list[tuple[int, int, int]]:
    """Start and end of each chunk, and how many messages the record behind it lists."""
    indexes = top_level(content, Opcode.MESSAGE_INDEX)
    sizes = [(end - start - 15) // 16 for start, end in indexes]
    return [(*one, size) for one, size in zip(top_level(content, Opcode.CHUNK), sizes, strict=True)]


def read(folder: Path, content: bytes, largest_loss: float = 1.0) -> tuple[pl.DataFrame, dict[str, Any]]:
    """Samples and damage report; whatever was read must be what was written."""
    path = folder / "damaged.mcap"
    path.write_bytes(content)
    recording = FORMATS["mcap"].read(path, source("angle", "/lab", "header", largest_loss=largest_loss))
    milliseconds = np.rint(recording.samples["time"].to_numpy() * 1000) + recording.facts["time"]["start_ns"] / 1e6
    np.testing.assert_array_equal(recording.samples["theta"], 1 + milliseconds)
    return recording.samples, recording.facts["damage"]


@ANY_PACKING
def test_wherever_a_file_is_cut_every_whole_chunk_is_recovered(tmp_path: Path, packing: CompressionType) -> None:
    content = written(tmp_path, packing)
    for cut in range(chunks(content)[0][1], len(content), 37):
        samples, damage = read(tmp_path, content[:cut], 0.0)
        assert len(samples) == sum(size for _, end, size in chunks(content) if end <= cut)
        del damage["topics"]["/lab"]["messages"]
        assert damage == {  # one rule for every byte
            "complete": False,
            "crc": "checked",
            "chunks_lost": None,
            "messages_lost": None,
            "share_lost": 0.0,
            "topics": {"/lab": {"messages_lost": None}},
            "remarks": ["no footer: the recorder did not finish, or the end is lost; how much is not known"],
        }


@ANY_PACKING
@pytest.mark.parametrize("is_finished", [True, False])  # not by a recorder that was killed
def test_a_chunk_with_an_absurd_length_costs_itself_alone(
    tmp_path: Path, packing: CompressionType, is_finished: bool
) -> None:
    whole = written(tmp_path, packing)
    content = whole if is_finished else whole[: top_level(whole, Opcode.DATA_END)[0][0]]
    start, _, lost = chunks(whole)[2]
    for length in (2**64 - 1, 2**40, 0, 60):
        samples, damage = read(tmp_path, content[: start + 1] + struct.pack("<Q", length) + content[start + 9 :])
        assert len(samples) == MESSAGES - lost
        assert (damage["chunks_lost"], damage["messages_lost"]) == ((1, lost) if is_finished else (None, None))
        assert damage["share_lost"] == pytest.approx(lost / MESSAGES)


def test_a_flipped_bit_in_an_opcode_loses_no_message(tmp_path: Path) -> None:
    content = written(tmp_path)
    for kind in (Opcode.CHUNK, Opcode.DATA_END):
        place = top_level(content, kind)[-1][0]
        for bit in range(8):
            flipped = content[:place] + bytes([content[place] ^ 1 << bit]) + content[place + 1 :]
            samples, damage = read(tmp_path, flipped)
            assert (len(samples), damage["messages_lost"]) == (MESSAGES, 0)
    for opcode in (Opcode.SCHEMA, Opcode.CHANNEL):  # behind loose schemas, a walk over these would take it for another
        content = log(LAB, bytes([opcode]) + chunk(TEN)[1:], chunk(TWENTY), summary=statistics({1: 20}, 2))
        assert ingested(tmp_path, content).samples["theta"].to_list() == list(range(20))


def test_a_wrong_message_index_changes_nothing_and_is_remarked(tmp_path: Path) -> None:
    content = written(tmp_path)
    entry = top_level(content, Opcode.MESSAGE_INDEX)[1][0] + 9 + 6 + 16 + 8  # the second message's offset
    for wrong in (b"\0" * 8, b"\xff" * 8, b"\x01" + b"\0" * 7, bytes(8 + 16 * 3)):
        samples, damage = read(tmp_path, content[:entry] + wrong + content[entry + len(wrong) :], 0.0)
        assert (len(samples), damage["complete"]) == (MESSAGES, True)
        assert "the index of the chunk" in damage["remarks"][0]
        (found,) = read_channels(read_mcap(tmp_path / "damaged.mcap"))
        assert (np.diff(found.log_time) == MILLISECOND).all()


def test_records_that_no_recorder_writes_among_the_chunks_hide_none_of_them(tmp_path: Path) -> None:
    content = written(tmp_path)
    start = chunks(content)[1][0]
    unknown = record(Opcode.CHUNK, CHUNK_HEAD.pack(0, 0, 9, 0, 4) + b"xyz\n" + struct.pack("<Q", 3) + b"abc")
    samples, damage = read(tmp_path, content[:start] + unknown + content[start:])
    assert len(samples) == MESSAGES
    assert any(r"is compressed with 'xyz\n'; zstd and lz4 are read" in remark for remark in damage["remarks"])
    samples, damage = read(tmp_path, content[:start] + DATA_END + content[start:])
    assert (len(samples), damage["complete"]) == (MESSAGES, False)
    behind = ingested(tmp_path, log(LAB, DATA_END, chunk(TEN), TWENTY))  # nor the messages outside of chunks
    assert behind.samples["theta"].to_list() == list(range(20))


def test_a_schema_from_a_damaged_summary_reads_nothing(tmp_path: Path) -> None:
    content = written(tmp_path)
    first, rest = content[: chunks(content)[0][1] - 3], content[chunks(content)[0][1] :]
    damaged = first + b"abc" + rest.replace(b"float32 angle\nfloat64 torque", b"float32 wrong\nfloat32  angle")
    with pytest.raises(InputError, match="messages belong to channels that are not declared"):
        read(tmp_path, damaged)


def test_what_holds_no_log_is_refused_in_one_line(tmp_path: Path) -> None:
    for content in (b"", bytes(300), MAGIC, MAGIC * 2, MAGIC + b"\xff" * 99):
        with pytest.raises(InputError, match=r"^[^\n]+damaged.mcap: [^\n]+$"):
            read(tmp_path, content)


@ANY_PACKING
def test_no_damage_crashes_the_reader_or_changes_a_value(tmp_path: Path, packing: CompressionType) -> None:
    whole = written(tmp_path, packing)
    for seed in range(100):
        content, chance = whole, random.Random(seed)
        for _ in range(chance.randint(1, 6)):
            content = mutilated(content, chance) or MAGIC
        with suppress(InputError):
            read(tmp_path, content)


def ingested(folder: Path, content: bytes, topic: str = "/lab", **options: Any) -> Recording:
    (folder / "log.mcap").write_bytes(content)
    return FORMATS["mcap"].read(folder / "log.mcap", source("a", topic, "log", **options))


def losses(folder: Path, content: bytes) -> tuple[Any, ...]:
    """Whether a file is complete, chunks lost, messages lost (also as inspect says), of these of the topic `/lab`."""
    damage = ingested(folder, content, largest_loss=1.0).facts["damage"]
    told = FORMATS["mcap"].inspect(folder / "log.mcap").facts["messages lost"]
    lost = damage["messages_lost"]
    assert told == ("the file does not tell" if lost is None else str(lost))
    return damage["complete"], damage["chunks_lost"], lost, *damage["topics"]["/lab"].values()


def refused(folder: Path, content: bytes) -> str:
    """What both ingest and inspect say."""
    (folder / "log.mcap").write_bytes(content)
    said = refusal_by(FORMATS["mcap"].read, folder / "log.mcap", source("a", "/lab", "log"))
    assert said == refusal_by(FORMATS["mcap"].inspect, folder / "log.mcap")
    return said


LAB = schema() + channel(1, b"/lab")
TEN, TWENTY = messages(1, range(10)), messages(1, range(10, 20))
AT = [i * len(TEN) // 10 for i in range(10)]
ENTRIES = [(i * MILLISECOND, AT[i]) for i in range(10)]
PRIVATE, PADDING = record(0x85, b"ours") + record(0x40, b"of a later version"), b"\1\2\3\4\5"
LEGAL = {
    "longer records": log(
        schema(more=PADDING) + channel(1, b"/lab", more=PADDING),
        chunk(TEN, more=PADDING) + index(1, ENTRIES, PADDING),
        chunk(TWENTY, crc=False, more=PADDING),
        summary=statistics({1: 20}, 2, PADDING),
        more=PADDING,
    ),
    "private records": log(
        PRIVATE + LAB + PRIVATE,
        chunk(PRIVATE + TEN[: AT[3]] + PRIVATE + TEN[AT[3] :] + PRIVATE) + PRIVATE,
        chunk(TWENTY) + PRIVATE,
        summary=PRIVATE + statistics({1: 20}, 2) + PRIVATE,
    ),
    "private records in a chunk with an index": log(
        LAB, chunk(TEN + PRIVATE, crc=False), index(1, ENTRIES), PRIVATE, chunk(TWENTY), summary=statistics({1: 20}, 2)
    ),
    "messages outside of the chunks": log(
        LAB, chunk(TEN), index(1, ENTRIES), TWENTY[: AT[5]], PRIVATE, TWENTY[AT[5] :], summary=statistics({1: 20}, 1)
    ),
    "no statistics": log(LAB, chunk(TEN), chunk(TWENTY)),
    "no channels": log(LAB, chunk(TEN), chunk(TWENTY), summary=statistics({1: 20}, 2, of_channels=False)),
}


@pytest.mark.parametrize("content", LEGAL.values(), ids=LEGAL)
def test_a_legal_file_is_complete_and_read_as_by_the_official_reader(tmp_path: Path, content: bytes) -> None:
    recording = ingested(tmp_path, content, largest_loss=0.0)
    official = [struct.unpack("<d", m.data[4:])[0] for _, _, m in NonSeekingReader(BytesIO(content)).iter_messages()]
    assert recording.samples["theta"].to_list() == official == list(range(20))
    assert losses(tmp_path, content) == (True, 0, 0, 20, 0)


def test_the_loss_is_that_of_the_topic_and_not_of_the_file(tmp_path: Path) -> None:
    bad = b"".join(message(2, i * MILLISECOND, cdr(1.0)[: 9 if i % 5 == 0 else 12]) for i in range(100))
    two = LAB + channel(2, b"/rare")
    content = log(two, chunk(messages(1, range(10_000)) + bad), summary=statistics({1: 10_000, 2: 100}, 1))
    assert len(ingested(tmp_path, content).samples) == 10_000
    with pytest.raises(InputError, match="20 % of topic '/rare' is lost, at most 1 % may be"):
        ingested(tmp_path, content, "/rare")
    damage = ingested(tmp_path, content, "/rare", largest_loss=0.2).facts["damage"]
    assert damage["topics"] == {"/rare": {"messages": 100, "messages_lost": 20}}
    assert damage["share_lost"] == pytest.approx(0.2)


@pytest.mark.parametrize("crc", [True, False])
def test_a_chunk_that_was_cut_out_is_counted_by_topic_from_the_statistics(tmp_path: Path, crc: bool) -> None:
    removed, kept = chunk(TWENTY), TEN + message(2, 0, cdr(1.0)) + message(2, 15 * MILLISECOND, cdr(2.0))
    parts, summary = (LAB + channel(2, b"/rare"), chunk(kept)), statistics({1: 20, 2: 2}, 2)
    content = log(*parts, summary=summary, shift=len(removed), crc=False)
    if crc:  # the recorder's checksum was computed with the summary where it was
        content = log(*parts, removed, summary=summary).replace(removed, b"")
    assert len(ingested(tmp_path, content, "/rare").samples) == 2
    assert losses(tmp_path, content) == (False, 1, 10, 10, 10)
    remarks = ingested(tmp_path, content, largest_loss=1.0).facts["damage"]["remarks"]
    assert f"{len(removed)} bytes are missing before the summary" in remarks
    with pytest.raises(InputError, match="damaged or incomplete MCAP: 50 % of topic '/lab' is lost, at most 1 % may"):
        ingested(tmp_path, content)


def test_what_a_file_does_not_tell_of_its_losses_is_unknown(tmp_path: Path) -> None:
    cut_out = log(LAB, chunk(TEN), summary=LAB, shift=len(chunk(TWENTY)), crc=False)
    assert losses(tmp_path, cut_out) == (False, 0, None, 10, None)
    assert ingested(tmp_path, cut_out, largest_loss=1.0).facts["damage"]["share_lost"] > 0.1
    with pytest.raises(InputError, match="of topic '/lab' is lost"):
        ingested(tmp_path, cut_out)
    entries = record(Opcode.CHUNK_INDEX, bytes(60)) * 2  # of more chunks than there are
    assert losses(tmp_path, log(LAB, chunk(TEN), summary=entries)) == (False, 1, None, 10, None)


def test_what_contradicts_a_files_own_counts_is_not_complete(tmp_path: Path) -> None:
    more = log(LAB, chunk(TEN), chunk(TWENTY), summary=statistics({1: 10}, 2))
    assert losses(tmp_path, more) == (False, 0, 0, 20, 0)
    assert "it declares 10 messages and holds 20" in ingested(tmp_path, more).facts["damage"]["remarks"]
    turned = TEN[: AT[4]] + b"\x85" + TEN[AT[4] + 1 :]  # without a checksum, a message may pass for a private record
    content = log(LAB, chunk(turned, crc=False), index(1, ENTRIES), chunk(TWENTY))
    assert losses(tmp_path, content) == (False, 0, 1, 19, 1)


def test_the_time_of_a_message_is_when_it_was_logged_and_not_when_it_was_published(tmp_path: Path) -> None:
    late = [message(1, 7 + 3 * i * MILLISECOND, cdr(i), i, publish=i * MILLISECOND) for i in range(20)]
    recording = ingested(tmp_path, log(LAB, chunk(b"".join(late))))
    np.testing.assert_allclose(recording.samples["time"], 3e-3 * np.arange(20), rtol=1e-12)
    assert recording.facts["time"] == {"source": "log", "stamps": "auto", "start_ns": 7}


OTHER = log(schema() + channel(1, b"/other") + channel(2, b"/lab"), chunk(messages(1, range(30, 40))))
FIRST = log(LAB, chunk(TEN), chunk(TWENTY), summary=statistics({1: 20}, 2))


def test_a_log_behind_one_that_was_not_finished_is_refused_wherever_that_ends(tmp_path: Path) -> None:
    ends = [FIRST.index(part) + len(part) - 8 - len(header()) for part in (chunk(TEN), chunk(TWENTY))]
    for cut in [*range(len(log()), len(FIRST), 7), *ends]:  # a cut chunk may end with the header of the second log
        assert f"holds two logs, the second from byte {cut} on: split them" in refused(tmp_path, FIRST[:cut] + OTHER)
    unfinished = FIRST[: FIRST.index(chunk(TWENTY)) + len(chunk(TWENTY))]
    said = refused(tmp_path, unfinished + OTHER[8 + len(header()) :])
    assert "channel 1 is '/lab' in one part of the file and '/other' in another" in said


@pytest.mark.parametrize("packed", [chunk, bytes])
def test_a_log_that_was_appended_without_its_magic_is_refused(tmp_path: Path, packed: Any) -> None:
    more = log(LAB, packed(messages(1, range(30, 40))))[8:]  # the same numbers mean the same
    data, whole = log(LAB, packed(TEN)), header() + LAB + packed(TEN)
    for begin in (data[: 8 + len(whole)], data[:-8], data[:-37]):  # nor is it one behind the end of the data
        assert f"holds two logs, the second from byte {len(begin)} on: split" in refused(tmp_path, begin + more)
    flipped = b"\1" + TEN[1:]  # a message with the opcode of a header is none
    assert ingested(tmp_path, log(LAB, flipped)).samples["theta"].to_list() == list(range(1, 10))


def test_bytes_after_the_end_are_refused_with_the_byte_to_cut_at(tmp_path: Path) -> None:
    for more in (bytes(100), OTHER):
        said = refused(tmp_path, FIRST + more)
        assert f"ends at byte {len(FIRST)} and has {len(more)} bytes after it; keep what is before them" in said
        assert f"`head -c {len(FIRST)}`" in said


@pytest.mark.parametrize("crc", [True, False])
def test_a_number_with_two_meanings_is_refused(tmp_path: Path, crc: bool) -> None:
    for what, again in (("channel", channel(1, b"/other")), ("schema", schema(b"float64 b\nfloat64 a"))):
        said = refused(tmp_path, log(LAB, chunk(LAB + TEN, crc=crc), chunk(again + TWENTY, crc=crc)))
        assert f"{what} 1 is " in said
        assert "two logs were joined, or the file is damaged" in said
