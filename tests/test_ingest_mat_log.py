"""Logs in MATLAB files: a source file names variables by address; what cannot be a log is refused by its variable."""

from pathlib import Path

import numpy as np
import pytest
from c3d_builder import REAL_DATA
from recognised_files import refusal_by
from test_formats_mat import write_mat, write_mat73

from osl_analysis.commands.inspect import inspect_file, overview_text
from osl_analysis.errors import InputError
from osl_analysis.ingest.draft import draft_source
from osl_analysis.ingest.raw_files import FORMATS, read_source, trial_from_files
from osl_analysis.ingest.source import Source

TIME = np.arange(40) / 500
ANGLE, TORQUE = np.sin(40 * TIME), 30 * np.sin(40 * TIME)
TEST = {"t": 1e3 * TIME + 7, "angle": np.rad2deg(ANGLE), "torque": -1e3 * TORQUE, "fs": 500.0}
WRITERS = pytest.mark.parametrize("write", [write_mat, write_mat73])


def source(**fields: object) -> Source:
    usual = {
        "format": "mat",
        "time": {"variable": "t", "unit": "ms"},
        "channels": {
            "theta": {"variable": "angle", "unit": "deg"},
            "torque": {"variable": "torque", "unit": "Nmm", "sign": -1},
        },
    }
    return FORMATS["mat"].source.model_validate({**usual, **fields})


def refused(path: Path, mat_source: Source | None = None) -> str:
    return refusal_by(FORMATS["mat"].read, path, mat_source or source())


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"channels": {"theta": {"variable": "a b", "unit": "deg"}}}, "no address in a MATLAB file"),
        ({"channels": {"theta": {"variable": "a"}}}, "unit"),
        ({"time": {"rate": 100, "unit": "s"}}, "is that of the variable of time"),
        ({"time": {}}, "state either"),
        ({"log_part": "(2)"}, "no address"),
    ],
)
def test_a_wrong_field_of_a_source_file_is_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        source(**fields)


@WRITERS
def test_a_part_of_the_file_is_a_trial_of_its_own(write, tmp_path):
    path = write(tmp_path / "a.mat", Slow=TEST, Fast={**TEST, "torque": -2e3 * TORQUE}, clock=1e3 * TIME)
    for part, factor in (("Slow", 1), ("Fast", 2)):
        recording = FORMATS["mat"].read(path, source().of_part(part))
        np.testing.assert_allclose(recording.samples["torque"], factor * TORQUE, atol=1e-12)
    shared = source(time={"variable": "/clock", "unit": "ms"}).of_part("Fast")
    assert FORMATS["mat"].read(path, shared).columns["torque"]["variable"] == "Fast.torque"
    assert "no variable 't'; it has" in (said := refused(path))
    assert "if one of these holds it, name this one as `log_part`" in said


def test_a_matrix_is_a_part_whose_columns_are_signals(tmp_path):
    path = write_mat(tmp_path / "a.mat", D={"run1": np.column_stack([TIME, ANGLE])})
    columns = {"theta": {"variable": "(:,2)", "unit": "rad"}}
    read = FORMATS["mat"].read(
        path, source(time={"variable": "(:,1)", "unit": "s"}, channels=columns).of_part("D.run1")
    )
    np.testing.assert_allclose(read.samples["theta"], ANGLE)


def test_a_log_in_a_format_without_parts_refuses_one():
    csv = FORMATS["csv"].source.model_validate(
        {"format": "csv", "time": {"rate": 100}, "channels": {"theta": {"column": "a", "unit": "deg"}}}
    )
    with pytest.raises(InputError, match="log_part 'x' in the sheet: a log in csv holds one trial; clear the cell"):
        csv.of_part("x")


@WRITERS
def test_what_cannot_be_a_log_is_refused_by_its_variable(write, tmp_path):
    for torque, message in (
        (TORQUE[1:], "torque has 39 numbers and t has 40; name variables of one recording"),
        ("broken", "torque is a 1x6 char, not real numbers"),
        (TORQUE + 1j, "torque is a "),
    ):
        assert message in refused(write(tmp_path / "a.mat", **{**TEST, "torque": torque}))


@WRITERS
def test_the_draft_of_several_trials_is_of_one_and_fits_the_other(write, tmp_path):
    named = {"time_ms": 1e3 * TIME, "ankle_deg": np.rad2deg(ANGLE)}
    path = write(tmp_path / "a.mat", Slow=named, Fast=named, note="left foot")
    overview = inspect_file(path)
    assert "variable       Slow.ankle_deg  40 samples; from" in overview_text(overview)
    assert "2 parts hold the same variables: name one per trial in the column `log_part`" in overview_text(overview)
    (tmp_path / "mine.yaml").write_text(draft_source(overview, path.name).replace("NAME_1", "theta"))
    read = FORMATS["mat"].read(path, read_source(tmp_path / "mine.yaml").of_part("Fast"))
    np.testing.assert_allclose(read.samples["theta"], ANGLE)
    np.testing.assert_allclose(read.samples["time"], TIME, atol=1e-12)


@pytest.mark.skipif(not REAL_DATA.is_dir(), reason="no real data here")
def test_a_real_test_of_a_foot_is_read_by_its_part():
    row = {"trial": "x45", "log": "mat/DESR_Characterization_Data.mat", "log_source": "desr", "log_part": "DESR_N.x45"}
    trial = trial_from_files(row, REAL_DATA, Path(__file__).parents[1] / "config/sources")
    time, theta, torque = trial.signals("theta", "torque")
    assert (time.size, round((time.size - 1) / time[-1], 2)) == (12000, 833.33)
    assert (np.rad2deg(theta.max()).round(2), torque.max().round(1)) == (11.35, 115.5)
