"""Validated YAML files (YAML 1.2): a wrong field becomes one line that names file, line, field,
value and remedy."""

import hashlib
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from datetime import date
from functools import lru_cache
from itertools import chain, pairwise
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

import yaml
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from osl_analysis.errors import InputError, Removal, RemovedFieldError, listing, nearest
from osl_analysis.files import digest, shipped
from osl_analysis.renamed import NewName, RenamedWarning, warn_caller

Positive = Annotated[float, Field(gt=0)]  # A number above zero.
NotNegative = Annotated[float, Field(ge=0)]  # A number of zero or more.
Degrees = Annotated[float, Field(gt=0, le=180)]  # An angle above zero, at most half a turn.
JointDegrees = Annotated[float, Field(gt=0, le=60)]  # An angle by which an ankle can be turned.
# A time within a crossing, or a gap; a larger number is in ms.
Seconds = Annotated[float, Field(gt=0, le=10)]
Metres = Annotated[float, Field(gt=0, le=10)]  # A length in a laboratory; a larger number is in mm.
# A threshold of vertical force at which a contact begins or ends.
Newtons = Annotated[float, Field(gt=0, le=1000)]
# Stiffness of a joint; a larger number has another unit.
Stiffness = Annotated[float, Field(gt=0, le=10_000)]
ShippedPath = Annotated[Path, AfterValidator(shipped)]
"""A path in the campaign's folder or, if that has none, of a shipped file such as
`config/config.yaml`."""
# Keys and numbers of list entries that lead to a field, from the outermost.
Place = tuple[int | str, ...]


class Settings(BaseModel):
    """Base of every validated file. The settings are immutable, and an unknown field is an
    error."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)
    # removed fields, each with a sentence on what to write or do now
    REMOVED: ClassVar[Mapping[str, str]] = {}
    # fields that have another name
    RENAMED: ClassVar[Mapping[str, NewName]] = {}
    # words behind "the known ones" in messages, as ` of format csv`
    OF: ClassVar[str] = ""

    @model_validator(mode="before")
    @classmethod
    def _has_known_fields_alone(cls, content: Any) -> Any:
        fields = ", ".join(cls.model_fields) or "those of the shipped files in config/"
        if not isinstance(content, dict | BaseModel):
            raise ValueError(
                f"write its fields below it, as `name: value`; the known ones are {fields}"
            )
        if isinstance(content, BaseModel) or cls.model_config.get("extra") != "forbid":
            return content
        for name in content:
            if name in cls.model_fields:
                continue
            suggestion = nearest(str(name), cls.model_fields)
            if name in cls.REMOVED:
                raise removed(cls.REMOVED[name], name)
            if name in cls.RENAMED:
                raise renamed(cls.RENAMED[name], name)
            reason = f"unknown field '{{field}}'; the known ones{cls.OF} are {fields}{suggestion}"
            raise PydanticCustomError(
                "unknown_field", "{reason}", {"reason": reason, "place": (name,)}
            )
        return content

    @field_validator("*", mode="before")
    @classmethod
    def _truth_values_are_words(cls, value: Any) -> Any:
        """Turn a truth value into text, which fields of numbers refuse: pydantic would make 1 of
        it."""
        if isinstance(value, bool):
            return str(value).lower()
        if isinstance(value, dict):
            return {key: cls._truth_values_are_words(inner) for key, inner in value.items()}
        if isinstance(value, list):
            return [cls._truth_values_are_words(inner) for inner in value]
        return value

    def part(self, base: str) -> dict[str, Any]:
        """The fields of the base class of this name, as JSON, for a job that uses only these: a
        rule of Snakemake imports no settings model."""
        bases = {
            model.__name__: model for model in type(self).__mro__ if issubclass(model, Settings)
        }
        return self.model_dump(mode="json", include=set(bases[base].model_fields))


AnySettings = TypeVar("AnySettings", bound=Settings)


def as_json(setting: Any) -> Any:
    """A section of a configuration as JSON, for a job; a single setting as it is."""
    return setting.model_dump(mode="json") if isinstance(setting, BaseModel) else setting


def read_yaml(path: Path, model: type[AnySettings]) -> AnySettings:
    """A YAML file as a model. InputError: as `read_mapping`; a field is unknown, absent or of a
    wrong value."""
    return validated(read_mapping(path), model, path)


def read_mapping(path: Path, by_snakemake: bool = False) -> dict[str, Any]:
    """The top level of a YAML file. It is cached and shared: do not change it. Raises InputError:
    the file is missing, is not YAML, or is no mapping; `by_snakemake`: a number differs in YAML
    1.1, which Snakemake reads."""
    if not path.is_file():
        beside_it = (file.stem for file in path.parent.glob(f"*{path.suffix}"))
        raise InputError(
            f"{path}: no such file; check the path, which is relative to the working"
            f" directory{nearest(path.stem, beside_it)}"
        )
    try:
        text = path.read_text(encoding="utf-8-sig")
        node, content = parsed_yaml(text)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); check its permissions"
        ) from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(f"{path}: line {line} is not UTF-8; save the file as UTF-8") from error
    except RecursionError as error:
        raise InputError(
            f"{path}: its fields are nested too deeply, or its aliases (`*name`) stand for too"
            " many; write them out as in the shipped files"
        ) from error
    # the last five are of a wrong tag, as `!!float text`
    except (
        yaml.YAMLError,
        ValueError,
        AttributeError,
        KeyError,
        TypeError,
        OverflowError,
    ) as error:
        raise InputError(f"{path}: not YAML: {yaml_problem(error, text)}") from error
    if not isinstance(content, dict):
        raise InputError(
            f"{path}: has no fields; write `name: value` lines as in the shipped files"
        )
    for inner in nodes_of(node):
        if isinstance(inner, yaml.MappingNode):
            check_keys_once(path, inner)
        elif by_snakemake and isinstance(inner, yaml.ScalarNode) and not inner.style:
            check_same_number(path, inner)
    return content


def check_keys_once(path: Path, node: yaml.MappingNode) -> None:
    """Refuse a mapping with a key that stands twice."""
    keys: set[str] = set()
    for key, _ in node.value:
        if key.value in keys:
            line = key.start_mark.line + 1
            raise InputError(f"{path}: line {line}: key '{key.value}' stands twice; remove one")
        keys.add(str(key.value))


# as 1:30, which YAML 1.1 takes for 90
IN_SIXTIES = re.compile(r"[-+]?[0-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?")
IN_EIGHTS = re.compile(r"[-+]?0[0-7_]+")  # as 010, which it takes for 8


def check_same_number(path: Path, node: yaml.ScalarNode) -> None:
    """Refuse a text without quotes that is another number in YAML 1.1, which Snakemake reads."""
    for form, base in ((IN_SIXTIES, "sixties"), (IN_EIGHTS, "eights")):
        if form.fullmatch(node.value):
            raise InputError(
                f"{path}: line {node.start_mark.line + 1}: YAML counts {node.value} in {base};"
                " write a plain decimal number, or text in quotes"
            )


def yaml_problem(error: Exception, text: str) -> str:
    """What is wrong in a text that is no YAML, and how to write it."""
    problem = " ".join(str(error).split())
    if isinstance(error, yaml.MarkedYAMLError):
        problem = " ".join(marked_parts(error))
    if re.search(r"(?m)^\s*//", text):
        return (
            f"{problem}; begin comments with #, not with //, and put text with such signs in quotes"
        )
    if "cannot start any token" in problem or "tab character" in problem:
        return (
            f"{problem}; indent with blanks, not with tabs, and put text that begins with a sign"
            " such as % or @ in quotes"
        )
    return f"{problem}; compare with the shipped files, and put text with signs as : # * in quotes"


def marked_parts(error: yaml.MarkedYAMLError) -> Iterator[str]:
    """What a parser was reading and what it met, each with its line and column."""
    parts = ((error.context, error.context_mark), (error.problem, error.problem_mark))
    for part, mark in parts:
        if part and mark:
            yield f"{part} in line {mark.line + 1}, column {mark.column + 1}"
        elif part:
            yield part


class Loader(yaml.CSafeLoader):
    """YAML 1.2, read by the library in C: `off` is text, and so is 1:30; 010 is ten."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 (the constants below)

    def whole_number(self, node: yaml.ScalarNode) -> int:
        return int(node.value.replace("_", ""), 0 if re.match("[-+]?0[ox]", node.value) else 10)


for kind, first, form in (
    ("bool", "tTfF", "true|True|TRUE|false|False|FALSE"),
    ("int", "-+0123456789", r"[-+]?[0-9][0-9_]*|[-+]?0o[0-7_]+|[-+]?0x[0-9a-fA-F_]+"),
    ("float", "-+.0123456789",
     r"[-+]?(\.[0-9]+|[0-9][0-9_]*(\.[0-9_]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)"
     r"|\.(nan|NaN|NAN)"),
    ("null", ["~", "n", "N", ""], "~|null|Null|NULL|"),
    ("timestamp", "0123456789",
     r"[0-9]{4}-[0-9]{2}-[0-9]{2}|[0-9]{4}-[0-9]{1,2}-[0-9]{1,2}([Tt]|[ \t]+)[0-9]{1,2}"
     r":[0-9]{2}:[0-9]{2}(\.[0-9]*)?([ \t]*(Z|[-+][0-9]{1,2}(:[0-9]{2})?))?"),
    ("merge", "<", "<<"),
):  # fmt: skip
    Loader.add_implicit_resolver(f"tag:yaml.org,2002:{kind}", re.compile(f"^(?:{form})$"), first)
Loader.add_constructor("tag:yaml.org,2002:int", Loader.whole_number)


@lru_cache(maxsize=64)
def parsed_yaml(text: str) -> tuple[yaml.Node | None, Any]:
    """The nodes of a YAML text, with their lines, and its content."""
    depth = 0
    # the parser of nodes would crash on deeply nested ones
    for event in yaml.parse(text, yaml.CSafeLoader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(
            event, yaml.CollectionEndEvent
        )
        if depth > 100:
            raise RecursionError
    loader = Loader(text)
    try:
        node = loader.get_single_node()
        nodes_of(node)  # refuses a file whose aliases stand for too many
        return node, loader.construct_document(node) if node is not None else None
    finally:
        loader.dispose()


MOST_NODES = 200_000  # of a file with its aliases written out


def nodes_of(node: yaml.Node | None) -> list[yaml.Node]:
    """A node and all below it. Aliases may stand for millions; one of itself raises
    RecursionError."""
    nodes = [] if node is None else [node]
    for above in nodes:  # which grows meanwhile
        if isinstance(above, yaml.MappingNode):
            nodes.extend(chain.from_iterable(above.value))
        elif isinstance(above, yaml.SequenceNode):
            nodes.extend(above.value)
        if len(nodes) > MOST_NODES:
            raise RecursionError
    return nodes


def content_digest(path: Path) -> str | None:
    """SHA-256 of a file's content. For YAML: without comments, order of keys, and `description`,
    from which nothing is computed. For another file, or an unreadable YAML file: of its bytes. None
    if there is no such file."""
    if path.suffix != ".yaml" or not path.is_file():
        return digest(path)
    try:
        content = parsed_yaml(path.read_text(encoding="utf-8-sig"))[1]
    except (
        OSError,
        ValueError,
        AttributeError,
        KeyError,
        TypeError,
        RecursionError,
        yaml.YAMLError,
    ):
        return digest(path)
    if isinstance(content, dict):
        content = {key: value for key, value in content.items() if key != "description"}
    return hashlib.sha256(repr(in_order(content)).encode()).hexdigest()


def in_order(content: Any) -> Any:
    """Nested mappings and lists with the keys of each mapping in order."""
    if isinstance(content, dict):
        return {key: in_order(content[key]) for key in sorted(content, key=repr)}
    if isinstance(content, list):
        return [in_order(entry) for entry in content]
    return content


def field_line(path: Path, place: Place) -> int | None:
    """Line, counted from 1, of a field, or of the innermost field above it in the file; None if
    there is none."""
    try:
        node, _ = parsed_yaml(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError, yaml.YAMLError):
        return None
    line = None
    for name in place:
        key = None
        if isinstance(node, yaml.MappingNode):
            key, node = next(
                (pair for pair in node.value if pair[0].value == str(name)), (None, None)
            )
        elif (
            isinstance(node, yaml.SequenceNode) and isinstance(name, int) and name < len(node.value)
        ):
            key = node = node.value[name]
        if key is None:
            break
        line = key.start_mark.line + 1
    return line


def located(files: Sequence[Path], place: Place) -> str:
    """`line 12: ` in the last of the files that has the field, with its name if there are several;
    empty if none."""
    for file in reversed(files):
        line = field_line(file, place)
        if line is not None:
            of_file = f" of {file.name}" if len(files) > 1 else ""
            return f"line {line}{of_file}: "
    return ""


def dotted(place: Place) -> str:
    """A place in a file, as in `walking.markers.foot`."""
    return ".".join(map(str, place))


def validated(
    content: Any,
    model: type[AnySettings],
    path: Path,
    files: Sequence[Path] | None = None,
    above: Place = (),
) -> AnySettings:
    """The content of a configuration file as a model; for messages `path`, `files` with lines, and
    keys `above` it. A field by its old name counts, with a warning, until that name goes."""
    while True:
        try:
            return model.model_validate(content)
        except ValidationError as error:
            first = first_problem(error, content, above)
            line = ""
            if first.place:
                line = located([Path(path)] if files is None else files, first.place)
            message = f"{path}: {line}{first.text}"
            if first.removal is None:
                raise InputError(message) from error
            if first.removal.new_name:
                check_has_one_name([Path(path)] if files is None else files, first.removal)
            if not first.removal.old_name_works:
                raise RemovedFieldError(message, (), first.removal) from error
        warn_caller(RenamedWarning(message, first.removal))
        content = with_new_name(content, first.removal.place[len(above) :], first.removal.new_name)


def check_has_one_name(files: Sequence[Path], removal: Removal) -> None:
    """Refuse a field that has both its old and its new name, in one file or the new one in a later
    file: one of the two values would be lost in silence."""
    new_place = (*removal.place[:-1], removal.new_name)
    has_old_name = False
    for file in files:
        has_old_name = has_old_name or is_stated(file, removal.place)
        if has_old_name and is_stated(file, new_place):
            raise InputError(
                f"{file}: field '{dotted(removal.place)}' is called {removal.new_name} now, and"
                " that stands there too; remove the line of the wrong value"
            )


def is_stated(path: Path, place: Place) -> bool:
    """Whether a YAML file has a field."""
    try:
        _, content = parsed_yaml(path.read_text(encoding="utf-8-sig"))
        for name in place:
            content = content[name]
    except (OSError, ValueError, RecursionError, yaml.YAMLError, LookupError, TypeError):
        return False
    return True


def with_new_name(content: Any, place: Place, new_name: str) -> Any:
    """Nested settings in which the field at a place has another name."""
    name, *below = place
    copied = copy(content)
    if below:
        copied[name] = with_new_name(copied[name], tuple(below), new_name)
    else:
        copied[new_name] = copied.pop(name)
    return copied


@dataclass(frozen=True)
class Problem:
    """What is wrong with a field of a configuration file."""

    text: str  # one sentence with field, value and remedy
    place: Place  # of the field in its file
    removal: Removal | None  # if an earlier release had the field


def first_problem(error: ValidationError, content: Any, above: Place) -> Problem:
    """The first problem of a validation error. `above` are the keys that lead to `content` in its
    file. A removed field comes before an unknown one, and that before all other problems."""
    # by place: pydantic finds a problem for each kind of value that a field may have
    problems_at: dict[Place, list[Mapping[str, Any]]] = {}
    for problem in error.errors():
        problems_at.setdefault(problem_place(problem, content), []).append(problem)
    # a problem of a field makes one of what is above it, which is not told
    above_others = {place[:n] for place in problems_at for n in range(len(place))}
    places = [place for place in problems_at if place not in above_others or not place]
    by_type = {problems_at[place][-1]["type"]: place for place in reversed(places)}
    first = by_type.get("removed_field") or by_type.get("unknown_field") or places[0]

    text = problem_text(dotted((*above, *first)) or "the file", problems_at[first])
    n_more = len(places) - 1
    if n_more == 1:
        text += " (and 1 more problem)"
    elif n_more > 1:
        text += f" (and {n_more} more problems)"
    place = (*above, *first)
    last = problems_at[first][-1]
    removal = None
    if last["type"] == "removed_field":
        removal = replace(last["ctx"]["removal"], place=place)
    return Problem(text, place, removal)


LONGEST_VALUE = 60  # signs of a wrong value that a message shows


def problem_text(field: str, problems: Sequence[Mapping[str, Any]]) -> str:
    """The problems of one field, of which one is enough to be mended, as one sentence."""
    last = problems[-1]
    if last["type"] in ("unknown_field", "removed_field"):
        return str(last["msg"]).replace("{field}", field)
    if last["type"] == "missing":
        return f"field '{field}' is missing; add it"
    reasons = dict.fromkeys(plain_reason(problem) for problem in problems)
    # those that end with a question, as whether another name was meant, come last
    first, *further = sorted(reasons, key=lambda reason: ";" in reason)
    reason = ", or ".join([first, *(text.removeprefix("write ") for text in further)])
    value = last["input"]
    if isinstance(value, dict | list | BaseModel):
        return f"{field}: {reason}"
    written = str(value) if isinstance(value, date) else repr(value)
    if value is None:
        written = "null"
    if len(written) > LONGEST_VALUE:
        written = f"{written[:LONGEST_VALUE]}..."
    return f"{field}: {written} is not allowed: {reason}"


def problem_place(problem: Mapping[str, Any], content: Any) -> Place:
    """The field of a problem. A check of several fields gives the wrong one as `place` in its
    context. Parts that are not in the content, such as the kind of value that was tried, are
    pydantic's and are left out."""
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
        elif isinstance(here, BaseModel) or (
            problem["type"] == "missing" and name == problem["loc"][-1]
        ):
            place.append(name)
            here = getattr(here, str(name), None)
    return (*place, *problem.get("ctx", {}).get("place", ()))


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
    "dict_type": "its fields below it, as `name: value`",
}
"""What to write, by pydantic's name of the problem."""


FILE_NAME = r"^[A-Za-z0-9_-]+$"
IDENTIFIER = r"^[A-Za-z][A-Za-z0-9]{0,30}$"
ADVICE_BY_PATTERN = {
    FILE_NAME: "letters, digits, _ and - alone",
    IDENTIFIER: "letters and digits alone, a letter first, 31 at most",
}
"""What to write, by the pattern of a field of text."""
WITH_UNIT = {
    "delay": "2 ms", "cutoff": "100 Hz", "resolution": "0.02 deg", "range": "60 N*m",
    "threshold": "0.05 s", "value": "12500 N*m/rad", "standard_error": "100 N*m/rad",
}  # fmt: skip
"""An example of fields that are a number with its unit."""
UNIT_BY_ENDING = {
    "_deg": "deg", "_hz": "Hz", "_s": "s", "_m": "m", "_mm": "mm", "_kg": "kg", "_n": "N",
    "K_d": "N*m/rad", "largest_angle": "rad",
}  # fmt: skip


def unit_behind(place: Sequence[int | str]) -> str:
    """The unit of a field with a blank before it, by the end of its name; empty for none."""
    names = [name for name in place if isinstance(name, str)]
    for ending, unit in UNIT_BY_ENDING.items():
        if names and names[-1].endswith(ending):
            return f" {unit}"
    return ""


def plain_reason(problem: Mapping[str, Any]) -> str:
    """What is to be written in place of what a problem of pydantic is about."""
    kind = problem["type"]
    text = str(problem["msg"]).removeprefix("Value error, ").replace("Input should be", "write")
    if kind == "literal_error":
        return text + nearest(str(problem["input"]), re.findall(r"'([^']+)'", text))
    if kind == "string_type" and problem["input"] is not None:
        example = WITH_UNIT.get(str(problem["loc"][-1]))
        if example:
            return f"write a number with its unit, as `{example}`"
    if kind == "string_pattern_mismatch":
        return f"write {ADVICE_BY_PATTERN[problem['ctx']['pattern']]}"
    if kind.startswith(("greater_than", "less_than")):
        number = text.replace("write", "write a number")
        return number if text.split()[-1] == "0" else f"{number}{unit_behind(problem['loc'])}"
    if kind == "too_short":
        return "name at least one"
    return f"write {ADVICE[kind]}" if kind in ADVICE else text


# Relations between settings. Each is one line of its model. A violation is reported as a wrong
# field.


def misplaced(reason: str, *place: str) -> PydanticCustomError:
    """An error of a check that sees several fields; `place` is the field below them that is
    wrong."""
    return PydanticCustomError("misplaced", "{reason}", {"reason": reason, "place": place})


def removed(instead: str, *place: str) -> PydanticCustomError:
    """An error for a field that an earlier release had.

    Parameters
    ----------
    instead : str
        What does without the field now.
    *place : str
        Keys that lead to the field from the settings that find it.
    """
    reason = f"field '{{field}}' is gone: {instead}; remove the line, {AS_UPGRADE_DOES}"
    return of_earlier_release(reason, Removal(place, instead, ""))


def renamed(new: NewName, *place: str) -> PydanticCustomError:
    """An error, as `removed`, for a field that has another name; `validated` makes a warning of it
    as long as the old one works."""
    reason = f"field '{{field}}' has another name; write {new.name}, {AS_UPGRADE_DOES}"
    if new.old_one_works:
        reason += f": the old one goes in release {new.goes_in}"
    return of_earlier_release(reason, Removal(place, "", new.name, new.old_one_works))


AS_UPGRADE_DOES = "as `osl-analysis doctor --upgrade` does"


def of_earlier_release(reason: str, removal: Removal) -> PydanticCustomError:
    """The error of `removed` and `renamed`, from which `first_problem` has the `removal`."""
    context = {"reason": reason, "place": removal.place, "removal": removal}
    return PydanticCustomError("removed_field", "{reason}", context)


def refuse_if(wrong: Callable[[Any], Any], reason: str, field: str = "") -> Any:
    """A check that refuses settings if `wrong` holds for them. `{s.field}` in the `reason` is
    replaced by their value. `field` is the dotted name of the field to be corrected, if there is
    one."""

    def check(settings: Any) -> Any:
        if wrong(settings):
            raise misplaced(reason.format(s=settings), *filter(None, field.split(".")))
        return settings

    return model_validator(mode="after")(check)


ROUNDING = 1e-9  # of sums of settings


def require_below(low: str, high: str, why: str, or_equal: bool = False) -> Any:
    """A check that a field, or a sum as `guard_s + window_s`, is below another, or equal; `why` is
    for the message."""

    def check(settings: Any) -> Any:
        low_value = sum_of_fields(settings, low)
        high_value = sum_of_fields(settings, high)
        if low_value - high_value > (ROUNDING if or_equal else -ROUNDING):
            reason = (
                f"{low} = {low_value:g} is not below {high} = {high_value:g}, {why}; lower {low},"
                f" or raise {high}"
            )
            first_field = low.split(" + ")[0]
            raise misplaced(reason, *first_field.split("."))
        return settings

    return model_validator(mode="after")(check)


def sum_of_fields(settings: Any, names: str) -> float:
    """The sum of fields by their dotted names, as of `guard_s + window_s`."""
    total: float = sum(attrgetter(name)(settings) for name in names.split(" + "))
    return total


def check_rising(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """A check that each value of a list, such as of two bounds, is below the next."""
    for value, following in pairwise(values):
        if value >= following:
            raise ValueError(
                f"{following} stands behind {value}; write each once, from low to high"
            )
    return values


def check_distinct(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """A check that no value of a list, or no name of its entries, stands twice."""
    names = [getattr(value, "name", value) for value in values]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"'{name}' stands twice; name each once")
    return values


def check_known(names: Collection[str], kind: str, name: str) -> str:
    """A check that a name is among these; `kind` says in the message what they are."""
    if name in names:
        return name
    raise InputError(
        f"'{name}' is no {kind}; write one of {listing([*names], 14)}{nearest(name, names)}"
    )
