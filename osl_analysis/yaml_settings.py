"""Validated YAML files: a wrong field becomes one line with file, line, field, value and reason."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from osl_analysis.errors import InputError, listing, nearest
from osl_analysis.files import shipped

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Degrees = Annotated[float, Field(gt=0, le=180)]
JointDegrees = Annotated[float, Field(gt=0, le=60)]
Seconds = Annotated[float, Field(gt=0, le=10)]
Metres = Annotated[float, Field(gt=0, le=10)]
Newtons = Annotated[float, Field(gt=0, le=1000)]
Stiffness = Annotated[float, Field(gt=0, le=10000)]
ShippedPath = Annotated[Path, AfterValidator(shipped)]
Place = tuple[int | str, ...]
FILE_NAME = r"^[A-Za-z0-9_-]+$"
IDENTIFIER = r"^[A-Za-z][A-Za-z0-9]{0,30}$"
ROUNDING = 1e-9


class Settings(BaseModel):
    """Base of every validated file. The settings are immutable, and an unknown field is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)
    REMOVED: ClassVar[Mapping[str, str]] = {}  # by field of an earlier release: what to do instead
    OF: ClassVar[str] = ""

    @model_validator(mode="before")
    @classmethod
    def _has_known_fields_alone(cls, content: Any) -> Any:
        if not isinstance(content, dict) or cls.model_config.get("extra") != "forbid":
            return content
        for name in content:
            if name in cls.REMOVED:
                raise misplaced(f"is gone: {cls.REMOVED[name]}; remove the line", name)
            if name not in cls.model_fields:
                known = ", ".join(cls.model_fields)
                raise misplaced(
                    f"is unknown; the known fields{cls.OF} are {known}"
                    f"{nearest(str(name), cls.model_fields)}",
                    name,
                )
        return content

    def part(self, base: str) -> dict[str, Any]:
        """The fields of the base class of this name, as JSON, for a job that uses only these."""
        bases = {
            model.__name__: model for model in type(self).__mro__ if issubclass(model, Settings)
        }
        return self.model_dump(mode="json", include=set(bases[base].model_fields))


AnySettings = TypeVar("AnySettings", bound=Settings)


def as_json(setting: Any) -> Any:
    """A section of a configuration as JSON, for a job; a single setting as it is."""
    return setting.model_dump(mode="json") if isinstance(setting, BaseModel) else setting


class Loader(yaml.CSafeLoader):
    """YAML in which `off` and 1:30 are text."""


Loader.yaml_implicit_resolvers = {
    first: [(tag, form) for tag, form in resolvers if not tag.endswith((":bool", ":int", ":float"))]
    for first, resolvers in yaml.CSafeLoader.yaml_implicit_resolvers.items()
}
for _kind, _first, _form in (
    ("bool", "tf", "true|false"),
    ("int", "-+0123456789", "[-+]?[0-9]+"),
    ("float", "-+.0123456789", r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?"),
):
    Loader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_kind}", re.compile(f"^(?:{_form})$"), list(_first)
    )


def read_yaml(path: Path, model: type[AnySettings]) -> AnySettings:
    """A YAML file as a model."""
    return validated(read_mapping(path), model, path)


def read_mapping(path: Path, by_snakemake: bool = False) -> dict[str, Any]:
    """The top level of a YAML file. Raises InputError: it is missing, or no mapping in YAML."""
    if not path.is_file():
        beside = [file.stem for file in path.parent.glob(f"*{path.suffix}")]
        raise InputError(f"{path}: no such file; check the path{nearest(path.stem, beside)}")
    try:
        content = yaml.load(path.read_text(encoding="utf-8-sig"), Loader)
    except (yaml.YAMLError, OSError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InputError(
            f"{path}: not YAML: {reason}; put text with signs as : # * % in quotes"
        ) from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: has no fields; write `name: value` lines")
    return content


def node_of(path: Path) -> yaml.Node | None:
    """The nodes of a YAML file, with their lines."""
    return yaml.compose(path.read_text(encoding="utf-8-sig"), Loader)


def field_line(path: Path, place: Place) -> int | None:
    """Line, counted from 1, of a field, or of the innermost field above it in the file."""
    line = None
    try:
        node = node_of(path)
    except (OSError, yaml.YAMLError, ValueError):
        return None
    for name in place:
        if isinstance(node, yaml.MappingNode):
            pair = next((pair for pair in node.value if pair[0].value == str(name)), None)
        elif isinstance(node, yaml.SequenceNode) and isinstance(name, int):
            pair = (node.value[name],) * 2 if name < len(node.value) else None
        else:
            pair = None
        if pair is None:
            break
        line = pair[0].start_mark.line + 1
        node = pair[1]
    return line


def located(files: Sequence[Path], place: Place) -> str:
    """`line 12: ` in the last of the files that has the field, with its name if there are several."""
    for file in reversed(files):
        line = field_line(file, place)
        if line is not None:
            return f"line {line}{f' of {file.name}' if len(files) > 1 else ''}: "
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
    """The content of a configuration file as a model. `files` have the lines, and `above` are the
    keys that lead to `content`."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        problems = error.errors()
        first = next((one for one in problems if one["type"] == "misplaced"), problems[0])
        own = (*above, *own_place(first, content))
        line = located([Path(path)] if files is None else files, own)
        reason = str(first["msg"]).removeprefix("Value error, ").replace("Input should be", "write")
        value = first["input"]
        shown = "" if isinstance(value, dict | list | BaseModel) else f": {value!r} is not allowed"
        if first["type"] == "missing":
            shown, reason = "", "is missing; add it"
        more = f" (and {len(problems) - 1} more problems)" if len(problems) > 1 else ""
        raise InputError(
            f"{path}: {line}{dotted(own) or 'the file'}{shown}: {reason}{more}"
        ) from error


def own_place(problem: Mapping[str, Any], content: Any) -> Place:
    """The field of a problem, without the names that pydantic gives to choices of a union."""
    place: list[int | str] = []
    for name in problem["loc"]:
        if (isinstance(content, dict) and name in content) or (
            isinstance(content, list | tuple) and isinstance(name, int) and name < len(content)
        ):
            content = content[name]
        elif problem["type"] != "missing" or name != problem["loc"][-1]:
            continue
        place.append(name)
    return (*place, *problem.get("ctx", {}).get("place", ()))


def misplaced(reason: str, *place: str) -> PydanticCustomError:
    """An error of a check that sees several fields; `place` is the field below them that is wrong."""
    return PydanticCustomError("misplaced", "{reason}", {"reason": reason, "place": place})


def refuse_if(wrong: Callable[[Any], Any], reason: str, field: str = "") -> Any:
    """A check that refuses settings if `wrong` holds for them."""

    def check(settings: Any) -> Any:
        if wrong(settings):
            raise misplaced(reason.format(s=settings), *filter(None, field.split(".")))
        return settings

    return model_validator(mode="after")(check)


def require_below(low: str, high: str, why: str, or_equal: bool = False) -> Any:
    """A check that a field, or a sum as `guard_s + window_s`, is below another, or equal."""

    def check(settings: Any) -> Any:
        ends = [
            sum(attrgetter(name)(settings) for name in names.split(" + ")) for names in (low, high)
        ]
        if ends[0] - ends[1] > (ROUNDING if or_equal else -ROUNDING):
            reason = f"{low} = {ends[0]:g} is not below {high} = {ends[1]:g}, {why}"
            raise misplaced(
                f"{reason}; lower {low}, or raise {high}", *low.split(" + ")[0].split(".")
            )
        return settings

    return model_validator(mode="after")(check)


def check_rising(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """A check that each value of a list is below the next."""
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


def removed(instead: str, *place: str) -> PydanticCustomError:
    """An error for a field that an earlier release had."""
    return misplaced(f"is gone: {instead}; remove the line", *place)


def renamed(new: Any, *place: str) -> PydanticCustomError:
    """An error for a field that has another name."""
    return misplaced(f"has another name; write {new.name}", *place)
