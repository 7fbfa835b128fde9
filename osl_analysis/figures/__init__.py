"""The list of figures, which the workflow, the command line and the tests read.

A new figure is a module here, an entry in `figures.yaml`, and its test. Its module has `COLUMNS` (the columns of the
plotted numbers), `draw` (plotted numbers -> page) and `caption` (plotted numbers -> a paragraph of Markdown, by the
words of `names.py`). Where the numbers come from one result table, the module has `TABLE_COLUMNS` (what it needs of
that table) and `points` (result table -> plotted numbers) too.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML


@dataclass(frozen=True)
class CampaignFigure:
    """A figure of a campaign, drawn if the campaign has what it needs; the fields are explained in `figures.yaml`."""

    name: str  # name of its module and of its files
    table: str
    setting: str | None = None
    option: str | None = None
    own_rule: bool = False


def read_figures(path: Path) -> dict[str, CampaignFigure]:
    """The figures of a campaign by name, from the list in YAML."""
    entries = {place.removeprefix("figures/"): entry for place, entry in YAML(typ="safe", pure=True).load(path).items()}
    optional = ("setting", "option", "own_rule")
    return {
        name: CampaignFigure(name, entry["from"], **{key: entry[key] for key in optional if key in entry})
        for name, entry in entries.items()
    }


FIGURES = read_figures(Path(__file__).with_name("figures.yaml"))  # the figures of a campaign by name

OTHER_DRAWINGS = ("torque", "gain_grid", "study", "not_drawn")
"""Drawings in `others.py` that are no figures of a campaign."""


def drawn_figures(tables: Collection[str], setting: Callable[[str], Any]) -> list[CampaignFigure]:
    """The figures that a campaign with these result tables gives; `setting` returns a setting by its dotted name."""
    return [
        figure
        for figure in FIGURES.values()
        if figure.table in tables and (figure.setting is None or setting(figure.setting) is not None)
    ]
