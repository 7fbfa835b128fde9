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


def odd_multisine(
    time: Array, period_s: float, band_hz: tuple[float, float], rms: float, seed: int
) -> Array:
    """Draw an odd multisine with a flat spectrum of the angle and random phases.

    Parameters
    ----------
    time : Array
        (n,) [s].
    period_s : float
    band_hz : (float, float)
        Lowest and highest frequency [Hz].
    rms : float
        Of the angle [rad].
    seed : int
        Of the phases.

    Returns
    -------
    Array
        The angle (n,) [rad].

    Raises
    ------
    InputError
        Period or size is not positive, or odd lines are too few.
    """
    lines = odd_lines(period_s, band_hz)
    if not 0 < rms < np.inf:
        raise InputError(
            f"a multisine of {rms:g} rad rms does not move the joint", "give an angle above 0"
        )
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(lines))
    sines = np.sin(np.outer(time, 2 * np.pi * lines / period_s) + phase)
    return rms * np.sqrt(2 / len(lines)) * sines.sum(axis=1)


def odd_lines(period_s: float, band_hz: tuple[float, float]) -> NDArray[np.intp]:
    """The odd lines within a band [Hz]. Raises InputError as `odd_multisine`."""
    low, high = band_hz
    if not (0 < period_s < np.inf and 0 < low < high < np.inf):
        raise InputError(
            f"no multisine has a period of {period_s:g} s and a band of {low:g} to {high:g} Hz"
        )
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
