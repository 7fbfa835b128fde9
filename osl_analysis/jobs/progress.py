"""The progress of a run: a line per stage with count, rate and time left, and what was refused as soon as it is.

It is a logger of Snakemake (`snakemake_logger_plugin_osl`), whose own lines, five per job, come with `--verbose` only.
"""

import re
import shutil
import sys
import threading
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from logging import INFO, WARNING, LogRecord
from pathlib import Path
from typing import TextIO

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from osl_analysis.errors import printable
from osl_analysis.jobs.job_log import read_log

STAGES = {
    "simulate": r"simulate_|trial_sheet",
    "read and check recordings": r"ingest",
    "fit": r"fit_|compare_|pool_|calibrate_|identify_|measure_|analyse_|select_|average_|summarise_|impedance_over",
    "figures": r"plot_numbers|draw_figure|captions",
    "study": r"study",
    "tables and page": r"",
}
"""By stage: what the names of its rules begin with, behind the prefix of a module. The first that fits counts."""
NOT_TOLD = re.compile(
    r"Building DAG|Assuming unrestricted|Using |Provided cores|Rules claiming|Select jobs|Execute \d|Complete log|"
    r"Elapsed time|host: |Finished job|SNAKEMAKE|\s*$"
)
"""What lines of Snakemake begin with that tell a user nothing."""
CLEARED = "\r\x1b[K"


@dataclass
class Stage:
    """Jobs of one kind."""

    total: int
    done: int = 0
    started: float | None = None  # When its first job began [s].

    def text(self, name: str, now: float) -> str:
        """Count, rate and time left."""
        spent = now - (now if self.started is None else self.started)
        counted = f"{name} {self.done}/{self.total}"
        if self.done == self.total:
            return f"{counted} in {spent:.0f} s"
        if not self.done or spent <= 0:
            return counted
        rate = self.done / spent
        return f"{counted}, {rate:.3g}/s, {(self.total - self.done) / rate:.0f} s left"


def stage_of(rule: str) -> str:
    """The stage of a rule."""
    return next(name for name, begins in STAGES.items() if re.search(f"(^|_)({begins})", rule))


@dataclass
class Progress:
    """The lines of a run."""

    out: TextIO
    is_terminal: bool
    stages: dict[str, Stage] = field(default_factory=dict)
    jobs: dict[int, tuple[str, list[Path]]] = field(default_factory=dict)
    """Stage and logs of the jobs that run, by their numbers."""
    last: float = 0.0  # When something was written last [s].

    def plan(self, jobs_of_rules: Mapping[str, int]) -> None:
        """Learn how many jobs each rule has; what has none of its own stages, as the target, does not count."""
        for rule, count in jobs_of_rules.items():
            if not re.fullmatch(r"total|(\w+_)?(reproduce-all|study|validate)", rule):
                self.stages.setdefault(stage_of(rule), Stage(0)).total += count

    def begin(self, job: int, rule: str, logs: Iterable[str]) -> None:
        """A job begins."""
        name = stage_of(rule)
        self.jobs[job] = (name, [Path(log) for log in logs])
        stage = self.stages.get(name)
        if stage is not None and stage.started is None:
            stage.started = time.monotonic()

    def finish(self, job: int) -> None:
        """A job has ended: count it, and say at once what it refused."""
        name, logs = self.jobs.pop(job, ("", []))
        stage = self.stages.get(name)
        if stage is None:
            return
        stage.done += 1
        for log in logs:
            ended = read_log(log)
            if ended is not None and ended.outcome in ("refused", "failed", "died"):
                self.line(f"{ended.outcome}: {log.stem}: {printable(ended.error)}")
        self.show(name, stage)

    def show(self, name: str, stage: Stage) -> None:
        """Draw what runs on the last line of a terminal; elsewhere, a line now and then, and one for a whole stage."""
        now, spent = time.monotonic(), time.monotonic() - self.last
        if stage.done == stage.total:
            self.line(stage.text(name, now))
        elif self.is_terminal and spent > 0.1:
            running = {stage for stage, _ in self.jobs.values()} | {name}
            text = " | ".join(
                self.stages[one].text(one, now) for one in STAGES if one in running and one in self.stages
            )
            self.write(f"{CLEARED}{text[: shutil.get_terminal_size().columns - 1]}")
        elif not self.is_terminal and spent > 10:
            self.line(stage.text(name, now))

    def line(self, text: str) -> None:
        """A line that stays."""
        self.write(f"{CLEARED if self.is_terminal else ''}{text}\n")

    def write(self, text: str) -> None:
        self.out.write(text)
        self.out.flush()
        self.last = time.monotonic()


def forget_timers(kept: int) -> None:
    """End the timers of Snakemake's scheduler but for the newest ones.

    For its limit on how many jobs may start in a second, each choice of jobs ends with a timer that makes it choose
    again, which ends with a timer: after n jobs it looks at all ready jobs n times per second, for nothing.
    """
    timers = [one for one in threading.enumerate() if isinstance(one, threading.Timer)]
    timers = [one for one in timers if one.function.__module__ == "snakemake.scheduling.job_scheduler"]
    for one in timers[: len(timers) - kept]:
        one.cancel()


class LogHandler(LogHandlerBase):
    """Snakemake's records as the lines of `Progress`; with `--verbose`, or in a dry run, Snakemake writes its own."""

    writes_to_file = False  # Snakemake's log file stays as it is
    has_filter = True  # it chooses by itself
    has_formatter = False  # errors look as those of Snakemake
    needs_rulegraph = False

    def __post_init__(self) -> None:
        self.progress = Progress(sys.stderr, sys.stderr.isatty())
        self.is_quiet = not (self.common_settings.verbose or self.common_settings.dryrun)

    def emit(self, record: LogRecord) -> None:
        """Take one record. A line that cannot be written must not end the thread that takes them."""
        event, known = getattr(record, "event", None), record.__dict__
        if event == LogEvent.JOB_STARTED:
            forget_timers(1)
        elif event == LogEvent.PROGRESS and known["done"] == known["total"]:
            forget_timers(0)
        if self.is_quiet:
            try:
                self.take(record)
            except Exception:
                self.handleError(record)

    def take(self, record: LogRecord) -> None:
        """Plan, count, or write."""
        event, known = getattr(record, "event", None), record.__dict__
        if event == LogEvent.RUN_INFO:
            self.progress.plan(known["stats"])
        elif event == LogEvent.JOB_INFO:
            self.progress.begin(known["jobid"], known["rule_name"], known["log"] or ())
        elif event == LogEvent.JOB_FINISHED:
            self.progress.finish(known["job_id"])
        elif record.levelno >= WARNING or (event is None and record.levelno >= INFO):
            text = self.format(record)
            if not NOT_TOLD.match(text):
                self.progress.line(text)

    @property
    def writes_to_stream(self) -> bool:
        """It takes the place of Snakemake's own lines."""
        return self.is_quiet
