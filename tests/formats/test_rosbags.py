# SPDX-License-Identifier: Apache-2.0
"""The folder of a ROS 2 recording: its parts are one log, and its description says what they
held."""

import re

import numpy as np
import pytest
import yaml
from conftest import said_in_refusal
from mcap_builder import SAMPLE_NAME, message_source, stamped, write_log

from osl_analysis import formats
from osl_analysis.base.recording import End
from osl_analysis.formats import known_formats

DESCRIBED = "metadata.yaml"
PARTS = (range(30), range(30, 50))


def write_folder(folder):
    """A recording of 50 messages in two parts, as `ros2 bag record --max-bag-size` leaves it."""
    folder.mkdir()
    names = [f"{folder.name}_{number}.mcap" for number in range(len(PARTS))]
    for name, rows in zip(names, PARTS, strict=True):
        messages = [
            stamped(row * 1_000_000, angle=row, torque=-row / 2, sync=False) for row in rows
        ]
        write_log(folder / name, messages)
    topic = {"name": "/lab", "type": SAMPLE_NAME, "serialization_format": "cdr"}
    about = {
        "storage_identifier": "mcap",
        "relative_file_paths": names,
        "topics_with_message_count": [{"topic_metadata": topic, "message_count": 50}],
    }
    (folder / DESCRIBED).write_text(yaml.safe_dump({"rosbag2_bagfile_information": about}))
    return folder


def read(folder):
    return formats.read(folder, message_source("angle", "torque", kind="rosbag2", time="header"))


def test_the_parts_of_a_folder_are_one_log(tmp_path):
    folder = write_folder(tmp_path / "bag")

    recording = read(folder)

    torque = recording.find({"topic": "/lab", "field": "torque"})
    stamps = recording.find({"topic": "/lab", "field": "header.stamp"})
    np.testing.assert_array_equal(torque.values, -np.arange(50) / 2)
    np.testing.assert_array_equal(stamps.values, 1_000_000 * np.arange(50))
    assert recording.loss.by_topic == {"/lab": (50, 50)}
    files = [path.name for path in known_formats()["rosbag2"].files_in(folder)]
    assert files == [DESCRIBED, "bag_0.mcap", "bag_1.mcap"]


def test_the_description_tells_what_a_cut_part_held(tmp_path):
    folder = write_folder(tmp_path / "bag")
    content = (folder / "bag_1.mcap").read_bytes()

    (folder / "bag_1.mcap").write_bytes(content[: len(content) // 4])
    cut = read(folder)
    (folder / "bag_1.mcap").write_bytes(content[:-20])
    without_footer = read(folder)

    assert cut.loss.by_topic == {"/lab": (30, 50)}
    assert cut.loss.end == End.MISSING
    assert any("bag_1.mcap" in remark for remark in cut.loss.remarks)
    assert without_footer.loss.by_topic == {"/lab": (50, 50)}


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        (DESCRIBED, b"a: {b: 9}", "metadata.yaml: "),
        ("bag_1.mcap", None, "1 of the 2 .*bag_1.mcap"),
        ("bag_1.mcap", b"SQLite format 3\0", "bag_1.mcap: .*`rosbags-convert"),
    ],
)
def test_a_folder_that_cannot_be_read_is_refused_with_what_helps(tmp_path, name, content, said):
    folder = write_folder(tmp_path / "bag")
    (folder / name).unlink()
    if content is not None:
        (folder / name).write_bytes(content)

    assert re.search(said, said_in_refusal(read, folder))
