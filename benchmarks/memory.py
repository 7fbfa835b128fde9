"""Largest memory of ingest and quality control by the length of a recording.

Run from the repository: `python benchmarks/memory.py`. A simulated impedance trial of 1 kHz is recorded again and
again, without a break, into files of two lengths: MCAP of two and four hours, CSV of twenty and sixty minutes. Each is
ingested, and its trial checked, in a process of its own. The difference of the largest memories of the two lengths is
printed per sample, and the largest of all. The trial itself takes 8 bytes per sample and column.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from osl_analysis.commands.simulate import row_of_trial
from osl_analysis.parameters import read_parameters
from osl_analysis.simulator import messages
from osl_analysis.simulator.dynamometer import simulate_dynamometer_trial
from osl_analysis.simulator.mcap_recorder import write_mcap
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.yaml_settings import read_yaml

SETTINGS = Path("config/simulation/default.yaml")
TRIAL = "impedance_K300_B5.0_compensated"
LENGTHS = {"mcap": (7_200_000, 14_400_000), "csv": (1_200_000, 3_600_000)}
"""Samples of the two lengths, by format."""
CHANNELS = ("joint_angle", "load_cell_torque", "actuator_angle", "motor_current", "commanded_angle")
CSV_NAMES = {
    "joint_angle": "joint angle [rad]",
    "actuator_angle": "actuator angle [rad]",
    "load_cell_torque": "load cell torque [N*m]",
    "motor_current": "motor current [A]",
}
JOB = """
import sys
from pathlib import Path
from osl_analysis.commands.trials import ingest_and_check
from osl_analysis.config import read_config
from osl_analysis.experiments import PROTOCOL
from osl_analysis.quality.checks import Commanded
def size():
    return next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM")) * 1024
log, source, out = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3])
config = read_config(Path("config/config.yaml"))
row = dict.fromkeys(("log_part", "mocap", "mocap_source", "plate"), None)
row |= {"trial": "long", "experiment": "impedance", "log": log.name, "log_source": source}
before = size()
from osl_analysis.commands.ingest import ingest_trial
from osl_analysis.commands.quality import check_trial
commanded = Commanded(**config.dynamometer.model_dump(mode="json", include=set(PROTOCOL)))
trial = ingest_trial(row, log.parent, Path("config/sources"), out / "long.parquet", ("theta", "torque"))
read = size()
from osl_analysis.memory import return_memory; return_memory()
check_trial(trial, "impedance", (), config.quality, commanded, out / "long.csv")
print(len(trial.samples), before, read, size())
"""


def simulated() -> dict[str, np.ndarray]:
    """The channels of one simulated trial at 1 kHz, by their names in the log."""
    settings = read_yaml(SETTINGS, SimulationSettings)
    row, parameters = row_of_trial(settings, SETTINGS, TRIAL), read_parameters(settings.parameters)
    log, _ = simulate_dynamometer_trial(row, settings, parameters)
    step = max(round(1e-3 / float(np.median(np.diff(log.time)))), 1)
    channels = {name: np.asarray(getattr(log, name))[::step] for name in CHANNELS}
    length = min(map(len, channels.values()))
    return {name: values[:length] for name, values in channels.items()}


def recorded(folder: Path, kind: str, once: dict[str, np.ndarray], samples: int) -> Path:
    """One trial again and again, without a break, until it has this many samples, as a file of this kind."""
    length = len(once["joint_angle"])
    path = folder / f"long_{samples}.{kind}"
    time = 1.0 + np.arange(samples) * 1e-3
    if kind == "mcap":
        whole = {name: np.resize(values, samples).astype(np.float32) for name, values in once.items()}
        write_mcap(path, messages.DYNAMOMETER, time, whole)
        return path
    block = np.column_stack([once[name] for name in CSV_NAMES])
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join(["time [s]", *CSV_NAMES.values()]) + "\n")
        for start in range(0, samples, length):
            at = time[start : start + length]
            rows = np.column_stack([at, block[: len(at)]])
            np.savetxt(file, rows, fmt=["%.6f", *["%.7g"] * len(CSV_NAMES)], delimiter=",")
    return path


def measured(path: Path, kind: str) -> tuple[int, int, int, int]:
    """Samples of a trial, memory [bytes] before it, and the largest one in ingest and in both."""
    source = {"mcap": "dynamometer", "csv": "bench_csv"}[kind]
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-c", JOB, str(path), source, out]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
    if run.returncode:
        raise SystemExit(f"{path.name}: {run.stderr.splitlines()[-1]}")
    samples, before, ingest, both = map(int, run.stdout.split())
    return samples, before, ingest, both


def main() -> None:
    once = simulated()
    with tempfile.TemporaryDirectory() as name:
        for kind, lengths in LENGTHS.items():
            found = []
            for samples in lengths:
                path = recorded(Path(name), kind, once, samples)
                found.append(measured(path, kind))
                path.unlink()
            short, long = found
            ingest, both = ((long[k] - short[k]) / (long[0] - short[0]) for k in (2, 3))
            print(f"{kind}: {ingest:.0f} bytes per sample in ingest, {both:.0f} with quality control;")
            sizes = [long[k] / 2**30 for k in (2, 3, 1)]
            print(
                f"  {long[0]} samples take {sizes[0]:.2f} and {sizes[1]:.2f} GiB, of which the libraries {sizes[2]:.2f}"
            )


if __name__ == "__main__":
    main()
