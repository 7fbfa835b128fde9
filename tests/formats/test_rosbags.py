# SPDX-License-Identifier: Apache-2.0
"""Recordings of ROS 1 and 2 in any container are one log of the same topics, units and clocks."""

import re
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import yaml
from bag_builder import (
    LAB_STATE,
    LATE_NS,
    STATE,
    TOPIC,
    angle_of,
    change_tables,
    stamps_of,
    write_bag,
    write_sqlite,
)
from conftest import said_in_refusal
from mcap_builder import SAMPLE_NAME, message_source, stamped, write_log
from rosbags.rosbag1 import Writer
from rosbags.rosbag2 import StoragePlugin

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
    ("name", "content", "message"),
    [
        (DESCRIBED, b"a: {b: 9}", "metadata.yaml: "),
        ("bag_1.mcap", None, "1 of the 2 .*bag_1.mcap"),
        ("bag_1.mcap", b"no bag", "bag_1.mcap: .*neither MCAP nor sqlite3"),
        ("bag_1.mcap", b"\x28\xb5\x2f\xfd and more", "bag_1.mcap: .*zstd.*`rosbags-convert"),
        ("bag_1.mcap", b"SQLite format 3\0", "bag_1.mcap: "),
    ],
)
def test_a_folder_that_cannot_be_read_is_refused_with_what_helps(tmp_path, name, content, message):
    folder = write_folder(tmp_path / "bag")
    (folder / name).unlink()
    if content is not None:
        (folder / name).write_bytes(content)

    assert re.search(message, said_in_refusal(read, folder))


# --- one log in every container -----------------------------------------------------------------

ROWS = np.arange(400)
CONTAINERS = {
    "MCAP": lambda path: write_bag(path, range(400), 2, storage_plugin=StoragePlugin.MCAP),
    "sqlite3": lambda path: write_sqlite(path, range(400)),
    "a part in sqlite3": lambda path: next(write_sqlite(path, range(400)).glob("*.db3")),
    "ROS 1": lambda path: write_bag(path, range(400), 1),
    "ROS 1, bz2": lambda path: write_bag(
        path, range(400), 1, compression=Writer.CompressionFormat.BZ2
    ),
    "ROS 1, lz4": lambda path: write_bag(
        path, range(400), 1, compression=Writer.CompressionFormat.LZ4
    ),
}
FIELDS = ("position[name=ankle]", "effort[name=ankle]")


def state_source(path: Path, time: str = "header", *fields: str):
    kind = formats.recognise(path).name
    return message_source(*(fields or FIELDS), kind=kind, topic=TOPIC, time=time)


@pytest.mark.parametrize("container", CONTAINERS)
def test_every_container_holds_the_same_channels_units_and_clocks(tmp_path, container):
    path = CONTAINERS[container](tmp_path / "bag")

    recording = formats.read(path, state_source(path))
    listed = formats.read(path)

    angle, torque, stamp = (
        recording.find({"topic": TOPIC, "field": field}) for field in (*FIELDS, "header.stamp")
    )
    np.testing.assert_array_equal(angle.values, angle_of(ROWS))
    np.testing.assert_array_equal(torque.values, -30 * angle_of(ROWS))
    np.testing.assert_array_equal(stamp.values, stamps_of(ROWS))
    np.testing.assert_array_equal(angle.rows.stamps_ns, stamps_of(ROWS) + LATE_NS)
    assert (angle.likely_unit, torque.likely_unit) == ("rad", "N*m")
    assert recording.loss.by_topic == {TOPIC: (400, 400)}
    named = {channel.address["field"] for channel in listed.channels}
    assert {*FIELDS, "header.stamp"} <= named


def test_messages_of_sqlite3_stand_in_the_order_in_which_they_came(tmp_path):
    """A clock that was set back is seen, and not sorted away."""
    folder = write_sqlite(tmp_path / "bag", range(400))
    change_tables(folder, "UPDATE messages SET timestamp = timestamp - 5000000000 WHERE id > 200")

    recording = formats.read(folder, state_source(folder, "log"))

    angle = recording.find({"topic": TOPIC, "field": FIELDS[0]})
    np.testing.assert_array_equal(angle.values, angle_of(ROWS))
    assert np.diff(angle.rows.stamps_ns).min() == 1_000_000 - 5_000_000_000


def test_a_recording_without_definitions_has_those_of_ros(tmp_path):
    """As recorders up to Humble leave it."""
    folder = write_sqlite(tmp_path / "bag", range(400))
    change_tables(folder, "DROP TABLE message_definitions")

    angle = formats.read(folder, state_source(folder)).find({"topic": TOPIC, "field": FIELDS[0]})

    np.testing.assert_array_equal(angle.values, angle_of(ROWS))


def test_a_type_of_the_laboratory_without_a_definition_is_refused_by_name(tmp_path):
    folder = write_sqlite(tmp_path / "bag", range(400), is_typed_by_lab=True)
    defined = formats.read(folder, state_source(folder))
    change_tables(folder, "DELETE FROM message_definitions")

    recording = formats.read(folder, state_source(folder))

    assert defined.find({"topic": TOPIC, "field": FIELDS[0]}).values.size == 400
    message = said_in_refusal(recording.find, {"topic": TOPIC, "field": FIELDS[0]})
    assert LAB_STATE in message
    assert STATE not in message
    assert "`ros2 bag convert`" in message


def test_the_parts_of_a_split_recording_in_sqlite3_are_one_log(tmp_path):
    folder = write_sqlite(tmp_path / "bag", range(250))
    other = write_sqlite(tmp_path / "other", range(250, 400))
    shutil.copy(next(other.glob("*.db3")), folder / "bag_1.db3")
    described = yaml.safe_load((folder / DESCRIBED).read_text())
    about = described["rosbag2_bagfile_information"]
    about["relative_file_paths"].append("bag_1.db3")
    about["topics_with_message_count"][0]["message_count"] = 400
    (folder / DESCRIBED).write_text(yaml.safe_dump(described))

    recording = formats.read(folder, state_source(folder))

    angle = recording.find({"topic": TOPIC, "field": FIELDS[0]})
    np.testing.assert_array_equal(angle.values, angle_of(ROWS))
    assert recording.loss.by_topic == {TOPIC: (400, 400)}


def messages_compressed(folder):
    described = yaml.safe_load((folder / DESCRIBED).read_text())
    described["rosbag2_bagfile_information"]["compression_mode"] = "MESSAGE"
    (folder / DESCRIBED).write_text(yaml.safe_dump(described))


def left_in_a_journal(folder):
    (part,) = folder.glob("*.db3")
    part.with_name(f"{part.name}-wal").write_bytes(b"messages")


def another_database(folder):
    (part,) = folder.glob("*.db3")
    part.unlink()
    with sqlite3.connect(part) as tables:
        tables.execute("CREATE TABLE cookies (name TEXT)")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (messages_compressed, "each message is compressed .*`rosbags-convert"),
        (left_in_a_journal, "db3-wal: .*did not finish"),
        (another_database, "without the tables topics and messages"),
    ],
)
def test_what_of_sqlite3_cannot_be_read_is_refused_by_name(tmp_path, change, message):
    folder = write_sqlite(tmp_path / "bag", range(20))
    change(folder)

    assert re.search(message, said_in_refusal(formats.read, folder))


def test_to_read_sqlite3_changes_no_file(tmp_path):
    """Its recorder wrote ahead, and closed it: sqlite3 would write its index beside the file."""
    folder = write_sqlite(tmp_path / "bag", range(400))
    (part,) = folder.glob("*.db3")
    with closing(sqlite3.connect(part)) as tables:
        tables.execute("PRAGMA journal_mode = WAL")
    part.with_name(f"{part.name}-wal").touch()
    before = {path: path.read_bytes() for path in folder.iterdir()}

    recording = formats.read(folder)

    assert recording.loss.read == 400
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_a_damaged_chunk_of_ros_1_is_lost_and_counted(tmp_path):
    path = write_bag(tmp_path / "a.bag", range(400), 1, compression=Writer.CompressionFormat.BZ2)
    data = path.read_bytes()
    second_chunk = data.index(b"op=\x05", data.index(b"op=\x05") + 1) + 60
    path.write_bytes(data[:second_chunk] + b"\xff" * 8 + data[second_chunk + 8 :])

    recording = formats.read(path)

    assert 0 < recording.loss.lost < 400
    assert "is damaged" in " ".join(recording.loss.remarks)
    assert recording.facts["chunks_lost"] == 1


def test_a_bag_of_ros_1_that_was_not_closed_is_told_how_to_mend(tmp_path):
    path = write_bag(tmp_path / "a.bag", range(400), 1)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])

    assert "`rosbag reindex`" in said_in_refusal(formats.read, path)


def test_two_bags_of_ros_1_in_one_file_are_refused(tmp_path):
    """The index at the beginning is of the first one alone."""
    path = write_bag(tmp_path / "a.bag", range(400), 1)
    path.write_bytes(2 * path.read_bytes())

    assert "a.bag: holds two bags" in said_in_refusal(formats.read, path)


@pytest.mark.recordings
def test_bags_that_others_recorded_are_read_whole(recordings):
    of_ros_1 = formats.read(recordings / "bag" / "fake_joint_state.bag")
    of_ros_2 = formats.read(recordings / "bag" / "rosbag2_test_0.db3")

    assert of_ros_1.loss.by_topic == {"/fake_joints_state": (2725, 2725)}
    assert of_ros_2.loss.read == of_ros_2.loss.expected == 4695
    battery = of_ros_2.find({"topic": "/battery", "field": "percentage"})
    np.testing.assert_array_equal(battery.values, 8)
