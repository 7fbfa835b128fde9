"""The motion of a stepped sine as it was before an encoder rounded it: the sine of each segment."""

from collections.abc import Sequence

import numpy as np

from osl_analysis.bench.segments import Segment
from osl_analysis.pieces import pieces
from osl_analysis.stats.sinusoid import waves
from osl_analysis.trial import Array

HARMONICS = 3
"""Harmonics of the sine that a segment may have, the fundamental included."""


def with_sines(theta: Array, time: Array, segments: Sequence[Segment]) -> Array:
    """A copy of a filtered angle (n,) [rad] at times (n,) [s], in the rows of each segment its sine with harmonics.

    A filter does not take off the rounding where the joint turns round: the angle stays on one step there for longer
    than the filter remembers. Just there it is decided what rounding does to the estimates. A sine that is fitted to
    whole cycles knows its peaks to a hundredth of a step. Taken from the filtered angle, the standard error of K at 12
    bits was 0.4 to 2.5 times its true size, and the interval covered 80 to 87 %.
    """
    found = theta.copy()
    for segment in segments:
        fitted = harmonics_of(segment.part(theta), segment.part(time), segment.frequency_hz)
        first = 0
        for piece in segment.pieces:
            rows = piece.stop - piece.start
            found[piece] = fitted[first : first + rows]
            first += rows
    return found


def harmonics_of(angle: Array, time: Array, frequency_hz: float) -> Array:
    """The mean and the first `HARMONICS` of an angle (n,) at times (n,) [s], by least squares, shape (n,)."""
    parts = list(pieces(len(angle)))
    size = 2 * HARMONICS + 1
    gram, moments = np.zeros((size, size)), np.zeros(size)
    for rows in parts:
        X = harmonics(time[rows], frequency_hz)
        gram += X @ X.T
        moments += X @ angle[rows]
    found = np.linalg.solve(gram, moments)
    return np.concatenate([found @ harmonics(time[rows], frequency_hz) for rows in parts])


def harmonics(time: Array, frequency_hz: float) -> Array:
    """A constant, and cosine and sine of each harmonic, at times (n,) [s], shape (1 + 2 HARMONICS, n)."""
    columns = np.ones((2 * HARMONICS + 1, len(time)))
    cosine, sine = columns[1:3] = waves(time, frequency_hz)
    for k in range(2, HARMONICS + 1):
        below, above = columns[2 * k - 3 : 2 * k - 1], columns[2 * k - 1 : 2 * k + 1]
        above[0] = below[0] * cosine - below[1] * sine
        above[1] = below[0] * sine + below[1] * cosine
    return columns
