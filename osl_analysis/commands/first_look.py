"""A first look at a campaign: the first bench trial of each source file, ingested and fitted before anything else runs.

A torque with the wrong sign or unit, or an angle in degrees, shows in one trial as well as in fifty.
"""

from collections.abc import Iterator, Mapping
from contextlib import chdir
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.campaign import Campaign, open_campaign
from osl_analysis.commands.fit import FittedTrial, fit_request, fit_trial
from osl_analysis.commands.fit_text import estimates_text
from osl_analysis.commands.ingest import checked_trial
from osl_analysis.config import read_config
from osl_analysis.errors import OslAnalysisError, unexpected
from osl_analysis.experiments import EXPERIMENTS
from osl_analysis.shipped import CAMPAIGN
from osl_analysis.trial import Trial

FAR = (0.6, 1.67)
"""K over K_d beyond which a unit or K_d is probably wrong: a joint renders K_d to some 20 %."""


@dataclass(frozen=True)
class Look:
    """What the first trial of a source file gave."""

    trial: str
    experiment: str
    said: str
    """The estimates with their doubts, or why there are none."""
    is_sound: bool
    """Whether it was fitted, without a doubt."""


def first_look(folder: Path) -> Iterator[Look]:
    """The first trial of each experiment and source file of the campaign in a folder, fitted. Nothing is left behind.

    Raises
    ------
    InputError
        Configuration or sample sheet are not valid.
    """
    with chdir(folder):
        config = read_config(CAMPAIGN)
        campaign = open_campaign(config, None)
        for trial in first_trials(campaign):
            yield look(campaign, trial, CAMPAIGN)


def first_trials(campaign: Campaign) -> list[str]:
    """The first bench trial of each experiment and source file."""
    first: dict[tuple[str, str], str] = {}
    for trial in campaign.trials(*(name for name, facts in EXPERIMENTS.items() if facts.place == "bench")):
        row = campaign.row(trial)
        first.setdefault((row["experiment"], row["log_source"] or row["mocap_source"]), trial)
    return list(first.values())


def off_desired(estimates: pl.DataFrame, row: Mapping[str, Any]) -> str:
    """What a stiffness far from the K_d of an impedance trial may mean; empty if it is near, or no K_d is known."""
    K_d = row["K_d"]
    if row["experiment"] != "impedance" or K_d is None:
        return ""
    ratio = float(estimates["K"][-1]) / float(K_d)
    if FAR[0] <= ratio <= FAR[1]:
        return ""
    return (
        f"K is {ratio:.3g} times the K_d = {float(K_d):g} N*m/rad of this trial: are K_d and the units of torque and "
        "angle right?"
    )


def fit_of_row(trial: Trial, row: Mapping[str, Any], device: Path | None, config: Path) -> FittedTrial:
    """The fit of a trial in memory, by what its row of a sheet says, drafted or not, as in the workflow.

    `device` is its parameter file. Raises as `fit_request` and `fit_trial`.
    """
    experiment, asked = str(row["experiment"]), None
    if experiment == "impedance":
        K_d, B_d = (None if row[name] is None else float(row[name]) for name in ("K_d", "B_d"))
        asked = DesiredImpedance(row["controller"], K_d, B_d)
    request = fit_request(experiment, config, asked)
    stated = replace(request, windows=row.get("windows"), curve=row.get("desired"))
    return fit_trial(experiment, trial, device, stated)


def look(campaign: Campaign, name: str, config: Path) -> Look:
    """Ingest and fit one trial. Nothing is written."""
    row, folders = campaign.row(name), campaign.config
    experiment = str(row["experiment"])
    try:
        trial = checked_trial(campaign.recording(name), folders.raw_data, folders.sources)
        fitted = fit_of_row(trial, row, campaign.device(name), config)
    except OslAnalysisError as error:
        return Look(name, experiment, str(error), is_sound=False)
    except Exception as fault:  # a fault of the program in one recording must not hide the others
        return Look(name, experiment, unexpected(fault), is_sound=False)
    far = off_desired(fitted.estimates, row)
    if far:
        return Look(name, experiment, f"{far}\n{estimates_text(fitted.estimates)}", is_sound=False)
    doubts = [text for text in fitted.estimates["doubtful"].to_list() if text] if "doubtful" in fitted.estimates else []
    return Look(name, experiment, estimates_text(fitted.estimates), is_sound=not doubts)
