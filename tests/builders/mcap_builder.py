# SPDX-License-Identifier: Apache-2.0
"""Small ROS 2 logs in MCAP, encoded by mcap_ros2's own writer, independent of the decoder under
test."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer
from mcap_ros2._dynamic import serialize_dynamic

from osl_analysis.base.source_file import MessageSource

HEADER = """\
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
SAMPLE = "std_msgs/Header header\nfloat32 angle\nfloat64 torque\nbool sync\n" + HEADER
SAMPLE_NAME = "lab_msgs/msg/Sample"
Messages = Iterable[tuple[int, dict[str, Any]]]


def stamped(nanoseconds: int, **fields: Any) -> tuple[int, dict[str, Any]]:
    """A message with a header stamp, logged 1 ms after it."""
    stamp = {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}
    return nanoseconds + 1_000_000, {"header": {"stamp": stamp, "frame_id": "lab"}, **fields}


def message_source(
    *fields: str, kind: str = "mcap", topic: str = "/lab", time: str = "log"
) -> MessageSource:
    """A source file that asks for fields of a topic of a log or bag."""
    channels = {
        f"signal_{number}": {"topic": topic, "field": field, "unit": "1"}
        for number, field in enumerate(fields)
    }
    return MessageSource.model_validate(
        {"format": kind, "time": {"source": time}, "channels": channels}
    )


def write_payloads(
    path: Path, payloads: Iterable[bytes], encoding: str, *schema: Any, **options: Any
) -> Path:
    """The topic `/lab` of encoded messages, one per millisecond; `schema` is its name, encoding and
    bytes, if any."""
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start()
        channel = writer.register_channel(
            "/lab", encoding, writer.register_schema(*schema) if schema else 0
        )
        for i, payload in enumerate(payloads):
            writer.add_message(channel, i * 1_000_000, payload, i * 1_000_000, i)
        writer.finish()
    return path


def write_log(
    path: Path,
    messages: Messages,
    schema: str = SAMPLE,
    name: str = SAMPLE_NAME,
    topic: str = "/lab",
    **options: Any,
) -> Path:
    """One topic; messages are (log time [ns], fields), in file order."""
    return write_topics(path, {topic: (name, schema, messages)}, **options)


def write_topics(
    path: Path,
    topics: dict[str, tuple[str, str, Messages]],
    **options: Any,
) -> Path:
    """Topics one after the other."""
    with path.open("wb") as file:
        writer = Writer(file, **{"compression": CompressionType.ZSTD, **options})
        writer.start(profile="ros2")
        for topic, (name, schema, messages) in topics.items():
            encode = serialize_dynamic(name, schema)[name]
            number = writer.register_schema(name, "ros2msg", schema.encode())
            channel = writer.register_channel(topic, "cdr", number)
            for row, (log_time, fields) in enumerate(messages):
                writer.add_message(
                    channel,
                    log_time,
                    encode(fields),
                    log_time,
                    row,
                )
        writer.finish()
    return path
