"""The surface of a force plate, from its corners: its axes, and which points lie beside it.

A plate's corners (4, 3) [m] go round it; the first lies in the quadrant of +x and +y of its own axes, as in C3D files.
"""

import numpy as np

from osl_analysis.trial import Array


def own_axes(corners: Array) -> Array:
    """Axes of a plate as columns (3, 3), from its corners (4, 3) [m]: x along corners 2 to 1, z normal to the surface;
    not finite where the corners span no plane."""
    x = corners[0] - corners[1]
    z = np.cross(x, corners[0] - corners[3])
    with np.errstate(invalid="ignore", divide="ignore"):
        x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


def plate_axes(corners: Array) -> Array:
    """The same with a normal that points up; the signs along the edges do not matter."""
    axes = own_axes(corners)
    return axes if axes[2, 2] >= 0 else axes * [1.0, -1.0, -1.0]


def beside(points: Array, corners: Array) -> Array:
    """Distance (k,) [m] by which points (k, 2) [m], from the plate's centre along its axes, lie beside it; 0 on it."""
    half = np.array([np.linalg.norm(corners[0] - corners[1]), np.linalg.norm(corners[0] - corners[3])]) / 2
    return np.asarray(np.hypot(*np.maximum(np.abs(points) - half, 0.0).T))


def furthest_outside(points: Array, corners: Array) -> float:
    """Largest distance [m] by which points (m, 3) [m] lie outside the plate with these corners (4, 3) [m], along its
    surface; 0 if all are inside."""
    away = (points - corners.mean(axis=0)) @ plate_axes(corners)[:, :2]
    return float(beside(away, corners).max(initial=0.0))
