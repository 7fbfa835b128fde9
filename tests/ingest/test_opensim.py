# SPDX-License-Identifier: Apache-2.0
"""Files of OpenSim: markers in TRC and tables in .mot and .sto give canonical columns, or a line
that says why not."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from conftest import refused_with
from log_builders import FRAMES, WALK, write_opensim, write_trc
from recognised_files import read_recognised as read
from recognised_files import refusal_of as refused
from recognised_files import source_of

from osl_analysis.commands.trials import inspect_file
from osl_analysis.draft.draft_sheet import draft_trials
from osl_analysis.draft.draft_source import draft_source
from osl_analysis.formats import read as formats_read
from osl_analysis.ingest.raw_files import trial_from_files
from osl_analysis.ingest.several_clocks import check_clocks

UPRIGHT = {"axes": ("x", "-z", "y")}


def write_mot(path, header="inDegrees=yes"):
    """A table with an angle of k degrees and a moment of -k / 4."""
    k = np.arange(50.0)
    columns = {"time": 0.5 + k / 100, "ankle_angle_r": k, "ankle_moment": -k / 4}
    return write_opensim(path, columns, header)


ANKLE = {"column": "ankle_angle_r", "unit": "deg"}
MOT = {
    "format": "opensim",
    "channels": {"theta": ANKLE, "torque": {"column": "ankle_moment", "unit": "N*m", "sign": -1}},
}


# --- markers ------------------------------------------------------------------------------------


def test_markers_of_trc_are_metres_in_our_axes(tmp_path):
    positions = WALK.copy()
    positions[3:6, 1] = np.nan
    positions[8, 2] = 0.0

    samples = read(write_trc(tmp_path / "walk.trc", positions), **UPRIGHT).samples

    np.testing.assert_allclose(samples["time"], np.arange(FRAMES) / 100)
    toe = samples.select("^marker_TOE_[xyz]$").to_numpy()
    np.testing.assert_allclose(toe, WALK[:, 3, [0, 2, 1]] * [1, -1, 1] / 1000, atol=1e-8)
    assert np.flatnonzero(samples["marker_HIP_x"].is_nan()).tolist() == [3, 4, 5]
    assert np.flatnonzero(samples["marker_KNEE_z"].is_nan()).tolist() == [8]


def test_axes_that_do_not_point_up_are_doubted_and_drafted(tmp_path):
    path = write_trc(tmp_path / "walk.trc", start=2.5, first=7)

    assert [*inspect_file(path).facts.values()] == ["40", "7", "100.0", "1", "mm", "2.5"]
    assert any("`axes: [x, -z, y]`" in text for text in read(path).warnings)
    assert read(path, **UPRIGHT).warnings == []
    assert yaml.safe_load(draft_source(inspect_file(path), "a.trc"))["axes"] == ["x", "-z", "y"]
    # Cortex leaves virtual ones out
    assert read(write_trc(path, WALK[:, :3, [0, 2, 1]], NumMarkers=3)).warnings == []


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("\n21\t", "\n22\t", "line 27: .* 22 "),
        ("160.00000", "abc", "line 27, HEAD X: 'abc'"),
    ],
)
def test_rows_that_contradict_the_header_or_one_another_are_refused(tmp_path, old, new, reason):
    path = write_trc(tmp_path / "walk.trc")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))

    assert re.search(reason, refused(path))


@pytest.mark.parametrize(
    ("header", "reason"),
    [({"NumFrames": 41}, "NumFrames '41'.* 40 "), ({"Units": "parsnip"}, "'parsnip'")],
)
def test_a_header_that_cannot_be_is_refused(tmp_path, header, reason):
    assert re.search(reason, refused(write_trc(tmp_path / "walk.trc", **header)))


# --- tables -------------------------------------------------------------------------------------


def test_rows_that_the_header_contradicts_are_refused(tmp_path):
    path = write_mot(tmp_path / "a.mot")
    path.write_text(path.read_text().replace("nRows=50", "nRows=60"))

    with refused_with("60 rows.*50"):
        formats_read(path, source_of("opensim", **MOT)).channels[0].read()


@pytest.mark.parametrize(("sign", "header"), [("\t", "range 0 1"), ("   ", "inDegrees=yes")])
def test_a_table_is_read_with_any_blank_and_header(tmp_path, sign, header):
    path = write_mot(tmp_path / "a.mot", header)
    path.write_text(path.read_text().replace("\t", sign))

    samples = read(path, **MOT).samples

    np.testing.assert_allclose(samples["torque"], np.arange(50) / 4)
    np.testing.assert_allclose(samples["theta"], np.radians(np.arange(50)))


@pytest.mark.parametrize(
    ("header", "unit", "message"),
    [("inDegrees=no", "deg/s", "rad/s"), ("inDegrees=yes", "rad/s", "deg/s")],
)
def test_a_unit_of_angles_that_the_header_contradicts_is_refused(tmp_path, header, unit, message):
    path = write_mot(tmp_path / "a.sto", header)

    assert message in refused(path, channels={"omega_m": {**ANKLE, "unit": unit}})


# --- ground reactions ---------------------------------------------------------------------------

CORNERS = [[0.0, 0.0, -0.3], [0.6, 0.0, -0.3], [0.6, 0.0, 0.1], [0.0, 0.0, 0.1]]
PLATE = {"force": "R_v", "point": "R_p", "moment": "R_m", "corners": CORNERS}
K = np.arange(80)
FORCE = np.column_stack([20 * np.sin(K / 9), 700 + K, 5 * np.cos(K / 9)])  # N
POINT = np.column_stack([0.1 + 0.004 * K, 0 * K, np.full(80, -0.12)])  # m
MOMENTS = np.column_stack([0 * K, 2 * np.sin(K / 5), 0 * K])  # about the point [N*m]


def write_forces(folder, start=0.0, names=("R_v", "R_p", "R_m")):
    """Ground reactions in OpenSim's axes at 200 Hz."""
    columns = {"time": start + K / 200}
    for begin, values in zip(names, (FORCE, POINT, MOMENTS), strict=True):
        columns |= {f"{begin}{axis}": values[:, place] for place, axis in enumerate("xyz")}
    return write_opensim(folder / "grf.mot", columns)


def test_a_plate_gives_the_moment_about_its_centre_in_our_axes(tmp_path):
    path = write_forces(tmp_path)
    recording = read(path, plates={1: PLATE})
    pushed = read(path, plates={1: {**PLATE, "sign": -1}}).samples

    about_centre = MOMENTS + np.cross(POINT - [0.3, 0.0, -0.1], FORCE)
    for values, quantity in ((FORCE, "force"), (about_centre, "moment")):
        names = f"^plate1_{quantity}_[xyz]$"
        ours = values[:, [0, 2, 1]] * [1, -1, 1]  # forward x, left -z, up y
        np.testing.assert_allclose(recording.samples.select(names), ours, atol=1e-6)
        np.testing.assert_allclose(pushed.select(names), -ours, atol=1e-6)


def test_markers_and_ground_reactions_of_one_export_share_their_times(tmp_path):
    write_trc(tmp_path / "walk.trc", start=2.0)
    write_forces(tmp_path, start=1.95)
    (tmp_path / "trc.yaml").write_text("format: trc\naxes: [x, -z, y]\n")
    (tmp_path / "mot.yaml").write_text(
        yaml.safe_dump({"format": "opensim", "clock": "common", "plates": {1: PLATE}})
    )
    row = {"trial": "a", "log": "grf.mot", "log_source": "mot"}
    row |= {"mocap": "walk.trc", "mocap_source": "trc"}

    trial = trial_from_files(row, tmp_path, tmp_path)

    rows = trial.samples.drop_nulls("plate1_force_z")
    at = np.rint((rows["time"].to_numpy() + 0.05) * 200).astype(int)
    np.testing.assert_allclose(rows["plate1_force_z"], FORCE[at, 1], atol=1e-6)
    assert trial.provenance["clock"]["method"] == "common"
    assert len(trial.samples.drop_nulls("marker_TOE_x")) == FRAMES


@pytest.mark.parametrize("name", ["walk_grf.mot", "walk_forces.mot"])
def test_a_trc_finds_its_table_of_forces(name):
    recordings = [(Path(name), "opensim", False), (Path("walk.trc"), "trc", True)]

    (trial,) = draft_trials(recordings, {}, {})

    assert (trial.cells["log"], trial.cells["mocap"]) == (name, "walk.trc")


def test_the_draft_of_ground_reactions_proposes_their_plates(tmp_path):
    names = ("R_ground_force_v", "R_ground_force_p", "R_ground_torque_")
    path = write_forces(tmp_path, names=names)

    draft = draft_source(inspect_file(path), "grf.mot")

    (note,) = [line for line in draft.splitlines() if "force plates" in line]
    plate = yaml.safe_load(note.partition("corners: ")[2])["plates"][1]
    assert plate == dict(zip(PLATE, (*names, "UNKNOWN"), strict=True))
    assert len(read(path, plates={1: {**plate, "corners": CORNERS}}).samples) == 80


@pytest.mark.parametrize(
    ("cells", "stated", "message"),
    [
        ({}, {"plates": {1: {**PLATE, "force": "L_v"}}}, "'L_vx'"),
        ({"700.0": "nan"}, {"plates": {1: PLATE}}, "'R_vy': nan .* 1 .* 80"),
    ],
)
def test_plates_that_cannot_be_read_are_refused(tmp_path, cells, stated, message):
    path = write_forces(tmp_path)
    for old, new in cells.items():
        path.write_text(path.read_text().replace(old, new, 1))

    assert re.search(message, refused(path, **stated))


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"plates": {1: PLATE}, "axes": ("x", "y", "-z")}, "'x', 'y', '-z'"),
        ({}, "`channels`,.*plates.*`plates`"),
        (
            {
                "plates": {1: PLATE},
                "clock": "common",
                "time": {"column": None, "unit": None, "rate": 100},
            },
            "{column: time, unit: s}",
        ),
    ],
)
def test_a_source_file_that_cannot_be_is_refused(stated, message):
    with pytest.raises(ValueError, match=message):
        source_of("opensim", **stated)


def test_only_trc_states_times_that_a_log_may_share():
    common = source_of("opensim", **MOT, clock="common")

    check_clocks({"log": common, "mocap": source_of("trc")})
    with refused_with(r"'common'.*log"):
        check_clocks({"log": common, "mocap": source_of("c3d")})
