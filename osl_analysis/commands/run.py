"""Run the shipped workflow on the campaign of a folder: what `osl-analysis run` hands to Snakemake."""

import difflib
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.files import CAMPAIGN, check_working_folder, shipped
from osl_analysis.yaml_settings import read_mapping

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
            yield profile(argument)
        else:
            yield f"{PROFILE_OPTION}={profile(value)}" if option == PROFILE_OPTION and is_stated else argument


def profile(named: str) -> str:
    """The folder of a profile, here or shipped; `none` is Snakemake's word for no profile.

    Another name that is neither is refused: Snakemake would go on without a profile.
    """
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
    """Let the commands of SLURM fail at once: its plug-in for Snakemake asks them for a help text while it is imported.

    It is imported for local runs too, and would wait 10 s where SLURM is installed and does not answer.
    """
    configured = os.environ.get("SLURM_CONF")
    os.environ["SLURM_CONF"] = os.devnull
    try:
        yield
    finally:
        os.environ.pop("SLURM_CONF")
        os.environ |= {} if configured is None else {"SLURM_CONF": configured}
