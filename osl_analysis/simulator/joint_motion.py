"""Motion of the joint on the dynamometer: commands, and the motor that follows them with finite bandwidth."""

from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.compiled import compiled
from osl_analysis.simulator.schedules import BeltMotion, SteppedSineSchedule
from osl_analysis.trial import Array


@dataclass(frozen=True)
class JointMotion:
    """theta [rad], omega [rad/s], alpha [rad/s^2], each the true derivative of the one before; shape (n,)."""

    theta: Array
    omega: Array
    alpha: Array

    def __add__(self, other: "JointMotion") -> "JointMotion":
        """The sum of two motions."""
        return JointMotion(self.theta + other.theta, self.omega + other.omega, self.alpha + other.alpha)


@dataclass(frozen=True)
class Pieces:
    """The pieces of a stepped sine, (k,) each: start [s], duration [s], angular frequency [rad/s], amplitude [rad]."""

    start: Array
    duration: Array
    w: Array
    amplitude: Array

    @property
    def end(self) -> float:
        """End of the last piece [s]."""
        return float(self.start[-1] + self.duration[-1])


def stepped_sine_pieces(protocol: SteppedSineSchedule) -> Pieces:
    """The rests and frequencies of a stepped sine, on the clock of the log."""
    between = [protocol.rest_between_s] if protocol.rest_between_s else []
    duration, frequency = list[float](), list[float]()
    for f, sine in zip(protocol.frequencies_hz, protocol.durations, strict=True):
        duration += [sine + 2 * protocol.ramp_s, *between]
        frequency += [f, *(0.0 for _ in between)]
    blocks = len(protocol.amplitudes_deg)
    amplitude = np.repeat(np.deg2rad(protocol.amplitudes_deg), len(duration) + 1)
    faster = 1 + 1e-6 * protocol.clock_error.value
    durations = np.concatenate([[protocol.lead_s], np.tile([*duration, protocol.rest_s], blocks)]) / faster
    w = 2 * np.pi * np.concatenate([[0.0], np.tile([*frequency, 0.0], blocks)]) * faster
    start = np.concatenate([[0.0], np.cumsum(durations)[:-1]])
    return Pieces(start, durations, w, np.concatenate([[0.0], amplitude]))


def stepped_sine(protocol: SteppedSineSchedule, rate_hz: float) -> JointMotion:
    """The commanded stepped sine from rest, sampled at `rate_hz` [Hz].

    The phase is continuous where the frequency changes, and a multiple of 2 pi where the amplitude changes. The angle
    therefore has no jumps, unless a frequency starts as a cosine or does not end with a whole cycle. The velocity jumps
    at these changes. If the command is followed exactly, the acceleration does not include these jumps.
    """
    pieces = stepped_sine_pieces(protocol)
    time = np.arange(round(pieces.end * rate_hz)) / rate_hz
    k = np.minimum(np.searchsorted(pieces.start, time, side="right") - 1, len(pieces.start) - 1)
    elapsed, w = time - pieces.start[k], pieces.w[k]
    size = np.where(w > 0, pieces.amplitude[k], 0.0)
    envelope = decaying(ramped(size, elapsed, pieces.duration[k], protocol.ramp_s), elapsed, protocol.decay.value)
    motion = envelope.times(w, w * elapsed + (np.pi / 2 if protocol.start == "cosine" else 0.0))
    for order, harmonic in ((2, protocol.second_harmonic), (3, protocol.third_harmonic)):
        if harmonic.enabled:
            motion = motion + envelope.scaled(harmonic.value).times(order * w, order * w * elapsed)
    return motion


@dataclass(frozen=True)
class Envelope:
    """Amplitude (n,) [rad] of a sine, with its first and second derivative."""

    size: Array
    rate: Array
    curvature: Array

    def scaled(self, factor: float) -> "Envelope":
        """The envelope times a factor."""
        return Envelope(factor * self.size, factor * self.rate, factor * self.curvature)

    def times(self, w: Array, phase: Array) -> JointMotion:
        """A sine of this amplitude with its derivatives; w [rad/s] is the derivative of the phase [rad]."""
        sine, cosine = np.sin(phase), np.cos(phase)
        return JointMotion(
            self.size * sine,
            self.size * w * cosine + self.rate * sine,
            -self.size * w**2 * sine + 2 * self.rate * w * cosine + self.curvature * sine,
        )


def ramped(size: Array, elapsed: Array, duration: Array, ramp_s: float) -> Envelope:
    """The amplitude (n,) [rad] that rises and falls as a cosine within `ramp_s` [s] at both ends of its piece."""
    still = np.zeros_like(size)
    if not ramp_s:
        return Envelope(size, still, still)
    inside, turn = np.clip(np.minimum(elapsed, duration - elapsed), 0, ramp_s), np.pi / ramp_s
    side, rises = np.where(elapsed < duration / 2, 1.0, -1.0), inside < ramp_s
    return Envelope(
        size * 0.5 * (1 - np.cos(turn * inside)),
        size * 0.5 * turn * np.sin(turn * inside) * side * rises,
        size * 0.5 * turn**2 * np.cos(turn * inside) * rises,
    )


def decaying(envelope: Envelope, elapsed: Array, rate: float) -> Envelope:
    """The envelope times exp(-rate t), t being the time [s] since the start of its piece."""
    if not rate:
        return envelope
    left, size, first, second = np.exp(-rate * elapsed), envelope.size, envelope.rate, envelope.curvature
    return Envelope(left * size, left * (first - rate * size), left * (second - 2 * rate * first + rate**2 * size))


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
    """Response of a second-order position loop to a command, from rest at the command's first angle.

    Between two samples the solution is exact for the cubic through the command's angles and velocities. A command that
    is linear between samples would cause corners in the acceleration, which are aliased by the rate of the log and bias
    J_j. Angle and derivatives come from one state, so that each is the true derivative of the one before.
    """
    w, step = 2 * np.pi * bandwidth_hz, 1 / rate_hz
    augmented = np.diag(np.ones(5), 1)
    augmented[1, :3] = -(w**2), -2 * damping_ratio * w, w**2
    transition = np.ascontiguousarray(scipy.linalg.expm(augmented * step)[:2])
    mean = np.diff(command.theta) / step
    first, second = command.omega[:-1], command.omega[1:]
    curvature, jerk = 2 * (3 * mean - 2 * first - second) / step, 6 * (first + second - 2 * mean) / step**2
    forcing = transition[:, 2:] @ np.vstack([command.theta[:-1], first, curvature, jerk])
    theta, omega = propagate(command.theta[0], np.ascontiguousarray(transition[:, :2]), forcing)
    return JointMotion(theta, omega, w**2 * (command.theta - theta) - 2 * damping_ratio * w * omega)


@compiled
def propagate(start: float, transition: Array, forcing: Array) -> Array:
    """Angle and velocity, shape (2, n), from rest at an angle [rad]; forcing has shape (2, n - 1)."""
    states = np.zeros((2, forcing.shape[1] + 1))
    states[0, 0] = start
    for i in range(forcing.shape[1]):
        angle, velocity = states[0, i], states[1, i]
        states[0, i + 1] = transition[0, 0] * angle + transition[0, 1] * velocity + forcing[0, i]
        states[1, i + 1] = transition[1, 0] * angle + transition[1, 1] * velocity + forcing[1, i]
    return states
