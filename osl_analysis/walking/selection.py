"""Which crossings are excluded: those that lie too far from the median crossing, each with a reason."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.trial import Array
from osl_analysis.walking.conditions import PERTURBED, Sheet, split_keys
from osl_analysis.walking.crossing import Crossing, RefusedCrossing
from osl_analysis.walking.groups import Place, places
from osl_analysis.walking.settings import OutlierRule, SelectionSettings, Timing
from osl_analysis.walking.unperturbed import PHASES, signal_at, stance_times

NORMAL_MAD = 1.4826
"""Standard deviation of a normal distribution divided by its median absolute deviation."""
USED, OUTLIER, REFUSED = "used", "outlier", "refused"
"""Status of a crossing in `walking_crossings.csv`."""
SEPARATOR = "; "
"""Between the names of gaits in one cell; no name has a semicolon."""


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


def selection_rows(
    crossings: Sequence[Crossing],
    refused: Sequence[RefusedCrossing],
    settings: SelectionSettings,
    sheet: Sheet | None = None,
) -> dict[str, dict[str, object]]:
    """Rows of `walking_crossings.csv` by crossing: its quality, its group and, if it is excluded, the reason.

    `sheet` has the conditions of all crossings; None: there are none. Crossings are compared with those that share all
    conditions by which the campaign is split.
    """
    sheet = without_conditions(crossings, refused) if sheet is None else sheet
    keys = split_keys(sheet, settings)
    alike: dict[tuple[object, ...], list[Crossing]] = {}
    for c in crossings:
        alike.setdefault(tuple(sheet[c.name].get(key) for key in keys), []).append(c)
    rows = {name: row for some in alike.values() for name, row in compared_rows(some, settings).items()}
    used = [c for c in crossings if rows[c.name]["reason"] is None]
    rows |= {
        r.name: {"trial": r.name, "perturbed": r.perturbed, "status": REFUSED, "reason": r.reason} for r in refused
    }
    found = places(used, sheet, settings)
    return {name: row | place_row(found[name]) for name, row in rows.items()}


def without_conditions(crossings: Sequence[Crossing], refused: Sequence[RefusedCrossing]) -> Sheet:
    """The sheet of crossings about which no conditions are stated."""
    kinds = {c.name: c.onset is not None for c in crossings} | {r.name: r.perturbed for r in refused}
    return {name: {PERTURBED: perturbed} for name, perturbed in kinds.items()}


def place_row(place: Place) -> dict[str, object]:
    """Columns of `walking_crossings.csv` that say where a crossing belongs."""
    gait = SEPARATOR.join(place.gaits) or None
    return {
        "gait": gait, "group": place.group, "direction": place.direction, "onset_phase": place.onset_phase
    }  # fmt: skip


def compared_rows(crossings: Sequence[Crossing], settings: SelectionSettings) -> dict[str, dict[str, object]]:
    """Rows of crossings that are compared with each other, by crossing."""
    rule = settings.outliers
    features = crossing_features(crossings, settings.timing, rule) if rule else []
    reasons = outlier_reasons(features, [c.name for c in crossings], rule.limit) if rule else {}
    return {c.name: crossing_row(c, k, features, reasons.get(c.name)) for k, c in enumerate(crossings)}


def crossing_row(crossing: Crossing, index: int, features: Sequence[Feature], reason: str | None) -> dict[str, object]:
    """One row of `walking_crossings.csv`: angles in deg, residuals in mm, the encoder's delay in ms."""
    quality, encoder = crossing.quality, crossing.quality.encoder
    furthest = max((float(f.distance[index]) for f in features), default=None)
    return {
        "trial": crossing.name,
        "perturbed": crossing.onset is not None,
        "status": USED if reason is None else OUTLIER,
        "reason": reason,
        "stance_s": crossing.stance.duration,
        "onset_s": crossing.onset,
        "foot_forward_m": quality.placement[0],
        "foot_left_m": quality.placement[1],
        "gait_deviation_deg": next((float(f.values[index]) for f in features if f.unit == "deg"), None),
        "furthest_scatters": furthest,
        "bridged": crossing.bridged,
        **{f"{name}_residual_mm": 1e3 * size for name, size in quality.residuals.items()},
        "plate_zero_N": quality.zero,
        "encoder_offset_deg": encoder and float(np.rad2deg(encoder.offset)),
        "encoder_delay_ms": encoder and 1e3 * encoder.delay,
        "encoder_rms_deg": encoder and float(np.rad2deg(encoder.rms)),
    }


def crossing_features(crossings: Sequence[Crossing], timing: Timing, rule: OutlierRule) -> list[Feature]:
    """Features by which crossings are compared: duration of stance, place of the foot, deviation of the angle.

    A perturbation changes only the duration of stance. For this feature, perturbed crossings are compared with
    perturbed crossings only.
    """
    stance = np.array([c.stance.duration for c in crossings])
    place = np.array([c.quality.placement for c in crossings])
    deviation = np.rad2deg(gait_deviation(crossings, timing))
    perturbed = np.array([c.onset is not None for c in crossings])
    return [
        feature_of("stance", "s", stance, rule.stance_s, perturbed),
        feature_of("foot forward", "m", place[:, 0], rule.placement_m),
        feature_of("foot to the left", "m", place[:, 1], rule.placement_m),
        feature_of("gait before the onset", "deg", deviation, rule.angle_deg),
    ]


def feature_of(
    name: str, unit: str, values: Array, smallest_scatter: float, kind: NDArray[np.bool_] | None = None
) -> Feature:
    """A feature of crossings. Its medians are over all crossings, or over the crossings of the same `kind` (n,)."""
    kind = np.zeros(len(values), dtype=bool) if kind is None else kind
    median = np.array([np.median(values[kind == own]) for own in kind])
    scatter = NORMAL_MAD * float(np.median(np.abs(values - median)))
    return Feature(name, unit, values, median, max(scatter, smallest_scatter))


def gait_deviation(crossings: Sequence[Crossing], timing: Timing) -> Array:
    """RMS deviation (n,) [rad] of the ankle angle from the median crossing's at the same phase of stance.

    From heel strike to the end of the earliest baseline, so that a perturbation has no influence; over the whole
    stance if no crossing is perturbed.
    """
    phases = PHASES[PHASES <= earliest_baseline_end(crossings, timing)]
    angle = np.array([signal_at(c, c.theta, stance_times(c, phases)) for c in crossings])
    return np.asarray(np.sqrt(np.mean((angle - np.median(angle, axis=0)) ** 2, axis=1)))


def earliest_baseline_end(crossings: Sequence[Crossing], timing: Timing) -> float:
    """Phase of stance at which the first of all baselines ends; 1 without perturbed crossings."""
    ends = [
        (c.onset - timing.guard - c.stance.heel_strike) / c.stance.duration for c in crossings if c.onset is not None
    ]
    return min(ends, default=1.0)


def outlier_reasons(features: Sequence[Feature], names: Sequence[str], limit: float) -> dict[str, str]:
    """Why crossings are outliers, by name: the feature in which each lies furthest from the median."""
    reasons: dict[str, str] = {}
    distances = np.array([f.distance for f in features])
    for column, name in enumerate(names):
        worst = int(np.argmax(distances[:, column]))
        if distances[worst, column] > limit:
            f = features[worst]
            reasons[name] = (
                f"{f.name} {f.values[column]:.3g} {f.unit} lies {distances[worst, column]:.1f} scatters of "
                f"{f.scatter:.2g} {f.unit} from the median {f.median[column]:.3g} {f.unit}, more than {limit:g}"
            )
    return reasons
