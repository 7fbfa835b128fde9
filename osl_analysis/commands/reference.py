"""What a user looks up: the meaning of every column of every result table, and the JSON schemas of
the YAML files."""

import json
from pathlib import Path
from typing import Any

from pydantic.json_schema import models_json_schema

from osl_analysis.campaign.configuration import Config
from osl_analysis.dictionary import described_tables
from osl_analysis.files import write_text
from osl_analysis.formats import known_formats
from osl_analysis.ingest.quality import UNITS
from osl_analysis.judge.known_findings import CHECKS
from osl_analysis.model.drivetrain import ParameterFile
from osl_analysis.report.numbers import ENTRIES
from osl_analysis.report.typography import aligned
from osl_analysis.simulator.laboratory_settings import WalkingSettings
from osl_analysis.simulator.simulation_settings import SimulationSettings

DRAFT = "https://json-schema.org/draft/2020-12/schema"


def columns_text() -> str:
    """Unit and meaning of every column of every table, of every check and of every headline
    number."""
    sections = []
    for table in described_tables():
        for file, rows, columns in table.sections:
            lines = [(column.name, column.unit, column.meaning) for column in columns]
            sections.append(f"{file}: {rows}\n\n{aligned(lines)}")
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
    schema_of = {
        "config": Config.model_json_schema(),
        "parameters": ParameterFile.model_json_schema(),
        "simulation": SimulationSettings.model_json_schema(),
        "gait_laboratory": WalkingSettings.model_json_schema(),
    }
    # a campaign's configuration overrides fields of the default, and needs none
    config = schema_of["config"]
    for definition in (config, *config["$defs"].values()):
        definition.pop("required", None)

    models = {name: known.source for name, known in known_formats().items()}
    places, content = models_json_schema(
        [(model, "validation") for model in dict.fromkeys(models.values())]
    )
    of_format = []
    for name, model in models.items():
        is_format = {"properties": {"format": {"const": name}}}
        of_format.append({"if": is_format, "then": places[model, "validation"]})
    schema_of["source"] = {
        "type": "object",
        "required": ["format"],
        "properties": {"format": {"enum": list(models)}},
        "allOf": of_format,
        **content,
    }
    return schema_of


def write_schemas(folder: Path) -> None:
    for name, schema in schemas().items():
        text = json.dumps({"$schema": DRAFT, **schema}, indent=1, ensure_ascii=False)
        write_text(folder / f"{name}.schema.json", f"{text}\n")
