"""The surface of a force plate, from its corners: its axes, and which points lie beside it.

A plate's corners (4, 3) [m] go round it; the first lies in the quadrant of +x and +y of its own axes, as in C3D files.
"""

import numpy as np

from osl_analysis.trial import Array


def plate_axes(corners: Array) -> Array:
    """Unit vectors along the plate's edges and normal to it, as columns (3, 3), from its corners (4, 3) [m]. The normal
    points up; the signs along the edges do not matter."""
    x, y = corners[0] - corners[1], corners[0] - corners[3]
    normal = np.cross(x, y)
    normal = normal * np.sign(normal[2] or 1.0)
    return np.column_stack([axis / np.linalg.norm(axis) for axis in (x, np.cross(normal, x), normal)])


def beside(points: Array, corners: Array) -> Array:
    """Distance (k,) [m] by which points (k, 2) [m], from the plate's centre along its axes, lie beside it; 0 on it."""
    half = np.array([np.linalg.norm(corners[0] - corners[1]), np.linalg.norm(corners[0] - corners[3])]) / 2
    return np.asarray(np.hypot(*np.maximum(np.abs(points) - half, 0.0).T))


def furthest_outside(points: Array, corners: Array) -> float:
    """Largest distance [m] by which points (m, 3) [m] lie outside the plate with these corners (4, 3) [m], along its
    surface; 0 if all are inside."""
    away = (points - corners.mean(axis=0)) @ plate_axes(corners)[:, :2]
    return float(beside(away, corners).max(initial=0.0))
