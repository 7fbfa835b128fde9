# SPDX-License-Identifier: Apache-2.0
"""Simulate a campaign, or one trial of it, into a raw-data folder."""

from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any
from warnings import catch_warnings

import polars as pl

from osl_analysis.base.errors import InputError, naming, nearest, optional_module
from osl_analysis.base.files import write_text
from osl_analysis.base.yaml_settings import read_yaml, validated
from osl_analysis.campaign.configuration import SharedChoices
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.config.impedance_trajectory import read_impedance_trajectory
from osl_analysis.config.sheet import SheetRows
from osl_analysis.model.compensator import check_request
from osl_analysis.model.drivetrain import read_parameters
from osl_analysis.simulator.laboratory_settings import WalkingSettings
from osl_analysis.simulator.simulation_settings import SimulationSettings
from osl_analysis.simulator.trial_plan import plan_trials, planned_trials, row_of

TRUTH = "truth"
UNFOLLOWED = SharedChoices()  # no configuration to follow: the settings alone decide


def check_folder(folder: Path) -> None:
    """Refuse to simulate into a folder of real recordings, which has no folder `truth`."""
    for path in folder.rglob("*"):
        if (folder / TRUTH).is_dir():  # also if another job makes it meanwhile
            return
        is_recording = path.suffix.lower() in (".mcap", ".c3d") or path.name == "trials.csv"
        if is_recording:
            raise InputError(
                f"{path}: the simulator did not make it (there is no folder '{TRUTH}' in {folder})",
                "for real recordings write `simulation: null` in the configuration, for a"
                " simulation choose an empty folder for `sheet` and `raw_data`",
            )


def planned_sheet(settings_path: Path, sheet: Path) -> SheetRows | None:
    """The plan of a simulated campaign; None where the sheet on disk is newer than the settings and
    is to be read instead, so that trials can be excluded or added by hand."""
    check_folder(sheet.parent)
    with naming("simulation"):
        settings = read_yaml(settings_path, SimulationSettings)
    if sheet.is_file() and sheet.stat().st_mtime >= settings_path.stat().st_mtime:
        return None
    return plan_trials(settings)


def write_sheet(settings_path: Path, sheet: Path) -> None:
    """Write the plan of a simulated campaign as its sample sheet."""
    check_folder(sheet.parent)
    rows = plan_trials(read_yaml(settings_path, SimulationSettings))
    (sheet.parent / TRUTH).mkdir(parents=True, exist_ok=True)
    table = pl.DataFrame([*rows.values()], infer_schema_length=None)
    write_text(sheet, table.write_csv())


def settings_files(settings_path: Path, followed: SharedChoices = UNFOLLOWED) -> list[Path]:
    """The files that decide what is simulated: the settings and those that they, or the `followed`
    choices, name."""
    settings = read_simulation(settings_path, followed)
    laboratory = laboratory_of(settings, followed)
    # the jobs give the warnings
    with catch_warnings(action="ignore"), naming(f"{settings_path}: experiments"):
        wanted = settings.experiments
        p = read_parameters(settings.parameters)
        # K_s limits K_d only where a compensated controller renders it through the drivetrain
        is_rendered = "compensated" in wanted.controllers and settings.joint is None
        stiffnesses = wanted.K_d if is_rendered else (p.K_s / 2,)
        for K_d, B_d in product(stiffnesses, wanted.B_d):
            check_request(K_d, B_d, p)
    if laboratory is None or settings.walking is None:
        return [settings_path, settings.parameters]
    with naming(f"{settings.walking}: impedance"):
        read_impedance_trajectory(laboratory.impedance)
    return [settings_path, settings.parameters, settings.walking, laboratory.impedance]


def read_simulation(settings_path: Path, followed: SharedChoices) -> SimulationSettings:
    """The settings of a simulated campaign, with what its configuration decides in place of their
    own."""
    settings = read_yaml(settings_path, SimulationSettings)
    chosen = followed.model_dump(include={"parameters", "gain_weight"}, exclude_none=True)
    if followed.protocol is not None:
        chosen["protocol"] = settings.protocol.model_dump() | followed.protocol
    if chosen:
        fields = {**settings.model_dump(), **chosen}
        settings = validated(fields, SimulationSettings, settings_path)
    if settings.walking is not None and not settings.walking.is_file():
        raise InputError(
            f"{settings_path}: walking: {settings.walking} is no file", "correct it, or write null"
        )
    return settings


def laboratory_of(settings: SimulationSettings, followed: SharedChoices) -> WalkingSettings | None:
    """The gait laboratory of a simulated campaign, if it has one. Its gains are selected as on the
    bench."""
    if settings.walking is None:
        return None
    walking_settings = read_yaml(settings.walking, WalkingSettings)
    impedance = followed.impedance_trajectory or walking_settings.impedance
    return walking_settings.model_copy(
        update={"gain_weight": settings.gain_weight, "impedance": impedance}
    )


def simulate_planned_trial(
    settings_path: Path, campaign_folder: Path, trial: str, followed: SharedChoices = UNFOLLOWED
) -> None:
    """Simulate one trial of the plan: its logs where the sheet says, and `truth/<trial>.json`. What
    the campaign's configuration decides (`followed`) replaces what the settings have."""
    check_folder(campaign_folder)
    settings = read_simulation(settings_path, followed)
    row = row_of_trial(settings, settings_path, trial)
    optional_module("numba", "the simulator")  # planning, which imports this module, needs none
    p = read_parameters(settings.parameters)
    # the truth first, so that every log has one
    if EXPERIMENTS[row["experiment"]].place == "bench":
        from osl_analysis.simulator import bench_trial, recorder

        log, truth = bench_trial.simulate_bench_trial(row, settings, p)
        recorder.write_truth(campaign_folder, trial, truth)
        bench_trial.write_bench_log(campaign_folder / row["log"], log)
        return
    from osl_analysis.simulator.walking_trial import simulate_walking_trial

    laboratory = laboratory_of(settings, followed)
    assert laboratory is not None  # else the settings would plan no such trial
    simulate_walking_trial(row, settings, laboratory, p, campaign_folder)


def simulate_campaign(
    settings_path: Path, campaign_folder: Path, followed: SharedChoices = UNFOLLOWED
) -> None:
    """Write the sample sheet and simulate all of its trials, one after the other."""
    settings_files(settings_path, followed)
    write_sheet(settings_path, campaign_folder / "trials.csv")
    for trial in plan_trials(read_simulation(settings_path, followed)):
        simulate_planned_trial(settings_path, campaign_folder, trial, followed)


def row_of_trial(
    settings: SimulationSettings, settings_path: Path, trial: str
) -> Mapping[str, Any]:
    """The row of the sheet of one trial of the plan. Raises InputError: it is not planned."""
    names = []
    for name, experiment, condition in planned_trials(settings):
        if name == trial:
            return row_of(trial, experiment, condition, settings)
        names.append(name)
    raise InputError(f"{settings_path}: plans no trial '{trial}'{nearest(trial, names, 0.0)}")
