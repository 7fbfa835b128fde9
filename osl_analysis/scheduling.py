"""How Snakemake chooses its jobs: without what takes time in a run on one machine."""

from typing import Any

USUAL_RATE = (100, 1.0)
"""Jobs and time [s] of Snakemake's own limit on how many jobs may start."""


def without_usual_rate(workflow: Any, executor: Any) -> None:
    """Let jobs on this machine start as soon as a core is free. Another rate, that a user asks for, stays.

    Under a limit, Snakemake wakes up one `timespan` after each choice of jobs and chooses again, which ends in one more
    awakening: after n jobs it looks at the inputs of all ready jobs n times per second, for nothing.
    """
    if not executor.common_settings.local_exec:
        return
    limit = workflow.scheduling_settings.max_jobs_per_timespan
    if limit and (limit.max_jobs, limit.timespan) == USUAL_RATE:
        workflow.scheduling_settings.max_jobs_per_timespan = None
