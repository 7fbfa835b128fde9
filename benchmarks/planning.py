"""Time to plan large campaigns, beside a bare Snakefile of as many jobs, and the files that a trial
leaves.

Run from the repository: `python benchmarks/planning.py`, or with other numbers of trials, as
`python benchmarks/planning.py 100 1000`. A campaign of N measured impedance trials, whose
recordings are not looked into, is planned by `snakemake --dry-run --quiet all reproduce-all` in a
process of its own. The bare Snakefile has a chain of three jobs for each trial, as the campaign has
(ingest, fit, comparison), and one target that needs the ends of all chains. CPU and wall time [s],
their ratio, and the exponents p of the times, time ~ N^p, from one N to the next, of the campaign
and of the bare Snakefile. Campaigns of N crossings have exponents too. Then two campaigns, and two
bare Snakefiles, of 6 and 60 trials, whose recordings are cut off at different ends, are run and
planned again: with nothing to do, and after a change of one log. The difference of the numbers of
their files below `results/` gives files per trial.
"""

import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import yaml

from osl_analysis.commands.simulate import simulate_trial

ROOT = Path(__file__).resolve().parents[1]
NUMBERS = (30, 117, 1000, 4000)
PER_SUBJECT = 20
"""Crossings of one subject, with one static trial."""
RUN = (6, 60)
"""Numbers of trials of the campaigns that are run."""
SETTINGS, TRIAL = ROOT / "tests/tiny_simulation.yaml", "impedance_K300_B5.0_compensated"
RECORDED: dict[str, dict[str, Any]] = {
    "dynamometer": {
        "amplitudes_deg": [2, 4],
        "frequencies_hz": [2, 5],
        "cycles": 3,
        "settle_cycles": 1,
    },
    "figures": {"time_series": None, "frequency_response": None},
}
"""What the configuration says of the recording."""
BARE = """
TRIALS = [f"impedance_{number:05d}" for number in range(%d)]

rule all:
    default_target: True
    input: [f"compared/{trial}.csv" for trial in TRIALS]

rule ingest:
    output: trial="trials/{trial}.parquet", quality="quality/{trial}.csv"
    log: "logs/ingest/{trial}.log"
    shell: "touch {output}"

rule fit:
    input: "trials/{trial}.parquet"
    output: "fits/{trial}.csv"
    log: "logs/fit/{trial}.log"
    shell: "touch {output}"

rule compare:
    input: "trials/{trial}.parquet", "fits/{trial}.csv"
    output: "compared/{trial}.csv"
    log: "logs/compare/{trial}.log"
    shell: "touch {output}"
"""


def write_campaign(folder: Path, number: int, recording: bytes) -> list[str]:
    """Write sheet, configuration and recordings of a campaign; the arguments of Snakemake for it.
    No recording is a copy of another: each has a byte less."""
    raw = folder / "raw_data/dynamometer"
    raw.mkdir(parents=True)
    lines = ["trial,experiment,controller,K_d,B_d,log,log_source"]
    for trial in range(number):
        log = raw / f"impedance_{trial:05d}.mcap"
        log.write_bytes(recording[: len(recording) - trial])
        lines.append(f"{log.stem},impedance,compensated,300,5,dynamometer/{log.name},dynamometer")
    return write_sheet(folder, lines, RECORDED)


def write_sheet(folder: Path, lines: list[str], settings: dict[str, Any]) -> list[str]:
    """Write the sheet of a campaign, and a configuration with some settings; the arguments of
    Snakemake for it."""
    sheet = folder / "raw_data/trials.csv"
    sheet.write_text("\n".join(lines) + "\n", encoding="utf-8")
    own = {"simulation": None, "sheet": "raw_data/trials.csv", "raw_data": "raw_data", **settings}
    config = folder / "own.yaml"
    config.write_text(yaml.safe_dump(own), encoding="utf-8")
    snakefile = str(ROOT / "Snakefile")
    arguments = ["--snakefile", snakefile, "--configfile", str(config), "--cores", "2"]
    return [*arguments, "reproduce-all"]


def write_crossings(folder: Path, number: int) -> list[str]:
    """Write sheet and configuration of crossings, 20 of each subject with a static trial; their
    recordings need not be there. The arguments of Snakemake for it."""
    (folder / "raw_data").mkdir(parents=True)
    lines = ["trial,experiment,perturbed,log,log_source,mocap,mocap_source,subject"]
    lines.append("plate_1,plate,,plate_1.mcap,leg,plate_1.c3d,vicon,0")
    for trial in range(number):
        if trial % PER_SUBJECT == 0:
            name = f"static_{trial // PER_SUBJECT}"
            lines.append(f"{name},static,,,,{name}.c3d,vicon,{trial // PER_SUBJECT}")
        name = f"walking_{trial:05d}"
        perturbed = "true" if trial % 3 else "false"
        lines.append(
            f"{name},walking,{perturbed},{name}.mcap,leg,{name}.c3d,vicon,{trial // PER_SUBJECT}"
        )
    return write_sheet(folder, lines, {"figures": RECORDED["figures"]})


def write_bare(folder: Path, number: int) -> list[str]:
    """Write the bare Snakefile for a number of trials; the arguments of Snakemake for it."""
    folder.mkdir(parents=True)
    (folder / "Snakefile").write_text(BARE % number, encoding="utf-8")
    return ["--cores", "2", "all"]


def snakemake(arguments: list[str], folder: Path, *options: str) -> tuple[float, float]:
    """CPU and wall time [s] of a run of Snakemake, with its children."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begin = time.perf_counter()
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "snakemake", "--quiet", "all", *options, *arguments]
    ended = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    wall = time.perf_counter() - begin
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if ended.returncode:
        sys.exit(f"{' '.join(command)}\n{ended.stdout}{ended.stderr}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall


def plan(numbers: list[int], folder: Path) -> None:
    """Plan campaigns and bare Snakefiles of these numbers of trials, and print their times."""
    print(f"{'':>6}{'campaign':>18}{'bare Snakefile':>18}{'ratio':>14}{'exponents':>16}")
    print(
        f"{'N':>6}"
        + f"{'CPU':>9}{'wall':>9}" * 2
        + f"{'CPU':>7}{'wall':>7}{'campaign':>10}{'bare':>6}"
    )
    before: tuple[int, float, float] | None = None
    for number in numbers:
        place = folder / str(number)
        campaign = write_campaign(place / "campaign", number, bytes(2 * number))
        cpu, wall = snakemake(campaign, place / "campaign", "--dry-run")
        bare_cpu, bare_wall = snakemake(
            write_bare(place / "bare", number), place / "bare", "--dry-run"
        )
        exponents = ""
        if before:
            few, cpu_of_few, bare_cpu_of_few = before
            exponents = (
                f"{exponent(few, number, cpu_of_few, cpu):>10.2f}"
                f"{exponent(few, number, bare_cpu_of_few, bare_cpu):>6.2f}"
            )
        print(
            f"{number:>6}{cpu:>9.2f}{wall:>9.2f}{bare_cpu:>9.2f}{bare_wall:>9.2f}"
            f"{cpu / bare_cpu:>7.2f}{wall / bare_wall:>7.2f}{exponents}",
            flush=True,
        )
        before = (number, cpu, bare_cpu)


def plan_crossings(numbers: list[int], folder: Path) -> None:
    """Plan campaigns of these numbers of crossings, and print their times."""
    print(
        f"crossings, {PER_SUBJECT} of each subject:\n{'N':>6}{'CPU':>9}{'wall':>9}{'exponent':>10}"
    )
    before: tuple[int, float] | None = None
    for number in numbers:
        place = folder / f"crossings_{number}"
        cpu, wall = snakemake(write_crossings(place, number), place, "--dry-run")
        grown = f"{exponent(before[0], number, before[1], cpu):.2f}" if before else ""
        print(f"{number:>6}{cpu:>9.2f}{wall:>9.2f}{grown:>10}", flush=True)
        before = number, cpu


def exponent(few: int, many: int, time_of_few: float, time_of_many: float) -> float:
    """The exponent p of a time that grows as N^p."""
    return math.log(time_of_many / time_of_few) / math.log(many / few)


def run_and_plan_again(number: int, folder: Path, recording: bytes) -> int:
    """Run a campaign and a bare Snakefile, plan them again, print the times; the number of files in
    `results`."""
    campaign = write_campaign(folder / "campaign", number, recording)
    bare = write_bare(folder / "bare", number)
    snakemake(campaign, folder / "campaign")
    snakemake(bare, folder / "bare")
    nothing, _ = snakemake(campaign, folder / "campaign", "--dry-run")
    nothing_bare, _ = snakemake(bare, folder / "bare", "--dry-run")
    files = sum(path.is_file() for path in (folder / "campaign/results").rglob("*"))
    log = next((folder / "campaign/raw_data").rglob("*.mcap"))
    log.write_bytes(log.read_bytes()[: -2 * number])
    changed, _ = snakemake(campaign, folder / "campaign", "--dry-run")
    print(
        f"{number:>6}{nothing:>12.2f}{nothing_bare:>18.2f}{nothing / nothing_bare:>9.2f}"
        f"{changed:>18.2f}",
        flush=True,
    )
    return files


def main() -> None:
    """Print times to plan, and files per trial."""
    numbers = [int(word) for word in sys.argv[1:]] or list(NUMBERS)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.chdir(ROOT)
        settings = yaml.safe_load(SETTINGS.read_text(encoding="utf-8"))
        settings["protocol"]["amplitudes_deg"] = RECORDED["dynamometer"]["amplitudes_deg"]
        (folder / "simulation.yaml").write_text(yaml.safe_dump(settings), encoding="utf-8")
        simulate_trial(folder / "simulation.yaml", folder / "simulated", TRIAL)
        recording = next((folder / "simulated").rglob(f"{TRIAL}.mcap")).read_bytes()
        plan(numbers, folder)
        plan_crossings(numbers, folder)
        print("planned again, CPU:")
        print(
            f"{'N':>6}{'nothing to do':>15}{'bare Snakefile':>15}{'ratio':>9}"
            f"{'one log changed':>18}"
        )
        few, many = (
            run_and_plan_again(number, folder / f"run_{number}", recording) for number in RUN
        )
        print(f"files below results/ per trial: {(many - few) / (RUN[1] - RUN[0]):.2f}")


if __name__ == "__main__":
    main()
