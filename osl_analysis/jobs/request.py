"""The requests of jobs: what each is to do, with all that its results are made of, as a small file that is its input.

A request is written while Snakemake plans, and only if its content differs. So a changed setting, sheet, program or
recording is a changed input of the jobs that use it, and of no others. Snakemake compares inputs by content where it
has notes of its own (`.snakemake`), else by date.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from osl_analysis.files import PACKAGE, atomic_path, digest, file_state, root
from osl_analysis.jobs.job_log import plain
from osl_analysis.jobs.refusal import TRIED_AGAIN, is_refused, read_refusals
from osl_analysis.judge.findings import Judge, exclusions

PLACES = {"<package>": str(PACKAGE), "<shipped>": str(root())}
"""What stands in requests for folders of the program, so that results hold in another environment with the same."""
TABLES = (".csv", ".zip")  # Suffixes of files that say by their column `data` what their data are.


@dataclass(frozen=True)
class Job:
    """What one job is to do."""

    command: str  # `module.function` under `osl_analysis.commands`
    request: Mapping[str, Mapping[str, Any]]  # `input`, `output` and `settings`, by names of the function's arguments
    unnamed: Sequence[str]  # further files that it depends on
    files: Sequence[str]  # all the files that it writes
    data: str = ""  # what the column `data` of its tables says; empty: they have none
    log: Path = Path("job.log")
    judge: Path | None = None  # the file of what decides which trials are used; None where a job needs none
    path: Path | None = None  # the file of the request itself


def read_request(path: Path) -> Job:
    """The job of a request."""
    text = path.read_text(encoding="utf-8")
    for name, place in PLACES.items():
        text = text.replace(name, place)
    said = json.loads(text)
    judge = Path(said["judge"]) if said.get("judge") else None
    return Job(said["command"], said, said["needs"], said["files"], said["data"], Path(said["log"]), judge, path)


def say_excluded(path: Path, excluded: Sequence[str]) -> None:
    """Let a request say which of its trials quality control excludes, as the job found when all were measured.

    While the request was written some were not measured yet: without this the next run would take it for changed.
    """
    said = json.loads(path.read_text(encoding="utf-8"))
    if said["excluded"] != list(excluded):
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps(said | {"excluded": list(excluded)}, indent=1) + "\n", encoding="utf-8")


def write_request(path: Path, content: Mapping[str, Any], frozen: bool = False) -> None:
    """Write a request if it differs from the one in its place. `frozen`: an older one stays as it is.

    A failed or killed job is tried again, and so is one whose results were deleted: its request counts how often.
    """
    now = {name: plain(value) for name, value in content.items()}
    try:
        old = path.read_text(encoding="utf-8")
        before = json.loads(old)
    except (OSError, ValueError):
        old, before = "", {}
    if before and frozen:
        return
    now["tried"] = before.get("tried", 0) + int(bool(before) and is_to_try_again(path, now))
    if before and same_recordings(before["recorded"], now["recorded"], now["files"]):
        now["recorded"] = before["recorded"]
    text = json.dumps(now, indent=1) + "\n"
    for name, place in PLACES.items():
        text = text.replace(place, name)
    if text != old:
        with atomic_path(path) as temporary:
            temporary.write_text(text, encoding="utf-8")


def is_to_try_again(request: Path, now: Mapping[str, Any]) -> bool:
    """Whether results of a job that has run are gone, or stand for a failure since the request was written."""
    files = [Path(file) for file in now["files"]]
    if not all(file.exists() for file in files):
        return Path(now["log"]).exists()
    written = request.stat().st_mtime_ns
    failed = (f for f in files if is_refused(f) and any(r.outcome in TRIED_AGAIN for r in read_refusals(f)))
    return any(file.stat().st_mtime_ns >= written for file in failed)


def same_recordings(before: Mapping[str, Any], now: Mapping[str, Any], results: Sequence[str]) -> bool:
    """Whether recordings with other dates are the same ones, by size and the SHA-256 in their trial's provenance."""
    if before == now or before.keys() != now.keys() or None in (*before.values(), *now.values()):
        return False
    if any(then[::2] != state[::2] for then, state in zip(before.values(), now.values(), strict=True)):
        return False  # of another size, or not readable
    import polars as pl

    from osl_analysis.trial import PROVENANCE_KEY

    try:
        provenance = json.loads(pl.read_parquet_metadata(results[0])[PROVENANCE_KEY])
        parts = [part for one in provenance["files"].values() for part in one.get("parts", [one])]
        return [digest(Path(file)) for file in now] == [part["sha256"] for part in parts]
    except (pl.exceptions.PolarsError, OSError, KeyError, ValueError, TypeError):
        return False  # as of a refusal record, which has none


digest_of = cache(digest)  # many jobs use the same file


class Requests:
    """The requests of a workflow.

    They are written to `folder`, under the places of the jobs' logs below `logs`; in the process of a single job, as on
    a cluster, they stay as they are. `judge` decides which trials are used.
    """

    def __init__(self, folder: Path, logs: Path, data: str, judge: Judge, workflow: Any) -> None:
        self.folder, self.logs, self.data, self.judge, self.workflow = folder, logs, data, judge, workflow
        self.is_excluded = cache(lambda measured: bool(exclusions(judge.verdicts([Path(measured)]))))
        self.judge_file = cache(self.write_judge)

    def write_judge(self) -> str:
        """The file with the judge, for jobs over trials that were measured."""
        file = self.folder / "judge.json"
        if self.workflow.is_main_process:
            self.judge.write(file)
        return str(file)

    def job(
        self,
        rule: Any,
        wildcards: Any,
        command: str,
        code: str | Sequence[str],
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

        `command` is "module.function" under `osl_analysis.commands`, `code` its fingerprint. It is called with

        * the inputs by name: those of `input`, and those of `read`, which were made when `input` was. Snakemake's
          planning takes time with every file that it is told of;
        * the outputs of the rule by their names; without a name, one is `output` and several are `outputs`. Or with
          `output`, where the command finds the names of its files itself;
        * the `settings`.

        Each takes the type that the function's signature gives. What the job finds there that is refused or excluded is
        left out (`jobs.job.call`). Of the files in `needs` it must have every one, the files in `after` are not looked
        at. The small `files` are inputs by name that no job writes; of these and of those in `made_of` the content
        counts, of `recordings` state and content.
        """
        known = dict(wildcards.items())
        given = {name: plain(file) for name, file in (files or {}).items()}
        named_files = (one for file in given.values() for one in ([file] if isinstance(file, str) else file))
        made_of = [*made_of, *map(Path, named_files)]
        made = [str(pattern).format(**known) for pattern in rule.output]
        named = {name: str(pattern).format(**known) for name, pattern in rule.output.items()}
        if output is None:
            only: dict[str, Any] = {"output": made[0]} if len(made) == 1 else {"outputs": made}
            output = named or only
        log = str(rule.log[0]).format(**known)
        # Each in a folder of its own: what is written beside a file that it has looked for, Snakemake does not see.
        path = self.folder / Path(log).relative_to(self.logs).with_suffix("") / "job.json"
        measured = [str(file) for file in {**(input or {}), **(read or {})}.get("quality", ())]
        content = {
            "command": command,
            "code": code,
            "data": self.data if any(file.endswith(TABLES) for file in made) else "",
            "log": log,
            "files": made,
            "input": {**(input or {}), **(read or {}), **given},
            "judge": self.judge_file() if measured else "",
            "excluded": [Path(file).stem for file in measured if self.is_excluded(file)],
            "needs": needs,
            "output": output,
            "settings": settings or {},
            "made_of": {str(file): digest_of(Path(file)) for file in made_of},
            # as inputs, Snakemake would ignore an older date of a recording, and stop where it cannot read one
            "recorded": {str(file): file_state(file) for file in recordings},
        }
        write_request(path, content, frozen=not self.workflow.is_main_process)
        listed = {"after": [str(file) for file in after], "needs": [str(file) for file in needs]}
        return {"request": str(path), **plain(input or {}), **listed}
