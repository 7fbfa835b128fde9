"""Do a job of the workflow in this process: call its command with what its rule names, and leave
refusals if there is no result."""

import inspect
import time
import traceback
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_origin

from pydantic import ConfigDict, TypeAdapter, validate_call

from osl_analysis.commands import command_of
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.errors import (
    MemoryLimitError,
    OslAnalysisError,
    WriteError,
    printable,
    unexpected,
)
from osl_analysis.memory import limited_memory
from osl_analysis.outcomes.job_log import write_log
from osl_analysis.outcomes.used import Files, without_excluded, without_refused
from osl_analysis.refusal import Refusal, write_refusals
from osl_analysis.table import write_tables
from osl_analysis.trial import read_trial

ONLY_WAITED_FOR = ("recordings", "sources", "made_of", "evidence", "numbers", "quality")
"""Inputs that are no arguments of a command: it finds these files itself, or by others."""
ONLY_CHECKED = ("fitted",)
"""Inputs that no command reads: it gets the refusals among them, as `refused`."""
ONLY_MADE = ("log", "mocap")
"""Outputs that are no arguments of a command: it finds their places itself."""
ONLY_COMPARED = ("sizes",)
"""Params that are no arguments of a command: Snakemake compares them with those of the last run."""
OF_EVERY_JOB = ("made_by", "excluded")
"""Params that are read here: what made the data, and the trials that quality control excludes."""

WHAT_TO_DO = {
    "refused": (
        "correct or replace the file, or its source file, or give a reason under `exclude` in the"
        " sample sheet"
    ),
    "refused, of several": (
        "correct or exclude the trials behind it, or change the settings of this analysis in the "
        "configuration"
    ),
    "failed": "a fault of this program: report it with the traceback in {log}",
    "failed, of the system": "make the file or its folder accessible",
}
"""Remedy by outcome, if the error has none; `log` is the path of the job's log."""

TABLES_OF_FIT = {
    facts.fit.job: [table.name for table in facts.tables]
    for facts in EXPERIMENTS.values()
    if facts.fit is not None
}
"""The tables of the fit of an experiment, by its command, in the order in which it writes them."""

CONVERTING: Any = cache(validate_call(config=ConfigDict(arbitrary_types_allowed=True)))


@dataclass(frozen=True)
class Job:
    """What a rule gives to a job."""

    command: str  # `module.function` of `osl_analysis.commands`
    inputs: Mapping[str, Files]
    outputs: Mapping[str, Any]  # a file, or a list of files, by name
    params: Mapping[str, Any]
    log: Path
    killed_by: str = ""  # what killed the process that began the job before

    @property
    def files(self) -> list[Path]:
        """All outputs."""
        listed = [[files] if isinstance(files, str) else files for files in self.outputs.values()]
        return [Path(file) for files in listed for file in files]

    @property
    def recordings(self) -> list[str]:
        """The recordings of a trial that the job ingests, and the trial that it reads."""
        row = self.params.get("row") or {}
        raw = [
            str(Path(self.params["raw_folder"], row[role]))
            for role in ("log", "mocap")
            if row.get(role)
        ]
        read = [self.inputs.get(name) for name in ("trial", "crossing")]
        return [*raw, *(file for file in read if isinstance(file, str))]

    @property
    def trial(self) -> str:
        """The trial that the job is of; empty for one over several trials, and for a drawing."""
        if any(file.parent.name == "figures" for file in self.files):
            return ""
        stated = self.params.get("trial") or (self.params.get("row") or {}).get("trial")
        read = self.inputs.get("trial") or self.inputs.get("crossing") or ""
        return str(stated or (Path(read).stem if isinstance(read, str) else ""))


@dataclass(frozen=True)
class Ending:
    """How a job ended, as its log says (`job_log.write_log`)."""

    outcome: str = "done"
    error: str = ""
    remedy: str = ""
    traceback: str = ""


def perform(job: Job) -> None:
    """Do a job, and write its log. An error of its input leaves refusals in place of the outputs.

    Raises
    ------
    WriteError
        A result cannot be written, as on a full disk. The next run tries again.
    """
    start = time.perf_counter()
    ending = Ending()
    causes: Sequence[Refusal] = ()
    cannot_write: WriteError | None = None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        try:
            causes = call(job)
            if causes:
                reasons = [f"{cause.trial or cause.file}: {cause.reason}" for cause in causes]
                ending = Ending("skipped", "; ".join(reasons))
        except OslAnalysisError as error:
            if isinstance(error, WriteError) and not isinstance(error, MemoryLimitError):
                cannot_write = error
            outcome = "failed" if isinstance(error, WriteError) else "refused"
            ending = Ending(outcome, error.reason, error.remedy)
        except OSError as error:
            reason = printable(f"{error.filename or 'a file'}: {error.strerror or error}")
            ending = Ending("failed", reason, WHAT_TO_DO["failed, of the system"])
        except Exception as error:
            ending = Ending("failed", unexpected(error), traceback=traceback.format_exc())
    seconds = round(time.perf_counter() - start, 3)
    texts = [printable(str(warning.message)) for warning in caught]
    if job.killed_by:
        name = job.trial or job.files[0].name
        texts.insert(0, f"{name}: its process was killed ({job.killed_by}), and it was done again")

    if cannot_write is None and ending.outcome != "done":
        refuse(job, causes or [refusal(job, ending)])
    log_end(job, ending, seconds=seconds, warnings=list(dict.fromkeys(texts)))
    if cannot_write is not None:
        raise cannot_write


def log_end(job: Job, ending: Ending, **further: Any) -> None:
    """Write the log of a job, with further entries."""
    entries = {"job": job.command, **asdict(ending), **further}
    write_log(job.log, entries, {"input": job.inputs, "output": job.outputs, "params": job.params})


def call(job: Job) -> Sequence[Refusal]:
    """Call the command of a job.

    Its arguments, or the fields of the one dataclass that it takes, are the inputs, outputs and
    params of the rule by their names, each converted to the declared type. A mapping of files gets
    them by their stems. A command with an argument `refused` is told the causes of what is missing.
    Any other is not called if it needs something that is missing: these causes are returned. The
    fit of an experiment takes a trial and returns tables, which are written here. A command that
    writes tables has an argument `data`, which their last column says.
    """
    function = command_of(job.command)
    arguments = arguments_of(function)
    takes_refusals = "refused" in arguments
    inputs = {
        name: files
        for name, files in job.inputs.items()
        if name not in ONLY_WAITED_FOR and (takes_refusals or name not in ONLY_CHECKED)
    }
    for name, files in inputs.items():
        if name in arguments and arguments[name].annotation == Mapping[str, Path]:
            inputs[name] = {Path(file).stem: file for file in files}

    usable = without_refused(inputs)
    params = {
        name: value
        for name, value in job.params.items()
        if name not in ONLY_COMPARED and name not in OF_EVERY_JOB
    }
    if takes_refusals:
        params["refused"] = usable.refused
    elif usable.missing:
        return usable.missing
    used = without_excluded(usable.inputs, job.params.get("excluded", ()))
    given: dict[str, Any] = {
        name: files for name, files in used.items() if name not in ONLY_CHECKED
    }
    for name, files in given.items():
        takes_many = name in arguments and get_origin(arguments[name].annotation) in (
            Sequence,
            Mapping,
        )
        if isinstance(files, list) and not takes_many:  # one file, or None
            given[name] = files[0] if files else None

    data = job.params["made_by"]["data"]
    if "data" in arguments:
        params["data"] = data
    with limited_memory(job.recordings):
        if job.command in TABLES_OF_FIT:
            trial = read_trial(Path(str(given.pop("trial"))))
            advise = command_of("remedies.fit_or_advise")
            tables_of_trial = advise(CONVERTING(function), trial, **given, **params)
            fitted = tables_of_trial.everything()
            tables = TABLES_OF_FIT[job.command]
            write_tables({place_of(table, job): fitted[table] for table in tables}, data)
        else:
            outputs = {name: at for name, at in job.outputs.items() if name not in ONLY_MADE}
            values = {**given, **outputs, **params}
            made_of = dataclass_of(function)
            if made_of is None:
                CONVERTING(function)(**values)
            else:
                function(TypeAdapter(made_of).validate_python(values))
    return ()


def dataclass_of(function: Callable[..., Any]) -> Any:
    """The dataclass that a command takes as its only argument, `files`; None for other commands."""
    arguments = inspect.signature(function).parameters
    return arguments["files"].annotation if list(arguments) == ["files"] else None


def arguments_of(function: Callable[..., Any]) -> Mapping[str, inspect.Parameter]:
    """What a rule gives to a command by name: its arguments, or the fields of its dataclass."""
    return inspect.signature(dataclass_of(function) or function).parameters


def place_of(table: str, job: Job) -> Path:
    """The file of a table of a fit: the output with its name, or one of the archive `others`."""
    if table in job.outputs:
        return Path(job.outputs[table])
    return Path(job.outputs["others"], f"{table}.csv")


def refuse(job: Job, causes: Sequence[Refusal]) -> None:
    """Leave these causes in place of each output."""
    for file in job.files:
        write_refusals(causes, file)


def refusal(job: Job, ending: Ending) -> Refusal:
    """The cause that a job is that refused its input or failed."""
    kind = ending.outcome
    if kind == "refused" and not job.trial:
        kind = "refused, of several"
    remedy = ending.remedy or WHAT_TO_DO[kind].format(log=job.log)
    files = [*job.recordings, *map(str, job.files)]
    # the first is the cause, unless the reason names another
    file = next((file for file in files if file in ending.error), files[0])
    return Refusal(job.trial, file, job.command, ending.outcome, ending.error, remedy)


def end_killed(job: Job, signal_name: str, is_crash: bool) -> None:
    """Write the log of a job whose process was killed for the second time, or crashed. A library
    that crashed on the recording would crash again: the recording is refused.

    Raises
    ------
    WriteError
        It is no crash on a recording, so that the next run is to try the job again.
    """
    if is_crash and job.recordings:
        reason = f"{' or '.join(job.recordings)}: a library that reads it crashed ({signal_name})"
        remedy = "the file may be damaged: copy, export or record it again"
        ending = Ending("refused", reason, remedy)
        refuse(job, [refusal(job, ending)])
    else:
        reason = f"the process of this job was killed ({signal_name})"
        remedy = "run again; if memory was short, with fewer jobs at once (`--cores 1`)"
        ending = Ending("killed", reason, remedy)
    log_end(job, ending)
    if ending.outcome == "killed":
        raise WriteError(f"{job.files[0]}: {reason}; {remedy}")
