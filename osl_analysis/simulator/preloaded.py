"""For the process from which jobs are forked: importing this loads what simulating jobs would each load anew.

Compiled functions are among it. A new clone compiles them here, once, and not in each of its first jobs. All other runs
find them on disk, and all jobs in memory.
"""

import numpy as np

from osl_analysis.compiled import numba
from osl_analysis.config.parameters import DrivetrainParameters
from osl_analysis.simulator import bench, crossing
from osl_analysis.simulator.drivetrain import IDEAL, ControlCommands, simulate_belt_torque, simulate_drivetrain
from osl_analysis.simulator.joint_motion import JointMotion, position_loop
from osl_analysis.simulator.kernel import spline_at

__all__ = ["bench", "crossing", "warm_up"]


def warm_up() -> None:
    """Call the compiled functions of a bench trial and a crossing, with arguments of the same types as theirs."""
    device = DrivetrainParameters(
        k_tau=0.1, n_m=9.0, B_m=0.1, J_m=0.1, f_C=0.1, f_G=0.01, n_T=5.0, K_s=700.0, B_j=1.0, J_j=0.01
    )
    rate, still = 1000.0, np.zeros(4)
    simulate_drivetrain(rate, still, still, ControlCommands(still, still, still, True), IDEAL, device)
    simulate_belt_torque(still, IDEAL, device)
    position_loop(JointMotion(still, still, still), rate, 30.0, 0.9)
    spline_at(still, rate, still)


if numba is not None:
    warm_up()
