"""What a recording of messages by topic offers to its readers, whatever its container is: MCAP, ROS 1 or ROS 2 bag.

The payloads are decoded by `messages/`; topics, order and losses are found by `mcap/topics.py`, `order.py` and
`damage.py`, for all containers.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from osl_analysis.formats.mcap.chunk import MessageBlock
from osl_analysis.formats.mcap.damage import Damage
from osl_analysis.formats.mcap.declared import Declared
from osl_analysis.formats.mcap.limits import Budget


class MessageFile(Protocol):
    """A log of messages."""

    @property
    def path(self) -> Path:
        """Where the log is: a file, or the folder of its parts."""

    @property
    def kind(self) -> str:
        """What it is, for messages: `MCAP`."""

    @property
    def budget(self) -> Budget:
        """Its size, and what may still be unpacked."""

    @property
    def declared(self) -> Declared:
        """Its channels and schemas; complete once the blocks are read."""

    @property
    def damage(self) -> Damage:
        """Losses; complete once the blocks are read."""

    def blocks(self) -> Iterator[MessageBlock]:
        """The messages in the order of the file, in portions that memory holds. Call it once.

        Raises
        ------
        InputError
            The file unpacks to more than is allowed, or is damaged beyond reading.
        """
