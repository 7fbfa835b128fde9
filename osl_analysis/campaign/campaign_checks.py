"""What a campaign must fulfil before anything runs: its files, its sheet, its walking trials."""

import filecmp
import os
from pathlib import Path
from typing import Any, NamedTuple
from warnings import catch_warnings

from osl_analysis.campaign.campaign_trials import Campaign
from osl_analysis.campaign.configuration import Config
from osl_analysis.config.impedance_trajectory import read_impedance_trajectory
from osl_analysis.errors import InputError, listing, naming, nearest
from osl_analysis.ingest.quality import UNITS
from osl_analysis.judge.known_findings import CHECKS
from osl_analysis.judge.recording_checks import unknown_check, validate_rules
from osl_analysis.model.drivetrain import known_parameters
from osl_analysis.trial import stretches
from osl_analysis.walking.groups import split_keys

# cells of a row that name a recording
RECORDING = ("experiment", "log", "log_source", "log_part", "mocap")
WHOLE_RECORDING = "0-1000000"  # [s] as windows
FEWEST_PERTURBED = 2
ROUNDING_S = 1e-6  # of differences of times that are written with milliseconds


class UsedPart(NamedTuple):
    """A part of a recording that a trial uses."""

    start: float  # [s]
    stop: float  # [s]
    trial: str


def check_campaign(campaign: Campaign) -> None:
    """Refuse a campaign that cannot be analysed.

    Raises
    ------
    InputError
        The configuration names a missing file; quality rules, or names under `accept`, match no
        check; two trials use one recording; or the analysis of walking trials lacks other trials.
    """
    check_files(campaign.config)
    validate_rules(campaign.config.quality, UNITS)
    used_parts = dict[tuple[Any, ...], list[UsedPart]]()
    for trial in campaign.rows:
        for name in campaign.accepted(trial):
            if name not in CHECKS:
                raise InputError(
                    f"{campaign.config.sheet}: trial '{trial}', accept: {unknown_check(name)}"
                )
        recording = tuple(campaign.row(trial)[cell] for cell in RECORDING)
        check_not_used_twice(campaign, trial, used_parts.setdefault(recording, []))
        check_desired_curve(campaign, trial)
    if campaign.config.simulation is None:
        check_no_copies(campaign)
    if campaign.trials("walking"):
        check_walking(campaign)


def check_not_used_twice(campaign: Campaign, trial: str, used: list[UsedPart]) -> None:
    """Refuse a log of which another trial uses the same part; adds the parts of this trial to the
    `used` ones."""
    row = campaign.row(trial)
    if not row["log"]:
        return
    for start, stop in stretches(row["windows"] or WHOLE_RECORDING):
        for used_part in used:
            shared_s = min(stop, used_part.stop) - max(start, used_part.start)
            if shared_s > ROUNDING_S:
                raise InputError(
                    f"{campaign.config.sheet}: trial '{trial}': trial '{used_part.trial}' uses the"
                    f" same part of log '{row['log']}'; correct one, or give each its own `windows`"
                )
        used.append(UsedPart(start, stop, trial))


def check_desired_curve(campaign: Campaign, trial: str) -> None:
    """Refuse the name of a desired curve that the configuration does not have."""
    curve = campaign.row(trial)["desired"]
    curves = campaign.config.torque_angle.desired
    if curve and curve not in curves:
        raise InputError(
            f"{campaign.config.sheet}: trial '{trial}', desired '{curve}' is no curve;"
            f" torque_angle.desired in the configuration has {listing([*curves])}"
            f"{nearest(curve, curves)}"
        )


def check_no_copies(campaign: Campaign) -> None:
    """Refuse a recording that another trial of the experiment has under another name: it would
    count twice."""
    files_alike: dict[tuple[object, ...], list[Path]] = {}
    for trial, row in campaign.rows.items():
        for file in campaign.logs(trial):
            # two bags may have equal descriptions; the job of its trial refuses what is not there
            is_readable = os.access(file, os.R_OK) and file.suffix != ".yaml"
            size = file.stat().st_size if is_readable else 0
            if not size:
                continue
            alike = (row["experiment"], row["log_part"], row["windows"], size)
            earlier = files_alike.setdefault(alike, [])
            for other in {*earlier} - {file}:
                if filecmp.cmp(other, file, shallow=False):
                    raise InputError(
                        f"{campaign.config.sheet}: trial '{trial}': {file} is a copy of {other},"
                        " the recording of another trial, and would count twice; exclude one, or"
                        " name its own"
                    )
            earlier.append(file)


def check_files(config: Config) -> None:
    """Refuse a missing file, and a results' folder that is a file. Ingest checks raw files."""
    check_folders(config)
    # the jobs that use the parameters give their warnings
    with naming("parameters"), catch_warnings(action="ignore"):
        known_parameters(config.parameters)
    if config.impedance_trajectory is not None:
        with naming("impedance_trajectory"):
            read_impedance_trajectory(config.impedance_trajectory)


def check_folders(config: Config) -> None:
    """Refuse folders that are files, and a results' folder that holds what is analysed."""
    results = config.results.resolve()
    if any(
        path.resolve().is_relative_to(results)
        for path in (config.raw_data, config.sources, config.sheet, Path())
    ):
        raise InputError(
            f"configuration: results = {config.results} holds the recordings, source files, sheet"
            " or campaign; name another folder"
        )
    for field in ("raw_data", "sources", "results"):
        path: Path = getattr(config, field)
        for folder in (path, *path.parents):
            if folder.is_file():
                raise InputError(
                    f"{folder}: is a file; name a folder under `{field}` in the configuration"
                )


def check_walking(campaign: Campaign) -> None:
    """Refuse walking trials without a capture, or without static, plate or other trials."""
    sheet = campaign.config.sheet
    walking = campaign.config.walking
    for trial in campaign.trials("walking"):
        if campaign.row(trial)["mocap"] is None:
            raise InputError(
                f"{sheet}: trial '{trial}': mocap is empty; a trial of experiment 'walking' needs"
                " it"
            )
    fewest_plates = int(walking.plate_inertia == "identified")
    needs = {
        "trial of experiment 'static'": (campaign.trials("static"), 1),
        "unperturbed crossings (walking.fewest_unperturbed)": (
            campaign.crossings(perturbed=False),
            walking.fewest_unperturbed,
        ),
        "perturbed crossings": (campaign.crossings(perturbed=True), FEWEST_PERTURBED),
        "trial of experiment 'plate', unless walking.plate_inertia is none": (
            campaign.trials("plate"),
            fewest_plates,
        ),
    }
    for what, (trials, fewest) in needs.items():
        if len(trials) < fewest:
            raise InputError(
                f"{sheet}: walking needs {fewest} or more {what}, and there are {len(trials)}; add"
                " them, or exclude the walking trials"
            )
    for static in campaign.statics:
        campaign.calibration_settings(static)
    with naming(sheet):
        split_keys(campaign.conditions())
