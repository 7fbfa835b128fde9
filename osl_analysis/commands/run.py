"""`osl-analysis run` and `doctor`: run the workflow on the campaign in this folder, or say what it
lacks."""

import os
import platform
import shutil
from collections.abc import Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from osl_analysis.campaign.campaign import Campaign, check_campaign, open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.errors import (
    EXTRAS,
    InputError,
    OslAnalysisError,
    listing,
    naming,
    nearest,
    not_installed,
)
from osl_analysis.files import CAMPAIGN, check_working_folder, root, shipped
from osl_analysis.ingest.overview import inspect_recording
from osl_analysis.ingest.raw_files import (
    check_clocks,
    check_plates,
    read_source,
    recorded_files,
    recordings_in,
)
from osl_analysis.yaml_settings import read_mapping

CONFIGURED_BY = ("--configfile", "--configfiles")  # options of Snakemake that name a configuration
LONG_TO_READ = 50_000_000  # bytes of a recording, which take more than a second to look at


def snakemake_arguments(arguments: Sequence[str]) -> list[str]:
    """The arguments of Snakemake for the campaign in the working folder: those of the user first,
    because options of Snakemake that take lists also take what stands behind them. Raises
    InputError where there is no campaign, the folder cannot be written to, or a configuration or
    profile is missing."""
    said = any(argument.split("=")[0] in CONFIGURED_BY for argument in arguments)
    is_clone = Path("Snakefile").is_file() and Path("config/config.yaml").is_file()
    if not (said or CAMPAIGN.is_file() or is_clone):
        raise InputError(
            f"{Path.cwd()}: no campaign here, which has a {CAMPAIGN}; change to the folder of a"
            " campaign, or make one: `osl-analysis init FOLDER`"
        )
    check_working_folder()
    own = [] if said or not CAMPAIGN.is_file() else ["--configfile", str(CAMPAIGN)]
    takes_files = False
    # Snakemake's own words for a configuration that cannot be read are a traceback
    for argument in [*arguments, *own]:
        option, _, value = argument.partition("=")
        takes_files = option in CONFIGURED_BY if argument.startswith("-") else takes_files
        if file := takes_files and (value if argument.startswith("-") else argument):
            read_mapping(Path(file))
    return [*with_shipped_profile(arguments), "--snakefile", str(shipped("Snakefile")), *own]


def with_shipped_profile(arguments: Sequence[str]) -> Iterator[str]:
    """The arguments, with the folder of a shipped profile where it is named, as `profiles/slurm`,
    and none here has its name. A name that neither has is refused: Snakemake would go on without a
    profile."""
    option = "--workflow-profile"
    for before, argument in pairwise(("", *arguments)):
        own = f"{option}=" if argument.startswith(f"{option}=") else ""
        named = argument.removeprefix(own)
        if own or before == option:
            if named != "none" and not shipped(named).is_dir():
                known = sorted(f"profiles/{one.name}" for one in shipped("profiles").iterdir())
                there = f"correct it: there are {', '.join(known)}{nearest(named, known)}"
                raise InputError(f"{option} {named}: no such folder; {there}")
            argument = f"{own}{shipped(named)}"
        yield argument


class Look(NamedTuple):
    """What `doctor` says of one thing."""

    what: str
    found: str
    remedy: str = ""  # empty if nothing is to be done
    is_absent: bool = False  # an optional library that is not installed


def looked_at(folder: Path) -> Iterator[Look]:
    """What this machine has and lacks, and whether the campaign in a folder can be read."""
    yield Look("Python", platform.python_version())
    yield Look("osl-analysis", f"{version('osl-analysis')}, workflow in {root()}")
    for name in ("snakemake", "numpy", *EXTRAS):
        yield library(name)
    has_affinity = hasattr(os, "sched_getaffinity")
    cores = len(os.sched_getaffinity(0)) if has_affinity else os.cpu_count()
    yield Look("cores", str(cores))
    # the default campaign takes 0.4 GB, recordings not counted
    free = shutil.disk_usage(folder).free / 1e9
    few = "make room, or work on another disk" if free < 2 else ""
    yield Look("free space", f"{free:.0f} GB in {folder.resolve()}", few)
    if os.access(folder, os.W_OK):
        yield Look("folder", "can be written to")
    else:
        yield Look("folder", "cannot be written to", "choose another one")
    yield Look("campaign", *campaign(folder / CAMPAIGN))


def library(name: str) -> Look:
    """Whether a library is installed, and how to install it."""
    try:
        return Look(name, version(name))
    except PackageNotFoundError:
        if name not in EXTRAS:
            return Look(name, "not installed", f"pip install {name}")
        how = f"pip install 'osl-analysis[{EXTRAS[name]}]'"
        return Look(name, f"not installed, optional: {how}", is_absent=True)


def check_start(opened: Campaign) -> None:
    """Refuse, before any job, what `check_campaign` does, a folder that is missing, a source file
    that is wrong for every trial, a force plate that no crossing has, and to simulate without
    libraries. Ingest refuses single trials."""
    check_campaign(opened)
    config = opened.config
    if config.simulation and not all(
        log.exists() for trial in opened.trials() for log in opened.logs(trial)
    ):
        for library in (
            name
            for name, extra in EXTRAS.items()
            if extra == "simulator" and find_spec(name) is None
        ):
            raise not_installed("the simulator", library)
    for field in ("sources", "raw_data")[: 1 + (config.simulation is None)]:
        if not getattr(config, field).is_dir():
            raise InputError(
                f"{getattr(config, field)}: no such folder; correct `{field}` in the configuration"
            )
    problems = source_problems(opened)
    if len(problems) == len(opened.trials()) and len({*problems.values()}) == 1:
        raise InputError(next(iter(problems.values())))
    on_plate = () if config.walking.by_log else opened.trials("walking", "plate")
    for trial in [one for one in on_plate if one not in problems][:1]:
        check_plates(
            read_source(opened.sources(trial)[-1]), captures(opened, on_plate), config.walking.plate
        )


def source_problems(opened: Campaign) -> dict[str, str]:
    """What is wrong with the source files of trials, or does not fit their captures, by trial."""
    groups, problems = dict[tuple[Any, ...], list[str]](), dict[str, str]()
    for trial in opened.trials():
        groups.setdefault((*opened.sources(trial), opened.row(trial)["log_part"] or ""), []).append(
            trial
        )
    for (*paths, part), trials in groups.items():
        row = opened.row(trials[0])
        try:
            read = [read_source(path) for path in paths]
            with naming(f"{opened.config.sheet}: trial '{trials[0]}'"):
                read[0].of_part(part)
            if row["log"] and row["mocap"]:
                check_clocks(read[0], read[1])
            check_plates(read[-1], captures(opened, trials), 0)
        except OslAnalysisError as error:
            problems |= dict.fromkeys(trials, str(error))
    return problems


def captures(opened: Campaign, trials: Sequence[str]) -> list[Path]:
    named = [opened.row(trial)["mocap"] for trial in trials[:3]]
    return [opened.config.raw_data / name for name in named if name]


def unnamed_recordings(opened: Campaign) -> str:
    """The recordings in the campaign's folder that no row of the sheet names, of some why they
    cannot be read, and what to do; empty without one. `init --from` gives a recording that cannot
    be read no row."""
    config, rows = opened.config, [*opened.rows.values(), *opened.unused.values()]
    if config.simulation is not None:
        return ""
    named = {
        config.raw_data / row[column] for row in rows for column in ("log", "mocap") if row[column]
    }
    known = {file.resolve() for path in named for file in (path, *recorded_files(path))} | {
        config.sheet.resolve()
    }
    found = [path for path in recordings_in(config.raw_data) if path.resolve() not in known]
    # the latter is the simulator's own
    others = config.results.resolve(), (config.raw_data / "truth").resolve()
    ours = (
        one for one in found if not any(one.resolve().is_relative_to(other) for other in others)
    )
    left = [*ours]
    names = [str(one.relative_to(config.raw_data)) for one in left]
    what = f"{len(left)} recording{'s' * (len(left) > 1)} in {config.raw_data}: {listing(names, 5)}"
    said = [f"named by no row of {config.sheet}, and left out: {what}; add a row for each"] * bool(
        left
    )
    for path in left[:5]:
        try:
            if path.is_dir() or path.stat().st_size < LONG_TO_READ:
                inspect_recording(path)
        except InputError as error:
            said.append(f"not readable: {error}")
    return "; ".join(said)


def campaign(path: Path) -> tuple[str, str]:
    """What a campaign's configuration and sheet tell, and what to correct."""
    if not path.is_file():
        return "none in this folder", ""
    try:
        config = read_config(path)
        if config.simulation is not None:
            return f"{config.campaign}, simulated", ""
        opened = open_campaign(config, None)
        check_start(opened)
        if problems := [*dict.fromkeys(source_problems(opened).values())]:
            return " | ".join(problems), "correct it" if len(problems) == 1 else "correct them"
    except OslAnalysisError as error:
        return str(error), "correct it"
    missing = [
        trial for trial in opened.trials() if not all(log.exists() for log in opened.logs(trial))
    ]
    lack = (
        f"files of {len(missing)} are missing, first of {missing[0]}: correct the sheet"
        if missing
        else ""
    )
    left_out = unnamed_recordings(opened)
    return (
        f"{config.campaign}, {len(opened.trials())} trials" + f"; {left_out}" * bool(left_out),
        lack,
    )
