# SPDX-License-Identifier: Apache-2.0
"""Read YAML files (YAML 1.2) as validated settings.

An error is one line with file, line, field, value and reason. Example: `leg.yaml: line 41:
parameters.n_T.value: '83/0' is not allowed: write a number, ...`.
"""

import json
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, TypeVar

import yaml
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    NonNegativeFloat,
    PositiveFloat,
    PositiveInt,
    ValidationError,
    model_validator,
)
from pydantic_core import PydanticCustomError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from osl_analysis.base.errors import InputError, listing, naming, nearest, on_one_line, shortened
from osl_analysis.base.files import shipped

Positive = PositiveFloat
NotNegative = NonNegativeFloat
Degrees = Annotated[Positive, Field(le=180)]
FilterOrder = Annotated[PositiveInt, Field(le=10)]
CycleCount = Annotated[PositiveInt, Field(le=10_000)]
NotEmpty = Field(min_length=1)
Amplitudes = Annotated[tuple[Degrees, ...], NotEmpty]
Frequencies = Annotated[tuple[Positive, ...], NotEmpty]
JointDegrees = Annotated[Positive, Field(le=60)]  # by which an ankle can be turned
Seconds = Annotated[Positive, Field(le=10)]  # within a crossing; a larger number is in ms
Metres = Annotated[Positive, Field(le=10)]  # in a laboratory; a larger number is in mm
Newtons = Annotated[Positive, Field(le=1000)]  # vertical force that begins or ends a contact
Stiffness = Annotated[Positive, Field(le=10_000)]  # a larger number has another unit
ShippedPath = Annotated[Path, AfterValidator(shipped)]
"""A path in the campaign's folder or, if that has none, of a shipped file such as
`config/config.yaml`."""


FilesByName = Mapping[str, Path]
"""Files of a kind, by the stems of their names."""
# Keys and numbers of list entries that lead to a field, from the outermost.
Place = tuple[int | str, ...]
FILE_NAME = r"^[A-Za-z0-9_-]+$"
IDENTIFIER = r"^[A-Za-z][A-Za-z0-9]{0,30}$"
MOST_NODES = 100_000  # of a file, with those that aliases repeat; our largest has 354
MOST_LEVELS = 100  # of values in one another; the reader in C takes a time with their square
MOST_DIGITS = 1000  # of a number; Python writes none of 4,300
# of a file; the description of a ROS 2 bag of 1,000 topics has as many
MOST_YAML_LETTERS = 2_000_000
SUM_ROUNDING = 1e-9  # of a sum of fields, by which it may be above another field
MISPLACED = "misplaced"  # type of a problem that a check of ours finds
OF_EARLIER_RELEASE = "the changelog says what replaces settings of 1.0.0"


class Settings(BaseModel):
    """Base of every validated file. The settings are immutable, and an unknown field is an
    error."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _has_known_fields_alone(cls, content: Any) -> Any:
        known = cls.model_fields
        for name in content if isinstance(content, dict) else ():
            if name not in known and cls.model_config["extra"] == "forbid":
                raise misplaced(
                    f"unknown field; the known ones are {', '.join(known)} ({OF_EARLIER_RELEASE})"
                    f"{nearest(text_in(name), known)}",
                    name,
                )
        return content

    def part(self, base: "type[Settings]") -> dict[str, Any]:
        """The fields of a base class as JSON, for a job that uses only these: a change of others
        does not make its results anew."""
        return self.model_dump(mode="json", include=set(base.model_fields))


def without_truth_values(content: Any) -> Any:
    """Content of a file with truth values as text, of which pydantic makes no number."""
    if isinstance(content, dict):
        return {key: without_truth_values(inner) for key, inner in content.items()}
    if isinstance(content, list):
        return list(map(without_truth_values, content))
    return str(content).lower() if isinstance(content, bool) else content


AnySettings = TypeVar("AnySettings", bound=Settings)


def as_json(setting: Any) -> Any:
    """A section of a configuration as JSON, for a job; a single setting as it is."""
    return setting.model_dump(mode="json") if isinstance(setting, BaseModel) else setting


def read_yaml(path: Path, model: type[AnySettings]) -> AnySettings:
    """A YAML file as a model. InputError: as `read_mapping`; a field is unknown, absent or of a
    wrong value."""
    return validated(read_mapping(path), model, path)


def read_mapping(path: Path) -> dict[str, Any]:
    """The top level of a YAML file. It is cached and shared: do not change it. Raises InputError:
    the file is missing, is not YAML, has a key twice, or is no mapping."""
    if not path.is_file():
        beside_it = (file.stem for file in path.parent.glob(f"*{path.suffix}"))
        raise InputError(f"{path}: no such file", f"check the path{nearest(path.stem, beside_it)}")
    try:
        with naming(path):
            content = parsed_yaml(path.read_text(encoding="utf-8-sig"))
    except InputError:
        raise
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror})", "check its permissions"
        ) from error
    except (*NOT_YAML, ValueError) as error:  # ValueError: it is not UTF-8
        mark = getattr(error, "problem_mark", None)
        line = f"line {mark.line + 1}: " if mark else ""
        problem = getattr(error, "problem", None) or on_one_line(error)
        raise InputError(
            f"{path}: {line}not YAML: {problem}",
            "put text with signs as : # * % in quotes, and indent with blanks",
        ) from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: has no fields", "write `name: value` lines")
    return content


@lru_cache
def parsed_yaml(text: str, kind: str = "safe") -> Any:
    """The content of a YAML text; of kind `rt` it knows the lines of its fields."""
    check_size(text)
    return YAML(typ=kind, pure=True).load(text)  # the parser in C reads YAML 1.1


NOT_YAML = (YAMLError, yaml.YAMLError, RecursionError)
"""Errors of both readers."""


def check_size(text: str) -> None:
    """Refuse YAML of more nodes than any file of ours has, before they are made: by a few aliases
    of aliases, a kilobyte is a billion nodes."""
    size_of: dict[str | None, int] = {}  # nodes below an anchor, with itself
    begun: list[tuple[str | None, int]] = []  # anchors that are not ended, and nodes before them
    nodes = 0
    for event in yaml.parse(text[: MOST_YAML_LETTERS + 1], yaml.CSafeLoader):
        if isinstance(event, yaml.AliasEvent):
            nodes += size_of.get(event.anchor, 1)
        elif isinstance(event, yaml.NodeEvent):
            size_of[event.anchor] = MOST_NODES  # of an alias within itself
            begun.append((event.anchor, nodes))
            nodes += 1
        if isinstance(event, yaml.ScalarEvent | yaml.CollectionEndEvent):
            anchor, before = begun.pop()
            size_of[anchor] = nodes - before
        if isinstance(event, yaml.ScalarEvent) and event.value[MOST_DIGITS:].isalnum():
            raise InputError(
                f"YAML with a number of over {MOST_DIGITS} digits", "write a smaller one"
            )
        if nodes > MOST_NODES or len(begun) > MOST_LEVELS or len(text) > MOST_YAML_LETTERS:
            raise InputError(
                f"YAML of more than {MOST_NODES} values, with those that aliases repeat,"
                f" {MOST_LEVELS} levels or {MOST_YAML_LETTERS} letters",
                "write less, without aliases",
            )


def text_in(value: object) -> str:
    """A text of a file; empty for what is none, which may be of any size."""
    return value if isinstance(value, str) else ""


def field_line(path: Path, place: Place) -> int | None:
    """Line, counted from 1, of a field, or of the innermost field above it in the file; None if
    there is none."""
    line = None
    not_read = (OSError, *NOT_YAML, ValueError, LookupError, TypeError, AttributeError)
    with suppress(*not_read):
        content = parsed_yaml(path.read_text(encoding="utf-8-sig"), "rt")
        for name in place:
            # mappings and lists know the line and column of each entry
            line = content.lc.data[name][0] + 1
            content = content[name]
    return line


def located(files: Sequence[Path], place: Place) -> str:
    """`line 12: ` in the last of the files that has the field, with its name if there are several;
    empty if none."""
    for file in reversed(files):
        line = field_line(file, place)
        if line is not None:
            file_name = f" of {file.name}" if len(files) > 1 else ""
            return f"line {line}{file_name}: "
    return ""


def flat(settings: Mapping[str, Any]) -> dict[str, str]:
    """Nested settings as JSON by dotted name."""
    by_name: dict[str, str] = {}
    for key, value in settings.items():
        if isinstance(value, dict) and value:
            by_name.update((f"{key}.{name}", text) for name, text in flat(value).items())
        else:
            by_name[key] = json.dumps(value, default=str)
    return by_name


def dotted(place: Place) -> str:
    """A place in a file, as in `walking.markers.foot`."""
    return ".".join(map(str, place))


# what a draft leaves to the user
UNKNOWN = "UNKNOWN"  # a value that the recordings do not tell
NAME_OF_TIME = "NAME_OF_TIME"  # the column of time, if no column is named like a clock


def open_places(content: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The places of a draft that the user must still edit: placeholder names and unknown values,
    also in a list."""
    if not isinstance(content, dict):
        return
    for key, value in content.items():
        place = (*above, text_in(key))
        values = value if isinstance(value, list) else [value]
        is_open = UNKNOWN in values or NAME_OF_TIME in values
        if is_open or re.fullmatch(r"NAME_\d+", text_in(key)):
            yield place
        else:
            yield from open_places(value, place)


def validated(
    content: Any,
    model: type[AnySettings],
    path: Path | str,
    files: Sequence[Path] | None = None,
) -> AnySettings:
    """The content of a configuration file as a model; for messages `path`, and `files` with
    lines. A draft with places to be edited is refused."""
    yaml_files = [Path(path)] if files is None else files
    if yaml_files:  # a cell of a sheet may have any text
        unedited = [f"{located(yaml_files, at)}`{dotted(at)}`" for at in open_places(content)]
        if unedited:
            raise InputError(
                f"{path}: a draft with places to be edited: {listing(unedited)}",
                "its comments say how",
            )
    try:
        return model.model_validate(without_truth_values(content))
    except ValidationError as error:
        # by place: pydantic finds a problem for each kind of value that a field may have
        problems_at: dict[Place, list[Any]] = {}
        for problem in error.errors():
            problems_at.setdefault(problem_place(problem, content), []).append(problem)

    # a check of ours first: an unknown field may be the missing one. A problem of a field makes one
    # of what is above it
    first = max(problems_at, key=lambda at: (problems_at[at][0]["type"] == MISPLACED, len(at)))
    missing = [at for at in problems_at if problems_at[at][0]["type"] == "missing"]
    places = missing if first in missing else [first]
    line = located(yaml_files, first)
    names = ", ".join(map(dotted, places)) or "the file"
    # pydantic has one text for both
    reason, _, remedy = problem_text(problems_at[first]).partition("; ")
    raise InputError(f"{path}: {line}{names}: {reason}", remedy, settings=[dotted(first)])


NO_NUMBER = r"valid \w+, unable to parse string as an? \w+"
WORDS = {
    "Value error, ": "",
    "Field required": "is missing; add it",
    r"\w+ should have (at (least|most) \d+ items?) after validation, not \d+": r"write \1",
    "Input should be": "write",
    "a valid tuple": "a list",
    r"a valid dictionary( or instance of \w+)?": "fields below it, each as `name: value`",
    "write (?=less|greater)": "write a number ",
}
"""What is said in place of pydantic's words."""


def problem_text(problems: Sequence[Mapping[str, Any]]) -> str:
    """What is wrong with one field, and what is allowed: by a check of ours, where there is one."""
    checks = [problem for problem in problems if problem["type"] == "value_error"]
    problems = checks or problems
    value = problems[0]["input"]
    reason = ", or ".join(dict.fromkeys(str(problem["msg"]) for problem in problems))
    begins_with_number = re.match(r"[-+.]?\d", text_in(value))
    number = "number without a unit (3 % is 0.03)" if begins_with_number else "number"
    reason = re.sub(NO_NUMBER, number, reason)
    for pydantics, plain in WORDS.items():
        reason = re.sub(pydantics, plain, reason)
    if isinstance(value, dict | list | BaseModel):
        return reason
    written = "null" if value is None else shortened(repr(value))
    return f"{written} is not allowed: {reason}"


def problem_place(problem: Mapping[str, Any], content: Any) -> Place:
    """The field of a problem, without the names that pydantic gives to kinds of values. A check of
    several fields gives the wrong one as `place` in its context."""
    place = []
    for name in problem["loc"]:
        with suppress(LookupError, TypeError):
            content = content[name]
            place.append(name)
    if problem["type"] == "missing":
        place.append(problem["loc"][-1])
    return (*place, *problem.get("ctx", {}).get("place", ()))


def from_fraction(value: object) -> object:
    """A number that may be written as products and quotients of numbers, from left to right, such
    as `1/4096` and `0.25*9.80665/32768`."""
    if not isinstance(value, str):
        return value
    first, *signs_and_terms = re.split(r"([*/])", value)
    try:
        number = Fraction(first)
        for sign, text in zip(signs_and_terms[::2], signs_and_terms[1::2], strict=True):
            factor = Fraction(text)
            number = number * factor if sign == "*" else number / factor
        return float(number)
    except (ValueError, ArithmeticError) as error:
        raise ValueError("write a number, or numbers with * and /, such as 83/18") from error


def misplaced(reason: str, *place: str) -> PydanticCustomError:
    """An error of a check that sees several fields; `place` is the field below them that is
    wrong."""
    return PydanticCustomError(MISPLACED, "{reason}", {"reason": reason, "place": place})


def refuse_if(wrong: Callable[[Any], Any], reason: str, field: str = "") -> Any:
    """A check that refuses settings if `wrong` holds for them. `{s.field}` in the `reason` is
    replaced by their value. `field` is the dotted name of the field to be corrected, if there is
    one."""

    def check(settings: Any) -> Any:
        if wrong(settings):
            raise misplaced(reason.format(s=settings), *filter(None, field.split(".")))
        return settings

    return model_validator(mode="after")(check)


def require_at_most(low: str, high: str, why: str) -> Any:
    """A check that a field, or a sum as `guard_s + window_s`, is not above another; `why` is for
    the message."""

    def check(settings: Any) -> Any:
        fields = low.split(" + ")
        low_value = sum(attrgetter(field)(settings) for field in fields)
        high_value = attrgetter(high)(settings)
        if low_value > high_value + SUM_ROUNDING:
            raise misplaced(
                f"{low} = {low_value:g} is above {high} = {high_value:g}, {why}; lower {low}, or"
                f" raise {high}",
                *fields[0].split("."),
            )
        return settings

    return model_validator(mode="after")(check)


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
        f"'{name}' is no {kind}", f"write one of {listing([*names])}{nearest(name, names)}"
    )
