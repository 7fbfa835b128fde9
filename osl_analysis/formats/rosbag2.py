# SPDX-License-Identifier: Apache-2.0
"""Recordings of ROS 2: a folder with its description and its parts, in MCAP or sqlite3, or one part
in sqlite3 alone.

The tables of sqlite3 are read in their order: the reader of `rosbags` sorts by time, which would
hide a clock that was set back. `rosbags` defines the types of recorders that store no definitions,
which are those of ROS 2 up to Humble.
"""

import sqlite3
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from functools import cache
from operator import methodcaller
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.records import Schema
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from osl_analysis.base.errors import InputError, listing, naming, on_one_line, shortened
from osl_analysis.base.recording import Format, Recording
from osl_analysis.base.source_file import MessageSource
from osl_analysis.base.yaml_settings import check_size, text_in
from osl_analysis.formats import mcap
from osl_analysis.formats.reading import beginning, in_one_sentence
from osl_analysis.formats.topic_log import TopicLog

DESCRIPTION = "metadata.yaml"
REINDEX = "write it again with `ros2 bag reindex`, or name one file of the recording"
CONVERT = (
    "convert the recording with `rosbags-convert --src FOLDER --dst NEW --dst-storage mcap`, which"
    " stands beside `osl-analysis`"
)
SQLITE = b"SQLite format 3\0"
COMPRESSED = b"\x28\xb5\x2f\xfd"  # of zstd, the one compression of rosbag2
ROWS_AT_ONCE = 50_000  # messages of a table; a joint's state of 300 bytes then takes 15 MB
LAST_WITHOUT_DEFINITIONS = Stores.ROS2_HUMBLE  # later recorders store them


class Rosbag2Log(mcap.McapLog):
    """Parts in MCAP or sqlite3 that are read one after the other."""

    def take_part(self, path: Path) -> None:
        """Read a part by what it begins with."""
        begin = beginning(path)
        if begin.startswith(COMPRESSED):
            raise InputError(
                "is compressed as a whole by zstd", f"run `zstd -d {path.name}`, or {CONVERT}"
            )
        if begin.startswith(SQLITE):
            take_tables(self, path)
        elif begin.startswith(mcap.MAGIC):
            self.take_file(path)
        else:
            raise InputError("is neither MCAP nor sqlite3", f"copy it again, or {CONVERT}")


def take_tables(log: TopicLog, path: Path) -> None:
    """Read the tables of a part in sqlite3.

    Raises
    ------
    InputError
        It is no recording of ROS 2, or its last messages stand in another file.
    """
    for ending in ("-wal", "-journal"):
        unfinished = path.with_name(path.name + ending)
        if unfinished.is_file() and unfinished.stat().st_size:
            raise InputError(
                f"its last messages are in {unfinished.name}: the recorder did not finish",
                f"put both into one with `sqlite3 {path.name} 'PRAGMA wal_checkpoint(TRUNCATE)'`",
            )
    address = f"{path.resolve().as_uri()}?immutable=1"  # else it would write beside the file
    with closing(sqlite3.connect(address, uri=True)) as tables:
        names = {name for (name,) in tables.execute("SELECT name FROM sqlite_master")}
        if not {"topics", "messages"} <= names:
            raise InputError(
                "is a database without the tables topics and messages", "name a recording of ROS 2"
            )
        definitions = {}
        if "message_definitions" in names:
            query = (
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            )
            definitions = {row[0]: row[1:] for row in tables.execute(query)}
        query = "SELECT id, name, type, serialization_format FROM topics"
        for number, topic, type_name, encoding in tables.execute(query):
            schema = _schema_of(type_name, *definitions.get(type_name, ("", "")))
            log.declare_channel(number, topic, encoding, schema)
        for rows in _rows_in_order(tables):
            channels, log_times_ns, messages = zip(*rows, strict=True)
            lengths = np.array([len(message) for message in messages])
            starts = np.cumsum(lengths) - lengths
            log.add_messages(
                (b"".join(messages), starts, lengths),
                np.array(log_times_ns, np.int64),
                np.array(channels),
            )


def _rows_in_order(tables: sqlite3.Connection) -> Iterator[list[Any]]:
    """The rows of messages as they were recorded, some at once."""
    cursor = tables.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id")
    while rows := cursor.fetchmany(ROWS_AT_ONCE):
        yield rows


def _schema_of(type_name: str, encoding: str, definition: str) -> Schema:
    """The definition of a type by the recording, or else by ROS 2; empty where neither has it."""
    if definition:
        return Schema(0, definition.encode(), encoding, type_name)
    types = _types_of_ros()
    if type_name not in types.fielddefs:
        return Schema(0, b"", "", type_name)
    text, _ = types.generate_msgdef(type_name, ros_version=2)
    return Schema(0, text.encode(), "ros2msg", type_name)


@cache
def _types_of_ros() -> Typestore:
    return get_typestore(LAST_WITHOUT_DEFINITIONS)


def read(path: Path, source: MessageSource | None) -> Recording:
    """Read the parts of a folder one after the other, or one part alone."""
    log = Rosbag2Log(source)
    if not path.is_dir():
        log.take_part(path)
        return log.recording("rosbag2", log.read)
    parts, counts = _described(path)
    for part in parts:
        with naming(part), in_one_sentence():
            log.take_part(part)
    return log.recording("rosbag2", counts)


def _described(folder: Path) -> tuple[list[Path], Counter[str]]:
    """The files of a recording in its order, and the messages of each topic in all of them.

    Raises
    ------
    InputError
        The description in the folder cannot be read, or files are missing.
    """
    path = folder / DESCRIPTION
    counts: Counter[str] = Counter()
    try:
        text = path.read_text(encoding="utf-8")
        with naming(path):
            check_size(text)
        about = yaml.load(text, yaml.CSafeLoader)["rosbag2_bagfile_information"]
        # older ones begin with the folder
        files = [folder / Path(name).name for name in about["relative_file_paths"]]
        for topic in about["topics_with_message_count"]:
            counts[text_in(topic["topic_metadata"]["name"])] += int(topic["message_count"])
        compressed = text_in(about.get("compression_mode"))
    except InputError:
        raise
    except (yaml.YAMLError, RecursionError, LookupError, TypeError, ValueError) as error:
        reason = shortened(on_one_line(error))
        raise InputError(
            f"{path}: not the description of a ROS 2 bag ({reason})", REINDEX
        ) from error
    if compressed.upper() == "MESSAGE":
        raise InputError(f"{path}: each message is compressed on its own", CONVERT)
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        raise InputError(
            f"{folder}: {len(missing)} of the {len(files)} files that {DESCRIPTION} lists are"
            f" missing ({listing(missing)})",
            f"copy them there, or {REINDEX}",
        )
    return files, counts


FORMAT = Format(
    name="rosbag2",
    suffixes=(".db3",),
    begins=methodcaller("startswith", SQLITE),
    source=MessageSource,
    read=read,
    is_folder=lambda path: (path / DESCRIPTION).is_file(),
    files_in=lambda path: [path / DESCRIPTION, *_described(path)[0]],
)
