"""Force plates: the wrench that acts on the foot comes back, whatever the plate's type, pose and file."""

import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import yaml
from c3d_builder import REAL_DATA, write_c3d

from osl_analysis.errors import InputError
from osl_analysis.formats.c3d import read_c3d
from osl_analysis.ingest.c3d_capture import C3dSource, plates_of, read_c3d_capture
from osl_analysis.ingest.plates import ForcePlate

REFERENCE = REAL_DATA / "reference" / "force_plate.csv"
ROWS = pl.read_csv(REFERENCE) if REFERENCE.exists() else pl.DataFrame({"file": [], "plate": []})
PLATES = sorted(set(zip(ROWS["file"], ROWS["plate"], strict=True)))
RANDOM = np.random.default_rng(3)
FORCE = RANDOM.normal(0, 300, (20, 3))
MOMENT = RANDOM.normal(0, 40, (20, 3))
HALF_LENGTH, HALF_WIDTH = 0.3, 0.2


def rotation(angles: np.ndarray) -> np.ndarray:
    """Any rotation, from three angles about x, y and z."""
    (a, b, c), (s, t, u) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, a, -s], [0, s, a]])
    about_y = np.array([[b, 0, t], [0, 1, 0], [-t, 0, b]])
    about_z = np.array([[c, -u, 0], [u, c, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def placed_corners(axes: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Corners in the quadrants (+, +), (-, +), (-, -), (+, -) of the plate's axes, in the laboratory."""
    signs = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    return centre + (signs * [HALF_LENGTH, HALF_WIDTH, 0]) @ axes.T


AXES = rotation(np.array([np.pi - 0.1, 0.2, 0.7]))  # z down, tilted and turned
CENTRE = np.array([1.0, -2.0, 0.3])
CORNERS = placed_corners(AXES, CENTRE)
IN_PLATE = FORCE @ AXES, MOMENT @ AXES
SURFACE = np.array([0.004, -0.007, -0.045])  # from the plate's origin to the centre of its surface, plate axes


def about_origin(force: np.ndarray, moment: np.ndarray, surface: np.ndarray) -> np.ndarray:
    """Moment about the plate's origin of a wrench given about the surface's centre: M + r x F."""
    return moment + np.cross(surface, force)


def assert_wrench(plate: ForcePlate, channels: np.ndarray) -> None:
    force, moment = plate.wrench(channels)
    np.testing.assert_allclose(force, FORCE, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(moment, MOMENT, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("stored", [1, -1], ids=["as the manual", "the other way"])
def test_type_2_gives_the_wrench_back_whichever_way_origin_points(stored: int) -> None:
    force, moment = IN_PLATE
    channels = np.hstack([force, about_origin(force, moment, SURFACE)])
    assert_wrench(ForcePlate(1, 2, CORNERS, stored * SURFACE), channels)


def test_type_4_gives_the_wrench_back_through_its_calibration() -> None:
    force, moment = IN_PLATE
    calibration = RANDOM.normal(size=(6, 6)) + 5 * np.eye(6)
    outputs = np.hstack([force, about_origin(force, moment, SURFACE)])
    channels = np.linalg.solve(calibration, outputs.T).T
    assert_wrench(ForcePlate(1, 4, CORNERS, SURFACE, calibration), channels)


@pytest.mark.parametrize("depth_sign", [1, -1])
def test_type_3_gives_the_wrench_of_its_four_sensors_back(depth_sign: int) -> None:
    a, b, depth = 0.12, 0.2, 0.054
    sensors = np.array([[a, b, depth], [-a, b, depth], [-a, -b, depth], [a, -b, depth]])  # z down: under the surface
    forces = RANDOM.normal(0, 100, (20, 4, 3))
    total, moment = forces.sum(axis=1), np.cross(sensors, forces).sum(axis=1)
    x, y, z = forces.transpose(2, 1, 0)
    channels = np.column_stack([x[0] + x[1], x[2] + x[3], y[0] + y[3], y[1] + y[2], *z])
    found = ForcePlate(1, 3, CORNERS, np.array([a, b, depth_sign * depth])).wrench(channels)
    np.testing.assert_allclose(found[0], total @ AXES.T, atol=1e-9)
    np.testing.assert_allclose(found[1], moment @ AXES.T, atol=1e-9)


def test_type_1_gives_force_pressure_point_and_free_moment_back() -> None:
    force, _ = IN_PLATE
    pressure, free = RANDOM.normal(0, 0.1, (20, 2)), RANDOM.normal(0, 5, 20)
    arm = np.column_stack([pressure, np.zeros(20)])
    moment = np.cross(arm, force) + np.outer(free, [0, 0, 1])
    found = ForcePlate(1, 1, CORNERS, np.zeros(3)).wrench(np.column_stack([force, pressure, free]))
    np.testing.assert_allclose(found[0], FORCE, atol=1e-9)
    np.testing.assert_allclose(found[1], moment @ AXES.T, atol=1e-9)


def test_a_weight_on_a_level_plate_pushes_back_up_and_turns_about_the_centre() -> None:
    corners = np.array([[0.6, 0.0, 0], [0.0, 0.0, 0], [0.0, 0.4, 0], [0.6, 0.4, 0]])  # z down, centre (0.3, 0.2, 0)
    fz, x, y = -700.0, 0.1, 0.05  # what Nexus stores under 700 N, 0.1 m along plate x and 0.05 m along plate y
    channels = np.array([[0, 0, fz, y * fz, -x * fz, 0]])
    force, moment = ForcePlate(1, 2, corners, np.zeros(3)).wrench(channels)
    np.testing.assert_allclose(force, [[0, 0, 700]], atol=1e-12)
    foot = np.array([0.3 + 0.1, 0.2 - 0.05, 0.0])  # plate y is the laboratory's -y
    np.testing.assert_allclose(moment, np.cross(foot - [0.3, 0.2, 0], force), atol=1e-12)


@pytest.mark.parametrize("turn", [1, 2, 3])
def test_the_corners_order_names_the_plates_axes_and_nothing_else(turn: int) -> None:
    quarter = rotation(np.array([0, 0, turn * np.pi / 2]))
    axes = AXES @ quarter
    force, moment = FORCE @ axes, MOMENT @ axes
    corners = np.roll(CORNERS, -turn, axis=0)  # the corner in the new first quadrant comes first
    assert_wrench(ForcePlate(1, 2, corners, np.zeros(3)), np.hstack([force, moment]))


@pytest.mark.parametrize(("kind", "channels"), [(1, 6), (2, 6), (3, 8), (4, 6)])
def test_an_unloaded_plate_reads_zero(kind: int, channels: int) -> None:
    plate = ForcePlate(1, kind, CORNERS, np.array([0.1, 0.2, -0.04]), np.eye(6))
    for part in plate.wrench(np.zeros((3, channels))):
        np.testing.assert_array_equal(part, 0)


@pytest.mark.parametrize(
    ("kind", "corners", "origin", "problem"),
    [
        (5, CORNERS, SURFACE, "plate 7 is of type 5; types 1 to 4 are read"),
        (2, np.zeros((4, 3)), SURFACE, "plate 7: its corners span no plane"),
        (3, CORNERS, np.zeros(3), "plate 7 of type 3 has ORIGIN"),
        (4, CORNERS, SURFACE, "plate 7 of type 4 has no FORCE_PLATFORM:CAL_MATRIX"),
    ],
)
def test_a_plate_that_cannot_be_computed_is_refused(
    kind: int, corners: np.ndarray, origin: np.ndarray, problem: str
) -> None:
    with pytest.raises(InputError, match=problem):
        ForcePlate(7, kind, corners, origin)


@pytest.mark.skipif(not PLATES, reason="real data are not here")
@pytest.mark.parametrize(("file", "plate"), PLATES, ids=lambda value: str(value).split(".")[0])
def test_real_plates_give_the_reference_wrench(file: str, plate: int) -> None:
    recording = read_c3d(REAL_DATA / "c3d" / file)
    geometry, channels = plates_of(recording, C3dSource(format="c3d", plates=(plate + 1,)))[0]
    force, moment = geometry.wrench(channels)
    for row in ROWS.filter((pl.col("file") == file) & (pl.col("plate") == plate)).iter_rows(named=True):
        sample = row["analog_sample"]
        expected_force = [row["Fx"], row["Fy"], row["Fz"]]
        expected_moment = np.array([row["M_centre_x"], row["M_centre_y"], row["M_centre_z"]]) / 1000  # N*mm
        np.testing.assert_allclose(force[sample], expected_force, rtol=1e-5)
        np.testing.assert_allclose(moment[sample], expected_moment, rtol=1e-5)


def plate_file(path: Path, **parameters: object) -> Path:
    """Six channels N, N, N, Nmm, Nmm, Nmm on one level type 2 plate, z down; forces 1 to 3, moments 4000 to 6000."""
    raw = np.array([[1.0, 2, 3, 4000, 5000, 6000]] * 8)
    corners = np.array([[600.0, 0, 0], [0, 0, 0], [0, 400, 0], [600, 400, 0]])
    known = {
        "ANALOG__UNITS": ["N", "N", "N", "Nmm", "Nmm", "Nmm"],
        "FORCE_PLATFORM__USED": np.array([1]),
        "FORCE_PLATFORM__TYPE": np.array([2]),
        "FORCE_PLATFORM__CORNERS": corners.T[:, :, None],
        "FORCE_PLATFORM__ORIGIN": np.zeros((3, 1)),
        "FORCE_PLATFORM__CHANNEL": np.arange(1, 7)[:, None],
    }
    return write_c3d(path, np.ones((2, 1, 4)), raw, **{**known, **parameters})


def wrench_of(path: Path, **fields: object) -> list[float]:
    samples = read_c3d_capture(path, C3dSource(format="c3d", **fields)).samples
    return [samples[f"plate1_{q}_{axis}"][3] for q in ("force", "moment") for axis in "xyz"]


def test_columns_and_geometry_of_a_plate_are_in_si_units_and_laboratory_axes(tmp_path: Path) -> None:
    path = plate_file(tmp_path / "a.c3d")
    assert wrench_of(path) == pytest.approx([1, -2, -3, 4, -5, -6], rel=1e-12)
    expected = {
        "xyz": [[0.6, 0, 0], [0, 0, 0], [0, 0.4, 0], [0.6, 0.4, 0]],
        "x-zy": [[0.6, 0, 0], [0, 0, 0], [0, 0, 0.4], [0.6, 0, 0.4]],
    }
    for axes, corners in expected.items():
        source = C3dSource(format="c3d", axes=tuple(re.findall("-?[xyz]", axes)))
        (plate,) = read_c3d_capture(path, source).facts["plates"]
        assert (plate["plate"], plate["type"]) == (1, 2)
        np.testing.assert_allclose(plate["corners"], corners, atol=1e-12)


def test_a_plate_that_the_file_lacks_or_describes_wrongly_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no force plate 2; the file has 1, counted from 1"):
        wrench_of(plate_file(tmp_path / "a.c3d"), plates=[2])
    path = plate_file(tmp_path / "a.c3d", FORCE_PLATFORM__CORNERS=np.zeros((3, 3, 1)))
    with pytest.raises(InputError, match=r"plate 1: FORCE_PLATFORM:CORNERS has dimensions \(3, 3, 1\)"):
        wrench_of(path)


def test_plate_units_of_the_source_file_override_the_files(tmp_path: Path) -> None:
    path = plate_file(tmp_path / "a.c3d", ANALOG__UNITS=["V"] * 6)
    with pytest.raises(InputError, match=r"a.c3d: analog channel 1: unit 'V' measures \[V\], expected one of N"):
        wrench_of(path)
    assert wrench_of(path, plate_units={"force": "kN", "moment": "Nm"}) == pytest.approx(
        [1000, -2000, -3000, 4000, -5000, -6000]
    )


def test_a_type_1_plate_takes_the_stated_unit_of_its_pressure_centre(tmp_path: Path) -> None:
    path = plate_file(tmp_path / "a.c3d", ANALOG__UNITS=["V"] * 6, FORCE_PLATFORM__TYPE=np.array([1]))
    with pytest.raises(InputError, match=r"`plate_units: \{force: N, moment: N\*mm, length: mm\}`, in the source file"):
        wrench_of(path, plate_units={"force": "N", "moment": "N*m"})
    forward = np.add(np.cross([4e6, 5e6, 0], [1, 2, 3]), [0, 0, 6000])  # pressure in km, the plate's z points down
    stated = wrench_of(path, plate_units={"force": "N", "moment": "N*m", "length": "km"})
    assert stated == pytest.approx([1, -2, -3, forward[0], -forward[1], -forward[2]])


@pytest.mark.parametrize("unit", ["V", "N"])
def test_a_type_1_plate_is_read_with_the_units_that_its_refusal_says(tmp_path: Path, unit: str) -> None:
    path = plate_file(tmp_path / "a.c3d", ANALOG__UNITS=[unit] * 6, FORCE_PLATFORM__TYPE=np.array([1]))
    with pytest.raises(InputError) as caught:
        wrench_of(path)
    advised = re.findall(r"`plate_units: (\{.*\})`", str(caught.value))
    stated = wrench_of(path, plate_units=yaml.safe_load(advised[0]))
    moment = np.add(np.cross([4, 5, 0], [1, 2, 3]), [0, 0, 6])  # pressure 4000, 5000 mm, torque 6000 N*mm
    assert stated == pytest.approx([1, -2, -3, moment[0], -moment[1], -moment[2]])


@pytest.mark.parametrize("store", ["BYCOLUMN", "BYROW"])
def test_a_calibration_matrix_is_read_in_the_order_that_the_file_names(tmp_path: Path, store: str) -> None:
    matrix = np.eye(6)
    matrix[0, 1] = 10.0  # Fx = c1 + 10 c2
    stored = matrix.T if store == "BYROW" else matrix
    parameters = {
        "FORCE_PLATFORM__TYPE": np.array([4]),
        "FORCE_PLATFORM__CAL_MATRIX": stored[:, :, None],
        "FORCE_PLATFORM__MATRIX_STORE": [store],
    }
    path = plate_file(tmp_path / "a.c3d", **parameters)
    assert wrench_of(path) == pytest.approx([21, -2, -3, 4, -5, -6], rel=1e-6)


def test_a_plate_whose_channels_are_not_in_the_file_is_refused_and_can_be_left_out(tmp_path: Path) -> None:
    path = plate_file(tmp_path / "a.c3d", FORCE_PLATFORM__CHANNEL=np.arange(3, 9)[:, None])
    with pytest.raises(InputError, match=r"plate 1 of type 2 needs 6 channels.* leave this plate out: `plates: none`"):
        wrench_of(path)
    assert read_c3d_capture(path, C3dSource(format="c3d", plates="none")).facts["plates"] == []


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("biogesta_s30_admarche2.c3d", "plate 1 of type 3 has ORIGIN"),
        ("vicon_shd01_unsigned_offsets_missing_plate2.c3d", "plate 2 of type 4 needs 6 channels"),
    ],
)
def test_a_real_plate_that_cannot_be_computed_is_refused(name: str, problem: str) -> None:
    path = REAL_DATA / "c3d" / name
    if not path.exists():
        pytest.skip("real data are not here")
    with pytest.raises(InputError, match=problem):
        read_c3d_capture(path, C3dSource(format="c3d"))
