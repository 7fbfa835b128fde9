"""Small bags of ROS 1 and ROS 2, written by the library `rosbags`, independent of the readers under test."""

import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import yaml
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

SAMPLE = "std_msgs/Header header\nfloat32 angle\nstring state\nfloat64[] torque\nbool sync\n"
KIND = "lab_msgs/msg/Sample"
STEP = 1_000_000
START = 1_700_000_000_000_000_000
LATE = 250_000
"""By which a message was received after its stamp [ns]."""


@contextmanager
def edited(database: Path) -> Iterator[sqlite3.Connection]:
    """An SQLite file to be changed: committed and closed at the end."""
    with closing(sqlite3.connect(database)) as connection, connection:
        yield connection


def typestore(ros: int):  # type: ignore[no-untyped-def]
    """Known types of ROS 1 or ROS 2, with our own one."""
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(SAMPLE, KIND))
    return store


def sample(store, row: int, ros: int):  # type: ignore[no-untyped-def]
    """The message of one row: an angle of `row` degrees, torques of -row / 2 and row [N*m]."""
    stamp = START + row * STEP
    time = store.types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    header = store.types["std_msgs/msg/Header"](*[row] * (ros == 1), time, "lab")
    state = "stance" if row % 3 else "swing"  # messages of two lengths
    return store.types[KIND](header, float(row), state, np.array([-row / 2, row]), row % 2 == 0)


def write_bag1(path: Path, rows: Iterable[float] = range(50), compression: str = "", chunk: int = 0) -> Path:
    """A bag of ROS 1 with the topic /lab; `chunk` is the size of its chunks [bytes]."""
    store = typestore(1)
    writer = Writer1(path)
    if compression:
        writer.set_compression(Writer1.CompressionFormat[compression])
    if chunk:
        writer.chunk_threshold = chunk
    with writer:
        connection = writer.add_connection("/lab", KIND, typestore=store)
        for row in rows:
            data = store.serialize_ros1(sample(store, int(row), 1), KIND)
            writer.write(connection, START + int(row * STEP) + LATE, data)
    return path


def write_bag2(
    folder: Path, rows: Iterable[float] = range(50), storage: str = "SQLITE3", compression: str = ""
) -> Path:
    """A folder with a bag of ROS 2 with the topic /lab."""
    store = typestore(2)
    writer = Writer2(folder, version=9, storage_plugin=StoragePlugin[storage])
    if compression:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/lab", KIND, typestore=store)
        for row in rows:
            data = store.serialize_cdr(sample(store, int(row), 2), KIND)
            writer.write(connection, START + int(row * STEP) + LATE, data)
    return folder


def write_split(folder: Path, storage: str = "SQLITE3") -> Path:
    """A recording of 50 messages in two parts, as `ros2 bag record --max-bag-size` leaves it."""
    ending = "db3" if storage == "SQLITE3" else "mcap"
    described = []
    folder.mkdir()
    for number, rows in enumerate((range(30), range(30, 50))):
        part = write_bag2(folder.with_name(f"part{number}"), rows, storage)
        (file,) = part.glob(f"*.{ending}")
        file.rename(folder / f"bag_{number}.{ending}")
        described.append(yaml.safe_load((part / "metadata.yaml").read_text()))
    whole = described[0]["rosbag2_bagfile_information"]
    whole["relative_file_paths"] = [f"bag_{number}.{ending}" for number in range(2)]
    whole["message_count"] = 50
    whole["topics_with_message_count"][0]["message_count"] = 50
    (folder / "metadata.yaml").write_text(yaml.safe_dump(described[0]))
    return folder
