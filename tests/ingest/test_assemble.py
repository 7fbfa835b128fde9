# SPDX-License-Identifier: Apache-2.0
"""From the sheet's row to the trial's file, and one log in every format of rows: the same columns
and refusals."""

import hashlib
import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
import yaml
from c3d_builder import write_c3d
from conftest import refused_with, said_in_refusal
from mcap_builder import SAMPLE, stamped, write_log

from osl_analysis.base.trial import (
    Trial,
    read_trial,
    write_trial,
)
from osl_analysis.commands.trials import checked_trial
from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.formats import known_formats
from osl_analysis.ingest.conversion import Converted
from osl_analysis.ingest.several_clocks import joined_recordings

LEG = {
    "format": "mcap",
    "clock": "sync",
    "time": {"source": "header"},
    "channels": {
        "theta": {"topic": "/lab", "field": "angle", "unit": "deg"},
        "sync": {"topic": "/lab", "field": "sync", "unit": "V"},
    },
}
CAPTURE = {"format": "c3d", "analogs": {"sync": {"channel": "A1"}}}
LEG_OFFSET = 4.321  # leg time = offset + (1 + drift) * motion capture's
LEG_DRIFT = 40e-6
DURATION = 5.0


def level(time):
    return (
        np.searchsorted(
            np.cumsum(np.random.default_rng(0).uniform(0.06, 0.25, 40)), time, side="right"
        )
        % 2
    ).astype(float)


def angle(time):
    """A joint angle [deg] at motion capture's time [s]."""
    return 10 * np.sin(2 * np.pi * 0.7 * time)


@pytest.fixture
def laboratory(tmp_path):
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
    time = np.arange(frames) / 300
    positions = np.column_stack([100 + time, 200 - time, 1 + 0 * time, 0 * time])[:, None]
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


def row(**fields):
    known = {"log": "leg.mcap", "log_source": "leg", "mocap": "vicon.c3d", "mocap_source": "vicon"}
    return {"trial": "walk_1", **known, **fields}


def ingested(folder, **fields):
    write_trial(checked_trial(row(**fields), folder, folder), folder / OUT)
    return read_trial(folder / OUT)


def refused(folder, **fields):
    said = said_in_refusal(ingested, folder, **fields)
    assert not (folder / OUT).parent.exists()
    return said


def test_log_and_capture_share_one_clock_and_provenance_names_their_files(
    laboratory,
):
    trial = ingested(laboratory)
    speed = np.radians(10 * 2 * np.pi * 0.7)
    time, theta = trial.signals("theta")
    # half a millisecond
    np.testing.assert_allclose(theta, np.radians(angle(time)), atol=speed * 0.5e-3)
    assert 0 <= time[0] < time[-1] <= DURATION  # rows beyond motion capture's are not used
    clock = trial.provenance["clock"]
    assert clock["residual"] < 1e-3
    assert clock["edges"] >= 25
    files = trial.provenance["files"]
    columns = trial.provenance["columns"]
    for role, name in (("log", "leg.mcap"), ("mocap", "vicon.c3d")):
        assert files[role]["path"] == name
        assert files[role]["sha256"] == hashlib.sha256((laboratory / name).read_bytes()).hexdigest()
    assert columns["theta"]["topic"] == "/lab"
    assert columns["theta"]["factor"] == pytest.approx(np.pi / 180)
    assert columns["sync"]["file"] == "mocap"


def test_rows_within_a_nanosecond_are_one_and_clocks_apart_are_refused():
    mocap = Converted(pl.DataFrame({"time": [0.0, 2 / 3, 0.9], "trigger": [1.0, 2.0, 3.0]}), {})
    log = Converted(pl.DataFrame({"time": [0.05, 2 / 3 + 3e-10], "theta": [7.0, 8.0]}), {})
    clock = SimpleNamespace(format="trc", clock="common")

    def joined(recording):
        recordings = {"log": recording, "mocap": mocap}
        return joined_recordings(recordings, dict.fromkeys(recordings, clock))[0]

    samples = joined(log)
    assert samples["time"].to_list() == [0.0, 0.05, 2 / 3, 0.9]
    assert samples["theta"].to_list() == [None, 7.0, 8.0, None]
    assert samples["trigger"].to_list() == [1.0, None, 2.0, 3.0]
    with refused_with("time"):
        joined(replace(log, start_s=5.0))


def rewritten(path):
    """The same size and the same times, and one byte that differs."""
    times = path.stat()
    content = path.read_bytes()
    path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


@pytest.mark.parametrize("change", [rewritten, Path.unlink], ids=lambda change: change.__name__)
def test_a_file_that_changes_while_it_is_read_is_refused(laboratory, monkeypatch, change):
    mcap = known_formats()["mcap"]

    def read_and_change(path, source):
        recording = mcap.read(path, source)
        change(path)
        return recording

    monkeypatch.setitem(known_formats(), "mcap", replace(mcap, read=read_and_change))
    message = refused(laboratory, mocap=None, mocap_source=None)
    assert "leg.mcap: " in message


BOTH = {
    **CAPTURE,
    "analogs": {"sync": {"channel": "A1"}, "theta": {"channel": "A1", "unit": "deg"}},
}
PERIODIC = [
    stamped(i * 2_000_000, angle=0.0, torque=0.0, sync=(i // 29) % 2 > 0) for i in range(2500)
]


def stating(name, content):
    return lambda folder: (folder / name).write_text(yaml.safe_dump(content))


MISTAKES = [
    (stating("vicon.yaml", BOTH), {}, "trial walk_1 (leg.mcap, vicon.c3d): column 'theta'"),
    (stating("vicon.yaml", {"format": "c3d"}), {}, "'sync'"),
    (stating("leg.yaml", {**LEG, "clock": "master"}), {}, "clock: sync"),
    (
        lambda folder: write_log(folder / "leg.mcap", PERIODIC),
        {},
        "trial walk_1 (leg.mcap, vicon.c3d): ",
    ),
    (None, {"log": "elsewhere/none.bin"}, "elsewhere/none.bin: "),
]


@pytest.mark.parametrize(("change", "fields", "told"), MISTAKES)
def test_a_mistake_is_told_and_leaves_nothing_behind(
    laboratory,
    change,
    fields,
    told,
):
    if change is not None:
        change(laboratory)
    assert told in refused(laboratory, **fields)


def test_a_trial_file_keeps_every_bit_and_what_is_none_is_refused(
    tmp_path,
):
    path = tmp_path / "t.parquet"
    samples = pl.DataFrame({"time": [0.1, 0.2, 0.3], "theta": [None, float("nan"), 1 / 3]})
    with refused_with(r"t\.parquet: .*ingest"):
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
    path.write_bytes(b"PAR1" + bytes(50) + b"PAR1")
    with refused_with(r"t\.parquet: .*ingest"):
        read_trial(path)


def test_a_trial_without_a_column_that_it_needs_is_refused_by_name(
    laboratory,
):
    needed = EXPERIMENTS["belt"].needed_columns
    with refused_with(r"trial walk_1:.*column torque, theta_m,.*experiment 'belt'"):
        checked_trial(row(experiment="belt"), laboratory, laboratory, needed)


CSV_LOG = "format: csv\ntime: {column: t, unit: s}\nchannels:\n  theta: {column: a, unit: UNIT}\n"
CSV_LOG += "  torque: {column: m, unit: N*m}\n"


def capture_of(folder, points, experiment, **parameters):
    """A capture without plates, trial_of."""
    write_c3d(folder / "a.c3d", points, **parameters)
    (folder / "s.yaml").write_text("format: c3d\nmarkers: all\nplates: []\n")
    return trial_of(folder, experiment, mocap="a.c3d", mocap_source="s")


def trial_of(folder, experiment="ingest_only", **files):
    cells = {"trial": "a", "experiment": experiment, **files}
    write_trial(checked_trial(cells, folder, folder), folder / "a.parquet")
    return read_trial(folder / "a.parquet")


@pytest.mark.parametrize(
    ("angle", "torque", "unit", "told"),
    [
        (-1.1e6, 0.0, "rad", r"theta.*-1\.1e\+06 rad.*0\.020 s,.*-1e\+06.*1e\+06"),
        (0.0, 1e200, "rad", r"torque.*1e\+200 N\*m.*0\.020 s"),
        (1.7e308, 0.0, "rev", r"theta.*rad.*0\.020 s"),  # overflows in the conversion
    ],
)
def test_values_that_nothing_can_reach_are_refused_with_a_remedy(
    tmp_path, angle, torque, unit, told
):
    rows = [f"{k / 100},{angle if k == 2 else 0.1},{torque if k == 2 else k}" for k in range(4)]
    (tmp_path / "log.csv").write_text("\n".join(["t,a,m", *rows]) + "\n")
    (tmp_path / "s.yaml").write_text(CSV_LOG.replace("UNIT", unit))
    with refused_with(rf"log\.csv: {told}.*;.*unit.*scale"):
        trial_of(tmp_path, log="log.csv", log_source="s")
    assert not (tmp_path / "a.parquet").exists()


def test_unseen_markers_are_refused_where_they_are_needed(
    tmp_path,
):
    hidden = np.arange(1.0, 49).reshape(6, 2, 4)
    hidden[:, :, 3] = -1.0
    for experiment in (name for name, facts in EXPERIMENTS.items() if facts.place == "walkway"):
        with refused_with(rf"marker.*experiment '{experiment}'"):
            capture_of(tmp_path, hidden, experiment)
    hidden[4, 0, 3] = 0.0
    assert capture_of(tmp_path, hidden, "walking").provenance["warnings"] == []
