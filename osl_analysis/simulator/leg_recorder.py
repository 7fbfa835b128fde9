"""The leg's own log of a crossing, on the leg's own clock."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from osl_analysis.simulator import messages
from osl_analysis.simulator.crossing import SimulatedCrossing
from osl_analysis.simulator.mcap_recorder import write_mcap
from osl_analysis.simulator.rigid_body import interpolated_at
from osl_analysis.simulator.sensors import rounded_to, stream
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.simulator.vicon import draw_sync
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.trial import Array


@dataclass(frozen=True)
class LegClock:
    """The leg's clock: its time [s] is offset [s] + (1 + drift) * Vicon's time [s]."""

    offset: float
    drift: float

    def at(self, time: Array) -> Array:
        """The leg's time [s] at Vicon's."""
        return self.offset + (1 + self.drift) * time

    def inverse(self, leg_time: Array) -> Array:
        """Vicon's time [s] at the leg's."""
        return (leg_time - self.offset) / (1 + self.drift)


def draw_clock(trial: str, seed: int, walking: WalkingSettings) -> LegClock:
    """The leg's clock in one trial. Its offset is drawn evenly from 0.5 to 1.5 times its mean."""
    effects = walking.effects
    offset = effects.leg_clock_offset.value * stream(seed, trial, "leg_clock_offset").uniform(0.5, 1.5)
    drift = 1e-6 * effects.leg_clock_drift.value * stream(seed, trial, "leg_clock_drift").standard_normal()
    return LegClock(float(offset), float(drift))


def leg_columns(
    trial: str, crossing: SimulatedCrossing, time: Array, settings: SimulationSettings, walking: WalkingSettings
) -> dict[str, Array]:
    """What the leg logs at times [s] of Vicon's clock, shape (n,) each, in the fields of its message.

    Gains and current are held from one update of the controller to the next.
    """
    rates, effects, seed = walking.rates, settings.effects, settings.seed
    encoder = walking.effects.leg_joint_encoder
    resolution = 2 * np.pi / 2**encoder.size if encoder.enabled else 0.0
    held = np.floor(time * rates.controller_hz).astype(int)
    ripple = effects.current_noise.value * stream(seed, trial, "current_noise").standard_normal(len(time))
    theta_m = interpolated_at(crossing.drivetrain.theta_m, rates.controller_hz, time)
    return {
        "joint_angle": rounded_to(interpolated_at(crossing.motion.theta, rates.motion_hz, time), resolution),
        "actuator_angle": rounded_to(theta_m, effects.actuator_encoder.value),
        "motor_current": rounded_to(crossing.drivetrain.current[held] + ripple, effects.current_quantisation.value),
        "stiffness_gain": crossing.commands.K_1[held],
        "damping_gain": crossing.commands.B_1[held],
        "sync": draw_sync(trial, seed, walking.gait.recording_s).level(time),
    }


def write_leg_log(
    path: Path, trial: str, crossing: SimulatedCrossing, settings: SimulationSettings, walking: WalkingSettings
) -> LegClock:
    """Write the leg's log, sampled at whole periods of its own clock. Return this clock, for the truth."""
    clock, rate = draw_clock(trial, settings.seed, walking), walking.rates.leg_hz
    first, last = clock.at(crossing.time[[0, -1]]) * rate
    # the margin excludes a period that rounding put before the first sample or after the last
    leg_time = np.arange(np.ceil(first + 1e-6), np.floor(last - 1e-6) + 1) / rate
    columns = leg_columns(trial, crossing, clock.inverse(leg_time), settings, walking)
    write_mcap(path, messages.LEG, leg_time, columns)
    return clock
