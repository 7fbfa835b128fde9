"""Which lines of a periodic motion are excited, and at which ones only noise and distortion are seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from osl_analysis.errors import InputError
from osl_analysis.spectral.period import Spectrum
from osl_analysis.spectral.realisations import Realisation
from osl_analysis.trial import Array

NEIGHBOURS = 8
"""Lines to each side of a line that count as its neighbourhood."""
BESIDE_NEIGHBOURS, BESIDE_ALL = 0.05, 0.005
"""Size of an excited line, as a share of the largest one in its neighbourhood, and of all."""
ABOVE_NOISE = 5.0
"""Standard errors by which an excited line differs from 0."""
PERIODS_AGREE = 1e-3
"""Largest difference between the periods of realisations that are analysed together, as a share."""


@dataclass(frozen=True)
class Lines:
    """Kinds of the lines of a periodic motion, shape (lines,) each; line 0, the mean, is none of them."""

    excited: NDArray[np.bool_]
    odd: NDArray[np.bool_]
    """Odd lines that are not excited, from half the lowest to the highest excited line."""
    even: NDArray[np.bool_]
    """Even lines that are not excited, in the same band."""

    @property
    def only_odd(self) -> bool:
        """Whether only odd lines are excited, so that odd and even distortion are seen apart."""
        return not self.excited[::2].any()

    @property
    def detection(self) -> NDArray[np.bool_]:
        """Lines that show the distortion at excited lines: of an odd motion the odd ones, else all, (lines,)."""
        return self.odd if self.only_odd else self.odd | self.even


def lines_of(realisations: Sequence[Realisation]) -> Lines:
    """The kinds of the lines that the realisations share, from the size of the angle's lines.

    Raises
    ------
    InputError
        There is no realisation, periods differ, or no line stands out of the noise.
    """
    check_alike(realisations)
    size = np.sqrt(np.mean([np.abs(r.theta.mean(axis=0)) ** 2 for r in realisations], axis=0))
    error = np.sqrt(np.mean([scatter(r.theta) / r.periods for r in realisations], axis=0) / len(realisations))
    size[0] = 0.0
    largest = maximum_filter1d(size, 2 * NEIGHBOURS + 1)
    excited = (size > BESIDE_NEIGHBOURS * largest) & (size > BESIDE_ALL * size.max()) & (size > ABOVE_NOISE * error)
    if not excited.any():
        raise InputError("no line of the motion stands out of the noise; move the joint further, or record for longer")
    k, at = np.arange(len(size)), np.flatnonzero(excited)
    band = (k >= at[0] / 2) & (k <= at[-1]) & ~excited & (k > 0)
    return Lines(excited, band & (k % 2 == 1), band & (k % 2 == 0))


def check_alike(realisations: Sequence[Realisation]) -> None:
    """Refuse no realisation, or realisations with different periods."""
    if not realisations:
        raise InputError("no periods to fit; record at least two periods of the motion")
    periods = np.array([r.period for r in realisations])
    if np.ptp(periods) > PERIODS_AGREE * periods[0]:
        raise InputError(
            f"realisations with periods from {periods.min():.6g} to {periods.max():.6g} s cannot be fitted together; "
            "analyse them as trials of their own"
        )


def scatter(periods: Spectrum) -> Array:
    """Variance E|x - mean|^2 of a single period of each line, from lines (periods, lines); it has 2 (periods - 1)
    degrees of freedom."""
    return np.asarray(np.sum(np.abs(periods - periods.mean(axis=0)) ** 2, axis=0) / (len(periods) - 1))


def smoothed(values: Array, weights: Array) -> Array:
    """Mean of the values (lines,) over each line and its `NEIGHBOURS`, with `weights` (lines,)."""
    window = np.ones(2 * NEIGHBOURS + 1)
    total = np.convolve(weights, window, "same")
    return np.asarray(np.convolve(values * weights, window, "same") / np.maximum(total, np.finfo(float).tiny))
