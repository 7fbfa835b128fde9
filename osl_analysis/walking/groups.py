"""Which crossings are used, and with which result: conditions of the sheet, comparison with the
others, groups."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing
from osl_analysis.trial import Array, check_finite
from osl_analysis.walking.bodies import FREE_FALL, Mask
from osl_analysis.walking.crossing import QUALITY_COLUMNS, Crossing, RefusedCrossing
from osl_analysis.walking.plate import SINGLE_SUPPORT
from osl_analysis.walking.response import PHASES, signal_at, stance_times
from osl_analysis.walking.settings import OutlierRule, SelectionSettings

# Columns of the sheet that can split results. Each value has a mean unperturbed gait of its own.
STATED = ("group", "subject", "session", "side", "speed", "K_d", "B_d")
ALL = "all"  # Name of the group and of the gait of a campaign that is not split

# Cells of one row of the sheet, by column: `STATED` and `perturbed`; None where empty
Cells = Mapping[str, object]
Sheet = Mapping[str, Cells]  # Cells of crossings, by trial


def split_keys(sheet: Sheet, settings: SelectionSettings) -> list[str]:
    """Columns of the sheet that split a campaign, in the order of `STATED`: those of `group_by`,
    and any other in which crossings differ, unless `pool` names it. Raises InputError: a column is
    empty in a crossing, or everywhere."""
    keys = []
    for key in STATED:
        # An unperturbed crossing has a person and a pace too. In the others, its empty cell serves
        # every value
        every = key in ("subject", "session", "side", "speed")
        concerned = [name for name, cells in sheet.items() if every or cells["perturbed"]]
        values = {sheet[name].get(key) for name in concerned}
        stated = values - {None}
        if key in settings.pool or (len(values) < 2 and key not in settings.group_by):
            continue
        if not stated:
            raise InputError(
                f"walking.group_by names '{key}', but no crossing states it; fill in the column"
                f" {key} of the sheet, or remove it from group_by"
            )
        empty = [name for name in concerned if sheet[name].get(key) is None]
        if empty:
            raise InputError(
                f"trial {empty[0]}: no {key} in the sheet, but other crossings state"
                f" {cells_said(stated)}; fill in the cell, or add {key} to walking.pool"
            )
        keys.append(key)
    return keys


def cells_said(values: Collection[object]) -> str:
    """Values in order, for a message; without None."""
    numbers = sorted(value for value in values if isinstance(value, int | float))
    words = sorted(value for value in values if isinstance(value, str))
    return ", ".join([*map(shown, numbers), *words])


def shown(value: object) -> str:
    """One cell as text, a number without trailing zeros."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def label(parts: Mapping[str, object]) -> str:
    """Name of a group or gait from its conditions, such as `K_d 200, timing 41 %`; `ALL` without
    any."""
    named = (
        shown(value) if key == "group" else f"{key} {shown(value)}" for key, value in parts.items()
    )
    return ", ".join(named) or ALL


def static_of(trial: str, cells: Cells, statics: Mapping[str, Cells]) -> str:
    """Name of the static trial of a trial with the row `cells`: the one in its column `static`;
    else, of `statics` (name to row) that contradict no stated subject, session or side, the one
    that agrees in most of them."""
    named = cells.get("static")
    if named is not None:
        if named not in statics:
            raise InputError(
                f"trial '{trial}', static: '{named}' is no trial of experiment 'static' that is"
                f" used; the sheet has {listing(list(statics))}"
            )
        return str(named)
    stated = {
        key: cells[key] for key in ("subject", "session", "side") if cells.get(key) is not None
    }
    agreement = {}
    for name, other in statics.items():
        both = [(value, other[key]) for key, value in stated.items() if other.get(key) is not None]
        if all(a == b for a, b in both):
            agreement[name] = len(both)
    best = [name for name, count in agreement.items() if count == max(agreement.values())]
    if len(best) == 1:
        return best[0]
    said = ", ".join(f"{key} {shown(value)}" for key, value in stated.items())
    whose = f"trial '{trial}'" + (
        f" ({said})" if said else ", which states no subject, session or side"
    )
    none = (
        f"no static trial of the same conditions, the sheet has {listing(list(statics))}; record"
        " one, or name one in"
    )
    several = f"{len(best)} static trials could be its own ({listing(best)}); name one in"
    more = ", or state subject, session or side of all of them" if best else ""
    raise InputError(f"{whose}: {several if best else none} the column static{more}")


def side_of(static: str, cells: Cells, served: Mapping[str, Cells], otherwise: str) -> str:
    """Side of the leg that a static trial calibrates: of its row, else of the trials that it
    serves, or `otherwise`."""
    sides = {row["side"]: name for name, row in served.items() if row.get("side") is not None}
    own = cells.get("side")
    wrong = [(side, name) for side, name in sides.items() if own is not None and side != own]
    if len(sides) > 1 or wrong:
        side, name = wrong[0] if wrong else list(sides.items())[1]
        raise InputError(
            f"static trial '{static}' serves trials of the sides {cells_said({*sides, own})} (trial"
            f" '{name}': {side}); record a static trial for each side and state its side"
        )
    return str(own or next(iter(sides), otherwise))


@dataclass(frozen=True)
class Feature:
    """One feature of n crossings with its unit: values (n,), for each crossing the median (n,) of
    those with which it is compared, and the scatter about the medians."""

    name: str
    unit: str
    values: Array
    median: Array
    scatter: float

    @property
    def distance(self) -> Array:
        """Distance (n,) from the median, in scatters."""
        return np.asarray(np.abs(self.values - self.median) / self.scatter)


def crossing_features(
    crossings: Sequence[Crossing], timing: SelectionSettings, rule: OutlierRule
) -> list[Feature]:
    """Features by which crossings are compared; loads as shares of the median load. A crossing
    beyond a limit does not count for later features: four bad ones of twelve would widen the
    scatter until none stands out."""
    ends = [
        c.stance.phase(np.array(c.onset - timing.guard_s)) for c in crossings if c.onset is not None
    ]
    before = PHASES[min(ends, default=1.0) >= PHASES]
    middle = PHASES[(PHASES >= SINGLE_SUPPORT[0]) & (PHASES <= SINGLE_SUPPORT[1])]

    def curves(signals: Sequence[Array], phases: Array) -> Array:
        """A signal of each crossing at phases (k,) of stance: (n, k)."""
        pairs = zip(crossings, signals, strict=True)
        return np.array([signal_at(c, signal, stance_times(c, phases)) for c, signal in pairs])

    ways = ("foot_forward_m", "foot_left_m")
    forward, left = (np.array([c.quality.get(way) or 0.0 for c in crossings]) for way in ways)
    # What no perturbation can change; and what it changes, compared among those of each direction
    early = [
        ("foot forward", "m", forward, rule.placement_m),
        ("foot to the left", "m", left, rule.placement_m),
        (
            "angle before the onset",
            "deg",
            np.rad2deg(curves([c.theta for c in crossings], before)),
            rule.angle_deg,
        ),
        (
            "torque before the onset",
            "N*m",
            curves([c.torque for c in crossings], before),
            rule.torque_nm,
        ),
    ]
    later = [("stance", "s", np.array([c.stance.duration for c in crossings]), rule.stance_s)]
    loads = [c.load for c in crossings if c.load is not None]
    if len(loads) == len(crossings):
        forces, pressures = ([load[k] for load in loads] for k in (0, 1))
        usual, share = float(np.median(curves(forces, middle).mean(axis=1))), "of the usual load"
        early.append(
            ("load before the onset", share, curves(forces, before) / usual, rule.load_share)
        )
        later.append(
            ("load in single support", share, curves(forces, middle) / usual, rule.load_share)
        )
        later.append(("pressure beside the ankle", "m", curves(pressures, middle), rule.pressure_m))
    alike = np.zeros(len(crossings), dtype=int)
    turned = np.array([0 if c.onset is None else c.sign for c in crossings])
    before_onset, within = among_sound(
        early, alike, np.ones(len(crossings), dtype=bool), rule.limit
    )
    return before_onset + among_sound(later, turned, within, rule.limit)[0]


def among_sound(
    measures: Sequence[tuple[str, str, Array, float]],
    kinds: NDArray[np.int_],
    sound: Mask,
    limit: float,
) -> tuple[list[Feature], Mask]:
    """Features of n crossings, and which are within the `limit`. Repeated until no further one is
    beyond; at least half stay, because fewer would be a selection. A measure has name, unit, values
    (n,) or curves (n, k), of which the RMS deviations from their medians are the values, and the
    smallest scatter. A crossing is compared with the `sound` (n,) ones of its kind (n,), or with
    all if none is."""

    def medians(values: Array) -> Array:
        found = np.empty_like(values)
        for kind in np.unique(kinds):
            own = kinds == kind
            found[own] = np.median(values[own & sound if (own & sound).any() else own], axis=0)
        return found

    while True:
        found = list[Feature]()
        for name, unit, values, smallest in measures:
            if values.ndim == 2:
                values = np.sqrt(np.mean((values - medians(values)) ** 2, axis=1))
            median = medians(values)
            scatter = 1.4826 * float(np.median(np.abs(values - median)[sound]))
            found.append(Feature(name, unit, values, median, max(scatter, smallest)))
        within = sound & (np.max([feature.distance for feature in found], axis=0) <= limit)
        if within.sum() == sound.sum() or 2 * within.sum() < len(within):
            return found, within
        sound = within


def places(
    crossings: Sequence[Crossing], sheet: Sheet, settings: SelectionSettings
) -> dict[str, dict[str, object]]:
    """Columns of `walking_crossings.csv` of every row of the sheet, by name: the mean gaits that it
    belongs to, and of the used and perturbed `crossings` the group, the direction of the turn, and
    the onset as a share of mean stance."""
    gaits, served = gaits_of(sheet, settings)
    nowhere = dict.fromkeys(("group", "direction", "onset_phase"))
    own_gaits = {name: SEPARATOR.join(own) or None for name, own in served.items()}
    found: dict[str, dict[str, object]] = {
        name: {"gait": gait, **nowhere} for name, gait in own_gaits.items()
    }
    phases = {
        gait: onset_phases([c for c in crossings if gait in served[c.name]]) for gait in gaits
    }
    parts = {
        gait: timings(np.array([*own.values()]), settings.timing_scatter)
        for gait, own in phases.items()
    }
    several = any(part.max(initial=0) > 0 for part in parts.values())
    timed = "timing" in settings.group_by or ("timing" not in settings.pool and several)
    ways = {c.name: c.direction for c in crossings}
    for gait, conditions in gaits.items():
        known = np.array([*phases[gait].values()])
        for (name, phase), part in zip(phases[gait].items(), parts[gait], strict=True):
            named = dict(conditions)
            if timed:
                named["timing"] = f"{100 * np.median(known[parts[gait] == part]):.0f} %"
            if "direction" in settings.group_by:
                named["direction"] = ways[name] or "unknown"
            found[name] |= {"group": label(named), "direction": ways[name], "onset_phase": phase}
    return found


def gaits_of(
    sheet: Sheet, settings: SelectionSettings
) -> tuple[dict[str, Cells], dict[str, list[str]]]:
    """The conditions of each mean gait, by its name, and the gaits that each row of the sheet
    belongs to: an empty cell of an unperturbed one matches every value."""
    keys = split_keys(sheet, settings)
    every = [{key: cells[key] for key in keys} for cells in sheet.values() if cells["perturbed"]]
    gaits: dict[str, Cells] = {label(cells): cells for cells in every}
    return gaits, {
        name: [
            gait
            for gait, wanted in gaits.items()
            if all(cells.get(k) in (None, v) for k, v in wanted.items())
        ]
        for name, cells in sheet.items()
    }


def onset_phases(crossings: Sequence[Crossing]) -> dict[str, float]:
    """Onsets of one gait's perturbed crossings, by name, as shares of the others' mean stance, or
    of their own."""
    flat = [c.stance.duration for c in crossings if c.onset is None]
    usual = float(np.mean(flat)) if flat else None
    onsets = ((c, c.onset) for c in crossings if c.onset is not None)
    return {
        c.name: float((onset - c.stance.heel_strike) / (usual or c.stance.duration))
        for c, onset in onsets
    }


def timings(phases: Array, scatter: float) -> NDArray[np.intp]:
    """The timing (n,) of each onset phase (n,), counted from 0 in the order of phase. Timings are
    separated by clear gaps. One with an SD above `scatter` is cut into equal bins."""
    check_finite("the phase of an onset", phases)
    numbers, count = np.empty(len(phases), dtype=np.intp), 0

    def wide(rows: NDArray[np.intp]) -> bool:
        return len(rows) > 1 and float(np.std(phases[rows], ddof=1)) > scatter

    def parted(order: NDArray[np.intp]) -> list[NDArray[np.intp]]:
        """Parts between the largest gaps above 0.03 of stance. If their SD is that of one timing, a
        gap needs three phases on either side: one timing with an SD of 0.02 has such a gap in about
        one campaign in a hundred."""
        least = 1 if wide(order) else 3
        gaps = np.diff(phases[order])[least - 1 : max(len(order) - least, 0)]
        if not len(gaps) or gaps.max() <= 0.03:
            return [order]
        cut = int(np.argmax(gaps)) + least
        return [*parted(order[:cut]), *parted(order[cut:])]

    for rows in parted(np.argsort(phases, kind="stable")):
        bins = np.zeros(len(rows), dtype=np.intp)
        if wide(rows):
            low, span = phases[rows].min(), np.ptp(phases[rows])
            most = int(np.ceil(span / (2 * scatter)))
            raw = np.minimum(((phases[rows] - low) / span * most).astype(int), most - 1)
            bins = np.unique(raw, return_inverse=True)[1]
        numbers[rows] = count + bins
        count += int(bins.max(initial=-1)) + 1
    return numbers


SEPARATOR = "; "  # Between the names of gaits in one cell; no name has a semicolon


def selection_rows(
    crossings: Sequence[Crossing],
    refused: Sequence[RefusedCrossing],
    settings: SelectionSettings,
    sheet: Sheet,
) -> dict[str, dict[str, object]]:
    """Rows of `walking_crossings.csv` by crossing: its quality, its group and, if it is excluded,
    the reason. Crossings that share all splitting conditions are compared."""
    keys = split_keys(sheet, settings)
    alike = dict[tuple[object, ...], list[Crossing]]()
    for c in crossings:
        alike.setdefault(tuple(sheet[c.name].get(key) for key in keys), []).append(c)
    rows: dict[str, dict[str, object]] = {}
    for some in alike.values():
        features = crossing_features(some, settings, settings.outliers) if settings.outliers else []
        for k, c in enumerate(some):
            rows[c.name] = crossing_row(c, k, features, settings)
    used = [c for c in crossings if rows[c.name]["reason"] is None]
    for r in refused:
        rows[r.name] = {
            "trial": r.name,
            "perturbed": r.perturbed,
            "status": "refused",
            "reason": r.reason,
        }
    found = places(used, sheet, settings)
    return {name: row | found[name] for name, row in rows.items()}


def crossing_row(
    crossing: Crossing, index: int, features: Sequence[Feature], settings: SelectionSettings
) -> dict[str, object]:
    """One row of `walking_crossings.csv`. A crossing is excluded for its load or foot's place, or
    as an outlier."""
    quality = {name: crossing.quality.get(name) for name in QUALITY_COLUMNS}
    values = {f.name: float(f.values[index]) for f in features}
    share, reason, (low, high) = None, None, settings.load_of_weight
    if crossing.load is not None and crossing.body_mass is not None:
        phase = crossing.stance.phase(crossing.time)
        middle = crossing.load[0][(phase >= SINGLE_SUPPORT[0]) & (phase <= SINGLE_SUPPORT[1])]
        share = float(middle.mean() / (crossing.body_mass * np.linalg.norm(FREE_FALL)))
    furthest = max(features, key=lambda f: float(f.distance[index]), default=None)
    outside = quality.pop("foot_outside_m")
    if share is not None and not low <= share <= high:
        reason = (
            f"the plate carries {share:.2f} of the weight of {crossing.body_mass:g} kg in single"
            f" support, expected {low:g} to {high:g}: another foot stands on or beside the plate,"
            " somebody leans on a rail, or the body mass is wrong"
        )
    elif outside is not None and outside > settings.largest_outside_m:
        reason = (
            f"a foot marker lies {100 * outside:.1f} cm outside the plate while the foot is flat,"
            f" expected {100 * settings.largest_outside_m:g} cm or less: the foot stands beside the"
            " plate, or its corners are wrong"
        )
    elif (
        furthest
        and settings.outliers
        and (distance := furthest.distance[index]) > settings.outliers.limit
    ):
        unit, value, median = furthest.unit, furthest.values[index], furthest.median[index]
        reason = (
            f"{furthest.name} {value:.3g} {unit} lies {distance:.1f} scatters of"
            f" {furthest.scatter:.2g} {unit} from the median {median:.3g} {unit}, more than"
            f" {settings.outliers.limit:g}"
        )
        if crossing.bridged >= 0.05:
            remedy = "see that three markers of each cluster stay in sight, or lower longest_gap_s"
            reason += f" (markers were hidden for {crossing.bridged:.0%} of it: {remedy})"
    return {
        "trial": crossing.name,
        "perturbed": crossing.onset is not None,
        "status": "used" if reason is None else "outlier",
        "reason": reason,
        "stance_s": crossing.stance.duration,
        "onset_s": crossing.onset,
        "foot_forward_m": quality.pop("foot_forward_m"),
        "foot_left_m": quality.pop("foot_left_m"),
        "gait_deviation_deg": values.get("angle before the onset"),
        "torque_deviation": values.get("torque before the onset"),
        "load_deviation": values.get("load before the onset"),
        "pressure_deviation_m": values.get("pressure beside the ankle"),
        "load_of_weight": share,
        "foot_outside_m": outside,
        "furthest_scatters": furthest and float(furthest.distance[index]),
        "bridged": crossing.bridged,
        **quality,
    }
