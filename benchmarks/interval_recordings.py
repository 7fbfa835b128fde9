# SPDX-License-Identifier: Apache-2.0
"""Recordings of a joint that an exact servo moves, for `interval_coverage.py`. They share no code
with the package, its simulator or the other benchmarks.

A command that is constant within each step of 2 kHz goes through four equal real poles. The
response, its velocity and its acceleration are the exact solution, so that

    torque = K theta + K_3 theta^3 + B omega + I alpha + T_C tanh(omega/width) + disturbances

holds at every sample.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Draw = np.random.Generator
FINE_HZ = 2000  # rate at which a motion is made [Hz]
QUICK_HZ, RAMPS_HZ, STEPS_HZ, HAND_HZ = 25.0, 12.0, 6.0, 3.0  # corners of the servo
REST_S = 0.8  # before and after each motion [s]
SLOW_RATE_HZ = 60  # of the slow recorder, whose samples lie between the fine ones
RATES_HZ = (250, 500, 1000)  # of the others; each divides the fine one
LEAN_HZ = 0.15  # both poles of a person's slow push
DISTURBANCES = ("noise", "lean", "hardening", "friction", "coarse")


class Motion(NamedTuple):
    """A command, and the servo that follows it."""

    command: Array  # at the fine rate
    corner_hz: float = QUICK_HZ
    windows: str | None = None  # of the recording [s], which are fitted


class Recording(NamedTuple):
    """What is recorded of a joint, what an ideal bench would record, and the truth."""

    time: Array
    theta: Array
    torque: Array
    true_theta: Array
    true_torque: Array
    windows: str | None
    joint: Array  # K, B and I


def seconds(duration: float) -> Array:
    """Fine times [s]."""
    return np.arange(int(duration * FINE_HZ)) / FINE_HZ


def sines(sizes: ArrayLike, frequencies_hz: ArrayLike, cycles: int) -> Motion:
    """A stepped sine: each size at each frequency, with a rest between sizes."""
    rest = np.zeros(int(0.7 * FINE_HZ))
    parts = [rest]
    for size in np.atleast_1d(sizes):
        for hz in np.atleast_1d(frequencies_hz):
            t = np.arange(round(cycles * FINE_HZ / hz)) / FINE_HZ
            parts.append(size * np.sin(2 * np.pi * hz * t))
        parts.append(rest)
    return Motion(np.concatenate(parts))


def held(levels: Array, holds_s: Array) -> Array:
    """Levels that are held for some times [s]."""
    return np.repeat(levels, (holds_s * FINE_HZ).astype(int))


def band_noise(rng: Draw, duration: float, highest_hz: float = 5.0) -> Array:
    """Noise from 0.3 Hz, whose amplitude falls with the frequency."""
    n = int(duration * FINE_HZ)
    hz = np.fft.rfftfreq(n, 1 / FINE_HZ)
    shape = ((hz > 0.3) & (hz < highest_hz)) / np.maximum(hz, 0.5)
    return np.fft.irfft(np.fft.rfft(rng.normal(size=n)) * shape, n)


def sweep(duration: float) -> Motion:
    """A chirp from 0.4 to 6 Hz, which becomes smaller as it becomes faster."""
    t = seconds(duration)
    hz = 0.4 * (6 / 0.4) ** (t / t[-1])
    return Motion(np.sin(2 * np.pi * np.cumsum(hz) / FINE_HZ) / np.hypot(1, hz / 2.5))


def periods(rng: Draw, period_s: int, number: int) -> Motion:
    """Periods of the odd lines up to 6 Hz, of which one in four is left out."""
    lines = np.arange(3, 6 * period_s, 2)
    lines = lines[rng.random(len(lines)) < 0.75]
    t = np.arange(period_s * FINE_HZ) / FINE_HZ
    phases = rng.uniform(0, 2 * np.pi, len(lines))
    one = np.sin(2 * np.pi / period_s * np.outer(t, lines) + phases) @ (1 / np.sqrt(lines))
    return Motion(np.tile(one, number))


def steps_between_two(rng: Draw) -> Motion:
    return Motion(held(rng.choice([-1.0, 1.0], 100), rng.uniform(0.2, 0.6, 100)), STEPS_HZ)


def steps_of_any_size(rng: Draw) -> Motion:
    return Motion(held(rng.normal(size=90), rng.uniform(0.2, 0.7, 90)), STEPS_HZ)


def hand(rng: Draw) -> Motion:
    """A hand that reaches for random angles and returns in one of four."""
    targets = rng.normal(size=70)
    targets[rng.random(70) < 0.25] = 0.0
    return Motion(held(targets, rng.uniform(0.2, 0.9, 70)), HAND_HZ)


def ramps(rng: Draw) -> Motion:
    """Straight ways between random levels."""
    turns_s = np.cumsum(rng.uniform(0.15, 0.8, 90))
    t = seconds(min(40, turns_s[-1] - 1))
    return Motion(np.interp(t, turns_s, rng.uniform(-1, 1, len(turns_s))), RAMPS_HZ)


def swelling_sine(rng: Draw) -> Motion:
    """A sine of one frequency whose size rises and falls."""
    t = seconds(30)
    swell = 1 + 0.8 * np.sin(2 * np.pi * 0.61 * t + rng.uniform(0, 6))
    return Motion(np.sin(2 * np.pi * 1.7 * t) * swell)


def sines_without_period(rng: Draw) -> Motion:
    """Three sines at once whose frequencies have no common measure."""
    hz = np.array([0.53, 1.37, 3.71])
    phases = rng.uniform(0, 6, 3)
    return Motion(np.sin(2 * np.pi * np.outer(seconds(30), hz) + phases) @ (1 / np.sqrt(hz)))


def bursts(rng: Draw) -> Motion:
    """Four bursts of noise."""
    noise = band_noise(rng, 40)
    t = seconds(40)
    envelope = sum(np.exp(-((t - centre) ** 2)) for centre in rng.uniform(2, 38, 4)) + 0.15
    return Motion(noise * envelope)


# the place of a motion is part of its seed
MOTIONS: dict[str, Callable[[Draw], Motion]] = {
    "stepped sine": lambda _: sines([0.6, 1.2], [0.8, 1.7, 2.6, 3.6, 4.8], 8),
    "multisine": lambda rng: periods(rng, 8, 4),
    "chirp": lambda _: sweep(40),
    "noise": lambda rng: Motion(band_noise(rng, 40)),
    "steps between two levels": steps_between_two,
    "steps of any size": steps_of_any_size,
    "hand": hand,
    "ramps": ramps,
    "two sines": lambda _: sines(1.0, [1.1, 3.3], 12),
    "sines of three cycles": lambda _: sines(1.0, [0.9, 1.6, 2.4, 3.1, 3.9, 4.7], 3),
    "sines of one amplitude": lambda _: sines(1.0, [0.9, 1.8, 2.7, 3.6, 4.5], 10),
    "noise of 4 s": lambda rng: Motion(band_noise(rng, 3.6)),
    "chirp of 9 s": lambda _: sweep(9),
    "noise at 60 Hz": lambda rng: Motion(band_noise(rng, 40, 4.0)),
    "windows": lambda rng: Motion(
        band_noise(rng, 40), windows="1.8-5.1 6.8-8.7 11.8-24.8 26.8-28.4 30.8-39.8"
    ),
    "swelling sine": swelling_sine,
    "sines without a period": sines_without_period,
    "two periods": lambda rng: periods(rng, 5, 2),
    "bursts": bursts,
}


def followed(motion: Motion) -> Array:
    """Angle, velocity and acceleration (3, n) of the servo, exact for a command that is held."""
    p = 2 * np.pi * motion.corner_hz
    # of the states theta^(k)/p^k
    A = p * np.array([[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [-1, -4, -6, -4]])
    system = A, p * np.eye(4)[:, 3:], np.eye(3, 4), np.zeros((3, 1))
    sampled = scipy.signal.cont2discrete(system, 1 / FINE_HZ)[:4]
    numerators, denominator = scipy.signal.ss2tf(*sampled)
    scaled = numerators * p ** np.arange(3.0)[:, None]
    return np.array([scipy.signal.lfilter(each, denominator, motion.command) for each in scaled])


def pink(rng: Draw, n: int, rate_hz: float) -> Array:
    """Noise whose power falls with the frequency, of standard deviation 1."""
    hz = np.maximum(np.fft.rfftfreq(n, 1 / rate_hz), 0.03)
    lines = np.fft.rfft(rng.normal(size=n)) / np.sqrt(hz)
    lines[0] = 0
    x = np.fft.irfft(lines, n)
    return x / x.std()


def lean(rng: Draw, n: int, rate_hz: float) -> Array:
    """A person's slow push of standard deviation 1, begun long before."""
    before = int(20 * rate_hz)
    kept = np.exp(-2 * np.pi * LEAN_HZ / rate_hz)
    x = rng.normal(size=n + before)
    for _ in range(2):
        x = scipy.signal.lfilter([1 - kept], [1, -kept], x)
    return x[before:] / x[before:].std()


def recorded(motion: str, disturbance: str, seed: int) -> Recording:
    """A recording of a joint drawn at random.

    Disturbances are shares of the torque's standard deviation: all have white and flicker noise and
    a drift, and `DISTURBANCES` what its name says beside.
    """
    place = [*MOTIONS].index(motion)
    made = MOTIONS[motion](np.random.default_rng([7, place, seed]))
    rng = np.random.default_rng([11, place, DISTURBANCES.index(disturbance), seed])
    rest = round(REST_S * FINE_HZ)
    states = followed(made._replace(command=np.pad(made.command, rest)))
    states *= np.deg2rad(rng.uniform(2, 4)) / states[0, rest:-rest].std()
    K = float(np.exp(rng.uniform(np.log(20), np.log(1000))))
    I = K / (2 * np.pi * np.exp(rng.uniform(np.log(3), np.log(14)))) ** 2
    B = 2 * rng.uniform(0.15, 1.0) * np.sqrt(K * I)
    linear = np.array([K, B, I]) @ states
    size = linear[rest:-rest].std()

    cubic = friction = leaning = 0.0
    bits = rng.integers(16, 20)
    white, flicker, drift = 0.003, 0.001, 0.003
    match disturbance:
        case "noise":
            white, flicker = 0.005, 0.003
        case "lean":
            leaning, drift = rng.uniform(0.02, 0.04), 0.02
        case "hardening":  # of the spring's torque at the largest angle
            cubic = rng.uniform(0.05, 0.15) * K / np.max(np.abs(states[0])) ** 2
        case "friction":
            friction = rng.uniform(0.02, 0.06) * size
        case "coarse":
            white, flicker = 0.001, 0.0005
            bits = rng.integers(12, 14)
    theta, omega, _ = states
    width = rng.uniform(2e-3, 1.2e-2)  # velocity at which friction changes sign [rad/s]
    torque = linear + cubic * theta**3 + friction * np.tanh(omega / width)

    rate_hz = SLOW_RATE_HZ if motion == "noise at 60 Hz" else int(rng.choice(RATES_HZ))
    n = len(theta) * rate_hz // FINE_HZ
    time = np.arange(n) / rate_hz
    # exact at fine samples, and to 1e-9 between them
    true_theta, true_torque = scipy.interpolate.CubicSpline(
        np.arange(len(theta)) / FINE_HZ, [theta, torque], axis=1
    )(time)
    noise = white * rng.normal(size=n) + flicker * pink(rng, n, rate_hz)
    noise += drift * time / time[-1] + rng.normal()
    if leaning:
        noise += leaning * lean(rng, n, rate_hz)
    step = 2 * np.pi / 2**bits
    zero = rng.uniform(0, step)
    rounded = np.round((true_theta + zero) / step) * step - zero
    measured = true_torque + size * noise
    joint = np.array([K, B, I])
    return Recording(time, rounded, measured, true_theta, true_torque, made.windows, joint)
