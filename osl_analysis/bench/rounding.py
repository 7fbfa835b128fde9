"""What the rounding of an encoder or converter adds to the error of a stepped-sine fit where every cycle repeats it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from osl_analysis.bench.segments import Segment, rows_of
from osl_analysis.stats.covariance import Cycles, nearest_covariance
from osl_analysis.stats.rounding import (
    HARMONICS,
    noise_before_rounding,
    rounding_harmonics,
    scatter_between_cycles,
)
from osl_analysis.trial import Array

DITHERED = 1e-3
"""Share of the rounding that survives the noise before it, below which there is nothing to repeat."""


@dataclass(frozen=True)
class Rounded:
    """A signal that was rounded, in its unit, on the grid with times `time` (n,) [s]."""

    step: float
    """The step."""
    signal: Array
    """The signal as it was recorded, shape (n,)."""
    smooth: Array
    """The signal without rounding, noise and anything else that is fast, shape (n,)."""
    time: Array
    """Uniform times [s]."""
    sampled: Array
    """When the sensor took its samples, shape (k,) [s]."""
    kept: dict[tuple[int, int, int, int], Array] = field(default_factory=dict, init=False, compare=False, repr=False)
    """What `smooth_between` has found."""

    @property
    def rate_hz(self) -> float:
        """Rate [Hz] of the grid."""
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0])

    def smooth_between(self, piece: slice, low: int, high: int) -> Array:
        """The smooth signal when the sensor took its samples `low` to `high`, in a piece of rows of the grid.

        Every fit to the piece asks for it: it is kept.
        """
        key = (piece.start, piece.stop, low, high)
        if key not in self.kept:
            near = slice(max(piece.start - 2, 0), piece.stop + 2)
            self.kept[key] = CubicSpline(self.time[near], self.smooth[near])(self.sampled[low:high])
        return self.kept[key]


@dataclass(frozen=True)
class RepeatedRounding:
    """The rounding of one signal as an error of the estimates of a fit to the rows of the segments.

    The zero of the sensor lies anywhere within a step. The smooth signal is rounded at the instants at which the sensor
    took its samples. What this does to the estimates is computed cycle by cycle, as a variance over all zeros.
    Rounding that differs from cycle to cycle is already in the spread between cycles, and is taken off. Nothing is
    assumed on how the errors of neighbouring samples depend on one another: at 1 Hz there is one sample per step of 14
    bits, and independent errors of variance step^2/12 were wrong by a factor of two.
    """

    rounded: Rounded
    fitted: Array
    """The smooth signal (n,) that is fitted: the torque where the angle was rounded, or the rounded signal itself."""
    segments: Sequence[Segment]
    cycles: Cycles
    """The cycles of the segments."""

    def covariance(self, influence: Array) -> Array:
        """Covariance (p, p) of estimates that change by `influence` (rows, p) with each row of what is fitted."""
        p, first = influence.shape[1], 0
        total, shown = np.zeros((p, HARMONICS), dtype=complex), np.zeros((p, p))
        for segment, left in zip(self.segments, self.surviving(), strict=True):
            rows = len(segment.rows)
            if left[0] > DITHERED:
                sums = left * np.array(list(self.cycle_sums(segment, influence[first : first + rows])))
                total += sums.sum(axis=0)
                apart = sums - sums.mean(axis=0)
                shown += len(sums) / (len(sums) - 1) * np.einsum("mpk,mqk->pq", apart, apart.conj()).real
            first += rows
        return nearest_covariance((total @ total.conj().T).real - shown)

    def cycle_sums(self, segment: Segment, influence: Array) -> Iterator[NDArray[np.complex128]]:
        """What the rounding in each cycle of a segment does to the estimates, (p, HARMONICS) each."""
        signal, first = self.rounded, 0
        stiffness, damping = self.transfer(segment)
        for piece in segment.pieces:
            rows = slice(first, first + piece.stop - piece.start)
            first, own = rows.stop, influence[rows]
            # the error acts as stiffness e + damping de/dt; by parts, the derivative is the influence's
            weights = stiffness * own
            if damping:
                weights -= damping * signal.rate_hz * np.gradient(own, axis=0)
            used = [k for k in segment.used if piece.start - 1 < segment.edges[k] < piece.stop - 1]
            edges = signal.time[0] + segment.edges[[*used, used[-1] + 1]] / signal.rate_hz
            low, *_, high = cuts = np.searchsorted(signal.sampled, edges)
            at = signal.sampled[low:high]
            per_row = signal.rate_hz * (edges[-1] - edges[0]) / len(at)
            each = per_row * interpolated(at, signal.time[piece], weights).T
            errors = rounding_harmonics(signal.smooth_between(piece, low, high), signal.step)
            yield from (each[:, i:j] @ errors[:, i:j].T for i, j in pairwise(cuts - low))

    def transfer(self, segment: Segment) -> tuple[float, float]:
        """By how much what is fitted follows the signal and its derivative in a segment; (1, 0): the signal itself."""
        if self.fitted is self.rounded.smooth:
            return 1.0, 0.0
        rows = segment.rows
        smooth, w = self.rounded.smooth[rows], 2 * np.pi * segment.frequency_hz
        phase = np.exp(-1j * w * self.rounded.time[rows])
        ratio = np.sum((self.fitted[rows] - np.mean(self.fitted[rows])) * phase) / np.sum(
            (smooth - np.mean(smooth)) * phase
        )
        return float(ratio.real), float(ratio.imag) / w

    def surviving(self) -> Array:
        """Share of each harmonic of the rounding that the noise before it leaves in the mean, (segments, HARMONICS).

        The noise is what cycles differ by, beyond what the rounding of the smooth signal itself makes different.
        """
        signal, rows = self.rounded, rows_of(self.segments)
        smooth = signal.smooth[rows]
        seen = scatter_between_cycles(signal.signal[rows] - smooth, self.cycles)
        rounded = signal.step * np.rint(smooth / signal.step)
        expected = scatter_between_cycles(rounded - smooth, self.cycles)
        noise = noise_before_rounding(np.maximum(seen - expected, 0.0) / signal.step**2)
        return np.exp(-2 * (np.pi * noise[:, None] * np.arange(1, HARMONICS + 1)) ** 2)


def interpolated(at: Array, time: Array, values: Array) -> Array:
    """Values (k, p) at times `at` (k,) from those (n, p) at increasing times (n,), by straight lines; constant beyond.

    As `np.interp` of each column, whose places are found once for all.
    """
    row = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    share = np.clip((at - time[row]) / (time[row + 1] - time[row]), 0.0, 1.0)[:, None]
    below = values[row]
    return np.asarray(below + share * (values[row + 1] - below))
