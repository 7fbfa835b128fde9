"""The dotted path of a number in a message: `variables.ankle_angle`, `position[0]`, `position[name=ankle]`.

A name that has a dot or a bracket in it stands in brackets and double quotes, written as JSON writes a text:
`functions["loadcell.mz"]`. Without quotes, a dot always leads to the next level.
"""

import json
import re
from functools import cache

PART = re.compile(
    r"(?P<name>[^.\[\]]+)|\[(?P<quoted>\"(?:[^\"\\]|\\.)*\")\]|\[(?P<index>\d+)\]|\[(?P<names>\w+)=(?P<one>[^\]]+)\]|\."
)
PLAIN = re.compile(r"[^.\[\]]+")
"""A name that needs no quotes."""


def name_in(part: re.Match[str]) -> str | None:
    """The name of an object's field that one part of a path is; None for an index, a choice by name, and a dot."""
    return part["name"] if part["quoted"] is None else unquoted(part["quoted"])


@cache
def unquoted(text: str) -> str:
    """A quoted name as it is; one with an escape that JSON does not know stays as it was written."""
    try:
        return str(json.loads(text))
    except ValueError:
        return text[1:-1]


def path_to(above: str, name: str) -> str:
    """The path of the field `name` of the object at the path `above`; empty for the message itself."""
    if not PLAIN.fullmatch(name):
        return f"{above}[{json.dumps(name, ensure_ascii=False)}]"
    return f"{above}.{name}" if above else name


def last_name(path: str) -> str:
    """The name at the end of a path, also where an index or a choice follows it."""
    names = [name for part in PART.finditer(path) if (name := name_in(part)) is not None]
    return names[-1] if names else path
