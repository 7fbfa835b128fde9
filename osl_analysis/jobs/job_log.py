# SPDX-License-Identifier: Apache-2.0
"""A job as its rule gives it, and its log: outcome, warnings and duration. The lines of a run are
read from the logs, so that they are complete also on a cluster."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from osl_analysis.base.files import write_text
from osl_analysis.config.sheet import RECORDINGS

Files = str | list[str]
"""An input of a job: a file, or a list of files."""


def listed(files: Files) -> list[str]:
    """Files of an input: Snakemake gives the path of a single one."""
    return [files] if isinstance(files, str) else files


@dataclass(frozen=True)
class Job:
    """What a rule gives to a job."""

    command: Callable[..., Any]
    inputs: Mapping[str, Files]
    outputs: Mapping[str, Files]
    params: Mapping[str, Any]
    files: Sequence[Path]  # all outputs
    log: Path
    tell: str = ""  # `refused` or `not_analysed`: the argument that gets the refusals among inputs
    at_once: int = 1  # jobs that share the memory of the machine

    @property
    def name(self) -> str:
        """The full name of its command."""
        return f"{self.command.__module__}.{self.command.__qualname__}"

    @property
    def simulates(self) -> bool:
        """Whether its outputs are recordings, or their sheet, and no results."""
        return self.command.__module__ == "osl_analysis.commands.simulate"

    @property
    def recordings(self) -> list[str]:
        """The recordings of a trial that the job ingests, else the file of the trial that it
        reads."""
        if "row" in self.params:  # of the sheet
            named = filter(None, map(self.params["row"].get, RECORDINGS))
            return [str(Path(self.params["raw_folder"], name)) for name in named]
        return [str(self.inputs[name]) for name in ("trial", "crossing") if name in self.inputs]

    @property
    def trial(self) -> str:
        """The trial that the job is of; empty for one over several trials."""
        if "row" in self.params:
            return str(self.params["row"]["trial"])
        return "".join(Path(file).stem for file in self.recordings)


def write_log(path: Path, entries: dict[str, Any]) -> None:
    """Write how a job ended, as YAML.

    Entries are the command `job`, its `outcome`, wall time `seconds`, what was wrong in the line
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
    empty if none were."""
    written = summary_json.stat().st_mtime
    paths = sorted((summary_json.parent / "logs").rglob("*.log"))
    logs = [read_log(path) for path in paths if path.stat().st_mtime > written]
    failures = [log["error"] for log in logs if "error" in log]
    if not failures:
        return ""
    return (
        f"A LATER JOB FAILED: after these numbers were written, {len(failures)} jobs were refused"
        f" or failed, first: {failures[0]}; correct it and run again: what they make is older"
    )
