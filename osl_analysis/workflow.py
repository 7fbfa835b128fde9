"""How the Snakefile runs the commands: each job in a process that is forked from a process with all imports done.

Starting Python with numpy, scipy and polars takes 0.8 s per job. Forking a process that has imported them takes 0.05 s.
Each job still runs in its own process.
"""

import importlib
import multiprocessing
import os
import time
import traceback
import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, validate_call

from osl_analysis.errors import OslAnalysisError, printable
from osl_analysis.exclusion import without_excluded
from osl_analysis.fingerprint import code, code_of
from osl_analysis.job_log import JobLog, Outcome, plain, read_log, read_logs, run_report, write_log

__all__ = ["code", "code_of", "report", "run_job"]
PRELOADED = [
    "snakemake.cli",  # what a job's __main__, the snakemake script, imports before the job begins
    "osl_analysis.commands.bench",
    "osl_analysis.commands.ingest",
    "osl_analysis.commands.quality",
    "osl_analysis.commands.simulate",
    "osl_analysis.commands.crossing",
    "osl_analysis.commands.walking",
    "osl_analysis.simulator.dynamometer",
    "osl_analysis.simulator.walking",
    "matplotlib.figure",
]
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS", "NUMBA_NUM_THREADS")
FOR_SNAKEMAKE = ("code", "command")
STARTED = time.time()
"""Start of this run [s]. Its report covers the logs that were written after this time."""


class JobError(OslAnalysisError):
    """A job failed; the message is the reason, on one line."""


def run_job(log: Any, command: str, input: Any, output: Any, params: Any) -> None:
    """Run one job in its own process, and wait for it.

    `command` is "module.function" under `osl_analysis.commands`. `log`, `input`, `output` and `params` are those of the
    Snakemake rule. The function is called with the names that the rule gives to its inputs, outputs and parameters:

    * an output without a name is called `output`, several `outputs`;
    * an input without a name is a dependency and not passed on;
    * if an input is called `quality`, the files of the trials that it excludes are removed from the other inputs
      (`without_excluded`);
    * the parameters `code` and `command` are used only by the rule.

    Every value takes the type that the function's signature gives: a path, a settings model, a dataclass.

    Raises
    ------
    JobError
        The command raised an error, or its process died.
    """
    path = Path(str(log))
    request = {"input": named(input), "output": outputs(output), "settings": named(params)}
    path.unlink(missing_ok=True)
    process = fork_server().Process(target=_run, args=(path, command, request), daemon=True)
    process.start()
    process.join()
    ended = read_log(path) if path.is_file() else None
    if ended is None:
        ended = JobLog(command, "died", error=f"{command}: its process died (exit code {process.exitcode})")
        write_log(path, ended, request)
    if ended.outcome != "done":
        raise JobError(ended.error)


def named(items: Any) -> dict[str, Any]:
    """The named items of a rule's inputs, outputs or parameters, as values that can be sent to another process."""
    return {str(name): plain(value) for name, value in items.items() if name not in FOR_SNAKEMAKE}


def outputs(files: Any) -> dict[str, Any]:
    """The outputs of a rule by name."""
    if named(files) or not files:
        return named(files)
    return {"output": plain(files[0])} if len(files) == 1 else {"outputs": plain(list(files))}


@cache
def fork_server() -> multiprocessing.context.ForkServerContext:
    """The process from which jobs are forked. Each job uses one thread, because Snakemake counts one core per job."""
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    return context


def _run(log: Path, command: str, request: Mapping[str, Mapping[str, Any]]) -> None:
    """In the job's process: call the command and write the log, also after an error."""
    start, error, trace = time.perf_counter(), "", ""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        try:
            call(command, request)
        except OslAnalysisError as refusal:
            error = str(refusal)
        except Exception as fault:
            trace = traceback.format_exc()
            error = printable(f"unexpected {type(fault).__name__}: {fault} (the traceback is in {log})")
    warned = dict.fromkeys(printable(str(warning.message)) for warning in caught)
    outcome: Outcome = "failed" if trace else "refused" if error else "done"
    write_log(log, JobLog(command, outcome, time.perf_counter() - start, error, tuple(warned), trace), request)


def call(command: str, request: Mapping[str, Mapping[str, Any]]) -> None:
    """Call a command with the named values of a rule, each converted to the type that the command declares."""
    module, _, name = command.partition(".")
    function = getattr(importlib.import_module(f"osl_analysis.commands.{module}"), name)
    convert = validate_call(config=ConfigDict(arbitrary_types_allowed=True))
    convert(function)(**without_excluded(request["input"]), **request["output"], **request["settings"])


def report(logs: Path) -> str:
    """The report at the end of a run: failures, warnings and times, from the logs of the run's jobs."""
    return run_report(read_logs(logs, STARTED))
