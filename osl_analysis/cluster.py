"""A campaign on a cluster: which jobs one submission takes, and what stands in place of the results of a lost one.

Every submission pays for a queue and for a start. So a submission takes the jobs of many trials: those of a `group` of
the rules, as many trials at a time as `group-components` in the profile says. In the submission one Snakemake runs
them as a local run does. Each keeps its own process, log, refusal record and time, and trials can be run singly.
"""

import math
import re
import time
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from glob import escape
from itertools import pairwise
from pathlib import Path
from typing import Any

from snakemake_interface_common.exceptions import WorkflowError

from osl_analysis.errors import OslAnalysisError, printable
from osl_analysis.job_log import read_log
from osl_analysis.refusal import Refusal, write_refusals

STARTING_S, STARTING_MB = 60.0, 600
"""What a submission takes beside its jobs: Snakemake, and the process from which jobs are forked [s, MB]."""
MARGIN = 3.0
"""Time limit of a submission over the time that is expected of it."""
UNREACHABLE_S = 600.0
"""Time without an answer of the cluster after which a run ends [s]."""
IN_SUBMISSION = "--executor local --force-use-threads --keep-going --quiet rules host"
"""Options of the Snakemake in a submission, in place of those by which it would submit each job once more."""
STATE = re.compile(r"status is: '(\w+)'")
REMEDY = "run again: what the submission had finished stays"
REMEDIES = {
    "TIMEOUT": "state more time (`core_ms`) or fewer trials (`group-components`) in the profile; run again",
    "OUT_OF_MEMORY": "state more memory (`mem_mb`) in the profile; run again",
}
"""By SLURM's state of a lost submission."""
LOST: list[Refusal] = []
"""Causes of what was lost in this run. A full disk has no room for their records."""


def submit_in_batches(workflow: Any, trials: Sequence[str], recorded_mb: Callable[[str], float]) -> None:
    """Let Snakemake's executors that submit jobs take many jobs at a time; local runs stay as they are.

    `trials`: those of the campaign, in the order in which they are taken together. `recorded_mb`: size of a trial's
    recordings [MB]. What is in no group of the rules runs where Snakemake runs.
    """
    prepare, execute = workflow._prepare_dag, workflow.execute
    workflow.localrules(*(rule.name for rule in workflow.rules if rule.group is None))

    def prepared(*args: Any, **settings: Any) -> None:
        prepare(*args, **settings)
        if not workflow.local_exec:
            group_by_trials(workflow, trials, recorded_mb)
            return
        for rule in workflow.rules:
            rule.group = None

    def executed(*args: Any, **settings: Any) -> None:
        plugin = settings["executor_plugin"]
        if plugin.common_settings.non_local_exec and workflow.is_main_process:
            adapt(plugin.executor, lambda *lost: LOST.extend(record_lost(*lost)))
        execute(*args, **settings)

    workflow._prepare_dag, workflow.execute = prepared, executed


def group_by_trials(workflow: Any, trials: Sequence[str], recorded_mb: Callable[[str], float]) -> None:
    """Let one submission take the jobs of a group for `group-components` trials, in the order of `trials`.

    `recorded_mb`: size of a trial's recordings [MB].

    It replaces Snakemake's own grouping, which takes connected jobs in any order and takes time with the square of
    their number. The rules see to it that no job outside a group lies between two jobs of it.
    """
    dag, order = workflow.dag, {trial: number for number, trial in enumerate(trials)}

    def update_groups() -> None:
        dag._group, sizes = {}, {trial: recorded_mb(trial) for trial in trials}
        most = workflow.group_settings.group_components
        for name, parts in members(dag.needrun_jobs(), order).items():
            for batch in batches(parts, most.get(name, 1)):
                submission = dag.group_job_factory.new(name, batch, workflow.global_resources)
                submission.finalize()
                submission._resources = resources(batch, workflow.resource_settings.cores or 1, sizes)
                dag._group.update(dict.fromkeys(batch, submission))

    dag.update_groups = update_groups


def members(jobs: Iterable[Any], order: Mapping[str, int]) -> dict[str, list[list[Any]]]:
    """The jobs of every group, those of one trial together, in this order; without a trial, those of equal wildcards.

    Jobs without a group are left out.
    """
    found: dict[str, dict[tuple[int, str], list[Any]]] = defaultdict(lambda: defaultdict(list))
    for job in jobs:
        if job.group is not None:
            name = job.wildcards_dict.get("trial")
            key = (order.get(name, -1), "") if name else (-1, str(sorted(job.wildcards_dict.items())))
            found[job.group][key].append(job)
    return {group: [parts[key] for key in sorted(parts)] for group, parts in found.items()}


def batches(parts: Sequence[list[Any]], most: int) -> list[list[Any]]:
    """The jobs of at most so many parts together, as equal in number as can be, in the order given."""
    number = math.ceil(len(parts) / most)
    edges = [len(parts) * n // number for n in range(number + 1)]
    return [[job for part in parts[a:b] for job in part] for a, b in pairwise(edges)]


def resources(jobs: Sequence[Any], cores: int, sizes: Mapping[str, float]) -> dict[str, Any]:
    """Cores, memory [MB] and time limit [min] of a submission that runs at most `cores` of these jobs at a time.

    `sizes`: of each trial's recordings [MB]. The profile states what one job of a rule takes, `mem_mb` and `core_ms`,
    and what each MB of its trials' recordings adds to it (`_per_mb`). Text values, as a partition, are the first job's.
    """
    taken = [(job.resources, sum(sizes.get(trial, 0) for trial in trials_of(job, sizes))) for job in jobs]
    memory, busy = (
        [amount(use, name) + amount(use, f"{name}_per_mb") * mb for use, mb in taken] for name in ("mem_mb", "core_ms")
    )
    cores = min(cores, len(jobs))
    minutes = (STARTING_S + MARGIN * max(sum(busy) / cores, *busy) / 1000) / 60
    texts = {name: value for name, value in taken[0][0].items() if isinstance(value, str) and name != "tmpdir"}
    mb = STARTING_MB + cores * math.ceil(max(memory))
    return texts | {"_cores": cores, "_nodes": 1, "mem_mb": mb, "runtime": math.ceil(minutes)}


def amount(use: Mapping[str, Any], name: str) -> int:
    """A resource that is a number; 0 without it, and if it is not known before its job runs."""
    value = use.get(name, 0)
    return value if isinstance(value, int) else 0


def trials_of(job: Any, trials: Mapping[str, Any]) -> Iterable[str]:
    """A job's trial, or those of whose results it names files; all `trials` if it names none of theirs, as the page."""
    own = job.wildcards_dict.get("trial")
    return [own] if own else {Path(str(file)).stem for file in job.input} & trials.keys() or trials


def adapt(executor: Any, lost: Callable[[Any, str, str], None]) -> None:
    """Let a class of executors that submit jobs run a submission as a local run does, and go on after a lost one.

    `lost` is called with the submission, its number in the cluster and what is known of its end.

    Results are removed before they are made anew, as in a local run: what stands there later is the submission's.
    A plug-in that asks for the state of all its jobs at once can do so at a steady pace; SLURM's waits 10 s longer each
    time. It also forgets its jobs if it gets no answer (`asked_again`).
    """
    before, error, success = executor.run_job_pre, executor.report_job_error, executor.report_job_success
    ended: list[Any] = []

    def removed_before(self: Any, job: Any) -> None:
        for one in jobs_of(job):
            for file in (*one.output, *one.log):
                Path(str(file)).unlink(missing_ok=True)
        before(self, job)

    def reported(self: Any, info: Any, msg: str | None = None, **more: Any) -> None:
        if info.external_jobid is None:  # it was not taken by the cluster: others will not be either
            error(self, info, msg, **more)
            return
        lost(info.job, info.external_jobid, msg or "")
        self.report_job_success(info)

    def ended_well(self: Any, info: Any) -> None:
        ended.append(info)
        success(self, info)

    executor.run_job_pre = removed_before
    executor.report_job_error = reported
    executor.report_job_success = ended_well
    executor.check_active_jobs = asked_again(executor.check_active_jobs, ended)
    executor.additional_general_args = lambda self: IN_SUBMISSION
    executor.next_seconds_between_status_checks = property(
        lambda self: self.workflow.remote_execution_settings.seconds_between_status_checks, lambda self, _: None
    )


def asked_again(check: Callable[..., AsyncIterator[Any]], ended: list[Any]) -> Callable[..., AsyncIterator[Any]]:
    """The check of an executor for submissions that still run, with those that it was told nothing of.

    `ended` has those whose end the check reported. Without an answer SLURM's plug-in yields and reports none, so that
    Snakemake would wait for them without end, even if SLURM answers later.

    Raises `WorkflowError`, which ends the run, if there is no answer for `UNREACHABLE_S`.
    """
    silent_since = math.inf

    async def checked(self: Any, active: Sequence[Any]) -> AsyncIterator[Any]:
        nonlocal silent_since
        running = [info async for info in check(self, active)]
        told = {id(info) for info in (*running, *ended)}
        ended.clear()
        untold, now = [info for info in active if id(info) not in told], time.monotonic()
        if not untold:
            silent_since = math.inf
        elif silent_since == math.inf:
            silent_since = now
            self.logger.warning(f"the cluster does not answer: waiting, for at most {UNREACHABLE_S / 60:.0f} min")
        elif now - silent_since > UNREACHABLE_S:
            numbers = ", ".join(str(info.external_jobid) for info in untold)
            raise WorkflowError(
                f"the cluster has not answered (squeue, sacct) for {(now - silent_since) / 60:.0f} min: the end of its "
                f"jobs {numbers} is not known; remedy: when squeue answers and has none of them, run again"
            )
        for info in (*running, *untold):
            yield info

    return checked


def jobs_of(submission: Any) -> list[Any]:
    """The jobs of a submission: of a group of jobs, or one job."""
    return list(submission) if submission.is_group() else [submission]


def record_lost(submission: Any, number: str, said: str) -> tuple[Refusal, ...]:
    """Leave refusal records in place of the results that a lost submission has not made; their causes, one per trial.

    A job came to its end if its results and its log are there, and it was not killed. Temporary files of the others are
    deleted.
    """
    state = STATE.search(said)
    why = state[1] if state else printable(said.strip().partition("\n")[0]) or "no reason is known"
    causes: dict[str, Refusal] = {}
    for job in jobs_of(submission):
        files = [Path(str(file)) for file in job.output]
        if all(map(Path.exists, files)) and all(was_ended(Path(str(log))) for log in job.log):
            continue
        trial = job.wildcards_dict.get("trial") or ""
        reason = f"the cluster's job {number} was lost ({why})"
        cause = Refusal(trial, str(files[0]), job.rule.name, "died", reason, REMEDIES.get(why, REMEDY))
        cause = causes.setdefault(trial or cause.file, cause)
        for file in files:
            for left in file.parent.glob(f".{escape(file.stem)}.*{escape(file.suffix)}"):
                left.unlink(missing_ok=True)
            with suppress(OslAnalysisError, OSError):  # a full disk: Snakemake finds the file missing
                write_refusals([replace(cause)], file)
    return tuple(causes.values())


def was_ended(log: Path) -> bool:
    """Whether the job of a log came to its end by itself."""
    said = read_log(log)
    return said is not None and said.outcome != "died"
