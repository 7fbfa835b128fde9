# SPDX-License-Identifier: Apache-2.0
"""What a run costs without `--force-use-threads`: `python benchmarks/without_threads.py`.

A campaign of one trial of a spring is run twice, as the profiles state it and with
`--workflow-profile none`. Printed are the jobs, the core-seconds of all processes, and whether the
results differ, logs apart.
"""

import ctypes
import filecmp
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import polars as pl

ROOT = Path(__file__).parents[1]
PR_SET_CHILD_SUBREAPER = 36  # of prctl: orphans become ours, so that their core-seconds count
SOURCE = """format: csv
clock: master
time: {column: time, unit: s}
channels:
  theta: {column: angle, unit: deg}
  torque: {column: torque, unit: N*m}
"""
CONFIG = """campaign: one
raw_data: .
sheet: trials.csv
sources: .
simulation: null
parameters: null
impedance_trajectory: null
"""
STIFFNESS = 100.0  # N*m/rad


def write_campaign(folder: Path) -> None:
    """A spring that is moved to and fro for a minute."""
    folder.mkdir()
    time = np.arange(0, 60, 0.004)
    degrees = 15 * np.sin(2 * np.pi * 0.1 * time)
    noise = 0.02 * np.random.default_rng(6).standard_normal(time.size)
    table = {"time": time, "angle": degrees, "torque": STIFFNESS * np.radians(degrees) + noise}
    pl.DataFrame(table).write_csv(folder / "spring.csv", float_precision=5)
    (folder / "trials.csv").write_text(
        "trial,experiment,log,log_source\nspring,torque_angle,spring.csv,spring\n"
    )
    (folder / "spring.yaml").write_text(SOURCE)
    (folder / "config.yaml").write_text(CONFIG)


def core_seconds_of_run(folder: Path, *options: str) -> tuple[float, int]:
    """Core-seconds of a run with all its processes, and its jobs."""
    command = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile")]
    command += ["--configfile", "config.yaml", "--cores", "2", *options]
    before = used_s()
    with (folder / "said.txt").open("w") as said:
        run = subprocess.Popen(command, cwd=folder, stdout=said, stderr=said)
        while True:
            try:
                os.wait()
            except ChildProcessError:
                break
    run.returncode = 0  # `os.wait` has it
    verdict = folder / "results/verdict.txt"
    if not verdict.is_file():
        raise SystemExit((folder / "said.txt").read_text())
    logs = [*(folder / "results/logs").rglob("*.log")]
    return used_s() - before, len(logs)


def used_s() -> float:
    """Core-seconds of all ended children."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def differing(one: Path, other: Path) -> list[str]:
    """Results that differ between two folders, logs apart."""
    files = [path.relative_to(one) for path in one.rglob("*") if path.is_file()]
    results = [file for file in files if file.parts[0] != "logs"]
    return [str(f) for f in results if not filecmp.cmp(one / f, other / f, shallow=False)]


def main() -> None:
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    with tempfile.TemporaryDirectory() as temporary:
        threads, processes = Path(temporary, "threads"), Path(temporary, "processes")
        for folder in (threads, processes):
            write_campaign(folder)
        in_threads_s, jobs = core_seconds_of_run(threads)
        in_processes_s, _ = core_seconds_of_run(processes, "--workflow-profile", "none")
        others = differing(threads / "results", processes / "results")
    more_s = (in_processes_s - in_threads_s) / jobs
    print(f"{jobs} jobs: {in_threads_s:.1f} core-s in threads, {in_processes_s:.1f} without")
    print(f"{more_s:.1f} core-s more a job; results that differ: {', '.join(others) or 'none'}")


if __name__ == "__main__":
    main()
