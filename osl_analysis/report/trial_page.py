"""What the page shows of one trial."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import polars as pl

from osl_analysis.dictionary import DescribedTable
from osl_analysis.experiments import EXPERIMENTS
from osl_analysis.report.doubts import doubts_of
from osl_analysis.report.numbers import estimates_of, every_column, printed, said_of, shown
from osl_analysis.report.panels import Pictures
from osl_analysis.report.provenance import provenance_of

Verdict = Literal["used", "doubtful", "excluded", "refused"]
NOT_CONDITIONS = ("trial", "experiment", "log", "log_source", "mocap", "mocap_source", "log_part", "exclude", "accept")
"""Columns of the sheet that are not conditions of the trial."""


@dataclass(frozen=True)
class ReportedTrial:
    """One trial, as far as the campaign's results know it.

    row: its row of the sample sheet.
    tables: the rows of each of its result tables, by table; those of its fit first.
    quality: verdicts of quality control on it; None if it was never examined.
    provenance: what ingest wrote about it.
    left_out: why it has no result, or is excluded; a line each.
    refused: whether it is missing because a job refused or failed.
    pictures: what is drawn.
    """

    name: str
    row: Mapping[str, Any]
    tables: Mapping[str, pl.DataFrame] = field(default_factory=dict)
    quality: pl.DataFrame | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    left_out: Sequence[str] = ()
    refused: bool = False
    pictures: Pictures = field(default_factory=Pictures)

    @property
    def main(self) -> pl.DataFrame:
        """The rows of its fit; an empty table if it has none."""
        return next(iter(self.tables.values()), pl.DataFrame())

    @property
    def doubtful(self) -> bool:
        """Whether any of its fits is doubtful."""
        return "doubtful" in self.main.columns and bool((self.main["doubtful"].fill_null("") != "").any())

    @property
    def verdict(self) -> Verdict:
        """What becomes of it."""
        if self.left_out:
            return "refused" if self.refused else "excluded"
        return "doubtful" if self.doubtful else "used"

    def not_checked(self) -> list[str]:
        """What its fit could not check."""
        found = self.main["not_checked"] if "not_checked" in self.main.columns else pl.Series(dtype=pl.String)
        return [str(reason) for reason in found.drop_nulls().unique(maintain_order=True)]

    def condition(self, columns: Collection[str] | None = None) -> str:
        """Its conditions in one line, or those of them in these columns of the sheet."""
        said = {name: value for name, value in self.row.items() if name not in NOT_CONDITIONS and value is not None}
        words = {True: "perturbed", False: "unperturbed"}
        return ", ".join(
            words[bool(value)] if name == "perturbed" else f"{name} {shown(value)}"
            for name, value in said.items()
            if columns is None or name in columns
        )

    def estimates(self) -> Mapping[str, Any]:
        """Its estimates that stand for K, B and I, from the fit to all of it; empty without a fit."""
        return self.main.row(-1, named=True) if len(self.main) else {}


def trial_content(
    trial: ReportedTrial, described: Mapping[str, DescribedTable], checks: Mapping[str, str]
) -> dict[str, Any]:
    """All text of a trial for the page; `checks` has the meaning of each check of quality control."""
    tables = {name: table for name, table in trial.tables.items() if len(table)}
    name = next(iter(tables), "")
    return {
        "name": trial.name,
        "experiment": trial.row["experiment"],
        "description": EXPERIMENTS[trial.row["experiment"]].description,
        "condition": trial.condition(),
        "verdict": trial.verdict,
        "left_out": list(trial.left_out),
        "doubts": doubts_of(tables, described),
        "not_checked": trial.not_checked(),
        "table": name,
        "estimates": estimates_of(tables[name], described.get(name)) if tables else None,
        "columns": every_column(tables[name], described.get(name)) if tables else [],
        "quality": quality_rows(trial.quality, checks),
        "time_base": time_base(trial.tables.get("timebase"), described.get("timebase")),
        "provenance": provenance_of(trial.provenance),
        "panels": [panel.content() for panel in trial.pictures.panels],
        "remark": trial.pictures.remark,
    }


def quality_rows(quality: pl.DataFrame | None, checks: Mapping[str, str]) -> list[list[str]]:
    """Check, meaning, value, threshold, verdict and remark of every check."""
    if quality is None:
        return []
    return [
        [
            row["check"], checks.get(row["check"], ""), with_unit(row["value"], row["unit"]),
            with_unit(row["threshold"], row["unit"]), row["verdict"], row["remark"] or "",
        ]
        for row in quality.iter_rows(named=True)
    ]  # fmt: skip


def with_unit(value: float | None, unit: str | None) -> str:
    """A value with its unit."""
    return shown(value) if value is None else f"{shown(value)} {printed(unit or '')}".strip()


def time_base(table: pl.DataFrame | None, described: DescribedTable | None) -> list[list[str]]:
    """What the time base did to each group of signals: column, its values, its meaning."""
    if table is None:
        return []
    names = [name for name in table.columns if name not in ("trial", "joint", "side", "data", "signals")]
    filled = [name for name in names if table[name].count()]
    signals = table["signals"].to_list()
    lines = [["signals", *map(shown, signals), ""]]
    return lines + [[name, *map(shown, table[name]), said_of(name, described)["meaning"]] for name in filled]
