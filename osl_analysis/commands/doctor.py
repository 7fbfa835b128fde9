"""`osl-analysis doctor`: what this machine has and lacks, and whether the campaign can be read."""

import os
import platform
import shutil
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.commands.campaign_start import check_start, source_problems, unnamed_recordings
from osl_analysis.errors import EXTRAS, OslAnalysisError
from osl_analysis.files import CAMPAIGN, root

LEAST_FREE_GB = 2
"""The default campaign takes 0.4 GB without its recordings; that of a laboratory takes more."""


class Look(NamedTuple):
    """What `doctor` says of one thing."""

    subject: str
    state: str  # of the subject, as its version or what is wrong with it
    remedy: str = ""  # empty if nothing is to be done
    is_absent: bool = False  # an optional library that is not installed


def looked_at(folder: Path) -> Iterator[Look]:
    """What this machine has and lacks, and whether the campaign in a folder can be read."""
    yield Look("Python", platform.python_version())
    yield Look("osl-analysis", f"{version('osl-analysis')}, workflow in {root()}")
    for name in ("snakemake", "numpy", *EXTRAS):
        yield library(name)
    yield Look("cores", str(usable_cores()))
    yield free_space(folder)
    if os.access(folder, os.W_OK):
        yield Look("folder", "can be written to")
    else:
        yield Look("folder", "cannot be written to", "choose another one")
    yield campaign(folder / CAMPAIGN)


def library(name: str) -> Look:
    """Whether a library is installed, and how to install it."""
    try:
        return Look(name, version(name))
    except PackageNotFoundError:
        pass
    if name in EXTRAS:
        install = f"pip install 'osl-analysis[{EXTRAS[name]}]'"
        return Look(name, f"not installed, optional: {install}", is_absent=True)
    return Look(name, "not installed", f"pip install {name}")


def usable_cores() -> int | None:
    """The cores that this process may use; all of the machine where the system does not say."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count()


def free_space(folder: Path) -> Look:
    """The room that is left on the disk of a folder."""
    free_gb = shutil.disk_usage(folder).free / 1e9
    remedy = "make room, or work on another disk" if free_gb < LEAST_FREE_GB else ""
    return Look("free space", f"{free_gb:.0f} GB in {folder.resolve()}", remedy)


def campaign(path: Path) -> Look:
    """What a campaign's configuration and sheet tell, and what to correct."""
    if not path.is_file():
        return Look("campaign", "none in this folder")
    try:
        config = read_config(path)
        if config.simulation is not None:
            return Look("campaign", f"{config.campaign}, simulated")
        opened = open_campaign(config, None)
        check_start(opened)
        problems = list(dict.fromkeys(source_problems(opened).values()))
        left_out = unnamed_recordings(opened)
    except OslAnalysisError as error:
        return Look("campaign", error.reason, error.remedy or "correct it")
    if problems:
        remedy = "correct it" if len(problems) == 1 else "correct them"
        return Look("campaign", " | ".join(problems), remedy)

    trials = opened.trials()
    text = f"{config.campaign}, {len(trials)} trials"
    if left_out:
        text += f"; {left_out}"
    missing = [trial for trial in trials if not all(log.exists() for log in opened.logs(trial))]
    remedy = ""
    if missing:
        remedy = f"files of {len(missing)} are missing, first of {missing[0]}: correct the sheet"
    return Look("campaign", text, remedy)
