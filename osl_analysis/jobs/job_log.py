"""The log of a job: its outcome, warnings and duration. The lines of a run are read from the logs,
so that they are complete also on a cluster."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from osl_analysis.files import write_text


def write_log(path: Path, entries: Mapping[str, Any]) -> None:
    """Write how a job ended, as YAML, without empty entries.

    They are the command `job`, its `outcome`, wall time `seconds`, what was wrong in the line
    `error`, the `remedy`, `warnings`, and the `traceback` of an error of the program. Outcomes:
    done; refused, for an input that the user can correct; failed, by an error of the program or of
    the system; killed, ended from outside; skipped, because an input is missing."""
    filled = {name: value for name, value in entries.items() if value}
    text = yaml.dump(
        filled, Dumper=yaml.CSafeDumper, sort_keys=False, width=1_000_000, allow_unicode=True
    )
    write_text(path, text)


def read_log(path: Path) -> dict[str, Any] | None:
    """How the job of a log ended; None if the file is not the log of a job."""
    try:
        log = yaml.load(path.read_text(encoding="utf-8"), yaml.CSafeLoader)
    except (OSError, ValueError, yaml.YAMLError):
        return None
    return log if isinstance(log, dict) and "outcome" in log else None
