"""The requests of jobs: what each is to do, with all that its results are made of, as a small file that is its input.

A request is written while Snakemake plans, and only if its content differs. So a changed setting, sheet, program or
recording is a changed input of the jobs that use it, and of no others. Snakemake compares inputs by content where it
has notes of its own (`.snakemake`), else by date.
"""

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from osl_analysis.files import PACKAGE, digest, file_state, root, write_text
from osl_analysis.jobs.job_log import plain
from osl_analysis.judge.findings import Judge, exclusions
from osl_analysis.refusal import TRIED_AGAIN, is_refused, read_refusals

PLACES = {"<package>": str(PACKAGE), "<shipped>": str(root())}
"""What stands in requests for folders of the program, so that results hold in another environment with the same."""
IMPORT = re.compile(
    r"^[ \t]*(?:from (osl_analysis[\w.]*) import (\([^)]*\)|.*)|import (osl_analysis[\w.]*))", re.MULTILINE
)


def read_request(path: Path) -> dict[str, Any]:
    """The job of a request: the content of `Requests.job`, and its own `path`."""
    text = path.read_text(encoding="utf-8")
    for name, place in PLACES.items():
        text = text.replace(name, place)
    return {**json.loads(text), "path": path}


def write_request(path: Path, content: Mapping[str, Any]) -> None:
    """Write a request if it differs from the one in its place. A failed or killed job is tried again, and so is one
    whose results were deleted: its request counts how often."""
    now = plain(content)
    try:
        old = path.read_text(encoding="utf-8")
        before = json.loads(old)
    except (OSError, ValueError):
        old, before = "", {}
    now["tried"] = before.get("tried", 0)
    if before:
        files = [Path(file) for file in now["files"]]
        if not all(file.exists() for file in files):
            now["tried"] += Path(now["log"]).exists()
        else:
            failed = (f for f in files if is_refused(f) and any(r.outcome in TRIED_AGAIN for r in read_refusals(f)))
            now["tried"] += any(file.stat().st_mtime_ns >= path.stat().st_mtime_ns for file in failed)
        if before["recorded"] != now["recorded"] and same_recordings(now["recorded"], files[0]):
            now["recorded"] = before["recorded"]
    text = json.dumps(now, indent=1) + "\n"
    for name, place in PLACES.items():
        text = text.replace(place, name)
    if text != old:
        write_text(path, text)


def same_recordings(recorded: Iterable[str], trial: Path) -> bool:
    """Whether recordings of other dates are those that a trial was made of, by the SHA-256 in its provenance."""
    from osl_analysis.errors import InputError
    from osl_analysis.trial import metadata_of

    try:
        made_of = metadata_of(trial)[1]["files"].values()
    except (InputError, KeyError):
        return False  # as of a refusal record, which has none
    parts = [part for one in made_of for part in one.get("parts", [one])]
    return [digest(Path(file)) for file in recorded] == [part["sha256"] for part in parts]


digest_of = cache(digest)  # many jobs use the same file


class Requests:
    """The requests of a workflow, among its results; `judge` decides which trials are used. In the process of a single
    job, as on a cluster, they stay as they are."""

    def __init__(self, results: Path, data: str, judge: Judge, workflow: Any) -> None:
        self.folder, self.logs, self.data = results / "requests", results / "logs", data
        self.is_excluded = cache(lambda measured: bool(exclusions(judge.verdicts([Path(measured)]))))
        self.workflow, self.is_written = workflow, workflow.is_main_process
        if self.is_written:
            judge.write(self.folder / "judge.json")

    def job(
        self,
        rule: Any,
        wildcards: Any,
        command: str,
        modules: Sequence[str] = (),
        *,
        input: Mapping[str, Any] | None = None,
        after: Sequence[Path] = (),
        needs: Sequence[Path] = (),
        read: Mapping[str, Any] | None = None,
        settings: Mapping[str, Any] | None = None,
        output: Mapping[str, Any] | None = None,
        files: Mapping[str, Any] | None = None,
        made_of: Iterable[Path] = (),
        recordings: Iterable[Path] = (),
    ) -> dict[str, Any]:
        """The inputs of one job of a rule for Snakemake, by name; `request` is the file of its request.

        `command` and `modules` are those of `code`. It is called with
        * the inputs by name: those of `input`, those of `read`, which were made when `input` was (planning takes time
          with every file that Snakemake is told of), and the small `files`, which no job writes;
        * the outputs of the rule by their names; without a name, one is `output` and several are `outputs`. Or with
          `output`, where the command finds the names of its files itself;
        * the `settings`.
        What is refused or excluded there is left out (`jobs.job.call`). Of the files in `needs` it must have every one,
        those in `after` are not looked at. Of `files` and `made_of` the content counts, of `recordings` state and
        content.
        """
        if self.workflow.scheduling_settings and self.workflow.local_exec:
            # For its limit of jobs per second the scheduler looks, after n jobs, at all ready ones n times per second.
            self.workflow.scheduling_settings.max_jobs_per_timespan = None
        known = dict(wildcards.items())
        made = [str(pattern).format(**known) for pattern in rule.output]
        named = {name: str(pattern).format(**known) for name, pattern in rule.output.items()}
        if output is None:
            only: dict[str, Any] = {"output": made[0]} if len(made) == 1 else {"outputs": made}
            output = named or only
        given = {name: plain(file) for name, file in (files or {}).items()}
        small = [*made_of, *(one for file in given.values() for one in ([file] if isinstance(file, str) else file))]
        inputs = {**(input or {}), **(read or {}), **given}
        measured = [str(file) for file in inputs.get("quality", ())]
        log = str(rule.log[0]).format(**known)
        # Each in a folder of its own: what is written beside a file that it has looked for, Snakemake does not see.
        path = self.folder / Path(log).relative_to(self.logs).with_suffix("") / "job.json"
        if self.is_written or not path.is_file():
            content = {
                "command": command,
                "code": code(command, *modules),
                "data": self.data,
                "log": log,
                "files": made,
                "input": inputs,
                "judge": str(self.folder / "judge.json") if measured else "",
                "excluded": [Path(file).stem for file in measured if self.is_excluded(file)],
                "needs": needs,
                "output": output,
                "settings": settings or {},
                "made_of": {str(file): digest_of(Path(file)) for file in small},
                # as inputs, Snakemake would ignore an older date of a recording, and stop where it cannot read one
                "recorded": {str(file): file_state(file) for file in recordings},
            }
            write_request(path, content)
        return {"request": str(path), **plain({**(input or {}), "after": after, "needs": needs})}


@cache
def code(command: str, *modules: str) -> str:
    """Fingerprint of a command, `module.function` under `osl_analysis.commands`: of the module's file, of all of ours
    that it imports, and of `modules` under `osl_analysis` that it imports by name."""
    files, names = set[Path](), (f"commands.{command.partition('.')[0]}", *modules)
    new = [module_file(f"osl_analysis.{name}") for name in names]
    while new:
        file = new.pop()
        if file is not None and file not in files:
            data = "*.yaml" if file.stem == "__init__" else f"{file.stem}.*"  # in a package, or beside a module
            files |= {file, *file.parent.glob(data)}
            new += map(module_file, imported_names(file))
    return hashlib.sha256(b"".join(map(content_of, sorted(files)))).hexdigest()[:16]


content_of = cache(Path.read_bytes)  # as it was when it was asked for first


@cache
def imported_names(path: Path) -> tuple[str, ...]:
    """Dotted names of the package that a source file imports, at any place in it, and some words of comments there.
    They are found by their text: parsing every module takes 0.8 s, and Snakemake does it anew in each run."""
    names = []
    for module, imported, alone in IMPORT.findall(content_of(path).decode()):
        names += [alone or module, *(f"{module}.{name}" for name in re.findall(r"\w+", imported))]
    return tuple(name for name in names if name.startswith("osl_analysis."))


@cache
def module_file(name: str) -> Path | None:
    """File of a dotted module name of the package; None if the name is not a module."""
    path = PACKAGE.joinpath(*name.split(".")[1:])
    return next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)
