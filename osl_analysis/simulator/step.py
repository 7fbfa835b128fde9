# SPDX-License-Identifier: Apache-2.0
"""One step on the platform: the nominal curves of gait, their random variations, and the motion of
the platform.

The nominal curves resemble published ones of level walking with a prosthetic ankle, and have three
or more continuous derivatives. Cycle phase c: 0 at heel strike, 1 at the next one; stance phase p:
0 at heel strike, 1 at toe-off.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from osl_analysis.base.trial import Array
from osl_analysis.config.impedance_trajectory import STANCE_SHARE
from osl_analysis.simulator.laboratory_settings import (
    ANKLE_ANGLE,
    GROUND_REACTION,
    NOMINAL,
    Bump,
    WalkingSettings,
)
from osl_analysis.simulator.rigid_body import Pose, rotation_about
from osl_analysis.simulator.trial_plan import generator_of

RENDERED_S = 0.1  # time [s] after the onset in which the rendered impedance is fitted


def smooth_step(x: Array) -> Array:
    """0 for x <= 0, 1 for x >= 1; between them 35 x^4 - 84 x^5 + 70 x^6 - 20 x^7, which is an
    incomplete beta function. Three derivatives vanish at both ends."""
    return np.asarray(scipy.special.betainc(4, 4, np.clip(x, 0.0, 1.0)))


def pulse(time: Array, start: float, rise: float, back: float, fall: float) -> Array:
    """0, smoothly to 1 from `start` within `rise` [s], and to 0 again from `back` within `fall`
    [s]."""
    rising = smooth_step((time - start) / rise)
    falling = smooth_step((time - back) / fall)
    return rising - falling


def periodic_bumps(c: Array, bumps: Sequence[Bump]) -> Array:
    """Sum of size * exp(sharpness (cos 2 pi (c - peak) - 1)) over (size, peak, sharpness)."""
    waves = [a * np.exp(k * (np.cos(2 * np.pi * (c - peak)) - 1.0)) for a, peak, k in bumps]
    return np.sum(waves, axis=0)


def nominal_ankle_angle(c: Array) -> Array:
    """Ankle angle [rad], dorsiflexion positive, against cycle phase."""
    return np.radians(periodic_bumps(c, ANKLE_ANGLE))


def stance_window(p: Array) -> Array:
    """1 from 8 % to 92 % of stance, 0 outside stance, smooth between."""
    return smooth_step(p / NOMINAL.stance_edge) * smooth_step((1.0 - p) / NOMINAL.stance_edge)


def ground_reaction(p: Array) -> Array:
    """Ground reaction on a right foot in multiples of body weight, laboratory axes, shape (n,
    3)."""

    components = []
    for humps in GROUND_REACTION.values():
        curves = [size * np.exp(-(((p - peak) / width) ** 2)) for size, peak, width in humps]
        components.append(np.sum(curves, axis=0))
    forward, inward, upward = components
    in_stance = stance_window(p)[:, None]
    return np.stack([forward, inward, NOMINAL.upward + upward], axis=-1) * in_stance


def foot_path(c: Array, stride: float) -> tuple[Array, Array]:
    """Find the nominal path of a foot.

    In stance the foot rolls over its heel, lies flat from 12 % to 60 %, where both pivots give one
    path, and rolls over its ball.

    Parameters
    ----------
    c : Array
        Cycle phases (n,).
    stride : float
        Along x [m].

    Returns
    -------
    ankle : Array
        (n, 3) [m] from the ankle's place with the foot flat in cycle 0.
    pitch : Array
        (n,) [rad] against the floor, toes up positive.
    """
    phase = np.mod(c, 1.0)
    flat_from, flat_to = NOMINAL.foot_flat
    at_strike = np.radians(NOMINAL.pitch_at_strike_deg)
    at_toe_off = np.radians(NOMINAL.pitch_at_toe_off_deg)
    heel_rocker = at_strike * (1.0 - smooth_step(phase / (flat_from * STANCE_SHARE)))
    heel_off = at_toe_off * smooth_step((phase - flat_to * STANCE_SHARE) / 0.29)
    return_in_swing = (at_strike - at_toe_off) * smooth_step((phase - 0.67) / 0.33)
    pitch = heel_rocker + heel_off + return_in_swing

    on_ball = smooth_step((phase - 0.15) / 0.20) - smooth_step((phase - 0.72) / 0.22)
    over_heel = rolled_over(NOMINAL.heel, pitch)
    over_ball = rolled_over(NOMINAL.ball, pitch)
    ankle = (1.0 - on_ball)[:, None] * over_heel + on_ball[:, None] * over_ball

    swing_phase = np.clip((phase - STANCE_SHARE) / (1.0 - STANCE_SHARE), 0.0, 1.0)
    ankle[:, 0] += stride * (np.floor(c) + smooth_step(swing_phase))
    ankle[:, 2] += NOMINAL.clearance * 256.0 * (swing_phase * (1.0 - swing_phase)) ** 4
    return ankle, pitch


def rolled_over(x: float, pitch: Array) -> Array:
    """Place of the ankle (n, 3) [m] of a foot that rolls over a pivot on the floor, x [m] forward
    of the ankle, which stays where it is when the foot is flat; seen from the ankle it turns by
    -pitch about y."""
    z = -NOMINAL.ankle_height
    cos = np.cos(pitch)
    sin = np.sin(pitch)
    return np.stack([x - (cos * x - sin * z), np.zeros_like(pitch), z - (sin * x + cos * z)], -1)


@dataclass(frozen=True)
class GaitTrial:
    """A trial of the gait laboratory. Its name and the seed determine everything random."""

    name: str
    seed: int
    walking: WalkingSettings

    @cached_property
    def time(self) -> Array:
        """Times [s] of the motion, (n,): whole marker frames, at the motion's rate."""
        rates = self.walking.rates
        frames = round(self.walking.gait.recording_s * rates.points_hz)
        return np.arange(frames * (rates.motion_hz // rates.points_hz)) / rates.motion_hz

    def random(self, effect: str) -> np.random.Generator:
        """The random numbers of an effect."""
        return generator_of(self.seed, self.name, effect)

    def normal(self, effect: str, unit: float = 1.0) -> float:
        """A normal deviate with an effect's standard deviation, in SI units."""
        sd = getattr(self.walking.effects, effect).value
        return unit * float(sd * self.random(effect).standard_normal())

    def wandering(self) -> Array:
        """A smooth deviation of the ankle's angle, of unit standard deviation, (n,): six waves of
        random size, frequency [Hz] and phase."""
        random = self.random("angle_wander")
        sizes = random.standard_normal(6)
        waves = len(sizes)
        frequencies = random.uniform(0.3, 4.0, waves)
        phases = random.uniform(0, 2 * np.pi, waves)
        return np.cos(2 * np.pi * np.outer(self.time, frequencies) + phases) @ (
            sizes * np.sqrt(2 / waves)
        )


@dataclass(frozen=True)
class Step:
    """One crossing's step on the platform, the same with and without the perturbation."""

    trial: GaitTrial
    heel_strike: float  # time [s]
    stance: float  # duration [s]
    onset: float  # time [s] at which the platform starts to move
    command: float  # time [s] at which the perturbation is commanded
    placement: Array  # (3,) deviation [m] of the foot's place forward, to the left and up

    @property
    def toe_off(self) -> float:
        """Time [s] at which the foot leaves the platform."""
        return self.heel_strike + self.stance

    def stance_phase(self, time: Array) -> Array:
        """Phase of stance at times [s]: 0 at heel strike, 1 at toe-off."""
        return (time - self.heel_strike) / self.stance

    def cycle_phase(self, time: Array) -> Array:
        """Phase of the gait cycle at times [s]: 0 at the heel strike on the platform, 1 at the
        next."""
        return STANCE_SHARE * self.stance_phase(time)


def draw_step(trial: GaitTrial) -> Step:
    """Draw a crossing. Each effect has its own random numbers."""
    walking = trial.walking
    stance = walking.gait.stance_s * (1 + trial.normal("stance_scatter", unit=0.01))
    heel_strike = walking.gait.heel_strike_s + trial.normal("heel_strike_scatter")
    phase = trial.random("perturbation_phase").uniform(*walking.perturbation.stance_phase)
    command = heel_strike + phase * stance
    forward = trial.normal("placement_forward", unit=1e-3)
    sideways = trial.normal("placement_sideways", unit=1e-3)
    return Step(
        trial=trial,
        heel_strike=heel_strike,
        stance=stance,
        onset=command + walking.perturbation.latency_s,
        command=command,
        placement=np.array([forward, sideways, 0.0]),
    )


@dataclass(frozen=True)
class PlatformMotion:
    """True motion of the platform."""

    angle: Array  # (n,) [rad], dorsiflexion (toes up) positive
    pose: Pose  # displacement of the platform from where it is at rest
    command: float | None = None  # time [s] at which the trigger fires; None: it stays at rest
    onset: float | None = None  # time [s] at which the platform starts to move; None: at rest


def turned(angle: Array, walking: WalkingSettings) -> Pose:
    """The platform turned [rad, toes up] about its mediolateral axis through the nominal ankle."""
    rotation = rotation_about(1, -angle)
    pivot = nominal_ankle(walking)
    return Pose(rotation, pivot - rotation @ pivot)


def nominal_ankle(walking: WalkingSettings) -> Array:
    """Position [m] of the ankle of a nominally placed flat foot."""
    return np.add(walking.plate.centre_m, [*walking.plate.nominal_ankle_m, NOMINAL.ankle_height])


def resting_platform(trial: GaitTrial) -> PlatformMotion:
    """A platform that does not move."""
    angle = np.zeros_like(trial.time)
    return PlatformMotion(angle, turned(angle, trial.walking))


def ramped_platform(
    trial: GaitTrial,
    command: float,
    onset: float,
    back: float,
    size: float = 1.0,
    slowness: float = 1.0,
) -> PlatformMotion:
    """Move the platform by the commanded ramp, `size` times as far and `slowness` times as long,
    held until it returns at `back` [s].
    """
    ramp = trial.walking.perturbation
    held = pulse(trial.time, onset, slowness * ramp.rise_s, back, ramp.return_s)
    angle = size * np.radians(ramp.angle_deg) * held
    return PlatformMotion(angle, turned(angle, trial.walking), command, onset)


@dataclass(frozen=True)
class UnloadedTrial:
    """How the platform moves in a trial without a foot on it, which tells the plate's inertia."""

    command_s: float = 0.5  # after the start
    hold_s: float = 0.5  # from the onset until it returns
    shift: tuple[float, float, float] = (0.012, 0.008, 0.006)  # [m] along each axis
    tilt_deg: float = 2.0  # about the forward axis


UNLOADED = UnloadedTrial()


def unloaded_platform(trial: GaitTrial) -> PlatformMotion:
    """Move an unloaded platform by the perturbation, with small random variations.

    Every `full_motion_every`-th trial, by its number, then also shifts along all axes and tilts, so
    that all inertial parameters can be estimated.
    """
    ramp = trial.walking.perturbation
    command = UNLOADED.command_s
    onset = command + ramp.latency_s
    size, slowness = trial.random("unloaded_ramp").uniform([0.85, 0.9], [1.15, 1.3])
    back = onset + UNLOADED.hold_s
    motion = ramped_platform(trial, command, onset, back, size, slowness)
    # some trials also shift and tilt, by their number
    number = int(trial.name.rpartition("_")[2])
    period = trial.walking.plate.full_motion_every
    if not period or number % period:
        return motion

    # a shift along each axis in turn, as fast as the ramp, and a tilt about x that is three times
    # slower
    time = trial.time
    start = back + ramp.return_s
    fast = ramp.rise_s
    rise = 1.5 * fast
    shifts = [
        pulse(time, start + k * 3 * fast, rise, start + (k * 3 + 2) * fast, rise) for k in range(3)
    ]
    tilt = pulse(time, start + 9 * fast, 3 * fast, start + 13 * fast, 3 * fast)
    tilted = Pose(
        rotation_about(0, np.radians(UNLOADED.tilt_deg) * tilt),
        np.stack(shifts, axis=-1) * UNLOADED.shift,
    )
    return replace(motion, pose=tilted.after(motion.pose))
