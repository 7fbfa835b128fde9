"""Validated YAML files: a wrong field becomes one line that names file, field, value and remedy."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, ClassVar, TypeVar, Union, get_args, get_origin

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from osl_analysis.errors import InputError, OslAnalysisError, nearest
from osl_analysis.yaml_places import Place, located

Positive = Annotated[float, Field(gt=0)]
"""A number above zero."""


class DuplicateKeyError(OslAnalysisError):
    """A key stands twice in one mapping of a YAML file."""


class UniqueKeyLoader(yaml.CSafeLoader):
    """Safe YAML in which no mapping has a key twice. YAML's own rule is that the last one wins."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """The mapping of a node; raises DuplicateKeyError with both lines."""
        seen: dict[Any, int] = {}
        for key, _ in node.value:
            name, line = (key.tag, key.value) if isinstance(key, yaml.ScalarNode) else id(key), key.start_mark.line + 1
            if name in seen:
                raise DuplicateKeyError(
                    f"line {line}: key '{key.value}' stands twice, first in line {seen[name]}; remove one"
                )
            seen[name] = line
        return super().construct_mapping(node, deep)


class Settings(BaseModel):
    """Base of every validated file. The settings are immutable, and an unknown field is an error.

    RENAMED: old names of fields, with the new ones. An old name is refused, and the message names the new one.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    RENAMED: ClassVar[Mapping[str, str]] = {}

    def part(self, base: str) -> dict[str, Any]:
        """The fields of one of this model's base classes, as JSON, for a job that uses only these."""
        bases = (model for model in type(self).__mro__ if issubclass(model, Settings))
        (model,) = (model for model in bases if model.__name__ == base)
        return self.model_dump(mode="json", include=set(model.model_fields))


Model = TypeVar("Model", bound=Settings)


def read_yaml(path: Path, model: type[Model], first: Callable[[Path, dict[str, Any]], None] | None = None) -> Model:
    """Read a YAML file into a validated model. `first` may refuse its content before that.

    Raises
    ------
    InputError
        The file is missing, is not YAML, or a field is unknown, absent or of a wrong value.
    """
    content = read_mapping(path)
    if first is not None:
        first(path, content)
    return validated(content, model, path)


def read_mapping(path: Path) -> dict[str, Any]:
    """The top level of a YAML file, which must be a mapping.

    Raises
    ------
    InputError
        The file is missing, is not YAML, or is not a mapping.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; check the path, which is relative to the working directory")
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), Loader=UniqueKeyLoader)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(f"{path}: line {line} is not UTF-8; save the file as UTF-8") from error
    except DuplicateKeyError as error:
        raise InputError(f"{path}: {error}") from error
    except RecursionError as error:
        raise InputError(f"{path}: its fields are nested too deeply; write them as in the shipped files") from error
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"{path}: not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: has no fields; write `name: value` lines as in the shipped files")
    return content


def validated(
    content: Any, model: type[Model], path: Path, files: Sequence[Path] | None = None, above: Place = ()
) -> Model:
    """The content of a configuration file as a model.

    For messages: `path`, the `files` whose lines are named (default: `path`), and the keys `above` the content.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        text, place = explain(error, model)
        line = located([Path(path)] if files is None else files, (*above, *place)) if place else ""
        raise InputError(f"{path}: {line}{text}") from error


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
    return (*problem["loc"], *problem.get("ctx", {}).get("place", ()))


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
    if inner is None or not issubclass(inner, Settings) or old not in inner.RENAMED:
        return None
    new = inner.RENAMED[str(old)]
    return f"field '{dotted(place)}' is now called '{dotted([*parents, new])}'; rename it"


def described(problem: Mapping[str, Any], model: type[BaseModel]) -> str:
    """One problem that pydantic found, as a sentence."""
    place = dotted(place_of(problem)) or "the file"
    if problem["type"] == "extra_forbidden":
        known = known_fields(model, problem["loc"][:-1])
        return f"unknown field '{place}'; the known ones are {known}{misspelt(problem, model)}"
    if problem["type"] == "missing":
        return f"field '{place}' is missing; add it"
    reason = problem["msg"].removeprefix("Value error, ")
    nested = isinstance(problem["input"], dict | list | BaseModel)
    return f"{place}: {reason}" if nested else f"{place}: {problem['input']!r} is not allowed: {reason}"


def dotted(place: Sequence[int | str]) -> str:
    """A place in a file, as in `walking.markers.foot`."""
    return ".".join(map(str, place))


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
