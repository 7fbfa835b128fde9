"""CPU time of the fits of one impedance trial of the default campaign, stage by stage, beside a short script's.

    python benchmarks/impedance_trial.py

One run, one thread, 142 s at 1 kHz, which the simulator makes into a temporary folder; the ratio is the claim. The
script does what a reader would write with pandas and SciPy: filter, differentiate, fit Eq. 15 to each amplitude and to
all of them with `curve_fit`, and fit a sine with harmonics to angle and torque of each segment. It is told where the
segments are, takes both signals for samples of one clock, and has no interval. A second ratio is that of the same work
alone: filter, derivatives, phasors and fits of signals on a time base, with the spread between cycles for an interval.
"""

import os

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "POLARS_MAX_THREADS"), "1"))

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import curve_fit
from scipy.signal import butter, filtfilt

from osl_analysis.bench.amplitude_fits import fits_by_amplitude
from osl_analysis.bench.asked_impedance import AskedImpedance, judged_impedance
from osl_analysis.bench.clocks import clock_drift_row
from osl_analysis.bench.diagnostics import lowest_held_out_vaf
from osl_analysis.bench.estimators import estimator_table
from osl_analysis.bench.frequency_response import at_amplitude, phasor_table
from osl_analysis.bench.impedance import DesiredImpedance, impedance_of, trial_phasors
from osl_analysis.bench.load_cell_drift import drift_rate
from osl_analysis.bench.nonlinearity import rendered_nonlinearity_row
from osl_analysis.bench.phasor_lag import torque_lag_row
from osl_analysis.bench.plausibility import check_recording, saturated
from osl_analysis.bench.protocol import find_blocks
from osl_analysis.bench.recorded import Recorded, resolution_of
from osl_analysis.bench.rendered import rendered_phasors, rendered_series, rendered_time_base, rendered_trial, sines_of
from osl_analysis.bench.settings import DynamometerAnalysis
from osl_analysis.bench.stepped_sine import SteppedSineTrial
from osl_analysis.bench.stiffness_drift import stiffness_drift_row, stiffness_of_cycles
from osl_analysis.commands.ingest import ingest_trial
from osl_analysis.commands.simulate import row_of_trial, simulate_trial
from osl_analysis.config import read_section
from osl_analysis.model.compensator import PAPER_WEIGHT
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.parameters import DrivetrainParameters, read_parameters
from osl_analysis.protocol.likeness import likeness
from osl_analysis.second_order import impedance_columns
from osl_analysis.shipped import default_config
from osl_analysis.signals import SevenPointMotion, filtered_motion
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.stats.fit_row import Row
from osl_analysis.stats.regression import LinearFit
from osl_analysis.table import write_table
from osl_analysis.trial import Trial, read_trial
from osl_analysis.uniform import uniform_signals
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
    """What a reader would write: K, B, I, offset of each amplitude and of all, and the phasors of each segment."""
    rate = 1 / table["time"].diff().median()
    b, a = butter(4, 15, fs=rate)
    theta, torque = (filtfilt(b, a, table[name]) for name in ("theta", "torque"))
    omega = np.gradient(theta, 1 / rate)
    signals = pd.DataFrame({"theta": theta, "omega": omega, "alpha": np.gradient(omega, 1 / rate), "torque": torque})
    amplitude, found = np.zeros(len(table)), []
    for (size, frequency), start in starts.items():
        rows = slice(start + round(2 * rate / frequency), start + round((cycles - 1) * rate / frequency))
        amplitude[rows] = size
        turn = 2 * np.pi * frequency * table["time"].to_numpy()[rows]
        harmonics = [f(k * turn) for k in range(1, 6) for f in (np.cos, np.sin)]
        columns = np.column_stack([np.ones_like(turn), *harmonics])
        found += [np.linalg.lstsq(columns, table[name].to_numpy()[rows])[0] for name in ("theta", "torque")]

    def eq15(x: Any, K: float, B: float, I: float, offset: float) -> Any:
        return K * x[0] + B * x[1] + I * x[2] + offset

    for size in (*np.unique(amplitude[amplitude > 0]), None):
        part = signals[amplitude > 0 if size is None else amplitude == size]
        found.append(curve_fit(eq15, part[["theta", "omega", "alpha"]].to_numpy().T, part["torque"].to_numpy()))
    return found


def pandas_table(trial: Trial) -> pd.DataFrame:
    """The samples as the script takes them: row by row, as if one clock had stamped both."""
    time, theta = trial.sampled("theta").select("time", "theta").to_numpy().T
    torque = trial.sampled("torque")["torque"].to_numpy()
    rows = min(len(theta), len(torque))
    return pd.DataFrame({"time": time[:rows], "theta": theta[:rows], "torque": torque[:rows]})


def stages(path: Path, s: DynamometerAnalysis, p: DrivetrainParameters) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Every stage of the job, each given what the ones before it have made."""
    read = read_trial(path)
    signals = uniform_signals(read, ("theta", "torque"), s.gap_limits, computed=("theta_command",))
    trial, motion = rendered_trial(read, s), likeness(signals.time, signals["theta"], s.protocol)
    assert isinstance(trial, SteppedSineTrial)
    known = Recorded(signals, motion)
    phasors, amplitudes = trial_phasors(trial), [*(block.amplitude_deg for block in trial.blocks), None]
    fits = [(amplitude, at_amplitude(phasors, amplitude), impedance_of(trial, amplitude)) for amplitude in amplitudes]
    gains = CONDITION.gains(p, PAPER_WEIGHT)
    assert gains is not None
    expected = joint_admittance(gains.K_1, gains.B_1, p, p.J_j)
    yield "read", lambda: read_trial(path)
    yield "checks of the recording", lambda: check_recording(read, s)
    yield "ends of the sensors' ranges", lambda: saturated(read, "torque", "theta")
    yield "time base", lambda: uniform_signals(read, ("theta", "torque"), s.gap_limits, computed=("theta_command",))
    yield "stepped sine or not", lambda: likeness(signals.time, signals["theta"], s.protocol).kind
    yield "steps of the sensors", lambda: [resolution_of(read, column, known) for column in ("theta", "torque")]
    yield "blocks", lambda: find_blocks(signals.time, signals["theta"], s.protocol, motion.runs)
    yield "drift of the load cell", lambda: drift_rate(trial.time, trial.torque, trial.segments(None))
    yield "filter", lambda: [s.low_pass(signals[name], signals.rate_hz) for name in ("theta", "torque")]
    yield "derivatives", lambda: SevenPointMotion(trial.time, trial.motion.theta, trial.rate_hz)[:]
    yield "phasors without rounding", lambda: trial_phasors(replace(trial, steps=(None, None)))
    yield "phasors, and rounding for the fits", lambda: trial_phasors(replace(trial))
    yield "fits with covariance", lambda: fits_by_amplitude(after_phasors(trial), impedance_columns)
    yield "held-out VAF", lambda: [lowest_held_out_vaf(trial, a, fit, impedance_columns) for a, _, fit in fits]
    yield "nonlinearity", lambda: [rendered_nonlinearity_row(chosen, fit) for _, chosen, fit in fits]
    yield "lag", lambda: [torque_lag_row(chosen, fit, expected) for _, chosen, fit in fits]
    yield "drift of the stiffness", lambda: drifts_of_stiffness(trial, fits)
    yield "clocks", lambda: clock_drift_row(trial)
    yield "gains", lambda: CONDITION.gains(p, PAPER_WEIGHT)
    yield "table of phasors", lambda: write_table(phasor_table(NAME, phasors), path.with_suffix(".csv"))
    yield "series", lambda: write_table(rendered_series(trial).table(), path.with_suffix(".csv"))
    yield "five estimators (only where asked for)", lambda: estimator_table(trial)


def drifts_of_stiffness(trial: SteppedSineTrial, fits: Sequence[tuple[float | None, Any, LinearFit]]) -> list[Row]:
    """The change of K at each amplitude, and at all of them."""
    stiffness = stiffness_of_cycles(trial.motion.theta, trial.filtered_torque, trial.segments(None))
    return [stiffness_drift_row(stiffness, trial.segments(amplitude), fit) for amplitude, _, fit in fits]


def same_work(trial: SteppedSineTrial, s: DynamometerAnalysis) -> dict[float | None, LinearFit]:
    """What the script does as well, from a trial on its time base with its segments: without rounding and checks."""
    motion, torque = filtered_motion(trial.time, trial.theta, trial.torque, s.low_pass)
    made = replace(trial, motion=motion, filtered_torque=torque, steps=(None, None))
    trial_phasors(made)
    return fits_by_amplitude(made, impedance_columns)


def after_phasors(trial: SteppedSineTrial) -> SteppedSineTrial:
    """The trial with what its phasors have kept for the fits, and nothing else."""
    made = replace(trial)
    made.rounding.update(trial.rounding)
    return made


def job(path: Path, s: DynamometerAnalysis, p: DrivetrainParameters) -> None:
    """All of it, as the workflow's job does it, but for the estimators."""
    read = read_trial(path)
    check_recording(read, s)
    rails = saturated(read, "torque", "theta")
    rendered = rendered_trial(read, s)
    asked, phasors = AskedImpedance(CONDITION, PAPER_WEIGHT, s.frequencies_hz), sines_of(rendered)
    tables = [judged_impedance(rendered, rails, p, asked, phasors), rendered_phasors(rendered, phasors)]
    tables += [rendered_time_base(rendered), rendered_series(rendered).table()]
    for table in tables:
        write_table(table, path.with_suffix(".csv"))


def main() -> None:
    settings = read_section(default_config(), "dynamometer", DynamometerAnalysis)
    p = read_parameters(DEVICE)
    with tempfile.TemporaryDirectory() as folder:
        path = recorded_trial(Path(folder))
        trial = read_trial(path)
        table = pandas_table(trial)
        found = find_blocks(table["time"].to_numpy(), table["theta"].to_numpy(), settings.protocol)
        starts = {(b.amplitude, one.frequency_hz): round(one.start) for b in found for one in b.segments}
        cycles = int(found[0].segments[0].cycles)
        print(f"{NAME}, {len(table)} samples, CPU of one thread:")
        for name, work in stages(path, settings, p):
            print(f"  {name:<40}{cpu_ms(work):8.1f} ms")
        rendered = rendered_trial(trial, settings)
        assert isinstance(rendered, SteppedSineTrial)
        whole, short = cpu_ms(lambda: job(path, settings, p)), cpu_ms(lambda: script(table, starts, cycles))
        same = cpu_ms(lambda: same_work(rendered, settings))
    print(f"the job without the five estimators: {whole:.0f} ms; pandas and curve_fit: {short:.0f} ms; ", end="")
    print(f"ratio {whole / short:.2f}")
    print(f"filter, derivatives, phasors and fits alone, as in the script: {same:.0f} ms; ratio {same / short:.2f}")


if __name__ == "__main__":
    main()
