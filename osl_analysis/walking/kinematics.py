"""Velocity and acceleration of a rigid body from its (already filtered) poses."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.signals import differentiate
from osl_analysis.trial import Array
from osl_analysis.walking.rigid_body import Poses

GRAVITY = np.array([0.0, 0.0, -9.80665])
"""Acceleration of free fall [m/s^2] in laboratory axes, z up."""


@dataclass(frozen=True)
class BodyMotion:
    """Motion of a body and one of its points in laboratory axes, n frames.

    `rotation` (n, 3, 3); angular velocity `omega` (n, 3) [rad/s] and acceleration `alpha` (n, 3) [rad/s^2]; the
    point's position `point` (n, 3) [m] and `acceleration` (n, 3) [m/s^2].
    """

    rotation: Array
    omega: Array
    alpha: Array
    point: Array
    acceleration: Array


def body_motion(time: Array, poses: Poses, point: Array) -> BodyMotion:
    """Motion at times (n,) [s] of a body and of its point whose reference position is `point` (3,) [m].

    Angular velocity is the axial vector of (dR/dt) R^T. Poses must be without NaN and low-passed.
    """
    turning = differentiate(time, poses.rotation.reshape(-1, 9)).omega.reshape(-1, 3, 3)
    spin = np.einsum("nij,nkj->nik", turning, poses.rotation)
    omega = 0.5 * np.stack(
        [spin[:, 2, 1] - spin[:, 1, 2], spin[:, 0, 2] - spin[:, 2, 0], spin[:, 1, 0] - spin[:, 0, 1]], axis=1
    )
    path = differentiate(time, poses.points(point[None])[:, 0])
    return BodyMotion(poses.rotation, omega, differentiate(time, omega).omega, path.theta, path.alpha)
