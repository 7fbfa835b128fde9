"""Trials that quality control excludes. They are not used in any result of several trials, and are always listed."""

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn

from osl_analysis.errors import InputError

REMEDY = "record again, give a reason under `exclude` in the sample sheet, or name the check under `accept`"


def excluded(quality: Iterable[Path]) -> dict[str, str]:
    """Excluded trials and why, from the quality tables of single trials."""
    reasons: dict[str, str] = {}
    for path in quality:
        with path.open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                if row["verdict"] == "exclude":
                    said = f"{row['check']} {float(row['value']):.4g} {row['unit']}, threshold {row['threshold']}"
                    reasons[row["trial"]] = "; ".join(filter(None, [reasons.get(row["trial"]), said]))
    return reasons


def without_excluded(inputs: Mapping[str, Any]) -> dict[str, Any]:
    """The named inputs of a job without the files of excluded trials; the input `quality` has the verdicts.

    Files with the name of an excluded trial are removed from every list.

    Raises
    ------
    InputError
        The input `trial` is excluded, or all trials of the lists are excluded.
    """
    quality = [Path(path) for path in inputs.get("quality", ())]
    judged, reasons = {path.stem for path in quality}, excluded(quality)
    lists = {name: files for name, files in inputs.items() if isinstance(files, list) and name != "quality"}
    needed = {Path(file).stem for files in lists.values() for file in files} & judged
    single = {Path(str(inputs.get("trial"))).stem} & judged
    if single & set(reasons) or (needed | single and needed | single <= set(reasons)):
        refuse({trial: reasons[trial] for trial in sorted(single or needed)})
    kept = {name: [file for file in files if Path(file).stem not in reasons] for name, files in lists.items()}
    return {name: kept.get(name, value) for name, value in inputs.items() if name != "quality"}


def refuse(reasons: Mapping[str, str]) -> NoReturn:
    """Raise an error: all trials that a job needs are excluded. The message has the first reasons."""
    why = "; ".join(f"{trial} ({reason})" for trial, reason in list(reasons.items())[:3])
    raise InputError(f"quality control excludes every trial that is needed here: {why}; {REMEDY}")


def exclusion_report(quality: Iterable[Path], by_sheet: Mapping[str, str]) -> str:
    """Excluded trials with reasons, for the end of a run, also of a failed run; empty without excluded trials.

    `by_sheet` has the reasons in the sample sheet. Trials without a quality table are ignored.
    """
    reasons = excluded(path for path in quality if path.is_file())
    judged = [f"excluded from tables and figures by quality control: {trial} ({why})" for trial, why in reasons.items()]
    stated = [f"excluded by the sample sheet: {trial} ({why})" for trial, why in by_sheet.items()]
    return "\n".join([*stated, *judged, *([f"to change that: {REMEDY}"] if judged else [])])
