"""A first look at a campaign: the first bench trial of each source file, ingested and fitted before anything else runs.

A torque with the wrong sign or unit, or an angle in degrees, shows in one trial as well as in fifty.
"""

import os
from collections.abc import Iterator
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import polars as pl

from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.campaign import Campaign, open_campaign
from osl_analysis.commands.fit import fit_one_trial, fit_request
from osl_analysis.commands.fit_text import estimates_text
from osl_analysis.commands.ingest import ingest_trial
from osl_analysis.config import read_config
from osl_analysis.errors import OslAnalysisError
from osl_analysis.experiments import EXPERIMENTS
from osl_analysis.shipped import CAMPAIGN

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


def off_desired(estimates: pl.DataFrame, K_d: float | str | None) -> str:
    """What a stiffness far from the one that was asked for may mean; empty where it is near, or none was asked for."""
    ratio = 1.0 if K_d is None else float(estimates["K"][-1]) / float(K_d)
    if K_d is None or FAR[0] <= ratio <= FAR[1]:
        return ""
    return (
        f"K is {ratio:.3g} times the K_d = {float(K_d):g} N*m/rad of this trial: are K_d and the units of torque and "
        "angle right?"
    )


def look(campaign: Campaign, trial: str, config: Path) -> Look:
    """Ingest and fit one trial into a folder that is deleted."""
    row = campaign.row(trial)
    experiment = str(row["experiment"])
    with TemporaryDirectory() as place:
        ingested = Path(place) / f"{trial}.parquet"
        try:
            ingest_trial(campaign.recording(trial), campaign.config.raw_data, campaign.config.sources, ingested)
            asked = None
            if experiment == "impedance" and row["K_d"] is not None:
                asked = DesiredImpedance(row["controller"] or "", row["K_d"], row["B_d"])
            fitted = fit_one_trial(experiment, ingested, campaign.device(trial), fit_request(experiment, config, asked))
        except OslAnalysisError as error:
            return Look(trial, experiment, str(error).replace(str(Path(place)) + os.sep, ""), is_sound=False)
        except Exception as fault:  # a fault of the program in one recording must not hide the others
            return Look(trial, experiment, f"unexpected {type(fault).__name__}: {fault}", is_sound=False)
    far = off_desired(fitted.estimates, row["K_d"]) if experiment == "impedance" else ""
    if far:
        return Look(trial, experiment, f"{far}\n{estimates_text(fitted.estimates)}", is_sound=False)
    doubts = [text for text in fitted.estimates["doubtful"].to_list() if text] if "doubtful" in fitted.estimates else []
    return Look(trial, experiment, estimates_text(fitted.estimates), is_sound=not doubts)
