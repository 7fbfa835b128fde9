"""What the moving force plate records gives back the torque that the drivetrain made."""

from pathlib import Path

import ezc3d
import numpy as np
import polars as pl
import pytest
from decoded_capture import decoded_crossing, decoded_wrench
from walking_setup import PERTURBED, STATIC, Setup, load_setup

from osl_analysis.simulator.plate import sensor_reading
from osl_analysis.simulator.platform import turned_about, unloaded_platform
from osl_analysis.simulator.rigid_body import TrueWrench
from osl_analysis.simulator.walking import motion_grid

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


def test_standing_reads_as_half_the_weight_above_the_ankle(setup: Setup, tmp_path: Path) -> None:
    setup.ideal().record(tmp_path, STATIC)
    force, moment, centre = decoded_wrench(ezc3d.c3d(str(tmp_path / "vicon/static_1.c3d")))
    np.testing.assert_allclose(force, np.tile([0, 0, 40 * G], (len(force), 1)), atol=1e-3)
    pressure = centre[0] + np.array([-moment[0, 1], moment[0, 0], 0]) / force[0, 2]
    np.testing.assert_allclose(pressure, [0.24, 0.25, 0], atol=1e-5)


@pytest.mark.parametrize("trial", ["walking_01", "walking_02", "walking_03"])
def test_an_exact_analysis_of_the_recording_gives_back_angle_and_torque(
    setup: Setup, tmp_path: Path, trial: str
) -> None:
    """Gait varies, sensors are perfect and nothing but the foot has mass: what remains is rounding to float32."""
    sensors = ("marker_noise", "marker_gaps", "force_noise", "moment_noise", "force_offset", "moment_offset")
    perfect = setup.lacking("plate_inertia", "plate_lag", "foot_inertia", *sensors)
    perfect.record(tmp_path, PERTURBED | {"trial": trial})
    seen = decoded_crossing(tmp_path / f"vicon/{trial}.c3d")
    truth = pl.read_parquet(tmp_path / f"truth/{trial}.parquet")[::5]
    np.testing.assert_allclose(seen.theta, truth["theta"], atol=1e-6)
    inside = seen.force[:, 2] > 400
    np.testing.assert_allclose(seen.torque[inside], truth["torque"].to_numpy()[inside], atol=2e-3)
    assert 90 < seen.torque.max() < 150


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
