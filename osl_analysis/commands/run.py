"""Run the shipped workflow on the campaign of a folder: what `osl-analysis run` hands to Snakemake."""

import os
from collections.abc import Sequence
from pathlib import Path

from osl_analysis.errors import InputError
from osl_analysis.shipped import CAMPAIGN, shipped

STATES_ITS_OWN = ("--configfile", "--configfiles")
"""Options of Snakemake that name a configuration."""


def snakemake_arguments(arguments: Sequence[str]) -> list[str]:
    """The arguments of Snakemake for the campaign in the working folder: those of the user first, because options of
    Snakemake that take lists also take what stands behind them.

    Raises
    ------
    InputError
        There is no campaign in the working folder.
    """
    said = any(argument.split("=")[0] in STATES_ITS_OWN for argument in arguments)
    is_clone = Path("Snakefile").is_file() and Path("config/config.yaml").is_file()
    if not said and not CAMPAIGN.is_file() and not is_clone:
        raise InputError(
            f"{Path.cwd()}: no campaign here, which has a {CAMPAIGN}; change to the folder of a campaign, or make one: "
            "`osl-analysis init FOLDER`"
        )
    if not os.access(Path(), os.W_OK):
        raise InputError(f"{Path.cwd()}: cannot be written to; copy the campaign to a folder that can")
    own = [] if said or not CAMPAIGN.is_file() else ["--configfile", str(CAMPAIGN)]
    return [*arguments, "--snakefile", str(shipped("Snakefile")), *own]


def run_workflow(arguments: Sequence[str]) -> None:
    """Run Snakemake in this process, which ends with its exit code.

    Raises
    ------
    InputError
        There is no campaign in the working folder.
    """
    from snakemake.cli import main

    main(snakemake_arguments(arguments))
