# SPDX-License-Identifier: Apache-2.0
"""Importing it loads what numba has compiled, once for all campaigns that the tests run."""

from pathlib import Path
from tempfile import TemporaryDirectory

from osl_analysis.commands.simulate import simulate_planned_trial

with TemporaryDirectory() as folder:
    simulate_planned_trial(
        Path(__file__).parents[1] / "tiny_simulation.yaml",
        Path(folder),
        "impedance_K300_B5.0_compensated",
    )
