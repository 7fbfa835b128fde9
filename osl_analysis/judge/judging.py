"""Findings about the rows of result tables, from their columns and the configured limits, and the
tables with them.

What a known cause explains, such as a low VAF due to friction, is no finding of its own. The row's
columns also tell what could not be checked, and what was checked and is worth knowing.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.judge.causes import (
    BETWEEN,
    CAUSES,
    EVIDENCE,
    Cause,
    CauseInRow,
    causes_in,
    explaining,
    numbers_beyond,
    suspected_unit,
)
from osl_analysis.judge.finding import (
    Accuracy,
    AnyRow,
    Beyond,
    Finding,
    Grade,
    Limits,
    Remedy,
    cell_number,
    subject_of,
)
from osl_analysis.judge.moved_estimates import (
    corrections,
    estimate_column,
    is_told,
    is_within_accuracy,
)
from osl_analysis.stats.repeats import DOUBTFUL

LATENESS = "whether the torque is late"
UNSTATED_DELAY = "how well the delay between angle and torque is known"
GAIN = "whether the gain of torque over angle is right"
NO_ZERO = "the torque's zero"
ZERO = (
    "whether the torque at rest is the load cell's offset or what hysteresis leaves in the device"
)
# by what could not be checked: the doubt that covers it
DOUBTED = {ZERO: "zero that nobody stated"}
HAVE_UNCHECKED = (
    "belt",
    "transmission",
    "actuator",
    "impedance",
    "torque_angle",
    "walking_groups",
)
"""Judged tables in which something may be unchecked."""
HAVE_INERTIA = ("impedance", "transmission", "walking_groups")
MEASURED_BY = {"belt": "K_s", "transmission": "B_j", "actuator": "k_tau_n_m"}
"""What a component trial measures. `NAME_ratio` is its ratio to the parameter file's value."""
USUAL_DIFFERENCE = {"K_s": 0.05, "B_j": 0.1, "k_tau_n_m": 0.05}
"""Of a component from its parameter file; most differ by less, of 10 trials of the default belt by
2 %. Data sheets give torque constants to 0.1, which is why more is a remark and no doubt."""
HIDDEN_SHARE = 0.1  # of J_j, by which a delay of two standard errors may change it
WIDE = 3.0  # effect of a reflex that is seen on K, in widths of K's interval
SEEN = 0.5  # the same of a reflex that may be hidden
LEAST_MOMENT_SHARE = 0.02  # of K, that a wrong gain of the plate's moments may change
ROUGH_GAIN = 0.05  # share by which a plate of the right gain may seem wrong


def unchecked_in(table: str, row: AnyRow) -> Iterator[Finding]:
    """Find what could not be checked of a row, and what is worth knowing of it.

    Parameters
    ----------
    table : str
        The name of its table.
    row : AnyRow

    Yields
    ------
    Finding
        Of the grades `not checked` and `notes`, in this order.
    """
    subject = subject_of(row)
    amplitude = cell_number(row, "amplitude_deg")
    for cause in unchecked_causes(table, row):
        yield Finding(table, subject, cause, Grade.UNCHECKED, amplitude_deg=amplitude)
    for cause in noted_causes(table, row):
        yield Finding(table, subject, cause, Grade.NOTES, amplitude_deg=amplitude)


def unchecked_causes(table: str, row: AnyRow) -> Iterator[str]:
    """What could not be checked of a row of a table."""
    if lacks(row, "fixture"):
        yield "what turns with the joint behind the load cell"
    if table == "impedance":
        yield from unchecked_in_impedance(row)
    elif table == "walking_groups":
        yield from unchecked_in_walking(row)
    elif table == "transmission":
        if delay_may_hide(row):
            yield LATENESS
    elif table == "torque_angle":
        yield from unchecked_in_torque_angle(row)
    elif table == "actuator" and lacks(row, "B_m"):
        yield "f_C, f_G, B_m and J_m"
    elif table == "prediction":
        yield from unchecked_in_prediction(row)
    if table in ("belt", "actuator") and lacks(row, f"{MEASURED_BY[table]}_ratio"):
        yield GAIN


def noted_causes(table: str, row: AnyRow) -> Iterator[str]:
    """What was checked in a row of a table and is worth knowing."""
    if row.get("reflex_probability") is not None:
        yield "K, B and I are beside a reflex"
    quantity = MEASURED_BY.get(table, "")
    ratio = cell_number(row, f"{quantity}_ratio") or 1.0
    usual = USUAL_DIFFERENCE.get(quantity, math.inf)
    if abs(ratio - 1) > usual and not suspected_unit(f"{quantity}_ratio", ratio, row):
        yield f"{quantity} is not that of the parameter file"
    if table not in HAVE_INERTIA:
        return
    for inertia in ("I", "J_j"):
        if (cell_number(row, f"{inertia}_high") or 0.0) < 0:
            yield f"{inertia} is certainly negative"


def lacks(row: AnyRow, name: str) -> bool:
    """Whether a row has no value in a column of its table."""
    return name in row and row[name] is None


def unchecked_in_impedance(row: AnyRow) -> Iterator[str]:
    has_commanded = "controller" in row  # a fit with a commanded impedance
    if (cell_number(row, "band_high_hz") or 0.0) > (cell_number(row, "cutoff_hz") or math.inf):
        yield "what moves faster than the cut-off"
    is_device_known = not lacks(row, "K_over_K_s")
    if has_commanded and lacks(row, "K_predicted") and is_device_known:
        yield "whether K is what the gains should give"
        yield "whether the bench's frame yields"
    if has_commanded and lacks(row, "fault_probability") and lacks(row, "lag_s"):
        yield LATENESS
    if row.get("delay_told_s") is not None:
        yield UNSTATED_DELAY
    if row.get("certain_theta_m_lag_s"):
        yield "whether theta_m or B_j is wrong"
    if lacks(row, "K_drift") and lacks(row, "fault_probability"):
        yield "whether K changes while it is recorded"
    if (cell_number(row, "clocks") or 1) > 1 and lacks(row, "clock_drift_ppm"):
        yield "whether the clocks of angle and torque drift apart"
    if lacks(row, "gain_error"):
        yield GAIN


def delay_may_hide(row: AnyRow) -> bool:
    """Whether a delay that the recording does not show may change J_j by a tenth."""
    delay_se_s = cell_number(row, "delay_told_s")
    B_j, J_j = cell_number(row, "B_j"), cell_number(row, "J_j")
    if delay_se_s is None or B_j is None or J_j is None:
        return lacks(row, "fault_probability")
    return abs(B_j) * 2 * delay_se_s > HIDDEN_SHARE * abs(J_j)


def unchecked_in_torque_angle(row: AnyRow) -> Iterator[str]:
    if row.get("smaller_cycles"):
        yield "cycles that are smaller than the largest"
    if row.get("zero_unsure") is not None:
        yield ZERO
    if lacks(row, "torque_zero"):
        yield NO_ZERO
    if lacks(row, "rate_change"):
        yield LATENESS


def unchecked_in_prediction(row: AnyRow) -> Iterator[str]:
    if row.get("missing_components") is not None:
        yield "prediction by components"
    elif lacks(row, "K_low"):
        yield "the prediction's interval"
    elif row.get("outside") is not None:
        yield "the prediction outside what was measured"


def unchecked_in_walking(row: AnyRow) -> Iterator[str]:
    if row.get("K") is None:
        return
    K = cell_number(row, "K") or 0.0
    has_no_plate = lacks(row, "plate_K_per_m")  # the torque is the log's
    if has_no_plate:
        yield LATENESS
    elif lacks(row, "shoe_share"):
        yield "whether K is that of the joint alone"
    K_per_percent = cell_number(row, "moment_K_per_percent") or 0.0
    moment_effect = 100 * (cell_number(row, "moment_error_half") or 0.0) * K_per_percent
    if abs(moment_effect) > LEAST_MOMENT_SHARE * abs(K):
        yield "whether the plate's moments are right"
    is_gain_told = (cell_number(row, "load_slack") or 0.0) < ROUGH_GAIN
    if (lacks(row, "load_error") or not is_gain_told) and not has_no_plate:
        yield "whether the plate's gain is right"
    if lacks(row, "plate_height_m") and not has_no_plate:
        yield "the height of the plate's corners and ORIGIN"
    if lacks(row, "filled_share") and not has_no_plate:
        yield "whether markers were filled before the export"
    reflex_effect = cell_number(row, "reflex_K_widths") or 0.0
    if row.get("reflex_delay_ms") is not None and reflex_effect > WIDE:
        yield "how much of K a reflex is"
    if (cell_number(row, "hidden_reflex_K_widths") or 0.0) > SEEN:
        yield "whether a reflex is in K"
    if row.get("hidden_slope_low") is not None:
        yield "whether B holds a change of K with stance"
    if lacks(row, "common_K"):
        yield "whether a voluntary torque or a change of pace is in K"


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
    numbers: dict[str, Beyond]  # by column
    is_fit: bool

    @property
    def trial(self) -> object:
        return self.row.get("trial")


def is_of_recording(column: str) -> bool:
    """Whether a column is evidence of a fault of the recording, which the fit to all of a trial
    must show, too."""
    return column in EVIDENCE and CAUSES[EVIDENCE[column].cause].of_recording


def remedy_of(judged_row: JudgedRow, has_amplitudes: bool, is_whole_sound: bool) -> Remedy:
    """Which remedy helps for a row."""
    if judged_row.row.get("frequency_hz") is not None:
        return Remedy.FREQUENCY
    if judged_row.row.get("amplitude_deg") is not None and is_whole_sound:
        return Remedy.AMPLITUDE
    return Remedy.WHOLE if has_amplitudes else Remedy.ALONE


def judged(table: pl.DataFrame, limits: Limits, name: str) -> RowFindings:
    """Judge each row of a table.

    Parameters
    ----------
    table : polars.DataFrame
        A result table with its evidence.
    limits : Limits
        Accuracy and limits of the configuration.
    name : str
        The name of the table.

    Returns
    -------
    list of list of Finding
        For each row doubts in the order of their limits, remarks on what moves the estimates by
        less than their accuracy, then what could not be checked. Rows without a fit have none.

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
    rows: list[JudgedRow] = []
    for cells, has_fit in zip(table.to_dicts(), is_fit, strict=True):
        rows.append(JudgedRow(cells, numbers_beyond(name, cells, limits), has_fit))
    of_whole = {row.trial: row.numbers for row in rows if of_whole_trial(row.row)}
    with_amplitudes = {row.trial for row in rows if row.row.get("amplitude_deg") is not None}
    explained_by: dict[object, Cause | None] = {}  # by trial
    # the fits to whole trials first
    for row in sorted(rows, key=lambda row: not of_whole_trial(row.row)):
        for column in list(row.numbers):
            # a trial whose table has no row of the whole is judged by its rows alone
            numbers_of_whole = of_whole.get(row.trial, row.numbers)
            if is_of_recording(column) and column not in numbers_of_whole:
                del row.numbers[column]  # at one amplitude friction looks the same
        explained_by[row.trial] = explained_by.get(row.trial) or explaining(row.row, row.numbers)
    findings: RowFindings = []
    for row in rows:
        if not row.is_fit:
            findings.append([])
            continue
        is_whole_sound = row.trial in of_whole and not of_whole[row.trial]
        remedy = remedy_of(row, row.trial in with_amplitudes, is_whole_sound)
        misfit_by = explaining(row.row, row.numbers) or explained_by[row.trial]
        causes = causes_in(row.row, row.numbers, misfit_by)
        findings.append(findings_of_row(name, row.row, causes, remedy, limits.accuracy))
    return findings


def findings_of_row(
    table: str, row: AnyRow, causes: Sequence[CauseInRow], remedy: Remedy, accuracy: Accuracy
) -> list[Finding]:
    """The doubts about a row by their causes, remarks on causes without much effect, and what could
    not be checked."""
    doubts: list[Finding] = []
    remarks: list[Finding] = []
    for in_row in causes:
        finding = finding_of_cause(table, row, in_row, remedy)
        if is_within_accuracy(table, row, in_row.cause, in_row.numbers, accuracy):
            remarks.append(replace(finding, grade=Grade.NOTES, remedy=Remedy.WHOLE))
        else:
            doubts.append(finding)
    doubted = {finding.cause for finding in doubts}
    remedy_of_unchecked = Remedy.DOUBTED if doubts else Remedy.WHOLE
    unchecked: list[Finding] = []
    for finding in unchecked_in(table, row):
        if DOUBTED.get(finding.cause) not in doubted:
            unchecked.append(replace(finding, remedy=remedy_of_unchecked))
    return [*doubts, *remarks, *unchecked]


def finding_of_cause(table: str, row: AnyRow, in_row: CauseInRow, remedy: Remedy) -> Finding:
    """A cause of doubt about a row, with its effect on the estimates as far as the row has it.
    Estimates without it are offered where they are better than the recorded ones."""
    sizes: dict[str, float] = {}
    for number in in_row.numbers:
        symbol = EVIDENCE[number.column].size if number.column in EVIDENCE else ""
        estimate = cell_number(row, estimate_column(table, symbol)) if symbol else None
        if estimate is not None:
            sizes[symbol] = max(sizes.get(symbol, 0.0), abs(number.value * estimate))
    without: dict[str, float] = {}
    without_cause = corrections(table, in_row.cause, row)
    for correction in without_cause:
        recorded = cell_number(row, estimate_column(table, correction.symbol))
        if not correction.is_better_than(recorded):
            continue
        ends = {"": correction.value, "_low": correction.low, "_high": correction.high}
        for end, value in ends.items():
            if value is not None:
                without[f"{correction.symbol}{end}"] = value
    untold = [correction.symbol for correction in without_cause if not is_told(correction)]
    if len(untold) == len(without_cause):  # the cause was no column of any regression
        untold = []
    return Finding(
        table=table,
        subject=subject_of(row),
        cause=in_row.cause.name,
        grade=Grade.DOUBTS,
        evidence=tuple(in_row.numbers),
        amplitude_deg=cell_number(row, "amplitude_deg"),
        frequency_hz=cell_number(row, "frequency_hz"),
        remedy=remedy,
        sizes=sizes,
        without=without,
        untold=tuple(untold),
    )


def cell_of_causes(findings: Sequence[Finding], are_doubts: bool) -> str:
    """The causes of doubt about a row in one cell, or those of its other findings."""
    causes = [
        finding.cause for finding in findings if (finding.grade is Grade.DOUBTS) == are_doubts
    ]
    return BETWEEN.join(dict.fromkeys(causes))


def marked(table: pl.DataFrame, findings: RowFindings, name: str) -> pl.DataFrame:
    """The table `name` with the column `DOUBTFUL`, the causes of doubt about each row (empty: none;
    null: no fit), and with `not_checked`, remarks and what could not be checked, if the table has
    it."""
    is_fit = pl.col(EXCLUDED).is_null() if EXCLUDED in table.columns else pl.lit(True)
    doubts = pl.Series([cell_of_causes(row, True) for row in findings], dtype=pl.String)
    other_causes = pl.Series([cell_of_causes(row, False) for row in findings], dtype=pl.String)
    table = table.with_columns(pl.when(is_fit).then(doubts).alias(DOUBTFUL))
    if name not in HAVE_UNCHECKED:
        return table
    return table.with_columns(not_checked=other_causes.replace("", None))


def with_inherited(
    name: str,
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
    name, table, findings
        A table, its rows, and the findings about them.
    origin, findings_of_origin
        The rows of the other table, and the findings about them.
    """
    doubts_by_fit: dict[tuple[Any, ...], list[Finding]] = {}
    for fit, of_row in zip(trials_and_amplitudes(origin), findings_of_origin, strict=True):
        doubts_by_fit[fit] = [finding for finding in of_row if finding.grade is Grade.DOUBTS]
    extended: RowFindings = []
    for fit, of_row in zip(trials_and_amplitudes(table), findings, strict=True):
        inherited = []
        for doubt in doubts_by_fit.get(fit, ()):
            inherited.append(replace(doubt, table=name, inherited=doubt.table))
        extended.append([*of_row, *inherited])
    return extended


def trials_and_amplitudes(table: pl.DataFrame) -> list[tuple[Any, ...]]:
    """The trial and the amplitude of each row; None for the amplitude of a whole trial."""
    amplitude = pl.col("amplitude_deg") if "amplitude_deg" in table.columns else pl.lit(None)
    return table.select("trial", amplitude=amplitude).rows()
