"""The progress of a run: a line per stage with count, rate and time left, and what was refused as soon as it is.

It is a logger of Snakemake (`snakemake_logger_plugin_osl`), whose own lines, five per job, come with `--verbose` only.
"""

import re
import shutil
import sys
import time
from logging import INFO, WARNING, LogRecord
from pathlib import Path

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


def stage_of(rule: str) -> str:
    return next(name for name, begins in STAGES.items() if re.search(f"(^|_)({begins})", rule))


class LogHandler(LogHandlerBase):
    """Snakemake's records as the lines of a run; with `--verbose`, or in a dry run, Snakemake writes its own."""

    writes_to_file = False  # Snakemake's log file stays as it is
    has_filter = True  # it chooses by itself
    has_formatter = False  # errors look as those of Snakemake
    needs_rulegraph = False

    def __post_init__(self) -> None:
        self.is_quiet = not (self.common_settings.verbose or self.common_settings.dryrun)
        self.total, self.done = dict[str, int](), dict[str, int]()  # jobs by stage
        self.started: dict[str, float] = {}  # when the first job of a stage began [s]
        self.jobs: dict[int, tuple[str, list[str]]] = {}  # stage and logs of the jobs that run, by their numbers
        self.last = 0.0  # when something was written last [s]

    @property
    def writes_to_stream(self) -> bool:
        """It takes the place of Snakemake's own lines."""
        return self.is_quiet

    def emit(self, record: LogRecord) -> None:
        """Take one record. A line that cannot be written must not end the thread that takes them."""
        event, known = getattr(record, "event", None), record.__dict__
        if not self.is_quiet:
            return
        try:
            if event == LogEvent.RUN_INFO:
                for rule, count in known["stats"].items():  # the targets have no stage
                    if not re.fullmatch(r"total|(\w+_)?(reproduce-all|study|validate)", rule):
                        name = stage_of(rule)
                        self.total[name] = self.total.get(name, 0) + count
                        self.done.setdefault(name, 0)
            elif event == LogEvent.JOB_INFO:
                name = stage_of(known["rule_name"])
                self.jobs[known["jobid"]] = (name, list(known["log"] or ()))
                self.started.setdefault(name, time.monotonic())
            elif event == LogEvent.JOB_FINISHED:
                self.finish(*self.jobs.pop(known["job_id"], ("", [])))
            elif record.levelno >= WARNING or (event is None and record.levelno >= INFO):
                text = self.format(record)
                if not NOT_TOLD.match(text):
                    self.line(text)
        except Exception:
            self.handleError(record)

    def finish(self, name: str, logs: list[str]) -> None:
        """A job has ended: say at once what it refused, and where its stage stands. A terminal has what runs on its
        last line; elsewhere there is a line now and then, and one for a whole stage.
        """
        if name not in self.total:
            return
        self.done[name] += 1
        for log in logs:
            ended = read_log(Path(log))
            if ended is not None and ended["outcome"] in ("refused", "failed", "died"):
                self.line(f"{ended['outcome']}: {Path(log).stem}: {printable(ended['error'])}")
        spent, is_terminal = time.monotonic() - self.last, sys.stderr.isatty()
        if self.done[name] == self.total[name] or (not is_terminal and spent > 10):
            self.line(self.standing(name))
        elif is_terminal and spent > 0.1:
            running = {one for one, _ in self.jobs.values()} | {name}
            text = " | ".join(self.standing(one) for one in STAGES if one in running and one in self.total)
            self.line(text[: shutil.get_terminal_size().columns - 1], end="")

    def standing(self, name: str) -> str:
        """Count, rate and time left of a stage."""
        done, total = self.done[name], self.total[name]
        spent = time.monotonic() - self.started[name]
        if done == total:
            return f"{name} {done}/{total} in {spent:.0f} s"
        if not done or spent <= 0:
            return f"{name} {done}/{total}"
        return f"{name} {done}/{total}, {done / spent:.3g}/s, {(total - done) * spent / done:.0f} s left"

    def line(self, text: str, end: str = "\n") -> None:
        """A line in place of the last one of a terminal; it stays where it has an end."""
        cleared = "\r\x1b[K" if sys.stderr.isatty() else ""
        print(f"{cleared}{text}", file=sys.stderr, end=end, flush=True)
        self.last = time.monotonic()
