"""The file of the platform's shared motion: `fits/platform.json`."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.commands.walking_files import read_json, write_json
from osl_analysis.walking.platform_model import PlatformModel
from osl_analysis.walking.platform_shape import Alignment, PlatformTemplate
from osl_analysis.walking.trigger import TriggerLatency

FIELDS = ("template", "reason", "alignments", "triggers", "latency", "leave_out")
NUMBERS = ("noise", "crossings", "scaled", "start_se", "start_shape")
"""Of a shape, beside its arrays."""


def write_platform(model: PlatformModel, path: Path) -> None:
    """Write the shape, how each crossing follows it, and the trigger's latency [SI]."""
    content = {
        "template": model.template and template_content(model.template),
        "reason": model.reason,
        "alignments": [asdict(a) | {"offset": a.offset.tolist()} for a in model.alignments.values()],
        "triggers": model.triggers,
        "latency": model.latency and asdict(model.latency),
        "leave_out": [template_content(template) for template in model.leave_out],
    }
    write_json(content, path)


def template_content(template: PlatformTemplate) -> dict[str, Any]:
    """A shape as lists of numbers."""
    arrays = {name: getattr(template, name).tolist() for name in ("axes", "time", "shape")}
    return arrays | {name: getattr(template, name) for name in NUMBERS}


def template_from(content: Mapping[str, Any]) -> PlatformTemplate:
    """The shape that `template_content` described."""
    arrays: dict[str, Any] = {name: np.array(content[name], dtype=float) for name in ("axes", "time", "shape")}
    return PlatformTemplate(**arrays, **{name: content[name] for name in NUMBERS})


def read_platform(path: Path) -> PlatformModel:
    """Read what `write_platform` wrote."""
    content = read_json(path, "measure-platform", *FIELDS)
    alignments = [Alignment(**{**a, "offset": np.array(a["offset"], dtype=float)}) for a in content["alignments"]]
    return PlatformModel(
        content["template"] and template_from(content["template"]),
        content["reason"],
        {a.name: a for a in alignments},
        dict(content["triggers"]),
        content["latency"] and TriggerLatency(**content["latency"]),
        tuple(template_from(template) for template in content["leave_out"]),
    )
