# SPDX-License-Identifier: Apache-2.0
"""Recordings of joints whose truth is known, made by numpy alone, independent of the project's own
simulator.

A stiff drive moves the joint: I alpha = torque - K theta - B omega - friction - reflex - will. The
torque is that between drive and joint, which a load cell there measures. All joints of a seed are
integrated together by the method of Runge and Kutta at 2 kHz. Then the recorder makes angle and
torque late, held or coarse, and adds noise.
"""

from dataclasses import dataclass, field

import numpy as np

RATE, SUBSTEPS = 500, 4  # Hz of the recording, steps of the integration per sample
STEP = 1 / (RATE * SUBSTEPS)  # s
DEG = np.pi / 180
DRIVE = 20_000.0, 40.0  # N*m/rad and N*m*s/rad of the drive's position loop
SLIDING = 1e-2  # rad/s, over which Coulomb friction changes its sign
REFLEX_DELAY, REFLEX_RATE = 0.04, 20.0  # s, and rad/s of its two lags


@dataclass(frozen=True)
class Case:
    """A joint, its motion, and what the recorder does. Units: N*m, rad, s."""

    case: str
    motion: str
    K: float = 300.0
    B: float = 5.0
    I: float = 0.02
    friction: float = 0.0
    reflex: float = 0.0  # N*m*s/rad, of velocity in one direction
    will: float = 0.0  # N*m, slow torque of the person
    fall_of_K: float = 0.0  # share of K that is lost by the end, in a straight line
    late: float = 0.0
    drift: float = 0.0  # s/s by which the torque becomes late
    held_hz: float = 0.0
    bits: int = 18
    highest_hz: float = 6.0
    announce: str = ""
    known: dict[str, float] = field(default_factory=dict)

    @property
    def true(self) -> dict[str, float]:
        """K, B and I; K is its mean over the recording."""
        return {"K": self.K * (1 - self.fall_of_K / 2), "B": self.B, "I": self.I}


PERSON = {
    "K": 80.0,
    "B": 1.2,
    "I": 0.016,
    "reflex": 4.0,
    "will": 0.5,
    "highest_hz": 12.0,
    "announce": "reflex",
    "known": {"person": 1.0},
}
CLOCKS = "clocks that drift apart"
CASES = [
    Case("exact joint", "multisine"),
    Case("exact joint", "chirp"),
    Case("friction", "multisine", friction=0.3, announce="friction"),
    Case("friction", "chirp", friction=0.3, announce="friction"),
    Case("late torque", "multisine", late=2e-3, announce="late torque"),
    Case("late torque", "noise", late=2e-3, announce="late torque"),
    Case("two clocks", "chirp", drift=2e-4, announce=CLOCKS),
    Case("two clocks", "noise", drift=2e-4, announce=CLOCKS),
    Case("stale values", "multisine", held_hz=50.0, announce="held torque"),
    Case("stale values", "hand", held_hz=50.0, announce="held torque"),
    Case("14 bits", "multisine", bits=14),
    Case("14 bits", "hand", bits=14),
    Case("human ankle", "noise", **PERSON),
    Case("human ankle", "multisine", **PERSON),
    Case("varying K", "multisine", fall_of_K=0.2, announce="K changes"),
    Case("varying K", "chirp", fall_of_K=0.2, announce="K changes"),
]


def commanded(case, seconds, rng):
    """The angle [rad] that the drive is told, (n,) every half step."""
    t = np.arange(round(seconds / STEP) * 2 + 1) * STEP / 2
    if case.motion == "chirp":
        f = 0.4 + (case.highest_hz - 0.4) * t / seconds
        x = np.sin(2 * np.pi * np.cumsum(f) * STEP / 2) / np.sqrt(1 + (f / 2.5) ** 2)
    elif case.motion == "hand":  # moves of least jerk between random angles
        x = np.empty_like(t)
        angle = 0.0
        first = 0
        while first < len(t):
            target = rng.uniform(-1, 1)
            n = round(rng.uniform(0.15, 0.6) * 2 / STEP)
            u = np.arange(1, n + 1)[: len(t) - first] / n
            x[first : first + n] = angle + (target - angle) * u**3 * (10 - 15 * u + 6 * u**2)
            angle = target
            first += n
    else:
        if case.motion == "multisine":  # odd lines of a period of 8 s
            lines = np.arange(3, 8 * case.highest_hz, 2) / 8
            sizes = 1
        else:  # noise: all lines of the recording, with random sizes
            lines = np.arange(0.3, case.highest_hz, 1 / seconds)
            sizes = rng.rayleigh(size=len(lines))
        phases = rng.uniform(0, 2 * np.pi, len(lines))
        x = np.zeros_like(t)
        for f, size, phase in zip(lines, sizes * lines**-0.4, phases, strict=True):
            x += size * np.sin(2 * np.pi * f * t + phase)
    fade = np.clip(np.minimum(t, t[-1] - t), 0, 1)
    return 2.5 * DEG * x / x.std() * fade**2 * (3 - 2 * fade)


def integrated(cases, seconds, rng):
    """Angle and torque of the joints, (n, cases) each, every step."""
    r = np.stack([commanded(case, seconds, rng) for case in cases], axis=1)
    r_rate = np.gradient(r, STEP / 2, axis=0)
    of = {
        name: np.array([getattr(case, name) for case in cases])
        for name in ("K", "B", "I", "friction", "reflex")
    }
    lost, n = np.array([case.fall_of_K for case in cases]) / seconds, len(r) // 2
    will = np.stack([case.will * slow_noise(n + 1, rng) for case in cases], axis=1)
    delay, late = round(REFLEX_DELAY / STEP), np.zeros(len(cases))
    P, D = DRIVE

    def torque(k, x):
        return P * (r[k] - x[0]) + D * (r_rate[k] - x[1])

    def rates(k, x, stretch):
        angle, velocity, first, second = x
        resisting = (
            of["K"] * (1 - lost * k * STEP / 2) * angle + of["B"] * velocity + second + will[k // 2]
        )
        resisting += of["friction"] * np.tanh(velocity / SLIDING)
        accelerated = (torque(k, x) - resisting) / of["I"]
        driven = REFLEX_RATE * (of["reflex"] * np.maximum(stretch, 0) - first)
        return np.stack([velocity, accelerated, driven, REFLEX_RATE * (first - second)])

    x, theta, omega, tau = np.zeros((4, len(cases))), *np.zeros((3, n, len(cases)))
    for step in range(n):
        k = 2 * step
        theta[step], omega[step], tau[step] = x[0], x[1], torque(k, x)
        before, late = late, omega[step - delay] if step >= delay else late
        a = rates(k, x, before)
        b = rates(k + 1, x + STEP / 2 * a, (before + late) / 2)
        c = rates(k + 1, x + STEP / 2 * b, (before + late) / 2)
        d = rates(k + 2, x + STEP * c, late)
        x = x + STEP / 6 * (a + 2 * b + 2 * c + d)
    return theta, tau


def slow_noise(n, rng):
    """Noise below 1 Hz with a standard deviation of 1, (n,) every step."""
    f = np.fft.rfftfreq(n, STEP)
    x = np.fft.irfft(np.fft.rfft(rng.normal(size=n)) / (1 + (f / 0.5) ** 4), n)
    return x / x.std()


def recorded(case, theta, tau, rng):
    """Stamps [s], angle [rad] and torque [N*m] of a recording, (n,) each."""
    fine = np.arange(len(theta)) * STEP
    t = fine[SUBSTEPS:-SUBSTEPS:SUBSTEPS]
    t = t + np.clip(rng.normal(scale=2e-5, size=len(t)), -1e-4, 1e-4)
    taken = np.floor(t * case.held_hz + 1e-9) / case.held_hz if case.held_hz else t
    torque = (
        np.interp(taken - case.late - case.drift * t, fine, tau)
        + 0.3
        + 0.05 * rng.normal(size=len(t))
    )
    step = 2 * np.pi / 2**case.bits
    return t, np.round(np.interp(t, fine, theta) / step) * step, torque


def recordings(seed, seconds=24.0, only=CASES):
    """Each case with its recording."""
    rng = np.random.default_rng([seed, 55])
    theta, tau = integrated(only, seconds, rng)
    return [(case, recorded(case, theta[:, k], tau[:, k], rng)) for k, case in enumerate(only)]
