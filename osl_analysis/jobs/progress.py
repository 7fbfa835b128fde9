# SPDX-License-Identifier: Apache-2.0
"""The progress of a run: a line per stage with count, rate and time left, and each refusal as soon
as it happens.

This is a logger of Snakemake (`snakemake_logger_plugin_osl`). Snakemake's own five lines per job
need `--verbose`.
"""

import re
import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from itertools import chain
from logging import WARNING, LogRecord
from pathlib import Path
from typing import Any

import yaml
from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from osl_analysis.base.errors import printable, without_particulars
from osl_analysis.base.files import write_text


def write_log(path: Path, entries: dict[str, Any]) -> None:
    """Write how a job ended, as YAML.

    Entries are the function `job`, its `outcome`, wall time `seconds`, what was wrong in the line
    `error`, the `remedy`, `warnings`, and the `traceback` of an error of the program. Outcomes:
    done; refused, for an input that the user can correct; failed, by an error of the program or of
    the system; killed, ended from outside; skipped, because an input is missing."""
    write_text(
        path,
        yaml.dump(
            entries, Dumper=yaml.CSafeDumper, sort_keys=False, width=1_000_000, allow_unicode=True
        ),
    )


def read_log(path: Path) -> dict[str, Any]:
    """How the job of a log ended; empty if it has written none, as on a full disk, or is a job of
    another workflow."""
    with suppress(OSError, ValueError, TypeError, yaml.YAMLError):
        return {**yaml.load(path.read_bytes(), yaml.CSafeLoader)}
    return {}


def later_failures(summary_json: Path) -> str:
    """Whether jobs of a later run than that of a summary were refused, failed or killed; a line,
    empty if none were. A run ends with its verdict, which tells its own refusals."""
    logs_folder = summary_json.parent / "logs"
    ends = [path for path in (summary_json, logs_folder / "verdict.log") if path.exists()]
    written = max(path.stat().st_mtime for path in ends)
    paths = sorted(logs_folder.rglob("*.log"))
    logs = [read_log(path) for path in paths if path.stat().st_mtime > written]
    failures = [log["error"] for log in logs if "error" in log]
    if not failures:
        return ""
    return (
        f"A LATER JOB FAILED: after these numbers were written, {len(failures)} jobs were refused"
        f" or failed, first: {failures[0]}; correct it and run again: what they make is older"
    )


STAGES = {
    r"(verdict|reproduce-all|total)$": "",  # with which a run ends
    r"simulate_|trial_sheet": "simulate",
    r"ingest": "read and check recordings",
    r"fit|(compare|calibrate|find|identify|analyse|select|average|summarise)_": "fit",
    r"\w+_numbers|draw_figure|captions": "figures",
    r"": "tables and page",
}
"""The stage of a rule, by how its name begins. Behind `osl_` stand those of a module."""
LOCKED = (
    "error: another run is at work in this folder: wait for it; or one that was killed left its"
    " lock: the same command with `--unlock` removes it"
)
SHOWN = ("Nothing to be done", "Terminating processes", "Will exit after finishing")
"""How messages of Snakemake begin that are shown; the last two answer Ctrl-C and SIGTERM."""
FOLLOWING = ("Exiting because a job", "At least one job did not", "WorkflowError")
"""How messages of Snakemake begin that follow a job's own error."""
FRAMES = re.compile(r'WorkflowError in file "[^"]+", line \d+:\n(.+)(\n *File ".+)*')
"""An error in a file of the user, and where in our rules it was found."""
LEAST_SHARE = 0.5  # of a stage's jobs, from which time left is told: the first are slower
SHORTEST_WAIT_S = 10.0  # between two lines on the same stage


def stage_of(rule: str) -> str:
    """The stage of a rule."""
    return next(stage for begin, stage in STAGES.items() if re.match(f"(osl_)?({begin})", rule))


def errors_in(logs: Iterable[str]) -> list[str]:
    """The errors that jobs of ours have told in these logs."""
    return [log["error"] for log in map(read_log, map(Path, logs)) if "remedy" in log]


class LogHandler(LogHandlerBase):
    """Snakemake's records as the lines of a run. With `--verbose`, or in a dry run, Snakemake
    writes its own."""

    writes_to_file = False  # Snakemake writes its log file itself
    has_filter = True
    has_formatter = False  # errors look like Snakemake's
    needs_rulegraph = False
    brief = Path()  # what a run ends with: set while it is planned, if its rule is asked for

    def __post_init__(self) -> None:
        self.total = Counter[str]()  # jobs by stage
        self.done = Counter[str]()
        self.started_s: dict[str, float] = {}  # when the first job of a stage began
        self.jobs: dict[int, Any] = {}  # stage and logs, by their numbers
        self.printed = set[str]()  # lines, or their causes
        self.has_told_error = False  # of a job of ours
        self.last_line_s = time.monotonic()  # when something was printed last

    @property
    def writes_to_stream(self) -> bool:
        """Whether this replaces Snakemake's own lines."""
        return not (self.common_settings.verbose or self.common_settings.dryrun)

    def emit(self, record: LogRecord) -> None:
        """Take one record. A line that cannot be written must not end the thread that takes
        them."""
        try:
            if self.writes_to_stream:
                self.handle_event(record)
        except Exception:
            self.handleError(record)

    def handle_event(self, record: LogRecord) -> None:
        fields = record.__dict__  # of the event, as Snakemake's `LogEvent` describes them
        event = fields.get("event")
        exception = fields.get("exception")
        message = record.getMessage()
        running = chain(*(logs for _, logs in self.jobs.values()))
        if event == LogEvent.RUN_INFO:
            for rule, count in fields["stats"].items():
                self.total[stage_of(rule)] += count
        elif event == LogEvent.JOB_INFO:
            stage = stage_of(fields["rule_name"])
            self.jobs[fields["jobid"]] = (stage, fields["log"])
            self.started_s.setdefault(stage, time.monotonic())
        elif event == LogEvent.JOB_FINISHED and fields["job_id"] in self.jobs:
            self.finish(*self.jobs.pop(fields["job_id"]))
        elif event == LogEvent.JOB_ERROR and errors_in(fields["log"]):
            self.print_outcome(*self.jobs.pop(fields["jobid"]))
        elif exception == "LockException":
            self.print_once(LOCKED)
        elif exception and any(error in message for error in errors_in(running)):
            pass  # of a job of ours, whose JOB_ERROR follows
        elif self.has_told_error and message.startswith(FOLLOWING):
            pass  # it says no more
        elif record.levelno >= WARNING or message.startswith(SHOWN):
            self.print_once(FRAMES.sub(r"error: \1", self.format(record)))
            if message.startswith(SHOWN[0]):
                self.print_outcome("", ())

    def finish(self, stage: str, logs: Sequence[str]) -> None:
        """Report an ended job: at once what it refused; from time to time, and at its end, the
        state of its stage."""
        self.print_outcome(stage, logs)
        if not stage:
            return
        self.done[stage] += 1
        done = self.done[stage]
        total = self.total[stage]
        spent_s = time.monotonic() - self.started_s[stage]
        if done == total:
            self.print_once(f"{stage} {done}/{total} in {spent_s:.0f} s")
        elif time.monotonic() - self.last_line_s > SHORTEST_WAIT_S:
            left = ""
            if done > LEAST_SHARE * total:
                left = f", about {(total - done) * spent_s / done:.0f} s left"
            self.print_once(f"{stage} {done}/{total}{left}")

    def print_outcome(self, stage: str, logs: Sequence[str]) -> None:
        """Of what ends the run, its brief. A line on each warning of a job, and on one that was
        refused, once for each cause: the brief names the others. A line on each that has failed or
        was killed."""
        if not stage and self.brief.is_file():
            self.print_once(self.brief.read_text(encoding="utf-8").rstrip())
        for log in map(Path, logs):
            job_log = read_log(log)
            lines = [("warning", warning) for warning in job_log.get("warnings", ())]
            if "remedy" in job_log:
                self.has_told_error = True
                lines.append((job_log["outcome"], f"{job_log['error']}; {job_log['remedy']}"))
            for kind, text in lines:
                self.print_once(
                    f"{kind}: {log.stem}: {printable(text)}",
                    without_particulars(text, log.stem) if kind in ("warning", "refused") else "",
                )

    def print_once(self, line: str, cause: str = "") -> None:
        """Print a line, unless it is printed already, or one of its cause."""
        line_or_cause = cause or line
        if line_or_cause not in self.printed:
            self.printed.add(line_or_cause)
            sys.stderr.write(f"{line}\n")  # in one piece, beside what Snakemake's thread prints
            self.last_line_s = time.monotonic()
