"""What a validated file does wrong, as one sentence with field, value and remedy."""

import re
from collections.abc import Mapping, Sequence
from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from osl_analysis.errors import nearest
from osl_analysis.yaml_places import Place, dotted

LONGEST = 60
"""Largest number of characters of a value in a message."""
ADVICE = {
    "string_type": "write text, in quotes if it looks like a number, a list or nothing",
    "float_type": "write a number, without a unit",
    "float_parsing": "write a number, without a unit, with a full stop as decimal sign",
    "int_parsing": "write a whole number",
    "int_type": "write a whole number",
    "bool_parsing": "write true or false",
    "bool_type": "write true or false",
    "tuple_type": "write a list, as [first, second]",
    "list_type": "write a list, as [first, second]",
    "too_short": "name at least one",
    "path_type": "write a path",
    "finite_number": "write a finite number",
}
"""What to write, by the type of a problem that pydantic found."""


def explain(error: ValidationError, model: type[BaseModel]) -> tuple[str, Place]:
    """The first problem of a validation error as one sentence with field, value and remedy, and the field's place.

    An old name of a field is reported before all other problems, and a name like that of a field before the rest,
    because both also cause the problem that the right name is missing.
    """
    problems = error.errors()
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    for problem in problems:
        renamed = new_name(model, problem["loc"])
        if renamed is not None:
            return renamed, problem["loc"]
    first = next((problem for problem in problems if misspelt(problem, model)), problems[0])
    return described(first, model) + more, place_of(first)


def place_of(problem: Mapping[str, Any]) -> Place:
    """The field of a problem. A check of several fields states the one that it means as `place` in its context."""
    stated = [part for part in problem["loc"] if not (isinstance(part, str) and "[" in part)]  # kinds of a union
    return (*stated, *problem.get("ctx", {}).get("place", ()))


def misspelt(problem: Mapping[str, Any], model: type[BaseModel]) -> str:
    """A question for the field that an unknown one was meant to be; empty if none is like it."""
    if problem["type"] != "extra_forbidden":
        return ""
    inner = model_at(model, problem["loc"][:-1])
    return nearest(str(problem["loc"][-1]), inner.model_fields if inner else ())


def new_name(model: type[BaseModel], place: Sequence[int | str]) -> str | None:
    """A sentence with the new name of the field at `place`; None if it was not renamed."""
    *parents, old = place or ("",)
    inner = model_at(model, parents)
    new = getattr(inner, "RENAMED", {}).get(str(old))
    if new is None:
        return None
    return f"field '{dotted(place)}' is now called '{dotted([*parents, new])}'; rename it"


def described(problem: Mapping[str, Any], model: type[BaseModel]) -> str:
    """One problem that pydantic found, as a sentence."""
    place = dotted(place_of(problem)) or "the file"
    if problem["type"] == "extra_forbidden":
        known = known_fields(model, problem["loc"][:-1])
        return f"unknown field '{place}'; the known ones are {known}{misspelt(problem, model)}"
    if problem["type"] == "missing":
        return f"field '{place}' is missing; {instead_of(problem, model)}add it"
    reason = plain_reason(problem, model)
    nested = isinstance(problem["input"], dict | list | BaseModel)
    value = repr(problem["input"])
    shown = value if len(value) <= LONGEST else f"{value[:LONGEST]}..."
    return f"{place}: {reason}" if nested else f"{place}: {shown} is not allowed: {reason}"


def instead_of(problem: Mapping[str, Any], model: type[BaseModel]) -> str:
    """The advice to rename a field that was probably meant to be the missing one; empty if none is like it."""
    fields, inner = problem["input"], model_at(model, problem["loc"][:-1])
    unknown = (
        [str(key) for key in fields if inner and str(key) not in inner.model_fields] if isinstance(fields, dict) else []
    )
    like = nearest(str(problem["loc"][-1]), unknown)
    return f"rename {like.removeprefix('; did you mean ').removesuffix('?')}, or " if like else ""


def plain_reason(problem: Mapping[str, Any], model: type[BaseModel]) -> str:
    """What a field should be, as an instruction."""
    kind, text = problem["type"], str(problem["msg"]).removeprefix("Value error, ")
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        fields = known_fields(model, problem["loc"])
        return f"write its fields below it, as `name: value`; the known ones are {fields}"
    if kind == "literal_error":
        return text.replace("Input should be", "write") + nearest(str(problem["input"]), re.findall(r"'([^']+)'", text))
    if kind.startswith(("greater_than", "less_than")):
        return text.replace("Input should be", "write a number")
    return ADVICE.get(kind) or text.replace("Input should be", "write")


def known_fields(model: type[BaseModel], place: Sequence[int | str]) -> str:
    """Names of the fields of the model at `place`, for a message."""
    inner = model_at(model, place)
    return "those of the shipped files in config/" if inner is None else ", ".join(inner.model_fields)


def model_at(model: type[BaseModel], place: Sequence[int | str]) -> type[BaseModel] | None:
    """The model of the mapping at `place`; None if it has no model, for example in a list."""
    here: Any = model
    for name in place:
        if is_model(here):
            field = here.model_fields.get(str(name))
            here = field.annotation if field else None
        else:
            here = get_args(here)[-1] if get_origin(here) in (dict, Mapping) else None
        here = next(filter(is_model, get_args(here)), here) if get_origin(here) in (Union, UnionType) else here
    return here if is_model(here) else None


def is_model(annotation: Any) -> bool:
    """Whether the annotation of a field is a model."""
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)
