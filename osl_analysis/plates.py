"""A force plate: what its channels measure, its axes, and whether a point lies on it.

Corners (4, 3) [m] go round the edge. The first lies in the quadrant +x, +y of the plate's own axes,
as in C3D files.
"""

import numpy as np

from osl_analysis.recording import EXPORTED
from osl_analysis.trial import Array

MEASURED_BY_TYPE = {
    EXPORTED: ("N", "N", "N", "N*m", "N*m", "N*m", "m", "m", "m"),
    1: ("N", "N", "N", "m", "m", "N*m"),
    2: ("N", "N", "N", "N*m", "N*m", "N*m"),
    3: ("N", "N", "N", "N", "N", "N", "N", "N"),
    4: ("", "", "", "", "", ""),
}
"""By type of plate, what its channels measure in SI units; those of type 4 in the units of its
calibration."""


def own_axes(corners: Array) -> Array:
    """Find the axes in which a plate reports its force.

    Parameters
    ----------
    corners : Array
        (4, 3) [m] in the laboratory.

    Returns
    -------
    Array
        Unit vectors x, y, z as columns (3, 3). x runs from corner 2 to corner 1, z is normal to the
        surface. Not finite where the corners span no plane.
    """
    x = corners[0] - corners[1]
    z = np.cross(x, corners[0] - corners[3])
    with np.errstate(invalid="ignore", divide="ignore"):
        x = x / np.linalg.norm(x)
        z = z / np.linalg.norm(z)
    y = np.cross(z, x)
    return np.column_stack([x, y, z])


def plate_axes(corners: Array) -> Array:
    """Find axes along a plate's edges, (3, 3) as columns, with z up; x and y may point either way.

    A plate's own z points down in many laboratories (`own_axes`).
    """
    axes = own_axes(corners)
    if axes[2, 2] >= 0:
        return axes
    return axes * [1.0, -1.0, -1.0]


def beside(points: Array, corners: Array) -> Array:
    """Find how far points lie beside the plate.

    Parameters
    ----------
    points : Array
        (k, 2) [m] in the axes of the plate, from its centre.
    corners : Array
        (4, 3) [m].

    Returns
    -------
    Array
        Distance (k,) [m] from the nearest edge; 0 on the plate.
    """
    length = np.linalg.norm(corners[0] - corners[1])
    width = np.linalg.norm(corners[0] - corners[3])
    half_sides = np.array([length, width]) / 2
    excess = np.maximum(np.abs(points) - half_sides, 0.0)
    return np.asarray(np.hypot(excess[:, 0], excess[:, 1]))


def furthest_outside(points: Array, corners: Array) -> float:
    """Find the largest distance [m] of points (k, 3) [m] outside the plate; 0 if all are on it.

    Points are in laboratory axes and are projected on the surface.
    """
    centre = corners.mean(axis=0)
    on_surface = (points - centre) @ plate_axes(corners)[:, :2]
    return float(beside(on_surface, corners).max(initial=0.0))
