# SPDX-License-Identifier: Apache-2.0
"""Poses, wrenches and Newton-Euler for the bodies of a crossing, on a regular time grid, in
laboratory axes: x forward, y left, z up, in metres."""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.base.trial import Array

Point = Array | tuple[float, float, float]  # [m]

GRAVITY = np.array([0.0, 0.0, -9.81])  # [m/s^2]


@dataclass(frozen=True)
class Pose:
    """Pose of a body."""

    rotation: Array  # (n, 3, 3) from its own axes to the laboratory's
    origin: Array  # (n, 3) [m]

    def point(self, local: Point) -> Array:
        """Laboratory position (n, 3) [m] of a point of the body, (3,)."""
        turned = self.rotation.reshape(-1, 3) @ local
        return self.origin + turned.reshape(self.origin.shape)

    def after(self, inner: "Pose") -> "Pose":
        """The pose of a body that is held at `inner` in this body's axes."""
        origin = self.origin + np.einsum("nij,nj->ni", self.rotation, inner.origin)
        return Pose(self.rotation @ inner.rotation, origin)


@dataclass(frozen=True)
class TrueWrench:
    """A force that acts at a point, with a moment about that point."""

    force: Array  # (n, 3) [N]
    moment: Array  # (n, 3) [N*m]
    point: Array  # (n, 3) [m]

    def moment_about(self, point: Array) -> Array:
        """Moment (n, 3) [N*m] of the same wrench about another point."""
        return self.moment + np.cross(self.point - point, self.force)


def support(
    pose: Pose, rate_hz: float, mass: float, centre_of_mass: Point, gyration: Point
) -> TrueWrench:
    """Find the wrench that must act on a body, besides its weight, for its motion.

    Parameters
    ----------
    pose : Pose
        Of the body, sampled at `rate_hz`.
    rate_hz : float
    mass : float
        [kg].
    centre_of_mass, gyration : Point
        Centre of mass and principal radii about it, in the body's axes [m].

    Returns
    -------
    TrueWrench
        Force m (a - g) and moment dH/dt about the centre of mass, H = I omega.
    """
    centre = pose.point(centre_of_mass)
    acceleration = time_derivative(time_derivative(centre, rate_hz), rate_hz)
    transposed = pose.rotation.transpose(0, 2, 1)
    inertia = (pose.rotation * (mass * np.array(gyration) ** 2)) @ transposed
    W = time_derivative(pose.rotation, rate_hz) @ transposed  # dR/dt R^T
    omega = 0.5 * np.stack(
        [W[:, 2, 1] - W[:, 1, 2], W[:, 0, 2] - W[:, 2, 0], W[:, 1, 0] - W[:, 0, 1]], axis=-1
    )
    momentum = np.einsum("nij,nj->ni", inertia, omega)
    return TrueWrench(
        force=mass * (acceleration - GRAVITY),
        moment=time_derivative(momentum, rate_hz),
        point=centre,
    )


def time_derivative(values: Array, rate_hz: float) -> Array:
    """Time derivative along the first axis by fourth-order central differences.

    It is for smooth simulated curves, never for data: over tens of milliseconds the error at 3 kHz
    is below 1e-6. The two samples at either end are worse.
    """
    slope = np.gradient(values, axis=0, edge_order=2)
    inner = values[3:-1] - values[1:-3]
    outer = values[4:] - values[:-4]
    slope[2:-2] = (8.0 * inner - outer) / 12.0
    return slope * rate_hz


def rotation_about(axis: int, angle: Array) -> Array:
    """Right-handed rotation (n, 3, 3) by angles (n,) [rad] about laboratory axis 0 (x), 1 (y) or 2
    (z)."""
    about_axis = scipy.spatial.transform.Rotation.from_euler("xyz"[axis], angle[:, None])
    return np.asarray(about_axis.as_matrix())


NODES = (-1, 0, 1, 2)  # of the interpolation, in samples


def interpolated_at(values: Array, rate_hz: float, times: Array) -> Array:
    """Values on a regular grid, (n, ...), at other times [s], held inside it, by cubic Lagrange
    interpolation."""
    place = np.clip(times * rate_hz, 1.0, len(values) - 3.0)
    first = np.floor(place).astype(int)
    f = (place - first).reshape(-1, *[1] * (values.ndim - 1))
    interpolated = np.zeros((len(f), *values.shape[1:]))
    for node in NODES:
        other_nodes = [other_node for other_node in NODES if other_node != node]
        weight = math.prod(f - other_node for other_node in other_nodes)
        at_node = math.prod(node - other_node for other_node in other_nodes)
        interpolated += weight / at_node * values[first + node]
    return interpolated
