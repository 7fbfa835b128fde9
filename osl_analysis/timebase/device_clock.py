"""The clock of a device that samples evenly: a straight line through the stamps of its counted samples; and by how much
the clocks of two devices, one of which measured the angle and the other the torque, drift apart."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from osl_analysis.errors import InputError
from osl_analysis.timebase.stream import SampleCount, line_through
from osl_analysis.trial import Array

ONE_SIDED = 0.5
"""Skew of the usual residual from which stamps are late and never early: the line then runs along their lower edge."""
FAR, NO_SPREAD = 5.0, 1e-6
"""Usual spreads, and usual steps besides, from which a sample lies far off the line and says nothing about it."""
WANDER_SAMPLES = 50  # samples over which the residual is averaged to see whether it wanders slowly; jitter averages out


@dataclass(frozen=True)
class DeviceClock:
    """Stamps of a stream against the least-squares line through them."""

    stamps: Array  # (n,) [s]
    count: SampleCount  # (n,) place of every sample in the device's count
    start: float  # the line's value [s] at count 0
    step: float  # its slope [s]

    @cached_property
    def residual(self) -> Array:
        """Stamp minus line (n,) [s]."""
        return np.asarray(self.stamps - self.step * self.count - self.start)

    @property
    def rate_hz(self) -> float:
        return 1 / self.step

    @cached_property
    def sd(self) -> float:
        """Standard deviation [s] of the residual."""
        return float(np.std(self.residual))

    @property
    def skew(self) -> float:
        """Skewness of the residual; 0 where there is none to speak of."""
        return skewness(self.residual) if self.sd > NO_SPREAD * self.step else 0.0

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
        return int(self.count[-1] - self.count[0] + 1 - len(self.count))

    def times(self) -> Array:
        """When the samples were taken, (n,) [s], if the device samples evenly. The least-squares line through all but
        the few samples that lie far off. Where the residual of these is still one-sided, the line along its lower edge:
        a host's stamp is late by what the message waited, and the promptest messages waited least."""
        residual, (middle, spread) = self.residual, self.middle_and_spread
        near = np.abs(residual - middle) <= FAR * spread + NO_SPREAD * self.step
        count, usual = self.count[near], residual[near]
        if np.std(usual) > NO_SPREAD * self.step and skewness(usual) > ONE_SIDED:
            start, step = lower_edge(self.count.astype(float), residual)
        else:
            step = line_through(count, usual)[0]
            start = float(np.mean(usual) - step * np.mean(count))
        times = (self.step + step) * self.count
        times += self.start + start
        return np.asarray(times, dtype=np.float64)


def skewness(values: Array) -> float:
    """Third moment about the mean in standard deviations; NaN where they do not scatter."""
    apart, sd = values - values.mean(), float(np.std(values))
    return float(apart @ (apart * apart)) / len(apart) / sd**3 if sd else np.nan


def device_clock(stamps: Array, count: SampleCount) -> DeviceClock:
    """The line through stamps (n,) [s] over their count (n,)."""
    step = line_through(count, stamps)[0]
    return DeviceClock(stamps, count, float(np.mean(stamps) - step * np.mean(count)), step)


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


SURE_OF_DRIFT = 4.0
"""Standard errors by which a drift must differ from zero before it is believed, if they are known exactly."""


@dataclass(frozen=True)
class ClockDrift:
    """How much faster the torque's clock runs than the angle's [ppm], and its standard error [ppm]."""

    ppm: float
    se: float
    freedom: float = np.inf  # degrees of freedom of the standard error

    @property
    def certain_ppm(self) -> float:
        """The drift [ppm] if it is larger than chance makes it, else 0. Of an estimated error as many are needed as are
        as rare as `SURE_OF_DRIFT` of an exact one (Student)."""
        rare = float(scipy.special.ndtr(-SURE_OF_DRIFT))
        enough = SURE_OF_DRIFT if np.isinf(self.freedom) else float(-scipy.special.stdtrit(self.freedom, rare))
        return self.ppm if abs(self.ppm) > enough * self.se else 0.0


def drift_row(drift: ClockDrift | None) -> dict[str, float | str | None]:
    """The drift [ppm], its standard error, and the drift if it is certain, as columns of a table; null without one."""
    values = (None, None, None) if drift is None else (drift.ppm, drift.se, drift.certain_ppm)
    return dict(zip(("clock_drift_ppm", "clock_drift_se_ppm", "certain_clock_drift_ppm"), values, strict=True))


def check_drift(drift: ClockDrift, largest_ppm: float) -> None:
    """Refuse a drift beyond what B and I bear."""
    if abs(drift.certain_ppm) > largest_ppm:
        raise InputError(
            f"the clocks of angle and torque drift apart by {drift.ppm:.2f} +- {drift.se:.2f} ppm, "
            f"more than {largest_ppm:g}: B and I would be wrong; "
            "synchronise the clocks, or record both channels with one device"
        )
