"""One log in every format of rows: the same columns, the same refusals, a draft that reads it; and damage is told."""

import json
import random
import sys
from pathlib import Path

import numpy as np
import pytest
import test_ingest_c3d_capture as captures
import test_ingest_mcap_log as mcap
import test_ingest_opensim as opensim
from c3d_builder import write_c3d
from mcap_builder import write_log
from nptdms import ChannelObject, TdmsWriter
from recognised_files import refusal_by
from test_formats_mat import write_mat, write_mat73
from test_formats_rosbags import CHANNELS, write_bag1, write_bag2

from osl_analysis.commands.inspect import inspect_file, overview_text
from osl_analysis.errors import InputError
from osl_analysis.ingest.draft import draft_source
from osl_analysis.ingest.raw_files import FORMATS, read_source

TIME = np.arange(40) / 500
ANGLE, TORQUE = np.sin(40 * TIME), 30 * np.sin(40 * TIME)
LOG = {"t": 1e3 * TIME + 7, "angle": np.rad2deg(ANGLE), "torque": -1e3 * TORQUE}


def write_text(path, columns, sign=",", head=""):
    rows = zip(*columns.values(), strict=True)
    path.write_text(head + "\n".join([sign.join(columns), *(sign.join(map(str, row)) for row in rows)]) + "\n")
    return path


def write_table(path, columns):
    return write_text(path, columns, "\t", f"grf\nnRows={len(TIME)}\nendheader\n")


def write_json(path, columns):
    rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    path.write_text("".join(json.dumps(dict(zip(columns, row, strict=True))) + "\n" for row in rows))
    return path


def write_tdms(path, columns):
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("Bench", name, np.asarray(one)) for name, one in columns.items()])
    return path


WRITERS = {
    "csv": ("csv", "column", write_text), "json_lines": ("json_lines", "field", write_json),
    "mat": ("mat", "variable", lambda path, columns: write_mat(path, **columns)),
    "mat 7.3": ("mat", "variable", lambda path, columns: write_mat73(path, **columns)),
    "tdms": ("tdms", "channel", write_tdms), "opensim": ("opensim", "column", write_table),
}  # fmt: skip
NO_TIME = {"opensim": {"column": None, "unit": None}}  # where a source file has a time of its own
EVERY = pytest.mark.parametrize("what", WRITERS)


def described(what, counter=None, **fields):
    """The source file of a log in a format, with other fields than the usual."""
    name, key, _ = WRITERS[what]
    theta, torque = {key: "angle", "unit": "deg", "counter": counter}, {key: "torque", "unit": "Nmm", "sign": -1}
    content = {"format": name, "time": {key: "t", "unit": "ms"}, "channels": {"theta": theta, "torque": torque}}
    return FORMATS[name].source.model_validate({**content, **fields})


@EVERY
def test_a_log_gives_the_same_columns_in_every_format(tmp_path, what):
    path = WRITERS[what][2](tmp_path / "log", {**LOG, "count": np.arange(7, 47)})
    recording = FORMATS[WRITERS[what][0]].read(path, described(what, counter="count"))
    for column, expected in (("time", TIME), ("theta", ANGLE), ("torque", TORQUE)):
        np.testing.assert_allclose(recording.samples[column], expected, atol=1e-12)
    assert recording.samples["theta_counter"].to_list() == list(range(7, 47))
    by_rate = FORMATS[WRITERS[what][0]].read(path, described(what, time={**NO_TIME.get(what, {}), "rate": 250}))
    np.testing.assert_allclose(by_rate.samples["time"], 2 * TIME, atol=1e-12)
    assert (recording.columns["torque"]["unit"], recording.facts["time"]["start"]) == ("Nmm", 7)
    assert recording.facts["rates_hz"]["log"] == pytest.approx(500)


LATE = TIME > 0.039


@EVERY
@pytest.mark.parametrize(("changes", "counted", "told"), [
    ({"torque": np.where(LATE, np.nan, TORQUE)}, {}, "in 20 of 40 "),
    ({"torque": np.where(LATE, np.inf, TORQUE)}, {}, "inf"),
    ({"t": np.full(40, 3.0)}, {}, "time stands still at 3 in all 40 "), ({"t": -TIME}, {}, "time goes from"),
    ({"t": np.where(LATE, np.nan, TIME)}, {}, "no time in "), ({"angle": None, "angel": ANGLE}, {}, "angel"),
    ({}, {"counter": "angle"}, "is no count of samples, a whole number below"),
    ({"big": np.full(40, 2.0**53)}, {"counter": "big"}, "is no count of samples, a whole number below 9.01e+15"),
])  # fmt: skip
def test_what_cannot_be_a_log_is_refused_in_every_format(tmp_path, what, changes, counted, told):
    columns = {name: one for name, one in {**LOG, **changes}.items() if one is not None}
    path = WRITERS[what][2](tmp_path / "log", columns)
    assert told in refusal_by(FORMATS[WRITERS[what][0]].read, path, described(what, **counted))


@EVERY
def test_a_draft_becomes_a_source_file_by_naming_two_signals_and_a_unit(tmp_path, what):
    columns = {"time": TIME, "ankle_deg": np.rad2deg(ANGLE), "moment": TORQUE}
    path = WRITERS[what][2](tmp_path / f"log.{WRITERS[what][0]}", columns)
    (tmp_path / "s.yaml").write_text(
        draft_source(inspect_file(path), path.name).replace("NAME_1", "theta").replace("NAME_2", "torque")
        .replace("UNKNOWN", "N*m")
    )  # fmt: skip
    samples = FORMATS[WRITERS[what][0]].read(path, read_source(tmp_path / "s.yaml")).samples
    for column, expected in (("time", TIME), ("theta", ANGLE), ("torque", TORQUE)):
        np.testing.assert_allclose(samples[column], expected, atol=1e-12)


@pytest.mark.parametrize(("what", "library", "extra"), [("tdms", "nptdms", "tdms"), ("mat 7.3", "h5py", "mat73")])
def test_a_library_that_is_not_installed_is_named_with_its_extra(tmp_path, monkeypatch, what, library, extra):
    path = WRITERS[what][2](tmp_path / "log", LOG)
    monkeypatch.setitem(sys.modules, library, None)
    said = refusal_by(FORMATS[WRITERS[what][0]].read, path, described(what))
    assert f"needs {library}, which is not installed; pip install 'osl-analysis[{extra}]'" in said


@pytest.mark.parametrize(("what", "content", "told"), [
    ("csv", b"t,angle,torque\n1,True,2\n", "'True' is not a number; name a column of numbers; a truth value can on"),
    ("csv", b"t,angle,torque\nx,1,2\n2,3,4\n", "line 2, column 't': 'x' is not a number; correct the cell, or delete"),
    ("json_lines", b'{"t": 1', "holds no whole line"), ("json_lines", b'{"t": 1\n' * 2, "a message of 7 bytes is not"),
    ("json_lines", b'{"t": 1}\n{"t": 2}\n{"t": \n', "no line that can be used has a field 'angle': a message of 6"),
    ("mat", b"t\n1\n", "no MATLAB file of version 5 or 7.3; save it"), ("opensim", b"t\n1\n", "no line `endheader`"),
    ("tdms", b"t\n1\n", "no TDMS file (it begins with b't\\n1\\n'); check the path and the source's format"),
    (None, b"\1\0\2", "neither MCAP, C3D nor text (it begins with b'\\x01\\x00\\x02'); export it as one of these"),
    (None, b"# a\n", "holds no rows; check that it"), (None, b'{"a": "b"}\n' * 2, "no line holds a number; name a"),
])  # fmt: skip
def test_a_file_that_is_no_log_of_the_stated_format_or_of_any_is_refused(tmp_path, what, content, told):
    (path := tmp_path / "log").write_bytes(content)
    assert told in (refusal_by(FORMATS[what].read, path, described(what)) if what else refusal_by(inspect_file, path))


def refused_mat(path, **fields):
    return refusal_by(FORMATS["mat"].read, path, described("mat", **fields))


def test_a_wrong_field_of_a_source_file_of_matlab_is_refused():
    for fields, message in (
        ({"channels": {"theta": {"variable": "a"}}}, "unit"),
        ({"time": {"rate": 100, "unit": "s"}}, "is that of the variable of time"), ({"log_part": "(2)"}, "no address"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=message):
            described("mat", **fields)
    with pytest.raises(InputError, match="log_part 'x' in the sheet: a log in csv holds one trial; clear the cell"):
        described("csv").of_part("x")


MATLAB = pytest.mark.parametrize("write", [write_mat, write_mat73])


@MATLAB
def test_a_part_of_a_matlab_file_is_a_trial_of_its_own(write, tmp_path):
    path = write(tmp_path / "a.mat", Slow=LOG, Fast={**LOG, "torque": -2e3 * TORQUE}, clock=1e3 * TIME)
    for part, factor in (("Slow", 1), ("Fast", 2)):
        recording = FORMATS["mat"].read(path, described("mat").of_part(part))
        np.testing.assert_allclose(recording.samples["torque"], factor * TORQUE, atol=1e-12)
    shared = described("mat", time={"variable": "/clock", "unit": "ms"}).of_part("Fast")
    assert FORMATS["mat"].read(path, shared).columns["torque"]["variable"] == "Fast.torque"
    assert "no variable 't'; it has" in (said := refused_mat(path))
    assert "if one of these holds it, name this one as `log_part`" in said


def test_a_matrix_is_a_part_whose_columns_are_signals(tmp_path):
    path = write_mat(tmp_path / "a.mat", D={"run1": np.column_stack([TIME, ANGLE])})
    columns = {"theta": {"variable": "(:,2)", "unit": "rad"}}
    source = described("mat", time={"variable": "(:,1)", "unit": "s"}, channels=columns).of_part("D.run1")
    np.testing.assert_allclose(FORMATS["mat"].read(path, source).samples["theta"], ANGLE)


@MATLAB
def test_what_cannot_be_a_log_is_refused_by_its_variable(write, tmp_path):
    for torque, message in (
        (TORQUE[1:], "torque has 39 numbers and t has 40; name variables of one recording"),
        ("broken", "torque is a 1x6 char, not real numbers"), (TORQUE + 1j, "torque is a "),
    ):  # fmt: skip
        assert message in refused_mat(write(tmp_path / "a.mat", **{**LOG, "torque": torque}))


@MATLAB
def test_the_draft_of_several_trials_is_of_one_and_fits_the_other(write, tmp_path):
    named = {"time_ms": 1e3 * TIME, "ankle_deg": np.rad2deg(ANGLE)}
    path = write(tmp_path / "a.mat", Slow=named, Fast=named, note="left foot")
    own = {"single": np.float32(TIME), "int16": np.int16(TIME), "uint8": np.uint8(TIME), "double": TIME}
    assert [one.type for one in inspect_file(write_mat(tmp_path / "b", **own)).channels] == [f"1x40 {k}" for k in own]
    overview = inspect_file(path)
    assert "variable       Slow.ankle_deg  40 samples; from" in overview_text(overview)
    assert "2 parts hold the same variables: name one per trial in the column `log_part`" in overview_text(overview)
    (tmp_path / "mine.yaml").write_text(draft_source(overview, path.name).replace("NAME_1", "theta"))
    read = FORMATS["mat"].read(path, read_source(tmp_path / "mine.yaml").of_part("Fast"))
    np.testing.assert_allclose(read.samples["theta"], ANGLE)
    np.testing.assert_allclose(read.samples["time"], TIME, atol=1e-12)


BAG = {"time": {"source": "header"}, "channels": CHANNELS}
OTHERS = {
    "bag of ROS 1": (lambda path: write_bag1(path, range(60), "LZ4", 800), {"format": "rosbag1", **BAG}),
    "bag of ROS 2": (lambda path: write_bag2(path, range(60)) / f"{path.name}.db3", {"format": "rosbag2", **BAG}),
    "TRC": (lambda path: opensim.write_trc(path, opensim.walk()), {"format": "trc"}),
    "C3D": (lambda path: write_c3d(path, np.ones((6, 3, 4)), np.ones((24, 2))), {"format": "c3d"}),
    "Nexus": (lambda path: path.write_text(captures.DEVICES + captures.TRAJECTORIES + captures.MODEL) and path,
              {"format": "nexus_csv"}),
    "MCAP": (lambda path: write_log(path, mcap.samples(), chunk_size=800), mcap.source().model_dump(exclude_none=True)),
}  # fmt: skip


def mutilated(content: bytes, chance: random.Random) -> bytes:
    """The content with one kind of damage: cut, shortened, repeated, with other bytes, or with an absurd length."""
    place, other, kind = chance.randrange(len(content)), chance.randrange(len(content)), chance.randrange(5)
    absurd, damaged = chance.choice([0, 2**31, 2**63, 2**64 - 1]).to_bytes(8, "little"), bytearray(content)
    for _ in range(chance.choice([1, 2, 8])):
        damaged[chance.randrange(len(content))] = chance.choice([0, 255, chance.randrange(256)])
    return (
        content[:place], content[:place] + content[place + chance.randrange(1, 40) :],
        content[:place] + content[other : other + chance.randrange(60)] + content[place:], bytes(damaged),
        content[:place] + absurd + content[place + 8 :],
    )[kind]  # fmt: skip


@pytest.mark.parametrize("what", [*OTHERS, "json_lines", "tdms", "opensim"])
def test_a_mutilated_file_is_samples_or_a_sentence(tmp_path: Path, what: str) -> None:
    if what in OTHERS:
        write, content = OTHERS[what]
        path, source = Path(write(tmp_path / "whole")), FORMATS[content["format"]].source.model_validate(content)
    else:
        path, source = WRITERS[what][2](tmp_path / "whole", LOG), described(what)
    known, whole = FORMATS[source.format], path.read_bytes()
    for seed in range(12):
        path.write_bytes(mutilated(whole, random.Random(seed)))
        for attempt in (lambda: known.read(path, source), lambda: draft_source(known.inspect(path), "a")):
            try:
                attempt()
            except InputError as error:
                message = str(error)
                assert message.startswith(str(path))
                assert len(message.splitlines()) == 1
                assert len(message) < 1500
