"""Noise of a filtered signal as it was before the filter, from which intervals of any excitation come."""

from collections.abc import Callable

import numpy as np

from osl_analysis.pieces import pieces
from osl_analysis.signals import LowPass
from osl_analysis.trial import Array

TERMS = 5
"""Terms by which a signal is found from what a filter left of it: up to the cut-off 97 % of it."""
AT_ONCE = 1 << 18
"""Rows whose noise is found at a time, beside as many as the filters remember."""
REACH = 2
"""Times that a filter remembers: as many runs of it as there are terms, one behind the other, have forgotten then."""


def noise_beyond(
    noisy: Array, behind: Array, signal: Callable[[slice], Array], low_pass: LowPass, rate_hz: float
) -> Array:
    """What a filter H took off a `noisy` signal (n,), without the part of the `signal` itself, which is known behind H.

    All are in the unit of the signal, sampled at `rate_hz`; `behind` (n,) is the noisy signal behind H, and `signal`
    gives the rows that are asked for. The filter took off (1 - H) of the signal s, of which H s is known:
    s = H s + (1 - H) H s + (1 - H)^2 H s + ...

    Raises
    ------
    InputError
        As the filter.
    """
    found, reach = np.empty(len(noisy)), REACH * low_pass.remembers(rate_hz)
    for rows in pieces(len(noisy), AT_ONCE):
        known = slice(max(rows.start - reach, 0), min(rows.stop + reach, len(noisy)))
        part, off = signal(known), noisy[known] - behind[known]
        for _ in range(TERMS):
            part = part - low_pass(part, rate_hz)
            off -= part
        found[rows] = off[rows.start - known.start : rows.stop - known.start]
    return found
