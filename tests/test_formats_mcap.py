"""MCAP files: of damaged ones every intact chunk is recovered, what is lost is said, and nothing that is read is wrong.

Legal and rare ones are read as the official reader does; two logs in one are refused. Messages in CDR, JSON and
protobuf: every number stands at its path as reference decoders read it; what is absent is null, and what is no number
is lost and said.
"""

import json
import random
import struct
import zlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import pytest
import zstandard
from c3d_builder import REAL_DATA
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Schema
from mcap_builder import HEADER, stamped, write_log, write_payloads
from mcap_ros2.decoder import DecoderFactory
from recognised_files import refusal_by
from test_ingest_every_log import mutilated

from osl_analysis.commands.inspect import inspect_file
from osl_analysis.errors import InputError
from osl_analysis.formats.mcap import MAGIC, read_mcap
from osl_analysis.formats.message_fields import Columns, MessageType, Reader, message_type, shape_of
from osl_analysis.formats.messages import decode_topics
from osl_analysis.ingest.raw_files import FORMATS
from osl_analysis.ingest.source import Recording

MILLISECOND = 1_000_000


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def longer(one: bytes) -> bytes:
    """A record with more bytes than its specification says, as of a later version."""
    return record(one[0], one[9:] + b"\1\2\3\4\5")


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value)) + value


def schema(content: bytes = b"float64 a") -> bytes:
    return record(Opcode.SCHEMA, struct.pack("<H", 1) + text(b"lab_msgs/msg/S") + text(b"ros2msg") + text(content))


def channel(number: int, topic: bytes) -> bytes:
    return record(Opcode.CHANNEL, struct.pack("<HH", number, 1) + text(topic) + text(b"cdr") + text(b""))


def cdr(value: float) -> bytes:
    return b"\0\1\0\0" + struct.pack("<d", value)


def message(number: int, time: int, payload: bytes, publish: int = 0) -> bytes:
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", number, 0, time, publish) + payload)


def messages(number: int, values: range) -> bytes:
    """One per millisecond, each with its own value."""
    return b"".join(message(number, i * MILLISECOND, cdr(float(i))) for i in values)


PACKINGS: dict[bytes, Callable[[bytes], bytes]] = {
    b"zstd": zstandard.ZstdCompressor().compress,
    b"lz4": lz4.frame.compress,
    b"": bytes,
}


def chunk(content: bytes, packing: bytes = b"zstd", crc: bool = True) -> bytes:
    packed = PACKINGS[packing](content)
    head = struct.pack("<QQQI", 0, 1 << 62, len(content), zlib.crc32(content) if crc else 0)
    return record(Opcode.CHUNK, head + text(packing) + struct.pack("<Q", len(packed)) + packed)


def index(number: int, count: int) -> bytes:
    return record(Opcode.MESSAGE_INDEX, struct.pack("<H", number) + text(bytes(16 * count)))


def statistics(counts: dict[int, int], chunks: int, of_channels: bool = True) -> bytes:
    by_channel = b"".join(struct.pack("<HQ", *count) for count in counts.items()) if of_channels else b""
    head = struct.pack("<QHIIIIQQ", sum(counts.values()), 1, len(counts), 0, 0, chunks, 0, 0)
    return record(Opcode.STATISTICS, head + text(by_channel))


HEAD, DATA_END = record(Opcode.HEADER, text(b"") + text(b"")), record(Opcode.DATA_END, bytes(4))


def log(*parts: bytes, summary: bytes = b"", shift: int = 0, crc: bool = True) -> bytes:
    """A whole file of these parts; the footer says that the summary begins `shift` bytes later than it does."""
    data = MAGIC + HEAD + b"".join(parts) + DATA_END
    opening = struct.pack("<BQQQ", Opcode.FOOTER, 20, len(data) + shift if summary else 0, 0)
    return data + summary + opening + struct.pack("<I", zlib.crc32(summary + opening) if crc else 0) + MAGIC


LAB = schema() + channel(1, b"/lab")
TEN, TWENTY = messages(1, range(10)), messages(1, range(10, 20))
THREE, FIVE = len(TEN) * 3 // 10, len(TEN) // 2
PRIVATE = record(0x85, b"ours") + record(0x40, b"of a later version")
ALL = statistics({1: 20}, 2)
FIRST = log(LAB, chunk(TEN), chunk(TWENTY), summary=ALL)
ANY_PACKING = pytest.mark.parametrize("packing", PACKINGS)


def whole(packing: bytes) -> tuple[bytes, list[tuple[int, int]]]:
    """A log of 60 messages, ten in a chunk, and the first and last byte of each chunk."""
    data, places = LAB, []
    for first in range(0, 60, 10):
        one, begin = chunk(messages(1, range(first, first + 10)), packing), len(MAGIC + HEAD + data)
        places.append((begin, begin + len(one)))
        data += one + index(1, 10)
    return log(data, summary=LAB + statistics({1: 60}, 6)), places


def recorded(path: Path, time: str = "log", loss: float = 0.01, **fields: str | dict[str, str]) -> Recording:
    """Fields of `/lab` by column, in radians."""
    named = {name: {"field": one} if isinstance(one, str) else one for name, one in fields.items()}
    channels = {name: {"topic": "/lab", "unit": "rad", **one} for name, one in named.items()}
    source = FORMATS["mcap"].source.model_validate(
        {"format": "mcap", "time": {"source": time}, "largest_loss": loss, "channels": channels}
    )
    return FORMATS["mcap"].read(path, source)


def ingested(folder: Path, content: bytes, topic: str = "/lab", loss: float = 0.01) -> Recording:
    (folder / "log.mcap").write_bytes(content)
    return recorded(folder / "log.mcap", "log", loss, theta={"topic": topic, "field": "a"})


def read(folder: Path, content: bytes, loss: float = 1.0) -> tuple[int, dict[str, Any]]:
    """Number of samples and damage report; whatever was read must be what was written: its time in ms."""
    recording = ingested(folder, content, loss=loss)
    milliseconds = np.rint(recording.samples["time"].to_numpy() * 1000) + recording.facts["time"]["start_ns"] / 1e6
    np.testing.assert_array_equal(recording.samples["theta"], milliseconds)
    return len(recording.samples), recording.facts["damage"]


@ANY_PACKING
def test_wherever_a_file_is_cut_every_whole_chunk_is_recovered(tmp_path: Path, packing: bytes) -> None:
    content, places = whole(packing)
    for cut in range(places[0][1], len(content), 41):
        count, damage = read(tmp_path, content[:cut], 0.0)
        assert count == 10 * sum(end <= cut for _, end in places)
        assert damage == {  # one rule for every byte
            "complete": False,
            "crc": "checked",
            "chunks_lost": None,
            "messages_lost": None,
            "share_lost": 0.0,
            "topics": {"/lab": {"messages": count, "messages_lost": None}},
            "remarks": ["no footer: the recorder did not finish, or the end is lost; how much is not known"],
        }


@ANY_PACKING
def test_a_chunk_with_an_absurd_length_costs_itself_alone(tmp_path: Path, packing: bytes) -> None:
    content, places = whole(packing)
    start = places[2][0] + 1
    for length in (2**64 - 1, 2**40, 0, 60):
        for end, told in ((len(content), (1, 10)), (content.rindex(DATA_END), (None, None))):  # or never finished
            count, damage = read(tmp_path, content[:start] + struct.pack("<Q", length) + content[start + 8 : end])
            assert count == 50
            assert (damage["chunks_lost"], damage["messages_lost"]) == told
            assert damage["share_lost"] == pytest.approx(1 / 6)


def test_records_that_no_recorder_writes_among_the_chunks_hide_none_of_them(tmp_path: Path) -> None:
    unknown = record(Opcode.CHUNK, struct.pack("<QQQI", 0, 0, 9, 0) + text(b"xyz\n") + struct.pack("<Q", 3) + b"abc")
    count, damage = read(tmp_path, log(LAB, chunk(TEN), unknown, chunk(TWENTY), summary=ALL))
    assert count == 20
    assert any(r"is compressed with 'xyz\n'; zstd and lz4 are read" in remark for remark in damage["remarks"])
    for second in (chunk(TWENTY), TWENTY):  # nor those behind what seems to be the end of the data
        assert read(tmp_path, log(LAB, DATA_END, chunk(TEN), second))[0] == 20


def test_a_schema_from_a_damaged_summary_reads_nothing(tmp_path: Path) -> None:
    damaged = log(chunk(LAB + TEN)[:-3] + b"abc", chunk(TWENTY), summary=LAB).replace(b"float64 a", b"float64 b")
    with pytest.raises(InputError, match="messages belong to channels that are not declared"):
        read(tmp_path, damaged)


def test_what_holds_no_log_is_refused_in_one_line(tmp_path: Path) -> None:
    for content in (b"", bytes(300), MAGIC, MAGIC * 2, MAGIC + b"\xff" * 99):
        with pytest.raises(InputError, match=r"^[^\n]+log.mcap: [^\n]+$"):
            read(tmp_path, content)


@ANY_PACKING
def test_no_damage_crashes_the_reader_changes_a_value_or_miscounts_what_is_lost(tmp_path: Path, packing: bytes) -> None:
    for seed in range(100):
        (content, _), chance = whole(packing), random.Random(seed)
        for _ in range(chance.randint(1, 6)):
            content = mutilated(content, chance) or MAGIC
        with suppress(InputError):
            count, damage = read(tmp_path, content)
            assert damage["messages_lost"] in (None, 60 - count)  # what is told is exact, or that nobody knows


def losses(folder: Path, content: bytes) -> tuple[Any, ...]:
    """Whether a file is complete, chunks lost, messages lost (also as inspect says), of these of the topic `/lab`."""
    damage = ingested(folder, content, loss=1.0).facts["damage"]
    told = FORMATS["mcap"].inspect(folder / "log.mcap").facts["messages lost"]
    lost = damage["messages_lost"]
    assert told == ("the file does not tell" if lost is None else str(lost))
    return damage["complete"], damage["chunks_lost"], lost, *damage["topics"]["/lab"].values()


def refused(folder: Path, content: bytes) -> str:
    """What both ingest and inspect say."""
    (folder / "log.mcap").write_bytes(content)
    said = refusal_by(recorded, folder / "log.mcap", theta="a")
    assert said == refusal_by(FORMATS["mcap"].inspect, folder / "log.mcap")
    return said


LEGAL = {
    "longer records": log(
        *map(longer, (schema(), channel(1, b"/lab"), chunk(TEN), index(1, 10), chunk(TWENTY, crc=False))),
        summary=longer(ALL),
    ),
    "private records": log(
        *(PRIVATE + LAB + PRIVATE, chunk(PRIVATE + TEN[:THREE] + PRIVATE + TEN[THREE:]), PRIVATE, chunk(TWENTY)),
        summary=PRIVATE + ALL + PRIVATE,
    ),
    "private records in a chunk with an index": log(
        LAB, chunk(TEN + PRIVATE, crc=False), index(1, 10), PRIVATE, chunk(TWENTY), summary=ALL
    ),
    "messages outside of the chunks": log(
        LAB, chunk(TEN), index(1, 10), TWENTY[:FIVE], PRIVATE, TWENTY[FIVE:], summary=statistics({1: 20}, 1)
    ),
    "no statistics": log(LAB, chunk(TEN), chunk(TWENTY)),
    "no channels": log(LAB, chunk(TEN), chunk(TWENTY), summary=statistics({1: 20}, 2, of_channels=False)),
}


@pytest.mark.parametrize("content", LEGAL.values(), ids=LEGAL)
def test_a_legal_file_is_complete_and_read_as_by_the_official_reader(tmp_path: Path, content: bytes) -> None:
    official = [struct.unpack("<d", m.data[4:])[0] for _, _, m in NonSeekingReader(BytesIO(content)).iter_messages()]
    assert ingested(tmp_path, content, loss=0.0).samples["theta"].to_list() == official == list(range(20))
    assert losses(tmp_path, content) == (True, 0, 0, 20, 0)


def test_the_loss_is_that_of_the_topic_and_not_of_the_file(tmp_path: Path) -> None:
    bad = b"".join(message(2, i * MILLISECOND, cdr(1.0)[: 9 if i % 5 == 0 else 12]) for i in range(100))
    rare = LAB + channel(2, b"/rare")
    content = log(rare, chunk(messages(1, range(10_000)) + bad), summary=statistics({1: 10_000, 2: 100}, 1))
    assert len(ingested(tmp_path, content).samples) == 10_000
    with pytest.raises(InputError, match="20 % of topic '/rare' is lost, at most 1 % may be"):
        ingested(tmp_path, content, "/rare")
    damage = ingested(tmp_path, content, "/rare", 0.2).facts["damage"]
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
    remarks = ingested(tmp_path, content, loss=1.0).facts["damage"]["remarks"]
    assert f"{len(removed)} bytes are missing before the summary" in remarks
    with pytest.raises(InputError, match="damaged or incomplete MCAP: 50 % of topic '/lab' is lost, at most 1 % may"):
        ingested(tmp_path, content)


def test_what_a_file_does_not_tell_of_its_losses_is_unknown(tmp_path: Path) -> None:
    cut_out = log(LAB, chunk(TEN), summary=LAB, shift=len(chunk(TWENTY)), crc=False)
    assert losses(tmp_path, cut_out) == (False, 0, None, 10, None)
    with pytest.raises(InputError, match="of topic '/lab' is lost"):
        ingested(tmp_path, cut_out, loss=0.1)


def test_what_contradicts_a_files_own_counts_is_not_complete(tmp_path: Path) -> None:
    more = log(LAB, chunk(TEN), chunk(TWENTY), summary=statistics({1: 10}, 2))
    assert losses(tmp_path, more) == (False, 0, 0, 20, 0)
    assert "it declares 10 messages and holds 20" in ingested(tmp_path, more).facts["damage"]["remarks"]
    turned = TEN[:FIVE] + b"\x85" + TEN[FIVE + 1 :]  # without a checksum, a message may pass for a private record
    assert losses(tmp_path, log(LAB, chunk(turned, crc=False), index(1, 10), chunk(TWENTY))) == (False, 0, 1, 19, 1)


def test_the_time_of_a_message_is_when_it_was_logged_and_not_when_it_was_published(tmp_path: Path) -> None:
    late = [message(1, 7 + 3 * i * MILLISECOND, cdr(i), publish=i * MILLISECOND) for i in range(20)]
    recording = ingested(tmp_path, log(LAB, chunk(b"".join(late))))
    np.testing.assert_allclose(recording.samples["time"], 3e-3 * np.arange(20), rtol=1e-12)
    assert recording.facts["time"] == {"source": "log", "stamps": "auto", "start_ns": 7}


def test_two_logs_in_one_file_are_refused_with_the_byte_to_cut_at(tmp_path: Path) -> None:
    other = log(schema() + channel(1, b"/other") + channel(2, b"/lab"), chunk(messages(1, range(30, 40))))
    ends = [FIRST.index(part) + len(part) - 8 - len(HEAD) for part in (chunk(TEN), chunk(TWENTY))]
    for cut in [*range(len(log()), len(FIRST), 23), *ends]:  # a cut chunk may end with the header of the second log
        assert f"holds two logs, the second from byte {cut} on: split them" in refused(tmp_path, FIRST[:cut] + other)
    for more in (bytes(100), other):
        said = refused(tmp_path, FIRST + more)
        assert f"ends at byte {len(FIRST)} and has {len(more)} bytes after it; keep what is before them" in said
    for what, again in (("channel", channel(1, b"/other")), ("schema", schema(b"float64 b\nfloat64 a"))):
        said = refused(tmp_path, log(LAB, chunk(LAB + TEN), chunk(again + TWENTY)))
        assert f"{what} 1 is '" in said
        assert "two logs were joined, or the file is damaged" in said


def assert_decoded(path: Path, topic: str, expected: list[dict[str, float]]) -> list[int]:
    """Every number of every message of a topic is read exactly, and no other; gives the log times [ns]."""
    paths = sorted({name for values in expected for name in values})
    found = decode_topics(read_mcap(path), {topic: paths})[topic]
    for name in paths:
        assert np.ma.getmaskarray(found.values[name]).tolist() == [name not in values for values in expected]
        own = [values[name] for values in expected if name in values]
        np.testing.assert_array_equal(np.ma.compressed(found.values[name]), own, err_msg=f"{topic} {name}")
    return [int(one) for one in found.log_time]


MIXED = """\
# a constant, a default, comments, bounds and every alignment
uint8 MODE_OFF=0
string LABEL = "a # b"
std_msgs/Header header
bool flag
float64 wide 1.5
uint8[3] bytes
int16 small
string<=20 name
float64[] series
Part[<=4] parts
Nothing nothing
float32 last
===
MSG: lab_msgs/Part
int8 kind
int64[2] counts
string[] tags
===
MSG: lab_msgs/msg/Nothing
===
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""
words, finite = st.text("abcé", max_size=6), st.floats(allow_nan=False, allow_infinity=False)
whole_numbers = st.lists(st.integers(-(2**63), 2**63 - 1), min_size=2, max_size=2)
part = {"kind": st.integers(-128, 127), "counts": whole_numbers, "tags": st.lists(words, max_size=2)}
mixed = {
    "flag": st.booleans(),
    "wide": finite,
    "bytes": st.binary(min_size=3, max_size=3),
    "small": st.integers(-(2**15), 2**15 - 1),
    "name": words,
    "series": st.lists(finite, max_size=3),
    "parts": st.lists(st.fixed_dictionaries(part), max_size=2),
    "nothing": st.just({}),
    "last": st.floats(width=32, allow_nan=False),
}


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
    return {key: v for name in value.__slots__ for key, v in numbers(getattr(value, name), dot + name).items()}


def assert_equal_to_reference(path: Path) -> int:
    """Compare every topic with the reference decoder, exactly; return how many numbers were compared."""
    topics: dict[str, list[tuple[int, dict[str, float]]]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            topics.setdefault(channel.topic, []).append((message.log_time, numbers(decoded)))
    for topic, messages in topics.items():
        if any(values for _, values in messages):
            assert assert_decoded(path, topic, [values for _, values in messages]) == [time for time, _ in messages]
    return sum(len(values) for messages in topics.values() for _, values in messages)


@pytest.mark.skipif(not REAL_DATA.is_dir(), reason="real data are not here")
def test_every_number_of_a_real_log_equals_the_reference_decoders() -> None:
    for name in ("rerun_rosbag2_all_sensor_msgs_ros2_cdr", "rosbag2_cdr_test_0", "pj_test_empty_channel"):
        assert assert_equal_to_reference(REAL_DATA / f"mcap/{name}.mcap") > 50


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(messages=st.lists(st.fixed_dictionaries(mixed), min_size=1, max_size=8))
def test_messages_of_any_shape_equal_the_reference_decoders(tmp_path: Path, messages: list[dict[str, Any]]) -> None:
    log = [stamped(10**9 + i * 10**6, **fields) for i, fields in enumerate(messages)]
    path = write_log(tmp_path / "log.mcap", log, MIXED, "lab_msgs/msg/Mixed")
    assert assert_equal_to_reference(path) >= 8 * len(messages)


def kind_of(text: str) -> MessageType:
    return message_type(Schema(1, text.encode(), "", "l/S"), ros1=False)


def read_each(kind: MessageType, paths: Sequence[str], *payloads: bytes) -> Columns:
    reader, lengths = Reader(paths, kind), np.array([len(one) for one in payloads])
    reader.read(b"".join(payloads), np.cumsum(lengths) - lengths, lengths)
    return reader.columns()


def test_big_endian_messages_and_characters_are_numbers() -> None:
    big = b"\0\0\0\0" + struct.pack(">B7xdh2xf", 7, -2.5, -300, 0.75)
    for schema, payload, expected in (
        ("uint8 a\nfloat64 b\nint16 c\nfloat32 d", big, [7, -2.5, -300, 0.75]),
        ("char a\nint8 b\nbyte c\nuint8 d", b"\0\1\0\0\xc8\xc8\xc8\xc8", [200, -56, 200, 200]),  # as rosidl says
    ):
        read = read_each(kind_of(schema), "abcd", payload)
        assert [read.values[path].tolist() for path in "abcd"] == [[one] for one in expected]


def test_a_joint_is_found_by_name_though_the_order_of_joints_changes(tmp_path: Path) -> None:
    schema = "std_msgs/Header header\nstring[] name\nfloat64[] position\n" + HEADER
    orders = [["hip", "toe"], ["toe", "hip"], ["hip", "toe"], ["shank", "toe"], ["hip", "leg"]]
    log = [stamped(i, name=order, position=[10.0 + i, 20.0 + i]) for i, order in enumerate(orders)]
    path = write_log(tmp_path / "log.mcap", log, schema, "sensor_msgs/msg/JointState")
    decoded = decode_topics(read_mcap(path), {"/lab": ["position[name=toe]"]})["/lab"]
    assert decoded.values["position[name=toe]"].tolist() == [20.0, 11.0, 22.0, 23.0, None]


ONE, KIND = cdr(1.0), kind_of("float64 a")
LONGER = kind_of("float64 a\nstring s\nfloat64[] b")


def test_a_message_or_a_schema_that_cannot_be_read_is_refused_by_name() -> None:
    for payload, said in (
        (ONE, "too short for its schema"),
        (ONE + struct.pack("<II", 0, 2**31), "too short for its schema"),
        (b"\x00\x07\x00\x00\x01", "encapsulation 00070000 is not plain CDR"),
    ):
        with pytest.raises(InputError, match=said):
            shape_of(LONGER, payload)
    for schema, said in (
        ("wstring w", "type 'l/wstring' of field 'w' is not defined"),
        ("Other a", "schema l/S: type 'l/Other' of field 'a' is not defined"),
        ("}{", r"schema l/S: cannot read the line '\}\{'"),
        ("float64 a\nfloat64 a", "field 'a' is defined twice"),
    ):
        with pytest.raises(InputError, match=said):
            kind_of(schema)


def test_a_message_with_more_than_its_schema_describes_is_refused_and_padding_is_not() -> None:
    for padding in (b"\xff", b"\xff" * 3, bytes(4), bytes(7)):  # to four bytes with any content, to eight with zeros
        assert shape_of(KIND, ONE + padding).leaves["a"][0] == 4
    for more in (b"\0\0\0\1", struct.pack("<d", 2.0), bytes(8)):
        with pytest.raises(InputError, match=f"a message of {12 + len(more)} bytes has {len(more)} more than its"):
            shape_of(KIND, ONE + more)
    both = read_each(KIND, ["a"], ONE + bytes(4), ONE + b"\0\0\0\7")  # zeros do not let another with content pass
    assert (both.rows.tolist(), both.misfits) == ([0], 1)


def write_json(folder: Path, texts: list[str], chunk_size: int = 1 << 20) -> Path:
    return write_payloads(folder / "log.mcap", [text.encode() for text in texts], "json", chunk_size=chunk_size)


SHAPES: list[tuple[Any, dict[str, float]]] = [
    ({"a": 1.5, "b": {"c": 2}, "d": [1, 2.5], "e": True}, {"a": 1.5, "b.c": 2, "d[1]": 2.5, "e": True}),
    ({"a": None, "b": {}, "d": [3]}, {}),
    ({"b": {"c": -(2**62), "a": 9}, "d": []}, {"b.c": -(2**62)}),
    ({"a": -7, "b": None, "d": [None, 4], "e": False}, {"a": -7, "d[1]": 4, "e": False}),
]


def test_messages_of_different_shapes_stay_in_order_with_what_each_has(tmp_path: Path) -> None:
    order = [0, 0, 1, 3, 2, 1, 0, 3, 3, 2]
    path = write_json(tmp_path, [json.dumps(SHAPES[k][0], indent=1) for k in order], chunk_size=200)
    assert_decoded(path, "/lab", [SHAPES[k][1] for k in order])


@pytest.mark.parametrize("base", [2**53, -(2**53), 2**63])
def test_an_integer_beyond_a_floats_reach_is_exact_in_every_chunk(tmp_path: Path, base: int) -> None:
    texts = [json.dumps({"a": base + 1 + 2 * i if i % 7 else i}) for i in range(60)]
    decoded = decode_topics(read_mcap(write_json(tmp_path, texts, chunk_size=400)), {"/lab": ["a"]})["/lab"]
    assert decoded.values["a"].tolist() == [json.loads(text)["a"] for text in texts]


@pytest.mark.parametrize(
    ("field", "right", "wrong", "said"),
    [
        ("x", '{"x": 1.5}', "no json", "a message of 7 bytes is not JSON: Expecting value"),
        ("x", '{"x": 1.5}', '{"x": "a"}', "field 'x' is \"a\", not a number, in message 2"),
        ("x", '{"x": 1.5}', '{"x": [1, 2]}', "field 'x' is an array of 2, not one number, in message 2"),
        ("x.y", '{"x": {"y": 1.5}}', '{"x": 3}', "field 'x' is 3, not an object with fields, in message 2"),
        ("v[n=b]", '{"v": [0, 1.5], "n": ["a", "b"]}', '{"v": [1, "c"], "n": ["a", "b"]}', "field 'v[n=b]' is \"c\""),
    ],
)
def test_a_message_without_a_number_in_a_field_is_lost_and_said(
    tmp_path: Path, field: str, right: str, wrong: str, said: str
) -> None:
    recording = recorded(write_json(tmp_path, [right, wrong, *[right] * 9], chunk_size=100), "log", 0.3, theta=field)
    assert recording.samples["theta"].to_list() == [1.5] * 10
    assert recording.facts["damage"]["topics"]["/lab"] == {"messages": 11, "messages_lost": 1}
    assert recording.facts["damage"]["remarks"][0].startswith(f"1 of 11 messages of topic '/lab' are lost: {said}")
    with pytest.raises(InputError, match="messages that cannot be used: 90 % of topic '/lab' is lost, at most 30 %"):
        recorded(write_json(tmp_path, [right, *[wrong] * 9]), "log", 0.3, theta=field)


def test_a_field_that_is_no_number_anywhere_is_blamed_on_the_source_file(tmp_path: Path) -> None:
    for text, said in (
        ('{"x": "1"}', "field 'x' is \"1\", not a number, in message 1"),
        ('{"x": [1, 2]}', "field 'x' is an array of 2, not one number, in message 1 (it has x[0..1])"),
        ('{"x": true}', "field 'x' is true in message 1 of 9, a truth value and no number in rad"),
    ):
        with pytest.raises(InputError, match="`field` in the source file") as caught:
            recorded(write_json(tmp_path, [text] * 9), "log", 0.3, theta="x")
        assert f"topic '/lab': {said}" in str(caught.value)
    with pytest.raises(InputError, match="field 'x' is a truth value in some places and a number in others"):
        recorded(write_json(tmp_path, ['{"x": true}', '{"x": 1}']), "log", 0.9, theta="x")


def test_values_that_are_absent_are_counted_and_said(tmp_path: Path) -> None:
    recording = recorded(write_json(tmp_path, ['{"x": 1.5}', '{"x": null}', "{}"]), "log", 0.3, theta="x")
    assert recording.samples["theta"].to_list() == [1.5, None, None]
    said = "topic '/lab': field 'x' has no value in 2 of 3 messages, first message 2"
    assert any(said in warning for warning in recording.warnings)


SCALARS = {"double": -1e300, "bool": True, "sint32": -(2**31), "int64": -(2**63), "uint64": 2**64 - 1}


def descriptors() -> FileDescriptorSet:
    """`lab.Sample`: each scalar alone, optional and in an array, an array of messages, names."""
    file = FileDescriptorProto(name="lab.proto", package="lab", syntax="proto3")
    inner, sample = (file.message_type.add(name=name) for name in ("Inner", "Sample"))

    def add(message: Any, name: str, of: str, **options: Any) -> None:
        kind, options = getattr(FieldDescriptorProto, f"TYPE_{of.upper()}"), {"label": 1, **options}
        message.field.add(name=name, number=len(message.field) + 1, type=kind, **options)

    add(inner, "count", "int64")
    add(sample, "name", "string", label=3)
    add(sample, "parts", "message", type_name=".lab.Inner", label=3)
    for scalar in SCALARS:
        add(sample, f"one_{scalar}", scalar)
        add(sample, f"packed_{scalar}", scalar, label=3)
        add(sample, f"maybe_{scalar}", scalar, proto3_optional=True, oneof_index=len(sample.oneof_decl))
        sample.oneof_decl.add(name=f"_maybe_{scalar}")
    return FileDescriptorSet(file=[file])


POOL = DescriptorPool()
POOL.Add(descriptors().file[0])
Sample: Any = GetMessageClass(POOL.FindMessageTypeByName("lab.Sample"))


def write_protobuf(folder: Path, payloads: list[bytes], **options: Any) -> Path:
    schema = "lab.Sample", "protobuf", descriptors().SerializeToString()
    return write_payloads(folder / "log.mcap", payloads, "protobuf", *schema, **options)


def test_what_google_wrote_is_read_and_what_is_absent_is_null_if_it_is_optional_and_else_zero(tmp_path: Path) -> None:
    ones, maybe, packed = (
        {f"{kind}_{s}": value for s, value in SCALARS.items()} for kind in ("one", "maybe", "packed")
    )
    zeros = {name: type(value)(0) for name, value in ones.items()}
    arrays = {name: [value, 0] for name, value in packed.items()}
    in_arrays = {f"{name}[{i}]": one for name, pair in arrays.items() for i, one in enumerate(pair)}
    contents: list[tuple[dict[str, Any], dict[str, float]]] = [
        (ones | maybe, ones | maybe),
        ({}, zeros),
        ({**arrays, "name": ["é"]}, zeros | in_arrays),
        ({"maybe_double": 0.0, "parts": [{}, {"count": 5}]}, zeros | {"maybe_double": 0.0, "parts[1].count": 5}),
    ]
    expected = [values | ({"parts[0].count": 0} if "parts" in content else {}) for content, values in contents]
    path = write_protobuf(tmp_path, [Sample(**one).SerializeToString() for one, _ in contents], chunk_size=100)
    assert_decoded(path, "/lab", expected)


def test_a_message_that_google_refuses_is_left_out_and_reported(tmp_path: Path) -> None:
    whole = Sample(one_double=1.0, one_int64=-5).SerializeToString()
    recording = recorded(write_protobuf(tmp_path, [whole, whole[:-3], whole]), "log", 0.5, theta="one_double")
    assert (len(recording.samples), recording.facts["damage"]["messages_lost"]) == (2, 1)
    assert "1 of 3 messages of topic '/lab' are lost: a message of" in recording.facts["damage"]["remarks"][0]


def test_fields_are_listed_with_their_types_lengths_and_names_and_read_by_these(tmp_path: Path) -> None:
    content = {"name": ["hip", "toe"], "packed_double": [1.0, 2.0], "packed_uint64": [5, 300, 7], "one_sint32": 1}
    path = write_protobuf(tmp_path, [Sample(**content).SerializeToString()] * 3)
    listed = {"packed_double[name=toe]": "float64[2]", "packed_uint64[0]": "int64[3]", "one_sint32": "int64"}
    assert listed.items() <= {one.address["field"]: one.type for one in inspect_file(path).channels}.items()
    assert recorded(path, "log", 0.3, theta="packed_double[name=toe]").samples["theta"].to_list() == [2.0] * 3
