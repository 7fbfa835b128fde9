"""The shipped source files fit what the simulator's recorders write, sign and unit included."""

from pathlib import Path

import numpy as np
import pytest

from osl_analysis.ingest.c3d_capture import C3dSource, read_c3d_capture
from osl_analysis.ingest.known_formats import read_source
from osl_analysis.ingest.message_log import McapSource, read_mcap_log
from osl_analysis.simulator.mcap_writer import DYNAMOMETER, LEG, write_mcap
from osl_analysis.simulator.vicon import C3dRecording, RecordedPlate, write_c3d

SOURCES = Path(__file__).parents[1] / "config" / "sources"
TIME = 5.0 + np.arange(200) / 500


def log_source(name: str) -> McapSource:
    source = read_source(SOURCES / f"{name}.yaml")
    assert isinstance(source, McapSource)
    return source


def test_the_dynamometers_log_gives_the_resisting_torque(tmp_path: Path) -> None:
    fields = ("joint_angle", "load_cell_torque", "actuator_angle", "motor_current", "commanded_angle")
    columns = {field: np.float32(np.sin(TIME + i)) for i, field in enumerate(fields)}
    write_mcap(
        tmp_path / "log.mcap",
        DYNAMOMETER,
        TIME,
        columns,
    )
    recording = read_mcap_log(tmp_path / "log.mcap", log_source("dynamometer"))
    mapped = {"theta": 0, "torque": 1, "theta_m": 2, "current": 3, "theta_command": 4}
    for column, field in mapped.items():
        sign = -1 if column == "torque" else 1  # the load cell measures what the joint exerts
        np.testing.assert_array_equal(recording.samples[column], sign * columns[fields[field]].astype(float))
    np.testing.assert_allclose(recording.samples["time"], TIME - TIME[0], atol=1e-9)
    assert recording.warnings == []


def test_the_legs_log_gives_its_signals_gains_and_sync(tmp_path: Path) -> None:
    fields = {
        "joint_angle": "theta",
        "actuator_angle": "theta_m",
        "motor_current": "current",
        "stiffness_gain": "K_1",
        "damping_gain": "B_1",
        "sync": "sync",
    }
    columns = {field: np.float32(np.cos(TIME + i)) for i, field in enumerate(fields)}
    columns["sync"] = np.arange(TIME.size) % 3 == 0
    write_mcap(
        tmp_path / "log.mcap",
        LEG,
        TIME,
        columns,
    )
    recording = read_mcap_log(tmp_path / "log.mcap", log_source("leg"))
    for field, column in fields.items():
        np.testing.assert_array_equal(recording.samples[column], columns[field].astype(float))


def test_vicons_file_gives_markers_the_ground_reaction_and_both_pulses(tmp_path: Path) -> None:
    frames, ratio = 30, 5
    points = np.random.default_rng(0).normal(1.0, 0.2, (frames, 2, 3))
    points[4:7, 1] = np.nan
    corners = np.array([[0.6, 0.5, 0.0], [0.6, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.5, 0.0]])
    foot, force = np.array([0.4, 0.2, 0.0]), np.array([20.0, -30.0, 700.0])
    centre, depth = corners.mean(axis=0), 0.041
    axes = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])  # rows: the plate's x, y and z in the laboratory
    about_sensors = axes @ np.cross(foot - centre + [0, 0, depth], force)
    channels = np.concatenate([axes @ force, about_sensors * 1000, [5.0, 0.0]])
    recording = C3dRecording(
        labels=("FOOT1", "PLAT1"),
        points=points,
        point_rate_hz=300,
        channels=("Fx1", "Fy1", "Fz1", "Mx1", "My1", "Mz1", "Sync", "Trigger"),
        units=("N", "N", "N", "Nmm", "Nmm", "Nmm", "V", "V"),
        analogs=np.tile(channels, (frames * ratio, 1)),
        analog_rate_hz=1500,
        plate=RecordedPlate(corners, np.array([0.0, 0.0, -depth])),
    )
    write_c3d(tmp_path / "a.c3d", recording)
    source = read_source(SOURCES / "vicon.yaml")
    assert isinstance(source, C3dSource)
    samples = read_c3d_capture(tmp_path / "a.c3d", source).samples
    for axis, name in enumerate("xyz"):
        for i, label in enumerate(recording.labels):
            seen = samples[f"marker_{label}_{name}"].drop_nulls().to_numpy()
            np.testing.assert_allclose(seen, points[:, i, axis], atol=1e-6)
        assert samples[f"plate1_force_{name}"][7] == pytest.approx(force[axis], rel=1e-6)
        expected = np.cross(foot - centre, force)[axis]
        assert samples[f"plate1_moment_{name}"][7] == pytest.approx(expected, rel=1e-5, abs=1e-5)
    assert samples["sync"].unique().to_list() == [5.0]
    assert samples["trigger"].unique().to_list() == [0.0]
