"""Which crossings are excluded: those that lie too far from the median crossing, each with a reason."""

from collections.abc import Sequence

import numpy as np

from osl_analysis.walking.conditions import PERTURBED, Sheet, split_keys
from osl_analysis.walking.crossing import Crossing, RefusedCrossing
from osl_analysis.walking.features import ANGLE, LOAD, PRESSURE, TORQUE, Feature, crossing_features
from osl_analysis.walking.groups import Place, places
from osl_analysis.walking.load import load_of_weight
from osl_analysis.walking.settings import SelectionSettings

USED, OUTLIER, REFUSED = "used", "outlier", "refused"
"""Status of a crossing in `walking_crossings.csv`."""
DEVIATIONS = (
    ("gait_deviation_deg", ANGLE),
    ("torque_deviation", TORQUE),
    ("load_deviation", LOAD),
    ("pressure_deviation_m", PRESSURE),
)
"""Columns of `walking_crossings.csv` with the features that compare curves."""
BRIDGED = 0.05
"""Share of hidden frames from which they are named beside an outlier."""
SEPARATOR = "; "
"""Between the names of gaits in one cell; no name has a semicolon."""


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
    reasons = {c.name: reasons[c.name] + hidden_share(c) for c in crossings if c.name in reasons}
    reasons |= {c.name: reason for c in crossings if (reason := load_reason(c, settings))}
    return {c.name: crossing_row(c, k, features, reasons.get(c.name)) for k, c in enumerate(crossings)}


def hidden_share(crossing: Crossing) -> str:
    """What hidden markers may have to do with an outlier, for its reason; empty if they were not hidden for long."""
    if crossing.bridged < BRIDGED:
        return ""
    return f" (markers were hidden for {crossing.bridged:.0%} of it: fill the gaps in Nexus, or lower longest_gap_s)"


def load_reason(crossing: Crossing, settings: SelectionSettings) -> str:
    """Why a crossing is excluded whatever the others are: its share of the weight, or a foot beside the plate."""
    (low, high), share = settings.load_of_weight, share_of_weight(crossing)
    if share is not None and not low <= share <= high:
        return (
            f"the plate carries {share:.2f} of the weight of {crossing.body_mass:g} kg in single support, expected "
            f"{low:g} to {high:g}: another foot stands on or beside the plate, somebody leans on a rail, or the body "
            "mass is wrong"
        )
    outside, most = crossing.quality.outside, settings.largest_outside_m
    if outside > most:
        return (
            f"a foot marker lies {100 * outside:.1f} cm outside the plate while the foot is flat, expected "
            f"{100 * most:g} cm or less: the foot stands beside the plate, or its corners are wrong"
        )
    return ""


def share_of_weight(crossing: Crossing) -> float | None:
    """Mean load in single support as a share of the weight; None if load or mass is unknown."""
    if crossing.load is None:
        return None
    return load_of_weight(crossing.time, crossing.load.force, crossing.stance, crossing.body_mass)


def crossing_row(crossing: Crossing, index: int, features: Sequence[Feature], reason: str | None) -> dict[str, object]:
    """One row of `walking_crossings.csv`: angles in deg, residuals in mm, the encoder's delay in ms."""
    quality, encoder = crossing.quality, crossing.quality.encoder
    values = {f.name: float(f.values[index]) for f in features}
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
        **{column: values.get(name) for column, name in DEVIATIONS},
        "load_of_weight": share_of_weight(crossing),
        "foot_outside_m": quality.outside,
        "furthest_scatters": furthest,
        "bridged": crossing.bridged,
        **{f"{name}_residual_mm": 1e3 * size for name, size in quality.residuals.items()},
        "plate_zero_N": quality.zero,
        "encoder_offset_deg": encoder and float(np.rad2deg(encoder.offset)),
        "encoder_delay_ms": encoder and 1e3 * encoder.delay,
        "encoder_rms_deg": encoder and float(np.rad2deg(encoder.rms)),
    }


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
