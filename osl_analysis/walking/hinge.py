"""The ankle's hinge from motion: the axis about which foot and shank turn against each other, and where it is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.ankle import StaticCalibration
from osl_analysis.walking.rigid_body import Poses

LEAST_EXCURSION = np.deg2rad(5.0)
"""RMS rotation [rad] about an axis below which noise of the markers decides where it points."""
FLAT = 0.05
"""Directions in which the centre shows by less than this part of the best one are left to the anatomical centre."""


@dataclass(frozen=True)
class Hinge:
    """A functional hinge in the static pose: `axis` (3,), a unit vector to the left, through `centre` (3,) [m].

    `excursion` and `off_axis` [rad]: RMS rotation about the axis and across it. `gap` [m]: RMS distance between where
    foot and shank have the centre. `angle` [rad] and `distance` [m]: from the anatomical axis.
    """

    axis: Array
    centre: Array
    excursion: float
    off_axis: float
    gap: float
    angle: float
    distance: float
    frames: int


def functional_hinge(recordings: Sequence[tuple[Poses, Poses]], calibration: StaticCalibration) -> Hinge:
    """The hinge of a joint that moved: poses of foot and shank, which may be NaN, per recording.

    The axis is the direction of largest scatter of the relative rotations' vectors, which leaves the least across it;
    the centre is the point that both bodies carry along the same path (Ehrig et al., J. Biomech. 40, 2007), found in
    the directions that the motion shows, and the anatomical one elsewhere (along the axis it is arbitrary).

    Raises
    ------
    InputError
        The joint turned too little for an axis to show.
    """
    feet, shanks = [], []
    for foot_poses, shank_poses in recordings:
        seen = foot_poses.seen() & shank_poses.seen()
        feet.append(foot_poses[seen])
        shanks.append(shank_poses[seen])
    foot, shank = (np.concatenate([p.rotation for p in poses]) for poses in (feet, shanks))
    if len(foot) < 3:
        raise InputError(f"foot and shank are seen together in {len(foot)} frames; a hinge needs a recorded motion")
    vectors = rotation_vectors(foot, shank)
    _, size, directions = np.linalg.svd(vectors, full_matrices=False)
    size = size / np.sqrt(len(vectors))
    if size[0] < LEAST_EXCURSION:
        raise InputError(
            f"the ankle turned by {np.rad2deg(size[0]):.1f} deg RMS, expected {np.rad2deg(LEAST_EXCURSION):.0f} deg or "
            "more for a functional axis; record a range-of-motion trial, or set hinge to anatomical"
        )
    axis = directions[0] * np.sign(directions[0] @ calibration.ankle_axis)
    centre, gap = common_point(feet, shanks, calibration.ankle_centre)
    aside = np.cross(calibration.ankle_centre - centre, axis)
    angle = float(np.arccos(np.clip(axis @ calibration.ankle_axis, -1, 1)))
    off_axis = float(np.hypot(size[1], size[2]))
    return Hinge(axis, centre, float(size[0]), off_axis, gap, angle, float(np.linalg.norm(aside)), len(vectors))


def rotation_vectors(foot: Array, shank: Array) -> Array:
    """Vectors (n, 3) [rad] by which the foot is turned against the shank from its mean attitude, in static axes."""
    relative = Rotation.from_matrix(np.einsum("nji,njk->nik", shank, foot))
    mean = relative.mean()
    return np.asarray((relative * mean.inv()).as_rotvec())


def common_point(feet: Sequence[Poses], shanks: Sequence[Poses], start: Array) -> tuple[Array, float]:
    """The point (3,) [m] of the static pose that foot and shank carry alike, nearest to `start`; RMS distance [m]."""
    turned = np.concatenate([f.rotation - s.rotation for f, s in zip(feet, shanks, strict=True)])
    paths = [(f.points(start[None]) - s.points(start[None]))[:, 0] for f, s in zip(feet, shanks, strict=True)]
    apart = np.concatenate(paths)
    shift = np.linalg.lstsq(turned.reshape(-1, 3), -apart.reshape(-1), rcond=FLAT)[0]
    left = apart + turned @ shift
    return start + shift, float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


def hinged(calibration: StaticCalibration, hinge: Hinge) -> StaticCalibration:
    """The calibration with the functional axis and centre in place of the anatomical ones."""
    return replace(calibration, ankle_axis=hinge.axis, ankle_centre=hinge.centre)
