"""Rigid clusters of markers: pose per frame, short gaps bridged and flagged, nothing extrapolated."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp

from osl_analysis.signals import LowPass
from osl_analysis.trial import Array

Mask = NDArray[np.bool_]

COLLINEAR = 0.1
"""Markers lie on a line where their spread across it is below this fraction of their spread along it."""


@dataclass(frozen=True)
class Poses:
    """Pose of a cluster in n frames: a point that was at x_ref [m] is now at R (x_ref - origin) + position.

    `rotation` (n, 3, 3), `position` (n, 3) [m] of the cluster's centroid `origin` (3,) [m]; NaN where the cluster
    was not seen. `residual` (n,) [m] is the RMS distance between markers and pose, `bridged` (n,) marks frames that
    were interpolated. Referring to the centroid keeps an error of the rotation from moving a distant origin.
    """

    rotation: Array
    position: Array
    origin: Array
    residual: Array
    bridged: Mask

    def __getitem__(self, rows: slice | Mask) -> "Poses":
        return Poses(self.rotation[rows], self.position[rows], self.origin, self.residual[rows], self.bridged[rows])

    def points(self, reference: Array) -> Array:
        """Where reference points (m, 3) [m] are in each frame: (n, m, 3)."""
        turned = np.einsum("nij,mj->nmi", self.rotation, reference - self.origin)
        return np.asarray(turned + self.position[:, None])

    def seen(self) -> Mask:
        """Frames (n,) that have a pose."""
        return np.asarray(np.isfinite(self.position).all(axis=1))


def cluster_poses(reference: Array, observed: Array, largest_residual: float = np.inf) -> Poses:
    """Pose of markers (n, m, 3) [m] against their reference positions (m, 3), by least squares.

    A frame uses the markers that it has, if three or more are left and they do not lie on a line; else it is NaN, as it
    is where the residual exceeds `largest_residual` [m] (swapped or knocked markers).
    """
    n = len(observed)
    poses = Poses(
        np.full((n, 3, 3), np.nan),
        np.full((n, 3), np.nan),
        reference.mean(axis=0),
        np.full(n, np.nan),
        np.zeros(n, dtype=bool),
    )
    patterns, member = np.unique(np.isfinite(observed).all(axis=2), axis=0, return_inverse=True)
    for index, pattern in enumerate(patterns):
        if spans_a_plane(reference[pattern]):
            rows = np.flatnonzero(member == index)
            fit_rows(poses, rows, reference[pattern], observed[rows][:, pattern])
    wrong = poses.residual > largest_residual
    poses.rotation[wrong], poses.position[wrong] = np.nan, np.nan
    return poses


def spans_a_plane(points: Array) -> bool:
    """Whether points (m, 3) are three or more and not on a line."""
    if len(points) < 3:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > COLLINEAR * spread[0])


def fit_rows(poses: Poses, rows: NDArray[np.intp], reference: Array, observed: Array) -> None:
    """Fill `rows` of freshly made poses from markers (k, m, 3) (Kabsch, Acta Cryst. A32, 1976)."""
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
    """Interpolate interior gaps of up to `longest` [s] between the stamps time (n,) [s], and flag them.

    Rotations by slerp between the gap's neighbours, positions by a cubic spline through the frames that were seen. The
    ends and longer gaps stay NaN.
    """
    seen, step = np.flatnonzero(poses.seen()), time[1] - time[0]
    gaps = [(before, after) for before, after in pairwise(seen) if 0 < (after - before - 1) * step < longest + step / 2]
    if not gaps or len(seen) < 4:
        return poses
    gap = np.concatenate([np.arange(before + 1, after) for before, after in gaps])
    rotation, position, bridged = poses.rotation.copy(), poses.position.copy(), poses.bridged.copy()
    rotation[gap] = Slerp(time[seen], Rotation.from_matrix(poses.rotation[seen]))(time[gap]).as_matrix()
    position[gap] = CubicSpline(time[seen], poses.position[seen])(time[gap])
    bridged[gap] = True
    return replace(poses, rotation=rotation, position=position, bridged=bridged)


def smoothed(poses: Poses, reference: Array, low_pass: LowPass, rate: float) -> Poses:
    """The poses (n,) of the cluster's markers after each coordinate passed the low-pass; no frame may be NaN.

    Filtering positions, not angles, is what makes it *the same linear filter* as the wrench's.
    """
    filtered = cluster_poses(reference, low_pass(poses.points(reference), rate))
    return replace(filtered, residual=poses.residual, bridged=poses.bridged)
