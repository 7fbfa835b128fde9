# SPDX-License-Identifier: Apache-2.0
"""The folder of a ROS 2 recording gives what the library `rosbags` wrote."""

import re
from functools import partial

import numpy as np
import pytest
import yaml
from conftest import said_in_refusal
from mcap_builder import message_source
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from osl_analysis import formats
from osl_analysis.formats import known_formats, recognise
from osl_analysis.recording import End

KIND = "lab_msgs/msg/Sample"
STEP_NS = 1_000_000
START_NS = 1_700_000_000_000_000_000
LATE_NS = 250_000  # a message is received after its stamp
DESCRIBED = "metadata.yaml"


def write_rows(writer, rows):
    """A message per row on /lab: `row` degrees, torques -row / 2 and row."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(
        get_types_from_msg(
            "std_msgs/Header header\nfloat32 angle\nstring state\nfloat64[] torque\nbool sync\n",
            KIND,
        )
    )
    time = store.types["builtin_interfaces/msg/Time"]
    header = store.types["std_msgs/msg/Header"]
    with writer:
        connection = writer.add_connection("/lab", KIND, typestore=store)
        for given in rows:
            row = int(given)
            stamp = time(*divmod(START_NS + row * STEP_NS, 10**9))
            state = "stance" if row % 3 else "swing"  # messages of two lengths
            torque = np.array([-row / 2, row])
            message = store.types[KIND](
                header(stamp, "lab"), float(row), state, torque, row % 2 == 0
            )
            received = START_NS + int(given * STEP_NS) + LATE_NS
            writer.write(connection, received, store.serialize_cdr(message, KIND))


def write_bag(folder, rows=range(50), storage="MCAP", packed=""):
    """A folder with a bag of ROS 2."""
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin[storage])
    if packed:
        writer.set_compression(CompressionMode[packed], CompressionFormat.ZSTD)
    write_rows(writer, rows)
    return folder


def write_split(folder):
    """A recording of 50 messages in two parts, as `ros2 bag record --max-bag-size` leaves it."""
    whole = write_bag(folder.with_name(f"{folder.name}_0"), range(30))
    other = write_bag(folder.with_name(f"{folder.name}_1"), range(30, 50))
    part = next(other.glob("*_1.*"))
    part.rename(whole / part.name)
    description = yaml.safe_load((whole / DESCRIBED).read_text())
    about = description["rosbag2_bagfile_information"]
    about["relative_file_paths"] = [f"{whole.name}{part.suffix}", part.name]
    about["topics_with_message_count"][0]["message_count"] = 50
    (whole / DESCRIBED).write_text(yaml.safe_dump(description))
    return whole


def rewritten(path, content):
    path.write_bytes(content)
    return path


def read(path, *fields, time="header"):
    """The fields that a source file asks for."""
    asked = fields or ("angle", "torque[0]", "sync")
    return formats.read(path, message_source(*asked, kind=recognise(path).name, time=time))


def column(recording, field):
    return recording.find({"topic": "/lab", "field": field}).values


refusal = partial(said_in_refusal, lambda path: column(read(path, "angle"), "angle"))


def assert_rows(recording):
    """The numbers of the rows that were written, and their stamps."""
    row = np.arange(50)
    found = recording.find({"topic": "/lab", "field": "angle"})
    np.testing.assert_array_equal(column(recording, "angle"), row)
    np.testing.assert_array_equal(column(recording, "torque[0]"), -row / 2)
    np.testing.assert_array_equal(column(recording, "sync"), row % 2 == 0)
    np.testing.assert_array_equal(column(recording, "header.stamp"), START_NS + row * STEP_NS)
    np.testing.assert_array_equal(found.rows.stamps_ns, START_NS + row * STEP_NS + LATE_NS)


def test_the_parts_of_a_folder_are_one_log(tmp_path):
    folder = write_split(tmp_path / "bag")

    recording = read(folder)

    assert_rows(recording)
    assert recording.loss.by_topic == {"/lab": (50, 50)}
    files = [path.name for path in known_formats()["rosbag2"].files_in(folder)]
    assert files == [DESCRIBED, "bag_0.mcap", "bag_1.mcap"]


def test_the_description_tells_what_a_cut_part_held(tmp_path):
    folder = write_split(tmp_path / "bag")
    content = (folder / "bag_1.mcap").read_bytes()

    rewritten(folder / "bag_1.mcap", content[: len(content) // 2])
    half = read(folder)
    rewritten(folder / "bag_1.mcap", content[:-20])
    without_footer = read(folder)

    assert half.loss.by_topic == {"/lab": (30, 50)}
    assert half.loss.end == End.MISSING
    assert any("bag_1.mcap" in one for one in half.loss.remarks)
    assert without_footer.loss.by_topic == {"/lab": (50, 50)}


def without_a_part(folder):
    whole = write_split(folder)
    (whole / "bag_1.mcap").unlink()
    return whole


REFUSED = [
    (lambda bag: rewritten(bag / DESCRIBED, b"a: {b: 9}").parent, "metadata.yaml: "),
    (lambda bag: without_a_part(bag / "bag"), "1 .* 2 .*bag_1.mcap"),
    (lambda bag: write_bag(bag / "x", packed="MESSAGE"), "CDR"),
    (lambda bag: write_bag(bag / "x", storage="SQLITE3"), "`rosbags-convert"),
    (lambda bag: write_bag(bag / "x", storage="SQLITE3") / "x.db3", "`rosbags-convert"),
]


@pytest.mark.parametrize(("make", "said"), REFUSED)
def test_a_ros_2_bag_that_cannot_be_read_is_refused_with_what_helps(tmp_path, make, said):
    path = make(write_bag(tmp_path / "bag"))

    assert re.search(said, refusal(path))


def test_messages_stand_in_the_order_of_the_file_though_the_clock_was_set_back(tmp_path):
    rows = [*range(100), *(20.3 + np.arange(100))]
    path = write_bag(tmp_path / "bag", rows)

    recording = read(path)
    stamps = recording.find({"topic": "/lab", "field": "angle"}).rows.stamps_ns

    assert column(recording, "angle").tolist() == [int(row) for row in rows]
    assert np.flatnonzero(np.diff(stamps) < 0).tolist() == [99]
