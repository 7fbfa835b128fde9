"""Trials that are not used in any result of several trials: those that quality control excludes, and those without a
result of their own (`refusal.py`). Both are always listed.
"""

import csv
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import polars as pl

from osl_analysis.errors import InputError, listing
from osl_analysis.files import atomic_path
from osl_analysis.quality.checks import QualityRules
from osl_analysis.quality.verdict import judged_table
from osl_analysis.refusal import Refusal, distinct, is_refused, read_refusals

REMEDY = "record again, give a reason under `exclude` in the sample sheet, or name the check under `accept`"
TRUNCATED = "truncated"
"""Check of quality control that fails where the end of a log is missing."""
JUDGES = ("quality", "fitted")
"""Inputs that only tell which trials are used: what was measured of them, and other results of the same trials."""
MEASURED = ("trial", "check", "value", "unit", "remark")  # columns of the file of a trial's checks


@dataclass(frozen=True)
class Usable:
    """The inputs of a job without refusal records.

    inputs: what is left, by name.
    refused: the causes of everything that was removed.
    missing: the causes without which the job cannot run; empty if it can.
    """

    inputs: Mapping[str, Any]
    refused: tuple[Refusal, ...] = ()
    missing: tuple[Refusal, ...] = ()


def without_refused(inputs: Mapping[str, Any], unnamed: Sequence[str] = ()) -> Usable:
    """The named inputs of a job without refusal records.

    A trial with a record in one list, or among those in `quality` or the results in `fitted`, is removed from
    every list. The job cannot run if a record stands for a single input or for one of the `unnamed` files, if the input
    `trial` is such a trial, or if nothing is left of a list; beside an input `trial`, lists may become empty. Lists by
    name are handed over as they are.
    """
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
    return Usable({**inputs, **kept}, distinct([*causes, *missing]), distinct(missing))


@dataclass(frozen=True)
class Judge:
    """What decides which trials are used: the configured rules of quality control, and what the sheet accepts by trial.

    A job that measures knows neither: a changed threshold judges again what was measured, and measures nothing again.
    A job over several trials finds it in a file, whose change alone runs no job again: its request names the trials
    that are excluded.
    """

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
        rows: list[dict[str, Any]] = []
        for path in measured:
            if path.is_file() and not is_refused(path):
                with path.open(newline="", encoding="utf-8") as file:
                    rows += csv.DictReader(file)
        values = [float(row["value"]) if row["value"] else None for row in rows]
        table = pl.DataFrame(rows, schema=dict.fromkeys(MEASURED, pl.String))
        return judged_table(table.with_columns(pl.Series("value", values, dtype=pl.Float64)), self.rules, self.accept)


def exclusions(verdicts: pl.DataFrame) -> dict[str, str]:
    """The trials that quality control excludes, and why."""
    reasons: dict[str, str] = {}
    for row in verdicts.filter(pl.col("verdict") == "exclude").iter_rows(named=True):
        said = f"{row['check']} {row['value']:.4g} {row['unit']}, threshold {row['threshold']}"
        said += f": {row['remark'].replace('; ', ', ')}" if row["remark"] else ""
        reasons[row["trial"]] = "; ".join(filter(None, [reasons.get(row["trial"]), said]))
    return reasons


def without_excluded(inputs: Mapping[str, Any], reasons: Mapping[str, str]) -> dict[str, Any]:
    """The named inputs of a job without the files of excluded trials (`exclusions`).

    Of the trials in the input `quality`, files with the name of an excluded one are removed from every list. The inputs
    `JUDGES` are not passed on. An excluded input `trial` is refused, and so are lists of excluded trials alone.
    """
    judged = {Path(path).stem for path in inputs.get("quality", ())}
    lists = {name: files for name, files in inputs.items() if isinstance(files, list) and name not in JUDGES}
    needed = {Path(file).stem for files in lists.values() for file in files} & judged
    single = {Path(str(inputs.get("trial"))).stem} & judged
    if single & set(reasons) or (needed | single and needed | single <= set(reasons)):
        why = "; ".join(f"{trial} ({reasons[trial]})" for trial in sorted(single or needed)[:3])
        raise InputError(f"quality control excludes every trial that is needed here: {why}; {REMEDY}")
    kept = {name: [file for file in files if Path(file).stem not in reasons] for name, files in lists.items()}
    return {name: kept.get(name, value) for name, value in inputs.items() if name not in JUDGES}


def exclusion_report(verdicts: pl.DataFrame, by_sheet: Mapping[str, str]) -> str:
    """Excluded trials with reasons, for the end of a run, also of a failed run; empty without excluded trials.

    `verdicts` are those on the trials that were examined, `by_sheet` has the reasons in the sample sheet.
    """
    reasons = exclusions(verdicts)
    judged = [f"excluded from tables and figures by quality control: {trial} ({why})" for trial, why in reasons.items()]
    stated = [f"excluded by the sample sheet: {trial} ({why})" for trial, why in by_sheet.items()]
    return "\n".join([*stated, *judged, *([f"to change that: {REMEDY}"] if judged else [])])


def left_behind_report(stored: Iterable[Path], trials: Collection[str]) -> str:
    """A line on trials that are not in the sample sheet, as after a renaming, whose files are still among the results.

    `stored` are the files of trials there, `trials` all those of the sheet. Empty without such files.
    """
    unknown = sorted({path.stem for path in stored} - set(trials))
    if not unknown:
        return ""
    return (
        f"not in the sample sheet, and in no table or figure: {listing(unknown, 12)}; files of theirs are left "
        "below the results; delete them, or enter the trials again"
    )


def truncation_report(verdicts: pl.DataFrame, recordings: Mapping[str, Sequence[str]]) -> str:
    """A line per trial that is used although the end of its recording is missing, for the end of a run.

    `recordings` has the raw files of every trial. A trial that the sheet accepts with this is not named.
    """
    cut = verdicts.filter(pl.col("check") == TRUNCATED, pl.col("verdict") == "flag")["trial"]
    return "\n".join(
        f"warning: trial {trial}, file {', '.join(recordings.get(trial, ()))}: the end of the log is missing, and what "
        "is there is analysed; copy or record it again, give a reason under `exclude` in the sample sheet, or write "
        f"`{TRUNCATED}` under `accept` there"
        for trial in cut
    )
