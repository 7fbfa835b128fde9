"""What sampling does to a torque whose acceleration jumps, as under a command of binary steps.

A torque that jumps by I d between two samples has no band: without an anti-aliasing filter its
samples say that it jumped at one of them. In the band of the motion the error is an impulse of
I d (1/2 - x)/rate where the jump is a share x of a sample late (Euler and Maclaurin's first term),
and its derivative by the next one. The angle, which falls by the third power of the frequency, has
no such error. Where command and sampling share a clock x is one number, and the impulses are
columns beside all hypotheses. Else x is drawn, and the errors enter as those of rounding do.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.inference.constants import (
    BLOCKS,
    JUMP_ABOVE_NOISE,
    KNOWN_ROW,
    KNOWN_SIZE,
    ROUNDING_DRAWS,
    STEEPEST,
)
from osl_analysis.inference.spectra import Spectra, Spectrum
from osl_analysis.trial import Array

SEED = 2  # of the draws: the same recording gives the same numbers
WIDEST = 0.35  # of the sampling rate; above it the angle is folded by 16 % and more
LEAST_SHARE = 0.4  # of a jump by the lower half of that band, which the upper half shows, too
LEAST_WIDTH = 1.7  # ends of that band over each other: a narrower one rings


@dataclass(frozen=True)
class Jumps:
    """Jumps of the acceleration.

    Attributes
    ----------
    at : Array (j,)
        Rows, and parts of rows, of the padded recording.
    sizes : Array (j,)
        Jumps [rad/s^2].
    above_noise : float
        The median jump over its standard deviation; 0 without jumps.
    placed_to : float
        Standard deviation of a jump's place [rows].
    """

    at: Array
    sizes: Array
    above_noise: float = 0.0
    placed_to: float = np.inf

    @property
    def are_columns(self) -> bool:
        """Whether their sizes are known well enough to be columns."""
        return self.above_noise > KNOWN_SIZE


NO_JUMPS = Jumps(np.empty(0), np.empty(0))


@dataclass(frozen=True)
class BandPass:
    """The third derivative of an angle between two frequencies.

    Attributes
    ----------
    jerk : Array (r,)
        The third derivative there [rad/s^3].
    gain : Spectrum (f,)
        What turns the angle's spectrum into it.
    peak_of_unit_jump : float
        Its peak where the acceleration jumps by 1 rad/s^2, whose third derivative is an impulse of
        area 1.
    """

    jerk: Array
    gain: Spectrum
    peak_of_unit_jump: float


def third_derivative_between(spectra: Spectra, low_hz: float, high_hz: float) -> BandPass:
    """Derive the recorded angle three times between two frequencies."""
    frequency = np.arange(len(spectra.raw_angle)) / spectra.padded_seconds
    s = 2j * np.pi * frequency
    below_high = 1 / (1 + (frequency / high_hz) ** 16)
    below_low = 1 / (1 + (frequency / low_hz) ** 16)
    band = np.maximum(below_high - below_low, 0.0)
    gain = np.asarray(s**3 * band, np.complex128)
    jerk = scipy.fft.irfft(gain * spectra.raw_angle, spectra.padded_rows)
    impulse = gain[1:] / s[1:] ** 3
    peak = 2 * float(impulse.real.sum()) / spectra.padded_seconds
    return BandPass(jerk, gain, peak)


def acceleration_jumps(spectra: Spectra) -> Jumps:
    """Find jumps of the acceleration in the angle above the band of the motion.

    The third derivative is an impulse at a jump, and above the band little else. It is looked for
    up to the frequency at which the angle's noise, which grows by the sixth power there, would
    hide it. A smooth motion is smaller in the upper half of that band than in the lower one; a
    jump has one size in both.
    """
    signals = spectra.signals
    low_hz = spectra.band_hz
    high_hz = min(spectra.visible_hz, WIDEST * signals.rate_hz)
    if signals.has_drivetrain or high_hz < LEAST_WIDTH * low_hz:
        return NO_JUMPS

    whole = third_derivative_between(spectra, low_hz, high_hz)
    noise = noise_of_jerk(spectra, whole.gain)
    at = largest_rows(spectra, np.abs(whole.jerk), JUMP_ABOVE_NOISE * noise)
    if len(at) < BLOCKS:
        return NO_JUMPS

    middle_hz = float(np.sqrt(low_hz * high_hz))
    lower_half = third_derivative_between(spectra, low_hz, middle_hz)
    upper_half = third_derivative_between(spectra, middle_hz, high_hz)
    in_lower = lower_half.jerk[at] / lower_half.peak_of_unit_jump
    in_upper = upper_half.jerk[at] / upper_half.peak_of_unit_jump
    is_jump = in_upper * np.sign(in_lower) > LEAST_SHARE * np.abs(in_lower)
    at, in_lower, in_upper = at[is_jump], in_lower[is_jump], in_upper[is_jump]
    size_in_lower = max(float(np.sum(np.abs(in_lower))), 1e-300)
    size_in_upper = float(np.sum(np.abs(in_upper)))
    falls_too_much = size_in_upper / size_in_lower < (middle_hz / low_hz) ** STEEPEST
    # fewer than one in a block do not move what hundreds of motions tell
    if len(at) < BLOCKS or falls_too_much:
        return NO_JUMPS

    # the place of a jump is the vertex of a parabola through three rows
    before, peak, after = whole.jerk[at - 1], whole.jerk[at], whole.jerk[at + 1]
    vertex = 0.5 * (before - after) / (before - 2 * peak + after)
    above_noise = float(np.median(np.abs(peak)) / noise)
    return Jumps(
        at=np.asarray(at + np.clip(vertex, -0.5, 0.5)),
        sizes=peak / whole.peak_of_unit_jump,
        above_noise=above_noise,
        placed_to=signals.rate_hz / (np.pi * (low_hz + high_hz)) / above_noise,
    )


def noise_of_jerk(spectra: Spectra, gain: Spectrum) -> float:
    """Standard deviation of what noise and rounding of the angle make of the third derivative."""
    signals = spectra.signals
    rounding = signals.encoder_step**2 / 6 / signals.rate_hz  # density [rad^2/Hz]
    density = max(spectra.angle_noise, rounding)
    return float(np.sqrt(density * np.sum(np.abs(gain) ** 2) / spectra.padded_seconds))


def largest_rows(spectra: Spectra, size: Array, least: float) -> NDArray[np.intp]:
    """Rows (j,) of peaks above `least`, no two within a period of the band's end: one jump has
    lobes there. An extension beyond an end of the recording may jump, which does not count."""
    signals = spectra.signals
    width = 2 * round(signals.rate_hz / spectra.band_hz) + 1
    is_peak = size == scipy.ndimage.maximum_filter1d(size, width)
    first = spectra.first_row + width
    last = spectra.first_row + len(signals.theta) - width
    is_peak[:first] = False
    is_peak[last:] = False
    return np.flatnonzero(is_peak & (size > least))


def impulses(spectra: Spectra, at: Array, areas: Array) -> Spectrum:
    """The working spectra (..., f) of impulses of some areas (..., j) at rows and parts of rows."""
    if not len(at):
        return np.zeros((*areas.shape[:-1], len(spectra.frequency)), np.complex128)
    signal = np.zeros((*areas.shape[:-1], spectra.padded_rows))
    row = np.floor(at).astype(np.intp)
    later = at - row
    signal[..., row] = areas * (1 - later) * spectra.signals.rate_hz
    signal[..., row + 1] += areas * later * spectra.signals.rate_hz
    to_working = spectra.working_rows / spectra.padded_rows
    return np.asarray(scipy.fft.rfft(signal)[..., : len(spectra.frequency)] * to_working)


def jump_columns(spectra: Spectra, jumps: Jumps) -> Spectrum:
    """The spectra (k, f) of what sampling may make of jumps; none where they are not known.

    A jump is seen at the next sample. One that is nearest to it may be at it, or just after it,
    which the angle cannot tell: command and sampling on one clock decide for all jumps alike.
    """
    if not jumps.are_columns:
        return np.empty((0, len(spectra.frequency)), np.complex128)
    areas = jumps.sizes / spectra.signals.rate_hz
    of_jumps = impulses(spectra, jumps.at, areas[None])
    per_sample = spectra.s / spectra.signals.rate_hz
    derived = of_jumps * np.array([per_sample, per_sample**2, per_sample**3])
    if jumps.placed_to > KNOWN_ROW:
        return np.concatenate([of_jumps, derived])
    from_sample = jumps.at - np.rint(jumps.at)
    anywhere = np.sign(from_sample) * (0.5 - np.abs(from_sample))
    by_place = impulses(spectra, jumps.at, areas * np.array([np.abs(from_sample), anywhere]))
    return np.concatenate([of_jumps, derived, by_place])


def jump_errors(spectra: Spectra, jumps: Jumps, inertia: float) -> Spectrum:
    """Draw the errors (draws, f) of a torque that jumps anywhere between two samples.

    Where they are no columns, half of the draws have one place between samples for all jumps.
    """
    rng = np.random.default_rng(SEED)
    shares = rng.uniform(-0.5, 0.5, (ROUNDING_DRAWS, len(jumps.at)))
    if not jumps.are_columns:
        shares[::2] = np.linspace(-0.5, 0.5, len(shares[::2]))[:, None]
    areas = inertia * jumps.sizes / spectra.signals.rate_hz
    return impulses(spectra, jumps.at, areas * shares)
