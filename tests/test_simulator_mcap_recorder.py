"""What the recorder writes is what an independent ROS 2 reader reads."""

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from osl_analysis.errors import InputError
from osl_analysis.simulator.mcap_writer import (
    DEPENDENCIES,
    LATENCY_NS,
    LogTopic,
    joint_states,
    wrenches,
    write_mcap,
    write_topics,
)

MIXED = "std_msgs/Header header\nbool flag\nfloat64 wide\nuint8 level\nfloat32 narrow # unit\n" + DEPENDENCIES


def mixed_columns(n):
    t = np.arange(n)
    return {"flag": t % 2 == 0, "wide": np.sqrt(t), "level": t % 7, "narrow": np.sin(t)}


def decoded(path):
    """The ROS 2 messages of a file, with its CRCs checked."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [ros for *_, ros in reader.iter_decoded_messages()]


@pytest.mark.parametrize("frame_id", ["", "a", "ab", "abc", "abcd", "abcde", "abcdef", "abcdefg"])
def test_every_field_is_aligned_whatever_the_length_of_the_frame_id(tmp_path, frame_id):
    columns = mixed_columns(5)
    write_mcap(tmp_path / "a.mcap", LogTopic("/t", "p/msg/M", MIXED, frame_id), 3.0 + np.arange(5), columns)
    ros = decoded(tmp_path / "a.mcap")
    assert [m.header.frame_id for m in ros] == [frame_id] * 5
    assert [m.wide for m in ros] == columns["wide"].tolist()
    assert [m.narrow for m in ros] == columns["narrow"].astype(np.float32).tolist()
    assert [m.flag for m in ros] == columns["flag"].tolist()
    assert [m.level for m in ros] == columns["level"].tolist()


def test_a_recording_that_breaks_off_leaves_the_older_file(tmp_path, monkeypatch):
    path = tmp_path / "a.mcap"
    write_mcap(path, LogTopic("/t", "p/msg/M", MIXED, "f"), np.arange(5.0), mixed_columns(5))
    before = path.read_bytes()

    def fail(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr("osl_analysis.simulator.mcap_writer.Writer.finish", fail)
    with pytest.raises(InputError, match=r"a\.mcap: cannot be written \(no space left on device\); make room"):
        write_mcap(path, LogTopic("/t", "p/msg/M", MIXED, "f"), np.arange(9.0), mixed_columns(9))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_messages_of_two_topics_stand_in_the_order_of_their_stamps_and_arrive_a_little_later(tmp_path):
    joints = joint_states("/joint", "bench", np.array([0.3, 0.1]), {"a": np.zeros(2)}, {})
    write_topics(tmp_path / "a.mcap", [joints, wrenches("/cell", "f", np.array([0.2, 0.4]), np.zeros(2))])
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = [(channel.topic, m) for _, channel, m in reader.iter_messages(log_time_order=False)]
        assert reader.get_header().profile == "ros2"
    assert [topic for topic, _ in found] == ["/joint", "/cell", "/joint", "/cell"]
    assert [m.sequence for _, m in found] == [1, 0, 0, 1]
    assert [m.publish_time for _, m in found] == [100_000_000, 200_000_000, 300_000_000, 400_000_000]
    assert {m.log_time - m.publish_time for _, m in found} == {LATENCY_NS}
