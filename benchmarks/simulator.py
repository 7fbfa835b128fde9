"""Speed of one core relative to real time for the simulation of a full dynamometer trial, including sensors.

Run from the repository: `python benchmarks/simulator.py`. Nothing is written; compilation is not counted.
"""

import time
from pathlib import Path

from osl_analysis.commands.simulate import row_of_trial
from osl_analysis.parameters import read_parameters
from osl_analysis.simulator.dynamometer import simulate_dynamometer_trial
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.yaml_settings import read_yaml

SETTINGS = Path("config/simulation/default.yaml")
TRIAL = "impedance_K300_B5.0_compensated"
REPEATS = 7


def main() -> None:
    settings = read_yaml(SETTINGS, SimulationSettings)
    p = read_parameters(settings.parameters)
    row = row_of_trial(settings, SETTINGS, TRIAL)
    log, _ = simulate_dynamometer_trial(row, settings, p)
    duration = float(log.time[-1] - log.time[0])
    walls = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        simulate_dynamometer_trial(row, settings, p)
        walls.append(time.perf_counter() - start)
    print(f"{TRIAL}: {duration:.0f} s simulated in {min(walls):.3f} s, {duration / min(walls):.0f} x real time")


if __name__ == "__main__":
    main()
