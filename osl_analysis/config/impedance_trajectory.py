# SPDX-License-Identifier: Apache-2.0
"""The desired impedance over the gait cycle, from a CSV file, validated when it is read."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.base.errors import InputError, advise, listing
from osl_analysis.base.table import read_table
from osl_analysis.base.trial import Array

SYNTHETIC = "synthetic"  # kind of a trajectory that was made for a simulated leg
TRAJECTORY_COLUMNS = ("phase", "K_d", "B_d")
STANCE_SHARE = 0.62  # of the gait cycle (Section IV)


@dataclass(frozen=True)
class ImpedanceTrajectory:
    """Desired impedance at the joint over the gait cycle."""

    phase: Array  # (n,) of the gait cycle, from 0 to 1
    K_d: Array  # (n,) desired stiffness [N*m/rad]
    B_d: Array  # (n,) desired damping [N*m*s/rad]
    # what the file says of itself in a comment `# kind: synthetic`; None: it says nothing
    kind: str | None = None

    def at(self, values: Array, c: Array) -> Array:
        """One of the columns at cycle phases c of any cycle, by linear interpolation."""
        return np.interp(np.mod(c, 1.0), self.phase, values)


def read_impedance_trajectory(path: Path) -> ImpedanceTrajectory:
    """Read the desired impedance over the gait cycle.

    Parameters
    ----------
    path : Path
        CSV table with columns phase, K_d [N*m/rad] and B_d [N*m*s/rad]; a warning names others, as
        an equilibrium. Lines that begin with `#` are comments. One of them, `# kind: synthetic`,
        may say what the trajectory is.

    Returns
    -------
    ImpedanceTrajectory

    Raises
    ------
    InputError
        The file is missing, a column is absent, a cell is no finite number, or the phase does not
        rise from 0 to 1.
    """
    table = read_table(path, TRAJECTORY_COLUMNS)
    unused = [name for name in table.columns if name not in TRAJECTORY_COLUMNS]
    if unused:
        advise(f"{path}: not used: {listing(unused)}; delete these columns")
    columns = {name: table[name].cast(pl.Float64).to_numpy() for name in TRAJECTORY_COLUMNS}
    for name, column in columns.items():
        if not np.isfinite(column).all():
            raise InputError(f"{path}: column {name}: write a number in every row")
    phase = columns["phase"]
    if phase[0] != 0 or phase[-1] != 1 or not (np.diff(phase) > 0).all():
        raise InputError(
            f"{path}: column phase runs from {phase[0]:g} to {phase[-1]:g}",
            "it must rise from 0 to 1",
        )
    kind = re.search(r"^#\s*kind:\s*(\S.*?)\s*$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return ImpedanceTrajectory(**columns, kind=kind[1] if kind else None)
