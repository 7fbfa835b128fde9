"""From the sheet's row to the trial's file, and one log in every format of rows: the same columns
and refusals."""

import hashlib
import json
import os
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import yaml
from c3d_builder import write_c3d
from mcap_builder import SAMPLE, stamped, write_log
from recognised_files import refusal_by
from scipy.interpolate import make_interp_spline
from test_formats_mat import write_mat, write_mat73
from test_ingest_json_log import write_tdms

from osl_analysis.commands.trials import ingest_trial, inspect_file, overview_text
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.draft.draft_source import draft_source
from osl_analysis.errors import InputError
from osl_analysis.formats import known_formats
from osl_analysis.ingest import LIMITS
from osl_analysis.ingest.assemble import merged
from osl_analysis.ingest.clock import ClockFit, aligned_clock
from osl_analysis.ingest.conversion import Converted
from osl_analysis.ingest.raw_files import read_converted, read_source
from osl_analysis.recording import Recording
from osl_analysis.source_file import SharedAngle
from osl_analysis.trial import (
    COLUMNS,
    FAMILIES,
    Trial,
    plate_columns,
    read_trial,
    unit_of,
    write_trial,
)

THETA, SYNC = (
    {"topic": "/lab", "field": name, "unit": unit}
    for name, unit in (("angle", "deg"), ("sync", "V"))
)
LEG = {
    "format": "mcap",
    "clock": "sync",
    "time": {"source": "header"},
    "channels": {"theta": THETA, "sync": SYNC},
}
CAPTURE = {"format": "c3d", "analogs": {"sync": {"channel": "A1"}}}
LEG_OFFSET, LEG_DRIFT = 4.321, 40e-6  # leg time = offset + (1 + drift) * motion capture's
CHANGES, DURATION = np.cumsum(np.random.default_rng(0).uniform(0.06, 0.25, 40)), 5.0


def level(time: np.ndarray) -> np.ndarray:
    return (np.searchsorted(CHANGES, time, side="right") % 2).astype(float)


def angle(time: np.ndarray) -> np.ndarray:
    """A joint angle [deg] at motion capture's time [s]."""
    return 10 * np.sin(2 * np.pi * 0.7 * time)


@pytest.fixture
def laboratory(tmp_path: Path) -> Path:
    """Raw files of one trial, `leg.mcap` at 500 Hz and `vicon.c3d` at 300 and 1500 Hz, and their
    source files."""
    leg_time = np.arange(np.ceil((LEG_OFFSET - 1) * 500), (LEG_OFFSET + DURATION + 1) * 500) / 500
    mocap_time = (leg_time - LEG_OFFSET) / (1 + LEG_DRIFT)
    every = zip(
        leg_time.tolist(), angle(mocap_time).tolist(), level(mocap_time).tolist(), strict=True
    )
    log = [stamped(round(t * 1e9), angle=a, torque=0.0, sync=s > 0) for t, a, s in every]
    write_log(tmp_path / "leg.mcap", log, SAMPLE.replace("float32 angle", "float64 angle"))
    frames = int(DURATION * 300)
    time = np.arange(frames)[:, None] / 300
    positions = np.concatenate([100 + time, 200 - time, 1 + 0 * time, 0 * time], axis=1)[:, None, :]
    write_c3d(
        tmp_path / "vicon.c3d",
        positions,
        5.0 * level(np.arange(frames * 5) / 1500)[:, None],
        rate=300.0,
    )
    (tmp_path / "leg.yaml").write_text(yaml.safe_dump(LEG))
    (tmp_path / "vicon.yaml").write_text(yaml.safe_dump(CAPTURE))
    return tmp_path


OUT = Path("out") / "walk_1.parquet"


def row(**fields: object) -> dict[str, object]:
    known = {"log": "leg.mcap", "log_source": "leg", "mocap": "vicon.c3d", "mocap_source": "vicon"}
    return {"trial": "walk_1", **known, **fields}


def ingested(folder: Path, **fields: object) -> Trial:
    ingest_trial(row(**fields), folder, folder, folder / OUT)
    return read_trial(folder / OUT)


def refused(folder: Path, **fields: object) -> str:
    with pytest.raises(InputError) as caught:
        ingest_trial(row(**fields), folder, folder, folder / OUT)
    assert ("\n" in str(caught.value), (folder / OUT).parent.exists()) == (False, False)
    return str(caught.value)


def test_log_and_capture_share_one_clock_and_provenance_names_their_files(
    laboratory,
):
    trial, speed = ingested(laboratory), np.radians(10 * 2 * np.pi * 0.7)
    time, theta = trial.signals("theta")
    # half a millisecond
    np.testing.assert_allclose(theta, np.radians(angle(time)), atol=speed * 0.5e-3)
    assert 0 <= time[0] < time[-1] <= DURATION  # rows beyond motion capture's are not used
    clock = trial.provenance["clock"]
    assert clock["residual"] < 1e-3
    assert clock["edges"] >= 25
    files, columns = trial.provenance["files"], trial.provenance["columns"]
    for role, name in (("log", "leg.mcap"), ("mocap", "vicon.c3d")):
        assert files[role]["path"] == name
        assert files[role]["sha256"] == hashlib.sha256((laboratory / name).read_bytes()).hexdigest()
    assert (set(columns), columns["theta"]["topic"]) == (
        set(trial.samples.columns) - {"time"},
        "/lab",
    )
    assert (columns["theta"]["factor"], columns["sync"]["file"]) == (
        pytest.approx(np.pi / 180),
        "mocap",
    )
    marker = {
        "file": "mocap",
        "label": "M1",
        "component": "y",
        "unit": "mm",
        "factor": 0.001,
        "si_unit": "m",
    }
    assert columns["marker_M1_y"] == marker


def test_without_sync_edges_the_joints_angle_aligns_the_log_and_the_trial_says_so(
    tmp_path: Path,
) -> None:
    knots = np.arange(-5.0, 40.0, 0.2)
    course = make_interp_spline(knots, 0.3 * np.random.default_rng(4).standard_normal(knots.size))
    leg_time, time = np.arange(0, 30, 1 / 500), np.arange(0, 25, 1 / 300)
    every = zip(leg_time.tolist(), np.degrees(course(leg_time - 2.5)).tolist(), strict=True)
    log = [stamped(round(t * 1e9), angle=a, torque=0.0, sync=False) for t, a in every]
    write_log(tmp_path / "leg.mcap", log, SAMPLE.replace("float32 angle", "float64 angle"))
    bent = np.pi / 2 + course(time)
    toe = 200 * np.stack([np.sin(bent), 0 * bent, np.cos(bent)], axis=1)
    points = np.stack(
        [np.tile([0, 0, 400.0], (time.size, 1)), np.full((time.size, 3), 1e-6), toe], axis=1
    )
    seen = np.concatenate([points, np.zeros((time.size, 3, 1))], axis=2)
    seen[40:50, 0, 3] = -1.0  # a marker that was hidden for a moment
    write_c3d(tmp_path / "vicon.c3d", seen, rate=300.0)
    shared, no_sync = {"column": "theta", "markers": ["M1", "M2", "M3"]}, {"theta": THETA}
    (tmp_path / "leg.yaml").write_text(
        yaml.safe_dump(LEG | {"clock": "shared", "channels": no_sync})
    )
    (tmp_path / "vicon.yaml").write_text(yaml.safe_dump({"format": "c3d", "shared": shared}))
    trial = ingested(tmp_path)
    found, theta = trial.signals("theta")
    np.testing.assert_allclose(theta, course(found), atol=2e-3)
    assert trial.provenance["clock"]["method"] == "correlation"
    assert (
        "aligned by cross-correlation of 'theta' and the angle at marker M2"
        in trial.provenance["warnings"][0]
    )


def test_rows_within_a_nanosecond_become_one() -> None:
    mocap = pl.DataFrame(
        {"time": [0.0, 2 / 3, 0.9], "sync": [0.0, 1.0, 0.0], "trigger": [1.0, 2.0, 3.0]}
    )
    times = [0.05, 2 / 3 + 3e-10, 0.7, 0.9 - 3e-10]
    log = pl.DataFrame(
        {"time": times, "sync": [0.0, 1.0, 0.0, 1.0], "theta": [7.0, 8.0, 9.0, 10.0]}
    )
    joined = merged(Converted(log, {}), Converted(mocap, {}), ClockFit(0.0, 0.0, 0.0, 0.0, 6, 0))
    assert joined["time"].to_list() == [0.0, 0.05, 2 / 3, 0.7, 0.9]
    assert joined["theta"].to_list() == [None, 7.0, 8.0, 9.0, 10.0]
    assert joined["trigger"].to_list() == [1.0, None, 2.0, None, 3.0]
    shared = SharedAngle(column="theta", markers=("A", "B", "C"))
    said = r"no column 'sync' from log: .*; .* at marker B .* either: no marker 'A', which"
    with pytest.raises(InputError, match=said):
        aligned_clock(Converted(log.drop("sync"), {}), Converted(mocap, {}), shared)
    with pytest.raises(InputError, match="log and motion capture do not overlap in time"):
        merged(Converted(log, {}), Converted(mocap, {}), ClockFit(5.0))


def rewritten(path: Path) -> None:
    """The same size and the same times, and one byte that differs."""
    times, content = path.stat(), path.read_bytes()
    path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


@pytest.mark.parametrize("broken", [False, True])
@pytest.mark.parametrize("change", [rewritten, Path.unlink], ids=lambda change: change.__name__)
def test_a_file_that_changes_while_it_is_read_is_refused(laboratory, monkeypatch, change, broken):
    mcap = known_formats()["mcap"]

    def read_and_change(path: Path, source: Any) -> Recording:
        recording = mcap.read(path, source)
        change(path)
        return recording if not broken else {}["broken"]

    monkeypatch.setitem(known_formats(), "mcap", replace(mcap, read=read_and_change))
    message = refused(laboratory, mocap=None, mocap_source=None)
    assert (
        "leg.mcap: the file changed while it was read; wait until it is recorded or copied"
        in message
    )


BOTH = {
    **CAPTURE,
    "analogs": {"sync": {"channel": "A1"}, "theta": {"channel": "A1", "unit": "deg"}},
}
PERIODIC = [
    stamped(i * 2_000_000, angle=0.0, torque=0.0, sync=(i // 29) % 2 > 0) for i in range(2500)
]


def stating(name: str, content: dict[str, Any]) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(yaml.safe_dump(content))


MISTAKES: dict[str, tuple[Callable[[Path], object] | None, dict[str, object], str]] = {
    "one column of both": (stating("vicon.yaml", BOTH), {},
     "trial walk_1 (leg.mcap, vicon.c3d): column 'theta' is mapped in log and motion capture"),
    "no sync": (stating("vicon.yaml", {"format": "c3d"}), {},
    "'sync' does not align the log with motion capture of"),
    "a clock of its own": (stating("leg.yaml", {**LEG, "clock": "master"}), {},
    "write clock: sync"),
    "two trials": (lambda folder: write_log(folder / "leg.mcap", PERIODIC), {},
    "trial walk_1 (leg.mcap, vicon.c3d): "),
    "no such log": (None, {"log": "elsewhere/none.bin"},
    "elsewhere/none.bin: no such file; correct its name"),
    "empty": (lambda folder: (folder / "leg.mcap").write_bytes(b""), {},
    "leg.mcap: the file is empty"),
    "c3d as log": (None, {"log": "vicon.c3d", "mocap": ""},
    "is c3d, its source file says mcap; write `format: c3d`"),
    "a device": (None, {"log": "/dev/null"}, "/dev/null: no such file"),
    "no such source file": (None, {"log_source": "none"}, "none.yaml: no such file"),
    "no source file": (None, {"log_source": None}, "log_source is empty"),
    "no file": (None, {"log": None, "mocap": float("nan")},
    "trial walk_1: the sheet names no file"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_told_and_leaves_nothing_behind(laboratory: Path, mistake: str) -> None:
    change, fields, told = MISTAKES[mistake]
    if change is not None:
        change(laboratory)
    assert told in refused(laboratory, **fields)


def test_a_trial_file_keeps_every_bit_and_what_is_none_is_refused(
    tmp_path: Path,
) -> None:
    path = tmp_path / "t.parquet"
    samples = pl.DataFrame({"time": [0.1, 0.2, 0.3], "theta": [None, float("nan"), 1 / 3]})
    with pytest.raises(InputError, match="no such trial; ingest it first"):
        read_trial(path)
    trial = Trial("t", samples, {"plates": [{"corners": [[0.1, 1e-17, -0.0]]}], "warnings": ["°"]})
    write_trial(trial, path)
    read = read_trial(path)
    assert read.samples["theta"].is_nan().to_list() == [None, True, False]
    assert (read.samples.equals(samples), read.name, read.provenance) == (
        True,
        trial.name,
        trial.provenance,
    )
    whole = path.read_bytes()
    number = struct.pack("<d", 1 / 3)  # it stands also in the statistics, which nobody reads
    at = whole.index(number, whole.index(number, whole.index(number) + 1) + 1)
    changed = (
        whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :],
        whole.replace(b'{"plates', b'["plates'),
    )
    for content in (b"", b"time,theta\n", b"PAR1" + bytes(50) + b"PAR1", *changed):
        path.write_bytes(content)
        with pytest.raises(
            InputError, match=r"t.parquet: not what `ingest` wrote .*; ingest it again"
        ):
            read_trial(path)
    pl.DataFrame({"time": [0.0]}).write_parquet(path)
    with pytest.raises(InputError, match="Parquet without provenance"):
        read_trial(path)


def test_a_trial_without_a_column_that_its_experiment_needs_is_refused_by_name(
    laboratory: Path,
) -> None:
    needed = EXPERIMENTS["belt"].needed_columns
    with pytest.raises(
        InputError,
        match=r"trial walk_1: no column torque, theta_m, .* experiment 'belt' needs; map",
    ):
        ingest_trial(
            row(experiment="belt"), laboratory, laboratory, laboratory / "out.parquet", needed
        )
    assert not (laboratory / "out.parquet").exists()


CSV_LOG = "format: csv\ntime: {column: t, unit: s}\nchannels:\n  theta: {column: a, unit: UNIT}\n"
CSV_LOG += "  torque: {column: m, unit: N*m}\n"


def log_of(folder: Path, angle: float, torque: float, unit: str = "rad") -> Trial:
    """A log of four rows whose third has these values, trial_of."""
    rows = [f"{k / 100},{angle if k == 2 else 0.1},{torque if k == 2 else k}" for k in range(4)]
    (folder / "log.csv").write_text("\n".join(["t,a,m", *rows]) + "\n")
    (folder / "s.yaml").write_text(CSV_LOG.replace("UNIT", unit))
    return trial_of(folder, log="log.csv", log_source="s")


def capture_of(
    folder: Path, points: np.ndarray, experiment: str = "ingest_only", **parameters: object
) -> Trial:
    """A capture without plates, trial_of."""
    write_c3d(folder / "a.c3d", points, **parameters)  # type: ignore[arg-type]
    (folder / "s.yaml").write_text("format: c3d\nmarkers: all\nplates: []\n")
    return trial_of(folder, experiment, mocap="a.c3d", mocap_source="s")


def trial_of(folder: Path, experiment: str = "ingest_only", **files: str) -> Trial:
    ingest_trial(
        {"trial": "a", "experiment": experiment, **files}, folder, folder, folder / "a.parquet"
    )
    return read_trial(folder / "a.parquet")


def seen(frames: int = 6) -> np.ndarray:
    """Two points that are seen, in mm."""
    return np.concatenate(
        [np.arange(1.0, 1 + frames * 6).reshape(frames, 2, 3), np.zeros((frames, 2, 1))], axis=2
    )


def test_every_unit_of_a_column_has_a_largest_value() -> None:
    assert {unit for name, unit in COLUMNS.items() if name != "time"} | set(
        FAMILIES.values()
    ) == set(LIMITS.largest)
    # however many there are
    assert [unit_of(plate_columns(10, of)[2]) for of in ("force", "moment")] == ["N", "N*m"]


@pytest.mark.parametrize(("angle", "torque", "unit", "told"), [
    (-1.1e6, 0.0, "rad",
     r"theta is -1\.1e\+06 rad at 0\.020 s, beyond .* can reach, -1e\+06 to 1e\+06"),
    (0.0, 1e200, "rad", r"torque is 1e\+200 N\*m at 0\.020 s"),
    (1.7e308, 0.0, "rev", r"theta is inf rad at 0\.020 s"),  # overflows in the conversion
])  # fmt: skip
def test_values_that_nothing_can_reach_are_refused_by_file_column_value_and_remedy(
    tmp_path, angle, torque, unit, told
):
    with pytest.raises(
        InputError, match=rf"log\.csv: {told}.*; correct its unit or scale in the source file, or"
    ):
        log_of(tmp_path, angle, torque, unit)
    assert not (tmp_path / "a.parquet").exists()


def test_unseen_markers_are_refused_where_they_are_needed(
    tmp_path: Path,
) -> None:
    hidden = seen()
    hidden[:, :, 3] = -1.0
    for experiment in (name for name, facts in EXPERIMENTS.items() if facts.place == "walkway"):
        with pytest.raises(
            InputError, match=rf"no marker was ever seen.* experiment '{experiment}' needs them; "
        ):
            capture_of(tmp_path, hidden, experiment)
    (said,) = capture_of(tmp_path, hidden).provenance["warnings"]
    assert said == "a.c3d: no marker was seen in any frame"
    hidden[4, 0, 3] = 0.0
    assert capture_of(tmp_path, hidden, "walking").provenance["warnings"] == []


TIME = np.arange(40) / 500
ANGLE, TORQUE = np.sin(40 * TIME), 30 * np.sin(40 * TIME)
LOG = {"t": 1e3 * TIME + 7, "angle": np.rad2deg(ANGLE), "torque": -1e3 * TORQUE}


def write_text(path, columns, sign=",", head=""):
    rows = zip(*columns.values(), strict=True)
    path.write_text(
        head + "\n".join([sign.join(columns), *(sign.join(map(str, row)) for row in rows)]) + "\n"
    )
    return path


def write_table(path, columns):
    return write_text(path, columns, "\t", f"grf\nnRows={len(TIME)}\nendheader\n")


def write_json(path, columns):
    rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    path.write_text(
        "".join(json.dumps(dict(zip(columns, row, strict=True))) + "\n" for row in rows)
    )
    return path


WRITERS = {
    "csv": ("csv", "column", write_text), "json_lines": ("json_lines", "field", write_json),
    "mat": ("mat", "variable", lambda path, columns: write_mat(path, **columns)),
    "mat 7.3": ("mat", "variable", lambda path, columns: write_mat73(path, **columns)),
    "tdms": ("tdms", "channel", lambda path, columns: write_tdms(path, [(*one,
    {}) for one in columns.items()])),
    "opensim": ("opensim", "column", write_table),
}  # fmt: skip
NO_TIME = {"opensim": {"column": None, "unit": None}}  # where a source file has a time of its own
EVERY = pytest.mark.parametrize("what", WRITERS)
OTHERS = [what for what in WRITERS if what != "csv"]


def described(what, counter=None, **fields):
    """The source file of a log in a format, with other fields than the usual."""
    name, key, _ = WRITERS[what]
    theta, torque = (
        {key: "angle", "unit": "deg", "counter": counter},
        {key: "torque", "unit": "Nmm", "sign": -1},
    )
    content = {
        "format": name,
        "time": {key: "t", "unit": "ms"},
        "channels": {"theta": theta, "torque": torque},
    }
    return known_formats()[name].source.model_validate({**content, **fields})


@EVERY
def test_a_log_gives_the_same_columns_in_every_format(tmp_path, what):
    path = WRITERS[what][2](tmp_path / "log", {**LOG, "count": np.arange(7, 47)})
    recording = read_converted(path, described(what, counter="count"))
    for column, expected in (("time", TIME), ("theta", ANGLE), ("torque", TORQUE)):
        np.testing.assert_allclose(recording.samples[column], expected, atol=1e-12)
    assert recording.samples["theta_counter"].to_list() == list(range(7, 47))
    by_rate = read_converted(path, described(what, time={**NO_TIME.get(what, {}), "rate": 520}))
    np.testing.assert_allclose(by_rate.samples["time"], TIME * 500 / 520, atol=1e-12)
    assert (recording.origins["torque"]["unit"], recording.facts["time"]["start"]) == ("Nmm", 7)
    assert recording.facts["rates_hz"]["log"] == pytest.approx(500)


CLOCKS = {
    "t": TIME, "Date": 45_000 + TIME / 86_400, "LabVIEW time": 3.8e9 + TIME,
    "count_time": (1e3 * TIME + 65_500) % 2**16,
}  # fmt: skip


@pytest.mark.parametrize(
    ("what", "name"), [*(("csv", name) for name in CLOCKS), *((what, "t") for what in OTHERS)]
)
def test_a_rate_that_a_clock_of_the_file_contradicts_is_refused_in_every_format(
    tmp_path, what, name
):
    """A rate of 1000 for a file of 500 Hz halves B, and no check objects."""
    columns = {"angle": LOG["angle"], "torque": LOG["torque"], name: CLOCKS[name]}
    path = WRITERS[what][2](tmp_path / "log", columns)
    read, other = read_converted, NO_TIME.get(what, {})
    assert "but " in (said := refusal_by(read, path, described(what, time={**other, "rate": 1000})))
    assert f"{name}' rises by" in said
    assert len(read(path, described(what, time={**other, "rate": 500})).samples) == len(TIME)


LATE = TIME > 0.039


NO_LOG = [
    ({"torque": np.where(LATE, np.nan, TORQUE)}, {}, "in 20 of 40 "),
    ({"torque": np.where(LATE, np.inf, TORQUE)}, {}, "inf"),
    ({"t": np.full(40, 3.0)}, {}, "time stands still at 0.003 s in 40 of"), ({"t": -TIME},
     {}, "sort rows that changed places by time"),
    ({"t": np.r_[TIME[:30], TIME[20:30]]}, {}, "row 30; delete rows that stand twice"),
    ({"t": np.where(LATE, np.nan, TIME)}, {}, "no time in "), ({"angle": None, "angel": ANGLE},
     {}, "angel"),
    ({"big": np.full(40, 2.0**53)},
     {"counter": "big"}, "is no count of samples, a whole number below 9.01e+15"),
    ({}, {"counter": "angle"}, "is no count of samples, a whole number below"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("what", "changes", "counted", "told"),
    [*(("csv", *case) for case in NO_LOG), *((what, *NO_LOG[0]) for what in OTHERS),
     *((what, *NO_LOG[-1]) for what in OTHERS)],
)  # fmt: skip
def test_what_cannot_be_a_log_is_refused_in_every_format(tmp_path, what, changes, counted, told):
    columns = {name: one for name, one in {**LOG, **changes}.items() if one is not None}
    path = WRITERS[what][2](tmp_path / "log", columns)
    assert told in refusal_by(read_converted, path, described(what, **counted))


MATLAB = pytest.mark.parametrize("write", [write_mat, write_mat73])


@MATLAB
def test_a_part_of_a_matlab_file_is_a_trial_of_its_own(write, tmp_path):
    path = write(
        tmp_path / "a.mat", Slow=LOG, Fast={**LOG, "torque": -2e3 * TORQUE}, clock=1e3 * TIME
    )
    for part, factor in (("Slow", 1), ("Fast", 2)):
        recording = read_converted(path, described("mat").of_part(part))
        np.testing.assert_allclose(recording.samples["torque"], factor * TORQUE, atol=1e-12)
    shared = described("mat", time={"variable": "/clock", "unit": "ms"}).of_part("Fast")
    samples = read_converted(path, shared).samples
    np.testing.assert_allclose(samples["torque"], 2 * TORQUE, atol=1e-12)
    said = refusal_by(read_converted, path, described("mat"))
    assert "variable 't' occurs 2 times" in said
    assert "Slow.t" in said
    assert "Fast.t" in said


@MATLAB
def test_the_draft_of_several_trials_is_of_one_and_fits_the_other(write, tmp_path):
    named = {"time_ms": 1e3 * TIME, "ankle_deg": np.rad2deg(ANGLE)}
    path = write(tmp_path / "a.mat", Slow=named, Fast=named, note="left foot")
    overview = inspect_file(path)
    assert (
        "2 parts hold the same variables: name one per trial in the column `log_part`"
        in overview_text(overview)
    )
    (tmp_path / "mine.yaml").write_text(
        draft_source(overview, path.name).replace("NAME_1", "theta")
    )
    read = read_converted(path, read_source(tmp_path / "mine.yaml").of_part("Fast"))
    np.testing.assert_allclose(read.samples["theta"], ANGLE)
    np.testing.assert_allclose(read.samples["time"], TIME, atol=1e-12)
