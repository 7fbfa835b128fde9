"""What the rounding of an encoder or converter adds to the error of a stepped-sine fit where every cycle repeats it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from osl_analysis.bench.segments import Segment, rows_of
from osl_analysis.stats.covariance import Cycles, RepeatedError
from osl_analysis.stats.rounding import scatter_between_cycles
from osl_analysis.trial import Array

IN_PHASE = 0.0247
"""Variance of a rounded sine's gain, times (amplitude/step)^3, over all zeros of the encoder: 2 zeta(3)/pi^4, from the
Bessel functions of the rounding's fundamental."""
DITHERED = 1.5
"""Scatter between cycles, as a share of step^2/12, from which on noise dithers the rounding; then it averages out."""


@dataclass(frozen=True)
class Rounded:
    """A signal that was rounded, shape (n,)."""

    step: float
    """The step, in the unit of the signal."""
    signal: Array
    """The signal as it was recorded."""
    smooth: Array
    """The signal without rounding, noise and anything else that is fast."""


def repeated_error(rounded: Rounded, torque: Array, segments: Sequence[Segment], cycles: Cycles) -> RepeatedError:
    """The rounding as an error of the torque (n,) [N*m] in the rows of the segments.

    An error of the angle acts as a torque, by the ratio of both in its segment. There are two parts. The samples of a
    cycle fall anywhere between two steps: their errors, independent with the variance step^2/12, repeat in the next
    cycle as far as they have no scatter between cycles. The rounding of a sine also changes its amplitude a little, by
    as much at every frequency.
    """
    each = [segment.rows for segment in segments]
    fundamental = [float(np.std(torque[rows])) / float(np.std(rounded.smooth[rows])) for rows in each]
    uniform = rounded.step**2 / 12
    scatter = scatter_between_cycles((rounded.signal - rounded.smooth)[rows_of(segments)], cycles)
    times = np.array([len(segment.used) for segment in segments])
    variance = np.square(fundamental) * np.maximum(uniform - scatter, 0.0) * times
    repeats = scatter < DITHERED * uniform
    amplitudes = list(dict.fromkeys(segment.amplitude for segment in segments))
    common = np.zeros((sum(map(len, each)), len(amplitudes)))
    ends = np.cumsum([0, *map(len, each)])
    for k, rows in enumerate(each):
        if repeats[k]:
            deviation = torque[rows] - np.mean(torque[rows])
            size = np.sqrt(2) * float(np.std(rounded.smooth[rows]))
            gain = np.sqrt(IN_PHASE * (rounded.step / size) ** 3)
            common[ends[k] : ends[k + 1], amplitudes.index(segments[k].amplitude)] = gain * deviation
    return RepeatedError(np.repeat(variance, [len(rows) for rows in each]), common)
