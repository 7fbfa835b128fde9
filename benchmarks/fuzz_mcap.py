"""Read many damaged logs: the reader must not crash, hang, use unbounded memory or return a value that was not written.

Run from the repository: `python benchmarks/fuzz_mcap.py [minutes] [seed]`, 1 minute and seed 0 unless told. The suite
runs 150 such files in `tests/test_formats_mcap.py`; run this after every change to the reader, for an hour
before a release. Each file is a valid log (CDR, protobuf or JSON; zstd, lz4 or no compression; with and without
chunks, index and checksums) that is then damaged in up to eight places: flipped, overwritten, cut out, inserted,
repeated, swapped, truncated, with absurd lengths where lengths stand.

The run ends if the reader raises another error than `InputError`, or takes more than 5 s or 100 MB for a file of some
kB. The file is then kept as `fuzz_failure.mcap`. If a checksum covers the messages, every value that was read is
compared with the written one. Without a checksum a flipped bit cannot be detected; the report says so (`crc`: absent).
"""

import json
import random
import resource
import struct
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from mcap.writer import CompressionType, IndexType, Writer

from osl_analysis.errors import InputError
from osl_analysis.ingest.raw_files import FORMATS

MESSAGES = 60
LONGEST = 5.0
MOST_MEMORY = 100 << 20
FAILURE = Path("fuzz_failure.mcap")
SOURCE = FORMATS["mcap"].source.model_validate(
    {
        "format": "mcap",
        "time": {"source": "log"},
        "largest_loss": 1.0,
        "channels": {"theta": {"topic": "/lab", "field": "angle", "unit": "rad"}},
    }
)


def descriptor() -> bytes:
    file = FileDescriptorProto(name="lab.proto", package="lab", syntax="proto3")
    message = file.message_type.add(name="Sample")
    message.field.add(name="frame", number=1, type=9, label=1)
    message.field.add(name="count", number=2, type=5, label=1)
    message.field.add(name="angle", number=3, type=1, label=1)
    return FileDescriptorSet(file=[file]).SerializeToString()


SCHEMAS = {
    "cdr": ("lab/msg/Sample", "ros2msg", b"string frame\nint32 count\nfloat64 angle"),
    "protobuf": ("lab.Sample", "protobuf", descriptor()),
    "json": ("Sample", "jsonschema", b"{}"),
}


def payload(encoding: str, i: int) -> bytes:
    """Message i, of which the angle is 1 + i."""
    if encoding == "cdr":
        return struct.pack("<4sI4sid", b"\0\1\0\0", 4, b"leg\0", i, 1.0 + i)
    if encoding == "protobuf":
        return b"\x0a\x03leg\x10" + bytes([i]) + b"\x19" + struct.pack("<d", 1.0 + i)
    return json.dumps({"frame": "leg", "count": i, "angle": 1.0 + i}).encode()


def written(path: Path, dice: random.Random) -> bool:
    """Write a valid log; whether a checksum covers all of its messages."""
    encoding = dice.choice(list(SCHEMAS))
    chunked, checked = dice.random() < 0.85, dice.random() < 0.7
    with path.open("wb") as file:
        writer = Writer(
            file,
            chunk_size=dice.choice([200, 800, 10_000]),
            compression=dice.choice(list(CompressionType)),
            index_types=dice.choice([IndexType.ALL, IndexType.ALL, IndexType.NONE]),
            use_chunking=chunked,
            enable_crcs=checked,
            enable_data_crcs=dice.random() < 0.3,
            use_statistics=dice.random() < 0.7,
            repeat_channels=dice.random() < 0.7,
        )
        writer.start()
        channel = writer.register_channel("/lab", encoding, writer.register_schema(*SCHEMAS[encoding]))
        for i in range(MESSAGES):
            writer.add_message(channel, i * 1_000_000, payload(encoding, i), i * 1_000_000, i)
        writer.finish()
    return chunked and checked


def damaged(content: bytes, dice: random.Random) -> bytes:
    """The content with one more damage."""
    at, size = dice.randrange(len(content) + 1), dice.choice([1, 1, 2, 8, 9, 40, 300])
    other = dice.randrange(len(content) + 1)
    absurd = struct.pack("<Q", dice.choice([0, 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1, len(content)]))
    kind = dice.choice(["flip", "flip", "flip", "write", "cut", "insert", "repeat", "swap", "truncate", "length"])
    if kind == "flip" and at < len(content):
        return content[:at] + bytes([content[at] ^ (1 << dice.randrange(8))]) + content[at + 1 :]
    if kind == "write":
        return content[:at] + dice.randbytes(size) + content[at + size :]
    if kind == "cut":
        return content[:at] + content[at + size :]
    if kind == "insert":
        return content[:at] + dice.randbytes(size) + content[at:]
    if kind == "repeat":
        return content[:at] + content[other : other + size] + content[at:]
    if kind == "swap":
        return content[:at] + content[other : other + size] + content[at + size :]
    if kind == "length":
        return content[:at] + absurd + content[at + 8 :]
    return content[:at]


def check(path: Path, covered: bool) -> str:
    """Read one file; how it went."""
    start = time.perf_counter()
    try:
        recording = FORMATS["mcap"].read(path, SOURCE)
    except InputError as error:
        if "\n" in str(error):
            raise ValueError("an error of more than one line") from error
        return "refused"
    finally:
        if time.perf_counter() - start > LONGEST:
            raise TimeoutError(f"{time.perf_counter() - start:.1f} s")
    damage = recording.losses
    stamps = recording.samples["time"].to_numpy() + recording.facts["time"]["start_ns"] / 1e9
    right = np.array_equal(recording.samples["theta"], 1 + np.rint(stamps * 1000))
    if covered and damage["crc"] == "checked" and not right:
        raise ValueError("a value that was not written")
    whole = len(recording.samples) == MESSAGES
    if not whole and damage["crc"] == "checked" and damage["complete"]:
        raise ValueError("messages are missing from a log that is said to be complete")
    return "whole" if whole else "in part"


def main() -> None:
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    dice, end, counts = random.Random(seed), time.monotonic() + 60 * minutes, Counter[str]()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        while time.monotonic() < end:
            covered = written(path, dice)
            content = path.read_bytes()
            for _ in range(dice.randint(1, 8)):
                content = damaged(content, dice)
            path.write_bytes(content)
            try:
                counts[check(path, covered)] += 1
                if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before > MOST_MEMORY >> 10:
                    raise MemoryError("more memory than a small multiple of the file")
            except BaseException:
                FAILURE.write_bytes(content)
                print(f"failed after {counts.total()} files; the file is {FAILURE}")
                raise
    print(f"{counts.total()} damaged files, seed {seed}: {', '.join(f'{n} {how}' for how, n in counts.items())}")


if __name__ == "__main__":
    main()
