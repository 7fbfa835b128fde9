# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 2: a database of sqlite3, or the folder of a recording in sqlite3 or MCAP.

The library `rosbags` gives messages in the order of their times, which would hide a clock that was
set back. Here they are read in the order in which they were recorded, by the rows of the database.
The library knows the definitions of standard messages.
"""

import sqlite3
from collections import Counter
from contextlib import closing, suppress
from operator import methodcaller
from pathlib import Path

import numpy as np
import yaml
from mcap.records import Schema
from rosbags.typesys import Stores, get_typestore

from osl_analysis.errors import InputError, listing, naming, on_one_line
from osl_analysis.formats import beginning, mcap
from osl_analysis.formats._messages import AT_ONCE, Log
from osl_analysis.recording import Format, Recording
from osl_analysis.source_file import MessageSource
from osl_analysis.yaml_settings import check_size, text_in

DESCRIPTION = "metadata.yaml"
SQLITE = b"SQLite format 3\0"
REINDEX = "write it again with `ros2 bag reindex`, or name one file of the recording"
RECOVER = (
    "if it is packed, unpack it with `zstd -d`; save what it holds with `sqlite3 BAG .recover |"
    " sqlite3 NEW`, or record it again"
)
STATED_SIZE = "SELECT page_count * page_size FROM pragma_page_count, pragma_page_size"  # bytes
TOPICS = "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
MESSAGES = (
    "SELECT timestamp, data FROM messages WHERE topic_id = ? AND typeof(timestamp) = 'integer' AND"
    " typeof(data) = 'blob' ORDER BY id"
)
DEFINITIONS = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"


class Database(Log):
    """The databases of a recording."""

    def take_file(self, path: Path) -> None:
        """Read the messages of a database in the order of its rows."""
        _check_finished(path)
        address = f"{path.absolute().as_uri()}?mode=ro&immutable=1"  # writes no file beside it
        try:
            with closing(sqlite3.connect(address, uri=True)) as connection:
                (size,) = connection.execute(STATED_SIZE).fetchone()
                if path.stat().st_size < size:  # sqlite would fill the last page up with zeros
                    raise sqlite3.DatabaseError(f"{size} bytes are stated")
                self._take_rows(connection)
        except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
            raise InputError(
                f"no bag of ROS 2, or one that is damaged or cut off ({error}); {RECOVER}"
            ) from error

    def _take_rows(self, connection: sqlite3.Connection) -> None:
        definitions = {}
        with suppress(sqlite3.OperationalError):  # bags have them since ROS 2 Iron
            for kind, encoding, text in connection.execute(DEFINITIONS):
                definitions[kind] = (encoding, text)
        topics = connection.execute(TOPICS).fetchall()
        for number, (key, name, kind, form) in enumerate(topics):
            encoding, text = definitions.get(kind) or _standard_definition(kind)
            self.declare(number, name, form, Schema(0, text.encode(), encoding, kind))
            cursor = connection.execute(MESSAGES, (key,))
            while rows := cursor.fetchmany(AT_ONCE):
                times_ns, payloads = zip(*rows, strict=True)
                lengths = np.array([len(payload) for payload in payloads])
                messages = (b"".join(payloads), np.cumsum(lengths) - lengths, lengths)
                self.add(np.full_like(lengths, number), messages, np.array(times_ns))


def _standard_definition(kind: str) -> tuple[str, str]:
    """Encoding and text of the definition of a standard type, in the newest distribution of ROS 2:
    a message of another one has another length, and is refused. Empty if it is none."""
    store = get_typestore(Stores.LATEST)
    if kind not in store.types:
        return "", ""
    return "ros2msg", str(store.generate_msgdef(kind, ros_version=2)[0])


def read_database(path: Path, source: MessageSource | None) -> Recording:
    """Read a database, or the parts of a folder one after the other."""
    parts = [path]
    counts: Counter[str] = Counter()
    if path.is_dir():
        parts, counts = _described(path)
    is_mcap = all(beginning(part).startswith(mcap.MAGIC) for part in parts)
    log = mcap.Log(source) if is_mcap else Database(source)
    for part in parts:
        with naming(part):
            log.take_file(part)
    log.expected = counts
    return log.recording("rosbag2")


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
    except InputError:
        raise
    except (yaml.YAMLError, RecursionError, LookupError, TypeError, ValueError) as error:
        reason = on_one_line(error)[:120]
        raise InputError(
            f"{path}: not the description of a ROS 2 bag ({reason}); {REINDEX}"
        ) from error
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        raise InputError(
            f"{folder}: {len(missing)} of the {len(files)} files that {DESCRIPTION} lists are"
            f" missing ({listing(missing)}); copy them there, or {REINDEX}"
        )
    return files, counts


def _check_finished(path: Path) -> None:
    """Refuse a database with messages in a log of changes beside it."""
    for ending in ("-wal", "-journal"):
        beside = path.with_name(path.name + ending)
        if beside.is_file() and beside.stat().st_size:
            raise InputError(
                f"{beside.name} is beside it: the recorder did not finish, and messages are in"
                " there; copy both elsewhere, and run `sqlite3 COPY 'PRAGMA"
                " wal_checkpoint(TRUNCATE)'` there"
            )


def _files_in(path: Path) -> list[Path]:
    """The description of a folder and the files that it lists."""
    return [path / DESCRIPTION, *_described(path)[0]] if path.is_dir() else [path]


ROSBAG2 = Format(
    name="rosbag2",
    suffixes=(".db3", ".bag"),  # of ROS 1, to say how they are converted
    begins=methodcaller("startswith", SQLITE),
    source=MessageSource,
    read=read_database,
    is_folder=lambda path: (path / DESCRIPTION).is_file(),
    files_in=_files_in,
)
