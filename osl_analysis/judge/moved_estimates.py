"""How far a cause may move K, B and I of a row, which tells a doubt from a remark."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from osl_analysis.judge.finding import ESTIMATES, AnyRow, Beyond, cell_number
from osl_analysis.judge.known_findings import EVIDENCE, KnownFinding
from osl_analysis.judge.limits import Accuracy

NAMES_IN_TABLE: Mapping[str, Mapping[str, str]] = {
    "belt": {"K": "K_s"},
    "transmission": {"B": "B_j", "I": "J_j"},
}
"""Columns of the stiffness, damping and inertia of tables that do not call them K, B and I."""


@dataclass(frozen=True)
class Correction:
    """An estimate with a cause as a column of the regression, in the unit of the estimate."""

    symbol: str  # K, B or I
    value: float | None  # None: rivals that cannot be told apart give a range alone
    low: float | None  # lower end of its 95 % interval or range; None: nothing is told
    high: float | None  # upper end

    def is_better_than(self, recorded: float | None) -> bool:
        """Whether the recorded estimate lies outside of this interval. Of one that lies in it
        nothing better is known."""
        if recorded is None or self.low is None or self.high is None:
            return is_told(self)
        return not self.low <= recorded <= self.high


def estimate_column(table: str, symbol: str) -> str:
    """The column of K, B or I in a table."""
    return NAMES_IN_TABLE.get(table, {}).get(symbol, symbol)


def corrected_column(table: str, symbol: str, column: str) -> str:
    """The column of an estimate beside a cause in a table: `B_without` is `B_j_without` of a
    transmission."""
    return f"{estimate_column(table, symbol)}{column.removeprefix(symbol)}"


def corrections(table: str, cause: KnownFinding, row: AnyRow) -> list[Correction]:
    """The estimates beside a cause, as far as the row has their columns."""
    without_cause: list[Correction] = []
    for symbol, column_of_impedance in cause.estimates_without.items():
        column = corrected_column(table, symbol, column_of_impedance)
        if column not in row:
            continue
        low, high = cell_number(row, f"{column}_low"), cell_number(row, f"{column}_high")
        without_cause.append(Correction(symbol, cell_number(row, column), low, high))
    return without_cause


def is_told(correction: Correction) -> bool:
    """Whether anything is known of an estimate beside its cause."""
    return correction.value is not None or None not in (correction.low, correction.high)


def largest_move(correction: Correction, row: AnyRow, column: str) -> float:
    """By how much [unit of the estimate] a cause moves the estimate in this column, or an end of
    its interval; infinite where nothing of the estimate is told."""
    if not is_told(correction):
        return math.inf
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
    if any(is_told(correction) for correction in without_cause):
        for correction in without_cause:
            column = estimate_column(table, correction.symbol)
            size = size_of(row, column)
            if size:
                moved[correction.symbol] = largest_move(correction, row, column) / size
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
