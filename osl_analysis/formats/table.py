"""One table for every format: columns as the file has them, before any conversion, and what the file has lost."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.trial import Array


@dataclass(frozen=True)
class Table:
    """A recording, or a part of one, that has one time."""

    rows: int
    # by the address that asked for it: (rows,) in the type of the file, NaN where a reading failed, masked without one
    columns: Mapping[str, NDArray[Any]]
    units: Mapping[str, str] = field(default_factory=dict)  # units that the file states, by address
    time: Array | None = None  # time [s] of each row, (rows,), where the format itself tells it
    notes: Sequence[str] = ()  # what is missing or was repaired or left out, a sentence each
    report: Mapping[str, Any] = field(default_factory=dict)  # the same for the provenance's `damage`
    facts: Mapping[str, Any] = field(default_factory=dict)  # what else the provenance says of the file
    found: Mapping[str, Mapping[str, str]] = field(default_factory=dict)  # what it says of a column, as its full name
    lines: NDArray[np.int64] | None = None  # line of each row in a file of text, counted from 1
    noun: str = "row"  # what messages call a row
    failed: str = "NaN"  # what messages call a reading that failed

    def place(self, row: int) -> str:
        """A row, for messages."""
        return f"{self.noun} {row + 1} of {self.rows}" if self.lines is None else f"line {self.lines[row]}"
