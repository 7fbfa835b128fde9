# SPDX-License-Identifier: Apache-2.0
"""Do a job of the workflow in this process: call its command with what its rule names, but without
the inputs that were refused or excluded, and write the reason into its outputs where the input is
at fault."""

import json
import time
import traceback
import warnings
from collections.abc import Collection, Mapping, Sequence
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

import polars as pl
from pydantic import ConfigDict, validate_call

from osl_analysis.base.errors import (
    InputError,
    MemoryLimitError,
    OslAnalysisError,
    WriteError,
    on_one_line,
    printable,
    show_advice_alone,
    unexpected,
)
from osl_analysis.base.files import write_text
from osl_analysis.base.memory import limited_memory
from osl_analysis.base.table import (
    NOT_ANALYSED,
    NOT_ANALYSED_KEY,
    OUTCOME,
    NotAnalysed,
    not_analysed,
    write_table,
    write_tables,
)
from osl_analysis.base.trial import read_trial, write_empty
from osl_analysis.commands.fit import FITS, fit_or_advise
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.dictionary.described import (
    ADDED_TO_ALL,
    columns_of_trial,
    described_tables,
    described_tables_by_name,
)
from osl_analysis.jobs.progress import Files, Job, listed, write_log
from osl_analysis.judge.campaign import QUALITY
from osl_analysis.judge.recording_checks import CHECKED, HOW_TO_USE

ONLY_CHECKED = "fitted"
"""An input that no command reads: it gets the refusals among these files, as `refused`."""
NO_ARGUMENTS = {"arguments", "made_by", "excluded", "file_states", "sources"}
"""Params that are no arguments of a command: those of a fit stand in `arguments`; what made the
data; the trials that quality control excludes; and what Snakemake only compares with the last
run."""

REMEDY = (
    "correct or replace the file, or its source file, or give a reason under `exclude` in the"
    " sample sheet, or change the settings of this analysis in the configuration"
)
HOLDING_A_REASON = {".csv", ".zip", ".parquet", ".json", ".tex", ".md"}
"""Suffixes of files that can say why there is no result."""

OF_A_FILE = (FileNotFoundError, PermissionError, IsADirectoryError, NotADirectoryError)
"""Errors of the system that are those of one file; a bad disk or too many open files are not."""

FITTED = {fit: EXPERIMENTS[name] for name, fit in FITS.items()}
"""The experiment that a command fits, whose tables it writes in their order."""

CONVERTING: Any = cache(validate_call(config=ConfigDict(arbitrary_types_allowed=True)))
"""A command that converts what it is given to the types that it declares."""


def perform(job: Job) -> None:
    """Do a job, and write its log. Where its input is at fault, the outputs hold the reason.

    Raises
    ------
    RuntimeError
        There is no result and no reason of the input: the program or the system is at fault.
    """
    start = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        show_advice_alone()
        try:
            ending = called(job)
        except Exception as error:
            reason, remedy = reason_and_remedy(job, error)
            ending = {
                "outcome": "failed",
                "error": reason,
                "remedy": remedy,
                "traceback": traceback.format_exc(),
            }
    texts = dict.fromkeys(printable(str(warning.message)) for warning in caught)
    write_log(
        job.log,
        {
            "job": job.name,
            **ending,
            "seconds": round(time.perf_counter() - start, 3),
            "warnings": [*texts],
        },
    )
    if ending["outcome"] == "failed":
        raise RuntimeError(ending["error"])


def called(job: Job) -> dict[str, Any]:
    """Call the command of a job, or write why it has no result; how it ended, for its log."""
    try:
        causes = call(job)
    except (OslAnalysisError, OSError) as error:
        if not is_of_input(job, error):
            raise
        reason, remedy = reason_and_remedy(job, error)
        trial = getattr(error, "trial", "") or job.trial  # an OSError knows none
        write_reasons(job, [NotAnalysed(trial, f"{reason}; {remedy}")])
        return {"outcome": "refused", "error": reason, "remedy": remedy}
    if causes:
        write_reasons(job, causes)
        return {"outcome": "skipped", "error": "; ".join(cause.text for cause in causes)}
    return {"outcome": "done"}


def reason_and_remedy(job: Job, error: Exception) -> tuple[str, str]:
    """Reason and remedy of an error, each on one line."""
    if isinstance(error, OslAnalysisError):
        return error.reason, error.remedy or REMEDY
    if isinstance(error, OSError):
        return printable(str(error)), "make the file or its folder accessible"
    return unexpected(error), f"a fault of this program: report it with the traceback in {job.log}"


def is_of_input(job: Job, error: Exception) -> bool:
    """Whether an error is of what the job was given, so that its outputs are to hold the reason."""
    suffixes = {file.suffix for file in job.files}
    if not suffixes <= HOLDING_A_REASON or job.simulates:
        return False
    if isinstance(error, OF_A_FILE):
        return str(error.filename) in job.recordings
    return not isinstance(error, OSError | WriteError | MemoryLimitError)


def call(job: Job) -> Sequence[NotAnalysed]:
    """Call the command of a job, or return the causes for which something that it needs is missing.

    Its arguments are the inputs, outputs and params of the rule by their names, converted to the
    declared types. A command that returns a table gets no outputs: the table is written here. A
    command that is told what is `refused` is called whatever is missing.
    """
    inputs, refused, missing = without_missing(job.inputs)
    if missing and job.tell != "refused":
        return missing

    inputs = without_excluded(inputs, job.params.get("excluded", ()))
    params = {**job.params, **job.params.get("arguments", {})}
    stated = {name: params[name] for name in params if name not in NO_ARGUMENTS}
    arguments = {**stated, **inputs}
    arguments.pop(ONLY_CHECKED, None)
    if job.tell:
        arguments[job.tell] = refused
    command = CONVERTING(job.command)
    with limited_memory(job.recordings, job.at_once):
        if job.command in FITTED:
            write_fit(job, command, arguments)
        elif job.command.__annotations__.get("return") is pl.DataFrame:
            (file,) = job.files
            write_table(command(**arguments), file, job.params["made_by"]["data"])
        else:
            command(**arguments, **job.outputs)
    return ()


def without_missing(
    inputs: Mapping[str, Files],
) -> tuple[dict[str, Files], list[NotAnalysed], list[NotAnalysed]]:
    """Take the refusals out of the inputs of a job.

    Returns the inputs that are left, the causes of all that was refused, and those of them that
    keep the job from running: of what it cannot run without (`without_trials`).
    """
    causes_of = {}
    for files in inputs.values():
        for file in listed(files):
            if causes := not_analysed(file):
                causes_of[Path(file).stem] = causes
    usable, needed = without_trials(inputs, causes_of)
    missing = chain(*(causes_of[name] for name in needed))
    return usable, list(dict.fromkeys(chain(*causes_of.values()))), list(dict.fromkeys(missing))


def without_excluded(inputs: Mapping[str, Files], excluded: Collection[str]) -> dict[str, Files]:
    """Take the files of excluded trials out of the lists of a job.

    Raises
    ------
    InputError
        The input `trial` is excluded, or a list loses everything.
    """
    left, needed = without_trials(inputs, excluded)
    if needed:
        raise InputError(
            f"quality control excludes every trial that is needed here: {', '.join(needed)}",
            f"{HOW_TO_USE}; the reasons stand in tables/excluded.csv",
        )
    return left


def without_trials(
    inputs: Mapping[str, Files], removed: Collection[str]
) -> tuple[dict[str, Files], list[str]]:
    """Take the files of some trials out of the lists of a job, each of them out of every list.

    Returns the inputs that are left, and those of the names without which the job cannot run: of a
    single file, or, of a job without the input `trial`, all of a list.
    """
    left = dict(inputs)
    needed = set[str]()
    for name, files in inputs.items():
        stems = [Path(file).stem for file in listed(files)]
        if isinstance(files, list):
            left[name] = [file for file in files if Path(file).stem not in removed]
        if isinstance(files, str) or not (left[name] or "trial" in inputs):
            needed.update({*stems}.intersection(removed))
    return left, sorted(needed)


def write_fit(job: Job, fit: Any, arguments: dict[str, Any]) -> None:
    """Fit a trial, and write the first of its tables to a file, the others into an archive."""
    trial = read_trial(Path(arguments.pop("trial")))
    tables = fit_or_advise(fit, trial, **arguments).everything()
    first, *further = [table.name for table in FITTED[job.command].tables]
    file, archive = job.files
    by_place = {archive / f"{name}.csv": tables[name] for name in further}
    by_place[file] = tables[first].with_columns(**OUTCOME).select(columns_of_trial(first))
    write_tables(by_place, job.params["made_by"]["data"])


def write_reasons(job: Job, causes: Sequence[NotAnalysed]) -> None:
    """Write each output with the columns that it has else, and why there is nothing in it."""
    tables = {}
    for file in job.files:
        if file.suffix == ".csv":
            tables[file] = reason_rows(causes, columns_of_file(file))
        elif file.suffix == ".zip":
            tables[file / f"{NOT_ANALYSED_KEY}.csv"] = reason_rows(causes, ["trial"])
            described = {Path(each.also or each.place).name: each for each in described_tables()}
            experiment = FITTED[job.command]
            # signals over time have one motion
            left_out = {*ADDED_TO_ALL, "theta_deg" if experiment.motion == "omega" else "omega"}
            for table in experiment.tables[1:]:
                of_table = described[table.name].columns
                columns = [name for name in of_table if name not in left_out]
                empty = pl.DataFrame(schema=dict.fromkeys(columns, pl.String))
                tables[file / f"{table.name}.csv"] = empty
        elif file.suffix == ".parquet":
            names = ["time", *job.params.get("needed_columns", ("theta", "torque"))]
            write_empty(names, file, {NOT_ANALYSED_KEY: json.dumps(causes)})
        elif file.suffix == ".json":
            write_text(file, json.dumps({NOT_ANALYSED_KEY: causes}))
        else:  # a comment of LaTeX
            reasons = on_one_line("; ".join(cause.reason for cause in causes))
            write_text(file, f"% not made: {reasons}\n")
    write_tables(tables, job.params["made_by"]["data"])


def columns_of_file(file: Path) -> list[str]:
    """The columns of a table, by its place in the results."""
    if file.parent.name == QUALITY:
        return CHECKED
    if file.parent.name in described_tables_by_name():
        return columns_of_trial(file.parent.name)
    columns = {table.place: [*table.columns] for table in described_tables()}
    return columns.get(f"{file.parent.name}/{file.stem}", ["trial"])


def reason_rows(causes: Sequence[NotAnalysed], columns: Sequence[str]) -> pl.DataFrame:
    """A row for each cause, with these columns."""
    without = {**dict.fromkeys(columns), "status": NOT_ANALYSED}
    return pl.DataFrame(
        [{**without, "trial": cause.trial or None, "reason": cause.reason} for cause in causes]
    )
