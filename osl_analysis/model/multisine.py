# SPDX-License-Identifier: Apache-2.0
"""An odd random-phase multisine: a periodic motion that shows noise and even distortion separately.

Only odd lines (odd multiples of 1/period) are excited. A torque that is an even function of the
motion appears at even lines only; one that is odd, such as friction, at odd lines only. Pintelon
and Schoukens, System Identification, 2012, ch. 4.
"""

import numpy as np
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Array

# each line gives two equations for K, B and I, but one alone cannot tell K from I
FEWEST_LINES = 3


def odd_multisine(time: Array, period_s: float, band_hz: tuple[float, float], seed: int) -> Array:
    """Draw an odd multisine of RMS 1 with a flat spectrum and random phases.

    Parameters
    ----------
    time : Array
        (n,) [s].
    period_s : float
    band_hz : (float, float)
        Lowest and highest frequency [Hz].
    seed : int
        Of the phases.

    Returns
    -------
    Array
        (n,), without a unit.

    Raises
    ------
    InputError
        Odd lines are too few.
    """
    lines = odd_lines(period_s, band_hz)
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(lines))
    sines = np.sin(np.outer(time, 2 * np.pi * lines / period_s) + phase)
    return np.sqrt(2 / len(lines)) * sines.sum(axis=1)


def odd_lines(period_s: float, band_hz: tuple[float, float]) -> NDArray[np.intp]:
    """The odd lines within a band [Hz]. Raises InputError as `odd_multisine`."""
    low, high = band_hz
    first = int(np.ceil(low * period_s - 1e-9))
    last = int(np.floor(high * period_s + 1e-9))
    lines = np.arange(first + 1 - first % 2, last + 1, 2)
    if len(lines) < FEWEST_LINES:
        raise InputError(
            f"{len(lines)} odd lines of a period of {period_s:g} s lie within {low:g} to"
            f" {high:g} Hz",
            "take a longer period or a wider band",
        )
    return lines
