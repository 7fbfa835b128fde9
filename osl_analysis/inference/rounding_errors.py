# SPDX-License-Identifier: Apache-2.0
"""Torques that rounding of the angle makes, drawn for other zeros of the encoder and sizes of the
motion.

Rounding is no noise where a motion repeats itself: every cycle has the same errors. Drawn with
other zeros and sizes (Widrow and Kollár, Quantization Noise, 2008), they say what rounding alone
does to each estimate, and how well it alone would be explained by each candidate model. As random
effects in the model a dozen draws would be fitted away.
"""

import numpy as np
import scipy

from osl_analysis.base.trial import Array
from osl_analysis.inference.spectra import roll_off
from osl_analysis.inference.whitening import Whitened

# Draws of the encoder's zero and the motion's size; they give a standard error to 20 %; as random
# effects in the model they would be fitted away
ROUNDING_DRAWS = 12

SMOOTH_BANDS = 4.0  # bands of the low-pass that gives the angle before its rounding
# share by which a drawn motion is larger or smaller at most: zeros alone leave a slow sine the same
# errors where it turns, which read as friction: of 384 frictionless ones, 0.1 to 0.3 Hz, 12 and 14
# bits, 19 have friction without, 10 with it
SIZES_DRAWN = 0.1


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
        Torques; one of 0 if no step is known.
    """
    spectra = data.spectra
    step = spectra.signals.encoder_step
    rate_hz = spectra.signals.rate_hz
    repeated = repeated_share(spectra.angle_noise, rate_hz, step) if step > 0 else 0.0
    if not repeated:
        return np.zeros((1, len(data.torque)))

    # without what is faster than its motion, as it was before it was read in whole steps
    end = SMOOTH_BANDS * spectra.band_hz * spectra.padded_seconds
    gain = roll_off(np.arange(float(len(spectra.raw_angle))), end)
    smooth = scipy.fft.irfft(spectra.raw_angle * gain, spectra.padded_rows)
    smooth += np.linspace(*spectra.ends, spectra.padded_rows)
    smooth = (smooth - smooth.mean()) / step
    draws = np.arange(ROUNDING_DRAWS)
    zeros = (draws + 0.5) / ROUNDING_DRAWS
    # sizes in another order than zeros, so that both are spread evenly
    sizes = 1 + SIZES_DRAWN * (2 * zeros[5 * draws % ROUNDING_DRAWS] - 1)
    of_error = impedance @ spectra.powers[:3]
    of_error *= -repeated * step * spectra.working_rows / spectra.padded_rows
    torques = []
    for zero, size in zip(zeros, sizes, strict=True):
        angle = size * smooth
        angle += zero
        angle -= np.rint(angle)  # the opposite of its error
        # of a few rows together: that they are late by half of these does not matter
        errors = angle.reshape(-1, spectra.thinned) @ np.ones(spectra.thinned)
        torques.append(of_error * scipy.fft.rfft(errors)[: len(of_error)])
    return data.column(np.array(torques))


def repeated_share(noise_density: float, rate_hz: float, step: float) -> float:
    """Share of a rounding error that noise before the encoder leaves to repeat itself.

    It is exp(-2 pi^2 s^2) for noise of s steps (Widrow and Kollár 2008, ch. 5).

    Parameters
    ----------
    noise_density : float
        Of what the encoder reads, with its rounding [rad^2/Hz].
    rate_hz : float
        Sampling rate [Hz].
    step : float
        Of the encoder [rad].
    """
    variance_of_readings = noise_density * rate_hz / 2 / step**2
    before_rounding = max(variance_of_readings - 1 / 12, 0.0)
    return float(np.exp(-2 * np.pi**2 * before_rounding))
