"""The trials that figures show as examples."""

from collections.abc import Mapping
from typing import Any

from osl_analysis.campaign.campaign_trials import Campaign
from osl_analysis.campaign.configuration import FrequencyResponseFigure
from osl_analysis.errors import InputError, nearest
from osl_analysis.files import default_config
from osl_analysis.model.compensator import CONTROLLERS
from osl_analysis.yaml_settings import read_mapping

CONDITION = ("controller", "K_d", "B_d")


def time_series_example(campaign: Campaign) -> dict[str, Any] | None:
    """Choose the trial that Fig. 4 shows.

    Returns
    -------
    dict or None
        `trial`; its `joint` and `side`; its condition, `controller`, `K_d` and `B_d`; and `chosen`,
        why this trial, if the configuration does not name it. None without impedance trials.

    Raises
    ------
    InputError
        As `matching`.
    """
    stated = campaign.config.figures.time_series
    trials = campaign.trials("impedance")
    if not trials:
        return None
    example = {
        **named_trial(campaign, trials[0]),
        "chosen": "the first impedance trial of the sheet",
    }
    if stated is None:
        return example
    named = matching(campaign, stated.model_dump(), "time_series")
    if not named:
        example["chosen"] += "; the example of the configuration is not in this campaign"
        return example
    return {**named_trial(campaign, named[0]), "chosen": ""}


def named_trial(campaign: Campaign, trial: str) -> dict[str, Any]:
    """A trial with its place and its condition."""
    row = campaign.row(trial)
    condition = {name: row[name] for name in CONDITION}
    return {"trial": trial, **campaign.places[trial], **condition}


def response_example(campaign: Campaign) -> FrequencyResponseFigure | None:
    """The desired impedance of Fig. 7; None: the one with the most trials. Raises as
    `time_series_example`."""
    stated = campaign.config.figures.frequency_response
    if stated is None or not campaign.trials("impedance"):
        return None
    return stated if matching(campaign, stated.model_dump(), "frequency_response") else None


def matching(campaign: Campaign, cells: Mapping[str, Any], figure: str = "") -> list[str]:
    """Find the impedance trials with these cells of the sheet.

    Parameters
    ----------
    campaign : Campaign
    cells : Mapping
        By column; None matches an empty cell.
    figure : str
        Section of `figures` in the configuration that asks for them; empty: none.

    Raises
    ------
    InputError
        The figure asks for an example that the campaign does not have, unless the default
        configuration does.
    """
    trials = [
        trial
        for trial in campaign.trials("impedance")
        if all(campaign.row(trial)[column] == value for column, value in cells.items())
    ]
    if trials or not figure:
        return trials
    default = read_mapping(default_config())["figures"].get(figure) or {}
    if all(default.get(column) == value for column, value in cells.items()):
        return trials
    shown = {name: cells.get(name) for name in CONDITION}
    stated = [
        f"{name} = {value if isinstance(value, str) else f'{value:g}'}"
        for name, value in shown.items()
        if value is not None
    ]
    raise InputError(
        f"{campaign.config.sheet}: no impedance trial with"
        f" {', '.join(stated) or 'these empty cells'}; choose another one under figures.{figure},"
        f" or null to have one chosen{nearest(cells.get('controller') or '', CONTROLLERS)}"
    )
