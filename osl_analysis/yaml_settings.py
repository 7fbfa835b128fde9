"""Validated YAML files: a wrong field becomes one line that names file, field, value and remedy."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, ClassVar, Literal, TypeVar, Union, get_args, get_origin

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from osl_analysis.errors import InputError, OslAnalysisError, nearest
from osl_analysis.files import shipped

Positive = Annotated[float, Field(gt=0)]
"""A number above zero."""
Degrees = Annotated[float, Field(gt=0, le=180)]
"""An angle above zero, of half a turn at most."""
ShippedPath = Annotated[Path, AfterValidator(shipped)]
"""A path of the campaign's folder or, where that has none, of a shipped file such as `config/config.yaml`."""
MOST_VALUES = 100_000
"""Largest number of values in a file."""


Place = Sequence[int | str]
"""Keys and numbers of list entries that lead to a field, from the outermost."""


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


def line_of(path: Path, place: Place) -> int | None:
    """Line, counted from 1, of a field or of the innermost field above it that stands in the file.

    None if not even its outermost key stands there, or if the file cannot be read.
    """
    try:
        node: yaml.Node | None = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.CSafeLoader)
    except (OSError, ValueError, RecursionError, yaml.YAMLError):
        return None
    line = None
    for name in place:
        key, node = child(node, name)
        if key is None:
            break
        line = key.start_mark.line + 1
    return line


def child(node: yaml.Node | None, name: int | str) -> tuple[yaml.Node | None, yaml.Node | None]:
    """The node that names an entry, and the entry; None where a node has no such entry."""
    if isinstance(node, yaml.MappingNode):
        return next(((key, value) for key, value in node.value if key.value == str(name)), (None, None))
    if isinstance(node, yaml.SequenceNode) and isinstance(name, int) and name < len(node.value):
        return node.value[name], node.value[name]
    return None, None


def located(files: Sequence[Path], place: Place) -> str:
    """`line 12: ` in the last of the files that has the field, with its name if there are several; empty if none."""
    for file in reversed(files):
        line = line_of(file, place)
        if line is not None:
            return f"line {line}: " if len(files) == 1 else f"line {line} of {file.name}: "
    return ""


def dotted(place: Sequence[int | str]) -> str:
    """A place in a file, as in `walking.markers.foot`."""
    return ".".join(map(str, place))


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
