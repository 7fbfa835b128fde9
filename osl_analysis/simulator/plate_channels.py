"""The analog channels of a force plate of types 1 to 4, with their faults (C3D manual, Kistler's formulas solved)."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.simulator.capture_settings import CaptureSettings
from osl_analysis.simulator.force_platform import PLATE_AXES, SensorReading, c3d_origin, sensor_from_centre
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.trial import Array

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
CROSSTALK = 0.01
"""Share of each channel of type 4 in the next one."""


@dataclass(frozen=True)
class PlateChannels:
    """The channels of a plate as the file has them.

    values: shape (n, channels), in `units`; origin [m]: FORCE_PLATFORM:ORIGIN; calibration: (6, 6) of type 4, which
    turns the channels into [N] and [N*mm], or None.
    """

    labels: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    origin: Array
    calibration: Array | None


def plate_channels(reading: SensorReading, walking: WalkingSettings) -> PlateChannels:
    """The channels of the plate's type, from its reading [N, N*m] with noise and offset, and their faults."""
    capture, kind = walking.capture, walking.capture.plate_type
    values, origin, calibration = {1: type_1, 2: type_2, 3: type_3, 4: type_4}[kind](reading, walking)
    labels, units = LABELS[kind], UNITS[kind]
    limited = clipped(values, units, walking)
    for label, value in capture.dead_channels.items():
        limited[:, labels.index(label)] = value
    return PlateChannels(labels, stated(units, capture), limited, origin, calibration)


def clipped(values: Array, units: tuple[str, ...], walking: WalkingSettings) -> Array:
    """The channels inside the rails of their amplifiers; the force's rails are those of the sensors of type 3."""
    effects, kind = walking.effects, walking.capture.plate_type
    forces = effects.sensor_clip if kind == 3 else effects.force_clip
    rails = {"N": forces.value, "Nmm": MILLI * effects.moment_clip.value}
    limits = np.array([rails.get(unit, 0.0) or np.inf for unit in units])
    return np.clip(values, -limits, limits)


def stated(units: tuple[str, ...], capture: CaptureSettings) -> tuple[str, ...]:
    """The units that the file states."""
    return tuple(capture.moment_label or unit if unit == "Nmm" else unit for unit in units)


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
    """Force and moment about the sensor origin."""
    return np.hstack([reading.force, MILLI * reading.moment]), c3d_origin(walking.plate), None


def type_3(reading: SensorReading, walking: WalkingSettings) -> tuple[Array, Array, Array | None]:
    """Eight forces of four sensors in the corners (+a, +b), (-a, +b), (-a, -b), (+a, -b), below the surface's centre.

    Statics leave how the horizontal pairs share Mz, and a torsion of the four vertical forces: half each, and none.
    """
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
