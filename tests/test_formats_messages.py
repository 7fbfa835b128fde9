"""Messages in CDR, JSON and protobuf: every number stands at its path as reference decoders read it; what is absent is
null, and what is no number is lost and said."""

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c3d_builder import REAL_DATA
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_builder import HEADER, stamped, write_log, write_payloads
from mcap_ros2.decoder import DecoderFactory

from osl_analysis.commands.inspect import inspect_file
from osl_analysis.errors import InputError
from osl_analysis.formats.mcap import read_mcap
from osl_analysis.formats.message_fields import Columns, MessageType, Reader, message_type, shape_of
from osl_analysis.formats.messages import decode_topics
from osl_analysis.ingest.raw_files import FORMATS


def assert_decoded(path: Path, topic: str, expected: list[dict[str, float]]) -> list[int]:
    """Every number of every message of a topic is read exactly, and no other; gives the log times [ns]."""
    paths = sorted({name for values in expected for name in values})
    found = decode_topics(read_mcap(path), {topic: paths})[topic]
    for name in paths:
        assert np.ma.getmaskarray(found.values[name]).tolist() == [name not in values for values in expected]
        own = [values[name] for values in expected if name in values]
        np.testing.assert_array_equal(np.ma.compressed(found.values[name]), own, err_msg=f"{topic} {name}")
    return [int(one) for one in found.log_time]


def ingested(path: Path, time: dict[str, str] | None = None, loss: float = 0.3, **fields: str | dict[str, str]) -> Any:
    """The recording of fields of `/lab` by column, in radians."""
    channels: dict[str, Any] = {}
    for column, one in fields.items():
        channels[column] = {"topic": "/lab", "unit": "rad", **({"field": one} if isinstance(one, str) else one)}
    described = {"format": "mcap", "time": time or {"source": "log"}, "largest_loss": loss, "channels": channels}
    return FORMATS["mcap"].read(path, FORMATS["mcap"].source.model_validate(described))


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
text, finite = st.text("abcé", max_size=6), st.floats(allow_nan=False, allow_infinity=False)
whole = st.integers(-(2**63), 2**63 - 1)
part = {"kind": st.integers(-128, 127), "counts": st.lists(whole, min_size=2, max_size=2)}
mixed = {
    "flag": st.booleans(),
    "wide": finite,
    "bytes": st.binary(min_size=3, max_size=3),
    "small": st.integers(-(2**15), 2**15 - 1),
    "name": text,
    "series": st.lists(finite, max_size=3),
    "parts": st.lists(st.fixed_dictionaries(part | {"tags": st.lists(text, max_size=2)}), max_size=2),
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


ONE = struct.pack("<4sd", b"\0\1\0\0", 1.0)


@pytest.mark.parametrize(
    ("schema", "payload", "said"),
    [
        ("float64 a\nstring s\nfloat64[] b", ONE, "too short for its schema"),
        ("float64 a\nstring s\nfloat64[] b", ONE + struct.pack("<II", 0, 2**31), "too short for its schema"),
        ("uint8 a", b"\x00\x07\x00\x00\x01", "encapsulation 00070000 is not plain CDR"),
        ("wstring w", b"\0\1\0\0\0\0\0\0", "field 'w' is a wstring"),
        ("Other a", b"", "schema l/S: type 'l/Other' of field 'a' is not defined"),
        ("}{", b"", r"schema l/S: cannot read the line '\}\{'"),
        ("float64 a\nfloat64 a", b"", "field 'a' is defined twice"),
    ],
)
def test_a_message_or_a_schema_that_cannot_be_read_is_refused_by_name(schema: str, payload: bytes, said: str) -> None:
    with pytest.raises(InputError, match=said):
        shape_of(kind_of(schema), payload)


def test_a_message_with_more_than_its_schema_describes_is_refused_and_padding_is_not() -> None:
    kind = kind_of("float64 a")
    for padding in (b"\xff", b"\xff" * 3, bytes(4), bytes(7)):  # to four bytes with any content, to eight with zeros
        assert shape_of(kind, ONE + padding).leaves["a"][0] == 4
    for more in (b"\0\0\0\1", struct.pack("<d", 2.0), bytes(8)):
        with pytest.raises(InputError, match=f"a message of {12 + len(more)} bytes has {len(more)} more than its"):
            shape_of(kind, ONE + more)
    both = read_each(kind, ["a"], ONE + bytes(4), ONE + b"\0\0\0\7")  # zeros do not let another with content pass
    assert (both.rows.tolist(), both.misfits) == ([0], 1)


def write_json(folder: Path, texts: list[str], chunk_size: int = 1 << 20) -> Path:
    return write_payloads(folder / "log.mcap", [text.encode() for text in texts], "json", chunk_size=chunk_size)


SHAPES: list[tuple[Any, dict[str, float]]] = [
    ({"a": 1.5, "b": {"c": 2}, "d": [1, 2.5], "e": True}, {"a": 1.5, "b.c": 2, "d[1]": 2.5, "e": True}),
    ({"a": None, "b": {}, "d": [3]}, {}),
    ({"b": {"c": -(2**62), "a": 9}, "d": []}, {"b.c": -(2**62)}),
    ({"a": -7, "b": None, "d": [None, 4], "e": False}, {"a": -7, "d[1]": 4, "e": False}),
]


@pytest.mark.parametrize("indent", [None, 1])
def test_messages_of_different_shapes_stay_in_order_with_what_each_has(tmp_path: Path, indent: int | None) -> None:
    order = [0, 0, 1, 3, 2, 1, 0, 3, 3, 2]
    path = write_json(tmp_path, [json.dumps(SHAPES[k][0], indent=indent) for k in order], chunk_size=200)
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
        ("x", '{"x": 1.5}', '{"x": true}', "field 'x' is true, not a number as elsewhere, in message 2"),
        ("x", '{"x": 1.5}', '{"x": [1, 2]}', "field 'x' is an array of 2, not one number, in message 2"),
        ("x.y", '{"x": {"y": 1.5}}', '{"x": 3}', "field 'x' is 3, not an object with fields, in message 2"),
        (
            "v[n=b]",
            '{"v": [0, 1.5], "n": ["a", "b"]}',
            '{"v": [1, "c"], "n": ["a", "b"]}',
            "field 'v[n=b]' is \"c\", not a number, in message 2",
        ),
    ],
)
def test_a_message_without_a_number_in_a_field_is_lost_and_said(
    tmp_path: Path, field: str, right: str, wrong: str, said: str
) -> None:
    recording = ingested(write_json(tmp_path, [right, wrong, *[right] * 9], chunk_size=100), theta=field)
    assert recording.samples["theta"].to_list() == [1.5] * 10
    assert recording.facts["damage"]["topics"]["/lab"] == {"messages": 11, "messages_lost": 1}
    assert recording.facts["damage"]["remarks"][0].startswith(f"1 of 11 messages of topic '/lab' are lost: {said}")
    with pytest.raises(InputError, match="messages that cannot be used: 90 % of topic '/lab' is lost, at most 30 %"):
        ingested(write_json(tmp_path, [right, *[wrong] * 9]), theta=field)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"x": "1"}', "field 'x' is \"1\", not a number, in message 1"),
        ('{"x": [1, 2]}', "field 'x' is an array of 2, not one number, in message 1 (it has x[0..1])"),
        ('{"x": true}', "field 'x' is true in message 1 of 9, a truth value and no number in rad"),
    ],
)
def test_a_field_that_is_no_number_anywhere_is_blamed_on_the_source_file(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match="`field` in the source file") as caught:
        ingested(write_json(tmp_path, [text] * 9), theta="x")
    assert f"topic '/lab': {said}" in str(caught.value)
    assert "damaged" not in str(caught.value)


def test_values_that_are_absent_are_counted_and_said(tmp_path: Path) -> None:
    recording = ingested(write_json(tmp_path, ['{"x": 1.5}', '{"x": null}', "{}"]), theta="x")
    assert recording.samples["theta"].to_list() == [1.5, None, None]
    said = "topic '/lab': field 'x' has no value in 2 of 3 messages, first message 2"
    assert any(said in warning for warning in recording.warnings)


def test_a_counter_that_does_not_count_is_refused_and_not_taken_for_zero(tmp_path: Path) -> None:
    for wrong in ("null", "1.5", "true", "1e300", "9223372036854775808"):
        texts = ['{"x": 1.5, "seq": 7}', f'{{"x": 1.5, "seq": {wrong}}}'] * 2
        with pytest.raises(InputError, match=r"'seq'.* in message 2"):
            ingested(write_json(tmp_path, texts), theta={"field": "x", "counter": "seq"})


SCALARS = {
    "double": -1e300, "float": 0.1, "bool": True, "int32": -(2**31), "int64": -(2**63), "uint32": 2**32 - 1,
    "uint64": 2**64 - 1, "sint32": -(2**31), "sint64": 2**63 - 1, "fixed32": 2**32 - 1, "fixed64": 2**64 - 1,
    "sfixed32": -1, "sfixed64": -(2**63),
}  # fmt: skip
"""Types of numbers, with a value that not all of them can hold."""


def descriptors() -> FileDescriptorSet:
    """`lab.Sample`: each scalar alone, optional and in an array, messages, names, a oneof."""
    file = FileDescriptorProto(name="lab.proto", package="lab", syntax="proto3")
    stamp, sample, entry = (file.message_type.add(name=name) for name in ("Stamp", "Sample", "Note"))

    def add(message: Any, name: str, of: str, **options: Any) -> None:
        kind, options = getattr(FieldDescriptorProto, f"TYPE_{of.upper()}"), {"label": 1, **options}
        message.field.add(name=name, number=len(message.field) + 1, type=kind, **options)

    add(stamp, "seconds", "int64")
    add(stamp, "nanos", "int32")
    add(entry, "text", "string")
    add(sample, "stamp", "message", type_name=".lab.Stamp")
    add(sample, "name", "string", label=3)
    add(sample, "note", "message", type_name=".lab.Note", label=3)
    add(sample, "history", "message", type_name=".lab.Stamp", label=3)
    add(sample, "choice_a", "double", oneof_index=0)
    add(sample, "choice_b", "message", type_name=".lab.Stamp", oneof_index=0)
    sample.oneof_decl.add(name="choice")
    for scalar in SCALARS:
        add(sample, f"one_{scalar}", scalar)
        add(sample, f"packed_{scalar}", scalar, label=3)
        add(sample, f"maybe_{scalar}", scalar, proto3_optional=True, oneof_index=len(sample.oneof_decl))
        sample.oneof_decl.add(name=f"_maybe_{scalar}")
    return FileDescriptorSet(file=[file])


POOL = DescriptorPool()
POOL.Add(descriptors().file[0])
Sample: Any = GetMessageClass(POOL.FindMessageTypeByName("lab.Sample"))


def fields_of(message: Message, prefix: str = "") -> dict[str, float]:
    """Every number of a decoded message, by path; a field that tells whether it is there counts only if it is."""
    found: dict[str, float] = {}
    for item in message.DESCRIPTOR.fields:
        path, value = prefix + item.name, getattr(message, item.name)
        if item.is_repeated:
            for i, one in enumerate(value):
                found |= fields_of(one, f"{path}[{i}].") if item.message_type else {f"{path}[{i}]": one}
        elif not item.has_presence or message.HasField(item.name):
            found |= fields_of(value, f"{path}.") if item.message_type else {path: value}
    return {path: value for path, value in found.items() if isinstance(value, int | float)}


def write_protobuf(folder: Path, payloads: list[bytes], **options: Any) -> Path:
    schema = "lab.Sample", "protobuf", descriptors().SerializeToString()
    return write_payloads(folder / "log.mcap", payloads, "protobuf", *schema, **options)


def test_messages_of_any_shape_equal_googles_decoder(tmp_path: Path) -> None:
    alone = {f"one_{scalar}": value for scalar, value in SCALARS.items()}
    maybe = {f"maybe_{scalar}": value for scalar, value in SCALARS.items()}
    arrays = {f"packed_{scalar}": [value, 0, 1] for scalar, value in SCALARS.items()}
    stamps = {"stamp": {"seconds": 2**40}, "history": [{}, {"nanos": 5}], "choice_a": 2.5}
    contents = [alone | maybe, {}, arrays, stamps, alone | stamps, {"name": ["é"], "note": [{"text": "b"}]}, {}]
    messages = [Sample(**content) for content in contents]
    expected = [fields_of(message) for message in messages]
    path = write_protobuf(tmp_path, [message.SerializeToString() for message in messages], chunk_size=400)
    assert_decoded(path, "/lab", expected)
    assert sum(len(values) for values in expected) >= len(SCALARS) * len(messages)


HEADED = {"source": "header", "field": "stamp"}


def stamped_sample(i: int, **fields: Any) -> bytes:
    return bytes(Sample(stamp={"seconds": 1_700_000_000, "nanos": i * 300_000_000}, **fields).SerializeToString())


def test_a_field_that_is_optional_is_null_where_absent_and_one_that_is_not_is_zero(tmp_path: Path) -> None:
    contents = [{"maybe_double": 0.0}, {}, {"maybe_double": 2.0, "one_double": 5.0}]
    path = write_protobuf(tmp_path, [stamped_sample(i, **content) for i, content in enumerate(contents)])
    read = ingested(path, HEADED, theta="maybe_double", theta_m="one_double").samples
    assert read["theta"].to_list() == [0.0, None, 2.0]
    assert read["theta_m"].to_list() == [0.0, 0.0, 5.0]
    np.testing.assert_allclose(read["time"], [0.0, 0.3, 0.6], rtol=1e-15)


def test_a_message_that_google_refuses_is_left_out_and_reported(tmp_path: Path) -> None:
    payloads = [stamped_sample(i, one_double=1.0) for i in range(3)]
    path = write_protobuf(tmp_path, [payloads[0], payloads[1][:-3], payloads[2]])
    recording = ingested(path, HEADED, 0.5, theta="one_double")
    assert (len(recording.samples), recording.facts["damage"]["messages_lost"]) == (2, 1)
    with pytest.raises(InputError, match="1 of 3 messages of topic '/lab' are lost: a message of"):
        ingested(path, HEADED, theta="one_double")


def test_fields_are_listed_with_their_types_lengths_and_names_and_read_by_these(tmp_path: Path) -> None:
    content = {"name": ["hip", "toe"], "packed_double": [1.0, 2.0], "packed_uint64": [5, 300, 7], "one_sint32": 1}
    path = write_protobuf(tmp_path, [stamped_sample(i, **content) for i in range(3)])
    listed = {"packed_double[name=toe]": "float64[2]", "packed_uint64[0]": "uint64[3]", "one_sint32": "int32"}
    assert listed.items() <= {one.address["field"]: one.type for one in inspect_file(path).channels}.items()
    assert ingested(path, theta="packed_double[name=toe]").samples["theta"].to_list() == [2.0] * 3
