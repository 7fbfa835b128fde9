"""Limits on the walks through binary messages, each of which takes microseconds per element, and on JSON to parse.

Messages of one shape are walked once. A small file can unpack to many large messages, each of another shape. Two bytes
of JSON can be a number, which takes a hundred and fifty bytes while it is parsed.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from osl_analysis.formats.messages.leaves import Indices

OF_ONE_MESSAGE = 100_000
"""Elements of one message that are walked."""
OF_ONE_BYTE = 2
"""Elements that are walked for each byte of the file. An element takes a byte of a message, and a message that is no
bomb compresses less than a hundredfold."""

LARGEST_TEXT = 1 << 19
"""Bytes of one JSON message that is parsed. The messages of a recorder of signals have some hundreds."""
TEXT_AT_ONCE = 1 << 19
"""Bytes of JSON that are parsed at once."""
FREE_TEXT = 8 << 20
"""Bytes of JSON that are parsed in a file of any size ..."""
TEXT_OF_ONE_BYTE = 50
"""... and how many more for each of its bytes. Times that count up take 10 bytes of a compressed message."""


class EffortError(ValueError):
    """The messages of a file have more elements to walk through than its size allows."""


class LongMessageError(EffortError):
    """One message is too long, whatever the size of its file is. The message says what to do."""


@dataclass
class Effort:
    """What may still be walked."""

    left: int = OF_ONE_MESSAGE
    """Elements."""

    def take(self) -> None:
        """Count an element.

        Raises
        ------
        EffortError
            There were too many.
        """
        self.left -= 1
        if self.left < 0:
            raise EffortError("its messages differ in length and have too many elements to walk through")


def effort_for(file_bytes: int) -> Effort:
    """What may be walked in the messages of one channel of a file."""
    return Effort(OF_ONE_MESSAGE + OF_ONE_BYTE * file_bytes)


@dataclass
class TextEffort:
    """How much JSON may still be parsed."""

    left: int = FREE_TEXT
    """Bytes."""

    def portions(self, lengths: Indices) -> Iterator[slice]:
        """Count messages of these lengths, and split them into portions to parse at once.

        Raises
        ------
        EffortError
            One of them is too long, or all messages so far are.
        """
        check_text(int(lengths.max(initial=0)))
        self.left -= int(lengths.sum())
        if self.left < 0:
            raise EffortError("its messages of JSON unpack to more text than a file of its size holds for a reason")
        portion = (np.cumsum(lengths) - lengths) // TEXT_AT_ONCE
        edges = [0, *(np.flatnonzero(np.diff(portion)) + 1).tolist(), lengths.size]
        yield from (slice(start, stop) for start, stop in pairwise(edges) if start < stop)


def text_effort_for(file_bytes: int) -> TextEffort:
    """How much JSON may be parsed in the messages of a file."""
    return TextEffort(FREE_TEXT + TEXT_OF_ONE_BYTE * file_bytes)


def check_text(size: int) -> None:
    """Refuse a JSON message of that many bytes if it is too long.

    Raises
    ------
    LongMessageError
        It is.
    """
    if size > LARGEST_TEXT:
        raise LongMessageError(
            f"a message of JSON has {size} bytes, more than the {LARGEST_TEXT} that are parsed; record the signals in "
            "a topic of their own, in small messages"
        )
