"""A joint that answers by Eq. 15, exactly or with a spring that stiffens, Coulomb friction or backlash."""

import numpy as np

from osl_analysis.simulator.drivetrain_kernel import torque_through_gap
from osl_analysis.simulator.effect_settings import SecondOrderJoint
from osl_analysis.simulator.joint_motion import JointMotion
from osl_analysis.trial import Array

SIGN_WIDTH = 1e-3
"""Velocity [rad/s] over which Coulomb friction changes its sign, a hundredth of a slow sine's largest."""
GAP_SUBSTEPS = 20
"""Integration steps per sample for a joint with backlash."""


def second_order_torque(joint: SecondOrderJoint, motion: JointMotion, rate_hz: float) -> Array:
    """Resisting torque [N*m] of the joint, shape (n,), where the bench makes `motion`."""
    theta, omega, alpha = motion.theta, motion.omega, motion.alpha
    if joint.backlash.value:
        angle, velocity, acceleration = (np.ascontiguousarray(x, dtype=float) for x in (theta, omega, alpha))
        K_B_I, gap = (joint.K, joint.B, joint.I), joint.backlash.value
        linear = torque_through_gap(angle, velocity, acceleration, K_B_I, gap, 1 / rate_hz, GAP_SUBSTEPS)
    else:
        linear = joint.K * theta + joint.B * omega + joint.I * alpha
    return linear + joint.K * joint.stiffening.value * theta**3 + joint.coulomb.value * np.tanh(omega / SIGN_WIDTH)
