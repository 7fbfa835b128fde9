"""A small campaign with every kind of trial, for a run through SLURM beside a local run."""

import shutil
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
CONFIG = "small.yaml"
"""The file of its configuration."""
PROTOCOL = {"frequencies_hz": [2, 5], "cycles": 5, "amplitudes_deg": [2, 4]}
COUNTS = {"belt": 4, "transmission": 3, "actuator": 2, "K_d": [200, 300], "B_d": [5.0], "plate": 3, "walking": 13}
"""With one static trial and four of impedance these are 30."""
SETTINGS = {
    "campaign": "small",
    "raw_data": "raw_data/small",
    "sheet": "raw_data/small/trials.csv",
    "simulation": "simulation.yaml",
    "dynamometer": PROTOCOL,
    "walking": {"bootstrap_samples": 100, "perturbed_stance": "own"},
    "figures": {"time_series": {"amplitude_deg": 4, "duration_s": 2}, "frequency_response": {"K_d": 300, "B_d": 5}},
}


def write(folder: Path) -> None:
    """Write the configuration of the campaign, which is simulated, to a folder."""
    shutil.copytree(ROOT / "config", folder / "config")
    settings = yaml.safe_load((ROOT / "config/simulation/default.yaml").read_text())
    settings["experiments"] |= COUNTS
    settings["actuator"] |= {"duration_s": 10}
    settings["protocol"] |= PROTOCOL | {"rest_s": 0.5, "lead_s": 0.5}
    (folder / "simulation.yaml").write_text(yaml.safe_dump(settings))
    (folder / CONFIG).write_text(yaml.safe_dump(SETTINGS))


def measured(folder: Path) -> None:
    """Let its recordings count as measured."""
    (folder / CONFIG).write_text(yaml.safe_dump(SETTINGS | {"simulation": None}))
