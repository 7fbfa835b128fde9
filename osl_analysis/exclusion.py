"""Trials that quality control excludes: left out of what is computed over trials, by name and never silently."""

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path

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


def kept(files: Iterable[str | Path], quality: Iterable[str | Path]) -> list[Path]:
    """Of files named after their trials, those whose trial is not excluded.

    Raises
    ------
    InputError
        Nothing is left.
    """
    paths, reasons = [Path(file) for file in files], excluded(Path(path) for path in quality)
    left = [path for path in paths if path.stem not in reasons]
    if paths and not left:
        why = "; ".join(f"{trial} ({reasons[trial]})" for trial in list(reasons)[:3])
        raise InputError(f"quality control excludes every trial that is needed here: {why}; {REMEDY}")
    return left


def exclusion_report(quality: Iterable[Path], by_sheet: Mapping[str, str]) -> str:
    """What a user must know at the end of a run, even of one that failed: who was left out, and why; empty if nobody.

    Trials whose table was not written are passed over.
    """
    reasons = excluded(path for path in quality if path.is_file())
    lines = [f"left out of tables and figures by quality control: {trial} ({why})" for trial, why in reasons.items()]
    stated = [f"left out by the sample sheet: {trial} ({why})" for trial, why in by_sheet.items()]
    return "\n".join([*stated, *lines, *([f"to change that: {REMEDY}"] if lines else [])])
