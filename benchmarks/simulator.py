"""Speed of the simulator relative to real time, and to other ways to do the same, on one core.

    python benchmarks/simulator.py [folder of an earlier release]

For one trial of each experiment of the default campaign: its duration over the time of the processor, first for its
physics and sensors, then for the whole trial: its settings read, its truth and its logs written. Compilation is not
counted. The alternatives, for the impedance trial:

* the actuator's equation, without friction, hysteresis or encoders, by scipy's `solve_ivp` (RK45 at its usual
  tolerance, no step longer than a sample), the controller's current being held between samples: a script's way;
* an earlier release, if its folder is given: the same trial, simulated and written by its code.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "POLARS_MAX_THREADS"), "1")

import numpy as np
from scipy.integrate import solve_ivp

from osl_analysis.commands.simulate import row_of_trial, simulate_trial
from osl_analysis.experiments import EXPERIMENTS
from osl_analysis.model.compensator import select_gains
from osl_analysis.parameters import read_parameters
from osl_analysis.simulator.bench import commanded, moved, simulate_actuator_trial, simulate_dynamometer_trial
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.yaml_settings import read_yaml

SETTINGS = Path("config/simulation/default.yaml")
IMPEDANCE = "impedance_K300_B5.0_compensated"
TRIALS = ("belt_01", "transmission_1", "actuator_1", IMPEDANCE, "static_1", "plate_01", "walking_01", "walking_02")
REPEATS = 5
SCRIPT_S = 2.0
"""Seconds of the trial that the script's way simulates."""
OF_RELEASE = """
import sys, time
from pathlib import Path
from osl_analysis.commands.simulate import simulate_trial
run = lambda: simulate_trial(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
run()
times = []
for _ in range(int(sys.argv[4])):
    start = time.process_time()
    run()
    times.append(time.process_time() - start)
print(min(times))
"""


def seconds_of(work: Callable[[], Any], repeats: int = REPEATS) -> float:
    """Least time of the processor."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def script_way(settings: SimulationSettings) -> float:
    """Time [s] of the processor per simulated second of `solve_ivp` on the linear drivetrain."""
    p, rate = read_parameters(settings.parameters), settings.dynamometer.rate_hz
    row = row_of_trial(settings, SETTINGS, IMPEDANCE)
    gains = select_gains("compensated", row["K_d"], row["B_d"], p, settings.gain_weight.weight)
    n = round(SCRIPT_S * rate)
    theta, time_s = moved(commanded(row, settings), settings)[1].theta[: n + 1], np.arange(n + 1) / rate

    def slope(t: float, state: Any, current: float) -> tuple[float, float]:
        belt = p.K_s * (np.interp(t, time_s, theta) - state[0] / p.n_T)
        return state[1], (p.k_tau * p.n_m * current - p.B_m * state[1] + belt / p.n_T) / p.J_m

    def run() -> None:
        state: Any = (0.0, 0.0)
        for i in range(n):
            current = -(gains.K_1 * state[0] + gains.B_1 * state[1]) / (p.k_tau * p.n_m)
            state = solve_ivp(slope, time_s[i : i + 2], state, args=(current,), max_step=1 / rate).y[:, -1]

    return seconds_of(run, 1) / SCRIPT_S


def release_way(release: Path, folder: Path) -> float:
    """Time [s] of the processor in which an earlier release simulates and writes the trial."""
    arguments = [str(SETTINGS.resolve()), str(folder / "earlier"), IMPEDANCE, str(REPEATS)]
    writes_nothing = {"PYTHONDONTWRITEBYTECODE": "1", "NUMBA_CACHE_DIR": str(folder / "compiled")}
    environment = os.environ | {"PYTHONPATH": str(release)} | writes_nothing
    done = subprocess.run(
        [sys.executable, "-c", OF_RELEASE, *arguments], cwd=release, env=environment, capture_output=True, text=True
    )
    if done.returncode:
        raise SystemExit(done.stderr)
    return float(done.stdout.split()[-1])


def main() -> None:
    settings = read_yaml(SETTINGS, SimulationSettings)
    p = read_parameters(settings.parameters)
    print(f"{'trial':<34}{'s':>6}{'simulated, ms':>15}{'x real time':>13}{'with its files, ms':>20}{'x real time':>13}")
    with tempfile.TemporaryDirectory() as folder:
        for trial in TRIALS:
            row = row_of_trial(settings, SETTINGS, trial)

            def whole(trial: str = trial) -> None:
                simulate_trial(SETTINGS, Path(folder) / "now", trial)

            whole()  # compile
            seconds, physics = duration_of(row, settings), 0.0
            if row["experiment"] == "actuator":
                physics = seconds_of(lambda trial=trial: simulate_actuator_trial(trial, settings, p))
            elif EXPERIMENTS[row["experiment"]].log == "dynamometer":
                physics = seconds_of(lambda row=row: simulate_dynamometer_trial(row, settings, p))
            written = seconds_of(whole)
            alone = f"{1e3 * physics:>15.1f}{seconds / physics:>13.0f}" if physics else f"{'-':>15}{'-':>13}"
            print(f"{trial:<34}{seconds:>6.0f}{alone}{1e3 * written:>20.1f}{seconds / written:>13.0f}")
            if trial == IMPEDANCE:
                ours = physics, written, seconds
        physics, written, seconds = ours
        print(f"solve_ivp takes {script_way(settings) * seconds / physics:.0f} x the time of the simulated {IMPEDANCE}")
        if len(sys.argv) > 1:
            earlier = release_way(Path(sys.argv[1]).resolve(), Path(folder))
            print(
                f"the earlier release takes {earlier:.2f} s for {IMPEDANCE} with its files, {earlier / written:.1f} x"
            )


def duration_of(row: Mapping[str, Any], settings: SimulationSettings) -> float:
    """Duration [s] of a trial."""
    if EXPERIMENTS[row["experiment"]].log not in ("dynamometer", "actuator"):
        assert settings.walking is not None
        return read_yaml(settings.walking, WalkingSettings).gait.recording_s
    schedule: Any = {"belt": settings.belt, "actuator": settings.actuator}.get(row["experiment"], settings.protocol)
    return float(getattr(schedule, "duration_s", 0.0) or schedule.total_s)


if __name__ == "__main__":
    main()
