"""All hypotheses that may explain a torque, by family.

| family | what is not as Eq. 15 has it |
|---|---|
| (none) | nothing: a second-order joint |
| path | the torque is delayed or filtered on its way to the record |
| time | stiffness, damping or inertia changes during the recording |
| speed | damping depends on speed, or there is play |
| size | stiffness depends on the angle |
| direction | stiffness or damping depends on the direction of motion |
| clipping | the largest torques are cut |
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from osl_analysis.inference.constants import Ranges
from osl_analysis.inference.hypothesis import PLAIN, Candidate, Hypothesis, OneParameter, Search
from osl_analysis.inference.spectra import Spectrum
from osl_analysis.inference.whitening import Whitened
from osl_analysis.trial import Array


class Path(OneParameter):
    """What lies between the joint's torque and its record."""

    def candidates(self, search: Search) -> list[Candidate]:
        return super().candidates(search) if search.may_be_path else []


class Filter(Path):
    """A linear filter of the torque."""

    @abstractmethod
    def response(self, value: float) -> Spectrum:
        """Response of the path (f,)."""

    def columns(self, values: Array) -> Array:
        responses = np.array([self.response(value) for value in values.tolist()])
        return self.data.column(self.data.spectra.derivatives[:3] * responses[:, None])


class Delay(Filter):
    """A torque that is late by a constant time, or early if it is negative."""

    @cached_property
    def grid(self) -> Array:
        return np.linspace(*Ranges.DELAY_S, 26)

    def response(self, value: float) -> Spectrum:
        return np.asarray(np.exp(-value * self.data.spectra.s))


class LowPass(Filter):
    """A torque behind a low-pass of first order, or an angle, whose time constant is negative."""

    @cached_property
    def grid(self) -> Array:
        of_torque = np.geomspace(*Ranges.LAG_S, 11)
        return np.concatenate([-of_torque[::-1], of_torque])

    def response(self, value: float) -> Spectrum:
        low_pass = 1 / (1 + abs(value) * self.data.spectra.s)
        return low_pass if value > 0 else 1 / low_pass


class SeriesSpring(Path):
    """A spring between the angle's encoder and the joint.

    With Z = K + B s + I s^2 and the compliance c the torque is Z/(1 + c Z) theta, which is not
    linear in K, B and I: Gauss-Newton steps linearise it.
    """

    @cached_property
    def grid(self) -> Array:
        return np.geomspace(*Ranges.COMPLIANCE, 9)

    def left_on_grid(self, search: Search) -> Array:
        models = [self.model(value, search) for value in self.grid.tolist()]
        return np.array([search.fit(columns, torque)[0] for columns, torque in models])

    def model(self, value: float, search: Search) -> tuple[Array, Array]:
        spectra = self.data.spectra
        powers = spectra.s ** np.arange(3)[:, None]
        impedance = search.impedance
        columns = self.data.motion
        torque = self.data.torque
        for _ in range(4):
            of_joint = impedance @ powers
            gain = 1 / (1 + value * of_joint)
            columns = self.data.column(spectra.derivatives[:3] * gain**2)
            modelled = self.data.column(spectra.derivatives[0] * of_joint * gain)
            torque = self.data.torque - (modelled - impedance @ columns)
            impedance = search.fit(columns, torque)[1]
        return columns, torque


class Play(OneParameter):
    """Play before spring and damper, which follow the angle when a gap is taken up."""

    @cached_property
    def grid(self) -> Array:
        return self.data.gap_widths

    def columns(self, values: Array) -> Array:
        return self.data.behind_gaps(values)


@dataclass(frozen=True, eq=False)
class Added(Hypothesis):
    """Eq. 15 with further columns.

    Attributes
    ----------
    added : function
        The further columns (p,) of a recording, at the product rate.
    changes : sequence
        Where K, B or I is not one number, what the coefficients of the p columns change of them,
        (3, p).
    shares : sequence of float
        Shares of that change that are read: none, and those at the ends.
    """

    added: Callable[[Whitened], list[Array]]
    changes: Sequence[Sequence[float]] = ()
    shares: Sequence[float] = (0.0, 1.0, -1.0)

    def candidates(self, search: Search) -> list[Candidate]:
        return [self.candidate]

    @cached_property
    def candidate(self) -> Candidate:
        columns = self.data.motion
        if added := self.added(self.data):
            columns = np.concatenate([columns, self.data.of_product(np.array(added))])
        matrices: tuple[Array, ...] = ()
        if self.changes:
            of_motion = self.data.impedance_matrix
            of_added = np.array(self.changes)
            matrices = tuple(np.hstack([of_motion, share * of_added]) for share in self.shares)
        return Candidate(self, columns, self.data.torque, impedance_matrices=matrices)


def change_over_time(data: Whitened) -> list[Array]:
    """Stiffness, damping and inertia that change evenly."""
    spectra = data.spectra
    since_middle = spectra.relative_time - 0.5
    return [x * since_middle for x in (spectra.theta, spectra.omega, spectra.alpha)]


def change_at_once(data: Whitened) -> list[Array]:
    """Stiffness and damping that step in the middle of the recording."""
    is_after = data.spectra.relative_time > 0.5
    return [data.spectra.theta * is_after, data.spectra.omega * is_after]


def damping_by_speed(data: Whitened) -> list[Array]:
    """Damping that grows with the speed."""
    omega = data.spectra.omega
    return [omega * np.abs(omega)]


def hardening(data: Whitened) -> list[Array]:
    """A spring whose stiffness depends on the angle."""
    square = data.spectra.angle**2
    return [square, square * data.spectra.angle]


def stiffness_by_side(data: Whitened) -> list[Array]:
    """Another stiffness on each side of the mean angle."""
    return [np.abs(data.spectra.angle)]


def by_direction(data: Whitened) -> list[Array]:
    """Another stiffness and damping in each direction of motion."""
    return [data.spectra.angle * data.sign, np.abs(data.spectra.omega)]


class Clipping(Hypothesis):
    """A torque of which one or both ends are cut; K, B and I predict what is missing.

    An end is the median of what is recorded where more is predicted: noise is added after an
    amplifier has cut, so that the largest samples are beyond it.
    """

    OUTERMOST = (0.002, 0.998)  # quantiles of a torque that are its ends, beside noise
    MOST_STEPS = 16  # the end and what is beyond it are found in turn
    # slope of a recorded torque over the modelled one beyond its end: halfway between a torque that
    # is cut, and one that goes on
    MOST_FOLLOWING = 0.5
    AT_REST = 0.1  # SD of the speed, below which the joint rests
    LAST_STEP = 1e-9  # relative change of K, B and I below which a step is the last one

    def candidates(self, search: Search) -> list[Candidate]:
        torque = self.data.torque
        ends = self.outermost
        coefficients = search.coefficients
        for _ in range(self.MOST_STEPS):
            ends_before = ends
            coefficients_before = coefficients
            with_padding = self.modelled(coefficients)
            modelled = with_padding[self.inside]
            ends = self.next_ends(modelled, ends)
            missing = with_padding - np.clip(with_padding, *ends)
            torque = self.data.torque + self.data.of_product(missing)
            coefficients = search.fit(self.data.motion, torque)[1]
            change = np.abs(coefficients - coefficients_before)
            has_moved = bool((change > self.LAST_STEP * np.abs(coefficients)).any())
            if ends == ends_before and not has_moved:
                break
        if self.slope_beyond(modelled, ends_before) > self.MOST_FOLLOWING or self.mostly_rests(
            missing
        ):
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
        low, high = np.quantile(self.recorded, self.OUTERMOST)
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
        return bool(np.median(speed[missing[self.inside] != 0]) < self.AT_REST * speed.std())

    def slope_beyond(self, modelled: Array, ends: tuple[float, float]) -> float:
        """Slope of the recorded torque over the modelled one (i,), beyond each end of the recorded
        one: 0 where it is cut, 1 where it goes on. 1 if nothing is beyond."""
        low, high = ends
        product = 0.0
        square = 0.0
        for rows in (modelled > high, modelled < low):
            if rows.any():
                model_about_mean = modelled[rows] - modelled[rows].mean()
                product += float(model_about_mean @ self.recorded[rows])
                square += float(model_about_mean @ model_about_mean)
        return product / square if square > 0 else 1.0

    @cached_property
    def motion(self) -> Array:
        """The columns of the motion (3, p) or (4, p), with the angle about its mean."""
        motion = self.data.motion_at_product_rate().copy()
        motion[0] = self.data.spectra.angle
        return motion


def hypotheses_for(data: Whitened) -> list[Hypothesis]:
    """All hypotheses that compete for a recording of a joint that is no leg."""
    of_all = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    of_K_and_B = ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0))
    in_middle_and_at_ends = (0.0, -0.5, 0.5)
    before_and_after = (0.0, 1.0)
    return [
        plain(data),
        Delay(data, "path", "delay"),
        LowPass(data, "path", "low-pass"),
        SeriesSpring(data, "path", "spring in series"),
        Added(data, "time", "change over time", change_over_time, of_all, in_middle_and_at_ends),
        Added(data, "time", "change at once", change_at_once, of_K_and_B, before_and_after),
        Added(data, "speed", "damping by speed", damping_by_speed),
        Added(data, "size", "hardening", hardening),
        Added(data, "size", "K by side", stiffness_by_side, ((1.0,), (0.0,), (0.0,))),
        Added(data, "direction", "K and B by direction", by_direction, of_K_and_B),
        Play(data, "speed", "play"),
        Clipping(data, "clipping", "clipping"),
    ]


def plain(data: Whitened) -> Hypothesis:
    """Eq. 15 alone."""
    return Added(data, "", PLAIN, lambda _: [])
