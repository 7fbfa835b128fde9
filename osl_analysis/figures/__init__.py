"""The list of figures, which the workflow, the command line and the tests read.

A new figure is a function `draw_NAME` in a module here, which `style.drawing` decorates; an entry
in `figures.yaml`; and its test. Captions are said by the words of `names.py`."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from osl_analysis.dictionary import described_in, own_yaml
from osl_analysis.errors import InputError


class CampaignFigure(NamedTuple):
    """A figure of a campaign, drawn if the campaign has what it needs; the fields are explained in
    `figures.yaml`."""

    table: str
    module: str
    option: str | None = None
    beside: Sequence[str] = ()
    caption: str = ""


DESCRIBED = Path(__file__).with_name("figures.yaml")
FIGURES = {
    place.removeprefix("figures/"): CampaignFigure(
        **{key: one[key] for key in CampaignFigure._fields if key in one}
    )
    for place, one in own_yaml(DESCRIBED).items()
}


def columns_of(figure: str) -> list[str]:
    """The columns of a figure's plotted numbers, as figures.yaml describes them."""
    (table,) = (one for one in described_in(DESCRIBED) if one.place == f"figures/{figure}")
    return [name for name in table.columns if name != "data"]


def drawing_of(name: str) -> Any:
    """The `style.Drawing` of a figure, imported only when it is needed: importing matplotlib takes
    half a second."""
    known = {figure: one.module for figure, one in FIGURES.items()}
    known |= dict.fromkeys(("comparison", "torque", "gain_grid", "not_drawn"), "others")
    if name not in known:
        raise InputError(f"no figure '{name}'; there are {', '.join(known)}")
    return getattr(import_module(f"osl_analysis.figures.{known[name]}"), f"draw_{name}")
