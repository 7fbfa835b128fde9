"""`osl-analysis run` and `doctor`: run the workflow on the campaign in this folder, or say what it
lacks. What Snakemake's process does before its first job and behind its last one."""

import atexit
import hashlib
import json
import os
import platform
import re
import shutil
import sys
import traceback
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import psutil

from osl_analysis.campaign.campaign_checks import check_campaign
from osl_analysis.campaign.campaign_trials import Campaign, open_campaign
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
from osl_analysis.files import CAMPAIGN, PACKAGE, check_working_folder, root, shipped
from osl_analysis.ingest.overview import inspect_recording
from osl_analysis.ingest.raw_files import (
    check_clocks,
    check_plates,
    read_source,
    recorded_files,
    recordings_in,
)
from osl_analysis.jobs.workers import end_workers
from osl_analysis.outcomes.job_log import run_report
from osl_analysis.refusal import MOST_TOLD, is_refused
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


RUNS = Path(".snakemake/osl_at_work")
"""A file for each run that is at work in this folder, with its host, process and temporary folder.
One whose process has ended was killed."""


def begin_run(temporary: Path, written: Sequence[Path]) -> None:
    """Note that a run is at work here, and remove what killed ones on this machine have left.

    Parameters
    ----------
    temporary
        The temporary folder of this run.
    written
        Folders into which jobs write.
    """
    killed = killed_runs()
    for note, run in killed.items():
        shutil.rmtree(run["temporary"], ignore_errors=True)
        note.unlink(missing_ok=True)
    if killed:
        remove_half_written(written)
    RUNS.mkdir(parents=True, exist_ok=True)
    note = RUNS / f"{platform.node()}_{os.getpid()}.json"
    began = psutil.Process().create_time()
    run = {"host": platform.node(), "pid": os.getpid(), "began": began, "temporary": str(temporary)}
    note.write_text(json.dumps(run), encoding="utf-8")
    atexit.register(note.unlink, missing_ok=True)


def killed_runs() -> dict[Path, dict[str, Any]]:
    """The runs in this folder that were killed on this machine, by their notes."""
    runs = {note: json.loads(note.read_text(encoding="utf-8")) for note in RUNS.glob("*.json")}
    return {
        note: run
        for note, run in runs.items()
        if run["host"] == platform.node() and not is_at_work(run["pid"], run["began"])
    }


def is_at_work(pid: int, began: float) -> bool:
    """Whether the process that began at this time [s] is alive: numbers are used again."""
    try:
        is_same: bool = abs(psutil.Process(pid).create_time() - began) < 1
    except psutil.NoSuchProcess:
        return False
    return is_same


def remove_half_written(folders: Iterable[Path]) -> None:
    """Remove the temporary files (`files.temporary_path`) of processes that have ended."""
    for folder in folders:
        for path in folder.rglob(".*"):
            name = re.fullmatch(r"\..+\.(\d+)(\.\w+)?", path.name)
            if name and not psutil.pid_exists(int(name[1])) and path.is_file():
                path.unlink(missing_ok=True)


def take_over_lock() -> bool:
    """Remove Snakemake's lock of this folder if all runs that may hold it were killed on this
    machine; whether it was removed."""
    locks = [*Path(".snakemake/locks").glob("*.lock")]
    killed = killed_runs()
    if not locks or not killed or len(killed) < len([*RUNS.glob("*.json")]):
        return False
    for lock in locks:
        lock.unlink(missing_ok=True)
    return True


def end_run(
    workflow: Any, results: Path, report: Callable[[Sequence[str]], str], accept: bool
) -> None:
    """Say what a run has made, at the exit of Snakemake, and end it with exit code 1 if a result
    that was asked for is refused, unless refusals are to `accept`.

    A page whose inputs could not be made is removed: it shows older ones.

    Parameters
    ----------
    results
        Folder of the results.
    report
        Writes the report of a run, from the refused files of it.
    """
    if workflow.dryrun or workflow.scheduler is None or not workflow.is_main_process:
        return  # without a scheduler nothing was to be made, or another run has the lock
    try:
        unfinished = [str(file) for job in workflow.dag.needrun_jobs() for file in job.output]
        page = results / "report.html"
        if str(page) in unfinished:
            page.unlink(missing_ok=True)
        files = [str(file) for job in workflow.dag.jobs for file in job.output]
        refused = [file for file in files if is_refused(file)]
        began = psutil.Process().create_time()
        end_workers()
        idle = "" if unfinished or workflow.scheduler.finished_jobs else NOTHING_DONE
        lines = [idle, run_report(results / "logs", began), not_made(unfinished), report(refused)]
        print("\n".join(filter(None, lines)), file=sys.stderr, flush=True)
        failed = bool(refused) and not accept
    except Exception:  # by a fault of ours the run must not end as if all were well
        traceback.print_exc()
        failed = True
    if failed:
        shutil.rmtree(workflow.snakemake_tmp_dir, ignore_errors=True)
        sys.stdout.flush()
        os._exit(1)  # at the exit of Python there is no other way


NOTHING_DONE = "Nothing to be done: every result that was asked for is up to date"


def not_made(files: Sequence[str]) -> str:
    """A line on files that a run should have made; empty if there are none."""
    if not files:
        return ""
    missing = [file for file in files if not Path(file).exists()]
    older = len(files) - len(missing)
    stay = f"; {older} results that depend on them are those of an earlier run" if older else ""
    return f"not made: {listing(missing, MOST_TOLD)}{stay}; run again, what is finished stays"


def left_behind_report(stored: Iterable[Path], trials: Collection[str]) -> str:
    """A line on trials with `stored` files that are not in the sheet, as after a renaming; empty if
    there are none."""
    unknown = sorted({path.stem for path in stored} - set(trials))
    if not unknown:
        return ""
    return (
        f"not in the sample sheet, and in no table or figure: {listing(unknown, 12)}; files of"
        " theirs are left below the results; delete them, or enter the trials again"
    )


def made_by(opened: Campaign) -> dict[str, str]:
    """What makes the results: version of the package, first digits of the SHA-256 of its sources;
    and whether the data are simulated."""
    sources = hashlib.sha256()
    for file in sorted(PACKAGE.rglob("*")):
        # compiled code is made of the sources; what is used of shipped files is an input or a param
        is_source = not {"__pycache__", "shipped"} & {*file.relative_to(PACKAGE).parts}
        if file.is_file() and is_source:
            sources.update(file.relative_to(PACKAGE).as_posix().encode() + file.read_bytes())
    return {
        "version": version("osl-analysis"),
        "sources": sources.hexdigest()[:12],
        "data": opened.data,
    }
