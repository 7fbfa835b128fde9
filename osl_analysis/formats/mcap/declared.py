"""The channels and schemas of an MCAP file, by their numbers."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from osl_analysis.formats.mcap.limits import RefusedFileError
from osl_analysis.formats.mcap.walk import Buffer

Meaning = tuple[object, ...]


@dataclass
class Declared:
    """What the numbers of a file's channels and schemas mean. A number means one thing throughout a file."""

    channels: dict[int, Channel] = field(default_factory=dict)
    """Channels by number."""
    schemas: dict[int, Schema] = field(default_factory=dict)
    """Schemas by number."""
    meanings: dict[tuple[int, int], Meaning] = field(default_factory=dict)
    """What each record means, by opcode and number."""
    provisional: set[tuple[int, int]] = field(default_factory=set)
    """Records that only a summary without a checksum has had so far."""
    seen: set[bytes] = field(default_factory=set)
    """Contents that were read; recorders repeat them in every chunk."""

    def adopt(self, buffer: Buffer, records: list[tuple[int, int, int]], *, provisional: bool) -> Iterator[str]:
        """Take in records (opcode, start, end); yields a remark for each that cannot be read.

        `provisional` records give way to others of the same number.

        Raises
        ------
        RefusedFileError
            A number has two meanings: the file is two logs, or damaged.
        """
        for opcode, start, end in records:
            content = bytes(buffer[start:end])
            if bytes([opcode]) + content in self.seen:
                continue
            stream = ReadDataStream(BytesIO(content))
            try:
                one = Schema.read(stream) if opcode == Opcode.SCHEMA else Channel.read(stream)
            except Exception:  # the library raises many kinds of errors on damaged bytes
                yield "a schema or a channel cannot be read"
                continue
            if self.take(opcode, one, provisional):
                self.seen.add(bytes([opcode]) + content)

    def take(self, opcode: int, one: Channel | Schema, provisional: bool) -> bool:
        """Take in one record; whether it is certain."""
        key, meaning = (opcode, one.id), meaning_of(one)
        known = self.meanings.get(key, meaning)
        if known != meaning and key not in self.provisional and not provisional:
            what = "channel" if isinstance(one, Channel) else "schema"
            raise RefusedFileError(
                f"{what} {one.id} is {known[0]!a} in one part of the file and {meaning[0]!a} in another: two logs were "
                "joined, or the file is damaged; record again, or give each log a file of its own"
            )
        if known == meaning or not provisional:
            self.meanings[key] = meaning
            self.channels.update({one.id: one} if isinstance(one, Channel) else {})
            self.schemas.update({one.id: one} if isinstance(one, Schema) else {})
            (self.provisional.add if provisional else self.provisional.discard)(key)
        return not provisional


def meaning_of(one: Channel | Schema) -> Meaning:
    """What the numbers in messages mean by a record; the first entry is its name."""
    if isinstance(one, Channel):
        return one.topic, one.message_encoding, one.schema_id
    return one.name, one.encoding, one.data
