"""C3D: frames and plates of whole, cut and odd files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c3d_builder import REAL_DATA, write_c3d

from osl_analysis import formats
from osl_analysis.errors import InputError
from osl_analysis.formats.c3d import C3dSource
from osl_analysis.recording import Kind, Recording

CORNERS = np.array([[400.0, 600, 0], [0, 600, 0], [0, 0, 0], [400, 0, 0]])
PLATE_LABELS = ["Force.Fx1", "Force.Fy1", "Force.Fz1", "Moment.Mx1", "Moment.My1", "Moment.Mz1"]
PLATE = {
    "FORCE_PLATFORM__USED": np.array([1]),
    "FORCE_PLATFORM__TYPE": np.array([2]),
    "FORCE_PLATFORM__CHANNEL": np.array([[1], [2], [3], [4], [5], [6]]),
    "FORCE_PLATFORM__CORNERS": CORNERS.T[:, :, None],
    "FORCE_PLATFORM__ORIGIN": np.array([[0.0], [0.0], [-40.0]]),
}


def seen_points(frames: int = 8, points: int = 2) -> np.ndarray:
    """Positions 1, 2, 3 ... with a residual of 0."""
    positions = np.ones((frames, points, 4))
    positions[:, :, :3] = 1.0 + np.arange(frames * points * 3).reshape(frames, points, 3)
    positions[:, :, 3] = 0.0
    return positions


def source(**stated: Any) -> C3dSource:
    return C3dSource.model_validate({"format": "c3d", **stated})


def refusal(path: Path, stated: C3dSource | None = None) -> str:
    with pytest.raises(InputError, match=r"^[^\n]+$") as caught:
        formats.read(path, stated)
    return str(caught.value)


def values_of(recording: Recording, key: str, name: str) -> np.ndarray:
    return recording.find({key: name}).values


@pytest.mark.parametrize("integers", [False, True])
def test_integers_and_reals_are_read(tmp_path: Path, integers: bool) -> None:
    analogs = np.array([[-300.0], [250.0]] * 8)
    path = write_c3d(tmp_path / "a.c3d", seen_points(), analogs, integers=integers)

    recording = formats.read(path)

    factor = 0.1 if integers else 1.0  # POINT:SCALE of the builder
    np.testing.assert_allclose(
        values_of(recording, "label", "M2"), factor * seen_points()[:, 1, :3], rtol=1e-6
    )
    np.testing.assert_array_equal(values_of(recording, "channel", "A1"), analogs[:, 0])


def test_numbers_of_old_processors_are_refused_with_what_to_do(tmp_path: Path) -> None:
    path = write_c3d(tmp_path / "a.c3d", seen_points())
    content = bytearray(path.read_bytes())
    content[512 * (content[0] - 1) + 3] = 86  # MIPS
    path.write_bytes(content)

    assert "not in the format of Intel processors, which alone is read; open" in refusal(path)


def test_a_sample_is_raw_minus_offset_times_both_scales(tmp_path: Path) -> None:
    path = write_c3d(
        tmp_path / "a.c3d", seen_points(), np.full((8, 1), 100.0),
        ANALOG__OFFSET=np.array([20]), ANALOG__SCALE=np.array([0.5]),
        ANALOG__GEN_SCALE=np.array([0.1]),
    )  # fmt: skip

    samples = values_of(formats.read(path), "channel", "A1")

    np.testing.assert_allclose(samples, (100 - 20) * 0.5 * 0.1, rtol=1e-6)


def test_an_unsigned_offset_is_no_negative_one(tmp_path: Path) -> None:
    path = write_c3d(
        tmp_path / "a.c3d", seen_points(), np.full((8, 1), 40_000), integers=True,
        ANALOG__OFFSET=np.array([32_768]), ANALOG__FORMAT=["UNSIGNED"],
    )  # fmt: skip

    samples = values_of(formats.read(path), "channel", "A1")

    np.testing.assert_array_equal(samples, 40_000 - 32_768)


def test_a_file_that_is_cut_is_refused_with_both_counts(tmp_path: Path) -> None:
    path = write_c3d(tmp_path / "a.c3d", seen_points(100))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) - 2048])

    said = refusal(path)

    assert "truncated: it declares 100 frames and holds" in said


@pytest.mark.parametrize(("first_zero", "whole"), [(96, 100), (99, 98)])
def test_a_c3d_file_that_ends_in_zeros_is_whole(
    tmp_path: Path, first_zero: int, whole: int
) -> None:
    """A joint at rest; of a single sub-frame of zeros, which was not recorded, the frame is left
    out."""
    analogs = np.random.default_rng(2).normal(0, 1, (100, 4))
    analogs[first_zero:] = 0.0

    recording = formats.read(write_c3d(tmp_path / "a.c3d", np.ones((50, 3, 4)), analogs))

    samples = [part.values for part in recording.channels if "channel" in part.address]
    np.testing.assert_allclose(np.column_stack(samples), analogs[:whole], rtol=1e-6)


def test_what_fills_the_last_block_of_a_c3d_file_is_not_looked_at(tmp_path: Path) -> None:
    """Some writers leave there what their memory held."""
    path = write_c3d(tmp_path / "a.c3d", np.ones((50, 3, 4)))
    content = path.read_bytes()
    assert content.endswith(bytes(16))
    path.write_bytes(content[:-16] + b"left in a buffer")

    assert formats.read(path).loss.lost == 0


def test_a_second_parameter_goes_on_with_the_labels_of_the_first(tmp_path: Path) -> None:
    path = write_c3d(
        tmp_path / "a.c3d", seen_points(points=3),
        POINT__LABELS=["A", "B"], POINT__LABELS2=["C"],
    )  # fmt: skip

    labels = [one.address["label"] for one in formats.read(path).channels]

    assert labels == ["A", "B", "C"]


# --- plates -------------------------------------------------------------------------------------


def write_plate(path: Path, forces: np.ndarray | None = None, **parameters: Any) -> Path:
    analogs = np.zeros((8, 6)) if forces is None else forces
    labels = {"ANALOG__LABELS": PLATE_LABELS, "ANALOG__UNITS": ["N"] * 3 + ["N*mm"] * 3}
    return write_c3d(path, seen_points(), analogs, **{**labels, **parameters})


def test_a_plate_of_another_type_is_a_question_with_what_to_do(tmp_path: Path) -> None:
    path = write_plate(tmp_path / "a.c3d", **PLATE | {"FORCE_PLATFORM__TYPE": np.array([6])})

    listed = formats.read(path)

    assert not listed.plates
    (question,) = listed.questions
    assert "plate 1 is of type 6" in question
    assert "state it as type 2 under `plate_geometry`" in question
    (stated,) = formats.read(path, source(plate_geometry=STATED)).plates
    assert stated.type == 2
    assert not formats.read(path, source(plates=[])).plates


STATED = {
    1: {"type": 2, "channels": PLATE_LABELS, "corners": CORNERS.tolist(), "origin": [0, 0, -40]}
}


def test_without_force_platform_the_refusal_says_the_key_that_states_a_plate(
    tmp_path: Path,
) -> None:
    path = write_plate(tmp_path / "a.c3d")

    said = refusal(path, source(plates=[1]))

    assert "no force plate 1; the file describes 0, counted from 1" in said
    assert "`plate_geometry: {1: {type: 2, channels: [Fx, Fy, Fz, Mx, My, Mz]" in said
    assert "look like those of a force plate" in formats.read(path).questions[0]


def test_a_plate_that_the_source_file_states_is_as_one_of_the_file(tmp_path: Path) -> None:
    described = formats.read(write_plate(tmp_path / "a.c3d", **PLATE)).plates[0]
    by_number = {1: {**STATED[1], "channels": [1, 2, 3, 4, 5, 6]}}

    for geometry in (STATED, by_number):
        (plate,) = formats.read(
            write_plate(tmp_path / "b.c3d"), source(plate_geometry=geometry)
        ).plates
        assert plate.type == described.type
        assert [one.key for one in plate.channels] == [one.key for one in described.channels]
        np.testing.assert_array_equal(plate.corners, described.corners)
        np.testing.assert_array_equal(plate.origin, described.origin)


def test_a_stated_channel_that_the_file_lacks_is_refused(tmp_path: Path) -> None:
    wrong = {1: {**STATED[1], "channels": [*PLATE_LABELS[:5], "Mz"]}}
    path = write_plate(tmp_path / "a.c3d")

    assert "'Mz' names 0 analog channels" in refusal(path, source(plate_geometry=wrong))
    with pytest.raises(ValueError, match="a plate of type 3 has 8 channels, 6 are named"):
        source(plate_geometry={1: {**STATED[1], "type": 3}})


def test_frames_at_the_end_without_forces_are_left_out(tmp_path: Path) -> None:
    forces = np.random.default_rng(1).normal(size=(16, 6))
    forces[11:] = np.nan

    recording = formats.read(write_plate(tmp_path / "a.c3d", forces, **PLATE))

    assert recording.facts["frames"] == 5
    assert recording.loss.read == 5
    assert recording.loss.expected == 8
    assert values_of(recording, "channel", "Force.Fz1").size == 10
    assert "the last 3 frames, in which samples are no numbers" in recording.loss.remarks[0]


def test_rotations_without_markers_are_named(tmp_path: Path) -> None:
    path = write_c3d(
        tmp_path / "a.c3d", np.zeros((8, 0, 4)), rate=85.0, ROTATION__USED=np.array([3])
    )

    assert "holds 3 rotations of segments at 85 Hz and no marker: rotations are not read" in (
        refusal(path)
    )


# --- real files ---------------------------------------------------------------------------------


@pytest.mark.skipif(not REAL_DATA.is_dir(), reason="no recordings made by others here")
@pytest.mark.parametrize(
    "name",
    [
        "btk_PiG_Motion3_FF.c3d",
        "opensim_jogging_300_1500.c3d",
        "qtm_JH_01_300_1200_plate_offset.c3d",
        "Eb015pr.c3d",
    ],
)
def test_points_and_analogs_of_real_files_equal_ezc3ds(name: str) -> None:
    ezc3d = pytest.importorskip("ezc3d")
    path = REAL_DATA / "c3d" / name

    recording = formats.read(path)
    other = ezc3d.c3d(str(path))["data"]

    points = [one for one in recording.channels if "label" in one.address]
    analogs = [one for one in recording.channels if "channel" in one.address]
    for place, channel in enumerate(points):
        theirs = other["points"][:3, place].T
        seen = np.isfinite(channel.values)
        np.testing.assert_allclose(channel.values[seen], theirs[seen], rtol=1e-6, atol=1e-6)
    for place, channel in enumerate(analogs):
        np.testing.assert_allclose(channel.values, other["analogs"][0, place], rtol=1e-6, atol=1e-6)


@pytest.mark.skipif(not REAL_DATA.is_dir(), reason="no recordings made by others here")
def test_one_trial_in_integers_and_in_reals_is_one_trial() -> None:
    integers, reals = (formats.read(REAL_DATA / f"c3d/Eb015{kind}.c3d") for kind in ("pi", "pr"))

    for channel, other in zip(integers.channels, reals.channels, strict=True):
        step = 0.1 if channel.kind == Kind.MARKER else 2.0  # of the integers
        np.testing.assert_allclose(channel.values, other.values, atol=step)
