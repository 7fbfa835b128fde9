"""Motion of the joint on the dynamometer: commands, and the motor that follows them with finite
bandwidth."""

import math
import zlib
from dataclasses import dataclass, replace

import numpy as np
import scipy

from osl_analysis.model.compiled import compiled
from osl_analysis.model.multisine import odd_multisine
from osl_analysis.simulator.settings import (
    ActuatorBench,
    BeltMotion,
    Excitation,
    SlowCycles,
    SteppedSineSchedule,
)
from osl_analysis.trial import Array


@dataclass(frozen=True)
class JointMotion:
    """theta [rad], omega [rad/s], alpha [rad/s^2], each the true derivative of the one before;
    shape (n,)."""

    theta: Array
    omega: Array
    alpha: Array

    def __mul__(self, other: "JointMotion") -> "JointMotion":
        """The product, as of a sine and its envelope, with its derivatives."""
        return JointMotion(
            self.theta * other.theta,
            self.omega * other.theta + self.theta * other.omega,
            self.alpha * other.theta + 2 * self.omega * other.omega + self.theta * other.alpha,
        )


def sine(w: Array | float, phase: Array, size: float = 1.0) -> JointMotion:
    """A sine; w [rad/s] is the derivative of the phase (n,) [rad], and constant or taken as it."""
    return JointMotion(size * np.sin(phase), size * w * np.cos(phase), -size * w**2 * np.sin(phase))


def sine_command(protocol: SteppedSineSchedule, rate_hz: float) -> JointMotion:
    """The commanded stepped sine from rest, sampled at `rate_hz` [Hz], each frequency with its
    ramps. The velocity jumps where the frequency changes, and the acceleration does not include
    these jumps."""
    sines = zip(protocol.durations, protocol.frequencies_hz, strict=True)
    block = [(lasts + 2 * protocol.ramp_s, f) for lasts, f in sines]
    # start [s], duration [s], angular frequency [rad/s] and amplitude [rad]; rests have w = 0
    pieces, end = [(0.0, protocol.lead_s, 0.0, 0.0)], protocol.lead_s
    for degrees in protocol.amplitudes_deg:
        for duration, f in (*block, (protocol.rest_s, 0.0)):
            pieces.append((end, duration, 2 * math.pi * f, math.radians(degrees)))
            end += duration
    time = np.arange(round(end * rate_hz)) / rate_hz
    first, motion = (
        [*np.searchsorted(time, [start for start, *_ in pieces]), len(time)],
        np.zeros((3, len(time))),
    )
    for (start, duration, w, amplitude), *ends in zip(pieces, first[:-1], first[1:], strict=True):
        elapsed = time[slice(*ends)] - start
        made = ramped(elapsed, duration, protocol.ramp_s, amplitude) * sine(w, w * elapsed)
        motion[:, slice(*ends)] = made.theta, made.omega, made.alpha
    return JointMotion(*motion)


def ramped(elapsed: Array, duration: float, ramp_s: float, size: float = 1.0) -> JointMotion:
    """An amplitude (n,) that rises and falls as a cosine within `ramp_s` [s] at both ends of its
    piece."""
    if not ramp_s:
        return JointMotion(np.full_like(elapsed, size), *np.zeros((2, len(elapsed))))
    inside, turn = np.clip(np.minimum(elapsed, duration - elapsed), 0, ramp_s), np.pi / ramp_s
    side, rises = np.where(elapsed < duration / 2, 1.0, -1.0), inside < ramp_s
    return JointMotion(
        size * 0.5 * (1 - np.cos(turn * inside)),
        size * 0.5 * turn * np.sin(turn * inside) * side * rises,
        size * 0.5 * turn**2 * np.cos(turn * inside) * rises,
    )


def there_and_back(belt: BeltMotion, rate_hz: float) -> JointMotion:
    """The belt experiment's command: a raised cosine of one period, between two rests."""
    time = np.arange(round(2 * (belt.ramp_s + belt.rest_s) * rate_hz)) / rate_hz
    w, height = np.pi / belt.ramp_s, 0.5 * np.deg2rad(belt.amplitude_deg)
    phase = w * np.clip(time - belt.rest_s, 0.0, 2 * belt.ramp_s)
    moves = (phase > 0) & (phase < 2 * np.pi)
    alpha = height * w**2 * np.where(moves, np.cos(phase), 0.0)
    return JointMotion(height * (1 - np.cos(phase)), height * w * np.sin(phase), alpha)


def position_loop(
    command: JointMotion, rate_hz: float, bandwidth_hz: float, damping_ratio: float
) -> JointMotion:
    """Response of a second-order position loop to a command, from rest at the command's first
    angle. Between two samples the solution is exact for the cubic through the command's angles and
    velocities: straight lines would cause corners in the acceleration, which are aliased by the
    rate of the log and bias J_j."""
    w, step = 2 * np.pi * bandwidth_hz, 1 / rate_hz
    augmented = np.diag(np.ones(5), 1)
    augmented[1, :3] = -(w**2), -2 * damping_ratio * w, w**2
    transition = np.ascontiguousarray(scipy.linalg.expm(augmented * step)[:2])
    theta, omega = propagate(transition, command.theta, command.omega, step)
    return JointMotion(theta, omega, w**2 * (command.theta - theta) - 2 * damping_ratio * w * omega)


@compiled
def propagate(transition: Array, commanded: Array, speed: Array, step: float) -> Array:
    """Angle and velocity, shape (2, n), from rest at the first of the commanded angles [rad], (n,),
    with their speeds. `transition` (2, 6) takes both, and the command with its three derivatives,
    over a step [s]."""
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


def excitation_motion(excitation: Excitation, trial: str, seed: int, rate_hz: float) -> JointMotion:
    """The commanded motion of one trial, from rest to rest, sampled at `rate_hz`: realisations with
    their fades."""
    rest, whole = (
        np.zeros(round(excitation.rest_s * rate_hz)),
        excitation.full_s + 2 * excitation.fade_s,
    )
    time, parts = np.arange(round(whole * rate_hz)) / rate_hz, [(rest, rest, rest)]
    made = {"chirp": chirp_motion, "prbs": prbs_motion, "ramps": ramps_motion}
    for number in range(excitation.realisations):
        draws = np.random.default_rng(
            [seed, zlib.crc32(trial.encode()), zlib.crc32(b"excitation"), number]
        )
        # it goes on through the fades; a trial's realisations have the same lines
        if excitation.kind == "multisine":
            own, rms = int(draws.integers(2**31)), float(np.deg2rad(excitation.rms_deg))
            lines = zlib.crc32(excitation.name.encode())
            multisine = odd_multisine(excitation.period_s, excitation.band_hz, rms, lines, own)
            one = JointMotion(*(multisine.angle(time, derivative) for derivative in range(3)))
        else:
            one = made.get(excitation.kind, noise_motion)(excitation, time, draws)
        one = ramped(time, whole, excitation.fade_s) * one
        parts += [(one.theta, one.omega, one.alpha), (rest, rest, rest)]
    return JointMotion(*(np.concatenate(signal) for signal in zip(*parts, strict=True)))


def chirp_motion(excitation: Excitation, time: Array, draws: np.random.Generator) -> JointMotion:
    """A linear sweep over the band, as long as the motion at full size; beyond it goes on at its
    last frequency."""
    low, high = excitation.band_hz
    rate = 2 * np.pi * (high - low) / excitation.full_s
    t = time - excitation.fade_s
    inside = np.clip(t, 0, excitation.full_s)
    w = 2 * np.pi * low + rate * inside
    phase = 2 * np.pi * low * np.minimum(t, 0) + 2 * np.pi * low * inside + rate * inside**2 / 2
    phase = (
        phase
        + 2 * np.pi * high * np.maximum(t - excitation.full_s, 0)
        + draws.uniform(0, 2 * np.pi)
    )
    size, sweeps = (
        float(np.sqrt(2) * np.deg2rad(excitation.rms_deg)),
        (t > 0) & (t < excitation.full_s),
    )
    steady = sine(w, phase, size)
    return replace(steady, alpha=steady.alpha + size * rate * sweeps * np.cos(phase))


def noise_motion(excitation: Excitation, time: Array, draws: np.random.Generator) -> JointMotion:
    """Gaussian noise, flat within the band and nothing beyond; or as a person moves a joint by
    `hand`: slow motions are the larger, and the size of the motion wanders within 4 s. Derivatives
    are those of its lines."""
    low, high = excitation.band_hz
    n, f, by_hand = len(time), np.fft.rfftfreq(len(time), time[1]), excitation.kind == "hand"
    w = 2 * np.pi * f
    gain = ((f >= low) & (f <= high)) / (np.maximum(f, low) ** 1.5 if by_hand else 1.0)
    lines = gain * (draws.standard_normal(len(gain)) + 1j * draws.standard_normal(len(gain)))
    lines *= np.deg2rad(excitation.rms_deg) / np.std(np.fft.irfft(lines, n))
    steady = JointMotion(
        *(np.fft.irfft((1j * w) ** derivative * lines, n) for derivative in range(3))
    )
    if not by_hand:
        return steady
    turn = 2 * np.pi / 4.0
    wandering = sine(turn, turn * time + draws.uniform(0, 2 * np.pi), 0.4)
    return replace(wandering, theta=1 + wandering.theta) * steady


def prbs_motion(excitation: Excitation, time: Array, draws: np.random.Generator) -> JointMotion:
    """A random binary sequence. It jumps between samples, with no velocity at them, unless it is
    smoothed."""
    held = np.floor(time / excitation.clock_s).astype(np.intp)
    theta = np.deg2rad(excitation.rms_deg) * draws.choice([-1.0, 1.0], held[-1] + 1)[held]
    if excitation.smoothing_hz is None:
        return JointMotion(theta, np.zeros_like(theta), np.zeros_like(theta))
    low_pass = scipy.signal.butter(4, excitation.smoothing_hz, fs=1 / time[1], output="sos")
    smooth = scipy.signal.sosfilt(low_pass, theta)
    omega = np.gradient(smooth, time)
    return JointMotion(smooth, omega, np.gradient(omega, time))


def ramps_motion(excitation: Excitation, time: Array, draws: np.random.Generator) -> JointMotion:
    """Constant velocities from one random angle to the next; the velocity jumps at these angles."""
    corners = np.arange(0, time[-1] + 2 * excitation.clock_s, excitation.clock_s)
    angles = np.sqrt(3) * np.deg2rad(excitation.rms_deg) * draws.uniform(-1, 1, len(corners))
    slope = np.diff(angles) / excitation.clock_s
    own = np.minimum((time / excitation.clock_s).astype(np.intp), len(slope) - 1)
    return JointMotion(np.interp(time, corners, angles), slope[own], np.zeros_like(time))


def slow_cycles(cycles: SlowCycles, rate_hz: float) -> JointMotion:
    """The command of torque-angle trials; ramps blend into each other at a constant
    acceleration."""
    pieces = [(0.0, cycles.rest_s)]
    for speed in cycles.speed_deg_s:
        for way in (cycles.lowest_deg, cycles.highest_deg - cycles.lowest_deg, -cycles.highest_deg):
            pieces += [(np.sign(way) * speed, abs(way) / speed)] if way else []
    pieces.append((0.0, cycles.rest_s))
    steps = [np.full(round(duration * rate_hz), velocity) for velocity, duration in pieces]
    turn = max(round(cycles.turn_s * rate_hz), 1)
    omega = np.deg2rad(np.convolve(np.concatenate(steps), np.full(turn, 1 / turn), mode="same"))
    theta = np.concatenate([[0.0], np.cumsum((omega[1:] + omega[:-1]) / 2)]) / rate_hz
    return JointMotion(theta, omega, np.gradient(omega) * rate_hz)


def actuator_command(bench: ActuatorBench, rate_hz: float) -> tuple[JointMotion, Array]:
    """The commanded angle of the actuator's own bench, with its derivatives, and the current [A],
    (n,) each: tones of velocity and of current, which fade in and out within `fade_s` with
    continuous derivatives."""
    time = np.arange(round(bench.duration_s * rate_hz)) / rate_hz
    u = np.clip(np.minimum(time, bench.duration_s - time) / bench.fade_s, 0.0, 1.0)
    side = np.where(time < bench.duration_s / 2, 1.0, -1.0) / bench.fade_s
    fading = JointMotion(
        u**3 * (10 - 15 * u + 6 * u**2),
        30 * u**2 * (1 - u) ** 2 * side,
        60 * u * (1 - u) * (1 - 2 * u) * side**2,
    )
    w = 2 * np.pi * np.array([[tone.frequency_hz] for tone in bench.velocity])
    size = np.array([[tone.size] for tone in bench.velocity])
    tones = size / w * (1 - np.cos(w * time)), size * np.sin(w * time), size * w * np.cos(w * time)
    current = sum(
        tone.size * np.sin(2 * np.pi * tone.frequency_hz * time) for tone in bench.current
    )
    return fading * JointMotion(*(x.sum(axis=0) for x in tones)), np.asarray(current * fading.theta)
