"""Recordings examined as they come: when one is complete, what is said of it, and that nothing is said twice."""

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from any_motion import TRUE, made_trial, noise
from conftest import ROOT

from osl_analysis.commands import inspect as module
from osl_analysis.commands.inspect import (
    Arrivals,
    WatchedBench,
    device_of_row,
    first_look,
    fit_of_row,
    new_campaign,
    quality_text,
    read_notes,
    recording_line,
    watched_lines,
)
from osl_analysis.files import default_config

STIFFNESS, DAMPING, INERTIA = 120.0, 2.0, 0.02


@pytest.fixture(autouse=True)
def in_root(monkeypatch):
    monkeypatch.chdir(ROOT)


@pytest.fixture
def bench(tmp_path):
    return WatchedBench(default_config(), None, tmp_path / "pictures")


def write_joint(path, sign=1.0):
    """A log of an exact joint under a stepped sine, as a laboratory's own CSV: 1 and 3 Hz at 4 deg, 250 Hz."""
    time = np.arange(0, 34, 0.004)
    angle = np.zeros_like(time)
    for start, frequency in ((2.0, 1.0), (24.0, 3.0)):
        inside = (time >= start) & (time < start + 20 / frequency)
        angle[inside] = np.radians(4) * np.sin(2 * np.pi * frequency * (time[inside] - start))
    omega, noise = np.gradient(angle, time), np.random.default_rng(3).normal(0, 0.05, time.size)
    torque = STIFFNESS * angle + DAMPING * omega + INERTIA * np.gradient(omega, time) + noise
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = np.column_stack([time, np.degrees(angle), sign * torque])
    np.savetxt(path, columns, "%.6f", ",", header="time_s,ankle_angle_deg,loadcell_torque_Nm", comments="")


def touch(path, text, second):
    """Write a file whose date is `second`."""
    path.write_text(text)
    os.utime(path, (second, second))


def looks(arrivals, *seconds):
    """The names of what is complete at each of these times, which is then examined."""
    found = []
    for now in seconds:
        complete = arrivals.complete(float(now))
        arrivals.seen |= {path.name: state for path, state in complete}
        found.append([path.name for path, _ in complete])
    return found


def test_a_file_that_grows_with_pauses_is_taken_for_complete_once_at_most(tmp_path):
    """A recorder that writes every 6 s gave a refusal for each part."""
    arrivals, log, found = Arrivals(tmp_path), tmp_path / "a.csv", []
    for second in range(60):
        if second % 6 == 0:
            touch(log, "x" * (second + 1), second)
        found += looks(arrivals, second)
    assert [second for second, names in enumerate(found) if names] in ([4], [])
    assert ["a.csv"] in looks(arrivals, *range(60, 75))
    touch(log, log.read_text().replace("x", "y"), 80)  # written again, of the same size
    assert looks(arrivals, *range(100, 130)).count(["a.csv"]) == 1
    touch(log, "", 140)
    assert ["a.csv"] not in looks(arrivals, *range(200, 230))


def test_what_was_not_examined_before_a_restart_is_examined_then_and_no_more(tmp_path, bench, monkeypatch):
    """All that lay there was noted before the first was examined: after Ctrl-C the rest was lost."""
    (tmp_path / "in").mkdir()
    for name in ("a.csv", "b.csv", "c.csv"):
        touch(tmp_path / f"in/{name}", "text", 1)
    clock = iter(range(0, 1000, 5))
    monkeypatch.setattr(module.time, "monotonic", lambda: float(next(clock)))
    monkeypatch.setattr(module.time, "sleep", lambda _: None)
    first = watched_lines(tmp_path / "in", bench)
    assert " a.csv: " in next(first)
    first.close()
    again = watched_lines(tmp_path / "in", bench)
    assert [" b.csv: " in next(again), " c.csv: " in next(again)] == [True, True]
    again.close()
    assert sorted(read_notes(bench.output / "examined.json")) == ["a.csv", "b.csv", "c.csv"]
    (bench.output / "examined.json").write_text("{cut")
    assert read_notes(bench.output / "examined.json") == {}


def test_a_fault_in_one_recording_does_not_end_the_watch(tmp_path, bench, monkeypatch):
    write_joint(path := tmp_path / "in/k120_b2.csv")
    bench.output.write_text("a file in place of the folder")  # and no picture takes the numbers away
    said = recording_line(path, tmp_path / "in", bench)
    assert re.search(r"\bK 1[12]\d.*no picture: ", said)
    monkeypatch.setattr(module, "fit_of_row", lambda *_: 1 / 0)
    assert "FAILED: unexpected ZeroDivisionError" in recording_line(path, tmp_path / "in", bench)


def test_a_stiffness_far_from_the_desired_one_is_pointed_at(tmp_path, bench):
    write_joint(path := tmp_path / "in/impedance_k300_b2.csv")
    assert "LOOK AT IT: K is 0.4 times the K_d = 300" in recording_line(path, tmp_path / "in", bench)
    new_campaign(tmp_path / "c", recordings=tmp_path / "in")
    (look,) = first_look(tmp_path / "c")
    assert re.search("first trial of experiment impedance, .*: LOOK AT IT\n  K is 0.4 times the K_d = 300", look)


def test_a_recording_of_an_unknown_recorder_gives_its_joint_and_what_was_guessed_or_why_not_in_a_line(tmp_path, bench):
    write_joint(tmp_path / "in/k120_b2.csv")
    write_joint(tmp_path / "in/rec7.csv", sign=-1.0)
    (tmp_path / "in/x.csv").write_text("junk\n")
    paths = sorted((tmp_path / "in").iterdir())
    sound, turned, junk = (recording_line(path, tmp_path / "in", bench) for path in paths)
    found = {name: float(value) for name, value in re.findall(r"\b([KBI]) (\S+) ±", sound)}
    assert found == pytest.approx({"K": STIFFNESS, "B": DAMPING, "I": INERTIA}, rel=0.02)
    assert 'channels are guessed: theta: {column: "ankle_angle_deg"' in sound
    assert (tmp_path / "pictures/k120_b2.png").stat().st_size > 10_000
    assert re.search(r"rec7.csv: REFUSED: .*turn the `sign` of the torque", turned)
    assert re.search(r"x.csv: REFUSED: no rows", junk)
    assert "\n" not in sound + turned + junk
    assert {*paths, tmp_path / "pictures/k120_b2.png"} == {path for path in tmp_path.rglob("*") if path.is_file()}


def test_the_stated_source_file_decides(tmp_path):
    write_joint(tmp_path / "in/k120_b2.csv", sign=-1.0)
    (tmp_path / "mine.yaml").write_text(
        "format: csv\ntime: {column: time_s, unit: s}\nchannels:\n  theta: {column: ankle_angle_deg, unit: deg}\n"
        "  torque: {column: loadcell_torque_Nm, unit: N*m, sign: -1}\n"
    )
    bench = WatchedBench(Path("config/config.yaml"), tmp_path / "mine.yaml", tmp_path / "pictures")
    said = recording_line(tmp_path / "in/k120_b2.csv", tmp_path / "in", bench)
    assert "guessed" not in said
    assert "NOT CHECKED: " in said
    assert float(re.search(r"\bK (\S+) ±", said)[1]) == pytest.approx(STIFFNESS, rel=0.01)


def test_a_trial_of_the_sheet_is_fitted_in_its_windows_and_against_its_curve(monkeypatch):
    rng = np.random.default_rng(1)
    motion = noise(rng, duration=40.0)
    disturbed = np.where((motion[0] > 15) & (motion[0] < 25), 30 * np.sin(9 * motion[0]), 0.0)
    trial = made_trial(rng, motion, more=disturbed)
    row = {"experiment": "impedance", "controller": "mine", "K_d": 250.0, "B_d": None, "windows": "2-14.5 25.5-40"}
    (found,) = fit_of_row(trial, row, None, default_config()).table.to_dicts()
    assert [found[name] for name in TRUE] == pytest.approx(list(TRUE.values()), rel=0.01)
    assert (found["controller"], found["K_d"]) == ("mine", 250.0)
    assert "the configuration names no parameter file" in found["not_checked"]
    monkeypatch.setattr(module, "fit_trial", lambda *given: given[-2]["desired"])
    assert fit_of_row(trial, {"experiment": "torque_angle", "desired": "foot"}, None, default_config()) == "foot"


def test_the_parameters_of_an_ankle_judge_no_knee(bench):
    device, without = bench.config.parameters, bench.config.model_copy(update={"parameters": None})
    assert [device_of_row({"joint": joint}, bench.config) for joint in ("knee", "ankle", None)] == [
        None,
        device,
        device,
    ]
    assert device_of_row({}, without) is None


def test_a_failed_check_that_the_sheet_accepts_is_not_repeated(bench):
    rng = np.random.default_rng(1)
    trial = made_trial(rng, noise(rng, duration=20.0))
    spoilt = replace(trial, samples=trial.samples.with_columns(torque=pl.col("torque").clip(-4, 4)))
    assert "saturation" in quality_text(spoilt, "impedance", bench.config, ())
    assert "saturation" not in quality_text(spoilt, "impedance", bench.config, ("saturation",))
