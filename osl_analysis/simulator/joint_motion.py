"""Motion of the joint on the dynamometer: commands, and the motor that follows them with finite bandwidth."""

import math
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
class Piece:
    """A rest (w = 0) or a frequency of a stepped sine."""

    start: float
    """[s], on the clock of the log."""
    duration: float
    """[s], as of its start."""
    w: float
    """Angular frequency [rad/s]."""
    amplitude: float
    """[rad]."""

    @property
    def end(self) -> float:
        """End [s]."""
        return self.start + self.duration


def stepped_sine_pieces(protocol: SteppedSineSchedule) -> list[Piece]:
    """The rests and frequencies of a stepped sine, on the clock of the log."""
    between = [(protocol.rest_between_s, 0.0)] if protocol.rest_between_s else []
    sines = zip(protocol.durations, protocol.frequencies_hz, strict=True)
    block = [piece for sine, f in sines for piece in ((sine + 2 * protocol.ramp_s, f), *between)]
    faster = 1 + 1e-6 * protocol.clock_error.value
    pieces = [Piece(0.0, protocol.lead_s / faster, 0.0, 0.0)]
    for degrees in protocol.amplitudes_deg:
        for duration, f in (*block, (protocol.rest_s, 0.0)):
            w = 2 * math.pi * f * faster
            pieces.append(Piece(pieces[-1].end, duration / faster, w, math.radians(degrees)))
    return pieces


def stepped_sine(protocol: SteppedSineSchedule, rate_hz: float) -> JointMotion:
    """The commanded stepped sine from rest, sampled at `rate_hz` [Hz].

    The phase is continuous where the frequency changes, and a multiple of 2 pi where the amplitude changes. The angle
    therefore has no jumps, unless a frequency starts as a cosine or does not end with a whole cycle. The velocity jumps
    at these changes. If the command is followed exactly, the acceleration does not include these jumps.
    """
    pieces = stepped_sine_pieces(protocol)
    time = np.arange(round(pieces[-1].end * rate_hz)) / rate_hz
    motion = JointMotion(*np.zeros((3, len(time))))
    first = [*np.searchsorted(time, [piece.start for piece in pieces]), len(time)]
    for piece, *ends in zip(pieces, first[:-1], first[1:], strict=True):
        if piece.w > 0:
            rows = slice(*ends)
            turning = piece_motion(piece, time[rows] - piece.start, protocol)
            motion.theta[rows], motion.omega[rows], motion.alpha[rows] = turning.theta, turning.omega, turning.alpha
    return motion


def piece_motion(piece: Piece, elapsed: Array, protocol: SteppedSineSchedule) -> JointMotion:
    """The motion at one frequency, at times (n,) [s] since its start, with its ramps and harmonics."""
    size, w = np.full_like(elapsed, piece.amplitude), piece.w
    envelope = decaying(ramped(size, elapsed, piece.duration, protocol.ramp_s), elapsed, protocol.decay.value)
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

    def times(self, w: Array | float, phase: Array) -> JointMotion:
        """A sine of this amplitude with its derivatives; w [rad/s] is the derivative of the phase [rad]."""
        sine, cosine = np.sin(phase), np.cos(phase)
        return JointMotion(
            self.size * sine,
            self.size * w * cosine + self.rate * sine,
            -self.size * w**2 * sine + 2 * self.rate * w * cosine + self.curvature * sine,
        )


def ramped(size: Array, elapsed: Array, duration: float, ramp_s: float) -> Envelope:
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
    theta, omega = propagate(transition, command.theta, command.omega, step)
    return JointMotion(theta, omega, w**2 * (command.theta - theta) - 2 * damping_ratio * w * omega)


@compiled
def propagate(transition: Array, commanded: Array, speed: Array, step: float) -> Array:
    """Angle and velocity, shape (2, n), from rest at the first of the commanded angles [rad], (n,), with their speeds.

    `transition` (2, 6) takes both, and the command with its three derivatives, over a step [s].
    """
    states = np.zeros((2, len(commanded)))
    states[0, 0] = commanded[0]
    for i in range(len(commanded) - 1):
        mean = (commanded[i + 1] - commanded[i]) / step
        curvature = 2.0 * (3.0 * mean - 2.0 * speed[i] - speed[i + 1]) / step
        jerk = 6.0 * (speed[i] + speed[i + 1] - 2.0 * mean) / step**2
        for row in range(2):
            t = transition[row]
            forced = t[2] * commanded[i] + t[3] * speed[i] + t[4] * curvature + t[5] * jerk
            states[row, i + 1] = t[0] * states[0, i] + t[1] * states[1, i] + forced
    return states
