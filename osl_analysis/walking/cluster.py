"""Marker clusters: rigid-body pose in each frame, short gaps bridged and flagged, and the body's motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from osl_analysis.columns import marker_columns
from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass, differentiate
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.settings import MarkerSettings

Mask = NDArray[np.bool_]

COLLINEAR = 0.1
"""Markers lie on a line if their spread across it is below this fraction of their spread along it."""
BESIDE_S, FEWEST_BESIDE = 0.015, 4
"""Time [s] before and after a gap whose frames bridge it, and their smallest number on each side."""
GRAVITY = np.array([0.0, 0.0, -9.80665])
"""Acceleration of free fall [m/s^2] in laboratory axes, z up."""


@dataclass(frozen=True)
class Poses:
    """Pose of a cluster in n frames: a point that was at x_ref [m] is now at R (x_ref - origin) + position.

    rotation: R (n, 3, 3); NaN where the cluster was not seen.
    position: position (n, 3) [m] of the cluster's centroid; NaN where the cluster was not seen.
    origin: centroid (3,) [m] in the reference pose. An error of R does not move it, but moves distant points.
    residual: RMS distance (n,) [m] between the markers and the rigid body.
    bridged: frames (n,) that were interpolated.
    """

    rotation: Array
    position: Array
    origin: Array
    residual: Array
    bridged: Mask

    def __getitem__(self, rows: slice | Mask) -> "Poses":
        return Poses(self.rotation[rows], self.position[rows], self.origin, self.residual[rows], self.bridged[rows])

    def points(self, reference: Array) -> Array:
        """Positions (n, m, 3) [m], in each frame, of reference points (m, 3) [m]."""
        turned = np.einsum("nij,mj->nmi", self.rotation, reference - self.origin)
        return np.asarray(turned + self.position[:, None])

    def point(self, reference: Array) -> Array:
        """Positions (n, 3) [m], in each frame, of one reference point (3,) [m]."""
        return np.asarray(self.points(reference[None])[:, 0])

    def seen(self) -> Mask:
        """Frames (n,) that have a pose."""
        return np.asarray(np.isfinite(self.position).all(axis=1))


def marker_tracks(trial: Trial, names: Sequence[str]) -> tuple[Array, Array]:
    """Time (n,) [s] of the marker frames and positions (n, m, 3) [m], NaN where a marker was hidden."""
    columns = [column for name in names for column in marker_columns(name)]
    rows = trial.sampled(*columns)
    if rows.is_empty():
        raise InputError(f"trial {trial.name}: markers {', '.join(names)} have no frames; record the trial again")
    return rows["time"].to_numpy(), rows.select(columns).to_numpy().reshape(-1, len(names), 3)


def reference_positions(cluster: Mapping[str, Array], names: Sequence[str], trial: str) -> Array:
    """Positions (m, 3) [m] of the named markers in the static trial; `trial` is for messages."""
    absent = [name for name in names if name not in cluster]
    if absent:
        raise InputError(
            f"trial {trial}: marker {absent[0]} is not in the static calibration, which has {', '.join(cluster)}; "
            "calibrate with the static trial again"
        )
    return np.array([cluster[name] for name in names])


def segment_poses(
    trial: Trial, names: Sequence[str], cluster: Mapping[str, Array], settings: MarkerSettings
) -> tuple[Array, Poses]:
    """Time (n,) [s] and poses of one cluster, not filtered: short gaps are interpolated, long ones NaN."""
    time, observed = marker_tracks(trial, names)
    reference = reference_positions(cluster, names, trial.name)
    poses = cluster_poses(reference, observed, settings.largest_residual_mm * 1e-3)
    return time, bridge_gaps(time, poses, settings.longest_gap_s)


def cluster_poses(reference: Array, observed: Array, largest_residual: float = np.inf) -> Poses:
    """Least-squares pose of markers (n, m, 3) [m] against their reference positions (m, 3) [m].

    A frame uses the markers that were seen, if there are at least three and they do not lie on a line. Otherwise it is
    NaN. It is also NaN where the residual exceeds `largest_residual` [m], as with swapped or displaced markers.
    """
    n = len(observed)
    poses = Poses(
        np.full((n, 3, 3), np.nan),
        np.full((n, 3), np.nan),
        reference.mean(axis=0),
        np.full(n, np.nan),
        np.zeros(n, dtype=bool),
    )
    seen = np.isfinite(observed).all(axis=2)
    if seen.all():
        patterns, member = np.ones((1, len(reference)), dtype=bool), np.zeros(n, dtype=int)
    else:
        patterns, member = np.unique(seen, axis=0, return_inverse=True)
    for index, pattern in enumerate(patterns):
        if spans_a_plane(reference[pattern]):
            rows = np.flatnonzero(member == index)
            fit_rows(poses, rows, reference[pattern], observed[rows][:, pattern])
    wrong = poses.residual > largest_residual
    poses.rotation[wrong], poses.position[wrong] = np.nan, np.nan
    return poses


def spans_a_plane(points: Array) -> bool:
    """Whether points (m, 3) are three or more and do not lie on a line."""
    if len(points) < 3:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > COLLINEAR * spread[0])


def fit_rows(poses: Poses, rows: NDArray[np.intp], reference: Array, observed: Array) -> None:
    """Write the poses of markers (k, m, 3) [m] into `rows` of new poses (Kabsch, Acta Cryst. A32, 1976)."""
    local, centroid = reference - reference.mean(axis=0), observed.mean(axis=1)
    centred = observed - centroid[:, None]
    U, _, Vt = np.linalg.svd(np.einsum("mi,kmj->kij", local, centred))
    mirror = np.linalg.det(U) * np.linalg.det(Vt)
    U[:, :, 2] *= mirror[:, None]
    R = np.einsum("kij,kjl->kli", U, Vt)
    misfit = np.einsum("kij,mj->kmi", R, local) - centred
    poses.rotation[rows] = R
    poses.position[rows] = centroid + R @ (poses.origin - reference.mean(axis=0))
    poses.residual[rows] = np.sqrt(np.mean(np.sum(misfit**2, axis=2), axis=1))


def bridge_gaps(time: Array, poses: Poses, longest: float) -> Poses:
    """Interpolate gaps of up to `longest` [s] between frames that were seen, at stamps time (n,) [s], and flag them.

    By the cubic of least squares through the frames of `BESIDE_S` on either side. A spline through all frames has the
    slope of two noisy ones, and leaves a motion of stance by 1 to 10 deg over gaps of 60 to 190 ms; this cubic by 0.1
    to 3 deg. The ends of the recording and longer gaps stay NaN.

    Raises
    ------
    InputError
        A stamp is not later than the one before.
    """
    if len(time) < 2:
        return poses
    steps = np.diff(time)
    if not (steps > 0).all():
        row = int(np.argmin(steps > 0))
        raise InputError(
            f"frame {row + 1} is stamped {time[row + 1]:.6f} s, not later than the one before; record again, or cut "
            "the capture there"
        )
    seen, step = np.flatnonzero(poses.seen()), float(steps[0])
    hidden = (np.diff(seen) - 1) * step
    ends = np.flatnonzero((hidden > 0) & (hidden < longest + step / 2))
    if not len(ends) or len(seen) < 4:
        return poses
    rotation, position, bridged = poses.rotation.copy(), poses.position.copy(), poses.bridged.copy()
    count = max(round(BESIDE_S / step), FEWEST_BESIDE)
    for k in ends:
        gap, beside = np.arange(seen[k] + 1, seen[k + 1]), seen[max(k + 1 - count, 0) : k + 1 + count]
        origin = Rotation.from_matrix(poses.rotation[seen[k]])
        turned = (Rotation.from_matrix(poses.rotation[beside]) * origin.inv()).as_rotvec()
        found = cubic(time[beside], np.hstack([turned, poses.position[beside]]), time[gap])
        rotation[gap] = (Rotation.from_rotvec(found[:, :3]) * origin).as_matrix()
        position[gap] = found[:, 3:]
        bridged[gap] = True
    return replace(poses, rotation=rotation, position=position, bridged=bridged)


def cubic(time: Array, values: Array, at: Array) -> Array:
    """Values (k, m) at other times (k,) [s] of the cubic of least squares through values (n, m) at times (n,) [s]."""
    span = np.ptp(time) / 2
    design, wanted = (np.vander((t - time.mean()) / span, 4) for t in (time, at))
    return np.asarray(wanted @ np.linalg.lstsq(design, values)[0])


def gap_duration(time: Array, gap: slice) -> float:
    """Duration [s] of consecutive hidden frames, for comparison with the longest gap that is allowed."""
    return float((gap.stop - gap.start - 0.5) * (time[1] - time[0]))


def filtered_poses(poses: Poses, reference: Array, low_pass: LowPass, rate: float) -> Poses:
    """Poses (n,) from the marker positions after each coordinate passed the low-pass; no frame may be NaN.

    Positions are filtered instead of angles: their filter is linear and the same as the wrench's.
    """
    filtered = cluster_poses(reference, low_pass(poses.points(reference), rate))
    return replace(filtered, residual=poses.residual, bridged=poses.bridged)


@dataclass(frozen=True)
class BodyMotion:
    """Motion of a body and of one of its points in laboratory axes, n frames.

    rotation: (n, 3, 3).
    omega: angular velocity (n, 3) [rad/s].
    alpha: angular acceleration (n, 3) [rad/s^2].
    point: position (n, 3) [m] of the point.
    acceleration: acceleration (n, 3) [m/s^2] of the point.
    """

    rotation: Array
    omega: Array
    alpha: Array
    point: Array
    acceleration: Array

    def __getitem__(self, rows: slice) -> "BodyMotion":
        parts = (self.rotation, self.omega, self.alpha, self.point, self.acceleration)
        return BodyMotion(*(part[rows] for part in parts))

    def weighted(self, weights: Array) -> "BodyMotion":
        """The same poses with angular velocity and accelerations times weights (n,): 0 where the body rests."""
        w = weights[:, None]
        return replace(self, omega=w * self.omega, alpha=w * self.alpha, acceleration=w * self.acceleration)


def body_motion(time: Array, poses: Poses, point: Array) -> BodyMotion:
    """Motion at times (n,) [s] of a body and of its point with the reference position `point` (3,) [m].

    Angular velocity is the axial vector of (dR/dt) R^T. Poses must be low-passed and without NaN.
    """
    turning = differentiate(time, poses.rotation.reshape(-1, 9)).omega.reshape(-1, 3, 3)
    spin = np.einsum("nij,nkj->nik", turning, poses.rotation)
    omega = 0.5 * axial_vector(spin)
    path = differentiate(time, poses.point(point))
    return BodyMotion(poses.rotation, omega, differentiate(time, omega).omega, path.theta, path.alpha)


def axial_vector(matrices: Array) -> Array:
    """Vectors (n, 3) of the antisymmetric part of matrices (n, 3, 3), times two."""
    return np.stack(
        [
            matrices[:, 2, 1] - matrices[:, 1, 2],
            matrices[:, 0, 2] - matrices[:, 2, 0],
            matrices[:, 1, 0] - matrices[:, 0, 1],
        ],
        axis=1,
    )
