"""Motion of the perturbation platform, with and without a foot on it."""

import re
from dataclasses import dataclass

import numpy as np

from osl_analysis.simulator.gait import ANKLE_HEIGHT, smooth_step
from osl_analysis.simulator.rigid_body import Pose, rotation_about
from osl_analysis.simulator.sensors import stream
from osl_analysis.simulator.walking_settings import Perturbation, WalkingSettings
from osl_analysis.trial import Array

UNLOADED_COMMAND_S = 0.5
SHIFT_M = np.array([0.012, 0.008, 0.006])
TILT_RAD = np.radians(2.0)


@dataclass(frozen=True)
class PlatformMotion:
    """True motion of the platform."""

    angle: Array
    """Dorsiflexion (toes-up) angle [rad], shape (n,)."""
    pose: Pose
    """Displacement of the platform from where it is at rest."""
    command: float | None
    """Time [s] at which the trigger fires. None if the platform stays at rest."""
    onset: float | None
    """Time [s] at which the platform starts to move. None if it stays at rest."""


def pulse(time: Array, start: float, rise: float, back: float, fall: float) -> Array:
    """0, smoothly to 1 from `start` within `rise` [s], and to 0 again from `back` within `fall` [s]."""
    return np.asarray(smooth_step((time - start) / rise) - smooth_step((time - back) / fall))


def turned_about(pivot: Array, angle: Array) -> Pose:
    """Rotation by `angle` [rad, toes up] about the laboratory's y axis through a point [m]; 0 is the identity."""
    rotation = rotation_about(1, -angle)
    return Pose(rotation, pivot - rotation @ pivot)


def nominal_ankle(walking: WalkingSettings) -> Array:
    """Position [m] of the ankle of a nominally placed flat foot. The platform's axis passes through it."""
    return np.add(walking.plate.centre_m, [*walking.plate.nominal_ankle_m, ANKLE_HEIGHT])


def perturbed_platform(time: Array, command: float, toe_off: float, walking: WalkingSettings) -> PlatformMotion:
    """The ramp under a walking foot, held until after toe-off [s]."""
    ramp = walking.perturbation
    onset = command + ramp.latency_s
    held = pulse(time, onset, ramp.rise_s, toe_off + ramp.hold_s, ramp.return_s)
    angle = np.radians(ramp.angle_deg) * held
    return PlatformMotion(angle, turned_about(nominal_ankle(walking), angle), command, onset)


def resting_platform(time: Array) -> PlatformMotion:
    """A platform that stays flat."""
    still = np.zeros_like(time)
    return PlatformMotion(still, turned_about(np.zeros(3), still), None, None)


def unloaded_platform(time: Array, trial: str, seed: int, walking: WalkingSettings) -> PlatformMotion:
    """The perturbation of an unloaded platform: the ramp, with small random variations, and its return.

    Every `full_motion_every`-th trial (by the number at the end of its name) then also shifts along all three axes and
    tilts slowly about the walking direction. A regression can then estimate all inertial parameters of the plate.
    """
    ramp, onset = walking.perturbation, UNLOADED_COMMAND_S + walking.perturbation.latency_s
    size, slowness = stream(seed, trial, "unloaded_ramp").uniform([0.85, 0.9], [1.15, 1.3])
    back = onset + 0.5
    angle = size * np.radians(ramp.angle_deg)
    angle = angle * pulse(time, onset, slowness * ramp.rise_s, back, ramp.return_s)
    pose = turned_about(nominal_ankle(walking), angle)
    if moves_fully(trial, walking):
        pose = shifted_and_tilted(time, back + ramp.return_s, ramp).after(pose)
    return PlatformMotion(angle, pose, UNLOADED_COMMAND_S, onset)


def moves_fully(trial: str, walking: WalkingSettings) -> bool:
    """Whether a trial without a foot on the plate moves it about every axis."""
    number, every = re.search(r"\d+$", trial), walking.plate.full_motion_every
    return bool(number and every and int(number.group()) % every == 0)


def shifted_and_tilted(time: Array, start: float, ramp: Perturbation) -> Pose:
    """A shift along each axis in turn, as fast as the ramp, and a tilt about x that is three times slower."""
    rise = ramp.rise_s
    shifts = [pulse(time, start + k * 3 * rise, 1.5 * rise, start + (k * 3 + 2) * rise, 1.5 * rise) for k in range(3)]
    tilt = TILT_RAD * pulse(time, start + 9 * rise, 3 * rise, start + 13 * rise, 3 * rise)
    return Pose(rotation_about(0, tilt), np.stack(shifts, axis=-1) * SHIFT_M)
