"""A stiffness that changes while a stepped sine is recorded, as by warming up: found between cycles of one frequency.

Each frequency is measured at another time. A stiffness that falls meanwhile looks like inertia: K - I w^2 falls with w.
If K falls by 1 %, I of an ankle rises by 4 %, forty standard errors, and every other number of the fit looks sound.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import stdtrit

from osl_analysis.bench.segments import Segment
from osl_analysis.stats.covariance import FEWEST_CYCLES
from osl_analysis.stats.cycle_sums import products_between
from osl_analysis.trial import Array

AT_ONCE = 15
"""Segments that are summed at a time: more of them would need room in a recording of hours."""
CERTAIN = 0.999
"""Probability that the estimate of a constant stiffness is below the part of a change that counts as noise."""


def stiffness_of_cycles(theta: Array, torque: Array, segments: Sequence[Segment]) -> dict[Segment, Array]:
    """Middle [samples], torque in phase over angle [N*m/rad] and weight of each used cycle, (3, m), of each segment.

    `theta` [rad] and `torque` [N*m], shape (n,), are the filtered signals, without the load cell's drift. In whole
    cycles of a sine the torque in phase with the angle is K - I w^2.
    """
    in_turn = sorted(segments, key=lambda segment: segment.start)
    found: dict[Segment, Array] = {}
    for k in range(0, len(in_turn), AT_ONCE):
        found |= stiffness_of_some(theta, torque, in_turn[k : k + AT_ONCE])
    return found


def stiffness_of_some(theta: Array, torque: Array, segments: Sequence[Segment]) -> dict[Segment, Array]:
    """As `stiffness_of_cycles`, for segments that follow one another."""
    first, end = (np.concatenate([segment.edges[segment.used + k] for segment in segments]) for k in (0, 1))
    begin, stop = int(np.min(first)), int(np.max(end)) + 2
    x, y = theta[begin:stop], torque[begin:stop]
    nowhere = np.zeros(2 * len(first), dtype=np.intp)
    sums = products_between(np.array([x, np.ones_like(x)]).T, np.array([x, y]).T, first - begin, end - begin, nowhere)
    (squares, products), (angles, torques) = np.moveaxis(sums, 0, 2)
    squares -= angles**2 / (end - first)
    products -= angles * torques / (end - first)
    ends = np.cumsum([len(segment.used) for segment in segments])[:-1]
    found = np.split(np.array([(first + end) / 2, products / squares, squares]), ends, axis=1)
    return dict(zip(segments, found, strict=True))


def stiffness_drift(stiffness: Mapping[Segment, Array], segments: Sequence[Segment]) -> float:
    """Change of the stiffness [N*m/rad] over the cycles of the segments, beyond what noise can make of a constant one.

    `stiffness` is that of their cycles (`stiffness_of_cycles`). Cycles of one amplitude at one frequency differ by what
    K changes alone, wherever in the recording they are. The slope over time that all have in common, times the time
    from the first cycle to the last, is the change. It is 0 where no frequency has five cycles.
    """
    kinds: dict[tuple[float, float], list[Array]] = {}
    for segment in segments:
        kinds.setdefault((segment.amplitude, segment.frequency_hz), []).append(stiffness[segment])
    cycles = [np.concatenate(parts, axis=1) for parts in kinds.values()]
    cycles = [rows for rows in cycles if rows.shape[1] >= FEWEST_CYCLES]
    if not cycles:
        return 0.0
    everywhen = np.concatenate([rows[0] for rows in cycles])
    for rows in cycles:
        rows[:2] -= np.average(rows[:2], axis=1, weights=rows[2])[:, None]
    when, stiffness, weight = np.concatenate(cycles, axis=1)
    spread = float(weight @ when**2)
    slope = float(weight @ (when * stiffness)) / spread
    degrees_of_freedom = len(when) - len(cycles) - 1
    variance = float(weight @ (stiffness - slope * when) ** 2) / degrees_of_freedom / spread
    noise = float(stdtrit(degrees_of_freedom, CERTAIN)) * np.sqrt(variance)
    return float(np.sign(slope) * max(abs(slope) - noise, 0.0) * np.ptp(everywhen)) + 0.0  # no -0
