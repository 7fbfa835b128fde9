"""Whether a joint's acceleration jumps, as under a command of binary steps.

The torque of an inertia then jumps between two samples and has no band: without an anti-aliasing
filter its samples say that it jumped at one of them. In the band of the motion that is an error
like a delay, which differs from jump to jump, so that rivals of Eq. 15 would explain it.
"""

import numpy as np
import scipy

from osl_analysis.inference.constants import BLOCKS, MEDIAN_OF_NOISE
from osl_analysis.inference.spectra import Spectra
from osl_analysis.trial import Array

ABOVE_NOISE = 6.0  # SD of the third derivative's noise, which passes it once in 5e8 rows
HIGHEST_SHARE = 0.35  # of the sampling rate; above it the angle is folded by 16 % and more
NARROWEST = 1.7  # ends of the band in which jumps are looked for, over each other
# power of the frequency by which a jump's size falls from the lower to the upper half of that band,
# beyond which it is none: 0 of jumps, -1 of ramps; by 36 sound recordings whose acceleration jumps
STEEPEST = -0.75
# the same, from which it is the velocity that jumps (1), as that of an angle that is joined by
# straight lines
FLATTEST = 0.4
ORDER = 16  # of the band's ends


def acceleration_jumps(spectra: Spectra) -> bool:
    """Tell whether the acceleration jumps at least once in a block, on average.

    The third derivative of the angle is an impulse at a jump, and above the band of the motion
    little else. A smooth motion is smaller in the upper half of the band above it than in the lower
    half; a jump has one size in both.
    """
    low_hz = spectra.band_hz
    high_hz = min(spectra.visible_hz, HIGHEST_SHARE * spectra.signals.rate_hz)
    if high_hz < NARROWEST * low_hz:
        return False
    middle_hz = float(np.sqrt(low_hz * high_hz))
    lower_sizes, noise = jump_sizes(spectra, low_hz, middle_hz)
    upper_sizes, _ = jump_sizes(spectra, middle_hz, high_hz)
    # no two within a period of the band's end
    apart = round(spectra.signals.rate_hz / low_hz) + 1
    at, _ = scipy.signal.find_peaks(lower_sizes, height=ABOVE_NOISE * noise, distance=apart)
    if len(at) < BLOCKS:
        return False
    power = np.log(np.median(upper_sizes[at]) / np.median(lower_sizes[at]))
    power /= np.log(middle_hz / low_hz)
    return bool(STEEPEST < power < FLATTEST)


def jump_sizes(spectra: Spectra, low_hz: float, high_hz: float) -> tuple[Array, float]:
    """The largest jump of the acceleration (n,) [rad/s^2] that the third derivative of the angle
    between two frequencies shows within a period of the lower one about each row, and what noise
    makes of it (SD)."""
    frequency = np.arange(len(spectra.raw_angle)) / spectra.padded_seconds
    s = 2j * np.pi * frequency
    below_high = 1 / (1 + (frequency / high_hz) ** ORDER)
    below_low = 1 / (1 + (frequency / low_hz) ** ORDER)
    band = np.maximum(below_high - below_low, 0.0)
    jerk = scipy.fft.irfft(s**3 * band * spectra.raw_angle, spectra.padded_rows)
    # a jump by 1 rad/s^2 is an impulse of area 1, whose height the band gives
    height = 2 * float(band.sum()) / spectra.padded_seconds
    # jumps are rare, so that the median tells the noise, whatever filter it has passed
    first = spectra.first_row
    jerk = np.abs(jerk[first : first + len(spectra.signals.theta)])
    noise = float(np.median(jerk)) / MEDIAN_OF_NOISE
    near = 2 * round(spectra.signals.rate_hz / low_hz / 2) + 1
    largest = scipy.ndimage.maximum_filter1d(jerk, near)
    return np.asarray(largest / height), noise / height
