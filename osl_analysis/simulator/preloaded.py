"""For the process from which jobs are forked: importing this loads what simulating jobs would each load anew.

Compiled functions are among it. A new clone compiles them here, once, and not in each of its first jobs. All other runs
find them on disk, and all jobs in memory.
"""

import numpy as np

from osl_analysis.model.preloaded import DEVICE, GAINS
from osl_analysis.simulator import actuator_bench, bench_files, dynamometer, walking
from osl_analysis.simulator.drivetrain_sim import IDEAL, ControlCommands, simulate_belt_torque, simulate_drivetrain
from osl_analysis.simulator.even_spline import spline_at
from osl_analysis.simulator.joint_motion import JointMotion, position_loop

__all__ = ["actuator_bench", "bench_files", "dynamometer", "walking", "warm_up"]


def warm_up() -> None:
    """Call the compiled functions of a bench trial and a crossing, with arguments of the same types as theirs."""
    rate, still = 1000.0, np.zeros(4)
    commands = ControlCommands(GAINS.K_1 + still, GAINS.B_1 + still, still, GAINS.cancels_friction)
    simulate_drivetrain(rate, still, still, commands, IDEAL, DEVICE)
    simulate_belt_torque(still, IDEAL, DEVICE)
    position_loop(JointMotion(still, still, still), rate, 30.0, 0.9)
    spline_at(still, rate, still)


warm_up()
