"""The progress of a run: a line per stage with count, rate and time left, and each refusal as soon
as it happens.

This is a logger of Snakemake (`snakemake_logger_plugin_osl`). Snakemake's own five lines per job
need `--verbose`.
"""

import sys
import time
from collections import Counter
from collections.abc import Sequence
from logging import WARNING, LogRecord
from pathlib import Path
from typing import NamedTuple

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from osl_analysis.errors import printable, without_particulars
from osl_analysis.jobs.job_log import read_log

STAGES = {
    "simulate": ("simulate_", "trial_sheet"),
    "read and check recordings": ("ingest",),
    "fit": (
        "fit_",
        "compare_",
        "calibrate_",
        "find_",
        "identify_",
        "measure_",
        "analyse_",
        "select_",
        "average_",
        "summarise_",
        "tabulate_",
    ),
    "figures": (
        "plot_numbers",
        "fig3_numbers",
        "fig4_numbers",
        "fig7_numbers",
        "walking_page_numbers",
        "draw_figure",
        "captions",
    ),
}
"""How the names of rules begin, by stage. All other rules make tables and the page."""
TABLES_AND_PAGE = "tables and page"
MESSAGE_BY_EXCEPTION = {
    "LockException": (
        "error: another run is at work in this folder: wait for it; or one that was killed left its"
        " lock: the same command with `--unlock` removes it"
    ),
}
"""What is printed in place of the exception with which Snakemake ends, by its name."""
SHORTEST_WAIT_S = 10.0  # between two lines on the same stage


def stage_of(rule: str) -> str:
    """The stage of a rule; in another workflow that has this one as a module, `osl_` stands before
    its name."""
    for stage, begins in STAGES.items():
        if any(rule.startswith(begin) or f"_{begin}" in rule for begin in begins):
            return stage
    return TABLES_AND_PAGE


class RunningJob(NamedTuple):
    stage: str
    logs: Sequence[str]


class LogHandler(LogHandlerBase):
    """Snakemake's records as the lines of a run. With `--verbose`, or in a dry run, Snakemake
    writes its own."""

    writes_to_file = False  # Snakemake writes its log file itself
    has_filter = True
    has_formatter = False  # errors look like Snakemake's
    needs_rulegraph = False

    def __post_init__(self) -> None:
        self.is_quiet = not (self.common_settings.verbose or self.common_settings.dryrun)
        self.total = Counter[str]()  # jobs by stage
        self.done = Counter[str]()
        self.started_s: dict[str, float] = {}  # when the first job of a stage began
        self.jobs: dict[int, RunningJob] = {}  # by their numbers
        self.printed_causes = set[tuple[str, str]]()  # outcome and text
        self.last_line_s = time.monotonic()  # when something was printed last

    @property
    def writes_to_stream(self) -> bool:
        """Whether this replaces Snakemake's own lines."""
        return self.is_quiet

    def emit(self, record: LogRecord) -> None:
        """Take one record. A line that cannot be written must not end the thread that takes
        them."""
        if not self.is_quiet:
            return
        try:
            self.handle_event(record)
        except Exception:
            self.handleError(record)

    def handle_event(self, record: LogRecord) -> None:
        event = getattr(record, "event", None)
        fields = record.__dict__  # of the event, as Snakemake's `LogEvent` describes them
        if event == LogEvent.RUN_INFO:
            for rule, count in fields["stats"].items():
                if rule != "total" and not rule.endswith("reproduce-all"):  # which has no stage
                    self.total[stage_of(rule)] += count
        elif event == LogEvent.JOB_INFO:
            stage = stage_of(fields["rule_name"])
            self.jobs[fields["jobid"]] = RunningJob(stage, list(fields["log"] or ()))
            self.started_s.setdefault(stage, time.monotonic())
        elif event == LogEvent.JOB_FINISHED and fields["job_id"] in self.jobs:
            self.finish(self.jobs.pop(fields["job_id"]))
        elif event == LogEvent.JOB_ERROR:
            self.print_outcome(list(fields["log"] or ()))
        elif event == LogEvent.ERROR and fields.get("exception") == "RuleException" and self.jobs:
            pass  # a job has told its error
        elif event == LogEvent.ERROR and fields.get("exception") in MESSAGE_BY_EXCEPTION:
            self.print_line(MESSAGE_BY_EXCEPTION[fields["exception"]])
        elif record.levelno >= WARNING:
            self.print_line(self.format(record))

    def finish(self, job: RunningJob) -> None:
        """Report an ended job: at once what it refused; from time to time, and at its end, the
        state of its stage."""
        self.print_outcome(job.logs)
        stage = job.stage
        self.done[stage] += 1
        done = self.done[stage]
        total = self.total[stage]
        now = time.monotonic()
        spent_s = max(now - self.started_s[stage], 1e-3)
        if done == total:
            self.print_line(f"{stage} {done}/{total} in {spent_s:.0f} s")
        elif now - self.last_line_s > SHORTEST_WAIT_S and done < total:
            left_s = (total - done) * spent_s / done
            self.print_line(f"{stage} {done}/{total}, {done / spent_s:.3g}/s, {left_s:.0f} s left")

    def print_outcome(self, logs: Sequence[str]) -> None:
        """A line on each warning of a job, and on one that was refused, has failed or was killed,
        once for each cause: the list at the end of the run names the others."""
        for log in map(Path, logs):
            job_log = read_log(log)
            if job_log is None:
                continue
            for warning in job_log.get("warnings", ()):
                self.print_once("warning", warning, log.stem)
            if job_log["outcome"] not in ("refused", "failed", "killed"):
                continue
            text = "; ".join(filter(None, (job_log["error"], job_log.get("remedy"))))
            self.print_once(job_log["outcome"], text, log.stem)

    def print_once(self, outcome: str, text: str, job: str) -> None:
        cause = (outcome, without_particulars(text, job))
        if cause not in self.printed_causes:
            self.printed_causes.add(cause)
            self.print_line(f"{outcome}: {job}: {printable(text)}")

    def print_line(self, text: str) -> None:
        print(text, file=sys.stderr, flush=True)
        self.last_line_s = time.monotonic()
