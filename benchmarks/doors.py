"""Processor time and peak memory of single commands, each in a process of its own.

    python benchmarks/doors.py [--most MB]

Commands on an impedance trial of 42 s: the least of three runs, imports included, and what imports
alone take. Then one trial of 142 s at 1 kHz as the workflow simulates it, imports apart; and a
recording of an hour at 1 kHz with six channels. With `--most`, as CI runs it, only what ingest and
fit of 20 minutes of that recording need: it ends with exit code 1 where that is more.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import yaml

from osl_analysis.jobs.workers import ENVIRONMENT

SETTINGS, TRIAL = Path("config/simulation/default.yaml"), "impedance_K300_B5.0_compensated"
SOURCES = ("--log-source", "dynamometer_nodes", "--sources", str(Path("config/sources").resolve()))
DESIRED = ("--stiffness", "300", "--damping", "5")
LIBRARIES = "click, numpy, polars, pydantic, scipy.signal, yaml"  # which `fit` needs
COMMAND = (sys.executable, "-c", "from osl_analysis.cli import main; main()")
SIMULATE = """import sys, time
from pathlib import Path
from osl_analysis.commands.simulate import simulate_trial
for _ in range(2):
    before = time.process_time()
    simulate_trial(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
print(time.process_time() - before)
"""
SMALL, USUAL, THIRD, HOUR = 6, 20, 173, 520  # cycles at each frequency


def spent(
    folder: Path, *words: str, repeats: int = 3, command: tuple[str, ...] = COMMAND
) -> tuple[float, float]:
    """Least processor time [s], and peak memory [MB], of a command."""
    times = []
    for _ in range(repeats):
        process = subprocess.Popen([*command, *words], cwd=folder, stdout=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"osl-analysis {' '.join(words)} ended with {process.returncode}")
        times.append(used.ru_utime + used.ru_stime)
    return min(times), used.ru_maxrss / 1024


def simulated(folder: Path, cycles: int) -> float:
    """Processor time [s], of the second time, in which a trial with so many cycles at each
    frequency is simulated, as `CYCLES.mcap`, with `CYCLES.yaml` for its fit. This process imports
    no library: a child's peak memory begins with that of its parent."""
    settings = yaml.safe_load(SETTINGS.read_text(encoding="utf-8"))
    settings["protocol"]["cycles"] = cycles
    (folder / "simulation.yaml").write_text(yaml.safe_dump(settings), encoding="utf-8")
    (folder / f"{cycles}.yaml").write_text(f"dynamometer: {{cycles: {cycles}}}\n", encoding="utf-8")
    run = [sys.executable, "-c", SIMULATE, str(folder / "simulation.yaml"), str(folder), TRIAL]
    kept = os.environ | ENVIRONMENT
    took = float(
        subprocess.run(run, env=kept, stdout=subprocess.PIPE, text=True, check=True).stdout
    )
    next(folder.rglob(f"{TRIAL}.mcap")).rename(folder / f"{cycles}.mcap")
    return took


def main() -> None:
    parser = argparse.ArgumentParser(description="Single commands.")
    parser.add_argument(
        "--most", type=float, help="largest memory of 20 minutes [MB], which alone are measured"
    )
    most = parser.parse_args().most
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def ingest(cycles: int, **options: int) -> tuple[float, float]:
            files = ("--output", f"{cycles}.parquet", "--log", f"{cycles}.mcap")
            return spent(folder, "ingest", *SOURCES, *files, **options)

        def fit(cycles: int, **options: int) -> tuple[float, float]:
            files = ("--config", f"{cycles}.yaml", f"{cycles}.parquet")
            return spent(folder, "fit", *DESIRED, *files, **options)

        simulated(folder, SMALL)  # which compiles the simulator
        if most is not None:
            simulated(folder, THIRD)
            needed = {"ingest": ingest(THIRD, repeats=1)[1], "fit": fit(THIRD, repeats=1)[1]}
            print(
                "20 minutes at 1 kHz:",
                ", ".join(f"{what} {memory:.0f} MB" for what, memory in needed.items()),
            )
            raise SystemExit(
                f"at most {most:g} MB are allowed" if max(needed.values()) > most else 0
            )
        simulate = min(simulated(folder, USUAL) for _ in range(3))
        simulated(folder, HOUR)
        ingest(SMALL, repeats=1)
        found = {
            "osl-analysis --help": spent(folder, "--help"),
            "osl-analysis doctor": spent(folder, "doctor"),
            "osl-analysis inspect": spent(folder, "inspect", f"{SMALL}.mcap"),
            "osl-analysis fit": fit(SMALL),
            "  its libraries alone": spent(
                folder, f"import {LIBRARIES}", command=(sys.executable, "-c")
            ),
            "snakemake, imported": spent(
                folder, "import snakemake.cli", command=(sys.executable, "-c")
            ),
            "an hour: ingest": ingest(HOUR, repeats=1),
            "an hour: fit": fit(HOUR, repeats=1),
        }
    for what, (seconds, memory) in found.items():
        print(f"{what:22} {seconds:.2f} s, {memory:.0f} MB")
    print(f"simulate 142 s at 1 kHz, without imports and compilation: {simulate:.2f} s")


if __name__ == "__main__":
    main()
