"""Motions of the simulated dynamometer that are no stepped sine: their settings, and the commanded motion."""

import zlib
from typing import Annotated, Literal, Self

import numpy as np
import scipy
from pydantic import Field, model_validator

from osl_analysis.multisine import odd_multisine
from osl_analysis.simulator.effect import NotNegative, Positive
from osl_analysis.simulator.joint_motion import Envelope, JointMotion, ramped
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Degrees, Settings

Kind = Literal["multisine", "chirp", "noise", "prbs", "ramps", "hand"]
SMOOTHING_ORDER = 4
"""Order of the Butterworth low-pass that smooths a binary command."""
HAND_WANDERS_S = 4.0
"""Time [s] over which a hand changes how far it moves."""


class Excitation(Settings):
    """One motion of the joint, and how many trials of each impedance have it. Each trial has random numbers of its own.

    multisine: odd lines of a period with random phases, one in four left out; chirp: a linear sweep; noise: Gaussian,
    flat within the band; prbs: a random binary sequence; ramps: constant velocities between random angles; hand: slow
    noise that wanders in size.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9]{0,30}$")]
    """Its name, a part of the names of its trials."""
    kind: Kind
    """The motion."""
    rms_deg: Degrees
    """Root mean square [deg] of the angle; of a binary sequence half its step, of ramps a third of their range."""
    band_hz: tuple[Positive, Positive] = (0.5, 6.0)
    """Lowest and highest frequency [Hz]; a binary sequence and ramps have none."""
    duration_s: Positive = 60.0
    """Duration [s] of the motion at full size; of a multisine see `periods`."""
    period_s: Positive = 8.0
    """Period [s] of a multisine."""
    periods: Annotated[int, Field(ge=1, le=1000)] = 5
    """Periods of each realisation of a multisine."""
    realisations: Annotated[int, Field(ge=1, le=100)] = 1
    """Motions in one recording, one after the other with a rest between, each of other random numbers."""
    trials: Annotated[int, Field(ge=1, le=1000)] = 1
    """Number of trials."""
    clock_s: Positive = 0.1
    """Time [s] between two changes of a binary sequence, or of the velocity of ramps."""
    smoothing_hz: Positive | None = None
    """Cut-off [Hz] of the low-pass over a binary sequence; null: it jumps."""
    fade_s: Positive = 1.0
    """Time [s] in which the motion grows to its full size, and goes back to rest, in addition to its duration."""
    rest_s: NotNegative = 1.5
    """Rest [s] before and after each motion."""

    @model_validator(mode="after")
    def _band_rises(self) -> Self:
        if self.band_hz[0] >= self.band_hz[1]:
            raise ValueError(
                f"band_hz goes from {self.band_hz[0]:g} to {self.band_hz[1]:g} Hz; write the lower one first"
            )
        return self

    @property
    def full_s(self) -> float:
        """Duration [s] of one realisation at full size."""
        return self.period_s * self.periods if self.kind == "multisine" else self.duration_s

    @property
    def total_s(self) -> float:
        """Duration [s] of a trial."""
        return self.rest_s + self.realisations * (self.full_s + 2 * self.fade_s + self.rest_s)

    @property
    def trial_endings(self) -> list[str]:
        """Endings of the names of its trials."""
        return [f"{self.name}_{number + 1}" for number in range(self.trials)]


def excitation_motion(excitation: Excitation, trial: str, seed: int, rate_hz: float) -> JointMotion:
    """The commanded motion of one trial, from rest to rest, sampled at `rate_hz` [Hz]."""
    rest = np.zeros(round(excitation.rest_s * rate_hz))
    parts = [(rest, rest, rest)]
    for number in range(excitation.realisations):
        one = realisation(excitation, trial, seed, number, rate_hz)
        parts += [(one.theta, one.omega, one.alpha), (rest, rest, rest)]
    return JointMotion(*(np.concatenate(signal) for signal in zip(*parts, strict=True)))


def realisation(excitation: Excitation, trial: str, seed: int, number: int, rate_hz: float) -> JointMotion:
    """One realisation with its fades."""
    whole = excitation.full_s + 2 * excitation.fade_s
    time = np.arange(round(whole * rate_hz)) / rate_hz
    draws = np.random.default_rng([seed, zlib.crc32(trial.encode()), zlib.crc32(b"excitation"), number])
    made = {
        "multisine": multisine_motion,
        "chirp": chirp_motion,
        "noise": noise_motion,
        "prbs": prbs_motion,
        "ramps": ramps_motion,
        "hand": hand_motion,
    }[excitation.kind](excitation, time, draws)
    envelope = ramped(np.ones_like(time), time, whole, excitation.fade_s)
    return shaped(envelope, made)


def shaped(envelope: Envelope, motion: JointMotion) -> JointMotion:
    """The motion times an envelope (n,), with the derivatives of the product."""
    e, x = envelope, motion
    return JointMotion(
        e.size * x.theta,
        e.rate * x.theta + e.size * x.omega,
        e.curvature * x.theta + 2 * e.rate * x.omega + e.size * x.alpha,
    )


def multisine_motion(excitation: Excitation, time: Array, draws: np.random.Generator) -> JointMotion:
    """An odd random-phase multisine, which goes on through the fades; a trial's realisations have the same lines."""
    number = int(draws.integers(2**31))
    rms = float(np.deg2rad(excitation.rms_deg))
    one = odd_multisine(excitation.period_s, excitation.band_hz, rms, zlib.crc32(excitation.name.encode()), number)
    return JointMotion(*(one.angle(time, derivative) for derivative in range(3)))


def chirp_motion(excitation: Excitation, time: Array, draws: np.random.Generator) -> JointMotion:
    """A linear sweep over the band, as long as the motion at full size; beyond it goes on at its last frequency."""
    low, high = excitation.band_hz
    rate = 2 * np.pi * (high - low) / excitation.full_s
    t = time - excitation.fade_s
    inside = np.clip(t, 0, excitation.full_s)
    w = 2 * np.pi * low + rate * inside
    phase = 2 * np.pi * low * np.minimum(t, 0) + 2 * np.pi * low * inside + rate * inside**2 / 2
    phase = phase + 2 * np.pi * high * np.maximum(t - excitation.full_s, 0) + draws.uniform(0, 2 * np.pi)
    size, sweeps = np.sqrt(2) * np.deg2rad(excitation.rms_deg), (t > 0) & (t < excitation.full_s)
    sine, cosine = np.sin(phase), np.cos(phase)
    return JointMotion(size * sine, size * w * cosine, size * (rate * sweeps * cosine - w**2 * sine))


def noise_motion(excitation: Excitation, time: Array, draws: np.random.Generator) -> JointMotion:
    """Gaussian noise, flat within the band and nothing beyond."""
    low, high = excitation.band_hz
    f = np.fft.rfftfreq(len(time), time[1])
    return spectrum_motion(excitation, time, draws, ((f >= low) & (f <= high)).astype(float))


def hand_motion(excitation: Excitation, time: Array, draws: np.random.Generator) -> JointMotion:
    """As a person moves a joint by hand: slow motions are the larger, and the size of the motion wanders."""
    low, high = excitation.band_hz
    f = np.fft.rfftfreq(len(time), time[1])
    steady = spectrum_motion(excitation, time, draws, ((f >= low) & (f <= high)) / np.maximum(f, low) ** 1.5)
    turn = 2 * np.pi / HAND_WANDERS_S
    phase = turn * time + draws.uniform(0, 2 * np.pi)
    return shaped(Envelope(1 + 0.4 * np.sin(phase), 0.4 * turn * np.cos(phase), -0.4 * turn**2 * np.sin(phase)), steady)


def spectrum_motion(excitation: Excitation, time: Array, draws: np.random.Generator, gain: Array) -> JointMotion:
    """Gaussian noise with a gain (n // 2 + 1,) over frequency, and its derivatives by its lines."""
    n, w = len(time), 2 * np.pi * np.fft.rfftfreq(len(time), time[1])
    lines = gain * (draws.standard_normal(len(gain)) + 1j * draws.standard_normal(len(gain)))
    lines *= np.deg2rad(excitation.rms_deg) / np.std(np.fft.irfft(lines, n))
    return JointMotion(*(np.fft.irfft((1j * w) ** derivative * lines, n) for derivative in range(3)))


def prbs_motion(excitation: Excitation, time: Array, draws: np.random.Generator) -> JointMotion:
    """A random binary sequence. It jumps between samples, with no velocity at them, unless it is smoothed."""
    held = np.floor(time / excitation.clock_s).astype(np.intp)
    theta = np.deg2rad(excitation.rms_deg) * draws.choice([-1.0, 1.0], held[-1] + 1)[held]
    if excitation.smoothing_hz is None:
        return JointMotion(theta, np.zeros_like(theta), np.zeros_like(theta))
    rate = 1 / time[1]
    smooth = scipy.signal.sosfilt(
        scipy.signal.butter(SMOOTHING_ORDER, excitation.smoothing_hz, fs=rate, output="sos"), theta
    )
    omega = np.gradient(smooth, time)
    return JointMotion(smooth, omega, np.gradient(omega, time))


def ramps_motion(excitation: Excitation, time: Array, draws: np.random.Generator) -> JointMotion:
    """Constant velocities from one random angle to the next; the velocity jumps at these angles."""
    corners = np.arange(0, time[-1] + 2 * excitation.clock_s, excitation.clock_s)
    angles = np.sqrt(3) * np.deg2rad(excitation.rms_deg) * draws.uniform(-1, 1, len(corners))
    slope = np.diff(angles) / excitation.clock_s
    own = np.minimum((time / excitation.clock_s).astype(np.intp), len(slope) - 1)
    return JointMotion(np.interp(time, corners, angles), slope[own], np.zeros_like(time))
