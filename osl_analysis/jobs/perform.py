"""Do a job of the workflow in this process: call its command with what its rule names, and write
the reason into its outputs where the input is at fault."""

import inspect
import json
import time
import traceback
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, get_origin

import polars as pl
from pydantic import ConfigDict, TypeAdapter, validate_call

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.dictionary import described_tables
from osl_analysis.errors import (
    MemoryLimitError,
    OslAnalysisError,
    WriteError,
    printable,
    unexpected,
)
from osl_analysis.files import atomic_path, write_text
from osl_analysis.jobs.job_log import write_log
from osl_analysis.jobs.used import Files, without_excluded, without_missing
from osl_analysis.memory import limited_memory
from osl_analysis.status import KEY, NOT_ANALYSED, NotAnalysed
from osl_analysis.table import write_table, write_tables
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

REMEDY_OF_TRIAL = (
    "correct or replace the file, or its source file, or give a reason under `exclude` in the"
    " sample sheet"
)
REMEDY_OF_SEVERAL = (
    "correct or exclude the trials behind it, or change the settings of this analysis in the"
    " configuration"
)
COMMENTS = {".tex": "% {}", ".md": "{}"}
"""How text files say why there is no result."""
HOLDING_A_REASON = {".csv", ".zip", ".parquet", ".json", *COMMENTS}

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

    command: str  # full name of a function
    inputs: Mapping[str, Files]
    outputs: Mapping[str, Any]  # a file, or a list of files, by name
    params: Mapping[str, Any]
    log: Path

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
    def makes_recordings(self) -> bool:
        """Whether the job simulates: what it makes is no result of a trial."""
        return self.command.startswith("osl_analysis.commands.simulate.")

    @property
    def trial(self) -> str:
        """The trial that the job is of; empty for one over several trials, and for a drawing."""
        if any(file.parent.name == "figures" for file in self.files):
            return ""
        stated = self.params.get("trial") or (self.params.get("row") or {}).get("trial")
        read = self.inputs.get("trial") or self.inputs.get("crossing") or ""
        return str(stated or (Path(read).stem if isinstance(read, str) else ""))


def perform(job: Job) -> None:
    """Do a job, and write its log. Where its input is at fault, the outputs hold the reason.

    Raises
    ------
    RuntimeError
        There is no result and no reason of the input: the program or the system is at fault.
    """
    start = time.perf_counter()
    fault = ""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        try:
            ending = called(job)
        except Exception as error:
            fault, remedy = words_of(job, error)
            ending = {"outcome": "failed", "error": fault, "remedy": remedy}
            if not isinstance(error, OslAnalysisError | OSError):
                ending["traceback"] = traceback.format_exc()
    seconds = round(time.perf_counter() - start, 3)
    texts = dict.fromkeys(printable(str(warning.message)) for warning in caught)
    log_end(job, ending, seconds=seconds, warnings=list(texts))
    if fault:
        raise RuntimeError(fault)


def called(job: Job) -> dict[str, str]:
    """Call the command of a job, or write why it has no result; how it ended, for its log."""
    try:
        causes = call(job)
    except (OslAnalysisError, OSError) as error:
        if not is_of_input(job, error):
            raise
        reason, remedy = words_of(job, error)
        write_reasons(job, [cause_of(job, reason, remedy)])
        return {"outcome": "refused", "error": reason, "remedy": remedy}
    if causes:
        write_reasons(job, causes)
        return {"outcome": "skipped", "error": "; ".join(cause.text for cause in causes)}
    return {"outcome": "done"}


def words_of(job: Job, error: Exception) -> tuple[str, str]:
    """Reason and remedy of an error, each on one line."""
    if isinstance(error, OslAnalysisError):
        return error.reason, error.remedy or (REMEDY_OF_TRIAL if job.trial else REMEDY_OF_SEVERAL)
    if isinstance(error, OSError):
        reason = f"{error.filename or 'a file'}: {error.strerror or error}"
        return printable(reason), "make the file or its folder accessible"
    remedy = f"a fault of this program: report it with the traceback in {job.log}"
    return unexpected(error), remedy


def is_of_input(job: Job, error: Exception) -> bool:
    """Whether an error is of what the job was given, so that its outputs are to hold the reason."""
    if not all(file.suffix in HOLDING_A_REASON for file in job.files) or job.makes_recordings:
        return False
    if isinstance(error, MemoryLimitError):
        return bool(job.recordings)
    if isinstance(error, OSError):
        return str(error.filename) in job.recordings
    return isinstance(error, OslAnalysisError) and not isinstance(error, WriteError)


def cause_of(job: Job, reason: str, remedy: str) -> NotAnalysed:
    """What the outputs of a job say. Of several trials the reason begins with a file."""
    files = [*job.recordings, *map(str, job.files)]
    if not any(file in reason for file in files) and not job.trial:
        reason = f"{files[0]}: {reason}"
    return NotAnalysed(job.trial, f"{reason}; {remedy}")


def log_end(job: Job, ending: Mapping[str, Any], **further: Any) -> None:
    """Write the log of a job, with further entries."""
    entries = {"job": job.command, **ending, **further}
    write_log(job.log, entries, {"input": job.inputs, "output": job.outputs, "params": job.params})


def call(job: Job) -> Sequence[NotAnalysed]:
    """Call the command of a job.

    Its arguments, or the fields of the one dataclass that it takes, are the inputs, outputs and
    params of the rule by their names, each converted to the declared type. A mapping of files gets
    them by their stems. A command with an argument `refused` is told the causes of what is missing.
    Any other is not called if it needs something that is missing: these causes are returned. The
    fit of an experiment takes a trial and returns tables, which are written here. A command that
    writes tables has an argument `data`, which their last column says.
    """
    function = resolve_name(job.command)
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

    usable = without_missing(inputs)
    params = {
        name: value
        for name, value in job.params.items()
        if name not in ONLY_COMPARED and name not in OF_EVERY_JOB
    }
    if takes_refusals:
        params["refused"] = usable.refused
    elif usable.missing:
        return usable.missing
    if "not_analysed" in arguments:
        params["not_analysed"] = usable.refused
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
            advise = resolve_name("osl_analysis.commands.remedies.fit_or_advise")
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


def write_reasons(job: Job, causes: Sequence[NotAnalysed]) -> None:
    """Write each output with its columns and why there is nothing in it."""
    described = {table.place: table for table in described_tables()}
    data = job.params["made_by"]["data"]
    rows = pl.DataFrame(causes, ("trial", "reason"), orient="row")
    rows = rows.with_columns(pl.col("trial").replace("", None), status=pl.lit(NOT_ANALYSED))

    def with_columns_of(places: Sequence[str]) -> pl.DataFrame:
        place = next((place for place in places if place in described), "")
        columns = described[place].columns if place else ("trial", "status", "reason")
        missing = [pl.lit(None).alias(name) for name in columns if name not in rows.columns]
        return rows.with_columns(missing).select(list(columns))

    for file in job.files:
        stem, folder = file.stem, file.parent.name
        if file.suffix == ".csv":
            places = (f"tables/{folder}", f"{folder}/{stem}", f"{folder}/*")
            write_table(with_columns_of(places), file, data)
        elif file.suffix == ".zip":
            tables = TABLES_OF_FIT[job.command]
            parts = {}
            for table in tables:
                parts[file / f"{table}.csv"] = with_columns_of([f"tables/{table}"])
            write_tables(parts, data)
        elif file.suffix == ".parquet":
            names = dict.fromkeys(("time", *job.params.get("needed_columns", ("theta", "torque"))))
            empty = pl.DataFrame(schema=dict.fromkeys(names, pl.Float64))
            with atomic_path(file) as temporary:
                empty.write_parquet(temporary, metadata={KEY: json.dumps(causes)})
        elif file.suffix == ".json":
            write_text(file, json.dumps({"status": NOT_ANALYSED, "reasons": causes}))
        else:
            text = "; ".join(cause.reason for cause in causes)
            write_text(file, COMMENTS[file.suffix].format(f"not made: {text}\n"))


def end_killed(job: Job, signal_name: str, is_crash: bool) -> None:
    """Write the log of a job whose process was killed, or crashed. A library that crashed on the
    recording would crash again: the outputs hold this reason.

    Raises
    ------
    RuntimeError
        It is no crash on a recording, so that the next run is to try the job again.
    """
    if is_crash and job.recordings and not job.makes_recordings:
        reason = f"{' or '.join(job.recordings)}: a library that reads it crashed ({signal_name})"
        remedy = "the file may be damaged: copy, export or record it again"
        log_end(job, {"outcome": "refused", "error": reason, "remedy": remedy})
        write_reasons(job, [cause_of(job, reason, remedy)])
        return
    reason = f"the process of this job was killed ({signal_name})"
    remedy = "run again; if memory was short, with fewer jobs at once (`--cores 1`)"
    log_end(job, {"outcome": "killed", "error": reason, "remedy": remedy})
    raise RuntimeError(reason)
