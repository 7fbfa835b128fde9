"""The stepped sine that the configuration commands: an expectation, with which the recording is compared."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

FREQUENCY_TOLERANCE = 0.05
"""Largest relative deviation of a recorded frequency from the commanded one that it follows: a clock is off by less."""
AMPLITUDE_TOLERANCE = 0.25
"""Largest relative deviation of a recorded amplitude from the commanded one. Some is lost to the dynamometer's
bandwidth."""


@dataclass(frozen=True)
class SteppedSineProtocol:
    """A stepped sine: each amplitude at every frequency, in any order and with or without rests."""

    amplitudes: Sequence[float]
    """Amplitudes [rad]."""
    frequencies_hz: Sequence[float]
    """Frequencies [Hz]."""
    cycles: float | Sequence[float]
    """Number of cycles at each frequency: one number for all, or one for each."""

    @property
    def cycles_at(self) -> tuple[float, ...]:
        """Number of cycles at each frequency; not whole where a time per frequency is commanded."""
        each = np.broadcast_to(np.asarray(self.cycles, dtype=float), len(self.frequencies_hz))
        return tuple(float(n) for n in each)

    def amplitude_near(self, amplitude: float) -> float | None:
        """The commanded amplitude [rad] that a recorded one follows; None if it is beyond the tolerance of all."""
        nearest = min(self.amplitudes, key=lambda commanded: abs(amplitude / commanded - 1), default=None)
        if nearest is None or abs(amplitude / nearest - 1) > AMPLITUDE_TOLERANCE:
            return None
        return nearest

    def frequency_near(self, frequency_hz: float) -> float | None:
        """The commanded frequency [Hz] that a recorded one follows; None if it is beyond the tolerance of all."""
        nearest = min(self.frequencies_hz, key=lambda commanded: abs(frequency_hz / commanded - 1), default=None)
        if nearest is None or abs(frequency_hz / nearest - 1) > FREQUENCY_TOLERANCE:
            return None
        return nearest
