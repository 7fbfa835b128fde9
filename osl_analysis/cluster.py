"""A campaign on a cluster: which jobs one submission takes, and what it asks for.

Every submission pays for a queue and for a start. So a submission takes the jobs of many trials: those of a `group` of
the rules, as many trials at a time as `group-components` in the profile says. Groups that one submission can take are
taken together, to the end of the campaign: a small campaign is one submission. In the submission one Snakemake runs
the jobs as a local run does. Each keeps its own process, log, refusal record and time, and trials can be run singly.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from osl_analysis.submission import LOST, adapt, record_lost

STARTING_S, STARTING_MB = 60.0, 600
"""What a submission takes beside its jobs: Snakemake, and the process from which jobs are forked [s, MB]."""
USUAL = {"trials": 50, "crossings": 200, "perturbations": 500, "study": 1}
"""`group-components` where the profile states none. Of other groups all jobs are taken together."""
MARGIN = 3.0
"""Time limit of a submission over the time that is expected of it."""


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
        most, needed = USUAL | workflow.group_settings.group_components, list(dag.needrun_jobs())
        for job in needed:
            job.group = job.rule.group
        taken = {name: batches(parts, most.get(name, len(parts))) for name, parts in members(needed, order).items()}
        single = [job for job in needed if job.group is None and not job.rule.norun]
        for name, batch in submissions(taken, single, dag.depending.__getitem__):
            submission = dag.group_job_factory.new(name, batch, workflow.global_resources)
            submission.finalize()
            submission._resources = resources(batch, workflow.resource_settings.cores or 1, sizes)
            type(submission).is_local = False  # Snakemake's is local if one of its jobs is
            dag._group.update(dict.fromkeys(batch, submission))
            for job in batch:
                job.group = name

    dag.update_groups = update_groups


def submissions(
    taken: Mapping[str, list[list[Any]]], single: Iterable[Any], following: Callable[[Any], Iterable[Any]]
) -> list[tuple[str, list[Any]]]:
    """Name and jobs of every submission: of the batches of jobs that each group is taken in, and of jobs of no group.

    Groups of one batch are one submission, if no job of another group follows from theirs, with what does follow from
    them among the jobs `single`; or with all of these, if all groups are. `following` has the jobs that wait for a job.
    """
    last = {name: after(parts[0], following) for name, parts in taken.items() if len(parts) == 1}
    while held := [name for name, jobs in last.items() if any(job.group not in (None, *last) for job in jobs)]:
        for name in held:
            del last[name]
    follow = set().union(*last.values())
    apart = [(name, batch) for name, parts in taken.items() if name not in last for batch in parts]
    together = [job for name in last for job in taken[name][0]]
    together += [job for job in single if not apart or job in follow]
    return [*apart, ("_".join(last), together)] if last else apart


def after(jobs: Iterable[Any], following: Callable[[Any], Iterable[Any]]) -> set[Any]:
    """All jobs that wait for some of these, directly or not."""
    found: set[Any] = set()
    waiting = set(jobs)
    while waiting:
        new = set(following(waiting.pop())) - found
        found |= new
        waiting |= new
    return found


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
    and what each MB of its trials' recordings adds to it (`_per_mb`); a job of no group reads no recordings. Text
    values, as a partition, are the first job's.
    """
    of_trials = [trials_of(job, sizes) if job.rule.group else () for job in jobs]
    taken = [(job.resources, sum(sizes.get(t, 0) for t in of)) for job, of in zip(jobs, of_trials, strict=True)]
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
