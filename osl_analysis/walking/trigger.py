"""The platform's trigger: when its edge was recorded, and by how much the motion follows it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from osl_analysis.trial import Trial
from osl_analysis.walking.platform_shape import Alignment

COLUMN = "trigger"
SMALLEST_LEVEL_V = 0.5
"""Smallest difference [V] between the trigger's levels that is an edge."""
FEWEST = 3
"""Fewest crossings with a trigger from which a latency is judged."""
CHANCE = 1e-3
"""A latency is constant unless the starts' own noise would scatter it as much with less than this probability."""


@dataclass(frozen=True)
class TriggerEdge:
    """The first rise of a trial's trigger.

    time: [s], halfway between the last low and the first high sample.
    step: time [s] between them.
    """

    time: float
    step: float


@dataclass(frozen=True)
class TriggerLatency:
    """The latency of the platform's motion behind its trigger.

    mean: [s].
    sd: scatter [s] over crossings.
    template_se: standard error [s] with which the shared shape shows the start of one crossing.
    resolution: standard deviation [s] of an edge that is known to one sample.
    crossings: number of crossings.
    used: whether the latency is constant, so that the trigger tells the onset.
    """

    mean: float
    sd: float
    template_se: float
    resolution: float
    crossings: int
    used: bool


def trigger_edge(trial: Trial) -> TriggerEdge | None:
    """The first rise of the trigger through the middle of its levels; None without a trigger that is finite and
    has an edge."""
    if COLUMN not in trial.samples.columns:
        return None
    rows = trial.sampled(COLUMN)
    time, level = rows["time"].to_numpy(), rows[COLUMN].to_numpy()
    if len(level) < 2 or not np.isfinite(level).all() or np.ptp(level) < SMALLEST_LEVEL_V:
        return None
    high = level > (level.max() + level.min()) / 2
    rises = np.flatnonzero(~high[:-1] & high[1:])
    if not len(rises):
        return None
    row = int(rises[0])
    return TriggerEdge(float(time[row] + time[row + 1]) / 2, float(time[row + 1] - time[row]))


def trigger_latency(
    alignments: Sequence[Alignment], triggers: Mapping[str, float], step: float
) -> TriggerLatency | None:
    """Latency [s] of the starts behind the triggers, sampled every `step` [s]; None with fewer than three crossings.

    It is constant if its scatter is that of the starts' standard errors and of the sampling.
    """
    both = [(a.start - triggers[a.name], a.start_se) for a in alignments if a.name in triggers]
    if len(both) < FEWEST:
        return None
    late, errors = np.array(both).T
    resolution = step / np.sqrt(12)
    expected = float(np.mean(errors**2)) + resolution**2
    constant = np.sum((late - late.mean()) ** 2) / expected < chdtri(len(late) - 1, CHANCE)
    template_se = float(np.sqrt(np.mean(errors**2)))
    return TriggerLatency(
        float(late.mean()), float(late.std(ddof=1)), template_se, float(resolution), len(late), bool(constant)
    )
