"""How the dynamometer moves the joint: commands, and the motor that follows them with finite bandwidth."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from osl_analysis.simulator.drivetrain_kernel import compiled_kernel
from osl_analysis.simulator.settings import BeltMotion, SteppedSineSchedule
from osl_analysis.trial import Array


@dataclass(frozen=True)
class JointMotion:
    """theta [rad], omega [rad/s], alpha [rad/s^2], each the true derivative of the one before; shape (n,)."""

    theta: Array
    omega: Array
    alpha: Array


def stepped_sine(protocol: SteppedSineSchedule, rate_hz: float) -> JointMotion:
    """The commanded stepped sine from rest, sampled at `rate_hz` [Hz].

    The phase is continuous where the frequency changes and a multiple of 2 pi where the amplitude does, so the
    angle never jumps. The velocity does, there: a command that is followed exactly has no acceleration for it.
    """
    frequency = np.array([*protocol.frequencies_hz, 0.0])
    duration = np.array([*(protocol.cycles / f for f in protocol.frequencies_hz), protocol.rest_s])
    amplitude = np.deg2rad(protocol.amplitudes_deg)
    rates = 2 * np.pi * np.concatenate([[0.0], np.tile(frequency, len(amplitude))])
    ends = np.cumsum([protocol.lead_s, *np.tile(duration, len(amplitude))])
    time = np.arange(round(ends[-1] * rate_hz)) / rate_hz
    piece = np.minimum(np.searchsorted(ends, time, side="right"), len(ends) - 1)
    started = np.concatenate([[0.0], ends[:-1]])
    size = np.concatenate([[0.0], np.repeat(amplitude, len(frequency))])[piece]
    w, phase = rates[piece], rates[piece] * (time - started[piece])
    return JointMotion(size * np.sin(phase), size * w * np.cos(phase), -size * w**2 * np.sin(phase))


def there_and_back(belt: BeltMotion, rate_hz: float) -> JointMotion:
    """The belt experiment's command: a raised cosine of one period, between two rests."""
    time = np.arange(round((2 * belt.rest_s + 2 * belt.ramp_s) * rate_hz)) / rate_hz
    w, height = np.pi / belt.ramp_s, 0.5 * np.deg2rad(belt.amplitude_deg)
    phase = w * np.clip(time - belt.rest_s, 0.0, 2 * belt.ramp_s)
    moves = (phase > 0) & (phase < 2 * np.pi)
    return JointMotion(
        height * (1 - np.cos(phase)), height * w * np.sin(phase), height * w**2 * np.where(moves, np.cos(phase), 0.0)
    )


def position_loop(command: JointMotion, rate_hz: float, bandwidth_hz: float, damping_ratio: float) -> JointMotion:
    """What a second-order position loop makes of a command, from rest at the command's first angle.

    Exact for the cubic through the command's angles and velocities at two samples; a command that is merely
    linear between samples would leave corners in the acceleration, which the log's rate aliases into J_j. Angle
    and derivatives come from one state, so that each is the true derivative of the one before.
    """
    w, step = 2 * np.pi * bandwidth_hz, 1 / rate_hz
    augmented = np.diag(np.ones(5), 1)
    augmented[1, :3] = -(w**2), -2 * damping_ratio * w, w**2
    transition = np.ascontiguousarray(expm(augmented * step)[:2])
    mean = np.diff(command.theta) / step
    first, second = command.omega[:-1], command.omega[1:]
    curvature, jerk = 2 * (3 * mean - 2 * first - second) / step, 6 * (first + second - 2 * mean) / step**2
    forcing = transition[:, 2:] @ np.vstack([command.theta[:-1], first, curvature, jerk])
    theta, omega = propagate(command.theta[0], np.ascontiguousarray(transition[:, :2]), forcing)
    return JointMotion(theta, omega, w**2 * (command.theta - theta) - 2 * damping_ratio * w * omega)


@compiled_kernel
def propagate(start: float, transition: Array, forcing: Array) -> Array:
    """Angle and velocity, shape (2, n), from rest at an angle [rad]; forcing has shape (2, n - 1)."""
    states = np.zeros((2, forcing.shape[1] + 1))
    states[0, 0] = start
    for i in range(forcing.shape[1]):
        angle, velocity = states[0, i], states[1, i]
        states[0, i + 1] = transition[0, 0] * angle + transition[0, 1] * velocity + forcing[0, i]
        states[1, i + 1] = transition[1, 0] * angle + transition[1, 1] * velocity + forcing[1, i]
    return states
