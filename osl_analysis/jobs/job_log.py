"""The log of a job: its request, outcome, warnings and duration. The report at the end of a run is read from the logs:
so it is complete on a cluster too, where every job is a process apart."""

import json
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import yaml

from osl_analysis.files import atomic_path

REQUEST = ("input", "output", "settings")  # The last entries of a log: the request.


@dataclass(frozen=True)
class JobLog:
    """How one job ended.

    Refused: because of an input that the user can correct. Failed: by an error of the program. Died: its process was
    ended from outside. Skipped: a result that it needs was refused or failed.
    """

    job: str  # the command, `module.function`
    outcome: Literal["done", "refused", "failed", "died", "skipped"]
    seconds: float = 0.0  # wall time [s]
    error: str = ""  # one line that says what was wrong
    warnings: Sequence[str] = ()  # one line each
    traceback: str = ""  # of an error of the program


def write_log(path: Path, ended: JobLog, request: Mapping[str, Any]) -> None:
    """Write outcome and request of a job as YAML, without empty entries, 15 times as fast as with ruamel.yaml."""
    entries = vars(ended) | {"seconds": round(ended.seconds, 3)} | {name: request.get(name) for name in REQUEST}
    said = plain({name: value for name, value in entries.items() if value not in ("", (), [], {}, None)})
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        yaml.dump(said, file, yaml.CSafeDumper, sort_keys=False, width=10**9, allow_unicode=True)


def read_log(path: Path) -> JobLog | None:
    """Outcome of the job of a log; None if the file is not the log of a job."""
    try:
        head = path.read_text(encoding="utf-8")
        for name in REQUEST:
            head = head.split(f"\n{name}:", 1)[0]
        return JobLog(**yaml.load(head, yaml.CSafeLoader))
    except (OSError, ValueError, TypeError, yaml.YAMLError):
        return None


def plain(value: Any) -> Any:
    """A value of mappings, lists, numbers, truth values and text alone; a path becomes text, a number of numpy ours."""
    return json.loads(json.dumps(value, default=lambda one: one.item() if hasattr(one, "item") else str(one)))


def run_report(folder: Path, since: float) -> str:
    """Of the jobs whose logs below a folder were written after `since` [s, as `time.time`]: each warning once, with the
    number of jobs that gave it, and the wall time by stage."""
    paths = [path for path in sorted(folder.rglob("*.log")) if path.stat().st_mtime >= since]
    logs = [log for log in map(read_log, paths) if log is not None]
    most = 10  # warnings
    counts = Counter(warning for log in logs for warning in log.warnings)
    lines = [f"warning: {text}" + (f" ({count} jobs)" if count > 1 else "") for text, count in counts.items()]
    more = [f"{len(lines) - most} more warnings stand in the logs"] if len(lines) > most else []
    spent: dict[str, list[float]] = defaultdict(list)
    for log in logs:
        spent[log.job.partition(".")[0]].append(log.seconds)
    rows = sorted(spent.items(), key=lambda stage: -sum(stage[1]))
    times = [f"{stage:<16}{len(seconds):>6} jobs{sum(seconds):>9.1f} s" for stage, seconds in rows]
    return "\n".join([*lines[:most], *more, *["where the time went (summed over cores):"] * bool(times), *times])
