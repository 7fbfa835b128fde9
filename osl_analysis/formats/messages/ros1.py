"""ROS 1 messages: the walk through one message, which finds where its numbers are.

They are little-endian and not aligned; strings have no zero at their end (wiki.ros.org/msg). All else is as in ROS 2.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from mcap.records import Schema

from osl_analysis.errors import InputError
from osl_analysis.formats.messages.cdr import CdrWalk, message_type, reader_by_walk
from osl_analysis.formats.messages.description import FieldDescription, describe_walk
from osl_analysis.formats.messages.effort import Effort
from osl_analysis.formats.messages.ros2_schema import Definitions
from osl_analysis.formats.messages.templates import ByShape

OWN_TYPE = re.compile(r"^([ \t]*)(time|duration|Header|byte)(?=(?:\[\d*\])?[ \t]+\w)", re.MULTILINE)
AS_ROS_2 = {"time": "ros1/Time", "duration": "ros1/Duration", "Header": "std_msgs/Header", "byte": "int8"}
"""What the types that ROS 2 does not have, or means otherwise, are (wiki.ros.org/msg)."""
DEFINED = "\n===\nMSG: ros1/Time\nuint32 secs\nuint32 nsecs\n===\nMSG: ros1/Duration\nint32 secs\nint32 nsecs\n"
EMPTY = bytes(1 << 16)  # every number 0, every string and array empty


@dataclass
class Ros1Walk(CdrWalk):
    """The walk through one message of ROS 1."""

    def align(self, size: int) -> None:
        """Numbers stand where the field before ends."""


def ros1_type(schema: Schema) -> tuple[str, Definitions]:
    """Name and definitions of a schema's message; raises InputError if they cannot be read."""
    text = OWN_TYPE.sub(lambda match: match[1] + AS_ROS_2[match[2]], schema.data.decode(errors="replace"))
    return message_type(replace(schema, data=(text + DEFINED).encode()))


def walk_of(definitions: Definitions, name: str, payload: bytes, effort: Effort | None = None) -> Ros1Walk:
    """Leaves and guards of one message of type `name` (`package/Name`); `effort` limits the walk.

    Raises
    ------
    InputError
        The message is shorter or longer than its definition asks for.
    """
    walk = Ros1Walk(payload, definitions=definitions, effort=effort or Effort(), empty_size=0)
    walk.message(name, "")
    if walk.position != len(payload) and payload is not EMPTY:
        raise InputError(
            f"a message of {len(payload)} bytes has {walk.position} by its definition, which is not its own; record "
            "the bag again with the definitions that its publisher was built with"
        )
    return walk


def ros1_reader(schema: Schema, paths: Sequence[str], effort: Effort) -> ByShape:
    """A reader of the fields at `paths`, for messages of a schema in ros1msg; `effort` limits all its walks.

    Raises
    ------
    InputError
        The schema cannot be read.
    """
    name, definitions = ros1_type(schema)
    return reader_by_walk(lambda payload: walk_of(definitions, name, payload, effort), paths)


def describe_ros1(schema: Schema, payload: bytes | None) -> list[FieldDescription]:
    """The fields of one message; without a message, those of one whose strings and arrays are empty.

    Raises
    ------
    InputError
        The schema cannot be read, or does not describe the message.
    """
    name, definitions = ros1_type(schema)
    return describe_walk(walk_of(definitions, name, EMPTY if payload is None else payload))
