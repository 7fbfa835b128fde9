"""Messages of one shape, read at once: offsets are learned from one message and hold for all that share its shape.

A message's *shape* is its length together with what its guard bytes say (lengths, tags, and whether a varint goes
on): messages that share these share every field's offset.
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
from osl_analysis.formats.messages.one_by_one import Numbers, Values, batches

INDEXED = re.compile(r"(?P<array>.+)\[(?P<index>\d+)\]")
NAMED = re.compile(r"(?P<parent>.*\.)?(?P<array>\w+)\[(?P<names>\w+)=(?P<name>[^\]]+)\]")
MOST_SHAPES = 200  # of one channel and length; whoever varies more is read message by message


@dataclass
class MessageWalk:
    """The walk through one message: what was found so far.

    `texts` are the extents of the strings in arrays of strings, `guards` the offsets of the bytes that another
    message must share to be read by this shape, `continued` those of which the highest bit must be the same.
    """

    payload: bytes
    position: int = 0
    leaves: dict[str, AnyLeaf] = field(default_factory=dict)
    texts: dict[str, range] = field(default_factory=dict)
    guards: list[int] = field(default_factory=list)
    continued: list[int] = field(default_factory=list)


@dataclass(frozen=True)
class Template:
    """Leaves by path, and what says that they stand there: (offset, type, mask, expected) of words in the message."""

    leaves: dict[str, AnyLeaf]
    words: tuple[tuple[int, np.dtype[Any], Any, Any], ...]

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
    """What reads the fields at `paths`, as far as the shape has them."""
    leaves = {path: leaf for path in paths if (leaf := leaf_at(walk, path))}
    mask = np.zeros(len(walk.payload), np.uint8)
    mask[walk.continued] = 0x80
    mask[walk.guards] = 0xFF
    return Template(leaves, tuple(guarding_words(mask, np.frombuffer(walk.payload, np.uint8))))


def guarding_words(mask: Bytes, payload: Bytes) -> Iterator[tuple[int, np.dtype[Any], Any, Any]]:
    """The guarded bits of a message in words of eight bytes, of one where the message is shorter: fewer to compare."""
    kind = np.dtype("<u8" if mask.size >= 8 else "u1")
    guarded = np.flatnonzero(mask)
    while guarded.size:
        offset = min(int(guarded[0]), mask.size - kind.itemsize)
        word = slice(offset, offset + kind.itemsize)
        yield offset, kind, mask[word].view(kind)[0], (payload[word] & mask[word]).view(kind)[0]
        guarded = guarded[guarded >= word.stop]


def leaf_at(walk: MessageWalk, path: str) -> AnyLeaf | None:
    """The single number at `path`; None where this message's arrays do not reach so far, or lack the field.

    An element is chosen by its index, `position[0]`, or by the name that stands at the same index of a sibling
    array, `position[name=ankle]`; the names then join the shape's guards.

    Raises
    ------
    InputError
        The path names a whole array.
    """
    path = index_of_name(walk, path)
    direct = walk.leaves.get(path)
    if direct is not None and direct.count is not None:
        raise InputError(f"field '{path}' is an array of {direct.count}; name one element, like '{path}[0]'")
    match = INDEXED.fullmatch(path)
    array = walk.leaves.get(match["array"]) if match else None
    if not match or not isinstance(array, Leaf) or array.count is None or int(match["index"]) >= array.count:
        return direct
    return Leaf(array.offset + int(match["index"]) * np.dtype(array.dtype).itemsize, array.dtype)


def index_of_name(walk: MessageWalk, path: str) -> str:
    """The path with `[names=name]` replaced by the index of that name; guards the names up to and with it."""
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
    """Reads messages by templates, which it learns as it meets new shapes; they hold from chunk to chunk.

    `learn` makes a template of one message; `alone` reads the fields of one message for which no template can be
    made. Both raise InputError for a message that is not what its schema says.
    """

    learn: Callable[[bytes], Template]
    alone: Callable[[bytes], Numbers]
    templates: dict[int, list[Template]] = field(default_factory=lambda: defaultdict(list))
    read_alone: int = 0
    misfits: int = 0
    misfit: str = ""

    def read(self, buffer: bytes | mmap, starts: Indices, lengths: Indices) -> Iterator[tuple[Indices, Values]]:
        """Which of the messages, and the fields that they have; misfits are left out, and counted."""
        for length in distinct(lengths):
            (mine,) = np.nonzero(lengths == length)
            yield from self.of_length(mine, byte_rows(buffer, starts[mine], length))

    def of_length(self, mine: Indices, rows: Bytes) -> Iterator[tuple[Indices, Values]]:
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
        try:
            return self.learn(payload)
        except (InputError, RecursionError):
            return None

    def one(self, payload: bytes) -> Numbers | None:
        """The fields of one message, None for a misfit."""
        try:
            numbers = self.alone(payload)
        except (InputError, RecursionError) as error:
            self.misfits += 1
            self.misfit = self.misfit or str(error)
            return None
        self.read_alone += 1
        return numbers
