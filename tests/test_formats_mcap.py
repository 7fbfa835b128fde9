"""MCAP files: of damaged ones every intact chunk is recovered, what is lost is said, and nothing that is read is wrong.

Legal and rare ones are read as the official reader does; two logs in one are refused.
"""

import random
import struct
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType
from mcap_builder import stamped, write_log
from mcap_bytes import cdr, channel, chunk, header, index, log, message, messages, record, schema, statistics
from test_ingest_every_log import mutilated

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap import CHUNK_HEAD, MAGIC, RECORD, read_mcap
from osl_analysis.formats.messages import read_channels
from osl_analysis.ingest.raw_files import FORMATS
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source import Source

MESSAGES = 60
MILLISECOND = 1_000_000


def source(field: str, topic: str, time: dict[str, str], **options: Any) -> Source:
    channels = {"theta": {"topic": topic, "field": field, "unit": "rad"}}
    return FORMATS["mcap"].source.model_validate({"format": "mcap", "time": time, "channels": channels, **options})


def written(folder: Path, **options: Any) -> bytes:
    """A log of 60 messages, ten or so in a chunk; theta is 1 + the number of milliseconds since the first stamp."""
    log = [stamped(i * MILLISECOND, angle=1.0 + i, torque=0.0, sync=False) for i in range(MESSAGES)]
    return write_log(folder / "log.mcap", log, **{"chunk_size": 800, **options}).read_bytes()


def top_level(content: bytes) -> list[tuple[int, int, int]]:
    """Opcode, start and end of each whole record, headers included."""
    position, found = 8, []
    while position + 9 <= len(content) - 8:
        opcode, length = RECORD.unpack_from(content, position)
        found.append((opcode, position, position + 9 + length))
        position += 9 + length
    return found


def chunks(content: bytes) -> list[tuple[int, int]]:
    return [(start, end) for opcode, start, end in top_level(content) if opcode == Opcode.CHUNK]


def read(folder: Path, content: bytes, largest_loss: float = 1.0) -> tuple[pl.DataFrame, dict[str, Any]]:
    """Samples and damage report; whatever was read must be what was written."""
    path = folder / "damaged.mcap"
    path.write_bytes(content)
    asked = source("angle", "/lab", {"source": "header"}, largest_loss=largest_loss)
    recording = FORMATS["mcap"].read(path, asked)
    milliseconds = np.rint(recording.samples["time"].to_numpy() * 1000) + recording.facts["time"]["start_ns"] / 1e6
    np.testing.assert_array_equal(recording.samples["theta"], 1 + milliseconds)
    return recording.samples, recording.facts["damage"]


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.NONE, CompressionType.LZ4])
def test_wherever_a_file_is_cut_every_whole_chunk_is_recovered(tmp_path: Path, compression: CompressionType) -> None:
    content = written(tmp_path, compression=compression)
    ends = [end for _, end in chunks(content)]
    counts = np.cumsum([0, *messages_in_chunks(content)])
    report = None
    for cut in range(ends[0], len(content), 37):
        samples, damage = read(tmp_path, content[:cut], 0.0)
        assert len(samples) == counts[sum(end <= cut for end in ends)]
        del damage["topics"]["/lab"]["messages"]
        report = report or damage
        assert damage == report  # one rule for every byte
    assert report == {
        "complete": False,
        "crc": "checked",
        "chunks_lost": None,
        "messages_lost": None,
        "share_lost": 0.0,
        "topics": {"/lab": {"messages_lost": None}},
        "remarks": ["no footer: the recorder did not finish, or the end is lost; how much is not known"],
    }


def messages_in_chunks(content: bytes) -> list[int]:
    """From the message index records that follow each chunk."""
    counts: list[int] = []
    for opcode, start, end in top_level(content):
        if opcode == Opcode.CHUNK:
            counts.append(0)
        elif opcode == Opcode.MESSAGE_INDEX:
            counts[-1] += (end - start - 15) // 16
    return counts


@pytest.mark.parametrize("length", [2**64 - 1, 2**40, 0, 60])
@pytest.mark.parametrize("with_summary", [True, False])
@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.NONE])
def test_a_chunk_with_an_absurd_length_costs_itself_alone(
    tmp_path: Path, length: int, with_summary: bool, compression: CompressionType
) -> None:
    content = written(tmp_path, compression=compression)
    if not with_summary:  # as a recorder that was killed leaves it
        content = content[: next(start for opcode, start, _ in top_level(content) if opcode == Opcode.DATA_END)]
    start = chunks(content)[2][0]
    lost = messages_in_chunks(content)[2]
    damaged = content[: start + 1] + struct.pack("<Q", length) + content[start + 9 :]
    samples, damage = read(tmp_path, damaged)
    assert len(samples) == MESSAGES - lost
    assert (damage["chunks_lost"], damage["messages_lost"]) == ((1, lost) if with_summary else (None, None))
    assert damage["share_lost"] == pytest.approx(lost / MESSAGES)


@pytest.mark.parametrize("record", [Opcode.CHUNK, Opcode.DATA_END])
def test_a_flipped_bit_in_an_opcode_loses_no_message(tmp_path: Path, record: Opcode) -> None:
    content = written(tmp_path)
    place = [start for opcode, start, _ in top_level(content) if opcode == record][-1]
    for bit in range(8):
        flipped = content[:place] + bytes([content[place] ^ 1 << bit]) + content[place + 1 :]
        samples, damage = read(tmp_path, flipped)
        assert len(samples) == MESSAGES
        assert damage["messages_lost"] == 0


@pytest.mark.parametrize("wrong", [b"\0" * 8, b"\xff" * 8, b"\x01" + b"\0" * 7, bytes(8 + 16 * 3)])
def test_a_wrong_message_index_changes_nothing_and_is_remarked(tmp_path: Path, wrong: bytes) -> None:
    content = written(tmp_path)
    _, index, *_ = (start for opcode, start, _ in top_level(content) if opcode == Opcode.MESSAGE_INDEX)
    entry = index + 9 + 6 + 16 + 8  # the second message's offset
    samples, damage = read(tmp_path, content[:entry] + wrong + content[entry + len(wrong) :], 0.0)
    assert len(samples) == MESSAGES
    assert damage["complete"]
    assert "the index of the chunk" in damage["remarks"][0]
    (survey,) = read_channels(read_mcap(tmp_path / "damaged.mcap"))
    assert (np.diff(survey.log_time) == MILLISECOND).all()


def test_a_chunk_of_unknown_compression_is_lost_and_named(tmp_path: Path) -> None:
    content = written(tmp_path)
    start = chunks(content)[1][0]
    unknown = record(Opcode.CHUNK, CHUNK_HEAD.pack(0, 0, 9, 0, 4) + b"xyz\n" + struct.pack("<Q", 3) + b"abc")
    samples, damage = read(tmp_path, content[:start] + unknown + content[start:])
    assert len(samples) == MESSAGES
    assert any(r"is compressed with 'xyz\n'; zstd and lz4 are read" in remark for remark in damage["remarks"])


def test_a_stray_end_of_the_data_does_not_hide_the_chunks_after_it(tmp_path: Path) -> None:
    content = written(tmp_path)
    start = chunks(content)[1][0]
    samples, damage = read(tmp_path, content[:start] + record(Opcode.DATA_END, bytes(4)) + content[start:])
    assert len(samples) == MESSAGES
    assert not damage["complete"]
    content = log(LAB, record(Opcode.DATA_END, bytes(4)), chunk(TEN), TWENTY)  # nor the messages outside of chunks
    assert ingested(tmp_path, content).samples["theta"].to_list() == list(range(20))


def test_a_schema_from_a_damaged_summary_reads_nothing(tmp_path: Path) -> None:
    content = written(tmp_path)
    first, rest = content[: chunks(content)[0][1] - 3], content[chunks(content)[0][1] :]
    damaged = first + b"abc" + rest.replace(b"float32 angle\nfloat64 torque", b"float32 wrong\nfloat32  angle")
    with pytest.raises(InputError, match="messages belong to channels that are not declared"):
        read(tmp_path, damaged)


@pytest.mark.parametrize("content", [b"", bytes(300), MAGIC, MAGIC * 2, MAGIC + b"\xff" * 99])
def test_what_holds_no_log_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(InputError, match=r"^[^\n]+damaged.mcap: [^\n]+$"):
        read(tmp_path, content)


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.NONE, CompressionType.LZ4])
def test_no_damage_crashes_the_reader_or_changes_a_value(tmp_path: Path, compression: CompressionType) -> None:
    whole = written(tmp_path, compression=compression)
    for seed in range(100):
        content, chance = whole, random.Random(seed)
        for _ in range(chance.randint(1, 6)):
            content = mutilated(content, chance) or MAGIC
        with suppress(InputError):
            read(tmp_path, content)


PRIVATE = record(0x85, b"ours") + record(0x40, b"of a later version")
PADDING = b"\1\2\3\4\5"


def ingested(folder: Path, content: bytes, topic: str = "/lab", **options: Any) -> Recording:
    (folder / "log.mcap").write_bytes(content)
    return FORMATS["mcap"].read(folder / "log.mcap", source("a", topic, {"source": "log"}, **options))


def refused(folder: Path, content: bytes, topic: str = "/lab") -> str:
    """What both ingest and inspect say."""
    (folder / "log.mcap").write_bytes(content)
    said = []
    for reader in (
        lambda path: FORMATS["mcap"].read(path, source("a", topic, {"source": "log"})),
        FORMATS["mcap"].inspect,
    ):
        with pytest.raises(InputError) as caught:
            reader(folder / "log.mcap")
        said.append(str(caught.value))
    assert said[0] == said[1]
    assert said[0].startswith(str(folder / "log.mcap"))
    assert "\n" not in said[0]
    return said[0]


LAB = schema() + channel(1, b"/lab")
TEN = b"".join(messages(1, range(10)))
TWENTY = b"".join(messages(1, range(10, 20)))
AT = [i * len(messages(1, range(1))[0]) for i in range(10)]
ENTRIES = [(i * 1_000_000, AT[i]) for i in range(10)]

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
    "statistics without channels": log(
        LAB, chunk(TEN), chunk(TWENTY), summary=statistics({1: 20}, 2, of_channels=False)
    ),
}


@pytest.mark.parametrize("content", LEGAL.values(), ids=LEGAL)
def test_a_legal_file_is_complete_and_read_as_by_the_official_reader(tmp_path: Path, content: bytes) -> None:
    recording = ingested(tmp_path, content, largest_loss=0.0)
    official = [struct.unpack("<d", m.data[4:])[0] for _, _, m in NonSeekingReader(BytesIO(content)).iter_messages()]
    assert recording.samples["theta"].to_list() == official == list(range(20))
    damage = recording.facts["damage"]
    assert (damage["complete"], damage["messages_lost"], damage["chunks_lost"]) == (True, 0, 0)
    assert damage["topics"] == {"/lab": {"messages": 20, "messages_lost": 0}}
    assert FORMATS["mcap"].inspect(tmp_path / "log.mcap").facts["messages lost"] == "0"


def test_a_chunk_behind_loose_schemas_whose_opcode_turned_into_theirs_is_read(tmp_path: Path) -> None:
    for opcode in (Opcode.SCHEMA, Opcode.CHANNEL):  # a walk over the loose records would take it for one of them
        content = log(LAB, bytes([opcode]) + chunk(TEN)[1:], chunk(TWENTY), summary=statistics({1: 20}, 2))
        assert ingested(tmp_path, content).samples["theta"].to_list() == list(range(20))


def test_without_a_checksum_a_message_that_turned_into_a_private_record_is_lost(tmp_path: Path) -> None:
    flipped = TEN[: AT[4]] + b"\x85" + TEN[AT[4] + 1 :]
    content = log(LAB, chunk(flipped, crc=False), index(1, ENTRIES), chunk(TWENTY))
    damage = ingested(tmp_path, content, largest_loss=1.0).facts["damage"]
    assert (damage["complete"], damage["topics"]["/lab"]) == (False, {"messages": 19, "messages_lost": 1})


def test_the_loss_is_that_of_the_topic_and_not_of_the_file(tmp_path: Path) -> None:
    bad = [message(2, i * 1_000_000, cdr(1.0)[: 9 if i % 5 == 0 else 12]) for i in range(100)]
    two = LAB + channel(2, b"/rare")
    content = log(two, chunk(b"".join([*messages(1, range(10_000)), *bad])), summary=statistics({1: 10_000, 2: 100}, 1))
    assert len(ingested(tmp_path, content).samples) == 10_000
    with pytest.raises(InputError, match="20 % of topic '/rare' is lost, at most 1 % may be"):
        ingested(tmp_path, content, "/rare")
    damage = ingested(tmp_path, content, "/rare", largest_loss=0.2).facts["damage"]
    assert damage["topics"] == {"/rare": {"messages": 100, "messages_lost": 20}}
    assert damage["share_lost"] == pytest.approx(0.2)


RARE = message(2, 0, cdr(1.0)) + message(2, 15_000_000, cdr(2.0))


@pytest.mark.parametrize("crc", [True, False])
def test_a_chunk_that_was_cut_out_is_counted_by_topic_from_the_statistics(tmp_path: Path, crc: bool) -> None:
    removed = chunk(TWENTY)
    two = LAB + channel(2, b"/rare")
    summary = statistics({1: 20, 2: 2}, 2)
    content = log(two, chunk(TEN + RARE), summary=summary, shift=len(removed), crc=False)
    if crc:  # the recorder's checksum was computed with the summary where it was
        whole = log(two, chunk(TEN + RARE), removed, summary=summary)
        content = whole.replace(removed, b"")
    assert len(ingested(tmp_path, content, "/rare").samples) == 2
    damage = ingested(tmp_path, content, largest_loss=1.0).facts["damage"]
    assert (damage["complete"], damage["chunks_lost"], damage["messages_lost"]) == (False, 1, 10)
    assert damage["topics"] == {"/lab": {"messages": 10, "messages_lost": 10}}
    assert f"{len(removed)} bytes are missing before the summary" in damage["remarks"]
    with pytest.raises(InputError, match="damaged or incomplete MCAP: 50 % of topic '/lab' is lost, at most 1 % may"):
        ingested(tmp_path, content)
    assert FORMATS["mcap"].inspect(tmp_path / "log.mcap").facts["messages lost"] == "10"


def test_a_chunk_that_was_cut_out_without_statistics_is_an_unknown_loss(tmp_path: Path) -> None:
    removed = chunk(TWENTY)
    content = log(LAB, chunk(TEN), summary=LAB, shift=len(removed), crc=False)
    damage = ingested(tmp_path, content, largest_loss=1.0).facts["damage"]
    assert (damage["complete"], damage["messages_lost"]) == (False, None)
    assert damage["topics"]["/lab"]["messages_lost"] is None
    assert damage["share_lost"] > 0.1
    with pytest.raises(InputError, match="of topic '/lab' is lost"):
        ingested(tmp_path, content)
    assert FORMATS["mcap"].inspect(tmp_path / "log.mcap").facts["messages lost"] == "the file does not tell"


def test_a_chunk_index_with_more_chunks_than_there_are_is_an_unknown_loss(tmp_path: Path) -> None:
    entry = record(0x08, bytes(60))
    damage = ingested(tmp_path, log(LAB, chunk(TEN), summary=entry + entry), largest_loss=1.0).facts["damage"]
    assert (damage["complete"], damage["chunks_lost"], damage["messages_lost"]) == (False, 1, None)


def test_more_messages_than_the_statistics_declare_are_no_complete_log(tmp_path: Path) -> None:
    content = log(LAB, chunk(TEN), chunk(TWENTY), summary=statistics({1: 10}, 2))
    damage = ingested(tmp_path, content).facts["damage"]
    assert (damage["complete"], damage["messages_lost"]) == (False, 0)
    assert "it declares 10 messages and holds 20" in damage["remarks"]


def test_the_time_of_a_message_is_when_it_was_logged_and_not_when_it_was_published(tmp_path: Path) -> None:
    late = [message(1, 7 + 3 * i * MILLISECOND, cdr(i), i, publish=i * MILLISECOND) for i in range(20)]
    recording = ingested(tmp_path, log(LAB, chunk(b"".join(late))))
    np.testing.assert_allclose(recording.samples["time"], 3e-3 * np.arange(20), rtol=1e-12)
    assert recording.facts["time"] == {"source": "log", "stamps": "auto", "start_ns": 7}


OTHER = log(schema() + channel(1, b"/other") + channel(2, b"/lab"), chunk(b"".join(messages(1, range(30, 40)))))
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
    more = log(LAB, packed(b"".join(messages(1, range(30, 40)))))[8:]  # the same numbers mean the same
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
@pytest.mark.parametrize("what", ["channel", "schema"])
def test_a_number_with_two_meanings_is_refused(tmp_path: Path, crc: bool, what: str) -> None:
    again = channel(1, b"/other") if what == "channel" else schema(content=b"float64 b\nfloat64 a")
    said = refused(tmp_path, log(LAB, chunk(LAB + TEN, crc=crc), chunk(again + TWENTY, crc=crc)))
    assert f"{what} 1 is " in said
    assert "two logs were joined, or the file is damaged" in said
