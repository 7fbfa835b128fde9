# SPDX-License-Identifier: Apache-2.0
"""Campaigns through SLURM on this machine: `make test-slurm`, as root on Debian (`one_node.sh`).
SLURM analyses some of a local run's recordings as several submissions by the plug-in of Snakemake,
of which one is cancelled."""

import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
import yaml
from conftest import ROOT
from snakemake_runs import OVERRIDES, write_small

from osl_analysis.base.table import not_analysed

CONFIG = "config/small.yaml"
BROKEN = "belt_02"
TABLE = "results/tables/belt.csv"
LOG = f"raw_data/small/dynamometer/{BROKEN}.mcap"
# and one static, four of impedance
LONGEST_S = 400  # of one run on a busy machine

pytestmark = pytest.mark.slurm


def run(
    folder: Path, *arguments: str, then: Callable[[], None] = lambda: None, once: str = CONFIG
) -> str:
    """What Snakemake says in a folder, its exit code last; `then` is called once a file like `once`
    is no refusal."""
    said = folder / "said.txt"
    command = [
        *[sys.executable, "-m", "snakemake"],
        *arguments,
        *["--snakefile", str(ROOT / "Snakefile"), "--configfile", CONFIG],
    ]
    with (
        said.open("w") as file,
        subprocess.Popen(command, cwd=folder, stdout=file, stderr=file) as it,
    ):
        while all(map(not_analysed, folder.glob(once))) and it.poll() is None:
            time.sleep(0.1)
        then()
        it.wait(timeout=LONGEST_S)
    return f"{said.read_text()}\nexit code {it.returncode}"


def test_submissions_give_the_same_bytes_and_a_cancelled_one_is_made_later(
    tmp_path,
):
    """Four trials of the bench, two in each submission; one recording is broken."""
    assert shutil.which("sbatch"), "SLURM is started by `make test-slurm`"
    local = tmp_path / "local"
    folder = tmp_path / "slurm"
    write_small(
        local,
        {"experiments": {"belt": 4, "transmission": 2, "actuator": 2, "plate": 3, "walking": 8}},
    )
    (local / CONFIG).write_text(yaml.safe_dump(OVERRIDES))
    assert run(local).endswith("exit code 0")
    for part in ("config", "raw_data"):
        shutil.copytree(local / part, folder / part)
    recorded = {
        "simulation": None,
        "data": "simulated",
        "parameters": "config/parameters/default.yaml",
    }
    (folder / CONFIG).write_text(yaml.safe_dump(OVERRIDES | recorded))
    (folder / LOG).write_bytes(b"no log")
    options = (
        TABLE,
        "--workflow-profile",
        str(ROOT / "profiles/slurm"),
        "--group-components",
        "trials=2",
    )
    options += ("--default-resources", "mem_mb=500", "runtime=5")
    running = "squeue --noheader --states=running --format=%i"
    cancel = partial(subprocess.run, f"scancel $({running} | tail -n 1)", shell=True, check=True)
    said = run(folder, *options, then=cancel, once="results/trials/*.parquet")
    assert said.endswith("exit code 1"), said
    said = run(folder, *options)  # of one table alone no verdict is asked
    assert said.endswith("exit code 0"), said
    rows = (folder / TABLE).read_text().splitlines()[1:]
    assert sum("not analysed" not in row for row in rows) == 3
    shutil.copy2(local / LOG, folder / LOG)
    assert run(folder, TABLE).endswith("exit code 0")
    tables = [
        path.relative_to(folder)
        for path in (folder / "results").rglob("*")
        if path.suffix in (".csv", ".zip")
    ]
    assert tables
    assert [
        path for path in tables if (local / path).read_bytes() != (folder / path).read_bytes()
    ] == []
