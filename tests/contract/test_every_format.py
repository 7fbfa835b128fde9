# SPDX-License-Identifier: Apache-2.0
"""One log in every format of rows: the same columns, and what is refused in every one of them."""

import contextlib
import json
import re

import h5py
import numpy as np
import polars as pl
import pytest
import xlsxwriter
from log_builders import write_mat, write_mat73, write_opensim, write_tdms, write_text
from recognised_files import refusal_by, source_of

from osl_analysis import formats
from osl_analysis.base.errors import InputError
from osl_analysis.commands.trials import inspect_file, overview_text
from osl_analysis.draft.draft_source import draft_source
from osl_analysis.ingest.raw_files import read_converted, read_source

TIME = np.arange(40) / 500
ANGLE = np.sin(40 * TIME)
TORQUE = 30 * np.sin(40 * TIME)
LOG = {"t": 1e3 * TIME + 7, "angle": np.rad2deg(ANGLE), "torque": -1e3 * TORQUE}


def write_json(path, columns):
    rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    lines = [json.dumps(dict(zip(columns, row, strict=True))) for row in rows]
    path.write_text("\n".join(lines) + "\n")


def write_hdf5(path, columns):
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[name] = values


WRITERS = {
    "csv": ("csv", "column", write_text),
    "a.jsonl": ("table", "column", write_json),
    "mat": ("mat", "variable", lambda path, columns: write_mat(path, **columns)),
    "mat 7.3": ("mat", "variable", lambda path, columns: write_mat73(path, **columns)),
    "tdms": (
        "tdms",
        "channel",
        lambda path, columns: write_tdms(path, [(*item, {}) for item in columns.items()]),
    ),
    "opensim": ("opensim", "column", write_opensim),
    "a.parquet": (
        "table",
        "column",
        lambda path, columns: pl.DataFrame(columns).write_parquet(path),
    ),
    "a.xlsx": ("table", "column", lambda path, columns: pl.DataFrame(columns).write_excel(path)),
    "a.h5": ("table", "column", write_hdf5),
}
NO_TIME = {"opensim": {"column": None, "unit": None}}  # where a source file has a time of its own
EVERY = pytest.mark.parametrize("what", WRITERS)
OTHERS = [what for what in WRITERS if what != "csv"]


def written(folder, what, columns):
    """A log of these columns in a format."""
    path = folder / what
    WRITERS[what][2](path, columns)
    return path


def described(what, counter=None, unit="deg", **fields):
    """The source file of a log in a format, with other fields than the usual."""
    name, key, _ = WRITERS[what]
    content = {
        "time": {key: "t", "unit": "ms"},
        "channels": {
            "theta": {key: "angle", "unit": unit, "counter": counter},
            "torque": {key: "torque", "unit": "Nmm", "sign": -1},
        },
    }
    return source_of(name, **content | fields)


@EVERY
def test_a_log_gives_the_same_columns_in_every_format(tmp_path, what):
    path = written(tmp_path, what, {**LOG, "count": np.arange(7, 47)})

    recording = read_converted(path, described(what, counter="count"))

    for column, expected in (("time", TIME), ("theta", ANGLE), ("torque", TORQUE)):
        np.testing.assert_allclose(recording.samples[column], expected, atol=1e-12)
    assert recording.samples["theta_counter"].to_list() == list(range(7, 47))
    assert (recording.origins["torque"]["unit"], recording.facts["time"]["start"]) == ("Nmm", 7)
    assert [*recording.facts["rates_hz"].values()] == [pytest.approx(500)]
    by_rate = read_converted(path, described(what, time={**NO_TIME.get(what, {}), "rate": 520}))
    np.testing.assert_allclose(by_rate.samples["time"], TIME * 500 / 520, atol=1e-12)


@EVERY
@pytest.mark.parametrize("share", [0.3, 0.6, 0.99])
def test_a_log_that_is_cut_is_never_read_as_whole(tmp_path, what, share):
    path = written(tmp_path, what, LOG)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])

    with contextlib.suppress(InputError):
        recording = read_converted(path, described(what))
        count = len(recording.samples)
        assert recording.losses["end_missing"]
        assert count < 40
        np.testing.assert_allclose(recording.samples["torque"], TORQUE[:count], atol=1e-12)


CLOCKS = {
    "t": TIME,
    "Date": 45_000 + TIME / 86_400,
    "LabVIEW time": 3.8e9 + TIME,
    "count_time": (1e3 * TIME + 65_500) % 2**16,
}


@pytest.mark.parametrize(
    ("what", "name"), [*(("csv", name) for name in CLOCKS), *((what, "t") for what in OTHERS)]
)
def test_a_rate_that_a_clock_contradicts_is_refused_in_every_format(tmp_path, what, name):
    """A rate of 1000 for a file of 500 Hz halves B, and no check objects."""
    columns = {"angle": LOG["angle"], "torque": LOG["torque"], name: CLOCKS[name]}
    path = written(tmp_path, what, columns)
    twice, right = (
        described(what, time={**NO_TIME.get(what, {}), "rate": rate}) for rate in (1000, 500)
    )

    assert f"{name}'" in refusal_by(read_converted, path, twice)
    assert len(read_converted(path, right).samples) == 40


LATE = TIME > 0.039


NO_LOG = [
    ({"torque": np.where(LATE, np.nan, TORQUE)}, {}, r"20 .*40 "),
    ({"torque": np.where(LATE, np.inf, TORQUE)}, {}, "inf"),
    ({"t": np.full(40, 3.0)}, {}, r"'t'.*0\.003 s.* 40 "),
    ({"t": -TIME}, {}, "'t'"),
    ({"t": np.r_[TIME[:30], TIME[20:30]]}, {}, "'t'.*row 30"),
    ({"t": np.where(LATE, np.nan, TIME)}, {}, "'t'"),
    ({"angle": None, "angel": ANGLE}, {}, "angel"),
    ({"big": np.full(40, 2.0**53)}, {"counter": "big"}, r"'big'.*9\.01e\+15"),
    ({}, {"counter": "angle"}, r"'angle'.*9\.01"),
]


@pytest.mark.parametrize(
    ("what", "changes", "counted", "told"),
    [
        *(("csv", *case) for case in NO_LOG),
        *((what, *NO_LOG[0]) for what in OTHERS),
        *((what, *NO_LOG[-1]) for what in OTHERS),
    ],
)
def test_what_cannot_be_a_log_is_refused_in_every_format(tmp_path, what, changes, counted, told):
    columns = {name: one for name, one in {**LOG, **changes}.items() if one is not None}
    path = written(tmp_path, what, columns)
    assert re.search(told, refusal_by(read_converted, path, described(what, **counted)))


MATLAB = pytest.mark.parametrize("write", [write_mat, write_mat73])


@MATLAB
def test_a_part_of_a_matlab_file_is_a_trial_of_its_own(write, tmp_path):
    path = write(
        tmp_path / "a.mat", Slow=LOG, Fast={**LOG, "torque": -2e3 * TORQUE}, clock=1e3 * TIME
    )
    for part, factor in (("Slow", 1), ("Fast", 2)):
        recording = read_converted(path, described("mat").for_part(part))
        np.testing.assert_allclose(recording.samples["torque"], factor * TORQUE, atol=1e-12)
    shared = described("mat", time={"variable": "/clock", "unit": "ms"}).for_part("Fast")
    samples = read_converted(path, shared).samples
    np.testing.assert_allclose(samples["torque"], 2 * TORQUE, atol=1e-12)
    said = refusal_by(read_converted, path, described("mat"))
    assert "variable 't'" in said
    assert "Slow.t" in said
    assert "Fast.t" in said


@MATLAB
def test_the_draft_of_several_trials_is_of_one_and_fits_the_other(write, tmp_path):
    named = {"time_ms": 1e3 * TIME, "ankle_deg": np.rad2deg(ANGLE)}
    path = write(tmp_path / "a.mat", Slow=named, Fast=named, note="left foot")
    overview = inspect_file(path)
    assert "`log_part`" in overview_text(overview)
    (tmp_path / "mine.yaml").write_text(
        draft_source(overview, path.name).replace("NAME_1", "theta")
    )
    read = read_converted(path, read_source(tmp_path / "mine.yaml").for_part("Fast"))
    np.testing.assert_allclose(read.samples["theta"], ANGLE)
    np.testing.assert_allclose(read.samples["time"], TIME, atol=1e-12)


# --- archives and workbooks ---------------------------------------------------------------------


def test_a_workbook_is_its_largest_sheet_by_the_rules_of_text(tmp_path):
    with xlsxwriter.Workbook(tmp_path / "a.xlsx") as book:
        book.add_worksheet("notes").write_row(0, 0, ["Bench 3", "rig B"])
        sheet = book.add_worksheet("data")
        sheet.write_row(0, 0, ["Angle", "Torque"])
        sheet.write_row(1, 0, ["deg", "Nm"])
        for row, values in enumerate(zip(ANGLE, TORQUE, strict=True), start=2):
            sheet.write_row(row, 0, values)

    recording = formats.read(tmp_path / "a.xlsx")

    assert [(one.name, one.unit) for one in recording.channels] == [
        ("Angle", "deg"),
        ("Torque", "Nm"),
    ]
    np.testing.assert_allclose(recording.find({"column": "Torque"}).values, TORQUE, atol=1e-9)
    assert any(re.search("'data'.*notes", remark) for remark in recording.loss.remarks)
    assert recording.channels[0].rows.place(0) == "row 3"
