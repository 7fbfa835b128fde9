# SPDX-License-Identifier: Apache-2.0
"""C3D: frames, names and plates of whole, cut and odd files, against closed forms and ezc3d."""

import re

import ezc3d
import numpy as np
import pytest
import yaml
from c3d_builder import DEC, FACE, MIPS, UNITS_OF_PLATE, level_plates, write_c3d
from pydantic import ValidationError
from recognised_files import refusal_by, source_of
from scipy.spatial.transform import Rotation

from osl_analysis import formats
from osl_analysis.draft.overview import inspect_recording
from osl_analysis.ingest.force_plates import wrench
from osl_analysis.ingest.raw_files import read_converted, recordings_in

# Whole numbers, all different, none zero: 6 frames of 3 points of residual 0, 4 samples a frame.
POINTS = np.arange(1.0, 73).reshape(6, 3, 4) * [1, 1, 1, 0]
ANALOGS = np.arange(48.0).reshape(24, 2) - 7


def source(**fields):
    return source_of("c3d", **fields)


def read(path, **fields):
    return read_converted(path, source(**fields))


def refused(path, **fields):
    return refusal_by(read, path, **fields)


def capture(folder, **parameters):
    return write_c3d(folder / "a.c3d", POINTS, ANALOGS, **parameters)


def marker(recording, name):
    """Positions (frames, 3) [m]."""
    return recording.samples.select(f"^marker_{name}_[xyz]$").drop_nulls().to_numpy()


# --- frames -------------------------------------------------------------------------------------


def test_points_analogs_and_time_are_those_of_the_file(tmp_path):
    path = capture(tmp_path, PROCESSING__BODYMASS=72.5)
    path.write_bytes(path.read_bytes()[:6] + b"\5\0\n\0" + path.read_bytes()[10:])  # frames 5 to 10

    recording = read(path, analogs={"sync": {"channel": "A2"}})

    facts = ("body_mass_kg", "first_frame", "samples_per_frame")
    assert [recording.facts[name] for name in facts] == [72.5, 5, 4]
    for place in range(3):
        positions = marker(recording, f"M{place + 1}")
        np.testing.assert_allclose(positions, POINTS[:, place, :3] / 1000, rtol=1e-15)
    np.testing.assert_allclose(recording.samples["time"], np.arange(24) / 400, rtol=1e-15)
    np.testing.assert_array_equal(recording.samples["sync"], ANALOGS[:, 1])
    assert len(read(path).samples) == 6  # a row per frame
    assert inspect_recording(path).channels[-1].note.split()[1::2] == ["-6", "40"]


@pytest.mark.parametrize(
    ("raw", "is_integer", "parameters", "expected"),
    [
        (-300.0, False, {}, -300),
        (-300, True, {}, -300),
        (100.0, False, {"OFFSET": 20, "SCALE": 0.5, "GEN_SCALE": 0.1}, 4),
        (40_000, True, {"OFFSET": 32_768, "FORMAT": ["UNSIGNED"]}, 7232),
    ],
)
def test_a_sample_is_raw_minus_offset_times_both_scales(
    tmp_path, raw, is_integer, parameters, expected
):
    named = {f"ANALOG__{name}": value for name, value in parameters.items()}
    path = write_c3d(tmp_path / "a.c3d", POINTS, np.full((6, 1), raw), integers=is_integer, **named)

    recording = formats.read(path)

    scale = 0.1 if is_integer else 1.0  # POINT:SCALE of the builder
    positions = recording.find({"label": "M2"}).values
    np.testing.assert_allclose(positions, scale * POINTS[:, 1, :3], rtol=1e-6)
    np.testing.assert_allclose(recording.find({"channel": "A1"}).values, expected, rtol=1e-6)


@pytest.mark.parametrize("processor", [DEC, MIPS])
@pytest.mark.parametrize("integers", [False, True])
def test_a_file_of_another_processor_holds_the_same_numbers(tmp_path, processor, integers):
    files = {
        code: write_c3d(
            tmp_path / f"{code}.c3d",
            np.round(POINTS),
            -ANALOGS,
            rate=59.94,
            integers=integers,
            processor=code,
            ANALOG__SCALE=np.array([0.1, -3e-5]),
        )
        for code in (84, processor)
    }

    intel, other = (formats.read(path) for path in files.values())

    assert other.facts == intel.facts
    for channel, its_twin in zip(other.channels, intel.channels, strict=True):
        assert (channel.address, channel.unit) == (its_twin.address, its_twin.unit)
        np.testing.assert_array_equal(channel.values, its_twin.values)


@pytest.mark.parametrize("size", [2, 511])
def test_a_file_that_ends_in_its_header_is_told_so(tmp_path, size):
    path = capture(tmp_path)
    path.write_bytes(path.read_bytes()[:size])

    assert f"{size} bytes" in refused(path)


def test_a_point_with_negative_residual_or_at_the_exact_origin_was_not_seen(tmp_path):
    raw = POINTS.copy()
    raw[1, 0, 3], raw[2, 0, :3], raw[3, 0, 2], raw[4, 0, 0] = -1.0, 0.0, 0.0, np.inf

    samples = read(write_c3d(tmp_path / "a.c3d", raw)).samples

    assert samples["marker_M1_z"].is_nan().to_list() == [False, True, True, False, True, False]
    assert not samples["marker_M2_x"].is_nan().any()


@pytest.mark.parametrize(("first_zero", "whole"), [(20, 24), (23, 20)])
def test_a_single_last_sample_of_zeros_was_not_recorded(tmp_path, first_zero, whole):
    """A joint may be at rest at the end; of one sample alone the frame is left out."""
    recorded = ANALOGS + 8
    recorded[first_zero:] = 0.0

    converted = read(
        write_c3d(tmp_path / "a.c3d", POINTS, recorded), analogs={"sync": {"channel": "A1"}}
    )

    np.testing.assert_allclose(converted.samples["sync"], recorded[:whole, 0], rtol=1e-6)
    assert bool(converted.warnings) == (whole < 24)


def test_what_fills_the_last_block_is_no_loss_and_a_cut_file_is(
    tmp_path,
):
    path = write_c3d(tmp_path / "a.c3d", np.ones((50, 3, 4)))
    content = path.read_bytes()
    path.write_bytes(content[:-16] + b"left in a buffer")
    assert formats.read(path).loss.lost == 0

    path.write_bytes(content[:-1024])
    assert " 50 " in refused(path)


def test_a_capture_of_more_frames_than_its_header_counts_is_whole(tmp_path):
    positions = np.zeros((70_000, 1, 4))
    positions[:, 0, 0] = np.arange(70_000)
    path = write_c3d(tmp_path / "a.c3d", positions, POINT__FRAMES=70_000.0)

    (channel,) = formats.read(path).channels

    assert channel.values[-1, 0] == 69_999


@pytest.mark.parametrize(
    ("name", "offset", "value", "problem"),
    [
        ("", 12, b"\0\0\0\0", " 0.0"),
        ("", 8, b"\0\0", " 0 frames"),
        ("", 0, b"\0", "parameters"),
        ("", 512 + 3, b"\x57", "processor type 87"),
        # behind its name stand the pointer of a parameter, its type, dimensions and sizes
        ("RATE", 4, b"\1\0", "'RATE'"),
        ("RATE", 6, b"\3", "'RATE'"),
    ],
)
def test_an_absurd_header_or_a_damaged_parameter_is_refused(tmp_path, name, offset, value, problem):
    path = capture(tmp_path)
    whole = path.read_bytes()
    place = offset + (whole.index(name.encode(), 512) if name else 0)
    path.write_bytes(whole[:place] + value + whole[place + len(value) :])

    assert problem in refused(path)


# --- names and units ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("labels", "names"),
    [
        (["P07:RANK", "P07:LANK", "*3"], ["RANK", "LANK"]),
        (["P07:RANK", "P08:RANK", "P08:LANK"], ["P07:RANK", "P08:RANK", "LANK"]),
        (["P07:RANK", "RANK", "M3"], ["P07:RANK", "RANK", "M3"]),
    ],
)
def test_the_subject_of_markers_is_left_out_where_there_is_one(tmp_path, labels, names):
    columns = read(capture(tmp_path, POINT__LABELS=labels)).samples.columns

    assert [name for name in columns if name.endswith("_x")] == [f"marker_{n}_x" for n in names]


def test_a_second_parameter_goes_on_with_the_labels_of_the_first(tmp_path):
    path = capture(tmp_path, POINT__LABELS=["A", "B"], POINT__LABELS2=["C"])

    labels = [channel.address.get("label") for channel in formats.read(path).channels]

    assert labels[:3] == ["A", "B", "C"]


def test_one_of_two_channels_of_one_name_is_read_by_its_number(tmp_path):
    path = capture(tmp_path, POINT__LABELS=["TOE", "HEEL", "TOE"], ANALOG__LABELS=["Sync", "Sync"])

    recording = read(path, markers=["HEEL", "3"], analogs={"sync": {"channel": "2"}})

    np.testing.assert_allclose(marker(recording, "TOE"), POINTS[:, 2, :3] / 1000)
    np.testing.assert_allclose(recording.samples["sync"], ANALOGS[:, 1])
    assert "1, 3" in refused(path)
    assert "'Sync'" in refused(path, markers=[], analogs={"sync": {"channel": "Sync"}})


def test_model_outputs_take_unit_and_sign_from_the_source_file(tmp_path):
    groups = ["POWERS", "POWER", "Moments", "MOMENT"]
    path = capture(
        tmp_path,
        POINT__LABELS=["LTOE", "LAnkleMoment", "*3"],
        POINT__TYPE_GROUPS=groups,
        POINT__MOMENTS=["LAnkleMoment"],
    )
    output = {"label": "LAnkleMoment", "component": "y", "unit": "N*mm/kg", "sign": -1}

    samples = read(path, outputs={"reference_ankle_moment_left": output}).samples

    moment = samples["reference_ankle_moment_left"].drop_nulls()
    np.testing.assert_allclose(moment, -POINTS[:, 1, 1] / 1000, rtol=1e-15)
    assert [name for name in samples.columns if name.endswith("_x")] == ["marker_LTOE_x"]


@pytest.mark.parametrize(
    ("parameters", "stated", "expected"),
    [
        ({}, {"axes": ["z", "x", "y"]}, POINTS[:, 1, [2, 0, 1]] / 1000),
        ({"POINT__UNITS": ["mmm"]}, {"point_unit": "cm"}, POINTS[:, 1, :3] / 100),
        ({"POINT__UNITS": ["m"]}, {}, POINTS[:, 1, :3]),
    ],
)
def test_positions_are_in_metres_and_in_the_stated_axes(tmp_path, parameters, stated, expected):
    recording = read(capture(tmp_path, **parameters), **stated)

    np.testing.assert_allclose(marker(recording, "M2"), expected, rtol=1e-12)


# --- plates -------------------------------------------------------------------------------------

LEVEL = np.array([[600.0, 0, 0], [0, 0, 0], [0, 400, 0], [600, 400, 0]])  # z down
LABELS = ["Force.Fx1", "Force.Fy1", "Force.Fz1", "Moment.Mx1", "Moment.My1", "Moment.Mz1"]
STATED = {"type": 2, "channels": LABELS, "corners": LEVEL.tolist()}
READINGS = np.tile([1.0, 2, 3, 4000, 5000, 6000], (24, 1))
WRENCH = pytest.approx([1, -2, -3, 4, -5, -6], rel=1e-12)  # N and N*m, z up


def plate_file(folder, readings=READINGS, **parameters):
    """Channels in N, N, N, Nmm, Nmm, Nmm on one plate, by default forces 1 to 3 and moments 4000 to
    6000."""
    channels = {"ANALOG__UNITS": UNITS_OF_PLATE, "ANALOG__LABELS": LABELS}
    plate = channels | level_plates(LEVEL) | parameters
    return write_c3d(folder / "plate.c3d", POINTS, readings, **plate)


def wrench_of(path, row=3, **fields):
    return read(path, **fields).samples.select("^plate1_(force|moment)_[xyz]$").row(row)


@pytest.mark.parametrize(
    ("parameters", "stated", "told"),
    [
        ({"ANALOG__SCALE": [1, 1, np.nan, 1, 1, 1.0]}, {}, "'Force.Fz1': nan"),
        ({}, {"plate_zero": [1, 7]}, " 7 "),
        ({"FORCE_PLATFORM__TYPE": [6]}, {}, "type 6"),
        ({"FORCE_PLATFORM__CORNERS": np.zeros((3, 4, 1))}, {}, "corners"),
        ({"FORCE_PLATFORM__ORIGIN": np.array([[0], [np.nan], [0]])}, {}, "FORCE_PLATFORM:ORIGIN"),
        ({"POINT__UNITS": ["mmm"]}, {}, "unit 'mmm'"),
        ({"ANALOG__UNITS": ["N"]}, {}, "'Force.Fy1'"),
        ({"POINT__USED": [9]}, {}, "POINT:USED"),
        ({}, {"plates": [2]}, "plate 2"),
        ({}, {"markers": ["M1", "TOE"]}, "'TOE'"),
        ({}, {"plate_geometry": {1: {**STATED, "channels": [*LABELS[:5], "Mz"]}}}, "'Mz'"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path, parameters, stated, told):
    arrays = {
        name: value if "UNITS" in name else np.array(value) for name, value in parameters.items()
    }

    assert told in refused(plate_file(tmp_path, **arrays), **stated)


def test_the_corners_of_a_plate_are_in_metres_and_laboratory_axes(tmp_path):
    path = plate_file(tmp_path)

    for axes, order in ((["x", "y", "z"], [0, 1, 2]), (["x", "-z", "y"], [0, 2, 1])):
        (plate,) = read(path, axes=axes).facts["plates"]
        np.testing.assert_allclose(plate["corners"], LEVEL[:, order] / 1000, atol=1e-12)


@pytest.mark.parametrize(
    ("parameters", "stated"),
    [
        # of a single plate, without its dimension; and unused channels
        (
            {
                "FORCE_PLATFORM__CORNERS": LEVEL.T,
                "FORCE_PLATFORM__ORIGIN": np.zeros(3),
                "FORCE_PLATFORM__CHANNEL": np.array([1, 2, 3, 4, 5, 6, 0, 0]),
            },
            {},
        ),
        ({"FORCE_PLATFORM__USED": 0}, {"plate_geometry": {1: STATED}}),
        ({"FORCE_PLATFORM__TYPE": 6}, {"plate_geometry": {1: STATED}}),
        ({}, {"plate_geometry": {1: {**STATED, "channels": [1, 2, 3, 4, 5, 6]}}}),
        ({"FORCE_PLATFORM__TYPE": 4, "FORCE_PLATFORM__CAL_MATRIX": np.eye(6)}, {}),
    ],
)
def test_one_plate_described_in_any_way_is_one_plate(tmp_path, parameters, stated):
    path = plate_file(tmp_path, **parameters)

    assert wrench_of(path, **stated) == WRENCH


def test_a_plate_that_cannot_be_read_is_a_question(tmp_path):
    path = plate_file(tmp_path, FORCE_PLATFORM__TYPE=6)

    listed = formats.read(path)

    assert not listed.plates
    assert "type 6" in listed.questions[0]
    assert not formats.read(path, source(plates=[])).plates


def test_how_to_state_a_plate_works_also_where_two_have_the_same_labels(tmp_path):
    path = plate_file(
        tmp_path,
        np.hstack([READINGS, 0 * READINGS]),
        FORCE_PLATFORM__USED=0,
        ANALOG__LABELS=[label[:-1] for label in LABELS] * 2,
        ANALOG__UNITS=UNITS_OF_PLATE * 2,
    )

    (question,) = formats.read(path).questions
    (remedy,) = re.findall("`(.*)`", question)
    stated = yaml.safe_load(remedy)
    stated["plate_geometry"][1]["corners"] = LEVEL.tolist()

    assert wrench_of(path, **stated) == WRENCH


@pytest.mark.parametrize("ending", ["_forces", "_fp"])
def test_markers_and_plates_in_two_files_of_one_trial_are_one_recording(tmp_path, ending):
    markers = write_c3d(tmp_path / "walk.c3d", POINTS)
    plate_file(tmp_path).rename(tmp_path / f"walk{ending}.c3d")

    samples = read(markers, plates=[1]).samples

    np.testing.assert_allclose(samples["marker_M2_x"].drop_nulls(), POINTS[:, 1, 0] / 1000)
    assert samples.select("^plate1_(force|moment)_[xyz]$").row(3) == WRENCH
    assert recordings_in(tmp_path) == [markers]


def test_files_of_other_frames_are_not_taken_for_one_trial(tmp_path):
    markers = write_c3d(tmp_path / "walk.c3d", POINTS[:4])
    plate_file(tmp_path).rename(tmp_path / "walk_forces.c3d")

    said = refused(markers)

    assert "walk_forces.c3d" in said
    assert "6 at 100 Hz, the markers beside it 1 on, 4" in said


@pytest.mark.parametrize("unit", ["V", "N"])
def test_a_type_1_plate_is_read_with_the_units_that_its_refusal_says(tmp_path, unit):
    type_1 = {"FORCE_PLATFORM__TYPE": 1, "ANALOG__UNITS": [unit] * 6}
    path = plate_file(tmp_path, **type_1)

    advised = refused(path).partition("`plate_units: ")[2].partition("`")[0]
    stated = {"plate_units": yaml.safe_load(advised)}

    # pressure 4000, 5000 mm, torque 6000 N*mm
    moment = np.add(np.cross([4, 5, 0], [1, 2, 3]), [0, 0, 6])
    expected = pytest.approx([1, -2, -3, moment[0], -moment[1], -moment[2]])
    assert wrench_of(path, **stated) == expected
    # less the first frame: an unloaded plate has no centre of pressure
    loaded = READINGS.copy()
    loaded[4:] *= [2, 2, 2, 1, 1, 2]
    path = plate_file(tmp_path, loaded, **type_1)
    assert wrench_of(path, -1, **stated, plate_zero=(1, 1)) == expected


@pytest.mark.parametrize("store", ["BYCOLUMN", "BYROW"])
def test_a_plate_of_type_5_is_calibrated_from_eight_channels_in_volts(tmp_path, store):
    random = np.random.default_rng(8)
    matrix = random.normal(0, 100, (6, 8))
    volts = random.normal(0, 1, (24, 8))
    stored = matrix if store == "BYCOLUMN" else matrix.ravel().reshape(6, 8, order="F")
    described = {
        "FORCE_PLATFORM__TYPE": 5,
        "FORCE_PLATFORM__CHANNEL": np.arange(1, 9)[:, None],
        "FORCE_PLATFORM__CAL_MATRIX": stored[:, :, None],
        "FORCE_PLATFORM__MATRIX_STORE": [store],
    }
    in_volts = {"ANALOG__UNITS": ["V"] * 8, "ANALOG__LABELS": [f"pin {n}" for n in range(1, 9)]}
    plate = {
        **STATED,
        "type": 5,
        "channels": list(range(1, 9)),
        "calibration": matrix.tolist(),
    }

    from_file = wrench_of(plate_file(tmp_path, volts, **in_volts, **described))
    undescribed = plate_file(tmp_path, volts, **in_volts, FORCE_PLATFORM__USED=0)
    as_stated = wrench_of(undescribed, plate_geometry={1: plate})

    # N and N*mm in the plate's axes, whose y and z are the laboratory's turned round
    in_plate = matrix @ volts[3] * [1, 1, 1, 1e-3, 1e-3, 1e-3]
    expected = pytest.approx(in_plate * [1, -1, -1, 1, -1, -1], rel=1e-5)
    assert from_file == expected
    assert as_stated == expected


@pytest.mark.parametrize(
    ("kind", "calibration"), [(2, np.eye(6)), (4, np.ones((6, 8))), (5, np.eye(6)), (5, ())]
)
def test_a_calibration_of_another_size_than_its_type_is_refused(kind, calibration):
    plate = {**STATED, "type": kind, "calibration": np.asarray(calibration).tolist()}

    with pytest.raises(ValidationError, match=f"type {kind}"):
        source(plate_geometry={1: plate})


def test_channels_in_volts_are_said_to_need_a_calibration(tmp_path):
    assert "calibration" in refused(plate_file(tmp_path, ANALOG__UNITS=["V"] * 6))


@pytest.mark.parametrize("store", ["BYCOLUMN", "BYROW"])
def test_a_calibration_matrix_is_read_in_the_order_that_the_file_names(tmp_path, store):
    matrix = np.eye(6)
    matrix[0, 1] = 10.0  # Fx = c1 + 10 c2
    parameters = {
        "FORCE_PLATFORM__TYPE": 4,
        "FORCE_PLATFORM__CAL_MATRIX": (matrix.T if store == "BYROW" else matrix)[:, :, None],
        "FORCE_PLATFORM__MATRIX_STORE": [store],
    }
    path = plate_file(tmp_path, **parameters)

    assert wrench_of(path) == pytest.approx([21, -2, -3, 4, -5, -6], rel=1e-6)


def test_the_baseline_that_is_asked_for_is_subtracted(tmp_path):
    readings = np.arange(144.0).reshape(24, 6)
    path = plate_file(tmp_path, readings)

    as_is = read(path)
    zeroed = read(path, plate_zero=[2, 3])

    assert zeroed.facts["plate_zero_frames"] == (2, 3)
    for column in ("plate1_force_z", "plate1_moment_x"):
        values = as_is.samples[column]
        expected = values - values[4:12].mean()  # frames 2 and 3 of 4 samples each
        np.testing.assert_allclose(zeroed.samples[column], expected, atol=1e-9)


def test_frames_at_the_end_without_forces_are_left_out(tmp_path):
    forces = READINGS.copy()
    forces[17:] = np.nan

    recording = formats.read(plate_file(tmp_path, forces))

    assert (recording.loss.read, recording.loss.expected) == (4, 6)
    assert recording.find({"channel": "Force.Fz1"}).values.size == 16
    assert " 2 frames" in recording.loss.remarks[0]


def test_rotations_without_markers_are_named(tmp_path):
    path = write_c3d(tmp_path / "a.c3d", np.zeros((8, 0, 4)), rate=85.0, ROTATION__USED=3)

    assert "85 Hz" in refused(path)


# --- wrenches in closed form --------------------------------------------------------------------

RANDOM = np.random.default_rng(3)
FORCE = RANDOM.normal(0, 300, (20, 3))
MOMENT = RANDOM.normal(0, 40, (20, 3))
AXES = Rotation.from_euler("ZYX", [0.7, 0.2, np.pi - 0.1]).as_matrix()  # z down, tilted and turned
CORNERS = [1.0, -2.0, 0.3] + FACE @ AXES.T
# from the plate's origin to the centre of its surface, plate axes
SURFACE = np.array([0.004, -0.007, -0.045])


@pytest.mark.parametrize("stored", [1, -1])
def test_type_2_gives_the_wrench_back_whichever_way_origin_points(stored):
    force, moment = (FORCE @ AXES, MOMENT @ AXES)
    # moments about the plate's origin: M + r x F
    channels = np.hstack([force, moment + np.cross(SURFACE, force)])

    of_plate = wrench(2, CORNERS, stored * SURFACE, channels)

    np.testing.assert_allclose(of_plate[0], FORCE, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(of_plate[1], MOMENT, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("depth_sign", [1, -1])
def test_type_3_gives_the_wrench_of_its_four_sensors_back(depth_sign):
    a = 0.12
    b = 0.2
    depth = 0.054
    # z down: under the surface
    sensors = np.sign(FACE) * [a, b, 0] + [0, 0, depth]
    forces = RANDOM.normal(0, 100, (20, 4, 3))
    total = forces.sum(axis=1)
    moment = np.cross(sensors, forces).sum(axis=1)
    x, y, z = forces.transpose(2, 1, 0)
    channels = np.column_stack([x[0] + x[1], x[2] + x[3], y[0] + y[3], y[1] + y[2], *z])

    of_plate = wrench(3, CORNERS, np.array([a, b, depth_sign * depth]), channels)

    np.testing.assert_allclose(of_plate[0], total @ AXES.T, atol=1e-9)
    np.testing.assert_allclose(of_plate[1], moment @ AXES.T, atol=1e-9)


# --- real files ---------------------------------------------------------------------------------


@pytest.mark.recordings
@pytest.mark.parametrize(
    ("name", "rounding_mm"), [("vr", 0), ("pi", 2e-4), ("vi", 2e-4), ("si", 2e-4)]
)
def test_one_trial_is_the_same_in_files_of_three_processors(recordings, name, rounding_mm):
    intel, other = (
        formats.read(recordings / "c3d" / f"Eb015{kind}.c3d").channels for kind in ("pr", name)
    )

    for channel, its_twin in zip(other, intel, strict=True):
        assert channel.key == its_twin.key
        np.testing.assert_allclose(channel.values, its_twin.values, rtol=0, atol=rounding_mm)


@pytest.mark.recordings
@pytest.mark.parametrize(
    "name",
    [
        "btk_PiG_Motion3_FF.c3d",
        "opensim_jogging_300_1500.c3d",
        "qtm_JH_01_300_1200_plate_offset.c3d",
        "Eb015pr.c3d",
    ],
)
def test_points_and_analogs_of_real_files_equal_ezc3ds(recordings, name):
    path = recordings / "c3d" / name

    recording = formats.read(path)
    other = ezc3d.c3d(str(path))["data"]

    points = [channel for channel in recording.channels if "label" in channel.address]
    analogs = [channel for channel in recording.channels if "channel" in channel.address]
    for place, channel in enumerate(points):
        theirs = other["points"][:3, place].T
        seen = np.isfinite(channel.values)
        np.testing.assert_allclose(channel.values[seen], theirs[seen], rtol=1e-6, atol=1e-6)
    for place, channel in enumerate(analogs):
        np.testing.assert_allclose(channel.values, other["analogs"][0, place], rtol=1e-6, atol=1e-6)
