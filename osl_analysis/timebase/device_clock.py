"""The clock of a device that samples evenly: a straight line through the stamps of its counted samples."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from osl_analysis.timebase.counting import Counts, line_slope
from osl_analysis.trial import Array

ONE_SIDED = 0.5
"""Skew of the usual residual from which stamps are late and never early: the line then runs along their lower edge."""
FAR, NEAR = 5.0, 1e-6
"""Usual spreads, and usual steps besides, from which a sample lies far off the line and says nothing about it."""
WANDER_SAMPLES = 50  # samples over which the residual is averaged to see whether it wanders slowly; jitter averages out


@dataclass(frozen=True)
class DeviceClock:
    """Stamps of a stream against the least-squares line through them.

    stamps: (n,) [s].
    counted: (n,) place of every sample in the device's count; None where none is missing.
    start, step: [s] the line's value at count 0 and its slope.

    """

    stamps: Array
    counted: Counts | None
    start: float
    step: float

    @cached_property
    def count(self) -> Counts:
        """Place (n,) of every sample in the device's count."""
        return np.arange(len(self.stamps)) if self.counted is None else self.counted

    @cached_property
    def residual(self) -> Array:
        """Stamp minus line (n,) [s]."""
        return np.asarray(self.stamps - self.step * self.count - self.start)

    @property
    def rate_hz(self) -> float:
        return 1 / self.step

    @property
    def sd(self) -> float:
        """Standard deviation [s] of the residual."""
        return self.shape[0]

    @property
    def skew(self) -> float:
        """Skewness of the residual; 0 where there is none to speak of."""
        return self.shape[1] if self.sd > NEAR * self.step else 0.0

    @cached_property
    def shape(self) -> tuple[float, float]:
        """Standard deviation [s] and skewness of the residual."""
        return spread_and_skewness(self.residual)

    @property
    def usual_spread(self) -> float:
        """Spread [s] of the residual by its 5th and 95th percentile, in standard deviations of a normal one. Unlike
        `sd` it does not see a handful of late samples."""
        return self.middle_and_spread[1]

    @cached_property
    def middle_and_spread(self) -> tuple[float, float]:
        """Median [s] of the residual and `usual_spread`."""
        low, middle, high = (float(at) for at in np.quantile(self.residual, (0.05, 0.5, 0.95)))
        return middle, (high - low) / 3.29

    @cached_property
    def wander(self) -> float:
        """Standard deviation [s] of the residual averaged over `WANDER_SAMPLES`."""
        blocks = len(self.stamps) // WANDER_SAMPLES
        if blocks < 2:
            return self.sd
        return float(np.std(self.residual[: blocks * WANDER_SAMPLES].reshape(-1, WANDER_SAMPLES).mean(axis=1)))

    @property
    def missing(self) -> int:
        """Samples that the count leaves free."""
        return 0 if self.counted is None else int(self.counted[-1] - self.counted[0] + 1 - len(self.counted))

    def times(self) -> Array:
        """When the samples were taken, (n,) [s], if the device samples evenly. The least-squares line through all but
        the few samples that lie far off. Where the residual of these is still one-sided, the line along its lower edge:
        a host's stamp is late by what the message waited, and the promptest messages waited least."""
        start, step = self.even_line
        times = (self.step + step) * self.count
        times += self.start + start
        return np.asarray(times, dtype=np.float64)

    @cached_property
    def even_line(self) -> tuple[float, float]:
        """By how much the line of `times` differs from the least-squares line: at count 0 [s], and its slope [s]."""
        residual, (middle, spread) = self.residual, self.middle_and_spread
        count, usual, far = self.count, residual, FAR * spread + NEAR * self.step
        if residual.max() > middle + far or residual.min() < middle - far:
            near = np.abs(residual - middle) <= far
            count, usual = count[near], residual[near]
        sd, skewness = spread_and_skewness(usual)
        if sd > NEAR * self.step and skewness > ONE_SIDED:
            return lower_edge(self.count.astype(float), residual)
        step = line_slope(count, usual)
        return float(np.mean(usual) - step * np.mean(count)), step


def spread_and_skewness(values: Array) -> tuple[float, float]:
    """Standard deviation, and third moment about the mean in standard deviations (NaN where they do not scatter)."""
    apart, sd = values - values.mean(), float(np.std(values))
    return sd, float(apart @ (apart * apart)) / len(apart) / sd**3 if sd else np.nan


def device_clock(stamps: Array, count: Counts) -> DeviceClock:
    """The line through stamps (n,) [s] over their count (n,)."""
    step = line_slope(count, stamps)
    start = float(np.mean(stamps) - step * np.mean(count))
    none_missing = count[0] == 0 and count[-1] == len(count) - 1
    return DeviceClock(stamps, None if none_missing else count, start, step)


def lower_edge(x: Array, y: Array) -> tuple[float, float]:
    """Value at 0 and slope of the highest line below all points (x, y), (n,) each, x rising: their hull at its middle.
    The hull's edge over the mean of x. One point is held on each side of the mean; the lowest point below the line
    through them replaces the one on its side, until none lies below."""
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
