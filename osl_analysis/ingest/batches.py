# SPDX-License-Identifier: Apache-2.0
"""Stamps of a driver that hands on several samples at once, with one stamp for all of them.

The sensor went on sampling: samples of a batch are spread evenly over the time since the stamp
before it, so that the last one keeps the stamp.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Batches:
    """What makes equal stamps those of batches."""

    # steps within a batch and before it, in usual ones: a batch of m samples follows m steps after
    # the stamp before it; two samples within one usual step are of two sensors, or copies
    shortest_step: float = 0.75
    most_share: float = 0.5  # of the samples in batches; of more of them no usual step is known


BATCHES = Batches()


def spread_batches(
    stamps: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.bool_]] | None:
    """Spread samples of one stamp evenly over the time since the stamp before.

    Parameters
    ----------
    stamps
        Shape (n,), not falling [ns].

    Returns
    -------
    stamps
        Shape (n,), rising [ns].
    is_moved
        Shape (n,): samples whose stamp is another now.

    None if equal stamps are no batches: their samples did not take as long as others do.
    """
    _, first, counts = np.unique(stamps, return_index=True, return_counts=True)
    ends = stamps[first]
    in_batch = counts > 1
    if counts[in_batch].sum() > BATCHES.most_share * stamps.size or counts.size < 3:
        return None
    gaps = np.diff(ends)
    usual = np.median(gaps[~in_batch[1:]])
    steps = gaps / counts[1:]
    steps = np.concatenate([[usual], steps])  # nothing tells when the first batch began
    if (steps[in_batch] < BATCHES.shortest_step * usual).any():
        return None
    behind = np.repeat(first + counts - 1, counts) - np.arange(stamps.size)  # samples to its end
    back = np.rint(behind * np.repeat(steps, counts)).astype(np.int64)
    return np.repeat(ends, counts) - back, behind > 0
