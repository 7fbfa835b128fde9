"""Motion of the joint on the dynamometer: commands, and the motor that follows them with finite
bandwidth."""

import zlib
from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.model.multisine import odd_multisine
from osl_analysis.simulator.simulation_settings import (
    ActuatorBench,
    BeltMotion,
    Excitation,
    SteppedSineSchedule,
)
from osl_analysis.trial import Array

# A person's hand
SLOW_IS_LARGE = 1.5  # power of the frequency by which the lines of a hand's motion fall
WANDERING_S = 4.0  # period [s] in which the size of the motion wanders
WANDERING_SIZE = 0.4  # share of the size

# from 0 to 1, with two derivatives that vanish at both ends
FADE = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])


@dataclass(frozen=True)
class JointMotion:
    """An angle with its derivatives, each the true derivative of the one before."""

    theta: Array  # (n,) [rad]
    omega: Array  # (n,) [rad/s]
    alpha: Array  # (n,) [rad/s^2]


def smooth_motion(theta: Array, rate_hz: float) -> JointMotion:
    """A motion whose velocity and acceleration are those of a spline through its angle."""
    spline = scipy.interpolate.CubicSpline(np.arange(len(theta)) / rate_hz, theta)
    return JointMotion(theta, spline(spline.x, 1), spline(spline.x, 2))


def sine_command(protocol: SteppedSineSchedule, rate_hz: float) -> JointMotion:
    """Command the stepped sine from rest.

    The velocity jumps where the frequency changes, and the acceleration does not include these
    jumps.
    """
    block = [*zip(protocol.durations, protocol.frequencies_hz, strict=True)]
    block.append((protocol.rest_s, 0.0))  # a rest has no frequency
    pieces = [(protocol.lead_s, 0.0, 0.0)]  # duration [s], frequency [Hz], amplitude [deg]
    for amplitude_deg in protocol.amplitudes_deg:
        pieces += [(duration, frequency, amplitude_deg) for duration, frequency in block]

    ends = np.cumsum([duration for duration, _, _ in pieces])
    time = np.arange(round(ends[-1] * rate_hz)) / rate_hz
    starts = np.array([0.0, *ends[:-1]])
    piece = np.searchsorted(starts, time, side="right") - 1  # (n,) to which a sample belongs
    _, frequency, amplitude_deg = np.array(pieces).T[:, piece]
    w = 2 * np.pi * frequency
    phase = w * (time - starts[piece])
    size = np.deg2rad(amplitude_deg)
    return JointMotion(
        theta=size * np.sin(phase),
        omega=size * (w * np.cos(phase)),
        alpha=size * (-(w**2) * np.sin(phase)),
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
    transition = scipy.linalg.expm(rates * step)[:2]  # over a step

    angle = command.theta - command.theta[0]
    speed = command.omega
    mean = np.diff(angle) / step
    curvature = 2.0 * (3.0 * mean - 2.0 * speed[:-1] - speed[1:]) / step
    jerk = 6.0 * (speed[:-1] + speed[1:] - 2.0 * mean) / step**2
    forced = transition[:, 2:] @ np.array([angle[:-1], speed[:-1], curvature, jerk])
    (a, b), (c, d) = transition[:, :2]
    poles = [1, -(a + d), a * d - b * c]
    theta, omega = np.zeros((2, len(angle)))
    by_angle, by_speed = forced
    theta[1:] = scipy.signal.lfilter([1, -d], poles, by_angle)
    theta[1:] += scipy.signal.lfilter([0, b], poles, by_speed)
    omega[1:] = scipy.signal.lfilter([0, c], poles, by_angle)
    omega[1:] += scipy.signal.lfilter([1, -a], poles, by_speed)
    alpha = w**2 * (angle - theta) - 2 * damping_ratio * w * omega
    return JointMotion(command.theta[0] + theta, omega, alpha)


def excitation_motion(excitation: Excitation, trial: str, seed: int, rate_hz: float) -> JointMotion:
    """Command the motion of one trial, from rest to rest, with its fades."""
    duration = excitation.full_s + 2 * excitation.fade_s
    time = np.arange(round(duration * rate_hz)) / rate_hz
    envelope = scipy.signal.windows.tukey(len(time), 2 * excitation.fade_s / duration, sym=False)
    draws = np.random.default_rng([seed, zlib.crc32(trial.encode()), zlib.crc32(b"excitation"), 0])
    shape = steady_angle(excitation, time, draws)
    theta = np.deg2rad(excitation.rms_deg) * envelope * shape
    return smooth_motion(np.pad(theta, round(excitation.rest_s * rate_hz)), rate_hz)


def steady_angle(excitation: Excitation, time: Array, draws: np.random.Generator) -> Array:
    """The angle at full size over its RMS, at times (n,) [s]; it goes on through the fades."""
    low, high = excitation.band_hz
    steps = np.floor(time / excitation.clock_s).astype(np.intp)
    if excitation.kind == "multisine":  # trials of one name have the same lines
        lines_of = zlib.crc32(excitation.name.encode())
        phases_of = int(draws.integers(2**31))
        period_s = excitation.period_s
        return odd_multisine(period_s, (low, high), 1.0, lines_of, phases_of).angle(time)
    if excitation.kind == "chirp":
        since_full = time - excitation.fade_s
        phase_deg = draws.uniform(0, 360) - 90  # of a cosine
        sweep = scipy.signal.chirp(since_full, low, excitation.full_s, high, phi=phase_deg)
        return np.asarray(np.sqrt(2) * sweep)
    if excitation.kind == "prbs":
        signs = draws.choice([-1.0, 1.0], steps[-1] + 1)
        low_pass = scipy.signal.butter(4, excitation.smoothing_hz, fs=1 / time[1], output="sos")
        return np.asarray(scipy.signal.sosfilt(low_pass, signs[steps]))
    return noise(excitation, time, draws)


def noise(excitation: Excitation, time: Array, draws: np.random.Generator) -> Array:
    """Gaussian noise (n,) of unit RMS, flat within the band and nothing beyond; or as a person
    moves a joint by `hand`: slow motions are the larger, and the size of the motion wanders within
    4 s."""
    low, high = excitation.band_hz
    f = np.fft.rfftfreq(len(time), time[1])
    gain = ((f >= low) & (f <= high)).astype(float)
    by_hand = excitation.kind == "hand"
    if by_hand:
        gain /= np.maximum(f, low) ** SLOW_IS_LARGE
    lines = gain * (draws.standard_normal(len(f)) + 1j * draws.standard_normal(len(f)))
    steady = np.fft.irfft(lines, len(time))
    steady /= np.std(steady)
    if not by_hand:
        return np.asarray(steady)
    phase = draws.uniform(0, 2 * np.pi)
    wandering = np.sin(2 * np.pi / WANDERING_S * time + phase)
    return np.asarray(steady * (1 + WANDERING_SIZE * wandering))


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
    u = np.clip(np.minimum(time, bench.duration_s - time) / bench.fade_s, 0.0, 1.0)
    slope = np.where(time < bench.duration_s / 2, 1.0, -1.0) / bench.fade_s  # du/dt
    fade = FADE(u)
    fade_rate = FADE.deriv(1)(u) * slope

    theta, omega, alpha, current = np.zeros((4, len(time)))
    for tone in bench.velocity:
        w = 2 * np.pi * tone.frequency_hz
        theta += tone.size / w * (1 - np.cos(w * time))
        omega += tone.size * np.sin(w * time)
        alpha += tone.size * w * np.cos(w * time)
    for tone in bench.current:
        current += tone.size * np.sin(2 * np.pi * tone.frequency_hz * time)
    motion = JointMotion(
        theta=fade * theta,
        omega=fade_rate * theta + fade * omega,
        alpha=FADE.deriv(2)(u) * slope**2 * theta + 2 * fade_rate * omega + fade * alpha,
    )
    return motion, fade * current
