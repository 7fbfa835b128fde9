"""Torques that rounding of the angle makes, drawn for other zeros of the encoder.

Rounding is no noise where a motion repeats itself: every cycle has the same errors. Drawn with
other zeros (Widrow and Kollár, Quantization Noise, 2008), they say what rounding alone does to each
estimate, and how well it alone would be explained by each hypothesis. As random effects in the
model a dozen draws would be fitted away.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.inference.constants import DWELL_PERIODS, ROUNDING_DRAWS, SMALLEST_SIZE
from osl_analysis.inference.spectra import Spectra, roll_off
from osl_analysis.inference.whitening import Whitened
from osl_analysis.trial import Array

SMOOTH_BANDS = 4.0  # bands of the low-pass that gives the angle before its rounding
DRAWS_AT_ONCE = 2  # two rows fill a processor's vector in a transform
LEAST_REPEATED = 0.05  # share of the rounding that noise leaves, below which it is noise


def rounding_torques(data: Whitened, impedance: Array) -> Array:
    """Draw the whitened torques that rounding of the angle makes.

    Parameters
    ----------
    data : Whitened
        The recording.
    impedance : Array (3,)
        K, B, I of its joint, through which an error of the angle becomes one of the torque.

    Returns
    -------
    Array (draws, m)
        Torques, with errors of sampling where the acceleration jumps; no row if it does not, and
        noise of the angle hides its rounding, or no step is known.
    """
    spectra = data.spectra
    step, rows = spectra.signals.encoder_step, int(np.count_nonzero(spectra.rows))
    repeated = repeated_share(spectra)
    if repeated < LEAST_REPEATED:
        return np.empty((0, rows))

    angle = (
        np.asarray(scipy.fft.irfft(spectra.raw_angle, spectra.padded_rows) + spectra.line) / step
    )
    read = encoder_reading(angle)
    smooth, halfway = before_encoder(spectra, read)
    levels = share_at_levels(spectra, read)
    size = min(max(levels, SMALLEST_SIZE), 1.0)
    # a level is read as one step; halfway between two of them there would be none
    drawn_from = [smooth, halfway] if levels > 0.5 else [smooth, smooth]
    means = [float(x.mean()) for x in drawn_from]
    middle = float(halfway.mean())
    largest = max(float(halfway.max()) - middle, middle - float(halfway.min()))
    del angle, read, smooth, halfway  # an hour has 30 MB of each
    of_error = impedance @ spectra.s ** np.arange(3)[:, None]
    to_working = spectra.working_rows / spectra.padded_rows
    found = np.empty((ROUNDING_DRAWS, len(spectra.frequency)), np.complex128)
    for first in range(0, ROUNDING_DRAWS, DRAWS_AT_ONCE):
        draws = range(first, first + DRAWS_AT_ONCE)
        errors = np.empty((DRAWS_AT_ONCE, spectra.padded_rows))
        for error, draw in zip(errors, draws, strict=True):
            zero = (draw + 0.5) / ROUNDING_DRAWS
            # sizes in another order than zeros, so that both are spread evenly
            growth = ((5 * draw) % ROUNDING_DRAWS + 0.5) / ROUNDING_DRAWS - 0.5
            which = draw % 2
            share = growth * size / largest  # by which the motion is larger, about its mean
            np.multiply(drawn_from[which], 1 + share, out=error)
            error += zero - share * means[which]
            np.subtract(np.rint(error), error, out=error)
        of_draws = scipy.fft.rfft(errors)[:, : len(spectra.frequency)]
        found[first : first + DRAWS_AT_ONCE] = of_error * of_draws
    found *= to_working * step * repeated
    return data.column(found)


def repeated_share(spectra: Spectra) -> float:
    """Share of the rounding error that noise before the encoder leaves to repeat itself."""
    step = spectra.signals.encoder_step
    if step <= 0:
        return 0.0
    variance = spectra.angle_noise * spectra.signals.rate_hz / 2 / step**2
    return share_left_by_noise(noise_before_rounding(variance))


def noise_before_rounding(variance: float) -> float:
    """Variance [steps^2] of the noise that a sensor rounds, from that of its readings."""
    return max(variance - 1 / 12, 0.0)


def share_left_by_noise(variance: float) -> float:
    """Share of a rounding error that noise of this variance [steps^2] leaves to repeat itself:
    exp(-2 pi^2 s^2) for s steps (Widrow and Kollár 2008, ch. 5)."""
    return float(np.exp(-2 * np.pi**2 * variance))


def before_encoder(spectra: Spectra, read: Array) -> tuple[Array, Array]:
    """Reconstruct an angle in encoder steps (r,) before it was read in whole ones, in two ways.

    The first is low-passed, and rings where the joint comes to a level. The second is known halfway
    between two steps, where the encoder goes from one to the next.
    """
    end = min(
        round(SMOOTH_BANDS * spectra.band_hz * spectra.padded_seconds), len(spectra.raw_angle)
    )
    gain = roll_off(np.arange(float(len(spectra.raw_angle))), end)
    low_passed = scipy.fft.irfft(spectra.raw_angle * gain, spectra.padded_rows) + spectra.line
    smooth = np.asarray(low_passed) / spectra.signals.encoder_step

    at = np.flatnonzero(np.diff(read))
    if len(at) < 3:
        return smooth, read
    halfway = np.interp(np.arange(len(read)), at + 0.5, (read[at] + read[at + 1]) / 2)
    return smooth, halfway


def encoder_reading(angle: Array) -> Array:
    """Whole steps (r,) that an encoder shows, for an angle in steps about an unknown zero."""
    zero = np.angle(np.mean(np.exp(2j * np.pi * angle))) / (2 * np.pi)
    return np.asarray(np.rint(angle - zero))


def share_at_levels(spectra: Spectra, read: Array) -> float:
    """Share of the time in which the encoder shows one step for longer than a motion lets it."""
    changes: NDArray[np.intp] = np.flatnonzero(np.diff(read))
    starts = np.concatenate([[0], changes + 1])
    stops = np.concatenate([changes, [len(read) - 1]])
    dwells = stops - starts
    longest_in_motion = DWELL_PERIODS * spectra.signals.rate_hz / spectra.band_hz
    return float(np.sum(dwells[dwells > longest_in_motion]) / len(read))
