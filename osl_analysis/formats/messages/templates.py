"""Messages of one shape, read at once: offsets are learned from one message and hold for all that share its shape.

A message's *shape* is its length together with its guard bytes: lengths of arrays and strings, protobuf's tags, and
whether a varint continues. In messages of equal shape every field has the same offset.
"""

import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from mmap import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.formats.messages.leaves import AnyLeaf, Bytes, Indices, Leaf, byte_rows, distinct, value_at
from osl_analysis.formats.messages.one_by_one import Numbers, Values, WholeArrayError, batches

INDEXED = re.compile(r"(?P<array>.+)\[(?P<index>\d+)\]")
NAMED = re.compile(r"(?P<parent>.*\.)?(?P<array>\w+)\[(?P<names>\w+)=(?P<name>[^\]]+)\]")
MOST_SHAPES = 200  # of one channel and message length; what varies more is read message by message


@dataclass
class MessageWalk:
    """The walk through one message, which finds where its numbers are."""

    payload: bytes
    """The message."""
    position: int = 0
    """Where the walk is [bytes]."""
    leaves: dict[str, AnyLeaf] = field(default_factory=dict)
    """The numbers found so far, by path."""
    texts: dict[str, range] = field(default_factory=dict)
    """Extents of the strings in arrays of strings, by path."""
    guards: list[int] = field(default_factory=list)
    """Offsets of the bytes that another message must share to have the same shape."""
    continued: list[int] = field(default_factory=list)
    """Offsets of the bytes whose highest bit another message must share."""


@dataclass(frozen=True)
class Template:
    """How to read the wanted numbers of all messages of one shape."""

    leaves: dict[str, AnyLeaf]
    """The numbers, by path."""
    words: tuple[tuple[int, np.dtype[Any], Any, Any], ...]
    """Offset, type, mask and expected value of the guarded words, which a message of the shape must have."""

    def fits(self, rows: Bytes) -> NDArray[np.bool_]:
        """Which of the messages have this shape, (messages,)."""
        same = np.ones(len(rows), bool)
        for offset, kind, mask, expected in self.words:
            same &= (value_at(rows, offset, kind) & mask) == expected
        return same

    def read(self, rows: Bytes) -> Values:
        """The leaves' values in messages of this shape, `rows` of shape (messages, length)."""
        return {path: leaf.read(rows) for path, leaf in self.leaves.items()}


def template_of(walk: MessageWalk, paths: Sequence[str]) -> Template:
    """A template that reads the fields at `paths`, as far as the message has them."""
    leaves = {path: leaf for path in paths if (leaf := leaf_at(walk, path))}
    mask = np.zeros(len(walk.payload), np.uint8)
    mask[walk.continued] = 0x80
    mask[walk.guards] = 0xFF
    return Template(leaves, tuple(guarding_words(mask, np.frombuffer(walk.payload, np.uint8))))


def guarding_words(mask: Bytes, payload: Bytes) -> Iterator[tuple[int, np.dtype[Any], Any, Any]]:
    """The guarded bits of a message, in words of eight bytes (of one byte in a shorter message) to compare fewer."""
    kind = np.dtype("<u8" if mask.size >= 8 else "u1")
    guarded = np.flatnonzero(mask)
    while guarded.size:
        offset = min(int(guarded[0]), mask.size - kind.itemsize)
        word = slice(offset, offset + kind.itemsize)
        yield offset, kind, mask[word].view(kind)[0], (payload[word] & mask[word]).view(kind)[0]
        guarded = guarded[guarded >= word.stop]


def leaf_at(walk: MessageWalk, path: str) -> AnyLeaf | None:
    """The single number at `path`; None where the message lacks the field or its array is too short.

    An element is chosen by its index, `position[0]`, or by the name at the same index of an array of names beside it,
    `position[name=ankle]`. The bytes of these names then become guards.

    Raises
    ------
    WholeArrayError
        The path names a whole array.
    """
    path = index_of_name(walk, path)
    direct = walk.leaves.get(path)
    if direct is not None and direct.count is not None:
        raise WholeArrayError(f"field '{path}' is an array of {direct.count}, not one number")
    match = INDEXED.fullmatch(path)
    array = walk.leaves.get(match["array"]) if match else None
    if not match or not isinstance(array, Leaf) or array.count is None or int(match["index"]) >= array.count:
        return direct
    return Leaf(array.offset + int(match["index"]) * np.dtype(array.dtype).itemsize, array.dtype)


def index_of_name(walk: MessageWalk, path: str) -> str:
    """The path with `[names=name]` replaced by the index of that name; the names up to that one become guards."""
    match = NAMED.fullmatch(path)
    if not match:
        return path
    parent = match["parent"] or ""
    names = f"{parent}{match['names']}["
    for text, extent in walk.texts.items():
        if text.startswith(names):
            walk.guards += extent
            if walk.payload[extent.start : extent.stop].rstrip(b"\0") == match["name"].encode():
                return f"{parent}{match['array']}[{text.removeprefix(names)}"
    return path


@dataclass
class ByShape:
    """Reads binary messages by templates; it learns a template from the first message of each shape."""

    learn: Callable[[bytes], Template]
    """Makes a template of one message; raises InputError if the message does not fit its schema."""
    alone: Callable[[bytes], Numbers]
    """Reads one message for which no template can be made; raises InputError as above."""
    templates: dict[int, list[Template]] = field(default_factory=lambda: defaultdict(list))
    """The templates so far, by length of the message."""
    read_alone: int = 0
    """Messages that were read one by one."""
    misfits: int = 0
    """Messages that do not fit their schema."""
    misfit: str = ""
    """What is wrong with the first of the misfits."""

    def read(self, buffer: bytes | mmap, starts: Indices, lengths: Indices) -> Iterator[tuple[Indices, Values]]:
        """Batches of messages: their places among `starts`, and their numbers by path; misfits are only counted."""
        different = distinct(lengths)
        if len(different) == 1:
            yield from self.of_length(np.arange(len(starts)), byte_rows(buffer, starts, different[0]))
            return
        for length in different:
            (mine,) = np.nonzero(lengths == length)
            yield from self.of_length(mine, byte_rows(buffer, starts[mine], length))

    def of_length(self, mine: Indices, rows: Bytes) -> Iterator[tuple[Indices, Values]]:
        """Reads messages of one length, `rows` of shape (messages, length), whose places are `mine`."""
        templates = self.templates[rows.shape[1]]
        for template in templates:
            same = template.fits(rows)
            if same.all():
                yield mine, template.read(rows)
                return
            if same.any():
                yield mine[same], template.read(rows[same])
                mine, rows = mine[~same], rows[~same]
        which: list[int] = []
        alone: list[Numbers] = []
        while mine.size:
            payload = rows[0].tobytes()
            learned = self.learned(payload) if len(templates) < MOST_SHAPES else None
            if learned is None:
                numbers = self.one(payload)
                if numbers is not None:
                    which.append(int(mine[0]))
                    alone.append(numbers)
                mine, rows = mine[1:], rows[1:]
                continue
            templates.append(learned)
            same = learned.fits(rows)
            yield mine[same], learned.read(rows[same])
            mine, rows = mine[~same], rows[~same]
        yield from batches(which, alone)

    def learned(self, payload: bytes) -> Template | None:
        """A template of one message; None if none can be made."""
        try:
            return self.learn(payload)
        except (InputError, RecursionError):
            return None

    def one(self, payload: bytes) -> Numbers | None:
        """The numbers of one message; None if it does not fit its schema."""
        try:
            numbers = self.alone(payload)
        except (InputError, RecursionError) as error:
            self.misfits += 1
            self.misfit = self.misfit or str(error)
            return None
        self.read_alone += 1
        return numbers
