# SPDX-License-Identifier: Apache-2.0
"""What the workflow uses of Snakemake that its documentation does not promise.

A test compares the installed release with `TRIED`: with a newer one, try the workflow, also as a
module and without options, and then raise the second of them.
"""

import os
from pathlib import Path
from typing import Any

from snakemake.executors.local import Executor
from snakemake.io import PeriodicityDetector

TRIED = ("9.19", "9.27")
"""The oldest and the newest release of Snakemake with which all of this was tried."""
USUAL_LOOKS = (100, 1)
"""Jobs that Snakemake starts at most, and in how many seconds, unless its command line says so."""


def configuration_files(workflow: Any) -> list[Path]:
    """The files that Snakemake merges into `config`, which does not tell the line of a field, as a
    message does. Later ones override earlier ones: those that a workflow names come first."""
    by_precedence = sorted(workflow.configfiles, key=workflow.overwrite_configfiles.__contains__)
    return [Path(os.path.relpath(file)) for file in by_precedence]


def has_prefix(workflow: Any) -> bool:
    """Whether a workflow that has this one as a module puts a folder before its files."""
    return bool(getattr(workflow.modifier.path_modifier, "prefix", None))


def do_jobs_in_threads() -> None:
    """Have jobs of `run:` done in threads, as by `--force-use-threads`.

    Else each starts a Snakemake of its own, 2 s, for a job that a warm worker does, and params that
    are looked up as a job begins are not those that Snakemake compares in the next run."""
    Executor.use_threads = property(lambda executor: True, lambda executor, stated: None)


def allow_repeated_letters() -> None:
    """Have names that end in twenty equal parts, as a trial `aaaa...`, be names: Snakemake takes
    one for a rule that asks for its own output without an end, and stops. No rule here does."""
    PeriodicityDetector.is_periodic = lambda detector, name: None


def look_for_jobs_at_once(workflow: Any) -> None:
    """Take off the usual limit of jobs a second, by which each look for jobs asks for another one a
    second later: N jobs make N looks a second, a tenth of all core-seconds."""
    limit = workflow.scheduling_settings.max_jobs_per_timespan
    if workflow.local_exec and limit and (limit.max_jobs, limit.timespan) == USUAL_LOOKS:
        workflow.scheduler.job_rate_limiter = None


def parallel_jobs(workflow: Any) -> int:
    """How many jobs of one core may run at once here."""
    return min(workflow.resource_settings.cores or 1, os.cpu_count() or 1)
