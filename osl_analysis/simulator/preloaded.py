"""For the process from which jobs are forked: importing this loads what simulating jobs would each load anew.

Compiled functions are among it, also the search for gains, which fits use too. A new clone compiles them here, once,
and not in each of its first jobs. All other runs find them on disk, and all jobs in memory.
"""

import numpy as np

from osl_analysis.compiled import load_numba
from osl_analysis.model.compensator import compensated_gains
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.simulator import actuator_bench, bench_files, dynamometer, walking
from osl_analysis.simulator.drivetrain_sim import IDEAL, ControlCommands, simulate_belt_torque, simulate_drivetrain
from osl_analysis.simulator.even_spline import spline_at
from osl_analysis.simulator.joint_motion import JointMotion, position_loop

__all__ = ["actuator_bench", "bench_files", "dynamometer", "walking", "warm_up"]


def warm_up() -> None:
    """Call the compiled functions of a bench trial and a crossing, with arguments of the same types as theirs."""
    load_numba()
    rate, still = 1000.0, np.zeros(4)
    p = DrivetrainParameters(
        k_tau=0.1, n_m=9.0, B_m=0.1, J_m=0.1, f_C=0.1, f_G=0.01, n_T=5.0, K_s=700.0, B_j=1.0, J_j=0.01
    )
    gains = compensated_gains(100.0, 5.0, p)
    commands = ControlCommands(gains.K_1 + still, gains.B_1 + still, still, gains.cancels_friction)
    simulate_drivetrain(rate, still, still, commands, IDEAL, p)
    simulate_belt_torque(still, IDEAL, p)
    position_loop(JointMotion(still, still, still), rate, 30.0, 0.9)
    spline_at(still, rate, still)


warm_up()
