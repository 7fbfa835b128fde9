"""Run the benchmarks of speed and size, and write what they print as the page docs/performance.md.

Run from the repository, with nothing else running: `python benchmarks/performance.py [--against FOLDER]`, with the
folder of an earlier release. It takes some twenty minutes on two cores. Each part is a benchmark of its own, whose head
explains what is measured.
"""

import argparse
import os
import platform
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy
import polars
import snakemake

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs/performance.md"
KEPT = re.compile(r"^`benchmarks/(\w+\.py)`.*?```\n(.*?)\n```", re.MULTILINE | re.DOTALL)
"""A part of the page: its script, and what that printed."""


@dataclass(frozen=True)
class Part:
    """A benchmark of the page."""

    title: str
    script: str
    said: str
    """What a reader should know before the numbers: what is compared with what, and the limit."""
    arguments: tuple[str, ...] = ()
    against: str = ""
    """How it is given the earlier release: an option, or `FOLDER` for an argument; empty if it does not use it."""


PARTS = (
    Part(
        "The whole campaign",
        "reproduce_all.py",
        "`reproduce-all` of the default campaign from empty folders, and one changed recording to its "
        "table. The alternative is the "
        "earlier release, run in the same minutes. Core-seconds are those of all processes.",
        against="--against",
    ),
    Part(
        "One impedance trial",
        "impedance_trial.py",
        "One fit of 142 s at 1 kHz: four fits with intervals, 15 phasors of both signals, "
        "diagnostics. The alternative is "
        "a script of a laboratory with pandas and `curve_fit`: the same fits and phasors, without "
        "intervals and checks.",
    ),
    Part(
        "Planning",
        "planning.py",
        "`snakemake -n` of a campaign of N trials. The alternative is a bare Snakefile with as many jobs"
        " of the same shape, which is the "
        "limit too: what Snakemake itself takes.",
        ("30", "100", "300", "1000", "3000"),
    ),
    Part(
        "Through SLURM",
        "cluster.py",
        "The campaign of `make test-slurm` beside a local run on the same cores. The limit is 1.5 times its time, "
        "without SLURM's own latency. What SLURM adds is one more start of Snakemake, and the wait for its answer.",
    ),
    Part(
        "Simulator",
        "simulator.py",
        "Simulated time over the time of one core. Alternatives: scipy's `solve_ivp`, and the earlier release.",
        against="FOLDER",
    ),
    Part("Selection of gains", "gain_selection.py", "Pairs of gains by Eq. 14 per second, beside scipy's minimiser."),
    Part(
        "Memory",
        "memory.py",
        "Largest memory by the length of a recording, in a process for each. The limit is 150 bytes per sample, and "
        "2 GiB for four hours at 1 kHz.",
    ),
    Part(
        "Reading MCAP",
        "mcap_reading.py",
        "A trial of 140 s at 1 kHz in three topics. The alternatives are the `mcap` packages, and the earlier release. "
        "The limit is what every checking reader needs: decompression, CRC, and two copies.",
        against="--against",
    ),
)


def printed(part: Part, against: Path | None) -> str:
    """What a benchmark prints."""
    more = list(part.arguments)
    if part.against and against is not None:
        more += [str(against)] if part.against == "FOLDER" else [part.against, str(against)]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, f"benchmarks/{part.script}", *more],
        cwd=ROOT,
        env=environment,
        text=True,
        capture_output=True,
        check=False,
    )
    if done.returncode:
        sys.exit(f"{part.script}: exit code {done.returncode}\n{done.stdout}\n{done.stderr}")
    said = done.stdout if against is None else done.stdout.replace(str(against), "the earlier release")
    return "\n".join(line.rstrip() for line in said.strip("\n").splitlines())


def machine() -> str:
    """What the numbers were measured on."""
    return (
        f"{os.cpu_count()} cores ({platform.machine()}), Python {platform.python_version()}, numpy "
        f"{numpy.__version__}, "
        f"polars {polars.__version__}, Snakemake {snakemake.__version__}"
    )


def main() -> None:
    """Run all parts, or those that are named, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", type=Path, help="Folder of an earlier release, for the comparisons with it.")
    parser.add_argument("--only", nargs="*", help="Scripts to run; the others keep what the page has of them.")
    asked = parser.parse_args()
    before = dict(KEPT.findall(PAGE.read_text(encoding="utf-8"))) if PAGE.is_file() else {}
    lines = [
        "# Performance",
        "",
        "Printed by `python benchmarks/performance.py --against EARLIER_RELEASE`, where the earlier "
        "release is\ncommit 8f3d452, on",
        f"{machine()}. A machine swings by a factor of two between hours: trust the ratios within a part, which was",
        "measured in one run. Times are of the processor where nothing else is said.",
    ]
    for part in PARTS:
        is_kept = asked.only is not None and part.script not in asked.only
        text = before.get(part.script, "not printed yet") if is_kept else printed(part, asked.against)
        print(f"{part.title}\n{text}\n", flush=True)
        lines += ["", f"## {part.title}", "", f"`benchmarks/{part.script}`. {part.said}", "", "```", text, "```"]
    PAGE.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
