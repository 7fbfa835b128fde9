# SPDX-License-Identifier: Apache-2.0
"""Geometry of a crossing: what markers and plate recorded, and the ankle between foot and shank.

The torque is computed from force and moment at the plate's origin, never from a centre of pressure,
which is undefined while the plate is unloaded:

    tau = -(M + (c - a) x F) . e,

with force F and moment M of the ground on the foot about the plate's centre c, the ankle's centre a
and its axis e, which points to the left.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.base.trial import Array
from osl_analysis.walking.plate import Stance, WrenchReader, between
from osl_analysis.walking.poses import FREE_FALL, BodyMotion, Poses, StaticCalibration

PRESSED_N = 100.0  # vertical force above which a centre of pressure is defined
VERTICAL = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Passage:
    """A crossing as markers and plate recorded it, in all k frames and in n `rows`.

    The rows are stance, and up to 0.1 s before and after it for the low-pass.
    """

    name: str
    frames: Array  # time (k,) [s] of all frames
    recorded: dict[str, Poses]  # of foot, shank and platform in all frames, not low-passed
    wrench: WrenchReader  # of the plate, in all frames, minus its zero
    corners: Array  # of the plate (4, 3) [m] at rest
    stance: Stance
    onset: float | None  # of the perturbation [s]
    rows: slice
    poses: dict[str, Poses]  # in `rows`, low-passed

    @property
    def time(self) -> Array:
        return self.frames[self.rows]


@dataclass(frozen=True)
class Ankle:
    """The ankle in n frames: the means of foot's and shank's centre and axis."""

    theta: Array  # joint angle (n,) [rad], dorsiflexion positive
    centre: Array  # (n, 3) [m]
    axis: Array  # unit vectors (n, 3) to the left

    @property
    def forward(self) -> Array:
        """Level directions (n, 3) in which the foot points."""
        return np.cross(self.axis, VERTICAL)

    def along(self, vectors: Array) -> Array:
        """Components (2, n) of vectors (n, 3) to the left and forward."""
        return np.einsum("kni,ni->kn", (self.axis, self.forward), vectors)


def ankle_between(foot: Poses, shank: Poses, calibration: StaticCalibration) -> Ankle:
    """Find angle, centre and axis of the ankle from the poses of foot and shank."""
    axis = (foot.rotation + shank.rotation) @ calibration.ankle_axis
    centre = calibration.ankle_centre
    return Ankle(
        theta=ankle_angle(foot, shank, calibration.ankle_axis),
        centre=(foot.point(centre) + shank.point(centre)) / 2,
        axis=axis / np.linalg.norm(axis, axis=1, keepdims=True),
    )


def ankle_angle(foot: Poses, shank: Poses, axis: Array) -> Array:
    """Joint angle theta (n,) [rad], zero in the static pose.

    It is minus the twist of the foot relative to the shank about the axis (3,), which points to
    the left: a foot that turns about it by a positive angle lowers its toes.
    """
    relative = np.einsum("nji,njk->nik", shank.rotation, foot.rotation)
    quaternion = scipy.spatial.transform.Rotation.from_matrix(relative).as_quat(canonical=True)
    return -2 * np.arctan2(quaternion[:, :3] @ axis, quaternion[:, 3])


def ankle_torque(reaction: Array, plate_centre: Array, ankle: Array, axis: Array) -> Array:
    """Internal plantarflexion moment about the ankle's axis.

    Parameters
    ----------
    reaction : Array
        Force F [N] and moment M [N*m] of the ground on the foot (n, 6), in laboratory axes, about
        the plate's centre.
    plate_centre, ankle : Array
        The plate's centre c and the ankle's centre a [m], (3,) or (n, 3).
    axis : Array
        Unit vectors (n, 3) to the left.

    Returns
    -------
    Array
        tau (n,) [N*m] = -(M + (c - a) x F) . axis.
    """
    F, M = reaction[:, :3], reaction[:, 3:]
    about_ankle = M + np.cross(plate_centre - ankle, F)
    return -np.sum(about_ankle * axis, axis=1)


def load_on_foot(reaction: Array, centre: Array, ankle: Ankle) -> Array:
    """Vertical force [N], and centre of pressure [m] to the left of the ankle and before it, 0 if
    hardly pressed: (3, n), from the reaction (n, 6) about `centre` (n, 3) [m]."""
    vertical = reaction[:, 2]
    pressed = vertical > PRESSED_N
    divisor = np.where(pressed, vertical, 1.0)[:, None]
    from_ankle = centre + np.cross(VERTICAL, reaction[:, 3:]) / divisor - ankle.centre
    return np.vstack([vertical, pressed * ankle.along(from_ankle)])


def moment_of_foot(
    foot: BodyMotion, ankle: Array, axis: Array, mass: float, inertia: float
) -> Array:
    """Torque of weight and inertia of all that moves with the foot.

    Parameters
    ----------
    foot : BodyMotion
        Of the foot and of its centre of mass c, n frames.
    ankle, axis : Array
        Centre a (n, 3) [m] and axis (n, 3) of the ankle.
    mass, inertia : float
        m [kg], and I [kg*m^2] about the axis through c.

    Returns
    -------
    Array
        (n,) [N*m]: axis . ((c - a) x m (c'' - g) + I alpha).
    """
    inertial_force = mass * (foot.acceleration - FREE_FALL)
    moment = np.cross(foot.point - ankle, inertial_force) + inertia * foot.alpha
    return np.sum(axis * moment, axis=1)


def platform_turn(time: Array, turned: Poses, axis: Array, window: tuple[float, float]) -> float:
    """Find the largest turn of the platform in a window [s] from its start.

    Parameters
    ----------
    turned : Poses
        Of the platform, at times (n,) [s].
    axis : Array
        Of the ankle (n, 3), to the left.

    Returns
    -------
    float
        [rad], toes up positive.
    """
    rotation = turned.rotation[between(time, window)]
    vectors = scipy.spatial.transform.Rotation.from_matrix(rotation @ rotation[0].T).as_rotvec()
    turns = -vectors @ axis.mean(axis=0)
    return turns[np.argmax(np.abs(turns))]
