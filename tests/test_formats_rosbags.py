"""Bags of ROS 1 and ROS 2 give what the library `rosbags` wrote, through ingest to canonical columns."""

import re
import sys
from functools import partial
from pathlib import Path
from shutil import copytree, rmtree
from typing import Any

import numpy as np
import pytest
import yaml
from bag_builder import START, STEP, edited, write_bag1, write_bag2, write_split
from c3d_builder import REAL_DATA
from mcap.records import Schema
from recognised_files import read_recognised, refusal_of
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from osl_analysis.commands.inspect import inspect_file
from osl_analysis.errors import InputError
from osl_analysis.formats.message_fields import message_type, shape_of
from osl_analysis.ingest.raw_files import trial_from_files
from osl_analysis.ingest.recording import Recording

CHANNELS = {
    "theta": {"topic": "/lab", "field": "angle", "unit": "deg"},
    "torque": {"topic": "/lab", "field": "torque[0]", "unit": "N*m", "sign": -1},
    "sync": {"topic": "/lab", "field": "sync", "unit": "V"},
}
read = partial(read_recognised, time={"source": "header"}, channels=CHANNELS)
refused = partial(refusal_of, time={"source": "header"}, channels=CHANNELS)


def check_rows(recording: Recording, rows: range = range(50)) -> None:
    """The canonical columns of the rows that were written."""
    row = np.array(rows)
    np.testing.assert_allclose(recording.samples["time"], (row - row[0]) * 1e-3, atol=1e-12)
    np.testing.assert_allclose(recording.samples["theta"], np.radians(row), rtol=1e-12)
    np.testing.assert_array_equal(recording.samples["torque"], row / 2)
    np.testing.assert_array_equal(recording.samples["sync"], row % 2 == 0)
    assert recording.facts["time"]["start_ns"] == START + rows[0] * STEP


def kept_files(folder: Path) -> list[str]:
    """Names below a folder: reading a bag must not write beside it."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


@pytest.mark.parametrize(("compression", "chunk"), [("", 0), ("BZ2", 500), ("LZ4", 500)])
def test_a_ros_1_bag_gives_the_columns_that_were_written(tmp_path: Path, compression: str, chunk: int) -> None:
    recording = read(write_bag1(tmp_path / "a.bag", compression=compression, chunk=chunk))
    check_rows(recording)
    damage = recording.facts["damage"]
    assert (damage["complete"], damage["messages_lost"]) == (True, 0)
    assert damage["topics"] == {"/lab": {"messages": 50, "messages_lost": 0}}


@pytest.mark.parametrize(("storage", "compression"), [("SQLITE3", ""), ("SQLITE3", "MESSAGE"), ("MCAP", "")])
def test_a_ros_2_bag_gives_the_columns_that_were_written(tmp_path: Path, storage: str, compression: str) -> None:
    recording = read(write_bag2(tmp_path / "bag", storage=storage, compression=compression))
    check_rows(recording)
    assert recording.facts["damage"]["messages_lost"] == 0
    assert sorted(kept_files(tmp_path / "bag")) == [f"bag.{'mcap' if storage == 'MCAP' else 'db3'}", "metadata.yaml"]


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_the_parts_of_a_split_recording_are_one_log(tmp_path: Path, storage: str) -> None:
    folder = write_split(tmp_path / "bag", storage)
    write_bag1(folder / "other_0.bag", range(5))  # the description tells what belongs to the recording
    recording = read(folder)
    check_rows(recording)
    assert recording.facts["damage"]["topics"]["/lab"] == {"messages": 50, "messages_lost": 0}
    assert len(recording.facts["decoding"]["/lab"]) == 1


def test_damage_in_one_part_of_a_split_recording_is_damage_of_the_whole(tmp_path: Path) -> None:
    part = write_split(tmp_path / "bag", "MCAP") / "bag_0.mcap"
    content = part.read_bytes()
    part.write_bytes(content[:-9] + bytes([content[-9] ^ 1]) + content[-8:])  # the checksum of its summary
    damage = read(part.parent).facts["damage"]
    assert (damage["complete"], damage["messages_lost"]) == (False, 0)
    assert "bag_0.mcap: the summary is damaged" in damage["remarks"]


def write_split1(folder: Path, names: list[str]) -> Path:
    """A recording of ROS 1 in files of these names, of 5 messages each."""
    folder.mkdir()
    for number, name in enumerate(names):
        write_bag1(folder / name, range(5 * number, 5 * number + 5), chunk=200)
    return folder


def test_the_bags_of_a_split_recording_of_ros_1_are_one_log_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    folder = write_split1(tmp_path / "bag", [f"knee_{k}.bag" for k in range(12)])
    recording = read(folder)
    check_rows(recording, range(60))
    damage = recording.facts["damage"]
    assert (damage["complete"], damage["topics"]) == (True, {"/lab": {"messages": 60, "messages_lost": 0}})
    assert inspect_file(folder).facts["messages lost"] == "0"


def test_the_trial_of_a_folder_names_all_its_files_and_is_of_the_format_that_its_source_file_says(
    tmp_path: Path,
) -> None:
    described = {"format": "rosbag2", "time": {"source": "header"}, "channels": CHANNELS}
    (tmp_path / "ros.yaml").write_text(yaml.safe_dump(described))
    row = {"trial": "a", "log": "bag", "log_source": "ros"}
    write_split(tmp_path / "bag")
    files = trial_from_files(row, tmp_path, tmp_path).provenance["files"]["log"]
    assert [one["path"] for one in files["parts"]] == ["metadata.yaml", "bag_0.db3", "bag_1.db3"]
    assert files["bytes"] == sum(path.stat().st_size for path in (tmp_path / "bag").iterdir())
    write_split1(tmp_path / "first", ["knee_0.bag"])
    with pytest.raises(InputError, match="a folder with a recording in rosbag1, its source file says rosbag2"):
        trial_from_files(row | {"log": "first"}, tmp_path, tmp_path)


def test_a_split_recording_of_ros_1_whose_first_bags_were_deleted_says_so(tmp_path: Path) -> None:
    folder = write_split1(tmp_path / "bag", ["2026-11-20-10-00-00_3.bag", "2026-11-20-10-05-00_4.bag.active"])
    recording = read(folder)
    check_rows(recording, range(10))
    assert any(
        "begins with '2026-11-20-10-00-00_3.bag': its files before that are not here" in text
        for text in recording.warnings
    )


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["rec_0.bag", "rec_1.bag", "rec_3.bag"], "NAME_1.bag (rec_2.bag cannot be found); copy what is missing"),
        (["rec_0.bag", "rec_1.orig.bag"], "rec_0.bag, rec_1.orig.bag are not the files of one split recording"),
        (["a_0.bag", "b_1.bag"], "a_0.bag, b_1.bag are not the files of one split recording of ROS 1"),
    ],
)
def test_bags_of_ros_1_that_are_not_one_recording_are_refused_without_a_remedy_of_ros_2(
    tmp_path: Path, names: list[str], said: str
) -> None:
    text = refused(folder := write_split1(tmp_path / "bag", names))
    assert said in text
    assert "ros2" not in text
    with pytest.raises(InputError, match=re.escape(text)):
        inspect_file(folder)


def test_one_part_of_a_split_recording_is_read_with_a_warning(tmp_path: Path) -> None:
    for storage, ending in (("SQLITE3", "db3"), ("MCAP", "mcap")):
        folder = write_split(tmp_path / storage, storage)
        recording = read(folder / f"bag_1.{ending}")
        check_rows(recording, range(30, 50))
        assert any("one of the 2 files of a recording; name the folder" in text for text in recording.warnings)
        assert recording.facts["damage"]["messages_lost"] is None or storage == "MCAP"
        for number in range(2):
            rmtree(tmp_path / f"part{number}")


def test_messages_that_the_description_has_and_the_bag_lacks_are_lost(tmp_path: Path) -> None:
    bag = write_bag2(tmp_path / "bag", range(1000))
    with edited(bag / "bag.db3") as connection:
        connection.execute("DELETE FROM messages WHERE id % 200 = 7")
    recording = read(bag)
    assert recording.facts["damage"]["topics"]["/lab"] == {"messages": 995, "messages_lost": 5}
    with edited(bag / "bag.db3") as connection:
        connection.execute("DELETE FROM messages WHERE id % 50 = 7")
    assert "2 % of topic '/lab' is lost" in refused(bag)


def test_without_its_description_a_database_is_read_and_the_losses_are_unknown(tmp_path: Path) -> None:
    bag = write_bag2(tmp_path / "bag")
    (bag / "metadata.yaml").unlink()
    recording = read(bag / "bag.db3")
    check_rows(recording)
    assert recording.facts["damage"]["messages_lost"] is None
    assert any("no metadata.yaml beside it" in text for text in recording.warnings)
    assert "a folder without metadata.yaml" in refused(bag)
    assert "ros2 bag reindex" in refused(bag)


@pytest.mark.parametrize("text", ["a: [", "rosbag2_bagfile_information: {version: 9}"])
def test_a_description_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    bag = write_bag2(tmp_path / "bag")
    (bag / "metadata.yaml").write_text(text)
    assert "metadata.yaml: not the description of a ROS 2 bag" in refused(bag)


def test_a_recording_of_which_a_part_is_missing_or_packed_is_refused(tmp_path: Path) -> None:
    folder = write_split(tmp_path / "bag")
    (folder / "bag_1.db3").unlink()
    assert "1 of the 2 files that metadata.yaml lists are missing (bag_1.db3)" in refused(folder)
    assert "unpack them with `zstd -d`" in refused(write_bag2(tmp_path / "packed", compression="FILE"))


def test_a_database_that_is_cut_off_is_refused(tmp_path: Path) -> None:
    path = write_bag2(tmp_path / "bag", range(500)) / "bag.db3"
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert "the database is damaged or cut off" in refused(path)
    assert "sqlite3 BAG .recover" in refused(path)


def test_a_database_with_a_write_ahead_log_is_refused_and_reading_changes_no_file(tmp_path: Path) -> None:
    closed, killed = write_bag2(tmp_path / "bag"), tmp_path / "killed"
    with edited(closed / "bag.db3") as connection:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("UPDATE messages SET timestamp = timestamp")
        connection.commit()
        copytree(closed, killed)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}
    assert "a write-ahead log is beside it (bag.db3-wal)" in refused(killed)
    check_rows(read(closed))
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before


def test_a_database_that_is_no_bag_is_refused(tmp_path: Path) -> None:
    for columns, lacks in (("id INTEGER, name TEXT", "column: type"), ("id, name, type, serialization_format", "")):
        with edited(tmp_path / "a.db3") as connection:
            connection.execute("DROP TABLE IF EXISTS topics")
            connection.execute(f"CREATE TABLE topics ({columns})")
        assert f"(no such {lacks or 'table: messages'}): no bag of ROS 2" in refused(tmp_path / "a.db3")


def test_rows_that_are_no_messages_are_refused_and_strangers_are_counted(tmp_path: Path) -> None:
    bag = write_bag2(tmp_path / "bag")
    with edited(bag / "bag.db3") as connection:
        connection.execute("INSERT INTO messages VALUES (99, 77, 5, x'00')")
    assert any("1 messages belong to topics that are not in the bag" in text for text in read(bag).warnings)
    with edited(bag / "bag.db3") as connection:
        connection.execute("UPDATE messages SET data = 'text' WHERE id = 9")
    assert "holds str at" in refused(bag / "bag.db3")


def without_definitions(bag: Path) -> Path:
    """A bag as it was before bags had definitions of their messages."""
    with edited(bag / f"{bag.name}.db3") as connection:
        connection.execute("DROP TABLE message_definitions")
    return bag


def standard_bag(folder: Path, kind: str, *fields: Any) -> Path:
    """Two messages of a standard type in a bag without definitions."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer2(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/lab", kind, typestore=store)
        for time in (5, 9):
            writer.write(connection, time, store.serialize_cdr(store.types[kind](*fields), kind))
    return without_definitions(folder)


def test_a_standard_type_that_changed_needs_the_distribution(tmp_path: Path) -> None:
    """`Range` has the field `variance` since ROS 2 Iron."""
    types = get_typestore(Stores.ROS2_HUMBLE).types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), "")
    bag = standard_bag(tmp_path / "bag", "sensor_msgs/msg/Range", header, 1, 0.1, 0.2, 3.0, 1.5)
    asked: dict[str, Any] = {"channels": {"theta": {"topic": "/lab", "field": "range", "unit": "rad"}}}
    asked["time"] = {"source": "log"}
    said = refused(bag, **asked)
    assert "which differs between the distributions of ROS 2; convert it with `ros2 bag convert`" in said
    described = yaml.safe_load((bag / "metadata.yaml").read_text())
    described["rosbag2_bagfile_information"]["ros_distro"] = "humble"
    (bag / "metadata.yaml").write_text(yaml.safe_dump(described))
    assert read(bag, **asked).samples["theta"].to_list() == [1.5, 1.5]


def test_standard_types_are_known_without_definitions_and_others_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = standard_bag(tmp_path / "bag", "std_msgs/msg/Float64", 2.5)
    channels = {"theta": {"topic": "/lab", "field": "data", "unit": "rad"}}
    assert read(bag, channels=channels, time={"source": "log"}).samples["theta"].to_list() == [2.5, 2.5]
    said = refused(without_definitions(write_bag2(tmp_path / "own")))
    assert "topic '/lab': the bag has no definition of type 'lab_msgs/msg/Sample', which is no standard one" in said
    monkeypatch.setitem(sys.modules, "rosbags", None)
    monkeypatch.delitem(sys.modules, "rosbags.typesys")
    said = refused(bag, channels=channels, time={"source": "log"})
    assert "needs rosbags, which is not installed; pip install 'osl-analysis[ros]'" in said


def test_a_ros_1_bag_that_is_cut_or_whose_recorder_was_killed_is_refused_with_the_command_that_helps(
    tmp_path: Path,
) -> None:
    path = write_bag1(tmp_path / "a.bag", chunk=500)
    whole = path.read_bytes()
    place = whole.index(b"index_pos=") + len(b"index_pos=")
    index = int.from_bytes(whole[place : place + 8], "little")
    unfinished = whole[:place] + bytes(8) + whole[place + 8 :]
    for content in (unfinished[: index - 40], whole[: index - 40], whole[:-40], whole[:30]):
        path.write_bytes(content)
        assert "the recorder did not finish, or the bag is damaged; run `rosbag reindex` on a copy" in refused(path)


@pytest.mark.parametrize("zeros", [True, False])
def test_a_damaged_chunk_of_a_ros_1_bag_is_lost_as_a_whole_and_counted(tmp_path: Path, zeros: bool) -> None:
    path = write_bag1(tmp_path / "a.bag", range(2000), "LZ4" if zeros else "", 500)
    content = bytearray(path.read_bytes())
    if zeros:
        place = content.index(b"\x04\x22\x4d\x18", len(content) // 2)
        content[place + 20 : place + 200] = bytes(180)
    else:
        place = content.index(b"time=", len(content) // 2) + 13
        content[place : place + 4] = (1 << 20).to_bytes(4, "little")
    path.write_bytes(content)
    recording = read(path)
    lost = 2000 - len(recording.samples)
    assert 0 < lost <= 10
    assert recording.facts["damage"]["topics"]["/lab"]["messages_lost"] == lost
    assert recording.facts["damage"]["chunks_lost"] == 1


def test_two_bags_in_one_file_and_other_versions_are_refused(tmp_path: Path) -> None:
    path = write_bag1(tmp_path / "a.bag")
    whole = path.read_bytes()
    path.write_bytes(whole + whole)
    assert "two bags were joined" in refused(path)
    path.write_bytes(b"#ROSBAG V1.2\n" + whole[13:])
    assert "not a ROS 1 bag of version 2.0 (it begins with b'#ROSBAG V1.2'); convert it" in refused(path)


@pytest.mark.parametrize("write", [write_bag1, write_bag2])
def test_a_clock_that_was_set_back_is_refused(tmp_path: Path, write: Any) -> None:
    """`rosbags` sorts by time and would interleave the halves."""
    path = write(tmp_path / "a.bag", [*range(100), *(20.3 + np.arange(100))])
    assert "the clock was set while recording" in refused(path, time={"source": "log"})


@pytest.mark.skipif(not REAL_DATA.is_dir(), reason="no recordings made by others here")
def test_a_real_ros_2_database_is_read_as_the_library_reads_it(tmp_path: Path) -> None:
    folder = tmp_path / "rosbag2_test"
    folder.mkdir()
    for name, own in (("rosbag2_test_0.db3", "rosbag2_test_0.db3"), ("rosbag2_test_metadata.yaml", "metadata.yaml")):
        (folder / own).write_bytes((REAL_DATA / "bag" / name).read_bytes())
    channels = {"theta": {"topic": "/imu", "field": "angular_velocity.x", "unit": "rad"}}
    recording = read(folder, channels=channels)
    assert recording.facts["damage"]["topics"]["/imu"] == {"messages": 1565, "messages_lost": 0}
    store = get_typestore(Stores.ROS2_FOXY)
    description = yaml.safe_load((folder / "metadata.yaml").read_text())
    description["rosbag2_bagfile_information"]["relative_file_paths"] = ["rosbag2_test_0.db3"]
    (folder / "metadata.yaml").write_text(yaml.safe_dump(description))
    with Reader2(folder) as reader:
        imu = [one for one in reader.connections if one.topic == "/imu"]
        messages = [store.deserialize_cdr(raw, one.msgtype) for one, _, raw in reader.messages(imu)]
    expected = [message.angular_velocity.x for message in messages]  # type: ignore[attr-defined]
    np.testing.assert_array_equal(recording.samples["theta"], expected)


def test_a_signalling_nan_is_a_failed_reading(tmp_path: Path) -> None:
    content = write_bag1(tmp_path / "a.bag", range(200)).read_bytes()
    angle = np.float32(77).tobytes() + len("stance").to_bytes(4, "little")
    (tmp_path / "a.bag").write_bytes(content.replace(angle, b"\1\0\x80\x7f" + angle[4:]))
    assert read(tmp_path / "a.bag").facts["missing"] == {"theta": 1, "torque": 0, "sync": 0}


def test_a_truth_value_is_no_angle(tmp_path: Path) -> None:
    for path in (write_bag1(tmp_path / "a.bag"), write_bag2(tmp_path / "b")):
        said = refused(path, channels={"theta": CHANNELS["sync"] | {"unit": "rad"}})
        assert "field 'sync' is true in message 1 of 50, a truth value and no number in rad" in said


def test_a_ros_1_message_has_the_length_of_its_definition() -> None:
    own = "Header header\nbyte level\nchar letter\ntime at\nduration[2] took\n"
    header = "===\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    kind = message_type(Schema(1, (own + header).encode(), "ros1msg", "lab/Odd"), ros1=True)
    assert [one[:2] for one in kind.definitions["lab/Odd"]][1:3] == [("level", "int8"), ("letter", "char")]
    payload = (7).to_bytes(4, "little") + bytes(8) + bytes(4) + b"\xff\xfe" + bytes(8) + bytes(16)
    shape = shape_of(kind, payload, ["header.seq", "level", "letter"])
    found = shape.read(payload, np.zeros(1, np.int64))
    assert {path: values[0] for path, values in found.items()} == {"header.seq": 7, "level": -1, "letter": 254}
    assert "took[1].nsecs" in shape.leaves
    for wrong in (payload + b"\0", payload[:-1]):
        with pytest.raises(InputError):
            shape_of(kind, wrong)
