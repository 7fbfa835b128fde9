"""Which crossings are compared with which: those that lie too far from the median crossing are left out, by name."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.perturbation import PHASES, Timing, at_times
from osl_analysis.walking.settings import OutlierRule

NORMAL_MAD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


@dataclass(frozen=True)
class Feature:
    """One feature of n crossings: `values` (n,) in `unit`, the medians (n,) of those that each is compared with, and
    the scatter about them."""

    name: str
    unit: str
    values: Array
    median: Array
    scatter: float

    @property
    def distance(self) -> Array:
        """Distance (n,) from the median, in scatters."""
        return np.asarray(np.abs(self.values - self.median) / self.scatter)


def features(crossings: Sequence[Crossing], timing: Timing, rule: OutlierRule) -> list[Feature]:
    """What crossings are judged by: duration of stance [s], place of the foot [m], deviation of the angle [deg].

    All of it is from before a perturbation could change it, but for the duration of stance, in which perturbed
    crossings are therefore compared with perturbed ones.
    """
    stance = np.array([c.stance.duration for c in crossings])
    place = np.array([c.quality.placement for c in crossings])
    deviation = np.rad2deg(gait_deviation(crossings, timing))
    return [
        feature("stance", "s", stance, rule.stance_s, np.array([c.onset is not None for c in crossings])),
        feature("foot forward", "m", place[:, 0], rule.placement_m),
        feature("foot to the left", "m", place[:, 1], rule.placement_m),
        feature("gait before the onset", "deg", deviation, rule.angle_deg),
    ]


def feature(name: str, unit: str, values: Array, least: float, kind: NDArray[np.bool_] | None = None) -> Feature:
    """A feature with its medians, over all crossings or over those of the same `kind` (n,), and its scatter, at least
    `least`."""
    kind = np.zeros(len(values), dtype=bool) if kind is None else kind
    median = np.array([np.median(values[kind == own]) for own in kind])
    scatter = NORMAL_MAD * float(np.median(np.abs(values - median)))
    return Feature(name, unit, values, median, max(scatter, least))


def gait_deviation(crossings: Sequence[Crossing], timing: Timing) -> Array:
    """RMS deviation (n,) [rad] of the ankle's angle from the median crossing's at the same phase of stance.

    From heel strike to the end of the earliest baseline, so that no crossing is judged by its perturbation; over the
    whole stance where none is perturbed.
    """
    phases = PHASES[PHASES <= last_phase(crossings, timing)]
    angle = np.array([at_times(c, c.theta, c.stance.heel_strike + phases * c.stance.duration) for c in crossings])
    return np.asarray(np.sqrt(np.mean((angle - np.median(angle, axis=0)) ** 2, axis=1)))


def last_phase(crossings: Sequence[Crossing], timing: Timing) -> float:
    """Phase of stance at which the first of all baselines ends."""
    ends = [
        (c.onset - timing.guard - c.stance.heel_strike) / c.stance.duration for c in crossings if c.onset is not None
    ]
    return min(ends, default=1.0)


def outliers(found: Sequence[Feature], names: Sequence[str], limit: float) -> dict[str, str]:
    """Why crossings lie too far from the others, by name: the feature in which each is furthest away."""
    reasons: dict[str, str] = {}
    distances = np.array([f.distance for f in found])
    for column, name in enumerate(names):
        worst = int(np.argmax(distances[:, column]))
        if distances[worst, column] > limit:
            f = found[worst]
            reasons[name] = (
                f"{f.name} {f.values[column]:.3g} {f.unit} lies {distances[worst, column]:.1f} scatters of "
                f"{f.scatter:.2g} {f.unit} from the median {f.median[column]:.3g} {f.unit}, more than {limit:g}"
            )
    return reasons
