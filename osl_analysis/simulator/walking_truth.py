"""The exact curves of a gait-laboratory trial, and the impedance that the leg rendered."""

import numpy as np

from osl_analysis.columns import AXES
from osl_analysis.simulator.crossing import SimulatedCrossing
from osl_analysis.simulator.platform_motion import PlatformMotion
from osl_analysis.simulator.step import WINDOW_S
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.trial import Array


def rendered_impedance(perturbed: SimulatedCrossing, unperturbed: SimulatedCrossing) -> dict[str, float]:
    """K [N*m/rad], B [N*m*s/rad] and I [kg*m^2] of the drivetrain's response to the perturbation.

    Least squares of d_torque = K d_theta + B d_omega + I d_alpha without intercept, over the 100 ms after the onset.
    Both crossings are identical before the onset, so that the differences are exactly zero there.
    """
    onset = perturbed.motion.platform.onset
    if onset is None:
        return {}
    rows = (perturbed.time >= onset) & (perturbed.time <= onset + WINDOW_S)
    new, old = perturbed.motion, unperturbed.motion
    columns = np.stack([new.theta - old.theta, new.omega - old.omega, new.alpha - old.alpha], axis=-1)[rows]
    answer = (perturbed.drivetrain_torque - unperturbed.drivetrain_torque)[rows]
    K, B, inertia = np.linalg.lstsq(columns, answer, rcond=None)[0]
    return {"K_rendered": float(K), "B_rendered": float(B), "I_rendered": float(inertia)}


def crossing_curves(
    crossing: SimulatedCrossing, unperturbed: SimulatedCrossing, walking: WalkingSettings
) -> dict[str, Array]:
    """Exact curves in SI units, shape (n,) each, laboratory axes.

    force and moment: ground reaction on the foot, the moment about the centre of the plate's surface where the
    platform has carried it (`plate_centre`); axis: the ankle's, through `ankle`; foot_moment: what the foot's weight
    and inertia demand about it, so that torque = foot_moment - axis . (moment + (plate_centre - ankle) x force).
    """
    motion, desired = crossing.motion, crossing.step.condition.desired(walking.impedance)
    phase = crossing.step.cycle_phase(crossing.time)
    centre = motion.platform.pose.point(np.array(walking.plate.centre_m))
    axis = motion.foot.rotation[:, :, 1]
    ground = np.einsum("ni,ni->n", crossing.reaction.moment, axis)
    curves = {
        "time": crossing.time,
        "phase": phase,
        "theta": motion.theta,
        "omega": motion.omega,
        "alpha": motion.alpha,
        "torque": crossing.torque,
        "theta_unperturbed": unperturbed.motion.theta,
        "torque_unperturbed": unperturbed.torque,
        "K_d": desired.at(desired.K_d, phase),
        "B_d": desired.at(desired.B_d, phase),
        "platform_angle": motion.platform.angle,
        "foot_moment": crossing.torque + ground,
    }
    curves |= components("ankle", motion.foot.origin) | components("axis", axis) | components("plate_centre", centre)
    curves |= components("force", crossing.reaction.force)
    return curves | components("moment", crossing.reaction.moment_about(centre))


def platform_curves(time: Array, platform: PlatformMotion, walking: WalkingSettings) -> dict[str, Array]:
    """Exact curves of a platform without a foot: its angle [rad] and the centre of the plate's surface [m]."""
    centre = platform.pose.point(np.array(walking.plate.centre_m))
    return {"time": time, "platform_angle": platform.angle} | components("plate_centre", centre)


def components(name: str, vectors: Array) -> dict[str, Array]:
    """Columns name_x, name_y, name_z of vectors, shape (n, 3)."""
    return {f"{name}_{axis}": vectors[:, i] for i, axis in enumerate(AXES)}
