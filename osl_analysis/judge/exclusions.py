"""Which trials quality control excludes, and why."""

import csv
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.judge.recording_checks import QualityRules, judged_table, spoiled_trials
from osl_analysis.table import not_analysed

HOW_TO_USE = (
    "record again, give a reason under `exclude` in the sample sheet, or name the check under"
    " `accept`"
)
MEASURED_COLUMNS = {
    "trial": pl.String,
    "check": pl.String,
    "value": pl.Float64,
    "unit": pl.String,
    "remark": pl.String,
}


@dataclass(frozen=True)
class Judge:
    """What decides which trials are used. Jobs that measure know nothing of it.

    Attributes
    ----------
    rules
        The configured thresholds.
    accept
        The checks that the sheet accepts, by trial.
    verdicts_by_states
        Verdicts by the last changes [ns] of the files that tell them: a run asks again for each of
        its rules, mostly of files that have not changed.
    """

    rules: QualityRules
    accept: Mapping[str, Collection[str]]
    verdicts_by_states: dict[tuple[tuple[Path, int], ...], pl.DataFrame] = field(
        default_factory=dict
    )

    def verdicts(self, measured: Iterable[Path]) -> pl.DataFrame:
        """The rows of `quality.csv` for trials whose checks were `measured`; a missing file, or
        a trial that was not analysed, has none."""
        files = list(measured)
        states = tuple((path, path.stat().st_mtime_ns if path.is_file() else 0) for path in files)
        if states not in self.verdicts_by_states:
            rows: list[dict[str, Any]] = []
            for path in files:
                if path.is_file() and not not_analysed(path):
                    rows += read_measured(path)
            table = pl.DataFrame(rows, MEASURED_COLUMNS)
            self.verdicts_by_states[states] = judged_table(table, self.rules, self.accept)
        return self.verdicts_by_states[states]

    def excluded(self, measured: Iterable[Path]) -> list[str]:
        """The trials whose `measured` checks exclude them; a file that is not there excludes
        none."""
        return list(exclusions(self.verdicts(measured)))

    def spoiled(self, measured: Iterable[Path]) -> dict[str, str]:
        """By trial, the fault of its recording beside which no estimate can be trusted."""
        return spoiled_trials(self.verdicts(measured))


def read_measured(path: Path) -> list[dict[str, Any]]:
    """The measured checks of one trial. Polars would take ten times as long for such small
    files."""
    rows: list[dict[str, Any]] = []
    with path.open(newline="", encoding="utf-8") as file:
        for cells in csv.DictReader(file):
            value = float(cells["value"]) if cells["value"] else None
            rows.append({**cells, "value": value})
    return rows


def exclusion_text(row: Mapping[str, Any]) -> str:
    """Why a trial is not used, by a row of `quality.csv` or `excluded.csv`: check, value,
    threshold, what was seen."""
    if row["value"] is None:
        return f"{row['check']}: {row['remark']}"
    reason = f"{row['check']} {row['value']:.4g} {row['unit']}, threshold {row['threshold']}"
    if not row["remark"]:
        return reason
    return f"{reason}: {row['remark'].replace('; ', ', ')}"


def exclusions(verdicts: pl.DataFrame) -> dict[str, str]:
    """The trials that quality control excludes, and why."""
    reasons: dict[str, list[str]] = {}
    for row in verdicts.filter(pl.col("verdict") == "exclude").iter_rows(named=True):
        reasons.setdefault(row["trial"], []).append(exclusion_text(row))
    return {trial: "; ".join(texts) for trial, texts in reasons.items()}
