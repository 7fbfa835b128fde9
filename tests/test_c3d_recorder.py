"""A recording goes through the C3D file unharmed, for an independent reader, and looks like Vicon Nexus's."""

from dataclasses import replace
from pathlib import Path

import ezc3d
import numpy as np
import pytest

from osl_analysis.simulator.vicon import C3dRecording, write_c3d

FLOAT32 = 1.2e-7
REAL = Path(__file__).parents[2] / "shared" / "real_data" / "c3d" / "btk_PiG_Motion3_FF.c3d"
CORNERS = np.array([[0.6, 0.5, 0.01], [0.6, 0.0, 0.01], [0.0, 0.0, 0.01], [0.0, 0.5, 0.01]])
ORIGIN = np.array([-0.0009, 0.0006, 0.041])


@pytest.fixture
def recording() -> C3dRecording:
    random = np.random.default_rng(3)
    points = random.normal(size=(40, 3, 3))
    points[10:14, 1] = np.nan
    return C3dRecording(
        labels=("FOOT1", "FOOT2", "PLAT1"),
        points=points,
        point_rate_hz=300,
        channels=("Fx1", "Fy1", "Fz1", "Mx1", "My1", "Mz1", "Sync"),
        units=("N", "N", "N", "Nmm", "Nmm", "Nmm", "V"),
        analogs=random.normal(size=(200, 7)) * [1e2, 1e2, 1e3, 1e5, 1e5, 1e4, 5],
        analog_rate_hz=1500,
        corners=CORNERS,
        origin=ORIGIN,
    )


@pytest.fixture
def file(recording: C3dRecording, tmp_path: Path) -> Path:
    path = tmp_path / "vicon" / "trial.c3d"
    write_c3d(path, recording)
    return path


def test_ezc3d_reads_back_what_was_recorded(recording: C3dRecording, file: Path) -> None:
    read = ezc3d.c3d(str(file))
    points = read["data"]["points"][:3].transpose(2, 1, 0)
    np.testing.assert_allclose(points, recording.points * 1e3, rtol=FLOAT32, equal_nan=True)
    np.testing.assert_allclose(read["data"]["analogs"][0].T, recording.analogs, rtol=FLOAT32)
    group = read["parameters"]
    assert group["POINT"]["LABELS"]["value"] == list(recording.labels)
    assert group["ANALOG"]["LABELS"]["value"] == list(recording.channels)
    assert group["ANALOG"]["UNITS"]["value"] == list(recording.units)
    assert (group["POINT"]["RATE"]["value"][0], group["ANALOG"]["RATE"]["value"][0]) == (300, 1500)
    assert (group["POINT"]["UNITS"]["value"][0], group["POINT"]["FRAMES"]["value"][0]) == ("mm", 40)


def test_a_hidden_marker_is_stored_as_zeros_with_residual_minus_one(recording: C3dRecording, file: Path) -> None:
    raw = file.read_bytes()
    header = np.frombuffer(raw[:512], "<i2")
    per_frame = 4 * int(header[1]) + int(header[2])
    start = (int(header[8]) - 1) * 512
    words = np.frombuffer(raw[start : start + 4 * 40 * per_frame], "<f4").reshape(40, per_frame)
    stored = words[:, :12].reshape(40, 3, 4)
    assert np.frombuffer(raw[12:16], "<f4")[0] < 0, "a negative POINT:SCALE is what marks floats"
    assert (stored[10:14, 1] == [0, 0, 0, -1]).all()
    assert (stored[[9, 14], 1, 3] >= 0).all()


def test_a_recording_that_cannot_be_stored_leaves_the_old_file_and_no_other(
    recording: C3dRecording, file: Path
) -> None:
    before = file.read_bytes()
    with pytest.raises(ValueError, match="analog rate"):
        write_c3d(file, replace(recording, analogs=recording.analogs[:-3]))
    assert file.read_bytes() == before
    assert [f.name for f in file.parent.iterdir()] == ["trial.c3d"]


@pytest.mark.skipif(not REAL.exists(), reason="public sample recordings are not on this machine")
def test_every_force_plate_parameter_of_a_nexus_file_is_there_with_its_type_and_sign(file: Path) -> None:
    ours, nexus = (ezc3d.c3d(str(f))["parameters"]["FORCE_PLATFORM"] for f in (file, REAL))
    for name in set(nexus) - {"__METADATA__"}:
        assert ours[name]["type"] == nexus[name]["type"], name
    assert np.sign(ours["ORIGIN"]["value"][2, 0]) == np.sign(nexus["ORIGIN"]["value"][2, 0])
