# SPDX-License-Identifier: Apache-2.0
"""Campaigns of one or two recordings: all trials of an experiment are refused, and a system that
lacks what Linux has."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import yaml
from conftest import ROOT
from snakemake_runs import run_forked

K = 40.0  # N*m/rad, of the spring
CONFIG = {"campaign": "small", "raw_data": ".", "sheet": "trials.csv"}
SOURCE = {
    "format": "csv",
    "clock": "master",
    "time": {"column": "time", "unit": "s"},
    "channels": {
        "theta": {"column": "angle", "unit": "deg"},
        "torque": {"column": "torque", "unit": "N*m"},
    },
}
TABLE = "results/tables/torque_angle.csv"
OTHER_SYSTEM = {
    "PYTHONPATH": os.pathsep.join([str(ROOT / "tests/builders/other_system"), str(ROOT)]),
    "PYTHONIOENCODING": "cp1252",
    "PYTHONWARNDEFAULTENCODING": "1",
    "LC_ALL": "C",
    "PYTHONUTF8": "0",
    "PYTHONCOERCECLOCALE": "0",  # no text but ASCII
}
"""The environment of a process to which this machine is like Windows (`other_system`)."""
DOORS = """
import sys
from osl_analysis.cli import main

# the run does its jobs in processes of their own; that the page can be made, these imports show
import osl_analysis.commands.figure, osl_analysis.commands.report

FIT = "fit spring.csv --source config/sources/spring.yaml --model torque_angle"
for command in ("--help", "init drafted --from .", "inspect greek.csv", FIT):
    try:
        main(command.split())
    except SystemExit as end:
        print("exit code", end.code, "of", command)
main()
"""


JUDGED_SHEET = """trial,experiment,log,log_source,accept
spring,torque_angle,spring.csv,spring,
sine,torque_angle,sine.csv,spring,"""
EXCLUDING = ("--config", "quality={exclude: [gap]}")


def write_campaign(folder: Path, experiments: dict[str, str]) -> None:
    """Write a campaign of a spring: `sine` is of one frequency, from which K and I cannot be told
    apart, `spring` moves slowly to and fro."""
    rng = np.random.default_rng(6)
    time = np.arange(0, 60, 0.004)
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
    (folder / "config.yaml").write_text(
        yaml.safe_dump(CONFIG | dict.fromkeys(("simulation", "parameters", "impedance_trajectory")))
    )
    (folder / "config/sources").mkdir(parents=True)
    (folder / "config/sources/spring.yaml").write_text(yaml.safe_dump(SOURCE))


def judged_tables(folder: Path, accept: str, *options: str) -> dict[str, str]:
    """The tables of a campaign after a run with these options. Its `sine` has a gap, which the
    sheet may `accept`."""
    if not folder.exists():
        folder.mkdir()
        write_campaign(folder, {"sine": "torque_angle", "spring": "torque_angle"})
        sine = folder / "sine.csv"
        sine.write_text(re.sub(r"\n30\.[0-4].*", "", sine.read_text()))
    (folder / "trials.csv").write_text(JUDGED_SHEET + accept)
    ended = run_forked(["osl-analysis", "run", "results/summary.json", *options], folder)
    assert not ended.returncode, ended.stdout
    return {path.name: path.read_text() for path in folder.glob("results/tables/*.csv")}


def run(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run `osl-analysis run` in a folder."""
    return run_forked(["osl-analysis", "run"], folder)


@dataclass(frozen=True)
class TwoRuns:
    """A campaign whose `sine` is refused, run while the job of its `spring` is killed, and again
    after that."""

    folder: Path
    killed: subprocess.CompletedProcess[str]
    again: subprocess.CompletedProcess[str]


@pytest.fixture(scope="module")
def two_runs(tmp_path_factory: pytest.TempPathFactory) -> TwoRuns:
    folder = tmp_path_factory.mktemp("killed")
    write_campaign(folder, {"sine": "impedance", "spring": "torque_angle"})
    (folder / "unlucky").mkdir()
    (folder / "unlucky/spring.csv.SIGKILL").touch()

    killed = run(folder)
    again = run(folder)

    return TwoRuns(folder, killed, again)


def test_a_job_that_is_killed_fails_alone_and_has_no_result(two_runs):
    said = two_runs.killed.stdout

    assert two_runs.killed.returncode == 1
    assert re.search("^killed: spring:.*SIGKILL", said, re.MULTILINE)
    assert re.search("^refused: sine:", said, re.MULTILINE), "the others are finished"


def assert_spring_is_fitted(folder):
    assert pl.read_csv(folder / TABLE)["K"].item() == pytest.approx(K, rel=0.01)


def test_a_run_after_a_job_was_killed_does_it(two_runs):
    assert_spring_is_fitted(two_runs.folder)
    excluded = pl.read_csv(two_runs.folder / "results/tables/excluded.csv")
    assert excluded.select("trial", "check").rows() == [("sine", "refused")]


def test_a_page_is_made_where_every_trial_of_an_experiment_is_refused(two_runs):
    results = two_runs.folder / "results"

    assert two_runs.again.returncode == 1
    page = (results / "report.html").read_text(encoding="utf-8")
    assert page.lstrip().startswith("<!")
    assert re.search("sine: .*K .*I ", page)
    assert not (results / "verdict.txt").exists()


def test_with_retries_a_job_that_was_killed_is_done_in_the_same_run(tmp_path):
    write_campaign(tmp_path, {"spring": "torque_angle"})
    (tmp_path / "unlucky").mkdir()
    (tmp_path / "unlucky/spring.csv.SIGKILL").touch()

    ended = run_forked(["osl-analysis", "run", TABLE, "--retries", "1"], tmp_path)

    assert ended.returncode == 0, ended.stdout
    assert not [*(tmp_path / "unlucky").iterdir()], "it was killed"
    assert_spring_is_fitted(tmp_path)


def test_what_is_excluded_and_used_again_leaves_the_tables_of_a_fresh_folder(tmp_path):
    """By the configuration, and by the sheet's `accept`; there and back."""
    ways = {"flagged": [""], "excluded": ["", *EXCLUDING], "accepted": ["gap", *EXCLUDING]}
    fresh = {way: judged_tables(tmp_path / way, *ways[way]) for way in ways}

    for way in ("excluded", "accepted", "excluded", "flagged"):
        assert judged_tables(tmp_path / "flagged", *ways[way]) == fresh[way]
    assert [text["torque_angle.csv"].count("\nsine,") for text in fresh.values()] == [1, 0, 1]


def test_a_page_is_made_where_every_trial_of_the_campaign_is_refused(tmp_path):
    write_campaign(tmp_path, {"spring": "torque_angle"})
    (tmp_path / "spring.csv").write_text("time,angle,torque\n")

    ended = run(tmp_path)

    assert ended.returncode == 1
    assert "NOT ANALYSED: 1 " in ended.stdout
    page = (tmp_path / "results/report.html").read_text(encoding="utf-8")
    assert page.lstrip().startswith("<!")


def test_commands_and_a_campaign_run_without_what_windows_and_macos_lack(tmp_path):
    write_campaign(tmp_path, {"spring": "torque_angle"})
    spring = (tmp_path / "spring.csv").read_text()
    (tmp_path / "greek.csv").write_text(spring.replace("angle", "θ"), encoding="utf-8")

    ended = subprocess.run(
        [sys.executable, "-c", DOORS, "run", "--cores", "1", TABLE],
        cwd=tmp_path,
        env=os.environ | OTHER_SYSTEM,
        encoding="cp1252",
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )

    assert ended.returncode == 0, ended.stdout
    assert re.findall(r"exit code (\d)", ended.stdout) == ["0"] * 4, ended.stdout
    assert "\\u03b8" in ended.stdout
    assert_spring_is_fitted(tmp_path)


def test_without_options_a_run_gives_the_same_and_the_next_one_has_nothing_to_do(tmp_path):
    """Jobs are then Snakemakes of their own, and the run says what to state. As it is planned, it
    is not known yet what the table leaves out."""
    table = "results/tables/torque_angle.csv"
    command = ["snakemake", "--snakefile", str(ROOT / "Snakefile"), "--configfile", "config.yaml"]
    command += ["--cores", "2", table]
    without = [*command, "--workflow-profile", "none"]
    alone, usual = tmp_path / "alone", tmp_path / "usual"
    alone.mkdir()
    write_campaign(alone, {"spring": "torque_angle"})
    shutil.copytree(alone, usual)

    first = run_forked(without, alone).stdout
    second = run_forked(without, alone).stdout
    in_threads = run_forked(command, usual).stdout

    assert first.count("state `--force-use-threads`") == 1, first
    assert "--force-use-threads" not in in_threads
    assert "Nothing to be done" in second, second
    assert (alone / table).read_bytes() == (usual / table).read_bytes()
