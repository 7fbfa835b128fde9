"""Campaigns of one or two recordings: all trials of an experiment are refused, and a system without
fork and file locks."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import yaml
from conftest import ROOT
from snakemake_runs import run_forked

from osl_analysis.outcomes.job_log import read_log
from osl_analysis.refusal import is_refused

K = 40.0  # N*m/rad, of the spring
CONFIG = {"campaign": "small", "raw_data": ".", "sheet": "trials.csv"}
NOT_OURS = dict.fromkeys(("simulation", "parameters", "impedance_trajectory"))
SOURCE = {
    "format": "csv",
    "clock": "master",
    "time": {"column": "time", "unit": "s"},
    "channels": {
        "theta": {"column": "angle", "unit": "deg"},
        "torque": {"column": "torque", "unit": "N*m"},
    },
}
WITHOUT_FORK = """
import os
import sys

sys.modules["fcntl"] = None  # an import of it fails, as where there is none
del os.fork, os.forkpty, os.sched_getaffinity
"""


def write_campaign(folder: Path, experiments: dict[str, str]) -> None:
    """Write a campaign of a spring: `sine` is of one frequency, from which K and I cannot be told
    apart, `spring` moves slowly to and fro."""
    rng, time = np.random.default_rng(6), np.arange(0, 60, 0.004)
    moving = np.clip(time - 5, 0, 50)
    angles = {
        "sine": 21.5 * np.sin(2 * np.pi * 0.2 * time),
        "spring": 15 * 2 / np.pi * np.arcsin(np.sin(2 * np.pi * 0.1 * moving)),
    }
    rows = ["trial,experiment,log,log_source"]
    for name, experiment in experiments.items():
        theta = np.radians(angles[name])
        torque = K * theta + 0.5 * np.gradient(theta, time)
        torque += 0.02 * rng.standard_normal(len(time))
        columns = {"time": time, "angle": angles[name], "torque": torque}
        pl.DataFrame(columns).write_csv(folder / f"{name}.csv", float_precision=5)
        rows.append(f"{name},{experiment},{name}.csv,spring")
    (folder / "trials.csv").write_text("\n".join(rows) + "\n")
    (folder / "config.yaml").write_text(yaml.safe_dump(CONFIG | NOT_OURS))
    (folder / "config/sources").mkdir(parents=True)
    (folder / "config/sources/spring.yaml").write_text(yaml.safe_dump(SOURCE))


def run(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run `osl-analysis run` in a folder."""
    return run_forked(["osl-analysis", "run"], folder)


def run_without_fork(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run `osl-analysis run` in a folder as on a system without fork and file locks."""
    blocking = folder / "blocking"
    blocking.mkdir()
    (blocking / "sitecustomize.py").write_text(WITHOUT_FORK)
    python_path = {"PYTHONPATH": os.pathsep.join(map(str, (blocking, ROOT)))}
    program = "from osl_analysis.cli import main; main()"
    command = [sys.executable, "-c", program, "run", "--cores", "1"]
    return subprocess.run(
        command,
        cwd=folder,
        env=os.environ | python_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def test_a_page_is_made_where_every_trial_of_an_experiment_is_refused(tmp_path):
    write_campaign(tmp_path, {"sine": "impedance", "spring": "torque_angle"})

    ended = run(tmp_path)

    results = tmp_path / "results"
    assert ended.returncode == 1
    page = (results / "report.html").read_text(encoding="utf-8")
    assert page.lstrip().startswith("<!")
    assert "K and I cannot be told apart" in page
    fitted = pl.read_csv(results / "tables/torque_angle.csv")
    assert fitted["K_secant"].item() == pytest.approx(K, rel=0.01)
    excluded = pl.read_csv(results / "tables/excluded.csv")
    assert excluded.select("trial", "check").rows() == [("sine", "refused")]
    assert is_refused(results / "tables/impedance.csv")


def test_a_page_is_made_where_every_trial_of_the_campaign_is_refused(tmp_path):
    write_campaign(tmp_path, {"spring": "torque_angle"})
    (tmp_path / "spring.csv").write_text("time,angle,torque\n")

    ended = run(tmp_path)

    assert ended.returncode == 1
    assert "NOT ANALYSED: 1 of 1 trials" in ended.stdout
    page = (tmp_path / "results/report.html").read_text(encoding="utf-8")
    assert page.lstrip().startswith("<!")


def test_a_job_that_is_killed_twice_fails_alone_and_the_page_of_before_does_not_stay(tmp_path):
    write_campaign(tmp_path, {"spring": "torque_angle"})
    (tmp_path / "results").mkdir()
    (tmp_path / "results/report.html").write_text("of before")
    (tmp_path / "unlucky").mkdir()
    for time in ("first", "second"):
        (tmp_path / f"unlucky/spring.csv.{time}.SIGKILL").touch()

    killed = run(tmp_path)
    page_after_kill = (tmp_path / "results/report.html").exists()
    outcome = read_log(tmp_path / "results/logs/ingest/spring.log")["outcome"]
    again = run(tmp_path)

    assert killed.returncode == 1
    assert re.search(r"^killed: spring: .*SIGKILL.*; run again", killed.stdout, re.MULTILINE)
    assert outcome == "killed"
    assert not page_after_kill
    assert again.returncode == 0
    assert (tmp_path / "results/report.html").is_file()


def test_a_campaign_runs_where_there_is_no_fork_and_no_file_lock(tmp_path):
    write_campaign(tmp_path, {"spring": "torque_angle"})

    ended = run_without_fork(tmp_path)

    assert ended.returncode == 0, ended.stdout
    fitted = pl.read_csv(tmp_path / "results/tables/torque_angle.csv")
    assert fitted["K_secant"].item() == pytest.approx(K, rel=0.01)
    assert (tmp_path / "results/report.html").is_file()
