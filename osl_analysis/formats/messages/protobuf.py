"""Protobuf messages: the walk through one message, which finds where its numbers are, by its descriptor.

The guards are tags, lengths, and the ends of varints. Groups, arrays in pieces, and enumerations that refuse unknown
values have no template; google.protobuf decodes them.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message import DecodeError, Message
from mcap.exceptions import McapError
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory

from osl_analysis.errors import InputError
from osl_analysis.formats.messages.description import FieldDescription, describe_walk
from osl_analysis.formats.messages.effort import Effort
from osl_analysis.formats.messages.leaves import Constant, Leaf, Varint
from osl_analysis.formats.messages.one_by_one import Numbers, numbers_at
from osl_analysis.formats.messages.templates import ByShape, MessageWalk, Template, template_of

FIXED = {1: "<f8", 2: "<f4", 6: "<u8", 7: "<u4", 15: "<i4", 16: "<i8"}  # by FieldDescriptor.TYPE_...
VARINTS = {3: "i8", 4: "u8", 5: "i4", 8: "?", 13: "u4", 14: "i4", 17: "zigzagi4", 18: "zigzagi8"}
STRING, GROUP, MESSAGE, ENUM = 9, 10, 11, 14
VARINT, BITS64, LENGTH, BITS32 = 0, 1, 2, 5  # wire types
DEEPEST = 100
MOST_LEAVES = 4096


class NoTemplateError(InputError):
    """The message may be sound, but no template can describe it."""


@dataclass
class ProtobufWalk(MessageWalk):
    """The walk through one protobuf message."""

    wanted: frozenset[str] = frozenset()
    """Paths of the fields that will be read."""
    effort: Effort = field(default_factory=Effort)
    """How many fields may still be walked."""
    counts: Counter[str] = field(default_factory=Counter)
    """Elements so far of each array, by path."""

    def varint(self, end: int, guards: list[int]) -> tuple[int, int]:
        """Value and size of the varint at the position; the offsets of its bytes are added to `guards`."""
        value, start = 0, self.position
        for i in range(10):
            if start + i >= end:
                break
            byte = self.payload[start + i]
            value |= (byte & 0x7F) << (7 * i)
            if byte < 0x80:
                self.position = start + i + 1
                guards += range(start, self.position)
                return value, i + 1
        raise protobuf_misfit(self.payload)

    def skip(self, size: int, end: int) -> range:
        """Extent of the next `size` bytes."""
        extent = range(self.position, self.position + size)
        if extent.stop > end:
            raise protobuf_misfit(self.payload)
        self.position = extent.stop
        return extent

    def message(self, kind: Descriptor, end: int, prefix: str, depth: int = 0) -> None:
        """Walk the fields of a message up to `end`; a field that is not written is zero, unless it is optional."""
        if depth > DEEPEST or len(self.leaves) > MOST_LEAVES:
            raise NoTemplateError(
                f"a message of {len(self.payload)} bytes is nested too deeply or too long for a template"
            )
        for item in kind.fields:
            if not item.is_repeated and not item.has_presence and item.type in FIXED | VARINTS:
                self.leaves.setdefault(prefix + item.name, Constant(dtype_of(item)))
        while self.position < end:
            self.effort.take()
            tag, _ = self.varint(end, self.guards)
            number, wire = tag >> 3, tag & 7
            item = kind.fields_by_number.get(number)
            if number == 0:
                raise protobuf_misfit(self.payload)
            self.one_of(item, prefix)
            self.one_field(item, wire, end, prefix, depth)

    def one_of(self, item: FieldDescriptor | None, prefix: str) -> None:
        """Refuse a `oneof` that is written twice: its last field counts, which no template can describe."""
        others = item.containing_oneof.fields if item is not None and item.containing_oneof else ()
        taken = tuple(prefix + other.name for other in others if item is None or other.number != item.number)
        for path in self.leaves if taken else ():
            if path in taken or path.startswith(tuple(f"{one}." for one in taken)):
                raise NoTemplateError(f"field '{path}' of a oneof is written and then replaced")

    def one_field(self, item: FieldDescriptor | None, wire: int, end: int, prefix: str, depth: int) -> None:
        """Walk over the value of one field, and note it if the descriptor knows the field."""
        kind = item.type if item is not None else 0
        if wire == VARINT:
            start = self.position
            _, size = self.varint(end, self.continued)
            if item is not None and kind in VARINTS:
                self.note(item, prefix, Varint(start, size, VARINTS[kind]))
        elif wire in (BITS32, BITS64):
            extent = self.skip(8 if wire == BITS64 else 4, end)
            if item is not None and kind in FIXED and len(extent) == int(FIXED[kind][-1]):
                self.note(item, prefix, Leaf(extent.start, FIXED[kind]))
        elif wire == LENGTH:
            size, _ = self.varint(end, self.guards)
            extent = self.skip(size, end)
            if item is not None:
                self.of_length(item, extent, prefix, depth)
        else:
            raise NoTemplateError(f"a group, or an invalid tag, in a message of {len(self.payload)} bytes")

    def of_length(self, item: FieldDescriptor, extent: range, prefix: str, depth: int) -> None:
        """A string, a message or a packed array."""
        path = prefix + item.name
        if item.type == STRING and item.is_repeated:
            self.texts[self.element(path)] = extent
        elif item.type == MESSAGE and not item.message_type.GetOptions().map_entry:
            self.position = extent.start
            own = self.element(path) if item.is_repeated else path
            self.message(item.message_type, extent.stop, f"{own}.", depth + 1)
        elif item.is_repeated and item.type in FIXED:
            self.packed(path, FIXED[item.type], extent)
        elif item.is_repeated and item.type in VARINTS:
            self.position = extent.start
            while self.position < extent.stop:
                self.effort.take()
                self.one_field(item, VARINT, extent.stop, prefix, depth)

    def packed(self, path: str, dtype: str, extent: range) -> None:
        """A packed array of fixed size, in one piece."""
        count, rest = divmod(len(extent), int(dtype[-1]))
        if rest:
            raise protobuf_misfit(self.payload)
        if self.counts[path]:
            raise NoTemplateError(f"array '{path}' is written in pieces")
        self.counts[path] += count
        self.leaves[path] = Leaf(extent.start, dtype, count)

    def note(self, item: FieldDescriptor, prefix: str, leaf: Leaf | Varint) -> None:
        """Note the place of a number. If a field is written twice, the last value counts."""
        path = prefix + item.name
        if path in self.leaves and item.is_repeated:
            raise NoTemplateError(f"array '{path}' is written in pieces")
        if item.is_repeated:
            path = self.element(path)
        if item.type == ENUM and item.enum_type.is_closed and path in self.wanted:
            raise NoTemplateError(f"enumeration '{path}' may refuse its value")
        self.leaves[path] = leaf
        if len(self.leaves) > MOST_LEAVES:
            raise NoTemplateError(f"array '{path}' is too long for a template")

    def element(self, path: str) -> str:
        """Path of the next element of an array."""
        self.counts[path] += 1
        return f"{path}[{self.counts[path] - 1}]"


def dtype_of(item: FieldDescriptor) -> str:
    """Type, in numpy's spelling, of a number that is not written."""
    return FIXED.get(item.type) or VARINTS[item.type].removeprefix("zigzag")


def protobuf_misfit(payload: bytes) -> InputError:
    """The error for a message that does not fit its schema."""
    return InputError(f"a message of {len(payload)} bytes is not what its schema says, or is damaged")


def protobuf_reader(schema: Schema, paths: Sequence[str], effort: Effort) -> ByShape:
    """A reader of the fields at `paths`, for messages of a schema, which is a FileDescriptorSet.

    `effort` limits all its walks.

    Raises
    ------
    InputError
        The schema cannot be read, or does not hold its own message.
    """
    decode, empty = decoder(schema)
    wanted = frozenset(paths)

    def learn(payload: bytes) -> Template:
        """The template of all messages that are laid out as this one."""
        walk = ProtobufWalk(payload, wanted=wanted, effort=effort)
        walk.message(empty.DESCRIPTOR, len(payload), "")
        return template_of(walk, paths)

    def alone(payload: bytes) -> Numbers:
        """The wanted numbers of one message, decoded by google.protobuf."""
        return numbers_at(decode(payload), paths)

    return ByShape(learn, alone)


def decoder(schema: Schema):  # type: ignore[no-untyped-def]
    """The decoder of google.protobuf for a schema, and an empty message."""
    try:
        decode = DecoderFactory().decoder_for("protobuf", schema)
        if decode is None:
            raise TypeError(f"its encoding is '{schema.encoding}'")
        empty: Message = decode(b"")
    except (McapError, DecodeError, TypeError, KeyError, ValueError, RecursionError) as error:
        raise InputError(f"schema {schema.name}: cannot be read: {' '.join(str(error).split())}") from error

    def checked(payload: bytes) -> Message:
        """One message; refuses what does not fit the schema."""
        try:
            message: Message = decode(payload)
        except DecodeError:
            raise protobuf_misfit(payload) from None
        return message

    return checked, empty


def describe_protobuf(schema: Schema, payload: bytes | None) -> list[FieldDescription]:
    """The fields of one message; without a message, those of an empty one.

    Raises
    ------
    InputError
        The schema cannot be read, or does not describe the message.
    """
    walk = ProtobufWalk(payload or b"")
    walk.message(decoder(schema)[1].DESCRIPTOR, len(walk.payload), "")
    return describe_walk(walk)
