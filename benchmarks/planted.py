# SPDX-License-Identifier: Apache-2.0
"""Recordings of a joint whose K, B and I are known, with one cause of error planted: numpy and
splines, nothing of the project, neither its simulator nor its fits.

A motion is smooth samples at 1 kHz; the quintic spline through them is what moved the joint, so
that velocity and acceleration are exact. A cause changes what the torque is, or what the recorder
makes of angle, torque and stamps.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.linalg import expm
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, lfilter, sosfiltfilt

Array = NDArray[np.float64]
RATE = 1000.0  # Hz
DEG = np.pi / 180


@dataclass(frozen=True)
class Joint:
    """Second-order joint: torque = K theta + B omega + I alpha."""

    K: float = 300.0  # N*m/rad
    B: float = 5.0  # N*m*s/rad
    I: float = 0.02  # kg*m^2


@dataclass(frozen=True)
class Moved:
    """A motion (n,): time [s], angle [rad], velocity and acceleration."""

    time: Array
    theta: Array
    omega: Array
    alpha: Array

    def torque(self, joint: Joint) -> Array:
        return joint.K * self.theta + joint.B * self.omega + joint.I * self.alpha


def smooth(theta: Array) -> Moved:
    """The motion of the quintic spline through samples."""
    time = np.arange(len(theta)) / RATE
    spline = make_interp_spline(time, theta, 5)
    return Moved(time, theta, spline(time, 1), spline(time, 2))


def stepped_sine(
    rng: np.random.Generator, hz: tuple[float, ...] = (1, 2, 3, 4, 5), cycles: int = 12
) -> Moved:
    """2, 4 and 6 deg at each frequency, with half a second of rest at both ends."""
    parts = [np.zeros(500)]
    for size in (2.0, 4.0, 6.0):
        for f in hz:
            n = round(cycles * RATE / f)
            parts.append(size * DEG * np.sin(2 * np.pi * f * np.arange(n) / RATE))
    return smooth(gaussian_filter1d(np.concatenate([*parts, np.zeros(500)]), 8.0, mode="nearest"))


def slow_sine(rng: np.random.Generator) -> Moved:
    """One amplitude from 0.1 to 0.5 Hz."""
    parts = [
        np.sin(2 * np.pi * f * np.arange(round(3 * RATE / f)) / RATE)
        for f in (0.1, 0.2, 0.3, 0.4, 0.5)
    ]
    return smooth(gaussian_filter1d(10 * DEG * np.concatenate(parts), 8.0, mode="nearest"))


def two_sines(rng: np.random.Generator, seconds: float = 20.0) -> Moved:
    """At once, which tell no fourth derivative from the angle and its second one."""
    x = 2 * np.pi * np.arange(round(seconds * RATE)) / RATE
    return smooth(0.05 * np.sin(1.3 * x) + 0.03 * np.sin(3.1 * x))


def chirp(rng: np.random.Generator, seconds: float = 60.0) -> Moved:
    """0.4 to 7 Hz, smaller as it becomes faster."""
    t = np.arange(round(seconds * RATE)) / RATE
    f = 0.4 + 6.6 * (t / seconds) ** 1.5
    # a fade without a corner, at which the velocity and with it the torque would leap
    fade = np.sin(np.pi / 2 * np.minimum(1, np.minimum(t, seconds - t))) ** 2
    return smooth(
        5 * DEG * fade * np.sin(2 * np.pi * np.cumsum(f) / RATE) / np.sqrt(1 + (f / 2.5) ** 2)
    )


def noise(rng: np.random.Generator, seconds: float = 60.0, highest: float = 6.0) -> Moved:
    """Noise of 0.3 to 6 Hz, 2.5 deg RMS."""
    n = 2 * round(seconds * RATE)
    f = np.fft.rfftfreq(n, 1 / RATE)
    shape = (
        1
        / (1 + (f / highest) ** 12)
        / (1 + (0.3 / np.maximum(f, 1e-9)) ** 8)
        / np.sqrt(1 + (f / 2) ** 2)
    )
    x = np.fft.irfft(np.fft.rfft(rng.normal(size=n)) * shape, n)[: n // 2]
    return smooth(2.5 * DEG * x / x.std())


def multisine(rng: np.random.Generator) -> Moved:
    """Eight periods of 8 s, odd lines to 6 Hz with random phases, 2.5 deg RMS."""
    t = np.arange(round(64 * RATE)) / RATE
    lines = np.arange(3, 49, 2)
    phases = rng.uniform(0, 7, 99)
    x = sum(
        np.sin(2 * np.pi * line / 8 * t + phase) / line**0.4
        for line, phase in zip(lines, phases, strict=False)
    )
    return smooth(2.5 * DEG * x / np.std(x))


def hand(rng: np.random.Generator, seconds: float = 60.0) -> Moved:
    """Moves of least jerk between random angles, each in 0.15 to 0.6 s."""
    parts = [np.zeros(1)]
    at = 0.0
    while sum(map(len, parts)) < seconds * RATE:
        target = rng.uniform(-6, 6) * DEG
        n = round(rng.uniform(0.15, 0.6) * RATE)
        u = np.arange(1, n + 1) / n
        parts.append(at + (target - at) * u**3 * (10 - 15 * u + 6 * u**2))
        at = target
    return smooth(gaussian_filter1d(np.concatenate(parts), 15.0, mode="nearest"))


def ramps(rng: np.random.Generator, seconds: float = 60.0) -> Moved:
    """Ramps between random levels, with short holds."""
    corner_times = [0.0]
    corner_angles = [0.0]
    while corner_times[-1] < seconds:
        level = rng.uniform(-6, 6) * DEG
        for shortest_s, longest_s in ((0.15, 0.5), (0.05, 0.3)):  # of the ramp, of the hold
            corner_times.append(corner_times[-1] + rng.uniform(shortest_s, longest_s))
            corner_angles.append(level)
    time = np.arange(round(seconds * RATE)) / RATE
    angle = np.interp(time, corner_times, corner_angles)
    return smooth(gaussian_filter1d(angle, 10.0, mode="nearest"))


def binary(
    rng: np.random.Generator, order: int = 4, corner: float = 12.8, seconds: float = 60.0
) -> Moved:
    """Random steps between -2.5 and 2.5 deg through equal lags, exact at the samples."""
    n = round(seconds * RATE)
    w = 2 * np.pi * corner
    holds = rng.integers(125, 500, n // 125)
    u = np.repeat(2.5 * DEG * np.where(rng.random(len(holds)) < 0.5, -1.0, 1.0), holds)[:n]
    A = w * (np.eye(order, k=-1) - np.eye(order))
    step = expm(np.block([[A, w * np.eye(order)[:, :1]], [np.zeros((1, order + 1))]]) / RATE)
    x = np.zeros((n, order))
    for k in range(1, n):
        x[k] = step[:order, :order] @ x[k - 1] + step[:order, order] * u[k - 1]
    before = np.column_stack([u, x])
    theta = before[:, -1]
    omega = w * (before[:, -2] - before[:, -1])
    alpha = w**2 * (before[:, -3] - 2 * before[:, -2] + before[:, -1])
    return Moved(np.arange(n) / RATE, theta, omega, alpha)


MOTIONS: Mapping[str, Callable[[np.random.Generator], Moved]] = {
    "stepped sine": stepped_sine,
    "chirp": chirp,
    "noise": noise,
    "multisine": multisine,
    "hand": hand,
    "binary steps": binary,
}
OTHER_MOTIONS: Mapping[str, Callable[[np.random.Generator], Moved]] = {
    "slow sine": slow_sine,
    "ramps": ramps,
    "two sines": two_sines,
    "noise to 20 Hz": lambda rng: noise(rng, highest=20.0),
}


@cache
def moved(motion: str, seed: int) -> Moved:
    return {**MOTIONS, **OTHER_MOTIONS}[motion](np.random.default_rng([seed, 7]))


@dataclass(frozen=True)
class Taken:
    """What the recorder is given, at the samples: true angle and torque, and what it makes of
    them."""

    theta: Array
    torque: Array
    torque_time: Array | None = None  # stamps of the torque [s] where another device has it
    clip: float = np.inf  # N*m, beyond which the load cell stands still, before its noise


Plant = Callable[[Moved, Joint, float], Taken]
"""What a cause of some size makes of a motion of a joint."""


def changed_torque(change: Callable[[Moved, Array, float], Array]) -> Plant:
    """A cause that makes another torque of the joint's, by motion, torque and size."""
    return lambda motion, joint, size: Taken(
        motion.theta, change(motion, motion.torque(joint), size)
    )


def added_torque(part: Callable[[Moved, float], Array]) -> Plant:
    """A cause that adds to the joint's torque, by motion and size."""
    return lambda motion, joint, size: Taken(
        motion.theta, motion.torque(joint) + part(motion, size)
    )


@changed_torque
def nothing(motion: Moved, torque: Array, size: float) -> Array:
    """No cause."""
    return torque


# Torque or angle that is late, or behind a filter


def delayed(motion: Moved, torque: Array, delay_s: Array | float) -> Array:
    """A torque that is late by some time [s]."""
    before = np.clip(motion.time - delay_s, 0, motion.time[-1])
    return np.asarray(make_interp_spline(motion.time, torque, 5)(before))


late_torque = changed_torque(delayed)


@changed_torque
def late_angle(motion: Moved, torque: Array, delay_s: float) -> Array:
    """The angle is late by some time [s]: the torque is early."""
    return delayed(motion, torque, -delay_s)


@changed_torque
def late_in_second_half(motion: Moved, torque: Array, delay_s: float) -> Array:
    """The torque is late by some time [s] from the middle of the recording on."""
    return delayed(motion, torque, delay_s * from_share_on(motion, 0.5))


@changed_torque
def one_clock_fast(motion: Moved, torque: Array, ppm: float) -> Array:
    """The torque's stamps are those of the angle, and its clock gains."""
    return delayed(motion, torque, 1e-6 * ppm * motion.time)


def two_clocks(motion: Moved, joint: Joint, ppm: float) -> Taken:
    """The torque is sampled 0.31 ms after the angle, by a clock that gains."""
    after_theta = np.minimum(motion.time + 0.31e-3, motion.time[-1])
    torque = make_interp_spline(motion.time, motion.torque(joint), 5)(after_theta)
    return Taken(motion.theta, torque, (motion.time + 0.31e-3) * (1 + 1e-6 * ppm))


def filtered(
    torque: Array, response: Callable[[NDArray[np.complex128]], NDArray[np.complex128]]
) -> Array:
    """Torque behind a filter of the path, of which the response at s [rad/s] is given; the ends are
    mirrored."""
    around = np.pad(torque, 3000, mode="reflect")
    s = 2j * np.pi * np.fft.rfftfreq(len(around), 1 / RATE)
    return np.asarray(np.fft.irfft(np.fft.rfft(around) * response(s), len(around))[3000:-3000])


@changed_torque
def first_order(motion: Moved, torque: Array, time_constant_s: float) -> Array:
    """A low-pass of first order."""
    return filtered(torque, lambda s: 1 / (1 + time_constant_s * s))


@changed_torque
def moving_average(motion: Moved, torque: Array, seconds: float) -> Array:
    """The mean of the last seconds."""

    def response(s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        return np.exp(-seconds * s / 2) * np.sinc(seconds * s.imag / (2 * np.pi))

    return filtered(torque, response)


@changed_torque
def resonating_path(motion: Moved, torque: Array, period_s: float) -> Array:
    """A path that resonates with some period [s], with a tenth of the critical damping over pi."""

    def response(s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        return 1 / (1 + 0.1 / np.pi * period_s * s + (period_s * s / (2 * np.pi)) ** 2)

    return filtered(torque, response)


@changed_torque
def held_torque(motion: Moved, torque: Array, hz: float) -> Array:
    """The recorder holds the values of a source at `hz`."""
    samples = np.floor(np.arange(len(torque)) * hz / RATE)
    return np.asarray(torque[np.floor(samples * RATE / hz + 1e-6).astype(int)])


@changed_torque
def larger_torque(motion: Moved, torque: Array, share: float) -> Array:
    """The torque is larger by a share."""
    return torque * (1 + share)


@changed_torque
def negative_torque(motion: Moved, torque: Array, size: float) -> Array:
    """The torque has the wrong sign."""
    return -torque


def clipped(motion: Moved, joint: Joint, share: float) -> Taken:
    """The largest share of the torque's range is missing, on both sides."""
    torque = motion.torque(joint)
    return Taken(motion.theta, torque, clip=(1 - share) * float(np.abs(torque).max()))


def in_series(motion: Moved, joint: Joint, compliance: float) -> Taken:
    """The bench's angle is the joint's and what the torque winds up in a spring [rad/(N*m)]."""
    torque = motion.torque(joint)
    return Taken(motion.theta + compliance * torque, torque)


# Friction and backlash


SIGN_WIDTH = 2e-3  # rad/s, in which Coulomb friction turns its sign


@added_torque
def coulomb_friction(motion: Moved, size: float) -> Array:
    """Coulomb friction [N*m]."""
    return size * np.tanh(motion.omega / SIGN_WIDTH)


@added_torque
def bristle_friction(motion: Moved, size: float) -> Array:
    """Friction [N*m] that a bristle winds up over 0.1 mrad before it slides, and that stays at rest
    (Dahl)."""
    torque = [0.0]
    for step in np.diff(motion.theta).tolist():
        slides = float(np.sign(step))
        torque.append(slides + (torque[-1] - slides) * float(np.exp(-abs(step) / 1e-4)))
    return size * np.array(torque)


def with_spring_at(motion: Moved, joint: Joint, angle: Array) -> Taken:
    """A joint whose stiffness feels another angle (n,) than its damping and inertia."""
    without_spring = motion.torque(replace(joint, K=0.0))
    return Taken(motion.theta, without_spring + joint.K * angle)


def backlash(motion: Moved, joint: Joint, gap: float) -> Taken:
    """A gap [rad] about zero within which the spring gives no torque."""
    return with_spring_at(motion, joint, motion.theta - np.clip(motion.theta, -gap / 2, gap / 2))


def play_with_hysteresis(motion: Moved, joint: Joint, gap: float) -> Taken:
    """The spring follows the angle when that has taken up a gap [rad]."""
    followed = np.empty_like(motion.theta)
    at = 0.0
    for k, theta in enumerate(motion.theta.tolist()):
        at = min(max(at, theta - gap / 2), theta + gap / 2)
        followed[k] = at
    return with_spring_at(motion, joint, followed)


# Springs and dampers that are not linear, or change


@added_torque
def hardening_spring(motion: Moved, size: float) -> Array:
    """A torque with the third power of the angle [N*m/rad^3]."""
    return size * motion.theta**3


@added_torque
def quadratic_damping(motion: Moved, size: float) -> Array:
    """A torque with the square of the velocity [N*m*s^2/rad^2]."""
    return size * motion.omega * np.abs(motion.omega)


@added_torque
def stiffness_by_direction(motion: Moved, share: float) -> Array:
    """K of positive and negative angles differ by a share."""
    return 300.0 * share / 2 * np.abs(motion.theta)


@added_torque
def damping_by_direction(motion: Moved, share: float) -> Array:
    """B of positive and negative velocities differ by a share."""
    return 5.0 * share / 2 * np.abs(motion.omega)


@added_torque
def warming_spring(motion: Moved, share: float) -> Array:
    """K falls steadily by a share."""
    return 300.0 * share * -(motion.time / motion.time[-1]) * motion.theta


@added_torque
def stepping_spring(motion: Moved, share: float) -> Array:
    """K falls by a share at 60 % of the recording."""
    return 300.0 * share * -from_share_on(motion, 0.6) * motion.theta


def from_share_on(motion: Moved, share: float) -> Array:
    """1 from a share of the recording on, 0 before (n,)."""
    return np.where(motion.time > share * motion.time[-1], 1.0, 0.0)


# What else acts on the joint or the load cell


@added_torque
def gravity(motion: Moved, size: float) -> Array:
    """The weight of a fixture [N*m], which turns with the joint."""
    return size * np.sin(motion.theta)


@added_torque
def reflex(motion: Moved, gain: float) -> Array:
    """A muscle that resists the stretch of 40 ms before [N*m*s/rad]."""
    stretch = np.interp(motion.time - 0.04, motion.time, np.maximum(motion.omega, 0.0))
    return gain * np.asarray(lfilter(*butter(2, 6.0, fs=RATE), stretch))


@added_torque
def drifting_load_cell(motion: Moved, size: float) -> Array:
    """An offset of 3 N*m that dies away in 20 s."""
    return 3 * np.exp(-motion.time / 20)


@added_torque
def leaning_person(motion: Moved, size: float) -> Array:
    """A person leans on the bench to and fro, slowly, from 12 s on."""
    to_and_fro = np.sign(np.sin(2 * np.pi * motion.time / 23)) * (motion.time > 12)
    return 2.0 * gaussian_filter1d(to_and_fro, 600.0)


@added_torque
def little_friction(motion: Moved, size: float) -> Array:
    """Coulomb friction of 0.15 N*m."""
    return 0.15 * np.tanh(motion.omega / SIGN_WIDTH)


@dataclass(frozen=True)
class Cause:
    """A planted cause: what it does for a size, the size at which it was reported, and the names
    that are right."""

    name: str
    plant: Plant
    reported: float
    right: tuple[str, ...]
    unit: str = ""
    sized: bool = True
    recorder: Mapping[str, float] = field(default_factory=dict)
    motions: tuple[str, ...] = tuple(MOTIONS)
    needs_gains: bool = False  # nothing in the recording can tell
    told: str = ""  # what sound recordings, too, are not checked for, where that is this very cause
    joint: Joint = Joint()


LATE = (
    "late torque",
    "late torque or yielding bench",
    "late torque or drivetrain",
    "yielding bench",
)
PATH = (*LATE, "torque path", "response of higher order")
TIME = ("stiffness that changes", "clocks that drift apart", "change over time")
SLOW = {"slow_noise": 0.03}
FRICTION = ("friction",)
WEIGHT = "what turns with the joint behind the load cell"
LATENESS = "late torque"
UNTOLD = "friction"
CAUSES = [
    Cause("late torque", late_torque, 2e-3, PATH, "s", told=LATENESS),
    Cause("late angle", late_angle, 2e-3, PATH, "s", told=LATENESS),
    Cause("late torque, slow noise", late_torque, 5e-3, PATH, "s", recorder=SLOW, told=LATENESS),
    Cause(
        "low-pass, first order",
        first_order,
        8e-3,
        PATH,
        "s",
        told=LATENESS,
    ),
    Cause(
        "moving average",
        moving_average,
        20e-3,
        PATH,
        "s",
        told=LATENESS,
    ),
    Cause("frame in series", in_series, 1 / 3000, PATH, "rad/(N*m)"),
    Cause("belt in series", in_series, 1 / 685, PATH, "rad/(N*m)", sized=False),
    Cause("resonance of the path", resonating_path, 1 / 15, PATH, "s"),
    Cause("clocks apart, two streams", two_clocks, 50.0, (*TIME, "refused"), "ppm"),
    Cause(
        "clocks apart, one file",
        one_clock_fast,
        200.0,
        TIME,
        "ppm",
    ),
    Cause("K warms up", warming_spring, 0.05, TIME, "of K"),
    Cause("K steps", stepping_spring, 0.15, TIME, "of K"),
    Cause(
        "late from half on",
        late_in_second_half,
        2e-3,
        (*TIME, *LATE),
        "s",
    ),
    Cause(
        "Coulomb friction",
        coulomb_friction,
        0.5,
        FRICTION,
        "N*m",
        told=UNTOLD,
    ),
    Cause(
        "bristle friction",
        bristle_friction,
        0.3,
        FRICTION,
        "N*m",
        motions=(*MOTIONS, "ramps"),
        told=UNTOLD,
    ),
    Cause(
        "backlash, no hysteresis",
        backlash,
        0.1 * DEG,
        (
            "backlash",
            "backlash, speed or direction",
            "K that changes with amplitude beyond friction",
            *FRICTION,
        ),
        "rad",
    ),
    Cause(
        "backlash with hysteresis",
        play_with_hysteresis,
        0.15 * DEG,
        ("backlash", "backlash, speed or direction", *FRICTION),
        "rad",
    ),
    Cause(
        "backlash with hysteresis, slow noise",
        play_with_hysteresis,
        6e-3,
        ("backlash", "backlash, speed or direction", *FRICTION),
        "rad",
        sized=False,
        recorder=SLOW,
    ),
    Cause(
        "hardening spring",
        hardening_spring,
        2200.0,
        ("K that changes with amplitude beyond friction",),
        "N*m/rad^3",
    ),
    Cause(
        "hardening spring, slow noise",
        hardening_spring,
        2200.0,
        ("K that changes with amplitude beyond friction",),
        "N*m/rad^3",
        recorder=SLOW,
    ),
    Cause(
        "clipped torque",
        clipped,
        0.3,
        ("clipped signal", "K that changes with amplitude beyond friction"),
        "of the range",
    ),
    Cause(
        "quadratic damping",
        quadratic_damping,
        1.5,
        ("damping that depends on speed", "backlash, speed or direction"),
        "N*m*s^2/rad^2",
    ),
    Cause(
        "K by direction",
        stiffness_by_direction,
        0.3,
        ("backlash, speed or direction", "K that changes with amplitude beyond friction"),
        "of K",
    ),
    Cause(
        "B by direction",
        damping_by_direction,
        0.3,
        ("backlash, speed or direction",),
        "of B",
    ),
    Cause("torque held at 50 Hz", held_torque, 50.0, PATH, "Hz", sized=False),
    Cause("torque held at 333 Hz", held_torque, 333.0, PATH, "Hz", sized=False),
    Cause(
        "torque × 1.1",
        larger_torque,
        0.1,
        ("wrong gain", "unlikely size", "another unit"),
        "of 1",
        needs_gains=True,
    ),
    Cause(
        "torque × 1.3558",
        larger_torque,
        0.3558,
        ("unlikely size", "another unit"),
        "of 1",
        sized=False,
        needs_gains=True,
    ),
    Cause("torque of the wrong sign", negative_torque, 1.0, ("refused",), sized=False),
    Cause(
        "gravity of a fixture",
        gravity,
        1.0,
        ("weight on the joint",),
        "N*m",
        told=WEIGHT,
    ),
    Cause("reflex", reflex, 1.0, (), "N*m*s/rad"),
    Cause(
        "friction, noise to 20 Hz",
        coulomb_friction,
        0.5,
        FRICTION,
        "N*m",
        sized=False,
        motions=("noise to 20 Hz",),
    ),
]
SOUND = [
    Cause("sound", nothing, 0.0, ()),
    Cause("sound, 18 bits", nothing, 0.0, (), recorder={"bits": 18}),
    Cause("sound, 50 µs of true jitter", nothing, 0.0, (), recorder={"jitter": 50e-6}),
    Cause("sound, 300 µs of true jitter", nothing, 0.0, (), recorder={"jitter": 300e-6}),
    Cause("sound, slow noise of the torque", nothing, 0.0, (), recorder=SLOW),
    Cause(
        "sound, begins and ends in motion", nothing, 0.0, (), recorder={"bits": 18, "kept_s": 20.0}
    ),
    Cause("sound, load cell drifts by 3 N·m", drifting_load_cell, 0.0, ()),
    Cause(
        "sound, a person leans on the bench",
        leaning_person,
        0.0,
        (),
    ),
    Cause(
        "sound, Coulomb friction of 0.15 N·m",
        little_friction,
        0.0,
        # where the motion is slow it moves B by more than is needed, which is true
        FRICTION,
    ),
    Cause("sound, pure damper", nothing, 0.0, (), joint=Joint(0.0, 5.0, 0.02)),
    Cause("sound, K = -50", nothing, 0.0, (), joint=Joint(-50.0, 5.0, 0.02)),
    Cause("sound, K = 2000", nothing, 0.0, (), joint=Joint(2000.0, 10.0, 0.02)),
    Cause("sound, K = 20", nothing, 0.0, (), joint=Joint(20.0, 0.5, 0.02)),
    Cause("sound, slow sine and ramps", nothing, 0.0, (), motions=("slow sine", "ramps")),
    Cause("sound, two sines", nothing, 0.0, (), motions=("two sines",), recorder={"bits": 18}),
]


USUAL_RECORDER = {
    "bits": 14.0,  # of the encoder, per turn
    "white": 0.05,  # SD of the load cell's noise [N*m]
    "slow_noise": 0.0,  # SD of noise below 2 Hz [N*m]
    "jitter": 0.0,  # SD of the sampling instants [s]
    "kept_s": 0.0,  # length of the middle part that is kept [s]; 0: all
}
LOAD_CELL_OFFSET = 0.3  # [N*m]


def recording(cause: Cause, size: float, motion: str, seed: int) -> dict[str, Any]:
    """Columns of a recording: `time` [s], `theta` [rad] and `torque` [N*m], each with a null where
    it has no sample."""
    course = moved(motion, seed)
    rng = np.random.default_rng([seed, 11])
    taken = cause.plant(course, cause.joint, size)
    recorder = {**USUAL_RECORDER, **cause.recorder}
    time = course.time
    theta = taken.theta
    torque = np.clip(taken.torque, -taken.clip, taken.clip)
    if recorder["jitter"]:
        jitter = recorder["jitter"] * np.clip(rng.normal(size=len(course.time)), -3, 3)
        time = np.sort(course.time + jitter)
        theta = make_interp_spline(course.time, theta, 5)(time)
        torque = make_interp_spline(course.time, torque, 5)(time)
    torque = torque + LOAD_CELL_OFFSET + recorder["white"] * rng.normal(size=len(time))
    if recorder["slow_noise"]:
        slow = lfilter([1.0], [1, -np.exp(-2 * np.pi * 2 / RATE)], rng.normal(size=len(time)))
        torque = torque + recorder["slow_noise"] * slow / slow.std()
    step = 2 * np.pi / 2 ** recorder["bits"]
    zero = rng.uniform(0, step)
    theta = np.round((theta + zero) / step) * step - zero
    if recorder["kept_s"]:
        is_kept = np.abs(time - time.mean()) < recorder["kept_s"] / 2
        time = time[is_kept]
        theta = theta[is_kept]
        torque = torque[is_kept]
    if taken.torque_time is None:
        return {"time": time, "theta": theta, "torque": torque}

    # two streams, each with its own stamps
    stamps = np.concatenate([time, taken.torque_time])
    order = np.argsort(stamps, kind="stable")
    empty = [None] * len(time)
    angles = [*theta.tolist(), *empty]
    torques = [*empty, *torque.tolist()]
    return {
        "time": stamps[order],
        "theta": [angles[k] for k in order],
        "torque": [torques[k] for k in order],
    }


def plain_fit(theta: Array, torque: Array) -> Array:
    """K, B and I of the textbook: one low-pass of 15 Hz on both, central differences, least
    squares."""
    low_pass = butter(4, 15.0, fs=RATE, output="sos")
    theta = sosfiltfilt(low_pass, theta)
    torque = sosfiltfilt(low_pass, torque)
    omega = np.gradient(theta, 1 / RATE)
    X = np.column_stack(
        [
            theta,
            omega,
            np.gradient(omega, 1 / RATE),
            np.ones(len(theta)),
            np.linspace(-1, 1, len(theta)),
        ]
    )
    return np.asarray(np.linalg.lstsq(X[200:-200:4], torque[200:-200:4], rcond=None)[0][:3])


def moves(cause: Cause, size: float, motion: str, half: Array) -> float:
    """By how many half-widths (3,) a cause moves K, B or I, whichever it moves most."""
    course = moved(motion, 0)
    taken = cause.plant(course, cause.joint, size)
    torque = np.clip(taken.torque, -taken.clip, taken.clip)
    if taken.torque_time is not None:
        torque = np.interp(course.time, taken.torque_time, torque)
    moved_by = plain_fit(taken.theta, torque) - clean_fit(motion, cause.joint)
    return float(np.abs(moved_by / half).max())


@cache
def clean_fit(motion: str, joint: Joint) -> Array:
    course = moved(motion, 0)
    return plain_fit(course.theta, course.torque(joint))


def size_that_moves(cause: Cause, motion: str, half: Array, times: float) -> float | None:
    """The size of a cause that moves an estimate by some half-widths, to a fifth of that; None
    where none does."""
    size = cause.reported
    power = 1.0  # of the size, by which the estimate moves; learnt from two sizes
    at = moves(cause, size, motion, half)
    for _ in range(10):
        if at <= 0 or abs(np.log(at / times)) < 0.2:
            break
        size_before = size
        at_before = at
        size *= float(np.clip((times / at) ** (1 / power), 0.02, 20))
        at = moves(cause, size, motion, half)
        if at > 0 and at != at_before:
            slope = np.log(at / at_before) / np.log(size / size_before)
            power = float(np.clip(slope, 0.4, 4))
    return size if at > 0 and abs(np.log(at / times)) < 0.3 else None
