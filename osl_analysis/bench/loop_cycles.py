"""Cycles of a slow motion to and fro: where each begins, turns and ends."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Array

TURNING_SHARE = 0.1  # of the range of motion: a smaller return is no turning point
AT_AN_END = 0.1  # of the range of motion: a start this near an end counts as this end
CLOSED = 0.05  # of the range of motion: largest distance between the ends of a cycle
WHOLE = 0.9  # of the range of motion: a cycle that covers less is a smaller one
RESTS = 0.01  # of the range of motion: the joint is at rest within it


@dataclass(frozen=True)
class Cycle:
    """A closed cycle of an angle, by rows."""

    rows: tuple[int, ...]  # where it begins, turns (once or more often) and ends

    @property
    def start(self) -> int:
        return self.rows[0]

    @property
    def stop(self) -> int:
        """The last row, which belongs to the cycle."""
        return self.rows[-1]

    @property
    def all_rows(self) -> slice:
        return slice(self.start, self.stop + 1)

    def pieces(self, theta: Array, direction: int) -> list[slice]:
        """The rows between two turns in which the angle (n,) rises (1) or falls (-1)."""
        return [
            slice(first, last + 1)
            for first, last in pairwise(self.rows)
            if (theta[last] - theta[first]) * direction > 0
        ]


@dataclass(frozen=True)
class Cycles:
    """The cycles of a trial that are analysed, and how many others it has."""

    analysed: tuple[Cycle, ...]
    settled: int  # first cycles, which are left out
    smaller: int  # closed cycles that cover less of the range
    partial: int  # other stretches that are no whole cycle
    loading: Literal["rising", "falling"]
    """Direction of the angle to the end that is farther from the start."""

    @property
    def loading_direction(self) -> int:
        return 1 if self.loading == "rising" else -1

    def without_first(self) -> "Cycles":
        """The cycles without the first one, which is settled."""
        return Cycles(self.analysed[1:], 1, self.smaller, self.partial, self.loading)


def find_cycles(theta: Array, settle: int = 0) -> Cycles:
    """Find the whole cycles of a slow motion.

    A cycle ends where the angle returns to its start in the same direction, or, if the motion
    starts at one of its ends, where it returns to this end.

    Parameters
    ----------
    theta : Array
        Filtered angle (n,) [rad].
    settle : int
        Number of first cycles that are left out.

    Returns
    -------
    Cycles
        The whole cycles, and the counts of others.

    Raises
    ------
    InputError
        There is no whole cycle to analyse.
    """
    low, high = float(theta.min()), float(theta.max())
    span = high - low
    turns = turning_points(theta, TURNING_SHARE * span)
    edges = cycle_edges(theta, turns, span)
    closed = [
        Cycle((first, *(turn for turn in turns if first < turn < last), last))
        for first, last in pairwise(edges)
        if abs(theta[last] - theta[first]) <= CLOSED * span
        and moves_in(theta, first, last, TURNING_SHARE * span)
    ]
    whole = [cycle for cycle in closed if np.ptp(theta[cycle.all_rows]) >= WHOLE * span]
    if not whole:
        first_deg, low_deg, high_deg, last_deg = (
            np.rad2deg([theta[0], low, high, theta[-1]]).round(2) + 0.0  # no "-0.00"
        )
        raise InputError(
            f"no whole cycle: the angle begins at {first_deg:.2f} deg, goes to {low_deg:.2f} and"
            f" {high_deg:.2f} deg, and ends at {last_deg:.2f} deg; record the way back to the start"
        )
    if len(whole) <= settle:
        raise InputError(
            f"the first {settle} of {len(whole)} whole cycles are not analysed; record more, or"
            " lower settle_cycles"
        )
    ends_of_closed = {(cycle.start, cycle.stop) for cycle in closed}
    stretches = pairwise(sorted({0, *edges, len(theta) - 1}))
    partial = [
        (first, last)
        for first, last in stretches
        if (first, last) not in ends_of_closed
        and moves_in(theta, first, last, TURNING_SHARE * span)
    ]
    begin = theta[whole[0].start]
    return Cycles(
        analysed=tuple(whole[settle:]),
        settled=settle,
        smaller=len(closed) - len(whole),
        partial=len(partial),
        loading="rising" if high - begin >= begin - low else "falling",
    )


def moves_in(theta: Array, first: int, last: int, least: float) -> bool:
    """Whether the angle (n,) moves by more than `least` [rad] from row to row."""
    return bool(np.ptp(theta[first : last + 1]) > least)


def turning_points(theta: Array, swing: float) -> list[int]:
    """Rows at which the angle (n,) turns and then returns by `swing` [rad] or more."""
    angles = theta.tolist()  # single values of a list are quicker to read than an array's
    turns: list[int] = []
    direction = 0  # 1 while the angle rises, -1 while it falls, 0 before the first turn
    highest = lowest = 0  # rows of the highest and lowest angle since the last turn
    for row, angle in enumerate(angles):
        if angle > angles[highest]:
            highest = row
        if angle < angles[lowest]:
            lowest = row
        if direction >= 0 and angle < angles[highest] - swing:
            if direction:
                turns.append(highest)
            direction, lowest = -1, row
        elif direction <= 0 and angle > angles[lowest] + swing:
            if direction:
                turns.append(lowest)
            direction, highest = 1, row
    return turns


def cycle_edges(theta: Array, turns: list[int], span: float) -> list[int]:
    """Rows at which cycles of an angle (n,) with a range `span` [rad] may begin or end."""
    start, last_row = float(theta[0]), len(theta) - 1
    distance_to_end = min(start - theta.min(), theta.max() - start)
    if distance_to_end < AT_AN_END * span:
        back_at_start = [
            turn for turn in turns if abs(theta[turn] - start) < (AT_AN_END + CLOSED) * span
        ]
        return [0, *back_at_start, last_row]
    between_turns = list(pairwise([0, *turns, last_row]))
    direction = np.sign(theta[between_turns[0][1]] - start)
    ends_at_start = abs(theta[last_row] - start) <= CLOSED * span
    edges = [0]
    for first, last in between_turns[1 : -1 if ends_at_start else None]:
        if (start - theta[first]) * direction > 0 and (theta[last] - start) * direction > 0:
            beyond_start = (theta[first : last + 1] - start) * direction >= 0
            edges.append(first + int(np.argmax(beyond_start)))
    return [*edges, last_row]


def between_rests(theta: Array) -> slice:
    """The rows of an angle (n,) between its rests at both ends."""
    near = RESTS * np.ptp(theta)
    left_start = np.abs(theta - theta[0]) > near
    before_end = np.abs(theta - theta[-1]) > near
    first = max(int(np.argmax(left_start)) - 1, 0)
    after_last = max(int(np.argmax(before_end[::-1])) - 1, 0)
    return slice(first, len(theta) - after_last)
