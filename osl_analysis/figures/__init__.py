"""The list of figures, which the workflow, the command line and the tests read.

A new figure is a `style.Drawing` in a module here, an object of its name in capitals; an entry in `figures.yaml`; and
its test. Captions are said by the words of `names.py`.
"""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from osl_analysis.errors import InputError


@dataclass(frozen=True)
class CampaignFigure:
    """A figure of a campaign, drawn if the campaign has what it needs; the fields are explained in `figures.yaml`."""

    name: str  # name of its files
    table: str
    module: str
    option: str | None
    beside: list[str]
    own_rule: bool


FIGURES = {
    (name := place.removeprefix("figures/")): CampaignFigure(
        name,
        one["from"],
        one.get("module", name),
        one.get("option"),
        one.get("beside", []),
        one.get("own_rule", False),
    )
    for place, one in YAML(typ="safe", pure=True).load(Path(__file__).with_name("figures.yaml")).items()
}
OTHER_DRAWINGS = ("torque", "gain_grid", "study", "not_drawn")  # drawings in `others.py` that are none of a campaign


def drawing_of(name: str) -> Any:
    """The `style.Drawing` of a figure, imported only when it is needed: importing matplotlib takes half a second."""
    if name not in FIGURES and name not in OTHER_DRAWINGS:
        raise InputError(f"no figure '{name}'; there are {', '.join((*FIGURES, *OTHER_DRAWINGS))}")
    module = FIGURES[name].module if name in FIGURES else "others"
    return getattr(import_module(f"osl_analysis.figures.{module}"), name.upper())
