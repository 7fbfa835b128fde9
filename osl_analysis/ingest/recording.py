"""Result of every reader: the samples of one recorder in canonical columns, and their sources."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.trial import Array


@dataclass(frozen=True)
class Recording:
    """The raw files of one recorder, as read. All but the samples is JSON."""

    samples: pl.DataFrame
    """`time` [s] on the recorder's own clock, and canonical columns in SI units; null where a column has no sample."""
    columns: Mapping[str, Mapping[str, Any]]
    """Source channel and conversion of each column."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """Further facts: rates, source of time, plates, damage."""
    warnings: Sequence[str] = ()
    """Warnings, a sentence each."""

    def __post_init__(self) -> None:
        time = self.samples["time"]
        lasts = float(time[-1] - time[0]) if len(time) else 0.0
        for column, origin in self.columns.items():
            if abs(origin.get("delay", 0.0)) > lasts:
                raise InputError(
                    f"{column}: a delay of {origin['delay']:g} s is longer than the recording of {lasts:g} s; "
                    "correct `delay` and its unit in the source file"
                )


def check_values(what: str, values: Array, time: Array, most_missing: float) -> None:
    """Refuse infinity in a channel, (n,), and NaN, a reading that failed, in more than a share of it."""
    missing = np.isnan(values)
    check_finite(what, np.where(missing, 0.0, values) if missing.any() else values, time)
    if missing.sum() > most_missing * values.size:
        raise InputError(
            f"{what}: NaN in {missing.sum()} of {values.size} samples, first at {time[np.argmax(missing)]:.3f} s; at "
            f"most {most_missing:.1%} may be: repair the recording, or raise `most_missing` in the source file"
        )


def check_finite(what: str, values: Array, time: Array) -> None:
    """Refuse NaN and infinity in a channel, (n,), naming the first with its time [s]."""
    finite = np.isfinite(values)
    if not finite.all():
        row = int(np.argmin(finite))
        raise InputError(
            f"{what}: {values[row]} in sample {row + 1} of {values.size}, at {time[row]:.3f} s; repair the recording "
            "or exclude the trial in the sheet"
        )
