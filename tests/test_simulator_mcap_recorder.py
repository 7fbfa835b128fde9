"""What the recorder writes is what an independent ROS 2 reader reads."""

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from osl_analysis.errors import InputError
from osl_analysis.simulator.mcap_writer import (
    DEPENDENCIES,
    LogTopic,
    write_mcap,
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
