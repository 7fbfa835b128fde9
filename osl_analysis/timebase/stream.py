"""A stream: the signals that one device or topic recorded at the same stamps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.trial import Array

Stamps = Literal["auto", "even", "exact"]
FEWEST_SAMPLES = 20
"""Samples below which neither a line through the stamps nor a spline through the samples means anything."""


@dataclass(frozen=True)
class Stream:
    """Signals sampled at shared stamps, as recorded.

    name: device, topic or column, for messages.
    stamps: (n,) [s], on the clock that all streams of the trial share.
    signals: name -> (n,) samples in any unit; NaN where the device sampled and the value is missing from the log.
    choice: `exact`, the stamps are true; `even`, the device samples evenly; `auto`, the stamps and signals decide.
    counter: (n,) the device's own count of its samples, where it writes one.
    silent: signals that say nothing about the stamps, as a command, which is computed and not sampled.
    delays: signal -> time [s] by which its samples are older than their stamps; none for a signal that is not there.

    Raises
    ------
    InputError
        Too few samples, a stamp that is not finite, an infinite value, stamps that run backwards or stand still.
    """

    name: str
    stamps: Array
    signals: Mapping[str, Array]
    choice: Stamps = "auto"
    counter: NDArray[np.int64] | None = None
    silent: frozenset[str] = frozenset()
    delays: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.stamps) < FEWEST_SAMPLES:
            raise InputError(
                f"{self.name}: {len(self.stamps)} samples are too few for a time base; "
                f"record at least {FEWEST_SAMPLES}, or exclude the trial in the sheet"
            )
        self._check_finite()
        self._check_forward()
        if not self.stamps[-1] > self.stamps[0]:
            raise InputError(
                f"{self.name}: time stands still at {self.stamps[0]:.6f} s for {len(self.stamps)} samples; "
                "take another time source"
            )

    def _check_finite(self) -> None:
        for name, values in {"stamps": self.stamps, **self.signals}.items():
            bad = ~np.isfinite(values) if name == "stamps" else np.isinf(values)
            there = np.count_nonzero(~np.isnan(values))
            if there < FEWEST_SAMPLES and not bad.any():
                raise InputError(
                    f"{self.name}: {name} has {there} values in {len(values)} rows; at least {FEWEST_SAMPLES} are "
                    "needed: repair the log or exclude the trial"
                )
            if bad.any():
                row = int(np.argmax(bad))
                raise InputError(
                    f"{self.name}: {name} is {values[row]} at row {row}, after {self.stamps[max(row - 1, 0)]:.6f} s; "
                    f"{bad.sum()} of {len(values)} values are not finite: repair the log or exclude the trial"
                )

    def _check_forward(self) -> None:
        if (self.stamps[1:] < self.stamps[:-1]).any():
            row = int(np.argmin(np.diff(self.stamps)))
            raise InputError(
                f"{self.name}: time runs backwards from {self.stamps[row]:.6f} s to {self.stamps[row + 1]:.6f} s "
                f"at row {row + 1}; the recorder's clock was set back: cut the log there, or take another time source"
            )

    def only(self, names: Sequence[str]) -> "Stream":
        """The named signals alone, as a stream whose name says so."""
        kept = {name: self.signals[name] for name in names}
        return replace(self, name=f"{self.name} [{', '.join(names)}]", signals=kept)


def without_repeats(stream: Stream) -> Stream:
    """The stream without rows that equal their predecessor in stamp and every value: a recorder wrote them twice."""
    new = np.concatenate([[True], changes(stream.stamps)])
    for column in stream.signals.values():
        if new.all():
            return stream
        new[1:] |= changes(column)
    if new.all():
        return stream
    counter = None if stream.counter is None else stream.counter[new]
    signals = {name: values[new] for name, values in stream.signals.items()}
    return replace(stream, stamps=stream.stamps[new], signals=signals, counter=counter)


def changes(column: Array) -> NDArray[np.bool_]:
    """Whether each value but the first differs from the one before, (n - 1,); a missing one equals a missing one."""
    return np.asarray((column[1:] != column[:-1]) & ~(np.isnan(column[1:]) & np.isnan(column[:-1])))
