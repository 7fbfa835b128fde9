"""A campaign of 30 trials through SLURM on this machine: `make test-slurm`, as root on Debian (`one_node.sh`).

A local run simulates and analyses it. SLURM analyses the same recordings in another folder, first with one of them
broken and one submission cancelled, then with all.
"""

import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
NODE = Path(__file__).parent / "one_node.sh"
PROTOCOL = {"frequencies_hz": [2, 5], "cycles": 5, "amplitudes_deg": [2, 4]}
COUNTS = {"belt": 4, "transmission": 3, "actuator": 2, "K_d": [200, 300], "B_d": [5.0], "plate": 3, "walking": 13}
"""With one static trial and four of impedance these are 30."""
CONFIG = {
    "campaign": "small",
    "raw_data": "raw_data/small",
    "sheet": "raw_data/small/trials.csv",
    "simulation": "simulation.yaml",
    "dynamometer": PROTOCOL,
    "walking": {"bootstrap_samples": 100, "perturbed_stance": "own"},
    "figures": {"time_series": {"amplitude_deg": 4, "duration_s": 2}, "frequency_response": {"K_d": 300, "B_d": 5}},
}
SLURM = ["--workflow-profile", str(ROOT / "profiles/slurm"), "--seconds-between-status-checks", "1"]
BROKEN = "belt_02"

pytestmark = pytest.mark.slurm


def start(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    """Snakemake in a folder; both of its streams are in `stdout`."""
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"), "--configfile", "small.yaml"]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    return subprocess.Popen([*command, *arguments], cwd=folder, text=True, **streams)


def run(folder: Path, *arguments: str) -> tuple[int, str]:
    """Exit code and what Snakemake says."""
    process = start(folder, *arguments)
    said, _ = process.communicate()
    return process.returncode, said


def squeue(*options: str) -> list[str]:
    """Lines of `squeue`."""
    done = subprocess.run(["squeue", "--noheader", *options], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


@pytest.fixture(scope="module", autouse=True)
def slurm():
    """SLURM, on as many cores as this process may use."""
    subprocess.run([NODE, "start", str(min(2, len(os.sched_getaffinity(0))))], check=True)
    yield
    subprocess.run([NODE, "stop"], check=True)


@pytest.fixture(scope="module")
def local(tmp_path_factory) -> Path:
    """The campaign after a local run."""
    folder = tmp_path_factory.mktemp("local")
    shutil.copytree(ROOT / "config", folder / "config")
    settings = yaml.safe_load((ROOT / "config/simulation/default.yaml").read_text())
    settings["experiments"] |= COUNTS
    settings["actuator"] |= {"duration_s": 10}
    settings["protocol"] |= PROTOCOL | {"rest_s": 0.5, "lead_s": 0.5}
    (folder / "simulation.yaml").write_text(yaml.safe_dump(settings))
    (folder / "small.yaml").write_text(yaml.safe_dump(CONFIG))
    begun = time.perf_counter()
    code, said = run(folder)
    print(f"\nlocal run, with simulation: {time.perf_counter() - begun:.0f} s")
    assert code == 0, said
    return folder


@pytest.fixture(scope="module")
def cluster(local, tmp_path_factory) -> Path:
    """The same recordings and configuration, without results and with a broken recording."""
    folder = tmp_path_factory.mktemp("cluster")
    shutil.copytree(local, folder, ignore=shutil.ignore_patterns("results", ".snakemake"), dirs_exist_ok=True)
    (folder / "small.yaml").write_text(yaml.safe_dump(CONFIG | {"simulation": None}))
    (folder / f"raw_data/small/dynamometer/{BROKEN}.mcap").write_bytes(b"no log")
    return folder


def lost_trials(said: str) -> set[str]:
    """Trials that are listed because their submission was cancelled."""
    return set(re.findall(r"^  trial (\S+), file .*: the cluster's job \d+ was lost \(CANCELLED\)", said, re.MULTILINE))


def test_a_broken_recording_and_a_cancelled_submission_are_named_and_the_rest_is_made(cluster):
    """The submission of crossings is cancelled when the first of them is there."""
    begun = time.perf_counter()
    process = start(cluster, *SLURM)
    while not list((cluster / "results/crossings").glob("*.parquet")) and process.poll() is None:
        time.sleep(0.2)
    (number,) = squeue("--states=running", "--format=%i")
    subprocess.run(["scancel", number], check=True)
    said, _ = process.communicate()
    print(f"\nthrough SLURM, without simulation: {time.perf_counter() - begun:.0f} s")
    lost = lost_trials(said)
    assert process.returncode == 1, said
    assert re.search(rf"^  trial {BROKEN}, file \S+{BROKEN}\.mcap: .*; remedy: ", said, re.MULTILINE), said
    assert lost, said
    assert all(trial.startswith("walking_") for trial in lost)
    assert f"NOT ANALYSED: {1 + len(lost)} of 30 trials" in said
    assert re.search(r"^crossing +\d+ jobs", said, re.MULTILINE)
    assert len((cluster / "results/tables/belt.csv").read_text().splitlines()) == 1 + 3
    assert not list((cluster / "results").rglob(".*"))
    assert said.count("has been submitted with SLURM jobid") == 5


def test_the_next_run_makes_what_is_missing_and_every_table_is_that_of_the_local_run(cluster, local):
    name = f"raw_data/small/dynamometer/{BROKEN}.mcap"
    shutil.copy2(local / name, cluster / name)
    begun = time.perf_counter()
    code, said = run(cluster, *SLURM)
    print(f"\nwhat was missing, through SLURM: {time.perf_counter() - begun:.0f} s")
    assert code == 0, said
    assert re.search(r"^ingest +1$", said, re.MULTILINE), said
    tables = sorted(path.relative_to(local) for path in (local / "results").rglob("*.csv"))
    assert len(tables) > 140
    differing = [path for path in tables if (local / path).read_bytes() != (cluster / path).read_bytes()]
    assert differing == []


def test_a_local_run_has_nothing_left_to_do(cluster):
    _, said = run(cluster, "-n")
    assert "Nothing to be done" in said
    shutil.rmtree(cluster / ".snakemake")
    _, said = run(cluster, "-n")
    assert "Nothing to be done" in said
