"""Rigid bodies from marker clusters, and the ankle between foot and shank."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import lgamma
from typing import Annotated

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import PlainSerializer, PlainValidator

from osl_analysis.errors import InputError, nearest
from osl_analysis.signals import differentiate
from osl_analysis.trial import Array, Trial, marker_columns
from osl_analysis.walking.settings import CalibrationSettings, MarkerSettings

Mask = NDArray[np.bool_]
Kept = Annotated[
    Array,
    PlainValidator(lambda values: np.array(values, dtype=float)),
    PlainSerializer(lambda values: values.tolist(), when_used="json"),
]
"""An array in what a file keeps: a list in JSON, where NaN is null."""
SEGMENTS = ("foot", "shank", "platform")
# Acceleration of free fall [m/s^2] in laboratory axes, z up
FREE_FALL = np.array([0.0, 0.0, -9.80665])


@dataclass(frozen=True)
class Poses:
    """Pose of a cluster in n frames: a point that was at x_ref [m] is now at R (x_ref - origin) +
    position."""

    rotation: Array  # R (n, 3, 3); as the position, NaN where the cluster was not seen
    position: Array  # (n, 3) [m] of the cluster's centroid
    # centroid (3,) [m] in the reference pose. An error of R does not move it, but moves distant
    # points.
    origin: Array
    residual: Array  # RMS distance (n,) [m] between the markers and the rigid body
    bridged: Mask  # frames (n,) that were interpolated
    # frames (n,) of which some marker was filled before the export; None if none tells
    filled: Mask | None = None

    def __getitem__(self, rows: slice | Mask) -> "Poses":
        filled, bridged = None if self.filled is None else self.filled[rows], self.bridged[rows]
        return Poses(
            self.rotation[rows],
            self.position[rows],
            self.origin,
            self.residual[rows],
            bridged,
            filled,
        )

    def by_filling(self, rows: slice | NDArray[np.intp]) -> str:
        """Words for a message, empty unless markers were filled in some of the rows."""
        filled = self.filled is not None and bool(self.filled[rows].any())
        return ", where they were filled before the export and so not measured" if filled else ""

    def points(self, reference: Array) -> Array:
        """Positions (n, m, 3) [m], in each frame, of reference points (m, 3) [m]."""
        return np.asarray(
            (reference - self.origin) @ np.swapaxes(self.rotation, 1, 2) + self.position[:, None]
        )

    def point(self, reference: Array) -> Array:
        """Positions (n, 3) [m], in each frame, of one reference point (3,) [m]."""
        return np.asarray(self.points(reference[None])[:, 0])

    def seen(self) -> Mask:
        """Frames (n,) that have a pose."""
        return np.asarray(np.isfinite(self.position).all(axis=1))


def marker_tracks(trial: Trial, names: Sequence[str]) -> tuple[Array, Array]:
    """Time (n,) [s] of the marker frames and positions (n, m, 3) [m], NaN where a marker was
    hidden."""
    columns = [column for name in names for column in marker_columns(name)]
    for name in (one for one in names if marker_columns(one)[0] not in trial.columns):
        said = (
            f"trial {trial.name}: no marker '{name}'; correct `walking.markers` in the"
            " configuration, or its label"
        )
        labels = [
            one.removeprefix("marker_").removesuffix("_x")
            for one in trial.columns
            if one.endswith("_x")
        ]
        raise InputError(said + nearest(name, labels))
    rows = trial.sampled(*columns)
    if rows.is_empty():
        raise InputError(
            f"trial {trial.name}: markers {', '.join(names)} have no frames; record the trial again"
        )
    return rows["time"].to_numpy(), rows.select(columns).to_numpy().reshape(-1, len(names), 3)


@dataclass(frozen=True)
class StaticCalibration:
    """Result of the static trial, in laboratory axes. In the static pose every segment's axes are
    the laboratory's."""

    markers: dict[str, Kept]  # positions (3,) [m] of the clusters' markers by name
    ankle_centre: Kept  # point (3,) [m] that belongs to the foot and to the shank
    ankle_axis: Kept  # unit vector (3,) to the subject's left, the same for foot and shank

    def positions(self, names: Sequence[str], trial: str) -> Array:
        """Positions (m, 3) [m] of the named markers; `trial` is for messages."""
        if absent := [name for name in names if name not in self.markers]:
            raise InputError(
                f"trial {trial}: marker {absent[0]} is not in the static calibration, which has "
                f"{', '.join(self.markers)}; calibrate with the static trial again"
            )
        return np.array([self.markers[name] for name in names])


def segment_poses(
    trial: Trial, names: Sequence[str], calibration: StaticCalibration, settings: MarkerSettings
) -> tuple[Array, Poses]:
    """Time (n,) [s] and poses of one cluster, not filtered: short gaps are interpolated, long ones
    NaN. What was filled before the export was not measured, and is a gap."""
    time, observed = marker_tracks(trial, names)
    filled = [filled_frames(track) for track in np.moveaxis(observed, 1, 0)]
    observed = observed.copy()
    for k, frames in enumerate(filled):
        if frames is not None:
            observed[frames, k] = np.nan
    told = [frames for frames in filled if frames is not None]
    reference = calibration.positions(names, trial.name)
    poses = cluster_poses(reference, observed, settings.largest_residual_mm * 1e-3)
    poses = replace(poses, filled=np.any(told, axis=0) if told else None)
    return time, bridge_gaps(time, poses, settings.longest_gap_s)


@cache
def filled_share(length: int) -> float:
    """The RMS of so many third differences in three coordinates, over that of white noise, which
    that noise falls below with a chance of 1e-8: its density at 0 times the volume of a ball, at
    most 0.15."""
    apart = np.abs(np.subtract.outer(np.arange(length), np.arange(length)))
    # of third differences of white noise
    correlation = np.array([1.0, -0.75, 0.3, -0.05, 0.0])[np.minimum(apart, 4)]
    n = 3 * length
    volume = n / 2 * np.log(np.pi) - lgamma(n / 2 + 1) + n / 2 * np.log(n)
    density = -1.5 * np.linalg.slogdet(correlation)[1] - n / 2 * np.log(2 * np.pi)
    return float(min(np.exp((np.log(1e-8) - density - volume) / n), 0.15))


def filled_frames(track: Array) -> Mask | None:
    """Frames (n,) of a marker's track (n, 3) [m] that a spline, polynomial or line filled; None
    where that cannot be told, as in a track that was smoothed. Each measured frame has noise, which
    third differences multiply by the root of 20, while they lose the motion. Runs of them are
    filled whose RMS is below a share of that in the quiet fifth of the track. What is copied from
    other markers carries their noise and is not seen."""
    square = np.mean(np.diff(track, 3, axis=0) ** 2, axis=1)
    known = square[np.isfinite(square)]
    if len(known) < 40:
        return None
    noise = float(np.quantile(np.convolve(known, np.full(10, 0.1), "valid"), 0.2))
    steps = np.abs(np.diff(track, axis=0))
    rounding = float(np.min(steps[steps > 0], initial=np.inf)) / np.sqrt(12)
    if np.sqrt(noise / 20) < max(5e-6, 3 * rounding):  # [m]
        return None
    filled, square = np.zeros(len(track), dtype=bool), np.where(np.isfinite(square), square, np.inf)
    for length in range(2, 13):
        mean = np.convolve(square, np.full(length, 1 / length), "valid")
        for start in np.flatnonzero(mean < filled_share(length) ** 2 * noise):
            filled[start : start + length + 3] = True
    return filled


def cluster_poses(reference: Array, observed: Array, largest_residual: float = np.inf) -> Poses:
    """Least-squares pose (Kabsch, Acta Cryst. A32, 1976) of markers (n, m, 3) [m] against their
    reference (m, 3) [m]; NaN where fewer than three that span a plane were seen, or the residual is
    larger, as with swapped markers."""
    n, origin = len(observed), reference.mean(axis=0)
    rotation, position, residual = (
        np.full((n, 3, 3), np.nan),
        np.full((n, 3), np.nan),
        np.full(n, np.nan),
    )
    seen = np.asarray(np.isfinite(observed).all(axis=2))
    member = seen @ 2.0 ** np.arange(len(reference))  # a number for each set of markers
    for rows in (np.flatnonzero(member == one) for one in np.unique(member)):
        if not spans_a_plane(reference[pattern := seen[rows[0]]]):
            continue
        local, markers = (
            reference[pattern] - reference[pattern].mean(axis=0),
            observed[rows][:, pattern],
        )
        centroid = markers.mean(axis=1)
        centred = markers - centroid[:, None]
        U, _, Vt = np.linalg.svd(local.T @ centred)
        U[:, :, 2] *= (np.linalg.det(U) * np.linalg.det(Vt))[:, None]  # no reflection
        R = np.swapaxes(U @ Vt, 1, 2)
        misfit = local @ (U @ Vt) - centred
        rotation[rows], position[rows] = (
            R,
            centroid + R @ (origin - reference[pattern].mean(axis=0)),
        )
        residual[rows] = np.sqrt(np.mean(np.sum(misfit**2, axis=2), axis=1))
    wrong = residual > largest_residual
    rotation[wrong], position[wrong] = np.nan, np.nan
    return Poses(rotation, position, origin, residual, np.zeros(n, dtype=bool))


def spans_a_plane(points: Array) -> bool:
    """Whether points (m, 3) are three or more and do not lie on a line, with a tenth of their
    spread beside it."""
    if len(points) < 3:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > 0.1 * spread[0])


def bridge_gaps(time: Array, poses: Poses, longest: float) -> Poses:
    """Interpolate gaps of up to `longest` [s] by the cubic of least squares through the frames of
    15 ms, four at least, on either side. It leaves a motion of stance by 0.1 to 3 deg over 60 to
    190 ms, a spline by 1 to 10 deg."""
    steps, seen = np.diff(time), np.flatnonzero(poses.seen())
    if not (steps > 0).all():
        row = int(np.argmin(steps > 0))
        raise InputError(
            f"frame {row + 1} is stamped {time[row + 1]:.6f} s, not later than the one before;"
            " record again, or cut the capture there"
        )
    if len(seen) < 4:
        return poses
    step = float(steps[0])
    hidden, count = (np.diff(seen) - 1) * step, max(round(0.015 / step), 4)
    rotation, position, bridged = poses.rotation.copy(), poses.position.copy(), poses.bridged.copy()
    for k in np.flatnonzero((hidden > 0) & (hidden < longest + step / 2)):
        gap, beside = (
            np.arange(seen[k] + 1, seen[k + 1]),
            seen[max(k + 1 - count, 0) : k + 1 + count],
        )
        origin = scipy.spatial.transform.Rotation.from_matrix(poses.rotation[seen[k]])
        turned = (
            scipy.spatial.transform.Rotation.from_matrix(poses.rotation[beside]) * origin.inv()
        ).as_rotvec()
        span = np.ptp(time[beside]) / 2
        design, wanted = (
            np.vander((t - time[beside].mean()) / span, 4) for t in (time[beside], time[gap])
        )
        found = wanted @ np.linalg.lstsq(design, np.hstack([turned, poses.position[beside]]))[0]
        rotation[gap] = (
            scipy.spatial.transform.Rotation.from_rotvec(found[:, :3]) * origin
        ).as_matrix()
        position[gap], bridged[gap] = found[:, 3:], True
    return replace(poses, rotation=rotation, position=position, bridged=bridged)


def gap_duration(time: Array, gap: slice) -> float:
    """Duration [s] of consecutive hidden frames, for comparison with the longest gap that is
    allowed."""
    return float((gap.stop - gap.start - 0.5) * (time[1] - time[0]))


@dataclass(frozen=True)
class BodyMotion:
    """Motion of a body and of one of its points in laboratory axes, n frames."""

    rotation: Array  # (n, 3, 3)
    omega: Array  # angular velocity (n, 3) [rad/s]
    alpha: Array  # angular acceleration (n, 3) [rad/s^2]
    point: Array  # position (n, 3) [m] of the point
    acceleration: Array  # of the point (n, 3) [m/s^2]

    def __getitem__(self, rows: slice) -> "BodyMotion":
        parts = (self.rotation, self.omega, self.alpha, self.point, self.acceleration)
        return BodyMotion(*(part[rows] for part in parts))

    def weighted(self, weights: Array) -> "BodyMotion":
        """The same poses with angular velocity and accelerations times weights (n,): 0 where the
        body rests."""
        w = weights[:, None]
        return replace(
            self, omega=w * self.omega, alpha=w * self.alpha, acceleration=w * self.acceleration
        )


def body_motion(time: Array, poses: Poses, point: Array) -> BodyMotion:
    """Motion at times (n,) [s] of a low-passed body without NaN, and of its point that rests at
    `point` (3,) [m]."""
    turning = differentiate(time, poses.rotation.reshape(-1, 9)).omega.reshape(-1, 3, 3)
    # antisymmetric: the cross product with omega
    spin = turning @ np.swapaxes(poses.rotation, 1, 2)
    omega = 0.5 * np.stack(
        [spin[:, k - 1, k - 2] - spin[:, k - 2, k - 1] for k in range(3)], axis=1
    )
    path = differentiate(time, poses.point(point))
    return BodyMotion(
        poses.rotation, omega, differentiate(time, omega).omega, path.theta, path.alpha
    )


def cross_matrix(v: Array) -> Array:
    """Matrices (n, 3, 3) whose product with a vector is the cross product of v (n, 3) with it."""
    x, y, z, zero = *v.T, np.zeros(len(v))
    return np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), 2, 0)


def static_calibration(trial: Trial, settings: CalibrationSettings) -> StaticCalibration:
    """Calibration from the static trial: mean positions of the markers that the settings name."""

    def standing(names: Sequence[str]) -> dict[str, Array]:
        found = {}
        for name, track in zip(
            names, np.moveaxis(marker_tracks(trial, names)[1], 1, 0), strict=True
        ):
            seen = np.isfinite(track).all(axis=1)
            if not seen.any():
                raise InputError(
                    f"trial {trial.name}: marker {name} is never seen in the static trial; label"
                    " it, or record the trial again"
                )
            found[name] = np.asarray(track[seen].mean(axis=0))
        return found

    markers = settings.markers
    clusters = {
        segment: standing(names) for segment in SEGMENTS if (names := getattr(markers, segment))
    }
    for segment, cluster in clusters.items():
        if not spans_a_plane(np.array(list(cluster.values()))):
            raise InputError(
                f"trial {trial.name}: the {segment} markers {', '.join(cluster)} lie on a line or"
                " are fewer than three, expected three or more that span a plane; name others"
                " under `markers` in the configuration"
            )
    foot, shank = clusters["foot"], clusters["shank"]
    above = float(np.mean([p[2] for p in foot.values()]) - np.mean([p[2] for p in shank.values()]))
    if above > 0.05:  # standing, they are lower by 0.1 m and more
        raise InputError(
            f"trial {trial.name}: the foot markers {', '.join(foot)} stand {100 * above:.0f} cm"
            f" above the shank markers {', '.join(shank)}: exchange them under `markers` or in"
            " Nexus; or z does not point up, then state `axes` in the source file"
        )
    inner, outer = standing((markers.ankle_medial, markers.ankle_lateral)).values()
    across = inner - outer if settings.side == "right" else outer - inner
    placed = foot | shank | clusters.get("platform", {})
    return StaticCalibration(placed, (inner + outer) / 2, across / np.linalg.norm(across))


def ankle_angle(foot: Poses, shank: Poses, axis: Array) -> Array:
    """Joint angle theta (n,) [rad]: dorsiflexion positive, zero in the static pose. Minus the twist
    of the foot relative to the shank about the axis (3,), which points to the left."""
    relative = np.einsum("nji,njk->nik", shank.rotation, foot.rotation)
    twist = scipy.spatial.transform.Rotation.from_matrix(relative).as_quat(canonical=True)
    return np.asarray(-2 * np.arctan2(twist[:, :3] @ axis, twist[:, 3]))


def moment_of_foot(
    foot: BodyMotion, ankle: Array, axis: Array, mass: float, inertia: float
) -> Array:
    """Torque (n,) [N*m] of weight and inertia of what moves with the foot, axis . ((c - a) x m
    (acceleration - g)) + I alpha . axis, with its centre of mass c, the point of `foot`, and I
    [kg*m^2] about the axis through c."""
    lever = np.cross(foot.point - ankle, mass * (foot.acceleration - FREE_FALL))
    return np.asarray(np.sum(axis * (lever + inertia * foot.alpha), axis=1))
