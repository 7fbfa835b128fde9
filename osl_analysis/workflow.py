"""How the Snakefile runs the commands: each job in a process that is forked from a process with all imports done.

Starting Python with numpy, scipy and polars takes 0.8 s per job. Forking a process that has imported them takes 0.05 s.
Each job still runs in its own process. A job that does not end well leaves refusal records in place of its results.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from multiprocessing import connection
from pathlib import Path
from typing import Any

from osl_analysis.fingerprint import code, code_of
from osl_analysis.fork_server import fork_server, without_main
from osl_analysis.job import Job, died, run_uninterrupted
from osl_analysis.job_log import MADE_OF, plain, read_log, read_logs, run_report
from osl_analysis.refusal import failures, forget_failures
from osl_analysis.refusal_report import records_in
from osl_analysis.scheduling import without_usual_rate
from osl_analysis.stale import RECORDED, each_param, made_of, stale

__all__ = [
    "at_end_of_dry_run",
    "at_end_of_run",
    "code",
    "code_of",
    "know_by_logs",
    "report",
    "run_job",
    "say_of_tables",
]
FOR_SNAKEMAKE = ("code", "command", "described", RECORDED)
INTERRUPTED = "interrupted: what had begun was brought to its end; run again to go on from here"
CANCELLED = "interrupted: what was submitted is cancelled; run again to go on from what it had finished"
LONGEST_WAIT_S = 5.0
"""For lines that are to be written before the report [s]."""
ONE_AT_A_TIME = threading.Lock()
"""Starting a process asks which others have ended. An exit code can be read once: of two threads, one gets none."""
STARTED = time.time()
"""Start of this run [s]. Its report covers the logs that were written after this time."""


said_of_tables = {"data": ""}
"""What the data of this workflow's tables are; see `say_of_tables`."""


def say_of_tables(data: str) -> None:
    """Let every table of this workflow say by its column `data` what its data are (`table.tables_of`).

    It is no parameter of the rules: it changes only with the recordings themselves, and then all is made again.
    """
    said_of_tables["data"] = data


def run_job(
    log: Any,
    command: str,
    input: Any,
    output: Any,
    params: Any,
    files: Any = None,
    read: Mapping[str, Any] | None = None,
) -> None:
    """Run one job in its own process, and wait for it.

    `command` is "module.function" under `osl_analysis.commands`. `log`, `input`, `output` and `params` are those of the
    Snakemake rule; `files` are its outputs if `output` is not, because the command finds their names itself. `read`
    are further inputs by name, which were made when `input` was: the results of every trial behind a list or table.
    Snakemake's planning takes time with every file that a rule names. The function is called with the names that the
    rule gives to its inputs, outputs and parameters:

    * an output without a name is called `output`, several `outputs`;
    * an input without a name is a dependency and not passed on; the input `after` is not looked at either;
    * refusal records are removed from the inputs (`without_refused`), and the trials that the input `quality` excludes
      (`without_excluded`);
    * a function with an argument `refused` is given the causes of what was removed, and runs without it. Any other one
      does not run if it lacks something that it needs;
    * the parameters `FOR_SNAKEMAKE` are used only by the rule.

    Every value takes the type that the function's signature gives: a path, a settings model, a dataclass.

    If the job does not end well, refusal records stand in place of all its outputs. Snakemake goes on.
    """
    inputs = named(input)
    after = flat(inputs.pop("after", []))
    unnamed = [] if isinstance(input, Mapping) else sorted(set(map(str, input)) - set(flat(inputs)) - set(after))
    inputs |= named(read or {})
    path, request = Path(str(log)), {"input": inputs, "output": outputs(output), "settings": named(each_param(params))}
    request[MADE_OF] = made_of(flat(input), params)
    files_made = flat(plain(list(files)) if files else request["output"])
    job = Job(command, request, unnamed, files_made, said_of_tables["data"])
    path.unlink(missing_ok=True)
    process = fork_server().Process(target=run_uninterrupted, args=(path, job), daemon=True)
    try:
        with ONE_AT_A_TIME, without_main():
            process.start()
    except (EOFError, OSError):  # the process from which jobs are forked was ended while it started, as by Ctrl-C
        died(path, job, None, None)
        return
    connection.wait([process.sentinel])
    with ONE_AT_A_TIME:
        process.join()
    if not path.is_file() or read_log(path) is None:
        died(path, job, process.pid, process.exitcode)


def named(items: Any) -> dict[str, Any]:
    """The named items of a rule's inputs, outputs or parameters, as values that can be sent to another process."""
    return {str(name): plain(value) for name, value in items.items() if name not in FOR_SNAKEMAKE}


def flat(files: Any) -> list[str]:
    """The paths in a list or mapping of paths, lists and mappings."""
    if isinstance(files, Mapping):
        return flat(list(files.values()))
    return [path for inner in files for path in flat(inner)] if isinstance(files, list | tuple) else [str(files)]


def outputs(files: Any) -> dict[str, Any]:
    """The outputs of a rule by name."""
    if named(files) or not files:
        return named(files)
    return {"output": plain(files[0])} if len(files) == 1 else {"outputs": plain(list(files))}


def know_by_logs(workflow: Any, folders: Collection[Path]) -> None:
    """Let Snakemake make a result again that is missing, or does not hold by the log of its job: also in a dry run.

    Snakemake alone makes nothing again for other settings or recordings if it has no notes in `.snakemake` (`stale`).
    It leaves a missing result alone where what follows from it stands: after a fit that was killed, tables without its
    trial. So does it if no rule names the file as its input (`run_job`, `read`).

    In a dry run the records of failed and killed jobs below the `folders` count as missing: a run would delete them.
    """
    prepare = workflow._prepare_dag

    def prepared(*args: Any, **settings: Any) -> None:
        prepare(*args, **settings)
        notes = workflow.persistence
        noted, compare = notes.has_metadata, notes.params_changed
        failed = set(map(str, failures(folders))) if workflow.dryrun else set()

        def changed(job: Any, file: Any = None) -> Any:
            missing = [output for output in job.output if str(output) in failed or not os.path.exists(output)]
            if missing and job.log:
                notes.dag.reason(job).missing_output.update(missing)
                return False
            found, results = compare(job, file=file), [Path(str(output)) for output in job.output]
            if found or not job.log:
                return found
            why = stale(made_of(job.input, job.params), Path(str(job.log[0])), results, noted(job))
            return type(found)(only_old={why}, files=set(job.output)) if why else found

        notes.has_metadata = lambda job: bool(job.log) or noted(job)  # else Snakemake does not ask `params_changed`
        notes.params_changed = changed

    workflow._prepare_dag = prepared


def report(logs: Path) -> str:
    """The report at the end of a run: failures, warnings and times, from the logs of the run's jobs."""
    return run_report(read_logs(logs, STARTED))


def noticed_interrupt() -> threading.Event:
    """What is set when the user ends the run by Ctrl-C. Snakemake goes on to handle it as it does."""
    pressed = threading.Event()
    handle = signal.getsignal(signal.SIGINT)
    if not callable(handle) or threading.current_thread() is not threading.main_thread():
        return pressed
    go_on: Callable[[int, Any], Any] = handle

    def interrupt(number: int, frame: Any) -> Any:
        pressed.set()
        return go_on(number, frame)

    signal.signal(signal.SIGINT, interrupt)
    return pressed


def write_all_lines(logging: Any) -> None:
    """Wait until the thread that writes Snakemake's lines has written those that wait, so that our report is last."""
    listener, deadline = logging.queue_listener, time.monotonic() + LONGEST_WAIT_S
    while listener is not None and listener.queue.unfinished_tasks and time.monotonic() < deadline:
        time.sleep(0.01)


def at_end_of_run(workflow: Any, folders: Iterable[Path], said: Callable[[tuple[str, ...]], str], accept: bool) -> None:
    """Let a run of Snakemake end with our report, and with exit code 1 if something that was asked for is refused.

    `said` writes the report, from the names of the refusal records among the files that the run was to bring up to
    date. Before the run, the records of failed and killed jobs below the `folders` are deleted. `accept`: refusals do
    not count.

    The hooks `onsuccess` and `onerror` do not serve: they are not called if nothing is left to do, as in the run after
    a refusal. Dry runs, and the runs of single jobs that Snakemake starts, stay as they are.
    """
    execute = workflow.execute

    def executed(*args: Any, **settings: Any) -> None:
        dry = settings["executor_plugin"].common_settings.dryrun_exec
        if dry or not workflow.is_main_process:
            execute(*args, **settings)
            return
        without_usual_rate(workflow, settings["executor_plugin"])
        if not any(Path(".snakemake/locks").glob("*")):
            forget_failures(folders)
        records: tuple[str, ...] = ()
        interrupted = noticed_interrupt()
        try:
            execute(*args, **settings)
        finally:
            if workflow.scheduler is not None:  # else it was not a run: an unknown target, another run's lock
                records = records_in(str(file) for job in workflow.dag.jobs for file in job.output)
                write_all_lines(workflow.logger_manager)
                stopped = INTERRUPTED if settings["executor_plugin"].common_settings.local_exec else CANCELLED
                print(stopped if interrupted.is_set() else said(records), file=sys.stderr, flush=True)
        if records and not accept:
            raise SystemExit(1)

    workflow.execute = executed


def at_end_of_dry_run(workflow: Any, said: Callable[[Iterable[Any]], str]) -> None:
    """Let a dry run of Snakemake end with what `said` says of the jobs that it would run."""
    execute = workflow.execute

    def executed(*args: Any, **settings: Any) -> None:
        execute(*args, **settings)
        if settings["executor_plugin"].common_settings.dryrun_exec:
            text = said(workflow.dag.needrun_jobs(exclude_finished=False))
            write_all_lines(workflow.logger_manager)
            print(text, file=sys.stderr, end="\n" * bool(text), flush=True)

    workflow.execute = executed
