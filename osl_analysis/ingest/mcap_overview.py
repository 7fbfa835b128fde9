"""What an MCAP file holds, read record by record with the `mcap` package, past whatever is damaged."""

import json
import struct
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.stream_reader import get_chunk_data_stream

from osl_analysis.errors import InputError
from osl_analysis.formats.messages.ros2_schema import parse_schema, short_name
from osl_analysis.ingest.overview import Channel, Overview, gaps_of, rate_of

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # opcode, length of the content
MESSAGE = struct.Struct("<HIQ")  # channel, sequence, log time
LARGEST_CHUNK = 1 << 30  # bytes; what claims more is damaged, or a bomb
DEEPEST = 8  # messages within messages that are listed: a schema may hold itself
MOST_FIELDS = 500  # of one topic

Record = TypeVar("Record", records.Schema, records.Channel, records.Chunk)


@dataclass
class Tally:
    """What was found on the way: declarations by id, stamps [ns] and the first message's bytes by channel."""

    schemas: dict[int, records.Schema] = field(default_factory=dict)
    channels: dict[int, records.Channel] = field(default_factory=dict)
    stamps: dict[int, list[int]] = field(default_factory=lambda: defaultdict(list))
    first: dict[int, bytes] = field(default_factory=dict)
    chunks: int = 0
    unverified: int = 0
    finished: bool = False
    remarks: list[str] = field(default_factory=list)


def inspect_mcap(path: Path) -> Overview:
    """Topics with schema, encoding, rate and gaps, every field of each, and what is damaged."""
    tally = Tally()
    data = path.read_bytes()
    add_records(data, len(MAGIC), tally)
    if not tally.finished:
        tally.remarks.append("no footer: the recorder did not finish, or the end of the file is lost")
    if tally.unverified:
        tally.remarks.append(f"{tally.unverified} of {tally.chunks} chunks have no checksum: damage cannot be excluded")
    channels = [channel for number in tally.channels for channel in channels_of(tally, number)]
    messages = sum(len(stamps) for stamps in tally.stamps.values())
    facts = {"bytes": str(len(data)), "chunks": str(tally.chunks), "messages": str(messages)}
    stamped = any(channel.address.get("field", "").startswith("header.stamp") for channel in channels)
    channels = [c for c in channels if not c.address.get("field", "").startswith("header.")]
    settings = {"clock": "master", "time": {"source": "header" if stamped else "log"}}
    return Overview("mcap", facts, channels, tally.remarks, settings)


def add_records(data: bytes, begin: int, tally: Tally) -> None:
    """Take in the records from `begin` on, up to the end or to where they make no sense."""
    for opcode, start, end in walk(data, begin, tally):
        content = data[start:end]
        try:
            if opcode == Opcode.MESSAGE:
                number, _, stamp = MESSAGE.unpack_from(content)
                tally.stamps[number].append(stamp)
                tally.first.setdefault(number, content[22:])
            elif opcode == Opcode.SCHEMA:
                schema = records.Schema.read(ReadDataStream(BytesIO(content)))
                tally.schemas.setdefault(schema.id, schema)
            elif opcode == Opcode.CHANNEL:
                channel = records.Channel.read(ReadDataStream(BytesIO(content)))
                tally.channels.setdefault(channel.id, channel)
            elif opcode == Opcode.CHUNK:
                add_chunk(content, start, tally)
            elif opcode == Opcode.FOOTER:
                tally.finished = True
        except Exception as error:  # whatever the packages stumble over in damaged bytes
            tally.remarks.append(f"the record at byte {start} is damaged ({type(error).__name__}: {error})")


def walk(data: bytes, position: int, tally: Tally) -> Iterator[tuple[int, int, int]]:
    """Opcode, begin and end of the content of every record, until one reaches beyond the end."""
    while position + HEAD.size <= len(data) and data[position : position + 8] != MAGIC:
        opcode, length = HEAD.unpack_from(data, position)
        start = position + HEAD.size
        if start + length > len(data):
            tally.remarks.append(f"the record at byte {position} reaches beyond the end: what follows is not listed")
            return
        yield opcode, start, start + length
        position = start + length


def add_chunk(content: bytes, start: int, tally: Tally) -> None:
    """Take in the records of a chunk, if its checksum is right."""
    chunk = records.Chunk.read(ReadDataStream(BytesIO(content)))
    tally.chunks += 1
    tally.unverified += chunk.uncompressed_crc == 0
    size = zstandard.frame_content_size(chunk.data) if chunk.compression == "zstd" else 0
    if max(chunk.uncompressed_size, size) > LARGEST_CHUNK:
        raise InputError(f"a chunk that claims {max(chunk.uncompressed_size, size)} bytes")
    if chunk.compression not in ("", "zstd", "lz4"):
        raise InputError(f"compression {chunk.compression} is not known")
    inner, _ = get_chunk_data_stream(chunk, validate_crc=True)
    add_records(inner.read(chunk.uncompressed_size), 0, tally)


def channels_of(tally: Tally, number: int) -> Iterator[Channel]:
    """A channel's fields; the topic alone where they cannot be told."""
    declared = tally.channels[number]
    schema = tally.schemas.get(declared.schema_id)
    stamps = np.array(tally.stamps.get(number, []), dtype=np.float64) / 1e9
    type_name = f"{schema.name} ({declared.message_encoding})" if schema else declared.message_encoding
    rate = rate_of(stamps)
    try:
        fields = fields_of(declared.message_encoding, schema, tally.first.get(number))
    except Exception as error:  # a schema is the file's own text
        fields = []
        tally.remarks.append(f"topic {declared.topic}: its fields cannot be told ({type(error).__name__}: {error})")
    for name in fields or [""]:
        address = {"topic": declared.topic, **({"field": name} if name else {})}
        yield Channel(type_name, address, "", stamps.size, rate, gaps_of(stamps) or ("" if stamps.size else "empty"))


def fields_of(encoding: str, schema: records.Schema | None, first: bytes | None) -> list[str]:
    """Dotted paths of the numbers in a message: by the schema for ROS 2, by the first message for JSON."""
    if encoding == "json":
        return list(islice(json_paths(json.loads(first), ""), MOST_FIELDS)) if first else []
    if schema is None or schema.encoding != "ros2msg":
        return []
    definitions = parse_schema(schema.name, schema.data.decode(errors="replace"))
    return list(islice(ros2_paths(definitions, short_name(schema.name), "", 0), MOST_FIELDS))


def json_paths(value: Any, path: str) -> Iterator[str]:
    """Dotted paths of the numbers in a JSON value; of an array, of its first element."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from json_paths(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list):
        yield from json_paths(value[0], f"{path}[0]") if value else ()
    elif isinstance(value, int | float):
        yield path


def ros2_paths(definitions: Any, name: str, path: str, depth: int) -> Iterator[str]:
    """Dotted paths of the numbers in a ROS 2 message; of an array, of its first element."""
    for part in definitions[name]:
        where = f"{path}.{part.name}" if path else part.name
        where = where if part.array is None else f"{where}[0]"
        if part.type in definitions and depth < DEEPEST:
            yield from ros2_paths(definitions, part.type, where, depth + 1)
        elif part.type not in ("string", "wstring"):
            yield where
