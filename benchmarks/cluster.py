"""A campaign of 30 trials through SLURM beside a local run, and where the time between them goes.

Run from the repository, on Debian as root: `python benchmarks/cluster.py`. It starts a SLURM of one node and two cores
that exists for it alone (tests/slurm/one_node.sh). Recordings are simulated before. Both runs begin without results, on
the same two cores, one after the other. Of each: wall time [s] until the first job begins, from there to the end of the
last job, and to the end of the run, by the logs of the jobs. SLURM's own latency is the median of three small jobs,
from `sbatch` to their first command; a run waits for it once for each submission that follows another.
"""

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests/slurm"))
import thirty_trials  # noqa: E402

LIMIT = 1.5
"""Of the time through SLURM, without its latency, over that of a local run."""


def run(folder: Path, *options: str) -> tuple[float, float, float, int]:
    """Wall times [s] of the three parts of a run without results, and the number of its submissions."""
    shutil.rmtree(folder / "results", ignore_errors=True)
    shutil.rmtree(folder / ".snakemake", ignore_errors=True)
    snakefile = str(ROOT / "Snakefile")
    command = [sys.executable, "-m", "snakemake", "--snakefile", snakefile, "--configfile", thirty_trials.CONFIG]
    begun = time.time()
    done = subprocess.run([*command, *options], cwd=folder, capture_output=True, text=True)
    ended = time.time()
    if done.returncode:
        sys.exit(done.stdout + done.stderr)
    logs = list((folder / "results/logs").rglob("*.log"))
    ends = {log: log.stat().st_mtime for log in logs}
    first = min(end - yaml.safe_load(log.read_text())["seconds"] for log, end in ends.items())
    last = max(ends.values())
    return first - begun, last - first, ended - last, done.stderr.count("has been submitted with SLURM jobid")


def latency(folder: Path) -> float:
    """From `sbatch` to the first command of a job [s]."""
    output, begun = folder / "latency.txt", time.time()
    subprocess.run(
        ["sbatch", "--wait", "--output", "/dev/null", "--wrap", f"date +%s.%N > {output}"],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return float(output.read_text()) - begun


def main() -> None:
    """Print the table."""
    if not shutil.which("sbatch"):
        os.execv(ROOT / "tests/slurm/one_node.sh", ["one_node.sh", sys.executable, __file__])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        thirty_trials.write(folder)
        run(folder)  # it simulates
        thirty_trials.measured(folder)
        slurm = statistics.median(latency(folder) for _ in range(3))
        local, cluster = run(folder), run(folder, "--workflow-profile", str(ROOT / "profiles/slurm"))
    print(f"30 trials on two cores; {cluster[3]} submission(s), SLURM's latency {slurm:.1f} s each")
    print(f"{'wall time [s]':30}{'local':>8}{'SLURM':>8}")
    for part, here, there in zip(
        ("until the first job begins", "first to last job", "until the run ends"), local, cluster, strict=False
    ):
        print(f"{part:30}{here:8.1f}{there:8.1f}")
    here, there = sum(local[:3]), sum(cluster[:3])
    print(f"{'total':30}{here:8.1f}{there:8.1f}")
    ratio = (there - slurm * cluster[3]) / here
    print(f"ratio without SLURM's latency: {ratio:.2f} (limit {LIMIT}), with it: {there / here:.2f}")


if __name__ == "__main__":
    main()
