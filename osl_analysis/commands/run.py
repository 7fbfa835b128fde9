"""`osl-analysis run`: Snakemake on the campaign in this folder, and what is said behind its last
job."""

import gc
import os
import shutil
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib.metadata import version
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import psutil

from osl_analysis.campaign.campaign_trials import Campaign
from osl_analysis.errors import InputError, listing, nearest, not_installed
from osl_analysis.files import CAMPAIGN, check_working_folder, shipped
from osl_analysis.jobs.workers import end_workers
from osl_analysis.outcomes.job_log import run_report
from osl_analysis.refusal import MOST_TOLD, failed_results, is_refused
from osl_analysis.yaml_settings import read_mapping

CONFIGURED_BY = ("--configfile", "--configfiles")
"""Options of Snakemake that name configurations."""
PROFILE = "--workflow-profile"
NOTHING_DONE = "Nothing to be done: every result that was asked for is up to date"


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


def check_profile(arguments: Sequence[str]) -> None:
    """Refuse a profile that is named and does not exist. Raises InputError."""
    list(with_shipped_profile(arguments))


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


def end_run(
    workflow: Any,
    results: Path,
    report: Callable[[Sequence[str], Sequence[str]], str],
    accept: bool,
) -> None:
    """Say what a run has made, at the exit of Snakemake, and end it with exit code 1 if a result
    that was asked for is refused, unless refusals are to `accept`.

    A page whose inputs could not be made is removed: it shows older ones. So is what a job left
    that failed, so that the next run tries it again.

    Parameters
    ----------
    workflow
        Snakemake's own.
    results
        Folder of the results.
    report
        Writes the report of a run, from all its files and those of them that are refused.
    accept
        Whether a run with refusals ends as one without.
    """
    if workflow.dryrun or workflow.scheduler is None or not workflow.is_main_process:
        return  # without a scheduler nothing was to be made, or another run has the lock
    try:
        unfinished = [str(file) for job in workflow.dag.needrun_jobs() for file in job.output]
        page = results / "report.html"
        if page.as_posix() in unfinished:
            page.unlink(missing_ok=True)
        files = [str(file) for job in workflow.dag.jobs for file in job.output]
        refused = [file for file in files if is_refused(file)]
        began = psutil.Process().create_time()
        end_workers()
        has_worked = bool(unfinished) or workflow.scheduler.finished_jobs
        lines = [
            "" if has_worked else NOTHING_DONE,
            run_report(results / "logs", began),
            not_made(unfinished),
            report(files, refused),
        ]
        # a later run makes them: by then the fault may be mended, or memory be enough
        for file in failed_results(refused):
            file.unlink(missing_ok=True)
        if page.as_posix() in files and page.is_file():
            lines.append(f"open {page} in a browser: every number, figure and trial")
        print("\n".join(filter(None, lines)), file=sys.stderr, flush=True)
        failed = bool(refused) and not accept
    except Exception:  # by a fault of ours the run must not end as if all were well
        traceback.print_exc()
        failed = True
    gc.freeze()  # at its exit Python would look through all of Snakemake's jobs, 0.4 s
    if failed:
        shutil.rmtree(workflow.snakemake_tmp_dir, ignore_errors=True)
        sys.stdout.flush()
        os._exit(1)  # at the exit of Python there is no other way


def not_made(files: Sequence[str]) -> str:
    """A line on files that a run should have made; empty if there are none."""
    if not files:
        return ""
    missing = [file for file in files if not Path(file).exists()]
    older = len(files) - len(missing)
    text = f"not made: {listing(missing, MOST_TOLD)}"
    if older:
        text += f"; {older} results that depend on them are those of an earlier run"
    return f"{text}; run again, what is finished stays"


def made_by(campaign: Campaign) -> dict[str, str]:
    """What makes the results: the version of the package; and whether the data are simulated."""
    return {"version": version("osl-analysis"), "data": campaign.data}
