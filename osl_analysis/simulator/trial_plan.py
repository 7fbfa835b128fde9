# SPDX-License-Identifier: Apache-2.0
"""The plan of a simulated campaign: its random numbers, and the rows of its sample sheet."""

import itertools
import zlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from osl_analysis.base.errors import InputError
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.config.sheet import JOINT, SHEET_COLUMNS, SheetRows
from osl_analysis.simulator.simulation_settings import SimulationSettings


def generator_of(seed: int, trial: str, effect: str) -> np.random.Generator:
    """Make the random generator of one effect in one trial, which depends on nothing else.

    A trial that is simulated alone equals the campaign's, and switching one effect off leaves the
    random numbers of the others.
    """
    return np.random.default_rng([seed, zlib.crc32(trial.encode()), zlib.crc32(effect.encode())])


# experiments in the order of the sheet, with the number of digits in the names of their trials
DIGITS = {
    "belt": 2,
    "transmission": 1,
    "actuator": 1,
    "impedance": 0,
    "static": 1,
    "plate": 2,
    "walking": 2,
}


def plan_trials(settings: SimulationSettings) -> SheetRows:
    """Plan the trials of a simulated campaign.

    Returns
    -------
    SheetRows
        A row per trial, in the columns of `sheet.py`. The same settings give the same plan. Whether
        a crossing is perturbed depends on the seed and its name, not on the number of crossings.

    Raises
    ------
    InputError
        No trial is planned, or two have the same name.
    """
    rows = {}
    for trial, experiment, condition in planned_trials(settings):
        if trial in rows:
            raise InputError(
                f"the plan has two trials '{trial}': K_d and B_d of experiments are too close"
                " for names of their own",
                "remove one of them",
            )
        rows[trial] = row_of(trial, experiment, condition, settings)
    if not rows:
        raise InputError("no trials are planned", "ask in `experiments` for at least one")
    return rows


def planned_trials(settings: SimulationSettings) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """All trials in the order of the sheet: name, experiment, and cells of the condition."""
    for experiment, digits in DIGITS.items():
        if experiment == "impedance":
            yield from impedance_trials(settings)
            continue
        for number in range(1, getattr(settings.experiments, experiment) + 1):
            yield f"{experiment}_{number:0{digits}d}", experiment, {}


def impedance_trials(
    settings: SimulationSettings,
) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """A trial for each controller, stiffness and damping; several where excitations are stated."""
    wanted = settings.experiments
    endings = [
        f"_{excitation.name}_{number}"
        for excitation in settings.excitations
        for number in range(1, excitation.trials + 1)
    ]
    for controller, K_d, B_d in itertools.product(wanted.controllers, wanted.K_d, wanted.B_d):
        condition = {"controller": controller, "K_d": K_d, "B_d": B_d}
        for ending in endings or [""]:
            name = f"impedance_K{K_d:g}_B{B_d:.1f}_{controller}{ending}"
            yield name, "impedance", condition


def row_of(
    trial: str, experiment: str, condition: Mapping[str, Any], settings: SimulationSettings
) -> dict[str, Any]:
    """The sheet's row of a planned trial."""
    facts = EXPERIMENTS[experiment]
    files = {}
    if facts.log:
        files["log"] = f"{facts.log}/{trial}.mcap"
    if facts.mocap:  # crossings also have the leg's log
        files["mocap"] = f"{facts.mocap}/{trial}.c3d"
    sources = {f"{role}_source": getattr(facts, role) for role in files}
    row = {
        **dict.fromkeys(SHEET_COLUMNS),
        "trial": trial,
        "experiment": experiment,
        "joint": JOINT,
        **files,
        **sources,
        **condition,
    }
    if experiment == "walking":
        draw = generator_of(settings.seed, trial, "perturbed").random()
        row["perturbed"] = bool(draw < settings.experiments.perturbed_share)
    return row
