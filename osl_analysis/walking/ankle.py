"""Step 4, angle and torque: the ankle between foot and shank, and the ground's moment about it.

The torque is computed from force and moment at the plate's origin, never from a centre of pressure,
which is undefined while the plate is unloaded.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.trial import Array
from osl_analysis.walking.poses import FREE_FALL, BodyMotion, Poses, StaticCalibration

PRESSED_N = 100.0  # vertical force above which a centre of pressure is defined
VERTICAL = np.array([0.0, 0.0, 1.0])


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
    return np.asarray(-2 * np.arctan2(quaternion[:, :3] @ axis, quaternion[:, 3]))


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
    return np.asarray(-np.sum(about_ankle * axis, axis=1))


@dataclass(frozen=True)
class LoadOnFoot:
    """What presses on the foot in n frames: the rows of `Crossing.load`."""

    vertical: Array  # force (n,) [N]
    left: Array  # centre of pressure (n,) [m] from the ankle along its axis; 0 if hardly pressed
    forward: Array  # the same before the ankle


def load_on_foot(reaction: Array, centre: Array, ankle: Ankle) -> LoadOnFoot:
    """Vertical force and centre of pressure, from the reaction (n, 6) about `centre` (n, 3) [m]."""
    vertical = reaction[:, 2]
    pressed = vertical > PRESSED_N
    divisor = np.where(pressed, vertical, 1.0)[:, None]
    pressure = centre + np.cross(VERTICAL, reaction[:, 3:]) / divisor
    from_ankle = pressure - ankle.centre
    return LoadOnFoot(
        vertical,
        left=np.where(pressed, np.sum(from_ankle * ankle.axis, axis=1), 0.0),
        forward=np.where(pressed, np.sum(from_ankle * ankle.forward, axis=1), 0.0),
    )


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
    of_mass = np.cross(foot.point - ankle, mass * (foot.acceleration - FREE_FALL))
    return np.asarray(np.sum(axis * (of_mass + inertia * foot.alpha), axis=1))
