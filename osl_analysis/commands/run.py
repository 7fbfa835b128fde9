"""Run the shipped workflow on the campaign of a folder: what `osl-analysis run` hands to Snakemake."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.files import check_working_folder
from osl_analysis.shipped import CAMPAIGN, shipped
from osl_analysis.yaml_settings import read_mapping

STATES_ITS_OWN = ("--configfile", "--configfiles")
"""Options of Snakemake that name a configuration."""


def snakemake_arguments(arguments: Sequence[str]) -> list[str]:
    """The arguments of Snakemake for the campaign in the working folder: those of the user first, because options of
    Snakemake that take lists also take what stands behind them.

    Raises
    ------
    InputError
        There is no campaign in the working folder, this cannot be written to, or a configuration is missing or no YAML.
    """
    said = any(argument.split("=")[0] in STATES_ITS_OWN for argument in arguments)
    is_clone = Path("Snakefile").is_file() and Path("config/config.yaml").is_file()
    if not said and not CAMPAIGN.is_file() and not is_clone:
        raise InputError(
            f"{Path.cwd()}: no campaign here, which has a {CAMPAIGN}; change to the folder of a campaign, or make one: "
            "`osl-analysis init FOLDER`"
        )
    check_working_folder()
    own = [] if said or not CAMPAIGN.is_file() else ["--configfile", str(CAMPAIGN)]
    for file in configurations([*arguments, *own]):  # Snakemake's own words for these are a traceback
        read_mapping(file)
    return [*arguments, "--snakefile", str(shipped("Snakefile")), *own]


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
    """Run Snakemake in this process, which ends with its exit code.

    Raises
    ------
    InputError
        There is no campaign in the working folder.
    """
    from snakemake.cli import main

    main(snakemake_arguments(arguments))
