"""Files of OpenSim: markers in TRC and tables in .mot and .sto give canonical columns, or a line
that says why not."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import yaml
from c3d_builder import REAL_DATA
from recognised_files import read_recognised as read
from recognised_files import refusal_of as refused

from osl_analysis.commands.trials import inspect_file
from osl_analysis.draft.draft_sheet import draft_trials
from osl_analysis.draft.draft_source import draft_source
from osl_analysis.errors import InputError
from osl_analysis.formats import known_formats
from osl_analysis.ingest.capture import vertical_axis
from osl_analysis.ingest.raw_files import check_clocks, trial_from_files
from osl_analysis.recording import Channel, Plate, Rows
from osl_analysis.trial import Array

FRAMES, LABELS, HEIGHTS = 40, ["HEAD", "HIP", "KNEE", "TOE"], np.array([1700.0, 900.0, 500.0, 50.0])


def walk() -> Array:
    """Positions (frames, markers, 3) [mm] in OpenSim's axes: x forward, y up, z to the right."""
    step = np.arange(FRAMES)
    x, y = 8.0 * step[:, None] + np.arange(4), HEIGHTS + 5 * np.sin(step / 5)[:, None]
    return np.stack([x, y, np.full((FRAMES, 4), -100.0) + np.arange(4)], axis=2)


def write_trc(
    path: Path, positions: Array, rate: float = 100, start: float = 0, first: int = 1, **header: Any
) -> Path:
    """A file as Cortex writes it; `header` replaces what its second line names."""
    said = {
        "DataRate": rate,
        "CameraRate": rate,
        "NumFrames": len(positions),
        "NumMarkers": len(LABELS),
        "Units": "mm",
    }
    said.update(header)
    lines = [
        "PathFileType\t4\t(X/Y/Z)\twalk.trc",
        "\t".join(said),
        "\t".join(str(value) for value in said.values()),
    ]
    lines += ["\t".join(["Frame#", "Time", *(f"{label}\t\t" for label in LABELS)])]
    lines += [
        "\t\t" + "\t".join(f"{axis}{i + 1}" for i in range(len(LABELS)) for axis in "XYZ"),
        "",
    ]
    for k, frame in enumerate(positions):
        cells = ["" if np.isnan(value) else f"{value:.5f}" for value in frame.ravel()]
        lines.append("\t".join([str(k + first), f"{start + k / rate:.3f}", *cells, ""]))
    path.write_text("\n".join(lines) + "\n")
    return path


def write_mot(path: Path, header: str = "inDegrees=yes", rows: int = 50, **counts: int) -> Path:
    """A table with an angle of k degrees, a moment of -k / 4 and a force."""
    counts = {"nRows": rows, "nColumns": 4, **counts}
    lines = [
        "Coordinates",
        "version=1",
        *(f"{key}={value}" for key, value in counts.items()),
        header,
        "endheader",
    ]
    lines.append("time\tankle_angle_r\tankle_moment\tground_force_vy")
    lines += [f"{0.5 + 0.01 * k:.8f}\t{k}\t    {-k / 4}\t{700 + k}" for k in range(rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


ANKLE, MOMENT = (
    {"column": "ankle_angle_r", "unit": "deg"},
    {"column": "ankle_moment", "unit": "N*m", "sign": -1},
)
MOT = {"format": "opensim", "channels": {"theta": ANKLE, "torque": MOMENT}}


def test_markers_of_trc_are_metres_in_our_axes(tmp_path: Path) -> None:
    positions = walk()
    positions[3:6, 1] = np.nan
    positions[8, 2] = 0.0
    write_trc(tmp_path / "walk.trc", positions)
    (tmp_path / "cortex.yaml").write_text("format: trc\naxes: [x, -z, y]\n")
    trial = trial_from_files(
        {"trial": "a", "mocap": "walk.trc", "mocap_source": "cortex"}, tmp_path, tmp_path
    )
    np.testing.assert_allclose(trial.samples["time"], np.arange(FRAMES) / 100)
    for axis, expected in (
        ("x", positions[:, 3, 0]),
        ("y", -positions[:, 3, 2]),
        ("z", positions[:, 3, 1]),
    ):
        np.testing.assert_allclose(trial.samples[f"marker_TOE_{axis}"], expected / 1000, atol=1e-8)
    assert np.flatnonzero(trial.samples["marker_HIP_x"].is_nan()).tolist() == [3, 4, 5]
    assert (
        np.flatnonzero(trial.samples["marker_KNEE_z"].is_nan()).tolist(),
        trial.provenance["warnings"],
    ) == ([8], [])


def test_axes_that_do_not_point_up_are_doubted_and_drafted(tmp_path: Path) -> None:
    path = write_trc(tmp_path / "walk.trc", walk(), start=2.5, first=7)
    assert [*inspect_file(path).facts.values()] == ["40", "7", "100.0", "1", "mm", "2.5"]
    assert any("state `axes: [x, -z, y]`" in text for text in read(path).warnings)
    assert read(path, axes=("x", "-z", "y")).warnings == []
    assert yaml.safe_load(draft_source(inspect_file(path), "walk.trc"))["axes"] == ["x", "-z", "y"]
    assert read(write_trc(tmp_path / "b.trc", walk()[:, :, [0, 2, 1]])).warnings == []
    # Cortex leaves virtual ones out
    (note,) = read(write_trc(path, walk()[:, :3], NumMarkers=3)).warnings
    assert note == "walk.trc: 1 names after the 3 markers have no positions, such as TOE"


def test_rows_that_contradict_the_header_or_one_another_are_refused(
    tmp_path: Path,
) -> None:
    path = tmp_path / "walk.trc"
    for header, reason in (
        ({"NumFrames": 41}, "NumFrames is 41, the file holds 40 rows: the end is missing"),
        ({"NumMarkers": 5}, "NumMarkers is 5"),
        ({"DataRate": 101}, "does not fit the rate of 101 Hz"),
    ):  # fmt: skip
        assert reason in refused(write_trc(path, walk(), **header))
    lines = write_trc(path, walk()).read_text().splitlines()
    assert "no marker 'TOES'; the file has HEAD, HIP, KNEE, TOE; did you mean 'TOE'?" in refused(
        path, markers=["TOES"]
    )
    cells = lines[26].split("\t")
    for reason, line in {
        "frame 22 does not follow the line before": lines[26].replace("21\t", "22\t", 1),
        "'abc' is not a number": "\t".join([*cells[:4], "abc", *cells[5:]]),
        "line 27 has 4 coordinates, its header names 4 markers": "\t".join(cells[:6]),
        "line 27 has 15 coordinates, its header names 4 markers": "\t".join(
            [*cells[:14], "1", "2", "3"]
        ),
        "line 27: time nan s does not fit": lines[26].replace("0.200", ""),
    }.items():
        path.write_text("\n".join([*lines[:26], line, *lines[27:], ""]))
        assert reason in refused(path)
    path.write_text("\n".join(lines[:5]))
    assert "holds no frames" in refused(path)


@pytest.mark.parametrize("tabs", ["header", "rows", "both"])
def test_two_tabs_between_values_are_as_one(tmp_path: Path, tabs: str) -> None:
    """NumFrames was read from the column of CameraRate."""
    path = write_trc(tmp_path / "walk.trc", walk())
    lines = path.read_text().splitlines()
    if tabs != "rows":
        lines[2] = lines[2].replace("\t", "\t\t")
    if tabs != "header":
        lines[6:] = [line.rstrip("\t").replace("\t", "\t\t") for line in lines[6:]]
    path.write_text("\n".join(lines) + "\n")

    samples = read(path, axes=("x", "-z", "y")).samples

    np.testing.assert_allclose(samples["marker_TOE_z"], walk()[:, 3, 1] / 1000, atol=1e-8)


def test_plates_tell_the_axis_that_points_up_or_else_four_markers_of_a_walker() -> None:
    corners = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    level = Plate(1, 2, corners, np.zeros(3), [], "mm")
    stands = walk()[:1] + 0.2 * np.random.default_rng(0).standard_normal(walk().shape)

    assert vertical_axis(as_markers(walk() / 1000)) == "y"
    assert vertical_axis(as_markers(walk()[:, :3])) == ""
    assert vertical_axis(as_markers(stands)) == ""
    assert vertical_axis(as_markers(walk()), [level]) == "z"


def as_markers(positions: Array) -> list[Channel]:
    """Markers of positions (frames, markers, 3)."""
    rows = Rows(len(positions))
    return [
        Channel({"label": str(place)}, rows, lambda place=place: positions[:, place])
        for place in range(positions.shape[1])
    ]


@pytest.mark.parametrize("rate", [60, 120, 300, 1000])
def test_times_may_be_printed_with_more_decimals_than_they_have(
    tmp_path: Path, rate: float
) -> None:
    for start in (0, 9.4937):  # whose rounding is not that of the others
        path = write_trc(tmp_path / "walk.trc", walk(), rate, start)  # rounded to milliseconds
        path.write_text(
            text := re.sub(r"(?m)^(\d+\t\d+\.\d{3})\t", r"\g<1>000\t", path.read_text())
        )
        assert len(read(path).samples) == FRAMES
    line = text.splitlines()[25]
    time = float(line.split("\t")[1])
    for off in (-0.002, 0.002):  # more than rounding to milliseconds can do
        path.write_text(
            text.replace(line, re.sub(r"\t[\d.]+", f"\t{time + off:.3f}000", line, count=1))
        )
        assert f"line 26: time {time + off:.3f}"[:-1] in refused(path)
    path.write_text(re.sub(r"(?m)^(\d+\t)\d+\.\d{6}\t", r"\g<1>9.494000\t", text))
    assert f"time 9.494 s does not fit the rate of {rate:g} Hz from 9.494 s on" in refused(path)


def test_rows_of_a_table_that_cannot_be_right_are_refused(tmp_path: Path) -> None:
    text = (path := write_mot(tmp_path / "a.mot")).read_text()
    for reason, content in {
        "states 50 rows, the file holds 49 whole ones: its end": text.rstrip().rpartition("\t")[0],
        "header states 50 rows, the file holds 49 whole": text.rstrip()[:-1],
        "states 60 rows, the file holds 50 whole ones: its end": text.replace(
            "nRows=50", "nRows=60"
        ),
    }.items():
        path.write_text(content)
        assert reason in refused(path, **MOT)
    path.write_text(text.replace("\t", " "))
    assert read(path, **MOT).samples["torque"].to_list() == [k / 4 for k in range(50)]


def test_the_units_of_angles_are_those_that_the_header_says(tmp_path: Path) -> None:
    radians = write_mot(tmp_path / "a.sto", "inDegrees=no")
    assert (
        "column 'ankle_angle_r' is read in deg, and by `inDegrees` of its header it is in rad;"
        in refused(radians, **MOT)
    )
    assert "write rad/s" in refused(radians, channels={"omega_m": {**ANKLE, "unit": "deg/s"}})
    assert "write deg/s" in refused(
        write_mot(tmp_path / "b.mot"), channels={"omega_m": {**ANKLE, "unit": "rad/s"}}
    )
    assert read(write_mot(tmp_path / "b.mot", "range 0 1"), **MOT).samples["theta"][
        1
    ] == np.radians(1)
    draft = yaml.safe_load(draft_source(inspect_file(write_mot(tmp_path / "a.mot")), "a.mot"))
    assert (draft["format"], draft["time"]) == ("opensim", {"column": "time", "unit": "s"})
    assert [one["unit"] for one in draft["channels"].values()] == ["deg", "N*m"]


@pytest.mark.skipif(not REAL_DATA.is_dir(), reason="no recordings made by others here")
def test_real_files_of_opensim_are_read_as_numpy_reads_their_cells() -> None:
    path = REAL_DATA / "opensim" / "walk.trc"
    recording = read(path, axes=("x", "-z", "y"))
    cells = [line.split("\t") for line in path.read_text().splitlines()[6:] if line]
    heel = [float(row[2 + 3 * 11 + 1]) / 1000 for row in cells]  # the twelfth of its 28 markers
    np.testing.assert_allclose(recording.samples["marker_R.Heel_z"], heel, rtol=1e-12)
    assert "27 names after the 28 markers have no positions" in recording.warnings[0]
    path = REAL_DATA / "opensim" / "grf_run.mot"
    described = {"channels": {"plate1_force_z": {"column": "R_ground_force_vy", "unit": "N"}}}
    np.testing.assert_array_equal(
        read(path, **described).samples["plate1_force_z"], np.loadtxt(path, skiprows=7)[:, 2]
    )


CORNERS = [[0.0, 0.0, -0.3], [0.6, 0.0, -0.3], [0.6, 0.0, 0.1], [0.0, 0.0, 0.1]]
PLATE = {"force": "R_v", "point": "R_p", "moment": "R_m", "corners": CORNERS}


def write_forces(
    path: Path, rate: float = 200.0, rows: int = 80, start: float = 0.0
) -> tuple[Path, Array]:
    """Ground reactions in OpenSim's axes: force (rows, 3) [N], its point [m], and the moment about
    the point [N*m]."""
    k = np.arange(rows)
    force = np.column_stack([20 * np.sin(k / 9), 700 + k, 5 * np.cos(k / 9)])
    point = np.column_stack([0.1 + 0.004 * k, 0 * k, np.full(rows, -0.12)])
    table = np.column_stack(
        [start + k / rate, force, point, np.column_stack([0 * k, 2 * np.sin(k / 5), 0 * k])]
    )
    names = ["time", *(f"R_{kind}{axis}" for kind in "vpm" for axis in "xyz")]
    lines = ["grf", f"nRows={rows}", f"nColumns={len(names)}", "endheader", "\t".join(names)]
    path.write_text(
        "\n".join([*lines, *("\t".join(f"{value:.9f}" for value in row) for row in table)]) + "\n"
    )
    return path, table[:, 1:]


def test_a_plate_gives_the_moment_about_its_centre_in_our_axes(tmp_path: Path) -> None:
    path, table = write_forces(tmp_path / "grf.mot")
    recording = read(path, plates={1: PLATE})
    force, point, moment = (table[:, at : at + 3] for at in (0, 3, 6))
    ours = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]  # forward x, left -z, up y
    (rx, ry, rz), (fx, fy, fz) = (point - np.array([0.3, 0.0, -0.1])).T, force.T
    # r x F
    by_hand = moment + np.column_stack([ry * fz - rz * fy, rz * fx - rx * fz, rx * fy - ry * fx])
    for values, quantity in ((force, "force"), (by_hand, "moment")):
        found = recording.samples.select(f"plate1_{quantity}_{axis}" for axis in "xyz").to_numpy()
        np.testing.assert_allclose(found, values @ np.array(ours).T, atol=1e-6)
    (plate,) = recording.facts["plates"]
    np.testing.assert_allclose(np.mean(plate["corners"], axis=0), [0.3, 0.1, 0.0], atol=1e-12)
    # the other moments about the point are zero by definition, and no loose cable
    assert [one["label"] for one in plate["channels"]] == ["R_vx", "R_vy", "R_vz", "R_my"]
    assert not any(one["stands_samples"] for one in plate["channels"])
    pushed = read(path, plates={1: {**PLATE, "sign": -1}}).samples.select(pl.col("^plate1_.*$"))
    np.testing.assert_allclose(
        pushed, -recording.samples.select(pushed.columns).to_numpy(), atol=1e-6
    )


def test_markers_and_ground_reactions_of_one_export_share_their_times(tmp_path: Path) -> None:
    write_trc(tmp_path / "walk.trc", walk(), 100.0, start=2.0)
    _, table = write_forces(tmp_path / "grf.mot", 200.0, start=1.95)
    (tmp_path / "trc.yaml").write_text("format: trc\naxes: [x, -z, y]\n")
    (tmp_path / "mot.yaml").write_text(
        yaml.safe_dump({"format": "opensim", "clock": "common", "plates": {1: PLATE}})
    )
    row = {
        "trial": "a",
        "log": "grf.mot",
        "log_source": "mot",
        "mocap": "walk.trc",
        "mocap_source": "trc",
    }
    trial = trial_from_files(row, tmp_path, tmp_path)
    rows = trial.samples.drop_nulls("plate1_force_z")
    at = np.rint((rows["time"].to_numpy() + 0.05) * 200).astype(int)
    np.testing.assert_allclose(rows["plate1_force_z"], table[at, 1], atol=1e-6)
    assert (trial.provenance["clock"]["method"], trial.provenance["clock"]["rows_before"]) == (
        "common",
        10,
    )
    assert (
        trial.provenance["plates"][0]["plate"],
        len(trial.samples.drop_nulls("marker_TOE_x")),
    ) == (1, FRAMES)


@pytest.mark.parametrize("name", ["walk.mot", "walk_grf.mot", "walk_forces.mot", "walk-GRF.sto"])
def test_a_trc_finds_its_table_of_forces(name: str) -> None:
    recordings = [(Path(name), "opensim", False), (Path("walk.trc"), "trc", True)]

    (trial,) = draft_trials(recordings)

    assert (trial.cells["log"], trial.cells["mocap"]) == (name, "walk.trc")


@pytest.mark.parametrize(
    ("stem", "moment"),
    [("R_ground_force_", "R_ground_torque_"), ("ground_force_1_", "ground_moment_1_")],
)
def test_the_draft_of_ground_reactions_proposes_their_plates(
    tmp_path: Path, stem: str, moment: str
) -> None:
    names = [
        "time",
        *(f"{begin}{axis}" for begin in (f"{stem}v", f"{stem}p", moment) for axis in "xyz"),
    ]
    rows, path = (
        ["\t".join(["0.01", *["1"] * 9]), "\t".join(["0.02", *["1"] * 9])],
        tmp_path / "grf.mot",
    )
    path.write_text("\n".join(["grf", "endheader", "\t".join(names), *rows, ""]))
    (note,) = [
        line
        for line in draft_source(inspect_file(path), "grf.mot").splitlines()
        if "force plates" in line
    ]
    drafted = yaml.safe_load(note.partition("corners: ")[2])["plates"][1]
    assert drafted == {
        "force": f"{stem}v",
        "point": f"{stem}p",
        "moment": moment,
        "corners": "UNKNOWN",
    }
    assert len(read(path, plates={1: {**drafted, "corners": CORNERS}}).samples) == 2


def test_plates_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    path, _ = write_forces(tmp_path / "grf.mot")
    assert "no column 'L_vx'" in refused(path, plates={1: {**PLATE, "force": "L_v"}})
    common = known_formats()["opensim"].source.model_validate({**MOT, "clock": "common"})
    check_clocks(common, known_formats()["trc"].source(format="trc"))
    # only TRC states times
    with pytest.raises(InputError, match="'common' does not align the log"):
        check_clocks(common, known_formats()["c3d"].source(format="c3d"))
    path.write_text(
        path.read_text().replace("0.005000000", "0.000000000", 1).replace("700.000000000", "nan", 1)
    )
    assert "plates need all; remove `repeated: drop`" in refused(
        path, plates={1: PLATE}, time={"repeated": "drop"}
    )
    assert "column 'R_vy': nan in sample 1 of 80" in refused(path, plates={1: PLATE})
    by_rate = {"clock": "common", "time": {"column": None, "unit": None, "rate": 100}}
    for stated, told in (
        (
            {"plates": {1: PLATE}, "axes": ("x", "y", "-z")},
            "three different axes of a right-handed laboratory",
        ),
        ({}, "under `channels`, or plates under `plates`"),
        ({"plates": {1: PLATE}, **by_rate}, "needs the column of time in s"),
    ):
        with pytest.raises(ValueError, match=told):
            read(path, **stated)
