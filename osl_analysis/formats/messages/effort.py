"""Limit on the walks through messages, each of which takes microseconds per element.

Messages of one shape are walked once. A small file can unpack to many large messages, each of another shape.
"""

from dataclasses import dataclass

OF_ONE_MESSAGE = 100_000
"""Elements of one message that are walked."""
OF_ONE_BYTE = 2
"""Elements that are walked for each byte of the file. An element takes a byte of a message, and a message that is no
bomb compresses less than a hundredfold."""


class EffortError(ValueError):
    """The messages of a file have more elements to walk through than its size allows."""


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
