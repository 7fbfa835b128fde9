"""Numbers of messages on their way to a column: what they may be, and what is said where there are none."""

from collections.abc import Collection, Iterator

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap.limits import WrongFieldError
from osl_analysis.formats.mcap.topics import Decoded
from osl_analysis.formats.messages.leaves import Indices
from osl_analysis.trial import Array

LEVEL = "V"
"""Unit of the columns that may be read from truth values: levels of `sync` and `trigger`."""
EXACT = 2.0**53
"""Size below which a float64 counts exactly."""


def physical_values(topic: str, path: str, decoded: Decoded, unit: str) -> Array:
    """Numbers of a field for a column in `unit`, (n,), not converted; any number where a message lacks it.

    Raises
    ------
    WrongFieldError
        They are truth values, and the column is no level.
    """
    values = decoded.values[path]
    if values.dtype == bool and unit != LEVEL:
        row = int(np.argmax(decoded.present[path]))
        raise WrongFieldError(
            f"topic '{topic}': field '{path}' is {str(bool(values[row])).lower()} in message {row + 1}, a truth value "
            f"and no number in {unit}; name a number as `field` in the source file"
        )
    with np.errstate(invalid="ignore"):  # a signalling NaN is one, too
        return values.astype(np.float64)


def counts_of(topic: str, path: str, decoded: Decoded) -> Indices:
    """A device's count of its samples, (n,).

    Raises
    ------
    InputError
        A message lacks it, or it is no whole number that is read exactly.
    """
    values, present = decoded.values[path], decoded.present[path]
    largest = EXACT if values.dtype.kind == "f" else 2**63
    wrong = ~present | (values.dtype == bool)
    if values.dtype != bool:
        wrong |= ~(np.abs(values.astype(np.float64)) < largest) | (values != np.rint(values))
    if wrong.any():
        row = int(np.argmax(wrong))
        shown = values[row] if present[row] else "missing"
        raise InputError(
            f"topic '{topic}': counter '{path}' is {shown} in message {row + 1} of {values.size}, and no whole number "
            f"below {largest:.3g}; correct `counter` in the source file, or leave it out"
        )
    return values.astype(np.int64)


def absent_values(topic: str, paths: Collection[str], decoded: Decoded) -> Iterator[str]:
    """A warning for each field that some messages lack."""
    for path in dict.fromkeys(paths):
        present = decoded.present[path]
        if not present.all():
            yield (
                f"topic '{topic}': {int((~present).sum())} of {present.size} messages have no value in field "
                f"'{path}', first message {int(np.argmin(present)) + 1}"
            )
