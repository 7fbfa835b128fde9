"""What a force plate carries in a crossing: the foot, or the part of it that is on the plate, and a second foot."""

import numpy as np

from osl_analysis.simulator.crossing import SimulatedCrossing
from osl_analysis.simulator.gait import FOOT_WIDTH
from osl_analysis.simulator.rigid_body import GRAVITY, TrueWrench
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.trial import Array

SECOND_FOOT_M = np.array([-0.15, 0.18, 0.0])
"""Place of the other foot's load on the plate's surface, from below the nominal ankle [m]."""
SECOND_FOOT_WIDTH = 0.12
"""Width of the other foot's load, a Gaussian curve about mid-stance [phase of stance]."""


def plate_load(walked: SimulatedCrossing, walking: WalkingSettings) -> TrueWrench:
    """The load on the plate, about the ankle of the foot that walks; shape (n, 3) each."""
    own, change = foot_on_plate(walked), walked.step.change
    if not change.second_foot_percent:
        return own
    place = np.add(walking.plate.centre_m, [*walking.plate.nominal_ankle_m, 0.0]) + SECOND_FOOT_M
    other = second_foot(walked)
    point = walked.motion.platform.pose.point(place)
    moment = own.moment + np.cross(point - own.point, other)
    return TrueWrench(own.force + other, moment, own.point)


def foot_on_plate(walked: SimulatedCrossing) -> TrueWrench:
    """The part of the ground reaction that acts on the plate.

    The pressure is even over the width of the foot. What is beside the plate is carried by the floor, and the middle of
    the rest is half of that width further inward (to the left).
    """
    reaction, beside = walked.reaction, 1e-3 * walked.step.change.overhang_mm
    if not beside:
        return reaction
    share = 1.0 - beside / FOOT_WIDTH
    inward = np.array([0.0, 0.5 * beside, 0.0])
    return TrueWrench(share * reaction.force, share * reaction.moment, reaction.point + inward)


def second_foot(walked: SimulatedCrossing) -> Array:
    """Force [N] of the other foot on the plate, shape (n, 3): vertical, and largest at mid-stance."""
    phase = walked.step.stance_phase(walked.time)
    load = np.exp(-(((phase - 0.5) / SECOND_FOOT_WIDTH) ** 2)) * ((phase > 0) & (phase < 1))
    weight = -0.01 * walked.step.change.second_foot_percent * walked.step.body_mass * GRAVITY
    return np.asarray(load[:, None] * weight)
