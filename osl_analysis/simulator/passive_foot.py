"""A passive foot that is moved slowly back and forth: a spring that stiffens, and springs beside it that slip."""

from itertools import pairwise
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from osl_analysis.simulator.effect import NotNegative, Positive
from osl_analysis.simulator.joint_motion import JointMotion
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Settings


class SlippingSpring(Settings):
    """A spring in series with dry friction. Cycles of amplitude A lose 4 limit (A - limit/stiffness)."""

    stiffness: Positive
    """Stiffness [N*m/rad] until it slips."""
    limit: Positive
    """Torque [N*m] at which it slips."""


class SlowCycles(Settings):
    """Ramps at one speed from rest at 0 to the lowest angle, to the highest, and so on, and back to rest at 0."""

    lowest_deg: Annotated[float, Field(ge=-60, le=0)]
    """Lowest angle [deg]."""
    highest_deg: Annotated[float, Field(gt=0, le=60)]
    """Highest angle [deg]."""
    speed_deg_s: Annotated[tuple[Positive, ...], Field(min_length=1)]
    """Speed [deg/s] of each cycle."""
    turn_s: Positive
    """Time [s] in which the motion turns at the end of a ramp."""
    rest_s: Positive
    """Rest [s] before and after."""

    @property
    def total_s(self) -> float:
        """Duration [s] of a trial."""
        way = 2 * (self.highest_deg - self.lowest_deg)
        return 2 * self.rest_s + sum(way / speed for speed in self.speed_deg_s)

    def motion(self, rate_hz: float) -> JointMotion:
        """The commanded motion at `rate_hz` [Hz]; ramps blend into each other at a constant acceleration."""
        pieces = [(0.0, self.rest_s)]
        for speed in self.speed_deg_s:
            for way in (self.lowest_deg, self.highest_deg - self.lowest_deg, -self.highest_deg):
                pieces += [(np.sign(way) * speed, abs(way) / speed)] if way else []
        pieces.append((0.0, self.rest_s))
        steps = [np.full(round(duration * rate_hz), velocity) for velocity, duration in pieces]
        turn = max(round(self.turn_s * rate_hz), 1)
        omega = np.deg2rad(np.convolve(np.concatenate(steps), np.full(turn, 1 / turn), mode="same"))
        theta = np.concatenate([[0.0], np.cumsum((omega[1:] + omega[:-1]) / 2)]) / rate_hz
        return JointMotion(theta, omega, np.gradient(omega) * rate_hz)


class PassiveFoot(Settings):
    """The foot of torque-angle trials, and how it is moved."""

    K: Positive
    """Stiffness [N*m/rad] of the spring at rest."""
    stiffening: NotNegative = 0.0
    """The torque of the spring is K theta (1 + stiffening theta^2) [1/rad^2]."""
    B: NotNegative = 0.0
    """Damping [N*m*s/rad]."""
    slipping: tuple[SlippingSpring, ...] = ()
    """Springs that slip, parallel to it."""
    cycles: SlowCycles
    """The motion."""

    @model_validator(mode="after")
    def _slips_on_the_way(self) -> Self:
        half = np.deg2rad(self.cycles.highest_deg - self.cycles.lowest_deg) / 2
        for spring in self.slipping:
            if spring.limit / spring.stiffness >= half:
                raise ValueError(
                    f"a spring of {spring.stiffness:g} N*m/rad does not reach its limit of {spring.limit:g} N*m on the "
                    "way from the lowest to the highest angle; lower the limit, or leave it out"
                )
        return self

    def torque(self, motion: JointMotion) -> Array:
        """Resisting torque [N*m] on a motion from rest, shape (n,)."""
        theta = motion.theta
        elastic = self.K * theta * (1 + self.stiffening * theta**2) + self.B * motion.omega
        return np.asarray(elastic + sum(slipping_torque(theta, spring) for spring in self.slipping))


def slipping_torque(theta: Array, spring: SlippingSpring) -> Array:
    """Torque (n,) [N*m] of a slipping spring, 0 at the first angle; exact on each way between two turns."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(theta)))) + 1
    torque = np.zeros_like(theta)
    for a, b in pairwise([0, *turns.tolist(), len(theta) - 1]):
        way = slice(a, b + 1)
        torque[way] = np.clip(torque[a] + spring.stiffness * (theta[way] - theta[a]), -spring.limit, spring.limit)
    return torque
