# SPDX-License-Identifier: Apache-2.0
"""The range of estimates over parts of a motion: what the motion decides, and no noise.

A joint that is not of second order has another K, B and I at another amplitude or frequency. The
lowest and the highest of them over the amplitudes, and over the lower and the upper part of the
band, say how much: the interval, which is that of the same motion again, does not.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
import scipy

from osl_analysis.base.errors import IdentifiabilityError
from osl_analysis.bench.record import Record
from osl_analysis.bench.regression import Sums
from osl_analysis.stats.budget import Row
from osl_analysis.stats.linear_fit import LinearFit, products_between

FEWEST_SINES = 3  # of which two tell K from I in the lower and in the upper part of the band
# of a motion without sines: in half of them blocks of another size still tell all estimates
FEWEST_BLOCKS = 16
SPLIT_ORDER = 4  # of the filter that parts a band: 0.4 % of a motion an octave beyond remains


def parts_of(record: Record, sums: Sums) -> Iterator[Sums]:
    """The sums of parts of a motion: of each amplitude, and of both parts of its band.

    Parameters
    ----------
    record : Record
        Whose band is parted.
    sums : Sums
        Of its coarse record.
    """
    groups = sums.groups
    hz = np.array([stratum.frequency_hz for stratum in groups.strata])
    if groups.kind == "cycles":
        labels = dict.fromkeys(stratum.label for stratum in groups.strata)
        for label in labels:
            own_hz = np.unique([each.frequency_hz for each in groups.strata if each.label == label])
            if len(labels) > 1 and len(own_hz) > 1:
                yield sums.of(label)
        sines_hz = np.unique(hz)
        if len(sines_hz) >= FEWEST_SINES:
            both = len(sines_hz) // 2  # the sine in the middle belongs to both parts
            for part_hz in (sines_hz[: len(sines_hz) - both], sines_hz[both:]):
                yield sums.chosen(np.isin(hz[groups.stratum], part_hz))
        return
    rows = groups.stop - groups.first
    if len(rows) >= FEWEST_BLOCKS:
        mean_square = sums.products(sums.weighted, ["theta"])[:, 0, 0] / rows
        is_large = mean_square > np.median(mean_square)
        yield from (sums.chosen(~is_large), sums.chosen(is_large))
    low_hz, high_hz = record.band_hz
    yield from parts_of_band(record.coarse, sums, np.sqrt(low_hz * high_hz))


def parts_of_band(few: Record, sums: Sums, split_hz: float) -> Iterator[Sums]:
    """The sums below and above a frequency, by a zero-phase filter over the whole record."""
    sections = scipy.signal.butter(SPLIT_ORDER, split_hz, fs=few.rate_hz, output="sos")
    signals = np.array([*sums.columns.values(), few.filtered_torque, few.filtered_torque])
    slow = scipy.signal.sosfiltfilt(sections, signals)
    names = [*sums.columns]
    for part in (slow, signals - slow):
        for name in ("one", "ramp"):  # of each part the torque has its own offset and drift
            part[names.index(name)] = sums.columns[name]
        products = products_between(part.T, part.T, sums.groups.first, sums.groups.stop)
        yield replace(sums, weighted=products)


def range_over(
    parts: Sequence[Sums],
    fit: Callable[[Sums], LinearFit],
    whole: LinearFit,
    columns: Mapping[str, str],
) -> Row:
    """The lowest and the highest of some estimates of the whole motion and of its parts, in
    `columns` by their names; empty where no part tells them."""
    fits = [whole]
    for part in parts:
        with suppress(IdentifiabilityError):
            fits.append(fit(part))
    row: Row = {}
    if len(fits) > 1:
        for name, column in columns.items():
            values = [each[name] for each in fits]
            row[f"{column}_range_low"] = min(values)
            row[f"{column}_range_high"] = max(values)
    return row
