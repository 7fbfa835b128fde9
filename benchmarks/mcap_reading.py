"""Speed of the MCAP reader relative to the `mcap` packages and to the lower limit of the reading
time.

Run from the repository: `python benchmarks/mcap_reading.py [seconds] [--against FOLDER]`, with the
folder of an earlier release. One run writes a synthetic trial of 140 s (or as many as are asked
for) at 1 kHz in three topics, once in each encoding, to a temporary folder; reads it as ingest
does, as the earlier release did, and with the packages' own readers, to the same columns; and
prints the times' ratios. The limit is the time that every checking reader needs: decompress every
chunk, compute its CRC, copy its bytes twice. Times are those of the processor, on one thread as in
the workflow's jobs: they do not depend on what else is running.
"""

import argparse
import json
import math
import os
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

os.environ["POLARS_MAX_THREADS"] = "1"  # before polars is imported

import numpy as np
import zstandard
from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.decoder import DecoderFactory
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoderFactory
from mcap_ros2.decoder import DecoderFactory as Ros2DecoderFactory

from osl_analysis.ingest.raw_files import read_converted
from osl_analysis.formats import known_formats
from osl_analysis.source_file import Source

RATE = 1000
START = 1_700_000_000 * 10**9
FIELDS = ("position", "velocity", "effort", "current")
COLUMNS = {
    "/leg": ("theta", "theta_m"),
    "/motor": ("current", "theta_command"),
    "/cell": ("torque", "K_1"),
}
ROS2 = """\
std_msgs/Header header
float64 position
float64 velocity
float64 effort
float32 current
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""

REPEATS = 5
EARLIER = """
import sys, time
from pathlib import Path
source, times = known_formats()["mcap"].source.model_validate_json(sys.argv[2]), []
for _ in range(int(sys.argv[3])):
    start = time.process_time()
    read_converted(Path(sys.argv[1]), source)
    times.append(time.process_time() - start)
print(min(times))
"""

Row = tuple[int, int, float, float, float, float]


def rows(seconds: int) -> Iterator[Row]:
    """Stamp and values, quantised as a sensor's are."""
    for i in range(seconds * RATE):
        stamp = START + i * 10**9 // RATE + (i * 7919) % 50_000
        wave = [round(math.sin(i * w), 5) for w in (0.003, 0.011, 0.017, 0.029)]
        yield (*divmod(stamp, 10**9), *wave)


def cdr(row: Row) -> bytes:
    sec, nanosec, *values = row
    return struct.pack("<4siII4sdddf", b"\0\1\0\0", sec, nanosec, 4, b"leg\0", *values)


def as_json(row: Row) -> bytes:
    stamp = {"sec": row[0], "nanosec": row[1]}
    fields = dict(zip(FIELDS, row[2:], strict=True))
    return json.dumps({"header": {"stamp": stamp, "frame_id": "leg"}, **fields}).encode()


def descriptors() -> FileDescriptorSet:
    """`lab.Sample`, with the header that the ROS 2 message has."""
    kinds = FieldDescriptorProto
    file = FileDescriptorProto(name="lab.proto", package="lab", syntax="proto3")
    messages: dict[str, list[tuple[str, int, str]]] = {
        "Time": [("sec", kinds.TYPE_INT32, ""), ("nanosec", kinds.TYPE_UINT32, "")],
        "Header": [("stamp", kinds.TYPE_MESSAGE, ".lab.Time"), ("frame_id", kinds.TYPE_STRING, "")],
        "Sample": [
            ("header", kinds.TYPE_MESSAGE, ".lab.Header"),
            *((name, kinds.TYPE_DOUBLE, "") for name in FIELDS[:3]),
            (FIELDS[3], kinds.TYPE_FLOAT, ""),
        ],
    }
    for name, fields in messages.items():
        message = file.message_type.add(name=name)
        for number, (field, kind, type_name) in enumerate(fields, 1):
            message.field.add(
                name=field, number=number, type=kind, type_name=type_name or None, label=1
            )
    return FileDescriptorSet(file=[file])


def protobuf() -> Callable[[Row], bytes]:
    pool = DescriptorPool()
    pool.Add(descriptors().file[0])
    sample = GetMessageClass(pool.FindMessageTypeByName("lab.Sample"))

    def encode(row: Row) -> bytes:
        message = sample(**dict(zip(FIELDS, row[2:], strict=True)))
        message.header.frame_id = "leg"
        message.header.stamp.sec, message.header.stamp.nanosec = row[:2]
        return message.SerializeToString()

    return encode


def write(
    path: Path,
    encoding: str,
    schema: tuple[str, str, bytes],
    encode: Callable[[Row], bytes],
    n: int,
) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        number = writer.register_schema(*schema)
        channels = [writer.register_channel(topic, encoding, number) for topic in COLUMNS]
        for i, row in enumerate(rows(n)):
            stamp = row[0] * 10**9 + row[1]
            for k, channel in enumerate(channels):
                # topics do not hold the same numbers
                own: Row = (*row[:2], *row[2 + k :], *row[2 : 2 + k])
                writer.add_message(channel, stamp + 150_000, encode(own), stamp, i)
        writer.finish()


def source() -> Source:
    channels = {
        column: {"topic": topic, "field": field, "unit": UNITS[column]}
        for topic, columns in COLUMNS.items()
        for column, field in zip(columns, FIELDS, strict=False)
    }
    return known_formats()["mcap"].source.model_validate(
        {"format": "mcap", "time": {"source": "header"}, "channels": channels}
    )


UNITS = {
    "theta": "rad",
    "theta_m": "rad",
    "current": "A",
    "theta_command": "rad",
    "torque": "N*m",
    "K_1": "N*m/rad",
}


class JsonDecoderFactory(DecoderFactory):
    """JSON as the `mcap` documentation decodes it."""

    def decoder_for(self, message_encoding: str, schema: Any) -> Any:
        return json.loads


def by_mcap(path: Path, factory: DecoderFactory) -> dict[str, np.ndarray[Any, Any]]:
    """The same columns, through `mcap` and its decoders."""
    columns: dict[str, list[tuple[float, ...]]] = defaultdict(list)
    with path.open("rb") as file:
        for _, channel, _, message in make_reader(
            file, decoder_factories=[factory]
        ).iter_decoded_messages():
            if isinstance(message, dict):
                stamp = message["header"]["stamp"]
                value = (stamp["sec"], stamp["nanosec"], message[FIELDS[0]], message[FIELDS[1]])
            else:
                stamp = message.header.stamp
                value = (stamp.sec, stamp.nanosec, message.position, message.velocity)
            columns[channel.topic].append(value)
    return {topic: np.array(values) for topic, values in columns.items()}


def limit(path: Path) -> None:
    """Decompress, check, copy, copy."""
    data, position = path.read_bytes(), 8
    while position + 9 < len(data):
        opcode, length = struct.unpack_from("<BQ", data, position)
        if opcode == Opcode.CHUNK:
            size, crc = struct.unpack_from("<QI", data, position + 9 + 16)
            body = data[position + 9 + 16 + 12 + 4 + len("zstd") + 8 : position + 9 + length]
            content = zstandard.ZstdDecompressor().decompress(body, size)
            if zlib.crc32(content) != crc:
                raise ValueError("the benchmark's own file is damaged")
            bytearray(bytearray(content))
        position += 9 + length


def seconds_of(run: Callable[[], Any], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times)


def seconds_of_earlier(folder: Path, path: Path) -> float:
    """Time [s] of the processor in which an earlier release reads a file."""
    code = [
        sys.executable,
        "-c",
        EARLIER,
        str(path),
        source().model_dump_json(exclude_unset=True),
        str(REPEATS),
    ]
    environment = os.environ | {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    return float(
        subprocess.run(
            code, cwd=folder, env=environment, capture_output=True, text=True, check=True
        ).stdout
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("seconds", type=int, nargs="?", default=140)
    parser.add_argument("--against", type=Path, metavar="FOLDER")
    asked = parser.parse_args()
    duration = asked.seconds
    encodings = {
        "cdr": (("lab_msgs/msg/Sample", "ros2msg", ROS2.encode()), cdr, Ros2DecoderFactory()),
        "protobuf": (
            ("lab.Sample", "protobuf", descriptors().SerializeToString()),
            protobuf(),
            ProtobufDecoderFactory(),
        ),
        "json": (("Sample", "jsonschema", b"{}"), as_json, JsonDecoderFactory()),
    }
    print(f"{duration} s at {RATE} Hz in {len(COLUMNS)} topics, {3 * duration * RATE} messages")
    with tempfile.TemporaryDirectory() as folder:
        for encoding, (schema, encode, factory) in encodings.items():
            path = Path(folder) / f"{encoding}.mcap"
            write(path, encoding, schema, encode, duration)
            ours = seconds_of(lambda path=path: read_converted(path, source()), REPEATS)
            theirs = seconds_of(lambda path=path, factory=factory: by_mcap(path, factory), 1)
            floor = seconds_of(lambda path=path: limit(path), REPEATS)
            before = (
                "" if asked.against is None else seconds_of_earlier(asked.against.resolve(), path)
            )
            print(
                f"{encoding:9} {ours:.3f} s, the mcap packages {theirs:.2f} s: {theirs / ours:.2g}"
                f" x as fast; {ours / floor:.2f} x the limit of {floor:.3f} s"
                + (
                    f"; the earlier release {before:.3f} s: {before / ours:.2f} x as fast"
                    if before
                    else ""
                )
            )


if __name__ == "__main__":
    main()
