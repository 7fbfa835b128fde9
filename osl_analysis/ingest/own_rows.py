# SPDX-License-Identifier: Apache-2.0
"""Rows of a table in which a channel has a sample of its own: a channel of another rate leaves the
others blank, or was interpolated between its samples."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.base.recording import Rows
from osl_analysis.base.trial import Array
from osl_analysis.ingest import LIMITS
from osl_analysis.ingest.conversion import floats_of


def with_own_rows(
    values: Mapping[str, NDArray[Any]], rows: Rows, time: Array
) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Mask the readings of rows in which a channel was not sampled.

    Parameters
    ----------
    values
        Readings (n,) by canonical column and counter.
    time
        (n,) [s].

    Returns
    -------
    values
        The same, masked where a channel has no sample.
    remarks
        A sentence for each channel with rows of its own, by column.
    """
    own = dict(values)
    remarks = {}
    for column, readings in values.items():
        numbers = floats_of(readings)
        is_sampled = ~np.isnan(numbers)
        if is_sampled.all() and lies_seldom_between(time, numbers):
            continue
        is_sampled[is_sampled] = ~interpolated(time[is_sampled], numbers[is_sampled])
        count = is_sampled.sum()
        if rows.count - count > LIMITS.most_irregular * rows.count and keeps_step(time[is_sampled]):
            own[column] = np.ma.masked_array(readings, ~is_sampled)
            step_ms = 1e3 * np.median(np.diff(time[is_sampled]))
            remarks[column] = (
                f"{column} has a sample of its own every {step_ms:.4g} ms, in {count} of"
                f" {rows.count} {rows.noun}s; others are blank, or lie on the line between two"
            )
    return own, remarks


def keeps_step(stamps: Array) -> bool:
    """Whether stamps (n,) [s] are those of one clock, of which hardly one is missing."""
    steps = np.diff(stamps)
    if steps.size < LIMITS.fewest_ticks:
        return False
    usual = np.median(steps)
    off = np.abs(steps - usual)
    return bool(off[off > 0.5 * usual].sum() <= LIMITS.most_irregular * steps.sum())


def interpolated(time: Array, values: Array) -> NDArray[np.bool_]:
    """Rows (n,) that change, and lie on the line through their neighbours; none where the others do
    not keep step, as those of a coarse or smooth channel."""
    is_on_line = on_line(time, values)
    if lies_seldom_between(time, values) or not keeps_step(time[~is_on_line]):
        return np.zeros_like(is_on_line)
    return is_on_line & (np.diff(values, prepend=0) != 0)


def lies_seldom_between(time: Array, values: Array) -> bool:
    """Whether few of the first values (n,) lie on the line through their neighbours: all of an hour
    would take as long as reading them."""
    few = slice(LIMITS.rows_of_filter)
    return bool(on_line(time[few], values[few]).mean() <= LIMITS.most_irregular)


def on_line(time: Array, values: Array) -> NDArray[np.bool_]:
    """Whether values (n,) at times (n,) [s] lie on the line through both neighbours, as near as
    they are printed."""
    changes = np.abs(np.diff(values))
    printed = changes.min(where=changes > 0, initial=np.inf)
    slope = (values[2:] - values[:-2]) / np.maximum(time[2:] - time[:-2], LIMITS.shortest_step_s)
    off = np.abs(values[1:-1] - values[:-2] - slope * (time[1:-1] - time[:-2]))
    is_near = off <= printed + np.abs(slope) * LIMITS.printed_s
    return np.concatenate([[False], is_near, [False]])[: values.size]
