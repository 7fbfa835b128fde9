# SPDX-License-Identifier: Apache-2.0
"""Step 1, poses: from marker clusters to rigid bodies, and their motion.

The static trial fixes a reference position of every marker. In each frame of another trial a
segment's markers are at

    x = R (x_ref - origin) + position,

with the rotation R and the position of the cluster's centroid that fit best (Kabsch, Acta Cryst.
A32, 1976). In the static pose every segment's axes are the laboratory's (z up).

Example: `cluster_poses(reference, observed).position`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainSerializer, PlainValidator

from osl_analysis.base.errors import InputError, nearest
from osl_analysis.base.trial import Array, Trial, marker_columns
from osl_analysis.signals.filters import sampling_rate, spline_derivatives
from osl_analysis.walking.walking_settings import CalibrationSettings, MarkerSettings

Mask = NDArray[np.bool_]
StoredArray = Annotated[
    Array,
    PlainValidator(lambda values: np.array(values, dtype=float)),
    PlainSerializer(lambda values: values.tolist(), when_used="json"),
]
"""An array in a result that is stored in a file: a list in JSON, where NaN is null."""

# acceleration [m/s^2] in laboratory axes, z up; to import scipy.constants takes 0.1 s
FREE_FALL = np.array([0.0, 0.0, -9.80665])
SMALLEST_WIDTH = 0.1  # of a cluster across its longest line, as a share of that line's length
SIZES_M = (0.03, 5.0)  # of a plate, and between the clusters of foot and shank

SIDE_FRAMES = 4  # on either side of a gap, through which it is bridged


@dataclass(frozen=True)
class Poses:
    """Poses of one cluster in n frames; NaN where it was not seen."""

    rotation: Array  # R (n, 3, 3)
    position: Array  # of the cluster's centroid (n, 3) [m]
    # The centroid (3,) [m] in the static pose. An error of R does not move it, but distant points.
    origin: Array
    residual: Array  # RMS distance (n,) [m] between the markers and the rigid body
    bridged: Mask  # frames (n,) that were interpolated

    def __getitem__(self, rows: slice | Mask) -> "Poses":
        return replace(
            self,
            rotation=self.rotation[rows],
            position=self.position[rows],
            residual=self.residual[rows],
            bridged=self.bridged[rows],
        )

    def points(self, reference: Array) -> Array:
        """Positions (n, m, 3) [m], in each frame, of points at `reference` (m, 3) [m]."""
        R_transposed = np.swapaxes(self.rotation, 1, 2)
        return (reference - self.origin) @ R_transposed + self.position[:, None]

    def point(self, reference: Array) -> Array:
        """Positions (n, 3) [m], in each frame, of the point at `reference` (3,) [m]."""
        return self.points(reference[None])[:, 0]

    def seen(self) -> Mask:
        """Frames (n,) that have a pose."""
        return np.asarray(np.isfinite(self.position).all(axis=1))


@dataclass(frozen=True)
class StaticCalibration:
    """Result of the static trial, in laboratory axes."""

    markers: dict[str, StoredArray]  # position (3,) [m] of each marker of the clusters, by name
    ankle_centre: StoredArray  # point (3,) [m] that belongs to the foot and to the shank
    ankle_axis: StoredArray  # unit vector (3,) to the subject's left, the same for foot and shank
    # Of each plate, by its number (4, 3) [m]
    corners: dict[int, StoredArray]

    def positions(self, names: Sequence[str]) -> Array:
        """Positions (m, 3) [m] of the named markers."""
        return np.array([self.markers[name] for name in names])


def static_calibration(trial: Trial, settings: CalibrationSettings) -> StaticCalibration:
    """Find the reference positions of all clusters, and the ankle between the malleoli.

    Raises
    ------
    InputError
        A marker is never seen, a cluster lies on a line, or foot and shank are exchanged.
    """
    markers = settings.markers
    clusters = {}
    for segment, names in markers.clusters.items():
        clusters[segment] = mean_positions(trial, names)
        places = np.array(list(clusters[segment].values()))
        if not cluster_poses(places, places[None]).seen().all():
            raise InputError(
                f"the {segment} markers {', '.join(names)} lie on a line or"
                " are fewer than three, expected three or more that span a plane",
                "name others under `markers` in the configuration",
            )

    foot, shank = clusters["foot"], clusters["shank"]
    centres = [np.mean(list(cluster.values()), axis=0) for cluster in (foot, shank)]
    distance_m = np.linalg.norm(centres[1] - centres[0])
    if not SIZES_M[0] < distance_m < SIZES_M[1]:
        raise InputError(
            f"the markers of foot and shank are {distance_m:.2g} m apart,"
            f" expected {SIZES_M[0]:g} to {SIZES_M[1]:g} m",
            "state the unit of the points as `point_unit` in the source file",
        )
    above = centres[0][2] - centres[1][2]
    if above > 0:
        raise InputError(
            f"the foot markers {', '.join(foot)} stand {100 * above:.0f} cm"
            f" above the shank markers {', '.join(shank)}: exchange them under `markers` or in"
            " Nexus",
            "or z does not point up, then state `axes` in the source file",
        )

    malleoli = mean_positions(trial, (markers.ankle_medial, markers.ankle_lateral))
    medial, lateral = malleoli.values()
    to_left = medial - lateral if settings.side == "right" else lateral - medial
    return StaticCalibration(
        markers={**foot, **shank, **clusters["platform"]},
        ankle_centre=(medial + lateral) / 2,
        ankle_axis=to_left / np.linalg.norm(to_left),
        corners={
            facts["plate"]: np.array(facts["corners"])
            for facts in trial.provenance.get("plates", [])
            if facts.get("corners")
        },
    )


def mean_positions(trial: Trial, names: Sequence[str]) -> dict[str, Array]:
    """Mean position (3,) [m] of each marker in the frames in which it was seen."""
    _, tracks = marker_tracks(trial, names)
    means = {}
    for name, track in zip(names, np.moveaxis(tracks, 1, 0), strict=True):
        seen = np.isfinite(track).all(axis=1)
        if not seen.any():
            raise InputError(
                f"marker {name} is never seen in the static trial",
                "label it, or record the trial again",
            )
        means[name] = track[seen].mean(axis=0)
    return means


def marker_tracks(trial: Trial, names: Sequence[str]) -> tuple[Array, Array]:
    """Time (n,) [s] of the marker frames, and positions (n, m, 3) [m], NaN where occluded."""
    for name in names:
        if marker_columns(name)[0] in trial.columns:
            continue
        labels = [
            column.removeprefix("marker_").removesuffix("_x")
            for column in trial.columns
            if column.endswith("_x")
        ]
        raise InputError(
            f"no marker '{name}'",
            f"correct `walking.markers` in the configuration, or its label{nearest(name, labels)}",
        )

    columns = [column for name in names for column in marker_columns(name)]
    time, *positions = trial.arrays(*columns)
    if not time.size:
        raise InputError(
            f"markers {', '.join(names)} have no frames",
            "record the trial again",
        )
    return time, np.stack(positions, axis=1).reshape(-1, len(names), 3)


def segment_poses(
    trial: Trial, names: Sequence[str], calibration: StaticCalibration, settings: MarkerSettings
) -> tuple[Array, Poses]:
    """Find the poses of one cluster, not low-passed.

    Short gaps are interpolated, long ones stay NaN.

    Returns
    -------
    tuple of Array and Poses
        Time (n,) [s] of the marker frames, and the poses.
    """
    time, tracks = marker_tracks(trial, names)
    reference = calibration.positions(names)
    poses = cluster_poses(reference, without_held(tracks), settings.largest_residual_mm * 1e-3)
    return time, bridge_gaps(time, reference, poses, settings.longest_gap_s)


def without_held(tracks: Array) -> Array:
    """Tracks (n, m, 3) of a cluster, NaN where a marker repeats its place while another one moves:
    some programs repeat the last place until an occluded marker returns."""
    seen = tracks.copy()
    steps = np.abs(np.diff(tracks, axis=0)).sum(axis=2)
    cluster_moves = (steps > 0).any(axis=1)
    repeats = (steps == 0) & cluster_moves[:, None]
    held = repeats[1:] & repeats[:-1]  # noise repeats a place of three coordinates once at most
    seen[1:-1][held] = np.nan
    seen[2:][held] = np.nan
    return seen


def cluster_poses(reference: Array, observed: Array, largest_residual: float = np.inf) -> Poses:
    """Fit the rigid pose of a cluster in each frame by least squares.

    Parameters
    ----------
    reference : Array
        Positions (m, 3) [m] in the static trial.
    observed : Array
        Positions (n, m, 3) [m], NaN where occluded.
    largest_residual : float
        RMS distance [m] above which a frame has no pose, as with swapped markers.

    Returns
    -------
    Poses
        NaN where fewer than three markers that span a plane were seen.

    References
    ----------
    Kabsch, Acta Cryst. A32 (1976) 922.
    """
    # occluded markers are zero, so that they have no weight
    seen = np.isfinite(observed).all(axis=2, keepdims=True)
    count = np.maximum(seen.sum(axis=1), 1)
    markers = np.where(seen, observed, 0.0)
    reference_centroid = np.sum(seen * reference, axis=1) / count
    centroid = markers.sum(axis=1) / count
    local = seen * (reference - reference_centroid[:, None])
    centred = seen * (markers - centroid[:, None])

    U, squares, Vt = np.linalg.svd(np.swapaxes(local, 1, 2) @ centred)
    U[:, :, 2] *= (np.linalg.det(U) * np.linalg.det(Vt))[:, None]  # no reflection
    rotation = np.swapaxes(U @ Vt, 1, 2)
    origin = reference.mean(axis=0)
    position = centroid + np.einsum("nij,nj->ni", rotation, origin - reference_centroid)

    lack_of_fit = local @ (U @ Vt) - centred
    residual = np.linalg.norm(lack_of_fit, axis=(1, 2)) / np.sqrt(count[:, 0])
    spans_a_plane = squares[:, 1] > SMALLEST_WIDTH**2 * squares[:, 0]
    wrong = ~spans_a_plane | (residual > largest_residual)
    for values in (rotation, position, residual):
        values[wrong] = np.nan
    return Poses(rotation, position, origin, residual, np.zeros(len(observed), dtype=bool))


def moved_marker(reference: Array, tracks: Array, poses: Poses) -> tuple[int, float]:
    """Find the marker that moved most in its cluster since the static trial, and how far [m].

    With four markers or more, the moved one is that without which the others agree best. The others
    then say where it should be.

    Parameters
    ----------
    reference : Array
        Positions (m, 3) [m] in the static trial.
    tracks : Array
        Positions (n, m, 3) [m], NaN where occluded.
    poses : Poses
        Poses of the cluster in the same n frames.
    """
    in_cluster = np.einsum("nji,nmj->nmi", poses.rotation, tracks - poses.position[:, None])
    form = np.full_like(reference, np.nan)
    seen = np.isfinite(in_cluster).all(axis=2).any(axis=0)
    form[seen] = np.nanmean(in_cluster[:, seen], axis=0) + poses.origin
    moved = int(np.nanargmax(np.linalg.norm(form - reference, axis=1)))
    expected = reference[moved]
    least_residual = np.inf
    for marker in np.flatnonzero(seen):
        is_other = np.arange(len(reference)) != marker
        poses_by_others = cluster_poses(reference[is_other], form[None, is_other])
        if poses_by_others.residual[0] < least_residual:  # NaN of fewer than three others
            least_residual = poses_by_others.residual[0]
            moved = int(marker)
            expected = poses_by_others.point(reference[marker])[0]
    return moved, float(np.linalg.norm(form[moved] - expected))


def bridge_gaps(time: Array, reference: Array, poses: Poses, longest: float) -> Poses:
    """Interpolate gaps of up to `longest` [s]: the paths of the markers, at `reference` (m, 3) [m],
    by cubics through the frames on either side.

    Over 60 to 190 ms the cubic leaves a motion of stance by 0.1 to 3 deg, a spline by 1 to 10 deg.
    """
    seen = np.flatnonzero(poses.seen())
    step = 1 / sampling_rate(time)
    occluded_s = (np.diff(seen) - 1) * step
    paths = poses.points(reference).reshape(len(time), -1)
    bridged = poses.bridged.copy()
    for k in np.flatnonzero((occluded_s > 0) & (occluded_s < longest + step / 2)):
        gap = slice(seen[k] + 1, seen[k + 1])
        sides = seen[max(k + 1 - SIDE_FRAMES, 0) : k + 1 + SIDE_FRAMES]
        middle = time[sides].mean()
        cubic = np.polynomial.polynomial.polyfit(time[sides] - middle, paths[sides], 3)
        paths[gap] = np.polynomial.polynomial.polyval(time[gap] - middle, cubic).T
        bridged[gap] = True

    if not bridged.any():
        return poses
    filled = cluster_poses(reference, paths.reshape(-1, *reference.shape))
    return replace(filled, residual=poses.residual, bridged=bridged)


def gap_duration(time: Array, gap: slice) -> float:
    """Duration [s] of occluded frames, for comparison with the longest gap that is allowed."""
    # half a frame less, so that a gap of exactly the limit is not refused by rounding
    return float((gap.stop - gap.start - 0.5) * (time[1] - time[0]))


@dataclass(frozen=True)
class BodyMotion:
    """Motion of a body and of one of its points in laboratory axes, n frames."""

    rotation: Array  # (n, 3, 3)
    omega: Array  # angular velocity (n, 3) [rad/s]
    alpha: Array  # angular acceleration (n, 3) [rad/s^2]
    point: Array  # position (n, 3) [m] of the point
    acceleration: Array  # of the point (n, 3) [m/s^2]

    def weighted(self, weights: Array) -> "BodyMotion":
        """Multiply angular velocity and accelerations by weights (n,), 0 where the body rests."""
        w = weights[:, None]
        return replace(
            self, omega=w * self.omega, alpha=w * self.alpha, acceleration=w * self.acceleration
        )


def body_motion(time: Array, poses: Poses, point: Array) -> BodyMotion:
    """Differentiate low-passed poses of a body, and the path of its point at `point` (3,) [m].

    The angular velocity w is read from the antisymmetric matrix R' R^T, whose product with a
    vector v is w x v.
    """
    rotation_rate, _ = spline_derivatives(time, poses.rotation)
    spin = rotation_rate @ np.swapaxes(poses.rotation, 1, 2)
    omega = 0.5 * np.stack(
        [spin[:, k - 1, k - 2] - spin[:, k - 2, k - 1] for k in range(3)], axis=1
    )
    alpha, _ = spline_derivatives(time, omega)
    path = poses.point(point)
    _, acceleration = spline_derivatives(time, path)
    return BodyMotion(
        rotation=poses.rotation,
        omega=omega,
        alpha=alpha,
        point=path,
        acceleration=acceleration,
    )


def cross_matrix(v: Array) -> Array:
    """Matrices (n, 3, 3) whose product with a vector is the cross product of v (n, 3) with it."""
    return np.cross(np.eye(3), v[:, None])
