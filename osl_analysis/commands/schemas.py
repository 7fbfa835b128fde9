"""JSON schemas of the YAML files that a user writes, for editors that complete and check them."""

import ast
import inspect
import json
import textwrap
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from osl_analysis.config import Config
from osl_analysis.files import atomic_path
from osl_analysis.ingest.known_formats import FORMATS
from osl_analysis.parameters import ParameterFile
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.simulator.walking_settings import WalkingSettings

DRAFT = "https://json-schema.org/draft/2020-12/schema"
FILES: Mapping[str, type[BaseModel]] = {
    "config": Config,
    "parameters": ParameterFile,
    "simulation": SimulationSettings,
    "gait_laboratory": WalkingSettings,
}
"""The model behind each kind of file; a source file has one by its format."""


def schemas() -> dict[str, dict[str, Any]]:
    """The schema of each kind of file, by the name of its file without `.schema.json`."""
    return {name: schema_of(model) for name, model in FILES.items()} | {"source": schema_of_sources()}


def schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """The schema of a kind of file. A campaign's configuration overrides fields of the default, and needs none."""
    top, definitions = described({model.__name__: model})
    schema = {"$schema": DRAFT, "$ref": top[model.__name__], "$defs": definitions}
    if model is Config:
        for one in definitions.values():
            one.pop("required", None)
    return schema


def schema_of_sources() -> dict[str, Any]:
    """The schema of a source file: its `format` decides which one holds."""
    top, definitions = described({name: known.source for name, known in FORMATS.items()})
    return {
        "$schema": DRAFT,
        "type": "object",
        "required": ["format"],
        "properties": {"format": {"enum": list(FORMATS)}},
        "allOf": [
            {"if": {"properties": {"format": {"const": name}}}, "then": {"$ref": place}} for name, place in top.items()
        ],
        "$defs": definitions,
    }


def described(models: Mapping[str, type[BaseModel]]) -> tuple[dict[str, str], dict[str, Any]]:
    """Where the definition of each model stands, and all definitions, whose fields have their docstrings as text."""
    unique = list(dict.fromkeys(models.values()))
    places, content = models_json_schema([(model, "validation") for model in unique], ref_template="#/$defs/{model}")
    definitions = content["$defs"]
    for model in all_models(unique):
        for name, text in docstrings(model).items():
            field = definitions.get(model.__name__, {}).get("properties", {}).get(name)
            if field is not None:
                field["description"] = text
    return {name: places[model, "validation"]["$ref"] for name, model in models.items()}, definitions


def all_models(models: list[type[BaseModel]]) -> list[type[BaseModel]]:
    """Models and those of their fields, each once."""
    found: dict[type[BaseModel], None] = {}
    waiting = list(models)
    while waiting:
        model = waiting.pop()
        if model not in found:
            found[model] = None
            waiting += [inner for field in model.model_fields.values() for inner in models_in(field.annotation)]
    return list(found)


def models_in(annotation: Any) -> list[type[BaseModel]]:
    """The models in a type."""
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in getattr(annotation, "__args__", ()) for model in models_in(inner)]


def docstrings(model: type[BaseModel]) -> dict[str, str]:
    """The texts below the fields of a model and of its bases."""
    texts: dict[str, str] = {}
    for one in reversed(model.__mro__):
        if not issubclass(one, BaseModel) or one is BaseModel:
            continue
        (body,) = ast.parse(textwrap.dedent(inspect.getsource(one))).body
        statements = getattr(body, "body", [])
        for field, text in pairwise(statements):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(text, ast.Expr):
                texts[field.target.id] = " ".join(str(ast.literal_eval(text.value)).split())
    return texts


def write_schemas(folder: Path) -> list[Path]:
    """Write every schema into a folder, and name the files."""
    written = []
    for name, schema in schemas().items():
        with atomic_path(folder / f"{name}.schema.json") as path:
            path.write_text(json.dumps(schema, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        written.append(folder / f"{name}.schema.json")
    return written
