# SPDX-License-Identifier: Apache-2.0
"""Step 8, groups: sort crossings by the conditions of the sheet, and leave out those that stand
out.

Each group of perturbed crossings has a result and a mean unperturbed gait of its own. A crossing is
compared with the others under the same conditions: a feature is far off where it differs from their
median by more than a limit of scatters, which are 1.4826 times the median absolute deviation.

Example: `label({"K_d": 200.0, "direction": "up"})` is `K_d 200, direction up`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError, listing
from osl_analysis.base.trial import Array
from osl_analysis.walking.crossing import DOWN, UP, Crossing
from osl_analysis.walking.isolated_response import PHASES, curves_of
from osl_analysis.walking.plate import SINGLE_SUPPORT, between
from osl_analysis.walking.poses import FREE_FALL, Mask
from osl_analysis.walking.walking_settings import SelectionSettings

# Columns of the sheet that part crossings into groups
STATED = ("group", "subject", "session", "side", "speed", "K_d", "B_d", "direction")
OF_PERSON = ("subject", "session", "side", "speed")  # those that an unperturbed crossing has too
OF_STATIC = ("subject", "session", "side")  # those in which a crossing agrees with a static trial
ALL = "all"  # name of the group of a campaign that is not split
LEFT_OUT = "left out"  # status of a crossing that was not read, or that sheet or quality exclude
# Measures of a crossing's set-up that a group has the mean of
MEASURED_IN_CROSSINGS = ("cop_outside_m", "marker_noise_ratio", "foot_residual_ratio", "turn_share")
# cause of an unusual torque or load
LOADED = "another foot or a hand on the plate, or a part of this foot beside it"
SEPARATOR = "; "  # between the names of groups in one cell; no name has a semicolon

Cells = Mapping[str, object]
"""Cells of one row of the sheet, by column: `STATED`, `perturbed`, `exclude`; None where empty."""


def split_keys(sheet: Mapping[str, Cells]) -> list[str]:
    """Find the columns of the sheet in which crossings differ, in the order of `STATED`.

    Rows that the sheet excludes need not be complete, and do not count.

    Raises
    ------
    InputError
        Such a column is empty in a crossing.
    """
    keys = []
    for key in STATED:
        # An unperturbed crossing has a person and a pace, too. In all other columns its cell may be
        # empty, and then it serves every value.
        concerned = [
            name
            for name, cells in sheet.items()
            if not cells.get("exclude") and (key in OF_PERSON or cells["perturbed"])
        ]
        values = {sheet[name].get(key) for name in concerned}
        if len(values) < 2:
            continue
        empty = [name for name in concerned if sheet[name].get(key) is None]
        if empty:
            raise InputError(
                f"trial {empty[0]}: no {key} in the sheet, but other crossings state"
                f" {listing(sorted(map(cell_text, values - {None})))}",
                "fill in the cell, or empty the column",
            )
        keys.append(key)
    return keys


def cell_text(value: object) -> str:
    """One cell as text, a number without trailing zeros."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def label(conditions: Mapping[str, object]) -> str:
    """Name of a group, such as `K_d 200, direction up`; `ALL` without any condition."""
    words = [
        cell_text(value) if key == "group" else f"{key} {cell_text(value)}"
        for key, value in conditions.items()
    ]
    return ", ".join(words) or ALL


def static_of(trial: str, cells: Cells, statics: Mapping[str, Cells]) -> str:
    """Find the static trial that calibrates a trial.

    It is the one in its column `static`. Else it is the one that agrees in most of subject, session
    and side, and contradicts none of them.

    Parameters
    ----------
    cells : mapping
        The trial's row of the sheet.
    statics : mapping
        The rows of the static trials, by name.

    Raises
    ------
    InputError
        There is none, or more than one.
    """
    named = cells.get("static")
    if named is not None:
        if named not in statics:
            raise InputError(
                f"trial '{trial}', static: '{named}' is no trial of experiment 'static' that is"
                " used",
                f"the sheet has {listing(list(statics))}",
            )
        return str(named)

    known_cells = {key: cells[key] for key in OF_STATIC if cells.get(key) is not None}
    agreement = {}
    for name, static in statics.items():
        compared = [key for key in known_cells if static.get(key) is not None]
        if all(known_cells[key] == static[key] for key in compared):
            agreement[name] = len(compared)
    best = [name for name, count in agreement.items() if count == max(agreement.values())]
    if len(best) == 1:
        return best[0]

    conditions = ", ".join(f"{key} {cell_text(value)}" for key, value in known_cells.items())
    raise InputError(
        f"trial '{trial}', which states {conditions or 'no subject, session or side'}:"
        f" {len(best)} of the static trials {listing(list(statics))} could be its own",
        "name one in the column static, record one, or state subject, session and side of all of"
        " them",
    )


def side_of(static: str, cells: Cells, served: Mapping[str, Cells], configured: str) -> str:
    """Find the side of the leg that a static trial calibrates.

    It is that of its row, else of the trials that it serves, else the configured one.

    Raises
    ------
    InputError
        They contradict each other.
    """
    sides = {str(row["side"]) for row in (cells, *served.values()) if row.get("side")}
    if len(sides) > 1:
        raise InputError(
            f"static trial '{static}' and the trials that it serves ({listing(list(served))})"
            f" state the sides {listing(sorted(sides))}",
            "record a static trial for each side and state its side",
        )
    return next(iter(sides), configured)


def places(
    crossings: Sequence[Crossing], sheet: Mapping[str, Cells]
) -> dict[str, dict[str, object]]:
    """Find the place of every row of the sheet, by name; `crossings` are those that are used.

    Where turns go both ways, their measured directions part the crossings.

    Returns
    -------
    dict
        Columns of `walking_crossings.csv`: group (an unperturbed crossing may have several),
        direction of the turn, and onset as a share of mean stance. The last two are None unless the
        crossing is used and perturbed.
    """
    direction_of = {crossing.name: crossing.direction for crossing in crossings}
    keys = split_keys(sheet)
    if {UP, DOWN} <= set(direction_of.values()) and "direction" not in keys:
        keys.append("direction")
    cells_of: dict[str, Cells] = {
        name: {**cells, "direction": direction_of.get(name) or cells.get("direction")}
        for name, cells in sheet.items()
    }
    groups: dict[str, Cells] = {}
    for cells in cells_of.values():
        conditions: Cells = {key: cells[key] for key in keys}
        is_used = cells["perturbed"] and not cells.get("exclude")
        if is_used and None not in conditions.values():
            groups[label(conditions)] = conditions

    place_of: dict[str, dict[str, object]] = {}
    for name in sheet:
        groups_of_crossing = [
            group for group in groups if is_of_group(cells_of[name], groups[group])
        ]
        joined = SEPARATOR.join(groups_of_crossing) or None
        place_of[name] = {"group": joined, "direction": None, "onset_phase": None}
    for group, conditions in groups.items():
        in_group = [c for c in crossings if is_of_group(cells_of[c.name], conditions)]
        stances = [c.stance.duration for c in in_group if c.onset is None]
        for crossing in in_group:
            if crossing.onset is not None:
                # a share of its own stance where there is no unperturbed one
                stance = np.mean(stances or [crossing.stance.duration])
                place_of[crossing.name] = {
                    "group": group,
                    "direction": crossing.direction,
                    "onset_phase": (crossing.onset - crossing.stance.heel_strike) / stance,
                }
    return place_of


def is_of_group(cells: Cells, conditions: Cells) -> bool:
    """Whether a row of the sheet belongs to a group: an empty cell matches every value."""
    return all(cells.get(key) in (None, value) for key, value in conditions.items())


@dataclass(frozen=True)
class Measure:
    """A compared quantity: a value (n,) of each crossing, or its curve (n, k)."""

    name: str
    unit: str
    values: Array
    smallest_scatter: float
    cause: str  # why a crossing may be far from the others


@dataclass(frozen=True)
class Feature:
    """One feature of n crossings. That of a curve is its RMS deviation from the median curve."""

    measure: Measure
    values: Array  # (n,)
    median: Array  # (n,) of the crossings with which each one is compared
    scatter: float  # about the medians
    # (n,) from the median, in scatters; for a curve only above it: no deviation is too small
    distance: Array


def selection_rows(
    crossings: Sequence[Crossing],
    refused: Mapping[str, str],
    settings: SelectionSettings,
    sheet: Mapping[str, Cells],
) -> dict[str, dict[str, object]]:
    """Make the rows of `walking_crossings.csv`, by crossing.

    Crossings that share all splitting conditions are compared. A crossing is excluded for its load
    or its foot's place, or as an outlier.

    Parameters
    ----------
    crossings
        The crossings that could be analysed.
    refused : mapping
        The reasons for which others could not, by name.
    sheet : mapping
        Conditions of all crossings of the sheet, in the order of the rows.

    Returns
    -------
    dict
        Quality, group and, if it is not used, the reason.
    """
    keys = split_keys(sheet)
    by_condition: dict[tuple[object, ...], list[Crossing]] = {}
    for crossing in crossings:
        condition = tuple(sheet[crossing.name].get(key) for key in keys)
        by_condition.setdefault(condition, []).append(crossing)

    reasons = {}
    for same_conditions in by_condition.values():
        features = crossing_features(same_conditions, settings)
        for index, crossing in enumerate(same_conditions):
            reasons[crossing.name] = exclusion_reason(crossing, features, index, settings)
    place_of = places([c for c in crossings if reasons[c.name] is None], sheet)

    row_of = {
        crossing.name: crossing_row(crossing, reasons[crossing.name]) for crossing in crossings
    }
    for name, reason in refused.items():
        row_of[name] = {"status": "refused", "reason": reason}
    left_out = {"status": LEFT_OUT, "reason": "excluded.csv says why"}
    return {
        name: {
            "trial": name,
            "perturbed": cells["perturbed"],
            **row_of.get(name, left_out),
            **place_of[name],
        }
        for name, cells in sheet.items()
    }


def crossing_features(crossings: Sequence[Crossing], settings: SelectionSettings) -> list[Feature]:
    """Compare crossings by features that no perturbation changes, then by those that it may change.

    A crossing beyond a limit does not count for later features: four bad ones of twelve would widen
    the scatter until none stands out. Loads are shares of the median load.
    """
    rule = settings.outliers
    guards = [
        crossing.stance.phase(np.array(crossing.onset - settings.guard_s))
        for crossing in crossings
        if crossing.onset is not None
    ]
    before = PHASES[min(guards, default=1.0) >= PHASES]
    middle = PHASES[between(PHASES, SINGLE_SUPPORT)]
    stance = np.array([crossing.stance.duration for crossing in crossings])
    theta = curves_of(crossings, "theta", before)
    torque = curves_of(crossings, "torque", before)
    # until the toes leave: a foot that lands over an edge pushes off beside the plate
    load = curves_of(crossings, "load", PHASES[PHASES >= SINGLE_SUPPORT[0]])[0]
    centre_of_pressure = curves_of(crossings, "load", middle)[1]
    usual = np.median(load.mean(axis=1))
    unchanged = [
        Measure(
            "deviation in angle before the onset",
            "deg",
            np.rad2deg(theta),
            rule.angle_deg,
            "markers that jump, or another gait",
        ),
        Measure("deviation in torque before the onset", "N*m", torque, rule.torque_nm, LOADED),
    ]
    changed = [
        Measure("stance", "s", stance, rule.stance_s, "another pace, or a stumble"),
        Measure(
            "deviation in load until toe-off",
            "% of the usual load",
            100 * load / usual,
            100 * rule.load_share,
            LOADED,
        ),
        Measure(
            "deviation of the centre of pressure from the ankle",
            "m",
            centre_of_pressure,
            rule.pressure_m,
            LOADED,
        ),
    ]

    # Features that a perturbation may change are compared within each direction
    turned = [crossing.direction or "" for crossing in crossings]
    directions = np.unique(turned, return_inverse=True)[1]
    same_kind = np.zeros_like(directions)
    everything = np.ones_like(directions, dtype=bool)
    before_onset, within = among_sound(unchanged, same_kind, everything, rule.limit)
    later, _ = among_sound(changed, directions, within, rule.limit)
    return before_onset + later


def among_sound(
    measures: Sequence[Measure], kinds: NDArray[np.int_], sound: Mask, limit: float
) -> tuple[list[Feature], Mask]:
    """Compare crossings with the sound ones of their kind, until no further one is too far.

    It also ends before fewer than half are left: these would be a selection.

    Parameters
    ----------
    kinds : Array
        Kind (n,); a crossing is compared with all of its kind if none of them is sound.
    sound : Mask
        Crossings (n,) that are sound at first.
    limit : float
        Largest distance, in scatters.

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
    is_curve = values.ndim == 2
    if is_curve:
        deviation = values - kind_medians(values, kinds, sound)
        values = np.sqrt(np.mean(deviation**2, axis=1))
    median = kind_medians(values, kinds, sound)
    beyond = values - median
    usual = scipy.stats.median_abs_deviation(beyond[sound], scale="normal")
    scatter = max(float(usual), measure.smallest_scatter)
    distance = (beyond if is_curve else np.abs(beyond)) / scatter
    return Feature(measure, values, median, scatter, distance)


def kind_medians(values: Array, kinds: NDArray[np.int_], sound: Mask) -> Array:
    """For each crossing, the median over the sound ones of its kind, shaped as `values`."""
    medians = np.empty_like(values)
    for kind in np.unique(kinds):
        is_of_kind = kinds == kind
        compared = is_of_kind & sound
        medians[is_of_kind] = np.median(values[compared if compared.any() else is_of_kind], axis=0)
    return medians


def exclusion_reason(
    crossing: Crossing, features: Sequence[Feature], index: int, settings: SelectionSettings
) -> str | None:
    """The reason for which the crossing at `index` is not used; None if it is used."""
    if crossing.body_mass is not None:
        phase = crossing.stance.phase(crossing.time)
        load = crossing.load[0][between(phase, SINGLE_SUPPORT)].mean()
        share = load / (crossing.body_mass * np.linalg.norm(FREE_FALL))
        low, high = settings.load_of_weight
        if not low <= share <= high:
            return (
                f"the plate carries {share:.2f} of the weight of {crossing.body_mass:g} kg in"
                f" single support, expected {low:g} to {high:g}: another foot stands on or beside"
                " the plate, somebody leans on a rail, the plate's gain is wrong, or the body mass"
                " (is it in pounds?)"
            )
    furthest = max(features, key=lambda feature: feature.distance[index])
    distance = furthest.distance[index]
    if not distance > settings.outliers.limit:
        return None
    unit = furthest.measure.unit
    value = furthest.values[index]
    median = furthest.median[index]
    return (
        f"{furthest.measure.name} is {value:.3g} {unit}, in other crossings {median:.3g} {unit}"
        f" (median): {distance:.1f} times their usual deviation of {furthest.scatter:.2g} {unit},"
        f" expected at most {settings.outliers.limit:g}; look for {furthest.measure.cause}"
    )


def crossing_row(crossing: Crossing, reason: str | None) -> dict[str, object]:
    """The quality of a crossing, as columns of `walking_crossings.csv`."""
    return {
        "status": "used" if reason is None else "outlier",
        "reason": reason,
        "stance_s": crossing.stance.duration,
        **vars(crossing.quality),
    }
