"""CDR: the vectorised decoder agrees bit for bit with the reference decoder, whatever the messages' shapes."""

import struct
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_builder import HEADER, assert_decoded, stamped, write_log
from mcap_ros2.decoder import DecoderFactory

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap import read_mcap
from osl_analysis.formats.message_fields import Columns, MessageType, Reader, message_type, shape_of
from osl_analysis.formats.messages import decode_topics

REAL_DATA = Path(__file__).parents[2] / "shared" / "real_data"
REAL_LOGS = ["rerun_rosbag2_all_sensor_msgs_ros2_cdr.mcap", "rosbag2_cdr_test_0.mcap", "pj_test_empty_channel.mcap"]

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
================================================================================
MSG: lab_msgs/Part
int8 kind
int64[2] counts
string[] tags
================================================================================
MSG: lab_msgs/msg/Nothing
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""
text = st.text("abcé", max_size=6)
finite = st.floats(allow_nan=False, allow_infinity=False)
part = st.fixed_dictionaries(
    {
        "kind": st.integers(-128, 127),
        "counts": st.lists(st.integers(-(2**63), 2**63 - 1), min_size=2, max_size=2),
        "tags": st.lists(text, max_size=2),
    }
)
mixed = st.fixed_dictionaries(
    {
        "flag": st.booleans(),
        "wide": finite,
        "bytes": st.binary(min_size=3, max_size=3),
        "small": st.integers(-(2**15), 2**15 - 1),
        "name": text,
        "series": st.lists(finite, max_size=3),
        "parts": st.lists(part, max_size=2),
        "nothing": st.just({}),
        "last": st.floats(width=32, allow_nan=False),
    }
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
    return {key: v for name in value.__slots__ for key, v in numbers(getattr(value, name), dot + name).items()}


def reference(path: Path) -> dict[str, list[tuple[int, dict[str, float]]]]:
    """Every topic's messages as the reference decoder reads them."""
    topics: dict[str, list[tuple[int, dict[str, float]]]] = {}
    with path.open("rb") as file:
        for _, channel, message, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            topics.setdefault(channel.topic, []).append((message.log_time, numbers(decoded)))
    return topics


def assert_equal_to_reference(path: Path) -> int:
    """Compare every topic, exactly; return how many numbers were compared."""
    compared = 0
    for topic, messages in reference(path).items():
        expected = [values for _, values in messages]
        if any(expected):
            assert assert_decoded(path, topic, expected) == [log_time for log_time, _ in messages]
        compared += sum(map(len, expected))
    return compared


@pytest.mark.parametrize("name", REAL_LOGS)
def test_every_number_of_a_real_log_equals_the_reference_decoders(name: str) -> None:
    path = REAL_DATA / "mcap" / name
    if not path.exists():
        pytest.skip("real data are not here")
    assert assert_equal_to_reference(path) > 50


@settings(max_examples=60, deadline=None)
@given(st.lists(mixed, min_size=1, max_size=8))
def test_messages_of_any_shape_equal_the_reference_decoders(messages: list[dict[str, Any]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        log = [stamped(10**9 + i * 10**6, **fields) for i, fields in enumerate(messages)]
        path = write_log(Path(folder) / "log.mcap", log, MIXED, "lab_msgs/msg/Mixed")
        assert assert_equal_to_reference(path) >= 8 * len(messages)


def kind_of(text: str, name: str = "l/S", *, ros1: bool = False) -> MessageType:
    return message_type(Schema(1, text.encode(), "", name), ros1=ros1)


def read_each(kind: MessageType, paths: Sequence[str], *payloads: bytes) -> Columns:
    reader, lengths = Reader(paths, kind), np.array([len(one) for one in payloads])
    reader.read(b"".join(payloads), np.cumsum(lengths) - lengths, lengths)
    return reader.columns()


@pytest.mark.parametrize(
    ("schema", "payload", "expected"),
    [
        (
            "uint8 a\nfloat64 b\nint16 c\nfloat32 d",
            b"\0\0\0\0" + struct.pack(">B7xdh2xf", 7, -2.5, -300, 0.75),
            [7, -2.5, -300, 0.75],
        ),
        # as rosidl defines them
        ("char a\nint8 b\nbyte c\nuint8 d", b"\0\1\0\0\xc8\xc8\xc8\xc8", [200, -56, 200, 200]),
    ],
)
def test_big_endian_messages_and_characters_are_numbers(schema: str, payload: bytes, expected: list[float]) -> None:
    read = read_each(kind_of(schema), "abcd", payload)
    assert [read.values[path].tolist() for path in "abcd"] == [[one] for one in expected]


def test_a_joint_is_found_by_name_though_the_order_of_joints_changes(tmp_path: Path) -> None:
    schema = "std_msgs/Header header\nstring[] name\nfloat64[] position\n" + HEADER
    orders = [["hip", "toe"], ["toe", "hip"], ["hip", "toe"], ["shank", "toe"], ["hip", "leg"]]
    log = [stamped(i, name=order, position=[10.0 + i, 20.0 + i]) for i, order in enumerate(orders)]
    path = write_log(tmp_path / "log.mcap", log, schema, "sensor_msgs/msg/JointState")
    field = "position[name=toe]"
    decoded = decode_topics(read_mcap(path), {"/lab": [field]})["/lab"]
    assert decoded.values[field].tolist() == [20.0, 11.0, 22.0, 23.0, None]


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
