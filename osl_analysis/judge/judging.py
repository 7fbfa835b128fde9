"""Findings about the rows of result tables, from their columns and the configured limits, and the
tables with them.

What a known cause explains, such as a low VAF due to friction, is no finding of its own. The row's
columns also tell what could not be checked, and what was checked and is worth knowing."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.judge.causes import (
    BETWEEN,
    CAUSES,
    EVIDENCE,
    Cause,
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
MEASURED_BY = {"belt": "K_s", "transmission": "B_j", "actuator": "k_tau_n_m"}
"""What a component trial measures. `NAME_ratio` is its ratio to the parameter file's value."""
HIDDEN_SHARE = 0.1  # of J_j, by which a delay of two standard errors may change it
WIDE, SEEN = 3.0, 0.5  # effect of a seen, and of a hidden, reflex on K, in widths of K's interval


def unchecked_in(table: str, row: AnyRow) -> Iterator[Finding]:
    """The findings `not checked` and `notes` about a row of the table of this name."""
    subject = subject_of(row)
    amplitude = cell_number(row, "amplitude_deg")
    names = {"impedance": of_impedance, "walking_groups": of_walking}.get(table)
    for what in [*(names(row) if names else ()), *of_others(table, row)]:
        yield Finding(table, subject, what, Grade.UNCHECKED, amplitude_deg=amplitude)
    if row.get("reflex_probability") is not None:
        what = "K, B and I are beside a reflex"
        yield Finding(table, subject, what, Grade.NOTES, amplitude_deg=amplitude)
    quantity = MEASURED_BY.get(table, "")
    times = cell_number(row, f"{quantity}_ratio") or 1.0
    # components differ by less
    if abs(times - 1) > 0.1 and not suspected_unit(f"{quantity}_ratio", times, row):
        what = f"{quantity} is not that of the parameter file"
        yield Finding(table, subject, what, Grade.NOTES, amplitude_deg=amplitude)
    for name in ("I", "J_j") if table in ("impedance", "transmission", "walking_groups") else ():
        if (cell_number(row, f"{name}_high") or 0.0) < 0:
            yield Finding(
                table,
                subject,
                f"{name} is certainly negative",
                Grade.NOTES,
                amplitude_deg=amplitude,
            )


def lacks(row: AnyRow, name: str) -> bool:
    """Whether a row has no value in a column of its table."""
    return name in row and row[name] is None


def of_impedance(row: AnyRow) -> Iterator[str]:
    asked = "controller" in row  # a fit with a commanded impedance
    if (cell_number(row, "band_high_hz") or 0.0) > (cell_number(row, "cutoff_hz") or math.inf):
        yield "what moves faster than the cut-off"
    if asked and lacks(row, "K_predicted") and not lacks(row, "K_over_K_s"):  # the device is known
        yield "whether K is what the gains should give"
        yield "whether the bench's frame yields"
    if asked and lacks(row, "fault_probability") and lacks(row, "lag_s"):
        yield LATENESS
    if row.get("delay_told_s") is not None:
        yield UNSTATED_DELAY
    if row.get("certain_theta_m_lag_s"):
        yield "whether theta_m or B_j is wrong"
    if lacks(row, "K_drift") and lacks(row, "fault_probability"):
        yield "whether K changes while it is recorded"
    if (cell_number(row, "clocks") or 1) > 1 and lacks(row, "clock_drift_ppm"):
        yield "whether the clocks of angle and torque drift apart"
    low, high = (cell_number(row, f"K_{end}") for end in ("low", "high"))
    # a weight of 1 N*m with its arm level adds 1 to K
    if low is not None and high is not None and high - low < 2:
        yield "whether a fixture's weight is in K"


def delay_may_hide(row: AnyRow) -> bool:
    """Whether a delay that the recording does not show may change J_j by a tenth."""
    told, B_j, J_j = (cell_number(row, name) for name in ("delay_told_s", "B_j", "J_j"))
    if told is None or B_j is None or J_j is None:
        return lacks(row, "fault_probability")
    return abs(B_j) * 2 * told > HIDDEN_SHARE * abs(J_j)


def of_others(table: str, row: AnyRow) -> Iterator[str]:
    if table == "transmission" and delay_may_hide(row):
        yield LATENESS
    if table == "torque_angle":
        if row.get("smaller_cycles"):
            yield "cycles that are smaller than the largest"
        if row.get("zero_unsure") is not None:
            yield ZERO
        if lacks(row, "rate_change"):
            yield LATENESS
    if table == "actuator" and lacks(row, "B_m"):
        yield "f_C, f_G, B_m and J_m"
    if table == "prediction":
        if row.get("missing_components") is not None:
            yield "prediction by components"
        elif lacks(row, "K_low"):
            yield "the prediction's interval"
        elif row.get("outside") is not None:
            yield "the prediction outside what was measured"


def of_walking(row: AnyRow) -> Iterator[str]:
    if row.get("K") is None:
        return
    K = cell_number(row, "K") or 0.0
    by_log, error = lacks(row, "plate_K_per_m"), cell_number(row, "moment_error_half")
    if by_log:
        yield LATENESS
    elif lacks(row, "shoe_share"):
        yield "whether K is that of the joint alone"
    per_percent = cell_number(row, "moment_K_per_percent") or 0.0
    # less is not much of K
    if error is not None and abs(100 * error * per_percent) > 0.02 * abs(K):
        yield "whether the plate's moments are right"
    if lacks(row, "plate_height_m") and not by_log:
        yield "the height of the plate's corners and ORIGIN"
    if lacks(row, "filled_share") and not by_log:
        yield "whether markers were filled before the export"
    if (
        row.get("reflex_delay_ms") is not None
        and (cell_number(row, "reflex_K_widths") or 0.0) > WIDE
    ):
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
            known = ", ".join(other for other in table.columns if table[other].dtype.is_numeric())
            raise InputError(
                f"configuration, doubtful.{name}: the table has no column '{limit.column}' of"
                f" numbers; put the limit on one of {known}, or write null for no limit"
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
    """The findings about each row of the table `name`: doubts in the order of their limits, remarks
    on what moves the estimates by less than their accuracy, then what could not be checked. Rows
    without a fit have none. Raises InputError: as `check_limits`."""
    is_fit = [True] * len(table)
    if EXCLUDED in table.columns:
        is_fit = table[EXCLUDED].is_null().to_list()
    if any(is_fit):
        check_limits(table, limits, name)
    rows = [
        JudgedRow(row, numbers_beyond(name, row, limits), has_fit)
        for row, has_fit in zip(table.to_dicts(), is_fit, strict=True)
    ]
    of_whole = {row.trial: row.numbers for row in rows if of_whole_trial(row.row)}
    with_amplitudes = {row.trial for row in rows if row.row.get("amplitude_deg") is not None}
    explained_by = dict[object, Cause | None]()  # by trial
    # the fits to whole trials first
    for row in sorted(rows, key=lambda row: not of_whole_trial(row.row)):
        for column in [column for column in row.numbers if is_of_recording(column)]:
            if column not in of_whole.get(row.trial, row.numbers):
                del row.numbers[column]  # at one amplitude friction looks the same
        explained_by[row.trial] = explained_by.get(row.trial) or explaining(row.row, row.numbers)
    findings: RowFindings = []
    for row in rows:
        if not row.is_fit:
            findings.append([])
            continue
        is_whole_sound = not of_whole.get(row.trial, True)
        remedy = remedy_of(row, row.trial in with_amplitudes, is_whole_sound)
        misfit_by = explaining(row.row, row.numbers) or explained_by[row.trial]
        causes = causes_in(row.row, row.numbers, misfit_by)
        findings.append(findings_of_row(name, row.row, causes, remedy, limits.accuracy))
    return findings


def findings_of_row(
    table: str,
    row: AnyRow,
    causes: Sequence[tuple[Cause, list[Beyond]]],
    remedy: Remedy,
    accuracy: Accuracy,
) -> list[Finding]:
    """The doubts about a row by their causes, remarks on causes without much effect, and what could
    not be checked."""
    doubts, remarks = list[Finding](), list[Finding]()
    for cause, numbers in causes:
        finding = finding_of_cause(table, row, cause, numbers, remedy)
        if is_within_accuracy(table, row, cause, numbers, accuracy):
            remarks.append(replace(finding, grade=Grade.NOTES, remedy=Remedy.WHOLE))
        else:
            doubts.append(finding)
    doubted = {finding.cause for finding in doubts}
    unchecked = list[Finding]()
    for finding in unchecked_in(table, row):
        if DOUBTED.get(finding.cause) not in doubted:
            remedy = Remedy.DOUBTED if doubts else Remedy.WHOLE
            unchecked.append(replace(finding, remedy=remedy))
    return [*doubts, *remarks, *unchecked]


def finding_of_cause(
    table: str, row: AnyRow, cause: Cause, evidence: Sequence[Beyond], remedy: Remedy
) -> Finding:
    """A cause of doubt about a row, with its effect on the estimates as far as the row has it.
    Estimates without it are offered where they are better than the recorded ones."""
    sizes: dict[str, float] = {}
    for number in evidence:
        symbol = EVIDENCE[number.column].size if number.column in EVIDENCE else ""
        estimate = cell_number(row, estimate_column(table, symbol)) if symbol else None
        if estimate is not None:
            sizes[symbol] = max(sizes.get(symbol, 0.0), abs(number.value * estimate))
    without: dict[str, float] = {}
    told = corrections(table, cause, row)
    for correction in told:
        recorded = cell_number(row, estimate_column(table, correction.symbol))
        if not correction.is_better_than(recorded):
            continue
        ends = {"": correction.value, "_low": correction.low, "_high": correction.high}
        for end, value in ends.items():
            if value is not None:
                without[f"{correction.symbol}{end}"] = value
    untold = [correction.symbol for correction in told if not is_told(correction)]
    if len(untold) == len(told):  # the cause was no column of any regression
        untold = []
    return Finding(
        table,
        subject_of(row),
        cause.name,
        Grade.DOUBTS,
        tuple(evidence),
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
    others = pl.Series([cell_of_causes(row, False) for row in findings], dtype=pl.String)
    table = table.with_columns(pl.when(is_fit).then(doubts).alias(DOUBTFUL))
    if name not in HAVE_UNCHECKED:
        return table
    return table.with_columns(not_checked=others.replace("", None))


def with_inherited(
    name: str, table: pl.DataFrame, own: RowFindings, of: pl.DataFrame, findings: RowFindings
) -> RowFindings:
    """The findings about each row of the table `name`, with the doubts of the table `of` about the
    same trial and amplitude, or about the whole trial: a clipped or late torque concerns everything
    from the same samples."""
    keys, trials = (
        frame.select(
            "trial", amplitude="amplitude_deg" if "amplitude_deg" in frame.columns else pl.lit(None)
        ).rows()
        for frame in (of, table)
    )
    known = {
        key: [one for one in row if one.grade is Grade.DOUBTS]
        for key, row in zip(keys, findings, strict=True)
    }
    return [
        [*row, *(replace(one, table=name, inherited=one.table) for one in known.get(key, ()))]
        for key, row in zip(trials, own, strict=True)
    ]
