"""To which result each crossing belongs: conditions of the sheet, mean gaits, and timings.

Each group of perturbed crossings has a result of its own, and each gait a mean of its own. Groups
of one gait differ only in the timing or the direction of the perturbation.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, listing
from osl_analysis.measured import check_finite
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.walking_settings import SelectionSettings

# Columns of the sheet that can split results. Each value has a mean unperturbed gait of its own.
STATED = ("group", "subject", "session", "side", "speed", "K_d", "B_d")
OF_PERSON = ("subject", "session", "side", "speed")  # those that an unperturbed crossing has too
OF_STATIC = ("subject", "session", "side")  # those in which a crossing agrees with a static trial
ALL = "all"  # name of the group and of the gait of a campaign that is not split
SEPARATOR = "; "  # between the names of gaits in one cell; no name has a semicolon

# Timings are parted by gaps above this share of stance. If their SD is that of one timing, a gap
# needs three phases on either side: one timing with an SD of 0.02 has such a gap in about one
# campaign in a hundred.
SMALLEST_TIMING_GAP = 0.03
FEWEST_BESIDE_GAP = 3

Cells = Mapping[str, object]
"""Cells of one row of the sheet, by column: `STATED` and `perturbed`; None where empty."""
Sheet = Mapping[str, Cells]
"""Cells of crossings, by trial."""


def split_keys(sheet: Sheet, settings: SelectionSettings) -> list[str]:
    """Find the columns of the sheet that split a campaign, in the order of `STATED`.

    They are those of `group_by`, and any other in which crossings differ, unless `pool` names it.

    Raises
    ------
    InputError
        Such a column is empty in a crossing, or everywhere.
    """
    keys = []
    for key in STATED:
        # An unperturbed crossing has a person and a pace too. In the others, its empty cell serves
        # every value.
        concerned = [
            name for name, cells in sheet.items() if key in OF_PERSON or cells["perturbed"]
        ]
        values = {sheet[name].get(key) for name in concerned}
        if key in settings.pool or (len(values) < 2 and key not in settings.group_by):
            continue
        stated = values - {None}
        if not stated:
            raise InputError(
                f"walking.group_by names '{key}', but no crossing states it; fill in the column"
                f" {key} of the sheet, or remove it from group_by"
            )
        empty = [name for name in concerned if sheet[name].get(key) is None]
        if empty:
            raise InputError(
                f"trial {empty[0]}: no {key} in the sheet, but other crossings state"
                f" {cell_listing(stated)}; fill in the cell, or add {key} to walking.pool"
            )
        keys.append(key)
    return keys


def cell_listing(values: Collection[object]) -> str:
    """Values in order, for a message; without None."""
    numbers = sorted(value for value in values if isinstance(value, int | float))
    words = sorted(value for value in values if isinstance(value, str))
    return ", ".join([*map(cell_text, numbers), *words])


def cell_text(value: object) -> str:
    """One cell as text, a number without trailing zeros."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def label(conditions: Mapping[str, object]) -> str:
    """Name of a group or gait, such as `K_d 200, timing 41 %`; `ALL` without any condition."""
    words = [
        cell_text(value) if key == "group" else f"{key} {cell_text(value)}"
        for key, value in conditions.items()
    ]
    return ", ".join(words) or ALL


def static_of(trial: str, cells: Cells, statics: Mapping[str, Cells]) -> str:
    """Find the static trial that calibrates a trial.

    It is the one in its column `static`; else, of those that contradict no stated subject, session
    or side, the one that agrees in most of them.

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
                f" used; the sheet has {listing(list(statics))}"
            )
        return str(named)

    stated = {key: cells[key] for key in OF_STATIC if cells.get(key) is not None}
    agreement = {}
    for name, static in statics.items():
        compared = [key for key in stated if static.get(key) is not None]
        if all(stated[key] == static[key] for key in compared):
            agreement[name] = len(compared)
    best = [name for name, count in agreement.items() if count == max(agreement.values())]
    if len(best) == 1:
        return best[0]

    if stated:
        conditions = ", ".join(f"{key} {cell_text(value)}" for key, value in stated.items())
        subject = f"trial '{trial}' ({conditions})"
    else:
        subject = f"trial '{trial}', which states no subject, session or side"
    if not best:
        raise InputError(
            f"{subject}: no static trial of the same conditions, the sheet has"
            f" {listing(list(statics))}; record one, or name one in the column static"
        )
    raise InputError(
        f"{subject}: {len(best)} static trials could be its own ({listing(best)}); name one in the"
        " column static, or state subject, session or side of all of them"
    )


def side_of(static: str, cells: Cells, served: Mapping[str, Cells], configured: str) -> str:
    """Find the side of the leg that a static trial calibrates.

    It is that of its row, else of the trials that it serves, else the configured one.

    Raises
    ------
    InputError
        They contradict each other.
    """
    trial_of_side = {
        row["side"]: name for name, row in served.items() if row.get("side") is not None
    }
    static_side = cells.get("side")
    contradicting = [
        (side, name)
        for side, name in trial_of_side.items()
        if static_side is not None and side != static_side
    ]
    if len(trial_of_side) > 1 or contradicting:
        side, name = contradicting[0] if contradicting else list(trial_of_side.items())[1]
        sides = cell_listing({*trial_of_side, static_side})
        raise InputError(
            f"static trial '{static}' serves trials of the sides {sides} (trial '{name}': {side});"
            " record a static trial for each side and state its side"
        )
    return str(static_side or next(iter(trial_of_side), configured))


@dataclass(frozen=True)
class Place:
    """Columns of `walking_crossings.csv` that say to which result a crossing belongs."""

    gait: str | None  # the mean gaits that it belongs to
    # None unless it is used and perturbed
    group: str | None = None
    direction: str | None = None  # of the turn
    onset_phase: float | None = None  # as a share of mean stance

    def columns(self) -> dict[str, object]:
        return {
            "gait": self.gait,
            "group": self.group,
            "direction": self.direction,
            "onset_phase": self.onset_phase,
        }


def places(
    crossings: Sequence[Crossing], sheet: Sheet, settings: SelectionSettings
) -> dict[str, Place]:
    """Find the place of every row of the sheet, by name; `crossings` are those that are used."""
    gaits = gait_conditions(sheet, settings)
    gaits_of_trials = {name: gaits_of(cells, gaits) for name, cells in sheet.items()}
    phases = {
        gait: onset_phases([c for c in crossings if gait in gaits_of_trials[c.name]])
        for gait in gaits
    }
    timing_numbers = {
        gait: timings(np.array(list(of_gait.values())), settings.timing_scatter)
        for gait, of_gait in phases.items()
    }
    has_timings = any(numbers.max(initial=0) > 0 for numbers in timing_numbers.values())
    by_timing = "timing" in settings.group_by or ("timing" not in settings.pool and has_timings)
    directions = {crossing.name: crossing.direction for crossing in crossings}

    place_of = {
        name: Place(gait=SEPARATOR.join(of_trial) or None)
        for name, of_trial in gaits_of_trials.items()
    }
    for gait, conditions in gaits.items():
        values = np.array(list(phases[gait].values()))
        numbers = timing_numbers[gait]
        for (name, phase), number in zip(phases[gait].items(), numbers, strict=True):
            named = dict(conditions)
            if by_timing:
                named["timing"] = f"{100 * np.median(values[numbers == number]):.0f} %"
            if "direction" in settings.group_by:
                named["direction"] = directions[name] or "unknown"
            place_of[name] = Place(place_of[name].gait, label(named), directions[name], phase)
    return place_of


def gait_conditions(sheet: Sheet, settings: SelectionSettings) -> dict[str, Cells]:
    """The conditions of each mean gait, by its name."""
    keys = split_keys(sheet, settings)
    perturbed = [cells for cells in sheet.values() if cells["perturbed"]]
    conditions = [{key: cells[key] for key in keys} for cells in perturbed]
    return {label(cells): cells for cells in conditions}


def gaits_of(cells: Cells, gaits: Mapping[str, Cells]) -> list[str]:
    """The gaits that a row of the sheet belongs to: an empty cell matches every value."""
    return [
        gait
        for gait, conditions in gaits.items()
        if all(cells.get(key) in (None, value) for key, value in conditions.items())
    ]


def onset_phases(crossings: Sequence[Crossing]) -> dict[str, float]:
    """Onsets of one gait's perturbed crossings, as shares of the unperturbed ones' mean stance.

    Without unperturbed ones they are shares of their own.
    """
    unperturbed = [crossing.stance.duration for crossing in crossings if crossing.onset is None]
    mean_stance = float(np.mean(unperturbed)) if unperturbed else None
    phases = {}
    for crossing in crossings:
        if crossing.onset is not None:
            since_strike = crossing.onset - crossing.stance.heel_strike
            phases[crossing.name] = float(since_strike / (mean_stance or crossing.stance.duration))
    return phases


def timings(phases: Array, scatter: float) -> NDArray[np.intp]:
    """Part onset phases (n,) into timings.

    Timings are separated by clear gaps. One with an SD above `scatter` is cut into equal bins.

    Returns
    -------
    Array
        The timing (n,) of each, counted from 0 in the order of phase.
    """
    check_finite("the phase of an onset", phases)
    numbers = np.empty(len(phases), dtype=np.intp)
    count = 0
    for rows in parted_by_gaps(phases, np.argsort(phases, kind="stable"), scatter):
        bins = np.zeros(len(rows), dtype=np.intp)
        if is_wide(phases[rows], scatter):
            lowest, span = phases[rows].min(), np.ptp(phases[rows])
            bin_count = int(np.ceil(span / (2 * scatter)))
            equal = ((phases[rows] - lowest) / span * bin_count).astype(int)
            # bins without an onset are not counted
            bins = np.unique(np.minimum(equal, bin_count - 1), return_inverse=True)[1]
        numbers[rows] = count + bins
        count += int(bins.max(initial=-1)) + 1
    return numbers


def is_wide(phases: Array, scatter: float) -> bool:
    return len(phases) > 1 and float(np.std(phases, ddof=1)) > scatter


def parted_by_gaps(
    phases: Array, order: NDArray[np.intp], scatter: float
) -> list[NDArray[np.intp]]:
    """Part rows in the `order` of phase at the largest gaps."""
    fewest = 1 if is_wide(phases[order], scatter) else FEWEST_BESIDE_GAP
    gaps = np.diff(phases[order])[fewest - 1 : max(len(order) - fewest, 0)]
    if not len(gaps) or gaps.max() <= SMALLEST_TIMING_GAP:
        return [order]
    cut = int(np.argmax(gaps)) + fewest
    before, after = order[:cut], order[cut:]
    return [*parted_by_gaps(phases, before, scatter), *parted_by_gaps(phases, after, scatter)]
