"""Reading validated YAML: one place turns a wrong field into one line that names file, field, value, remedy."""

from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from osl_analysis.errors import InputError


class Settings(BaseModel):
    """Base of every validated file: frozen, and a misspelt field is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


Model = TypeVar("Model", bound=Settings)


def read_yaml(path: Path, model: type[Model]) -> Model:
    """Read a YAML file into a validated model.

    Raises
    ------
    InputError
        The file is missing, is not YAML, or a field is unknown, absent or of a wrong value.
    """
    return validated(read_mapping(path), model, path)


def read_mapping(path: Path) -> dict[str, Any]:
    """The top level of a YAML file, which must be a mapping.

    Raises
    ------
    InputError
        The file is missing, is not YAML, or holds something else.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; check the path, which is relative to the working directory")
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds no fields; write `name: value` lines as in the shipped files")
    return content


def validated(content: Any, model: type[Model], path: Path) -> Model:
    """The content of a configuration file as a model; `path` is for messages."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{path}: {explain(error, model)}") from error


def explain(error: ValidationError, model: type[BaseModel]) -> str:
    """The first problem of a validation error, as one sentence with field, value and remedy."""
    first = error.errors()[0]
    place = ".".join(str(part) for part in first["loc"]) or "the file"
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    if first["type"] == "extra_forbidden":
        return f"unknown field '{place}'; the known ones are {known_fields(model, first['loc'][:-1])}{more}"
    if first["type"] == "missing":
        return f"field '{place}' is missing; add it{more}"
    reason = first["msg"].removeprefix("Value error, ")
    nested = isinstance(first["input"], dict | list)
    return f"{place}: {reason}{more}" if nested else f"{place}: {first['input']!r} is not allowed: {reason}{more}"


def known_fields(model: type[BaseModel], path: tuple[int | str, ...]) -> str:
    """Names of the fields where `path` leads, in words for a message."""
    for name in path:
        field = model.model_fields.get(str(name))
        inner = field.annotation if field else None
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            return "those of the shipped files in config/"
        model = inner
    return ", ".join(model.model_fields)
