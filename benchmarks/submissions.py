"""What SLURM costs for each trial of a large campaign, beside the same campaign on one node.

    export PYTHONPATH=build/cluster
    tests/slurm/one_node.sh python benchmarks/submissions.py [N] [--batch N]

As root, on Debian, after `make build/cluster`: `one_node.sh` starts a SLURM of two processors for
this command alone. A campaign of N recordings of 8 s is fitted twice from empty folders: by two
cores of this node, and by `profiles/slurm`, whose groups submit so many trials at once as
`--batch` says. Wall time and processor time [s], for all and for each trial. Processor time is that
of all processes of the node, so that those of SLURM itself count. Each job of a submission starts a
Snakemake of its own: 1,000 trials take an hour or two.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from doors import CYCLES_8_S, ROOT, new_campaign

TABLE = "results/tables/impedance.csv"
PROFILE = ROOT / "profiles/slurm"
SETTLES_S = 10  # until SLURM has put away what ended
FIRST_TIME = (
    11  # of user, system, and of both for ended children, in /proc/PID/stat behind its name
)
TICKS = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Cost:
    """What a run took."""

    wall_s: float
    cpu_s: float


def processor_time() -> float:
    """What all processes of the node and their ended children have used [s]."""
    ticks = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text(encoding="utf-8").rpartition(")")[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue  # it has ended, and its parent has its time
        ticks += sum(map(int, fields[FIRST_TIME : FIRST_TIME + 4]))
    return ticks / TICKS


def cost_of(campaign: Path, *options: str) -> Cost:
    """Fit the trials of a campaign with these options of Snakemake.

    Raises
    ------
    SystemExit
        Snakemake did not end well.
    """
    command = [sys.executable, "-m", "snakemake", TABLE, "--snakefile", str(ROOT / "Snakefile")]
    environment = dict(os.environ)
    environment["PYTHONPATH"] = f"{ROOT}{os.pathsep}{environment.get('PYTHONPATH', '')}"
    before = processor_time()
    begin = time.perf_counter()
    ended = subprocess.run(
        [*command, "--configfile", "config.yaml", *options],
        cwd=campaign, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    wall_s = time.perf_counter() - begin
    if ended.returncode:
        raise SystemExit(f"{ended.stdout[-3000:]}\n{ended.stderr[-3000:]}")
    time.sleep(SETTLES_S)
    return Cost(wall_s, processor_time() - before)


def show(what: str, cost: Cost, number: int) -> None:
    """Print a row of the table."""
    each = f"{cost.wall_s / number:11.2f}{cost.cpu_s / number:9.2f}"
    print(f"{what:28}{cost.wall_s:9.1f}{cost.cpu_s:9.1f}{each}", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="SLURM beside one node.")
    parser.add_argument("number", nargs="?", type=int, default=1000, metavar="N")
    parser.add_argument("--batch", type=int, default=100, metavar="N", help="of a submission")
    asked = parser.parse_args()
    if not shutil.which("sbatch"):
        raise SystemExit("no SLURM here: begin with tests/slurm/one_node.sh")
    batches = ("--group-components", f"trials={asked.batch}")
    # without `--cores` a submission asks for as many processors and as much memory as all of its
    # trials take at once
    resources = ("--cores", "2", "--default-resources", "mem_mb=1500", "runtime=1")
    with tempfile.TemporaryDirectory(dir=ROOT / "build") as name:
        campaign = Path(name) / "campaign"
        new_campaign(campaign, CYCLES_8_S, asked.number)
        print(f"{asked.number} trials of 8 s, {asked.batch} in a submission")
        print(f"{'':28}{'wall':>9}{'CPU':>9}{'per trial:':>11}{'CPU':>9}")
        local = cost_of(campaign, "--cores", "2")
        show("two cores of one node", local, asked.number)
        shutil.rmtree(campaign / "results")
        submitted = cost_of(campaign, "--workflow-profile", str(PROFILE), *batches, *resources)
        show("SLURM of two processors", submitted, asked.number)
        more = Cost(submitted.wall_s - local.wall_s, submitted.cpu_s - local.cpu_s)
        show("overhead", more, asked.number)


if __name__ == "__main__":
    main()
