# SPDX-License-Identifier: Apache-2.0
"""What a program infers of exact recordings, and how often it is silently wrong.

A servo imposes the angle as a sum of sines, so that velocity, acceleration and torque are exact.
Each case prints how many of its recordings are silent: an estimate is off by more than is needed
and nothing is said, or something is said of a sound recording. The cases and their kinds are those
of an independent statistician; the recordings share no code with the package.

    python benchmarks/statistician/inferred.py [CASE ...]
"""

import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

import osl_analysis as osl
from osl_analysis.signals.device_clock import held_values
from osl_analysis.signals.plateaus import find_leaps

Array = NDArray[np.float64]
NOTHING_STATED = Path(__file__).parent.parent / "nothing_stated.yaml"
DURATION_S = 25.0
NEEDED_OF_B = 0.15  # share by which B may be off; more without a word is silent
SOURCE_HZ = 321.0  # of a torque that a log of 1 kHz repeats


class Joint(NamedTuple):
    """Stiffness, damping and inertia [SI]."""

    K: float = 200.0
    B: float = 3.0
    I: float = 0.05


class Motion(NamedTuple):
    """Times [s], angle, velocity and acceleration of a servo."""

    time: Array
    theta: Array
    omega: Array
    alpha: Array


def sines(hz: Array, degrees: Array, phase: Array, rate_hz: float) -> Motion:
    """A sum of sines, which begins and ends in motion."""
    time = np.arange(round(DURATION_S * rate_hz)) / rate_hz
    turning = np.deg2rad(degrees)[:, None] * np.exp(
        1j * (2 * np.pi * np.outer(hz, time) + phase[:, None])
    )
    derivatives = [((2j * np.pi * hz) ** order @ turning).imag for order in range(3)]
    return Motion(time, *derivatives)


def noise(random: np.random.Generator, rate_hz: float, highest_hz: float = 5.0) -> Motion:
    """Forty sines at random frequencies, with an RMS of 2.5 deg."""
    hz = random.uniform(0.3, highest_hz, 40)
    return sines(hz, np.full(40, 2.5 * np.sqrt(2 / 40)), random.uniform(0, 6.3, 40), rate_hz)


def torque_of(joint: Joint, motion: Motion) -> Array:
    """Torque of Eq. 15."""
    return joint.K * motion.theta + joint.B * motion.omega + joint.I * motion.alpha


def rounded(angle: Array, bits: int) -> Array:
    """An angle as an encoder of so many bits reads it."""
    step = 2 * np.pi / 2**bits
    return step * np.rint(angle / step)


class Said(NamedTuple):
    """K, B, I of a recording, and the sources of what is said of them."""

    estimates: Joint
    doubts: frozenset[str]
    notes: frozenset[str]
    unchecked: frozenset[str]


def fitted(time: Array, theta: Array, torque: Array) -> Said:
    """What the package says of a recording of which nothing is stated."""
    samples = pl.DataFrame({"time": time, "theta": theta, "torque": torque})
    fit = osl.fit(osl.Trial("exact", samples), parameters=None, config=NOTHING_STATED)
    by_grade: dict[str, set[str]] = {"doubts": set(), "notes": set(), "not checked": set()}
    for finding in fit.findings[-1]:
        by_grade.setdefault(str(finding.grade), set()).add(str(finding.source))
    said = [frozenset(by_grade[grade]) for grade in ("doubts", "notes", "not checked")]
    return Said(Joint(fit.K, fit.B, fit.I), *said)


def is_off(said: Said, joint: Joint) -> bool:
    return abs(said.estimates.B / joint.B - 1) > NEEDED_OF_B


def late_torque() -> Iterator[bool]:
    """A torque of a slower source, late by 1 to 10 ms: neither doubted nor named as not checked."""
    joint = Joint()
    for seed in range(3):
        random = np.random.default_rng([1, seed])
        motion = noise(random, 1000.0)
        torque = CubicSpline(motion.time, torque_of(joint, motion))
        for late_s in 1e-3 * np.array([1, 2, 3, 4, 5, 6, 7, 8, 10]):
            value = np.floor(motion.time * SOURCE_HZ + 1e-9).astype(int)
            taken_s = np.clip(np.arange(value[-1] + 1) / SOURCE_HZ - late_s, 0, None)
            values = torque(taken_s) + 0.02 * random.standard_normal(taken_s.size)
            said = fitted(motion.time, rounded(motion.theta, 16), values[value])
            is_told = said.doubts or "late_torque" in said.unchecked
            yield is_off(said, joint) and not is_told


def coarse_encoder() -> Iterator[bool]:
    """A coarse and noisy angle that is taken for a channel of a slower source."""
    for rate_hz in (500.0, 1000.0, 2000.0):
        for seed in range(6):
            random = np.random.default_rng([2, seed])
            theta = noise(random, rate_hz, highest_hz=random.uniform(1.5, 6.0)).theta
            for bits in (12, 13, 14, 15, 16):
                step = 2 * np.pi / 2**bits
                for noise_steps in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0):
                    with_noise = theta + noise_steps * step * random.standard_normal(theta.size)
                    yield held_values(rounded(with_noise, bits), 1 / rate_hz) is not None


def backlash() -> Iterator[bool]:
    """A spring behind a gap of 2 to 40 % of the angle's SD that is not doubted."""
    joint = Joint()
    for seed in range(3):
        random = np.random.default_rng([3, seed])
        motion = noise(random, 250.0)
        for share in (0.02, 0.05, 0.09, 0.1, 0.15, 0.25, 0.4):
            half = share * motion.theta.std() / 2
            behind = [0.0]
            for angle in motion.theta.tolist():
                behind.append(min(max(behind[-1], angle - half), angle + half))
            torque = torque_of(joint, motion) + joint.K * (np.array(behind[1:]) - motion.theta)
            torque += 0.003 * torque.std() * random.standard_normal(torque.size)
            said = fitted(motion.time, rounded(motion.theta, 17), torque)
            yield is_off(said, joint) and not said.doubts


def two_sines() -> Iterator[bool]:
    """An exact joint under two sines of which a property or a fault is named."""
    pairs = (((5, 2), (1.0, 2.7)), ((5, 3), (0.8, 2.1)), ((4, 2), (1.3, 4.1)))
    for joint in (Joint(), Joint(60.0, 0.8, 0.01)):
        for degrees, hz in pairs:
            motion = sines(np.array(hz), np.array(degrees), np.zeros(2), 500.0)
            for seed in range(20):
                white = np.random.default_rng([4, seed]).standard_normal(motion.time.size)
                said = fitted(motion.time, motion.theta, torque_of(joint, motion) + 0.05 * white)
                yield bool(said.doubts or said.notes)


def rest() -> Iterator[bool]:
    """A motion before nine tenths of rest that has leaps."""
    for rate_hz in (100.0, 500.0, 1000.0):
        for seed in range(6):
            motion = noise(np.random.default_rng([5, seed]), rate_hz)
            faded = motion.theta * np.sin(np.pi * motion.time / motion.time[-1]) ** 2
            theta = rounded(np.pad(faded, (0, 9 * faded.size)), 16)
            yield find_leaps(np.arange(theta.size) / rate_hz, theta).size > 0


CASES: dict[str, Callable[[], Iterator[bool]]] = {
    case.__name__: case for case in (late_torque, coarse_encoder, backlash, two_sines, rest)
}


def main() -> None:
    warnings.simplefilter("ignore")
    for name in sys.argv[1:] or CASES:
        wrong = list(CASES[name]())
        print(f"{name}: {sum(wrong)} of {len(wrong)}: {CASES[name].__doc__}", flush=True)


if __name__ == "__main__":
    main()
