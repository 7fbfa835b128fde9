"""Rows of a table in which a channel has a sample of its own: a channel of another rate leaves the
others blank, or was interpolated between its samples."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.ingest import LIMITS
from osl_analysis.recording import Rows
from osl_analysis.source_file import LogSource
from osl_analysis.trial import COUNTER, Array

Mask = NDArray[np.bool_]


def with_own_rows(
    values: Mapping[str, NDArray[Any]], source: LogSource, rows: Rows, time: Array
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
    own = {}
    remarks = {}
    for column, readings in values.items():
        own[column] = readings
        numbers = np.ma.filled(np.ma.asarray(readings, np.float64), np.nan)
        if column.endswith(COUNTER):
            continue
        is_sampled = ~np.isnan(numbers)
        between = interpolated(time[is_sampled], numbers[is_sampled])
        is_sampled[is_sampled] = ~between
        lacks = rows.count - is_sampled.sum()
        if lacks > LIMITS.most_irregular * rows.count and keeps_step(time[is_sampled]):
            how = "was interpolated, and has a sample" if between.any() else "has a value"
            own[column] = np.ma.masked_array(readings, ~is_sampled)
            step_s = np.median(np.diff(time[is_sampled]))
            remarks[column] = (
                f"{source.channels[column].title} {how} of its own every {1e3 * step_s:.4g} ms, in"
                f" {is_sampled.sum()} of {rows.count} {rows.noun}s"
            )
    return own, remarks


def keeps_step(stamps: Array) -> bool:
    """Whether stamps (n,) [s] are those of one clock, of which hardly one is missing."""
    steps = np.diff(stamps)
    if steps.size < LIMITS.fewest_ticks:
        return False
    usual = np.median(steps)
    return bool(np.mean(np.abs(steps - usual) > 0.5 * usual) <= LIMITS.most_irregular)


def interpolated(time: Array, values: Array) -> Mask:
    """Rows (n,) whose value lies on the line through its neighbours; none where the others do not
    keep step, as those of a coarse or smooth channel."""
    none = np.zeros(time.size, bool)
    middle = slice(max(time.size - LIMITS.rows_of_filter, 0) // 2, None)
    part = slice(middle.start, middle.start + LIMITS.rows_of_filter)
    if time.size < 3 or np.mean(on_line(time[part], values[part])) < LIMITS.most_irregular:
        return none
    is_on_line = on_line(time, values)
    knots = time[~is_on_line]
    if not keeps_step(knots):
        return none
    # a sample on the line by chance, or where the channel stands, is in step with the others
    steps = np.diff(knots)
    usual = np.median(steps)
    step = np.mean(steps[np.abs(steps - usual) < 0.5 * usual])
    before = np.clip(np.searchsorted(knots, time, "right") - 1, 0, steps.size - 1)
    since = (time - knots[before]) / step
    is_in_step = np.abs(since - np.rint(since)) < LIMITS.in_step
    lacks_sample = steps[before] > 1.5 * step
    return is_on_line & ~(is_in_step & lacks_sample)


def on_line(time: Array, values: Array) -> Mask:
    """Whether values (n,) at times (n,) [s] lie on the line through both neighbours, as near as
    they are printed."""
    slope = (values[2:] - values[:-2]) / np.maximum(time[2:] - time[:-2], LIMITS.shortest_step_s)
    off = np.abs(values[1:-1] - values[:-2] - slope * (time[1:-1] - time[:-2]))
    levels = np.diff(np.unique(values))
    printed = max(levels.min(initial=np.inf), LIMITS.of_rounding * np.ptp(values))
    near = printed + np.abs(slope) * LIMITS.printed_s
    return np.concatenate([[False], off <= near, [False]])
