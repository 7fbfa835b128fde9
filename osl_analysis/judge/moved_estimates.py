"""How far a cause may move K, B and I of a row, which tells a doubt from a remark."""

import math
from collections.abc import Mapping, Sequence

from osl_analysis.judge.finding import ESTIMATES, AnyRow, Beyond, Correction, cell_number
from osl_analysis.judge.known_findings import EVIDENCE, HYPOTHESES, KnownFinding
from osl_analysis.judge.limits import Accuracy

NAMES_IN_TABLE: Mapping[str, Mapping[str, str]] = {
    "belt": {"K": "K_s"},
    "transmission": {"B": "B_j", "I": "J_j"},
}
"""Columns of the stiffness, damping and inertia of tables that do not call them K, B and I."""


def estimate_column(table: str, symbol: str) -> str:
    """The column of K, B or I in a table."""
    return NAMES_IN_TABLE.get(table, {}).get(symbol, symbol)


def corrected_column(table: str, symbol: str, column: str) -> str:
    """The column of an estimate beside a cause in a table: `B_without` is `B_j_without` of a
    transmission."""
    return f"{estimate_column(table, symbol)}{column.removeprefix(symbol)}"


def recorded_column(table: str, cause: KnownFinding, symbol: str, row: AnyRow) -> str:
    """The column of K, B or I that a cause may have moved. Certain friction is a column of the
    regression beside a rival of Eq. 15, so that it moves the viscous damping."""
    column = estimate_column(table, symbol)
    viscous = f"{column}_viscous"
    is_rival = cause.name in HYPOTHESES.values()
    return viscous if symbol == "B" and is_rival and row.get(viscous) is not None else column


def corrections(table: str, cause: KnownFinding, row: AnyRow) -> list[Correction]:
    """The estimates beside a cause, as far as the row has their columns."""
    without_cause: list[Correction] = []
    for symbol, column_of_impedance in cause.estimates_without.items():
        column = corrected_column(table, symbol, column_of_impedance)
        if column not in row:
            continue
        low, high = cell_number(row, f"{column}_low"), cell_number(row, f"{column}_high")
        recorded = recorded_column(table, cause, symbol, row)
        without_cause.append(Correction(symbol, recorded, cell_number(row, column), low, high))
    return without_cause


def leaves_torque(row: AnyRow) -> bool:
    """Whether the most probable rival leaves more of the torque than noise."""
    columns = [column for column in row if column.endswith("_unexplained_share")]
    return any(cell_number(row, column) for column in columns)


def largest_move(correction: Correction, row: AnyRow) -> float:
    """By how much [unit of the estimate] a cause moves the recorded estimate, or an end of its
    interval; infinite where nothing of the estimate is told."""
    if not correction.is_told:
        return math.inf
    column = correction.recorded
    estimate = cell_number(row, column)
    low = cell_number(row, f"{column}_low")
    high = cell_number(row, f"{column}_high")
    moves = (
        distance(correction.value, estimate),
        distance(correction.low, estimate if low is None else low),
        distance(correction.high, estimate if high is None else high),
    )
    return max(moves)


def distance(corrected: float | None, recorded: float | None) -> float:
    """By how much a correction moves a number; 0 where one of them is not known."""
    if corrected is None or recorded is None:
        return 0.0
    return abs(corrected - recorded)


def size_of(row: AnyRow, column: str) -> float:
    """The size of an estimate, of which shares are taken: itself or, where it is not told from 0,
    the half-width of its 95 % interval."""
    estimate = abs(cell_number(row, column) or 0.0)
    low, high = cell_number(row, f"{column}_low"), cell_number(row, f"{column}_high")
    if low is None or high is None:
        return estimate
    return max(estimate, (high - low) / 2)


def shares_moved(
    table: str, row: AnyRow, cause: KnownFinding, evidence: Sequence[Beyond]
) -> dict[str, float]:
    """By which share of itself a cause may move each of K, B and I that the row has; empty where
    the row does not tell."""
    moved: dict[str, float] = {}
    without_cause = corrections(table, cause, row)
    if any(correction.is_told for correction in without_cause):
        for correction in without_cause:
            size = size_of(row, correction.recorded)
            if size:
                moved[correction.symbol] = largest_move(correction, row) / size
    for number in evidence:
        if number.column == "time_base_shift":  # in half-widths of the interval
            moved.update(shares_of_half_widths(table, row, number.value))
    return moved


def shares_of_half_widths(table: str, row: AnyRow, half_widths: float) -> dict[str, float]:
    """A number of half-widths of the intervals of K, B and I, each as a share of its estimate."""
    shares: dict[str, float] = {}
    for symbol in ESTIMATES:
        column = estimate_column(table, symbol)
        low, high = cell_number(row, f"{column}_low"), cell_number(row, f"{column}_high")
        if low is not None and high is not None and high > low:
            shares[symbol] = half_widths * ((high - low) / 2) / size_of(row, column)
    return shares


def is_within_accuracy(
    table: str, row: AnyRow, cause: KnownFinding, evidence: Sequence[Beyond], accuracy: Accuracy
) -> bool:
    """Whether a cause certainly moves K, B and I by less than their accuracy: the row tells by how
    much, and no other number of its evidence is beyond a limit of its own."""
    for number in evidence:
        if number.column not in EVIDENCE or EVIDENCE[number.column].decided_by != "effect":
            return False
    moved = shares_moved(table, row, cause, evidence)
    if not moved:
        return False
    return all(share < accuracy.of(symbol) for symbol, share in moved.items())
