# SPDX-License-Identifier: Apache-2.0
"""Exports of Qualisys and OptiTrack: markers, plates and analog channels come out as they went in,
whatever the container, and what the files do not tell is asked for."""

import re

import numpy as np
import pytest
from log_builders import write_mat, write_mat73
from recognised_files import refusal_by, source_of

from osl_analysis import formats
from osl_analysis.ingest.raw_files import read_converted, recorded_files, recordings_in

FRAMES, RATE_HZ, PER_FRAME = 6, 100, 4
LABELS = ["HEEL", "TOE", "KNEE"]
RANDOM = np.random.default_rng(4)
POSITIONS = RANDOM.normal(0, 500, (FRAMES, len(LABELS), 3))  # mm, laboratory
POSITIONS[2, 1] = 0  # not seen
FORCE = RANDOM.normal(0, 300, (FRAMES * PER_FRAME, 3))  # N on the foot, laboratory
MOMENT = RANDOM.normal(0, 40, (FRAMES * PER_FRAME, 3))  # N*m about the plate's centre
SYNC = np.arange(FRAMES * PER_FRAME) / 7
# +x+y, -x+y, -x-y, +x-y of the plate's axes, whose y and z are the laboratory's turned round [mm]
CORNERS = np.array([[600.0, 0, 0], [0, 0, 0], [0, 400, 0], [600, 400, 0]])
TO_PLATE = [1, -1, -1]


def tsv_text(keys, header, *columns):
    rows = ["\t".join([key, *map(str, np.ravel(value))]) for key, value in keys.items()]
    rows += ["\t".join(header)] * bool(header)
    rows += ["\t".join(f"{number:.9g}" for number in row) for row in np.column_stack(columns)]
    return "\n".join(rows) + "\n"


def write_tsv(folder, description="Force data in world (lab) coordinates", header=True, columns=2):
    """An export of markers, one plate and one analog board."""
    time = np.arange(FRAMES) / RATE_HZ
    fast = np.arange(FRAMES * PER_FRAME) / RATE_HZ / PER_FRAME
    keys = {
        "NO_OF_FRAMES": FRAMES,
        "NO_OF_CAMERAS": 8,
        "NO_OF_MARKERS": len(LABELS),
        "FREQUENCY": RATE_HZ,
        "DESCRIPTION": "--",
        "DATA_INCLUDED": "3D",
        "MARKER_NAMES": LABELS,
    }
    names = [f"{label} {axis}" for label in LABELS for axis in "XYZ"]
    before = [np.arange(1, FRAMES + 1), time][:columns]
    head = [*["Frame", "Time"][:columns], *names] if header else []
    (folder / "walk.tsv").write_text(tsv_text(keys, head, *before, POSITIONS.reshape(FRAMES, -1)))
    of_plate = {
        "NO_OF_SAMPLES": FRAMES * PER_FRAME,
        "FREQUENCY": RATE_HZ * PER_FRAME,
        "DESCRIPTION": description,
        "FORCE_PLATE_NAME": "AMTI 1",
    }
    for corner, place in zip(
        ("POSX_POSY", "NEGX_POSY", "NEGX_NEGY", "POSX_NEGY"), CORNERS, strict=True
    ):
        for axis, coordinate in zip("XYZ", place, strict=True):
            of_plate[f"FORCE_PLATE_CORNER_{corner}_{axis}"] = coordinate
    turned = TO_PLATE if "local" in description else [1, 1, 1]
    head = [
        "SAMPLE",
        "TIME",
        *(f"{what}_{axis}" for what in ("Force", "Moment", "COP") for axis in "XYZ"),
    ]
    samples = np.arange(1, fast.size + 1)
    text = tsv_text(of_plate, head, samples, fast, FORCE * turned, MOMENT * turned, 0 * FORCE)
    (folder / "walk_f_1.tsv").write_text(text)
    of_board = {
        "NO_OF_SAMPLES": FRAMES * PER_FRAME,
        "FREQUENCY": RATE_HZ * PER_FRAME,
        "CHANNEL_NAMES": ["Sync", "EMG"],
    }
    (folder / "walk_a_1.tsv").write_text(tsv_text(of_board, [], samples, fast, SYNC, -SYNC))
    return folder / "walk.tsv"


def structs(**fields):
    """A struct of MATLAB, (1, 1)."""
    return np.array([[tuple(fields.values())]], dtype=[(name, object) for name in fields])


def export(orientation=1):
    """The variable that Qualisys writes in MATLAB's format."""
    labels = np.array([LABELS], dtype=object)
    trajectories = np.concatenate([POSITIONS, np.ones((FRAMES, len(LABELS), 1))], axis=2)
    analog_labels = np.array([["Sync", "EMG"]], dtype=object)
    turned = TO_PLATE if orientation == 0 else [1, 1, 1]
    return {
        "walk": {
            "FrameRate": RATE_HZ,
            "Frames": FRAMES,
            "Trajectories": {
                "Labeled": {"Count": 3, "Labels": labels, "Data": trajectories.transpose(1, 2, 0)}
            },
            "Analog": {
                "Frequency": RATE_HZ * PER_FRAME,
                "Labels": analog_labels,
                "Data": np.vstack([SYNC, -SYNC]),
            },
            "Force": structs(
                ForcePlateName="AMTI 1",
                Frequency=RATE_HZ * PER_FRAME,
                Force=(FORCE * turned).T,
                Moment=(MOMENT * turned).T,
                COP=0 * FORCE.T,
                ForcePlateLocation=CORNERS,
                ForcePlateOrientation=orientation,
            ),
        }
    }


def mat_of(write, orientation):
    return lambda folder: write(folder / "walk.mat", **export(orientation))


EXPORTS = {
    "TSV": write_tsv,
    "TSV in the plate's axes": lambda folder: write_tsv(
        folder, "Force data in local (force plate) coordinates"
    ),
    "TSV without names above the columns": lambda folder: write_tsv(folder, header=False),
    "TSV without frame and time": lambda folder: write_tsv(folder, header=False, columns=0),
    "MAT": mat_of(write_mat, 1),
    "MAT in the plate's axes": mat_of(write_mat, 0),
    "MAT 7.3": mat_of(write_mat73, 1),
}


def qualisys_source(path, **fields):
    return source_of("qualisys_mat" if path.suffix == ".mat" else "qualisys_tsv", **fields)


@pytest.mark.parametrize("write", EXPORTS.values(), ids=EXPORTS)
def test_markers_plates_and_analog_channels_are_one_recording(tmp_path, write):
    path = write(tmp_path)
    source = qualisys_source(path, analogs={"sync": {"channel": "Sync", "unit": "V"}})

    samples = read_converted(path, source).samples

    assert samples.height == FRAMES * PER_FRAME
    for place, label in enumerate(LABELS):
        seen = np.where(
            (POSITIONS[:, place] == 0).all(axis=1, keepdims=True), np.nan, POSITIONS[:, place]
        )
        marker = samples.select(f"^marker_{label}_.$").drop_nulls().to_numpy()
        np.testing.assert_allclose(marker, seen / 1000, rtol=1e-7)
    np.testing.assert_allclose(samples.select("^plate1_force_.$"), FORCE, rtol=1e-7)
    np.testing.assert_allclose(samples.select("^plate1_moment_.$"), MOMENT, rtol=1e-7)
    np.testing.assert_allclose(samples["sync"], SYNC, rtol=1e-7)


@pytest.mark.parametrize("write", [write_tsv, mat_of(write_mat, 1)])
def test_an_export_is_recognised_by_its_content(tmp_path, write):
    listed = formats.read(write(tmp_path))

    assert listed.format.startswith("qualisys")
    assert [plate.number for plate in listed.plates] == [1]


def test_the_files_of_a_trial_are_one_recording_of_a_folder(tmp_path):
    path = write_tsv(tmp_path)

    assert recordings_in(tmp_path) == [path]
    assert [file.name for file in recorded_files(path)] == [
        "walk.tsv",
        "walk_a_1.tsv",
        "walk_f_1.tsv",
    ]


def test_the_sign_and_the_plates_are_those_of_the_source_file(tmp_path):
    path = write_tsv(tmp_path)

    turned = read_converted(path, qualisys_source(path, plate_sign=-1)).samples
    without = read_converted(path, qualisys_source(path, plates=[])).samples

    np.testing.assert_allclose(turned.select("^plate1_force_.$"), -FORCE, rtol=1e-7)
    assert not [name for name in without.columns if name.startswith("plate")]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_plate_with_the_force_on_it_is_asked_for(tmp_path, monkeypatch, sign):
    monkeypatch.setattr(f"{__name__}.FORCE", sign * np.abs(FORCE))

    (*questions,) = formats.read(write_tsv(tmp_path)).questions

    assert ("`plate_sign: -1`" in " ".join(questions)) == (sign == -1)


def longer(folder):
    text = (folder / "walk_f_1.tsv").read_text()
    (folder / "walk_f_1.tsv").write_text(
        text.replace(f"FREQUENCY\t{RATE_HZ * PER_FRAME}", "FREQUENCY\t500")
    )


def fewer_frames(folder):
    text = (folder / "walk.tsv").read_text()
    (folder / "walk.tsv").write_text(text.replace(f"NO_OF_FRAMES\t{FRAMES}", "NO_OF_FRAMES\t9"))


@pytest.mark.parametrize(
    ("change", "description", "message"),
    [
        (longer, "in world coordinates", "walk_f_1.tsv: .*24 samples at 500 Hz beside 6 frames"),
        (fewer_frames, "in world coordinates", "6 frames, and states 9"),
        (lambda folder: None, "--", "AMTI 1.*`plate_axes: laboratory`"),
    ],
)
def test_what_the_files_of_an_export_do_not_tell_is_asked_for(
    tmp_path, change, description, message
):
    path = write_tsv(tmp_path, description)
    change(tmp_path)

    assert re.search(message, refusal_by(read_converted, path, qualisys_source(path)))


@pytest.mark.parametrize("columns", [0, 2])
def test_positions_without_a_header_are_read_by_stated_names(tmp_path, columns):
    text = write_tsv(tmp_path, header=False, columns=columns).read_text()
    path = tmp_path / "rows.tsv"
    path.write_text(text[text.index("KNEE\n") + 5 :])
    source = source_of("marker_columns", markers=LABELS, rate=RATE_HZ, point_unit="mm")
    other = source_of("marker_columns", markers=LABELS[:1], rate=RATE_HZ, point_unit="mm")

    samples = read_converted(path, source).samples

    np.testing.assert_allclose(samples.select("^marker_KNEE_.$"), POSITIONS[:, 2] / 1000, rtol=1e-7)
    assert "name all markers" in refusal_by(read_converted, path, other)


Y_UP = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
"""Turns coordinates with y up into ours."""


# --- OptiTrack ----------------------------------------------------------------------------------


def write_optitrack(path, unit="Meters", ids=True, frames=FRAMES):
    first = (
        f"Format Version,1.23,Take Name,walk,Export Frame Rate,{RATE_HZ:.6f},"
        f"Total Exported Frames,{FRAMES},Length Units,{unit}"
    )
    kinds = ["Rigid Body"] * 4 + ["Marker"] * 6
    names = ["foot"] * 4 + ["foot:HEEL"] * 3 + ["foot:TOE"] * 3
    quantities = ["Rotation"] * 4 + ["Position"] * 6
    rows = [first, "", ",".join(["", "Type", *kinds]), ",".join(["", "Name", *names])]
    rows += [",".join(["", "ID", *["A1"] * 10])] * ids
    rows += [
        ",".join(["", "", *quantities]),
        ",".join(["Frame", "Time (Seconds)", *"XYZW", *"XYZXYZ"]),
    ]
    for row in range(frames):
        seen = POSITIONS[row, :2] * (1e-3 if unit == "Meters" else 1)
        cells = ["" if value == 0 else f"{value:.6f}" for value in seen.ravel()]
        rows.append(",".join([str(row), f"{row / RATE_HZ:.6f}", "0", "0", "0", "1", *cells]))
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize("ids", [True, False])
@pytest.mark.parametrize("unit", ["Meters", "Millimeters"])
def test_markers_of_optitrack_are_read_in_the_unit_of_the_export(tmp_path, unit, ids):
    path = write_optitrack(tmp_path / "walk.csv", unit, ids)

    samples = read_converted(path, source_of("optitrack", axes=["x", "-z", "y"])).samples

    heel = samples.select("^marker_HEEL_.$").to_numpy()
    np.testing.assert_allclose(heel, POSITIONS[:, 0] @ Y_UP / 1000, atol=1e-6)
    assert samples["marker_TOE_x"].is_nan().to_list() == [row == 2 for row in range(FRAMES)]
    assert not [name for name in samples.columns if "foot" in name]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("Length Units,Meters", "Length Units,Feet"), "'Feet'"),
        ((f"Frames,{FRAMES}", "Frames,9"), "states 9 frames, and it holds 6"),
        (("Marker", "Bone"), "holds no marker"),
    ],
)
def test_an_export_of_optitrack_that_does_not_fit_is_refused(tmp_path, change, message):
    path = write_optitrack(tmp_path / "walk.csv")
    path.write_text(path.read_text().replace(*change))

    assert re.search(message, refusal_by(read_converted, path, source_of("optitrack")))
