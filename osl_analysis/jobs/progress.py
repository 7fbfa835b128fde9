"""The progress of a run: a line per stage with count, rate and time left, and each refusal as soon
as it happens.

This is a logger of Snakemake (`snakemake_logger_plugin_osl`). Snakemake's own five lines per job
need `--verbose`.
"""

import re
import sys
import time
from collections import Counter
from logging import ERROR, INFO, WARNING, LogRecord
from pathlib import Path

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from osl_analysis.errors import printable
from osl_analysis.jobs.job_log import read_log
from osl_analysis.refusal import alike

STAGES = {
    "simulate": r"simulate_|trial_sheet",
    "read and check recordings": r"ingest",
    "fit": (
        r"fit_|compare_|pool_|calibrate_|identify_|measure_|analyse_|select_|average_|summarise_|impedance_over"
    ),
    "figures": r"plot_numbers|draw_figure|captions",
    "tables and page": r"",
}
"""Begin of rule names by stage, without the prefix of a module. The first that fits counts."""
NOT_TOLD = re.compile(
    r"Building DAG|Assuming unrestricted|Using |Provided cores|Rules claiming|Select jobs|Execute"
    r" \d|Complete log|"
    r"Elapsed time|host: |Finished job|SNAKEMAKE|RuleException:\s+OslAnalysisError|\s*$"
)
"""Begin of lines of Snakemake that are left out: they are of no use, or repeat what a job has
said."""
CANNOT_GO_ON = {
    r"LockException.*directory:\n(.+?)\n.*": (
        r"\1: another run is at work here: wait for it; or one that was killed "
        "left its lock: `osl-analysis run` takes it over on the same machine, else `--unlock`"
        " removes it"
    ),
    r"MissingRuleException[^\n]*\nNo rule to produce (.+?) \(if you use.*": (
        r"\1: no result of this campaign has this "
        "name; compare it with the files below its results, or leave it out to make all of them"
    ),
    r".*(?:Write|Input)Error(?: in file [^\n]+)?:\s+([^\n]+).*": r"\1",
    r".*Error: \[Errno (?:5|13|2[78]|30|122)\] ([^\n]+).*": (
        r"\1; make room, or make it writable, and run again"
    ),
}
"""One line in place of the many with which Snakemake ends on such an error. The numbers are errors
of a disk."""


def stage_of(rule: str) -> str:
    return next(name for name, begins in STAGES.items() if re.search(f"(^|_)({begins})", rule))


def in_our_words(text: str) -> str:
    for many, ours in CANNOT_GO_ON.items():
        text = re.sub(rf"\A{many}\Z", f"error: {ours}", text, flags=re.DOTALL)
    return text


class LogHandler(LogHandlerBase):
    """Snakemake's records as the lines of a run. With `--verbose`, or in a dry run, Snakemake
    writes its own."""

    writes_to_file = False  # Snakemake writes its log file itself
    has_filter = True
    has_formatter = False  # errors look like Snakemake's
    needs_rulegraph = False

    def __post_init__(self) -> None:
        self.is_quiet = not (self.common_settings.verbose or self.common_settings.dryrun)
        self.total, self.done = Counter[str](), Counter[str]()  # jobs by stage
        self.started: dict[str, float] = {}  # when the first job of a stage began [s]
        # stage and logs of the jobs that run, by their numbers
        self.jobs: dict[int, tuple[str, list[str]]] = {}
        self.told = set[tuple[str, str]]()  # causes of refusals that stand above
        self.last = time.monotonic()  # when something was written last [s]

    @property
    def writes_to_stream(self) -> bool:
        """Whether this replaces Snakemake's own lines."""
        return self.is_quiet

    def emit(self, record: LogRecord) -> None:
        """Take one record. A line that cannot be written must not end the thread that takes
        them."""
        event, known = getattr(record, "event", None), record.__dict__
        if event == LogEvent.JOB_ERROR and not known["rule_msg"]:  # the job has told its error
            return
        try:
            if not self.is_quiet:
                if (
                    record.levelno >= ERROR
                    and (said := in_our_words(text := self.format(record))) != text
                ):
                    self.line(said)
                return
            if event == LogEvent.RUN_INFO:
                for rule, count in known["stats"].items():  # the targets have no stage
                    if not re.fullmatch(r"total|(\w+_)?reproduce-all", rule):
                        self.total[stage_of(rule)] += count
            elif event == LogEvent.JOB_INFO:
                name = stage_of(known["rule_name"])
                self.jobs[known["jobid"]] = (name, list(known["log"] or ()))
                self.started.setdefault(name, time.monotonic())
            elif event == LogEvent.JOB_FINISHED:
                self.finish(*self.jobs.pop(known["job_id"], ("", [])))
            elif record.levelno >= WARNING or (event is None and record.levelno >= INFO):
                text = in_our_words(self.format(record))
                if not NOT_TOLD.match(text):
                    self.line(text)
        except Exception:
            self.handleError(record)

    def finish(self, name: str, logs: list[str]) -> None:
        """Report an ended job: at once what it refused; from time to time, and at its end, the
        state of its stage."""
        if name not in self.total:
            return
        self.done[name] += 1
        for log in map(Path, logs):
            if (ended := read_log(log)) and ended["outcome"] in ("refused", "failed", "died"):
                said = "; ".join(filter(None, (ended["error"], ended.get("remedy"))))
                kind = ended["outcome"], alike(said, log.stem)
                # the list at the end of the run names the others with this cause
                if kind not in self.told:
                    self.line(f"{ended['outcome']}: {log.stem}: {printable(said)}")
                self.told.add(kind)
        done, total, now = self.done[name], self.total[name], time.monotonic()
        spent = max(now - self.started[name], 1e-3)
        if done == total:
            self.line(f"{name} {done}/{total} in {spent:.0f} s")
        elif now - self.last > 10:
            self.line(
                f"{name} {done}/{total}, {done / spent:.3g}/s, {(total - done) * spent / done:.0f}"
                " s left"
            )

    def line(self, text: str) -> None:
        print(text, file=sys.stderr, flush=True)
        self.last = time.monotonic()
