# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1 and of ROS 2 in sqlite3, written by the library `rosbags`: states of a joint."""

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STATE = "sensor_msgs/msg/JointState"
LAB_STATE = "lab_msgs/msg/JointState"
TOPIC = "/joint_states"
LATE_NS = 1_000_000  # from a stamp to its logging


def angle_of(rows: np.ndarray) -> np.ndarray:
    return 0.1 * np.sin(rows / 7)


def stamps_of(rows: np.ndarray) -> np.ndarray:
    """Stamps [ns] of messages at 1 kHz, one of which the recorder's clock logs in the past."""
    return 1_700_000_000_000_000_000 + rows * 1_000_000


def write_bag(
    path: Path, rows: range, version: int, is_typed_by_lab: bool = False, **options: object
) -> Path:
    """Write a message per row; those of a laboratory's own type have the fields of a joint's
    state."""
    types = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    name = LAB_STATE if is_typed_by_lab else STATE
    if is_typed_by_lab:
        text, _ = types.generate_msgdef(STATE, ros_version=2)
        types.register(get_types_from_msg(text, LAB_STATE))
    writer = Writer1(path) if version == 1 else Writer2(path, version=9, **options)
    if version == 1 and "compression" in options:
        writer.set_compression(options["compression"])
        writer.chunk_threshold = 2000  # bytes: some chunks
    classes = types.types
    with writer:
        connection = writer.add_connection(TOPIC, name, typestore=types)
        for row, stamp in zip(rows, stamps_of(np.array(rows)).tolist(), strict=True):
            angle = np.array([angle_of(row)])
            time = classes["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
            head = {"stamp": time, "frame_id": "lab"} | ({"seq": row} if version == 1 else {})
            state = classes[name](
                header=classes["std_msgs/msg/Header"](**head),
                name=["ankle"],
                position=angle,
                velocity=0 * angle,
                effort=-30 * angle,
            )
            serialise = types.serialize_ros1 if version == 1 else types.serialize_cdr
            writer.write(connection, stamp + LATE_NS, serialise(state, name))
    return path


def write_sqlite(path: Path, rows: range, is_typed_by_lab: bool = False) -> Path:
    """A folder with one part in sqlite3, with definitions."""
    return write_bag(path, rows, 2, is_typed_by_lab, storage_plugin=StoragePlugin.SQLITE3)


def change_tables(folder: Path, *statements: str) -> None:
    """Change the tables of the first part of a folder."""
    with closing(sqlite3.connect(next(folder.glob("*.db3")))) as tables:
        for statement in statements:
            tables.execute(statement)
        tables.commit()
