"""A stiffness that changes while a stepped sine is recorded, as by warming up: found between cycles of one frequency.

Each frequency is measured at another time. A stiffness that falls meanwhile looks like inertia: K - I w^2 falls with w.
If K falls by 1 %, I of an ankle rises by 4 %, forty standard errors, and every other number of the fit looks sound.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri, stdtrit

from osl_analysis.bench.phasor_lag import LITTLE_INERTIA
from osl_analysis.bench.segments import Segment
from osl_analysis.stats.covariance import FEWEST_CYCLES
from osl_analysis.stats.cycle_sums import products_between
from osl_analysis.stats.fit_row import Row
from osl_analysis.stats.regression import LinearFit
from osl_analysis.trial import Array

CERTAIN = 0.999
"""Probability that the estimate of a constant stiffness is below the part of a change that counts as noise."""
PASSES = 0.99
"""Probability that a joint of Eq. 15 is taken as one."""
UNTOLD = 0.1
"""Share of I that an unseen change of K may make, from which it is not known whether K changes."""
OF_DRIFT = ("K_drift", "drift_inertia_share")
"""Columns of a change of K, null where it cannot be told."""


def stiffness_of_cycles(theta: Array, torque: Array, segments: Sequence[Segment]) -> dict[Segment, Array]:
    """Middle [samples], torque in phase over angle [N*m/rad] and weight of each used cycle, (3, m), of each segment.

    `theta` [rad] and `torque` [N*m], shape (n,), are the filtered signals, without the load cell's drift. In whole
    cycles of a sine the torque in phase with the angle is K - I w^2.
    """
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


def stiffness_drift_row(stiffness: Mapping[Segment, Array], segments: Sequence[Segment], fit: LinearFit) -> Row:
    """`K_drift`, the change of K over the cycles of the segments as a share of K, and `drift_inertia_share`, of I.

    `stiffness` is that of their cycles (`stiffness_of_cycles`), `fit` that of Eq. 15. Both are what is beyond the noise
    of a constant stiffness, 0 if nothing is. Null where noise hides a change that would spoil I.
    """
    cycles = Cycles.of(stiffness, segments)
    slope = stiffness_slope(cycles)
    if slope is None:
        return dict.fromkeys(OF_DRIFT)
    taken = cycles.taken_for_inertia() / float(np.hypot(fit["I"], LITTLE_INERTIA))
    noise = float(stdtrit(slope.degrees_of_freedom, CERTAIN)) * slope.se
    if abs(slope.change) <= noise:
        unknown = taken * noise > UNTOLD
        return dict.fromkeys(OF_DRIFT, None if unknown else 0.0)
    beyond = float(np.sign(slope.change)) * (abs(slope.change) - noise)
    return {"K_drift": beyond / fit["K"], "drift_inertia_share": taken * abs(slope.change)}


@dataclass(frozen=True)
class Cycles:
    """Cycles of some segments, shape (n,) each."""

    kind: NDArray[np.intp]
    """Number of their amplitude and frequency."""
    curvature: Array
    """Angular acceleration over angle, -w^2 [rad^2/s^2]."""
    when: Array
    """Time from the first cycle, as a share of that to the last."""
    stiffness: Array
    """Torque in phase over angle [N*m/rad]."""
    weight: Array
    """Sum of the squares of the angle."""

    @classmethod
    def of(cls, stiffness: Mapping[Segment, Array], segments: Sequence[Segment]) -> "Cycles":
        """The used cycles of the segments, by their `stiffness` (`stiffness_of_cycles`)."""
        kinds = [(segment.amplitude, segment.frequency_hz) for segment in segments]
        number = {kind: k for k, kind in enumerate(dict.fromkeys(kinds))}
        lengths = [stiffness[segment].shape[1] for segment in segments]
        kind = np.repeat([number[kind] for kind in kinds], lengths)
        frequency = np.repeat([frequency for _, frequency in kinds], lengths)
        when, in_phase, weight = np.concatenate([stiffness[segment] for segment in segments], axis=1)
        share = (when - when.min()) / max(np.ptp(when), 1.0)
        return cls(kind, -((2 * np.pi * frequency) ** 2), share, in_phase, weight)

    def chosen(self, cycles: NDArray[np.bool_]) -> "Cycles":
        """Those cycles, of all (n,), that are true."""
        return Cycles(*(getattr(self, field.name)[cycles] for field in fields(self)))

    def of_kinds(self) -> Array:
        """Columns (n, kinds) of a stiffness of each amplitude and frequency."""
        return np.asarray(self.kind[:, None] == np.unique(self.kind), dtype=np.float64)

    def of_second_order(self) -> Array:
        """Columns (n, 2) of the stiffness in phase of Eq. 15, K - I w^2."""
        return np.stack([np.ones_like(self.curvature), self.curvature], axis=1)

    def taken_for_inertia(self) -> float:
        """Inertia [kg*m^2] as which Eq. 15 takes a stiffness that rises by 1 N*m/rad over the cycles."""
        root = np.sqrt(self.weight)
        return abs(float(np.linalg.lstsq(root[:, None] * self.of_second_order(), root * self.when)[0][1]))


@dataclass(frozen=True)
class Slope:
    """A change [N*m/rad] of stiffness from the first cycle to the last, beside other columns, and its error."""

    change: float
    squares: float
    """Weighted sum of the squares of what the fit leaves."""
    degrees_of_freedom: int
    spread: float
    """Weighted sum of the squares of the time beside the other columns."""

    @property
    def variance(self) -> float:
        """Variance of what the fit leaves, of a cycle of weight 1."""
        return self.squares / self.degrees_of_freedom

    @property
    def se(self) -> float:
        """Standard error [N*m/rad] of the change."""
        return float(np.sqrt(self.variance / self.spread))


def slope_beside(cycles: Cycles, columns: Array) -> Slope | None:
    """The slope of the stiffness over time beside columns (n, m); None if the cycles are too few to know its error."""
    degrees_of_freedom = len(cycles.when) - columns.shape[1] - 1
    if degrees_of_freedom < FEWEST_CYCLES:
        return None
    root = np.sqrt(cycles.weight)[:, None]
    both = root * np.stack([cycles.when, cycles.stiffness], axis=1)
    both -= root * columns @ np.linalg.lstsq(root * columns, both)[0]
    spread = float(both[:, 0] @ both[:, 0])
    change = float(both[:, 0] @ both[:, 1]) / spread
    return Slope(change, float(np.sum((both[:, 1] - change * both[:, 0]) ** 2)), degrees_of_freedom, spread)


def stiffness_slope(cycles: Cycles) -> Slope | None:
    """The slope of the stiffness over time; None if the cycles do not tell it.

    Cycles of one amplitude at one frequency differ by what K changes alone, wherever in the recording they are. Where
    Eq. 15 with a changing K explains all others, too, but for the noise of cycles, the change from one frequency to the
    next tells much more. An F test decides. Friction, and whatever else Eq. 15 misses, fails it.
    """
    own, common = (slope_beside(cycles, columns) for columns in (cycles.of_kinds(), cycles.of_second_order()))
    if own and common:
        more = common.degrees_of_freedom - own.degrees_of_freedom
        if more > 0 and common.squares - own.squares < more * own.variance * fdtri(
            more, own.degrees_of_freedom, PASSES
        ):
            return common
    many = cycles.chosen(np.bincount(cycles.kind)[cycles.kind] >= FEWEST_CYCLES)
    return slope_beside(many, many.of_kinds())
