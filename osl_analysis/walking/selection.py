"""Which crossings are used: each is compared with the others under the same conditions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.trial import Array
from osl_analysis.walking.ankle import PRESSED_N
from osl_analysis.walking.crossing import Crossing, RefusedCrossing
from osl_analysis.walking.groups import Place, Sheet, places, split_keys
from osl_analysis.walking.poses import FREE_FALL, Mask
from osl_analysis.walking.stance import SINGLE_SUPPORT
from osl_analysis.walking.unperturbed_gait import PHASES, signal_at, stance_times
from osl_analysis.walking.walking_settings import OutlierRule, SelectionSettings

MAD_TO_SD = 1.4826  # from the median absolute deviation to the standard deviation of normal noise
BESIDE_M = 0.05  # of the pressure from that of other crossings, by which feet walk apart
MUCH_BRIDGED = 0.05  # share of stance, from which hidden markers may be the cause of an outlier


@dataclass(frozen=True)
class Measure:
    """What is compared: a value (n,) of each crossing, or its curve (n, k)."""

    name: str
    unit: str
    values: Array
    smallest_scatter: float


@dataclass(frozen=True)
class Feature:
    """One feature of n crossings. That of a curve is its RMS deviation from the median curve."""

    name: str
    unit: str
    values: Array  # (n,)
    median: Array  # (n,), of those with which each crossing is compared
    scatter: float  # about the medians

    @property
    def distance(self) -> Array:
        """Distance (n,) from the median, in scatters."""
        return np.asarray(np.abs(self.values - self.median) / self.scatter)


@dataclass(frozen=True)
class Comparison:
    """A crossing among those under the same conditions."""

    crossing: Crossing
    features: Sequence[Feature]  # of all of them; empty if they are not compared
    index: int  # of the crossing in the features
    # Times (from, to) [s] in which the pressure lies far beside that of others, and how far [m]
    pressed_beside: tuple[float, float, float] | None = None

    @property
    def furthest(self) -> Feature | None:
        """The feature in which the crossing is furthest from the median."""
        return max(self.features, key=self.distance, default=None)

    def distance(self, feature: Feature) -> float:
        """Distance of the crossing from the median, in scatters."""
        return float(feature.distance[self.index])


def selection_rows(
    crossings: Sequence[Crossing],
    refused: Sequence[RefusedCrossing],
    settings: SelectionSettings,
    sheet: Sheet,
) -> dict[str, dict[str, object]]:
    """Make the rows of `walking_crossings.csv`, by crossing.

    Crossings that share all splitting conditions are compared. A crossing is excluded for its load
    or its foot's place, or as an outlier.

    Parameters
    ----------
    crossings, refused
        What became of every crossing.
    sheet : mapping
        Their conditions.

    Returns
    -------
    dict
        Quality, group and, if it is excluded, the reason.
    """
    compared = compare_crossings(crossings, settings, sheet)
    reasons = {
        comparison.crossing.name: exclusion_reason(comparison, settings) for comparison in compared
    }
    used = [crossing for crossing in crossings if reasons[crossing.name] is None]
    place_of = places(used, sheet)

    rows = {}
    for comparison in compared:
        name = comparison.crossing.name
        rows[name] = crossing_row(comparison, reasons[name], place_of[name])
    for refusal in refused:
        rows[refusal.name] = {
            "trial": refusal.name,
            "perturbed": refusal.perturbed,
            "status": "refused",
            "reason": refusal.reason,
            **place_of[refusal.name].columns(),
        }
    return rows


def compare_crossings(
    crossings: Sequence[Crossing], settings: SelectionSettings, sheet: Sheet
) -> list[Comparison]:
    """Compare each crossing with those that share all splitting conditions."""
    keys = split_keys(sheet)
    by_condition: dict[tuple[object, ...], list[Crossing]] = {}
    for crossing in crossings:
        condition = tuple(sheet[crossing.name].get(key) for key in keys)
        by_condition.setdefault(condition, []).append(crossing)

    comparisons = []
    for same_conditions in by_condition.values():
        features = crossing_features(same_conditions, settings, settings.outliers)
        beside = pressures_beside(same_conditions)
        for index, crossing in enumerate(same_conditions):
            pressed = far_beside(crossing, beside[index])
            comparisons.append(Comparison(crossing, features, index, pressed))
    return comparisons


def pressures_beside(crossings: Sequence[Crossing]) -> Array:
    """Distance [m] of the centre of pressure beside that of the median crossing.

    Returns
    -------
    Array
        (n, k) at `PHASES`; 0 where either is hardly loaded or a load is not known.
    """
    loads = [crossing.load for crossing in crossings if crossing.load is not None]
    if len(loads) < len(crossings):
        return np.zeros((len(crossings), len(PHASES)))
    times = [stance_times(crossing, PHASES) for crossing in crossings]
    force, left = (
        np.array(
            [
                signal_at(crossing, load[row], time)
                for crossing, load, time in zip(crossings, loads, times, strict=True)
            ]
        )
        for row in (0, 1)
    )
    is_loaded = (force > PRESSED_N) & (np.median(force, axis=0) > PRESSED_N)
    return np.where(is_loaded, np.abs(left - np.median(left, axis=0)), 0.0)


def far_beside(crossing: Crossing, beside: Array) -> tuple[float, float, float] | None:
    """When and how far (k,) [m] the pressure of a crossing lies beside that of others."""
    far = np.flatnonzero(beside > BESIDE_M)
    if not len(far):
        return None
    first, last = stance_times(crossing, PHASES[far[[0, -1]]])
    return float(first), float(last), float(beside.max())


def crossing_features(
    crossings: Sequence[Crossing], timing: SelectionSettings, rule: OutlierRule | None
) -> list[Feature]:
    """Compare crossings: what no perturbation can change, and what it can.

    A crossing beyond a limit does not count for later features: four bad ones of twelve would widen
    the scatter until none stands out. Loads are shares of the median load.

    Parameters
    ----------
    timing : SelectionSettings
        The guard before an onset.
    rule : OutlierRule or None
        Limit and smallest scatters; None: nothing is compared.
    """
    if rule is None:
        return []
    guards = [
        crossing.stance.phase(np.array(crossing.onset - timing.guard_s))
        for crossing in crossings
        if crossing.onset is not None
    ]
    before = PHASES[min(guards, default=1.0) >= PHASES]
    middle = PHASES[(PHASES >= SINGLE_SUPPORT[0]) & (PHASES <= SINGLE_SUPPORT[1])]

    def curves(signals: Sequence[Array], phases: Array) -> Array:
        """A signal of each crossing at phases (k,) of stance: (n, k)."""
        sampled = [
            signal_at(crossing, signal, stance_times(crossing, phases))
            for crossing, signal in zip(crossings, signals, strict=True)
        ]
        return np.array(sampled)

    forward = np.array([crossing.quality.foot_forward_m or 0.0 for crossing in crossings])
    left = np.array([crossing.quality.foot_left_m or 0.0 for crossing in crossings])
    theta = curves([crossing.theta for crossing in crossings], before)
    torque = curves([crossing.torque for crossing in crossings], before)
    stance = np.array([crossing.stance.duration for crossing in crossings])
    unchanged = [
        Measure("foot forward", "m", forward, rule.placement_m),
        Measure("foot to the left", "m", left, rule.placement_m),
        Measure("angle before the onset", "deg", np.rad2deg(theta), rule.angle_deg),
        Measure("torque before the onset", "N*m", torque, rule.torque_nm),
    ]
    changed = [Measure("stance", "s", stance, rule.stance_s)]

    loads = [crossing.load for crossing in crossings if crossing.load is not None]
    if len(loads) == len(crossings):
        force = [load[0] for load in loads]
        pressure = [load[1] for load in loads]  # to the left of the ankle
        usual = float(np.median(curves(force, middle).mean(axis=1)))
        share = "of the usual load"
        load_before = curves(force, before) / usual
        unchanged.append(Measure("load before the onset", share, load_before, rule.load_share))
        load_middle = curves(force, middle) / usual
        changed.append(Measure("load in single support", share, load_middle, rule.load_share))
        pressure_left = curves(pressure, middle)
        changed.append(Measure("pressure beside the ankle", "m", pressure_left, rule.pressure_m))

    # What a perturbation changes is compared among those of each direction
    same_kind = np.zeros(len(crossings), dtype=int)
    directions = np.array(
        [0 if crossing.onset is None else crossing.sign for crossing in crossings]
    )
    everything = np.ones(len(crossings), dtype=bool)
    before_onset, within = among_sound(unchanged, same_kind, everything, rule.limit)
    later, _ = among_sound(changed, directions, within, rule.limit)
    return before_onset + later


def among_sound(
    measures: Sequence[Measure], kinds: NDArray[np.int_], sound: Mask, limit: float
) -> tuple[list[Feature], Mask]:
    """Compare crossings with the sound ones of their kind, until no further one is too far.

    At least half stay, because fewer would be a selection.

    Parameters
    ----------
    kinds : Array
        (n,); a crossing is compared with all of its kind if none of them is sound.
    sound : Mask
        (n,), to begin with.
    limit : float
        In scatters.

    Returns
    -------
    tuple of list of Feature and Mask
        The features, and which crossings (n,) are within the limit in all of them.
    """
    while True:
        features = [feature_of(measure, kinds, sound) for measure in measures]
        furthest = np.max([feature.distance for feature in features], axis=0)
        within = sound & (furthest <= limit)
        if within.sum() == sound.sum() or 2 * within.sum() < len(within):
            return features, within
        sound = within


def feature_of(measure: Measure, kinds: NDArray[np.int_], sound: Mask) -> Feature:
    """Compare one measure."""
    values = measure.values
    if values.ndim == 2:
        deviation = values - kind_medians(values, kinds, sound)
        values = np.sqrt(np.mean(deviation**2, axis=1))
    median = kind_medians(values, kinds, sound)
    scatter = MAD_TO_SD * float(np.median(np.abs(values - median)[sound]))
    return Feature(
        measure.name, measure.unit, values, median, max(scatter, measure.smallest_scatter)
    )


def kind_medians(values: Array, kinds: NDArray[np.int_], sound: Mask) -> Array:
    """For each crossing, the median over the sound ones of its kind, shaped as `values`."""
    medians = np.empty_like(values)
    for kind in np.unique(kinds):
        of_kind = kinds == kind
        compared = of_kind & sound
        medians[of_kind] = np.median(values[compared if compared.any() else of_kind], axis=0)
    return medians


def load_of_weight(crossing: Crossing) -> float | None:
    """Load in single support as a share of the weight; None if either is not known."""
    if crossing.load is None or crossing.body_mass is None:
        return None
    phase = crossing.stance.phase(crossing.time)
    middle = (phase >= SINGLE_SUPPORT[0]) & (phase <= SINGLE_SUPPORT[1])
    weight = crossing.body_mass * np.linalg.norm(FREE_FALL)
    return float(crossing.load[0][middle].mean() / weight)


def exclusion_reason(comparison: Comparison, settings: SelectionSettings) -> str | None:
    """Why a crossing is not used; None if it is."""
    crossing = comparison.crossing
    share = load_of_weight(crossing)
    low, high = settings.load_of_weight
    if share is not None and not low <= share <= high:
        return (
            f"the plate carries {share:.2f} of the weight of {crossing.body_mass:g} kg in single"
            f" support, expected {low:g} to {high:g}: another foot stands on or beside the plate,"
            " somebody leans on a rail, or the body mass is wrong"
        )
    outside = crossing.quality.foot_outside_m
    if outside is not None and outside > settings.largest_outside_m:
        return (
            f"a foot marker lies {100 * outside:.1f} cm outside the plate while the foot is flat,"
            f" expected {100 * settings.largest_outside_m:g} cm or less: the foot stands beside the"
            " plate, or its corners are wrong"
        )
    furthest = comparison.furthest
    if furthest is None or settings.outliers is None:
        return None
    distance = comparison.distance(furthest)
    if not distance > settings.outliers.limit:
        return None
    if comparison.pressed_beside is not None:
        first_s, last_s, beside_m = comparison.pressed_beside
        return (
            f"another foot stands on the plate from {first_s:.2f} to {last_s:.2f} s: the pressure"
            f" lies up to {100 * beside_m:.0f} cm beside that of other crossings, expected"
            f" {100 * BESIDE_M:.0f} cm or less"
        )
    unit = furthest.unit
    value = furthest.values[comparison.index]
    median = furthest.median[comparison.index]
    reason = (
        f"{furthest.name} {value:.3g} {unit} lies {distance:.1f} scatters of"
        f" {furthest.scatter:.2g} {unit} from the median {median:.3g} {unit}, more than"
        f" {settings.outliers.limit:g}"
    )
    if crossing.bridged >= MUCH_BRIDGED:
        reason += (
            f" (markers were hidden for {crossing.bridged:.0%} of it: see that three markers of"
            " each cluster stay in sight, or lower longest_gap_s)"
        )
    return reason


def crossing_row(comparison: Comparison, reason: str | None, place: Place) -> dict[str, object]:
    """One row of `walking_crossings.csv`."""
    crossing = comparison.crossing
    furthest = comparison.furthest
    quality = crossing.quality
    return {
        "trial": crossing.name,
        "perturbed": crossing.onset is not None,
        "status": "used" if reason is None else "outlier",
        "reason": reason,
        "stance_s": crossing.stance.duration,
        "onset_s": crossing.onset,
        "load_of_weight": load_of_weight(crossing),
        "pressure_outside_m": quality.pressure_outside_m,
        "furthest_scatters": None if furthest is None else comparison.distance(furthest),
        "different": quality.different,
        "different_mm": quality.different_mm,
        **place.columns(),
    }
