"""How a submission to a cluster is run, asked for and named if it is lost: Snakemake's executors, adapted."""

import math
import re
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from glob import escape
from pathlib import Path
from typing import Any

from snakemake_interface_common.exceptions import WorkflowError
from snakemake_interface_executor_plugins.executors.base import SubmittedJobInfo

from osl_analysis.errors import OslAnalysisError, printable
from osl_analysis.job_log import read_log
from osl_analysis.refusal import Refusal, write_refusals

UNREACHABLE_S = 600.0
"""Time without an answer of the cluster after which a run ends [s]."""
SOONEST_S, SHARE = 1.0, 0.1
"""Between two questions for states: at least so long [s], and this share of the time for which nothing has changed."""
IN_SUBMISSION = "--executor local --force-use-threads --keep-going --quiet rules host"
"""Options of the Snakemake in a submission, in place of those by which it would submit each job once more."""
STATE = re.compile(r"status is: '(\w+)'")
SAID_BY_SBATCH = re.compile(r"sbatch: error: (?:Batch job submission failed: )?(.+?)'?\.?$", re.MULTILINE)
ERROR = re.compile(r"^(?:\w+\.)*(\w+(?:Error|Exception): .+)", re.MULTILINE)
"""The first of the output of a submission that failed as a whole, as where its disk is full."""
REMEDY = "run again: what the submission had finished stays"
REMEDIES = {
    "TIMEOUT": "state more time (`core_ms`) or fewer trials (`group-components`) in the profile; run again",
    "OUT_OF_MEMORY": "state more memory (`mem_mb`) in the profile; run again",
}
"""By SLURM's state of a lost submission."""
NOT_TAKEN = "run again when the cluster takes it (`sinfo`), or ask for less in the profile"
LOST: list[Refusal] = []
"""Causes of what was lost in this run. A full disk has no room for their records."""


def adapt(executor: Any, lost: Callable[[Any, str | None, str, Path | None], None]) -> None:
    """Let a class of executors that submit jobs run a submission as a local run does, and go on after a lost one.

    `lost` is called with the submission, its number in the cluster (None: it was not taken), what is known of its end,
    and the file of its output.

    Results are removed before they are made anew, as in a local run: what stands there later is the submission's.
    SLURM's plug-in asks for states ever more rarely, and forgets its jobs if it gets no answer (`asked_again`). It
    submits in threads of its own, in which an exception is lost: Snakemake would wait for the submission without end.

    Where there is no room for refusal records, as on a full disk, what needs the results is not run. Snakemake would
    wait for every missing file, and then delete what the submission has finished. Our results are whole or absent.
    """
    before, submit, success = executor.run_job_pre, executor.run_job, executor.report_job_success
    taken = executor.report_job_submission
    ended: list[Any] = []

    def removed_before(self: Any, job: Any) -> None:
        for one in jobs_of(job):
            for file in (*one.output, *one.log):
                Path(str(file)).unlink(missing_ok=True)
        before(self, job)

    def submitted(self: Any, job: Any) -> None:
        try:
            submit(self, job)
        except Exception as fault:  # the plug-in's own handler fails, for want of a rule that a submission has not
            self.report_job_error(SubmittedJobInfo(job), msg=str(fault.__context__ or fault))

    def reported(self: Any, info: Any, msg: str | None = None, **more: Any) -> None:
        lost(info.job, info.external_jobid, msg or "", (info.aux or {}).get("slurm_logfile"))
        if all(Path(str(file)).exists() for one in jobs_of(info.job) for file in one.output):
            self.report_job_success(info)
            return
        ended.append(info)
        self.workflow.execution_settings.keep_incomplete = True
        self.workflow.scheduler.error_callback(info.job)

    def changes(self: Any, info: Any, *more: Any, **options: Any) -> None:
        self.changed_at = time.monotonic()
        taken(self, info, *more, **options)

    def ended_well(self: Any, info: Any) -> None:
        self.changed_at = time.monotonic()
        ended.append(info)
        success(self, info)

    def pace(self: Any) -> float:
        unchanged = time.monotonic() - float(self.changed_at)
        longest = float(self.workflow.remote_execution_settings.seconds_between_status_checks)
        return min(max(SHARE * unchanged, SOONEST_S), longest)

    executor.changed_at = time.monotonic()
    executor.run_job_pre = removed_before
    executor.run_job = submitted
    executor.report_job_submission = changes
    executor.report_job_error = reported
    executor.report_job_success = ended_well
    executor.check_active_jobs = asked_again(executor.check_active_jobs, ended)
    executor.additional_general_args = lambda self: IN_SUBMISSION
    executor.next_seconds_between_status_checks = property(pace, lambda self, _: None)


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


def record_lost(submission: Any, number: str | None, said: str, output: Path | None = None) -> tuple[Refusal, ...]:
    """Leave refusal records in place of the results that a lost submission has not made; their causes.

    Each trial is a cause, and the results over trials are one. `number`: in the cluster; None if the cluster has not
    taken it. `said` and the file `output` tell why.

    A job came to its end if its results and its log are there, and it was not killed. Temporary files of the others are
    deleted.
    """
    why = reason_in(said) or "no reason is known"
    remedy = REMEDIES.get(why, REMEDY) if number else NOT_TAKEN
    if why == "FAILED" and output is not None and output.is_file():
        error = ERROR.search(output.read_text(errors="replace"))
        why += f": {printable(error[1])}" if error else ""
    reason = f"the cluster's job {number} was lost ({why})" if number else f"the cluster did not take its job ({why})"
    causes: dict[str, Refusal] = {}
    for job in jobs_of(submission):
        files = [Path(str(file)) for file in job.output]
        if all(map(Path.exists, files)) and all(was_ended(Path(str(log))) for log in job.log):
            continue
        trial = job.wildcards_dict.get("trial") or ""
        cause = causes.setdefault(trial, Refusal(trial, str(files[0]), job.rule.name, "died", reason, remedy))
        for file in files:
            for left in file.parent.glob(f".{escape(file.stem)}.*{escape(file.suffix)}"):
                left.unlink(missing_ok=True)
            with suppress(OslAnalysisError, OSError):  # a full disk: Snakemake finds the file missing
                write_refusals([replace(cause)], file)
    return tuple(causes.values())


def reason_in(said: str) -> str:
    """SLURM's state of a lost submission, or what `sbatch` says, or a first line, in what an executor says of it."""
    state = STATE.search(said)
    first = printable(said.strip().partition("\n")[0])
    return state[1] if state else "; ".join(SAID_BY_SBATCH.findall(said)) or first


def was_ended(log: Path) -> bool:
    """Whether the job of a log came to its end by itself."""
    said = read_log(log)
    return said is not None and said.outcome != "died"
