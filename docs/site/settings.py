"""The page of settings: unit, default and meaning of every field that a YAML file may have.

A field's meaning is what stands beside it in its settings model: the text below it, the comment
above it, or the comment behind it.
"""

import ast
import inspect
import json
import re
import tokenize
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import get_args

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from osl_analysis.campaign.configuration import FACTS_OF_DEFAULT, Config
from osl_analysis.files import default_config
from osl_analysis.formats import known_formats
from osl_analysis.formats._table import SheetSource
from osl_analysis.model.drivetrain import ParameterFile
from osl_analysis.report.text_tables import markdown_table
from osl_analysis.simulator.laboratory_settings import WalkingSettings
from osl_analysis.simulator.simulation_settings import Effect, SimulationSettings
from osl_analysis.source_file import (
    LaboratorySource,
    LogSource,
    MarkerSource,
    MessageSource,
    TableSource,
)
from osl_analysis.yaml_settings import Settings, read_mapping

AS_WRITTEN = ("doubtful", "quality")
"""Sections whose limits stand beside their reasons in the shipped configuration: they are shown as
they stand there."""
UNIT = re.compile(r" ?\[([^\]]+)\](?=(?:[^`]*`[^`]*`)*[^`]*$)")
"""A unit in brackets, which are not within code."""
SPECIAL = re.compile(r"([\\*<>$\[\]])")
PAGE = re.compile(r"docs/(\w+)\.md")
UNIT_OF_ENDING = {
    "hz": "Hz", "s": "s", "deg": "deg", "mm": "mm", "m": "m", "n": "N", "nm": "N*m", "kg": "kg",
    "ppm": "ppm", "percent": "%", "kg_m2": "kg*m^2", "deg_s": "deg/s",
}  # fmt: skip
TOOLS = ("fmt:", "noqa", "type:")
INSIDE = "inside"
"""Default of a setting whose own fields have rows of their own."""
HEAD = ("setting", "unit", "default", "meaning")
GROUPS = {
    LogSource: "every log",
    TableSource: "every log with rows",
    SheetSource: "every table",
    MessageSource: "every log of messages",
    MarkerSource: "every capture",
    LaboratorySource: "every capture with devices",
}
"""Kinds of source files that several formats share; each has the settings of its bases, too."""


@dataclass(frozen=True)
class Row:
    """One setting.

    Attributes
    ----------
    name
        Its dotted name.
    unit, default, meaning
        As text; an empty default is one that has to be stated.
    """

    name: str
    unit: str
    default: str
    meaning: str

    def cells(self):
        """The row of a table in Markdown."""
        default = f"`{self.default}`" if self.default else "to be stated"
        if self.default == INSIDE:
            default = ""
        return f"`{self.name}`", escaped(self.unit), default, escaped(self.meaning)


def settings_page():
    """Every setting of every YAML file, in Markdown."""
    return "\n\n".join([*configuration(), *source_files(), *other_files()])


def configuration():
    """The parts on `config.yaml`: what stands at its top, then each section."""
    shipped = read_mapping(default_config())
    places = dict[type, str]()
    rows = [with_fact(row) for row in rows_of(Config, shipped, places)]
    yield "## The configuration, `config.yaml`"
    yield table(row for row in rows if "." not in row.name and not is_section(row.name))
    for name in Config.model_fields:
        if not is_section(name):
            continue
        yield f"### `{name}`"
        yield escaped(text_of(model_in(Config.model_fields[name].annotation).__doc__))
        below = [
            replace(row, name=row.name.removeprefix(f"{name}."))
            for row in rows
            if row.name.startswith(f"{name}.")
        ]
        if below:
            yield table(below)
        if name in AS_WRITTEN:
            yield f"```yaml\n{as_written(name)}```"


def source_files():
    """The parts on source files: what several formats share, then each format."""
    yield "## Source files"
    yield "`COLUMN` is a column of the trial, such as `theta` or `torque`."
    shared = set()
    for model, title in GROUPS.items():
        rows = [row for row in rows_of(model, {}, places={}) if row not in shared]
        shared |= set(rows)
        yield f"### {title.capitalize()}"
        yield table(rows)
    for name, known in sorted(known_formats().items()):
        of_groups = [title for model, title in GROUPS.items() if issubclass(known.source, model)]
        rows = [row for row in rows_of(known.source, {}, places={}) if row not in shared]
        yield f"### `format: {name}`"
        own = [row for row in rows if row.name != "format"]
        yield f"The settings of {', '.join(of_groups)}" + (", and:" if own else ".")
        if own:
            yield table(own)


def other_files():
    """The parts on parameter files and on settings of the simulator."""
    of_file = {
        "parameters": ParameterFile,
        "simulation": SimulationSettings,
        "gait laboratory": WalkingSettings,
    }
    shipped = {
        "simulation": "simulation/default.yaml",
        "gait laboratory": "simulation/walking.yaml",
    }
    for name, model in of_file.items():
        file = shipped.get(name)
        values = read_mapping(default_config().parent / file) if file else {}
        yield f"## The file of the {name}" if name != "parameters" else "## The parameter file"
        yield escaped(text_of(model.__doc__)) + (
            f" The defaults are those of `config/{file}`." if file else ""
        )
        yield table(rows_of(model, values, places={}))


def with_fact(row):
    """A row whose default, a fact on the default campaign's own bench, device or text, is null for
    other recordings."""
    if row.name not in FACTS_OF_DEFAULT or row.default == "null":
        return row
    said = f"{row.meaning} The default campaign states `{row.default}`, for itself alone."
    return replace(row, default="null", meaning=said)


def is_section(name):
    """Whether a field of the configuration is a section."""
    return model_in(Config.model_fields[name].annotation) is not None


def rows_of(model, values, places, above=""):
    """The settings of a model and of the models in it.

    Parameters
    ----------
    model : type
        Settings model.
    values : dict
        What a shipped file states; where it states nothing, the model's own default counts.
    places : dict
        Where each model in it was described: it is described once.
    above : str
        Dotted name of the model's place, with a dot at its end.
    """
    rows = []
    for name, field in model.model_fields.items():
        inner = model_in(field.annotation)
        default = values[name] if name in values else default_of(field)
        meaning = meanings_of(model).get(name, "")
        row = row_of(f"{above}{name}", field, default, meaning)
        if inner is None or issubclass(inner, Effect):
            rows.append(row)
        elif inner in places:
            as_there = f"{row.meaning} Fields as those of `{places[inner]}`.".strip()
            rows.append(replace(row, meaning=as_there))
        else:
            is_one = not is_mapping(field.annotation)
            place = row.name if is_one else f"{row.name}.{key_of(name)}"
            places[inner] = place
            is_stated = isinstance(default, dict) and is_one
            if row.meaning:
                rows.append(replace(row, default=INSIDE) if is_stated else row)
            rows += rows_of(inner, default if is_stated else {}, places, f"{place}.")
    return rows


def row_of(name, field, default, meaning):
    """One row; its unit stands in brackets in its meaning, or is the ending of its name."""
    unit = " or ".join((field.json_schema_extra or {}).get("units", ()))
    if not unit and (bracket := UNIT.search(meaning)):
        unit = bracket[1]
        meaning = meaning[: bracket.start()] + meaning[bracket.end() :]
    if not unit:
        ends = [ending for ending in UNIT_OF_ENDING if name.endswith(f"_{ending}")]
        unit = UNIT_OF_ENDING[max(ends, key=len)] if ends else ""
    return Row(name, unit, "" if default is PydanticUndefined else flow(default), text_of(meaning))


def default_of(field):
    """The default of a field as JSON has it; undefined where it has to be stated."""
    if field.is_required():
        return PydanticUndefined
    default = field.get_default(call_default_factory=True)
    return default.model_dump(mode="json") if isinstance(default, BaseModel) else default


def flow(value):
    """A value as YAML writes it in one line."""
    if isinstance(value, dict) and "enabled" in value:
        size = f"{value['size']} {value['unit']}".removesuffix(" 1")
        return size if value["enabled"] else "off"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {flow(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(flow, value)) + "]"
    return (str(value) or '""') if isinstance(value, str | Path) else json.dumps(value, default=str)


def model_in(annotation):
    """The settings model in an annotation, or None."""
    if isinstance(annotation, type) and issubclass(annotation, Settings):
        return annotation
    found = (model_in(inner) for inner in get_args(annotation))
    return next((model for model in found if model is not None), None)


def is_mapping(annotation):
    """Whether an annotation is a mapping from names to settings models."""
    text = str(annotation)
    return model_in(annotation) is not None and ("Mapping[" in text or "dict[" in text)


def key_of(name):
    """The word for the keys of a mapping."""
    return "COLUMN" if name in ("channels", "analogs", "outputs") else "NAME"


def as_written(section):
    """A section of the shipped configuration as it stands there."""
    text = default_config().read_text(encoding="utf-8")
    return re.search(rf"(?ms)^{section}:.*?\n(?=\n|\Z)", text)[0]


def table(rows):
    """Rows as a table."""
    return markdown_table([HEAD, *(row.cells() for row in rows)])


def escaped(text):
    """Text that Markdown shows as it is, but for code; a page that it names becomes a link."""
    parts = text.split("`")
    parts[::2] = [SPECIAL.sub(r"\\\1", part) for part in parts[::2]]
    return PAGE.sub(r"[\1](../\1.md)", "`".join(parts))


def text_of(text):
    """A docstring or comment as one line, which begins with a capital letter and ends with a full
    stop."""
    text = " ".join((text or "").split()).lstrip(" ,;.")
    if not text:
        return ""
    ended = text if text.endswith((".", "?", ":")) else f"{text}."
    return ended[0].upper() + ended[1:]


def meanings_of(model):
    """What stands beside each field of a model, those of its bases included."""
    found = {}
    for base in reversed(model.__mro__):
        if issubclass(base, Settings) and base is not Settings:
            found |= meanings_of_module(inspect.getsourcefile(base)).get(base.__name__, {})
    return found


@cache
def meanings_of_module(file):
    """What stands beside each field of each class of a module, by class and field."""
    text = Path(file).read_text(encoding="utf-8")
    comments = comments_of(file)
    lines = text.splitlines()
    found = {}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ClassDef):
            found[node.name] = meanings_of_class(node, comments, lines)
    return found


def meanings_of_class(node, comments, lines):
    """What stands beside each field of one class."""
    found = {}
    for statement, after in zip(node.body, [*node.body[1:], None], strict=True):
        if not isinstance(statement, ast.AnnAssign):
            continue
        above = []
        line = statement.lineno - 1
        while lines[line - 1].strip().startswith("#"):
            above.insert(0, comments.get(line, ""))
            line -= 1
        behind = [
            comments.get(line, "") for line in range(statement.lineno, statement.end_lineno + 1)
        ]
        below = after.value.value if isinstance(after, ast.Expr) else ""
        parts = [" ".join(above), " ".join(filter(None, behind)), below]
        found[statement.target.id] = " ".join(text_of(part) for part in parts if part)
    return found


def comments_of(file):
    """Comments by line, but for those that are for tools."""
    with tokenize.open(file) as source:
        tokens = list(tokenize.generate_tokens(source.readline))
    comments = {
        token.start[0]: token.string.lstrip("# ")
        for token in tokens
        if token.type == tokenize.COMMENT
    }
    return {line: text for line, text in comments.items() if not text.startswith(TOOLS)}
