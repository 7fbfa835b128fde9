"""Bags of ROS 1 and ROS 2 give what the library `rosbags` wrote, through ingest to canonical
columns."""

import hashlib
import re
import shutil
import sqlite3
import sys
from collections.abc import Iterable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from c3d_builder import REAL_DATA
from mcap.records import Schema
from recognised_files import read_recognised, refusal_of
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from osl_analysis.errors import InputError
from osl_analysis.old_formats.message_fields import message_type, shape_of
from osl_analysis.old_formats.rosbag import recorded_files
from osl_analysis.ingest.raw_files import FORMATS, trial_from_files
from osl_analysis.ingest.source import Recording

SAMPLE = "std_msgs/Header header\nfloat32 angle\nstring state\nfloat64[] torque\nbool sync\n"
KIND, STEP, START, DESCRIBED = (
    "lab_msgs/msg/Sample",
    1_000_000,
    1_700_000_000_000_000_000,
    "metadata.yaml",
)


def changed(path: Path, *queries: str) -> Path:
    """A database after SQL queries."""
    with closing(sqlite3.connect(path)) as connection, connection:
        for query in queries:
            connection.execute(query)
    return path


def rewritten(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def write_rows(writer, ros: int, rows: Iterable[float]) -> None:  # type: ignore[no-untyped-def]
    """A message per row on /lab: `row` degrees, torques -row / 2 and row [N*m], received 0.25 ms
    after its stamp."""
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(SAMPLE, KIND))
    time, header, own = (
        store.types[kind] for kind in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header", KIND)
    )
    encode = store.serialize_ros1 if ros == 1 else store.serialize_cdr
    with writer:
        connection = writer.add_connection("/lab", KIND, typestore=store)
        for received, row in ((START + int(row * STEP) + 250_000, int(row)) for row in rows):
            head = header(*[row] * (ros == 1), time(*divmod(START + row * STEP, 10**9)), "lab")
            state = "stance" if row % 3 else "swing"  # messages of two lengths
            message = own(head, float(row), state, np.array([-row / 2, row]), row % 2 == 0)
            writer.write(connection, received, encode(message, KIND))


def write_bag1(
    path: Path, rows: Iterable[float] = range(50), compression: str = "", chunk: int = 0
) -> Path:
    """A bag of ROS 1; `chunk` is the size of its chunks [bytes]."""
    writer = Writer1(path)
    if compression:
        writer.set_compression(Writer1.CompressionFormat[compression])
    writer.chunk_threshold = chunk or writer.chunk_threshold
    write_rows(writer, 1, rows)
    return path


def write_bag2(
    folder: Path, rows: Iterable[float] = range(50), storage: str = "SQLITE3", packed: str = ""
) -> Path:
    """A folder with a bag of ROS 2."""
    writer = Writer2(folder, version=9, storage_plugin=StoragePlugin[storage])
    if packed:
        writer.set_compression(CompressionMode[packed], CompressionFormat.ZSTD)
    write_rows(writer, 2, rows)
    return folder


def write_split(folder: Path, storage: str = "SQLITE3") -> Path:
    """A recording of 50 messages in two parts, as `ros2 bag record --max-bag-size` leaves it."""
    whole, other = (folder.with_name(f"{folder.name}_{number}") for number in range(2))
    write_bag2(whole, range(30), storage), write_bag2(other, range(30, 50), storage)
    part = next(other.glob("*_1.*"))
    names = [f"{whole.name}{part.suffix}", part.name]
    part.rename(whole / part.name)
    described = yaml.safe_load((whole / DESCRIBED).read_text())
    described["rosbag2_bagfile_information"]["relative_file_paths"] = names
    described["rosbag2_bagfile_information"]["topics_with_message_count"][0]["message_count"] = 50
    (whole / DESCRIBED).write_text(yaml.safe_dump(described))
    return whole


MAPPED = {
    "theta": ("angle", "deg", 1),
    "torque": ("torque[0]", "N*m", -1),
    "sync": ("sync", "V", 1),
}
CHANNELS = {
    name: {"topic": "/lab", "field": at, "unit": unit, "sign": s}
    for name, (at, unit, s) in MAPPED.items()
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


def counts(recording: Recording, topic: str = "/lab") -> tuple[int, int | None]:
    """How many messages of a topic there are, and were lost."""
    return tuple(recording.losses["topics"][topic].values())


@pytest.mark.parametrize(("write", "options"), [
    (write_bag1, {}), (write_bag1, {"compression": "BZ2", "chunk": 500}),
    (write_bag1, {"compression": "LZ4", "chunk": 500}), (write_bag2, {}), (write_bag2,
     {"packed": "MESSAGE"}),
    (write_bag2, {"storage": "MCAP"}),
])  # fmt: skip
def test_a_bag_gives_the_columns_that_were_written(
    tmp_path: Path, write: Any, options: dict[str, Any]
) -> None:
    path = write(tmp_path / "a.bag", **options)
    kept, recording = sorted(tmp_path.rglob("*")), read(path)
    check_rows(recording)
    assert recording.losses["complete"]
    assert not any("hold no bytes" in text for text in recording.warnings)
    # reading a bag must not write beside it
    assert (counts(recording), sorted(tmp_path.rglob("*"))) == ((50, 0), kept)


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_parts_of_a_split_bag_are_one_log_and_one_alone_is_read_with_a_warning(
    tmp_path: Path, storage: str
) -> None:
    folder = write_split(tmp_path / "bag", storage)
    recording = read(folder)
    check_rows(recording)
    assert (counts(recording), len(recording.facts["decoding"]["/lab"])) == ((50, 0), 1)
    facts, size = (
        FORMATS["rosbag2"].inspect(folder).facts,
        sum(one.stat().st_size for one in folder.glob("bag_?.*")),
    )
    assert (facts["bytes"], facts["chunks"]) == (str(size), "2" if storage == "MCAP" else "0")
    part = read(next(folder.glob("bag_1.*")))
    check_rows(part, range(30, 50))
    assert any(
        "one of the 2 files of a recording; name the folder" in text for text in part.warnings
    )
    assert part.losses["lost"] == (0 if storage == "MCAP" else None)
    if storage == "MCAP":
        content = (folder / "bag_0.mcap").read_bytes()
        # the checksum of its summary
        content = content[:-9] + bytes([content[-9] ^ 1]) + content[-8:]
        damage = read(rewritten(folder / "bag_0.mcap", content).parent).losses
        assert (damage["complete"], damage["lost"]) == (False, 0)  # as the whole
        assert "bag_0.mcap: the summary is damaged" in damage["remarks"]
        cut = rewritten(folder / "bag_1.mcap", (folder / "bag_1.mcap").read_bytes()[:-900]).parent
        damage = read(cut).losses  # behind the messages
        assert (damage["complete"], damage["end_missing"], damage["lost"]) == (False, False, 0)
        half = rewritten(folder / "bag_1.mcap", content[: len(content) // 2]).parent
        assert "40 % of topic '/lab' is lost" in refused(half)
        damage = read(half, largest_loss=0.5).losses  # its description knows what it held
        assert (damage["end_missing"], *counts(read(half, largest_loss=0.5))) == (True, 30, 20)
        assert (damage["expected"], damage["read"], damage["lost"]) == (50, 30, 20)


def test_the_trial_of_a_folder_names_all_its_files(tmp_path: Path) -> None:
    described = {"format": "rosbag2", "time": {"source": "header"}, "channels": CHANNELS}
    (tmp_path / "ros.yaml").write_text(yaml.safe_dump(described))
    folder = write_split(tmp_path / "bag")
    row = {"trial": "a", "log": folder.name, "log_source": "ros"}
    files = trial_from_files(row, tmp_path, tmp_path).provenance["files"]["log"]
    assert [one["path"] for one in files["parts"]] == [DESCRIBED, "bag_0.db3", "bag_1.db3"]
    assert files["bytes"] == sum(path.stat().st_size for path in folder.iterdir())
    assert (
        files["sha256"]
        == hashlib.sha256("".join(one["sha256"] for one in files["parts"]).encode()).hexdigest()
    )
    (tmp_path / "c3d.yaml").write_text("format: c3d")
    with pytest.raises(
        InputError, match="a folder with a recording in rosbag2, its source file says c3d; write"
    ):
        trial_from_files(row | {"log_source": "c3d"}, tmp_path, tmp_path)
    (tmp_path / "first").mkdir()
    write_bag1(tmp_path / "first/knee_0.bag")
    with pytest.raises(
        InputError, match=r"a folder without metadata.yaml, .*; name the recording in it"
    ):
        trial_from_files(row | {"log": "first"}, tmp_path, tmp_path)


def test_messages_that_the_description_has_and_the_bag_lacks_are_lost(tmp_path: Path) -> None:
    bag = write_bag2(tmp_path / "bag", range(1000))
    described = (bag / DESCRIBED).read_text()
    # as older ones say
    rewritten(bag / DESCRIBED, re.sub(r"( +- )(\S+db3)", r"\1bag/\2", described).encode())
    database = changed(bag / "bag.db3", "DELETE FROM messages WHERE id % 200 = 7")
    assert counts(read(bag)) == counts(read(database)) == (995, 5)
    # nor is a message what has no topic, or no bytes
    changed(
        database,
        "INSERT INTO messages VALUES (9999, 77, 5, x'00')",
        "UPDATE messages SET data = 'x' WHERE id = 9",
    )
    recording = read(bag)
    assert any(
        "2 messages hold no bytes, or belong to no topic of the bag" in text
        for text in recording.warnings
    )
    assert counts(recording) == (994, 6)
    changed(database, "DELETE FROM messages WHERE id % 50 = 7")
    assert "% of topic '/lab' is lost" in refused(bag)


def test_messages_that_stand_twice_over_others_are_lost(tmp_path: Path) -> None:
    bag = write_bag2(tmp_path / "bag")
    with closing(sqlite3.connect(bag / "bag.db3")) as connection:
        copied = (
            "UPDATE messages SET (timestamp, data) = (SELECT timestamp, data FROM messages AS other"
        )
        connection.execute(
            f"{copied} WHERE other.id = messages.id - 10) WHERE id BETWEEN 21 AND 24"
        )
        connection.commit()
    damage = read(bag, largest_loss=0.5).losses
    assert (damage["lost"], damage["complete"]) == (4, False)
    assert any("4 of " in text and "stand twice" in text for text in damage["remarks"])
    # of the payload alone; the one before may be sent once more
    for back, last, lost in ((4, 24, 4), (1, 21, 0)):
        bag = write_bag2(tmp_path / f"bag {back}")
        with closing(sqlite3.connect(next(bag.glob("*.db3")))) as connection:
            copied = f"SELECT data FROM messages AS other WHERE other.id = messages.id - {back}"
            connection.execute(
                f"UPDATE messages SET data = ({copied}) WHERE id BETWEEN 21 AND {last}"
            )
            connection.commit()
        damage = read(bag, largest_loss=0.5).losses
        assert (damage["lost"], damage["complete"]) == (lost, not lost)


def test_without_its_description_a_database_is_read_and_the_losses_are_unknown(
    tmp_path: Path,
) -> None:
    bag = write_bag2(tmp_path / "bag")
    (bag / DESCRIBED).unlink()
    recording = read(bag / "bag.db3")
    check_rows(recording)
    assert recording.losses["lost"] is None
    assert any("no metadata.yaml beside it" in text for text in recording.warnings)
    assert re.search("a folder without metadata.yaml.*ros2 bag reindex", refused(bag))
    assert (recorded_files(bag), recorded_files(bag / "bag.db3")) == ([bag], [bag / "bag.db3"])


def without_a_part(folder: Path) -> Path:
    whole = write_split(folder)
    (whole / "bag_1.db3").unlink()
    return whole


REFUSED: dict[str, tuple[Any, str]] = {
    "yaml": (lambda bag: rewritten(bag / DESCRIBED, b"a: {b: 9}").parent,
    "not the description of a ROS 2 bag"),
    "twice": (lambda bag: rewritten(x := bag / DESCRIBED, re.sub(rb"( +- \S+db3\n)", rb"\1\1",
    x.read_bytes())).parent,
        "lists no file, or one twice"),
    "missing part": (lambda bag: without_a_part(bag / "bag"),
    "1 of the 2 files that .* are missing .bag_1.db3.; copy"),
    "packed": (lambda bag: write_bag2(bag / "x", packed="FILE"), "unpack it with `zstd -d`"),
    "cut": (lambda bag: rewritten(bag / "bag.db3", (bag / "bag.db3").read_bytes()[:9000]),
        "is cut off: it has 9000 of its 28672 bytes; .*sqlite3 BAG .recover"),
    "cut in its last bytes": (lambda bag: rewritten(x := bag / "bag.db3", x.read_bytes()[:-9]),
    "cut off: it has"),
    "zeroed": (lambda bag: rewritten(x := bag / "bag.db3",
    x.read_bytes()[:4096].ljust(x.stat().st_size, b"\0")),
        "the database is damaged .*sqlite3 BAG .recover"),
    "aliases": (lambda bag: rewritten(bag / DESCRIBED, b"a: &x [1]\nb: [*x, *x]").parent,
    "it has aliases"),
    "no bag": (lambda bag: changed(bag / "x.db3", "CREATE TABLE topics (id, name)"),
    "no such column: type.: no bag"),
    "no messages": (lambda bag: changed(bag / "bag.db3", "DROP TABLE messages"),
    "no such table: messages.: no bag"),
    "text": (lambda bag: rewritten(bag / "bag.db3", b"t,a\n1,2\n").parent,
    "neither a database of sqlite3 nor MCAP"),
    "other text": (lambda bag: rewritten(bag / "x.db3", b"t,a\n1,2\n"),
    "x.db3: not a bag in sqlite3 .it begins with"),
    "journal": (lambda bag: rewritten(bag / "bag.db3-journal", b"x").parent,
    "a journal is beside it"),
    "IDL": (lambda bag: changed(bag / "bag.db3",
    "UPDATE message_definitions SET encoding = 'ros2idl'"),
        "type 'lab_msgs/msg/Sample' is defined in IDL, which is not read; convert it"),
}  # fmt: skip


@pytest.mark.parametrize(("make", "said"), REFUSED.values(), ids=REFUSED)
def test_a_ros_2_bag_that_cannot_be_read_is_refused_with_what_helps(
    tmp_path: Path, make: Any, said: str
) -> None:
    assert re.search(said, refused(make(write_bag2(tmp_path / "bag"))))


def test_a_database_with_a_write_ahead_log_is_refused_and_reading_changes_no_file(
    tmp_path: Path,
) -> None:
    closed, killed = write_bag2(tmp_path / "bag"), tmp_path / "killed"
    changed(closed / "bag.db3", "PRAGMA journal_mode = WAL")
    with closing(sqlite3.connect(closed / "bag.db3")) as connection:
        connection.execute("UPDATE messages SET timestamp = timestamp")
        connection.commit()
        shutil.copytree(closed, killed)
    (closed / "bag.db3-wal").touch()  # empty
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}
    assert "a write-ahead log is beside it (bag.db3-wal)" in refused(killed)
    check_rows(read(closed))
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before


def without_definitions(bag: Path) -> Path:
    """A bag as it was before bags had definitions of their messages."""
    return changed(bag / f"{bag.name}.db3", "DROP TABLE message_definitions").parent


def standard_bag(folder: Path, kind: str, *fields: Any) -> Path:
    """Two messages of a standard type in a bag without definitions."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer2(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/lab", kind, typestore=store)
        for time in (5, 9):
            writer.write(connection, time, store.serialize_cdr(store.types[kind](*fields), kind))
    return without_definitions(folder)


def test_standard_types_are_known_and_undefined_ones_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = {
        "channels": {"theta": {"topic": "/lab", "field": "data", "unit": "rad"}},
        "time": {"source": "log"},
    }
    bag = standard_bag(tmp_path / "bag", "std_msgs/msg/Float64", 2.5)
    assert read(bag, **asked).samples["theta"].to_list() == [2.5, 2.5]
    types = get_typestore(Stores.ROS2_HUMBLE).types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), "")
    changing = standard_bag(
        tmp_path / "range", "sensor_msgs/msg/Range", header, 1, 0.1, 0.2, 3.0, 1.5
    )
    said = refused(changing, **asked)  # it has the field `variance` since ROS 2 Iron
    assert (
        "which differs between the distributions of ROS 2; convert it with `ros2 bag convert`"
        in said
    )
    said = refused(without_definitions(write_bag2(tmp_path / "own")))
    assert (
        "topic '/lab': the bag has no definition of type 'lab_msgs/msg/Sample', which is no"
        " standard one" in said
    )
    monkeypatch.setitem(sys.modules, "rosbags", None)
    monkeypatch.delitem(sys.modules, "rosbags.typesys")
    assert "needs rosbags, which is not installed; pip install 'osl-analysis[ros]'" in refused(
        bag, **asked
    )


def test_a_ros_1_bag_that_is_cut_joined_or_not_finished_is_refused_with_the_command_that_helps(
    tmp_path: Path,
) -> None:
    path = write_bag1(tmp_path / "a.bag", chunk=500)
    whole = path.read_bytes()
    place = whole.index(b"index_pos=") + len(b"index_pos=")
    index = int.from_bytes(whole[place : place + 8], "little")
    unfinished = whole[:place] + bytes(8) + whole[place + 8 :]
    for content in (unfinished[: index - 40], whole[: index - 40], whole[:-40], whole[:30]):
        said = refused(rewritten(path, content))
        assert (
            "the recorder did not finish, or the bag is damaged; run `rosbag reindex` on a copy"
            in said
        )
    assert "two bags were joined" in refused(rewritten(path, whole + whole))
    assert "not a ROS 1 bag of version 2.0 (it beg" in refused(
        rewritten(path, b"#ROSBAG V1.2\n" + whole[13:])
    )


def test_a_damaged_chunk_of_a_ros_1_bag_is_lost_as_a_whole_and_counted(tmp_path: Path) -> None:
    for packing in ("", "LZ4"):
        path = write_bag1(tmp_path / f"a{packing}.bag", range(2000), packing, 500)
        content = bytearray(path.read_bytes())
        place = content.index(b"\x04\x22\x4d\x18" if packing else b"time=", len(content) // 2)
        if packing:
            content[place + 20 : place + 200] = bytes(180)
        else:  # the length of a message
            content[place + 13 : place + 17] = (1 << 20).to_bytes(4, "little")
        recording = read(rewritten(path, content))
        lost = 2000 - len(recording.samples)
        assert 0 < lost <= 10
        assert (counts(recording)[1], recording.losses["chunks_lost"]) == (lost, 1)


@pytest.mark.parametrize("write", [write_bag1, write_bag2])
def test_a_clock_that_was_set_back_is_refused(tmp_path: Path, write: Any) -> None:
    """`rosbags` sorts by time and would interleave the halves."""
    path = write(tmp_path / "a.bag", [*range(100), *(20.3 + np.arange(100))])
    assert "the clock was set while recording" in refused(path, time={"source": "log"})


@pytest.mark.skipif(not REAL_DATA.is_dir(), reason="no recordings made by others here")
def test_a_real_ros_2_database_is_read_as_the_library_reads_it(tmp_path: Path) -> None:
    shutil.copy(REAL_DATA / "bag/rosbag2_test_0.db3", tmp_path)
    shutil.copy(REAL_DATA / "bag/rosbag2_test_metadata.yaml", tmp_path / DESCRIBED)
    recording = read(
        tmp_path,
        channels={"theta": {"topic": "/imu", "field": "angular_velocity.x", "unit": "rad"}},
    )
    assert counts(recording, "/imu") == (1565, 0)
    store, kind = get_typestore(Stores.ROS2_FOXY), "sensor_msgs/msg/Imu"
    query = (
        "SELECT data FROM messages WHERE topic_id = (SELECT id FROM topics WHERE name = '/imu')"
        " ORDER BY id"
    )
    with closing(sqlite3.connect(tmp_path / "rosbag2_test_0.db3")) as connection:
        messages: Any = [store.deserialize_cdr(data, kind) for (data,) in connection.execute(query)]
    np.testing.assert_array_equal(
        recording.samples["theta"], [one.angular_velocity.x for one in messages]
    )


def test_a_ros_1_message_has_the_length_of_its_definition() -> None:
    own = "Header header\nbyte level\nchar letter\ntime at\nduration[2] took\n"
    header = "===\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    kind = message_type(Schema(1, (own + header).encode(), "ros1msg", "lab/Odd"), ros1=True)
    payload = (7).to_bytes(4, "little") + bytes(8) + bytes(4) + b"\xff\xfe" + b"\xff" * 24
    shape = shape_of(kind, payload, ["header.seq", "level", "letter", "at.secs", "took[1].secs"])
    values = [one[0] for one in shape.read(np.array([payload], f"V{len(payload)}")).values()]
    assert values == [7, -1, 254, 2**32 - 1, -1]
    assert "took[1].nsecs" in shape.leaves
    for wrong in (payload + b"\0", payload[:-1]):
        with pytest.raises(InputError):
            shape_of(kind, wrong)
