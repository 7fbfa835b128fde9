"""A simulated capture decoded by hand: ezc3d and the C3D manual, no line of ingest or of the
walking analysis."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np

from osl_analysis.simulator.laboratory_settings import FOOT, PLATFORM, SHANK
from osl_analysis.simulator.rigid_body import Pose
from osl_analysis.trial import Array

PLATE_CENTRE = np.array([0.30, 0.25, 0.0])  # [m] of the shipped plate at rest


@dataclass(frozen=True)
class DecodedCrossing:
    """Angle [rad], torque [N*m], force on the foot [N], its centre of pressure [m] and the plate's
    pose, per frame."""

    time: Array
    theta: Array
    torque: Array
    force: Array
    pressure: Array
    foot: Pose
    platform: Pose
    analogs: Array  # all channels, as the file has them, (channels, samples)

    @property
    def platform_angle(self) -> Array:
        """Toes-up angle [rad] of the platform."""
        return np.asarray(
            np.arctan2(self.platform.rotation[:, 2, 0], self.platform.rotation[:, 0, 0])
        )

    @property
    def stance(self) -> tuple[float, float]:
        """First and last time [s] at which the vertical force is above 20 N."""
        loaded = self.time[self.force[:, 2] > 20]
        return float(loaded[0]), float(loaded[-1])


def decoded_crossing(path: Path) -> DecodedCrossing:
    """Angle and torque of a capture whose sensors are perfect, from its clusters' poses and its
    type 2 plate."""
    file = ezc3d.c3d(str(path))
    labels, points = (
        file["parameters"]["POINT"]["LABELS"]["value"],
        file["data"]["points"][:3].T / 1e3,
    )
    poses = []
    for name, body, centre in (
        ("FOOT", FOOT, 0.0),
        ("SHANK", SHANK, 0.0),
        ("PLAT", PLATFORM, PLATE_CENTRE),
    ):
        own = [place for place, label in enumerate(labels) if label.startswith(name)]
        poses.append(pose_from(points[:, own], np.array(list(body.values())) + centre))
    foot, shank, platform = poses
    force, moment, centre = decoded_wrench(file, platform)
    axis, between = foot.rotation[:, :, 1], foot.rotation.transpose(0, 2, 1) @ shank.rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        upward = force[:, 2]
        pressure = centre + np.stack(
            [-moment[:, 1] / upward, moment[:, 0] / upward, 0 * upward], axis=-1
        )
    time, theta = np.arange(len(points)) / 300, np.arctan2(between[:, 0, 2], between[:, 0, 0])
    torque = -np.einsum("ni,ni->n", moment + np.cross(centre - foot.origin, force), axis)
    return DecodedCrossing(
        time, theta, torque, force, pressure, foot, platform, file["data"]["analogs"][0]
    )


def decoded_wrench(file: Any, platform: Pose) -> tuple[Array, Array, Array]:
    """Force [N], moment [N*m] about the plate's centre, and centre [m], in laboratory axes, by the
    C3D manual: x from corner 2 to 1, y from 4 to 1, z = x cross y; centre at -ORIGIN if ORIGIN z >
    0. `platform` carries the plate."""
    plate = file["parameters"]["FORCE_PLATFORM"]
    corners, origin = (
        plate["CORNERS"]["value"][:, :, 0].T / 1e3,
        plate["ORIGIN"]["value"][:, 0] / 1e3,
    )
    x, y = corners[0] - corners[1], corners[0] - corners[3]
    axes = np.stack(
        [
            x / np.linalg.norm(x),
            y / np.linalg.norm(y),
            np.cross(x, y) / np.linalg.norm(np.cross(x, y)),
        ]
    )
    channels = file["data"]["analogs"][0, :6, ::5].T
    force, moment = channels[:, :3], channels[:, 3:] / 1e3
    assert origin[2] > 0
    moment = moment - np.cross(-origin, force)
    force, moment = (
        np.einsum("nij,nj->ni", platform.rotation, one @ axes) for one in (force, moment)
    )
    return force, moment, platform.point(corners.mean(axis=0))


def pose_from(markers: Array, local: Array) -> Pose:
    """Least-squares pose of a cluster, shape (n, m, 3) seen and (m, 3) in the body's axes
    (Kabsch)."""
    centre, middle = markers.mean(axis=1), local.mean(axis=0)
    u, _, vt = np.linalg.svd(np.einsum("nmi,mj->nij", markers - centre[:, None], local - middle))
    flip = np.tile(np.eye(3), (len(markers), 1, 1))
    flip[:, 2, 2] = np.linalg.det(u @ vt)
    rotation = u @ flip @ vt
    return Pose(rotation, centre - rotation @ middle)
