"""Which trials quality control excludes, and why."""

import csv
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import polars as pl

from osl_analysis.files import file_state
from osl_analysis.judge.limits import QualityRules, judged_table
from osl_analysis.refusal import is_refused

HOW_TO_USE = (
    "record again, give a reason under `exclude` in the sample sheet, or name the check under"
    " `accept`"
)


@dataclass(frozen=True)
class Judge:
    """What decides which trials are used: the configured rules, and the checks that the sheet
    accepts by trial. Measuring jobs know neither."""

    rules: QualityRules
    accept: Mapping[str, Collection[str]]
    known: dict[tuple[tuple[Path, str], ...], list[str]] = field(default_factory=dict)

    def verdicts(self, measured: Iterable[Path]) -> pl.DataFrame:
        """The rows of `quality.csv` for trials whose checks were measured; a missing file, or a
        refusal, has none."""
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

    def excluded(self, measured: Iterable[Path]) -> list[str]:
        """The trials whose measured checks exclude them; a file that is not there excludes none."""
        files = list(measured)
        # a run asks again for each of its rules, mostly of files that have not changed
        states = tuple((path, repr(file_state(path))) for path in files)
        if states not in self.known:
            self.known[states] = list(exclusions(self.verdicts(files)))
        return self.known[states]


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
