"""Features by which crossings are compared: duration, place of the foot, and angle, torque and load at equal phases."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.load import SINGLE_SUPPORT
from osl_analysis.walking.settings import OutlierRule, Timing
from osl_analysis.walking.unperturbed import PHASES, signal_at, stance_times

NORMAL_MAD = 1.4826
"""Standard deviation of a normal distribution divided by its median absolute deviation."""
ANGLE, TORQUE = "angle before the onset", "torque before the onset"
LOAD, LOAD_LATER, PRESSURE = "load before the onset", "load in single support", "pressure beside the ankle"
"""Names of the features that compare curves."""
Kind = NDArray[np.int_]


@dataclass(frozen=True)
class Feature:
    """One feature of n crossings.

    name: name of the feature, for messages.
    unit: unit of the feature, for messages.
    values: one value per crossing (n,).
    median: for each crossing (n,), the median of the crossings with which it is compared.
    scatter: scatter about the medians.
    """

    name: str
    unit: str
    values: Array
    median: Array
    scatter: float

    @property
    def distance(self) -> Array:
        """Distance (n,) from the median, in scatters."""
        return np.asarray(np.abs(self.values - self.median) / self.scatter)


def crossing_features(crossings: Sequence[Crossing], timing: Timing, rule: OutlierRule) -> list[Feature]:
    """Features by which crossings are compared.

    Before the onset, all crossings are compared with each other. What a perturbation changes, duration of stance and
    the load after the onset, is compared among the unperturbed crossings and among those of each direction.
    """
    place = np.array([c.quality.placement for c in crossings])
    stance = np.array([c.stance.duration for c in crossings])
    kind = np.array([0 if c.onset is None else c.sign for c in crossings])
    alike = np.zeros_like(kind)
    early = PHASES[PHASES <= earliest_baseline_end(crossings, timing)]
    angle = np.rad2deg(deviation(crossings, theta_of, early, alike))
    features = [
        feature_of("stance", "s", stance, rule.stance_s, kind),
        feature_of("foot forward", "m", place[:, 0], rule.placement_m, alike),
        feature_of("foot to the left", "m", place[:, 1], rule.placement_m, alike),
        feature_of(ANGLE, "deg", angle, rule.angle_deg, alike),
        feature_of(TORQUE, "N*m", deviation(crossings, torque_of, early, alike), rule.torque_nm, alike),
    ]
    if any(c.load is None for c in crossings):
        return features
    middle = PHASES[(PHASES >= SINGLE_SUPPORT[0]) & (PHASES <= SINGLE_SUPPORT[1])]
    usual = float(np.median([signal_at(c, force_of(c), stance_times(c, middle)).mean() for c in crossings]))
    before, after = (deviation(crossings, force_of, *at) / usual for at in ((early, alike), (middle, kind)))
    beside = deviation(crossings, left_of, middle, kind)
    return [
        *features,
        feature_of(LOAD, "of the usual load", before, rule.load_share, alike),
        feature_of(LOAD_LATER, "of the usual load", after, rule.load_share, kind),
        feature_of(PRESSURE, "m", beside, rule.pressure_m, kind),
    ]


def theta_of(crossing: Crossing) -> Array:
    """Angle (n,) [rad]."""
    return crossing.theta


def torque_of(crossing: Crossing) -> Array:
    """Torque (n,) [N*m]."""
    return crossing.torque


def force_of(crossing: Crossing) -> Array:
    """Vertical force (n,) [N] on the foot."""
    assert crossing.load is not None  # checked by `crossing_features`
    return crossing.load.force


def left_of(crossing: Crossing) -> Array:
    """Centre of pressure (n,) [m] to the left of the ankle."""
    assert crossing.load is not None  # checked by `crossing_features`
    return crossing.load.left


def feature_of(name: str, unit: str, values: Array, smallest_scatter: float, kind: Kind) -> Feature:
    """A feature of crossings. Each is compared with the median of the crossings of its kind (n,)."""
    median = np.array([np.median(values[kind == own]) for own in kind])
    scatter = NORMAL_MAD * float(np.median(np.abs(values - median)))
    return Feature(name, unit, values, median, max(scatter, smallest_scatter))


def deviation(crossings: Sequence[Crossing], signal: Callable[[Crossing], Array], phases: Array, kind: Kind) -> Array:
    """RMS deviation (n,) of each crossing's signal, at phases of stance, from the median of its kind (n,)."""
    curves = np.array([signal_at(c, signal(c), stance_times(c, phases)) for c in crossings])
    median = np.array([np.median(curves[kind == own], axis=0) for own in kind])
    return np.asarray(np.sqrt(np.mean((curves - median) ** 2, axis=1)))


def earliest_baseline_end(crossings: Sequence[Crossing], timing: Timing) -> float:
    """Phase of stance at which the first of all baselines ends; 1 without perturbed crossings."""
    ends = [
        (c.onset - timing.guard - c.stance.heel_strike) / c.stance.duration for c in crossings if c.onset is not None
    ]
    return min(ends, default=1.0)
