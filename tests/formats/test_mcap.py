# SPDX-License-Identifier: Apache-2.0
"""MCAP: cut, damaged and rare files, and the numbers of messages in every encoding."""

import json
import re
import struct
import sys
import zlib
from io import BytesIO

import lz4.frame
import numpy as np
import pytest
import zstandard
from conftest import refused_with
from google.protobuf.descriptor_pb2 import FileDescriptorSet, UninterpretedOption
from google.protobuf.timestamp_pb2 import Timestamp
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.reader import NonSeekingReader, make_reader
from mcap_builder import HEADER, stamped, write_log, write_payloads
from mcap_builder import message_source as source
from mcap_ros2.decoder import DecoderFactory

from osl_analysis import formats
from osl_analysis.base.recording import End
from osl_analysis.formats import mcap

MAGIC = mcap.MAGIC
MILLISECOND = 1_000_000  # ns


def column(recording, field, topic="/lab"):
    """The numbers of a field; None where a message has none."""
    return recording.find({"topic": topic, "field": field}).values.tolist()


def read_field(path, field):
    return column(formats.read(path, source(field)), field)


# --- files put together of records --------------------------------------------------------------


def raw(record):
    """A record as the official library writes it."""
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def longer(record, opcode=None):
    """A record with more bytes than its specification says, as of a later version."""
    return struct.pack("<BQ", opcode or record[0], len(record) - 4) + record[9:] + b"\1\2\3\4\5"


SCHEMA = raw(records.Schema(id=1, name="lab_msgs/msg/S", encoding="ros2msg", data=b"float64 a"))


def channel(number, topic):
    return raw(
        records.Channel(id=number, topic=topic, message_encoding="cdr", metadata={}, schema_id=1)
    )


def cdr(value):
    return b"\0\1\0\0" + struct.pack("<d", value)


def message(number, time_ns, payload):
    return raw(
        records.Message(
            channel_id=number, log_time=time_ns, data=payload, publish_time=7, sequence=0
        )
    )


def messages(values, number=1):
    """One per millisecond, each with its own value."""
    return b"".join(message(number, i * MILLISECOND, cdr(i)) for i in values)


PACKINGS = {
    "zstd": zstandard.ZstdCompressor().compress,
    "lz4": lz4.frame.compress,
    "": bytes,
}
any_packing = pytest.mark.parametrize("packing", PACKINGS)


def chunk(content, packing="zstd", checksum=zlib.crc32):
    packed = PACKINGS[packing](content)
    return raw(records.Chunk(packing, packed, 1 << 62, 0, checksum(content), len(content)))


def statistics(count):
    return raw(records.Statistics(0, 1, {1: count}, 1, count, 0, 0, 0, 1))


HEAD = raw(records.Header("", ""))
INDEX = raw(records.MessageIndex(1, [(0, 0)] * 10))


def log(*parts, summary=b""):
    """A whole file of these parts."""
    data = MAGIC + HEAD + b"".join(parts) + raw(records.DataEnd(0))
    return data + summary + raw(records.Footer(len(data) if summary else 0, 0, 0)) + MAGIC


DECLARED = SCHEMA + channel(1, "/lab")
TEN = messages(range(10))
TWENTY = messages(range(10, 20))
ONE_MESSAGE = len(TEN) // 10
PRIVATE = longer(HEAD, 0x85) + longer(HEAD, 0x40)  # and one of a later version


def read(folder, content):
    (folder / "log.mcap").write_bytes(content)
    return formats.read(folder / "log.mcap", source("a"))


# --- cut and damaged files ----------------------------------------------------------------------


@any_packing
def test_wherever_a_log_is_cut_its_whole_chunks_are_read(tmp_path, packing):
    parts = [chunk(messages(range(k, k + 10)), packing) + INDEX for k in range(0, 60, 10)]
    content = log(DECLARED, *parts, summary=DECLARED + statistics(60))
    begin = len(MAGIC + HEAD + DECLARED)
    ends = begin + np.cumsum([len(part) for part in parts])

    for cut in range(begin + len(parts[0]), len(content), 97):
        recording = read(tmp_path, content[:cut])

        # the indexes behind the last chunk are not needed
        least = 10 * np.count_nonzero(ends <= cut)
        values = column(recording, "a")
        assert values == list(range(len(values)))
        assert least <= len(values) <= least + 10
        assert recording.loss.end == End.MISSING
        assert recording.loss.lost is None
        assert "log.mcap" in recording.loss.remarks[0]


@any_packing
def test_a_chunk_that_does_not_match_its_checksum_is_lost_and_counted(tmp_path, packing):
    damaged = bytearray(chunk(TWENTY, packing))
    damaged[-30] ^= 1

    recording = read(tmp_path, log(DECLARED, chunk(TEN), bytes(damaged), summary=statistics(20)))

    assert column(recording, "a") == list(range(10))
    assert recording.loss.by_topic == {"/lab": (10, 20)}
    assert recording.loss.share == 0.5
    assert re.search(r"byte \d+", recording.loss.remarks[0])
    assert recording.facts["chunks_lost"] == 1


def test_messages_keep_the_order_of_the_file_if_a_clock_was_set_back(tmp_path):
    recording = read(tmp_path, log(DECLARED, chunk(TWENTY), chunk(TEN)))

    assert column(recording, "a") == [*range(10, 20), *range(10)]


def test_a_log_is_read_up_to_a_message_that_is_no_whole_one(tmp_path):
    for behind in (struct.pack("<BQ", 5, 3) + b"abc" + TWENTY, TWENTY[: ONE_MESSAGE - 1]):
        recording = read(tmp_path, MAGIC + HEAD + DECLARED + TEN + behind)

        assert column(recording, "a") == list(range(10))


def test_two_logs_in_one_file_are_refused_with_the_byte_where_to_split_them(tmp_path):
    first = log(DECLARED, chunk(TEN))
    with refused_with(rf"log.*byte {len(first)};"):
        read(tmp_path, first + first)


# --- legal, rare files --------------------------------------------------------------------------

LEGAL = {
    "longer records": log(
        *map(longer, (SCHEMA, channel(1, "/lab"), chunk(TEN), INDEX, chunk(TWENTY)))
    ),
    "a checksum of zero, which is none": log(
        DECLARED, chunk(TEN, checksum=lambda _: 0), chunk(TWENTY)
    ),
    "private records": log(
        PRIVATE + chunk(SCHEMA) + DECLARED[len(SCHEMA) :] + PRIVATE,
        chunk(TEN + PRIVATE),
        PRIVATE,
        chunk(TWENTY),
    ),
    "a chunk without a record": log(DECLARED, chunk(b""), chunk(TEN + TWENTY)),
    "messages outside of chunks": log(
        DECLARED,
        chunk(TEN),
        INDEX,
        TWENTY[: 5 * ONE_MESSAGE],
        PRIVATE,
        TWENTY[5 * ONE_MESSAGE :],
    ),
    "a private record that holds messages, which are not of the log": log(
        DECLARED,  # and is as long as ten messages
        chunk(
            TEN[:ONE_MESSAGE] + struct.pack("<BQ", 0x85, len(TEN[9:])) + TEN[9:] + TEN[ONE_MESSAGE:]
        ),
        chunk(TWENTY),
    ),
}


@pytest.mark.parametrize("content", LEGAL.values(), ids=LEGAL)
def test_a_legal_log_is_read_as_by_the_official_reader(tmp_path, content):
    official = [
        struct.unpack("<d", one.data[4:])[0]
        for *_, one in NonSeekingReader(BytesIO(content)).iter_messages()
    ]

    recording = read(tmp_path, content)

    assert column(recording, "a") == official == list(range(20))
    assert recording.facts["chunks_lost"] == 0


@pytest.mark.parametrize("offset", [0, 20])
def test_two_channels_of_one_topic_that_write_at_once_are_refused(tmp_path, offset):
    both = log(DECLARED + channel(2, "/lab"), chunk(TEN + messages(range(5 + offset, 30), 2)))

    if offset:  # a publisher that was started again
        assert column(read(tmp_path, both), "a") == [*range(10), *range(25, 30)]
        return
    with refused_with(r"2 .*channel 1 .*channel 2"):
        read(tmp_path, both)


def test_a_topic_of_two_types_is_refused(tmp_path):
    """Both messages have 8 bytes: the whole numbers would be read as floats, without a word."""
    whole = raw(records.Schema(id=2, name="lab_msgs/msg/W", encoding="ros2msg", data=b"int64 a"))
    second = records.Channel(id=2, topic="/lab", message_encoding="cdr", metadata={}, schema_id=2)
    later = [message(2, i * MILLISECOND, b"\0\1\0\0" + struct.pack("<q", i)) for i in range(10, 20)]

    with refused_with("topic '/lab' has messages of 2 types; .*a topic of its own"):
        read(tmp_path, log(DECLARED + whole + raw(second), chunk(TEN), chunk(b"".join(later))))


# --- numbers of messages ------------------------------------------------------------------------


def assert_decoded(path, expected, topic="/lab"):
    """Compare every number of every message of a topic; gives the log times [ns]."""
    paths = sorted({name for values in expected for name in values})
    recording = formats.read(path, source(*paths, topic=topic))
    for name in paths:
        wanted = [values.get(name) for values in expected]
        assert column(recording, name, topic) == wanted, name
    return recording.channels[0].rows.stamps_ns.tolist()


words = st.text("abcé", max_size=6)
finite = st.floats(allow_nan=False, allow_infinity=False)
PART = {
    "int8 kind": st.integers(-128, 127),
    "int64[2] counts": st.lists(st.integers(-(2**63), 2**63 - 1), min_size=2, max_size=2),
    "string[] tags": st.lists(words, max_size=1),
}
parts_of_messages = st.fixed_dictionaries({line.split()[1]: one for line, one in PART.items()})
FIELDS = {
    "bool flag": st.booleans(),
    "float64 wide 1.5": finite,
    "uint8[3] bytes": st.binary(min_size=3, max_size=3),
    "int16 small": st.integers(-(2**15), 2**15 - 1),
    "string<=20 name": words,
    "float64[] series": st.lists(finite, max_size=3),
    "Part[<=4] parts": st.lists(parts_of_messages, max_size=2),
    "Nothing nothing": st.just({}),
    "float32 last": st.floats(width=32, allow_nan=False),
}
mixed = st.fixed_dictionaries({line.split()[1]: one for line, one in FIELDS.items()})
MIXED = "\n".join(
    [
        "# a constant, a default, bounds and every alignment",
        "uint8 OFF=0",
        'string LABEL = "a # b"',
        "std_msgs/Header header",
        *FIELDS,
        "=" * 80 + "\nMSG: lab_msgs/Part",
        *PART,
        "=" * 80 + "\nMSG: lab_msgs/msg/Nothing",
        "=" * 80 + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id",
    ]
)


def numbers_in(value, path=""):
    """Every number in a message of the reference decoder by its path; of long arrays a few."""
    if isinstance(value, bool | int | float):
        return {path: value}
    if isinstance(value, str):
        return {}
    found = {}
    if isinstance(value, list | tuple | bytes):
        for place, element in enumerate(value[:64]):
            found |= numbers_in(element, f"{path}[{place}]")
        return found
    for name in value.__slots__:
        found |= numbers_in(getattr(value, name), f"{path}.{name}".removeprefix("."))
    return found


def assert_equal_to_reference(path):
    """Compare every topic with the reference decoder; gives how many numbers were compared."""
    topics = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, own_channel, own_message, decoded in reader.iter_decoded_messages():
            found = (own_message.log_time, numbers_in(decoded))
            topics.setdefault(own_channel.topic, []).append(found)
    compared = 0
    for topic, found_messages in topics.items():
        values = [numbers for _, numbers in found_messages]
        if any(values):
            times = assert_decoded(path, values, topic)
            assert times == [time for time, _ in found_messages]
        compared += sum(map(len, values))
    return compared


@pytest.mark.recordings
@pytest.mark.parametrize(
    "name",
    [
        "rerun_rosbag2_all_sensor_msgs_ros2_cdr",
        "rosbag2_cdr_test_0",
        "pj_test_empty_channel",
    ],
)
def test_every_number_of_a_real_log_equals_the_reference_decoders(recordings, name):
    assert assert_equal_to_reference(recordings / f"mcap/{name}.mcap") > 50


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(contents=st.lists(mixed, min_size=1, max_size=8))
def test_messages_of_any_shape_equal_the_reference_decoders(tmp_path, contents):
    stamped_messages = [stamped(10**9 + i * 10**6, **one) for i, one in enumerate(contents)]
    path = write_log(tmp_path / "log.mcap", stamped_messages, MIXED, "lab_msgs/msg/Mixed")

    assert assert_equal_to_reference(path) >= 8 * len(contents)


@pytest.mark.parametrize(
    ("text", "payload", "expected"),
    [
        (
            "uint8 a\nfloat64 b\nint16 c\nfloat32 d",
            b"\0\0\0\0" + struct.pack(">B7xdh2xf", 7, -2.5, -300, 0.75),
            [7, -2.5, -300, 0.75],
        ),
        # as rosidl says
        ("char a\nint8 b\nbyte c\nuint8 d", b"\0\1\0\0\xc8\xc8\xc8\xc8", [200, -56, 200, 200]),
        (
            "uint16 a\nint32 b\nuint64 c\nuint32 d",
            b"\0\1\0\0" + b"\xff" * 23,  # three bytes of padding
            [2**16 - 1, -1, 2**64 - 1, 2**32 - 1],
        ),
    ],
)
def test_numbers_of_every_type_and_byte_order_are_exact(tmp_path, text, payload, expected):
    schema_of_all = ("l/S", "ros2msg", text.encode())
    path = write_payloads(tmp_path / "log.mcap", [payload], "cdr", *schema_of_all)

    assert_decoded(path, [dict(zip("abcd", expected, strict=True))])


def write_joints(folder, *states):
    written = [
        stamped(i, name=names, position=positions, velocity=[])
        for i, (names, positions) in enumerate(states)
    ]
    return write_log(
        folder / "log.mcap",
        written,
        (
            "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
            + HEADER
        ),
        "sensor_msgs/msg/JointState",
    )


def test_a_joint_is_found_by_name_beside_those_of_another_publisher(tmp_path):
    leg = (["hip", "toe"], [1.0, 2.0])
    arm = (["hand"], [3.0])
    path = write_joints(tmp_path, leg, arm, leg)

    assert read_field(path, "position[name=toe]") == [2.0, None, 2.0]


def test_two_publishers_of_one_joint_are_refused_with_their_names(
    tmp_path,
):
    ours = (["knee", "ankle"], [1.0, 2.0])
    others = (["ankle", "knee"], [0.0, 0.0])
    path = write_joints(tmp_path, ours, ours, others, ours)
    said = r"'/lab'.* 2 .*\[knee, ankle\].*\[ankle, knee\]"

    assert any(re.search(said, remark) for remark in formats.read(path).loss.remarks)
    with refused_with(said):
        formats.read(path, source("position[name=knee]"))


def test_a_name_that_two_elements_have_is_refused(tmp_path):
    path = write_joints(tmp_path, (["toe", "toe"], [1.0, 2.0]))

    with refused_with(r"number.*position\[0\]"):
        read_field(path, "position[name=toe]")


def test_a_unit_by_convention_is_likely_and_never_stated(tmp_path):
    path = write_joints(tmp_path, (["toe"], [1.0]))

    found = formats.read(path).find({"topic": "/lab", "field": "position[name=toe]"})

    assert (found.unit, found.likely_unit) == ("", "rad")


ONE = cdr(1.0)


def test_messages_that_do_not_fit_are_lost_and_others_keep_their_numbers(tmp_path):
    payloads = [ONE, ONE + b"\0\0\0\7", cdr(2.0), ONE[:9], cdr(3.0)]
    content = b"".join(message(1, i * MILLISECOND, one) for i, one in enumerate(payloads))

    recording = read(tmp_path, log(DECLARED, chunk(content)))
    rows = recording.find({"topic": "/lab", "field": "a"}).rows

    assert column(recording, "a") == [1.0, 2.0, 3.0]
    assert rows.lines.tolist() == [1, 3, 5]
    assert recording.loss.by_topic == {"/lab": (3, 5)}
    assert re.search("2 .* 5 .*'/lab'", recording.loss.remarks[0])


# --- JSON and protobuf --------------------------------------------------------------------------


def write_json(folder, texts, chunk_size=1 << 20):
    payloads = [text.encode() for text in texts]
    return write_payloads(folder / "log.mcap", payloads, "json", chunk_size=chunk_size)


@pytest.mark.parametrize("base", [2**53, -(2**53)])
def test_a_whole_number_beyond_a_floats_reach_is_exact(tmp_path, base):
    contents = [{"a": base + 1 + 2 * i if i % 7 else i} for i in range(60)]
    path = write_json(tmp_path, [json.dumps(one) for one in contents], chunk_size=400)

    assert_decoded(path, contents)


@pytest.mark.parametrize(
    ("field", "right", "wrong"),
    [
        ("x", '{"x": 1.5}', '{"x": "a"}'),
        ("x", '{"x": 1.5}', '{"x": [1, 2]}'),
        ("x.y", '{"x": {"y": 1.5}}', '{"x": 3}'),
        ("v[1]", '{"v": [0, 1.5]}', '{"v": [1, "c"]}'),
    ],
)
def test_a_message_without_a_number_in_an_asked_field_has_no_value_there(
    tmp_path, field, right, wrong
):
    path = write_json(tmp_path, [right, wrong, right])

    assert read_field(path, field) == [1.5, None, 1.5]


@pytest.mark.parametrize(
    ("text", "said"), [('{"x": null}', r"'x' .*`field`"), ("{", "Expecting property name")]
)
def test_a_field_without_numbers_is_blamed_on_the_source_file(tmp_path, text, said):
    path = write_json(tmp_path, [text])

    with refused_with(said):
        read_field(path, "x")


@pytest.mark.parametrize(
    ("payload", "packing", "said"),
    [
        (b"\0\7\0\0\1", ("cdr", "l/S", "ros2msg", b"float64 y"), "00070000.*CDR"),
        (ONE, ("cdr", "l/S", "ros2msg", b"}{"), "parse"),
        (ONE, ("cdr", "l/S", "ros2msg", b"wstring y"), "type 'l/msg/wstring'"),
        (
            b"\5",
            ("protobuf", "l.S", "protobuf", b"\xff\xff"),
            "Error parsing message",
        ),
    ],
)
def test_a_topic_that_cannot_be_decoded_is_refused_with_the_reason(
    tmp_path, payload, packing, said
):
    path = write_payloads(tmp_path / "log.mcap", [payload], *packing)

    with refused_with(rf"topic '/lab'.*{said}"):
        read_field(path, "y")


def write_protobuf(folder, contents):
    """Messages of a type of google's own."""
    described = FileDescriptorSet()
    file = contents[0].DESCRIPTOR.file
    for one in (*file.dependencies, file):
        one.CopyToProto(described.file.add())
    payloads = [one.SerializeToString() for one in contents]
    own_schema = (contents[0].DESCRIPTOR.full_name, "protobuf", described.SerializeToString())
    return write_payloads(folder / "log.mcap", payloads, "protobuf", *own_schema, chunk_size=100)


def test_what_google_wrote_is_read(tmp_path):
    expected = {
        "positive_int_value": 2**63 - 1,
        "negative_int_value": -(2**63),
        "double_value": -1e300,
    }
    path = write_protobuf(tmp_path, [UninterpretedOption(**expected), UninterpretedOption()])

    assert_decoded(path, [expected, {}])


def test_what_is_absent_in_a_message_of_google_and_not_optional_is_zero(tmp_path):
    path = write_protobuf(tmp_path, [Timestamp(), Timestamp(seconds=2**40)])

    assert_decoded(path, [{"seconds": 0, "nanos": 0}, {"seconds": 2**40, "nanos": 0}])


def test_without_the_library_of_protobuf_it_is_named(tmp_path, monkeypatch):
    path = write_protobuf(tmp_path, [Timestamp(seconds=5)] * 3)
    monkeypatch.setitem(sys.modules, "mcap_protobuf.decoder", None)

    with refused_with("'/lab'.* -m pip install mcap-protobuf-support$"):
        read_field(path, "seconds")
