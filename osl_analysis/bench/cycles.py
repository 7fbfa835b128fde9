# SPDX-License-Identifier: Apache-2.0
"""The cycles of a slow motion to and fro, of a belt or a passive joint: where each begins, turns
and ends, and its branches."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Array
from osl_analysis.bench.bench_settings import Calibration
from osl_analysis.bench.impedance import torque_errors

# of the range of motion: a smaller return is no turning point, a start this near an end counts as
# this end, and a cycle that lacks more is a smaller one
SMALL = 0.1
CLOSED = 0.02  # of the range of motion: largest distance between the ends of a cycle
BRANCHES = {"loading": 1, "unloading": -1}  # and whether the angle goes the way of loading

Cycle = tuple[int, ...]
"""A closed cycle of an angle, by rows: where it begins, turns (once or more often) and ends."""


@dataclass(frozen=True)
class Loop:
    """The whole cycles of an angle."""

    cycles: Sequence[Cycle]
    loading: int  # 1: the angle rises while it loads, from where the first cycle begins; -1: falls

    def rows(self, angle: Array, branch: str, *cycles: Cycle) -> NDArray[np.intp]:
        """The rows of a branch, in which the angle (n,) goes its way from turn to turn; of all
        cycles, or of some."""
        parts = [
            np.arange(first, last + 1)
            for cycle in cycles or self.cycles
            for first, last in pairwise(cycle)
            if (angle[last] - angle[first]) * self.loading * BRANCHES[branch] > 0
        ]
        return np.concatenate(parts)


def whole(cycle: Cycle) -> slice:
    """All rows of a cycle, with the last one."""
    return slice(cycle[0], cycle[-1] + 1)


def loop_errors(
    torque: Array, rate_hz: float, rows: NDArray[np.bool_ | np.intp], stated: Calibration
) -> list[Array]:
    """Errors of a torque (n,) [N*m] over an angle, by one standard uncertainty of both gains, of
    the load cell's hysteresis and of its delay."""
    return [stated.polar(0.0)[0] * torque, *torque_errors(torque, rate_hz, rows, stated)]


def find_loop(angle: Array, settle_cycles: int = 0) -> Loop:
    """Find the whole cycles of a slow motion.

    A cycle ends where the angle returns to its start in the same direction, or, if the motion
    starts at one of its ends, where it returns to this end. Other stretches lack more than
    `SMALL` of the range, or do not close.

    Parameters
    ----------
    angle : Array
        Filtered (n,) [rad].
    settle_cycles : int
        First cycles that are left out.

    Raises
    ------
    InputError
        There is no whole cycle, or all are left out.
    """
    span = np.ptp(angle)
    swing = SMALL * span
    highest, _ = scipy.signal.find_peaks(angle, prominence=swing)
    lowest, _ = scipy.signal.find_peaks(-angle, prominence=swing)
    turns = np.sort(np.concatenate([highest, lowest])).tolist()
    cycles = []
    for first, last in pairwise(cycle_edges(angle, turns, span)):
        is_whole = np.ptp(angle[first : last + 1]) >= (1 - SMALL) * span
        if is_whole and abs(angle[last] - angle[first]) <= CLOSED * span:
            cycles.append((first, *(turn for turn in turns if first < turn < last), last))
    if not cycles:
        extremes = [angle[0], angle.min(), angle.max(), angle[-1]]
        first_deg, low_deg, high_deg, last_deg = np.rad2deg(extremes)
        raise InputError(
            # without "-0.00"
            f"no whole cycle: the angle begins at {first_deg:z.2f} deg, goes to {low_deg:z.2f} and"
            f" {high_deg:z.2f} deg, and ends at {last_deg:z.2f} deg",
            "record the way back to the start",
        )
    settled = cycles[settle_cycles:]
    if not settled:
        raise InputError(
            f"all {len(cycles)} whole cycles are left out by settle_cycles",
            "lower it, or record more",
        )
    begin = angle[settled[0][0]]
    rises = angle.max() - begin >= begin - angle.min()
    return Loop(settled, 1 if rises else -1)


def cycle_edges(angle: Array, turns: list[int], span: float) -> list[int]:
    """Rows at which cycles of an angle (n,) with a range `span` [rad] may begin or end."""
    start = angle[0]
    last_row = len(angle) - 1
    if min(start - angle.min(), angle.max() - start) < SMALL * span:
        at_start = [turn for turn in turns if abs(angle[turn] - start) < (SMALL + CLOSED) * span]
        return [0, *at_start, last_row]
    ends_of_ways = [0, *turns, last_row]
    direction = np.sign(angle[ends_of_ways[1]] - start)
    if abs(angle[last_row] - start) <= CLOSED * span:  # the end counts, and is no crossing
        ends_of_ways = ends_of_ways[:-1]
    beyond_start = (angle - start) * direction
    edges = [0]
    for first, last in pairwise(ends_of_ways[1:]):
        if beyond_start[first] < 0 < beyond_start[last]:
            edges.append(first + int(np.argmax(beyond_start[first : last + 1] >= 0)))
    return [*edges, last_row]
