"""A stream: the signals that one device or topic recorded at the same stamps, as recorded."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.trial import Array

# fewest samples for a meaningful line through the stamps, or a spline through the values
FEWEST_STAMPS = 20
SampleCount = NDArray[np.int64]


@dataclass(frozen=True)
class SensorLowPass:
    """Analogue Butterworth low-pass of a sensor or its amplifier: causal, run once, with its
    phase."""

    cutoff_hz: float
    order: int

    def __call__(self, values: Array, rate_hz: float) -> Array:
        """Filter samples (n,) taken at `rate_hz` [Hz]; the filter starts in steady state.

        The bilinear transform is not prewarped, since the cut-off may lie above half the rate: 5 Hz
        at 1 kHz are taken for 8e-5 more.
        """
        unwarped = rate_hz / np.pi * np.arctan(np.pi * self.cutoff_hz / rate_hz)
        sections = scipy.signal.butter(self.order, unwarped, fs=rate_hz, output="sos")
        steady_state = scipy.signal.sosfilt_zi(sections) * values[0]
        filtered, _ = scipy.signal.sosfilt(sections, values, zi=steady_state)
        return np.asarray(filtered)


@dataclass(frozen=True)
class Stream:
    """Signals sampled at shared stamps, as recorded.

    Attributes
    ----------
    name : str
        Device, topic or column, for messages.
    stamps : Array
        (n,) [s], on the clock that all streams of the trial share.
    signals : Mapping
        (n,) samples each; NaN where the device sampled but the log lacks the value.
    choice : str
        `exact`, the stamps are true; `even`, the device samples evenly; `auto`, the stamps and
        signals decide.
    counter : Array or None
        (n,) the device's own count of its samples, where it writes one.
    silent : frozenset
        Signals that do not help to decide on the stamps, such as a command.
    delays : Mapping
        Stated delays [s] by signal: its samples are older than their stamps by that. 0 for a signal
        without one.
    low_passes : Mapping
        Stated low-pass filters of the sensors, by signal.
    fixture : Mapping or None
        Arguments of `fixture_torque`, as the sheet states them.
    clocks : dict
        `Trial.clocks`.

    Raises
    ------
    InputError
        Too few samples or values, an infinite value, or stamps that do not advance.
    """

    name: str
    stamps: Array
    signals: Mapping[str, Array]
    choice: Literal["auto", "even", "exact"] = "auto"
    counter: SampleCount | None = None
    silent: frozenset[str] = frozenset()
    delays: Mapping[str, float] = field(default_factory=dict)
    low_passes: Mapping[str, SensorLowPass] = field(default_factory=dict)
    fixture: Mapping[str, float] | None = None
    clocks: dict[bytes, Any] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        stamps = self.stamps
        if len(stamps) < FEWEST_STAMPS:
            raise InputError(
                f"{self.name}: {len(stamps)} samples are too few for a time base; "
                f"record at least {FEWEST_STAMPS}, or exclude the trial in the sheet"
            )
        for name, values in self.signals.items():
            self._check_values(name, values)
        if not stamps[-1] > stamps[0]:
            raise InputError(
                f"{self.name}: time stands still at {stamps[0]:.6f} s for {len(stamps)} samples; "
                "take another time source"
            )

    def _check_values(self, name: str, values: Array) -> None:
        """Refuse a signal (n,) with an infinite value, or with too few values."""
        is_infinite = np.isinf(values)
        if is_infinite.any():
            row = int(np.argmax(is_infinite))
            raise InputError(
                f"{self.name}: {name} is {values[row]} at row {row}, after"
                f" {self.stamps[max(row - 1, 0)]:.6f} s; {is_infinite.sum()} of {len(values)}"
                " values are not finite: repair the log or exclude the trial"
            )
        number = np.count_nonzero(~np.isnan(values))
        if number < FEWEST_STAMPS:
            raise InputError(
                f"{self.name}: {name} has {number} values in {len(values)} rows; at least"
                f" {FEWEST_STAMPS} are needed: repair the log or exclude the trial"
            )

    def without_repeats(self) -> "Stream":
        """Leave out rows that were written twice: equal to their predecessor in stamp and every
        value, NaN too."""
        is_new = np.diff(self.stamps, prepend=-np.inf) > 0
        for values in self.signals.values():
            filled = np.nan_to_num(values, nan=np.inf)  # no value is infinite
            is_new[1:] |= filled[1:] != filled[:-1]
        if is_new.all():
            return self
        return replace(
            self,
            stamps=self.stamps[is_new],
            signals={name: values[is_new] for name, values in self.signals.items()},
            counter=None if self.counter is None else self.counter[is_new],
        )
