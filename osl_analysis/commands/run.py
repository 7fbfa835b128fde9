# SPDX-License-Identifier: Apache-2.0
"""`osl-analysis run`: start Snakemake on the campaign in this folder, after checks.

A campaign none of whose trials can be analysed is refused before its first job.

Example: `snakemake_arguments(["--cores", "4"])`.
"""

import json
import os
import shutil
from argparse import ArgumentParser
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from osl_analysis.base.errors import (
    InputError,
    OslAnalysisError,
    listing,
    naming,
    nearest,
    not_installed,
    shortened,
)
from osl_analysis.base.files import CAMPAIGN, default_config, shipped, write_text
from osl_analysis.base.yaml_settings import read_mapping
from osl_analysis.campaign.campaign_trials import Campaign, check_campaign, open_campaign
from osl_analysis.campaign.configuration import campaign_config, over_default, read_config
from osl_analysis.config.sheet import RECORDINGS
from osl_analysis.ingest.raw_files import read_source, recordings_in
from osl_analysis.ingest.several_clocks import check_clocks
from osl_analysis.jobs.snakemake_attributes import FEWEST_REPEATS, repeated_end

CONFIGURED_BY = ("--configfile", "--configfiles")
"""Options of Snakemake that name configurations."""
PROFILE = "--workflow-profile"


def snakemake_arguments(arguments: Sequence[str]) -> list[str]:
    """The arguments of Snakemake for the campaign in the working folder.

    Those of the user stand first: options of Snakemake that take lists also take what stands behind
    them. A configuration that the user names overrides the campaign's own, as it overrides that of
    a clone.

    Raises
    ------
    InputError
        There is no campaign, the folder cannot be written to, a configuration or a profile is
        missing, or nothing can be submitted as the profile says.
    """
    parser = ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument(*CONFIGURED_BY, nargs="+", action="extend", type=Path, default=[])
    parser.add_argument(PROFILE, dest="profile")
    options, further_arguments = parser.parse_known_args(arguments)
    configurations: list[Path] = options.configfile
    is_clone = Path("Snakefile").is_file() and Path("config/config.yaml").is_file()
    if not (configurations or CAMPAIGN.is_file() or is_clone):
        raise InputError(
            f"{Path.cwd()}: no campaign here, which has a {CAMPAIGN}",
            "change to the folder of a campaign, or make one: `osl-analysis init FOLDER`",
        )
    check_working_folder()
    if CAMPAIGN.is_file() and CAMPAIGN not in configurations:
        configurations = [CAMPAIGN, *configurations]  # later ones override earlier ones
    for file in configurations:
        read_mapping(file)  # refuses a damaged file, for which Snakemake shows a traceback
    configured = []
    if configurations:
        configured = [CONFIGURED_BY[0], *map(str, configurations)]
    if options.profile:
        folder = profile_folder(options.profile)
        check_submission(folder)
        further_arguments += [PROFILE, str(folder)]
    return [*further_arguments, *configured, "--snakefile", str(shipped("Snakefile"))]


def check_working_folder(results: Path = Path(".snakemake")) -> None:
    """Refuse a folder in which the run or Snakemake cannot write: the run would end with a
    traceback."""
    snakemake_folder = Path(".snakemake")
    below = (*snakemake_folder.glob("*/"), *results.glob("*/"))
    for folder in (Path(), snakemake_folder, results, *below):
        if folder.is_dir() and not os.access(folder, os.W_OK):
            raise InputError(
                f"{folder.absolute()}: cannot be written to",
                "make it writable, or copy the campaign",
            )
    disk = shutil.disk_usage(results if results.is_dir() else Path())
    if disk.total and disk.free < 10e6:
        raise InputError(
            f"{results.absolute()}: less than 10 MB free on its disk",
            "make room, or work on another one",
        )


def profile_folder(name: str) -> Path:
    """The folder of a profile, a shipped one, as `profiles/slurm`, where none here has its name.
    Raises InputError: there is none, and Snakemake would go on without."""
    folder = shipped(name)
    if name == "none" or folder.is_dir():
        return folder
    known = sorted(f"profiles/{profile.name}" for profile in shipped("profiles").iterdir())
    raise InputError(
        f"{PROFILE} {name}: no such folder",
        f"correct it: there are {', '.join(known)}{nearest(name, known)}",
    )


def check_submission(profile: Path) -> None:
    """Refuse a profile of SLURM where nothing can be submitted: Snakemake would wait without an
    end."""
    file = profile / "profile.yaml"
    if not file.is_file() or read_mapping(file).get("executor") != "slurm":
        return
    if find_spec("snakemake_executor_plugin_slurm") is None:
        raise not_installed(str(profile), "snakemake-executor-plugin-slurm")
    if shutil.which("sbatch") is None:
        raise InputError(
            f"{profile}: there is no `sbatch` here",
            "start the run where you submit jobs, as on the head node",
        )


def end_run(summary: Path, brief: Path, verdict: Path, failed_trials: str) -> None:
    """Write the `brief` of a run as its `verdict`.

    Raises
    ------
    InputError
        The `summary` has refused trials or missing results, and `failed_trials` is not `accept`.
    """
    content = json.loads(summary.read_text(encoding="utf-8"))
    has_failed = content["verdicts"]["refused"] or content["missing_results"]
    if has_failed and failed_trials != "accept":
        raise InputError("trials could not be analysed", f"{brief} says which, and what to do")
    write_text(verdict, brief.read_text(encoding="utf-8"))


MOST_RECORDINGS = 5  # recordings that are named in one message


def start_campaign(fields: Mapping[str, Any], files: Sequence[Path]) -> tuple[Campaign, list[Path]]:
    """Open the campaign that Snakemake runs.

    Parameters
    ----------
    fields : Mapping
        The fields of the configuration that Snakemake merged from files.
    files : Sequence of Path
        These files; later ones override earlier ones.

    Returns
    -------
    Campaign
    list of Path
        The files with the settings of its simulation; none for real recordings.

    Raises
    ------
    InputError
        A file is wrong; `check_start` refuses the campaign; the campaign lacks an example of a
        figure.
    """
    config = campaign_config(over_default(fields), [default_config(), *files])
    planned = None
    simulation_files = []
    if config.simulation is not None:
        from osl_analysis.commands.simulate import planned_sheet, settings_files

        planned = planned_sheet(config.simulation, config.sheet)
        simulation_files = settings_files(config.simulation, config.shared())
    campaign = open_campaign(config, planned)
    check_working_folder(config.results)
    check_start(campaign)
    return campaign, simulation_files


def first_look() -> list[str]:
    """The refusals of a run of the campaign in this folder, which a dry run has no job to find.

    They are those at its start, and those of single trials by their source files. A simulated
    campaign has none.
    """
    problems: list[str] = []
    try:
        config = read_config(CAMPAIGN)
        if config.simulation is not None:
            return []
        campaign = open_campaign(config, None)
        problems += source_problems(campaign).values()
        check_start(campaign)
    except InputError as error:
        problems.append(str(error))
    return list(dict.fromkeys(problems))


def check_start(campaign: Campaign) -> None:
    """Refuse a campaign none of whose trials could be analysed. Ingest refuses single trials.

    Raises
    ------
    InputError
        `check_campaign` or `check_names` refuses it; a folder is missing; the source files of all
        trials are wrong; a simulation lacks its libraries.
    """
    check_campaign(campaign)
    check_names(campaign)
    config = campaign.config
    folders = {"sources": config.sources}
    if config.simulation is None:
        folders["raw_data"] = config.raw_data
    else:
        logs = [log for trial in campaign.trials() for log in campaign.logs(trial)]
        if not all(map(Path.exists, logs)):
            check_simulator()
    for setting, folder in folders.items():
        if not folder.is_dir():
            raise InputError(
                f"{folder}: no such folder", f"correct `{setting}` in the configuration"
            )

    problems = source_problems(campaign)
    if len(problems) == len(campaign.trials()):
        raise InputError(next(iter(problems.values())))


def check_names(campaign: Campaign) -> None:
    """Refuse a trial whose name Snakemake would stop at, with InputError."""
    for trial in campaign.trials():
        part = repeated_end(trial)
        if part:
            raise InputError(
                f"{campaign.config.sheet}: the name of trial '{shortened(trial)}' ends in"
                f" {FEWEST_REPEATS} times '{part}' or more, which Snakemake takes for a rule that"
                " asks for itself",
                "give the trial another name in the sheet",
            )


def check_simulator() -> None:
    """Refuse to simulate without the libraries of the simulator."""
    for library in ("ezc3d", "numba"):
        if find_spec(library) is None:
            raise not_installed("the simulator", library)


def source_problems(campaign: Campaign) -> dict[str, str]:
    """The error in the source files of each wrong trial; equal source files are read once."""
    problem_of: dict[tuple[Any, ...], str] = {}
    problems = {}
    for trial in campaign.trials():
        row = campaign.rows[trial]
        part = row["log_part"] or ""
        roles = [role for role in RECORDINGS if row[role]]
        alike = (*campaign.sources(trial), part, *roles)
        if alike not in problem_of:
            problem_of[alike] = ""
            try:
                sources = [read_source(path) for path in campaign.sources(trial)]
                with naming(f"{campaign.config.sheet}: trial '{trial}'"):
                    sources[0].for_part(part)
                if len(roles) > 1:
                    check_clocks(dict(zip(roles, sources, strict=True)))
            except OslAnalysisError as error:
                problem_of[alike] = str(error)
        if problem_of[alike]:
            problems[trial] = problem_of[alike]
    return problems


def left_out_recordings(campaign: Campaign) -> str:
    """Sentences on recordings that are not analysed; empty without any.

    Their row says so, or no row names them: `init --from` gives a recording that cannot be read no
    row.
    """
    config = campaign.config
    ingested = campaign.trials("ingest_only")
    texts = []
    if ingested:
        names = listing(ingested, MOST_RECORDINGS)
        texts.append(f"not analysed, as {config.sheet} has experiment ingest_only: {names}")
    unnamed = [] if config.simulation is not None else unnamed_files(campaign)
    if unnamed:
        texts.append(
            f"named by no row of {config.sheet}, and left out: {listing(unnamed, MOST_RECORDINGS)}"
            f" in {config.raw_data}; add a row for each, or see by `osl-analysis inspect` why it"
            " cannot be read"
        )
    return "\n".join(texts)


def unnamed_files(campaign: Campaign) -> list[str]:
    """The recordings in the campaign's folder that no row of the sheet names."""
    config = campaign.config
    named = {config.sheet.resolve()}
    for row in campaign.sheet.values():
        for file in filter(None, map(row.get, RECORDINGS)):
            named.add((config.raw_data / file).resolve())
    results = config.results.resolve()
    return [
        str(path.relative_to(config.raw_data))
        for path in recordings_in(config.raw_data)
        if path.resolve() not in named and not path.resolve().is_relative_to(results)
    ]
