"""One recorded file as canonical columns, and the values that none of them can reach."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.trial import Array, unit_of


@dataclass(frozen=True)
class Recording:
    """The raw files of one recorder, as read. All but the samples is JSON."""

    samples: pl.DataFrame
    """`time` [s] on the recorder's own clock, and canonical columns in SI units; null where a column has no sample."""
    columns: Mapping[str, Mapping[str, Any]]  # source channel and conversion of each column
    facts: Mapping[str, Any] = field(default_factory=dict)  # Further facts: rates, source of time, plates, damage.
    warnings: Sequence[str] = ()  # warnings, a sentence each

    def __post_init__(self) -> None:
        time = self.samples["time"]
        lasts = float(time[-1] - time[0]) if len(time) else 0.0
        for column, origin in self.columns.items():
            if abs(origin.get("delay", 0.0)) > lasts:
                raise InputError(
                    f"{column}: a delay of {origin['delay']:g} s is longer than the recording of {lasts:g} s; "
                    "correct `delay` and its unit in the source file"
                )


def check_values(what: str, values: Array, time: Array) -> None:
    """Refuse NaN and infinity in a channel, (n,), naming the first with its time [s]."""
    finite = np.isfinite(values)
    if not finite.all():
        row = int(np.argmin(finite))
        raise InputError(
            f"{what}: {values[row]} in sample {row + 1} of {values.size}, at {time[row]:.3f} s; repair the recording "
            "or exclude the trial in the sheet"
        )


LARGEST_MEASURED = {  # largest size of a value in its SI unit, by kind of quantity
    "m": 1e3,  # no laboratory is a kilometre long
    "rad": 1e6,  # 160 000 turns
    "rad/s": 1e5,  # a million turns per minute
    "N": 1e6,  # the weight of a hundred tonnes
    "N*m": 1e7,  # N*mm called N*m on a plate stays below, which the centre of pressure tells better
    "A": 1e5,
    "V": 1e6,  # counts of a converter of 16 bits called V stay below
    "N*m/rad": 1e8,
    "N*m*s/rad": 1e8,
    "N*m/kg": 1e6,
}


def check_sizes(recording: Recording) -> None:
    """Refuse values beyond `LARGEST_MEASURED`, and infinite ones. NaN, which is a value that was not seen, passes."""
    time = recording.samples["time"].to_numpy()
    for column in recording.columns:
        bound, values = LARGEST_MEASURED[unit_of(column)], recording.samples[column].to_numpy()
        if np.fmax.reduce(values, initial=0.0) > bound or np.fmin.reduce(values, initial=0.0) < -bound:
            beyond = np.abs(values) > bound
            row = int(np.argmax(beyond))
            raise InputError(
                f"{column} is {values[row]:.4g} {unit_of(column)} at {time[row]:.3f} s, and beyond ±{bound:g} in "
                f"{beyond.sum()} of {np.count_nonzero(~np.isnan(values))} samples: nothing here can be so large; "
                "correct its unit or scale in the source file, or repair the recording"
            )
