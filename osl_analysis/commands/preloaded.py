"""For the process from which jobs are forked: importing this loads what they would each load anew at its first use, the
units and compiled functions too."""

import numpy as np

from osl_analysis.compiled import HAS_COMPILER
from osl_analysis.ingest.units import is_unit
from osl_analysis.model.compensator import Controller, Gains, belt_response
from osl_analysis.model.parameters import PARAMETER_UNITS, DrivetrainParameters
from osl_analysis.simulator import bench, crossing
from osl_analysis.simulator.drivetrain import IDEAL, belt_path, constants, simulate_drivetrain
from osl_analysis.simulator.joint_motion import JointMotion, position_loop

__all__ = ["bench", "crossing"]

is_unit("rad")
if HAS_COMPILER:  # with arguments of the same types as in trials
    device, still = DrivetrainParameters(**dict.fromkeys(PARAMETER_UNITS, 2.0)), np.zeros(4)
    simulate_drivetrain(1000.0, still, still, np.zeros((3, 4)), IDEAL, device)
    belt_path(still, constants(IDEAL, device))
    position_loop(JointMotion(still, still, still), 1000.0, 30.0, 0.9)
    belt_response(still, 1000.0, Controller(Gains(1.0, 1.0, True), device, 0.1), device)
