"""CPU time of the fits of one impedance trial of the default campaign beside a short script's.

    python benchmarks/impedance_trial.py

One run, one thread, 142 s at 1 kHz, which the simulator makes into a temporary folder; the ratio is
the claim. The script does what a reader would write with pandas and SciPy: filter, differentiate,
fit Eq. 15 to each amplitude and to all of them with `curve_fit`, and fit a sine with harmonics to
angle and torque of each segment. It is told where the segments are, takes both signals for samples
of one clock, and has no interval.
"""

import os

os.environ.update(
    dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "POLARS_MAX_THREADS"), "1")
)

import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import curve_fit
from scipy.signal import butter, filtfilt

from osl_analysis.bench.analysis import QUANTITIES
from osl_analysis.bench.impedance import DesiredImpedance, judged_impedance
from osl_analysis.bench.phasors import phasor_table, phasors_of_record
from osl_analysis.bench.record import record_of_trial, with_actuator
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.campaign.configuration import read_section
from osl_analysis.commands.simulate import row_of_trial, simulate_trial
from osl_analysis.commands.trials import ingest_trial
from osl_analysis.files import default_config
from osl_analysis.ingest.examine import check_recording, saturated
from osl_analysis.model.compensator import PAPER_WEIGHT
from osl_analysis.model.drivetrain import DrivetrainParameters, read_parameters
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.spectral.stepped_sine import Likeness, find_segments
from osl_analysis.table import write_table
from osl_analysis.trial import Trial, read_trial
from osl_analysis.yaml_settings import read_yaml

SIMULATION = Path("config/simulation/default.yaml")
DEVICE = Path("config/parameters/default.yaml")
NAME, CONDITION = "impedance_K300_B5.0_compensated", DesiredImpedance("compensated", 300.0, 5.0)
REPEATS = 5
Starts = Mapping[tuple[float, float], int]
"""First row of each segment of the script, by amplitude [rad] and frequency [Hz]."""


def cpu_ms(work: Callable[[], Any]) -> float:
    """Least CPU time [ms] of several runs, the first of which does not count."""
    work()
    times = []
    for _ in range(REPEATS):
        started = time.process_time()
        work()
        times.append(time.process_time() - started)
    return 1e3 * min(times)


def recorded_trial(folder: Path) -> Path:
    """A trial of the default campaign, simulated and ingested into a folder."""
    row = row_of_trial(read_yaml(SIMULATION, SimulationSettings), SIMULATION, NAME)
    simulate_trial(SIMULATION, folder, NAME)
    ingest_trial(row, folder, Path("config/sources"), folder / f"{NAME}.parquet")
    return folder / f"{NAME}.parquet"


def script(table: pd.DataFrame, starts: Starts, cycles: int) -> list[Any]:
    """What a reader would write: K, B, I, offset of each amplitude and of all, and the phasors of
    each segment."""
    rate = 1 / table["time"].diff().median()
    b, a = butter(4, 15, fs=rate)
    theta, torque = (filtfilt(b, a, table[name]) for name in ("theta", "torque"))
    omega = np.gradient(theta, 1 / rate)
    signals = pd.DataFrame(
        {"theta": theta, "omega": omega, "alpha": np.gradient(omega, 1 / rate), "torque": torque}
    )
    amplitude, found = np.zeros(len(table)), []
    for (size, frequency), start in starts.items():
        rows = slice(
            start + round(2 * rate / frequency), start + round((cycles - 1) * rate / frequency)
        )
        amplitude[rows] = size
        turn = 2 * np.pi * frequency * table["time"].to_numpy()[rows]
        harmonics = [f(k * turn) for k in range(1, 6) for f in (np.cos, np.sin)]
        columns = np.column_stack([np.ones_like(turn), *harmonics])
        found += [
            np.linalg.lstsq(columns, table[name].to_numpy()[rows])[0]
            for name in ("theta", "torque")
        ]

    def eq15(x: Any, K: float, B: float, I: float, offset: float) -> Any:
        return K * x[0] + B * x[1] + I * x[2] + offset

    for size in (*np.unique(amplitude[amplitude > 0]), None):
        part = signals[amplitude > 0 if size is None else amplitude == size]
        found.append(
            curve_fit(
                eq15, part[["theta", "omega", "alpha"]].to_numpy().T, part["torque"].to_numpy()
            )
        )
    return found


def pandas_table(trial: Trial) -> pd.DataFrame:
    """The samples as the script takes them: row by row, as if one clock had stamped both."""
    time, theta = trial.sampled("theta").select("time", "theta").to_numpy().T
    torque = trial.sampled("torque")["torque"].to_numpy()
    rows = min(len(theta), len(torque))
    return pd.DataFrame({"time": time[:rows], "theta": theta[:rows], "torque": torque[:rows]})


def job(path: Path, s: DynamometerAnalysis, p: DrivetrainParameters) -> None:
    """All of it, as the workflow's job does it."""
    read = read_trial(path)
    check_recording(read, s)
    rails = saturated(read, "torque", "theta")
    record = with_actuator(record_of_trial(read, s), read)
    analysis, table = judged_impedance(
        record, rails, p, CONDITION, CONDITION.gains(p, PAPER_WEIGHT)
    )
    tables = [table, phasor_table(NAME, phasors_of_record(record)), analysis.time_base(QUANTITIES)]
    tables.append(analysis.series().table())
    for table in tables:
        write_table(table, path.with_suffix(".csv"))


def main() -> None:
    settings = read_section(default_config(), "dynamometer", DynamometerAnalysis)
    p = read_parameters(DEVICE)
    with tempfile.TemporaryDirectory() as folder:
        path = recorded_trial(Path(folder))
        trial = read_trial(path)
        table = pandas_table(trial)
        found = find_segments(
            Likeness(table["time"].to_numpy(), table["theta"].to_numpy(), settings.protocol)
        )
        starts = {(one.commanded, one.frequency_hz): round(one.start) for one in found}
        cycles = int(found[0].cycles)
        whole, short = (
            cpu_ms(lambda: job(path, settings, p)),
            cpu_ms(lambda: script(table, starts, cycles)),
        )
    print(f"{NAME}, {len(table)} samples, CPU of one thread:")
    print(
        f"the job: {whole:.0f} ms; pandas and curve_fit: {short:.0f} ms; ratio {whole / short:.2f}"
    )


if __name__ == "__main__":
    main()
