"""One trial of the actuator's own bench: its output turned, its current commanded, its torque measured (Eqs. 1-2)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.model.drivetrain import actuator_torque
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.simulator.bench_recorder import Jumping, TrueSignal, recorded
from osl_analysis.simulator.dynamometer import moved
from osl_analysis.simulator.even_spline import spline_at
from osl_analysis.simulator.joint_motion import JointMotion
from osl_analysis.simulator.schedules import ActuatorBench, Tone
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.simulator.truth_recorder import bench_truth
from osl_analysis.trial import Array


@dataclass(frozen=True)
class ActuatorLog:
    """Signals that the bench's recorder writes: time [s], actuator_angle [rad] and motor_current [A], shape (n,) each.

    output_torque [N*m], shape (m,), is the torque of the actuator on the bench, the paper's tau_m. torque_time [s],
    shape (m,), are its stamps. They equal `time` if one node records all signals.
    """

    time: Array
    actuator_angle: Array
    motor_current: Array
    output_torque: Array
    torque_time: Array


def simulate_actuator_trial(
    trial: str, settings: SimulationSettings, p: DrivetrainParameters
) -> tuple[ActuatorLog, dict[str, object]]:
    """The log of one trial, and its truth. `settings.actuator` must not be None.

    The bench follows its commanded angle with `dynamometer_bandwidth`, as the dynamometer does. Its torque transducer
    has the imperfections of the load cell.
    """
    assert settings.actuator is not None  # as SimulationSettings checked
    _, motion = moved(turning(settings.actuator, settings.dynamometer.rate_hz), settings)
    current = current_schedule(settings.actuator, settings.dynamometer.rate_hz)
    friction = settings.effects.friction.value
    actuator = replace(p, f_C=friction * p.f_C, f_G=friction * p.f_G)
    log, drawn = recorded_actuator(trial, motion, current, actuator, settings)
    return log, bench_truth(trial, settings, actuator, None, drawn)


def turning(bench: ActuatorBench, rate_hz: float) -> JointMotion:
    """The commanded angle [rad] with its derivatives: tones of the velocity, faded in and out."""
    time = np.arange(round(bench.duration_s * rate_hz)) / rate_hz
    w = 2 * np.pi * np.array([[tone.frequency_hz] for tone in bench.velocity])
    size = np.array([[tone.size] for tone in bench.velocity])
    angle, velocity, acceleration = (
        x.sum(axis=0) for x in (size / w * (1 - np.cos(w * time)), size * np.sin(w * time), size * w * np.cos(w * time))
    )
    fade, rate, curvature = fading(time, bench.duration_s, bench.fade_s)
    return JointMotion(
        fade * angle,
        rate * angle + fade * velocity,
        curvature * angle + 2 * rate * velocity + fade * acceleration,
    )


def fading(time: Array, duration: float, fade: float) -> tuple[Array, Array, Array]:
    """A window (n,) that rises from 0 to 1 and falls to 0 within `fade` [s], and its first two derivatives
    (continuous)."""
    u = np.clip(np.minimum(time, duration - time) / fade, 0.0, 1.0)
    side = np.where(time < duration / 2, 1.0, -1.0) / fade
    return (
        u**3 * (10 - 15 * u + 6 * u**2),
        30 * u**2 * (1 - u) ** 2 * side,
        60 * u * (1 - u) * (1 - 2 * u) * side**2,
    )


def current_schedule(bench: ActuatorBench, rate_hz: float) -> Array:
    """Commanded I_q [A], which the current loop follows: the sum of the tones, faded in and out."""
    time = np.arange(round(bench.duration_s * rate_hz)) / rate_hz
    return tones(bench.current, time) * fading(time, bench.duration_s, bench.fade_s)[0]


def tones(schedule: Sequence[Tone], time: Array) -> Array:
    """Sum of sines from phase 0, in the unit of their sizes."""
    return np.asarray(sum(tone.size * np.sin(2 * np.pi * tone.frequency_hz * time) for tone in schedule))


def recorded_actuator(
    trial: str, motion: JointMotion, current: Array, p: DrivetrainParameters, settings: SimulationSettings
) -> tuple[ActuatorLog, dict[str, float]]:
    """The recorded log of an actuator with these parameters, and the errors that were drawn for this trial."""
    torque = torque_of(motion, current, p, settings.dynamometer.rate_hz)
    signals: dict[str, TrueSignal] = {"actuator_angle": motion.theta, "motor_current": current, "output_torque": torque}
    nodes, drawn = recorded(trial, signals, settings)
    channels = {name: values for node in nodes for name, values in node.channels.items()}
    return ActuatorLog(time=nodes[0].time, torque_time=nodes[-1].time, **channels), drawn


def torque_of(motion: JointMotion, current: Array, p: DrivetrainParameters, rate_hz: float) -> Jumping:
    """True torque [N*m] of the actuator. Its friction jumps where the velocity is zero, and not at the next sample.

    A curve through the samples has every jump half a step after a sample. A torque transducer that samples later than
    the encoder would read all of them late, which looks like inertia.
    """

    def at(instants: Array) -> Array:
        """The torque at any instants [s]."""
        signals = (current, motion.omega, motion.alpha)
        amperes, omega, alpha = (spline_at(signal, rate_hz, instants) for signal in signals)
        return actuator_torque(amperes, omega, alpha, p)

    return Jumping(actuator_torque(current, motion.omega, motion.alpha, p), at)
