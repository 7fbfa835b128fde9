"""The requests of jobs. A request is a small file, an input of its job: the task, and all that
affects the result.

Requests are written while Snakemake plans, if their content differs. So a changed setting, sheet,
program or recording is a changed input of the jobs that use it, and of no others. Snakemake
compares inputs by content if it has its notes (`.snakemake`), else by date."""

import atexit
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from osl_analysis.files import PACKAGE, digest, file_state, root, write_text
from osl_analysis.jobs.code import Sources
from osl_analysis.jobs.job_log import plain
from osl_analysis.jobs.run import begin, planned_folder, remove_half_written, running_server
from osl_analysis.judge.used import Judge, exclusions
from osl_analysis.refusal import TRIED_AGAIN, is_refused, read_refusals
from osl_analysis.yaml_settings import content_digest

PLACES = {"<package>": str(PACKAGE), "<shipped>": str(root())}
"""Placeholders in requests for the program's folders: results then also hold in another
environment."""
NOTHING: Mapping[str, Any] = {}
# code with which `jobs.job` reads and writes for a fit
FITS = ("table.write_tables", "trial.read_trial")


def read_request(path: Path) -> dict[str, Any]:
    """The job of a request: the content of `Requests.job`, and its own `path`."""
    text = path.read_text(encoding="utf-8")
    for name, place in PLACES.items():
        text = text.replace(name, place)
    return {**json.loads(text), "path": path}


def request_text(
    path: Path, content: Mapping[str, Any], digest_in_state: Callable[[Path], str | None]
) -> str:
    """The text of a request that may replace an older one. A job that failed, was killed, or lost
    its results is tried again: its request counts the tries. If nothing has changed, the text is
    the old one."""
    now = plain(content)
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        before = {}
    now["tried"] = before.get("tried", 0)
    if before:
        files = [Path(file) for file in now["files"]]
        if not all(file.exists() for file in files):
            now["tried"] += Path(now["log"]).exists()
        else:
            failed = (
                f
                for f in files
                if is_refused(f) and any(r.outcome in TRIED_AGAIN for r in read_refusals(f))
            )
            now["tried"] += any(
                file.stat().st_mtime_ns >= path.stat().st_mtime_ns for file in failed
            )
        if before["recorded"] != now["recorded"] and same_recordings(
            now["recorded"], files[0], digest_in_state
        ):
            now["recorded"] = before["recorded"]
    text = json.dumps(now, indent=1) + "\n"
    for name, place in PLACES.items():
        text = text.replace(place, name)
    return text


def same_recordings(
    recorded: Iterable[str], trial: Path, digest_in_state: Callable[[Path], str | None]
) -> bool:
    """Whether recordings with other dates are still those that the trial was made of, by SHA-256 in
    its provenance."""
    from osl_analysis.errors import InputError
    from osl_analysis.trial import metadata_of

    try:
        made_of = metadata_of(trial)[1]["files"].values()
    except (InputError, KeyError):
        return False  # as of a refusal record, which has none
    parts = [part for one in made_of for part in one.get("parts", [one])]
    return [digest_in_state(Path(file)) for file in recorded] == [part["sha256"] for part in parts]


digest_of = cache(content_digest)  # many jobs use the same file


def filled(rule: Any, wildcards: Mapping[str, str]) -> tuple[list[str], dict[str, str], str]:
    """The outputs of a rule's job, the named ones by name, and its log."""
    made = [str(pattern).format(**wildcards) for pattern in rule.output]
    named = {name: str(pattern).format(**wildcards) for name, pattern in rule.output.items()}
    return made, named, str(rule.log[0]).format(**wildcards)


class Requests:
    """The requests of a workflow, in a folder of its results. `judge` decides which trials are
    used. The process of a single job, as on a cluster, does not change them. A dry run (`-n`)
    writes requests that differ elsewhere. `recordings` is the folder of simulated recordings."""

    def __init__(
        self, results: Path, data: str, judge: Judge, workflow: Any, recordings: Sequence[Path] = ()
    ) -> None:
        self.folder, self.logs, self.data, self.judge = (
            results / "requests",
            results / "logs",
            data,
            judge,
        )
        self.is_excluded = cache(
            lambda measured: bool(exclusions(judge.verdicts([Path(measured)])))
        )
        self.workflow, self.sources = workflow, Sources(self.folder / "code.json")
        self.written = (results, *recordings)
        self.code = cache(self.known_code)

    @cached_property
    def elsewhere(self) -> Path | None:
        """The folder for requests that differ, in a dry run. None in a run, which is begun here."""
        if self.workflow.executor_plugin is None or self.workflow.dryrun:
            return planned_folder()
        if self.workflow.is_main_process:
            if begin(self.workflow.snakemake_tmp_dir)[1]:
                remove_half_written(self.written)
            self.judge.write(self.folder / "judge.json")
            atexit.register(self.sources.write)
        return None

    def known_code(self, *roots: str) -> str:
        if self.elsewhere is None and not self.sources.known:
            running_server()  # it imports while all modules are parsed
        return self.sources.code(*roots)

    def digest_in_state(self, recording: Path) -> str | None:
        """SHA-256 of a recording, computed once per state of the file, not in every run."""
        found: str | None = self.sources.of_text(
            f"{recording} {file_state(recording)}", lambda: digest(recording)
        )
        return found

    def job(
        self,
        rule: Any,
        wildcards: Any,
        command: str,
        modules: Sequence[str] = (),
        *,
        input: Mapping[str, Any] = NOTHING,
        after: Sequence[Path] = (),
        needs: Sequence[Path] = (),
        read: Mapping[str, Any] = NOTHING,
        settings: Mapping[str, Any] = NOTHING,
        output: Mapping[str, Any] | None = None,
        files: Mapping[str, Any] = NOTHING,
        made_of: Iterable[Path] = (),
        recordings: Iterable[Path] = (),
    ) -> dict[str, Any]:
        """The inputs of one job of a rule for Snakemake, by name; `request` is the file of its
        request.

        `command` is `module.function` of `osl_analysis.commands`, `modules` are those that it
        imports by name. It is called with
        * the inputs by name: those of `input`, those of `read`, which were made when `input` was
          (planning takes time with every file that Snakemake is told of), and the small `files`,
          which no job writes;
        * the outputs of the rule by their names; without a name, one is `output` and several are
          `outputs`. Or with `output`, where the command finds the names of its files itself;
        * the `settings`. What is refused or excluded there is left out (`jobs.job.call`). Of the
        files in `needs` it must have every one, those in `after` are not looked at. Of `files` and
        `made_of` content counts, of `recordings` also state."""
        made, named, log = filled(rule, dict(wildcards.items()))
        if output is None:
            only: dict[str, Any] = {"output": made[0]} if len(made) == 1 else {"outputs": made}
            output = named or only
        given = {name: plain(file) for name, file in files.items()}
        small = [
            *made_of,
            *(
                one
                for file in given.values()
                for one in ([file] if isinstance(file, str) else file)
            ),
        ]
        inputs = {**input, **read, **given}
        measured = [str(file) for file in inputs.get("quality", ())]
        # Each has its own folder: Snakemake does not see files that appear later beside one it has
        # looked for.
        path = self.folder / Path(log).relative_to(self.logs).with_suffix("") / "job.json"
        if self.workflow.is_main_process or not path.is_file():
            content = {
                "command": command,
                "code": self.code(
                    f"commands.{command}", *modules, *(FITS if "tables" in output else ())
                ),
                "data": self.data,
                "log": log,
                "files": made,
                "input": inputs,
                "judge": str(self.folder / "judge.json") if measured else "",
                "excluded": [Path(file).stem for file in measured if self.is_excluded(file)],
                "needs": needs,
                "output": output,
                "settings": settings,
                "made_of": {str(file): digest_of(Path(file)) for file in small},
                # not as inputs: Snakemake would ignore an older date of a recording, and stop if it
                # cannot read one
                "recorded": {str(file): file_state(file) for file in recordings},
            }
            path = self.placed(path, request_text(path, content, self.digest_in_state))
        return {"request": str(path), **plain({**input, "after": after, "needs": needs})}

    def placed(self, path: Path, text: str) -> Path:
        """The file of a request: its own, written if it differs; in a dry run, one elsewhere."""
        if path.is_file() and path.read_text(encoding="utf-8") == text:
            return path
        if self.elsewhere is not None:
            path = self.elsewhere / path.relative_to(self.folder)
        else:
            running_server()  # it imports on another core while this one plans
        write_text(path, text)
        return path
