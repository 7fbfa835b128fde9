"""Known low-passes of sensors. The filter of one channel is applied to all other channels; nothing is deconvolved."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.trial import Array


@dataclass(frozen=True)
class SensorLowPass:
    """Analogue Butterworth low-pass of a sensor or its amplifier: causal, run once, with its phase."""

    cutoff_hz: float  # cut-off [Hz]
    order: int  # order

    def __call__(self, values: Array, rate_hz: float) -> Array:
        """Samples (n,), taken at `rate_hz`, after the filter. The filter starts at rest at the first sample.

        The bilinear transform without prewarping: at frequency f it is the analogue filter at f (1 + (pi f/rate)^2/3),
        8e-5 too high for 5 Hz at 1 kHz. The cut-off may lie above half the rate.
        """
        unwarped = rate_hz / np.pi * np.arctan(np.pi * self.cutoff_hz / rate_hz)
        sections = scipy.signal.butter(self.order, unwarped, fs=rate_hz, output="sos")
        filtered, _ = scipy.signal.sosfilt(sections, values, zi=scipy.signal.sosfilt_zi(sections) * values[0])
        return np.asarray(filtered)

    def __str__(self) -> str:
        return f"{self.cutoff_hz:g} Hz, order {self.order}"


def lacking(column: str, low_passes: Mapping[str, SensorLowPass]) -> list[SensorLowPass]:
    """The filters of other columns' sensors that this column's sensor does not have, each once."""
    return [one for one in dict.fromkeys(low_passes.values()) if one != low_passes.get(column)]
