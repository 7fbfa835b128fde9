"""How far a cause may move K, B and I of a row, which tells whether it matters."""

from collections.abc import Sequence

from osl_analysis.judge.finding import ESTIMATES, AnyRow, Beyond, cell_number
from osl_analysis.judge.known_findings import rule_of
from osl_analysis.judge.limits import Accuracy

NAMES_IN_TABLE = {("belt", "K"): "K_s", ("transmission", "B"): "B_j", ("transmission", "I"): "J_j"}
"""Columns of the stiffness, damping and inertia of tables that do not call them K, B and I."""


def estimate_column(table: str, symbol: str) -> str:
    """The column of K, B or I in a table."""
    return NAMES_IN_TABLE.get((table, symbol), symbol)


def interval(row: AnyRow, column: str) -> tuple[float | None, float | None, float | None]:
    """An estimate and the ends of its interval; None where one is not known."""
    value, low, high = (cell_number(row, f"{column}{end}") for end in ("", "_low", "_high"))
    return value, low, high


def size_and_half_width(row: AnyRow, column: str) -> tuple[float, float]:
    """The size of an estimate, of which shares are taken: itself or, where it is not told from 0,
    the half-width of its 95 % interval; and this half-width, 0 where it is not known."""
    estimate, low, high = interval(row, column)
    half_width = 0.0 if low is None or high is None else (high - low) / 2
    return max(abs(estimate or 0.0), half_width), half_width


def shares_moved(table: str, row: AnyRow, evidence: Sequence[Beyond]) -> dict[str, float]:
    """By which share of itself the other reading of time stamps may move each of K, B and I that
    the row has; empty where the row does not tell."""
    moved: dict[str, float] = {}
    for number in evidence:
        if number.column == "time_base_shift":  # in half-widths of the interval
            for symbol in ESTIMATES:
                size, half_width = size_and_half_width(row, estimate_column(table, symbol))
                if half_width > 0:
                    moved[symbol] = number.value * half_width / size
    return moved


def is_within_accuracy(
    table: str, row: AnyRow, evidence: Sequence[Beyond], accuracy: Accuracy
) -> bool:
    """Whether the evidence of a cause certainly moves K, B and I by less than their accuracy: the
    row tells by how much, and no other number of it is beyond a limit of its own."""
    for number in evidence:
        rule = rule_of(number.column, number.side)
        if rule is None or rule.by != "effect":
            return False
    moved = shares_moved(table, row, evidence)
    return bool(moved) and all(share < accuracy.of(symbol) for symbol, share in moved.items())
