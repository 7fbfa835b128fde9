"""`osl-analysis run` and `doctor`: run the workflow on the campaign in this folder, or say what it lacks."""

import os
import platform
import shutil
from collections.abc import Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

from osl_analysis.campaign.campaign import Campaign, check_campaign, open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.errors import EXTRAS, InputError, OslAnalysisError, naming, nearest, not_installed
from osl_analysis.files import CAMPAIGN, check_working_folder, root, shipped
from osl_analysis.ingest.raw_files import check_clocks, check_plates, read_source
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
                there = f"correct it: there are {', '.join(known)}{nearest(named, known)}"
                raise InputError(f"{option} {named}: no such folder; {there}")
            argument = f"{own}{shipped(named)}"
        yield argument


def looked_at(folder: Path) -> Iterator[tuple[str, str, str]]:
    """What this machine has and lacks, and whether the campaign in a folder can be read: a line each of what was looked
    at, what was found, and what to do, if anything."""
    yield "Python", platform.python_version(), ""
    yield "osl-analysis", f"{version('osl-analysis')}, workflow in {root()}", ""
    for name in ("snakemake", "numpy", *EXTRAS):
        try:
            yield name, version(name), ""
        except PackageNotFoundError:
            if name in EXTRAS:
                yield name, f"not installed, optional: pip install 'osl-analysis[{EXTRAS[name]}]'", ""
            else:
                yield name, "not installed", f"pip install {name}"
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    yield "cores", f"{cores}", ""
    free = shutil.disk_usage(folder).free / 1e9  # the default campaign takes 0.4 GB, recordings not counted
    few = "make room, or work on another disk" if free < 2 else ""
    yield "free space", f"{free:.0f} GB in {folder.resolve()}", few
    can = os.access(folder, os.W_OK)
    yield "folder", "can be written to" if can else "cannot be written to", "" if can else "choose another one"
    yield "campaign", *campaign(folder / CAMPAIGN)


def check_start(opened: Campaign) -> None:
    """Refuse, before any job, what `check_campaign` does, source files that are wrong or do not fit captures, and
    to simulate without the libraries of the simulator."""
    check_campaign(opened)
    if opened.config.simulation and not all(log.exists() for trial in opened.trials() for log in opened.logs(trial)):
        for library in (name for name, extra in EXTRAS.items() if extra == "simulator" and find_spec(name) is None):
            raise not_installed("the simulator", library)
    config, groups = opened.config, dict[tuple[Path, ...], list[str]]()
    for field in ("sources", "raw_data")[: 1 + (config.simulation is None)]:
        if not getattr(config, field).is_dir():
            raise InputError(f"{getattr(config, field)}: no such folder; correct `{field}` in the configuration")
    on_plate = () if config.walking.by_log else opened.trials("walking", "plate")
    for trial in (*on_plate, *opened.trials()):
        groups.setdefault(tuple(opened.sources(trial)), []).append(trial)
    read = {path: read_source(path) for path in sorted({path for paths in groups for path in paths})}
    for paths, trials in groups.items():
        for row in filter(lambda row: row["log_part"], map(opened.row, trials)):
            with naming(f"{config.sheet}: trial '{row['trial']}'"):
                read[paths[0]].of_part(row["log_part"])
        rows = [opened.row(trial) for trial in trials[:3]]
        if rows[0]["log"] and rows[0]["mocap"]:
            check_clocks(*(read[path] for path in paths))
        captures = [config.raw_data / row["mocap"] for row in rows if row["mocap"]]
        check_plates(read[paths[-1]], captures, config.walking.plate * (trials[0] in on_plate))


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
    except OslAnalysisError as error:
        return str(error), "correct it"
    missing = [trial for trial in opened.trials() if not all(log.exists() for log in opened.logs(trial))]
    lack = f"files of {len(missing)} are missing, first of {missing[0]}: correct the sheet" if missing else ""
    return f"{config.campaign}, {len(opened.trials())} trials", lack
