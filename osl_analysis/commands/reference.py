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
from osl_analysis.ingest.quality import UNITS
from osl_analysis.judge.known_findings import CHECKS
from osl_analysis.model.drivetrain import ParameterFile
from osl_analysis.report.numbers import ENTRIES
from osl_analysis.report.text_tables import aligned
from osl_analysis.simulator.laboratory_settings import WalkingSettings
from osl_analysis.simulator.simulation_settings import SimulationSettings

DRAFT = "https://json-schema.org/draft/2020-12/schema"


def columns_text() -> str:
    """Unit and meaning of every column of every table, of every check and of every headline
    number."""
    sections = []
    for table in described_tables():
        columns = [(column.name, column.unit, column.meaning) for column in table.columns.values()]
        sections.append(f"{file_at(table.place)}: {table.rows}\n\n{aligned(columns)}")
    numbers = [(entry.name, entry.unit, entry.meaning) for entry in ENTRIES]
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
        (name, UNITS[name], f"{check.meaning}. Fails {check.fails} its threshold")
        for name, check in CHECKS.items()
    ]


def schemas() -> dict[str, dict[str, Any]]:
    """The schema of each kind of file, by the name of its file without `.schema.json`."""
    models: dict[str, type[BaseModel]] = {
        "config": Config,
        "parameters": ParameterFile,
        "simulation": SimulationSettings,
        "gait_laboratory": WalkingSettings,
    }
    schema_of: dict[str, dict[str, Any]] = {}
    for name, model in models.items():
        places, definitions = definitions_of({name: model})
        if model is Config:  # a campaign's overrides fields of the default, and needs none
            for definition in definitions.values():
                definition.pop("required", None)
        schema_of[name] = {"$schema": DRAFT, "$ref": places[name], "$defs": definitions}

    sources = {name: known.source for name, known in known_formats().items()}
    places, definitions = definitions_of(sources)
    of_format = []
    for name, place in places.items():
        is_format = {"properties": {"format": {"const": name}}}
        of_format.append({"if": is_format, "then": {"$ref": place}})
    schema_of["source"] = {
        "$schema": DRAFT,
        "type": "object",
        "required": ["format"],
        "properties": {"format": {"enum": list(known_formats())}},
        "allOf": of_format,
        "$defs": definitions,
    }
    return schema_of


def definitions_of(models: Mapping[str, type[BaseModel]]) -> tuple[dict[str, str], dict[str, Any]]:
    """Where the definition of each model stands, and all definitions."""
    validated: list[tuple[type[BaseModel], Literal["validation"]]] = [
        (model, "validation") for model in dict.fromkeys(models.values())
    ]
    schema_of, content = models_json_schema(validated, ref_template="#/$defs/{model}")
    places = {name: schema_of[model, "validation"]["$ref"] for name, model in models.items()}
    return places, content["$defs"]


def write_schemas(folder: Path) -> None:
    for name, schema in schemas().items():
        text = json.dumps(schema, indent=1, ensure_ascii=False)
        write_text(folder / f"{name}.schema.json", f"{text}\n")
