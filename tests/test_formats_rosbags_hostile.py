"""Bags that are damaged on purpose, or legal and rare: every byte of a chunk counts, and no file is touched."""

import sqlite3
import tracemalloc
from contextlib import closing
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import yaml
import zstandard
from bag_builder import KIND, START, STEP, edited, sample, typestore, write_bag1, write_bag2, write_split
from mcap.records import Schema
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from test_formats_rosbags import CHANNELS, check_one_chunk_is_lost, check_rows, kept_files, read, refused

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap.limits import Budget
from osl_analysis.formats.messages.ros1 import ros1_type, walk_of
from osl_analysis.formats.rosbag1.bag import Bag, DamagedError
from osl_analysis.formats.rosbag1.records import Record, walk_chunk
from osl_analysis.formats.rosbag2.database import opened
from osl_analysis.ingest import raw_files


def record(op: int, time: int, data: bytes, connection: int = 0) -> bytes:
    """A record of a ROS 1 bag with the fields of a message (wiki.ros.org/Bags/Format/2.0)."""
    stamp = (time // 10**9).to_bytes(4, "little") + (time % 10**9).to_bytes(4, "little")
    fields = {b"conn": connection.to_bytes(4, "little"), b"op": bytes([op]), b"time": stamp}
    head = b"".join((len(n) + 1 + len(v)).to_bytes(4, "little") + n + b"=" + v for n, v in fields.items())
    return len(head).to_bytes(4, "little") + head + len(data).to_bytes(4, "little") + data


def test_records_of_other_kinds_with_the_fields_of_a_message_are_none() -> None:
    walk = walk_chunk(record(2, 5, b"abc") + record(9, 6, b"x") + record(2, 3_000_000_007, b"de", 4), 100)
    assert walk.time.tolist() == [5, 3_000_000_007]
    assert walk.connection.tolist() == [0, 4]
    assert walk.lengths.tolist() == [3, 2]
    assert walk.unknown == 1


def chunk(content: bytes, size: int, compression: bytes) -> tuple[Bag, Record]:
    bag = Bag(Path("a.bag"), content, Budget(len(content)))
    return bag, Record({b"size": size.to_bytes(4, "little"), b"compression": compression}, 0, len(content))


def test_a_chunk_must_unpack_to_its_declared_size_and_no_byte_more() -> None:
    packed = lz4.frame.compress(bytes(1000))
    bag, whole = chunk(packed, 1000, b"lz4")
    assert bag.unpacked(whole) == bytes(1000)
    for size in (999, 1001):
        with pytest.raises(DamagedError, match=f"of {size} bytes"):
            bag.unpacked(chunk(packed, size, b"lz4")[1])
    bag, bomb = chunk(lz4.frame.compress(bytes(1 << 26)), 1000, b"lz4")
    tracemalloc.start()
    with pytest.raises(DamagedError, match="holds 1001 of 1000 bytes"):
        bag.unpacked(bomb)
    assert tracemalloc.get_traced_memory()[1] < 1 << 22
    tracemalloc.stop()


def test_a_chunk_whose_records_do_not_end_with_it_is_lost_as_a_whole(tmp_path: Path) -> None:
    path = write_bag1(tmp_path / "a.bag", range(2000), chunk=500)
    content = bytearray(path.read_bytes())
    place = content.index(b"time=", len(content) // 2) + 13  # the length of a message
    content[place : place + 4] = (1 << 20).to_bytes(4, "little")
    path.write_bytes(content)
    check_one_chunk_is_lost(read(path), 2000)


def test_an_index_record_of_odd_length_is_no_crash(tmp_path: Path) -> None:
    content = bytearray(write_bag1(tmp_path / "a.bag").read_bytes())
    place = content.rindex(b"ver=") + 8  # the last record counts the messages of a chunk: its length, then the pair
    end = content.index((8).to_bytes(4, "little"), place)
    content[end : end + 4] = (5).to_bytes(4, "little")
    (tmp_path / "a.bag").write_bytes(content)
    assert read(tmp_path / "a.bag").facts["damage"]["messages_lost"] is None


def test_a_signalling_nan_is_a_failed_reading(tmp_path: Path) -> None:
    content = write_bag1(tmp_path / "a.bag", range(200)).read_bytes()
    angle = np.float32(77).tobytes() + len("stance").to_bytes(4, "little")
    assert content.count(angle) == 1
    (tmp_path / "a.bag").write_bytes(content.replace(angle, b"\1\0\x80\x7f" + angle[4:]))
    assert read(tmp_path / "a.bag").facts["missing"] == {"theta": 1, "torque": 0, "sync": 0}


def test_a_ros_1_message_has_the_length_of_its_definition() -> None:
    own = "Header header\nbyte level\nchar letter\ntime at\nduration[2] took\n"
    header = "===\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    name, definitions = ros1_type(Schema(1, (own + header).encode(), "ros1msg", "lab/Odd"))
    assert [(one.name, one.type) for one in definitions["lab/Odd"]][1:3] == [("level", "int8"), ("letter", "char")]
    payload = (7).to_bytes(4, "little") + bytes(8) + bytes(4) + b"\xff\xfe" + bytes(8) + bytes(16)
    walk = walk_of(definitions, name, payload)
    row = np.frombuffer(payload, np.uint8)[None]
    found = {path: walk.leaves[path].read(row)[0] for path in ("header.seq", "level", "letter")}
    assert found == {"header.seq": 7, "level": -1, "letter": 254}
    assert "took[1].nsecs" in walk.leaves
    for wrong in (payload + b"\0", payload[:-1]):
        with pytest.raises(InputError):
            walk_of(definitions, name, wrong)


def test_a_clock_that_was_set_back_in_a_database_is_refused(tmp_path: Path) -> None:
    store = typestore(2)
    with Writer2(tmp_path / "a", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/lab", KIND, typestore=store)
        for row in [*range(100), *(20.3 + np.arange(100))]:
            writer.write(connection, START + int(row * STEP), store.serialize_cdr(sample(store, int(row), 2), KIND))
    assert "the clock was set while recording" in refused(tmp_path / "a", time={"source": "log"})


def test_no_file_appears_beside_a_database_that_had_a_write_ahead_log(tmp_path: Path) -> None:
    bag = write_bag2(tmp_path / "bag")
    with edited(bag / "bag.db3") as connection:
        connection.execute("PRAGMA journal_mode = WAL")
    before, content = kept_files(bag), (bag / "bag.db3").read_bytes()
    check_rows(read(bag))
    assert kept_files(bag) == before
    assert (bag / "bag.db3").read_bytes() == content
    with closing(opened(bag / "bag.db3")) as database, pytest.raises(sqlite3.OperationalError, match="readonly"):
        database.execute("DELETE FROM messages")


def test_packed_messages_that_do_not_say_their_size_are_read(tmp_path: Path) -> None:
    bag = write_bag2(tmp_path / "bag")
    packer = zstandard.ZstdCompressor(write_content_size=False)
    with edited(bag / "bag.db3") as connection:
        rows = connection.execute("SELECT id, data FROM messages").fetchall()
        packed = [(packer.compress(data), row) for row, data in rows]
        connection.executemany("UPDATE messages SET data = ? WHERE id = ?", packed)
    check_rows(read(bag))
    with edited(bag / "bag.db3") as connection:
        connection.execute("UPDATE messages SET data = ? WHERE id = 7", (packer.compress(bytes(1 << 27)),))
    assert "more than the 67108864 that are unpacked" in refused(bag / "bag.db3")


def test_a_standard_type_that_changed_needs_the_distribution(tmp_path: Path) -> None:
    """`Range` has the field `variance` since ROS 2 Iron."""
    kind, channels = "sensor_msgs/msg/Range", {"theta": {"topic": "/lab", "field": "range", "unit": "rad"}}
    store = get_typestore(Stores.ROS2_HUMBLE)
    header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](0, 0), "")
    with Writer2(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/lab", kind, typestore=store)
        for time in (5, 9):
            writer.write(connection, time, store.serialize_cdr(store.types[kind](header, 1, 0.1, 0.2, 3.0, 1.5), kind))
    with edited(tmp_path / "bag" / "bag.db3") as database:
        database.execute("DROP TABLE message_definitions")
    said = refused(tmp_path / "bag", channels=channels, time={"source": "log"})
    assert "which differs between the distributions of ROS 2; convert it with `ros2 bag convert`" in said
    metadata = tmp_path / "bag" / "metadata.yaml"
    described = yaml.safe_load(metadata.read_text())
    described["rosbag2_bagfile_information"]["ros_distro"] = "humble"
    metadata.write_text(yaml.safe_dump(described))
    assert read(tmp_path / "bag", channels=channels, time={"source": "log"}).samples["theta"].to_list() == [1.5, 1.5]


def test_a_last_part_without_its_end_leaves_the_losses_unknown(tmp_path: Path) -> None:
    folder = write_split(tmp_path / "bag", "MCAP")
    whole = (folder / "bag_1.mcap").read_bytes()
    (folder / "bag_1.mcap").write_bytes(whole[:-30])
    damage = read(folder).facts["damage"]
    assert damage["messages_lost"] is None
    assert damage["complete"] is False


def test_a_part_that_changes_while_the_recording_is_read_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_split(tmp_path / "bag")
    described = {"format": "rosbag2", "time": {"source": "header"}, "channels": CHANNELS}
    (tmp_path / "ros.yaml").write_text(yaml.safe_dump(described))
    usual = raw_files.recording_from

    def meddling(path, source):  # type: ignore[no-untyped-def]
        recording = usual(path, source)
        with (folder / "bag_1.db3").open("ab") as file:
            file.write(b"\0")
        return recording

    monkeypatch.setattr(raw_files, "recording_from", meddling)
    with pytest.raises(InputError, match=r"bag_1\.db3: the file changed while it was read"):
        raw_files.trial_from_files({"trial": "a", "log": "bag", "log_source": "ros"}, tmp_path, tmp_path)
