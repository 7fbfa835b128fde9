# SPDX-License-Identifier: Apache-2.0
"""The surface of a force plate. Corners (4, 3) [m] go round the edge; the first lies in the
quadrant +x, +y of the plate's own axes, as in C3D files."""

import numpy as np

from osl_analysis.base.trial import Array


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
    x, y = corners[0] - corners[[1, 3]]
    z = np.cross(x, y)
    with np.errstate(invalid="ignore", divide="ignore"):
        x = x / np.linalg.norm(x)
        z = z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


def plate_axes(corners: Array) -> Array:
    """Find axes along a plate's edges, (3, 3) as columns, with z up; x and y may point either way.

    A plate's own z points down in many laboratories (`own_axes`).
    """
    axes = own_axes(corners)
    return axes if axes[2, 2] >= 0 else axes * [1.0, -1.0, -1.0]


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
    half_sides = np.linalg.norm(corners[0] - corners[[1, 3]], axis=1) / 2
    excess = np.maximum(np.abs(points) - half_sides, 0.0)
    return np.linalg.norm(excess, axis=1)
