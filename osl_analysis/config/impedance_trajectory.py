"""The desired impedance over the gait cycle, from a CSV file, validated when it is read."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from osl_analysis.config.sheet import numbered_rows
from osl_analysis.errors import InputError
from osl_analysis.trial import Array

SYNTHETIC = "synthetic"  # kind of a trajectory that was made for a simulated leg
REQUIRED = ("phase", "K_d", "B_d")
STANCE_SHARE = 0.62  # of the gait cycle (Section IV)
FEWEST_LINES = 3  # a header and two rows


@dataclass(frozen=True)
class ImpedanceTrajectory:
    """Desired impedance at the joint over the gait cycle."""

    phase: Array  # (n,) of the gait cycle, from 0 to 1
    K_d: Array  # (n,) desired stiffness [N*m/rad]
    B_d: Array  # (n,) desired damping [N*m*s/rad]
    # (n,) equilibrium angle [rad]; None: it is computed from the nominal ankle moment
    theta_eq: Array | None
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
        CSV table with columns phase, K_d [N*m/rad], B_d [N*m*s/rad] and, optionally, theta_eq_rad
        [rad]. Lines that begin with `#` are comments. One of them, `# kind: synthetic`, may say
        what the trajectory is.

    Returns
    -------
    ImpedanceTrajectory

    Raises
    ------
    InputError
        The file is missing, a column is absent, a cell is no finite number, or the phase does not
        rise from 0 to 1.
    """
    if not path.is_file():
        raise InputError(
            f"{path}: no such impedance trajectory; correct its path in the configuration or the"
            " walking settings"
        )
    rows = [row for _, row in numbered_rows(path)]
    names = [name.strip() for name in rows[0]] if rows else []
    check_columns(path, names, len(rows))
    try:
        values = np.array(rows[1:], dtype=float).T
        columns = dict(zip(names, values, strict=True))
    except ValueError as error:
        raise InputError(
            f"{path}: not a table of numbers ({error}); write one number per column"
        ) from error
    for name, column in columns.items():
        wrong = column[~np.isfinite(column)]
        if wrong.size:
            raise InputError(f"{path}: column {name} holds {wrong[0]}; write a number in every row")
    phase = columns["phase"]
    if phase[0] != 0 or phase[-1] != 1 or not (np.diff(phase) > 0).all():
        raise InputError(
            f"{path}: column phase runs from {phase[0]:g} to {phase[-1]:g}; it must rise from 0"
            " to 1"
        )
    text = path.read_text(encoding="utf-8")
    kind = re.search(r"^#\s*kind:\s*(\S.*?)\s*$", text, re.MULTILINE)
    return ImpedanceTrajectory(
        phase=phase,
        K_d=columns["K_d"],
        B_d=columns["B_d"],
        theta_eq=columns.get("theta_eq_rad"),
        kind=kind[1] if kind else None,
    )


def check_columns(path: Path, names: Sequence[str], lines: int) -> None:
    """Refuse a table without a needed column, with one that stands twice, or with too few lines."""
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{path}: column '{name}' stands twice; rename or remove one")
    absent = [name for name in REQUIRED if name not in names]
    if absent or lines < FEWEST_LINES:
        problem = f"no column '{absent[0]}'" if absent else "fewer than two rows"
        raise InputError(
            f"{path}: {problem}; it needs a header with {', '.join(REQUIRED)} and a row per phase"
        )
