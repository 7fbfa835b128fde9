# SPDX-License-Identifier: Apache-2.0
"""A walk over a force plate by formula: rigid bodies in numpy, which share no code with analysis or
simulator. The platform turns about a mediolateral axis below its surface by a minimum-jerk ramp,
and may heave or be slower. The foot rides on it flat, so that the ankle turns by its angle and the
lean of the shank, and answers with K, B and I on top of a load that does not vary."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from scipy.spatial.transform import Rotation
from scipy.special import erf
from shipped import SETTINGS

from osl_analysis.base.trial import Array, Trial, marker_columns, plate_columns
from osl_analysis.walking.poses import Poses
from osl_analysis.walking.walking_settings import WalkingAnalysis

RATE = 300
PLATE_RATE = 1500
G = 9.80665
FOOT = np.array([[-0.08, 0.01, 0.05], [0.16, 0.02, 0.03], [0.10, -0.05, 0.03], [0.06, 0.01, 0.12]])
SHANK = np.array(
    [[0.05, -0.02, 0.18], [0.01, -0.07, 0.27], [-0.03, 0.05, 0.33], [0.06, 0.02, 0.41]]
)
PLATFORM = np.array(
    [[0.28, 0.23, 0.0], [-0.28, 0.23, 0.0], [-0.28, -0.23, 0.06], [0.28, -0.23, 0.0]]
)
CORNERS = [[0.25, 0.25, 0.0], [0.25, -0.25, 0.0], [-0.25, -0.25, 0.0], [-0.25, 0.25, 0.0]]
ANKLE = np.array([-0.06, 0.0, 0.09])
LEFT = np.array([0.0, 1.0, 0.0])
OF_WALKING = SETTINGS["walking"] | {
    "load_on_n": 40,
    "longest_gap_s": 0.05,
}


def settings(**changes: Any) -> WalkingAnalysis:
    return WalkingAnalysis.model_validate(OF_WALKING | changes)


def about_y(angle: Array) -> Array:
    """Rotations (n, 3, 3) about the axis to the left: +x, the toes, goes down."""
    return Rotation.from_euler("y", angle[:, None]).as_matrix()


def pose(rotation: Array, position: Array) -> Poses:
    n = len(rotation)
    return Poses(rotation, position, np.zeros(3), np.zeros(n), np.zeros(n, dtype=bool))


def recording(name: str, tracks: dict[str, Array], force: Array, moment: Array) -> Trial:
    """A trial: marker tracks (n, 3) at 300 Hz, wrench (5 n, 3) at 1500 Hz in the plate's axes about
    its centre."""
    n = len(force)
    columns = plate_columns(1)
    wrench = pl.DataFrame(np.hstack([force, moment]), columns)
    labels = [column for label in tracks for column in marker_columns(label)]
    markers = pl.DataFrame(np.hstack(list(tracks.values())), labels)
    frames = np.arange(0, n, n // len(markers), dtype=np.uint32)
    fast = wrench.insert_column(0, pl.Series("time", np.arange(n) / PLATE_RATE))
    slow = markers.with_columns(row=pl.Series(frames))
    samples = fast.with_row_index("row").join(slow, on="row", how="left", maintain_order="left")
    plate = {"plate": 1, "type": 2, "corners": CORNERS}
    return Trial(name, samples.drop("row"), {"plates": [plate]})


def labelled(prefix: str, tracks: Array) -> dict[str, Array]:
    """Tracks (n, m, 3) by label."""
    return {f"{prefix}{k + 1}": tracks[:, k] for k in range(tracks.shape[1])}


def changed(trial: Trial, *columns: pl.Expr, **named: Any) -> Trial:
    """The trial with other columns."""
    return replace(trial, samples=trial.samples.with_columns(*columns, **named))


def hidden(trial: Trial, markers: Sequence[str], start: float, end: float) -> Trial:
    """The trial with markers hidden between two times [s]."""
    is_hidden = pl.col("time").is_between(start, end)
    columns = [pl.col(column) for marker in markers for column in marker_columns(marker)]
    unseen = [
        pl.when(is_hidden & column.is_not_null()).then(float("nan")).otherwise(column).name.keep()
        for column in columns
    ]
    return changed(trial, *unseen)


def static_trial(ankle: Array = ANKLE) -> Trial:
    """One second of standing; the malleoli 4 cm either side of the ankle (3,), the medial one to
    the left."""
    tracks = {}
    for prefix, points in {"FOOT": FOOT, "SHANK": SHANK, "PLAT": PLATFORM}.items():
        tracks |= labelled(prefix, np.tile(points, (RATE, 1, 1)))
    for label, side in (("ANKLE_MED", LEFT), ("ANKLE_LAT", -LEFT)):
        tracks[label] = np.tile(ankle + 0.04 * side, (RATE, 1))
    return recording("static", tracks, np.zeros((5 * RATE, 3)), np.zeros((5 * RATE, 3)))


def bump(time: Array, centre: float, width: float) -> Array:
    """A smooth step from 0 to 1 (an error function) with its two derivatives."""
    u = (time - centre) / width
    first = np.exp(-(u**2)) / (width * np.sqrt(np.pi))
    return np.array([0.5 * (1 + erf(u)), first, -2 * u / width * first])


@dataclass(frozen=True)
class Ramp:
    """One ramp of the platform: angle [deg, toes up], duration and onset [s], heave [m]."""

    angle: float = 2.5
    rise: float = 0.1
    onset: float = 1.19
    heave: float = 0.0
    returns: float = 2.1


@dataclass(frozen=True)
class Rig:
    """Plate of 25 kg, its centre of mass from the surface's centre, gyration and axis [m]; noise
    [m, N, N*m]."""

    mass: float = 25.0
    com: tuple[float, float, float] = (0.01, -0.015, -0.045)
    gyration: tuple[float, float, float] = (0.15, 0.17, 0.22)
    pivot: tuple[float, float, float] = (0.0, 0.0, -0.12)
    marker: float = 3e-4
    force: float = 0.4
    moment: float = 0.08
    lag: float = 0.0


def step(t: Array, start: float, duration: float) -> Array:
    """A minimum-jerk step from 0 to 1, with its two derivatives (3, n) in time."""
    x = np.clip((t - start) / duration, 0, 1)
    rise = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    return np.array([rise.deriv(order)(x) / duration**order for order in range(3)])


def angle_and_heave(t: Array, ramp: Ramp | None) -> tuple[Array, Array]:
    """Angle [rad, toes up] and heave [m] with two derivatives, (3, n) each."""
    if ramp is None:
        return np.zeros((3, len(t))), np.zeros((3, len(t)))
    angle = np.deg2rad(ramp.angle) * (step(t, ramp.onset, ramp.rise) - step(t, ramp.returns, 0.3))
    return angle, ramp.heave * (step(t, ramp.onset, 0.06) - step(t, ramp.onset + 0.08, 0.06))


def plate_wrench(t: Array, ramp: Ramp | None, rig: Rig) -> Array:
    """What the plate's own mass shows (n, 6) [N, N*m], in its axes and about its centre, zeroed at
    rest."""
    (phi, w, z), (_, _, lift) = angle_and_heave(t, ramp)
    R = about_y(-phi)
    com = np.array(rig.com)
    tare = np.array([0, 0, rig.mass * G])
    arm = np.einsum("nij,j->ni", R, com - rig.pivot)
    W = -w[:, None] * LEFT
    Z = -z[:, None] * LEFT
    a = np.cross(Z, arm) + np.cross(W, np.cross(W, arm)) + lift[:, None] * [0, 0, 1]
    in_plate = R.transpose(0, 2, 1)
    force = np.einsum("nij,nj->ni", in_plate, rig.mass * (a + np.array([0, 0, G])))
    spin = -rig.mass * rig.gyration[1] ** 2 * z[:, None] * LEFT
    moment = np.einsum("nij,nj->ni", in_plate, spin) + np.cross(com, force)
    return np.hstack([force - tare, moment - np.cross(com, tare)])


def stance_load(t: Array) -> Array:
    """Share of the load (n,), about 1 in stance from 0.9 to 1.62 s, with the two humps of gait."""
    held = step(t, 0.9, 0.15)[0] - step(t, 1.62 - 0.15, 0.15)[0]
    return held * (1 - 0.15 * np.cos(4 * np.pi * np.clip((t - 0.9) / 0.72, 0, 1)))


def carried(points: Array, t: Array, ramp: Ramp | None, rig: Rig) -> Array:
    """Points (m, 3) that ride on the platform: (n, m, 3)."""
    (phi, _, _), (lift, _, _) = angle_and_heave(t, ramp)
    ridden = np.einsum("nij,mj->nmi", about_y(-phi), points - rig.pivot) + rig.pivot
    ridden[:, :, 2] += lift[:, None]
    return ridden


def walked_over(name: str, ramp: Ramp | None, rig: Rig, seed: int, loaded: bool = True) -> Trial:
    """A crossing, or a trial of the unloaded platform, with noise from the seed."""
    random = np.random.default_rng(seed)
    fast = np.arange(3 * PLATE_RATE) / PLATE_RATE
    slow = fast[::5]
    late = fast - rig.lag
    wrench = plate_wrench(late, ramp, rig)
    tracks = labelled("PLAT", carried(PLATFORM, slow, ramp, rig))
    if loaded:
        wrench += wrench_of_foot(late, ramp)
        ankle = carried(ANKLE[None], slow, ramp, rig)
        pitch = -angle_and_heave(slow, ramp)[0][0]
        lean = -0.1 + 0.35 * step(slow, 0.9, 0.72)[0]
        for prefix, points, angle in (("FOOT", FOOT, pitch), ("SHANK", SHANK, lean)):
            turned = np.einsum("nij,mj->nmi", about_y(angle), points - ANKLE)
            tracks.update(labelled(prefix, turned + ankle))
    wrench += random.normal(0, [rig.force] * 3 + [rig.moment] * 3, wrench.shape)
    noisy = {
        label: track + random.normal(0, rig.marker, track.shape) for label, track in tracks.items()
    }
    return recording(name, noisy, wrench[:, :3], wrench[:, 3:])


def wrench_of_foot(t: Array, ramp: Ramp | None) -> Array:
    """A force through the ankle, and the ankle's torque (n, 6) [N, N*m], in the plate's axes: load
    of stance, and the answer to the ramp."""
    load = stance_load(t)
    phi, w, z = angle_and_heave(t, ramp)[0]
    in_plate = about_y(-phi).transpose(0, 2, 1)
    force = np.einsum("nij,nj->ni", in_plate, np.outer(load, [0, 0, 800.0]))
    stands = step(t, 0.9, 0.05)[0] - step(t, 1.57, 0.05)[0]
    torque = 40.0 * load + stands * (340.0 * phi + 3.0 * w + 0.02 * z)
    moment = np.cross(ANKLE, force) - np.outer(torque, LEFT)
    return np.hstack([force, moment])


def plate_trials(rig: Rig, ramp: Ramp, count: int) -> list[Trial]:
    """Trials of the unloaded platform: the same ramp, at other times."""
    starts = 1.0 + np.random.default_rng(80).uniform(0, 0.05, count)
    ramps = [replace(ramp, onset=start, returns=1.9) for start in starts]
    return [
        walked_over(f"plate_{k}", each, rig, 3900 + k, loaded=False) for k, each in enumerate(ramps)
    ]
