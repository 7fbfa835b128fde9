"""Rounding of an encoder or converter that every period repeats, where the clocks of generator and recorder agree.

The scatter of periods is blind to it. With half a step of noise, or clocks that differ, it differs from period to
period: it is in the scatter then, and must not count twice.
"""

import numpy as np

from osl_analysis.spectral.lines import scatter
from osl_analysis.spectral.period import Spectrum
from osl_analysis.spectral.realisations import Realisation
from osl_analysis.stats.rounding import noise_before_rounding
from osl_analysis.trial import Array

HARMONICS = 100
"""Harmonics of the error of rounding that are summed."""


def repeated_rounding(one: Realisation, impedance: Spectrum) -> Array:
    """E|error|^2 [(N*m)^2] at lines (m,) of the mean over the periods, by what every period repeats of the rounding.

    `impedance` (m,) [N*m/rad] takes the angle's error to the torque.
    """
    theta, torque = (
        repeated_variance(one, spectra, step) for spectra, step in zip((one.theta, one.torque), one.steps, strict=True)
    )
    return np.asarray(np.abs(impedance) ** 2 * theta + torque)


def repeated_variance(one: Realisation, spectra: Spectrum, step: float | None) -> float:
    """E|error|^2 of a line of a signal with lines (periods, lines) that was rounded to `step`; 0 if it was not.

    A sample's repeated error has the variance of the harmonics that the noise before the rounding leaves (Widrow and
    Kollar, Quantization Noise, 2008, ch. 5): step^2/12 without noise. It is taken for independent from sample to
    sample, as it is where a motion crosses a step or more between two samples; N of them give a line 4/N of it.
    """
    if step is None:
        return 0.0
    samples, k = one.period * one.rate_hz, np.arange(1, HARMONICS + 1)
    of_sample = float(np.mean(scatter(spectra)[1:])) * samples / 4 / step**2
    noise = float(noise_before_rounding(np.array([of_sample]))[0])
    left = float(np.sum(np.exp(-((2 * np.pi * k * noise) ** 2)) / (2 * (np.pi * k) ** 2)))
    return 4 * left * step**2 / samples
