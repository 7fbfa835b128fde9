"""What a user looks up: the meaning of every column of every result table, and the JSON schemas of
the YAML files."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from osl_analysis.campaign.configuration import Config
from osl_analysis.dictionary import HERE, described_tables
from osl_analysis.files import write_text
from osl_analysis.formats import known_formats
from osl_analysis.ingest.examine import UNITS
from osl_analysis.judge.limits import CHECKS
from osl_analysis.judge.words import WORDS
from osl_analysis.model.drivetrain import ParameterFile
from osl_analysis.report.headlines import all_labels, markdown_table
from osl_analysis.simulator.settings import SimulationSettings, WalkingSettings


def tables_page(command: str) -> str:
    """The page as Markdown; `command` is what the reader calls to make it again."""
    tables = []
    for table in described_tables():
        named = (
            path.replace("*/*", "EXPERIMENT/*").replace("*", "TRIAL")
            for path in (table.place, table.also)
        )
        place, also = (f"{path}.csv" for path in named)
        columns = [
            (f"`{column.name}`", column.unit, column.meaning) for column in table.columns.values()
        ]
        described = markdown_table([("column", "unit", "meaning"), *columns])
        gathered = f" `{also}` holds the rows of one trial." if table.also else ""
        tables.append(f"## `{place}`\n\nRows: {table.rows}.{gathered}\n\n{described}")
    says = {
        name: f"{WORDS['checks'][name]}. Fails {check.fails} its threshold"
        for name, check in CHECKS.items()
    }
    checks = [(f"`{name}`", UNITS[name], said) for name, said in says.items()]
    entries = [(f"`{one.name}`", one.unit, one.meaning) for one in all_labels()]
    page = (HERE / "page.md").read_text(encoding="utf-8").rstrip()
    return page.format(
        command=command,
        tables="\n".join(tables),
        checks=markdown_table([("check", "unit", "meaning of its value"), *checks]),
        entries=markdown_table([("entry", "unit", "meaning"), *entries]),
    )


def schemas() -> dict[str, dict[str, Any]]:
    """The schema of each kind of file, by the name of its file without `.schema.json`."""
    draft, found = "https://json-schema.org/draft/2020-12/schema", dict[str, dict[str, Any]]()
    models: dict[str, type[BaseModel]] = {"config": Config, "parameters": ParameterFile}
    models |= {"simulation": SimulationSettings, "gait_laboratory": WalkingSettings}
    for name, model in models.items():
        top, definitions = definitions_of({name: model})
        if model is Config:  # a campaign's overrides fields of the default, and needs none
            for one in definitions.values():
                one.pop("required", None)
        found[name] = {"$schema": draft, "$ref": top[name], "$defs": definitions}
    sources = {name: known.source for name, known in known_formats().items()}
    top, definitions = definitions_of(sources)
    found["source"] = {
        "$schema": draft,
        "type": "object",
        "required": ["format"],
        "properties": {"format": {"enum": list(known_formats())}},
        "allOf": [
            {"if": {"properties": {"format": {"const": n}}}, "then": {"$ref": at}}
            for n, at in top.items()
        ],
        "$defs": definitions,
    }
    return found


def definitions_of(models: Mapping[str, type[BaseModel]]) -> tuple[dict[str, str], dict[str, Any]]:
    """Where the definition of each model stands, and all definitions."""
    each: list[tuple[type[BaseModel], Literal["validation"]]] = []
    each += [(model, "validation") for model in dict.fromkeys(models.values())]
    places, content = models_json_schema(each, ref_template="#/$defs/{model}")
    return {name: places[model, "validation"]["$ref"] for name, model in models.items()}, content[
        "$defs"
    ]


def write_schemas(folder: Path) -> None:
    for name, schema in schemas().items():
        write_text(
            folder / f"{name}.schema.json", json.dumps(schema, indent=1, ensure_ascii=False) + "\n"
        )
