"""`osl-analysis run` and `doctor`: run the workflow on the campaign in this folder, or say what it lacks."""

import difflib
import os
import platform
import shutil
import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import PackageNotFoundError, requires, version
from itertools import pairwise
from pathlib import Path

from packaging.requirements import Requirement

from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.files import CAMPAIGN, check_working_folder, root, shipped
from osl_analysis.yaml_settings import read_mapping

CONFIGURED_BY = ("--configfile", "--configfiles")  # options of Snakemake that name a configuration


def snakemake_arguments(arguments: Sequence[str]) -> list[str]:
    """The arguments of Snakemake for the campaign in the working folder: those of the user first, because options of
    Snakemake that take lists also take what stands behind them. Raises InputError where there is no campaign, the
    folder cannot be written to, or a configuration or profile is missing."""
    said = any(argument.split("=")[0] in CONFIGURED_BY for argument in arguments)
    is_clone = Path("Snakefile").is_file() and Path("config/config.yaml").is_file()
    if not (said or CAMPAIGN.is_file() or is_clone):
        raise InputError(
            f"{Path.cwd()}: no campaign here, which has a {CAMPAIGN}; change to the folder of a campaign, or make one: "
            "`osl-analysis init FOLDER`"
        )
    check_working_folder()
    own = [] if said or not CAMPAIGN.is_file() else ["--configfile", str(CAMPAIGN)]
    takes_files = False
    for argument in [*arguments, *own]:  # Snakemake's own words for a configuration that cannot be read are a traceback
        option, _, value = argument.partition("=")
        takes_files = option in CONFIGURED_BY if argument.startswith("-") else takes_files
        if file := takes_files and (value if argument.startswith("-") else argument):
            read_mapping(Path(file))
    return [*with_shipped_profile(arguments), "--snakefile", str(shipped("Snakefile")), *own]


def with_shipped_profile(arguments: Sequence[str]) -> Iterator[str]:
    """The arguments, with the folder of a shipped profile where it is named, as `profiles/slurm`, and none here has its
    name. A name that neither has is refused: Snakemake would go on without a profile."""
    option = "--workflow-profile"
    for before, argument in pairwise(("", *arguments)):
        own = f"{option}=" if argument.startswith(f"{option}=") else ""
        named = argument.removeprefix(own)
        if own or before == option:
            if named != "none" and not shipped(named).is_dir():
                known = sorted(f"profiles/{one.name}" for one in shipped("profiles").iterdir())
                near = difflib.get_close_matches(named, known, 1, 0.5)
                meant = f"did you mean {near[0]}?" if near else f"correct it: there are {', '.join(known)}"
                raise InputError(f"{option} {named}: no such folder; {meant}")
            argument = f"{own}{shipped(named)}"
        yield argument


def looked_at(folder: Path) -> Iterator[tuple[str, str, str]]:
    """What this machine has and lacks, and whether the campaign in a folder can be read: a line each of what was looked
    at, what was found, and what to do, if anything."""
    too_old = sys.version_info[:2] < (3, 11)
    there = all(shipped(name).is_file() for name in ("Snakefile", "config/config.yaml"))
    again = "" if there else "install osl-analysis again: the files of its workflow are missing"
    yield "Python", platform.python_version(), "install Python 3.11 or newer" if too_old else ""
    yield "osl-analysis", f"{version('osl-analysis')}, workflow in {root()}", again
    for needed in map(Requirement, requires("osl-analysis") or ()):
        marker = needed.marker
        is_optional = marker is not None and any(marker.evaluate({"extra": one}) for one in ("mat73", "ros", "tdms"))
        if marker and not marker.evaluate() and not is_optional:
            continue
        try:
            found = version(needed.name)
        except PackageNotFoundError:
            optional = ", only for its files" if is_optional else ""
            yield needed.name, f"not installed{optional}", "" if is_optional else f"pip install '{needed}'"
            continue
        fits = needed.specifier.contains(found, prereleases=True)
        if not fits or needed.name in ("snakemake", "numpy"):
            yield needed.name, found, "" if fits else f"pip install '{needed.name}{needed.specifier}'"
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    yield "cores", f"{cores}", ""
    free = shutil.disk_usage(folder).free / 1e9  # the default campaign takes 0.4 GB, recordings not counted
    few = "make room, or work on another disk" if free < 2 else ""
    yield "free space", f"{free:.0f} GB in {folder.resolve()}", few
    can = os.access(folder, os.W_OK)
    yield "folder", "can be written to" if can else "cannot be written to", "" if can else "choose another one"
    yield "campaign", *campaign(folder / CAMPAIGN)


def campaign(path: Path) -> tuple[str, str]:
    """What a campaign's configuration and sheet tell, and what to correct."""
    from osl_analysis.campaign.campaign import check_campaign, open_campaign
    from osl_analysis.campaign.configuration import read_config

    if not path.is_file():
        return "none in this folder", ""
    try:
        config = read_config(path)
        if config.simulation is not None:
            return f"{config.campaign}, simulated", ""
        opened = open_campaign(config, None)
        check_campaign(opened)
    except OslAnalysisError as error:
        return str(error), "correct it"
    missing = [trial for trial in opened.trials() if not all(log.exists() for log in opened.logs(trial))]
    lack = f"files of {len(missing)} are missing, first of {missing[0]}: correct the sheet" if missing else ""
    return f"{config.campaign}, {len(opened.trials())} trials", lack
