"""The log of a job: its outcome, warnings and duration, and what it was given. The lines of a run
are read from the logs, so that they are complete also on a cluster."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from osl_analysis.files import atomic_path

GIVEN = ("input", "output", "params")  # The last entries of a log: what the rule gave the job.


def write_log(path: Path, ended: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    """Write how a job ended, and what it was `given`, as YAML, without empty entries.

    `ended` has the command `job`, its `outcome`, wall time `seconds`, what was wrong in the line
    `error`, the `remedy`, `warnings`, and the `traceback` of an error of the program. Outcomes:
    done; refused, for an input that the user can correct; failed, by an error of the program or of
    the system; killed, ended from outside; skipped, because an input is missing."""
    entries = {**ended, **{name: given.get(name) for name in GIVEN}}
    filled = {name: value for name, value in entries.items() if value not in ("", (), [], {}, None)}
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        yaml.dump(
            plain(filled),
            file,
            yaml.CSafeDumper,
            sort_keys=False,
            width=10**9,
            allow_unicode=True,
        )


def read_log(path: Path) -> dict[str, Any] | None:
    """How the job of a log ended; None if the file is not the log of a job."""
    try:
        head = path.read_text(encoding="utf-8")
        for name in GIVEN:
            head = head.split(f"\n{name}:", 1)[0]
        log = yaml.load(head, yaml.CSafeLoader)
    except (OSError, ValueError, yaml.YAMLError):
        return None
    return log if isinstance(log, dict) and {"job", "outcome"} <= log.keys() else None


def plain(value: Any) -> Any:
    """A value of mappings, lists, numbers, truth values and text only. Paths become text, numpy's
    numbers Python's."""
    return json.loads(json.dumps(value, default=plain_scalar))


def plain_scalar(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else str(value)
