"""Jobs of impedance over stance: the table, and the numbers of its figure."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.table import MEASURED, read_table, write_table
from osl_analysis.trajectory import SYNTHETIC, read_impedance_trajectory
from osl_analysis.trial import Array
from osl_analysis.walking.over_stance import impedance_over_stance, trajectory_points, with_trajectory

NEEDED = ("group", "quantity", "estimator", "n", "mean", "se", "low", "high", "commanded")
FACTS = ("group", "onset_phase", "fitted_phase", "end_phase")
PHASES = np.linspace(0, 1, 101)
"""Phases of stance at which the commanded trajectory is drawn."""


def tabulate(
    summary: Path, groups: Path, output: Path, stance_share: float, trajectory: Sequence[Path] = (), data: str = ""
) -> None:
    """K, B and I of every group at the phase of stance that its fit reads, with interval and commanded value.

    `summary` is `walking_summary.csv`, `groups` `walking_groups.csv`. `trajectory` has the file of the commanded
    impedance over the gait cycle, if there is one (`commanded`); stance is the first `stance_share` of the cycle.
    """
    table = impedance_over_stance(read_table(summary, NEEDED), read_table(groups, FACTS))
    for path in commanded(trajectory, data):
        table = with_trajectory(table, *over_stance(path, stance_share))
    write_table(table, output)


def plotted_numbers(
    table: Path, output: Path, stance_share: float, trajectory: Sequence[Path] = (), data: str = ""
) -> None:
    """What the figure draws: the rows of the table, and the points of the commanded trajectory."""
    rows = read_table(table, ("series", "quantity", "phase", "estimate", "low", "high"))
    for path in commanded(trajectory, data):
        rows = pl.concat([rows, trajectory_points(*over_stance(path, stance_share))], how="diagonal_relaxed")
    write_table(rows, output)


def commanded(trajectory: Sequence[Path], data: str) -> list[Path]:
    """The files of trajectories that the leg was commanded; `data` are `simulated` or `measured`.

    A synthetic trajectory is made for the simulated leg: no measured one was commanded it.
    """
    return [p for p in trajectory if data != MEASURED or read_impedance_trajectory(p).kind != SYNTHETIC]


def over_stance(trajectory: Path, stance_share: float) -> tuple[Array, Array, Array]:
    """Phases of stance (n,) and the commanded K_d [N*m/rad] and B_d [N*m*s/rad] there."""
    desired = read_impedance_trajectory(trajectory)
    cycle = PHASES * stance_share
    return PHASES, desired.at(desired.K_d, cycle), desired.at(desired.B_d, cycle)
