"""Numbers of a YAML file that are none: truth values, and numbers that YAML 1.1 reads otherwise than people do."""

import re
from collections.abc import Iterator, Mapping
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import yaml
from pydantic_core import PydanticCustomError

NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
MISREAD = re.compile(r"(?P<sixties>[^:]*:.*)|[-+]?0[0-7_]+")
"""A number in sixties (1:30 is 90 in YAML 1.1), or with an 0 in front (010 is 8)."""


def misread_number(key: yaml.Node, value: yaml.Node) -> str | None:
    """What is wrong with the first number below a key that YAML reads otherwise than it looks; None if all are right.

    Numbers below keys of an inner mapping are not looked at.
    """
    for node in scalars(value):
        found = MISREAD.fullmatch(node.value) if node.tag in NUMBERS else None
        if found is None:
            continue
        way = "in sixties" if found["sixties"] else "in eights"
        name = f"{key.value}: " if isinstance(key, yaml.ScalarNode) else ""
        return (
            f"line {node.start_mark.line + 1}: {name}YAML counts {node.value} {way}; write a plain decimal number, or "
            f"text in quotes"
        )
    return None


def scalars(node: yaml.Node) -> Iterator[yaml.ScalarNode]:
    """A single value, or those of a list. Lists in lists may be aliases of few characters for billions of values."""
    if isinstance(node, yaml.ScalarNode):
        yield node
    elif isinstance(node, yaml.SequenceNode):
        yield from (inner for inner in node.value if isinstance(inner, yaml.ScalarNode))


def check_truth_values(value: Any, annotation: Any) -> None:
    """Refuse a truth value, or one in a list or mapping, for a field of numbers: pydantic takes `yes` for 1.

    Raises
    ------
    PydanticCustomError
        The place of the value within the field is in its context.
    """
    if {int, float} & kinds(annotation) and bool not in kinds(annotation):
        place = truth_value(value)
        if place is not None:
            reason = "write a number; YAML reads true, yes and on, false, no and off as truth values"
            raise PydanticCustomError("truth_value", "{reason}", {"reason": reason, "place": place})


def truth_value(value: Any) -> tuple[int | str, ...] | None:
    """The place of the first truth value in a value, its lists and mappings; None without one."""
    if isinstance(value, bool):
        return ()
    inner: Any = ()
    if isinstance(value, list | tuple):
        inner = enumerate(value)
    elif isinstance(value, dict):
        inner = value.items()
    for key, entry in inner:
        place = truth_value(entry)
        if place is not None:
            return (key if isinstance(key, int) else str(key), *place)
    return None


def kinds(annotation: Any) -> set[Any]:
    """The types of the values that an annotation allows, in its lists, mappings and choices too."""
    origin = get_origin(annotation)
    if origin is Literal:
        return {type(choice) for choice in get_args(annotation)}
    if origin is Annotated:
        return kinds(get_args(annotation)[0])
    if origin in (Union, UnionType):
        return set().union(*map(kinds, get_args(annotation)))
    if origin in (tuple, list):
        return set().union(*map(kinds, get_args(annotation)))
    if origin in (dict, Mapping):
        return kinds(get_args(annotation)[1])
    return {annotation}
