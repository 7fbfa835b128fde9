"""What a user looks up: the meaning of every column of every result table, and the JSON schemas of
the YAML files."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from osl_analysis.campaign.configuration import Config
from osl_analysis.dictionary import described_tables, file_at
from osl_analysis.files import write_text
from osl_analysis.formats import known_formats
from osl_analysis.ingest.examine import UNITS
from osl_analysis.judge.limits import CHECKS
from osl_analysis.judge.words import WORDS
from osl_analysis.model.drivetrain import ParameterFile
from osl_analysis.report.headline import all_labels
from osl_analysis.report.headline_text import aligned
from osl_analysis.simulator.laboratory_settings import WalkingSettings
from osl_analysis.simulator.simulation_settings import SimulationSettings


def columns_text() -> str:
    """Unit and meaning of every column of every table, of every check and of every headline
    number."""
    sections = []
    for table in described_tables():
        columns = [(one.name, one.unit, one.meaning) for one in table.columns.values()]
        sections.append(f"{file_at(table.place)}: {table.rows}\n\n{aligned(columns)}")
    numbers = [(entry.name, entry.unit, entry.meaning) for entry in all_labels()]
    return "\n".join(
        [
            *sections,
            f"checks of quality control\n\n{aligned(described_checks())}",
            f"numbers in summary.json\n\n{aligned(numbers)}",
        ]
    )


def described_checks() -> list[tuple[str, str, str]]:
    """Name, unit and meaning of every check of quality control."""
    return [
        (name, UNITS[name], f"{WORDS['checks'][name]}. Fails {check.fails} its threshold")
        for name, check in CHECKS.items()
    ]


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
