"""One step on the platform: the nominal curves of gait, all that is random in it, and the motion of the platform.

What is random is the same with and without the perturbation. The nominal curves resemble published ones of level
walking with a prosthetic ankle. They have three or more continuous derivatives, so that every body has an acceleration.
Cycle phase c: 0 at heel strike, 1 at the next one, any real number; stance phase p: 0 at heel strike, 1 at toe-off.
"""

import re
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.simulator.rigid_body import Pose, rotation_about
from osl_analysis.simulator.settings import stream
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.trial import Array

STANCE_FRACTION = 0.62
FLAT_FROM, FLAT_TO = 0.12, 0.60
ANKLE_HEIGHT = 0.08
HEEL = np.array([-0.06, 0.0, -ANKLE_HEIGHT])
BALL = np.array([0.13, 0.0, -ANKLE_HEIGHT])
# (size, cycle phase of the peak, sharpness) of periodic bumps; sizes in degrees and N*m/kg
ANKLE_ANGLE = ((-7.0, 0.06, 20.0), (12.0, 0.40, 3.5), (-18.0, 0.63, 11.0))
ANKLE_MOMENT = ((0.45, 0.28, 6.0), (0.35, 0.37, 14.0), (1.35, 0.475, 11.0), (-0.15, 0.05, 30.0))
HEEL_STRIKE_PITCH = np.radians(18.0)
TOE_OFF_PITCH = np.radians(-58.0)
CLEARANCE = 0.04


def smooth_step(x: Array) -> Array:
    """0 for x <= 0, 1 for x >= 1; 35 x^4 - 84 x^5 + 70 x^6 - 20 x^7 between: three derivatives vanish at both ends."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**4 * (35.0 + x * (-84.0 + x * (70.0 - 20.0 * x))))


def periodic_bumps(c: Array, bumps: tuple[tuple[float, float, float], ...]) -> Array:
    """Sum of size * exp(sharpness (cos 2 pi (c - peak) - 1)) over (size, peak, sharpness)."""
    waves = [a * np.exp(k * (np.cos(2 * np.pi * (c - peak)) - 1.0)) for a, peak, k in bumps]
    return np.asarray(np.sum(waves, axis=0))


def nominal_ankle_angle(c: Array) -> Array:
    """Ankle angle [rad], dorsiflexion positive, against cycle phase."""
    return np.radians(periodic_bumps(c, ANKLE_ANGLE))


def nominal_ankle_moment(c: Array) -> Array:
    """Internal plantarflexion moment [N*m/kg] against cycle phase: 0.5 at midstance, 1.4 at push-off, 0 in swing."""
    inside = np.mod(c, 1.0) / STANCE_FRACTION
    return periodic_bumps(c, ANKLE_MOMENT) * stance_window(inside)


def stance_window(p: Array) -> Array:
    """1 from 8 % to 92 % of stance, 0 outside stance, smooth between."""
    return smooth_step(p / 0.08) * smooth_step((1.0 - p) / 0.08)


def ground_reaction(p: Array) -> Array:
    """Ground reaction on a right foot in multiples of body weight, laboratory axes, shape (n, 3)."""

    def hump(peak: float, width: float) -> Array:
        """A Gaussian bump of stance phase."""
        return np.exp(-(((p - peak) / width) ** 2))

    forward = -0.16 * hump(0.18, 0.10) + 0.18 * hump(0.85, 0.09)
    inward = 0.045 * hump(0.22, 0.14) + 0.04 * hump(0.75, 0.14)
    upward = 0.74 + 0.36 * hump(0.22, 0.13) + 0.40 * hump(0.76, 0.13)
    return np.asarray(np.stack([forward, inward, upward], axis=-1) * stance_window(p)[:, None])


def foot_pitch(c: Array) -> Array:
    """Pitch [rad] of the foot against the floor, toes up positive; exactly 0 from 12 % to 60 % of stance."""
    c = np.mod(c, 1.0)
    heel_rocker = HEEL_STRIKE_PITCH * (1.0 - smooth_step(c / (FLAT_FROM * STANCE_FRACTION)))
    heel_off = TOE_OFF_PITCH * smooth_step((c - FLAT_TO * STANCE_FRACTION) / 0.29)
    swing = (HEEL_STRIKE_PITCH - TOE_OFF_PITCH) * smooth_step((c - 0.67) / 0.33)
    return np.asarray(heel_rocker + heel_off + swing)


def ankle_path(c: Array, stride: float) -> Array:
    """Ankle centre [m], shape (n, 3), relative to its place with the foot flat in cycle 0. `stride` [m] is along x. In
    stance the foot rolls over its heel, lies flat, and rolls over its ball. Both pivots give the same path while the
    foot is flat. In swing the path changes smoothly from one to the other."""
    pitch, inside = foot_pitch(c), np.mod(c, 1.0)
    on_ball = smooth_step((inside - 0.15) / 0.20) - smooth_step((inside - 0.72) / 0.22)
    path = (1.0 - on_ball)[:, None] * rolled_over(HEEL, pitch) + on_ball[:, None] * rolled_over(BALL, pitch)
    swung = np.clip((inside - STANCE_FRACTION) / (1.0 - STANCE_FRACTION), 0.0, 1.0)
    path[:, 0] += stride * (np.floor(c) + smooth_step(swung))
    path[:, 2] += CLEARANCE * 256.0 * (swung * (1.0 - swung)) ** 4
    return np.asarray(path)


def rolled_over(pivot: Array, pitch: Array) -> Array:
    """Ankle [m], shape (n, 3), of a foot pitched [rad, toes up] about a pivot that stays where it is when flat."""
    cos, sin = np.cos(pitch), np.sin(pitch)
    x, z = pivot[0], pivot[2]
    # the pivot as seen from the ankle turns by -pitch about y
    return np.stack([x - (cos * x - sin * z), np.zeros_like(pitch), z - (sin * x + cos * z)], axis=-1)


RENDERED_S = 0.1  # Time [s] after the onset in which the rendered impedance is fitted
WANDER_HZ = (0.3, 4.0)
WANDER_WAVES = 6
STEEPEST = 35 / 16  # Largest slope of `smooth_step`


@dataclass(frozen=True)
class Step:
    """Random quantities of one crossing, the same with and without the perturbation."""

    heel_strike: float  # Time [s] of heel strike
    stance: float  # Duration [s] of stance, without the change after the window
    onset: float  # Time [s] at which the platform starts to move
    command: float  # Time [s] at which the perturbation is commanded
    angle_factor: float  # Factor of the ankle's angle
    wander: Array  # Smooth deviation [rad] of the ankle's angle, shape (n,)
    force_factor: Array  # Factor of each component of the ground reaction, shape (3,)
    placement: Array  # Deviation [m] of the foot's place forward, to the left and up, shape (3,)
    yaw: float  # Direction [rad] of the foot, to the left
    hurry: float  # Time [s] by which stance is longer after the window

    @property
    def toe_off(self) -> float:
        """Time [s] at which the foot leaves the platform."""
        return self.heel_strike + self.stance + self.hurry

    def stance_phase(self, time: Array) -> Array:
        """Phase of stance at times [s]: 0 at heel strike, 1 at toe-off."""
        elapsed = time - self.heel_strike
        if self.hurry:
            begins = self.onset + RENDERED_S - self.heel_strike
            left = self.stance + self.hurry - begins
            elapsed = elapsed - self.hurry * smooth_step((elapsed - begins) / left)
        return np.asarray(elapsed / self.stance)

    def cycle_phase(self, time: Array) -> Array:
        """Phase of the gait cycle at times [s]: 0 at the heel strike on the platform, 1 at the next."""
        return STANCE_FRACTION * self.stance_phase(time)

    def as_walked(self, perturbed: bool) -> "Step":
        """This step with or without the perturbation, which alone changes stance after the window."""
        return self if perturbed or not self.hurry else replace(self, hurry=0.0)


def draw_step(trial: str, seed: int, time: Array, walking: WalkingSettings) -> Step:
    """Draw a crossing. Each effect has its own random stream."""
    effects, nominal, perturbation = walking.effects, walking.gait, walking.perturbation

    def normal(effect: str, unit: float = 1.0) -> float:
        """A normal deviate with the effect's standard deviation, in SI units."""
        return unit * float(getattr(effects, effect).value * stream(seed, trial, effect).standard_normal())

    stance = nominal.stance_s * (1 + normal("stance_scatter", 0.01)) * (1 + 0.01 * nominal.slower_percent)
    heel_strike = nominal.heel_strike_s + normal("heel_strike_scatter")
    phase = float(stream(seed, trial, "perturbation_phase").uniform(*perturbation.stance_phase))
    command, hurry = heel_strike + phase * stance, 0.01 * nominal.after_window_percent * stance
    onset = command + perturbation.latency_s
    left = heel_strike + stance + hurry - onset - RENDERED_S
    if hurry and not left > STEEPEST * max(hurry, 0.0):
        raise InputError(
            f"trial {trial}: after_window_percent {nominal.after_window_percent:g} leaves {left:.3f} s of stance "
            "after the window; choose a smaller change, or an earlier perturbation"
        )
    return Step(
        heel_strike=heel_strike,
        stance=stance,
        onset=onset,
        command=command,
        angle_factor=1 + normal("angle_scale", 0.01),
        wander=np.radians(effects.angle_wander.value) * wandering(stream(seed, trial, "angle_wander"), time),
        force_factor=1 + 0.01 * effects.force_scale.value * stream(seed, trial, "force_scale").standard_normal(3),
        placement=np.array([normal("placement_forward", 1e-3), normal("placement_sideways", 1e-3), 0.0]),
        yaw=normal("foot_yaw", np.pi / 180),
        hurry=hurry,
    )


def wandering(random: np.random.Generator, time: Array) -> Array:
    """A smooth deviation of unit standard deviation, shape (n,): slow waves of random size, frequency and phase."""
    sizes = random.standard_normal(WANDER_WAVES) * np.sqrt(2 / WANDER_WAVES)
    pitches, phases = random.uniform(*WANDER_HZ, WANDER_WAVES), random.uniform(0, 2 * np.pi, WANDER_WAVES)
    return np.asarray(np.cos(2 * np.pi * np.outer(time, pitches) + phases) @ sizes)


UNLOADED_COMMAND_S = 0.5
SHIFT_M = np.array([0.012, 0.008, 0.006])
TILT_RAD = np.radians(2.0)
UNLOADED_RANGE = ([0.85, 0.9], [1.15, 1.3])  # Lowest and highest factors of size and duration of an unloaded ramp


@dataclass(frozen=True)
class PlatformMotion:
    """True motion of the platform."""

    angle: Array  # Dorsiflexion (toes-up) angle [rad], shape (n,)
    pose: Pose  # Displacement of the platform from where it is at rest
    command: float | None  # Time [s] at which the trigger fires. None if the platform stays at rest
    onset: float | None  # Time [s] at which the platform starts to move. None if it stays at rest


def pulse(time: Array, start: float, rise: float, back: float, fall: float) -> Array:
    """0, smoothly to 1 from `start` within `rise` [s], and to 0 again from `back` within `fall` [s]."""
    return np.asarray(smooth_step((time - start) / rise) - smooth_step((time - back) / fall))


def turned(angle: Array, walking: WalkingSettings) -> Pose:
    """Rotation of the platform by an angle [rad, toes up] about the mediolateral axis through the nominal ankle."""
    rotation, pivot = rotation_about(1, -angle), nominal_ankle(walking)
    return Pose(rotation, pivot - rotation @ pivot)


def nominal_ankle(walking: WalkingSettings) -> Array:
    """Position [m] of the ankle of a nominally placed flat foot."""
    return np.add(walking.plate.centre_m, [*walking.plate.nominal_ankle_m, ANKLE_HEIGHT])


def perturbed_platform(time: Array, step: Step, walking: WalkingSettings) -> PlatformMotion:
    """The ramp under a walking foot, held until after toe-off."""
    ramp = walking.perturbation
    held = pulse(time, step.onset, ramp.rise_s, step.toe_off + ramp.hold_s, ramp.return_s)
    angle = np.radians(ramp.angle_deg) * held
    return PlatformMotion(angle, turned(angle, walking), step.command, step.onset)


def resting_platform(time: Array, walking: WalkingSettings) -> PlatformMotion:
    """A platform that stays flat."""
    still = np.zeros_like(time)
    return PlatformMotion(still, turned(still, walking), None, None)


def unloaded_platform(time: Array, trial: str, seed: int, walking: WalkingSettings) -> PlatformMotion:
    """The perturbation of an unloaded platform: the ramp, with small random variations, and its return. Every
    `full_motion_every`-th trial (by the number at the end of its name) then also shifts along all three axes and tilts
    slowly about the walking direction. A regression can then estimate all inertial parameters of the plate."""
    ramp, onset = walking.perturbation, UNLOADED_COMMAND_S + walking.perturbation.latency_s
    size, slowness = stream(seed, trial, "unloaded_ramp").uniform(*UNLOADED_RANGE)
    back = onset + 0.5
    angle = size * (np.radians(ramp.angle_deg) * pulse(time, onset, slowness * ramp.rise_s, back, ramp.return_s))
    pose = turned(angle, walking)
    number, every = re.search(r"\d+$", trial), walking.plate.full_motion_every
    if number and every and int(number.group()) % every == 0:
        pose = shifted_and_tilted(time, back + ramp.return_s, ramp.rise_s).after(pose)
    return PlatformMotion(angle, pose, UNLOADED_COMMAND_S, onset)


def shifted_and_tilted(time: Array, start: float, rise: float) -> Pose:
    """A shift along each axis in turn, as fast as the ramp, and a tilt about x that is three times slower."""
    shifts = [pulse(time, start + k * 3 * rise, 1.5 * rise, start + (k * 3 + 2) * rise, 1.5 * rise) for k in range(3)]
    tilt = TILT_RAD * pulse(time, start + 9 * rise, 3 * rise, start + 13 * rise, 3 * rise)
    return Pose(rotation_about(0, tilt), np.stack(shifts, axis=-1) * SHIFT_M)
