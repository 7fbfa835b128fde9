"""The ankle in the laboratory: static calibration, joint angle, and the moment about the joint's axis."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.kinematics import GRAVITY, BodyMotion
from osl_analysis.walking.rigid_body import Poses, spans_a_plane

Side = Literal["left", "right"]
Vectors = dict[str, Array]


@dataclass(frozen=True)
class StaticCalibration:
    """What the static trial fixes: every frame of reference coincides with the laboratory's there.

    `foot`, `shank`, `platform`: marker positions (3,) [m] by name. `ankle_centre` (3,) [m] and `ankle_axis` (3,), a
    unit vector that points to the subject's left, belong to the foot and to the shank alike.
    """

    foot: Vectors
    shank: Vectors
    platform: Vectors
    ankle_centre: Array
    ankle_axis: Array


@dataclass(frozen=True)
class FootInertia:
    """Mass [kg] of what moves with the foot, its centre of mass (3,) [m] from the ankle centre in the static pose, and
    its inertia [kg*m^2] about the axis through the centre of mass parallel to the ankle's."""

    mass: float
    centre_of_mass: Array
    inertia: float


def calibrate_static(clusters: dict[str, Vectors], medial: Array, lateral: Array, side: Side) -> StaticCalibration:
    """Calibration from a static trial: marker tracks (n, 3) [m] by name, for `foot`, `shank` and `platform`.

    `medial` and `lateral` (n, 3) are the malleoli of the `side` that wears the prosthesis.

    Raises
    ------
    InputError
        A marker was never seen, or a cluster's markers lie on a line.
    """
    means = {
        segment: {name: mean_position(name, track) for name, track in tracks.items()}
        for segment, tracks in clusters.items()
    }
    for segment, markers in means.items():
        if not spans_a_plane(np.array(list(markers.values()))):
            raise InputError(
                f"the {segment} markers {', '.join(markers)} lie on a line or are fewer than three; use others"
            )
    inner, outer = mean_position("medial ankle", medial), mean_position("lateral ankle", lateral)
    across = inner - outer if side == "right" else outer - inner
    return StaticCalibration(
        means["foot"],
        means["shank"],
        means["platform"],
        (inner + outer) / 2,
        across / np.linalg.norm(across),
    )


def mean_position(name: str, track: Array) -> Array:
    """Mean (3,) [m] of a marker's track (n, 3) over the frames in which it was seen."""
    seen = np.isfinite(track).all(axis=1)
    if not seen.any():
        raise InputError(f"marker {name} is never seen in the static trial; label it, or record the trial again")
    return np.asarray(track[seen].mean(axis=0))


def ankle_angle(foot: Poses, shank: Poses, axis: Array) -> Array:
    """Joint angle theta (n,) [rad]: dorsiflexion positive, zero in the static pose.

    The twist about the axis (3,) of the foot's rotation as seen from the shank; +axis points to the left and turns the
    toes down, hence the minus.
    """
    relative = np.einsum("nji,njk->nik", shank.rotation, foot.rotation)
    skew = np.stack(
        [
            relative[:, 2, 1] - relative[:, 1, 2],
            relative[:, 0, 2] - relative[:, 2, 0],
            relative[:, 1, 0] - relative[:, 0, 1],
        ],
        axis=1,
    )
    trace = np.trace(relative, axis1=1, axis2=2)
    # Quaternion of `relative`, up to a common factor: w ~ 1 + trace, vector part ~ skew. Twist = 2 atan2(v.axis, w).
    return np.asarray(-2 * np.arctan2(skew @ axis, 1 + trace))


def ankle_in_lab(foot: Poses, shank: Poses, calibration: StaticCalibration) -> tuple[Array, Array]:
    """Ankle centre (n, 3) [m] and axis (n, 3), each the mean of what the foot's and the shank's poses say."""
    centres = [body.points(calibration.ankle_centre[None])[:, 0] for body in (foot, shank)]
    across = (foot.rotation + shank.rotation) @ calibration.ankle_axis
    return (centres[0] + centres[1]) / 2, across / np.linalg.norm(across, axis=1, keepdims=True)


def ankle_torque(force: Array, moment: Array, plate_centre: Array, ankle: Array, axis: Array) -> Array:
    """Internal plantarflexion moment tau (n,) [N*m] from the ground's wrench on the foot.

    tau = -(M + (c - a) x F) . axis, with force F (n, 3) [N], moment M (n, 3) [N*m] about the plate's centre c (n, 3) or
    (3,) [m], ankle a (n, 3) [m], axis (n, 3) pointing to the left, all in laboratory axes. No centre of pressure
    enters: it is undefined when the plate is unloaded.
    """
    about_ankle = moment + np.cross(plate_centre - ankle, force)
    return np.asarray(-np.sum(about_ankle * axis, axis=1))


def foot_torque(foot: BodyMotion, centre_of_mass: Array, ankle: Array, axis: Array, inertia: FootInertia) -> Array:
    """What `ankle_torque` lacks (n,) [N*m] for the foot's weight and inertia: add it.

    `foot` is the motion of the foot with its centre of mass as the point, `centre_of_mass` (n, 3) [m] that point:
    axis . ((com - a) x m (acceleration - g)) + I alpha . axis, from the balance of moments about the ankle.
    """
    load = inertia.mass * (foot.acceleration - GRAVITY)
    lever = np.cross(centre_of_mass - ankle, load)
    return np.asarray(np.sum(axis * (lever + inertia.inertia * foot.alpha), axis=1))
