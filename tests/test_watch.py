"""Recordings examined as they come: when one is complete, what is said of it, and that nothing is said twice."""

import os
import re
from pathlib import Path

import pytest
from conftest import ROOT
from test_new_campaign import DAMPING, INERTIA, STIFFNESS, write_joint

from osl_analysis.commands.watch import QUIET_S, Arrivals, bench_of, line_of, read_notes, write_notes
from osl_analysis.shipped import default_config


@pytest.fixture(autouse=True)
def in_root(monkeypatch):
    monkeypatch.chdir(ROOT)


@pytest.fixture
def bench(tmp_path):
    return bench_of(default_config(), None, tmp_path / "pictures")


def touch(path, text, second):
    """Write a file whose date is `second`."""
    path.write_text(text)
    os.utime(path, (second, second))


def test_a_file_that_grows_is_left_alone_until_it_rests(tmp_path):
    arrivals, log = Arrivals(tmp_path), tmp_path / "a.csv"
    for second in range(10):
        touch(log, "x" * (second + 1), second)
        assert arrivals.complete(float(second)) == []
    assert arrivals.complete(9.0 + QUIET_S - 0.1) == []
    assert arrivals.complete(9.0 + QUIET_S) == [log]
    assert arrivals.complete(9.0 + 3 * QUIET_S) == []


def test_a_file_of_the_same_size_that_is_written_again_is_examined_again(tmp_path):
    arrivals, log = Arrivals(tmp_path), tmp_path / "a.csv"
    touch(log, "first", 1)
    assert [arrivals.complete(now) for now in (0.0, QUIET_S)] == [[], [log]]
    touch(log, "later", 2)
    assert [arrivals.complete(QUIET_S + now) for now in (1.0, 1.0 + QUIET_S)] == [[], [log]]


def test_a_restart_does_not_repeat_and_an_empty_file_waits(tmp_path):
    log, notes = tmp_path / "in/a.csv", tmp_path / "out/examined.json"
    log.parent.mkdir()
    touch(log, "", 1)
    arrivals = Arrivals(log.parent)
    assert [arrivals.complete(now) for now in (0.0, QUIET_S)] == [[], []]
    touch(log, "text", 2)
    assert [arrivals.complete(QUIET_S + now) for now in (1.0, 1.0 + QUIET_S)] == [[], [log]]
    write_notes(notes, arrivals.seen)
    again = Arrivals(log.parent, read_notes(notes))
    assert [again.complete(now) for now in (0.0, QUIET_S, 2 * QUIET_S)] == [[], [], []]
    notes.write_text("{cut")
    assert read_notes(notes) == {}


def test_a_recording_of_an_unknown_recorder_gives_its_joint_and_what_was_guessed(tmp_path, bench):
    write_joint(tmp_path / "in/k120_b2.csv")
    said = line_of(tmp_path / "in/k120_b2.csv", tmp_path / "in", bench)
    found = {name: float(value) for name, value in re.findall(r"\b([KBI]) (\S+) ±", said)}
    assert found == pytest.approx({"K": STIFFNESS, "B": DAMPING, "I": INERTIA}, rel=0.02)
    assert 'channels are guessed: theta: {column: "ankle_angle_deg"' in said
    assert (tmp_path / "pictures/k120_b2.png").stat().st_size > 10_000
    assert sorted(path.name for path in tmp_path.rglob("*") if path.is_file()) == ["k120_b2.csv", "k120_b2.png"]


def test_a_wrong_sign_and_a_damaged_file_are_one_line_each(tmp_path, bench):
    write_joint(tmp_path / "in/rec7.csv", sign=-1.0)
    (tmp_path / "in/x.csv").write_text("junk\n")
    said = [line_of(path, tmp_path / "in", bench) for path in sorted((tmp_path / "in").iterdir())]
    assert re.search(r"rec7.csv: REFUSED: .*turn the `sign` of the torque", said[0])
    assert re.search(r"x.csv: REFUSED: no rows", said[1])
    assert [line.count("\n") for line in said] == [0, 0]


def test_the_stated_source_file_decides(tmp_path):
    write_joint(tmp_path / "in/k120_b2.csv", sign=-1.0)
    source = tmp_path / "sources/mine.yaml"
    source.parent.mkdir()
    source.write_text(
        "format: csv\nclock: master\ntime: {column: time_s, unit: s}\nchannels:\n"
        "  theta: {column: ankle_angle_deg, unit: deg}\n"
        "  torque: {column: loadcell_torque_Nm, unit: N*m, sign: -1}\n"
    )
    bench = bench_of(Path("config/config.yaml"), source, tmp_path / "pictures")
    said = line_of(tmp_path / "in/k120_b2.csv", tmp_path / "in", bench)
    assert "guessed" not in said
    assert float(re.search(r"\bK (\S+) ±", said)[1]) == pytest.approx(STIFFNESS, rel=0.01)
