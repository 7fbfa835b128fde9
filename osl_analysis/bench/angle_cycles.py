"""The cycles of a slow back-and-forth motion, found from the angle itself, and their two branches."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.trial import Array

SMALLEST_SWING = 0.1
"""Part of the range of motion by which the angle must come back for a turning point."""
AT_AN_END = 0.1
"""Part of the range of motion within which a start counts as one end of the motion."""
CLOSED = 0.05
"""Largest distance of a cycle's ends, as a part of the range of motion."""
WHOLE = 0.9
"""Smallest range of a cycle, as a part of the range of motion."""
NO_RETURN = 0.005
"""Part of the range of torque by which a first cycle may miss its begin without differing from the later ones."""
MUCH_MORE = 3.0
"""Ratio of this distance to that of later cycles from which on the first one differs: drift makes them alike."""
RESTS = 0.01
"""Part of the range of motion within which the joint rests."""


@dataclass(frozen=True)
class Cycle:
    """One closed cycle: rows from `start` to `stop`, both included, and its turning points in between."""

    start: int
    stop: int
    turns: tuple[int, ...]

    @property
    def rows(self) -> slice:
        """Its rows."""
        return slice(self.start, self.stop + 1)

    def pieces(self, theta: Array, direction: int) -> list[slice]:
        """Rows, piece by piece, in which the angle (n,) goes in a direction, 1 up or -1 down."""
        edges = [self.start, *self.turns, self.stop]
        return [slice(a, b + 1) for a, b in pairwise(edges) if (theta[b] - theta[a]) * direction > 0]


@dataclass(frozen=True)
class Cycles:
    """The cycles of a recording.

    used: those that are analysed. settled: number of first ones that are not. smaller: number of further ones of a
    smaller range. partial: number of further stretches that are no whole cycle. loading: direction in which the joint
    moves away from rest, 1 up or -1 down. starts_at: the angle [rad] at which a cycle begins.
    """

    used: tuple[Cycle, ...]
    settled: int
    smaller: int
    partial: int
    loading: int
    starts_at: float

    def settled_for(self, torque: Array) -> "Cycles":
        """Without the first cycle if it differs: its torque (n,) [N*m] does not come back, that of later ones does.

        A device with hysteresis that starts from rest begins within its loop and ends on it.
        """
        first, *later = (abs(float(torque[cycle.stop] - torque[cycle.start])) for cycle in self.used)
        if not later or first <= max(MUCH_MORE * max(later), NO_RETURN * float(np.ptp(torque))):
            return self
        return replace(self, used=self.used[1:], settled=self.settled + 1)


def find_cycles(theta: Array, settle: int = 0) -> Cycles:
    """The cycles of an angle theta (n,) [rad], filtered, without the first `settle` ones.

    A cycle begins where the recording begins, and ends where the angle comes back in the same direction; if the motion
    starts at one of its ends, where the angle comes back to this end. Loading is the way to the end that is farther
    from the start.

    Raises
    ------
    InputError
        There is no whole cycle, or none after the first ones.
    """
    low, high = float(theta.min()), float(theta.max())
    span, start = high - low, float(theta[0])
    turns = turning_points(theta, SMALLEST_SWING * span)
    edges = cycle_edges(theta, turns, span)
    closed = [
        Cycle(a, b, tuple(t for t in turns if a < t < b))
        for a, b in pairwise(edges)
        if abs(theta[b] - theta[a]) <= CLOSED * span and np.ptp(theta[a : b + 1]) > SMALLEST_SWING * span
    ]
    found = [cycle for cycle in closed if np.ptp(theta[cycle.rows]) >= WHOLE * span]
    if not found:
        raise InputError(
            f"no whole cycle: the angle begins at {in_deg(start)} deg, goes to {in_deg(low)} and {in_deg(high)} deg, "
            f"and ends at {in_deg(theta[-1])} deg; record the way back to the start"
        )
    if len(found) <= settle:
        raise InputError(
            f"the first {settle} of {len(found)} whole cycles are not analysed; record more, or lower settle_cycles"
        )
    farther = 1 if high - theta[found[0].start] >= theta[found[0].start] - low else -1
    partial, smaller = partial_cycles(theta, edges, closed), len(closed) - len(found)
    return Cycles(tuple(found[settle:]), settle, smaller, partial, farther, start)


def in_deg(angle: float) -> str:
    """An angle [rad] for messages, in degrees."""
    return f"{round(np.rad2deg(angle), 2) + 0.0:.2f}"


def partial_cycles(theta: Array, edges: Sequence[int], found: Sequence[Cycle]) -> int:
    """Number of stretches of the angle (n,) between edges, or at its ends, that move and are no cycle."""
    swing = SMALLEST_SWING * float(np.ptp(theta))
    stretches = pairwise(sorted({0, *edges, len(theta) - 1}))
    moves = [(a, b) for a, b in stretches if np.ptp(theta[a : b + 1]) > swing]
    return sum((a, b) not in {(cycle.start, cycle.stop) for cycle in found} for a, b in moves)


def turning_points(theta: Array, swing: float) -> list[int]:
    """Rows at which the angle (n,) turns, and comes back by `swing` or more before it goes on."""
    turns: list[int] = []
    highest = lowest = 0
    direction = 0
    top = bottom = float(theta[0])
    for row, value in enumerate(theta.tolist()):
        if value > top:
            highest, top = row, value
        if value < bottom:
            lowest, bottom = row, value
        if direction >= 0 and value < top - swing:
            turns += [highest] if direction else []
            direction, lowest, bottom = -1, row, value
        elif direction <= 0 and value > bottom + swing:
            turns += [lowest] if direction else []
            direction, highest, top = 1, row, value
    return turns


def cycle_edges(theta: Array, turns: Sequence[int], span: float) -> list[int]:
    """Rows at which cycles of an angle (n,) may begin or end."""
    start, last = float(theta[0]), len(theta) - 1
    at_low, at_high = start - theta.min() < AT_AN_END * span, theta.max() - start < AT_AN_END * span
    if at_low or at_high:
        same = [turn for turn in turns if abs(theta[turn] - start) < AT_AN_END * span + CLOSED * span]
        return [0, *same, last]
    segments = list(pairwise([0, *turns, last]))
    direction = np.sign(theta[segments[0][1]] - start)
    closes = abs(theta[last] - start) <= CLOSED * span
    edges = [0]
    for a, b in segments[1 : -1 if closes else None]:
        if (start - theta[a]) * direction > 0 and (theta[b] - start) * direction > 0:
            edges.append(a + int(np.argmax((theta[a : b + 1] - start) * direction >= 0)))
    return [*edges, last]


def moving(theta: Array) -> slice:
    """The rows of an angle (n,) between its rests at both ends."""
    near = RESTS * np.ptp(theta)
    away, back = np.abs(theta - theta[0]) > near, np.abs(theta - theta[-1]) > near
    return slice(max(int(np.argmax(away)) - 1, 0), len(theta) - max(int(np.argmax(back[::-1])) - 1, 0))


def joined(pieces: Sequence[slice]) -> NDArray[np.intp]:
    """The rows of several pieces, one after the other."""
    return np.concatenate([np.arange(piece.start, piece.stop) for piece in pieces])
