"""Validated YAML files (YAML 1.2): a wrong field becomes one line that names file, line, field, value and remedy."""

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, ClassVar, TypeVar, Union, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidatorFunctionWrapHandler,
    field_validator,
)
from pydantic_core import PydanticCustomError
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from osl_analysis.errors import InputError, nearest
from osl_analysis.files import shipped

Positive = Annotated[float, Field(gt=0)]  # A number above zero.
NotNegative = Annotated[float, Field(ge=0)]  # A number of zero or more.
Degrees = Annotated[float, Field(gt=0, le=180)]  # An angle above zero, of half a turn at most.
ShippedPath = Annotated[Path, AfterValidator(shipped)]
"""A path of the campaign's folder or, where that has none, of a shipped file such as `config/config.yaml`."""
Place = tuple[int | str, ...]  # Keys and numbers of list entries that lead to a field, from the outermost.


class Settings(BaseModel):
    """Base of every validated file. The settings are immutable, and an unknown field is an error.

    RENAMED: old names of fields, with the new ones. An old name is refused, and the message names the new one.
    REMOVED: fields that are gone, with what to write or do now: the message is "field 'NAME' is gone: SENTENCE".
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    RENAMED: ClassVar[Mapping[str, str]] = {}
    REMOVED: ClassVar[Mapping[str, str]] = {}

    @field_validator("*", mode="wrap")
    @classmethod
    def _truth_values_are_no_numbers(cls, value: Any, validate: ValidatorFunctionWrapHandler) -> Any:
        made = validate(value)
        place = counted_truth(value, made)
        if place is not None:
            reason = "write a number; YAML reads true, yes and on, false, no and off as truth values"
            raise PydanticCustomError("truth_value", "{reason}", {"reason": reason, "place": place})
        return made

    def part(self, base: str) -> dict[str, Any]:
        """The fields of one of this model's base classes, as JSON, for a job that uses only these."""
        bases = (model for model in type(self).__mro__ if issubclass(model, Settings))
        (model,) = (model for model in bases if model.__name__ == base)
        return self.model_dump(mode="json", include=set(model.model_fields))


def counted_truth(value: Any, made: Any) -> Place | None:
    """The place of the first truth value of which validation made a number, as pydantic does; None without one."""
    if isinstance(value, bool):
        return None if isinstance(made, bool) else ()
    pairs: Iterable[tuple[int | str, Any, Any]] = ()
    if isinstance(value, dict) and isinstance(made, Mapping):
        pairs = ((str(key), value[key], made[key]) for key in value if key in made)
    elif isinstance(value, list | tuple) and isinstance(made, list | tuple):
        pairs = ((k, *pair) for k, pair in enumerate(zip(value, made, strict=False)))
    for key, inner, inner_made in pairs:
        if (place := counted_truth(inner, inner_made)) is not None:
            return (key, *place)
    return None


AnySettings = TypeVar("AnySettings", bound=Settings)


def read_yaml(path: Path, model: type[AnySettings]) -> AnySettings:
    """Read a YAML file into a model. Raises InputError as `read_mapping`, and where a field is unknown, absent or of a
    wrong value."""
    return validated(read_mapping(path), model, path)


def read_mapping(path: Path, by_snakemake: bool = False) -> dict[str, Any]:
    """The top level of a YAML file, shared by all who read the file: do not change it. Raises InputError where it is
    missing, is not YAML, or is not a mapping; `by_snakemake`, which reads YAML 1.1, also where numbers differ there."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; check the path, which is relative to the working directory")
    try:
        node, content = parsed_yaml(path.read_text(encoding="utf-8-sig"))
        for mapping in mappings(node) if by_snakemake else ():
            for key, value in mapping.value:
                for one in value.value if isinstance(value, SequenceNode) else [value]:
                    number = one.value if isinstance(one, ScalarNode) and not one.style else ""
                    if counted := YAML_1_1.fullmatch(number):
                        said = f"{key.value}: YAML counts {number} in {'sixties' if counted['sixties'] else 'eights'}"
                        line = one.start_mark.line + 1
                        raise InputError(f"line {line}: {said}; write a plain decimal number, or text in quotes")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(f"{path}: line {line} is not UTF-8; save the file as UTF-8") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except RecursionError as error:
        raise InputError(f"{path}: its fields are nested too deeply; write them as in the shipped files") from error
    except (YAMLError, ValueError, AttributeError, KeyError, TypeError, OverflowError) as error:  # of a wrong tag
        text, remedy = (
            " ".join(str(error).split()),
            "compare with the shipped files, and put text with signs such as : # *",
        )
        if isinstance(error, MarkedYAMLError):
            marks = ((error.context, error.context_mark), (error.problem, error.problem_mark))
            at = [(what, f" in line {it.line + 1}, column {it.column + 1}" if it else "") for what, it in marks if what]
            text = " ".join(what + place for what, place in at)
        if "cannot start any token" in text or "tab character" in text:
            remedy = "indent with blanks, not with tabs, and put text that begins with a sign such as % or @"
        raise InputError(f"{path}: not YAML: {text}; {remedy} in quotes") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: has no fields; write `name: value` lines as in the shipped files")
    return content


YAML_1_1 = re.compile(r"(?P<sixties>[-+]?[0-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?)|[-+]?0[0-7_]+")
"""Numbers that YAML 1.1 counts in sixties (1:30 is 90) or eights (010 is 8)."""


@lru_cache(maxsize=64)
def parsed_yaml(text: str) -> tuple[Node | None, Any]:
    """The nodes of a YAML text, with their lines, and its content. A key that stands twice in a mapping is refused."""
    yaml = YAML(typ="safe", pure=True, plug_ins=[])
    node = yaml.compose(text)
    for mapping in mappings(node):
        lines: dict[Any, int] = {}
        for key, _ in mapping.value:
            name, line = (key.tag, key.value) if isinstance(key, ScalarNode) else id(key), key.start_mark.line + 1
            if name in lines:
                said = f"line {line}: key '{key.value}' stands twice, first in line {lines[name]}; remove one"
                raise InputError(said)
            lines[name] = line
    return node, yaml.constructor.construct_document(node) if node is not None else None


def mappings(node: Node | None) -> list[MappingNode]:
    """The mappings in a node, each once, though aliases may name it again."""
    found: dict[int, Node] = {}
    waiting = [node]
    while waiting:
        one = waiting.pop()
        if id(one) not in found and isinstance(one, MappingNode | SequenceNode):
            found[id(one)] = one
            waiting += [value for _, value in one.value] if isinstance(one, MappingNode) else one.value
    return [one for one in found.values() if isinstance(one, MappingNode)]


def field_line(path: Path, place: Place) -> int | None:
    """Line, counted from 1, of a field or of the innermost field above it in the file; None where there is none."""
    try:
        node, _ = parsed_yaml(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError, YAMLError):
        return None
    line = None
    for name in place:
        key = None
        if isinstance(node, MappingNode):
            key, node = next((pair for pair in node.value if pair[0].value == str(name)), (None, None))
        elif isinstance(node, SequenceNode) and isinstance(name, int) and name < len(node.value):
            key = node = node.value[name]
        if key is None:
            break
        line = key.start_mark.line + 1
    return line


def located(files: Sequence[Path], place: Place) -> str:
    """`line 12: ` in the last of the files that has the field, with its name if there are several; empty if none."""
    lines = ((file, field_line(file, place)) for file in reversed(files))
    found = (f"line {line}{f' of {file.name}' * (len(files) > 1)}: " for file, line in lines if line is not None)
    return next(found, "")


def dotted(place: Place) -> str:
    """A place in a file, as in `walking.markers.foot`."""
    return ".".join(map(str, place))


def validated(
    content: Any, model: type[AnySettings], path: Path, files: Sequence[Path] | None = None, above: Place = ()
) -> AnySettings:
    """The content of a configuration file as a model; for messages `path`, `files` with lines, and keys `above` it."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        text, place = explain(error, model, content, above)
        line = located([Path(path)] if files is None else files, place) if place else ""
        raise InputError(f"{path}: {line}{text}") from error


def explain(error: ValidationError, model: type[BaseModel], content: Any, above: Place) -> tuple[str, Place]:
    """The first problem of a validation error as one sentence with field, value and remedy, and the field's place.
    `above` are the keys that lead to `content` in its file. A field that is renamed or gone comes before all other
    problems, and a name like that of a field before the rest: both also cause that the right name is missing."""
    # by place; where a field may have several kinds of values, pydantic finds a problem for each
    found: dict[Place, list[Mapping[str, Any]]] = {}
    for one in error.errors():
        found.setdefault(problem_place(one, content), []).append(one)
    deeper = {place[:n] for place in found for n in range(len(place))}
    problems = [(place, each) for place, each in found.items() if place not in deeper or not place]
    for place, _ in problems:
        inner, old = model_at(model, place[:-1]), str(place[-1]) if place else ""
        if inner and issubclass(inner, Settings) and old in {**inner.REMOVED, **inner.RENAMED}:
            field, new = f"field '{dotted((*above, *place))}'", inner.RENAMED.get(old)
            is_now = f"{field} is now called '{dotted((*above, *place[:-1], new or ''))}'; rename it"
            return is_now if new else f"{field} is gone: {inner.REMOVED[old]}", (*above, *place)
    first, each = next((one for one in problems if misspelt(*one, model)), problems[0])
    others = len(problems) - 1
    more = f" (and {others} more problem{'s' if others > 1 else ''})" if others else ""
    return described_problem(first, each, model, above) + more, (*above, *first)


def problem_place(problem: Mapping[str, Any], content: Any) -> Place:
    """The field of a problem. A check of several fields states the one that it means as `place` in its context. What
    pydantic adds for itself, as the kind of value that it tried, is not in the content."""
    place: list[int | str] = []
    here = content
    for name in problem["loc"]:
        if isinstance(here, list | tuple):
            if isinstance(name, int):
                place.append(name)
                here = here[name] if name < len(here) else None
        elif isinstance(here, dict) and name in here:
            place.append(name)
            here = here[name]
        elif isinstance(here, BaseModel) or (problem["type"] == "missing" and name == problem["loc"][-1]):
            place.append(name)
            here = getattr(here, str(name), None)
    return (*place, *problem.get("ctx", {}).get("place", ()))


def misspelt(place: Place, problems: Sequence[Mapping[str, Any]], model: type[BaseModel]) -> str:
    """A question for the field that an unknown one was meant to be; empty if none is like it."""
    inner = model_at(model, place[:-1]) if problems[-1]["type"] == "extra_forbidden" else None
    return nearest(str(place[-1]), inner.model_fields) if inner else ""


def described_problem(place: Place, problems: Sequence[Mapping[str, Any]], model: type[BaseModel], above: Place) -> str:
    """The problems of one field as a sentence."""
    name, kind, value = dotted((*above, *place)) or "the file", problems[-1]["type"], problems[-1]["input"]
    if kind == "extra_forbidden":
        known = known_fields(model, place[:-1])
        return f"unknown field '{name}'; the known ones are {known}{misspelt(place, problems, model)}"
    if kind == "missing":
        inner, written = model_at(model, place[:-1]), value if isinstance(value, dict) else {}
        unknown = [str(key) for key in written if inner and str(key) not in inner.model_fields]
        like = nearest(str(place[-1]), unknown).removeprefix("; did you mean ").removesuffix("?")
        return f"field '{name}' is missing; {f'rename {like}, or ' if like else ''}add it"
    reasons = dict.fromkeys(plain_reason(problem, place, model) for problem in problems)
    first, *others = sorted(reasons, key=lambda reason: ";" in reason)  # questions for a word at the end
    reason = ", or ".join([first, *(other.removeprefix("write ") for other in others)])
    if isinstance(value, dict | list | BaseModel):
        return f"{name}: {reason}"
    shown = {"True": "true", "False": "false", "None": "null"}.get(repr(value)) or repr(value)
    return f"{name}: {shown if len(shown) <= 60 else f'{shown[:60]}...'} is not allowed: {reason}"


ADVICE = {
    "string_type": "text, in quotes if it looks like a number, a list or nothing",
    "float_type": "a number, without a unit",
    "float_parsing": "a number, without a unit, with a full stop as decimal sign",
    **dict.fromkeys(("int_parsing", "int_type", "int_from_float"), "a whole number"),
    "int_parsing_size": "a smaller number",
    "string_too_short": "at least one character",
    **dict.fromkeys(("bool_parsing", "bool_type"), "true or false"),
    **dict.fromkeys(("tuple_type", "list_type"), "a list, as [first, second]"),
    "path_type": "a path",
    "finite_number": "a finite number",
}
"""What to write, by pydantic's name of the problem."""


def plain_reason(problem: Mapping[str, Any], place: Place, model: type[BaseModel]) -> str:
    """What a field should be, as an instruction."""
    kind, text = problem["type"], str(problem["msg"]).removeprefix("Value error, ").replace("Input should be", "write")
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        fields = known_fields(model, place)
        return f"write its fields below it, as `name: value`{f'; the known ones are {fields}' if fields else ''}"
    if kind == "literal_error":
        return text + nearest(str(problem["input"]), re.findall(r"'([^']+)'", text))
    if kind == "string_pattern_mismatch":
        return f"write text of the form {problem['ctx']['pattern']}"
    if kind.startswith(("greater_than", "less_than")):
        return text.replace("write", "write a number")
    if kind == "too_short":
        return "name at least one"
    return f"write {ADVICE[kind]}" if kind in ADVICE else text


def known_fields(model: type[BaseModel], place: Place) -> str:
    inner = model_at(model, place)
    return "those of the shipped files in config/" if inner is None else ", ".join(inner.model_fields)


def model_at(model: type[BaseModel], place: Place) -> type[BaseModel] | None:
    """The model of the mapping at `place`; None if it has no model, for example in a list."""

    def is_model(annotation: Any) -> bool:
        return isinstance(annotation, type) and issubclass(annotation, BaseModel)

    here: Any = model
    for name in place:
        if is_model(here):
            field = here.model_fields.get(str(name))
            here = field.annotation if field else None
        else:
            here = get_args(here)[-1] if get_origin(here) in (dict, Mapping) else None
        here = next(filter(is_model, get_args(here)), here) if get_origin(here) in (Union, UnionType) else here
    return here if is_model(here) else None
