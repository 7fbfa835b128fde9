"""What the recorder writes is what an independent ROS 2 reader reads."""

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Metadata
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory

from osl_analysis.errors import InputError
from osl_analysis.simulator.mcap_writer import LATENCY_NS, joint_states, samples, wrenches, write_topics


def write_mixed(path, n, frame_id="f"):
    t = np.arange(n)
    columns = {"flag": t % 2 == 0, "wide": np.sqrt(t), "level": t % 7, "narrow": np.sin(t)}
    fields = "bool flag\nfloat64 wide\nuint8 level\nfloat32 narrow # unit\n"
    write_topics(path, [samples("/t", "p/msg/M", frame_id, fields, 3.0 + t, columns)])
    return columns


def decoded(path):
    """(records, ROS 2 messages) of a file, with its CRCs checked."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = list(reader.iter_decoded_messages())
    return [message for _, _, message, _ in found], [ros for *_, ros in found]


@pytest.mark.parametrize("frame_id", ["", "a", "ab", "abc", "abcd", "abcde", "abcdef", "abcdefg"])
def test_every_field_is_aligned_whatever_the_length_of_the_frame_id(tmp_path, frame_id):
    columns = write_mixed(tmp_path / "a.mcap", 5, frame_id)
    _, ros = decoded(tmp_path / "a.mcap")
    assert [m.header.frame_id for m in ros] == [frame_id] * 5
    assert [m.wide for m in ros] == columns["wide"].tolist()
    assert [m.narrow for m in ros] == columns["narrow"].astype(np.float32).tolist()
    assert [m.flag for m in ros] == columns["flag"].tolist()
    assert [m.level for m in ros] == columns["level"].tolist()


def written_by_the_mcap_package(path, topics, metadata):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="osl-analysis")
        writer.add_metadata(metadata.name, metadata.metadata)
        channels = []
        for topic in topics:
            schema = writer.register_schema(topic.schema_name, "ros2msg", topic.schema_text.encode())
            channels.append(writer.register_channel(topic.name, "cdr", schema))
        messages = [
            (message["publish"], channel, message["sequence"], message["data"].tobytes())
            for channel, topic in zip(channels, topics, strict=True)
            for message in topic.records
        ]
        for stamp, channel, row, data in sorted(messages, key=lambda message: message[0]):
            writer.add_message(channel, int(stamp) + LATENCY_NS, data, int(stamp), int(row))
        writer.finish()


@pytest.mark.parametrize("counts", [(9000, 4000), (5, 0), (0, 0)])
def test_a_file_is_the_one_that_the_mcap_package_writes_of_the_same_messages(tmp_path, counts):
    """Two topics of messages of different size, in turn, over two chunks; stamps that repeat and are not in order."""
    rng, end = np.random.default_rng(4), 100.0
    position, torque = rng.normal(size=counts[0]), rng.normal(size=counts[1])
    joints = joint_states(
        "/joint", "bench", np.round(end * rng.random(counts[0]), 1), {"a": position, "bc": position}, {}
    )
    cell = wrenches("/cell", "f", np.sort(np.round(end / 3 * rng.random(counts[1]), 1)), torque)
    metadata = Metadata("recording", {"origin": "simulated", "topic": "/joint, /cell", "time": "header stamp"})
    write_topics(tmp_path / "ours.mcap", [joints, cell])
    written_by_the_mcap_package(tmp_path / "theirs.mcap", [joints, cell], metadata)
    assert (tmp_path / "ours.mcap").read_bytes() == (tmp_path / "theirs.mcap").read_bytes()


def test_a_recording_that_breaks_off_leaves_the_older_file(tmp_path, monkeypatch):
    path = tmp_path / "a.mcap"
    write_mixed(path, 5)
    before = path.read_bytes()

    def fail(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr("osl_analysis.simulator.mcap_writer.mcap_records.Footer", fail)
    with pytest.raises(InputError, match=r"a\.mcap: cannot be written \(no space left on device\); make room"):
        write_mixed(path, 9)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
