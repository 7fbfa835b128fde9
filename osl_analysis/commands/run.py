"""`osl-analysis run` and `doctor`: run the workflow on the campaign in this folder, or say what it lacks."""

import difflib
import os
import platform
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from itertools import pairwise
from pathlib import Path

from packaging.requirements import Requirement

from osl_analysis.config.yaml_settings import read_mapping
from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.files import CAMPAIGN, check_working_folder, root, shipped

STATES_ITS_OWN = ("--configfile", "--configfiles")  # options of Snakemake that name a configuration
PROFILE_OPTION = "--workflow-profile"  # names a folder with options: one here, or a shipped one as `profiles/slurm`


def snakemake_arguments(arguments: Sequence[str]) -> list[str]:
    """The arguments of Snakemake for the campaign in the working folder: those of the user first, because options of
    Snakemake that take lists also take what stands behind them. Raises InputError where there is no campaign, the
    folder cannot be written to, or a configuration or profile is missing.
    """
    said = any(argument.split("=")[0] in STATES_ITS_OWN for argument in arguments)
    is_clone = Path("Snakefile").is_file() and Path("config/config.yaml").is_file()
    if not (said or CAMPAIGN.is_file() or is_clone):
        raise InputError(
            f"{Path.cwd()}: no campaign here, which has a {CAMPAIGN}; change to the folder of a campaign, or make one: "
            "`osl-analysis init FOLDER`"
        )
    check_working_folder()
    own = [] if said or not CAMPAIGN.is_file() else ["--configfile", str(CAMPAIGN)]
    for file in configurations([*arguments, *own]):  # Snakemake's own words for these are a traceback
        read_mapping(file)
    return [*with_shipped_profile(arguments), "--snakefile", str(shipped("Snakefile")), *own]


def with_shipped_profile(arguments: Sequence[str]) -> Iterator[str]:
    """The arguments, with the folder of a shipped profile where it is named and none here has its name."""
    for before, argument in pairwise(("", *arguments)):
        option, is_stated, value = argument.partition("=")
        if before == PROFILE_OPTION:
            yield profile_folder(argument)
        else:
            yield f"{PROFILE_OPTION}={profile_folder(value)}" if option == PROFILE_OPTION and is_stated else argument


def profile_folder(named: str) -> str:
    """The folder of a profile, here or shipped, or `none`; another name is refused: Snakemake would go on without."""
    folder = shipped(named)
    if named != "none" and not folder.is_dir():
        known = sorted(f"profiles/{one.name}" for one in shipped("profiles").iterdir())
        near = difflib.get_close_matches(named, known, 1, 0.5)
        meant = f"did you mean {near[0]}?" if near else f"correct it: there are {', '.join(known)}"
        raise InputError(f"{PROFILE_OPTION} {named}: no such folder; {meant}")
    return str(folder)


def configurations(arguments: Sequence[str]) -> Iterator[Path]:
    """The files that arguments of Snakemake name as configurations: all between such an option and the next one."""
    takes_files = False
    for argument in arguments:
        if argument.startswith("-"):
            option, _, value = argument.partition("=")
            takes_files = option in STATES_ITS_OWN
            if takes_files and value:
                yield Path(value)
        elif takes_files:
            yield Path(argument)


def run_workflow(arguments: Sequence[str]) -> None:
    """Run Snakemake in this process, which ends with its exit code; raises as `snakemake_arguments`."""
    with asking_no_cluster():
        from snakemake.cli import main

    main(snakemake_arguments(arguments))


@contextmanager
def asking_no_cluster() -> Iterator[None]:
    """Let the commands of SLURM fail at once: its plug-in for Snakemake asks them for a help text while it is imported,
    for local runs too, and would wait 10 s where SLURM is installed and does not answer."""
    configured = os.environ.get("SLURM_CONF")
    os.environ["SLURM_CONF"] = os.devnull
    try:
        yield
    finally:
        os.environ.pop("SLURM_CONF")
        os.environ |= {} if configured is None else {"SLURM_CONF": configured}


@dataclass(frozen=True)
class Looked:
    what: str
    found: str
    remedy: str = ""  # what to do; empty: nothing


def looked_at(folder: Path) -> Iterator[Looked]:
    """What this machine has and lacks, and whether the campaign in a folder can be read."""
    too_old = sys.version_info[:2] < (3, 11)
    there = all(shipped(name).is_file() for name in ("Snakefile", "config/config.yaml"))
    again = "" if there else "install osl-analysis again: the files of its workflow are missing"
    yield Looked("Python", platform.python_version(), "install Python 3.11 or newer" if too_old else "")
    yield Looked("osl-analysis", f"{version('osl-analysis')}, workflow in {root()}", again)
    yield from packages()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    yield Looked("cores", f"{cores}")
    free = shutil.disk_usage(folder).free / 1e9  # the default campaign takes 0.4 GB, recordings not counted
    few = "make room, or work on another disk" if free < 2 else ""
    yield Looked("free space", f"{free:.0f} GB in {folder.resolve()}", few)
    can = os.access(folder, os.W_OK)
    yield Looked("folder", "can be written to" if can else "cannot be written to", "" if can else "choose another one")
    yield campaign(folder)


def packages() -> Iterator[Looked]:
    """The packages that osl-analysis needs, and those for single formats, where they are too old or not there."""
    extras = ("mat73", "ros", "tdms")
    for text in requires("osl-analysis") or ():
        needed = Requirement(text)
        extra = next((one for one in extras if needed.marker and needed.marker.evaluate({"extra": one})), "")
        if needed.marker and not needed.marker.evaluate() and not extra:
            continue
        try:
            found = version(needed.name)
        except PackageNotFoundError:
            install = f"osl-analysis[{extra}]" if extra else f"{needed}"
            optional = ", only for its files" if extra else ""
            yield Looked(needed.name, f"not installed{optional}", f"pip install '{install}'" if not extra else "")
            continue
        if not needed.specifier.contains(found, prereleases=True):
            yield Looked(needed.name, found, f"pip install '{needed.name}{needed.specifier}'")
        elif needed.name in ("snakemake", "numpy"):
            yield Looked(needed.name, found)


def campaign(folder: Path) -> Looked:
    """The campaign in a folder, as far as its configuration and sheet tell."""
    from osl_analysis.config.campaign import check_campaign, open_campaign
    from osl_analysis.config.configuration import read_config

    path = folder / CAMPAIGN
    if not path.is_file():
        return Looked("campaign", "none in this folder")
    try:
        config = read_config(path)
        if config.simulation is not None:
            return Looked("campaign", f"{config.campaign}, simulated")
        opened = open_campaign(config, None)
        check_campaign(opened)
    except OslAnalysisError as error:
        return Looked("campaign", str(error), "correct it")
    missing = [trial for trial in opened.trials() if not all(log.exists() for log in opened.logs(trial))]
    said = f"{config.campaign}, {len(opened.trials())} trials"
    lack = f"files of {len(missing)} are missing, first of {missing[0]}: correct the sheet" if missing else ""
    return Looked("campaign", said, lack)


def findings_text(found: list[Looked]) -> str:
    width = max(len(one.what) for one in found)
    return "\n".join(
        f"{'!!' if one.remedy else 'ok'} {one.what:<{width}}  {one.found}{f': {one.remedy}' if one.remedy else ''}"
        for one in found
    )
