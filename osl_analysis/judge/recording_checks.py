# SPDX-License-Identifier: Apache-2.0
"""Judge recordings by the thresholds of the configuration, and list the trials that are excluded.

`ingest/quality.py` measures the values: it needs samples and no thresholds. Judging needs a few
numbers and no samples. So a changed threshold judges again and measures nothing.

Example: `judged_table(measured, QualityRules(gap="0.05 s"), accept={})`.
"""

import csv
import re
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import polars as pl
from pydantic import ConfigDict, Field, model_validator

from osl_analysis.base.errors import nearest
from osl_analysis.base.table import unquoted
from osl_analysis.base.yaml_settings import Settings, misplaced
from osl_analysis.dictionary.described import table_of
from osl_analysis.ingest.quality import CheckResult
from osl_analysis.judge.checks import CHECKS
from osl_analysis.judge.known_findings import FINDINGS
from osl_analysis.stats.sources import Source


class QualityRules(Settings):
    """The threshold of each check with its unit, under the check's name, as `gap: 0.05 s`.

    Without a threshold a single fault is beyond it. A trial beyond it is flagged or excluded.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, str] = Field(init=False)

    # Checks whose failure excludes a trial from every table and figure but that of quality.
    exclude: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _checks_are_known(self) -> "QualityRules":
        thresholds = self.__pydantic_extra__
        for name in (*thresholds, *self.exclude):
            if name not in CHECKS:
                raise misplaced(unknown_check(name), name if name in thresholds else "exclude")
        for name, threshold in thresholds.items():
            unit = CHECKS[name].unit
            if not re.fullmatch(rf"\d+(\.\d*)?(e-?\d+)? +{re.escape(unit)}", threshold):
                reason = f"'{threshold}' must be a number from 0 and its unit, as in '1 {unit}'"
                raise misplaced(reason, name)
        return self

    def limit(self, check: str) -> float:
        """The threshold of a check, in its unit."""
        return float(self.__pydantic_extra__.get(check, "0").partition(" ")[0])


NOT_APPLICABLE = "not applicable"  # a verdict


def unknown_check(name: str) -> str:
    return (
        f"'{name}' is no quality check; the checks are {', '.join(CHECKS)}{nearest(name, CHECKS)}"
    )


def spoiled_trials(verdicts: pl.DataFrame) -> dict[str, Source]:
    """By trial, the source of its first failed check that spoils all estimates."""
    spoiled: dict[str, Source] = {}
    failed = verdicts.filter(pl.col("verdict").is_in(["flag", "exclude"]))
    for trial, check in failed.select("trial", "check").iter_rows():
        finding = CHECKS[check].source
        if FINDINGS[finding].spoils_estimates:
            spoiled.setdefault(trial, finding)
    return spoiled


def judged_table(
    measured: pl.DataFrame, rules: QualityRules, accept: Mapping[str, Collection[str]]
) -> pl.DataFrame:
    """Judge measured values of recordings.

    Parameters
    ----------
    measured : polars.DataFrame
        `measured_table` of trials. Checks of an older release are left out: their trials are
        ingested again.
    rules : QualityRules
    accept : Mapping of str to Collection of str
        Checks that the sheet accepts, by trial.

    Returns
    -------
    polars.DataFrame
        With thresholds and verdicts, as in `quality.csv`.
    """
    rows = []
    rows_of_known_checks = measured.filter(pl.col("check").is_in(list(CHECKS)))
    for row in rows_of_known_checks.select("trial", "check", "value", "unit", "remark").to_dicts():
        name = row["check"]
        limit = rules.limit(name)
        remarks = [row["remark"]] if row["remark"] else []
        verdict = NOT_APPLICABLE if row["value"] is None else "pass"
        if CHECKS[name].failed(row["value"], limit):
            if name in accept.get(row["trial"], ()):
                remarks.insert(0, "accepted in the sheet")
            else:
                verdict = "exclude" if name in rules.exclude else "flag"
        judgement = {"threshold": limit, "verdict": verdict, "remark": "; ".join(remarks)}
        rows.append({**row, **judgement})
    return table_of(rows, "quality")


HOW_TO_USE = (
    "record again, give a reason under `exclude` in the sample sheet, or name the check under"
    " `accept`"
)
CHECKED = ["trial", "check", "value", "unit", "remark", "status", "reason"]
"""The columns of the file of a trial, also of one that could not be measured."""


def measured_table(trial: str, results: Mapping[str, CheckResult]) -> pl.DataFrame:
    """The results of `measure_quality`, a row per check: trial, check, value, unit, remark."""
    rows = [
        {"trial": trial, "check": name, "unit": CHECKS[name].unit, **vars(result)}
        for name, result in results.items()
    ]
    return table_of(rows, "quality").drop("threshold", "verdict")


def read_verdicts(
    paths: Iterable[Path], rules: QualityRules, accept: Mapping[str, Collection[str]]
) -> pl.DataFrame:
    """The rows of `quality.csv` by files of measured checks. A trial that was not analysed has
    none."""
    rows: list[dict[str, Any]] = []
    for path in paths:  # Polars would take ten times as long for such small files
        with path.open(newline="", encoding="utf-8") as file:
            rows += csv.DictReader(file)
    if not rows:
        return table_of([], "quality")
    measured = pl.DataFrame(rows).with_columns(pl.col("value").replace("", None).cast(pl.Float64))
    return judged_table(unquoted(measured), rules, accept)


# Values of `check` in excluded.csv for trials that no check excludes
REFUSED = "refused"  # by the job that reads or fits it
LACKING = "needs another"  # trial, which was refused or excluded
BY_JOB = (REFUSED, LACKING)
BY_SHEET = "sample sheet"
CROSSING = "crossing"  # of the walkway, which cannot be used or stands out


def exclusion_text(row: Mapping[str, Any]) -> str:
    """The reason for which a trial is not used, by a row of `quality.csv` or `excluded.csv`."""
    if row["value"] is None:
        return str(row["remark"])
    reason = f"{row['check']} {row['value']:.4g} {row['unit']}, threshold {row['threshold']}"
    if not row["remark"]:
        return reason
    return f"{reason}: {row['remark'].replace('; ', ', ')}"
