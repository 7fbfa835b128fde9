"""ROS 2 message definitions (`ros2msg`): which fields a message has, in order."""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from osl_analysis.errors import InputError

PRIMITIVES = {
    "bool": "?", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
"""Types in numpy's spelling. rosidl maps `char` to uint8: design.ros2.org/articles/legacy_interface_definition.html."""
STRINGS = ("string", "wstring")

FIELD = re.compile(r"(?P<type>[A-Za-z][\w/]*)(<=\d+)?(?P<array>\[(?P<bound><=)?(?P<size>\d*)\])?\s+(?P<name>\w+)")
SEPARATOR = re.compile(r"^={3,}\s*$", re.MULTILINE)
HEAD = re.compile(r"\s*MSG:\s*(\S+)[ \t]*$", re.MULTILINE)
CONSTANT = re.compile(r"\s*=")


@dataclass(frozen=True)
class MessageField:
    """One field of a message type."""

    name: str
    """Name of the field."""
    type: str
    """A primitive, a string or `package/Name`."""
    array: int | Literal["sequence"] | None = None
    """Length of an array of fixed size, "sequence" where the length is in the message, None for no array."""


Definitions = dict[str, list[MessageField]]

STAMP = [MessageField("sec", "int32"), MessageField("nanosec", "uint32")]


def parse_schema(name: str, text: str) -> Definitions:
    """Definitions of the message `name` (`package/msg/Name`) and of all that it holds, by `package/Name`.

    Raises
    ------
    InputError
        A line is not a field, a field is defined twice, or a type is not defined.
    """
    definitions: Definitions = {"builtin_interfaces/Time": STAMP, "builtin_interfaces/Duration": STAMP}
    own, *parts = SEPARATOR.split(text)
    definitions[short_name(name)] = list(parse_fields(short_name(name), own))
    for part in parts:
        head = HEAD.match(part)
        if not head:
            raise InputError(f"schema {name}: a line 'MSG: package/Name' is missing after a separator")
        full_name = short_name(head.group(1))
        definitions[full_name] = list(parse_fields(full_name, part[head.end() :]))
    for full_name, fields in definitions.items():
        twice = [name for name, count in Counter(field.name for field in fields).items() if count > 1]
        if twice:
            raise InputError(f"schema {full_name}: field '{twice[0]}' is defined twice")
        for field in fields:
            if field.type not in definitions and field.type not in PRIMITIVES and field.type not in STRINGS:
                raise InputError(f"schema {full_name}: type '{field.type}' of field '{field.name}' is not defined")
    return definitions


def parse_fields(full_name: str, body: str) -> Iterator[MessageField]:
    """The fields of one definition, without comments, constants and default values."""
    for raw in body.splitlines():
        line = raw.split("#")[0].strip()
        match = FIELD.match(line)
        if line and not match:
            raise InputError(f"schema {full_name}: cannot read the line '{line[:60]}'; expected a type and a name")
        if match and not CONSTANT.match(line, match.end()):
            yield MessageField(match["name"], full_type(match["type"], full_name), array_of(match))


def array_of(match: re.Match[str]) -> int | Literal["sequence"] | None:
    """`MessageField.array` of a field."""
    if match["array"] is None:
        return None
    return int(match["size"]) if match["size"] and not match["bound"] else "sequence"


def full_type(name: str, inside: str) -> str:
    """The key of a type in the definitions; a bare name belongs to the package of the message that uses it."""
    if name in PRIMITIVES or name in STRINGS:
        return name
    return short_name(name) if "/" in name else f"{inside.split('/')[0]}/{name}"


def short_name(name: str) -> str:
    """`package/msg/Name` as `package/Name`."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}"
