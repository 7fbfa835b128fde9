"""A job of the workflow, in its own process: it calls the command, and leaves records if there is
no result."""

import importlib
import inspect
import json
import signal
import time
import traceback
import warnings
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, validate_call

from osl_analysis.errors import OslAnalysisError, WriteError, printable, unexpected
from osl_analysis.files import temporary_path, write_text
from osl_analysis.jobs.job_log import write_log
from osl_analysis.jobs.memory import limited_memory
from osl_analysis.jobs.request import read_request
from osl_analysis.judge.used import Judge, exclusions, without_excluded, without_refused
from osl_analysis.refusal import Refusal, write_refusals
from osl_analysis.table import tables_of, write_tables
from osl_analysis.trial import read_trial

Job = Mapping[str, Any]  # the content of a request, and its `path`
CONVERTING: Any = cache(validate_call(config=ConfigDict(arbitrary_types_allowed=True)))

WHAT_TO_DO = {
    "refused": (
        "correct or replace the file, or its source file, or give a reason under `exclude` in the"
        " sample sheet"
    ),
    "refused, of several": (
        "correct or exclude the trials behind it, or change the settings of this analysis in the "
        "configuration"
    ),
    "failed": (
        "a fault of this program: report it with the traceback in {log}; the next run tries it"
        " again"
    ),
    "failed, of the system": (
        "make the file or its folder accessible, or room on the disk; the next run tries it again"
    ),
    "died": "run again; if memory was short, with fewer jobs at once (`--cores 1`)",
}
"""Remedy by outcome, if the job's message has none; `log` is the path of its log."""
CRASHES = ("SIGSEGV", "SIGBUS", "SIGABRT", "SIGILL", "SIGFPE")
"""Signals of a crash by damaged input or a library's fault: the same input would crash again."""


def perform(job: Job) -> None:
    """Call the command and write the log, also after an error; without a result, write records. An
    error of the input is a refusal. Any other is a failure, and the job is tried again."""
    Path(job["log"]).unlink(missing_ok=True)
    start = time.perf_counter()
    causes: Sequence[Refusal] = ()
    ended = {"job": job["command"], "outcome": "done"}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        try:
            if causes := call(job):
                said = "; ".join(f"{cause.trial or cause.file}: {cause.reason}" for cause in causes)
                ended |= {"outcome": "skipped", "error": said}
        except OslAnalysisError as fault:
            outcome = "failed" if isinstance(fault, WriteError) else "refused"
            ended |= {"outcome": outcome, "error": fault.reason, "remedy": fault.remedy}
        except OSError as fault:
            said = printable(f"{fault.filename or 'a file'}: {fault.strerror or fault}")
            ended |= {"outcome": "failed", "error": said}
        except Exception as fault:
            ended |= {
                "outcome": "failed",
                "error": unexpected(fault),
                "traceback": traceback.format_exc(),
            }
    warned = list(dict.fromkeys(printable(str(warning.message)) for warning in caught))
    end(
        job, {**ended, "seconds": round(time.perf_counter() - start, 3), "warnings": warned}, causes
    )


def call(job: Job) -> Sequence[Refusal]:
    """Call the command with the named values of its rule, each converted to the type that the
    command declares. A command with an argument `refused` gets the refusals of its inputs. Any
    other does not run if a needed input was refused: the causes are returned. A fit takes a trial
    and returns tables, which are written here."""
    module, _, name = job["command"].partition(".")
    function = getattr(importlib.import_module(f"osl_analysis.commands.{module}"), name)
    reasons: dict[str, str] = {}
    if job["judge"]:
        reasons = exclusions(
            Judge.read(Path(job["judge"])).verdicts(map(Path, job["input"]["quality"]))
        )
        if job["excluded"] != list(reasons):
            # Some were not measured when the request was written. Without this, the next run would
            # find it changed.
            said = json.loads(job["path"].read_text(encoding="utf-8")) | {"excluded": list(reasons)}
            write_text(job["path"], json.dumps(said, indent=1) + "\n")
    usable, refused, missing = without_refused(job["input"], job["needs"])
    told: dict[str, Any] = {}
    if "refused" in inspect.signature(function).parameters:
        told = {"refused": refused}
    elif missing:
        return missing
    converting = CONVERTING(function)
    with tables_of(job["data"]), limited_memory(files_read(job)):
        inputs = without_excluded(usable, reasons)
        if (tables := job["output"].get("tables")) is None:
            converting(**inputs, **job["output"], **job["settings"], **told)
            return ()
        fitted = converting(
            **inputs | {"trial": read_trial(Path(inputs["trial"]))}, **job["settings"]
        )
        write_tables({Path(file): fitted[table] for table, file in tables.items()})
    return ()


def end(job: Job, ended: Mapping[str, Any], causes: Sequence[Refusal] = ()) -> None:
    """Write the log of a job and, unless it is done, a record in place of each of its files.
    `causes` are the refusals of missing inputs; without these, the job itself is the cause."""
    if ended["outcome"] != "done":
        for path in job["files"]:
            write_refusals(causes or [refusal(job, ended)], Path(path))
    write_log(Path(job["log"]), ended, job)


def refusal(job: Job, ended: Mapping[str, Any]) -> Refusal:
    """The record of a job that refused its input, failed or died."""
    inputs, settings = job["input"], job["settings"]
    trial = settings.get("trial") or (settings.get("row") or {}).get("trial")
    trial = str(trial or Path(str(inputs.get("trial") or inputs.get("crossing") or "")).stem)
    if any(Path(file).parent.name == "figures" for file in job["files"]):
        trial = ""  # a trial without its drawing is still analysed
    outcome, reason, is_fault = ended["outcome"], ended["error"], bool(ended.get("traceback"))
    kind = {
        "refused": "" if trial else ", of several",
        "failed": "" if is_fault else ", of the system",
    }
    remedy = ended.get("remedy") or WHAT_TO_DO[outcome + kind.get(outcome, "")].format(
        log=job["log"]
    )
    # the first is the cause, unless the reason names another
    files = [*files_read(job), *job["files"]]
    file = next((file for file in files if file in reason), files[0] if files else "")
    return Refusal(trial, file, job["command"], outcome, reason, remedy)


def files_read(job: Job) -> list[str]:
    """The recordings of a job, and the trials that it reads."""
    inputs, row = job["input"], job["settings"].get("row") or {}
    raw = [
        Path(job["settings"]["raw_folder"], row[role]) for role in ("log", "mocap") if row.get(role)
    ]
    return [str(file) for file in (*raw, inputs.get("trial"), inputs.get("crossing")) if file]


def died(request: Path, pid: int, number: int) -> None:
    """End a job whose process a signal killed: leave records, so that other jobs go on, and no
    half-written file."""
    job = read_request(request)
    for path in map(Path, job["files"]):
        temporary_path(path, pid).unlink(missing_ok=True)
    known = {int(one): one.name for one in signal.Signals}
    name, file = known.get(number, ""), next(iter(files_read(job)), "")
    ended = {"job": job["command"], "outcome": "died"}
    if file and name in CRASHES:  # the next run would crash again
        said = f"{file}: a library that reads it crashed (signal {number}, {name})"
        ended |= {
            "outcome": "refused",
            "error": said,
            "remedy": "the file may be damaged: copy, export or record it again",
        }
    else:
        by = f"signal {number}, {name}" if name else "from outside"
        ended["error"] = f"the process of this job was killed ({by})"
    end(job, ended)
