"""Poses, wrenches and Newton-Euler for the bodies of a crossing, on a regular time grid, in laboratory axes."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.trial import Array

Point = Array | tuple[float, float, float]  # [m]

GRAVITY = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class Pose:
    """Pose of a body: rotation (n, 3, 3) from its own axes to the laboratory's, and its origin [m], shape (n, 3)."""

    rotation: Array
    origin: Array

    def point(self, local: Point) -> Array:
        """Laboratory position [m], shape (n, 3), of a point of the body, shape (3,)."""
        return self.origin + np.asarray(self.rotation.reshape(-1, 3) @ local).reshape(self.origin.shape)

    def after(self, inner: "Pose") -> "Pose":
        """The pose of a body that is held at `inner` in this body's axes."""
        origin = self.origin + np.einsum("nij,nj->ni", self.rotation, inner.origin)
        return Pose(self.rotation @ inner.rotation, origin)


@dataclass(frozen=True)
class TrueWrench:
    """A force [N] that acts at a point [m], with a moment [N*m] about that point; shape (n, 3) each."""

    force: Array
    moment: Array
    point: Array

    def moment_about(self, point: Array) -> Array:
        """Moment [N*m], shape (n, 3), of the same wrench about another point."""
        return self.moment + np.cross(self.point - point, self.force)


def support(pose: Pose, rate_hz: float, mass: float, centre_of_mass: Point, gyration: Point) -> TrueWrench:
    """The wrench that must act on a body, besides its weight, for its motion: force m (a - g) and moment dH/dt =
    I alpha + omega x I omega about the centre of mass. This [m] and the principal radii of gyration [m] about it are in
    the body's own axes."""
    centre = pose.point(centre_of_mass)
    acceleration = time_derivative(time_derivative(centre, rate_hz), rate_hz)
    inertia = (pose.rotation * (mass * np.array(gyration) ** 2)) @ pose.rotation.transpose(0, 2, 1)
    W = time_derivative(pose.rotation, rate_hz) @ pose.rotation.transpose(0, 2, 1)  # dR/dt R^T
    omega = 0.5 * np.stack([W[:, 2, 1] - W[:, 1, 2], W[:, 0, 2] - W[:, 2, 0], W[:, 1, 0] - W[:, 0, 1]], axis=-1)
    momentum = np.einsum("nij,nj->ni", inertia, omega)
    return TrueWrench(mass * (acceleration - GRAVITY), time_derivative(momentum, rate_hz), centre)


def time_derivative(values: Array, rate_hz: float) -> Array:
    """Time derivative along the first axis by fourth-order central differences, of smooth simulated curves, never of
    data: over tens of milliseconds the error at 3 kHz is below 1e-6. The two samples at either end are worse."""
    slope = np.gradient(values, axis=0, edge_order=2)
    inner, outer = values[3:-1] - values[1:-3], values[4:] - values[:-4]
    slope[2:-2] = (8.0 * inner - outer) / 12.0
    return np.asarray(slope * rate_hz)


def rotation_about(axis: int, angle: Array) -> Array:
    """Right-handed rotation, shape (n, 3, 3), by angles [rad] about laboratory axis 0 (x), 1 (y) or 2 (z)."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned = np.zeros((len(angle), 3, 3))
    turned[:, axis, axis] = 1.0
    turned[:, i, i] = turned[:, j, j] = np.cos(angle)
    turned[:, j, i] = np.sin(angle)
    turned[:, i, j] = -turned[:, j, i]
    return turned


def interpolated_at(values: Array, rate_hz: float, times: Array) -> Array:
    """Values on a regular grid, shape (n, ...), at other times [s], by cubic Lagrange interpolation. Times beyond the
    grid's ends are held inside it."""
    place = np.clip(times * rate_hz, 1.0, len(values) - 3.0)
    first = np.floor(place).astype(int)
    f = (place - first).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(
        -f * (f - 1) * (f - 2) / 6 * values[first - 1]
        + (f + 1) * (f - 1) * (f - 2) / 2 * values[first]
        - (f + 1) * f * (f - 2) / 2 * values[first + 1]
        + (f + 1) * f * (f - 1) / 6 * values[first + 2]
    )
