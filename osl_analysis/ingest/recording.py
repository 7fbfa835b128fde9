"""What every reader returns: one recorder's samples in canonical columns, and where they come from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.trial import Array


@dataclass(frozen=True)
class Recording:
    """`samples`: `time` [s] on the recorder's own clock, then canonical columns in SI units, null where not sampled.

    `columns` says for each column which channel it is and how it was converted, `facts` holds what else a reader
    of the trial may ask (rates, time source, plates), `warnings` what was left to be desired. All is JSON.
    """

    samples: pl.DataFrame
    columns: Mapping[str, Mapping[str, Any]]
    facts: Mapping[str, Any] = field(default_factory=dict)
    warnings: Sequence[str] = ()


def check_finite(what: str, values: Array, time: Array) -> None:
    """Refuse NaN and infinity in a channel, (n,), naming the first with its time [s]."""
    finite = np.isfinite(values)
    if not finite.all():
        row = int(np.argmin(finite))
        raise InputError(
            f"{what}: {values[row]} in sample {row + 1} of {values.size}, at {time[row]:.3f} s; repair the recording "
            "or exclude the trial in the sheet"
        )
