"""Damaged logs: every intact chunk is recovered, what is lost is said, and nothing that is read is wrong."""

import struct
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import CompressionType
from mcap_builder import stamped, write_log
from mcap_bytes import record

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap import CHUNK_HEAD, MAGIC, RECORD
from osl_analysis.ingest.message_log import McapSource, read_mcap_log

MESSAGES = 60
MILLISECOND = 1_000_000


def source(largest_loss: float = 1.0) -> McapSource:
    channels = {"theta": {"topic": "/lab", "field": "angle", "unit": "rad"}}
    content = {"format": "mcap", "time": {"source": "header"}, "channels": channels, "largest_loss": largest_loss}
    return McapSource.model_validate(content)


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
    recording = read_mcap_log(path, source(largest_loss))
    milliseconds = np.rint(recording.samples["time"].to_numpy() * 1000) + recording.facts["time"]["start_ns"] / 1e6
    np.testing.assert_array_equal(recording.samples["theta"], 1 + milliseconds)
    return recording.samples, recording.facts["damage"]


def test_an_intact_file_is_complete_and_checked(tmp_path: Path) -> None:
    assert read(tmp_path, written(tmp_path), 0.0)[1] == {
        "complete": True,
        "crc": "checked",
        "chunks_lost": 0,
        "messages_lost": 0,
        "share_lost": 0.0,
        "topics": {"/lab": {"messages": MESSAGES, "messages_lost": 0}},
        "remarks": [],
    }


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


def test_a_chunk_that_fails_its_checksum_is_left_out_and_counted(tmp_path: Path) -> None:
    content = bytearray(written(tmp_path, compression=CompressionType.NONE))
    start, end = chunks(content)[1]
    content[(start + end) // 2] ^= 0x10
    samples, damage = read(tmp_path, bytes(content))
    lost = messages_in_chunks(bytes(content))[1]
    assert len(samples) == MESSAGES - lost
    assert (damage["crc"], damage["chunks_lost"], damage["messages_lost"]) == ("checked", 1, lost)
    assert "does not match its checksum" in damage["remarks"][0]


@pytest.mark.parametrize("wrong", [b"\0" * 8, b"\xff" * 8, b"\x01" + b"\0" * 7])
def test_a_wrong_message_index_changes_nothing_and_is_remarked(tmp_path: Path, wrong: bytes) -> None:
    content = written(tmp_path)
    index = next(start for opcode, start, _ in top_level(content) if opcode == Opcode.MESSAGE_INDEX)
    entry = index + 9 + 6 + 16 + 8  # the second message's offset
    samples, damage = read(tmp_path, content[:entry] + wrong + content[entry + 8 :], 0.0)
    assert len(samples) == MESSAGES
    assert damage["complete"]
    assert "the index of the chunk" in damage["remarks"][0]


def test_an_index_made_to_look_like_a_message_is_none(tmp_path: Path) -> None:
    content = bytearray(written(tmp_path))
    for opcode, start, _ in top_level(bytes(content)):
        if opcode == Opcode.MESSAGE_INDEX:
            content[start] = Opcode.MESSAGE
    assert len(read(tmp_path, bytes(content), 0.0)[0]) == MESSAGES


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


damages = st.lists(
    st.one_of(
        st.tuples(st.just("flip"), st.floats(0, 1), st.integers(1, 255)),
        st.tuples(st.just("cut"), st.floats(0, 1), st.integers(1, 300)),
        st.tuples(st.just("insert"), st.floats(0, 1), st.binary(min_size=1, max_size=30)),
        st.tuples(st.just("truncate"), st.floats(0, 1), st.none()),
        st.tuples(st.just("lengthen"), st.floats(0, 1), st.sampled_from([0, 2**31, 2**63, 2**64 - 1])),
    ),
    min_size=1,
    max_size=6,
)


def damaged_by(content: bytes, kind: str, place: float, what: Any) -> bytes:
    at = int(place * len(content))
    if kind == "flip" and at < len(content):
        return content[:at] + bytes([content[at] ^ what]) + content[at + 1 :]
    if kind == "cut":
        return content[:at] + content[at + what :]
    if kind == "insert":
        return content[:at] + what + content[at:]
    if kind == "lengthen":
        return content[:at] + struct.pack("<Q", what) + content[at + 8 :]
    return content[:at]


@settings(max_examples=150, deadline=2000)
@given(damages, st.sampled_from([CompressionType.ZSTD, CompressionType.NONE, CompressionType.LZ4]))
def test_no_damage_crashes_the_reader_or_changes_a_value(damage: list[Any], compression: CompressionType) -> None:
    with tempfile.TemporaryDirectory() as folder:
        content = written(Path(folder), compression=compression)
        for one in damage:
            content = damaged_by(content, *one)
        with suppress(InputError):
            read(Path(folder), content)
