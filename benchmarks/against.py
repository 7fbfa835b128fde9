# SPDX-License-Identifier: Apache-2.0
"""This checkout against another revision, alternately: ratios of wall time, core-seconds and peak
memory.

`python benchmarks/against.py REV [--rounds N]` runs the default campaign of each in a copy of its
own: from empty folders, with nothing left to do, and after one recording has changed. `--short`
runs a campaign of 17 trials from empty folders alone, and `--most RATIO` ends with exit code 1
where this checkout takes more core-seconds there than that. A revision runs in this environment
where that has what the revision's lock asks for, else in one that is made for it; of one that a
shallow clone has not, it says so. Core-seconds are of all processes, peak memory is of the largest
one. Last stand the kinds of jobs that take longest, and what Snakemake takes for as many empty
jobs, which is the limit. Nothing else may run meanwhile.
"""

import argparse
import ctypes
import json
import os
import platform
import re
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

import yaml

from osl_analysis.jobs.progress import read_log

ROOT = Path(__file__).resolve().parents[1]
ADOPT_ORPHANS = 36
"""PR_SET_CHILD_SUBREAPER of Linux: jobs are forked from a process that ends after its parent."""
WARM = "impedance_K300_B5.0_compensated"
LOG = Path(f"dynamometer/{WARM}.mcap")
SIMULATION = "config/simulation/default.yaml"
SHORT = {
    "K_d": [300],
    "B_d": [5.0],
    "belt": 1,
    "transmission": 1,
    "actuator": 1,
    "plate": 3,
    "walking": 8,
}
COMMANDS = ("from empty folders", "nothing to do", "one changed recording")
NOT_COPIED = shutil.ignore_patterns(
    ".git", ".venv*", ".snakemake", "results", "build", "__pycache__", "*.mcap", "*.c3d"
)
EMPTY = """
rule all:
    input: expand("{{k}}", k=range({jobs}))
rule one:
    output: "{{k}}"
    shell: ": > {{output}}"
"""
SAID = ((1, 1, 0), ("s", "core-s", "MB"))
Spent = tuple[float, float, float]  # wall time [s], core-seconds, peak memory of one process [MB]


def checked_out(revision: str, folder: Path) -> str:
    """Copy a revision to a folder; its full name."""
    name = subprocess.check_output(
        ["git", "rev-parse", f"{revision}^{{commit}}"], cwd=ROOT, text=True
    ).strip()
    folder.mkdir()
    archive = subprocess.run(
        ["git", "archive", name], cwd=ROOT, stdout=subprocess.PIPE, check=True
    ).stdout
    subprocess.run(["tar", "-x", "-C", folder], input=archive, check=True)
    return name


def describe(tree: Path) -> str:
    """Let a tree be found as the distribution that it is, which other revisions call by another
    name; its name and version."""
    project = tomllib.loads((tree / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    name, version = project["name"], project["version"]
    described = tree / f"{name.replace('-', '_')}-{version}.dist-info"
    described.mkdir()
    (described / "METADATA").write_text(f"Name: {name}\nVersion: {version}\n", encoding="utf-8")
    return f"{name} {version}"


def pinned(tree: Path) -> set[str]:
    """What the lock of a tree asks for, as name==version."""
    return set(
        re.findall(r"^([\w.-]+==[\w.]+)", (tree / "requirements.lock").read_text(), re.MULTILINE)
    )


def interpreter(tree: Path) -> str:
    """The Python that runs a tree: this one where it has all that the tree's lock asks for."""
    if pinned(tree) <= pinned(ROOT):
        return sys.executable
    subprocess.run(
        ["make", "setup", f"PYTHON={sys.executable}"],
        cwd=tree,
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return str(tree / ".venv/bin/python")


def shorten(tree: Path) -> None:
    """Let the default campaign of a tree have a few short trials."""
    file = tree / SIMULATION
    settings = yaml.safe_load(file.read_text(encoding="utf-8"))
    settings["experiments"] |= {
        key: SHORT[key] for key in SHORT.keys() & settings["experiments"].keys()
    }
    file.write_text(yaml.safe_dump(settings), encoding="utf-8")


def simulate_anew(python: str, tree: Path) -> None:
    """Simulate the trial that is to change, with another seed."""
    file = tree / SIMULATION
    settings = file.read_text(encoding="utf-8")
    file.write_text(re.sub(r"(?m)^seed: ", "seed: 1", settings), encoding="utf-8")
    simulate = [
        python,
        "-c",
        "from osl_analysis.cli import main; main()",
        "simulate",
        "--trial",
        WARM,
        ".again",
    ]
    subprocess.run(simulate, cwd=tree, env=environment(tree), check=True, stdout=subprocess.DEVNULL)
    file.write_text(settings, encoding="utf-8")


def environment(tree: Path) -> dict[str, str]:
    """Variables with which the package of a tree is imported, and what numba compiles of it
    kept."""
    kept = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    return kept | {"PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(tree / ".numba")}


def spent(python: str, tree: Path, *arguments: str) -> Spent:
    """What Snakemake takes in a tree, in a process that adopts all that it starts and adds up what
    they took."""
    command = [sys.executable, __file__, "--measure", python, *arguments]
    measured = subprocess.run(command, cwd=tree, capture_output=True, text=True, check=False)
    if measured.returncode:
        raise SystemExit(f"{tree}: {measured.stdout[-3000:]}{measured.stderr[-3000:]}")
    wall, cores, memory = json.loads(measured.stdout.splitlines()[-1])
    return wall, cores, memory


def measure(python: str, arguments: list[str]) -> None:
    """Print what Snakemake takes in this folder."""
    ctypes.CDLL(None).prctl(ADOPT_ORPHANS, 1, 0, 0, 0)
    command, start = [python, "-m", "snakemake", *arguments], time.perf_counter()
    subprocess.run(command, env=environment(Path.cwd()), check=True, stdout=sys.stderr)
    wall = time.perf_counter() - start
    while True:
        try:
            os.wait()
        except ChildProcessError:
            break
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(json.dumps([wall, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024]))


def measured(python: str, tree: Path, short: bool) -> list[Spent]:
    """What each of `COMMANDS`, or the first one alone, takes in a tree without recordings and
    results. A recording changes by another one of the same trial in its place; of it follow a
    trial, its fit and a table."""
    for made in ("raw_data/default", "results", ".snakemake"):
        shutil.rmtree(tree / made, ignore_errors=True)
    found = [spent(python, tree, "reproduce-all")]
    if short:
        return found
    found.append(spent(python, tree, "reproduce-all"))
    (tree / "measured.yaml").write_text("simulation: null\n", encoding="utf-8")
    table = ("results/tables/impedance.csv", "--configfile", "measured.yaml")
    spent(python, tree, *table)
    shutil.copyfile(next((tree / ".again").rglob(LOG.name)), tree / "raw_data/default" / LOG)
    return [*found, spent(python, tree, *table)]


def longest_jobs(tree: Path, folder: Path) -> list[str]:
    """The kinds of jobs of a tree that took longest, with their number and mean wall time; and what
    Snakemake takes, in an empty folder, for as many jobs that do nothing."""
    logs = [log for path in (tree / "results/logs").rglob("*.log") if (log := read_log(path))]
    kinds: dict[str, list[float]] = {}
    for log in logs:
        kinds.setdefault(log["job"], []).append(log["seconds"])
    longest = sorted(kinds.items(), key=lambda one: -sum(one[1]))[:8]
    said = [f"{kind:28} {len(each):4} x {statistics.mean(each):.3f} s" for kind, each in longest]
    folder.mkdir()
    (folder / "Snakefile").write_text(EMPTY.format(jobs=len(logs)), encoding="utf-8")
    wall, cores, _ = spent(sys.executable, folder, "--cores", "all", "--scheduler", "greedy")
    return [*said, f"{len(logs)} empty jobs of Snakemake: {wall:.1f} s; {cores:.1f} core-s"]


def main() -> None:
    parser = argparse.ArgumentParser(description="This checkout against another revision.")
    parser.add_argument("revision")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--short", action="store_true", help="a campaign of seventeen trials")
    parser.add_argument(
        "--most", type=float, default=float("inf"), help="largest ratio of core-seconds"
    )
    if sys.argv[1:2] == ["--measure"]:
        measure(sys.argv[2], sys.argv[3:])
        return
    asked, taken = parser.parse_args(), dict[str, list[list[Spent]]]()
    known = ["git", "cat-file", "-e", f"{asked.revision}^{{commit}}"]
    if subprocess.run(known, cwd=ROOT, stderr=subprocess.DEVNULL, check=False).returncode:
        print(f"not measured: this clone has no revision {asked.revision}")
        return
    with tempfile.TemporaryDirectory() as name:
        then, now = Path(name, "then"), Path(name, "now")
        revision = checked_out(asked.revision, then)
        shutil.copytree(ROOT, now, ignore=NOT_COPIED)
        releases = [describe(tree) for tree in (now, then)]
        pythons = {then: interpreter(then), now: sys.executable}
        for tree, python in pythons.items():
            settings = (tree / SIMULATION).read_text(encoding="utf-8")
            shorten(tree)
            subprocess.run([python, "-m", "compileall", "-q", "osl_analysis"], cwd=tree, check=True)
            spent(python, tree, "reproduce-all")  # whatever is compiled on its first call, is now
            if not asked.short:
                (tree / SIMULATION).write_text(settings, encoding="utf-8")
                simulate_anew(python, tree)
        for _ in range(asked.rounds):
            for tree, python in pythons.items():
                taken.setdefault(tree.name, []).append(measured(python, tree, asked.short))
        lines_on_jobs = longest_jobs(now, Path(name, "empty"))
    print(
        f"this checkout, after {releases[0]}, against commit {revision[:8]}, {releases[1]};"
        f" {asked.rounds} rounds; {os.cpu_count()} cores ({platform.machine()}),"
    )
    print(
        f"Python {platform.python_version()}; medians of wall time, core-seconds, memory of the"
        " largest process"
    )
    worst = 0.0
    for k, what in enumerate(COMMANDS[:1] if asked.short else COMMANDS):
        old, new = (
            [statistics.median(column) for column in zip(*(r[k] for r in taken[t]), strict=True)]
            for t in taken
        )
        said = [
            f"{x:.{d}f} {unit} / {y:.{d}f} = {x / y:.2f}"
            for x, y, d, unit in zip(new, old, *SAID, strict=True)
        ]
        print(f"{what}: {'; '.join(said)}")
        worst = worst or new[1] / old[1]
    print(*lines_on_jobs, sep="\n")
    if worst > asked.most:
        raise SystemExit(
            f"{worst:.2f} times the core-seconds of {asked.revision}; at most {asked.most:g} are"
            " allowed"
        )


if __name__ == "__main__":
    main()
