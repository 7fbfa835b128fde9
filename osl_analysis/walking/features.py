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
Mask = NDArray[np.bool_]
OF_LOAD = "of the usual load"
CAMP, FEWEST_OF_CAMP = 1 / 3, 2
"""Share of the unperturbed crossings, and number of crossings, from which those beyond the limit are a camp."""
CLEARLY = 1.5
"""By how much nearer to the perturbed crossings a smaller camp must be than the larger one."""
USUAL_WIDTH = 0.15
"""Length [m] by which centres of pressure are divided, to compare them with shares of the load."""
MIDDLE = PHASES[(PHASES >= SINGLE_SUPPORT[0]) & (PHASES <= SINGLE_SUPPORT[1])]
"""Phases of single support."""


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
    """Features by which crossings are compared, `early_features` and `later_features`.

    A crossing beyond the limit does not count in medians and scatters, which are computed anew until no further one is
    beyond it: four bad crossings of twelve widen the scatter so that none of them stands out. Crossings that are unlike
    the others before the onset do not count in the later features either.
    """
    sound = np.ones(len(crossings), dtype=bool)
    early, sound = without_beyond(lambda mask: early_features(crossings, timing, rule, mask), sound, rule.limit)

    def compared(mask: Mask) -> list[Feature]:
        return later_features(crossings, rule, mask)

    later, within = without_beyond(compared, sound, rule.limit)
    camp = likelier_camp(crossings, sound, within)
    return early + (later if camp is None else without_beyond(compared, camp, rule.limit)[0])


def likelier_camp(crossings: Sequence[Crossing], sound: Mask, within: Mask) -> Mask | None:
    """The sound crossings (n,) without those unperturbed ones that were `within` the limit, if the perturbed ones agree
    with the others; None if the majority stands.

    A majority decides nothing where two camps are nearly as large: with a second foot on the plate in four of seven
    unperturbed crossings, the sound three would be excluded. The perturbed ones load the plate as these do.
    """
    flat = np.array([c.onset is None for c in crossings])
    kept, other, turned = flat & within, flat & sound & ~within, ~flat & within
    if other.sum() < max(CAMP * (flat & sound).sum(), FEWEST_OF_CAMP) or turned.sum() < FEWEST_OF_CAMP:
        return None
    if any(c.load is None for c in crossings):
        return None
    apart = np.zeros(2)
    for signal, size in ((force_of, usual_load(crossings)), (left_of, USUAL_WIDTH)):
        curves = np.array([signal_at(c, signal(c), stance_times(c, MIDDLE)) for c in crossings]) / size
        usual = np.median(curves[turned], axis=0)
        apart += [np.mean((np.median(curves[camp], axis=0) - usual) ** 2) for camp in (kept, other)]
    return sound & ~kept if CLEARLY**2 * apart[1] < apart[0] else None


def without_beyond(features: Callable[[Mask], list[Feature]], sound: Mask, limit: float) -> tuple[list[Feature], Mask]:
    """Features among the `sound` crossings (n,), and which of these are within the limit in all, settled by repetition.

    At least half of the crossings stay: fewer would be a selection.
    """
    while True:
        found = features(sound)
        within = sound & (np.max([feature.distance for feature in found], axis=0) <= limit)
        if within.sum() == sound.sum() or 2 * within.sum() < len(within):
            return found, within
        sound = within


def early_features(crossings: Sequence[Crossing], timing: Timing, rule: OutlierRule, sound: Mask) -> list[Feature]:
    """What no perturbation can change, among the `sound` (n,): the place of the foot, and curves before the onset."""
    place = np.array([c.quality.placement for c in crossings])
    phases = PHASES[PHASES <= earliest_baseline_end(crossings, timing)]
    alike = Compared(np.zeros(len(crossings), dtype=int), sound)
    angle = np.rad2deg(deviation(crossings, theta_of, phases, alike))
    torque = deviation(crossings, torque_of, phases, alike)
    features = [
        feature_of("foot forward", "m", place[:, 0], rule.placement_m, alike),
        feature_of("foot to the left", "m", place[:, 1], rule.placement_m, alike),
        feature_of(ANGLE, "deg", angle, rule.angle_deg, alike),
        feature_of(TORQUE, "N*m", torque, rule.torque_nm, alike),
    ]
    if any(c.load is None for c in crossings):
        return features
    load = deviation(crossings, force_of, phases, alike) / usual_load(crossings)
    return [*features, feature_of(LOAD, OF_LOAD, load, rule.load_share, alike)]


def later_features(crossings: Sequence[Crossing], rule: OutlierRule, sound: Mask) -> list[Feature]:
    """What a perturbation changes, compared among the `sound` (n,) unperturbed crossings, and those of each direction:
    duration of stance, load and pressure in single support."""
    stance = np.array([c.stance.duration for c in crossings])
    kinds = Compared(np.array([0 if c.onset is None else c.sign for c in crossings]), sound)
    features = [feature_of("stance", "s", stance, rule.stance_s, kinds)]
    if any(c.load is None for c in crossings):
        return features
    load = deviation(crossings, force_of, MIDDLE, kinds) / usual_load(crossings)
    beside = deviation(crossings, left_of, MIDDLE, kinds)
    return [
        *features,
        feature_of(LOAD_LATER, OF_LOAD, load, rule.load_share, kinds),
        feature_of(PRESSURE, "m", beside, rule.pressure_m, kinds),
    ]


def usual_load(crossings: Sequence[Crossing]) -> float:
    """Median over crossings of the mean vertical force [N] in single support."""
    return float(np.median([signal_at(c, force_of(c), stance_times(c, MIDDLE)).mean() for c in crossings]))


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


def feature_of(name: str, unit: str, values: Array, smallest_scatter: float, compared: "Compared") -> Feature:
    """A feature of crossings, with the medians of those that they are compared with."""
    median = compared.medians(values)
    scatter = NORMAL_MAD * float(np.median(np.abs(values - median)[compared.sound]))
    return Feature(name, unit, values, median, max(scatter, smallest_scatter))


def deviation(
    crossings: Sequence[Crossing], signal: Callable[[Crossing], Array], phases: Array, compared: "Compared"
) -> Array:
    """RMS deviation (n,) of each crossing's signal at phases of stance from the median of those it is compared with."""
    curves = np.array([signal_at(c, signal(c), stance_times(c, phases)) for c in crossings])
    return np.asarray(np.sqrt(np.mean((curves - compared.medians(curves)) ** 2, axis=1)))


@dataclass(frozen=True)
class Compared:
    """With which crossings each of n crossings is compared.

    kind: a crossing is compared with those of the same kind (n,).
    sound: those that count in the medians (n,). If none of a kind is sound, all of it count.
    """

    kind: NDArray[np.int_]
    sound: Mask

    def medians(self, values: Array) -> Array:
        """For each crossing the median of values (n, ...) over those with which it is compared."""
        found = np.empty_like(values)
        for kind in np.unique(self.kind):
            own = self.kind == kind
            counted = own & self.sound if (own & self.sound).any() else own
            found[own] = np.median(values[counted], axis=0)
        return found


def earliest_baseline_end(crossings: Sequence[Crossing], timing: Timing) -> float:
    """Phase of stance at which the first of all baselines ends; 1 without perturbed crossings."""
    ends = [
        (c.onset - timing.guard - c.stance.heel_strike) / c.stance.duration for c in crossings if c.onset is not None
    ]
    return min(ends, default=1.0)
