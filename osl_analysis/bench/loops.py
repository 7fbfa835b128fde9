"""Cycles of a slow motion to and fro: where each begins, turns and ends, and the energy in it."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.trial import Array

TURNING_SHARE = 0.1  # of the range of motion: a smaller return is no turning point
AT_AN_END = 0.1  # of the range of motion: a start this near an end counts as this end
CLOSED = 0.02  # of the range of motion: largest distance between the ends of a cycle
WHOLE = 0.9  # of the range of motion: a cycle that covers less is a smaller one


Cycle = tuple[int, ...]
"""A closed cycle of an angle, by rows: where it begins, turns (once or more often) and ends."""


def whole(cycle: Cycle) -> slice:
    """All rows of a cycle, with the last one."""
    return slice(cycle[0], cycle[-1] + 1)


def branch_rows(cycles: Sequence[Cycle], theta: Array, direction: int) -> NDArray[np.intp]:
    """The rows of cycles in which the angle (n,) rises (1) or falls (-1) from turn to turn."""
    parts = [
        np.arange(first, last + 1)
        for cycle in cycles
        for first, last in pairwise(cycle)
        if (theta[last] - theta[first]) * direction > 0
    ]
    return np.concatenate(parts)


def find_cycles(theta: Array) -> tuple[list[Cycle], int]:
    """Find the whole cycles of a slow motion, and the number of its other stretches.

    A cycle ends where the angle returns to its start in the same direction, or, if the motion
    starts at one of its ends, where it returns to this end. Other stretches cover less than
    `WHOLE` of the range, or do not close.

    Parameters
    ----------
    theta : Array
        Filtered angle (n,) [rad].

    Raises
    ------
    InputError
        There is no whole cycle.
    """
    span = float(np.ptp(theta))
    swing = TURNING_SHARE * span
    highest, _ = scipy.signal.find_peaks(theta, prominence=swing)
    lowest, _ = scipy.signal.find_peaks(-theta, prominence=swing)
    turns = np.sort(np.concatenate([highest, lowest])).tolist()
    edges = cycle_edges(theta, turns, span)
    cycles: list[Cycle] = []
    others = 0
    for first, last in pairwise(edges):
        range_of_stretch = np.ptp(theta[first : last + 1])
        is_closed = abs(theta[last] - theta[first]) <= CLOSED * span
        if is_closed and range_of_stretch >= WHOLE * span:
            cycles.append((first, *(turn for turn in turns if first < turn < last), last))
        elif range_of_stretch > swing:
            others += 1
    if not cycles:
        first_deg, low_deg, high_deg, last_deg = (
            np.rad2deg([theta[0], theta.min(), theta.max(), theta[-1]]).round(2) + 0.0
        )  # without "-0.00"
        raise InputError(
            f"no whole cycle: the angle begins at {first_deg:.2f} deg, goes to {low_deg:.2f} and"
            f" {high_deg:.2f} deg, and ends at {last_deg:.2f} deg; record the way back to the start"
        )
    return cycles, others


def cycle_edges(theta: Array, turns: list[int], span: float) -> list[int]:
    """Rows at which cycles of an angle (n,) with a range `span` [rad] may begin or end."""
    start = float(theta[0])
    last_row = len(theta) - 1
    if min(start - theta.min(), theta.max() - start) < AT_AN_END * span:
        at_start = [
            turn for turn in turns if abs(theta[turn] - start) < (AT_AN_END + CLOSED) * span
        ]
        return [0, *at_start, last_row]
    between_turns = list(pairwise([0, *turns, last_row]))
    direction = np.sign(theta[between_turns[0][1]] - start)
    if abs(theta[last_row] - start) <= CLOSED * span:  # the end counts, and is no crossing
        between_turns = between_turns[:-1]
    beyond_start = (theta - start) * direction
    edges = [0]
    for first, last in between_turns[1:]:
        if beyond_start[first] < 0 < beyond_start[last]:
            edges.append(first + int(np.argmax(beyond_start[first : last + 1] >= 0)))
    return [*edges, last_row]


def energies(angle: Array, torque: Array) -> tuple[float, float]:
    """Energies [J] that a cycle takes from the bench and returns: the integral of the torque [N*m]
    over the angle [rad], (n,) each.

    It is summed by pieces, which end where the angle turns or the torque changes sign, so that
    noise does not count as energy in both directions.
    """
    work = scipy.integrate.cumulative_trapezoid(torque, angle, initial=0)
    sign_changes = np.flatnonzero(np.diff(np.signbit(torque))) + 1
    ends = [0, np.argmin(angle), np.argmax(angle), len(angle) - 1, *sign_changes]
    of_pieces = np.diff(work[np.unique(ends)])
    return float(of_pieces[of_pieces > 0].sum()), float(-of_pieces[of_pieces < 0].sum())
