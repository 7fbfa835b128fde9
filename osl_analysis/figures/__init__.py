"""The list of figures, which the workflow, the command line and the tests read.

A new figure is a function `draw_NAME` in a module here, which `style.drawing` decorates, with its
caption beside it; an entry in `figures.yaml`; and its test.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, cast

from osl_analysis.dictionary import described_in, own_yaml
from osl_analysis.errors import InputError

if TYPE_CHECKING:
    import polars as pl

    from osl_analysis.figures.style import Drawing, NotebookFigure


@dataclass(frozen=True)
class CampaignFigure:
    """A figure of a campaign, drawn if the campaign has what it needs; the fields are explained in
    `figures.yaml`."""

    table: str
    module: str
    reading: str
    option: str | None = None
    beside: Sequence[str] = ()


DESCRIBED = Path(__file__).with_name("figures.yaml")


def listed_figures() -> dict[str, CampaignFigure]:
    """The figures of `figures.yaml` by name."""
    names = {field.name for field in fields(CampaignFigure)}
    figures = {}
    for place, entry in own_yaml(DESCRIBED).items():
        facts = {key: value for key, value in entry.items() if key in names}
        figures[place.removeprefix("figures/")] = CampaignFigure(**facts)
    return figures


FIGURES = listed_figures()
OTHER_FIGURES = {  # of no campaign: name and module
    "torque": "torque_over_time",
    "gain_grid": "gain_curves",
    "not_drawn": "not_drawn",
}


def columns_of(figure: str) -> list[str]:
    """The columns of a figure's plotted numbers, as `figures.yaml` describes them."""
    (table,) = [table for table in described_in(DESCRIBED) if table.place == f"figures/{figure}"]
    return [name for name in table.columns if name != "data"]


def drawing_of(name: str) -> "Drawing":
    """Find how a figure is drawn.

    It is imported only when it is needed: importing matplotlib takes half a second.

    Parameters
    ----------
    name : str
        Of `FIGURES`, or one of the few that are of no campaign.

    Raises
    ------
    InputError
        There is no such figure.
    """
    modules = {figure: entry.module for figure, entry in FIGURES.items()} | OTHER_FIGURES
    if name not in modules:
        raise InputError(f"no figure '{name}'; there are {', '.join(modules)}")
    module = import_module(f"osl_analysis.figures.{modules[name]}")
    drawing: Drawing = getattr(module, f"draw_{name}")
    return drawing


def drawn(name: str, table: "pl.DataFrame") -> "NotebookFigure":
    """Draw a figure of its plotted numbers, for a notebook; raises as `drawing_of`."""
    from osl_analysis.figures.style import NotebookFigure

    figure = drawing_of(name).draw(table)
    figure.__class__ = NotebookFigure
    return cast(NotebookFigure, figure)
