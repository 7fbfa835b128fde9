"""A trial of the page with its results: what is doubted of it, and its verdict."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any

import polars as pl

from osl_analysis.judge.campaign import QUALITY
from osl_analysis.judge.finding import Beyond, Finding, Grade, WordedFinding, Words
from osl_analysis.judge.known_findings import CHECKS
from osl_analysis.judge.words import sentence_of
from osl_analysis.report.panels import Pictures
from osl_analysis.report.shown_numbers import cell_text, unit_and_meaning
from osl_analysis.report.typography import printed

VERDICTS = ("clear", "doubtful in part", "flagged", "doubtful", "excluded", "refused")
"""Verdicts on a trial: `doubtful`: the fit to all of it is; `doubtful in part`: others are. The
last two are unused."""


class Scope(StrEnum):
    """What of a trial a doubt is about; `report.js` sorts doubts by it. The worst first."""

    WHOLE_FIT = "whole fit"
    RECORDING = "recording"
    PART_OF_FIT = "part of the fit"
    OTHER_TABLE = "other table"


VERDICT_BY_SCOPE = {
    Scope.WHOLE_FIT: "doubtful",
    Scope.RECORDING: "flagged",
    Scope.PART_OF_FIT: "doubtful in part",
    Scope.OTHER_TABLE: "doubtful in part",
}
"""The verdict on a trial that a doubt leads to."""


@dataclass(frozen=True)
class Doubt:
    """A doubt about a trial, for a reader.

    Attributes
    ----------
    where
        An amplitude and frequency, its recording, or another table.
    scope
        What of the trial it is about.
    numbers
        Evidence: column, value, limit and meaning of each.
    says, size, remedy, text
        Its words, and all of them in a sentence.
    """

    where: str
    scope: Scope
    cause: str
    numbers: list[list[str]]
    says: str
    size: str
    remedy: str
    text: str

    @property
    def verdict(self) -> str:
        return VERDICT_BY_SCOPE[self.scope]


def doubt_of(worded: WordedFinding, main_table: str) -> Doubt:
    """A finding as a doubt about a trial; `main_table` is that of the trial's fit."""
    finding = worded.finding
    place = place_of(finding)
    if finding.table == QUALITY:
        where = "its recording"
        scope = Scope.RECORDING
    elif finding.table != main_table:
        where = f"{finding.table.replace('_', ' ')}, {place}"
        scope = Scope.OTHER_TABLE
    else:
        where = place
        scope = Scope.PART_OF_FIT if finding.is_of_part else Scope.WHOLE_FIT
    words = Words(*map(printed, worded.words))
    return Doubt(
        where=where,
        scope=scope,
        cause=finding.cause,
        numbers=[number_cells(number, finding.table) for number in finding.evidence],
        says=words.says,
        size=words.size,
        remedy=words.remedy,
        text=sentence_of(words, finding.cause),
    )


def place_of(finding: Finding) -> str:
    """The amplitude and the frequency that a finding is about, or all of them."""
    parts = []
    if finding.amplitude_deg is not None:
        parts.append(f"{finding.amplitude_deg:g} deg")
    if finding.frequency_hz is not None:
        parts.append(f"{finding.frequency_hz:g} Hz")
    if parts:
        return ", ".join(parts)
    return "all amplitudes" if finding.table == "impedance" else "whole trial"


def number_cells(number: Beyond, table: str) -> list[str]:
    """Column, value, limit and meaning of a number beyond its limit."""
    if table == QUALITY:
        meaning = CHECKS[number.column].meaning
    else:
        meaning = unit_and_meaning(number.column, table)["meaning"]
    sides = {"nan": "not a number", "near": "near a factor between units"}
    limit = sides.get(number.side, f"{number.side} {number.limit:g}")
    return [printed(number.column), printed(f"{number.value:.3g}"), printed(limit), meaning]


NO_CONDITIONS = (
    "trial",
    "experiment",
    "log",
    "log_source",
    "mocap",
    "mocap_source",
    "log_part",
    "exclude",
    "accept",
)
"""Columns of the sample sheet that are no conditions of a trial."""


@dataclass(frozen=True)
class ReportedTrial:
    """One trial with its results.

    Attributes
    ----------
    row
        Its row of the sample sheet.
    tables
        Its rows of each table, that of its fit first.
    findings
        Those of `findings.csv` about it.
    quality
        Verdicts on it; None if it was never examined.
    provenance
        Where its columns come from.
    left_out
        Why it has no result, or is excluded.
    left_out_for
        The cause of the first of these reasons, in a few words.
    refused
        Whether it is missing because a job refused or failed.
    """

    name: str
    row: Mapping[str, Any]
    tables: Mapping[str, pl.DataFrame] = field(default_factory=dict)
    findings: Sequence[WordedFinding] = ()
    quality: pl.DataFrame | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    left_out: Sequence[str] = ()
    left_out_for: str = ""
    refused: bool = False
    pictures: Pictures = field(default_factory=lambda: Pictures([], {}))

    @property
    def main(self) -> pl.DataFrame:
        """The rows of its fit; an empty table if it has none."""
        return next(iter(self.tables.values()), pl.DataFrame())

    @property
    def main_table(self) -> str:
        """The name of the table of its fit; empty if it has none."""
        return next(iter(self.tables), "")

    @property
    def unchecked(self) -> list[WordedFinding]:
        """Findings on the fit to all of it that could not be checked, and remarks."""
        unchecked = []
        for worded in self.findings:
            finding = worded.finding
            is_of_whole_fit = finding.table == self.main_table and not finding.is_of_part
            if is_of_whole_fit and finding.grade in (Grade.UNCHECKED, Grade.NOTES):
                unchecked.append(worded)
        return unchecked

    @cached_property
    def doubts(self) -> list[Doubt]:
        """Each doubt about it. Doubts that other tables only repeat are left out."""
        doubts = []
        for worded in self.findings:
            if worded.finding.grade is Grade.DOUBTS and not worded.finding.inherited:
                doubts.append(doubt_of(worded, self.main_table))
        return doubts

    @property
    def doubts_worst_first(self) -> list[Doubt]:
        """The doubts about it in the order of `Scope`."""
        scopes = list(Scope)
        return sorted(self.doubts, key=lambda doubt: scopes.index(doubt.scope))

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`: the worst that follows from its doubts."""
        if self.left_out:
            return "refused" if self.refused else "excluded"
        verdicts = {doubt.verdict for doubt in self.doubts}
        for verdict in VERDICT_BY_SCOPE.values():
            if verdict in verdicts:
                return verdict
        return "clear"

    def causes_of(self, verdict: str) -> set[str]:
        """The causes of a verdict. Only the worst doubt of each cause counts, as in the map of
        trials and causes."""
        worst: dict[str, str] = {}
        for doubt in self.doubts_worst_first:
            worst.setdefault(doubt.cause, doubt.verdict)
        return {cause for cause, worst_verdict in worst.items() if worst_verdict == verdict}

    def condition(self, columns: Collection[str] | None = None) -> str:
        """Its conditions in one line; with `columns`, only those in these columns of the sheet."""
        texts = []
        for name, value in self.row.items():
            is_asked = columns is None or name in columns
            if name in NO_CONDITIONS or value is None or not is_asked:
                continue
            if name == "perturbed":
                texts.append("perturbed" if value else "unperturbed")
            else:
                texts.append(f"{name} {cell_text(value)}")
        return ", ".join(texts)
