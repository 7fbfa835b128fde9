"""Largest memory of ingest, quality control and fits by the length of a recording.

Run from the repository: `python benchmarks/memory.py`, with `fits` behind it for the fits alone. A simulated impedance
trial of 1 kHz is recorded again and again, without a break, into files of two lengths: MCAP of two and four hours, CSV
of twenty and sixty minutes. Each is ingested, and its trial checked, in a process of its own. The difference of the
largest memories of the two lengths is printed per sample, and the largest of all. The trial itself takes 8 bytes per
sample and column.

The same for the fits of trials of ten minutes, an hour and four hours: a stepped sine that one clock stamped, one that
two clocks stamped, whose stamps scatter, one of two clocks whose signals are too noisy to tell whether the stamps are
true, so that it is fitted with both answers, and any motion. A fit of four hours has 2 GiB: it may map that much, less
what it holds at the beginning, beyond its file and what its libraries have mapped by then.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import polars as pl
from scipy.signal import butter, sosfilt

from osl_analysis.commands.simulate import row_of_trial
from osl_analysis.parameters import read_parameters
from osl_analysis.simulator import messages
from osl_analysis.simulator.bench import simulate_dynamometer_trial
from osl_analysis.simulator.mcap_writer import joint_states, wrenches, write_mcap, write_topics
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.trial import Trial, write_trial
from osl_analysis.yaml_settings import read_yaml

SETTINGS = Path("config/simulation/default.yaml")
TRIAL = "impedance_K300_B5.0_compensated"
LENGTHS = {"mcap": (7_200_000, 14_400_000), "two nodes": (1_200_000, 3_600_000), "csv": (1_200_000, 3_600_000)}
"""Samples of the two lengths, by format; two nodes have as many each, with stamps of their own, so twice as many."""
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
FIT = """
import sys
from pathlib import Path
from resource import RLIMIT_AS, setrlimit
from osl_analysis.bench.impedance import DesiredImpedance
from osl_analysis.commands.bench import fit_impedance_trial
from osl_analysis.config import read_config
def sizes():
    status = dict(line.split(":", 1) for line in open("/proc/self/status"))
    return [int(status[name].split()[0]) * 1024 for name in ("VmHWM", "VmRSS", "VmSize")]
trial, warm, out, limit = Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4])
config, device = read_config(Path("config/config.yaml")), Path("config/parameters/default.yaml")
names = ("impedance", "phasors", "response", "response_lines", "response_models", "timebase", "series")
tables = {name: out / f"{name}.csv" for name in names}
def fit(path):
    desired = DesiredImpedance("compensated", 300.0, 5.0)
    fit_impedance_trial(path, device, desired, config.gain_weight.weight, config.dynamometer, tables)
fit(warm)
_, resident, mapped = sizes()
if limit:
    setrlimit(RLIMIT_AS, (mapped + trial.stat().st_size + limit - resident,) * 2)
fit(trial)
print(resident, sizes()[0])
"""
FIT_LENGTHS = {
    "one clock": (600_000, 3_600_000, 14_400_000),
    "two clocks": (600_000, 3_600_000, 14_400_000),
    "undecided stamps": (600_000, 3_600_000, 14_400_000),
    "any motion": (600_000, 3_600_000, 14_400_000),
}
"""Samples of the trials that are fitted, by kind; the longest has a limit."""
JITTER = {"two clocks": 2e-5, "undecided stamps": 2.5e-6}
"""Largest scatter [s] of the stamps of two clocks, by kind."""
NOISE = 1e-3, 0.3
"""Standard deviations of the noise of angle [rad] and torque [N*m] beside which such a scatter is not seen."""
WARM, LIMIT = 60_000, 2 << 30
"""Samples of a trial with which the libraries are loaded, and memory [bytes] of four hours."""


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
    path = folder / f"long_{samples}.{'csv' if kind == 'csv' else 'mcap'}"
    time = 1.0 + np.arange(samples) * 1e-3
    if kind == "two nodes":
        whole = {name: np.resize(values, samples) for name, values in once.items()}
        names = {"joint": "joint_angle", "actuator": "actuator_angle", "command": "commanded_angle"}
        position, effort = {key: whole[name] for key, name in names.items()}, {"actuator": whole["motor_current"]}
        joints = joint_states("/joint_states", "bench", time, position, effort)
        write_topics(path, [joints, wrenches("/wrench", "load_cell", time + 4e-4, whole["load_cell_torque"])])
        return path
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
    source = {"mcap": "dynamometer", "two nodes": "dynamometer_nodes", "csv": "bench_csv"}[kind]
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-c", JOB, str(path), source, out]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
    if run.returncode:
        raise SystemExit(f"{path.name}: {run.stderr.splitlines()[-1]}")
    samples, before, ingest, both = map(int, run.stdout.split())
    return samples, before, ingest, both


def motion(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Angle [rad] and torque [N*m] of a joint of second order that noise of 0.5 to 6 Hz moves."""
    rng, band = np.random.default_rng(1), butter(4, (0.5, 6.0), btype="band", fs=1000, output="sos")
    theta = sosfilt(band, rng.standard_normal(samples))
    theta *= np.deg2rad(2.0) / theta.std()
    omega = np.gradient(theta, 1e-3)
    torque = 300 * theta + 5 * omega + 0.1 * np.gradient(omega, 1e-3) + 0.05 * rng.standard_normal(samples)
    return theta + 2e-5 * rng.standard_normal(samples), torque


def fitted_trial(folder: Path, kind: str, once: dict[str, np.ndarray], samples: int) -> Path:
    """A trial of this kind and length, as ingest writes it."""
    time, rng = 1.0 + np.arange(samples) * 1e-3, np.random.default_rng(2)
    if kind == "any motion":
        theta, torque = motion(samples)
    else:
        theta, torque = (np.resize(once[name], samples) for name in ("joint_angle", "load_cell_torque"))
        torque = -torque.astype(np.float32).astype(float)
    if kind == "undecided stamps":
        theta += NOISE[0] * rng.standard_normal(samples)
        torque += NOISE[1] * rng.standard_normal(samples)
    table = pl.DataFrame({"time": time, "theta": theta, "torque": torque})
    if kind in JITTER:
        jitter = rng.uniform(-JITTER[kind], JITTER[kind], (2, samples))
        first = np.arange(2 * samples) % 2 == 0
        late = np.gradient(theta, 1e-3) * jitter[0], np.gradient(torque, 1e-3) * jitter[1]
        each = {"theta": (first, theta + late[0]), "torque": (~first, torque + late[1])}
        table = pl.DataFrame({"time": np.stack([time + jitter[0], time + 4e-4 + jitter[1]], axis=1).ravel()})
        for name, (rows, values) in each.items():
            column = np.full(2 * samples, np.nan)
            column[rows] = values
            table = table.with_columns(pl.Series(name, column, nan_to_null=True))
    path = folder / f"{kind.replace(' ', '_')}_{samples}.parquet"
    write_trial(Trial(TRIAL, table), path)
    return path


def fitted(path: Path, warm: Path, limit: int) -> tuple[int, int]:
    """Memory [bytes] before the fit of a trial, and the largest one in it; `limit` [bytes] is all that it has, or 0."""
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-c", FIT, str(path), str(warm), out, str(limit)]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
    if run.returncode:
        raise SystemExit(f"{path.name}: {run.stderr.splitlines()[-1]}")
    before, largest = map(int, run.stdout.split())
    return before, largest


def print_fits(folder: Path, once: dict[str, np.ndarray]) -> None:
    """Bytes per sample of a fit between ten minutes and an hour, and what four hours take."""
    for kind, lengths in FIT_LENGTHS.items():
        warm, largest = fitted_trial(folder, kind, once, WARM), []
        for samples in lengths:
            path = fitted_trial(folder, kind, once, samples)
            before, most = fitted(path, warm, LIMIT if samples == lengths[-1] else 0)
            largest.append(most)
            path.unlink()
        slope = (largest[1] - largest[0]) / (lengths[1] - lengths[0])
        print(f"fit of {kind}: {slope:.0f} bytes per sample from {lengths[0]} to {lengths[1]} samples;")
        print(
            f"  {lengths[-1]} samples take {largest[-1] / 2**30:.2f} GiB, of which the libraries "
            f"{before / 2**30:.2f}, and have {LIMIT / 2**30:.0f}",
            flush=True,
        )


def print_ingest(folder: Path, once: dict[str, np.ndarray]) -> None:
    """Bytes per sample of ingest and quality control, and what the longer recording takes."""
    for kind, lengths in LENGTHS.items():
        found = []
        for samples in lengths:
            path = recorded(folder, kind, once, samples)
            found.append(measured(path, kind))
            path.unlink()
        short, long = found
        ingest, both = ((long[k] - short[k]) / (long[0] - short[0]) for k in (2, 3))
        print(f"{kind}: {ingest:.0f} bytes per sample in ingest, {both:.0f} with quality control;")
        sizes = [long[k] / 2**30 for k in (2, 3, 1)]
        print(f"  {long[0]} samples take {sizes[0]:.2f} and {sizes[1]:.2f} GiB, of which the libraries {sizes[2]:.2f}")


def main() -> None:
    once = simulated()
    with tempfile.TemporaryDirectory() as name:
        if "fits" not in sys.argv[1:]:
            print_ingest(Path(name), once)
        print_fits(Path(name), once)


if __name__ == "__main__":
    main()
