"""Motion of the perturbation platform, with and without a foot on it."""

import re
from dataclasses import dataclass

import numpy as np

from osl_analysis.simulator.plan import Condition
from osl_analysis.simulator.rigid_body import Pose, rotation_about
from osl_analysis.simulator.settings import stream
from osl_analysis.simulator.step import ANKLE_HEIGHT, Step, draw_servo, smooth_step
from osl_analysis.simulator.walking_settings import Perturbation, WalkingSettings
from osl_analysis.trial import Array

UNLOADED_COMMAND_S = 0.5
SHIFT_M = np.array([0.012, 0.008, 0.006])
TILT_RAD = np.radians(2.0)
UNLOADED_RANGE = ([0.85, 0.9], [1.15, 1.3])  # Lowest and highest factors of size and duration of an unloaded ramp


@dataclass(frozen=True)
class PlatformMotion:
    """True motion of the platform."""

    angle: Array  # Dorsiflexion (toes-up) angle [rad], shape (n,)
    shift: Array  # Displacement [m] of the axis of rotation, laboratory axes, shape (n, 3)
    pose: Pose  # Displacement of the platform from where it is at rest
    command: float | None  # Time [s] at which the trigger fires. None if the platform stays at rest
    onset: float | None  # Time [s] at which the platform starts to move. None if it stays at rest


def pulse(time: Array, start: float, rise: float, back: float, fall: float) -> Array:
    """0, smoothly to 1 from `start` within `rise` [s], and to 0 again from `back` within `fall` [s]."""
    return np.asarray(smooth_step((time - start) / rise) - smooth_step((time - back) / fall))


def turned_about(pivot: Array, angle: Array) -> Pose:
    """Rotation by `angle` [rad, toes up] about the laboratory's y axis through a point [m]; 0 is the identity."""
    rotation = rotation_about(1, -angle)
    return Pose(rotation, pivot - rotation @ pivot)


def displaced(angle: Array, shift: Array, walking: WalkingSettings) -> Pose:
    """The platform turned by an angle [rad] about its axis, which is shifted [m]. The axis goes through the nominal
    ankle, or below it in the depth that the settings give."""
    axis, depth = nominal_ankle(walking), walking.perturbation.axis_depth_m
    if depth is not None:
        axis = np.array([*axis[:2], walking.plate.centre_m[2] - depth])
    turned = turned_about(axis, angle)
    return Pose(turned.rotation, turned.origin + shift)


def nominal_ankle(walking: WalkingSettings) -> Array:
    """Position [m] of the ankle of a nominally placed flat foot."""
    return np.add(walking.plate.centre_m, [*walking.plate.nominal_ankle_m, ANKLE_HEIGHT])


def perturbed_platform(time: Array, step: Step, walking: WalkingSettings) -> PlatformMotion:
    """The ramp under a walking foot, held until after toe-off."""
    ramp, servo = walking.perturbation, step.servo
    rise = servo.slowness * ramp.rise_s
    held = pulse(time, step.onset, rise, step.toe_off + ramp.hold_s, ramp.return_s)
    angle, shift = ramp_motion(held, step.condition, walking)
    angle = angle + servo.shivering(time, step.onset, rise)
    return PlatformMotion(angle, shift, displaced(angle, shift, walking), step.command, step.onset)


def ramp_motion(held: Array, condition: Condition, walking: WalkingSettings) -> tuple[Array, Array]:
    """Angle [rad], shape (n,), and shift [m] of the axis, shape (n, 3), of a platform that has gone a share `held` of
    its way. A platform that shifts the ankle backward dorsiflexes it, as one that turns the toes up. The heave is
    largest in the middle of the way."""
    ramp, shift = walking.perturbation, np.zeros((len(held), 3))
    shift[:, 2] = 1e-3 * walking.effects.platform_heave.value * 4 * held * (1 - held)
    if ramp.shift_mm is not None:
        shift[:, 0] = -condition.sign * 1e-3 * ramp.shift_mm * held
        return np.zeros_like(held), shift
    return condition.sign * np.radians(ramp.angle_deg) * held, shift


def resting_platform(time: Array) -> PlatformMotion:
    """A platform that stays flat."""
    still = np.zeros_like(time)
    return PlatformMotion(still, np.zeros((len(time), 3)), turned_about(np.zeros(3), still), None, None)


def unloaded_platform(
    time: Array, trial: str, seed: int, walking: WalkingSettings, condition: Condition | None = None
) -> PlatformMotion:
    """The perturbation of an unloaded platform: the ramp, with small random variations, and its return. Every
    `full_motion_every`-th trial (by the number at the end of its name) then also shifts along all three axes and tilts
    slowly about the walking direction. A regression can then estimate all inertial parameters of the plate."""
    ramp, servo = walking.perturbation, draw_servo(trial, seed, time, walking)
    scatter = 1e-3 * walking.effects.trigger_scatter.value * stream(seed, trial, "trigger_scatter").standard_normal()
    onset = UNLOADED_COMMAND_S + ramp.latency_s + float(scatter)
    size, slowness = (1.0, 1.0) if ramp.same_unloaded else stream(seed, trial, "unloaded_ramp").uniform(*UNLOADED_RANGE)
    back, rise = onset + 0.5, slowness * servo.slowness * ramp.rise_s
    held = pulse(time, onset, rise, back, ramp.return_s)
    angle, shift = ramp_motion(held, condition or Condition(), walking)
    angle, shift = size * angle + servo.shivering(time, onset, rise), size * shift
    pose = displaced(angle, shift, walking)
    number, every = re.search(r"\d+$", trial), walking.plate.full_motion_every
    if number and every and int(number.group()) % every == 0:
        pose = shifted_and_tilted(time, back + ramp.return_s, ramp).after(pose)
    return PlatformMotion(angle, shift, pose, UNLOADED_COMMAND_S, onset)


def shifted_and_tilted(time: Array, start: float, ramp: Perturbation) -> Pose:
    """A shift along each axis in turn, as fast as the ramp, and a tilt about x that is three times slower."""
    rise = ramp.rise_s
    shifts = [pulse(time, start + k * 3 * rise, 1.5 * rise, start + (k * 3 + 2) * rise, 1.5 * rise) for k in range(3)]
    tilt = TILT_RAD * pulse(time, start + 9 * rise, 3 * rise, start + 13 * rise, 3 * rise)
    return Pose(rotation_about(0, tilt), np.stack(shifts, axis=-1) * SHIFT_M)
