"""A second gait for studies of phase: a function of stance phase whose size, load and timing differ
from step to step.

The simulator's own gait varies in time: its angle wanders, and the leg's torque follows. Here a
crossing is a function of phase with a longer or shorter step, another load, another second hump and
another timing within stance, and only the rest wanders in time. The perturbation adds exactly Eq.
15. Nothing of the simulator is used.
"""

from dataclasses import dataclass

import numpy as np

from osl_analysis.signals import LowPass, Motion
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.stance import Stance

RATE, STRIKE, STANCE, WEIGHT, ONSET = 300.0, 0.5, 0.70, 785.0, 0.40
TRUTH = {"K": 340.0, "B": 3.0, "I": 0.02}
TURN, RAMP = np.deg2rad(4.75), 0.08
"""The ankle's turn [rad], and the duration [s] of the platform's ramp."""
LATER = 0.11
"""Time [s] after the onset at which a hurried crossing begins to hurry."""


@dataclass(frozen=True)
class Change:
    """What the perturbed crossings do: factor of their whole duration, and of stance by what
    follows the window."""

    slower: float = 1.0
    after_window: float = 1.0


def smooth(x: Array) -> Array:
    """0 for x <= 0, 1 for x >= 1, with two continuous derivatives."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x * x))


def waves(random: np.random.Generator, time: Array, highest: float, size: float) -> Array:
    """A deviation (n,) of standard deviation `size`: six waves between 0.3 Hz and the highest
    frequency [Hz]."""
    pitch, start = random.uniform(0.3, highest, 6), random.uniform(0, 2 * np.pi, 6)
    return np.asarray(
        size / np.sqrt(3) * np.sin(2 * np.pi * np.outer(time, pitch) + start).sum(axis=1)
    )


def ramp(time: Array) -> Motion:
    """The ankle's turn at times (n,) [s] from the onset, with its derivatives."""
    x = np.clip(time / RAMP, 0.0, 1.0)
    speed, change = 30 * x**2 - 60 * x**3 + 30 * x**4, 60 * x - 180 * x**2 + 120 * x**3
    return Motion(TURN * smooth(x), TURN * speed / RAMP, TURN * change / RAMP**2)


def crossing(
    key: tuple[int, ...], low_pass: LowPass, perturbed: bool, change: Change = Change()
) -> Crossing:
    """A crossing as the analysis sees it. Its key determines all that is random, also what sensors
    add."""
    random = np.random.default_rng(key)
    step, load, pace, hump, warp = random.standard_normal(5) * (0.03, 0.018, 0.018, 0.018, 0.005)
    duration = STANCE * change.slower * (1 + pace)
    onset = STRIKE + ONSET * STANCE + 0.01 * random.uniform(-1, 1)
    time = np.arange(round((STRIKE + 1.3 * duration) * RATE)) / RATE
    elapsed = time - STRIKE
    begins = onset + LATER - STRIKE
    stance = duration * change.after_window if perturbed else duration
    bend = (duration - stance) / duration / (stance - begins) ** 2
    phase = elapsed / duration + bend * np.maximum(elapsed - begins, 0.0) ** 2
    inside = np.clip(phase, 0.0, 1.0)
    phase = phase + warp * np.sin(np.pi * inside) ** 2 * np.sin(2 * np.pi * inside + 0.7)
    inside = np.clip(phase, 0.0, 1.0)
    on = smooth(inside / 0.08) * smooth((1 - inside) / 0.08)
    force = (
        (1 + load)
        * WEIGHT
        * 1.15
        * (np.sin(np.pi * inside) + (0.35 + hump) * np.sin(3 * np.pi * inside))
        * on
    )
    lever = -0.04 + 0.17 * smooth((inside + 0.05) / 1.1) * (1 + step / 2)
    shear = -0.13 * WEIGHT * (1 + step) * (1 + load) * np.sin(2 * np.pi * inside) * on
    foot = np.deg2rad(18 * (1 - smooth((phase + 0.05) / 0.2)) - 40 * smooth((phase - 0.62) / 0.45))
    shank = np.deg2rad(
        -18 + 48 * (1 + step) * smooth((phase + 0.3) / 1.6) + waves(random, time, 2.0, 0.24)
    )
    theta, torque = foot + shank, force * lever + 0.08 * shear + waves(random, time, 2.5, 0.9) * on
    if perturbed:
        turn = ramp(time - onset)
        answer = TRUTH["K"] * turn.theta + TRUTH["B"] * turn.omega + TRUTH["I"] * turn.alpha
        theta, torque = theta + turn.theta, torque + answer
    theta = low_pass(theta + 1e-3 * random.standard_normal(len(time)), RATE)
    torque = low_pass(torque + 0.1 * random.standard_normal(len(time)), RATE)
    name, still = f"phase_{'_'.join(map(str, key))}", np.zeros((0, len(time)))
    return Crossing(
        name, time, theta, torque, 0 * time, Stance(STRIKE, STRIKE + stance),
        onset if perturbed else None, 0.0,
        still,
    )  # fmt: skip
