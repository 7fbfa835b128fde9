"""Trials that quality control excludes: left out of what is computed over trials, by name and never silently."""

import csv
from collections.abc import Iterable
from pathlib import Path

from osl_analysis.errors import InputError

REMEDY = "record again, give a reason under `exclude` in the sample sheet, or name the check under `accept`"


def excluded(quality: Iterable[Path]) -> dict[str, str]:
    """Excluded trials and why, from the quality tables of single trials (or from the list of excluded ones)."""
    reasons: dict[str, str] = {}
    for path in quality:
        with path.open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                if row.get("verdict", "exclude") == "exclude":
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


def exclusion_report(listed: Path) -> str:
    """What a user must know at the end of a run: which trials were left out, and why; empty if none."""
    reasons = excluded([listed]) if listed.is_file() else {}
    lines = [f"left out by quality control: {trial} ({why})" for trial, why in reasons.items()]
    return "\n".join(
        [*lines, f"({listed}; to use them after all, name the check under `accept` in the sheet)"] * bool(lines)
    )
