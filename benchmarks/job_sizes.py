"""What one job of each rule takes: time of a core and memory, from which profiles/slurm states its resources.

    python benchmarks/job_sizes.py [CAMPAIGN ...]

runs again, from their logs, the largest job of every command in the folders of finished campaigns (this folder if none
is named), each in a process of its own, and writes their results elsewhere. It prints the size of the recordings [MB],
seconds of a core, and how much the peak of memory lies above that of a process that has only imported everything [MB].
Two campaigns with short and long recordings give what each MB adds.
"""

import importlib
import multiprocessing
import os
import resource
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from osl_analysis.fork_server import PRELOADED
from osl_analysis.job import Job, call
from osl_analysis.workflow import flat

MB_PER_KB = 1024 / 1e6


def jobs(campaign: Path) -> dict[str, tuple[float, dict[str, Any]]]:
    """The largest job of every command by the size of what it reads [MB], with its log."""
    found: dict[str, tuple[float, dict[str, Any]]] = {}
    for path in sorted((campaign / "results/logs").rglob("*.log")):
        log = yaml.load(path.read_text(encoding="utf-8"), Loader=yaml.CSafeLoader)
        if log.get("outcome") == "done" and log["job"] != "simulate.simulate_trial":
            size = sum((campaign / file).stat().st_size for file in read(log)) / 1e6
            if size >= found.get(log["job"], (-1.0, {}))[0]:
                found[log["job"]] = (size, log)
    return found


def read(log: dict[str, Any]) -> Iterator[str]:
    """The files that a job reads: its inputs, and its recordings."""
    settings = log.get("settings", {})
    row, folder = settings.get("row", {}), settings.get("raw_folder", "")
    yield from flat(log.get("input", {}))
    yield from (f"{folder}/{row[column]}" for column in ("log", "mocap") if row.get(column))


def elsewhere(files: Any, folder: str) -> Any:
    """The same names of outputs, each in another folder."""
    if isinstance(files, dict):
        return {name: elsewhere(inner, f"{folder}/{name}") for name, inner in files.items()}
    if isinstance(files, list):
        return [elsewhere(inner, folder) for inner in files]
    return f"{folder}/{Path(files).name}"


def measured(log: dict[str, Any], campaign: Path) -> tuple[float, float]:
    """Seconds of a core and memory [MB] of a job, in this process."""
    os.chdir(campaign)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = os.times()
    with tempfile.TemporaryDirectory() as folder:
        request = {"input": log.get("input", {}), "settings": log.get("settings", {})}
        request["output"] = elsewhere(log.get("output", {}), folder)
        call(Job(log["job"], request, (), (), "simulated"))
    used, end = resource.getrusage(resource.RUSAGE_SELF), os.times()
    return end.user + end.system - start.user - start.system, (used.ru_maxrss - peak) * MB_PER_KB


def main() -> None:
    """Measure and print."""
    for module in PRELOADED:
        importlib.import_module(module)
    campaigns = [Path(name).resolve() for name in sys.argv[1:]] or [Path.cwd()]
    taken = sorted((name, c, *found) for c in campaigns for name, found in jobs(c).items())
    print(f"{'job':<36}{'reads MB':>10}{'core s':>10}{'memory MB':>11}")
    for name, campaign, size, log in taken:
        with multiprocessing.get_context("fork").Pool(1) as pool:
            seconds, memory = pool.apply(measured, (log, campaign))
        print(f"{name:<36}{size:10.1f}{seconds:10.2f}{memory:11.0f}")


if __name__ == "__main__":
    main()
