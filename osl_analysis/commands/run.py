"""`osl-analysis run`: Snakemake on the campaign in this folder."""

import shutil
import sys
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import version
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

from osl_analysis.campaign.campaign_trials import Campaign
from osl_analysis.commands.campaign_start import check_working_folder
from osl_analysis.errors import InputError, nearest, not_installed
from osl_analysis.files import CAMPAIGN, shipped, write_text
from osl_analysis.table import NOT_ANALYSED
from osl_analysis.yaml_settings import read_mapping

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
        There is no campaign, the folder cannot be written to, or a configuration or profile is
        missing.
    """
    configurations, others = given_arguments(arguments)
    is_clone = Path("Snakefile").is_file() and Path("config/config.yaml").is_file()
    if not (configurations or CAMPAIGN.is_file() or is_clone):
        raise InputError(
            f"{Path.cwd()}: no campaign here, which has a {CAMPAIGN}; change to the folder of a"
            " campaign, or make one: `osl-analysis init FOLDER`"
        )
    check_working_folder()
    if CAMPAIGN.is_file() and CAMPAIGN not in configurations:
        configurations = [CAMPAIGN, *configurations]  # later ones override earlier ones
    for file in configurations:
        read_mapping(file)  # of one that cannot be read, Snakemake shows a traceback
    configured: list[str] = []
    if configurations:
        configured = [CONFIGURED_BY[0], *map(str, configurations)]
    snakefile = ["--snakefile", str(shipped("Snakefile"))]
    return [*with_shipped_profile(others), *configured, *snakefile]


def given_arguments(arguments: Iterable[str]) -> tuple[list[Path], list[str]]:
    """The configurations among the arguments, of `--configfile=FILE` or `--configfiles FILE FILE`,
    and all others."""
    configurations: list[Path] = []
    others: list[str] = []
    takes_files = False
    for argument in arguments:
        option, _, file_behind = argument.partition("=")
        if option in CONFIGURED_BY:
            takes_files = not file_behind  # what stands behind a `=` is one file
            if file_behind:
                configurations.append(Path(file_behind))
            continue
        if argument.startswith("-"):
            takes_files = False
        if takes_files:
            configurations.append(Path(argument))
        else:
            others.append(argument)
    return configurations, others


def check_submission(arguments: Sequence[str]) -> None:
    """Refuse a profile of SLURM where nothing can be submitted: Snakemake would wait without an
    end.

    Parameters
    ----------
    arguments
        As `snakemake_arguments` gives them.
    """
    for argument in arguments:
        folder = argument.removeprefix(f"{PROFILE}=")
        file = Path(folder) / "profile.yaml"
        if not file.is_file() or read_mapping(file).get("executor") != "slurm":
            continue
        if find_spec("snakemake_executor_plugin_slurm") is None:
            raise not_installed(folder, "snakemake-executor-plugin-slurm")
        if shutil.which("sbatch") is None:
            raise InputError(
                f"{folder}: there is no `sbatch` here; start the run where you submit jobs, as on"
                " the head node"
            )


def with_shipped_profile(arguments: Sequence[str]) -> Iterator[str]:
    """The arguments, with the folder of a shipped profile where it is named, as `profiles/slurm`,
    and none here has its name.

    Raises
    ------
    InputError
        There is no such profile: Snakemake would go on without one.
    """
    for before, argument in pairwise(("", *arguments)):
        if argument.startswith(f"{PROFILE}="):
            yield f"{PROFILE}={profile(argument.removeprefix(f'{PROFILE}='))}"
        elif before == PROFILE:
            yield profile(argument)
        else:
            yield argument


def profile(name: str) -> str:
    """The folder of a profile."""
    if name == "none" or shipped(name).is_dir():
        return str(shipped(name))
    known = sorted(f"profiles/{folder.name}" for folder in shipped("profiles").iterdir())
    raise InputError(
        f"{PROFILE} {name}: no such folder; correct it: there are"
        f" {', '.join(known)}{nearest(name, known)}"
    )


def end_run(brief: str, verdict: str, failed_trials: str) -> None:
    """Let a run fail whose `brief` tells of what was not analysed, unless that is to `accept`.

    Raises
    ------
    InputError
        It fails, and the brief is printed.
    """
    text = Path(brief).read_text(encoding="utf-8")
    if f"\n{NOT_ANALYSED.upper()}" in text and failed_trials != "accept":
        print(text, file=sys.stderr, flush=True)
        raise InputError("trials could not be analysed; the lines above say why")
    write_text(Path(verdict), text)


def made_by(campaign: Campaign) -> dict[str, str]:
    """What makes the results: the version of the package; and whether the data are simulated."""
    return {"version": version("osl-analysis"), "data": campaign.data}
