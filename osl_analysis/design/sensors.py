"""What sensors do to the sines that are fitted: variance of the torque's amplitude [(N*m)^2], by its cause.

A sine of the torque that is fitted for a time T beside white noise of the one-sided density S [(N*m)^2/Hz] has an
amplitude with the variance S/T in phase with the angle, and S/T a quarter of a turn off. An error e of the angle acts
as an error -Z e of the torque.
"""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from osl_analysis.design.plan import Sines
from osl_analysis.trial import Array

ZETA_3 = 1.2020569031595942
"""Sum of 1/k^3."""
LONGEST_PATTERN = 10_000
"""Largest denominator of samples per repetition that counts as a pattern that repeats itself."""
MEAN_SPEED = 0.9
"""Mean of the velocity's size over its RMS: 0.90 of a sine, 0.80 of a random motion."""
Phasors = NDArray[np.complex128]


@dataclass(frozen=True)
class LineVariance:
    """Variance [(N*m)^2] of the amplitude of each sine of the torque, shape (n,) each."""

    in_phase: Array
    """In phase with the angle."""
    quadrature: Array
    """In phase with the velocity."""


@dataclass(frozen=True)
class Sensors:
    """Errors of load cell and encoder."""

    rate_hz: float
    """Sampling rate [Hz]."""
    torque_noise: float
    """Standard deviation of the torque's noise [N*m]."""
    noise_band_hz: float | None = None
    """Bandwidth [Hz] of this noise; None: half the rate, as noise that is independent from sample to sample has it."""
    torque_step: float = 0.0
    """Step of the load cell's converter [N*m]."""
    encoder_step: float = 0.0
    """Step of the encoder [rad]."""
    angle_noise: float = 0.0
    """Standard deviation of the angle's noise before it is rounded [rad], independent from sample to sample."""
    drift: float = 0.0
    """Standard deviation of the load cell's drift [N*m/s]."""

    @property
    def torque_density(self) -> float:
        """One-sided density [(N*m)^2/Hz] of the torque's noise, with the rounding of its converter: step^2/12."""
        band = self.rate_hz / 2 if self.noise_band_hz is None else self.noise_band_hz
        return self.torque_noise**2 / band + self.torque_step**2 / 12 / (self.rate_hz / 2)

    def variances(self, sines: Sines, Z: Phasors, record_s: float) -> dict[str, LineVariance]:
        """Variances by cause. `Z` (n,) is the joint's impedance [N*m/rad] at the sines, `record_s` the record [s]."""
        white = self.torque_density / sines.duration_s
        slow = 2 * self.drift_left(record_s) / sines.w**2
        angle = self.angle_noise**2 * 2 / self.rate_hz / sines.duration_s
        rounded = self.rounding(sines)
        return {
            "torque noise": LineVariance(white, white),
            "angle noise": through(Z, LineVariance(angle, angle)),
            "encoder rounding": through(Z, rounded),
            "load cell drift": LineVariance(slow, slow),
        }

    def drift_left(self, record_s: float) -> float:
        """Variance [(N*m/s)^2] of the drift after the analysis has taken off the slope that it finds in the record.

        The slope's own error by noise is 6 S/T^3; both are combined as two pieces of knowledge. A slope s changes the
        amplitude of a sine over whole cycles by 2 s/w (the integral of t sin wt).
        """
        if not self.drift:
            return 0.0
        if not self.torque_density:
            return 0.0
        return 1 / (1 / self.drift**2 + record_s**3 / (6 * self.torque_density))

    def rounding(self, sines: Sines) -> LineVariance:
        """Variance [rad^2] of the angle's amplitudes by rounding to steps q, independent from sine to sine.

        Averaged over all zeros of the encoder. Of N samples that lie at different places of the motion each has an
        error of variance q^2/12, and the amplitude 2/N of it. Later cycles repeat these errors, if motion and samples
        have one clock, which is assumed: rounding does not average out. Where there are many samples per step, only one
        sample at each step is by chance on one side or the other, with the same variance: the steps of a sine are even
        in its angle, so that a third of it is in phase. The errors between steps are alike. That of a sine is then in
        `rounded_gain`. Of a random motion its density at low frequencies is zeta(3) q^3/(pi^2 (2 pi)^(1/2) v), v being
        the RMS velocity (Woodward's theorem on each harmonic of the rounding), and it repeats in every period.

        Noise s before the rounding leaves exp(-(2 pi s/q)^2) of it to repeat (Widrow and Kollar, Quantization Noise,
        2008, ch. 5); the rest averages out as noise of variance q^2/12 does.
        """
        q, still = self.encoder_step, np.zeros(len(sines.w))
        if not q:
            return LineVariance(still, still)
        white = q**2 / 6 / self.rate_hz
        steps = MEAN_SPEED * sines.velocity / (q * self.rate_hz)
        sampled = self.repeating * white / pattern_s(sines.cycle_s, sines.duration_s, self.rate_hz)
        random = ZETA_3 * q**3 / (np.pi**2 * np.sqrt(2 * np.pi) * sines.velocity) / sines.cycle_s
        others = np.where(sines.alone, 0.0, self.repeating * random) + (1 - self.repeating) * white / sines.duration_s
        return LineVariance(
            sampled * np.minimum(1, np.where(sines.alone, 2 / 3, 1) * steps) + others,
            sampled * np.minimum(1, np.where(sines.alone, 4 / 3, 1) * steps) + others,
        )

    def rounded_gain(self, sines: Sines) -> Array:
        """Variance of the share by which rounding to steps q changes the amplitude of single sines, (n,); 0 for others.

        The error of rounding is a sum of sines of 2 pi k theta/q, and its fundamental 2 q/(pi k) J_1(2 pi k a/q) in
        phase with theta = a sin (Bennett, 1948), the same at every frequency. Its variance is zeta(3) q^3/(pi^4 a).
        """
        share = ZETA_3 / np.pi**4 * (self.encoder_step / sines.size) ** 3
        return np.asarray(np.where(sines.alone, self.repeating * share, 0.0))

    @property
    def repeating(self) -> float:
        """Share of the variance of rounding that every cycle repeats."""
        if not self.encoder_step:
            return 0.0
        return float(np.exp(-((2 * np.pi * self.angle_noise / self.encoder_step) ** 2)))


def through(Z: Phasors, angle: LineVariance) -> LineVariance:
    """Variance of the torque's amplitudes that errors of the angle [rad^2] are worth, for impedances (n,) [N*m/rad]."""
    same, other = Z.real**2, Z.imag**2
    return LineVariance(
        same * angle.in_phase + other * angle.quadrature, other * angle.in_phase + same * angle.quadrature
    )


def pattern_s(cycle_s: Array, duration_s: Array, rate_hz: float) -> Array:
    """Time [s] after which samples at `rate_hz` lie at the same places of the motion again, where its clock is that of
    the samples; at most the duration. Shape (n,) each."""
    samples = [Fraction(float(c) * rate_hz).limit_denominator(LONGEST_PATTERN).numerator for c in cycle_s]
    return np.asarray(np.minimum(np.array(samples) / rate_hz, duration_s))
