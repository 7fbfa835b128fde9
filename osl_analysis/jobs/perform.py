# SPDX-License-Identifier: Apache-2.0
"""Do a job of the workflow in this process: call its function without the inputs that were refused
or excluded, write its log, and, where the input is at fault, the reason into its outputs. What the
function computes is not known here.

Example: `perform(Job(derive, [Path("a.csv")], Path("a.log"), {"table": Path("b.csv")}))`.
"""

import json
import time
import traceback
import warnings
from collections.abc import Collection, Mapping, Sequence
from dataclasses import is_dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import polars as pl

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
    NotAnalysed,
    not_analysed,
    write_table,
    write_tables,
)
from osl_analysis.base.trial import write_empty
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.dictionary.described import (
    ADDED_TO_ALL,
    columns_of_trial,
    described_tables,
    described_tables_by_name,
)
from osl_analysis.jobs.job import Files, Job, listed
from osl_analysis.jobs.progress import write_log
from osl_analysis.judge.campaign import QUALITY
from osl_analysis.judge.recording_checks import CHECKED, HOW_TO_USE

REMEDY = (
    "correct or replace the file, or its source file, or give a reason under `exclude` in the"
    " sample sheet, or change the settings of this analysis in the configuration"
)
HOLDING_A_REASON = {".csv", ".zip", ".parquet", ".json", ".tex", ".md"}
"""Suffixes of files that can say why there is no result."""
OF_A_FILE = (FileNotFoundError, PermissionError, IsADirectoryError, NotADirectoryError)
"""Errors of the system that are those of one file; a bad disk or too many open files are not."""
COLUMNS_OF_REFUSED_TRIAL = ("time", "theta", "torque")
"""Those of a trial or a crossing without rows."""


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
            ending = run_and_record(job)
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


def run_and_record(job: Job) -> dict[str, Any]:
    """Call the function of a job, or write why it has no result; how it ended, for its log."""
    try:
        causes = run(job)
    except (OslAnalysisError, OSError) as error:
        if not is_of_input(job, error):
            raise
        reason, remedy = reason_and_remedy(job, error)
        trial = getattr(error, "trial", "") or job.trial.name  # an OSError knows none
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
    suffixes = {file.suffix for file in job.outputs}
    if not suffixes <= HOLDING_A_REASON or job.simulates:
        return False
    if isinstance(error, OF_A_FILE):
        return Path(error.filename or "") in job.trial.files
    return not isinstance(error, OSError | WriteError | MemoryLimitError)


def run(job: Job) -> Sequence[NotAnalysed]:
    """Call the function of a job, and write the table that it returns; or return the causes for
    which something that it needs is missing."""
    left_out = job.left_out
    inputs, refused, missing = drop_refused(job.inputs, left_out.also_of)
    if missing and not left_out.is_called_anyway:
        return missing

    arguments = {**job.arguments, **drop_excluded(inputs, left_out.excluded)}
    if left_out.argument:
        arguments[left_out.argument] = refused
    with limited_memory(job.trial.files, job.parallel_jobs):
        table = job.function(**arguments)
        if table is not None:
            write_table(table, job.outputs[0], job.data)
    return ()


def drop_refused(
    inputs: Mapping[str, Files], also_of: Sequence[Path] = ()
) -> tuple[dict[str, Files], list[NotAnalysed], list[NotAnalysed]]:
    """Take the refused trials out of the inputs of a job.

    Returns the inputs that are left; the causes of all that was refused among them and in the
    files `also_of`; and those causes that keep the job from running (`drop_trials`).
    """
    causes_of = {}
    for file in chain(also_of, *map(listed, inputs.values())):
        if causes := not_analysed(file):
            causes_of[file.stem] = causes
    usable, needed = drop_trials(inputs, causes_of)
    refused = dict.fromkeys(chain(*causes_of.values()))
    missing = dict.fromkeys(chain(*(causes_of[name] for name in needed)))
    return usable, list(refused), list(missing)


def drop_excluded(inputs: Mapping[str, Files], excluded: Collection[str]) -> dict[str, Files]:
    """Take the files of excluded trials out of the inputs of a job.

    Raises
    ------
    InputError
        A single file is excluded, or a list loses everything.
    """
    usable, needed = drop_trials(inputs, excluded)
    if needed:
        raise InputError(
            f"quality control excludes every trial that is needed here: {', '.join(needed)}",
            f"{HOW_TO_USE}; the reasons stand in tables/excluded.csv",
        )
    return usable


def drop_trials(
    inputs: Mapping[str, Files], names: Collection[str]
) -> tuple[dict[str, Files], list[str]]:
    """Take the files with some names (stems) out of the inputs of a job.

    Returns the inputs that are left, and those of the names without which the job cannot run: of a
    single file, or all of several.
    """
    usable = dict(inputs)
    needed = set[str]()
    for argument, files in inputs.items():
        if is_dataclass(files):
            parts, needed_of_parts = drop_trials(vars(files), names)
            usable[argument] = replace(files, **parts)  # type: ignore[type-var]
            needed.update(needed_of_parts)
            continue
        if isinstance(files, list):
            usable[argument] = [file for file in files if file.stem not in names]
        elif isinstance(files, dict):
            usable[argument] = {
                name: file for name, file in files.items() if file.stem not in names
            }
        if isinstance(files, Path) or not usable[argument]:
            needed.update({file.stem for file in listed(files)}.intersection(names))
    return usable, sorted(needed)


def write_reasons(job: Job, causes: Sequence[NotAnalysed]) -> None:
    """Write each output with the columns that it has else, and why there is nothing in it."""
    tables = {}
    for file in job.outputs:
        if file.suffix == ".csv":
            tables[file] = reason_rows(causes, columns_of_file(file))
        elif file.suffix == ".zip":
            tables[file / f"{NOT_ANALYSED_KEY}.csv"] = reason_rows(causes, ["trial"])
            for name, columns in columns_in_archive(file).items():
                empty = pl.DataFrame(schema=dict.fromkeys(columns, pl.String))
                tables[file / f"{name}.csv"] = empty
        elif file.suffix == ".parquet":
            write_empty(COLUMNS_OF_REFUSED_TRIAL, file, {NOT_ANALYSED_KEY: json.dumps(causes)})
        elif file.suffix == ".json":
            write_text(file, json.dumps({NOT_ANALYSED_KEY: causes}))
        else:  # a comment of LaTeX
            reasons = on_one_line("; ".join(cause.reason for cause in causes))
            write_text(file, f"% not made: {reasons}\n")
    write_tables(tables, job.data)


def columns_of_file(file: Path) -> list[str]:
    """The columns of a table, by its place in the results."""
    if file.parent.name == QUALITY:
        return CHECKED
    if file.parent.name in described_tables_by_name():
        return columns_of_trial(file.parent.name)
    columns = {table.place: [*table.columns] for table in described_tables()}
    return columns.get(f"{file.parent.name}/{file.stem}", ["trial"])


def columns_in_archive(file: Path) -> dict[str, list[str]]:
    """The columns of each table in the archive `fits/EXPERIMENT/TRIAL.zip`."""
    experiment = EXPERIMENTS[file.parent.name]
    described = {Path(table.also or table.place).name: table for table in described_tables()}
    # signals over time have one motion
    left_out = {*ADDED_TO_ALL, "theta_deg" if experiment.motion == "omega" else "omega"}
    _, *further = experiment.tables  # the first is the file of the estimates
    return {
        table.name: [name for name in described[table.name].columns if name not in left_out]
        for table in further
    }


def reason_rows(causes: Sequence[NotAnalysed], columns: Sequence[str]) -> pl.DataFrame:
    """A row for each cause, with these columns."""
    without = {**dict.fromkeys(columns), "status": NOT_ANALYSED}
    return pl.DataFrame(
        [{**without, "trial": cause.trial or None, "reason": cause.reason} for cause in causes]
    )
