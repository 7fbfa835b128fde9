"""Which trials a job uses: not those that quality control excludes, nor those without a result
(`refusal`)."""

import csv
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Self

import polars as pl

from osl_analysis.errors import InputError, listing
from osl_analysis.files import write_text
from osl_analysis.judge.limits import QualityRules, judged_table
from osl_analysis.refusal import Refusal, distinct_causes, is_refused, read_refusals

HOW_TO_USE = (
    "record again, give a reason under `exclude` in the sample sheet, or name the check under"
    " `accept`"
)
JUDGES = ("quality", "fitted")
"""Inputs that only tell which trials are used: measured checks, and other results of the same
trials."""


def without_refused(
    inputs: Mapping[str, Any], unnamed: Sequence[str] = ()
) -> tuple[dict[str, Any], tuple[Refusal, ...], tuple[Refusal, ...]]:
    """The named inputs of a job without refusal records, the causes of all that was removed, and
    those that keep the job from running. A trial with a record in one list is removed from every
    list. The job cannot run if a record stands for a single input or one of the `unnamed` files, if
    the input `trial` is such a trial, or if a list loses everything; beside an input `trial`, lists
    may become empty. Lists by name are passed on unchanged."""
    lists = {name: files for name, files in inputs.items() if isinstance(files, list)}
    alone = [file for file in inputs.values() if not isinstance(file, list | Mapping)]
    gone = {
        Path(file).stem: read_refusals(file) for file in chain(*lists.values()) if is_refused(file)
    }
    causes, missing, kept = (
        [*chain(*gone.values())],
        [*chain(*map(read_refusals, [*alone, *unnamed]))],
        dict(inputs),
    )
    for name, files in lists.items():
        kept[name] = [file for file in files if Path(file).stem not in gone]
        if not kept[name] and name not in JUDGES and "trial" not in inputs:
            missing += chain(*(gone[Path(file).stem] for file in files))
    for name, files in inputs.items():
        if isinstance(files, Mapping) and not any(
            isinstance(file, list) for file in files.values()
        ):
            kept[name] = {key: file for key, file in files.items() if not is_refused(file)}
            causes += chain(*map(read_refusals, files.values()))
    missing += gone.get(Path(str(inputs.get("trial"))).stem, ())
    return kept, distinct_causes([*causes, *missing]), distinct_causes(missing)


@dataclass(frozen=True)
class Judge:
    """What decides which trials are used: the configured rules, and the checks that the sheet
    accepts by trial. Measuring jobs know neither. A job over several trials reads them from a file,
    whose change alone reruns no job."""

    rules: QualityRules
    accept: Mapping[str, Collection[str]]

    def write(self, path: Path) -> None:
        accept = {trial: list(names) for trial, names in self.accept.items() if names}
        write_text(
            path, json.dumps({"rules": self.rules.model_dump(mode="json"), "accept": accept})
        )

    @classmethod
    def read(cls, path: Path) -> Self:
        said = json.loads(path.read_text(encoding="utf-8"))
        return cls(QualityRules.model_validate(said["rules"]), said["accept"])

    def verdicts(self, measured: Iterable[Path]) -> pl.DataFrame:
        """The rows of `quality.csv` for trials whose checks were measured; a missing file, or a
        record, has none."""
        kinds = dict.fromkeys(("trial", "check", "value", "unit", "remark"), pl.String) | {
            "value": pl.Float64
        }
        rows = list[dict[str, Any]]()
        for path in measured:
            if path.is_file() and not is_refused(path):
                # polars would take ten times as long
                with path.open(newline="", encoding="utf-8") as file:
                    own = csv.DictReader(file)
                    rows += [
                        {**row, "value": float(row["value"]) if row["value"] else None}
                        for row in own
                    ]
        return judged_table(pl.DataFrame(rows, kinds), self.rules, self.accept)


def exclusion_said(row: Mapping[str, Any]) -> str:
    """Why a trial is not used, by a row of `quality.csv` or `excluded.csv`: check, value,
    threshold, what was seen."""
    if row["value"] is None:
        return f"{row['check']}: {row['remark']}"
    said = f"{row['check']} {row['value']:.4g} {row['unit']}, threshold {row['threshold']}"
    return said + (f": {row['remark'].replace('; ', ', ')}" if row["remark"] else "")


def exclusions(verdicts: pl.DataFrame) -> dict[str, str]:
    """The trials that quality control excludes, and why."""
    reasons: dict[str, str] = {}
    for row in verdicts.filter(pl.col("verdict") == "exclude").iter_rows(named=True):
        reasons[row["trial"]] = "; ".join(
            filter(None, [reasons.get(row["trial"]), exclusion_said(row)])
        )
    return reasons


def without_excluded(inputs: Mapping[str, Any], reasons: Mapping[str, str]) -> dict[str, Any]:
    """The named inputs of a job without `JUDGES` and without the files of excluded trials
    (`exclusions`), of those in the input `quality`. An excluded input `trial` is refused, and so
    are lists of excluded trials alone."""
    judged = {Path(path).stem for path in inputs.get("quality", ())}
    lists = {
        name: files
        for name, files in inputs.items()
        if isinstance(files, list) and name not in JUDGES
    }
    needed = {Path(file).stem for files in lists.values() for file in files} & judged
    single = {Path(str(inputs.get("trial"))).stem} & judged
    if single & set(reasons) or (needed | single and needed | single <= set(reasons)):
        why = "; ".join(f"{trial} ({reasons[trial]})" for trial in sorted(single or needed)[:3])
        raise InputError(
            f"quality control excludes every trial that is needed here: {why}; {HOW_TO_USE}"
        )
    kept = {
        name: [file for file in files if Path(file).stem not in reasons]
        for name, files in lists.items()
    }
    return {name: kept.get(name, value) for name, value in inputs.items() if name not in JUDGES}


def left_behind_report(stored: Iterable[Path], trials: Collection[str]) -> str:
    """A line on trials with `stored` files that are not in the sheet, as after a renaming; empty if
    there are none."""
    unknown = sorted({path.stem for path in stored} - set(trials))
    said = (
        f"not in the sample sheet, and in no table or figure: {listing(unknown, 12)}; files of"
        " theirs are left below"
    )
    return f"{said} the results; delete them, or enter the trials again" if unknown else ""
