# SPDX-License-Identifier: Apache-2.0
"""Recordings of joints whose truth is known, by formulas alone: a second generator, on whose
recordings no method here was tuned.

The drive is so stiff that it prescribes the angle, whose derivatives are written down. The torque
follows from angle, velocity and acceleration without an integration; the joint, the rate and the
noise of each recording are drawn anew.
"""

from dataclasses import dataclass, field

import numpy as np

FINE = 16_000  # Hz, on which signals are written down before they are sampled
RATES = (400, 500, 800)  # Hz of recordings
DEG = np.pi / 180
STIFFNESS = 60.0, 500.0  # N*m/rad
NATURAL_HZ, DAMPING_RATIO = (12.0, 25.0), (0.1, 0.5)
SPACING_S = 0.15  # between the middles of bursts
BURST_HZ, BURST_S = (0.3, 6.0), (0.15, 0.8)  # frequencies and lengths of bursts
MOVE_S, HOLD_S = (0.15, 0.9), (0.05, 0.5)  # of ramps
RMS_DEG = 1.5, 4.0
NOISE = 0.002, 0.01  # shares of the torque's SD
SLOW_S = 2.0  # time constant of slow torque
LARGEST_DEVIATION = 2.0  # SDs of the torque at which its channel is clipped


@dataclass(frozen=True)
class Case:
    """A motion, and what joint or recorder do beside K, B and I."""

    case: str
    motion: str
    announce: str = ""
    bristles: float = 0.0  # share of the torque's SD that friction has
    hardening: float = 0.0  # share by which K rises at twice the angle's SD
    slow: float = 0.0  # SD of slow torque, share of the torque's
    torque_filter_s: float = 0.0  # time constant of the load cell's low-pass
    late_stamps_s: float = 0.0  # mean delay with which a row is stamped
    lost: float = 0.0  # share of rows
    is_clipped: bool = False
    bits: int = 17
    known: dict[str, float] = field(default_factory=dict)


CASES = [
    Case("bursts", "bursts"),
    Case("ramps", "ramps"),
    Case("lost rows", "bursts", lost=0.01),
    Case("slow torque", "bursts", slow=0.03),
    Case("bristles", "ramps", "friction", bristles=0.03),
    Case(
        "hardening spring",
        "bursts",
        "K that changes with amplitude beyond friction",
        hardening=0.15,
    ),
    Case("filtered torque", "bursts", "late torque", torque_filter_s=2e-3),
    Case("late stamps", "ramps", "stamps", late_stamps_s=5e-4),
    Case("clipped torque", "bursts", "clipped", is_clipped=True),
]


def bursts(t, rng):
    """Sines under bells of Gauss: angle and its two derivatives, (3, n)."""
    motion = np.zeros((3, len(t)))
    for middle in np.arange(t[0] + 1, t[-1] - 1, SPACING_S):
        omega = 2 * np.pi * np.exp(rng.uniform(*np.log(BURST_HZ)))
        width = rng.uniform(*BURST_S)
        size = rng.normal() / omega**0.4
        from_middle = t - middle
        exponent = -((from_middle / width) ** 2) / 2 + 1j * (
            omega * from_middle + rng.uniform(0, 2 * np.pi)
        )
        slope = -from_middle / width**2 + 1j * omega
        burst = size * np.exp(exponent)
        motion += np.real([burst, slope * burst, (slope**2 - 1 / width**2) * burst])
    return motion


def ramps(t, rng):
    """Cycloids between random levels with rests between: angle and its two derivatives, (3, n)."""
    motion = np.zeros((3, len(t)))
    begin, level = t[0] + 0.5, 0.0
    while begin < t[-1] - 1.5:
        lasts, step = rng.uniform(*MOVE_S), rng.uniform(-1, 1) - level
        u = np.clip((t - begin) / lasts, 0, 1)
        turn = 2 * np.pi * u
        motion += step * np.array(
            [
                u - np.sin(turn) / (2 * np.pi),
                (1 - np.cos(turn)) / lasts,
                2 * np.pi * np.sin(turn) / lasts**2,
            ]
        )
        level += step
        begin += lasts + rng.uniform(*HOLD_S)
    return motion


def exponential_lag(x, time_constant):
    """What a first-order low-pass makes of x, (n,), exactly where x is linear between samples."""
    decay = np.exp(-1 / (FINE * time_constant))
    weight = (1 - decay) * FINE * time_constant  # of the slope
    made, value = np.empty_like(x), x[0]
    for k, (before, now) in enumerate(zip(np.r_[x[:1], x[:-1]], x, strict=True)):
        value = decay * value + (weight - decay) * before + (1 - weight) * now
        made[k] = value
    return made


def bristle_torque(theta, sliding, stiffness):
    """Friction after Dahl: bristles of a stiffness, which slide at a torque; (n,)."""
    torque, value = np.empty_like(theta), 0.0
    for k, turned in enumerate(np.diff(theta, prepend=theta[0])):
        end = sliding if turned > 0 else -sliding
        value = end + (value - end) * np.exp(-stiffness * abs(turned) / sliding)
        torque[k] = value
    return torque


def recording(case, seconds, rng):
    """Truth by name, and stamps [s], angle [rad] and torque [N*m], (n,) each."""
    rate = int(rng.choice(RATES))
    K = np.exp(rng.uniform(*np.log(STIFFNESS)))
    natural = 2 * np.pi * rng.uniform(*NATURAL_HZ)
    I, B = K / natural**2, 2 * rng.uniform(*DAMPING_RATIO) * K / natural
    t = np.arange(round(seconds * FINE)) / FINE
    theta, omega, alpha = {"bursts": bursts, "ramps": ramps}[case.motion](t, rng)
    scale = rng.uniform(*RMS_DEG) * DEG / theta.std()
    theta, omega, alpha = scale * theta, scale * omega, scale * alpha

    hardened = case.hardening * (theta / (2 * theta.std())) ** 2
    torque = K * (1 + hardened) * theta + B * omega + I * alpha
    X = np.column_stack([theta, omega, alpha, np.ones_like(theta)])
    true = dict(zip("KBI", np.linalg.lstsq(X, torque, rcond=None)[0], strict=False))

    size = torque.std()
    if case.bristles:
        torque = torque + bristle_torque(theta, case.bristles * size, 20 * K)
    if case.slow:
        white = rng.normal(size=len(t)) * np.sqrt(2 * SLOW_S * FINE)
        white[0] = rng.normal()  # where the slow torque begins
        torque = torque + case.slow * size * exponential_lag(white, SLOW_S)
    if case.torque_filter_s:
        torque = exponential_lag(torque, case.torque_filter_s)
    torque = torque + rng.uniform(-1, 1)

    taken = np.arange(1 / rate, seconds - 1 / rate, 1 / rate)
    if case.lost:
        taken = taken[rng.uniform(size=len(taken)) > case.lost]
    sampled = np.interp(taken, t, torque)
    sampled += rng.uniform(*NOISE) * size * rng.normal(size=len(taken))
    if case.is_clipped:
        sampled = np.clip(sampled, *(sampled.mean() + LARGEST_DEVIATION * size * np.array([-1, 1])))
    step = 2 * np.pi / 2**case.bits
    angle = np.round(np.interp(taken, t, theta) / step) * step
    stamps = taken
    if case.late_stamps_s:
        stamps = np.maximum.accumulate(taken + rng.exponential(case.late_stamps_s, len(taken)))
        stamps = stamps + 1e-6 * np.arange(len(taken))  # no two of one microsecond
    return rate, true, (stamps, angle, sampled)


def recordings(seed, seconds=24.0, only=CASES):
    """Each case with its rate [Hz], its truth, and its columns."""
    for number, case in enumerate(only):
        yield case, *recording(case, seconds, np.random.default_rng([seed, number, 2026]))
