"""The effects of recorders on true signals: sampling instants, sensors and stamps. With all effects
off, samples are at the even instants of the simulation.

The file is MCAP like those of laboratories: ROS 2 messages in CDR, zstd chunks with CRCs. All
messages are known beforehand, so it is made chunk by chunk. It equals the file that
`mcap.writer.Writer` writes."""

import json
import struct
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import polars as pl
import scipy
import zstandard
from mcap import records as mcap_records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC
from numpy.typing import ArrayLike, NDArray

from osl_analysis.files import atomic_path, write_text
from osl_analysis.simulator.settings import NodeSettings, Scatter, SimulationSettings, stream
from osl_analysis.trial import Array

SENSORS = {
    "joint_angle": ("", "joint_encoder"),
    "commanded_angle": ("", "joint_encoder"),
    "actuator_angle": ("", "actuator_encoder"),
    "motor_current": ("current_noise", "current_quantisation"),
    **dict.fromkeys(
        ("load_cell_torque", "output_torque"), ("load_cell_noise", "load_cell_quantisation")
    ),
}
"""Effects with the white noise and with the resolution of each channel."""
TrueSignal = Array | Callable[[Array], Array]
"""A true signal: (n,) at the even instants of the simulation; or, for a signal that jumps, as
friction does, a function of instants [s], because a curve through its samples would be wrong in
between."""


def recording_of(
    trial: str, signals: Mapping[str, TrueSignal], settings: SimulationSettings
) -> tuple[dict[str, Array], dict[str, float]]:
    """What the nodes of a bench write of true signals by channel, (n,) each, with its stamps [s]:
    `time`, and `torque_time` of the torque, which equals it if one node records all. And the errors
    that were drawn for this trial: clock start [s], load-cell offset [N*m] and drift [N*m/min], and
    the joint encoder's zero [rad] if enabled."""
    effects, seed, recorder = settings.effects, settings.seed, settings.recorder
    drawn = {"clock_start_s": float(stream(seed, trial, "clock_start").integers(20, 2000))}
    for name, effect in (
        ("load_cell_offset", effects.load_cell_offset),
        ("load_cell_drift", effects.load_cell_drift),
    ):
        drawn[name] = effect.value * stream(seed, trial, name).standard_normal()
    if effects.encoder_zero.enabled:
        zero = effects.encoder_zero.value * effects.joint_encoder.value
        drawn["encoder_zero"] = float(zero * stream(seed, trial, "encoder_zero").uniform(-1, 1))
    bench = Bench(
        trial, settings, drawn, next(len(one) for one in signals.values() if not callable(one))
    )
    if recorder.torque_node is None:
        log = bench.recording("node", recorder.node, signals)
        return log | {"torque_time": log["time"]}, drawn
    torque = {name: true for name, true in signals.items() if name.endswith("torque")}
    others = {name: true for name, true in signals.items() if name not in torque}
    late = bench.recording("torque_node", recorder.torque_node, torque)
    return (
        bench.recording("node", recorder.node, others)
        | {
            "torque_time": late.pop("time"),
            **late,
        },
        drawn,
    )


@dataclass(frozen=True)
class Bench:
    """One trial on a bench, with the errors that it keeps."""

    trial: str
    settings: SimulationSettings
    drawn: Mapping[str, float]
    samples: int  # instants of the simulation

    def random(self, name: str) -> np.random.Generator:
        return stream(self.settings.seed, self.trial, name)

    def recording(
        self, name: str, node: NodeSettings, signals: Mapping[str, TrueSignal]
    ) -> dict[str, Array]:
        """The stamps [s], as `time`, and the channels, (n,) each, that one node writes."""
        instants, even, stamps = self.sampling(name, node)
        rows: NDArray[np.bool_] | slice = slice(None)
        n, time = len(instants), self.drawn["clock_start_s"] + stamps
        # in slots that leave a sample between two gaps; the first and the last one stay
        if node.dropped.enabled:
            rows = np.ones(n, dtype=np.bool_)
            slots = self.random(f"{name}.dropped").permutation((n - 2) // 2)[
                : max(round(node.dropped.size * n), 1)
            ]
            rows[1 + 2 * slots] = False
        if node.decimals.enabled:
            time = np.round(time, int(node.decimals.size))
        read, late = dict[str, Array](), self.settings.effects.load_cell_delay.value
        # one curve through all channels that are sampled together
        for delay in (0.0, late) if late else (0.0,):
            own = {
                name: true
                for name, true in signals.items()
                if delay == late * name.endswith("torque")
            }
            exact, at = (
                {n: one for n, one in own.items() if not callable(one)},
                np.maximum(instants - delay, 0.0),
            )
            if exact and (delay or not even):
                simulated = np.arange(self.samples) / self.settings.dynamometer.rate_hz
                curves = scipy.interpolate.CubicSpline(
                    simulated, np.array([*exact.values()]), axis=1
                )
                exact = dict(zip(exact, curves(at), strict=True))
            for name, true in own.items():
                read[name] = self.reading(
                    name, true(at) if callable(true) else exact[name], instants
                )[rows]
        return {"time": time[rows], **{name: read[name] for name in signals}}

    def sampling(self, name: str, node: NodeSettings) -> tuple[Array, bool, Array]:
        """When a node samples [s], whether at instants of the simulation, and what its clock says
        of them [s]."""
        simulated_hz = self.settings.dynamometer.rate_hz
        duration, rate = self.samples / simulated_hz, node.rate.value or simulated_hz
        instants, scatters = (
            np.arange(round(duration * rate)) / rate,
            node.phase.enabled or node.jitter.enabled,
        )
        if scatters:
            scattered = (
                instants
                + node.phase.value
                + self.scatter(f"{name}.jitter", node.jitter, len(instants))
            )
            scattered.sort(kind="stable")  # fast, because few change places
            last = duration - 1 / simulated_hz
            instants = scattered[
                np.searchsorted(scattered, 0.0) : np.searchsorted(scattered, last, side="right")
            ]
        stamps = instants
        if node.latency.enabled:
            late = self.scatter(f"{name}.latency", node.latency, len(instants))
            # a host stamps one of several waiting messages in 5 us
            queue = 5e-6 * np.arange(len(instants))
            stamps = np.maximum.accumulate(instants + late - queue) + queue
        stamps = node.clock_offset.value + (1 + 1e-6 * node.clock_drift.value) * stamps
        return instants, rate == simulated_hz and not scatters, stamps

    def scatter(self, name: str, effect: Scatter, n: int) -> Array:
        """A number per sample, (n,) [s], as the effect is distributed; 0 where it is off."""
        if effect.distribution == "exponential":
            return effect.value * self.random(name).standard_exponential(n)
        return effect.value * self.random(name).standard_normal(n)

    def reading(self, channel: str, reading: Array, sampled: Array) -> Array:
        """What the sensor of a channel reads at the sampled instants: errors, noise and steps."""
        effects, (noise, resolution) = self.settings.effects, SENSORS[channel]
        if channel.endswith("torque"):
            reading = reading + (
                self.drawn["load_cell_offset"] + self.drawn["load_cell_drift"] * sampled / 60
            )
        if noise:
            reading = reading + getattr(effects, noise).value * self.random(noise).standard_normal(
                len(sampled)
            )
        if channel == "joint_angle" and effects.encoder_zero.enabled:
            reading = reading + self.drawn["encoder_zero"]
        return rounded_to(reading, getattr(effects, resolution).value)


def rounded_to(signal: Array, step: float) -> Array:
    """The signal rounded to the nearest multiple of `step` [unit of the signal]. With step 0 it is
    not rounded."""
    return np.rint(signal / step) * step if step else signal


def write_truth(
    folder: Path, trial: str, truth: Mapping[str, object], curves: Mapping[str, Array] | None = None
) -> None:
    """Write a trial's truth and its exact curves to the folder `truth`, which ingest never
    reads."""
    if curves is not None:
        with atomic_path(folder / "truth" / f"{trial}.parquet") as path:
            pl.DataFrame(curves).write_parquet(path)
    write_text(folder / "truth" / f"{trial}.json", json.dumps(truth, indent=1) + "\n")


McapRecord = mcap_records.McapRecord
RULE, ARRIVES = "=" * 80 + "\n", 150_000  # [ns] in which a sample arrives at the recorder
SAMPLES = {
    "/dynamometer": (
        """\
float32 joint_angle       # rad, joint encoder of the dynamometer
float32 load_cell_torque  # N*m, exerted by the joint on the dynamometer
float32 actuator_angle    # rad, at the actuator's output
float32 motor_current     # A, q-axis
float32 commanded_angle   # rad, in counts of the joint encoder
"""
    ),
    "/actuator": (
        """\
float32 actuator_angle  # rad, at the actuator's output
float32 motor_current   # A, q-axis
float32 output_torque   # N*m, exerted by the actuator's output on the bench
"""
    ),
    "/leg": (
        """\
float32 joint_angle     # rad
float32 actuator_angle  # rad, at the actuator's output
float32 motor_current   # A, q-axis
float32 stiffness_gain  # N*m/rad, K_1 at the actuator's output
float32 damping_gain    # N*m*s/rad, B_1 at the actuator's output
bool sync               # level of the synchronisation line
"""
    ),
}
"""Fields of the messages of each topic of our own types."""


class LogTopic(NamedTuple):
    """A topic of equally long messages: their type, stamps [ns], the record that all have, and
    columns that differ."""

    name: str
    schema_name: str
    schema_text: str
    stamps: NDArray[np.int64]
    alike: NDArray[np.void]
    columns: Mapping[str, NDArray[Any]]

    def records(self, rows: NDArray[np.intp]) -> NDArray[np.void]:
        """The records (m,) of messages in these rows: those of a chunk stay in the processor's
        cache."""
        made = np.repeat(self.alike.view(f"V{self.alike.itemsize}"), rows.size).view(
            self.alike.dtype
        )
        made["sequence"], made["publish"], made["log"] = (
            rows,
            (stamps := self.stamps[rows]),
            stamps + ARRIVES,
        )
        for member, value in self.columns.items():
            made["data"][member] = value[rows]
        return made


def log_topic(
    name: str,
    schema_name: str,
    fields: str,
    frame_id: str,
    time: Array,
    members: Mapping[str, tuple[str, Any]],
) -> LogTopic:
    """A topic with messages at time stamps [s], (n,), whose definition has `fields` after a header.
    Members are in order: numpy type, and a value for all messages or a column (n,). In CDR each is
    aligned to its own size, counted from after the encapsulation; text is not aligned. Padding is
    zero."""
    stamps, frame = np.rint(np.asarray(time) * 1e9).astype(np.int64), frame_id.encode() + b"\0"
    seconds, nanoseconds = np.divmod(stamps, 10**9)
    whole: dict[str, tuple[str, Any]] = {
        "encapsulation": ("V4", b"\x00\x01\x00\x00"),  # little endian
        "sec": ("<i4", seconds),
        "nanosec": ("<u4", nanoseconds),
        "frame_id_length": ("<u4", len(frame)),
        "frame_id": (f"S{len(frame)}", frame),
        **members,
    }
    kinds, offsets, end = [np.dtype(kind) for kind, _ in whole.values()], list[int](), 0
    for kind in kinds:
        alignment = 1 if kind.kind in "SV" else kind.itemsize
        offsets.append(end if end == 0 else 4 + -(-(end - 4) // alignment) * alignment)
        end = offsets[-1] + kind.itemsize
    layout = np.dtype({"names": list(whole), "formats": kinds, "offsets": offsets, "itemsize": end})
    head = [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log", "<u8"),
    ]
    alike = np.zeros(1, np.dtype([*head, ("publish", "<u8"), ("data", layout)]))
    # without opcode and length
    alike["opcode"], alike["length"] = Opcode.MESSAGE, alike.itemsize - 9
    columns = {member: np.asarray(value) for member, (_, value) in whole.items() if np.ndim(value)}
    for member in whole.keys() - columns.keys():
        alike["data"][member] = whole[member][1]
    schema = (
        f"std_msgs/Header header\n{fields}{RULE}MSG: std_msgs/Header\nbuiltin_interfaces/Time"
        f" stamp\nstring frame_id\n{RULE}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    )
    return LogTopic(name, schema_name, schema, stamps, alike, columns)


def sample_topic(
    topic: str, frame_id: str, fields: str, time: Array, columns: Mapping[str, ArrayLike]
) -> LogTopic:
    """Messages of scalar fields, one for each time stamp [s], from 0 to 2^31 s in whole
    nanoseconds. `fields` declares one in each line, to whose type its column (n,) is cast."""
    cdr = {"bool": "u1", "float32": "<f4"}
    types = {words[1]: cdr[words[0]] for words in map(str.split, fields.splitlines())}
    members = {f"field.{name}": (kind, np.asarray(columns[name])) for name, kind in types.items()}
    return log_topic(
        topic, f"osl_interfaces/msg/{topic[1:].title()}Sample", fields, frame_id, time, members
    )


def joint_states(
    topic: str,
    frame_id: str,
    time: Array,
    position: Mapping[str, Array],
    effort: Mapping[str, Array],
) -> LogTopic:
    """JointState messages: positions [rad] by joint, (n,) each, and the effort of some joints;
    other efforts are 0."""
    members: dict[str, tuple[str, Any]] = {"names": ("<u4", len(position))}
    for joint in position:
        name = joint.encode() + b"\0"
        members |= {
            f"name_length.{joint}": ("<u4", len(name)),
            f"name.{joint}": (f"S{len(name)}", name),
        }
    members |= {"positions": ("<u4", len(position))}
    members |= {f"position.{joint}": ("<f8", values) for joint, values in position.items()}
    members |= {"velocities": ("<u4", 0), "efforts": ("<u4", len(position))}
    members |= {f"effort.{joint}": ("<f8", effort.get(joint, 0.0)) for joint in position}
    fields = "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    return log_topic(topic, "sensor_msgs/msg/JointState", fields, frame_id, time, members)


def wrenches(topic: str, frame_id: str, time: Array, torque: Array) -> LogTopic:
    """WrenchStamped messages with a torque [N*m] about z, (n,). All other components are 0."""
    zeros = {f"{vector}.{axis}": ("<f8", 0.0) for vector in ("force", "torque") for axis in "xyz"}
    fields = (
        f"geometry_msgs/Wrench wrench\n{RULE}MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3"
        f" force\ngeometry_msgs/Vector3 torque\n{RULE}MSG: geometry_msgs/Vector3\nfloat64"
        " x\nfloat64 y\nfloat64 z\n"
    )
    members = {**zeros, "torque.z": ("<f8", torque)}
    return log_topic(topic, "geometry_msgs/msg/WrenchStamped", fields, frame_id, time, members)


COMPRESSOR = zstandard.ZstdCompressor()  # one for all chunks: to make it clears a megabyte


def write_topics(path: Path, topics: Sequence[LogTopic]) -> None:
    """Write the messages of all topics, in the order of their stamps, after a metadata record; last
    the summary, its offsets, and the footer with the CRC of both. The file appears whole or not at
    all."""
    names, schemas, channels = (
        ", ".join(t.name for t in topics),
        list[McapRecord](),
        list[McapRecord](),
    )
    for number, topic in enumerate(topics, 1):
        schemas.append(
            mcap_records.Schema(number, topic.schema_text.encode(), "ros2msg", topic.schema_name)
        )
        channels.append(mcap_records.Channel(number, topic.name, "cdr", {}, number))
        topic.alike["channel"] = number
    publish, counts = (
        np.concatenate([topic.stamps for topic in topics]),
        [topic.stamps.size for topic in topics],
    )
    channel = np.repeat(np.arange(len(topics)) + 1, counts)[
        order := np.argsort(publish, kind="stable")
    ]
    log, lengths = (
        publish[order] + ARRIVES,
        np.repeat([topic.alike.itemsize for topic in topics], counts)[order],
    )
    # begins the first chunk
    content = encoded(one for pair in zip(schemas, channels, strict=True) for one in pair)
    ends = np.cumsum(lengths) + len(content)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        head = MCAP0_MAGIC + encoded([mcap_records.Header("ros2", "osl-analysis")])
        facts = {"origin": "simulated", "topic": names, "time": "header stamp"}
        described = encoded([mcap_records.Metadata("recording", facts)])
        file.write(head + described)
        indexes, first, begin, chunk_size = list[mcap_records.ChunkIndex](), 0, 0, 1 << 20
        # a chunk ends with the message that takes it beyond the size [bytes]
        while first < len(order):
            last = int(np.searchsorted(ends[:-1], begin + chunk_size, side="right")) + 1
            starts = ends[first:last] - lengths[first:last] - begin
            whole, base, rows_of = (
                np.empty(int(ends[last - 1]) - begin, np.uint8),
                0,
                dict[int, NDArray[np.intp]](),
            )
            whole[: len(content)] = np.frombuffer(content, np.uint8)
            # the messages of each are rows, put to their places at once
            for number, topic in enumerate(topics, 1):
                size, own = topic.alike.itemsize, np.flatnonzero(channel[first:last] == number)
                # a message is one value that may begin at any byte, so that values overlap
                if own.size:
                    places = np.ndarray((len(whole) - size + 1,), f"V{size}", whole, 0, (1,))
                    places[starts[own]] = topic.records(order[first:last][own] - base).view(
                        f"V{size}"
                    )
                    rows_of[number] = own
                base += topic.stamps.size
            indexes.append(
                write_chunk(file, whole.data, np.stack([log[first:last], starts], axis=1), rows_of)
            )
            first, begin, content = last, int(ends[last - 1]), b""
        file.write(encoded([mcap_records.DataEnd(0)]))
        used = dict.fromkeys(number for index in indexes for number in index.message_index_offsets)
        statistics = mcap_records.Statistics(
            attachment_count=0,
            channel_count=len(topics),
            channel_message_counts={number: counts[number - 1] for number in used},
            chunk_count=len(indexes),
            message_count=len(order),
            message_end_time=max((index.message_end_time for index in indexes), default=0),
            message_start_time=min((index.message_start_time for index in indexes), default=0),
            metadata_count=1,
            schema_count=len(topics),
        )
        groups: dict[Opcode, Sequence[McapRecord]] = {
            Opcode.SCHEMA: schemas,
            Opcode.CHANNEL: channels,
            Opcode.STATISTICS: [statistics],
            Opcode.CHUNK_INDEX: indexes,
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.METADATA_INDEX: [
                mcap_records.MetadataIndex(len(head), len(described), "recording")
            ],
        }
        start, summary, offsets = file.tell(), b"", list[McapRecord]()
        for opcode, records in groups.items():
            group = encoded(records)
            offsets.append(mcap_records.SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        offsets_start = start + len(summary)
        summary += encoded(offsets)
        crc = zlib.crc32(summary + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_start))
        file.write(
            summary + encoded([mcap_records.Footer(start, offsets_start, crc)]) + MCAP0_MAGIC
        )


def write_chunk(
    file: BinaryIO,
    content: memoryview,
    index: NDArray[np.int64],
    rows_of: Mapping[int, NDArray[np.intp]],
) -> mcap_records.ChunkIndex:
    """Write a chunk of messages, and the index of each channel, as each comes first. `index` (n, 2)
    has log times [ns] and where messages begin [bytes], `rows_of` the messages of each channel."""
    compressed, begin, offsets, log = (
        COMPRESSOR.compress(content),
        file.tell(),
        dict[int, int](),
        index[:, 0],
    )
    shared = {"message_start_time": int(log.min()), "message_end_time": int(log.max())}
    shared["uncompressed_size"], crc = len(content), zlib.crc32(content)
    file.write(
        encoded(
            [
                mcap_records.Chunk(
                    compression="zstd", data=compressed, uncompressed_crc=crc, **shared
                )
            ]
        )
    )
    end = file.tell()
    for number in sorted(rows_of, key=lambda one: rows_of[one][0]):
        offsets[number], own = file.tell(), index[rows_of[number]]
        file.write(
            struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + own.nbytes, number, own.nbytes)
            + own.tobytes()
        )
    return mcap_records.ChunkIndex(
        chunk_start_offset=begin,
        chunk_length=end - begin,
        compression="zstd",
        compressed_size=len(compressed),
        message_index_offsets=offsets,
        message_index_length=file.tell() - end,
        **shared,
    )


def encoded(records: Iterable[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
