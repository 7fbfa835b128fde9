"""Motion of the joint on the dynamometer: commands, and the motor that follows them with finite
bandwidth."""

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from osl_analysis.model.compiled import compiled
from osl_analysis.model.multisine import odd_multisine
from osl_analysis.simulator.simulation_settings import (
    ActuatorBench,
    BeltMotion,
    Excitation,
    SlowCycles,
    SteppedSineSchedule,
)
from osl_analysis.trial import Array

# A person's hand
SLOW_IS_LARGE = 1.5  # power of the frequency by which the lines of a hand's motion fall
WANDERING_S = 4.0  # period [s] in which the size of the motion wanders
WANDERING_SIZE = 0.4  # share of the size


@dataclass(frozen=True)
class JointMotion:
    """An angle with its derivatives, each the true derivative of the one before."""

    theta: Array  # (n,) [rad]
    omega: Array  # (n,) [rad/s]
    alpha: Array  # (n,) [rad/s^2]

    def __mul__(self, other: "JointMotion") -> "JointMotion":
        """The product, as of a sine and its envelope, with its derivatives."""
        return JointMotion(
            theta=self.theta * other.theta,
            omega=self.omega * other.theta + self.theta * other.omega,
            alpha=(
                self.alpha * other.theta + 2 * self.omega * other.omega + self.theta * other.alpha
            ),
        )


def joined(motions: Sequence[JointMotion]) -> JointMotion:
    """Motions one after another."""
    return JointMotion(
        theta=np.concatenate([motion.theta for motion in motions]),
        omega=np.concatenate([motion.omega for motion in motions]),
        alpha=np.concatenate([motion.alpha for motion in motions]),
    )


def sine(w: Array | float, phase: Array, size: float = 1.0) -> JointMotion:
    """A sine; w [rad/s] is the derivative of the phase (n,) [rad], and constant or taken as it."""
    return JointMotion(
        theta=size * np.sin(phase),
        omega=size * w * np.cos(phase),
        alpha=-size * w**2 * np.sin(phase),
    )


def sine_command(protocol: SteppedSineSchedule, rate_hz: float) -> JointMotion:
    """Command the stepped sine from rest, each frequency with its ramps.

    The velocity jumps where the frequency changes, and the acceleration does not include these
    jumps.
    """
    sines = zip(protocol.durations, protocol.frequencies_hz, strict=True)
    block = [(duration + 2 * protocol.ramp_s, frequency) for duration, frequency in sines]
    block.append((protocol.rest_s, 0.0))  # a rest has no frequency
    pieces = [(protocol.lead_s, 0.0, 0.0)]  # duration [s], frequency [Hz], amplitude [deg]
    for amplitude_deg in protocol.amplitudes_deg:
        pieces += [(duration, frequency, amplitude_deg) for duration, frequency in block]

    starts = np.cumsum([0.0, *(duration for duration, _, _ in pieces)]).tolist()
    time = np.arange(round(starts[-1] * rate_hz)) / rate_hz
    borders = np.searchsorted(time, starts[:-1])
    motions = []
    for (duration, frequency, amplitude_deg), start, rows in zip(
        pieces, starts, np.split(time, borders)[1:], strict=False
    ):
        elapsed = rows - start
        w = 2 * math.pi * frequency
        envelope = ramped(elapsed, duration, protocol.ramp_s, math.radians(amplitude_deg))
        motions.append(envelope * sine(w, w * elapsed))
    return joined(motions)


def ramped(elapsed: Array, duration: float, ramp_s: float, size: float = 1.0) -> JointMotion:
    """An amplitude (n,) that rises and falls as a cosine within `ramp_s` [s] at both ends of its
    piece."""
    if not ramp_s:
        zero = np.zeros_like(elapsed)
        return JointMotion(np.full_like(elapsed, size), zero, zero)
    inside = np.clip(np.minimum(elapsed, duration - elapsed), 0, ramp_s)
    w = np.pi / ramp_s
    side = np.where(elapsed < duration / 2, 1.0, -1.0)
    is_ramp = inside < ramp_s
    return JointMotion(
        theta=size * 0.5 * (1 - np.cos(w * inside)),
        omega=size * 0.5 * w * np.sin(w * inside) * side * is_ramp,
        alpha=size * 0.5 * w**2 * np.cos(w * inside) * is_ramp,
    )


def there_and_back(belt: BeltMotion, rate_hz: float) -> JointMotion:
    """Command the belt experiment: a raised cosine of one period, between two rests."""
    time = np.arange(round(2 * (belt.ramp_s + belt.rest_s) * rate_hz)) / rate_hz
    w = np.pi / belt.ramp_s
    height = 0.5 * np.deg2rad(belt.amplitude_deg)
    phase = w * np.clip(time - belt.rest_s, 0.0, 2 * belt.ramp_s)
    moves = (phase > 0) & (phase < 2 * np.pi)
    return JointMotion(
        theta=height * (1 - np.cos(phase)),
        omega=height * w * np.sin(phase),
        alpha=height * w**2 * np.where(moves, np.cos(phase), 0.0),
    )


def position_loop(
    command: JointMotion, rate_hz: float, bandwidth_hz: float, damping_ratio: float
) -> JointMotion:
    """Follow a command with a second-order position loop, from rest at the command's first angle.

    Between two samples the solution is exact for the cubic through the command's angles and
    velocities: straight lines would cause corners in the acceleration, which are aliased by the
    rate of the log and bias J_j.
    """
    w = 2 * np.pi * bandwidth_hz
    step = 1 / rate_hz
    # rates of theta, omega, and of the command with its three derivatives
    rates = np.diag(np.ones(5), 1)
    rates[1, :3] = -(w**2), -2 * damping_ratio * w, w**2
    transition = np.ascontiguousarray(scipy.linalg.expm(rates * step)[:2])
    theta, omega = propagate(transition, command.theta, command.omega, step)
    alpha = w**2 * (command.theta - theta) - 2 * damping_ratio * w * omega
    return JointMotion(theta, omega, alpha)


@compiled
def propagate(transition: Array, commanded: Array, speed: Array, step: float) -> Array:
    """Angle and velocity, shape (2, n), from rest at the first of the commanded angles [rad], (n,),
    with their speeds.

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


def excitation_motion(excitation: Excitation, trial: str, seed: int, rate_hz: float) -> JointMotion:
    """Command the motion of one trial, from rest to rest: realisations with their fades."""
    duration = excitation.full_s + 2 * excitation.fade_s
    time = np.arange(round(duration * rate_hz)) / rate_hz
    zeros = np.zeros(round(excitation.rest_s * rate_hz))
    rest = JointMotion(zeros, zeros, zeros)
    parts = [rest]
    for number in range(excitation.realisations):
        draws = np.random.default_rng(
            [seed, zlib.crc32(trial.encode()), zlib.crc32(b"excitation"), number]
        )
        steady = steady_motion(excitation, time, draws)
        parts.append(ramped(time, duration, excitation.fade_s) * steady)
        parts.append(rest)
    return joined(parts)


def steady_motion(excitation: Excitation, time: Array, draws: np.random.Generator) -> JointMotion:
    """One realisation at full size at times (n,) [s], which goes on through the fades."""
    motion_of_kind = {
        "multisine": multisine_motion,
        "chirp": chirp_motion,
        "prbs": prbs_motion,
        "ramps": ramps_motion,
    }
    return motion_of_kind.get(excitation.kind, noise_motion)(excitation, time, draws)


def multisine_motion(
    excitation: Excitation, time: Array, draws: np.random.Generator
) -> JointMotion:
    """An odd multisine; a trial's realisations have the same lines."""
    multisine = odd_multisine(
        excitation.period_s,
        excitation.band_hz,
        rms=float(np.deg2rad(excitation.rms_deg)),
        seed=zlib.crc32(excitation.name.encode()),
        realisation=int(draws.integers(2**31)),
    )
    return JointMotion(multisine.angle(time), multisine.angle(time, 1), multisine.angle(time, 2))


def chirp_motion(excitation: Excitation, time: Array, draws: np.random.Generator) -> JointMotion:
    """A linear sweep over the band, as long as the motion at full size; beyond it goes on at its
    last frequency."""
    low, high = excitation.band_hz
    sweep_rate = 2 * np.pi * (high - low) / excitation.full_s
    t = time - excitation.fade_s
    inside = np.clip(t, 0, excitation.full_s)
    w = 2 * np.pi * low + sweep_rate * inside
    phase = 2 * np.pi * low * np.minimum(t, 0) + 2 * np.pi * low * inside
    phase = phase + sweep_rate * inside**2 / 2
    phase = phase + 2 * np.pi * high * np.maximum(t - excitation.full_s, 0)
    phase = phase + draws.uniform(0, 2 * np.pi)
    size = float(np.sqrt(2) * np.deg2rad(excitation.rms_deg))
    is_sweep = (t > 0) & (t < excitation.full_s)
    of_constant_frequency = sine(w, phase, size)
    alpha = of_constant_frequency.alpha + size * sweep_rate * is_sweep * np.cos(phase)
    return replace(of_constant_frequency, alpha=alpha)


def noise_motion(excitation: Excitation, time: Array, draws: np.random.Generator) -> JointMotion:
    """Gaussian noise, flat within the band and nothing beyond; or as a person moves a joint by
    `hand`: slow motions are the larger, and the size of the motion wanders within 4 s.

    Derivatives are those of its lines.
    """
    low, high = excitation.band_hz
    n = len(time)
    f = np.fft.rfftfreq(n, time[1])
    by_hand = excitation.kind == "hand"
    gain = ((f >= low) & (f <= high)) / (np.maximum(f, low) ** SLOW_IS_LARGE if by_hand else 1.0)
    lines = gain * (draws.standard_normal(len(gain)) + 1j * draws.standard_normal(len(gain)))
    lines *= np.deg2rad(excitation.rms_deg) / np.std(np.fft.irfft(lines, n))
    s = 1j * (2 * np.pi * f)
    steady = JointMotion(*(np.fft.irfft(s**derivative * lines, n) for derivative in range(3)))
    if not by_hand:
        return steady
    w = 2 * np.pi / WANDERING_S
    wandering = sine(w, w * time + draws.uniform(0, 2 * np.pi), WANDERING_SIZE)
    return replace(wandering, theta=1 + wandering.theta) * steady


def prbs_motion(excitation: Excitation, time: Array, draws: np.random.Generator) -> JointMotion:
    """A random binary sequence. It jumps between samples, with no velocity at them, unless it is
    smoothed."""
    clock = np.floor(time / excitation.clock_s).astype(np.intp)
    signs = draws.choice([-1.0, 1.0], clock[-1] + 1)
    theta = np.deg2rad(excitation.rms_deg) * signs[clock]
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
    slopes = np.diff(angles) / excitation.clock_s
    ramp = np.minimum((time / excitation.clock_s).astype(np.intp), len(slopes) - 1)
    return JointMotion(np.interp(time, corners, angles), slopes[ramp], np.zeros_like(time))


def slow_cycles(cycles: SlowCycles, rate_hz: float) -> JointMotion:
    """Command torque-angle trials; ramps blend into each other at a constant acceleration."""
    range_deg = cycles.highest_deg - cycles.lowest_deg
    rest = np.zeros(round(cycles.rest_s * rate_hz))
    velocities = [rest]  # [deg/s]
    for speed in cycles.speed_deg_s:
        for way in (cycles.lowest_deg, range_deg, -cycles.highest_deg):
            if way:
                rows = round(abs(way) / speed * rate_hz)
                velocities.append(np.full(rows, np.sign(way) * speed))
    velocities.append(rest)
    turn = max(round(cycles.turn_s * rate_hz), 1)
    blended = np.convolve(np.concatenate(velocities), np.full(turn, 1 / turn), mode="same")
    omega = np.deg2rad(blended)
    theta = np.concatenate([[0.0], np.cumsum((omega[1:] + omega[:-1]) / 2)]) / rate_hz
    return JointMotion(theta, omega, np.gradient(omega) * rate_hz)


def actuator_command(bench: ActuatorBench, rate_hz: float) -> tuple[JointMotion, Array]:
    """Command the actuator's own bench: tones of velocity and of current.

    Returns
    -------
    motion : JointMotion
        Of the output.
    current : Array
        (n,) [A]. Both fade in and out within `fade_s` with continuous derivatives.
    """
    time = np.arange(round(bench.duration_s * rate_hz)) / rate_hz
    fading = fade(bench, time)
    w = 2 * np.pi * np.array([[tone.frequency_hz] for tone in bench.velocity])
    size = np.array([[tone.size] for tone in bench.velocity])
    tones = JointMotion(
        theta=(size / w * (1 - np.cos(w * time))).sum(axis=0),
        omega=(size * np.sin(w * time)).sum(axis=0),
        alpha=(size * w * np.cos(w * time)).sum(axis=0),
    )
    current = sum(
        tone.size * np.sin(2 * np.pi * tone.frequency_hz * time) for tone in bench.current
    )
    return fading * tones, np.asarray(current * fading.theta)


def fade(bench: ActuatorBench, time: Array) -> JointMotion:
    """A factor that grows from 0 to 1 and back within `fade_s`, by 10 u^3 - 15 u^4 + 6 u^5."""
    u = np.clip(np.minimum(time, bench.duration_s - time) / bench.fade_s, 0.0, 1.0)
    slope = np.where(time < bench.duration_s / 2, 1.0, -1.0) / bench.fade_s  # du/dt
    return JointMotion(
        theta=u**3 * (10 - 15 * u + 6 * u**2),
        omega=30 * u**2 * (1 - u) ** 2 * slope,
        alpha=60 * u * (1 - u) * (1 - 2 * u) * slope**2,
    )
