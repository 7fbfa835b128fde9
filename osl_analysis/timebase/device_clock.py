"""The clock of a device that samples evenly: a straight line through the stamps of its counted samples."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.timebase.counting import Counts, line_slope
from osl_analysis.trial import Array

ONE_SIDED = 0.5
"""Skew of the usual residual from which stamps are late and never early: the line then runs along their lower edge."""
FAR, NEAR = 5.0, 1e-6
"""Usual spreads, and usual steps besides, from which a sample lies far off the line and says nothing about it."""
WANDER_SAMPLES = 50
"""Samples over which the residual is averaged to see whether it wanders slowly; jitter averages out."""


@dataclass(frozen=True)
class DeviceClock:
    """Stamps of a stream against the least-squares line through them.

    count: (n,) place of every sample in the device's count.
    start, step: [s] the line's value at count 0 and its slope.
    residual: (n,) [s] stamp minus line.
    """

    count: Counts
    start: float
    step: float
    residual: Array

    @property
    def rate_hz(self) -> float:
        """Samples per second by the line."""
        return 1 / self.step

    @property
    def sd(self) -> float:
        """Standard deviation [s] of the residual."""
        return float(np.std(self.residual))

    @property
    def skew(self) -> float:
        """Skewness of the residual; 0 where there is none to speak of."""
        return skewness(self.residual) if self.sd > NEAR * self.step else 0.0

    @property
    def usual_spread(self) -> float:
        """Spread [s] of the residual by its 5th and 95th percentile, in standard deviations of a normal one.

        Unlike `sd` it does not see a handful of late samples.
        """
        low, high = np.quantile(self.residual, [0.05, 0.95])
        return float(high - low) / 3.29

    @property
    def wander(self) -> float:
        """Standard deviation [s] of the residual averaged over `WANDER_SAMPLES`."""
        blocks = len(self.residual) // WANDER_SAMPLES
        if blocks < 2:
            return self.sd
        return float(np.std(self.residual[: blocks * WANDER_SAMPLES].reshape(blocks, -1).mean(axis=1)))

    @property
    def missing(self) -> int:
        """Samples that the count leaves free."""
        return int(self.count[-1] - self.count[0] + 1 - len(self.count))

    def times(self) -> Array:
        """When the samples were taken, (n,) [s], if the device samples evenly.

        The least-squares line through all but the few samples that lie far off. Where the residual of these is still
        one-sided, the line along its lower edge: a host's stamp is late by what the message waited, and the promptest
        messages waited least.
        """
        far = np.abs(self.residual - np.median(self.residual)) > FAR * self.usual_spread + NEAR * self.step
        usual = self.residual[~far]
        if np.std(usual) > NEAR * self.step and skewness(usual) > ONE_SIDED:
            start, step = lower_edge(self.count.astype(float), self.residual)
        else:
            step = line_slope(self.count[~far], usual)
            start = float(np.mean(usual) - step * np.mean(self.count[~far]))
        return np.asarray(self.start + start + (self.step + step) * self.count, dtype=np.float64)


def skewness(values: Array) -> float:
    """Third moment about the mean, in standard deviations."""
    apart = values - np.mean(values)
    return float(np.mean(apart * apart * apart) / np.std(values) ** 3)  # a power of an array takes ten times as long


def device_clock(stamps: Array, count: Counts) -> DeviceClock:
    """The line through stamps (n,) [s] over their count (n,)."""
    step = line_slope(count, stamps)
    start = float(np.mean(stamps) - step * np.mean(count))
    return DeviceClock(count, start, step, stamps - start - step * count)


def lower_edge(x: Array, y: Array) -> tuple[float, float]:
    """Value at 0 and slope of the highest line below all points (x, y), (n,) each, x rising: their hull at its middle.

    The hull's edge over the mean of x. One point is held on each side of the mean; the lowest point below the line
    through them replaces the one on its side, until none lies below.
    """
    middle = float(np.mean(x))
    left, right = 0, len(x) - 1
    for _ in range(len(x)):
        slope = (y[right] - y[left]) / (x[right] - x[left])
        above = y - y[left] - slope * (x - x[left])
        lowest = int(np.argmin(above))
        if above[lowest] >= 0 or lowest in (left, right):
            break
        left, right = (lowest, right) if x[lowest] <= middle else (left, lowest)
    return float(y[left] - slope * x[left]), float(slope)
