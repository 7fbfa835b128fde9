"""The examples that figures and summary show: those of the configuration, or chosen from the sheet, and then said."""

from dataclasses import dataclass
from typing import Any

from osl_analysis.campaign import Campaign
from osl_analysis.config import FrequencyResponseFigure
from osl_analysis.errors import InputError
from osl_analysis.shipped import default_config
from osl_analysis.yaml_settings import read_mapping

FIRST = "the first impedance trial of the sheet"
NEITHER = "the example of the configuration is not in this campaign"


@dataclass(frozen=True)
class ImpedanceExample:
    """The trial of Fig. 4.

    trial: its name.
    joint, side: its joint and side.
    amplitude_deg: amplitude that is drawn [deg]; None: the largest.
    duration_s: length of the part that is drawn [s].
    chosen: why this trial, where the configuration does not name it; empty where it does.
    """

    trial: str
    joint: str
    side: str | None
    amplitude_deg: float | None
    duration_s: float
    chosen: str


def time_series_example(campaign: Campaign) -> ImpedanceExample | None:
    """The trial that Fig. 4 shows; None for a campaign without impedance trials.

    Raises
    ------
    InputError
        The configuration asks for a trial that the sheet does not have, and the default configuration does not.
    """
    stated, trials = campaign.config.figures.time_series, campaign.trials("impedance")
    if not trials:
        return None
    places = campaign.places
    first, duration = places[trials[0]], stated.duration_s if stated else 10.0
    if stated is None:
        return ImpedanceExample(trials[0], **first, amplitude_deg=None, duration_s=duration, chosen=FIRST)
    asked = {"controller": stated.controller, "K_d": stated.K_d, "B_d": stated.B_d}
    found = matching(campaign, asked)
    if found:
        place = places[found[0]]
        return ImpedanceExample(found[0], **place, amplitude_deg=stated.amplitude_deg, duration_s=duration, chosen="")
    check_default(campaign, "time_series", asked)
    return ImpedanceExample(trials[0], **first, amplitude_deg=None, duration_s=duration, chosen=f"{FIRST}; {NEITHER}")


def response_example(campaign: Campaign) -> FrequencyResponseFigure | None:
    """The desired impedance that Fig. 7 shows; None: the one with the most trials. Raises as `time_series_example`."""
    stated = campaign.config.figures.frequency_response
    if stated is None or not campaign.trials("impedance"):
        return None
    asked = {"K_d": stated.K_d, "B_d": stated.B_d}
    if matching(campaign, asked):
        return stated
    check_default(campaign, "frequency_response", asked)
    return None


def matching(campaign: Campaign, asked: dict[str, Any]) -> list[str]:
    """The impedance trials whose cells are these; None matches an empty cell."""
    trials = campaign.trials("impedance")
    return [name for name in trials if all(campaign.row(name)[cell] == value for cell, value in asked.items())]


def check_default(campaign: Campaign, figure: str, asked: dict[str, Any]) -> None:
    """Refuse an example that is not in the campaign, unless the default configuration asks for it.

    Every configuration overrides the default one, whose examples are those of the default campaign.
    """
    default = read_mapping(default_config())["figures"].get(figure) or {}
    if all(default.get(name) == value for name, value in asked.items()):
        return
    said = ", ".join(f"{name} = {value:g}" for name, value in asked.items() if isinstance(value, float))
    what = f"{asked.get('controller') or 'impedance'} trial with {said or 'these empty cells'}"
    raise InputError(
        f"{campaign.config.sheet}: no {what}; choose another one under figures.{figure} in the configuration, or null "
        "to have one chosen from the sheet"
    )
