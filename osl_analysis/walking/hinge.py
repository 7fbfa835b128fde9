"""The ankle's functional hinge: axis and centre of the rotation of foot and shank relative to each other."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from osl_analysis.errors import InputError
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import StaticCalibration
from osl_analysis.walking.cluster import Poses, segment_poses
from osl_analysis.walking.settings import CalibrationSettings

LEAST_EXCURSION = np.deg2rad(5.0)
"""Smallest RMS rotation [rad] that determines an axis. Below it marker noise determines the direction."""
FLAT = 0.05
"""Smallest singular value, as a fraction of the largest, of a direction in which the motion determines the centre. In
the other directions the anatomical centre is kept."""


@dataclass(frozen=True)
class Hinge:
    """A functional hinge in the static pose.

    axis: unit vector (3,) to the left.
    centre: a point (3,) [m] of the axis.
    excursion: RMS rotation [rad] about the axis.
    off_axis: RMS rotation [rad] about the two axes across it.
    gap: RMS distance [m] between the centre that moves with the foot and the centre that moves with the shank.
    angle: angle [rad] to the anatomical axis.
    distance: distance [m] of the anatomical centre from the axis.
    frames: number of frames in which both segments were seen.
    """

    axis: Array
    centre: Array
    excursion: float
    off_axis: float
    gap: float
    angle: float
    distance: float
    frames: int


def hinge_of_trials(trials: Sequence[Trial], static: StaticCalibration, settings: CalibrationSettings) -> Hinge:
    """The hinge from all trials together; trials whose markers cannot be read are not used.

    Raises
    ------
    InputError
        No trial can be read, or as `functional_hinge`.
    """
    recordings: list[tuple[Poses, Poses]] = []
    for trial in trials:
        try:
            foot = segment_poses(trial, settings.markers.foot, static.foot, settings)[1]
            shank = segment_poses(trial, settings.markers.shank, static.shank, settings)[1]
        except InputError:
            continue
        recordings.append((foot, shank))
    if not recordings:
        raise InputError("no trial in which foot and shank move; add walking trials, or set hinge to anatomical")
    return functional_hinge(recordings, static)


def functional_hinge(recordings: Sequence[tuple[Poses, Poses]], calibration: StaticCalibration) -> Hinge:
    """The hinge from poses of foot and shank in recordings of a joint that moved; poses may be NaN.

    The axis is the principal direction of the relative rotation vectors, so that the smallest rotation remains across
    it. The centre is the point that has the same path in both segments (Ehrig et al., J. Biomech. 40, 2007). In
    directions in which the motion does not determine the centre, for example along the axis, the anatomical centre is
    used.

    Raises
    ------
    InputError
        The joint turned too little to determine an axis.
    """
    feet, shanks = [], []
    for foot_poses, shank_poses in recordings:
        seen = foot_poses.seen() & shank_poses.seen()
        feet.append(foot_poses[seen])
        shanks.append(shank_poses[seen])
    foot, shank = (np.concatenate([p.rotation for p in poses]) for poses in (feet, shanks))
    if len(foot) < 3:
        raise InputError(
            f"foot and shank are seen together in {len(foot)} frames, expected 3 or more; "
            "fill the gaps in Nexus, or set hinge to anatomical"
        )
    directions, size = principal_rotations(rotation_vectors(foot, shank))
    axis = directions[0] * np.sign(directions[0] @ calibration.ankle_axis)
    centre, gap = common_point(feet, shanks, calibration.ankle_centre)
    aside = np.cross(calibration.ankle_centre - centre, axis)
    return Hinge(
        axis=axis,
        centre=centre,
        excursion=float(size[0]),
        off_axis=float(np.hypot(size[1], size[2])),
        gap=gap,
        angle=float(np.arccos(np.clip(axis @ calibration.ankle_axis, -1, 1))),
        distance=float(np.linalg.norm(aside)),
        frames=len(foot),
    )


def principal_rotations(vectors: Array) -> tuple[Array, Array]:
    """Principal directions (3, 3), as rows, of rotation vectors (n, 3) [rad], and the RMS rotation (3,) about each.

    Raises
    ------
    InputError
        The largest RMS rotation is too small to determine an axis.
    """
    _, size, directions = np.linalg.svd(vectors, full_matrices=False)
    size = size / np.sqrt(len(vectors))
    if size[0] < LEAST_EXCURSION:
        raise InputError(
            f"the ankle turned by {np.rad2deg(size[0]):.1f} deg RMS, expected {np.rad2deg(LEAST_EXCURSION):.0f} deg or "
            "more for a functional axis; record a range-of-motion trial, or set hinge to anatomical"
        )
    return directions, size


def rotation_vectors(foot: Array, shank: Array) -> Array:
    """Rotation vectors (n, 3) [rad] of the foot relative to the shank, from the mean orientation, in static axes."""
    relative = Rotation.from_matrix(np.einsum("nji,njk->nik", shank, foot))
    mean = relative.mean()
    return np.asarray((relative * mean.inv()).as_rotvec())


def common_point(feet: Sequence[Poses], shanks: Sequence[Poses], start: Array) -> tuple[Array, float]:
    """The point (3,) [m] that moves alike with foot and shank, nearest to `start`, and the RMS distance [m] that
    remains."""
    turned = np.concatenate([f.rotation - s.rotation for f, s in zip(feet, shanks, strict=True)])
    apart = np.concatenate([f.point(start) - s.point(start) for f, s in zip(feet, shanks, strict=True)])
    shift = np.linalg.lstsq(turned.reshape(-1, 3), -apart.reshape(-1), rcond=FLAT)[0]
    remaining = apart + turned @ shift
    return start + shift, float(np.sqrt(np.mean(np.sum(remaining**2, axis=1))))


def with_hinge(calibration: StaticCalibration, hinge: Hinge) -> StaticCalibration:
    """The calibration with the functional axis and centre in place of the anatomical ones."""
    return replace(calibration, ankle_axis=hinge.axis, ankle_centre=hinge.centre)


def hinge_row(hinge: Hinge, axis: str) -> dict[str, object]:
    """The row of `hinge.csv`. `axis` names the axis that the analysis uses: `anatomical` or `functional`."""
    return {
        "axis": axis,
        **{f"functional_{name}": float(value) for name, value in zip("xyz", hinge.axis, strict=True)},
        "angle_deg": float(np.rad2deg(hinge.angle)),
        "distance_mm": 1e3 * hinge.distance,
        "excursion_deg": float(np.rad2deg(hinge.excursion)),
        "off_axis_deg": float(np.rad2deg(hinge.off_axis)),
        "gap_mm": 1e3 * hinge.gap,
        "frames": hinge.frames,
    }
