"""The force plate on the moving platform: readings of its sensors in the plate's axes.

The plate's axes are those of C3D force plates: x along laboratory +y, y along laboratory +x, z down, all turning with
the platform. Corners 1-4 lie in the quadrants (+x, +y), (-x, +y), (-x, -y), (+x, -y) of these axes.
"""

from dataclasses import dataclass

import numpy as np

from osl_analysis.simulator.rigid_body import GRAVITY, Pose, RigidBody, TrueWrench
from osl_analysis.simulator.walking_settings import Plate
from osl_analysis.trial import Array

PLATE_AXES = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass(frozen=True)
class SensorReading:
    """Force [N] and moment about the sensor origin [N*m], shape (n, 3) each, in the plate's moving axes.

    Signs as Vicon Nexus stores them: the reaction on the foot, so that a standing person reads Fz < 0 along z down.
    """

    force: Array
    moment: Array


def plate_corners(plate: Plate) -> Array:
    """The four corners [m] of the resting plate in laboratory axes, shape (4, 3), in C3D's order."""
    quadrants = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], dtype=float) @ PLATE_AXES.T
    half = 0.5 * np.array([*plate.size_m, 0.0])
    return np.asarray(np.array(plate.centre_m) + quadrants * half)


def sensor_from_centre(plate: Plate) -> Array:
    """The sensor origin [m] from the surface's centre, laboratory axes of the resting plate, shape (3,)."""
    return np.array([*plate.sensor_offset_m, -plate.sensor_depth_m])


def c3d_origin(plate: Plate) -> Array:
    """FORCE_PLATFORM:ORIGIN [m] with the sign of Vicon Nexus, shape (3,): z > 0 for a sensor below the surface.

    The C3D manual defines the opposite vector, from the sensor origin to the surface. Readers distinguish the two by
    the sign of z and reverse the vector.
    """
    return np.asarray(PLATE_AXES.T @ sensor_from_centre(plate))


def sensor_reading(reaction: TrueWrench, platform: Pose, plate: Plate, mass: float, rate_hz: float) -> SensorReading:
    """Reading of the sensors under a ground reaction, including the plate's own `mass` [kg] above them.

    They carry the force of the foot and the plate: force F + m (a - g), moment M + dH/dt + r x m (a - g). The zero was
    set on the unloaded plate at rest, in the sensors' axes. The plate's weight therefore appears only when it tilts.
    """
    sensor = np.array(plate.centre_m) + sensor_from_centre(plate)
    turned = platform.rotation @ PLATE_AXES
    body = RigidBody(mass, np.add(plate.centre_m, plate.centre_of_mass_m), np.array(plate.gyration_m))
    own = body.support(platform, rate_hz)
    origin = platform.point(sensor)
    resting = -mass * GRAVITY
    zero_moment = np.cross(body.centre_of_mass - sensor, resting)
    return SensorReading(
        in_axes(turned, reaction.force + own.force) - resting @ PLATE_AXES,
        in_axes(turned, reaction.moment_about(origin) + own.moment_about(origin)) - zero_moment @ PLATE_AXES,
    )


def in_axes(rotation: Array, vectors: Array) -> Array:
    """Laboratory vectors, shape (n, 3), in the axes that are the columns of rotation (n, 3, 3)."""
    return np.asarray(np.einsum("nji,nj->ni", rotation, vectors))
