"""Channels that repeat one value: a sensor at an end of its range, and one that stands still."""

import numpy as np
from numpy.typing import NDArray

from osl_analysis.signals import run_edges
from osl_analysis.signals.plateaus import noise_of
from osl_analysis.trial import Array

NO_EXTREME = 0.05
"""Share of the range: a lowest or highest value nearer to zero is an unloaded sensor."""
MIDDLE = 0.25  # share of the range: a value nearer to the median is no extreme
CORNER_STEPS = 5.0  # a peak that is rounded to steps moves by four within half of its standing time

LEAST_CHANGE = 0.005  # share of a reference's range; one at rest creeps by less
LEAST_STANDING = 5  # samples; a peak may have as many
MEANS = 16  # of a reference during a run, which scatter less than single samples
LONGEST_MEAN_S = 0.05  # a sine of 5 Hz keeps nine tenths of its amplitude
NOISE_SDS = 8.0  # of such a mean, that are a change

MOST_REPEATED = 0.3  # share of a channel's samples; a command, whose levels have no noise, has more


def repeats(values: Array) -> NDArray[np.intp]:
    """First row and row after the last, (k, 2), of each run of two or more equal values (n,)."""
    edges = run_edges(np.diff(values) == 0)
    edges[:, 1] += 1
    return edges


def has_levels(values: Array) -> bool:
    """Whether a channel (n,) has levels without noise, apart from its longest run."""
    lengths = np.diff(repeats(values)) - 1
    return bool(lengths.sum() - lengths.max(initial=0) > MOST_REPEATED * values.size)


def run_at_extreme(values: Array, standing: NDArray[np.intp] | None = None) -> slice:
    """Find the longest run of a channel at its lowest or highest value.

    It is one sample, or many if the channel is clipped. Values near zero (an unloaded sensor) or
    near the median do not count, nor the peak of a slow signal, which repeats a value, too.

    Parameters
    ----------
    values : Array
        (n,).
    standing : Array, optional
        (k, 2), the only runs that count (`standing_runs`), of a channel without noise.

    Returns
    -------
    slice
        Rows of the run; empty if there is none, or if a value is not finite.
    """
    found: list[slice] = []
    span = np.ptp(values) if values.size else np.nan
    for end in (values.min(initial=np.inf), values.max(initial=-np.inf)):
        if abs(end) > NO_EXTREME * span and abs(end - np.median(values)) > MIDDLE * span:
            edges = run_edges(values == end)
            if standing is not None:
                edges = standing[values[standing[:, 0]] == end]
            longest = np.argmax(np.diff(edges)) if len(edges) else 0
            found += [slice(*run) for run in edges[longest : longest + 1].tolist()]
    sharp = [run for run in found if has_corners(values, run)]
    return max(sharp, key=lambda run: run.stop - run.start, default=slice(0, 0))


def has_corners(values: Array, run: slice) -> bool:
    """Whether a channel (n,) is far from where it stands, half as long before and after a run of
    equal values; a single one has no duration."""
    half = (run.stop - run.start) // 2
    sides = [row for row in (run.start - half, run.stop - 1 + half) if 0 <= row < values.size]
    steps = np.abs(np.diff(values))
    far = CORNER_STEPS * steps[steps > 0].min(initial=np.inf)
    return half == 0 or bool(np.abs(values[sides] - values[run.start]).min(initial=np.inf) > far)


def standing_runs(
    time: Array, values: Array, reference: Array, least: float = LEAST_CHANGE
) -> NDArray[np.intp]:
    """Find where a channel repeats one value although a reference changes.

    Parameters
    ----------
    time : Array
        (n,) [s].
    values, reference : Array
        (n,) each.
    least : float
        By which share of its range the reference changes.

    Returns
    -------
    Array
        First row and row after the last of each run, (k, 2). The reference changes in the third
        quarter of it: at rest it settles, and it may be earlier or later at both ends.
    """
    edges = repeats(values)
    edges = edges[np.diff(edges)[:, 0] > LEAST_STANDING]
    duration_s = np.ptp(time)
    if duration_s == 0:
        return edges[:0]
    sums = np.concatenate([[0.0], np.cumsum(reference - reference.mean())])
    rows = np.arange(sums.size)
    length = np.diff(edges)
    width = np.minimum(length / MEANS, LONGEST_MEAN_S * time.size / duration_s)
    begins = edges[:, :1] + length / 2 + (length / 4 - width) * np.linspace(0, 1, MEANS)
    means = (np.interp(begins + width, rows, sums) - np.interp(begins, rows, sums)) / width
    noise = noise_of(reference) / np.sqrt(np.maximum(width[:, 0], 1.0))
    changes = np.maximum(least * np.ptp(reference), NOISE_SDS * noise)
    return np.asarray(edges[np.ptp(means, axis=1) > changes])
