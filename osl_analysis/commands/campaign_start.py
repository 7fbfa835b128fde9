"""What is refused, or said, of a campaign before its first job."""

import os
import shutil
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from osl_analysis.campaign.campaign_trials import Campaign, check_campaign, open_campaign
from osl_analysis.campaign.configuration import campaign_config, over_default, read_config
from osl_analysis.errors import (
    EXTRAS,
    InputError,
    OslAnalysisError,
    listing,
    naming,
    not_installed,
)
from osl_analysis.files import CAMPAIGN, default_config
from osl_analysis.ingest.raw_files import (
    check_clocks,
    read_source,
    recordings_in,
)

MOST_LISTED = 5  # recordings that are named in one message


def start_campaign(stated: Mapping[str, Any], files: Sequence[Path]) -> tuple[Campaign, list[Path]]:
    """Open the campaign that Snakemake runs.

    Parameters
    ----------
    stated : Mapping
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
        A file is wrong; what `check_start` refuses; an example of a figure is not in the campaign.
    """
    config = campaign_config(over_default(stated), [default_config(), *files])
    planned = None
    simulation_files: list[Path] = []
    if config.simulation is not None:
        from osl_analysis.commands.simulate import planned_sheet, settings_files

        planned = planned_sheet(config.simulation, config.sheet)
        simulation_files = settings_files(config.simulation, config.shared())
    campaign = open_campaign(config, planned)
    check_working_folder(config.results)
    check_start(campaign)
    return campaign, simulation_files


def check_working_folder(results: Path = Path(".snakemake")) -> None:
    """Refuse a folder in which the run or Snakemake cannot write: the run would end with a
    traceback."""
    of_snakemake = Path(".snakemake")
    below = (*of_snakemake.glob("*/"), *results.glob("*/"))
    for folder in (Path(), of_snakemake, results, *below):
        if folder.is_dir() and not os.access(folder, os.W_OK):
            raise InputError(
                f"{folder.absolute()}: cannot be written to; make it writable, or copy the campaign"
            )
    disk = shutil.disk_usage(results if results.is_dir() else Path())
    if disk.total and disk.free < 10e6:
        raise InputError(
            f"{results.absolute()}: less than 10 MB free on its disk; make room, or work on"
            " another one"
        )


def first_look() -> list[str]:
    """What a run of the campaign in this folder would refuse, at its start, or of single trials by
    their source files: a dry run has no job that says it. Nothing of a simulated campaign."""
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
        What `check_campaign` refuses; a folder that is missing; a source file that is wrong for
        every trial; a simulation without its libraries.
    """
    check_campaign(campaign)
    config = campaign.config
    folders = {"sources": config.sources}
    if config.simulation is None:
        folders["raw_data"] = config.raw_data
    else:
        check_simulator(campaign)
    for setting, folder in folders.items():
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; correct `{setting}` in the configuration")

    problems = source_problems(campaign)
    if len(problems) == len(campaign.trials()):
        raise InputError(next(iter(problems.values())))


def check_simulator(campaign: Campaign) -> None:
    """Refuse to simulate recordings that are missing without the libraries of the simulator."""
    if all(log.exists() for trial in campaign.trials() for log in campaign.logs(trial)):
        return
    for library, extra in EXTRAS.items():
        if extra == "simulator" and find_spec(library) is None:
            raise not_installed("the simulator", library)


def source_problems(campaign: Campaign) -> dict[str, str]:
    """What is wrong with the source files of trials, by trial.

    Trials with the same source files are looked at once.
    """
    problem_of: dict[tuple[object, ...], str] = {}
    problems: dict[str, str] = {}
    for trial in campaign.trials():
        row = campaign.row(trial)
        alike = (*campaign.sources(trial), row["log_part"], bool(row["log"] and row["mocap"]))
        if alike not in problem_of:
            problem_of[alike] = problem_of_sources(campaign, trial)
        if problem_of[alike]:
            problems[trial] = problem_of[alike]
    return problems


def problem_of_sources(campaign: Campaign, trial: str) -> str:
    """What is wrong with the source files of a trial; empty if nothing is."""
    row = campaign.row(trial)
    try:
        sources = [read_source(path) for path in campaign.sources(trial)]
        with naming(f"{campaign.config.sheet}: trial '{trial}'"):
            sources[0].of_part(row["log_part"] or "")
        if row["log"] and row["mocap"]:
            check_clocks(*sources)
    except OslAnalysisError as error:
        return str(error)
    return ""


def left_out_recordings(campaign: Campaign) -> str:
    """Sentences on the recordings that are not analysed: those whose row says so, and those in the
    campaign's folder that no row names; empty without any. `init --from` gives a recording that
    cannot be read no row."""
    config = campaign.config
    trials = campaign.trials()
    ingested = [name for name in trials if campaign.row(name)["experiment"] == "ingest_only"]
    texts: list[str] = []
    if ingested:
        names = listing(ingested, MOST_LISTED)
        texts.append(f"not analysed, as {config.sheet} has experiment ingest_only: {names}")
    unnamed = [] if config.simulation is not None else unnamed_files(campaign)
    if unnamed:
        texts.append(
            f"named by no row of {config.sheet}, and left out: {listing(unnamed, MOST_LISTED)} in"
            f" {config.raw_data}; add a row for each, or see by `osl-analysis inspect` why it"
            " cannot be read"
        )
    return "\n".join(texts)


def unnamed_files(campaign: Campaign) -> list[str]:
    """The recordings in the campaign's folder that no row of the sheet names."""
    config = campaign.config
    named = {config.sheet.resolve()}
    for row in [*campaign.rows.values(), *campaign.unused.values()]:
        for file in filter(None, (row["log"], row["mocap"])):
            named.add((config.raw_data / file).resolve())
    results = config.results.resolve()
    return [
        str(path.relative_to(config.raw_data))
        for path in recordings_in(config.raw_data)
        if path.resolve() not in named and not path.resolve().is_relative_to(results)
    ]
