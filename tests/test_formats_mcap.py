"""MCAP files: every intact chunk of damaged ones is recovered, what is lost is said; legal, rare
ones are read as by the official reader; two logs in one are refused. In CDR, JSON and protobuf
every number stands at its path as reference decoders read it; what is absent is null, what is no
number is lost and said."""

import json
import struct
import zlib
from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import pytest
import zstandard
from c3d_builder import REAL_DATA
from google.protobuf.descriptor_pb2 import FileDescriptorSet, SourceCodeInfo, UninterpretedOption
from google.protobuf.message import Message as Protobuf
from google.protobuf.timestamp_pb2 import Timestamp
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.reader import NonSeekingReader, make_reader
from mcap_builder import HEADER, stamped, write_log, write_payloads
from mcap_ros2.decoder import DecoderFactory
from recognised_files import refusal_by

from osl_analysis.commands.trials import inspect_file
from osl_analysis.errors import InputError
from osl_analysis.old_formats.mcap import MAGIC, read_mcap
from osl_analysis.old_formats.message_fields import Columns, MessageType, Reader, message_type, shape_of
from osl_analysis.old_formats.messages import decode_topics
from osl_analysis.ingest.raw_files import FORMATS
from osl_analysis.ingest.source import Recording

MILLISECOND = 1_000_000


def raw(one: records.McapRecord) -> bytes:
    """A record as the official library writes it."""
    builder = RecordBuilder()
    one.write(builder)
    return builder.end()


def longer(one: bytes, opcode: int | None = None) -> bytes:
    """A record with more bytes than its specification says, as of a later version."""
    return struct.pack("<BQ", opcode or one[0], len(one) - 4) + one[9:] + b"\1\2\3\4\5"


def schema(content: bytes = b"float64 a") -> bytes:
    return raw(records.Schema(id=1, name="lab_msgs/msg/S", encoding="ros2msg", data=content))


def channel(number: int, topic: str) -> bytes:
    return raw(
        records.Channel(id=number, topic=topic, message_encoding="cdr", metadata={}, schema_id=1)
    )


def cdr(value: float) -> bytes:
    return b"\0\1\0\0" + struct.pack("<d", value)


def message(number: int, time: int, payload: bytes) -> bytes:
    return raw(
        records.Message(channel_id=number, log_time=time, data=payload, publish_time=7, sequence=0)
    )


def messages(number: int, values: range) -> bytes:
    """One per millisecond, each with its own value."""
    return b"".join(message(number, i * MILLISECOND, cdr(float(i))) for i in values)


PACKINGS: dict[str, Callable[[bytes], bytes]] = {
    "zstd": zstandard.ZstdCompressor().compress, "lz4": lz4.frame.compress, "": bytes,
}  # fmt: skip


def chunk(content: bytes, packing: str = "zstd", crc: bool = True) -> bytes:
    return raw(
        records.Chunk(
            packing, PACKINGS[packing](content), 1 << 62, 0, zlib.crc32(content) * crc, len(content)
        )
    )


def index(count: int, *places: int) -> bytes:
    return raw(records.MessageIndex(1, [(0, place) for place in places] or [(0, 0)] * count))


def statistics(counts: dict[int, int], chunks: int, total: int = 0) -> bytes:
    return raw(
        records.Statistics(
            0, len(counts), counts, chunks, total or sum(counts.values()), 0, 0, 0, 1
        )
    )


HEAD, DATA_END = raw(records.Header("", "")), raw(records.DataEnd(0))


def log(*parts: bytes, summary: bytes = b"", shift: int = 0, crc: bool = True) -> bytes:
    """A whole file of these parts; the footer says that the summary begins `shift` bytes later than
    it does."""
    data = MAGIC + HEAD + b"".join(parts) + DATA_END
    opening = raw(records.Footer(len(data) + shift if summary else 0, 0, 0))[:-4]
    return data + summary + opening + struct.pack("<I", zlib.crc32(summary + opening) * crc) + MAGIC


LAB, TEN, TWENTY = schema() + channel(1, "/lab"), messages(1, range(10)), messages(1, range(10, 20))
THREE, FIVE, LAST = len(TEN) * 3 // 10, len(TEN) // 2, len(TEN) * 9 // 10
PRIVATE = longer(HEAD, 0x85) + longer(HEAD, 0x40)  # and one of a later version
# a private record that holds messages, which are not of the log
ENVELOPE = struct.pack("<BQ", 0x85, len(TEN)) + TEN
ALL = statistics({1: 20}, 2)
FIRST, ANY_PACKING = (
    log(LAB, chunk(TEN), chunk(TWENTY), summary=ALL),
    pytest.mark.parametrize("packing", PACKINGS),
)


def whole(packing: str) -> tuple[bytes, list[tuple[int, int]]]:
    """A log of 60 messages, ten in a chunk, and the first and last byte of each chunk."""
    data, places = LAB, []
    for first in range(0, 60, 10):
        one, begin = chunk(messages(1, range(first, first + 10)), packing), len(MAGIC + HEAD + data)
        places.append((begin, begin + len(one)))
        data += one + index(10)
    return log(data, summary=LAB + statistics({1: 60}, 6)), places


def recorded(
    path: Path, time: str = "log", loss: float = 0.01, **fields: str | dict[str, str]
) -> Recording:
    """Fields of `/lab` by column, in radians."""
    named = {name: {"field": one} if isinstance(one, str) else one for name, one in fields.items()}
    channels = {name: {"topic": "/lab", "unit": "rad", **one} for name, one in named.items()}
    described = {
        "format": "mcap",
        "time": {"source": time},
        "largest_loss": loss,
        "channels": channels,
    }
    return FORMATS["mcap"].read(path, FORMATS["mcap"].source.model_validate(described))


def ingested(folder: Path, content: bytes, topic: str = "/lab", loss: float = 0.01) -> Recording:
    (folder / "log.mcap").write_bytes(content)
    return recorded(folder / "log.mcap", "log", loss, theta={"topic": topic, "field": "a"})


def read(folder: Path, content: bytes, loss: float = 1.0) -> tuple[int, dict[str, Any]]:
    """Number of samples and damage report; whatever was read must be what was written: its time in
    ms."""
    recording = ingested(folder, content, loss=loss)
    milliseconds = (
        np.rint(recording.samples["time"].to_numpy() * 1000)
        + recording.facts["time"]["start_ns"] / 1e6
    )
    np.testing.assert_array_equal(recording.samples["theta"], milliseconds)
    return len(recording.samples), recording.losses


@ANY_PACKING
def test_wherever_a_file_is_cut_every_whole_chunk_is_recovered(
    tmp_path: Path, packing: str
) -> None:
    content, places = whole(packing)
    for cut in range(places[0][1], len(content), 41):
        count, damage = read(tmp_path, content[:cut], 0.0)
        assert count == 10 * sum(end <= cut for _, end in places)
        assert damage == {  # one rule for every byte
            "complete": False, "crc": "checked", "chunks_lost": None, "lost": None,
            "share_lost": 0.0,
            "end_missing": True, "expected": None, "read": count,
            "topics": {"/lab": {"messages": count, "lost": None}},
            "remarks": ["no footer: the recorder did not finish, or the end is lost; how much is not known"],
        }  # fmt: skip


@ANY_PACKING
def test_a_chunk_with_an_absurd_length_costs_itself_alone(tmp_path: Path, packing: str) -> None:
    content, places = whole(packing)
    start = places[2][0] + 1
    for length in (2**64 - 1, 2**40, 0, 60):
        # or never finished
        for end, told in ((len(content), (1, 10)), (content.rindex(DATA_END), (None, None))):
            count, damage = read(
                tmp_path, content[:start] + struct.pack("<Q", length) + content[start + 8 : end]
            )
            assert (count, (damage["chunks_lost"], damage["lost"])) == (50, told)
            assert damage["share_lost"] == pytest.approx(1 / 6, abs=0.011)


@ANY_PACKING
def test_a_chunk_that_unpacks_to_more_than_any_recorder_writes_is_lost_unread(
    tmp_path, packing, monkeypatch
):
    monkeypatch.setattr("osl_analysis.old_formats.mcap.MOST_UNPACKED", len(TEN) + 5)
    count, damage = read(tmp_path, log(LAB, chunk(TEN, packing), chunk(TEN + TWENTY, packing)))
    assert (count, damage["chunks_lost"]) == (10, 1)
    assert "GB, at most" in damage["remarks"][0]


@ANY_PACKING
def test_a_chunk_whose_head_was_zeroed_is_lost_and_told_where_no_count_and_no_index_tells(
    tmp_path, packing
):
    one = chunk(TWENTY, packing)
    for begin, end in ((9, 50), (25, 33), (0, 9), (9, len(one))):
        zeroed, last = (
            one[:begin] + bytes(end - begin) + one[end:],
            chunk(messages(1, range(20, 30))),
        )
        content = log(LAB, chunk(TEN, packing), zeroed, last)
        count, damage = read(tmp_path, content)
        assert (count, damage["complete"], damage["lost"]) == (20, False, None)


def test_records_that_no_recorder_writes_among_the_chunks_hide_none_of_them(tmp_path: Path) -> None:
    unknown, mixed = (
        raw(records.Chunk("xyz\n", b"abc", 0, 0, 0, 9)),
        chunk(TWENTY + b"\5", crc=False),
    )
    said = f"is damaged: it holds no record at byte {len(TWENTY)} of its {len(TWENTY) + 1} bytes"
    assert said in read(tmp_path, log(LAB, chunk(TEN), mixed, summary=ALL))[1]["remarks"][0]
    count, damage = read(tmp_path, log(LAB, chunk(TEN), unknown, chunk(TWENTY), summary=ALL))
    assert count == 20
    assert any(
        r"is compressed with 'xyz\n'; zstd and lz4 are read" in remark
        for remark in damage["remarks"]
    )
    assert (
        read(tmp_path, log(LAB, chunk(TEN), *[unknown] * 25))[1]["remarks"][20]
        == "and 5 more remarks"
    )
    mixed = read(tmp_path, LEGAL["longer records"])[1]
    assert (mixed["crc"], *mixed["remarks"]) == (
        "mixed",
        "not verifiable: no checksum covers 10 of 20 messages",
    )
    for second in (chunk(TWENTY), TWENTY):  # nor those behind what seems to be the end of the data
        assert read(tmp_path, log(LAB, DATA_END, chunk(TEN), second))[0] == 20


def test_a_schema_from_a_damaged_summary_reads_nothing(tmp_path: Path) -> None:
    damaged = log(chunk(LAB + TEN)[:-3] + b"abc", chunk(TWENTY), summary=LAB).replace(
        b"float64 a", b"float64 b"
    )
    with pytest.raises(InputError, match="messages belong to channels that are not declared"):
        read(tmp_path, damaged)


def test_what_holds_no_log_is_refused_in_one_line(tmp_path: Path) -> None:
    for content in (b"", bytes(300), MAGIC, MAGIC * 2, MAGIC + b"\xff" * 99):
        with pytest.raises(InputError, match=r"^[^\n]+log.mcap: [^\n]+$"):
            read(tmp_path, content)


CUT_OUT = chunk(TWENTY)
TWO = (
    LAB + channel(2, "/rare"),
    chunk(TEN + message(2, 0, cdr(1.0)) + message(2, 15 * MILLISECOND, cdr(2.0))),
)
OF_TWO = statistics({1: 20, 2: 2}, 2)
# without a checksum, a message may pass for a private record
TURNED = TEN[:FIVE] + b"\x85" + TEN[FIVE + 1 :]
# by what its last message declares
TOO_LONG = TEN[: LAST + 1] + struct.pack("<Q", len(TEN)) + TEN[LAST + 9 :]
LEGAL = {
    "longer records": log(*map(longer, (schema(), channel(1, "/lab"), chunk(TEN), index(10),
    chunk(TWENTY, crc=False))),
        summary=longer(ALL)),
    "private records": log(PRIVATE + LAB + PRIVATE,
    chunk(PRIVATE + TEN[:THREE] + PRIVATE + TEN[THREE:]), PRIVATE,
        chunk(TWENTY), summary=PRIVATE + ALL + PRIVATE),
    "private records in a chunk with an index": log(LAB, chunk(TEN + PRIVATE, crc=False), index(10),
    PRIVATE,
        chunk(TWENTY), summary=ALL),
    "messages outside of the chunks": log(
        LAB, chunk(TEN), index(10), TWENTY[:FIVE], PRIVATE, TWENTY[FIVE:],
        summary=statistics({1: 20}, 1)
    ), "no statistics": log(LAB, chunk(TEN), chunk(TWENTY)),
    "an index with more than the checksum covers": log(LAB, chunk(TEN), index(11), chunk(TWENTY)),
    "an index that is right but for one message": log(
        LAB, chunk(TEN), index(10, *(k * len(TEN) // 10 for k in (9, 0, 1, 2, 3, 5, 6, 7, 8, 8))),
        chunk(TWENTY)),
    "an index that points elsewhere": log(
        LAB, chunk(ENVELOPE + TEN), index(10, 0, *range(9, 9 + len(TEN), len(TEN) // 10)),
        chunk(TWENTY),
        index(10, 1, len(TWENTY) - 8, 10**9, 2**63, 2**64 - 1, 2, 3, 4, 5, len(TWENTY))),
    "no channels": log(LAB, chunk(TEN), chunk(TWENTY), summary=statistics({}, 2, 20)),
}  # fmt: skip
LOSSES = {  # complete or not, chunks and messages lost, messages of the topic and those lost of it
    "fewer declared": (log(LAB, chunk(TEN), chunk(TWENTY), summary=statistics({1: 10}, 2)), (False,
    0, None, 20, None)),
    "in the index of a chunk": (log(LAB, chunk(TURNED, crc=False), index(10), chunk(TWENTY)),
    (False, 0, 1, 19, 1)),
    "beyond the chunk": (log(LAB, chunk(TOO_LONG, crc=False), index(10, *range(0, len(TEN),
    len(TEN) // 10)),
        chunk(TWENTY)), (False, 1, 10, 10, 10)),
    "of no channel": (log(LAB, chunk(TEN + message(7, 9, cdr(1.0))), chunk(TWENTY)), (False, 0, 1,
    20, 0)),
    "cut out": (log(*TWO, summary=OF_TWO, shift=len(CUT_OUT), crc=False), (False, 1, 10, 10, 10)),
    # the recorder's checksum was computed with the summary where it was
    "cut out, with checksum": (log(*TWO, CUT_OUT, summary=OF_TWO).replace(CUT_OUT, b""), (False, 1,
    10, 10, 10)),
    "cut out, without statistics": (log(LAB, chunk(TEN), summary=LAB, shift=len(CUT_OUT),
    crc=False),
        (False, 0, None, 10, None)),
} | {name: (content, (True, 0, 0, 20, 0)) for name, content in LEGAL.items()}  # fmt: skip


@pytest.mark.parametrize("content", LEGAL.values(), ids=LEGAL)
def test_a_legal_file_is_read_as_by_the_official_reader(tmp_path: Path, content: bytes) -> None:
    official = [
        struct.unpack("<d", m.data[4:])[0]
        for _, _, m in NonSeekingReader(BytesIO(content)).iter_messages()
    ]
    assert (
        ingested(tmp_path, content, loss=0.0).samples["theta"].to_list()
        == official
        == list(range(20))
    )


@pytest.mark.parametrize("what", LOSSES)
def test_losses_are_counted_as_far_as_the_file_tells_them_and_inspect_says_the_same(
    tmp_path: Path, what: str
) -> None:
    content, expected = LOSSES[what]
    damage = ingested(tmp_path, content, loss=1.0).losses
    lost, of_topic = damage["lost"], damage["topics"]["/lab"].values()
    assert (damage["complete"], damage["chunks_lost"], lost, *of_topic) == expected
    told = FORMATS["mcap"].inspect(tmp_path / "log.mcap").facts["messages lost"]
    assert told == ("the file does not tell" if lost is None else str(lost))
    if what.startswith("cut out"):
        assert f"{len(CUT_OUT)} bytes are missing before the summary" in damage["remarks"]
        said = r"damaged or incomplete MCAP: .* of topic '/lab' is lost, at most 1 % may"
        with pytest.raises(InputError, match=said):
            ingested(tmp_path, content)


def test_the_loss_is_that_of_the_topic_and_not_of_the_file(tmp_path: Path) -> None:
    bad = b"".join(
        message(2, i * MILLISECOND, cdr(1.0)[: 9 if i % 5 == 0 else 12]) for i in range(100)
    )
    rare = LAB + channel(2, "/rare")
    content = log(
        rare, chunk(messages(1, range(10_000)) + bad), summary=statistics({1: 10_000, 2: 100}, 1)
    )
    assert len(ingested(tmp_path, content).samples) == 10_000
    with pytest.raises(InputError, match="20 % of topic '/rare' is lost, at most 1 % may be"):
        ingested(tmp_path, content, "/rare")
    damage = ingested(tmp_path, content, "/rare", 0.2).losses
    of_topics = {"/rare": {"messages": 100, "lost": 20}}
    assert (damage["topics"], damage["share_lost"]) == (of_topics, pytest.approx(0.2))
    assert len(ingested(tmp_path, LOSSES["cut out"][0], "/rare").samples) == 2


def refused(folder: Path, content: bytes) -> str:
    """What both ingest and inspect say."""
    (folder / "log.mcap").write_bytes(content)
    said = refusal_by(recorded, folder / "log.mcap", theta="a")
    assert said == refusal_by(FORMATS["mcap"].inspect, folder / "log.mcap")
    return said


def test_two_logs_in_one_file_are_refused_with_the_byte_to_cut_at(tmp_path: Path) -> None:
    other = log(
        schema() + channel(1, "/other") + channel(2, "/lab"), chunk(messages(1, range(30, 40)))
    )
    ends = [
        FIRST.index(part) + len(part) - 8
        for part in (channel(1, "/lab"), chunk(TEN), chunk(TWENTY))
    ]
    # a record that is cut off may end with the magic or the header of the second log
    for cut in [
        *range(len(log()), len(FIRST) - 8, 23),
        *ends,
        *(end - len(HEAD) for end in ends[1:]),
    ]:
        assert f"holds two logs, the second from byte {cut} on: split them" in refused(
            tmp_path, FIRST[:cut] + other
        )
    for more in (bytes(100), other):
        said = refused(tmp_path, FIRST + more)
        assert (
            f"ends at byte {len(FIRST)} and has {len(more)} bytes after it; keep what is before"
            " them" in said
        )
    for what, again in (
        ("channel", channel(1, "/other")),
        ("schema", schema(b"float64 b\nfloat64 a")),
    ):
        said = refused(tmp_path, log(LAB, chunk(LAB + TEN), chunk(again + TWENTY)))
        assert f"{what} 1 is '" in said
        assert "two logs were joined, or the file is damaged" in said


def assert_decoded(path: Path, topic: str, expected: list[dict[str, float]]) -> list[int]:
    """Every number of every message of a topic is read exactly, and no other; gives the log times
    [ns]."""
    paths = sorted({name for values in expected for name in values})
    found = decode_topics(read_mcap(path), {topic: paths})[topic]
    for name in paths:
        assert np.ma.getmaskarray(found.values[name]).tolist() == [
            name not in values for values in expected
        ]
        own = [values[name] for values in expected if name in values]
        np.testing.assert_array_equal(
            np.ma.compressed(found.values[name]), own, err_msg=f"{topic} {name}"
        )
    return [int(one) for one in found.log_time]


words, finite = st.text("abcé", max_size=6), st.floats(allow_nan=False, allow_infinity=False)
PART = {
    "int8 kind": st.integers(-128, 127),
    "int64[2] counts": st.lists(st.integers(-(2**63), 2**63 - 1), min_size=2, max_size=2),
    "string[] tags": st.lists(words, max_size=2),
}
part = st.fixed_dictionaries({line.split()[1]: one for line, one in PART.items()})
FIELDS = {
    "bool flag": st.booleans(), "float64 wide 1.5": finite, "uint8[3] bytes": st.binary(min_size=3,
    max_size=3),
    "int16 small": st.integers(-(2**15), 2**15 - 1), "string<=20 name": words,
    "float64[] series": st.lists(finite, max_size=3), "Part[<=4] parts": st.lists(part, max_size=2),
    "Nothing nothing": st.just({}), "float32 last": st.floats(width=32, allow_nan=False),
}  # fmt: skip
mixed = st.fixed_dictionaries({line.split()[1]: one for line, one in FIELDS.items()})
CONSTANTS = [
    "# a constant, a default, bounds and every alignment",
    "uint8 OFF=0",
    'string LABEL = "a # b"',
]
OTHERS = [
    "===\nMSG: lab_msgs/msg/Nothing",
    "===\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id",
]
MIXED = "\n".join(
    [*CONSTANTS, "std_msgs/Header header", *FIELDS, "===\nMSG: lab_msgs/Part", *PART, *OTHERS]
)


def numbers(value: Any, path: str = "") -> dict[str, float]:
    """Every number in a message of the reference decoder by its path; of long arrays a few."""
    if isinstance(value, bool | int | float):
        return {path: value}
    if isinstance(value, str):
        return {}
    if isinstance(value, list | tuple | bytes):
        chosen = range(len(value)) if len(value) < 40 else [0, 1, len(value) // 2, len(value) - 1]
        return {key: v for i in chosen for key, v in numbers(value[i], f"{path}[{i}]").items()}
    dot = f"{path}." if path else ""
    return {
        key: v
        for name in value.__slots__
        for key, v in numbers(getattr(value, name), dot + name).items()
    }


def assert_equal_to_reference(path: Path) -> int:
    """Compare every topic with the reference decoder, exactly; return how many numbers were
    compared."""
    topics: dict[str, list[tuple[int, dict[str, float]]]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            topics.setdefault(channel.topic, []).append((message.log_time, numbers(decoded)))
    for topic, messages in topics.items():
        if any(values for _, values in messages):
            assert assert_decoded(path, topic, [values for _, values in messages]) == [
                time for time, _ in messages
            ]
    return sum(len(values) for messages in topics.values() for _, values in messages)


@pytest.mark.skipif(not REAL_DATA.is_dir(), reason="real data are not here")
def test_every_number_of_a_real_log_equals_the_reference_decoders() -> None:
    for name in (
        "rerun_rosbag2_all_sensor_msgs_ros2_cdr",
        "rosbag2_cdr_test_0",
        "pj_test_empty_channel",
    ):
        assert assert_equal_to_reference(REAL_DATA / f"mcap/{name}.mcap") > 50


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(messages=st.lists(mixed, min_size=1, max_size=8))
def test_messages_of_any_shape_equal_the_reference_decoders(
    tmp_path: Path, messages: list[dict[str, Any]]
) -> None:
    log = [stamped(10**9 + i * 10**6, **fields) for i, fields in enumerate(messages)]
    path = write_log(tmp_path / "log.mcap", log, MIXED, "lab_msgs/msg/Mixed")
    assert assert_equal_to_reference(path) >= 8 * len(messages)


def kind_of(text: str) -> MessageType:
    return message_type(records.Schema(1, text.encode(), "", "l/S"), ros1=False)


def read_each(kind: MessageType, paths: Sequence[str], *payloads: bytes) -> Columns:
    reader, lengths = Reader(paths, kind), np.array([len(one) for one in payloads])
    reader.read(b"".join(payloads), np.cumsum(lengths) - lengths, lengths)
    return reader.columns()


def test_big_endian_messages_and_characters_are_numbers() -> None:
    big = b"\0\0\0\0" + struct.pack(">B7xdh2xf", 7, -2.5, -300, 0.75)
    for schema, payload, expected in (
        ("uint8 a\nfloat64 b\nint16 c\nfloat32 d", big, [7, -2.5, -300, 0.75]),
        # as rosidl says
        ("char a\nint8 b\nbyte c\nuint8 d", b"\0\1\0\0\xc8\xc8\xc8\xc8", [200, -56, 200, 200]),
        (
            "uint16 a\nint32 b\nuint64 c\nuint32 d",
            b"\0\1\0\0" + b"\xff" * 20,
            [2**16 - 1, -1, 2**64 - 1, 2**32 - 1],
        ),
    ):
        read = read_each(kind_of(schema), "abcd", payload)
        assert [read.values[path].tolist() for path in "abcd"] == [[one] for one in expected]
    assert [*shape_of(kind_of("builtin_interfaces/Duration d"), None).leaves] == [
        "d.sec",
        "d.nanosec",
    ]


def test_a_joint_is_found_by_name_though_the_order_of_joints_changes(tmp_path: Path) -> None:
    schema = "std_msgs/Header header\nstring[] name\nfloat64[] position\n" + HEADER
    orders = [["hip", "toe"], ["toe", "hip"], ["hip", "toe"], ["shank", "toe"], ["hip", "leg"]]
    log = [stamped(i, name=order, position=[10.0 + i, 20.0 + i]) for i, order in enumerate(orders)]
    path = write_log(tmp_path / "log.mcap", log, schema, "sensor_msgs/msg/JointState")
    decoded = decode_topics(read_mcap(path), {"/lab": ["position[name=toe]"]})["/lab"]
    assert decoded.values["position[name=toe]"].tolist() == [20.0, 11.0, 22.0, 23.0, None]
    twice = [stamped(0, name=["toe", "toe"], position=[1.0, 2.0])]
    written = write_log(path, twice, schema, "sensor_msgs/msg/JointState")
    with pytest.raises(
        InputError, match="2 elements are named 'toe' in 'name': write an index in its place"
    ):
        decode_topics(read_mcap(written), {"/lab": ["position[name=toe]"]})


ONE, KIND, LONGER = cdr(1.0), kind_of("float64 a"), kind_of("float64 a\nstring s\nfloat64[] b")


def test_a_message_or_a_schema_that_cannot_be_read_is_refused_by_name() -> None:
    for payload, said in (
        (ONE, "too short for its schema"),
        (ONE + struct.pack("<II", 0, 2**31), "too short for its schema"),
        (b"\x00\x07\x00\x00\x01", "encapsulation 00070000 is not plain CDR"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=said):
            shape_of(LONGER, payload)
    for schema, said in (
        ("wstring w", "type 'l/wstring' of field 'w' is not defined"),
        ("Other a", "schema l/S: type 'l/Other' of field 'a' is not defined"),
        ("float64 a\n===\nfloat64 b", "a line 'MSG: package/Name' is missing after a separator"),
        ("}{", r"schema l/S: cannot read the line '\}\{'"),
        ("float64 a\nfloat64 a", "field 'a' is defined twice"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=said):
            kind_of(schema)


def test_a_message_with_more_than_its_schema_describes_is_refused_and_padding_is_not() -> None:
    # to four bytes with any content, to eight with zeros
    for padding in (b"\xff", b"\xff" * 3, bytes(4), bytes(7)):
        assert shape_of(KIND, ONE + padding).leaves["a"][0] == 4
    for more in (b"\0\0\0\1", struct.pack("<d", 2.0), bytes(8)):
        with pytest.raises(
            InputError, match=f"a message of {12 + len(more)} bytes has {len(more)} more than its"
        ):
            shape_of(KIND, ONE + more)
    # zeros let no content pass
    all_three = read_each(KIND, ["a"], ONE + bytes(4), ONE + b"\0\0\0\7", ONE + bytes(9))
    assert (all_three.rows.tolist(), all_three.misfits, all_three.misfit[:20]) == (
        [0],
        2,
        "a message of 16 byte",
    )


def write_json(folder: Path, texts: list[str], chunk_size: int = 1 << 20) -> Path:
    return write_payloads(
        folder / "log.mcap", [text.encode() for text in texts], "json", chunk_size=chunk_size
    )


SHAPES: list[tuple[Any, dict[str, float]]] = [
    ({"a": 1.5, "b": {"c": 2}, "d": [1, 2.5], "e": True},
     {"a": 1.5, "b.c": 2, "d[1]": 2.5, "e": True}),
    ({"a": None, "b": {}, "d": [3]}, {}), ({"b": {"c": -(2**62), "a": 9}, "d": []},
     {"b.c": -(2**62)}),
    ({"a": -7, "b": None, "d": [None, 4], "e": False}, {"a": -7, "d[1]": 4, "e": False}),
]  # fmt: skip


def test_messages_of_different_shapes_stay_in_order_with_what_each_has(tmp_path: Path) -> None:
    order = [0, 0, 1, 3, 2, 1, 0, 3, 3, 2]
    path = write_json(tmp_path, [json.dumps(SHAPES[k][0], indent=1) for k in order], chunk_size=200)
    assert_decoded(path, "/lab", [SHAPES[k][1] for k in order])


def test_an_integer_beyond_a_floats_reach_is_exact_in_every_chunk(tmp_path: Path) -> None:
    for base in (2**53, -(2**53), 2**63):
        texts = [json.dumps({"a": base + 1 + 2 * i if i % 7 else i}) for i in range(60)]
        assert_decoded(
            write_json(tmp_path, texts, chunk_size=400), "/lab", [json.loads(one) for one in texts]
        )


@pytest.mark.parametrize(("field", "right", "wrong", "said"), [
    ("x", '{"x": 1.5}', "no json", "a message of 7 bytes is not JSON: Expecting value"),
    ("x", '{"x": 1.5}', '{"x": "a"}', "field 'x' is \"a\", not a number, in message 2"),
    ("x", '{"x": 1.5}', '{"x": [1, 2]}',
     "field 'x' is an array of 2, not one number, in message 2"),
    ("x.y", '{"x": {"y": 1.5}}', '{"x": 3}',
     "field 'x' is 3, not an object with fields, in message 2"),
    ("v[n=b]", '{"v": [0, 1.5], "n": ["a", "b"]}', '{"v": [1, "c"], "n": ["a", "b"]}',
     "field 'v[n=b]' is \"c\""),
])  # fmt: skip
def test_a_message_without_a_number_in_a_field_is_lost_and_said(
    tmp_path: Path, field: str, right: str, wrong: str, said: str
) -> None:
    # what is said of the first
    texts = [right, wrong, *[right] * 9, "{", '{"x": {"y": [1, 2]}, "v": 5}']
    recording = recorded(write_json(tmp_path, texts, chunk_size=100), "log", 0.3, theta=field)
    assert recording.samples["theta"].to_list() == [1.5] * 10
    assert recording.losses["topics"]["/lab"] == {"messages": 13, "lost": 3}
    assert recording.losses["remarks"][0].startswith(
        f"3 of 13 messages of topic '/lab' are lost: {said}"
    )
    with pytest.raises(
        InputError, match="messages that cannot be used: 90 % of topic '/lab' is lost, at most 30 %"
    ):
        recorded(write_json(tmp_path, [right, *[wrong] * 9]), "log", 0.3, theta=field)


def test_a_field_that_is_no_number_is_blamed_on_the_source_file_and_an_absent_one_is_null(
    tmp_path: Path,
) -> None:
    for text in ('{"x": "1"}', '{"x": [1, 2]}', "5", '{"v": [1, 2], "n": 5}', '{"x": true}'):
        with pytest.raises(InputError, match="`field` in the source file"):
            recorded(
                write_json(tmp_path, [text] * 9), "log", 0.3, theta="x" if "x" in text else "v[n=b]"
            )
    with pytest.raises(
        InputError, match="field 'x' is a truth value in some places and a number in others"
    ):
        recorded(write_json(tmp_path, ['{"x": true}', '{"x": 1}']), "log", 0.9, theta="x")
    ros, google = (
        ("cdr", "l/S", "ros2msg", b"float64 a\nfloat64[] y"),
        ("protobuf", "l.S", "protobuf", b"\xff\xff"),
    )
    for payload, packing, said in (
        (
            b"{",
            ["json"],
            "topic '/lab': a message of 1 bytes is not JSON: .* [(]1 of 1 .*; record the log again",
        ),
        (
            b'{"x": 1}',
            ["json"],
            r"topic '/lab' has no field 'y' \(it has x\); correct `field` in the source file",
        ),
        (
            cdr(1.0) + struct.pack("<I4xd", 1, 2.0),
            ros,
            r"'/lab': field 'y' is an array of 1, .* \(it has a, y\[0",
        ),
        (b"\5", google, r"topic '/lab': schema l\.S: cannot be read: .*, or map another topic"),
    ):
        with pytest.raises(InputError, match=said):
            recorded(
                write_payloads(tmp_path / "log.mcap", [payload], *packing), "log", 1.0, theta="y"
            )
    absent = write_json(tmp_path, ['{"x": 1.5}', '{"x": null}', '{"x": []}', "{}"])
    recording = recorded(absent, "log", 0.3, theta="x")
    assert recording.samples["theta"].to_list() == [1.5, None, None, None]
    said = "topic '/lab': field 'x' has no value in 3 of 4 messages, first message 2"
    assert any(said in warning for warning in recording.warnings)


def write_protobuf(folder: Path, messages: Sequence[Protobuf], cut: int = 0) -> Path:
    """Messages of a type of google's own; of the last one so many bytes are cut off."""
    files, file = FileDescriptorSet(), messages[0].DESCRIPTOR.file
    for one in (*file.dependencies, file):
        one.CopyToProto(files.file.add())
    payloads = [one.SerializeToString() for one in messages]
    payloads[-1] = payloads[-1][: len(payloads[-1]) - cut]
    schema = messages[0].DESCRIPTOR.full_name, "protobuf", files.SerializeToString()
    return write_payloads(folder / "log.mcap", payloads, "protobuf", *schema, chunk_size=100)


def test_what_google_wrote_is_read_and_what_is_absent_is_null_if_it_is_optional_and_else_zero(
    tmp_path: Path,
) -> None:
    extremes = {
        "positive_int_value": 2**64 - 1,
        "negative_int_value": -(2**63),
        "double_value": -1e300,
    }
    parts = [{"name_part": "é", "is_extension": one} for one in (True, False)]
    of_parts = {"name[0].is_extension": True, "name[1].is_extension": False}
    for kind, contents in (
        (
            UninterpretedOption,
            [(extremes, extremes), ({}, {}), ({"double_value": 0}, {"double_value": 0})],
        ),
        (UninterpretedOption, [({"name": parts, **extremes}, of_parts | extremes), ({}, {})]),
        (
            Timestamp,
            [
                ({}, {"seconds": 0, "nanos": 0}),
                ({"seconds": 2**40}, {"seconds": 2**40, "nanos": 0}),
            ],
        ),
        (
            SourceCodeInfo.Location,
            [({"path": [-7, 2**31 - 1]}, {"path[0]": -7, "path[1]": 2**31 - 1}), ({}, {})],
        ),
    ):
        path = write_protobuf(tmp_path, [kind(**content) for content, _ in contents])
        assert_decoded(path, "/lab", [expected for _, expected in contents])


def test_a_message_that_google_refuses_is_left_out_and_reported(tmp_path: Path) -> None:
    path = write_protobuf(tmp_path, [Timestamp(seconds=5, nanos=2**30)] * 3, cut=2)
    recording = recorded(path, "log", 0.5, theta="seconds")
    assert (len(recording.samples), recording.losses["lost"]) == (2, 1)
    assert (
        "1 of 3 messages of topic '/lab' are lost: a message of" in recording.losses["remarks"][0]
    )


def test_fields_are_listed_with_their_types_lengths_and_names_and_read_by_these(
    tmp_path: Path,
) -> None:
    one = SourceCodeInfo.Location(
        path=[5, 6], span=[5, 300, 7], leading_detached_comments=["hip", "toe"]
    )
    path, named = write_protobuf(tmp_path, [one] * 3), "path[leading_detached_comments=toe]"
    listed = {named: "int64[2]", "span[0]": "int64[3]"}
    assert (
        listed.items()
        <= {one.address["field"]: one.type for one in inspect_file(path).channels}.items()
    )
    assert recorded(path, "log", 0.3, theta=named).samples["theta"].to_list() == [6.0] * 3
