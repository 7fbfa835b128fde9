"""The trials that figures show as examples."""

from collections.abc import Mapping
from typing import Any

from osl_analysis.campaign.campaign_trials import Campaign
from osl_analysis.campaign.configuration import FrequencyResponseFigure

CONDITION = ("controller", "K_d", "B_d")


def time_series_example(campaign: Campaign) -> dict[str, Any] | None:
    """Choose the trial that Fig. 4 shows.

    Returns
    -------
    dict or None
        `trial`; its `joint` and `side`; its condition, `controller`, `K_d` and `B_d`; and `chosen`,
        why this trial, if the configuration does not name it. None without impedance trials.
    """
    trials = campaign.trials("impedance")
    if not trials:
        return None
    chosen = "the first impedance trial of the sheet"
    stated = campaign.config.figures.time_series
    if stated is not None:
        named = matching(campaign, stated.model_dump())
        chosen = "" if named else f"{chosen}; the example of the configuration is not in it"
        trials = named or trials
    row = campaign.row(trials[0])
    condition = {name: row[name] for name in CONDITION}
    return {"trial": trials[0], **campaign.places[trials[0]], **condition, "chosen": chosen}


def response_example(campaign: Campaign) -> FrequencyResponseFigure | None:
    """The desired impedance of Fig. 7, if the campaign has it; None: the one with the most
    trials."""
    stated = campaign.config.figures.frequency_response
    return stated if stated is not None and matching(campaign, stated.model_dump()) else None


def matching(campaign: Campaign, cells: Mapping[str, Any]) -> list[str]:
    """Find the impedance trials with these cells of the sheet by column; None matches an empty
    cell."""
    return [
        trial
        for trial in campaign.trials("impedance")
        if all(campaign.row(trial)[column] == value for column, value in cells.items())
    ]
