"""C3D, of others too, and exports of Nexus: what the file means comes out; what cannot be trusted
is refused."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import yaml
from c3d_builder import REAL_DATA, write_c3d
from recognised_files import refusal_by
from scipy.spatial.transform import Rotation

from osl_analysis import formats
from osl_analysis.draft.overview import inspect_recording
from osl_analysis.errors import InputError
from osl_analysis.formats import known_formats
from osl_analysis.ingest.conversion import Converted
from osl_analysis.ingest.force_plates import convert_plate, wrench
from osl_analysis.ingest.raw_files import read_converted, read_source
from osl_analysis.source_file import Source


def source(**fields: object) -> Source:
    return known_formats()["c3d"].source.model_validate({"format": "c3d", **fields})


def read(path: Path, **fields: object) -> Converted:
    return read_converted(path, source(**fields))


def points(frames: int = 6, count: int = 3) -> np.ndarray:
    """Whole numbers, all different, none zero, residual 0."""
    values = np.arange(1, frames * count * 4 + 1, dtype=float).reshape(frames, count, 4)
    values[:, :, 3] = 0.0
    return values


def analogs(samples: int = 24, channels: int = 2) -> np.ndarray:
    return np.arange(samples * channels, dtype=float).reshape(samples, channels) - 7.0


def refused(path: Path, **fields: object) -> str:
    return refusal_by(read, path, **fields)


def test_points_analogs_and_time_are_those_of_the_file(tmp_path: Path) -> None:
    path = write_c3d(
        tmp_path / "a.c3d", points(), analogs(), rate=100.0, PROCESSING__BODYMASS=np.array([72.5])
    )
    path.write_bytes(path.read_bytes()[:6] + b"\5\0\n\0" + path.read_bytes()[10:])  # frames 5 to 10
    samples, facts = (
        (recording := read(path, analogs={"sync": {"channel": "A2"}})).samples,
        recording.facts,
    )
    assert [facts[name] for name in ("body_mass_kg", "first_frame", "samples_per_frame")] == [
        72.5,
        5,
        4,
    ]
    markers = samples.select("time", pl.col("^marker_.*$")).drop_nulls()
    np.testing.assert_allclose(markers["time"], np.arange(6) / 100, rtol=1e-15)
    np.testing.assert_allclose(
        markers.drop("time").to_numpy().reshape(6, 3, 3), points()[:, :, :3] / 1000, rtol=1e-15
    )
    np.testing.assert_allclose(samples["time"], np.arange(24) / 400, rtol=1e-15)
    np.testing.assert_array_equal(samples["sync"], analogs()[:, 1])
    assert inspect_recording(path).channels[-1].note == "from -6 to 40"
    alone = read(path).samples
    assert (len(alone), alone.null_count().sum_horizontal()[0]) == (6, 0)  # a row per frame


def test_a_point_with_negative_residual_or_at_the_exact_origin_was_not_seen(tmp_path: Path) -> None:
    raw = points()
    raw[1, 0, 3], raw[2, 0, :3], raw[3, 0, 2], raw[4, 0, 0] = -1.0, 0.0, 0.0, np.inf
    samples = read(write_c3d(tmp_path / "a.c3d", raw)).samples
    assert samples["marker_M1_z"].is_nan().to_list() == [False, True, True, False, True, False]
    assert not samples["marker_M2_x"].is_nan().any()


def test_a_unit_that_is_unknown_or_missing_is_refused_unless_the_source_states_it(
    tmp_path: Path,
) -> None:
    for unit, problem in (("mmm", "unit 'mmm' is unknown"), ("", "the unit is empty")):
        path = write_c3d(tmp_path / "a.c3d", points(), POINT__UNITS=[unit])
        assert problem in refused(path)
        np.testing.assert_allclose(
            read(path, point_unit="cm").samples["marker_M1_x"], points()[:, 0, 0] / 100
        )
    path = write_c3d(tmp_path / "a.c3d", points(), analogs(), ANALOG__UNITS=["mV", "volt?"])
    assert "unit 'volt?' is unknown" in refused(path, analogs={"sync": {"channel": "A2"}})
    stated = {"channel": "A2", "unit": "V", "sign": -1}
    for channel, expected in (
        ({"channel": "A1"}, analogs()[:, 0] / 1000),
        (stated, -analogs()[:, 1]),
    ):
        np.testing.assert_allclose(
            read(path, analogs={"sync": channel}).samples["sync"], expected, rtol=1e-15
        )


def test_a_name_that_the_file_lacks_has_twice_or_a_unit_that_cannot_be_is_refused(
    tmp_path: Path,
) -> None:
    path = write_c3d(tmp_path / "a.c3d", points(), analogs(), ANALOG__UNITS=["N", "N"])
    for stated, told in (
        ({"markers": ["M1", "TOE"]}, "no marker 'TOE'; the file has M1, M2, M3"),
        ({"analogs": {"sync": {"channel": "Sync"}}},
         "no analog channel 'Sync'; the file has A1, A2"),
        ({"analogs": {"sync": {"channel": "a1"}}}, "; did you mean 'A1'?"),
        ({"analogs": {"sync": {"channel": "A1"}}}, "sync: unit 'N' measures [N]"),
    ):  # fmt: skip
        assert told in refused(path, **stated)


@pytest.mark.parametrize(
    ("labels", "names"),
    [
        (["P07:RANK", "P07:LANK", "*3"], ["RANK", "LANK"]),
        (["P07:RANK", "P08:RANK", "P08:LANK"], ["P07:RANK", "P08:RANK", "LANK"]),
        (["P07:RANK", "plate:P00", "M3"], ["RANK", "P00", "M3"]),
        (["P07:RANK", "RANK", "M3"], ["P07:RANK", "RANK", "M3"]),
    ],
)
def test_the_subject_of_markers_is_left_out_where_there_is_one(
    tmp_path: Path, labels: list[str], names: list[str]
) -> None:
    path = write_c3d(tmp_path / "a.c3d", points(), POINT__LABELS=labels)

    columns = read(path).samples.columns

    assert [name for name in columns if name.endswith("_x")] == [f"marker_{n}_x" for n in names]


def test_a_marker_of_a_name_used_twice_is_read_by_its_number(
    tmp_path: Path,
) -> None:
    path = write_c3d(tmp_path / "a.c3d", points(), POINT__LABELS=["TOE", "HEEL", "TOE"])

    for fields in ({}, {"markers": ["HEEL", "TOE"]}):
        assert "1, 3" in refused(path, **fields)
    samples = read(path, markers=["HEEL", "3"]).samples

    np.testing.assert_allclose(samples["marker_TOE_x"], points()[:, 2, 0] / 1000)


def test_a_pulse_whose_last_sample_was_not_recorded_is_read_without_its_last_frame(
    tmp_path: Path,
) -> None:
    recorded = analogs() + 1.0
    recorded[-1] = 0.0
    path = write_c3d(tmp_path / "a.c3d", points(), recorded)

    converted = read(path, analogs={"sync": {"channel": "A1"}})

    np.testing.assert_allclose(converted.samples["sync"], recorded[:-4, 0], rtol=1e-6)
    assert "were not recorded" in converted.warnings[0]


def test_one_of_two_analog_channels_of_one_name_is_read_by_its_number(tmp_path: Path) -> None:
    path = write_c3d(tmp_path / "a.c3d", points(), analogs(), ANALOG__LABELS=["Sync", "Sync"])

    told = refused(path, analogs={"sync": {"channel": "Sync"}})
    samples = read(path, analogs={"sync": {"channel": "2"}}).samples

    assert "one of 1, 2," in told
    np.testing.assert_allclose(samples["sync"], analogs()[:, 1])


def test_model_outputs_take_unit_and_sign_from_the_source_file(tmp_path: Path) -> None:
    groups = {
        "POINT__TYPE_GROUPS": ["POWERS", "POWER", "Moments", "MOMENT"],
        "POINT__MOMENTS": ["LAnkleMoment"],
    }
    path = write_c3d(
        tmp_path / "a.c3d", points(), POINT__LABELS=["LTOE", "LAnkleMoment", "*3"], **groups
    )
    output = {"label": "LAnkleMoment", "component": "y", "unit": "N*mm/kg", "sign": -1}
    recording = read(path, outputs={"reference_ankle_moment_left": output})
    np.testing.assert_allclose(
        recording.samples["reference_ankle_moment_left"], -points()[:, 1, 1] / 1000, rtol=1e-15
    )
    markers = {name for name in recording.samples.columns if name.startswith("marker")}
    assert markers == {"marker_LTOE_x", "marker_LTOE_y", "marker_LTOE_z"}
    assert [one.kind for one in inspect_recording(path).channels] == [
        "marker",
        "model output",
        "marker",
    ]


def test_an_absurd_header_a_pointer_past_a_record_or_other_counts_are_refused(
    tmp_path: Path,
) -> None:
    """A parameter's pointer stands behind its name."""
    path = write_c3d(
        tmp_path / "a.c3d", points(), analogs(), LAST__WORD=["XXXX"], LAST__MORE=["YYYY"]
    )
    at = (whole := path.read_bytes()).index(b"RATE", 512)
    for place, value, problem in (
        (16, b"\0\0", "the data begin at byte -512, within the header"),
        (12, b"\0\0\0\0", "the scale of the points is 0"), (8, b"\0\0", "declares 0 frames"),
        (0, b"\0", "not in the format of Intel processors"),
        (0, b"\x89MCAP0\r\n", "is mcap, its source file says c3d"),
        (at + 4, b"\1\0", "damaged C3D file"), (at + 4,
         (20000).to_bytes(2, "little"), "damaged C3D file"),
        (whole.index(b"WORD", 512) + 4,
         (20000).to_bytes(2, "little"), "the parameter section is damaged after 'WORD'"),
        (at + 4, b"\xff\xff", "section is damaged after 'RATE'"),
        (at - 1, b"\0", "section is damaged after 'RATE'"),
        (at + 6, b"\3", "'RATE' has type 3 and 1 dimens"),
        (at + 7, b"\x08", "'RATE' has type 4 and 8 dimensions"),
        (at + 7, b"\3\xff\xff\xff",
         "damaged C3D file: the parameter 'RATE' reaches beyond the end of the file"),
    ):  # fmt: skip
        path.write_bytes(whole[:place] + value + whole[place + len(value) :])
        assert problem in refused(path)
    for name, count in (("POINT__USED", 3), ("ANALOG__USED", 2)):
        write_c3d(path, points(200), analogs(800), **{name: np.array([9])})
        assert f"the header counts {count}, {name.replace('__', ':')} is 9" in refused(path)


@pytest.mark.parametrize(("stated_hz", "is_told"), [(360.0, True), (400.1, False)])
def test_another_rate_than_that_of_the_samples_in_the_frames_is_told(
    tmp_path: Path, stated_hz: float, is_told: bool
) -> None:
    path = write_c3d(
        tmp_path / "a.c3d", points(200), analogs(800), ANALOG__RATE=np.array([stated_hz])
    )

    remarks = " ".join(formats.read(path).loss.remarks)

    assert ("4 samples in each frame at 100 Hz are 400 Hz" in remarks) == is_told


def test_a_capture_of_more_frames_than_its_header_counts_is_whole(tmp_path: Path) -> None:
    positions = np.zeros((70_000, 1, 4))
    positions[:, 0, 0] = np.arange(70_000)
    path = write_c3d(tmp_path / "a.c3d", positions, POINT__FRAMES=np.array([70_000.0]))

    (marker,) = formats.read(path).channels

    assert marker.values[-1, 0] == 69_999


PLATES_THAT_CANNOT_BE: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    ({"ANALOG__SCALE": [1, 1, np.nan, 1, 1, 1.0]},
     {}, "plate 1: nan in sample 1 of analog channel 'A3'"),
    ({"ANALOG__UNITS": ["N"]}, {}, "analog channel 'A2': the unit is empty"),
    ({"FORCE_PLATFORM__USED": [np.nan]}, {}, "FORCE_PLATFORM:USED is nan"),
    ({"FORCE_PLATFORM__ZERO": [1, 7]},
     {"plate_zero": "file"}, "of the plates is frames 1 to 7 of 6"),
    ({"FORCE_PLATFORM__ZERO": [np.nan, 7]}, {"plate_zero": "file"}, "frames 0 to 0 of 6"),
    ({"FORCE_PLATFORM__CHANNEL": np.arange(6)[:, None]},
     {}, "FORCE_PLATFORM:CHANNEL gives [0, 1, 2, 3, 4, 5] of"),
    ({}, {"plate_zero": [3, 7]}, "of the plates is frames 3 to 7 of 6"),
    ({}, {"plates": [2]}, "no force plate 2; the file describes 1, counted from 1"),
    ({"FORCE_PLATFORM__TYPE": [5]}, {}, "plate 1 is of type 5, and types 1 to 4 are read"),
    ({"FORCE_PLATFORM__CORNERS": np.zeros((3, 4, 1))}, {}, "plate 1: its corners span no plane"),
    ({"FORCE_PLATFORM__TYPE": [3], "FORCE_PLATFORM__ORIGIN": np.zeros((3, 1))},
     {}, "type 3 has ORIGIN [0"),
    ({"FORCE_PLATFORM__CORNERS": np.zeros((3, 3, 1))},
     {}, "FORCE_PLATFORM:CORNERS has dimensions (3, 3, 1)"),
    ({"FORCE_PLATFORM__ORIGIN": np.array([[0], [np.nan], [0]])},
     {}, "plate 1: FORCE_PLATFORM:ORIGIN has dimensions (3, 1), or values that are not"),
    ({"FORCE_PLATFORM__CHANNEL": np.arange(3, 9)[:, None]},
     {}, "leave this plate out: `plates: []`"),
]  # fmt: skip


@pytest.mark.parametrize(("parameters", "stated", "told"), PLATES_THAT_CANNOT_BE)
def test_plates_that_cannot_be_are_refused(tmp_path, parameters, stated, told):
    arrays = {name: one if "UNITS" in name else np.array(one) for name, one in parameters.items()}
    assert told in refused(plate_file(tmp_path, **arrays), **stated)


def test_a_laboratory_with_y_up_is_turned_to_z_up(tmp_path: Path) -> None:
    path = write_c3d(tmp_path / "a.c3d", points(), POINT__Y_SCREEN=["+Y"])
    upright = [write_c3d(tmp_path / up, points(), POINT__Y_SCREEN=[up]) for up in ("+Z", "-Z", "z")]
    recording = read(path, axes=["z", "x", "y"])
    for column, axis in zip(("x", "y", "z"), (2, 0, 1), strict=True):
        np.testing.assert_allclose(
            recording.samples[f"marker_M2_{column}"], points()[:, 1, axis] / 1000, rtol=1e-12
        )
    assert [
        *recording.warnings,
        *(text for other in upright for text in read(other).warnings),
    ] == []
    assert "its vertical axis seems to be +Y; state `axes: [x, -z, y]`" in read(path).warnings[0]


CORNERS_MM = np.array([[200, 300, 0], [-200, 300, 0], [-200, -300, 0], [200, -300, 0]], float)
PLATE = {
    "FORCE_PLATFORM__USED": np.array([1]), "FORCE_PLATFORM__TYPE": np.array([2]),
    "FORCE_PLATFORM__CHANNEL": np.arange(1, 7)[:, None], "FORCE_PLATFORM__CORNERS": CORNERS_MM.T[:,
    :, None],
    "FORCE_PLATFORM__ORIGIN": np.array([[0.0], [0.0], [-40.0]]), "ANALOG__UNITS": ["N", "N", "N",
    "Nmm", "Nmm", "Nmm"],
}  # fmt: skip


def plate_file(folder: Path, **parameters: object) -> Path:
    """A type 2 plate of 400 by 600 mm at the laboratory's origin, all its samples different."""
    return write_c3d(folder / "plate.c3d", points(), analogs(24, 6), **{**PLATE, **parameters})


@pytest.mark.parametrize("zero", ["file", [2, 3]])
def test_the_baseline_that_is_asked_for_is_subtracted(tmp_path: Path, zero: object) -> None:
    path = plate_file(tmp_path, FORCE_PLATFORM__ZERO=np.array([2, 3]))
    as_is, zeroed, told = (
        read(path).samples,
        (recording := read(path, plate_zero=zero)).samples,
        recording.facts,
    )
    assert told["plate_zero_frames"] == (2, 3)
    for column in ("plate1_force_z", "plate1_moment_x"):
        baseline = as_is[column][4:12].mean()  # frames 2 and 3 of 4 samples each
        np.testing.assert_allclose(zeroed[column], as_is[column] - baseline, atol=1e-9)


REFERENCE = REAL_DATA / "reference" / "force_plate.csv"
ROWS = pl.read_csv(REFERENCE) if REFERENCE.exists() else pl.DataFrame({"file": [], "plate": []})
PLATES, RANDOM = (
    sorted(
        (file, plate)
        for file, plate in set(zip(ROWS["file"], ROWS["plate"], strict=True))
        if not file.startswith("c3dorg_s10")
    ),
    np.random.default_rng(3),
)
FORCE, MOMENT = RANDOM.normal(0, 300, (20, 3)), RANDOM.normal(0, 40, (20, 3))
AXES = Rotation.from_euler("ZYX", [0.7, 0.2, np.pi - 0.1]).as_matrix()  # z down, tilted and turned
CENTRE = np.array([1.0, -2.0, 0.3])
CORNERS = (
    CENTRE + np.array([[0.3, 0.2, 0], [-0.3, 0.2, 0], [-0.3, -0.2, 0], [0.3, -0.2, 0]]) @ AXES.T
)
IN_PLATE = FORCE @ AXES, MOMENT @ AXES
# from the plate's origin to the centre of its surface, plate axes
SURFACE = np.array([0.004, -0.007, -0.045])


@pytest.mark.parametrize("stored", [1, -1])
def test_types_2_and_4_give_the_wrench_back_whichever_way_origin_points(
    stored: int,
) -> None:
    force, moment = IN_PLATE
    # moments about the plate's origin: M + r x F
    channels = np.hstack([force, moment + np.cross(SURFACE, force)])
    calibration = RANDOM.normal(size=(6, 6)) + 5 * np.eye(6)
    raw = np.linalg.solve(calibration, channels.T).T
    for kind, readings in ((2, channels), (4, raw @ calibration.T)):
        found = wrench(kind, CORNERS, stored * SURFACE, readings)
        np.testing.assert_allclose(found[0], FORCE, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found[1], MOMENT, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("depth_sign", [1, -1])
def test_type_3_gives_the_wrench_of_its_four_sensors_back(depth_sign: int) -> None:
    a, b, depth = 0.12, 0.2, 0.054
    # z down: under the surface
    sensors = np.array([[a, b, depth], [-a, b, depth], [-a, -b, depth], [a, -b, depth]])
    forces = RANDOM.normal(0, 100, (20, 4, 3))
    total, moment = forces.sum(axis=1), np.cross(sensors, forces).sum(axis=1)
    x, y, z = forces.transpose(2, 1, 0)
    channels = np.column_stack([x[0] + x[1], x[2] + x[3], y[0] + y[3], y[1] + y[2], *z])
    found = wrench(3, CORNERS, np.array([a, b, depth_sign * depth]), channels)
    np.testing.assert_allclose(found[0], total @ AXES.T, atol=1e-9)
    np.testing.assert_allclose(found[1], moment @ AXES.T, atol=1e-9)


def test_type_1_gives_force_pressure_point_and_free_moment_back() -> None:
    pressure, free = RANDOM.normal(0, 0.1, (20, 2)), RANDOM.normal(0, 5, 20)
    moment = np.cross(np.column_stack([pressure, np.zeros(20)]), IN_PLATE[0]) + np.outer(
        free, [0, 0, 1]
    )
    found = wrench(1, CORNERS, np.zeros(3), np.column_stack([IN_PLATE[0], pressure, free]))
    np.testing.assert_allclose(found[0], FORCE, atol=1e-9)
    np.testing.assert_allclose(found[1], moment @ AXES.T, atol=1e-9)


@pytest.mark.skipif(not PLATES, reason="real data are not here")
@pytest.mark.parametrize(("file", "plate"), PLATES, ids=lambda value: str(value).split(".")[0])
def test_real_plates_give_the_reference_wrench(file: str, plate: int) -> None:
    described = source(plates=[plate + 1])
    (of_file,) = formats.read(REAL_DATA / "c3d" / file, described).plates
    columns = convert_plate(of_file, described, np.eye(3)).columns
    force, moment = (np.column_stack([*columns.values()][at : at + 3]) for at in (0, 3))
    for row in ROWS.filter((pl.col("file") == file) & (pl.col("plate") == plate)).iter_rows(
        named=True
    ):
        sample = row["analog_sample"]
        np.testing.assert_allclose(force[sample], [row["Fx"], row["Fy"], row["Fz"]], rtol=1e-5)
        expected = np.array([row[f"M_centre_{axis}"] for axis in "xyz"]) / 1000  # N*mm
        np.testing.assert_allclose(moment[sample], expected, rtol=1e-5)


def level_plate(
    path: Path, last: tuple[float, ...] = (1, 2, 3, 4000, 5000, 6000), **parameters: object
) -> Path:
    """Six channels N, N, N, Nmm, Nmm, Nmm on one level type 2 plate, z down; forces 1 to 3, moments
    4000 to 6000."""
    raw = np.array([[1.0, 2, 3, 4000, 5000, 6000]] * 4 + [list(last)] * 4)
    corners = np.array([[600.0, 0, 0], [0, 0, 0], [0, 400, 0], [600, 400, 0]])
    level = {
        "FORCE_PLATFORM__CORNERS": corners.T[:, :, None],
        "FORCE_PLATFORM__ORIGIN": np.zeros((3, 1)),
    }
    return write_c3d(path, np.ones((2, 1, 4)), raw, **{**PLATE, **level, **parameters})


def wrench_of(path: Path, row: int = 3, **fields: object) -> list[float]:
    samples = read(path, **fields).samples
    return [samples[f"plate1_{q}_{axis}"][row] for q in ("force", "moment") for axis in "xyz"]


def test_columns_and_geometry_of_a_plate_are_in_si_units_and_laboratory_axes(
    tmp_path: Path,
) -> None:
    path = level_plate(tmp_path / "a.c3d")
    assert wrench_of(path) == pytest.approx([1, -2, -3, 4, -5, -6], rel=1e-12)
    flat = {
        "CORNERS": formats.read(path).plates[0].corners.T,
        "ORIGIN": np.zeros(3),
    }
    # of a single plate, without its dimension; and unused ones
    flat["CHANNEL"] = np.array([1, 2, 3, 4, 5, 6, 0, 0])
    other = level_plate(
        tmp_path / "b.c3d", **{f"FORCE_PLATFORM__{name}": one for name, one in flat.items()}
    )
    assert wrench_of(other) == wrench_of(path)
    for axes, corners in {
        "xyz": [[0.6, 0, 0], [0, 0, 0], [0, 0.4, 0], [0.6, 0.4, 0]],
        "x-zy": [[0.6, 0, 0], [0, 0, 0], [0, 0, 0.4], [0.6, 0, 0.4]],
    }.items():
        (plate,) = read(path, axes=re.findall("-?[xyz]", axes)).facts["plates"]
        assert (plate["plate"], plate["type"]) == (1, 2)
        np.testing.assert_allclose(plate["corners"], corners, atol=1e-12)


@pytest.mark.parametrize("unit", ["V", "N"])
def test_a_type_1_plate_is_read_with_the_units_that_its_refusal_says(
    tmp_path: Path, unit: str
) -> None:
    path = level_plate(
        tmp_path / "a.c3d", ANALOG__UNITS=[unit] * 6, FORCE_PLATFORM__TYPE=np.array([1])
    )
    with pytest.raises(InputError) as caught:
        wrench_of(path)
    advised = re.findall(r"`plate_units: (\{.*\})`", str(caught.value))
    stated = wrench_of(path, plate_units=yaml.safe_load(advised[0]))
    # pressure 4000, 5000 mm, torque 6000 N*mm
    moment = np.add(np.cross([4, 5, 0], [1, 2, 3]), [0, 0, 6])
    assert stated == pytest.approx([1, -2, -3, moment[0], -moment[1], -moment[2]])
    # less the first frame: an unloaded plate has no centre of pressure
    twice = (2.0, 4, 6, 4000, 5000, 12000)
    path = level_plate(
        tmp_path / "b.c3d", twice, ANALOG__UNITS=[unit] * 6, FORCE_PLATFORM__TYPE=np.array([1])
    )
    assert wrench_of(
        path, -1, plate_units=yaml.safe_load(advised[0]), plate_zero=(1, 1)
    ) == pytest.approx(stated)
    # and the file's
    level_plate(path, ANALOG__UNITS=[*"VVV", "cm", "cm", "V"], FORCE_PLATFORM__TYPE=np.array([1]))
    assert wrench_of(path, plate_units={"force": "N", "moment": "N*mm"}) == pytest.approx(
        [1, -2, -3, 150, 120, -36]
    )


@pytest.mark.parametrize("store", ["BYCOLUMN", "BYROW"])
def test_a_calibration_matrix_is_read_in_the_order_that_the_file_names(
    tmp_path: Path, store: str
) -> None:
    matrix = np.eye(6)
    matrix[0, 1] = 10.0  # Fx = c1 + 10 c2
    stored = (matrix.T if store == "BYROW" else matrix)[:, :, None]
    parameters = {"FORCE_PLATFORM__CAL_MATRIX": stored, "FORCE_PLATFORM__MATRIX_STORE": [store]}
    path = level_plate(tmp_path / "a.c3d", FORCE_PLATFORM__TYPE=np.array([4]), **parameters)
    assert wrench_of(path) == pytest.approx([21, -2, -3, 4, -5, -6], rel=1e-6)
    stated = {"plate_units": {"force": "kN", "moment": "N*cm"}}
    assert wrench_of(path, **stated) == pytest.approx([21e3, -2e3, -3e3, 40, -50, -60], rel=1e-6)
    path = level_plate(path, FORCE_PLATFORM__TYPE=np.array([4]), **parameters, POINT__UNITS=["m"])
    assert wrench_of(path) == pytest.approx([21, -2, -3, 4e3, -5e3, -6e3], rel=1e-6)


SOURCES, NEXUS_FILES = (
    Path(__file__).parents[1] / "config" / "sources",
    sorted((REAL_DATA / "nexus_csv").glob("*.csv")),
)
DEVICES = """Devices
200
,,AMTI #1 - Force,,,AMTI #1 - Moment,,,AMTI #1 - CoP,,,Sync - Voltage
Frame,Sub Frame,Fx,Fy,Fz,Mx,My,Mz,Cx,Cy,Cz,1
,,N,N,N,N.mm,N.mm,N.mm,mm,mm,mm,V
5,0,1,2,-700,1000,2000,3000,0,0,0,0.5
5,1,1,2,-701,1000,2000,3000,0,0,0,0.6
6,0,1,2,-702,1000,2000,3000,0,0,0,0.7
6,1,1,2,-703,1000,2000,3000,0,0,0,0.8
"""
TRAJECTORIES = """Trajectories
100
,,Anna:TOE,,,Anna:HEEL,,,*12,,
Frame,Sub Frame,X,Y,Z,X,Y,Z,X,Y,Z
,,mm,mm,mm,mm,mm,mm,mm,mm,mm
5,0,1,2,3,,,,7,8,9
6,0,10,20,30,40,50,60,7,8,9
"""
MODEL = """Model Outputs
100
,,Anna:LAnkleMoment,,
Frame,Sub Frame,X,Y,Z
,,N.mm,N.mm,N.mm
5,0,1500,0,0
6,0,1600,0,0
"""
FLOOR = [[500, 600, 0], [0, 600, 0], [0, 0, 0], [500, 0, 0]]


def nexus_source(**fields: object) -> Source:
    usual = {
        "format": "nexus_csv", "analogs": {"sync": {"device": "Sync - Voltage", "component": "1"}},
        "outputs": {"reference_ankle_moment_left": {"label": "LAnkleMoment", "component": "x",
        "unit": "N*mm/kg"}},
        "plates": {1: {"device": "AMTI #1", "corners": FLOOR, "sign": -1}},
    }  # fmt: skip
    return known_formats()["nexus_csv"].source.model_validate({**usual, **fields})


def exported(tmp_path: Path, text: str, **fields: object) -> pl.DataFrame:
    path = tmp_path / "trial.csv"
    path.write_text(text)
    return read_converted(path, nexus_source(**fields)).samples


def padded(text: str) -> str:
    return "".join(line + "," * (20 - line.count(",")) + "\n" for line in text.splitlines())


EXPORT = "\n".join([DEVICES, TRAJECTORIES, MODEL])
DRESSES: dict[str, tuple[str, dict[str, object]]] = {
    "plain": (EXPORT, {}), "turned round": ("\n".join([MODEL, TRAJECTORIES, DEVICES]), {}),
    "padded": (padded(EXPORT), {}), "tabs": (EXPORT.replace(",", "\t"), {}),
    "semicolons": (EXPORT.replace(",", ";").replace("0.", "0,"), {}),
    "crlf": (EXPORT.replace("\n", "\r\n"), {}),
    "capitals": (EXPORT.replace("Frame,Sub Frame,", "FRAME,SUB FRAME,"), {}),
    "at the origin": (EXPORT.replace("3,,,,", "3,0,0,0,"), {}),
    "devices of a subject": (EXPORT.replace(",AMTI", ",Anna:AMTI"), {}),
    "no blank lines": (DEVICES + TRAJECTORIES + MODEL, {}),
}  # fmt: skip


@pytest.mark.parametrize(("text", "fields"), DRESSES.values(), ids=DRESSES)
def test_one_export_in_any_dress_is_one_recording(
    tmp_path: Path, text: str, fields: dict[str, object]
) -> None:
    samples = exported(tmp_path, text, **fields)
    np.testing.assert_allclose(samples["time"], [0, 0.005, 0.01, 0.015], rtol=1e-12)
    np.testing.assert_allclose(samples["sync"], [0.5, 0.6, 0.7, 0.8])
    np.testing.assert_allclose(samples["plate1_force_z"], [700, 701, 702, 703])
    assert samples["marker_TOE_z"].to_list() == [0.003, None, 0.03, None]
    assert samples["marker_HEEL_x"].is_nan().to_list() == [True, None, False, None]
    assert samples["reference_ankle_moment_left"].to_list() == [1.5, None, 1.6, None]
    assert not [column for column in samples.columns if "12" in column]


def test_a_plates_moment_is_about_its_centre_wherever_the_file_takes_it(tmp_path: Path) -> None:
    """A force F at p turns with (p - c) x F about c: here p is the laboratory's origin."""
    plate = {"device": "AMTI #1", "corners": FLOOR, "sign": -1, "moment_about": [0, 0, 0]}
    at_origin = exported(
        tmp_path, DEVICES.replace("1000,2000,3000", "0,0,0"), plates={1: plate}, outputs={}
    )
    expected = np.cross([-0.25, -0.3, 0], at_origin.select(pl.col("^plate1_force_.$")).to_numpy())
    np.testing.assert_allclose(
        at_origin.select(pl.col("^plate1_moment_.$")).to_numpy(), expected, rtol=1e-12
    )


@pytest.mark.parametrize(("text", "fields", "problem"), [
    (DEVICES + TRAJECTORIES, {}, "no model output 'LAnkleMoment'; the file has"),
    (DEVICES + DEVICES + TRAJECTORIES + MODEL, {}, "line 10: section Devices stands twice"),
    (DEVICES.replace("200", "fast") + TRAJECTORIES + MODEL, {}, "line 2: 'fast' is not a rate"),
    (DEVICES.replace("5,1,", "5,2,") + TRAJECTORIES + MODEL,
     {}, "line 7: frame 5 does not follow"),
    (DEVICES + TRAJECTORIES.replace("\n6,", "\n7,") + MODEL,
     {}, "line 16: frame 7 does not follow"),
    (DEVICES.replace("200", "210") + TRAJECTORIES + MODEL,
     {}, "its sections differ in first frame"),
    (DEVICES.replace("0.6", "") + TRAJECTORIES + MODEL, {}, "sync: nan in sample 2 of 4"),
    (DEVICES.replace("0.6", "?") + TRAJECTORIES + MODEL,
     {}, "line 7, Sync - Voltage 1: '?' is not a number"),
    (DEVICES + TRAJECTORIES.replace("HEEL", "TOE") + MODEL, {}, "marker 'TOE' occurs 2 times"),
    (DEVICES + TRAJECTORIES.replace("Anna:HEEL", "Ben:TOE") + MODEL,
     {}, "marker 'TOE' occurs 2 times"),
    (DEVICES + TRAJECTORIES + MODEL,
     {"markers": ["KNEE"]}, "no marker 'KNEE'; the file has Anna:TOE"),
    (EXPORT, {"analogs": {"sync": {"device": "EMG", "component": "1"}}},
     "no analog component 'EMG 1'; the file has AMTI #1 - Force"),
    (DEVICES + TRAJECTORIES.replace("mm", "parsnip") + MODEL, {}, "unit 'parsnip' is unknown"),
    (DEVICES[:DEVICES.index("6,1")],
     {"outputs": {}, "markers": []}, "the last frame lacks sub frames; export"),
    (EXPORT, {"analogs": {}, "outputs": {}, "plates": {}, "markers": []},
     "nothing to read; name markers, outputs"),
    (DEVICES + TRAJECTORIES.replace("100", "0") + MODEL,
     {}, "section Trajectories at 0 Hz has no samples; export wit"),
    (DEVICES.replace("N.mm", "N"), {"outputs": {}}, "unit 'N' measures [N], expected one of N*m"),
])  # fmt: skip
def test_what_does_not_fit_is_refused_with_the_reason(tmp_path, text, fields, problem):
    path = tmp_path / "trial.csv"
    path.write_text(text)
    assert problem in refusal_by(read_converted, path, nexus_source(**fields))


def test_an_export_is_listed_by_sections_with_what_is_missing(
    tmp_path: Path,
) -> None:
    (path := tmp_path / "trial.csv").write_text(EXPORT)
    facts, overview = (
        read_converted(path, nexus_source()).facts,
        inspect_recording(path),
    )
    assert [facts[name] for name in ("frame_rate_hz", "first_frame", "samples_per_frame")] == [
        100,
        5,
        2,
    ]
    kinds = [one.kind for one in overview.channels]
    assert [kinds.count(kind) for kind in ("analog", "marker", "model output")] == [10, 3, 1]
    heel = next(one for one in overview.channels if one.address == {"label": "Anna:HEEL"})
    assert (heel.count, heel.rate, heel.unit, heel.note) == (
        1,
        100,
        "mm",
        "missing in 50.0% of the frames",
    )


@pytest.mark.parametrize("path", NEXUS_FILES, ids=lambda path: path.stem)
def test_real_exports_are_read_as_they_are_written(path: Path) -> None:
    samples = read_converted(path, read_source(SOURCES / "nexus_csv.yaml")).samples
    np.testing.assert_allclose(samples["marker_HV_x"], [0.209331, 0.209475])
    assert samples["marker_CL_E_z"].to_list() == pytest.approx([0.496721, 0.496729])
