"""Validated YAML files: a wrong field becomes one line that names file, field, value and remedy."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator

from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.shipped import shipped
from osl_analysis.yaml_numbers import check_truth_values, misread_number
from osl_analysis.yaml_places import Place, located
from osl_analysis.yaml_problems import explain

Positive = Annotated[float, Field(gt=0)]
"""A number above zero."""
Degrees = Annotated[float, Field(gt=0, le=180)]
"""An angle above zero, of half a turn at most."""
ShippedPath = Annotated[Path, AfterValidator(shipped)]
"""A path of the campaign's folder or, where that has none, of a shipped file such as `config/config.yaml`."""
MOST_VALUES = 100_000
"""Largest number of values in a file."""


class AmbiguousError(OslAnalysisError):
    """A key stands twice in one mapping of a YAML file, or a number is not what it looks like."""


class StrictLoader(yaml.CSafeLoader):
    """Safe YAML without what YAML 1.1 reads otherwise than people do: keys that stand twice, of which the last one
    wins, and numbers in sixties or eights."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """The mapping of a node; raises AmbiguousError with the lines."""
        seen: dict[Any, int] = {}
        for key, value in node.value:
            name, line = (key.tag, key.value) if isinstance(key, yaml.ScalarNode) else id(key), key.start_mark.line + 1
            if name in seen:
                raise AmbiguousError(
                    f"line {line}: key '{key.value}' stands twice, first in line {seen[name]}; remove one"
                )
            seen[name] = line
            wrong = misread_number(key, value)
            if wrong is not None:
                raise AmbiguousError(wrong)
        return super().construct_mapping(node, deep)


class Settings(BaseModel):
    """Base of every validated file. The settings are immutable, and an unknown field is an error.

    RENAMED: old names of fields, with the new ones. An old name is refused, and the message names the new one.
    REMOVED: fields that are gone, with what to write or do now: the message is "field 'NAME' is gone: SENTENCE".
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    RENAMED: ClassVar[Mapping[str, str]] = {}
    REMOVED: ClassVar[Mapping[str, str]] = {}

    @field_validator("*", mode="before")
    @classmethod
    def _truth_values_are_no_numbers(cls, value: Any, info: ValidationInfo) -> Any:
        field = cls.model_fields.get(info.field_name or "")
        if field is not None:
            check_truth_values(value, field.annotation)
        return value

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
        content = yaml.load(path.read_text(encoding="utf-8"), Loader=StrictLoader)
        values = extent(content, {})
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(f"{path}: line {line} is not UTF-8; save the file as UTF-8") from error
    except AmbiguousError as error:
        raise InputError(f"{path}: {error}") from error
    except RecursionError as error:
        raise InputError(f"{path}: its fields are nested too deeply; write them as in the shipped files") from error
    except (yaml.YAMLError, ValueError, AttributeError, KeyError, TypeError, OverflowError) as error:  # of a wrong tag
        raise InputError(f"{path}: not YAML: {not_yaml(error)}") from error
    if values > MOST_VALUES:
        raise InputError(f"{path}: its aliases (`*name`) stand for more than {MOST_VALUES} values; write them out")
    if not isinstance(content, dict):
        raise InputError(f"{path}: has no fields; write `name: value` lines as in the shipped files")
    return content


def not_yaml(error: Exception) -> str:
    """What is wrong with a text that is not YAML, on one line, with a remedy."""
    text = " ".join(str(error).replace('in "<unicode string>", ', "in ").split())
    if "cannot start any token" in text or "tab character" in text:
        return (
            f"{text}; indent with blanks, not with tabs, and put text that begins with a sign such as % or @ in quotes"
        )
    return f"{text}; compare with the shipped files, and put text with signs such as : # * in quotes"


def extent(content: Any, known: dict[int, float]) -> float:
    """Number of values in nested mappings and lists with every alias written out; infinite where one contains itself.

    known: extents by the identity of a mapping or list. An alias of few characters may stand for billions of values.
    """
    if not isinstance(content, dict | list):
        return 1
    if id(content) not in known:
        known[id(content)] = math.inf
        inner = content.values() if isinstance(content, dict) else content
        known[id(content)] = 1 + sum(extent(value, known) for value in inner)
    return known[id(content)]


def validated(
    content: Any, model: type[Model], path: Path, files: Sequence[Path] | None = None, above: Place = ()
) -> Model:
    """The content of a configuration file as a model.

    For messages: `path`, the `files` whose lines are named (default: `path`), and the keys `above` the content.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        text, place = explain(error, model, content, above)
        line = located([Path(path)] if files is None else files, place) if place else ""
        raise InputError(f"{path}: {line}{text}") from error
