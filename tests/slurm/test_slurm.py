"""Campaigns through SLURM on this machine: `make test-slurm`, as root on Debian (`one_node.sh`).

A local run simulates and analyses a campaign. SLURM does the same in another folder as one submission of the local run,
and analyses some of the recordings as several by the plug-in of Snakemake, of which one is cancelled.
"""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from conftest import ROOT
from snakemake_runs import OVERRIDES, write_small

from osl_analysis.refusal import is_refused

CONFIG, BROKEN, TABLE = "config/small.yaml", "belt_02", "results/tables/belt.csv"
LOG = f"raw_data/small/dynamometer/{BROKEN}.mcap"
COUNTS = {"belt": 4, "transmission": 2, "actuator": 2, "plate": 3, "walking": 8}  # and one static, four of impedance
SNAKEMAKE = [sys.executable, "-m", "snakemake"]
CAMPAIGN = ["--snakefile", str(ROOT / "Snakefile"), "--configfile", CONFIG]
LONGEST_S = 400  # of one run on a busy machine

pytestmark = pytest.mark.slurm


def run(folder: Path, *arguments: str, then: Callable[[], None] = lambda: None, once: str = CONFIG) -> str:
    """What Snakemake says in a folder, and its exit code as a last line. `then` is called when there is a file like
    `once` that is no refusal record."""
    said, command = folder / "said.txt", [*SNAKEMAKE, *arguments, *CAMPAIGN]
    with said.open("w") as file, subprocess.Popen(command, cwd=folder, stdout=file, stderr=file) as it:
        while all(map(is_refused, folder.glob(once))) and it.poll() is None:
            time.sleep(0.1)
        then()
        it.wait(timeout=LONGEST_S)
    return f"{said.read_text()}\nexit code {it.returncode}"


def differing(local: Path, other: Path) -> list[Path]:
    """The tables of a folder that are not those of the local run."""
    tables = [path.relative_to(other) for path in (other / "results").rglob("*") if path.suffix in (".csv", ".zip")]
    assert tables
    return [path for path in tables if (local / path).read_bytes() != (other / path).read_bytes()]


@pytest.fixture(scope="module")
def local(tmp_path_factory) -> Path:
    """The campaign after a local run, with its time [s] in the file `seconds`."""
    assert shutil.which("sbatch"), "SLURM is started by `make test-slurm`"
    folder = tmp_path_factory.mktemp("local")
    write_small(folder, COUNTS)
    (folder / CONFIG).write_text(yaml.safe_dump(OVERRIDES))
    begun = time.perf_counter()
    assert run(folder).endswith("exit code 0")
    (folder / "seconds").write_text(str(time.perf_counter() - begun))
    return folder


def test_one_submission_of_the_local_run_gives_its_bytes_in_about_its_time(local, tmp_path):
    shutil.copytree(local / "config", (folder := tmp_path) / "config")
    snakemake, asked = " ".join(SNAKEMAKE + CAMPAIGN), time.time()
    command = f"date +%s.%N > begun; {snakemake} --cores 2; code=$?; date +%s.%N > ended; exit $code"
    sbatch = ["sbatch", "--wait", "-c", "2", "--output", "said.txt", "--wrap", command]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run(sbatch, cwd=folder, env=environment, check=True, timeout=LONGEST_S)
    begun, ended = (float((folder / name).read_text()) for name in ("begun", "ended"))
    here, there = float((local / "seconds").read_text()), ended - begun
    print(f"\n24 trials: local {here:.0f} s, in one submission {there:.0f} s after {begun - asked:.1f} s in the queue")
    assert differing(local, folder) == []
    assert len(list((folder / "results").rglob("*.csv"))) == len(list((local / "results").rglob("*.csv")))
    assert there < 1.5 * here
    assert "Nothing to be done" in run(folder, "-n")


def test_several_submissions_give_the_same_bytes_and_a_cancelled_one_is_made_by_the_next_run(local, tmp_path):
    """Four trials of the bench, two in each submission; one recording is broken."""
    for part in ("config", "raw_data"):
        shutil.copytree(local / part, (folder := tmp_path) / part)
    (folder / CONFIG).write_text(yaml.safe_dump(OVERRIDES | {"simulation": None, "data": "simulated"}))
    (folder / LOG).write_bytes(b"no log")
    options = (TABLE, "--workflow-profile", str(ROOT / "profiles/slurm"), "--group-components", "trials=2")
    options += ("--default-resources", "mem_mb=500", "runtime=5")

    def cancel() -> None:
        running = ("squeue", "--noheader", "--states=running", "--format=%i")
        subprocess.run(["scancel", *subprocess.check_output(running, text=True).split()[-1:]], check=True)

    said = run(folder, *options, then=cancel, once="results/trials/*.parquet")
    assert said.endswith("exit code 1"), said
    assert re.search(r"^not made: .*; run again", said, re.MULTILINE), said
    said = run(folder, *options)
    assert said.endswith("exit code 1"), said
    assert re.search(rf"^  trial {BROKEN}, file \S+{BROKEN}\.mcap: .*; remedy: ", said, re.MULTILINE), said
    assert "not made:" not in said
    assert len((folder / TABLE).read_text().splitlines()) == 1 + 3
    shutil.copy2(local / LOG, folder / LOG)
    assert run(folder, TABLE).endswith("exit code 0")
    assert differing(local, folder) == []
