"""A job of the workflow, in its own process: it calls the command, and leaves records where there is no result."""

import importlib
import inspect
import re
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, validate_call

from osl_analysis.errors import OslAnalysisError, PartialResultError, WriteError, printable, unexpected
from osl_analysis.files import temporary_path
from osl_analysis.jobs.job_log import JobLog, write_log
from osl_analysis.jobs.memory import limited_memory
from osl_analysis.jobs.refusal import Refusal, write_refusals
from osl_analysis.jobs.request import Job, read_request, say_excluded
from osl_analysis.judge.findings import Judge, exclusions, without_excluded, without_refused
from osl_analysis.table import archives, tables_of, write_table
from osl_analysis.trial import read_trial

WHAT_TO_DO = {
    "refused": "correct or replace the file, or its source file, or give a reason under `exclude` in the sample sheet",
    "refused, of several": "correct or exclude the trials behind it, or change the settings of this analysis in the "
    "configuration",
    "failed": "a fault of this program: report it with the traceback in {log}; the next run tries it again",
    "failed, of the system": "make the file or its folder accessible, or room on the disk; the next run tries it again",
    "died": "run again; if memory was short, with fewer jobs at once (`--cores 1`)",
}
"""After each outcome of a job, where its message does not say; `log` is the path of its log."""
TO_DO = frozenset({
    "add", "ask", "calibrate", "check", "choose", "clear", "convert", "copy", "correct", "cut", "delete", "drive",
    "enable", "exclude", "excite", "export", "fill", "find", "fit", "give", "ingest", "keep", "label", "leave",
    "list", "look", "lower", "make", "map", "mark", "mend", "move", "name", "put", "quote", "raise", "rebuild",
    "record", "remove", "rename", "repair", "repeat", "replace", "resample", "rewrite", "run", "sample", "save",
    "see", "select", "set", "shorten", "start", "state", "switch", "synchronise", "synchronize", "take", "turn",
    "type", "use", "wait", "write", "zero",
})  # fmt: skip
"""Verbs with which a remedy begins."""


class MissingInputError(Exception):
    """A job cannot run, because a result that it needs was refused or failed."""

    def __init__(self, causes: Sequence[Refusal]) -> None:
        super().__init__("; ".join(f"{cause.trial or cause.file}: {cause.reason}" for cause in causes))
        self.causes = causes


def run(request: str) -> int:
    """Run the job of a request; its exit code. Where there is no result, there are records: Snakemake goes on.

    The code is 1 where neither a result nor a record can be written, as on a full disk.
    """
    job = read_request(Path(request))
    job.log.unlink(missing_ok=True)
    try:
        perform(job)
    except (OslAnalysisError, OSError) as error:
        print(f"error: {job.log.stem}: {error}", file=sys.stderr)
        return 1
    return 0


def perform(job: Job) -> None:
    """Call the command, and write log and, where there is no result, records: also after an error."""
    start, ended, causes = time.perf_counter(), JobLog(job.command, "done"), None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        try:
            call(job)
        except MissingInputError as missing:
            ended, causes = JobLog(job.command, "skipped", error=str(missing)), missing.causes
        except PartialResultError as rest:
            job = replace(job, files=[str(path) for path in rest.missing])
            ended = ended_by(job.command, rest.__cause__ or rest)
        except Exception as fault:
            ended = ended_by(job.command, fault)
    warned = tuple(dict.fromkeys(printable(str(warning.message)) for warning in caught))
    end(job, replace(ended, seconds=time.perf_counter() - start, warnings=warned), causes)


def ended_by(command: str, fault: BaseException) -> JobLog:
    """How an error ends a job: refused for what is wrong with its input, else failed, so that it is tried again."""
    if isinstance(fault, WriteError):
        return JobLog(command, "failed", error=str(fault))
    if isinstance(fault, OslAnalysisError):
        return JobLog(command, "refused", error=str(fault))
    if isinstance(fault, OSError):
        return JobLog(command, "failed", error=printable(f"{fault.filename or 'a file'}: {fault.strerror or fault}"))
    said = "".join(traceback.format_exception(fault))
    return JobLog(command, "failed", error=unexpected(fault), traceback=said)


def call(job: Job) -> None:
    """Call the command with the named values of its rule, each converted to the type that the command declares.

    What was refused is told to a command that has an argument `refused`; another one that needs it cannot run. A fit
    (`Fit.job` in `experiments.py`) takes the trial itself and gives its tables, which are written here.
    """
    module, _, name = job.command.partition(".")
    function = getattr(importlib.import_module(f"osl_analysis.commands.{module}"), name)
    reasons: dict[str, str] = {}
    if job.judge:
        reasons = exclusions(Judge.read(job.judge).verdicts(map(Path, job.request["input"]["quality"])))
    if job.judge and job.path:
        say_excluded(job.path, list(reasons))
    usable = without_refused(job.request["input"], job.unnamed)
    told: dict[str, Any] = {}
    if "refused" in inspect.signature(function).parameters:
        told = {"refused": usable.refused}
    elif usable.missing:
        raise MissingInputError(usable.missing)
    convert = validate_call(config=ConfigDict(arbitrary_types_allowed=True))
    with tables_of(job.data), archives(), limited_memory(files_read(job)):
        inputs = without_excluded(usable.inputs, reasons)
        if (tables := job.request["output"].get("tables")) is None:
            convert(function)(**inputs, **job.request["output"], **job.request["settings"], **told)
            return
        inputs["trial"] = read_trial(Path(inputs["trial"]))
        fitted = convert(function)(**inputs, **job.request["settings"])
        for table, file in tables.items():
            write_table(fitted[table], Path(file))


def end(job: Job, ended: JobLog, causes: Sequence[Refusal] | None = None) -> None:
    """Write the log of a job, and unless it is done a record for each of its files.

    `causes` are those of a job that lacks an input; otherwise the job itself is the cause.
    """
    if ended.outcome != "done":
        for path in job.files:
            write_refusals(causes or [refusal(job, ended)], Path(path))
    write_log(job.log, ended, job.request)


def refusal(job: Job, ended: JobLog) -> Refusal:
    """The record of a job that refused its input, failed or died."""
    trial, outcome, reason, remedy = trial_of(job), ended.outcome, ended.error, ""
    if outcome == "refused" or (outcome == "failed" and not ended.traceback):
        reason, remedy = reason_and_remedy(ended.error)
    kind = {"refused": "" if trial else ", of several", "failed": "" if ended.traceback else ", of the system"}
    remedy = remedy or WHAT_TO_DO[outcome + kind.get(outcome, "")].format(log=job.log)
    files = [*files_read(job), *job.files]  # the first is to blame, unless the reason names another one
    file = next((file for file in files if file in reason), files[0] if files else "")
    return Refusal(trial, file, job.command, outcome, reason, remedy)


def reason_and_remedy(message: str) -> tuple[str, str]:
    """What a message says is wrong, and what to do; the latter is empty where it cannot be told from the former.

    It begins at the first semicolon outside brackets after which a verb of `TO_DO` stands, also after "if ...,".
    """
    for found in re.finditer("; ", message):
        reason, rest = message[: found.start()], message[found.end() :]
        outside = all(reason.count(left) == reason.count(right) for left, right in ("()", "[]"))
        first = re.match(r"(?:(?:if|for|to) [^;,]*, )?([A-Za-z]+)", rest)
        if outside and first and first[1].lower() in TO_DO:
            return reason, rest
    return message, ""


def trial_of(job: Job) -> str:
    """The trial of a job; empty for a job over several."""
    settings, inputs = job.request["settings"], job.request["input"]
    named = settings.get("trial") or (settings.get("row") or {}).get("trial")
    return str(named or Path(str(inputs.get("trial") or inputs.get("crossing") or "")).stem)


def files_read(job: Job) -> list[str]:
    """The recordings of a job, and the trials that it reads."""
    row, inputs = job.request["settings"].get("row") or {}, job.request["input"]
    raw = [Path(job.request["settings"]["raw_folder"], row[role]) for role in ("log", "mocap") if row.get(role)]
    return [str(file) for file in (*raw, inputs.get("trial"), inputs.get("crossing")) if file]


def died(request: str, pid: int, number: int) -> None:
    """End a job whose process was killed by a signal: leave records, so that other jobs go on."""
    job = read_request(Path(request))
    forget(request, pid)
    known = {int(one): one.name for one in signal.Signals}
    by = f"signal {number}, {known[number]}" if number in known else "from outside"
    end(job, JobLog(job.command, "died", error=f"the process of this job was killed ({by})"))


def forget(request: str, pid: int) -> None:
    """Delete the temporary files that a killed process has left."""
    for path in map(Path, read_request(Path(request)).files if pid else ()):
        temporary_path(path, pid).unlink(missing_ok=True)
