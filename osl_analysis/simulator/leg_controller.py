"""The leg's walking controller: desired impedance over the gait cycle, and the gains at the actuator."""

from functools import lru_cache
from pathlib import Path

import numpy as np

from osl_analysis.model.compensator import check_request, stiffness_gain
from osl_analysis.model.gain_selection import Weight, optimal_damping
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.simulator import gait
from osl_analysis.simulator.conditions import Condition
from osl_analysis.simulator.drivetrain_sim import ControlCommands
from osl_analysis.simulator.rigid_body import time_derivative
from osl_analysis.simulator.step import Step
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.trial import Array

B_1_GRID = 50


@lru_cache(maxsize=32)
def compensated_damping(
    path: Path, K_d: float | None, B_d: float | None, p: DrivetrainParameters, weight: Weight
) -> tuple[Array, Array]:
    """A grid of phases, and B_1 [N*m*s/rad] (Eq. 14) at these. A grid is enough because B_1 is a smooth curve."""
    desired = Condition(K_d=K_d, B_d=B_d).desired(path)
    grid = np.linspace(0.0, 1.0, B_1_GRID + 1)
    stiffness, damping = desired.at(desired.K_d, grid), desired.at(desired.B_d, grid)
    # at() is periodic, so the grid's last point is its first
    check_request(stiffness, damping, p)
    B_1 = optimal_damping(stiffness[:-1], damping[:-1], p, weight).B_1
    return grid, np.array([*B_1, B_1[0]])


def walking_commands(
    step: Step, time: Array, walking: WalkingSettings, compensates: bool, p: DrivetrainParameters
) -> ControlCommands:
    """Commands to the actuator in a step, shape (updates of the controller,); `time` [s] is that of the motion.

    The equilibrium angle is chosen so that K_d and B_d give the step's ankle moment at the step's nominal angle.
    """
    stride, condition = walking.rates.motion_hz // walking.rates.controller_hz, step.condition
    c, desired = step.cycle_phase(time[::stride]), condition.desired(walking.impedance)
    K_d, B_d = desired.at(desired.K_d, c), desired.at(desired.B_d, c)
    if compensates:
        damping = compensated_damping(walking.impedance, condition.K_d, condition.B_d, p, walking.gain_weight.weight)
        K_1, B_1 = stiffness_gain(K_d, p), np.interp(np.mod(c, 1.0), *damping)
    else:
        K_1, B_1 = K_d / p.n_T**2, B_d / p.n_T**2
    moment = step.load * step.body_mass * gait.nominal_ankle_moment(c) + step.torque_wander[::stride]
    if desired.theta_eq is not None:
        usual = step.body_mass * gait.nominal_ankle_moment(c)
        theta_eq = desired.at(desired.theta_eq, c) - (moment - usual) / K_d
    else:
        angle = step.change.amplitude * gait.nominal_ankle_angle(c)
        elastic = moment - B_d * time_derivative(angle, walking.rates.controller_hz)
        theta_eq = angle - elastic / K_d
    return ControlCommands(K_1, B_1, theta_eq * p.n_T, cancels_friction=compensates)
