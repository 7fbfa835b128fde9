"""One step on the platform: its timing, and all that is random in it, the same with and without the perturbation."""

from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.simulator import gait
from osl_analysis.simulator.conditions import Condition
from osl_analysis.simulator.gait_changes import StepChange, change_of
from osl_analysis.simulator.sensors import stream
from osl_analysis.simulator.servo import Servo, draw_servo
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.trial import Array

WINDOW_S = 0.1
"""Time [s] after the onset in which the rendered impedance is fitted."""
WANDER_HZ = (0.3, 4.0)
WANDER_WAVES = 6
STEEPEST = 35 / 16
"""Largest slope of `gait.smooth_step`."""


@dataclass(frozen=True)
class Step:
    """Random quantities of one crossing, the same with and without the perturbation."""

    heel_strike: float
    """Time [s] of heel strike."""
    stance: float
    """Duration [s] of stance, without the change after the window."""
    onset: float
    """Time [s] at which the platform starts to move."""
    command: float
    """Time [s] at which the perturbation is commanded."""
    angle_factor: float
    """Factor of the ankle's angle."""
    wander: Array
    """Smooth deviation [rad] of the ankle's angle, shape (n,)."""
    torque_wander: Array
    """Smooth deviation [N*m] of the ankle's torque, shape (n,). The leg's equilibrium follows it."""
    force_factor: Array
    """Factor of each component of the ground reaction, shape (3,)."""
    placement: Array
    """Deviation [m] of the foot's place forward, to the left and up, shape (3,)."""
    yaw: float
    """Direction [rad] of the foot, to the left."""
    hurry: float
    """Time [s] by which stance is longer after the window."""
    timing: tuple[float, float]
    """Deviation of the phase of stance in its middle, and of one half of it against the other."""
    body_mass: float
    """Body mass [kg]."""
    servo: Servo
    """What is random in the platform's motion."""
    change: StepChange
    """What makes this crossing differ from others."""
    condition: Condition
    """What the crossing is by plan."""

    @property
    def toe_off(self) -> float:
        """Time [s] at which the foot leaves the platform."""
        return self.heel_strike + self.stance + self.hurry

    @property
    def load(self) -> float:
        """Factor of the ground reaction and of the ankle's nominal torque."""
        return self.change.load * self.change.amplitude

    def stance_phase(self, time: Array) -> Array:
        """Phase of stance at times [s]: 0 at heel strike, 1 at toe-off."""
        elapsed = time - self.heel_strike
        if self.hurry:
            begins = self.onset + WINDOW_S - self.heel_strike
            left = self.stance + self.hurry - begins
            elapsed = elapsed - self.hurry * gait.smooth_step((elapsed - begins) / left)
        phase = elapsed / self.stance
        if not any(self.timing):
            return phase
        inside = np.clip(phase, 0.0, 1.0)
        middle, halves = self.timing
        return np.asarray(phase + 256.0 * (inside * (1 - inside)) ** 4 * (middle + halves * 2 * (2 * inside - 1)))

    def cycle_phase(self, time: Array) -> Array:
        """Phase of the gait cycle at times [s]: 0 at the heel strike on the platform, 1 at the next."""
        return gait.STANCE_FRACTION * self.stance_phase(time)

    def as_walked(self, perturbed: bool) -> "Step":
        """This step with or without the perturbation, which alone changes stance after the window."""
        return self if perturbed or not self.hurry else replace(self, hurry=0.0)


def draw_step(trial: str, seed: int, time: Array, walking: WalkingSettings, condition: Condition | None = None) -> Step:
    """Draw a crossing. Each effect has its own random stream.

    Raises
    ------
    InputError
        Stance would have to run backwards after the window.
    """
    effects, nominal, condition = walking.effects, walking.gait, condition or Condition()
    change = change_of(trial, seed, condition.perturbed, walking.changes)
    normal = Draws(trial, seed, walking)
    stance = condition.stance(nominal.stance_s) * (1 + normal("stance_scatter", 0.01))
    stance *= 1 + 0.01 * change.slower_percent
    heel_strike = nominal.heel_strike_s + normal("heel_strike_scatter")
    command = heel_strike + command_phase(trial, seed, walking, condition) * stance
    force = stream(seed, trial, "force_scale").standard_normal(3)
    load, amplitude = (f * (1 + normal(f"{n}_scatter", 0.01)) for n, f in change.factors.items())
    onset = command + walking.perturbation.latency_s + normal("trigger_scatter", 1e-3)
    sideways = normal("placement_sideways", 1e-3) if not change.overhang_mm else overhanging(change, walking)
    step = Step(
        heel_strike=heel_strike,
        stance=stance,
        onset=onset,
        command=command,
        angle_factor=1 + normal("angle_scale", 0.01),
        wander=np.radians(effects.angle_wander.value) * wandering(stream(seed, trial, "angle_wander"), time),
        torque_wander=effects.torque_wander.value * wandering(stream(seed, trial, "torque_wander"), time),
        force_factor=1 + 0.01 * effects.force_scale.value * force,
        placement=np.array([normal("placement_forward", 1e-3), sideways, 0.0]),
        yaw=normal("foot_yaw", np.pi / 180),
        hurry=0.01 * change.after_window_percent * stance,
        timing=(normal("timing_wander", 0.01), 0.01 * effects.timing_wander.value * normal.of("timing_halves")),
        body_mass=condition.body_mass(nominal.body_mass_kg),
        servo=draw_servo(trial, seed, time, walking),
        change=change.model_copy(update={"load": load, "amplitude": amplitude}),
        condition=condition,
    )
    return with_a_stance_that_can_be(step, trial)


class Draws:
    """Normal deviates of the effects of one crossing."""

    def __init__(self, trial: str, seed: int, walking: WalkingSettings) -> None:
        self.trial, self.seed, self.effects = trial, seed, walking.effects

    def __call__(self, effect: str, unit: float = 1.0) -> float:
        """A normal deviate with the effect's standard deviation, in SI units."""
        return unit * float(getattr(self.effects, effect).value * self.of(effect))

    def of(self, name: str) -> float:
        """A standard normal deviate."""
        return float(stream(self.seed, self.trial, name).standard_normal())


def command_phase(trial: str, seed: int, walking: WalkingSettings, condition: Condition) -> float:
    """Phase of stance at which the perturbation is commanded."""
    first, last = walking.perturbation.stance_phase
    middle = 0.0 if condition.stance_phase is None else condition.stance_phase - 0.5 * (first + last)
    return float(middle + stream(seed, trial, "perturbation_phase").uniform(first, last))


def overhanging(change: StepChange, walking: WalkingSettings) -> float:
    """Deviation [m] of a foot's place to the left, whose outer side is `overhang_mm` beyond the plate's right edge."""
    plate = walking.plate
    outer = -0.5 * plate.size_m[1] - 1e-3 * change.overhang_mm
    return outer + 0.5 * gait.FOOT_WIDTH - plate.nominal_ankle_m[1]


def with_a_stance_that_can_be(step: Step, trial: str) -> Step:
    """The step, if time after the window can be stretched as it asks."""
    left = step.toe_off - step.onset - WINDOW_S
    if step.hurry and not left > STEEPEST * max(step.hurry, 0.0):
        raise InputError(
            f"trial {trial}: after_window_percent {step.change.after_window_percent:g} leaves {left:.3f} s of stance "
            "after the window; choose a smaller change, or an earlier perturbation"
        )
    return step


def wandering(random: np.random.Generator, time: Array) -> Array:
    """A smooth deviation of unit standard deviation, shape (n,): slow waves of random size, frequency and phase."""
    sizes = random.standard_normal(WANDER_WAVES) * np.sqrt(2 / WANDER_WAVES)
    pitches, phases = random.uniform(*WANDER_HZ, WANDER_WAVES), random.uniform(0, 2 * np.pi, WANDER_WAVES)
    return np.asarray(np.cos(2 * np.pi * np.outer(time, pitches) + phases) @ sizes)
