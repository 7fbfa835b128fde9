# SPDX-License-Identifier: Apache-2.0
"""Cost of reading recordings: processor seconds, and the largest memory.

Run from the repository: `python benchmarks/reading.py [--campaign FOLDER] [--against FOLDER]`. The
campaign is a folder with recordings and their trials.csv (`raw_data/default` after `osl-analysis
simulate`), the other folder is that of an earlier release, whose costs stand beside ours as ratios.

Each task runs in a process of its own, on one thread as in the workflow's jobs, three times in turn
with the earlier release: the least counts. Printed are

* all recordings of the campaign, as canonical columns;
* one log of messages in each encoding, beside the `mcap` packages and the lower limit of the
  reading time: every checking reader decompresses each chunk, computes its checksum, and copies its
  bytes twice;
* what a CSV of a million rows holds;
* an hour at 1 kHz in MCAP and in CSV.

With an earlier release, the numbers of every recording of the campaign are compared too, column by
column and bit by bit, and with `--files FOLDER` those of every file of other laboratories: as many
channels as both list under one name, by the numbers that `inspect` shows.
"""

import argparse
import csv
import hashlib
import json
import math
import os
import resource
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

os.environ["POLARS_MAX_THREADS"] = "1"  # before polars is imported

import zstandard
from mcap.decoder import DecoderFactory
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import Writer

RATE_HZ = 1000
TRIAL_S = 94  # of a log of three topics: 282,000 messages
HOUR_S = 3600
MILLION = 1_000_000  # rows
START_S = 1_700_000_000
REPEATS = 3  # of a short task in its process
ROUNDS = 3
FIELDS = ("position", "velocity", "effort", "current")
TOPICS = {"/leg": "theta", "/motor": "current", "/cell": "torque"}
UNITS = {"theta": "rad", "current": "A", "torque": "N*m"}
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
Row = tuple[int, int, float, float, float, float]


# --- files --------------------------------------------------------------------------------------


def rows(seconds: int) -> Iterator[Row]:
    """Stamp [s, ns] and values, quantised as a sensor's are."""
    for i in range(seconds * RATE_HZ):
        jitter_ns = (i * 7919) % 50_000
        stamp_ns = START_S * 10**9 + i * 10**9 // RATE_HZ + jitter_ns
        wave = [round(math.sin(i * w), 5) for w in (0.003, 0.011, 0.017, 0.029)]
        yield (*divmod(stamp_ns, 10**9), *wave)


def as_cdr(row: Row) -> bytes:
    seconds, nanoseconds, *values = row
    return struct.pack("<4siII4sdddf", b"\0\1\0\0", seconds, nanoseconds, 4, b"leg\0", *values)


def as_json(row: Row) -> bytes:
    stamp = {"sec": row[0], "nanosec": row[1]}
    fields = dict(zip(FIELDS, row[2:], strict=True))
    return json.dumps({"header": {"stamp": stamp, "frame_id": "leg"}, **fields}).encode()


def write_mcap(
    path: Path,
    encoding: str,
    schema: tuple[str, str, bytes],
    encode: Callable[[Row], bytes],
    seconds: int,
) -> Path:
    """A log of three topics at 1 kHz."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        number = writer.register_schema(*schema)
        channels = [writer.register_channel(topic, encoding, number) for topic in TOPICS]
        for i, row in enumerate(rows(seconds)):
            stamp_ns = row[0] * 10**9 + row[1]
            for k, channel in enumerate(channels):
                # topics do not hold the same numbers
                own: Row = (*row[:2], *row[2 + k :], *row[2 : 2 + k])
                writer.add_message(channel, stamp_ns + 150_000, encode(own), stamp_ns, i)
        writer.finish()
    return path


def write_csv(path: Path, count: int) -> Path:
    """A table of time, angle and torque."""
    with path.open("w") as file:
        file.write("Time [s],Ankle angle [deg],Torque [Nm]\n")
        for i in range(count):
            angle = 5 * math.sin(0.011 * i)
            torque = 30 * math.sin(0.011 * i + 0.3)
            file.write(f"{i / RATE_HZ:.3f},{angle:.6f},{torque:.6f}\n")
    return path


def write_source(path: Path, content: dict[str, Any]) -> Path:
    path.write_text(json.dumps(content))  # JSON is YAML
    return path


MCAP_SOURCE = {
    "format": "mcap",
    "time": {"source": "header"},
    "channels": {
        column: {"topic": topic, "field": "position", "unit": UNITS[column]}
        for topic, column in TOPICS.items()
    },
}
CSV_SOURCE = {
    "format": "csv",
    "time": {"column": "Time"},
    "channels": {
        "theta": {"column": "Ankle angle", "unit": "deg"},
        "torque": {"column": "Torque", "unit": "Nm"},
    },
}


# --- tasks, each in a process of its own --------------------------------------------------------


def reader() -> Callable[[Path, Path], Any]:
    """What reads a file by its source file, in this release or in 0.4.0."""
    from osl_analysis.ingest import raw_files

    if hasattr(raw_files, "read_converted"):
        return lambda path, source: raw_files.read_converted(path, raw_files.read_source(source))

    def read_as_before(path: Path, source: Path) -> Any:
        described = raw_files.read_source(source)
        return raw_files.FORMATS[described.format].read(path, described)

    return read_as_before


def seconds_of(run: Callable[[], Any], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times)


def read_file(path: Path, source: Path, repeats: int) -> float:
    read = reader()
    return seconds_of(lambda: read(path, source), repeats)


def read_campaign(raw: Path, sources: Path) -> float:
    read = reader()
    files = files_of_campaign(raw, sources)
    read(*files[0])  # imports
    return seconds_of(lambda: [read(*file) for file in files], repeats=2)


def inspect(path: Path, small: Path) -> float:
    from osl_analysis.commands.trials import inspect_file

    inspect_file(small)  # imports
    return seconds_of(lambda: inspect_file(path), REPEATS)


def files_of_campaign(raw: Path, sources: Path) -> list[tuple[Path, Path]]:
    """Each recording of a campaign with its source file."""
    files: list[tuple[Path, Path]] = []
    with (raw / "trials.csv").open() as table:
        for row in csv.DictReader(table):
            for role in ("log", "mocap"):
                if row.get(role):
                    source = sources / f"{row[f'{role}_source']}.yaml"
                    files.append((raw / row[role], source))
    return files


def digest(values: Any) -> str:
    """What tells numbers apart bit by bit."""
    import numpy as np

    return hashlib.sha256(np.asarray(values, np.float64).tobytes()).hexdigest()


def digests_of_campaign(raw: Path, sources: Path) -> dict[str, str]:
    """By recording and column a digest of its samples; null is told from NaN."""
    read = reader()
    digests: dict[str, str] = {}
    for path, source in files_of_campaign(raw, sources):
        samples = read(path, source).samples
        for column in samples.columns:
            missing = samples[column].is_null().to_numpy()
            values = samples[column].fill_null(0).to_numpy()
            name = f"{path.relative_to(raw)} {source.stem} {column}"
            digests[name] = digest(values) + digest(missing)
    return digests


def digests_of_files(folder: Path) -> dict[str, str]:
    """By file and channel a digest of the numbers that `inspect` shows."""
    from osl_analysis.commands.trials import inspect_file

    digests: dict[str, str] = {}
    for path in sorted(folder.rglob("*")):
        try:
            channels = inspect_file(path).channels
        except (ValueError, OSError):  # no recording
            continue
        for number, channel in enumerate(channels):
            if channel.numbers is not None and channel.kind != "plate":
                name = f"{path.relative_to(folder)} {number} {' '.join(channel.address.values())}"
                digests[name] = digest(channel.numbers)
    return digests


def run_task(name: str, *given: str) -> None:
    """Run a task in this process, and print its seconds and the largest memory [MB], or the digests
    of what it reads."""
    if name == "equal":
        folder = Path(given[0])
        of_campaign = len(given) > 1
        digests = (
            digests_of_campaign(folder, Path(given[1])) if of_campaign else digests_of_files(folder)
        )
        print(json.dumps(digests))
        return
    if name == "campaign":
        seconds = read_campaign(Path(given[0]), Path(given[1]))
    elif name == "inspect":
        seconds = inspect(Path(given[0]), Path(given[1]))
    else:
        seconds = read_file(Path(given[0]), Path(given[1]), int(given[2]))
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
    print(json.dumps([seconds, memory_mb]))


def printed_by(folder: Path | None, *task: object) -> Any:
    """What a task prints by the package in a folder, or else by this one."""
    environment = dict(os.environ)
    if folder is not None:
        environment["PYTHONPATH"] = str(folder.resolve())
    code = [sys.executable, __file__, "--task", *map(str, task)]
    process = subprocess.run(code, env=environment, capture_output=True, text=True, check=True)
    return json.loads(process.stdout.splitlines()[-1])


def measured(folder: Path | None, *task: object) -> tuple[float, float]:
    """Seconds and memory [MB] of a task by the package in a folder, or else by this one."""
    seconds, memory_mb = printed_by(folder, *task)
    return seconds, memory_mb


def show_equality(title: str, against: Path, *task: object) -> None:
    """Print how many columns both releases read to the same bits, and name those that differ."""
    ours = printed_by(None, "equal", *task)
    theirs = printed_by(against, "equal", *task)
    shared = ours.keys() & theirs.keys()
    differing = sorted(name for name in shared if ours[name] != theirs[name])
    print(
        f"{title}: {len(shared) - len(differing)} of {len(shared)} equal bit by bit;"
        f" {len(ours) - len(shared)} listed by this release alone,"
        f" {len(theirs) - len(shared)} by the earlier one",
        *(f"\n    differs: {name}" for name in differing[:20]),
        flush=True,
    )


def show(title: str, against: Path | None, *task: object, limits: str = "") -> float:
    """Print the costs of a task, and the ratio to those of an earlier release."""
    releases = [None] if against is None else [None, against]
    rounds = [[measured(release, *task) for release in releases] for _ in range(ROUNDS)]
    (seconds, memory_mb), *earlier = [min(of_release) for of_release in zip(*rounds, strict=True)]
    line = f"{title:34} {seconds:7.3f} s  {memory_mb:6.0f} MB"
    for before, memory_before_mb in earlier:
        line += f"   earlier {before:7.3f} s  {memory_before_mb:6.0f} MB  ratio"
        line += f" {seconds / before:.2f}, {memory_mb / memory_before_mb:.2f}"
    print(line + limits, flush=True)
    return seconds


# --- other readers ------------------------------------------------------------------------------


class JsonDecoderFactory(DecoderFactory):
    """JSON as the `mcap` documentation decodes it."""

    def decoder_for(self, message_encoding: str, schema: Any) -> Any:
        return json.loads


def read_by_mcap(path: Path, factory: DecoderFactory) -> None:
    """The same columns, through `mcap` and its decoders."""
    columns: dict[str, list[tuple[float, ...]]] = {topic: [] for topic in TOPICS}
    with path.open("rb") as file:
        log = make_reader(file, decoder_factories=[factory])
        for _, channel, _, message in log.iter_decoded_messages():
            if isinstance(message, dict):
                stamp = message["header"]["stamp"]
                values = (stamp["sec"], stamp["nanosec"], message["position"])
            else:
                stamp = message.header.stamp
                values = (stamp.sec, stamp.nanosec, message.position)
            columns[channel.topic].append(values)


def read_at_least(path: Path) -> None:
    """What every checking reader does: decompress, check, copy, copy."""
    data = path.read_bytes()
    position = 8
    while position + 9 < len(data):
        opcode, length = struct.unpack_from("<BQ", data, position)
        if opcode == Opcode.CHUNK:
            size, checksum = struct.unpack_from("<QI", data, position + 9 + 16)
            begin = position + 9 + 16 + 12 + 4 + len("zstd") + 8
            packed = data[begin : position + 9 + length]
            content = zstandard.ZstdDecompressor().decompress(packed, size)
            if zlib.crc32(content) != checksum:
                raise ValueError("the benchmark's own file is damaged")
            bytearray(bytearray(content))
        position += 9 + length


def show_messages(folder: Path, against: Path | None) -> None:
    """Costs of one log in each encoding, beside those of the `mcap` packages."""
    from mcap_ros2.decoder import DecoderFactory as Ros2DecoderFactory

    source = write_source(folder / "mcap.yaml", MCAP_SOURCE)
    count = len(TOPICS) * TRIAL_S * RATE_HZ
    encodings = {
        "cdr": (("lab_msgs/msg/Sample", "ros2msg", ROS2.encode()), as_cdr, Ros2DecoderFactory()),
        "json": (("Sample", "jsonschema", b"{}"), as_json, JsonDecoderFactory()),
    }
    for encoding, (schema, encode, factory) in encodings.items():
        path = write_mcap(folder / f"{encoding}.mcap", encoding, schema, encode, TRIAL_S)
        seconds = show(f"{count} messages, {encoding}", against, "file", path, source, REPEATS)
        by_mcap = seconds_of(lambda: read_by_mcap(path, factory), 1)  # noqa: B023
        least = seconds_of(lambda: read_at_least(path), REPEATS)  # noqa: B023
        print(
            f"    the mcap packages {by_mcap:.2f} s: {by_mcap / seconds:.2g} x as fast;"
            f" {seconds / least:.1f} x the limit of {least:.3f} s"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--campaign", type=Path, metavar="FOLDER")
    parser.add_argument("--sources", type=Path, metavar="FOLDER", default=Path("config/sources"))
    parser.add_argument("--against", type=Path, metavar="FOLDER")
    parser.add_argument("--files", type=Path, metavar="FOLDER")
    parser.add_argument("--task", nargs="+", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.task:
        run_task(*asked.task)
        return
    if asked.campaign is not None:
        sources = asked.sources.resolve()
        show("all recordings of the campaign", asked.against, "campaign", asked.campaign, sources)
        if asked.against is not None:
            show_equality("columns of the campaign", asked.against, asked.campaign, sources)
    if asked.files is not None and asked.against is not None:
        show_equality("channels of other files", asked.against, asked.files)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        show_messages(folder, asked.against)
        source = write_source(folder / "csv.yaml", CSV_SOURCE)
        small = write_csv(folder / "small.csv", 1000)
        million = write_csv(folder / "million.csv", MILLION)
        show("inspect of a million rows of CSV", asked.against, "inspect", million, small)
        hour = write_csv(folder / "hour.csv", HOUR_S * RATE_HZ)
        show("an hour at 1 kHz in CSV", asked.against, "file", hour, source, 1)
        hour.unlink()
        schema = ("lab_msgs/msg/Sample", "ros2msg", ROS2.encode())
        hour = write_mcap(folder / "hour.mcap", "cdr", schema, as_cdr, HOUR_S)
        source = write_source(folder / "mcap.yaml", MCAP_SOURCE)
        show("an hour at 1 kHz in MCAP", asked.against, "file", hour, source, 1)


if __name__ == "__main__":
    main()
