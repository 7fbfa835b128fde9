"""The top level of a ROS 1 bag: its chunks, its index, and what stands between them."""

import mmap
import os
from collections import Counter
from pathlib import Path

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap.limits import Budget, RefusedFileError
from osl_analysis.formats.mcap.mcap_file import HELD
from osl_analysis.formats.rosbag1.bag import REMEDY, Bag, Section
from osl_analysis.formats.rosbag1.records import (
    BAG,
    CHUNK,
    CHUNK_INFO,
    CONNECTION,
    MESSAGE,
    Buffer,
    Record,
    is_cut_off,
    record_at,
)

MAGIC = b"#ROSBAG V2.0\n"
ANY_VERSION = b"#ROSBAG V"
PAIR = 8  # bytes of the number of a connection and of its messages in a chunk


def read_bag(path: Path) -> Bag:
    """Scan a ROS 1 bag; its messages are read by `blocks`.

    Raises
    ------
    InputError
        The file is empty, no bag, of another version, encrypted, or two bags.
    """
    with path.open("rb") as file:
        is_held = os.fstat(file.fileno()).st_size <= HELD
        data: Buffer = file.read() if is_held else mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    if data[: len(ANY_VERSION)] != ANY_VERSION:
        raise InputError(
            f"{path}: not a ROS 1 bag (it begins with {data[:8]!r}); check the path and the source's format"
        )
    if data[: len(MAGIC)] != MAGIC:
        version = data[: len(MAGIC)].decode("latin1").strip()
        raise InputError(
            f"{path}: a bag that begins with {version!a}, not with version 2.0; convert it with `rosbag fix`"
        )
    bag = Bag(path, data, Budget(len(data), remedy=REMEDY))
    try:
        scan_bag(bag)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return bag


def scan_bag(bag: Bag) -> None:
    """Find the chunks, and what the index says of them."""
    data = bag.data
    head = record_at(data, len(MAGIC))
    if head is None or head.op != BAG:
        raise InputError("the header of the bag is damaged; run `rosbag reindex` on a copy, or record again")
    if head.fields.get(b"encryptor"):
        raise InputError(f"the bag is encrypted ({head.fields[b'encryptor'][:40]!r}); run `rosbag decrypt` first")
    index = head.number(b"index_pos", 8)
    finished = 0 < index <= len(data) and take_index(bag, index, head)
    bag.damage.finished = finished
    bag.damage.bytes = (index if finished else len(data)) - len(MAGIC)
    if finished:
        bag.damage.declared = bag.by_channel(sum(bag.counts.values(), Counter[int]()))
        bag.damage.declared_messages = bag.damage.declared.total()
        bag.damage.declared_chunks = head.number(b"chunk_count")
    else:
        what = "index at its end" if not index else "whole index"
        bag.damage.remark(f"no {what}: the recorder did not finish, or the end is lost; how much is not known")
    find_chunks(bag, head.end, index if finished else len(data))
    bag.damage.gaps = any(section.chunk is None for section in bag.sections)


def take_index(bag: Bag, position: int, head: Record) -> bool:
    """Take in the connections and chunks that the index lists; whether it is whole."""
    connections, chunks = head.number(b"conn_count"), head.number(b"chunk_count")
    while position < len(bag.data):
        record = record_at(bag.data, position)
        if record is None or record.op not in (CONNECTION, CHUNK_INFO):
            return False
        if record.op == CONNECTION:
            bag.declare(bag.data, record)
            connections -= 1
        else:
            count = (record.end - record.start) // PAIR
            pairs = np.frombuffer(bag.data[record.start : record.start + count * PAIR], "<u4").reshape(-1, 2)
            bag.counts[record.number(b"chunk_pos", 8)] = Counter(dict(pairs.tolist()))
            chunks -= 1
        position = record.end
    return connections == 0 and chunks == 0


def find_chunks(bag: Bag, position: int, end: int) -> None:
    """Find the chunks between two bytes. After bytes that are no record, the next chunk is where the index says.

    Raises
    ------
    RefusedFileError
        A second bag begins there.
    """
    while position < end:
        record = record_at(bag.data, position)
        if record is not None and record.end <= end:
            if record.op in (CHUNK, MESSAGE):
                bag.sections.append(Section(position, record.end, record if record.op == CHUNK else None))
            elif record.op == CONNECTION:
                bag.declare(bag.data, record)
            position = record.end
            continue
        if bag.data[position : position + len(MAGIC)] == MAGIC:
            raise RefusedFileError(f"two bags were joined: a second one begins at byte {position}; give each a file")
        after = min((at for at in bag.counts if at > position), default=end)
        is_empty = not bag.data[position:after].strip(b"\0")  # some writers leave room before the index
        expected = not bag.damage.finished and after == end and is_cut_off(bag.data, position)
        if not is_empty and not expected:
            bag.sections.append(Section(position, after, None))
        position = after
