"""Speed, size, direction, clipping: what depends on the motion or on the torque itself."""

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from osl_analysis.inference.hypothesis import Candidate, Hypothesis, OneParameter, Search
from osl_analysis.trial import Array

OUTERMOST = (0.002, 0.998)  # quantiles of a torque that are its ends, beside noise
CLIPPING_STEPS = 16  # the end and what is beyond it are found in turn
# slope of a recorded torque over the modelled one beyond its end: halfway between a torque that is
# cut, and one that goes on
MOST_FOLLOWING = 0.5
AT_REST = 0.1  # SD of the speed, below which the joint rests
LAST_STEP = 1e-9  # relative change of K, B and I below which a step is the last one


class Play(OneParameter):
    """Play before spring and damper, which follow the angle when a gap is taken up."""

    family = "speed"
    name = "play"

    def grid(self) -> Array:
        return self.data.gap_widths

    def columns(self, values: Array) -> Array:
        return self.data.behind_gaps(values)


class Added(Hypothesis):
    """Eq. 15 with further columns.

    Where K, B or I is not one number, `changes` (3, p) has what the coefficients of the p columns
    change of them, and `shares` which shares of that change are read: none, and those at the ends.
    """

    changes: ClassVar[Sequence[Sequence[float]]] = ()
    shares: ClassVar[Sequence[float]] = (0.0, 1.0, -1.0)

    @abstractmethod
    def added(self) -> list[Array]:
        """The further columns (p,), at the product rate."""

    def candidates(self, search: Search) -> list[Candidate]:
        return [self.candidate]

    @cached_property
    def candidate(self) -> Candidate:
        matrices: tuple[Array, ...] = ()
        if self.changes:
            matrices = self.matrices_with_shares(self.changes, self.shares)
        return self.plain(*self.added(), matrices=matrices)


class ChangeOverTime(Added):
    """Stiffness, damping and inertia that change evenly."""

    family = "time"
    name = "change over time"
    changes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    shares = (0.0, -0.5, 0.5)  # in the middle, at the beginning and at the end

    def added(self) -> list[Array]:
        spectra = self.data.spectra
        since_middle = spectra.relative_time - 0.5
        return [x * since_middle for x in (spectra.theta, spectra.omega, spectra.alpha)]


class ChangeAtOnce(Added):
    """Stiffness and damping that step in the middle of the recording."""

    family = "time"
    name = "change at once"
    changes = ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0))
    shares = (0.0, 1.0)  # before and after

    def added(self) -> list[Array]:
        spectra = self.data.spectra
        is_after = spectra.relative_time > 0.5
        return [spectra.theta * is_after, spectra.omega * is_after]


class DampingBySpeed(Added):
    """Damping that grows with the speed."""

    family = "speed"
    name = "damping by speed"

    def added(self) -> list[Array]:
        omega = self.data.spectra.omega
        return [omega * np.abs(omega)]


class Hardening(Added):
    """A spring whose stiffness depends on the angle."""

    family = "size"
    name = "hardening"

    def added(self) -> list[Array]:
        square = self.data.spectra.angle**2
        return [square, square * self.data.spectra.angle]


class StiffnessBySide(Added):
    """Another stiffness on each side of the mean angle."""

    family = "size"
    name = "K by side"
    changes = ((1.0,), (0.0,), (0.0,))

    def added(self) -> list[Array]:
        return [np.abs(self.data.spectra.angle)]


class ByDirection(Added):
    """Another stiffness and damping in each direction of motion."""

    family = "direction"
    name = "K and B by direction"
    changes = ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0))

    def added(self) -> list[Array]:
        spectra = self.data.spectra
        return [spectra.angle * self.data.sign, np.abs(spectra.omega)]


class Clipping(Hypothesis):
    """A torque of which one or both ends are cut; K, B and I predict what is missing.

    An end is the median of what is recorded where more is predicted: noise is added after an
    amplifier has cut, so that the largest samples are beyond it.
    """

    family = "clipping"
    name = "clipping"

    def candidates(self, search: Search) -> list[Candidate]:
        torque = self.data.torque
        ends = self.outermost
        coefficients = search.coefficients
        for _ in range(CLIPPING_STEPS):
            ends_before = ends
            coefficients_before = coefficients
            with_padding = self.modelled(coefficients)
            modelled = with_padding[self.inside]
            ends = self.next_ends(modelled, ends)
            missing = with_padding - np.clip(with_padding, *ends)
            torque = self.data.torque + self.data.of_product(missing)
            coefficients = search.fit(self.data.motion, torque)[1]
            change = np.abs(coefficients - coefficients_before)
            has_moved = bool((change > LAST_STEP * np.abs(coefficients)).any())
            if ends == ends_before and not has_moved:
                break
        if self.slope_beyond(modelled, ends_before) > MOST_FOLLOWING or self.mostly_rests(missing):
            return []
        return [Candidate(self, self.data.motion, torque)]

    @cached_property
    def inside(self) -> slice:
        """Product rows of the recording, without its padding."""
        rows = np.flatnonzero(self.data.spectra.inside)
        return slice(int(rows[0]), int(rows[-1]) + 1)

    @cached_property
    def recorded(self) -> Array:
        """The recorded torque (i,) in these rows."""
        return np.asarray(self.data.spectra.recorded_torque[self.inside])

    @cached_property
    def outermost(self) -> tuple[float, float]:
        """Its ends beside noise [N*m]."""
        low, high = np.quantile(self.recorded, OUTERMOST)
        return float(low), float(high)

    def modelled(self, coefficients: Array) -> Array:
        """Torque (p,) of the motion, with the offset of its smaller half, in which nothing is
        cut."""
        with_padding = coefficients @ self.motion
        modelled = with_padding[self.inside]
        size = np.abs(modelled - np.median(modelled))
        small = size <= np.median(size)
        return np.asarray(with_padding + np.median((self.recorded - modelled)[small]))

    def next_ends(self, modelled: Array, ends: tuple[float, float]) -> tuple[float, float]:
        """Medians of what is recorded beyond ends; an end beyond which no model is stays."""
        low, high = ends
        above = modelled > high
        below = modelled < low
        if above.any():
            high = float(np.median(self.recorded[above]))
        if below.any():
            low = float(np.median(self.recorded[below]))
        return low, high

    def mostly_rests(self, missing: Array) -> bool:
        """Whether the joint rests in most rows in which torque is missing (p,): at rest at a level
        an angle's rounding and the filter's ringing go beyond what is recorded."""
        speed = np.abs(self.data.spectra.omega[self.inside])
        return bool(np.median(speed[missing[self.inside] != 0]) < AT_REST * speed.std())

    def slope_beyond(self, modelled: Array, ends: tuple[float, float]) -> float:
        """`slope_beyond_ends` of some ends."""
        low, high = ends
        beyond = [rows for rows in (modelled > high, modelled < low) if rows.any()]
        return slope_beyond_ends(self.recorded, modelled, beyond)

    @cached_property
    def motion(self) -> Array:
        """The columns of the motion (3, p) or (4, p), with the angle about its mean."""
        motion = self.data.motion_at_product_rate().copy()
        motion[0] = self.data.spectra.angle
        return motion


def slope_beyond_ends(
    recorded: Array, modelled: Array, beyond: Sequence[NDArray[np.bool_]]
) -> float:
    """Slope of the recorded torque (p,) over the modelled one (p,), beyond each end of the recorded
    one: 0 where it is cut, 1 where it goes on. 1 if nothing is beyond."""
    product = 0.0
    square = 0.0
    for rows in beyond:
        model_about_mean = modelled[rows] - modelled[rows].mean()
        product += float(model_about_mean @ recorded[rows])
        square += float(model_about_mean @ model_about_mean)
    return product / square if square > 0 else 1.0
