# SPDX-License-Identifier: Apache-2.0
"""What the workflow reads and sets of Snakemake that its documentation does not promise. No
attribute of a class is replaced.

A test compares the installed release with `TRIED`: with a newer one, try the workflow, also as a
module and without options, and then raise the second of them.
"""

import os
import sys
from pathlib import Path
from typing import Any

TRIED = ("9.19", "9.27")
"""The oldest and the newest release of Snakemake with which all of this was tried."""
USUAL_LOOKS = (100, 1)
"""Jobs that Snakemake starts at most, and in how many seconds, unless its command line says so."""
FEWEST_REPEATS = 20
"""Equal parts at the end of a name from which Snakemake takes it for a rule that asks for its own
output without an end (`PeriodicityDetector`)."""


def configuration_files(workflow: Any) -> list[Path]:
    """The files that Snakemake merges into `config`, which does not tell the line of a field, as a
    message does. Later ones override earlier ones: those that a workflow names come first."""
    by_precedence = sorted(workflow.configfiles, key=workflow.overwrite_configfiles.__contains__)
    return [Path(os.path.relpath(file)) for file in by_precedence]


def has_prefix(workflow: Any) -> bool:
    """Whether a workflow that has this one as a module puts a folder before its files."""
    return bool(getattr(workflow.modifier.path_modifier, "prefix", None))


def repeated_end(name: str) -> str:
    """The part that Snakemake takes a name to repeat at its end; empty for none."""
    for length in range(1, len(name) // FEWEST_REPEATS + 1):
        part = name[-length:]
        if name.endswith(part * FEWEST_REPEATS):
            return part
    return ""


def look_for_jobs_at_once(workflow: Any) -> None:
    """Take the usual limit of jobs a second off the scheduler of this run, an instance.

    With it each look for jobs asks for another one a second later, so that N jobs make N looks a
    second. No option switches it off. 500 jobs took 3.2 core-s without it, 5.1 with
    `--max-jobs-per-timespan 100000/1s`; a longer span delays the exit, since its timers are no
    daemons.
    """
    limit = workflow.scheduling_settings.max_jobs_per_timespan
    if workflow.local_exec and limit and (limit.max_jobs, limit.timespan) == USUAL_LOOKS:
        workflow.scheduler.job_rate_limiter = None


def say_what_to_state(workflow: Any) -> None:
    """Say what makes jobs faster, where Snakemake would start a Snakemake for each `run:` block."""
    settings = workflow.execution_settings
    if settings is None or workflow.use_threads or not workflow.is_main_process:
        return
    sys.stderr.write(
        "slow: each job starts a Snakemake of its own; state `--force-use-threads`, or a profile of"
        " this workflow, as docs/install.md says\n"
    )


def parallel_jobs(workflow: Any) -> int:
    """How many jobs of one core may run at once here."""
    return min(workflow.resource_settings.cores or 1, os.cpu_count() or 1)
