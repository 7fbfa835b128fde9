# SPDX-License-Identifier: Apache-2.0
"""What the recorders of the gait laboratory write: the capture of Vicon (C3D) and the leg's log
(MCAP)."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.base.errors import optional_module
from osl_analysis.base.files import atomic_path
from osl_analysis.base.trial import Array
from osl_analysis.simulator.laboratory_settings import MARKERS, PLATE_CHANNELS
from osl_analysis.simulator.recorder import leg_samples, rounded_to, write_topics
from osl_analysis.simulator.rigid_body import (
    GRAVITY,
    Point,
    Pose,
    TrueWrench,
    interpolated_at,
    support,
)
from osl_analysis.simulator.simulated_crossing import SimulatedCrossing
from osl_analysis.simulator.simulation_settings import SimulationSettings
from osl_analysis.simulator.step import GaitTrial, PlatformMotion

MM = 1e3  # mm in a metre
# axes of C3D force plates: x along laboratory +y, y along +x, z down, turning with the platform
PLATE_AXES = np.diag([1.0, 1.0, -1.0])[[1, 0, 2]]
TEXT_TYPE = -1  # C3D's types are bytes per element, -1 for characters
WHOLE_NUMBER_TYPE = 2
REAL_TYPE = 4


@dataclass(frozen=True)
class Recorders:
    """What the recorders of the laboratory do beyond their imperfections."""

    high: float = 5.0  # [V] of the synchronisation line and the trigger
    trigger_s: float = 0.02  # for which the trigger is high
    # shortest and longest between two changes of the synchronisation line
    sync_interval_s: tuple[float, float] = (0.06, 0.25)
    # in which a marker is occluded, shortest and longest
    short_gap_s: tuple[float, float] = (0.007, 0.04)
    long_gap_s: tuple[float, float] = (0.05, 0.2)
    long_gap_share: float = 0.25  # of all gaps
    # share of a period of the leg's clock that rounding put before the first sample, or after the
    # last
    clock_margin: float = 1e-6


RECORDERS = Recorders()


def write_leg_log(
    folder: Path,
    crossing: SimulatedCrossing,
    clock: tuple[float, float],
    settings: SimulationSettings,
) -> None:
    """Write the leg's log `leg/<trial>.mcap`, sampled at whole periods of its own clock.

    Parameters
    ----------
    folder : Path
        Of the campaign's raw data.
    crossing : SimulatedCrossing
    clock : (float, float)
        Offset [s] and drift: the leg's time is offset + (1 + drift) times Vicon's.
    settings : SimulationSettings
        Effects of encoder and current. Gains and current are held from one update of the controller
        to the next.
    """
    trial = crossing.step.trial
    effects = settings.effects
    rates = trial.walking.rates
    drivetrain = crossing.drivetrain
    offset, drift = clock
    first, last = (offset + (1 + drift) * crossing.time[[0, -1]]) * rates.leg_hz
    margin = RECORDERS.clock_margin
    periods = np.arange(np.ceil(first + margin), np.floor(last - margin) + 1)
    leg_time = periods / rates.leg_hz
    time = (leg_time - offset) / (1 + drift)

    update = np.floor(time * rates.controller_hz).astype(int)
    noise = trial.random("current_noise").standard_normal(len(time))
    current = drivetrain["current"][update] + effects.current_noise.value * noise
    theta = interpolated_at(crossing.motion.theta, rates.motion_hz, time)
    theta_m = interpolated_at(drivetrain["theta_m"], rates.controller_hz, time)
    columns = {
        "joint_angle": rounded_to(theta, trial.walking.effects.leg_joint_encoder.value),
        "actuator_angle": rounded_to(theta_m, effects.actuator_encoder.value),
        "motor_current": rounded_to(current, effects.current_quantisation.value),
        "stiffness_gain": crossing.commands[0, update],
        "damping_gain": crossing.commands[1, update],
        "sync": sync_level(trial, time),
    }
    topic = leg_samples(leg_time, columns)
    write_topics(folder / "leg" / f"{trial.name}.mcap", [topic])


def sync_level(trial: GaitTrial, time: Array) -> Array:
    """Level, 0 or 1, of the synchronisation line at times [s]: an irregular pulse train over the
    duration of a recording, whose pattern does not repeat. It is low before the first pulse."""
    shortest, longest = RECORDERS.sync_interval_s
    duration = trial.walking.gait.recording_s
    intervals = trial.random("sync").uniform(shortest, longest, int(duration / shortest) + 1)
    edges = np.cumsum(intervals)
    changes = np.searchsorted(edges[edges < duration], time, side="right")
    return np.asarray(changes % 2, dtype=float)


def write_capture(
    folder: Path,
    trial: GaitTrial,
    leg: Mapping[str, Array],
    platform: PlatformMotion,
    load: TrueWrench,
) -> None:
    """Write the capture `vicon/<trial>.c3d`.

    It has the paths of the leg's markers and those of the platform, with noise and gaps; the plate
    under its load, synchronisation, and the trigger, high for 20 ms.

    Parameters
    ----------
    folder : Path
        Of the campaign's raw data.
    trial : GaitTrial
    leg : Mapping
        Exact paths (n, 3) [m] of the leg's markers; without any there is no person.
    platform : PlatformMotion
    load : TrueWrench
        On the plate.
    """
    rates = trial.walking.rates
    centre = trial.walking.plate.centre_m
    places = {label: np.add(centre, place) for label, place in MARKERS["platform"].items()}
    markers = {**leg, **on_body(platform.pose, places)}
    stride = rates.motion_hz // rates.points_hz
    exact = np.stack(list(markers.values()), axis=1)[::stride]
    samples = len(exact) * (rates.analogs_hz // rates.points_hz)
    time = np.arange(samples) / rates.analogs_hz

    command = np.inf if platform.command is None else platform.command
    trigger = (time >= command) & (time < command + RECORDERS.trigger_s)
    plate = plate_channels(trial, platform, load, time)
    lines = RECORDERS.high * np.array([sync_level(trial, time), trigger])
    analogs = np.column_stack([plate, *lines])
    write_c3d(
        folder / "vicon" / f"{trial.name}.c3d",
        seen_markers(trial, exact),
        analogs,
        capture_parameters(trial, list(markers)),
    )


def plate_reading(
    trial: GaitTrial, platform: PlatformMotion, load: TrueWrench
) -> tuple[Array, Array]:
    """Find what ideal sensors of the plate read under a load, zeroed at rest: force (n, 3) [N], and
    moment (n, 3) [N*m] about the sensor's origin.

    The plate's signs are as Vicon Nexus stores them: a standing person reads Fz < 0 along z down.
    Its sensors carry the foot and the plate's own mass above them: force F + m (a - g), moment M +
    dH/dt + r x m (a - g).
    """
    plate = trial.walking.plate
    mass = trial.walking.effects.plate_inertia.value
    rate = trial.walking.rates.motion_hz
    axes = platform.pose.rotation @ PLATE_AXES
    sensor = np.add(plate.centre_m, [*plate.sensor_offset_m, -plate.sensor_depth_m])
    origin = platform.pose.point(sensor)
    centre_of_mass = np.add(plate.centre_m, plate.centre_of_mass_m)
    inertial = support(platform.pose, rate, mass, centre_of_mass, plate.gyration_m)

    force = np.einsum("nji,nj->ni", axes, load.force + inertial.force)
    moment_in_laboratory = load.moment_about(origin) + inertial.moment_about(origin)
    moment = np.einsum("nji,nj->ni", axes, moment_in_laboratory)
    force_at_rest = -mass * GRAVITY
    moment_at_rest = np.cross(centre_of_mass - sensor, force_at_rest)
    return force - force_at_rest @ PLATE_AXES, moment - moment_at_rest @ PLATE_AXES


def plate_channels(
    trial: GaitTrial, platform: PlatformMotion, load: TrueWrench, time: Array
) -> Array:
    """The plate's channels (m, 6) at times (m,) [s]: force [N], and moment [N*mm] about the
    sensor's origin, with lag, noise and offset."""
    effects = trial.walking.effects
    true_force, true_moment = plate_reading(trial, platform, load)

    def recorded(name: str, values: Array) -> Array:
        noise = trial.random(f"{name}_noise").standard_normal((len(time), 3))
        offset = trial.random(f"{name}_offset").standard_normal(3)
        noise_sd = getattr(effects, f"{name}_noise").value
        offset_sd = getattr(effects, f"{name}_offset").value
        lag = 1e-3 * effects.plate_lag.value
        late = interpolated_at(values, trial.walking.rates.motion_hz, time - lag)
        return late + noise_sd * noise + offset_sd * offset

    force = recorded("force", true_force)
    moment = recorded("moment", true_moment)
    return np.column_stack([force, MM * moment])


def capture_parameters(trial: GaitTrial, markers: list[str]) -> dict[str, dict[str, Any]]:
    """Groups of parameters of a capture, as Vicon Nexus writes them."""
    plate = trial.walking.plate
    rates = trial.walking.rates
    channels = [*PLATE_CHANNELS, "Sync", "Trigger"]
    half_size = 0.5 * np.array([*plate.size_m, 0.0])
    # corners in C3D's order, in the axes of the plate
    quadrants = np.array([(1, 1, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 0)])
    corners = np.add(plate.centre_m, quadrants @ PLATE_AXES.T * half_size)
    # of the sensor below the surface, z > 0: the sign of Vicon Nexus; that of the C3D manual is the
    # opposite
    origin = PLATE_AXES.T @ [*plate.sensor_offset_m, -plate.sensor_depth_m]
    point_parameters = {
        "LABELS": markers,
        "UNITS": ["mm"],
        "RATE": np.array([float(rates.points_hz)]),
        "Y_SCREEN": ["+Z"],
    }
    analog_parameters = {
        "LABELS": channels,
        "UNITS": [*PLATE_CHANNELS.values(), "V", "V"],
        "RATE": np.array([float(rates.analogs_hz)]),
    }
    plate_parameters = {
        "USED": np.array([1]),
        "TYPE": np.array([2]),
        "ZERO": np.array([1, 0]),
        "CORNERS": corners.T[:, :, None] * MM,
        "ORIGIN": origin[:, None] * MM,
        "CHANNEL": np.arange(1, len(PLATE_CHANNELS) + 1)[:, None],
    }
    return {
        "POINT": point_parameters,
        "ANALOG": analog_parameters,
        "FORCE_PLATFORM": plate_parameters,
    }


def write_c3d(
    path: Path, points: Array, analogs: Array, groups: Mapping[str, Mapping[str, Any]]
) -> None:
    """Write a C3D file; it appears whole or not at all.

    Parameters
    ----------
    path : Path
    points : Array
        Markers (frames, labels, 3) [m], NaN where occluded. An occluded marker is stored as Nexus
        does it: coordinates 0 and residual -1. That of a seen one is 0, because readers disagree
        about the byte of a positive residual.
    analogs : Array
        (samples, channels).
    groups : Mapping
        Parameters by group and name.
    """
    file: Any = optional_module("ezc3d", "the simulator of walking").c3d()
    is_seen = np.isfinite(points).all(axis=2).T
    homogeneous = np.ones((4, *is_seen.shape))
    homogeneous[:3] = np.where(is_seen, points.transpose(2, 1, 0) * MM, 0.0)
    file["data"]["points"] = homogeneous
    file["data"]["analogs"] = analogs.T[None]
    file["data"]["meta_points"] = {
        "residuals": np.where(is_seen, 0.0, -1.0)[None],
        "camera_masks": np.zeros((7, *is_seen.shape), dtype=bool),
    }
    parameters = file["parameters"]
    for group, values in groups.items():
        parameters.create_group_if_needed(group)
        for name, value in values.items():
            # ezc3d's own `add_parameter` makes floats of whole numbers, which other readers refuse
            # in CHANNEL and TYPE
            parameter = parameters[group].get(name, {"description": "", "is_locked": False})
            kind = TEXT_TYPE
            if not isinstance(value, list):
                kind = WHOLE_NUMBER_TYPE if value.dtype.kind == "i" else REAL_TYPE
            parameters[group][name] = {**parameter, "type": kind, "value": value}
    with atomic_path(path) as temporary:
        file.write(str(temporary))


def leg_markers(foot: Pose, shank: Pose) -> dict[str, Array]:
    """Exact paths (n, 3) [m] of the markers that foot and shank always carry."""
    return {**on_body(foot, MARKERS["foot"]), **on_body(shank, MARKERS["shank"])}


def on_body(body: Pose, places: Mapping[str, Point]) -> dict[str, Array]:
    """Exact paths (n, 3) [m] of points given by their places [m] on a body."""
    return {label: body.point(place) for label, place in places.items()}


def seen_markers(trial: GaitTrial, exact: Array) -> Array:
    """Marker positions (frames, labels, 3) [m] with noise, NaN where occluded."""
    effects = trial.walking.effects
    noise = trial.random("marker_noise").standard_normal(exact.shape)
    seen = exact + 1e-3 * effects.marker_noise.value * noise
    random = trial.random("marker_gaps")
    for _ in range(random.poisson(effects.marker_gaps.value)):
        is_long = random.random() < RECORDERS.long_gap_share
        length_s = RECORDERS.long_gap_s if is_long else RECORDERS.short_gap_s
        frames = int(np.ceil(random.uniform(*length_s) * trial.walking.rates.points_hz))
        first = random.integers(len(exact))
        label = random.integers(exact.shape[1])
        seen[first : first + frames, label] = np.nan
    return seen
