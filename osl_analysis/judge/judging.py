"""Findings about the rows of result tables, from their columns and the configured limits, and the
tables with them.

What a known cause explains, such as a low VAF due to friction, is no finding of its own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.judge.causes import (
    BETWEEN,
    CauseInRow,
    causes_in,
    explaining,
    limits_in,
    numbers_beyond,
    with_effects,
)
from osl_analysis.judge.finding import (
    AnyRow,
    Beyond,
    Finding,
    Grade,
    Remedy,
    cell_number,
    subject_of,
)
from osl_analysis.judge.known_findings import EVIDENCE, FINDINGS, HYPOTHESES, KnownFinding
from osl_analysis.judge.limits import Limits
from osl_analysis.judge.moved_estimates import (
    corrections,
    is_within_accuracy,
    leaves_torque,
)
from osl_analysis.judge.unchecked import unchecked_in
from osl_analysis.stats.repeats import DOUBTFUL

HAVE_REMARKS = (
    "belt",
    "transmission",
    "actuator",
    "impedance",
    "response",
    "torque_angle",
    "walking_groups",
)
"""Judged tables of which something may be remarked, or could not be checked."""
# by what could not be checked: the doubt that covers it
DOUBT_THAT_COVERS = {"rest_torque": "assumed_zero"}
UNEXPLAINED = "unexplained_torque"  # finding of torque that no rival explains
RIVALS = set(HYPOTHESES.values())
EXCLUDED = "excluded"  # column with the reason why a row has no fit; null in rows with a fit
RowFindings = list[list[Finding]]  # for each row of a table


def of_whole_trial(row: AnyRow) -> bool:
    """Whether a row is the fit to a whole trial, beside fits to single amplitudes."""
    return "amplitude_deg" in row and row["amplitude_deg"] is None


def check_limits(table: pl.DataFrame, limits: Limits, name: str) -> None:
    """Raises InputError: a limit is set on a column that the table does not have or that is not
    numeric."""
    numeric = {
        column for column, dtype in table.schema.items() if dtype.is_numeric() or dtype == pl.Null
    }
    for limit in limits.stated():
        if limit.value is not None and limit.column not in numeric:
            possible = ", ".join(name for name in table.columns if table[name].dtype.is_numeric())
            raise InputError(
                f"configuration, doubtful.{name}: the table has no column '{limit.column}' of"
                f" numbers; put the limit on one of {possible}, or write null for no limit"
            )


@dataclass(frozen=True)
class JudgedRow:
    """A row of a result table with its numbers beyond their limits."""

    row: AnyRow
    numbers: Mapping[str, Beyond]  # by column
    is_fit: bool

    @property
    def trial(self) -> object:
        return self.row.get("trial")


def is_of_recording(column: str) -> bool:
    """Whether a column is evidence of a fault of the recording, which the fit to all of a trial
    must show, too."""
    return column in EVIDENCE and FINDINGS[EVIDENCE[column].finding].of_recording


def remedy_of(judged_row: JudgedRow, has_amplitudes: bool, is_whole_sound: bool) -> Remedy:
    """Which remedy helps for a row."""
    if judged_row.row.get("frequency_hz") is not None:
        return Remedy.FREQUENCY
    if judged_row.row.get("amplitude_deg") is not None and is_whole_sound:
        return Remedy.AMPLITUDE
    return Remedy.WHOLE if has_amplitudes else Remedy.ALONE


def judged(
    table: pl.DataFrame, limits: Limits, name: str, faults: Mapping[str, str] | None = None
) -> RowFindings:
    """Judge each row of a table.

    Parameters
    ----------
    table : polars.DataFrame
        A result table with its evidence.
    limits : Limits
        Accuracy and limits of the configuration.
    name : str
        The name of the table.
    faults : Mapping of str to str, optional
        By trial, the finding of a failed check of its recording beside which no estimate can be
        trusted (`recording_checks.spoiled_trials`).

    Returns
    -------
    list of list of Finding
        For each row doubts in the order of their limits, remarks on the device, then what could
        not be checked; nothing of faults that move the estimates by less than their accuracy. Rows
        without a fit have none.

    Raises
    ------
    InputError
        As `check_limits`.
    """
    is_fit = [True] * len(table)
    if EXCLUDED in table.columns:
        is_fit = table[EXCLUDED].is_null().to_list()
    if any(is_fit):
        check_limits(table, limits, name)
    on_columns = limits_in(name, table.columns, limits)
    rows: list[JudgedRow] = []
    for cells, has_fit in zip(table.to_dicts(), is_fit, strict=True):
        rows.append(JudgedRow(cells, numbers_beyond(cells, on_columns), has_fit))
    of_whole = {row.trial: row.numbers for row in rows if of_whole_trial(row.row)}
    with_amplitudes = {row.trial for row in rows if row.row.get("amplitude_deg") is not None}
    rows = [shown_by_whole(row, of_whole) for row in rows]
    misfit_of_trial = misfits_by_trial(rows)
    findings: RowFindings = []
    for row in rows:
        if not row.is_fit:
            findings.append([])
            continue
        is_whole_sound = row.trial in of_whole and not of_whole[row.trial]
        remedy = remedy_of(row, row.trial in with_amplitudes, is_whole_sound)
        misfit_by = explaining(row.row, row.numbers) or misfit_of_trial[row.trial]
        causes = [
            each
            for each in causes_in(row.row, row.numbers, misfit_by)
            if each.cause.is_result
            or not is_within_accuracy(name, row.row, each.cause, each.numbers, limits.accuracy)
        ]
        fault = FINDINGS.get((faults or {}).get(str(row.trial), ""))
        findings.append(findings_of_row(name, row.row, with_effects(causes, fault), remedy))
    return findings


def shown_by_whole(row: JudgedRow, of_whole: Mapping[object, Mapping[str, Beyond]]) -> JudgedRow:
    """Drop from a row the evidence of a recording's fault that the fit to the whole trial does not
    show. At one amplitude friction looks like such a fault; over all amplitudes it does not.

    Parameters
    ----------
    row
        A row of a table.
    of_whole
        By trial, the numbers of the fit to all of it. A trial without such a row is judged by its
        rows alone.
    """
    if row.trial not in of_whole:
        return row
    numbers_of_whole = of_whole[row.trial]
    shown = {
        column: number
        for column, number in row.numbers.items()
        if column in numbers_of_whole or not is_of_recording(column)
    }
    return replace(row, numbers=shown)


def misfits_by_trial(rows: Sequence[JudgedRow]) -> dict[object, KnownFinding | None]:
    """What explains the misfit of each trial: as the fit to the whole trial says, or else the first
    of its rows that says anything."""
    of_whole: dict[object, KnownFinding | None] = {}
    of_rows: dict[object, KnownFinding | None] = {}
    for row in rows:
        by_trial = of_whole if of_whole_trial(row.row) else of_rows
        by_trial[row.trial] = by_trial.get(row.trial) or explaining(row.row, row.numbers)
    return {row.trial: of_whole.get(row.trial) or of_rows.get(row.trial) for row in rows}


def findings_of_row(
    table: str, row: AnyRow, causes: Sequence[CauseInRow], remedy: Remedy
) -> list[Finding]:
    """The doubts about a row by their causes, remarks on properties of the device, and what could
    not be checked."""
    doubts: list[Finding] = []
    remarks: list[Finding] = []
    for in_row in causes:
        finding = finding_of_cause(table, row, in_row, remedy)
        if finding.name == UNEXPLAINED and any(doubt.name in RIVALS for doubt in doubts):
            continue  # a rival explains what it can
        if in_row.cause.is_result:
            remarks.append(replace(finding, grade=Grade.NOTES))
        else:
            doubts.append(finding)
    doubted = {finding.name for finding in doubts}
    remedy_of_unchecked = Remedy.DOUBTED if doubts else Remedy.WHOLE
    unchecked: list[Finding] = []
    for finding in unchecked_in(table, row):
        if DOUBT_THAT_COVERS.get(finding.name) not in doubted:
            unchecked.append(replace(finding, remedy=remedy_of_unchecked))
    return [*doubts, *remarks, *unchecked]


def finding_of_cause(table: str, row: AnyRow, in_row: CauseInRow, remedy: Remedy) -> Finding:
    """A cause of doubt about a row. Estimates without it are offered where they are better than the
    recorded ones."""
    without = corrections(table, in_row.cause, row)
    if in_row.cause.name in RIVALS and leaves_torque(row):
        without = []  # what else is in the torque has moved them, too
    better = [each for each in without if not each.is_told or each.is_better_than(row)]
    if not any(each.is_told for each in without):  # the cause was no column of any regression
        better = []
    return Finding(
        name=in_row.cause.name,
        table=table,
        subject=subject_of(row),
        grade=Grade.DOUBTS,
        evidence=in_row.numbers,
        amplitude_deg=cell_number(row, "amplitude_deg"),
        frequency_hz=cell_number(row, "frequency_hz"),
        remedy=remedy,
        without=tuple(better),
    )


def cell_of_causes(findings: Sequence[Finding], are_doubts: bool) -> str:
    """The causes of doubt about a row in one cell, or those of its other findings."""
    causes = [
        finding.cause for finding in findings if (finding.grade is Grade.DOUBTS) == are_doubts
    ]
    return BETWEEN.join(dict.fromkeys(causes))


def marked(table: pl.DataFrame, findings: RowFindings, name: str) -> pl.DataFrame:
    """The table `name` with the column `DOUBTFUL`, the causes of doubt about each row (empty: none;
    null: no fit), and with `remarks`, which also says what could not be checked, if the table has
    it."""
    is_fit = pl.col(EXCLUDED).is_null() if EXCLUDED in table.columns else pl.lit(True)
    doubts = pl.Series([cell_of_causes(row, True) for row in findings], dtype=pl.String)
    other_causes = pl.Series([cell_of_causes(row, False) for row in findings], dtype=pl.String)
    table = table.with_columns(pl.when(is_fit).then(doubts).alias(DOUBTFUL))
    if name not in HAVE_REMARKS:
        return table
    return table.with_columns(remarks=other_causes.replace("", None))


def with_inherited(
    table: pl.DataFrame,
    findings: RowFindings,
    origin: pl.DataFrame,
    findings_of_origin: RowFindings,
) -> RowFindings:
    """Add to the findings about each row the doubts of another table about the same trial and
    amplitude, or about the whole trial: a clipped or late torque concerns everything from the same
    samples.

    Parameters
    ----------
    table, findings
        The rows of a table, and the findings about them.
    origin, findings_of_origin
        The rows of the other table, and the findings about them.
    """
    doubts_by_fit: dict[tuple[Any, ...], list[Finding]] = {}
    for fit, of_row in zip(trials_and_amplitudes(origin), findings_of_origin, strict=True):
        doubts_by_fit[fit] = [finding for finding in of_row if finding.grade is Grade.DOUBTS]
    extended: RowFindings = []
    for fit, of_row in zip(trials_and_amplitudes(table), findings, strict=True):
        extended.append([*of_row, *doubts_by_fit.get(fit, ())])
    return extended


def trials_and_amplitudes(table: pl.DataFrame) -> list[tuple[Any, ...]]:
    """The trial and the amplitude of each row; None for the amplitude of a whole trial."""
    amplitude = pl.col("amplitude_deg") if "amplitude_deg" in table.columns else pl.lit(None)
    return table.select("trial", amplitude=amplitude).rows()
