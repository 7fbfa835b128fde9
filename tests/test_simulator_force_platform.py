"""What the moving force plate records gives back the torque that the drivetrain made."""

from pathlib import Path
from typing import Any

import ezc3d
import numpy as np
import polars as pl
import pytest
from walking_setup import PERTURBED, STATIC, Setup, load_setup

from osl_analysis.simulator.force_platform import sensor_reading
from osl_analysis.simulator.platform_motion import turned_about, unloaded_platform
from osl_analysis.simulator.rigid_body import Pose, TrueWrench
from osl_analysis.simulator.vicon import FOOT, PLATFORM, SHANK
from osl_analysis.simulator.walking import motion_grid
from osl_analysis.trial import Array

G = 9.81


@pytest.fixture(scope="module")
def setup() -> Setup:
    return load_setup()


def test_a_resting_unloaded_plate_reads_zero(setup: Setup) -> None:
    still, nothing = turned_about(np.zeros(3), np.zeros(300)), np.zeros((300, 3))
    reading = sensor_reading(TrueWrench(nothing, nothing, nothing), still, setup.walking.plate, 12.0, 3000)
    np.testing.assert_allclose(np.hstack([reading.force, reading.moment]), 0, atol=1e-7)


def test_a_moving_plate_reads_its_own_mass_times_acceleration_less_gravity(setup: Setup) -> None:
    """Force m (a - g) of the centre of mass, turned into the plate's axes (y, x, -z) by hand, less the resting one."""
    rate, plate, mass = 3000.0, setup.walking.plate, 12.0
    t = np.arange(1500) / rate
    phi, omega, alpha = 0.05 * np.sin(20 * t), np.cos(20 * t), -20 * np.sin(20 * t)
    pivot = np.array([0.24, 0.25, 0.08])
    nothing = np.zeros((1500, 3))
    reading = sensor_reading(TrueWrench(nothing, nothing, nothing), turned_about(pivot, phi), plate, mass, rate)
    r = np.add(plate.centre_m, plate.centre_of_mass_m) - pivot
    # toes up by phi: x' = x cos - z sin, z' = x sin + z cos
    x, z = r[0] * np.cos(phi) - r[2] * np.sin(phi), r[0] * np.sin(phi) + r[2] * np.cos(phi)
    a_x, a_z = -alpha * z - omega**2 * x, alpha * x - omega**2 * z + G
    along, up = a_x * np.cos(phi) + a_z * np.sin(phi), -a_x * np.sin(phi) + a_z * np.cos(phi)
    np.testing.assert_allclose(reading.force[4:-4, 1], mass * along[4:-4], atol=1e-3)
    np.testing.assert_allclose(reading.force[4:-4, 2], -mass * (up - G)[4:-4], atol=1e-3)
    np.testing.assert_allclose(reading.force[:, 0], 0, atol=1e-9)
    sensor = np.array([*plate.sensor_offset_m, -plate.sensor_depth_m])
    arm = np.array(plate.centre_of_mass_m) - sensor
    about_y = arm[2] * along - arm[0] * (up - G) - plate.gyration_m[1] ** 2 * alpha
    np.testing.assert_allclose(reading.moment[4:-4, 0], mass * about_y[4:-4], atol=1e-3)


def decoded_wrench(file: Any, platform: Pose | None = None) -> tuple[Array, Array, Array]:
    """Ground reaction force [N], moment [N*m] about the plate's centre, and that centre [m], in laboratory axes.

    By the C3D manual: x from corner 2 to 1, y from 4 to 1, z = x cross y; the moment is about the sensor origin, from
    which the centre is -ORIGIN where ORIGIN z > 0 (Nexus). `platform` carries the plate.
    """
    plate = file["parameters"]["FORCE_PLATFORM"]
    corners, origin = plate["CORNERS"]["value"][:, :, 0].T / 1e3, plate["ORIGIN"]["value"][:, 0] / 1e3
    x, y = corners[0] - corners[1], corners[0] - corners[3]
    axes = np.stack([x / np.linalg.norm(x), y / np.linalg.norm(y), np.cross(x, y) / np.linalg.norm(np.cross(x, y))])
    channels = file["data"]["analogs"][0, :6, ::5].T
    force, moment = channels[:, :3], channels[:, 3:] / 1e3
    assert origin[2] > 0
    moment = moment - np.cross(-origin, force)
    force, moment, centre = force @ axes, moment @ axes, np.tile(corners.mean(axis=0), (len(force), 1))
    if platform is not None:
        force = np.einsum("nij,nj->ni", platform.rotation, force)
        moment = np.einsum("nij,nj->ni", platform.rotation, moment)
        centre = platform.point(centre[0])
    return force, moment, centre


def test_standing_reads_as_half_the_weight_above_the_ankle(setup: Setup, tmp_path: Path) -> None:
    setup.ideal().record(tmp_path, STATIC)
    force, moment, centre = decoded_wrench(ezc3d.c3d(str(tmp_path / "vicon/static_1.c3d")))
    np.testing.assert_allclose(force, np.tile([0, 0, 40 * G], (len(force), 1)), atol=1e-3)
    pressure = centre[0] + np.array([-moment[0, 1], moment[0, 0], 0]) / force[0, 2]
    np.testing.assert_allclose(pressure, [0.24, 0.25, 0], atol=1e-5)


def pose_from(markers: Array, local: Array) -> Pose:
    """Least-squares pose of a cluster, shape (n, m, 3) seen and (m, 3) in the body's axes (Kabsch)."""
    centre, middle = markers.mean(axis=1), local.mean(axis=0)
    u, _, vt = np.linalg.svd(np.einsum("nmi,mj->nij", markers - centre[:, None], local - middle))
    flip = np.tile(np.eye(3), (len(markers), 1, 1))
    flip[:, 2, 2] = np.linalg.det(u @ vt)
    rotation = u @ flip @ vt
    return Pose(rotation, centre - rotation @ middle)


@pytest.mark.parametrize("trial", ["walking_01", "walking_02", "walking_03"])
def test_an_exact_analysis_of_the_recording_gives_back_angle_and_torque(
    setup: Setup, tmp_path: Path, trial: str
) -> None:
    """Gait varies, sensors are perfect and nothing but the foot has mass: what remains is rounding to float32."""
    sensors = ("marker_noise", "marker_gaps", "force_noise", "moment_noise", "force_offset", "moment_offset")
    perfect = setup.lacking("plate_inertia", "plate_lag", "foot_inertia", *sensors)
    perfect.record(tmp_path, PERTURBED | {"trial": trial})
    file = ezc3d.c3d(str(tmp_path / f"vicon/{trial}.c3d"))
    labels, points = file["parameters"]["POINT"]["LABELS"]["value"], file["data"]["points"][:3].T / 1e3
    truth = pl.read_parquet(tmp_path / f"truth/{trial}.parquet")[::5]
    bodies = {"FOOT": FOOT, "SHANK": SHANK, "PLAT": PLATFORM}
    seen = {k: points[:, [i for i, name in enumerate(labels) if name.startswith(k)]] for k in bodies}
    foot, shank = (pose_from(seen[k], np.array(list(bodies[k].values()))) for k in ("FOOT", "SHANK"))
    rest = np.array(list(PLATFORM.values())) + setup.walking.plate.centre_m
    force, moment, centre = decoded_wrench(file, pose_from(seen["PLAT"], rest))
    axis, between = foot.rotation[:, :, 1], foot.rotation.transpose(0, 2, 1) @ shank.rotation
    theta = np.arctan2(between[:, 0, 2], between[:, 0, 0])
    torque = -np.einsum("ni,ni->n", moment + np.cross(centre - foot.origin, force), axis)
    np.testing.assert_allclose(theta, truth["theta"], atol=1e-6)
    inside = force[:, 2] > 400
    np.testing.assert_allclose(torque[inside], truth["torque"].to_numpy()[inside], atol=2e-3)
    assert 90 < torque.max() < 150


def test_unloaded_trials_move_the_plate_about_every_axis_now_and_then(setup: Setup) -> None:
    time = motion_grid(setup.walking)
    ramps = [unloaded_platform(time, f"plate_{i:02d}", 1, setup.walking) for i in range(1, 7)]
    spans = np.array([np.ptp(r.pose.point(np.array(setup.walking.plate.centre_m)), axis=0) for r in ramps])
    rolls = np.array([np.ptp(r.pose.rotation[:, 2, 1]) for r in ramps])
    assert (rolls > 0.02).tolist() == [False, False, True, False, False, True]
    assert (spans[[2, 5]] > 5e-3).all()
    tops = np.degrees([r.angle.max() for r in ramps])
    assert len(set(tops.round(3))) == 6
    assert tops.min() > 4
    assert tops.max() < 6
    assert all(abs(r.angle[-1]) < 1e-9 and abs(r.angle[0]) < 1e-9 for r in ramps)
