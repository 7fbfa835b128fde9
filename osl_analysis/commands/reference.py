"""What a user looks up: the meaning of every column of every result table, and the JSON schemas of the YAML files."""

import ast
import inspect
import json
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from osl_analysis.campaign.configuration import Config
from osl_analysis.dictionary import described_tables
from osl_analysis.files import atomic_path
from osl_analysis.ingest.raw_files import FORMATS
from osl_analysis.judge.recording import CHECKS
from osl_analysis.model.parameters import ParameterFile
from osl_analysis.report.headlines import all_labels
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.simulator.walking_settings import WalkingSettings

INTRODUCTION = """\
# Tables

Meaning and unit of every column of every table below `results/`, of the checks of quality control, and of every entry
of `results/summary.json`. Made by `{command}` from
`osl_analysis/dictionary/` and `osl_analysis/figures/figures.yaml`; do not edit this page.

Units are SI unless a column's name ends in its unit (`_deg`, `_mm`, `_ms`, `_hz`). `1` is a number without a unit.
The last column of every table, `data`, says whether the data are simulated or measured. Campaign, version,
configuration and date of all tables stand in `csv-metadata.json` beside them (CSV on the Web, W3C), because a comment
in a table would stop other readers. An empty cell is null: there is no value, and the column's meaning says why. Angles
are positive in dorsiflexion. Torques resist the motion: positive K, B and I oppose positive motion, as in Eq. 15.
Intervals cover 95 %.
"""


OF_SUMMARY = """\
## `summary.json`

`campaign` is the name of the campaign, `data` says whether its data are simulated or measured, `version` is \
that of osl-analysis, `configuration` the first digits of the SHA-256 of the configuration and of the files \
that it names, `recorded` the date of the data. `trials` has for every experiment how many trials are `used`, \
of how many (`of`), and the reason of each that is `missing`. `missing_results` has the reason of each result \
over several trials that could not be computed. `findings` has what to know of the results, as the end of a \
run says it in `line`: causes of doubt, flags, and what could not be checked, with the `trials` that each \
concerns. `numbers` has an entry per headline number, with these fields:

{fields}
The entries:

{entries}"""
SUMMARY_FIELDS = {
    "`value`": "the number, in `unit`",
    "`unit`": "its unit",
    "`low`, `high`": "ends of its interval; null if there is none",
    "`interval`": "what kind of interval it is; null if there is none",
    "`n`": "number of trials or fits behind it",
    "`draft`": "value that the paper's draft prints; null if it prints none",
    "`meaning`": "what the number is",
    "`n_doubtful`, `n_left_out`": "how many of the trials or fits that could be in the number are doubtful, and "
    "how many of these are not in it",
    "`doubt`": "why the number itself is doubtful; null if it is not, or not judged",
    "`amplitudes_low`, `amplitudes_high`": "lowest and highest of the fits to single amplitudes, if there are any",
}


def tables_page(command: str) -> str:
    """The page as Markdown; `command` is what the reader calls to make it again."""
    parts = [INTRODUCTION.format(command=command)]
    for table in described_tables():
        named = (path.replace("*/*", "EXPERIMENT/*").replace("*", "TRIAL") for path in (table.place, table.also))
        place, also = (f"{path}.csv" for path in named)
        gathered = f" `{also}` holds the rows of one trial." if table.also else ""
        rows = [(f"`{column.name}`", column.unit, column.meaning) for column in table.columns.values()]
        parts.append(
            f"## `{place}`\n\nRows: {table.rows}.{gathered}\n\n{markdown('column', 'unit', 'meaning', rows=rows)}"
        )
    checks = [(f"`{c.name}`", c.unit, f"{c.meaning}. Fails {c.fails} its threshold") for c in CHECKS.values()]
    parts.append(f"## Checks of quality control\n\n{markdown('check', 'unit', 'meaning of its value', rows=checks)}")
    entries = markdown(
        "entry", "unit", "meaning", rows=[(f"`{one.name}`", one.unit, one.meaning) for one in all_labels()]
    )
    fields = markdown("field", "meaning", rows=SUMMARY_FIELDS.items())
    return "\n".join([*parts, OF_SUMMARY.format(fields=fields, entries=entries)])


def markdown(*head: str, rows: Iterable[Iterable[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


SCHEMA_DRAFT = "https://json-schema.org/draft/2020-12/schema"
MODELS_OF_FILES: Mapping[str, type[BaseModel]] = {
    "config": Config,
    "parameters": ParameterFile,
    "simulation": SimulationSettings,
    "gait_laboratory": WalkingSettings,
}
"""The model behind each kind of file; a source file has one by its format."""


def schemas() -> dict[str, dict[str, Any]]:
    """The schema of each kind of file, by the name of its file without `.schema.json`."""
    found: dict[str, dict[str, Any]] = {}
    for name, model in MODELS_OF_FILES.items():
        top, definitions = definitions_of({name: model})
        if model is Config:  # a campaign's overrides fields of the default, and needs none
            for one in definitions.values():
                one.pop("required", None)
        found[name] = {"$schema": SCHEMA_DRAFT, "$ref": top[name], "$defs": definitions}
    top, definitions = definitions_of({name: known.source for name, known in FORMATS.items()})
    by_format = [{"if": {"properties": {"format": {"const": n}}}, "then": {"$ref": at}} for n, at in top.items()]
    found["source"] = {
        "$schema": SCHEMA_DRAFT,
        "type": "object",
        "required": ["format"],
        "properties": {"format": {"enum": list(FORMATS)}},
        "allOf": by_format,
        "$defs": definitions,
    }
    return found


def definitions_of(models: Mapping[str, type[BaseModel]]) -> tuple[dict[str, str], dict[str, Any]]:
    """Where the definition of each model stands, and all definitions, whose fields are explained as in the code."""
    unique = list(dict.fromkeys(models.values()))
    places, content = models_json_schema([(model, "validation") for model in unique], ref_template="#/$defs/{model}")
    definitions, waiting, seen = content["$defs"], list(unique), set[type[BaseModel]]()
    while waiting:
        model = waiting.pop()
        if model in seen:
            continue
        seen.add(model)
        waiting += [inner for field in model.model_fields.values() for inner in models_in(field.annotation)]
        fields = definitions.get(model.__name__, {}).get("properties", {})
        for name, text in explanations(model).items():
            if name in fields:
                fields[name]["description"] = text
    return {name: places[model, "validation"]["$ref"] for name, model in models.items()}, definitions


def models_in(annotation: Any) -> list[type[BaseModel]]:
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in getattr(annotation, "__args__", ()) for model in models_in(inner)]


@cache
def source_of(module: str) -> tuple[dict[str, ast.ClassDef], list[str]]:
    """The classes of a module by name, and its lines."""
    text = inspect.getsource(sys.modules[module])
    return {node.name: node for node in ast.parse(text).body if isinstance(node, ast.ClassDef)}, text.splitlines()


def explanations(model: type[BaseModel]) -> dict[str, str]:
    """What stands below or behind the fields of a model and of its bases, by field."""
    texts: dict[str, str] = {}
    for one in reversed(model.__mro__):
        if not issubclass(one, BaseModel) or one is BaseModel:
            continue
        written = one.__dict__.get("CATALOGUE", one)  # a source file's fields stand in the catalogue of all formats
        classes, lines = source_of(written.__module__)
        for field, below in pairwise([*classes[written.__name__].body, None]):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                _, _, said = lines[(field.end_lineno or 1) - 1].partition("  # ")
                if isinstance(below, ast.Expr):
                    said = " ".join(str(ast.literal_eval(below.value)).split())
                texts |= {field.target.id: said} if said else {}
    return texts


def write_schemas(folder: Path) -> None:
    for name, schema in schemas().items():
        with atomic_path(folder / f"{name}.schema.json") as path:
            path.write_text(json.dumps(schema, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
