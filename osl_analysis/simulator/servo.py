"""The servo of the platform in one trial: how fast it is, and how it shivers while it moves."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.simulator.gait import smooth_step
from osl_analysis.simulator.sensors import stream
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.trial import Array

SHIVER_HZ = (8.0, 20.0)
SHIVER_WAVES = 6
SETTLES_S = 0.1
"""Time [s] after the ramp at which the shiver begins to fade."""
FADE_S = 0.05


@dataclass(frozen=True)
class Servo:
    """What is random in a motion of the platform."""

    slowness: float
    """Factor of the duration of the ramp."""
    shiver: Array
    """Deviation [rad] of the angle, shape (n,), before it is limited to the motion."""

    def shivering(self, time: Array, onset: float, rise: float) -> Array:
        """Deviation [rad] of the angle, shape (n,): from the onset [s] until shortly after the rise [s]."""
        ends = onset + rise + SETTLES_S
        return np.asarray(self.shiver * (smooth_step((time - onset) / FADE_S) - smooth_step((time - ends) / FADE_S)))


def draw_servo(trial: str, seed: int, time: Array, walking: WalkingSettings) -> Servo:
    """Draw the servo of a trial."""
    effects = walking.effects
    slower = 0.01 * effects.rise_scatter.value * stream(seed, trial, "rise_scatter").standard_normal()
    random = stream(seed, trial, "servo_shiver")
    sizes = random.standard_normal(SHIVER_WAVES) * np.sqrt(2 / SHIVER_WAVES)
    pitches, phases = random.uniform(*SHIVER_HZ, SHIVER_WAVES), random.uniform(0, 2 * np.pi, SHIVER_WAVES)
    shiver = np.cos(2 * np.pi * np.outer(time, pitches) + phases) @ sizes
    return Servo(float(1 + slower), np.radians(effects.servo_shiver.value) * shiver)
