"""The log of a job: what it was asked to do, how it ended, what it warned of and how long it took.

The reports at the end of a run are read from the logs. They are therefore complete on a cluster too, where every job is
a process of its own and knows nothing of the others.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from osl_analysis.files import atomic_path

Outcome = Literal["done", "refused", "failed", "died"]
REQUEST = ("input", "output", "settings")
"""The last entries of a log: what the job was asked to do."""
UNLIMITED = 10**9
MOST_WARNINGS = 10
"""Warnings that the report at the end of a run shows."""


@dataclass(frozen=True)
class JobLog:
    """How one job ended.

    job: the command, `module.function`.
    outcome: done; refused, because of an input that the user can mend; failed, by an error of the program; died, when
        its process was ended from outside.
    seconds: wall time [s].
    error: one line that says what was wrong; empty where nothing was.
    warnings: one line each.
    traceback: of an error of the program.
    """

    job: str
    outcome: Outcome
    seconds: float = 0.0
    error: str = ""
    warnings: tuple[str, ...] = ()
    traceback: str = ""


def write_log(path: Path, ended: JobLog, request: Mapping[str, Any]) -> None:
    """Write how a job ended and what it was asked to do, as YAML. Entries that say nothing are left out."""
    entries = {"job": ended.job, "outcome": ended.outcome, "seconds": round(ended.seconds, 3)}
    entries |= {"error": ended.error, "warnings": list(ended.warnings), "traceback": ended.traceback}
    entries |= {name: plain(request.get(name)) for name in REQUEST}
    said = {name: value for name, value in entries.items() if value not in ("", [], {}, None)}
    text = yaml.dump(said, Dumper=yaml.CSafeDumper, sort_keys=False, width=UNLIMITED, allow_unicode=True)
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def read_log(path: Path) -> JobLog | None:
    """How the job of a log ended; None where the file is not the log of a job."""
    head = path.read_text(encoding="utf-8")
    for name in REQUEST:
        head = head.split(f"\n{name}:", 1)[0]
    try:
        said = yaml.load(head, Loader=yaml.CSafeLoader)
        return JobLog(**(said | {"warnings": tuple(said.get("warnings", ()))}))
    except (yaml.YAMLError, TypeError):
        return None


def read_logs(folder: Path, since: float) -> list[JobLog]:
    """How the jobs ended whose logs below a folder were written after `since` [s, as `time.time`]."""
    paths = [path for path in sorted(folder.rglob("*.log")) if path.stat().st_mtime >= since]
    return [log for log in map(read_log, paths) if log is not None]


def plain(value: Any) -> Any:
    """A value as YAML writes it: mappings, lists, numbers, truth values and text."""
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    if isinstance(value, np.generic):
        return value.item()
    return value if value is None or type(value) in (bool, int, float, str) else str(value)


def run_report(logs: Iterable[JobLog]) -> str:
    """What a user must know of the jobs at the end of a run: failures, warnings, and where the time went."""
    jobs = list(logs)
    return "\n".join(filter(None, [failure_report(jobs), warning_report(jobs), time_table(jobs)]))


def failure_report(logs: Iterable[JobLog]) -> str:
    """Why jobs failed, a line each, and what that means for the rest; empty if none did."""
    errors = list(dict.fromkeys(f"error: {log.error}" for log in logs if log.outcome != "done"))
    remedy = (
        "tables and figures that need these were not renewed; mend the input, or give a reason under `exclude` in the "
        "sample sheet, and run again"
    )
    return "\n".join(["what failed:", *errors, remedy]) if errors else ""


def warning_report(logs: Iterable[JobLog]) -> str:
    """The warnings of all jobs, each once with the number of jobs that gave it; empty if there are none."""
    counts: dict[str, int] = defaultdict(int)
    for log in logs:
        for warning in log.warnings:
            counts[warning] += 1
    lines = [f"warning: {text}" + (f" ({count} jobs)" if count > 1 else "") for text, count in counts.items()]
    more = [f"{len(lines) - MOST_WARNINGS} more warnings stand in the logs"] if len(lines) > MOST_WARNINGS else []
    return "\n".join([*lines[:MOST_WARNINGS], *more])


def time_table(logs: Iterable[JobLog]) -> str:
    """Wall time of the jobs of each stage, summed over the cores; empty if there were no jobs."""
    spent: dict[str, list[float]] = defaultdict(list)
    for log in logs:
        spent[log.job.partition(".")[0]].append(log.seconds)
    rows = sorted(spent.items(), key=lambda stage: -sum(stage[1]))
    lines = [f"{stage:<16}{len(seconds):>6} jobs{sum(seconds):>9.1f} s" for stage, seconds in rows]
    return "\n".join(["where the time went (summed over cores):", *lines]) if lines else ""
