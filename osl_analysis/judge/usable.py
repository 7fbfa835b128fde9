"""Which trials a job uses: not those that quality control excludes, nor those without a result (`refusal.py`), which
are always listed.
"""

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.files import atomic_path
from osl_analysis.jobs.refusal import Refusal, distinct_causes, is_refused, read_refusals
from osl_analysis.judge.recording import judged_table
from osl_analysis.judge.table import QualityRules

HOW_TO_USE = "record again, give a reason under `exclude` in the sample sheet, or name the check under `accept`"
JUDGES = ("quality", "fitted")
"""Inputs that only tell which trials are used: what was measured of them, and other results of the same trials."""
CHECK_COLUMNS = ("trial", "check", "value", "unit", "remark")  # columns of the file of a trial's checks


@dataclass(frozen=True)
class Usable:
    """The inputs of a job without refusal records."""

    inputs: Mapping[str, Any]  # what is left, by name
    refused: tuple[Refusal, ...] = ()  # the causes of everything that was removed
    missing: tuple[Refusal, ...] = ()  # the causes without which the job cannot run; empty if it can


def without_refused(inputs: Mapping[str, Any], unnamed: Sequence[str] = ()) -> Usable:
    """The named inputs of a job without refusal records. A trial with a record in one list, or among those in `quality`
    or the results in `fitted`, is removed from every list. The job cannot run if a record stands for a single input or
    for one of the `unnamed` files, if the input `trial` is such a trial, or if nothing is left of a list; beside an
    input `trial`, lists may become empty. Lists by name are handed over as they are."""
    lists = {name: files for name, files in inputs.items() if isinstance(files, list)}
    named = {name: files for name, files in inputs.items() if isinstance(files, Mapping)}
    groups = {name: files for name, files in named.items() if not any(isinstance(f, list) for f in files.values())}
    alone = [file for name, file in inputs.items() if name not in lists and name not in named]
    gone = {Path(file).stem: read_refusals(file) for files in lists.values() for file in files if is_refused(file)}
    kept: dict[str, Any] = {name: [f for f in files if Path(f).stem not in gone] for name, files in lists.items()}
    kept |= {name: {key: f for key, f in files.items() if not is_refused(f)} for name, files in groups.items()}
    missing = [cause for file in (*alone, *unnamed) for cause in read_refusals(file)]
    if "trial" not in inputs:
        emptied = [files for name, files in lists.items() if files and not kept[name] and name not in JUDGES]
        missing += [cause for files in emptied for file in files for cause in gone[Path(file).stem]]
    missing += gone.get(Path(str(inputs.get("trial"))).stem, ())
    causes = [cause for found in gone.values() for cause in found]
    causes += [cause for files in groups.values() for file in files.values() for cause in read_refusals(file)]
    return Usable({**inputs, **kept}, distinct_causes([*causes, *missing]), distinct_causes(missing))


@dataclass(frozen=True)
class Judge:
    """What decides which trials are used: the configured rules of quality control, and what the sheet accepts by trial.
    A job that measures knows neither: a changed threshold judges again what was measured, and measures nothing again. A
    job over several trials finds it in a file, whose change alone runs no job again: its request names the trials that
    are excluded."""

    rules: QualityRules
    accept: Mapping[str, Collection[str]]

    def write(self, path: Path) -> None:
        """Write it to a file for jobs."""
        accept = {trial: list(names) for trial, names in self.accept.items() if names}
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps({"rules": self.rules.model_dump(mode="json"), "accept": accept}))

    @classmethod
    def read(cls, path: Path) -> Self:
        """That of a file."""
        said = json.loads(path.read_text(encoding="utf-8"))
        return cls(QualityRules.model_validate(said["rules"]), said["accept"])

    def verdicts(self, measured: Iterable[Path]) -> pl.DataFrame:
        """The rows of `quality.csv` for trials whose checks were measured; a missing file, or a record, has none."""
        there = [path for path in measured if path.is_file() and not is_refused(path)]
        kinds = {name: pl.Float64 if name == "value" else pl.String for name in CHECK_COLUMNS}
        read = (pl.read_csv(path, columns=CHECK_COLUMNS, schema_overrides=kinds) for path in there)
        table = pl.concat([pl.DataFrame(schema=kinds), *read])
        return judged_table(table.with_columns(pl.col("remark").fill_null("")), self.rules, self.accept)


def exclusions(verdicts: pl.DataFrame) -> dict[str, str]:
    """The trials that quality control excludes, and why."""
    reasons: dict[str, str] = {}
    for row in verdicts.filter(pl.col("verdict") == "exclude").iter_rows(named=True):
        said = f"{row['check']} {row['value']:.4g} {row['unit']}, threshold {row['threshold']}"
        said += f": {row['remark'].replace('; ', ', ')}" if row["remark"] else ""
        reasons[row["trial"]] = "; ".join(filter(None, [reasons.get(row["trial"]), said]))
    return reasons


def without_excluded(inputs: Mapping[str, Any], reasons: Mapping[str, str]) -> dict[str, Any]:
    """The named inputs of a job without the files of excluded trials (`exclusions`). Of the trials in the input
    `quality`, files with the name of an excluded one are removed from every list. The inputs `JUDGES` are not passed
    on. An excluded input `trial` is refused, and so are lists of excluded trials alone."""
    judged = {Path(path).stem for path in inputs.get("quality", ())}
    lists = {name: files for name, files in inputs.items() if isinstance(files, list) and name not in JUDGES}
    needed = {Path(file).stem for files in lists.values() for file in files} & judged
    single = {Path(str(inputs.get("trial"))).stem} & judged
    if single & set(reasons) or (needed | single and needed | single <= set(reasons)):
        why = "; ".join(f"{trial} ({reasons[trial]})" for trial in sorted(single or needed)[:3])
        raise InputError(f"quality control excludes every trial that is needed here: {why}; {HOW_TO_USE}")
    kept = {name: [file for file in files if Path(file).stem not in reasons] for name, files in lists.items()}
    return {name: kept.get(name, value) for name, value in inputs.items() if name not in JUDGES}
