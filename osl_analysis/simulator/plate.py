"""The force plate on the moving platform: what it carries, its sensors' reading, and its channels of types 1 to 4.

The plate's axes are those of C3D force plates: x along laboratory +y, y along laboratory +x, z down, all turning with
the platform. Corners 1-4 lie in the quadrants (+x, +y), (-x, +y), (-x, -y), (+x, -y) of these axes. Channels are as the
C3D manual has them, with Kistler's formulas solved.
"""

from dataclasses import dataclass

import numpy as np

from osl_analysis.simulator.crossing import SimulatedCrossing
from osl_analysis.simulator.rigid_body import GRAVITY, Pose, RigidBody, TrueWrench
from osl_analysis.simulator.step import FOOT_WIDTH
from osl_analysis.simulator.walking_settings import Plate, WalkingSettings
from osl_analysis.trial import Array

PLATE_AXES = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass(frozen=True)
class SensorReading:
    """Force [N] and moment about the sensor origin [N*m], shape (n, 3) each, in the plate's moving axes. Signs as Vicon
    Nexus stores them: the reaction on the foot, so that a standing person reads Fz < 0 along z down."""

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


def sensor_reading(reaction: TrueWrench, platform: Pose, plate: Plate, mass: float, rate_hz: float) -> SensorReading:
    """Reading of the sensors under a ground reaction, including the plate's own `mass` [kg] above them. They carry the
    force of the foot and the plate: force F + m (a - g), moment M + dH/dt + r x m (a - g). The zero was set on the
    unloaded plate at rest, in the sensors' axes. The plate's weight therefore appears only when it tilts."""
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


SECOND_FOOT_M = np.array([-0.15, 0.18, 0.0])
"""Place of the other foot's load on the plate's surface, from below the nominal ankle [m]."""
SECOND_FOOT_WIDTH = 0.12  # Width of the other foot's load, a Gaussian curve about mid-stance [phase of stance]


def plate_load(walked: SimulatedCrossing, walking: WalkingSettings) -> TrueWrench:
    """The load on the plate, about the ankle of the foot that walks; shape (n, 3) each."""
    own, change = foot_on_plate(walked), walked.step.change
    if not change.second_foot_percent:
        return own
    place = np.add(walking.plate.centre_m, [*walking.plate.nominal_ankle_m, 0.0]) + SECOND_FOOT_M
    phase = walked.step.stance_phase(walked.time)
    load = np.exp(-(((phase - 0.5) / SECOND_FOOT_WIDTH) ** 2)) * ((phase > 0) & (phase < 1))
    other = load[:, None] * (-0.01 * change.second_foot_percent * walked.step.body_mass * GRAVITY)
    point = walked.motion.platform.pose.point(place)
    moment = own.moment + np.cross(point - own.point, other)
    return TrueWrench(own.force + other, moment, own.point)


def foot_on_plate(walked: SimulatedCrossing) -> TrueWrench:
    """The part of the ground reaction that acts on the plate. The pressure is even over the width of the foot. What is
    beside the plate is carried by the floor, and the middle of the rest is half of that width further inward (to the
    left)."""
    reaction, beside = walked.reaction, 1e-3 * walked.step.change.overhang_mm
    if not beside:
        return reaction
    share = 1.0 - beside / FOOT_WIDTH
    inward = np.array([0.0, 0.5 * beside, 0.0])
    return TrueWrench(share * reaction.force, share * reaction.moment, reaction.point + inward)


MILLI = 1e3
LABELS = {
    1: ("Fx1", "Fy1", "Fz1", "Px1", "Py1", "Tz1"),
    2: ("Fx1", "Fy1", "Fz1", "Mx1", "My1", "Mz1"),
    3: ("fx12", "fx34", "fy14", "fy23", "fz1", "fz2", "fz3", "fz4"),
    4: ("C1", "C2", "C3", "C4", "C5", "C6"),
}
UNITS = {
    1: ("N", "N", "N", "mm", "mm", "Nmm"),
    2: ("N", "N", "N", "Nmm", "Nmm", "Nmm"),
    3: ("N",) * 8,
    4: ("V",) * 6,
}
PRESSURE_FROM_N = 20.0
"""Vertical force from which on a plate of type 1 reports a centre of pressure; below it reports 0."""
VOLTS_PER = np.array([2e-3, 2e-3, 1e-3, 1e-5, 1e-5, 2e-5])
CROSSTALK = 0.01  # Share of each channel of type 4 in the next one


@dataclass(frozen=True)
class PlateChannels:
    """The channels of a plate as the file has them."""

    labels: tuple[str, ...]
    units: tuple[str, ...]
    values: Array  # (n, channels)
    origin: Array  # FORCE_PLATFORM:ORIGIN [m]
    calibration: Array | None  # (6, 6) of type 4, which turns the channels into [N] and [N*mm]


def plate_channels(reading: SensorReading, walking: WalkingSettings) -> PlateChannels:
    """The channels of the plate's type, from its reading [N, N*m] with noise and offset, inside the rails of their
    amplifiers, with the dead ones and the units that the file states."""
    capture, effects, kind = walking.capture, walking.effects, walking.capture.plate_type
    values, origin, calibration = {1: type_1, 2: type_2, 3: type_3, 4: type_4}[kind](reading, walking)
    labels, units = LABELS[kind], UNITS[kind]
    forces = effects.sensor_clip if kind == 3 else effects.force_clip
    rails = {"N": forces.value, "Nmm": MILLI * effects.moment_clip.value}
    limits = np.array([rails.get(unit, 0.0) or np.inf for unit in units])
    limited = np.clip(values, -limits, limits)
    for label, value in capture.dead_channels.items():
        limited[:, labels.index(label)] = value
    stated = tuple(capture.moment_label or unit if unit == "Nmm" else unit for unit in units)
    return PlateChannels(labels, stated, limited, origin, calibration)


def about(point: Array, reading: SensorReading, walking: WalkingSettings) -> Array:
    """Moment [N*m], shape (n, 3), about a point [m] given from the surface's centre along laboratory axes at rest."""
    lever = PLATE_AXES.T @ (sensor_from_centre(walking.plate) - point)
    return reading.moment + np.cross(lever, reading.force)


def type_1(reading: SensorReading, walking: WalkingSettings) -> tuple[Array, Array, Array | None]:
    """Force, centre of pressure on the surface and free moment, as computed by a plate that knows no motion."""
    force, moment = reading.force, about(np.zeros(3), reading, walking)
    loaded = np.abs(force[:, 2]) > PRESSURE_FROM_N
    upward = np.where(loaded, force[:, 2], 1.0)
    x, y = np.where(loaded, [-moment[:, 1] / upward, moment[:, 0] / upward], 0.0)
    free = np.where(loaded, moment[:, 2] - x * force[:, 1] + y * force[:, 0], 0.0)
    return np.column_stack([force, MILLI * x, MILLI * y, MILLI * free]), np.zeros(3), None


def type_2(reading: SensorReading, walking: WalkingSettings) -> tuple[Array, Array, Array | None]:
    """Force and moment about the sensor origin. ORIGIN has the sign of Vicon Nexus: z > 0 for a sensor below the
    surface. The C3D manual defines the opposite vector, and readers reverse it by the sign of z."""
    origin = np.asarray(PLATE_AXES.T @ sensor_from_centre(walking.plate))
    return np.hstack([reading.force, MILLI * reading.moment]), origin, None


def type_3(reading: SensorReading, walking: WalkingSettings) -> tuple[Array, Array, Array | None]:
    """Eight forces of four sensors in the corners (+a, +b), (-a, +b), (-a, -b), (+a, -b), below the surface's centre.
    Statics leave how the horizontal pairs share Mz, and a torsion of the four vertical forces: half each, and none."""
    depth = walking.plate.sensor_depth_m
    a, b = walking.capture.sensor_span_m
    moment = about(np.array([0.0, 0.0, -depth]), reading, walking)
    (x, y, z), (m_x, m_y, m_z) = reading.force.T, moment.T
    channels = [x / 2 - m_z / (4 * b), x / 2 + m_z / (4 * b), y / 2 + m_z / (4 * a), y / 2 - m_z / (4 * a)]
    for right, front in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        channels.append(z / 4 + front * m_x / (4 * b) - right * m_y / (4 * a))
    return np.column_stack(channels), np.array([a, b, -depth]), None


def type_4(reading: SensorReading, walking: WalkingSettings) -> tuple[Array, Array, Array | None]:
    """Voltages with crosstalk, whose calibration matrix gives force [N] and moment [N*mm] about the sensor origin."""
    wrench, origin, _ = type_2(reading, walking)
    scale = np.array([1, 1, 1, MILLI, MILLI, MILLI])
    sensitivity = (np.eye(6) + CROSSTALK * np.eye(6, k=1)) * VOLTS_PER[:, None] * 10 / scale
    return wrench @ sensitivity.T, origin, np.linalg.inv(sensitivity)
