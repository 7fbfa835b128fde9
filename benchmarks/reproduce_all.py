"""Time of the whole campaign from empty folders, and of one changed recording to its table, beside an earlier release.

Run from the repository: `python benchmarks/reproduce_all.py [--against FOLDER]`. Each tree is copied to a temporary
folder without recordings and results. Its modules are compiled before, as after an installation. Counted are the wall
time and the time of all processors in all processes: this process adopts those whose parents end before them, so that
the system adds up the time of jobs that are forked from another process too. The two trees run one after the other;
nothing else may run meanwhile.

A changed recording is another trial's of the same protocol. From it follow one trial, its fit and `impedance.csv`.
"""

import argparse
import ctypes
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NOT_COPIED = shutil.ignore_patterns(".git", ".snakemake", "results", "__pycache__", "*.mcap", "*.c3d", "default.lock")
ADOPT_ORPHANS = 36
"""PR_SET_CHILD_SUBREAPER of Linux."""
LOGS = Path("raw_data/default/dynamometer")
CHANGED, OTHER = "impedance_K100_B5.0_uncompensated.mcap", "impedance_K100_B7.5_uncompensated.mcap"
STAGE = re.compile(r"^(\w+) +(\d+) jobs +([\d.]+) s$", re.MULTILINE)


@dataclass(frozen=True)
class Spent:
    """Wall and processor time [s] of a command, and what it said."""

    wall: float
    cpu: float
    said: str


def spent(folder: Path, *command: str) -> Spent:
    """A command in a tree, with all that it started."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    environment |= {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / ".numba")}
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    run = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    wall = time.perf_counter() - start
    while True:
        try:
            os.wait()  # an orphan that this process has adopted
        except ChildProcessError:
            break
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if run.returncode:
        raise SystemExit(f"{folder}: {' '.join(command)}\n{run.stderr[-2000:]}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Spent(wall, cpu, run.stdout + run.stderr)


def prepared(tree: Path, folder: Path) -> Path:
    """A copy of a tree without recordings and results, with its modules compiled."""
    shutil.copytree(tree, folder, ignore=NOT_COPIED)
    shutil.rmtree(folder / "raw_data/default", ignore_errors=True)
    spent(folder, sys.executable, "-m", "compileall", "-q", "osl_analysis")
    trial = ("--trial", "impedance_K300_B5.0_compensated")
    warm = "from osl_analysis.cli import main; main()"
    spent(folder, sys.executable, "-c", warm, "simulate", *trial, str(folder / ".warm"))  # numba compiles here
    return folder


def one_log(folder: Path) -> Spent:
    """From a changed recording to its table, in a campaign of recordings that are taken as they are."""
    (folder / "measured.yaml").write_text("simulation: null\n", encoding="utf-8")
    table = ("snakemake", "results/tables/impedance.csv", "--configfile", "measured.yaml", "--quiet", "all")
    spent(folder, *table)
    shutil.copyfile(folder / LOGS / OTHER, folder / LOGS / CHANGED)
    return spent(folder, *table)


def report(name: str, whole: Spent, changed: Spent) -> None:
    """What was measured of one tree."""
    print(f"{name}: reproduce-all {whole.wall:.1f} s, {whole.cpu:.1f} core-seconds; ", end="")
    print(f"one changed recording to its table {changed.wall:.1f} s, {changed.cpu:.1f} core-seconds")
    for stage, jobs, seconds in STAGE.findall(whole.said):
        print(f"  {stage:<16}{jobs:>5} jobs{seconds:>8} s of wall time in all")


def main() -> None:
    parser = argparse.ArgumentParser(description="Time of the whole campaign from empty folders.")
    parser.add_argument("--against", type=Path, help="Tree of an earlier release.")
    earlier = parser.parse_args().against
    ctypes.CDLL(None).prctl(ADOPT_ORPHANS, 1, 0, 0, 0)
    trees = {"this tree": ROOT} | ({"earlier": earlier.resolve()} if earlier else {})
    found = {}
    with tempfile.TemporaryDirectory() as name:
        for place, (what, tree) in enumerate(trees.items()):
            folder = prepared(tree, Path(name) / f"tree{place}")
            whole = spent(folder, "snakemake", "reproduce-all", "--quiet", "all")
            found[what] = whole, one_log(folder)
            report(what, *found[what])
            shutil.rmtree(folder)
    if earlier:
        now, then = found["this tree"], found["earlier"]
        for what, new, old in zip(("reproduce-all", "one changed recording"), now, then, strict=True):
            print(f"{what}: {old.wall / new.wall:.2f} times as fast, {old.cpu / new.cpu:.2f} times fewer core-seconds")


if __name__ == "__main__":
    main()
