"""What a check finds, and the channel in which it is worst."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from osl_analysis.trial import Array


@dataclass(frozen=True)
class Finding:
    """A check's value in the unit of `names.CHECKS`, with a remark; None where the check does not apply."""

    value: float | None
    remark: str = ""


def not_applicable(why: str) -> Finding:
    """A check that this trial has nothing to say to."""
    return Finding(None, f"not applicable: {why}")


def worst(values: Mapping[str, float], why: str) -> Finding:
    """The largest of several channels' values, and whose it is; `why` the check does not apply if there are none."""
    if not values:
        return not_applicable(why)
    name = max(values, key=lambda channel: values[channel])
    return Finding(float(values[name]), name if values[name] else "")


def longest_run(same: Array | np.ndarray) -> int:
    """Length of the longest run of true values, (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(same, dtype=np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))
