"""The leg's walking controller: desired impedance over the gait cycle, and the gains at the actuator."""

from functools import lru_cache
from pathlib import Path

import numpy as np

from osl_analysis.model.compensator import PAPER_WEIGHT, check_request, stiffness_gain
from osl_analysis.model.gain_selection import optimal_damping
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.simulator import gait
from osl_analysis.simulator.drivetrain_sim import ControlCommands
from osl_analysis.simulator.rigid_body import time_derivative
from osl_analysis.trajectory import read_impedance_trajectory
from osl_analysis.trial import Array

B_1_GRID = 50


@lru_cache(maxsize=8)
def compensated_damping(path: Path, p: DrivetrainParameters) -> tuple[Array, Array]:
    """A grid of phases, and B_1 [N*m*s/rad] (Eq. 14) at these. A grid is enough because B_1 is a smooth curve."""
    desired = read_impedance_trajectory(path)
    grid = np.linspace(0.0, 1.0, B_1_GRID + 1)
    K_d, B_d = desired.at(desired.K_d, grid), desired.at(desired.B_d, grid)
    # at() is periodic, so the grid's last point is its first
    check_request(K_d, B_d, p)
    B_1 = optimal_damping(K_d[:-1], B_d[:-1], p, PAPER_WEIGHT).B_1
    return grid, np.array([*B_1, B_1[0]])


def walking_commands(
    c: Array, cycle_s: float, body_mass: float, path: Path, compensates: bool, p: DrivetrainParameters
) -> ControlCommands:
    """Commands to the actuator at cycle phases c, shape (n,), a regular grid of a step that takes `cycle_s` [s].

    The equilibrium angle is chosen so that K_d and B_d give the nominal ankle moment at the nominal ankle angle.
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
        angle = gait.nominal_ankle_angle(c)
        elastic = body_mass * gait.nominal_ankle_moment(c) - B_d * time_derivative(angle, rate)
        theta_eq = angle - elastic / K_d
    return ControlCommands(K_1, B_1, theta_eq * p.n_T, cancels_friction=compensates)
