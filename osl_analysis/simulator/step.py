"""One step on the platform: the nominal curves of gait, their random variations, and the motion of
the platform; with poses, wrenches and Newton-Euler for the bodies of a crossing, on a regular time
grid, in laboratory axes.

The nominal curves resemble published ones of level walking with a prosthetic ankle, and have three
or more continuous derivatives. Cycle phase c: 0 at heel strike, 1 at the next one; stance phase p:
0 at heel strike, 1 at toe-off."""

import re
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from osl_analysis.simulator.settings import Condition, WalkingSettings, stream
from osl_analysis.trial import Array

Point = Array | tuple[float, float, float]  # [m]

GRAVITY = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class Pose:
    """Pose of a body: rotation (n, 3, 3) from its own axes to the laboratory's, and its origin [m],
    shape (n, 3)."""

    rotation: Array
    origin: Array

    def point(self, local: Point) -> Array:
        """Laboratory position [m], shape (n, 3), of a point of the body, shape (3,)."""
        return self.origin + np.asarray(self.rotation.reshape(-1, 3) @ local).reshape(
            self.origin.shape
        )

    def after(self, inner: "Pose") -> "Pose":
        """The pose of a body that is held at `inner` in this body's axes."""
        origin = self.origin + np.einsum("nij,nj->ni", self.rotation, inner.origin)
        return Pose(self.rotation @ inner.rotation, origin)


@dataclass(frozen=True)
class TrueWrench:
    """A force [N] that acts at a point [m], with a moment [N*m] about that point; shape (n, 3)
    each."""

    force: Array
    moment: Array
    point: Array

    def moment_about(self, point: Array) -> Array:
        """Moment [N*m], shape (n, 3), of the same wrench about another point."""
        return self.moment + np.cross(self.point - point, self.force)


def support(
    pose: Pose, rate_hz: float, mass: float, centre_of_mass: Point, gyration: Point
) -> TrueWrench:
    """The wrench that must act on a body, besides its weight, for its motion: force m (a - g) and
    moment dH/dt = I alpha + omega x I omega about the centre of mass. This and the radii of
    gyration [m] are in the body's axes."""
    centre = pose.point(centre_of_mass)
    acceleration = time_derivative(time_derivative(centre, rate_hz), rate_hz)
    inertia = (pose.rotation * (mass * np.array(gyration) ** 2)) @ pose.rotation.transpose(0, 2, 1)
    W = time_derivative(pose.rotation, rate_hz) @ pose.rotation.transpose(0, 2, 1)  # dR/dt R^T
    omega = 0.5 * np.stack(
        [W[:, 2, 1] - W[:, 1, 2], W[:, 0, 2] - W[:, 2, 0], W[:, 1, 0] - W[:, 0, 1]], axis=-1
    )
    momentum = np.einsum("nij,nj->ni", inertia, omega)
    return TrueWrench(mass * (acceleration - GRAVITY), time_derivative(momentum, rate_hz), centre)


def time_derivative(values: Array, rate_hz: float) -> Array:
    """Time derivative along the first axis by fourth-order central differences, of smooth simulated
    curves, never of data: over tens of milliseconds the error at 3 kHz is below 1e-6. The two
    samples at either end are worse."""
    slope = np.gradient(values, axis=0, edge_order=2)
    inner, outer = values[3:-1] - values[1:-3], values[4:] - values[:-4]
    slope[2:-2] = (8.0 * inner - outer) / 12.0
    return np.asarray(slope * rate_hz)


def rotation_about(axis: int, angle: Array) -> Array:
    """Right-handed rotation, shape (n, 3, 3), by angles [rad] about laboratory axis 0 (x), 1 (y) or
    2 (z)."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned = np.zeros((len(angle), 3, 3))
    turned[:, axis, axis] = 1.0
    turned[:, i, i] = turned[:, j, j] = np.cos(angle)
    turned[:, j, i] = np.sin(angle)
    turned[:, i, j] = -turned[:, j, i]
    return turned


def interpolated_at(values: Array, rate_hz: float, times: Array) -> Array:
    """Values on a regular grid, (n, ...), at other times [s], held inside it, by cubic Lagrange
    interpolation."""
    place = np.clip(times * rate_hz, 1.0, len(values) - 3.0)
    first = np.floor(place).astype(int)
    f = (place - first).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(
        -f * (f - 1) * (f - 2) / 6 * values[first - 1]
        + (f + 1) * (f - 1) * (f - 2) / 2 * values[first]
        - (f + 1) * f * (f - 2) / 2 * values[first + 1]
        + (f + 1) * f * (f - 1) / 6 * values[first + 2]
    )


STANCE_FRACTION = 0.62
ANKLE_HEIGHT = 0.08
HEEL = np.array([-0.06, 0.0, -ANKLE_HEIGHT])
BALL = np.array([0.13, 0.0, -ANKLE_HEIGHT])


def smooth_step(x: Array) -> Array:
    """0 for x <= 0, 1 for x >= 1; 35 x^4 - 84 x^5 + 70 x^6 - 20 x^7 between: three derivatives
    vanish at both ends."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**4 * (35.0 + x * (-84.0 + x * (70.0 - 20.0 * x))))


def pulse(time: Array, start: float, rise: float, back: float, fall: float) -> Array:
    """0, smoothly to 1 from `start` within `rise` [s], and to 0 again from `back` within `fall`
    [s]."""
    return np.asarray(smooth_step((time - start) / rise) - smooth_step((time - back) / fall))


def periodic_bumps(c: Array, bumps: tuple[tuple[float, float, float], ...]) -> Array:
    """Sum of size * exp(sharpness (cos 2 pi (c - peak) - 1)) over (size, peak, sharpness)."""
    waves = [a * np.exp(k * (np.cos(2 * np.pi * (c - peak)) - 1.0)) for a, peak, k in bumps]
    return np.asarray(np.sum(waves, axis=0))


def nominal_ankle_angle(c: Array) -> Array:
    """Ankle angle [rad], dorsiflexion positive, against cycle phase."""
    return np.radians(
        periodic_bumps(c, ((-7.0, 0.06, 20.0), (12.0, 0.40, 3.5), (-18.0, 0.63, 11.0)))
    )


def stance_window(p: Array) -> Array:
    """1 from 8 % to 92 % of stance, 0 outside stance, smooth between."""
    return smooth_step(p / 0.08) * smooth_step((1.0 - p) / 0.08)


def ground_reaction(p: Array) -> Array:
    """Ground reaction on a right foot in multiples of body weight, laboratory axes, shape (n,
    3)."""

    def hump(peak: float, width: float) -> Array:
        return np.exp(-(((p - peak) / width) ** 2))

    forward = -0.16 * hump(0.18, 0.10) + 0.18 * hump(0.85, 0.09)
    inward = 0.045 * hump(0.22, 0.14) + 0.04 * hump(0.75, 0.14)
    upward = 0.74 + 0.36 * hump(0.22, 0.13) + 0.40 * hump(0.76, 0.13)
    return np.asarray(np.stack([forward, inward, upward], axis=-1) * stance_window(p)[:, None])


def foot_path(c: Array, stride: float) -> tuple[Array, Array]:
    """Ankle centre [m], shape (n, 3), relative to its place with the foot flat in cycle 0, where
    `stride` [m] is along x; and the foot's pitch [rad] against the floor, toes up positive. In
    stance the foot rolls over its heel, lies flat from 12 % to 60 %, where both pivots give one
    path, and rolls over its ball."""
    inside, at_strike, at_toe_off = np.mod(c, 1.0), np.radians(18.0), np.radians(-58.0)
    heel_rocker = at_strike * (1.0 - smooth_step(inside / (0.12 * STANCE_FRACTION)))
    heel_off = at_toe_off * smooth_step((inside - 0.60 * STANCE_FRACTION) / 0.29)
    pitch = heel_rocker + heel_off + (at_strike - at_toe_off) * smooth_step((inside - 0.67) / 0.33)
    cos, sin, flat = np.cos(pitch), np.sin(pitch), np.zeros_like(pitch)
    # about a pivot that stays where it is when flat; seen from the ankle it turns by -pitch about y
    rolled = [
        np.stack([x - (cos * x - sin * z), flat, z - (sin * x + cos * z)], -1)
        for x, _, z in (HEEL, BALL)
    ]
    on_ball = smooth_step((inside - 0.15) / 0.20) - smooth_step((inside - 0.72) / 0.22)
    path = (1.0 - on_ball)[:, None] * rolled[0] + on_ball[:, None] * rolled[1]
    swung = np.clip((inside - STANCE_FRACTION) / (1.0 - STANCE_FRACTION), 0.0, 1.0)
    path[:, 0] += stride * (np.floor(c) + smooth_step(swung))
    path[:, 2] += 0.04 * 256.0 * (swung * (1.0 - swung)) ** 4
    return path, pitch


@dataclass(frozen=True)
class GaitTrial:
    """A trial of the gait laboratory. Its name and the seed determine everything random."""

    name: str
    seed: int
    walking: WalkingSettings
    condition: Condition = field(default_factory=Condition)

    @cached_property
    def time(self) -> Array:
        """Times [s] of the motion, (n,): whole marker frames, at the motion's rate."""
        rates = self.walking.rates
        frames = round(self.walking.gait.recording_s * rates.points_hz)
        return np.arange(frames * (rates.motion_hz // rates.points_hz)) / rates.motion_hz

    @property
    def body_mass(self) -> float:
        return (
            self.condition.subject and self.condition.subject.body_mass_kg
        ) or self.walking.gait.body_mass_kg

    def random(self, effect: str) -> np.random.Generator:
        return stream(self.seed, self.name, effect)

    def normal(self, effect: str, unit: float = 1.0) -> float:
        """A normal deviate with an effect's standard deviation, in SI units."""
        return unit * float(
            getattr(self.walking.effects, effect).value * self.random(effect).standard_normal()
        )

    def wandering(self, effect: str) -> Array:
        """A smooth deviation of unit standard deviation, (n,): six waves of random size, frequency
        [Hz] and phase."""
        random = self.random(effect)
        sizes = random.standard_normal(6) * np.sqrt(2 / 6)
        pitches, phases = random.uniform(0.3, 4.0, 6), random.uniform(0, 2 * np.pi, 6)
        return np.asarray(np.cos(2 * np.pi * np.outer(self.time, pitches) + phases) @ sizes)


RENDERED_S = 0.1  # time [s] after the onset in which the rendered impedance is fitted


@dataclass(frozen=True)
class Step:
    """One crossing's step on the platform, the same with and without the perturbation."""

    trial: GaitTrial
    heel_strike: float  # Time [s] of heel strike
    stance: float  # Duration [s] of stance
    onset: float  # Time [s] at which the platform starts to move
    command: float  # Time [s] at which the perturbation is commanded
    placement: Array  # Deviation [m] of the foot's place forward, to the left and up, shape (3,)

    @property
    def toe_off(self) -> float:
        """Time [s] at which the foot leaves the platform."""
        return self.heel_strike + self.stance

    def stance_phase(self, time: Array) -> Array:
        """Phase of stance at times [s]: 0 at heel strike, 1 at toe-off."""
        return np.asarray((time - self.heel_strike) / self.stance)

    def cycle_phase(self, time: Array) -> Array:
        """Phase of the gait cycle at times [s]: 0 at the heel strike on the platform, 1 at the
        next."""
        return STANCE_FRACTION * self.stance_phase(time)


def draw_step(trial: GaitTrial) -> Step:
    """Draw a crossing. Each effect has its own random stream."""
    walking, condition, normal = trial.walking, trial.condition, trial.normal
    usual = (condition.subject and condition.subject.stance_s) or walking.gait.stance_s
    stance = usual * (1 + normal("stance_scatter", 0.01))
    heel_strike = walking.gait.heel_strike_s + normal("heel_strike_scatter")
    phase = float(trial.random("perturbation_phase").uniform(*walking.perturbation.stance_phase))
    command = heel_strike + phase * stance
    placement = np.array(
        [normal("placement_forward", 1e-3), normal("placement_sideways", 1e-3), 0.0]
    )
    return Step(
        trial, heel_strike, stance, command + walking.perturbation.latency_s, command, placement
    )


@dataclass(frozen=True)
class PlatformMotion:
    """True motion of the platform."""

    angle: Array  # Dorsiflexion (toes-up) angle [rad], shape (n,)
    shift: Array  # Displacement [m] of the axis of rotation, laboratory axes, shape (n, 3)
    pose: Pose  # Displacement of the platform from where it is at rest
    # Time [s] at which the trigger fires. None if the platform stays at rest
    command: float | None = None
    # Time [s] at which the platform starts to move. None if it stays at rest
    onset: float | None = None


def displaced(angle: Array, shift: Array, walking: WalkingSettings) -> Pose:
    """The platform turned [rad, toes up] about its mediolateral axis through the nominal ankle, and
    shifted [m]."""
    rotation, pivot = rotation_about(1, -angle), nominal_ankle(walking)
    return Pose(rotation, pivot - rotation @ pivot + shift)


def nominal_ankle(walking: WalkingSettings) -> Array:
    """Position [m] of the ankle of a nominally placed flat foot."""
    return np.add(walking.plate.centre_m, [*walking.plate.nominal_ankle_m, ANKLE_HEIGHT])


def resting_platform(trial: GaitTrial) -> PlatformMotion:
    still, unmoved = np.zeros_like(trial.time), np.zeros((len(trial.time), 3))
    return PlatformMotion(still, unmoved, displaced(still, unmoved, trial.walking))


def ramped_platform(
    trial: GaitTrial,
    command: float,
    onset: float,
    back: float,
    size: float = 1.0,
    slowness: float = 1.0,
) -> PlatformMotion:
    """The commanded ramp, `size` times as far and `slowness` times as long, held until the platform
    returns at `back` [s]. One that shifts the ankle backward dorsiflexes it."""
    ramp, angle, shift = (
        trial.walking.perturbation,
        np.zeros_like(trial.time),
        np.zeros((len(trial.time), 3)),
    )
    held = pulse(trial.time, onset, slowness * ramp.rise_s, back, ramp.return_s)
    if ramp.shift_mm is not None:
        shift[:, 0] = size * (-trial.condition.sign * 1e-3 * ramp.shift_mm * held)
    else:
        angle = size * (trial.condition.sign * np.radians(ramp.angle_deg) * held)
    return PlatformMotion(angle, shift, displaced(angle, shift, trial.walking), command, onset)


def unloaded_platform(trial: GaitTrial) -> PlatformMotion:
    """The perturbation of an unloaded platform, with small random variations. Every
    `full_motion_every`-th trial, by its number, then also shifts along all axes and tilts, so that
    all inertial parameters can be estimated."""
    ramp, time, command = trial.walking.perturbation, trial.time, 0.5
    onset = command + ramp.latency_s
    size, slowness = trial.random("unloaded_ramp").uniform([0.85, 0.9], [1.15, 1.3])
    back = onset + 0.5
    motion = ramped_platform(trial, command, onset, back, size, slowness)
    number, every = re.search(r"\d+$", trial.name), trial.walking.plate.full_motion_every
    if not (number and every and int(number.group()) % every == 0):
        return motion
    # a shift along each axis in turn, as fast as the ramp, and a tilt about x that is three times
    # slower
    start, fast = back + ramp.return_s, ramp.rise_s
    shifts = [
        pulse(time, start + k * 3 * fast, 1.5 * fast, start + (k * 3 + 2) * fast, 1.5 * fast)
        for k in range(3)
    ]
    tilt = np.radians(2.0) * pulse(time, start + 9 * fast, 3 * fast, start + 13 * fast, 3 * fast)
    tilted = Pose(
        rotation_about(0, tilt), np.stack(shifts, axis=-1) * np.array([0.012, 0.008, 0.006])
    )
    return replace(motion, pose=tilted.after(motion.pose))
