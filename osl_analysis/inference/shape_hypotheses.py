"""Speed, size, direction, clipping: what depends on the motion or on the torque itself."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from osl_analysis.inference.constants import FEWEST_STEPS, PLAYS
from osl_analysis.inference.hypothesis import Candidate, Hypothesis, Linear, OneParameter, Search
from osl_analysis.inference.least_squares import solve_scaled
from osl_analysis.inference.row_filter import contiguous
from osl_analysis.inference.whitening import Whitened
from osl_analysis.trial import Array

STOPS = np.linspace(0.05, 0.95, 10)  # quantiles of the angle at which a stop may be
OUTERMOST = (0.002, 0.998)  # quantiles of a torque that are its ends, beside noise
UNCLIPPED = 0.5  # share of the rows, about the median torque, in which nothing is cut
CLIPPING_STEPS = 16  # the end and what is beyond it are found in turn
# slope of a recorded torque over the modelled one beyond its end: halfway between a torque that is
# cut, and one that goes on
MOST_FOLLOWING = 0.5
LAST_STEP = 1e-9  # relative change of K, B and I below which a step is the last one


class QuadraticDamping(Linear):
    """A damping that grows with the speed."""

    family = "speed"
    name = "damping by speed"
    term = "damping that depends on speed"
    parameters = (("quadratic damping", "N*m*s^2/rad^2"),)

    def added(self) -> list[Array]:
        omega = self.data.spectra.omega
        return [omega * np.abs(omega)]


class Play(OneParameter):
    """Play before the spring: the spring follows the angle when a gap is taken up."""

    family = "speed"
    name = "play"
    term = "backlash"
    parameters = (("play", "rad"),)

    def grid(self) -> Array:
        return gaps(self.data)

    def columns(self, value: float) -> Array:
        return self.data.behind_gap(value, is_kept=value in self._grid)[:1]


class PlayBeforeDamper(Play):
    """Play before spring and damper."""

    name = "play before spring and damper"

    def columns(self, value: float) -> Array:
        return self.data.behind_gap(value, is_kept=value in self._grid)


def gaps(data: Whitened) -> Array:
    """Widths (8,) of a gap [rad], from what rounding cannot be."""
    least = max(PLAYS[0], FEWEST_STEPS * data.spectra.signals.encoder_step)
    return np.geomspace(least, max(PLAYS[1], 2 * least), 8)


class Hardening(Linear):
    """A spring whose stiffness changes with the angle, about any centre."""

    family = "size"
    name = "hardening"
    term = "spring that is not linear"
    parameters = (("quadratic stiffness", "N*m/rad^2"), ("cubic stiffness", "N*m/rad^3"))

    def added(self) -> list[Array]:
        angle = self.data.spectra.angle
        return [angle**2, angle**3]


class StiffnessBySide(Linear):
    """A spring with another stiffness on either side of the middle."""

    family = "size"
    name = "K by side"
    term = "asymmetric torque"
    parameters = (("half the difference of K", "N*m/rad"),)

    def added(self) -> list[Array]:
        return [np.abs(self.data.spectra.angle)]

    def matrices(self) -> tuple[Array, ...]:
        return self.matrices_with_shares([[1.0], [0.0], [0.0]], (0.0, 1.0, -1.0))


class EndStop(OneParameter):
    """A spring that is stiffer or softer beyond an angle, as behind a stop of one side."""

    family = "size"
    name = "end stop"
    term = "spring that is not linear"
    parameters = (("angle of the stop from the mean", "rad"), ("change of K", "N*m/rad"))

    def grid(self) -> Array:
        spectra = self.data.spectra
        return np.asarray(np.quantile(spectra.angle[spectra.inside], STOPS))

    def columns(self, value: float) -> Array:
        beyond = np.maximum(self.data.spectra.angle - value, 0.0)
        return self.data.of_product(beyond[None])

    def with_others(self, columns: Array) -> Array:
        return np.vstack([self.data.motion, columns])


class DeadZone(OneParameter):
    """A gap about the middle in which the spring does not act."""

    family = "size"
    name = "dead zone"
    term = "backlash"
    parameters = (("dead zone", "rad"),)

    def grid(self) -> Array:
        return gaps(self.data)

    def columns(self, value: float) -> Array:
        spectra = self.data.spectra
        beyond = spectra.theta - np.clip(spectra.angle, -value / 2, value / 2)
        return self.data.of_product(beyond[None])


class DampingByDirection(Linear):
    """Another damping in each direction of motion."""

    family = "direction"
    name = "B by direction"
    term = "asymmetric torque"
    parameters = (("half the difference of B", "N*m*s/rad"),)

    def added(self) -> list[Array]:
        return [np.abs(self.data.spectra.omega)]

    def matrices(self) -> tuple[Array, ...]:
        return self.matrices_with_shares([[0.0], [1.0], [0.0]], (0.0, 1.0, -1.0))


class StiffnessByDirection(Linear):
    """Another stiffness in each direction of motion."""

    family = "direction"
    name = "K by direction"
    term = "asymmetric torque"
    parameters = (("half the difference of K", "N*m/rad"),)

    def added(self) -> list[Array]:
        return [self.data.spectra.angle * self.data.sign]

    def matrices(self) -> tuple[Array, ...]:
        return self.matrices_with_shares([[1.0], [0.0], [0.0]], (0.0, 1.0, -1.0))


class Clipping(Hypothesis):
    """A torque of which one or both ends are cut; K, B and I predict what is missing.

    An end is the median of what is recorded where more is predicted: noise is added after an
    amplifier has cut, so that the largest samples are beyond it.
    """

    family = "clipping"
    name = "clipping"
    term = "clipped signal"

    def candidates(self, search: Search) -> list[Candidate]:
        spectra = self.data.spectra
        inside = contiguous(spectra.inside)
        recorded = spectra.recorded_torque[inside]
        low, high = np.quantile(recorded, OUTERMOST)
        torque = self.data.torque
        coefficients = self.coefficients_of_unclipped
        for _ in range(CLIPPING_STEPS):
            ends_before = (low, high)
            coefficients_before = coefficients
            with_padding = coefficients @ self.motion
            modelled = with_padding[inside]
            size = np.abs(modelled - np.median(modelled))
            small = size <= np.quantile(size, UNCLIPPED)
            offset = np.median(recorded[small] - modelled[small])
            with_padding = with_padding + offset
            modelled = modelled + offset
            above = modelled > high
            below = modelled < low
            if above.any():
                high = float(np.median(recorded[above]))
            if below.any():
                low = float(np.median(recorded[below]))
            missing = with_padding - np.clip(with_padding, low, high)
            torque = self.data.torque + self.data.of_product(missing)
            coefficients = search.fit(self.data.motion, torque)[1]
            change = np.abs(coefficients - coefficients_before)
            has_moved = bool((change > LAST_STEP * np.abs(coefficients)).any())
            if (low, high) == ends_before and not has_moved:
                break
        beyond = [rows for rows in (above, below) if rows.any()]
        if slope_beyond_ends(recorded, modelled, beyond) > MOST_FOLLOWING:
            return []
        return [Candidate(self, self.data.motion, torque)]

    @cached_property
    def motion(self) -> Array:
        """The columns of the motion (3, p) or (4, p), with the angle about its mean."""
        motion = self.data.motion_at_product_rate().copy()
        motion[0] = self.data.spectra.angle
        return motion

    @cached_property
    def coefficients_of_unclipped(self) -> Array:
        """Coefficients of the motion, by the rows that are surely not cut: Eq. 15 of a cut torque
        hardly passes its ends."""
        spectra = self.data.spectra
        recorded = spectra.recorded_torque
        share = [(1 - UNCLIPPED) / 2, (1 + UNCLIPPED) / 2]
        ends = np.quantile(recorded[contiguous(spectra.inside)], share)
        small = spectra.inside & (recorded > ends[0]) & (recorded < ends[1])
        beside = np.vstack([self.motion, np.ones_like(recorded), spectra.relative_time])
        return solve_scaled(beside[:, small], recorded[small])[: len(self.motion)]


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
