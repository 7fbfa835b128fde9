"""The list of figures: the workflow, the command line and the tests ask it which there are.

A new figure is a module here, an entry in `FIGURES`, and its test. Its module has `COLUMNS` (the columns of the plotted
numbers) and `draw` (plotted numbers -> page). Where the numbers come from one result table, the module has
`TABLE_COLUMNS` (what it needs of that table) and `points` (result table -> plotted numbers) too.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class CampaignFigure:
    """A figure of a campaign, drawn if the campaign has what it needs."""

    name: str
    """Name of its module and of its files."""
    table: str
    """Result table that the campaign must have: the figure shows these results."""
    setting: str | None = None
    """Setting of the configuration (dotted) that must not be null: what the figure is to show."""
    option: str | None = None
    """Setting of the configuration (dotted) that `points` takes beside the table; it may be null."""
    own_rule: bool = False
    """Whether its plotted numbers need more than the result table (trials, gains), and so a rule of their own in
    `rules/figures.smk`; where not, `points` of the module computes them from the table alone."""


FIGURES = {
    figure.name: figure
    for figure in (
        CampaignFigure("fig3", "belt", own_rule=True),
        CampaignFigure("fig4", "impedance", setting="figures.time_series", own_rule=True),
        CampaignFigure("fig5", "impedance"),
        CampaignFigure("fig6", "impedance"),
        CampaignFigure("fig7", "frequency_response", setting="figures.frequency_response", own_rule=True),
        CampaignFigure("fig8", "gains"),
        CampaignFigure("fig9", "walking_summary", option="figures.midstance_stiffness"),
        CampaignFigure("walking_page", "walking", own_rule=True),
        CampaignFigure("model_comparison", "model_comparison"),
    )
}
"""The figures of a campaign by name."""

OTHER_DRAWINGS = ("torque", "gain_grid", "gain_map", "study")
"""Modules that draw what is no figure of a campaign: a single fit, requested gains, the Monte Carlo study."""


def drawn_figures(tables: Collection[str], setting: Callable[[str], Any]) -> list[CampaignFigure]:
    """The figures that a campaign with these result tables gives; `setting` returns a setting by its dotted name."""
    return [
        figure
        for figure in FIGURES.values()
        if figure.table in tables and (figure.setting is None or setting(figure.setting) is not None)
    ]
