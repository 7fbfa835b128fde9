"""The leg's walking controller: desired impedance over the gait cycle, and the gains that the actuator gets."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.model.compensator import compensated_gains, stiffness_gain
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.simulator import gait
from osl_analysis.simulator.drivetrain_sim import ControlCommands
from osl_analysis.simulator.rigid_body import derivative
from osl_analysis.trial import Array

B_1_GRID = 50
REQUIRED = ("phase", "K_d", "B_d")
EQUILIBRIUM = "theta_eq_rad"


@dataclass(frozen=True)
class ImpedanceTrajectory:
    """Desired K_d [N*m/rad] and B_d [N*m*s/rad] at the joint over the gait cycle, shape (n,), phase from 0 to 1.

    theta_eq [rad] is the equilibrium at the joint; None leaves it to the nominal ankle moment.
    """

    phase: Array
    K_d: Array
    B_d: Array
    theta_eq: Array | None

    def at(self, values: Array, c: Array) -> Array:
        """One of the columns at cycle phases c of any cycle, by linear interpolation."""
        return np.interp(np.mod(c, 1.0), self.phase, values)


@lru_cache(maxsize=8)
def read_impedance_trajectory(path: Path) -> ImpedanceTrajectory:
    """Read a CSV table with columns phase, K_d [N*m/rad], B_d [N*m*s/rad] and, if it has it, theta_eq_rad [rad].

    Raises
    ------
    InputError
        The file is missing or no such table, a column is absent, a value is no number, or the phase does not rise
        from 0 to 1.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such impedance trajectory; correct 'impedance' in the walking settings")
    rows = [line for line in path.read_text(encoding="utf-8").splitlines() if line.strip() and line[0] != "#"]
    names = [name.strip() for name in rows[0].split(",")] if rows else []
    absent = [name for name in REQUIRED if name not in names]
    if absent or len(rows) < 3:
        problem = f"no column '{absent[0]}'" if absent else "fewer than two rows"
        raise InputError(f"{path}: {problem}; it needs a header with {', '.join(REQUIRED)} and a row per phase")
    try:
        columns = dict(zip(names, np.loadtxt(rows[1:], delimiter=",", ndmin=2).T, strict=True))
    except ValueError as error:
        raise InputError(f"{path}: not a table of numbers ({error}); write one number per column") from error
    phase = columns["phase"]
    if phase[0] != 0 or phase[-1] != 1 or not (np.diff(phase) > 0).all():
        raise InputError(f"{path}: column phase runs from {phase[0]:g} to {phase[-1]:g}; it must rise from 0 to 1")
    return ImpedanceTrajectory(phase, columns["K_d"], columns["B_d"], columns.get(EQUILIBRIUM))


@lru_cache(maxsize=8)
def compensated_damping(path: Path, p: DrivetrainParameters) -> tuple[Array, Array]:
    """B_1 [N*m*s/rad] (Eq. 14) on a grid of phases: the search is the expensive part, and B_1 is smooth."""
    desired = read_impedance_trajectory(path)
    grid = np.linspace(0.0, 1.0, B_1_GRID + 1)
    K_d, B_d = desired.at(desired.K_d, grid), desired.at(desired.B_d, grid)
    # at() is periodic, so the grid's last point is its first
    B_1 = [compensated_gains(k, b, p).B_1 for k, b in zip(K_d[:-1], B_d[:-1], strict=True)]
    return grid, np.array([*B_1, B_1[0]])


def walking_commands(
    c: Array, cycle_s: float, body_mass: float, path: Path, compensates: bool, p: DrivetrainParameters
) -> ControlCommands:
    """What the actuator is told at cycle phases c, shape (n,), a regular grid of a step that takes `cycle_s` [s].

    The equilibrium is where K_d and B_d give the nominal ankle moment at the nominal ankle angle.
    """
    desired = read_impedance_trajectory(path)
    K_d, B_d = desired.at(desired.K_d, c), desired.at(desired.B_d, c)
    if compensates:
        K_1, B_1 = stiffness_gain(K_d, p), np.interp(np.mod(c, 1.0), *compensated_damping(path, p))
    else:
        K_1, B_1 = K_d / p.n_T**2, B_d / p.n_T**2
    if desired.theta_eq is not None:
        theta_eq = desired.at(desired.theta_eq, c)
    else:
        rate = 1.0 / (float(c[1] - c[0]) * cycle_s)
        angle = gait.ankle_angle(c)
        elastic = body_mass * gait.ankle_moment(c) - B_d * derivative(angle, rate)
        theta_eq = angle - elastic / K_d
    return ControlCommands(K_1, B_1, theta_eq * p.n_T, cancels_friction=compensates)
