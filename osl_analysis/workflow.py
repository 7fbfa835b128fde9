"""How the Snakefile runs our commands: each job in a process forked from one that has done the imports.

Starting Python with numpy, scipy and polars costs 0.8 s a job; forking a process that has them costs 0.05 s.
A job is still a process of its own: what it breaks stays in it.
"""

import ast
import hashlib
import importlib
import multiprocessing
import os
import time
import traceback
from collections import defaultdict
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from osl_analysis.errors import OslAnalysisError

PACKAGE = Path(__file__).parent
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

DONE = "done"

seconds_spent: dict[str, float] = defaultdict(float)
jobs_done: dict[str, int] = defaultdict(int)
failures: list[str] = []


class JobError(OslAnalysisError):
    """A job failed; the message is its one-line reason, or points to the log with the traceback."""


def run_job(log: str, command: str, **arguments: Any) -> None:
    """Call `command`, "module.function" under `osl_analysis.commands`, in a process of its own; waits for it.

    The log tells how it ended: `DONE` is the last thing that a job writes, after its results.

    Raises
    ------
    JobError
        The command raised, or its process died.
    """
    started, path = time.perf_counter(), Path(log)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("")
    process = fork_server().Process(target=_call, args=(path, command, arguments), daemon=True)
    process.start()
    process.join()
    name = command.partition(".")[0]
    seconds_spent[name] += time.perf_counter() - started
    jobs_done[name] += 1
    outcome = path.read_text().strip()
    if outcome != DONE:
        failures.append(outcome.splitlines()[-1] if outcome else f"{command}: its process died ({process.exitcode})")
        raise JobError(failures[-1])


@cache
def fork_server() -> multiprocessing.context.ForkServerContext:
    """The process that the jobs fork from; every job computes on one thread, for Snakemake counts cores by jobs."""
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    return context


def _call(log: Path, command: str, arguments: dict[str, Any]) -> None:
    """In the job's process: a user's mistake becomes one line of the log, anything else a traceback."""
    module, _, function = command.partition(".")
    try:
        getattr(importlib.import_module(f"osl_analysis.commands.{module}"), function)(**arguments)
        log.write_text(f"{DONE}\n")
    except OslAnalysisError as error:
        log.write_text(f"error: {error}\n")
    except Exception as error:
        trace = traceback.format_exc()
        log.write_text(f"{trace}\nunexpected {type(error).__name__}: {error} (the traceback is in {log})\n")


def failure_report() -> str:
    """Why jobs failed, a line each, and what that means for the rest; empty if none did."""
    if not failures:
        return ""
    return "\n".join(
        [
            "what failed:",
            *dict.fromkeys(failures),
            "tables and figures that need these were not renewed; mend the input, or give a reason under `exclude` in "
            "the sample sheet, and run again",
        ]
    )


def time_table() -> str:
    """Where the time went: wall time of the jobs of each stage, summed over the cores."""
    rows = sorted(seconds_spent, key=lambda name: -seconds_spent[name])
    lines = [f"{name:<16}{jobs_done[name]:>6} jobs{seconds_spent[name]:>9.1f} s" for name in rows]
    return "\n".join(["where the time went (summed over cores):", *lines])


@cache
def code(*modules: str) -> str:
    """Fingerprint of the source of modules under `osl_analysis`, and of all modules of ours that they import.

    Snakemake does not see a change in an imported module. As a parameter of a rule, the fingerprint makes a changed
    estimator rerun the jobs that use it, and no others.
    """
    return fingerprint({path for module in modules for path in sources(f"osl_analysis.{module}")})


@cache
def code_of(command: str) -> str:
    """The same for a command, `module.function` under `osl_analysis.commands`.

    Beside the module's own file, only what the function uses counts: a module has the jobs of several experiments.
    """
    module, _, function = command.partition(".")
    return fingerprint(job_sources(f"osl_analysis.commands.{module}", function))


def fingerprint(files: Iterable[Path]) -> str:
    """Digest of the content of source files."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(files))).hexdigest()[:16]


def job_sources(module: str, function: str) -> set[Path]:
    """The file of a module, and the files behind the imported names that one of its functions uses."""
    path = module_file(module)
    top = ast.parse(path.read_text(encoding="utf-8")).body if path else []
    defined = {getattr(node, "name", ""): node for node in top}
    if path is None or function not in defined:
        raise JobError(f"no function {function} in {module}; correct the name of the job in the rules")
    used, waiting = set[str](), {function}
    while waiting:
        used |= waiting
        inside = [ast.walk(defined[name]) for name in waiting if name in defined]
        waiting = {node.id for nodes in inside for node in nodes if isinstance(node, ast.Name)} - used
    imports = [(node.module, alias.name) for node in top if isinstance(node, ast.ImportFrom) for alias in node.names]
    names = [f"{source}{end}" for source, name in imports if name in used for end in ("", f".{name}")]
    return {path, *(file for name in names if name.startswith("osl_analysis.") for file in sources(name))}


def sources(module: str) -> list[Path]:
    """Files of a module of ours and of all of ours that it imports, sorted."""
    found: set[Path] = set()
    waiting = [module_file(module)]
    while waiting:
        path = waiting.pop()
        if path is not None and path not in found:
            found.add(path)
            waiting += [module_file(name) for name in imported_names(path)]
    return sorted(found)


@cache
def imported_names(path: Path) -> tuple[str, ...]:
    """Dotted names of ours that a source file imports, anywhere in it."""
    names: list[str] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(name for name in names if name.startswith("osl_analysis."))


def module_file(name: str) -> Path | None:
    """File of a dotted module name of ours; None where the name is not a module."""
    path = PACKAGE.joinpath(*name.split(".")[1:])
    return next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)
