# SPDX-License-Identifier: Apache-2.0
"""The effects of recorders on true signals: sampling instants, sensors and stamps.

With all effects off, samples are at the even instants of the simulation.

Logs are MCAP like those of real ones: ROS 2 messages in CDR, zstd chunks with CRCs. All messages
are known beforehand, so the file is made chunk by chunk. One by one, as `mcap.writer.Writer` takes
them, they would take as long as all simulating.
"""

import json
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
import scipy
import zstandard
from mcap import records as mcap_records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC
from numpy.typing import ArrayLike, NDArray

from osl_analysis.base.files import atomic_path, write_text
from osl_analysis.base.trial import Array
from osl_analysis.simulator.simulation_settings import NodeSettings, SimulationSettings
from osl_analysis.simulator.trial_plan import generator_of

RULE = "=" * 80 + "\n"  # between the definitions of a ROS 2 schema
ARRIVES_NS = 150_000  # [ns] in which a sample arrives at the recorder
CHUNK_BYTES = 1 << 20  # of messages in a chunk, at most
COMPRESSION_LEVEL = -3  # of zstd: 0.75 of the time of 1, for 13 % more bytes
LITTLE_ENDIAN_CDR = b"\x00\x01\x00\x00"

HEADER_DEFINITIONS = (
    f"{RULE}MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    f"{RULE}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)
JOINT_STATE_FIELDS = "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
WRENCH_FIELDS = (
    f"geometry_msgs/Wrench wrench\n{RULE}MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3"
    f" force\ngeometry_msgs/Vector3 torque\n{RULE}MSG: geometry_msgs/Vector3\nfloat64"
    " x\nfloat64 y\nfloat64 z\n"
)
# of the leg's own messages
LEG_FIELDS = """\
float32 joint_angle     # rad
float32 actuator_angle  # rad, at the actuator's output
float32 motor_current   # A, q-axis
float32 stiffness_gain  # N*m/rad, K_1 at the actuator's output
float32 damping_gain    # N*m*s/rad, B_1 at the actuator's output
bool sync               # level of the synchronisation line
"""
CDR_TYPES = {"bool": "u1", "float32": "<f4"}


class LogTopic(NamedTuple):
    """A topic of equally long messages."""

    name: str
    schema_name: str
    schema_text: str
    records: NDArray[np.void]  # (n,) of MCAP, one for each message


def log_topic(
    name: str,
    schema_name: str,
    fields: str,
    frame_id: str,
    time: Array,
    members: Mapping[str, tuple[str, Any]],
) -> LogTopic:
    """Make a topic with a message per time stamp.

    Parameters
    ----------
    name, schema_name : str
    fields : str
        Definition of the message after its header.
    frame_id : str
        Of the header.
    time : Array
        (n,) [s].
    members : Mapping
        In order: numpy type, and a value for all messages or a column (n,).
    """
    stamps = np.rint(np.asarray(time) * 1e9).astype(np.int64)
    seconds, nanoseconds = np.divmod(stamps, 1_000_000_000)
    frame = frame_id.encode() + b"\0"
    message = {
        "sec": ("<i4", seconds),
        "nanosec": ("<u4", nanoseconds),
        "frame_id_length": ("<u4", len(frame)),
        "frame_id": (f"S{len(frame)}", frame),
        **members,
    }
    # CDR aligns each member to its own size, and not text, as C does
    body = np.dtype([(member, kind) for member, (kind, _) in message.items()], align=True)
    head = [("opcode", "u1"), ("length", "<u8")]  # which its length does not count
    content = [
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log", "<u8"),
        ("publish", "<u8"),
        ("encapsulation", "V4"),
        ("body", body),
    ]
    first = np.zeros(1, np.dtype(head + content))
    first["opcode"] = Opcode.MESSAGE
    first["length"] = np.dtype(content).itemsize
    first["encapsulation"] = LITTLE_ENDIAN_CDR
    columns = {}
    for member, (_, value) in message.items():
        if np.ndim(value):
            columns[member] = value
        else:
            first["body"][member] = value
    records = first.repeat(len(stamps))  # what all share is copied, which is the faster way
    records["sequence"] = np.arange(len(stamps))
    records["log"] = stamps + ARRIVES_NS
    records["publish"] = stamps
    for member, column in columns.items():
        records["body"][member] = column
    schema = f"std_msgs/Header header\n{fields}{HEADER_DEFINITIONS}"
    return LogTopic(name, schema_name, schema, records)


def leg_samples(time: Array, columns: Mapping[str, ArrayLike]) -> LogTopic:
    """Make the topic of the leg: its `LEG_FIELDS` (n,) at time stamps (n,) [s], from 0 to 2^31 s in
    whole nanoseconds."""
    members = {}
    for line in LEG_FIELDS.splitlines():
        kind, name, *_ = line.split()
        members[f"field.{name}"] = (CDR_TYPES[kind], np.asarray(columns[name]))
    return log_topic("/leg", "osl_interfaces/msg/LegSample", LEG_FIELDS, "leg", time, members)


def joint_states(
    time: Array, position: Mapping[str, Array], effort: Mapping[str, Array]
) -> LogTopic:
    """Make the bench's topic of JointState messages: positions [rad] by joint, (n,) each, and the
    effort of some joints; other efforts are 0."""
    names: dict[str, tuple[str, Any]] = {}
    for joint in position:
        text = joint.encode() + b"\0"
        names[f"name_length.{joint}"] = ("<u4", len(text))
        names[f"name.{joint}"] = (f"S{len(text)}", text)
    members: dict[str, tuple[str, Any]] = {
        "names": ("<u4", len(position)),
        **names,
        "positions": ("<u4", len(position)),
        **{f"position.{joint}": ("<f8", values) for joint, values in position.items()},
        "velocities": ("<u4", 0),
        "efforts": ("<u4", len(position)),
        **{f"effort.{joint}": ("<f8", effort.get(joint, 0.0)) for joint in position},
    }
    schema_name = "sensor_msgs/msg/JointState"
    return log_topic("/joint_states", schema_name, JOINT_STATE_FIELDS, "bench", time, members)


def wrenches(frame_id: str, time: Array, torque: Array) -> LogTopic:
    """Make the topic of WrenchStamped messages with a torque (n,) [N*m] about z; all other
    components are 0."""
    members: dict[str, tuple[str, Any]] = {}
    for vector in ("force", "torque"):
        for axis in "xyz":
            members[f"{vector}.{axis}"] = ("<f8", 0.0)
    members["torque.z"] = ("<f8", torque)
    schema_name = "geometry_msgs/msg/WrenchStamped"
    return log_topic("/wrench", schema_name, WRENCH_FIELDS, frame_id, time, members)


def write_topics(path: Path, topics: Sequence[LogTopic]) -> None:
    """Write the messages of all topics as MCAP, each topic in chunks of its own with a checksum.

    There is no index, which is for seeking. The file appears whole or not at all.
    """
    records: list[mcap_records.McapRecord] = [mcap_records.Header("ros2", "osl-analysis")]
    for number, topic in enumerate(topics, 1):
        text = topic.schema_text.encode()
        records.append(mcap_records.Schema(number, text, "ros2msg", topic.schema_name))
        records.append(mcap_records.Channel(number, topic.name, "cdr", {}, number))
    for number, topic in enumerate(topics, 1):
        topic.records["channel"] = number
        rows = CHUNK_BYTES // topic.records.itemsize
        for first in range(0, topic.records.size, rows):
            messages = topic.records[first : first + rows]
            content = messages.view(np.uint8).data
            chunk = mcap_records.Chunk(
                compression="zstd",
                data=zstandard.compress(content, COMPRESSION_LEVEL),
                message_start_time=int(messages["log"].min()),
                message_end_time=int(messages["log"].max()),
                uncompressed_crc=zlib.crc32(content),
                uncompressed_size=content.nbytes,
            )
            records.append(chunk)
    records += [mcap_records.DataEnd(0), mcap_records.Footer(0, 0, 0)]

    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    written: bytes = builder.end()  # type: ignore[no-untyped-call]
    with atomic_path(path) as temporary:
        temporary.write_bytes(MCAP0_MAGIC + written + MCAP0_MAGIC)


# A true signal: (n,) at the even instants of the simulation; or, for a signal that jumps, as
# friction does, a function of instants [s], because a curve through its samples would be wrong in
# between.
TrueSignal = Array | Callable[[Array], Array]


# the effects of each channel's sensor, white noise and resolution, by their names in the settings
SENSORS = {
    "joint_angle": (None, "joint_encoder"),
    "commanded_angle": (None, "joint_encoder"),
    "actuator_angle": (None, "actuator_encoder"),
    "motor_current": ("current_noise", "current_quantisation"),
    "load_cell_torque": ("load_cell_noise", "load_cell_quantisation"),
    "output_torque": ("load_cell_noise", "load_cell_quantisation"),
}


def recording_of(
    trial: str, signals: Mapping[str, TrueSignal], settings: SimulationSettings
) -> tuple[dict[str, Array], dict[str, float]]:
    """Record true signals with the nodes of a bench.

    Parameters
    ----------
    trial : str
        Its name, which decides the random numbers.
    signals : Mapping
        By channel.
    settings : SimulationSettings

    Returns
    -------
    log : dict
        (n,) by channel, with the stamps [s] `time`, and `torque_time` of the torque, which equals
        it if one node records all.
    drawn : dict
        Errors that were drawn for this trial: clock start [s], load-cell offset [N*m] and drift
        [N*m/min].
    """
    recorder = settings.recorder
    drawn = random_errors(trial, settings)
    samples = next(len(signal) for signal in signals.values() if not callable(signal))
    bench = Bench(trial, settings, drawn, samples)
    torque = {name: signal for name, signal in signals.items() if is_torque(name)}
    other_signals = {name: signal for name, signal in signals.items() if name not in torque}
    log = bench.recording("node", recorder.node, other_signals)
    name = "node" if recorder.torque_node is None else "torque_node"
    age_s = settings.effects.load_cell_delay.value
    log_of_torque = bench.recording(name, getattr(recorder, name), torque, age_s)
    torque_time = log_of_torque.pop("time")
    return {**log, "torque_time": torque_time, **log_of_torque}, drawn


def random_errors(trial: str, settings: SimulationSettings) -> dict[str, float]:
    """Draw the errors that a bench keeps over a trial."""
    clock = generator_of(settings.seed, trial, "clock_start")
    drawn = {"clock_start_s": float(clock.integers(20, 2000))}
    for name in ("load_cell_offset", "load_cell_drift"):
        deviate = generator_of(settings.seed, trial, name).standard_normal()
        drawn[name] = getattr(settings.effects, name).value * deviate
    return drawn


def is_torque(channel: str) -> bool:
    return channel.endswith("torque")


@dataclass(frozen=True)
class Bench:
    """One trial on a bench, with the errors that it keeps."""

    trial: str
    settings: SimulationSettings
    drawn: Mapping[str, float]
    samples: int  # instants of the simulation

    def random(self, name: str) -> np.random.Generator:
        """The random numbers of an effect."""
        return generator_of(self.settings.seed, self.trial, name)

    def recording(
        self, name: str, node: NodeSettings, signals: Mapping[str, TrueSignal], age_s: float = 0.0
    ) -> dict[str, Array]:
        """Record signals of some age with one node: its stamps [s], as `time`, and the channels,
        (n,) each."""
        instants = self.instants(name, node)
        values = self.values_at(signals, np.maximum(instants - age_s, 0.0))
        log = {"time": self.drawn["clock_start_s"] + instants}
        for channel in signals:
            log[channel] = self.reading(channel, values[channel], instants)
        return log

    def instants(self, name: str, node: NodeSettings) -> Array:
        """When a node samples, (n,) [s]."""
        simulated_hz = self.settings.dynamometer.rate_hz
        duration = self.samples / simulated_hz
        rate = node.rate.value or simulated_hz
        instants = np.arange(round(duration * rate)) / rate
        if not node.phase.enabled and not node.jitter.enabled:
            return instants
        jitter = self.random(f"{name}.jitter").standard_normal(len(instants))
        scattered = instants + node.phase.value + node.jitter.value * jitter
        scattered.sort(kind="stable")  # fast, because few change places
        first = np.searchsorted(scattered, 0.0)
        stop = np.searchsorted(scattered, duration - 1 / simulated_hz, side="right")
        return scattered[first:stop]

    def values_at(self, signals: Mapping[str, TrueSignal], instants: Array) -> dict[str, Array]:
        """True values (n,) of signals at instants [s]."""
        values = {name: signal(instants) for name, signal in signals.items() if callable(signal)}
        columns = {name: signal for name, signal in signals.items() if not callable(signal)}
        simulated = np.arange(self.samples) / self.settings.dynamometer.rate_hz
        if columns:  # one spline through all of them, whose intervals are found once
            splines = scipy.interpolate.CubicSpline(simulated, np.column_stack([*columns.values()]))
            values.update(zip(columns, splines(instants).T, strict=True))
        return values

    def reading(self, channel: str, values: Array, sampled: Array) -> Array:
        """What the sensor of a channel reads of true values (n,) at the sampled instants (n,):
        errors, noise and steps."""
        effects = self.settings.effects
        noise, resolution = SENSORS[channel]
        reading = values
        if is_torque(channel):
            drift = self.drawn["load_cell_drift"] * sampled / 60
            reading = values + (self.drawn["load_cell_offset"] + drift)
        if noise is not None:
            deviates = self.random(noise).standard_normal(len(sampled))
            reading = reading + getattr(effects, noise).value * deviates
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
