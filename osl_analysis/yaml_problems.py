"""What a validated file does wrong, as one sentence with field, value and remedy."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from osl_analysis.errors import nearest
from osl_analysis.yaml_places import Place, dotted

LONGEST = 60
"""Largest number of characters of a value in a message."""
AS_YAML = {"True": "true", "False": "false", "None": "null"}
"""Values as YAML writes them."""
ADVICE = {
    "string_type": "write text, in quotes if it looks like a number, a list or nothing",
    "float_type": "write a number, without a unit",
    "float_parsing": "write a number, without a unit, with a full stop as decimal sign",
    "int_parsing": "write a whole number",
    "int_type": "write a whole number",
    "int_from_float": "write a whole number",
    "int_parsing_size": "write a smaller number",
    "string_too_short": "write at least one character",
    "bool_parsing": "write true or false",
    "bool_type": "write true or false",
    "tuple_type": "write a list, as [first, second]",
    "list_type": "write a list, as [first, second]",
    "too_short": "name at least one",
    "path_type": "write a path",
    "finite_number": "write a finite number",
}
"""What to write, by the type of a problem that pydantic found."""


@dataclass(frozen=True)
class Problem:
    """One field that is wrong."""

    place: Place
    """The field, within the content that was validated."""
    kind: str
    """Type of the problem, as pydantic calls it."""
    input: Any
    """The field's value; that of the field above it where it is missing."""
    reasons: tuple[str, ...]
    """What pydantic says: one reason for each kind of value that the field may have."""


def explain(error: ValidationError, model: type[BaseModel], content: Any, above: Place = ()) -> tuple[str, Place]:
    """The first problem of a validation error as one sentence with field, value and remedy, and the field's place.

    `content` is what was validated, and `above` are the keys that lead to it in its file. How many further fields are
    wrong is said at the end. An old name of a field is reported before all other problems, and a name like that of a
    field before the rest, because both also cause the problem that the right name is missing.
    """
    problems = found_problems(error, model, content)
    for problem in problems:
        renamed = new_name(model, problem.place, above)
        if renamed is not None:
            return renamed, (*above, *problem.place)
    first = next((problem for problem in problems if misspelt(problem, model)), problems[0])
    others = len(problems) - 1
    more = f" (and {others} more problem{'s' if others > 1 else ''})" if others else ""
    return described(first, model, above) + more, (*above, *first.place)


def found_problems(error: ValidationError, model: type[BaseModel], content: Any) -> list[Problem]:
    """The fields that are wrong. Where a field may have several kinds of values, pydantic finds a problem for each."""
    found: dict[Place, Problem] = {}
    for problem in error.errors():
        place = place_of(problem, content)
        before = found.get(place)
        reasons = dict.fromkeys((*(before.reasons if before else ()), plain_reason(problem, place, model)))
        found[place] = Problem(place, problem["type"], problem["input"], tuple(reasons))
    deeper = {place[:n] for place in found for n in range(len(place))}
    return [problem for place, problem in found.items() if place not in deeper or not place]


def place_of(problem: Mapping[str, Any], content: Any) -> tuple[int | str, ...]:
    """The field of a problem. A check of several fields states the one that it means as `place` in its context.

    What pydantic adds for itself, as the kind of value that it tried, is not in the content.
    """
    place: list[int | str] = []
    here = content
    for name in problem["loc"]:
        here_has = name in here if isinstance(here, dict) else isinstance(here, BaseModel | list | tuple)
        if not here_has and not (problem["type"] == "missing" and name == problem["loc"][-1]):
            continue
        if isinstance(here, list | tuple) and not isinstance(name, int):
            continue
        place.append(name)
        here = entry(here, name)
    return (*place, *problem.get("ctx", {}).get("place", ()))


def entry(here: Any, name: int | str) -> Any:
    """What stands under a key or a number; None if nothing does."""
    if isinstance(here, dict):
        return here.get(name)
    if isinstance(here, BaseModel):
        return getattr(here, str(name), None)
    return here[name] if isinstance(here, list | tuple) and isinstance(name, int) and name < len(here) else None


def misspelt(problem: Problem, model: type[BaseModel]) -> str:
    """A question for the field that an unknown one was meant to be; empty if none is like it."""
    if problem.kind != "extra_forbidden":
        return ""
    inner = model_at(model, problem.place[:-1])
    return nearest(str(problem.place[-1]), inner.model_fields if inner else ())


def new_name(model: type[BaseModel], place: Place, above: Place = ()) -> str | None:
    """A sentence with the new name of the field at `place`, or why it is gone; None if it is neither."""
    *parents, old = place or ("",)
    inner = model_at(model, parents)
    gone = getattr(inner, "REMOVED", {}).get(str(old))
    if gone is not None:
        return f"field '{dotted([*above, *place])}' is gone: {gone}"
    new = getattr(inner, "RENAMED", {}).get(str(old))
    if new is None:
        return None
    return f"field '{dotted([*above, *place])}' is now called '{dotted([*above, *parents, new])}'; rename it"


def described(problem: Problem, model: type[BaseModel], above: Place = ()) -> str:
    """One problem as a sentence."""
    place = dotted([*above, *problem.place]) or "the file"
    if problem.kind == "extra_forbidden":
        known = known_fields(model, problem.place[:-1])
        return f"unknown field '{place}'; the known ones are {known}{misspelt(problem, model)}"
    if problem.kind == "missing":
        return f"field '{place}' is missing; {instead_of(problem, model)}add it"
    first, *others = sorted(problem.reasons, key=lambda reason: ";" in reason)  # questions for a word at the end
    reason = ", or ".join([first, *(other.removeprefix("write ") for other in others)])
    nested = isinstance(problem.input, dict | list | BaseModel)
    value = AS_YAML.get(repr(problem.input)) or repr(problem.input)
    shown = value if len(value) <= LONGEST else f"{value[:LONGEST]}..."
    return f"{place}: {reason}" if nested else f"{place}: {shown} is not allowed: {reason}"


def instead_of(problem: Problem, model: type[BaseModel]) -> str:
    """The advice to rename a field that was probably meant to be the missing one; empty if none is like it."""
    fields, inner = problem.input, model_at(model, problem.place[:-1])
    unknown = (
        [str(key) for key in fields if inner and str(key) not in inner.model_fields] if isinstance(fields, dict) else []
    )
    like = nearest(str(problem.place[-1]), unknown)
    return f"rename {like.removeprefix('; did you mean ').removesuffix('?')}, or " if like else ""


def plain_reason(problem: Mapping[str, Any], place: Place, model: type[BaseModel]) -> str:
    """What a field should be, as an instruction."""
    kind, text = problem["type"], str(problem["msg"]).removeprefix("Value error, ")
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        fields = known_fields(model, place)
        return f"write its fields below it, as `name: value`{f'; the known ones are {fields}' if fields else ''}"
    if kind == "literal_error":
        return text.replace("Input should be", "write") + nearest(str(problem["input"]), re.findall(r"'([^']+)'", text))
    if kind == "string_pattern_mismatch":
        return f"write text of the form {problem['ctx']['pattern']}"
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
