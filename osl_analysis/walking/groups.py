"""To which result each crossing belongs, by the conditions of the sheet.

Each group of perturbed crossings has a result and a mean unperturbed gait of its own.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from osl_analysis.errors import InputError, listing
from osl_analysis.walking.crossing import DOWN, UP, Crossing

# Columns of the sheet that part crossings into groups
STATED = ("group", "subject", "session", "side", "speed", "K_d", "B_d", "direction")
OF_PERSON = ("subject", "session", "side", "speed")  # those that an unperturbed crossing has too
OF_STATIC = ("subject", "session", "side")  # those in which a crossing agrees with a static trial
ALL = "all"  # name of the group of a campaign that is not split
SEPARATOR = "; "  # between the names of groups in one cell; no name has a semicolon

Cells = Mapping[str, object]
"""Cells of one row of the sheet, by column: `STATED` and `perturbed`; None where empty."""
Sheet = Mapping[str, Cells]
"""Cells of crossings, by trial."""


def split_keys(sheet: Sheet) -> list[str]:
    """Find the columns of the sheet in which crossings differ, in the order of `STATED`.

    Raises
    ------
    InputError
        Such a column is empty in a crossing.
    """
    keys = []
    for key in STATED:
        # An unperturbed crossing has a person and a pace too. In the others, its empty cell serves
        # every value.
        concerned = [
            name for name, cells in sheet.items() if key in OF_PERSON or cells["perturbed"]
        ]
        values = {sheet[name].get(key) for name in concerned}
        if len(values) < 2:
            continue
        empty = [name for name in concerned if sheet[name].get(key) is None]
        if empty:
            raise InputError(
                f"trial {empty[0]}: no {key} in the sheet, but other crossings state"
                f" {cell_listing(values - {None})}; fill in the cell, or empty the column"
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
    """Name of a group, such as `K_d 200, direction up`; `ALL` without any condition."""
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

    group: str | None  # an unperturbed crossing serves several
    # None unless it is used and perturbed
    direction: str | None = None  # of the turn
    onset_phase: float | None = None  # as a share of mean stance

    def columns(self) -> dict[str, object]:
        return {
            "group": self.group,
            "direction": self.direction,
            "onset_phase": self.onset_phase,
        }


def places(crossings: Sequence[Crossing], sheet: Sheet) -> dict[str, Place]:
    """Find the place of every row of the sheet, by name; `crossings` are those that are used.

    A group whose turns go both ways is two groups, by the measured direction.
    """
    direction_of = {crossing.name: crossing.direction for crossing in crossings}
    names_of: dict[str, list[str]] = {name: [] for name in sheet}
    for group, conditions in group_conditions(sheet).items():
        members = [name for name, cells in sheet.items() if is_of_group(cells, conditions)]
        turned = {direction_of.get(name) for name in members} - {None}
        for name in members:
            own = direction_of.get(name)
            if len(turned) < 2:
                names_of[name].append(group)
            elif own is not None:
                names_of[name].append(with_direction(group, own))
            else:
                names_of[name] += [with_direction(group, each) for each in (DOWN, UP)]

    place_of = {name: Place(SEPARATOR.join(names) or None) for name, names in names_of.items()}
    for group in dict.fromkeys(chain.from_iterable(names_of.values())):
        of_group = [c for c in crossings if group in names_of[c.name]]
        for name, phase in onset_phases(of_group).items():
            place_of[name] = Place(group, direction_of[name], phase)
    return place_of


def with_direction(group: str, direction: str) -> str:
    """Name of the part of a group whose turns have a direction."""
    part = f"direction {direction}"
    return part if group == ALL else f"{group}, {part}"


def groups_of_selection(cells: Collection[str | None], sheet: Sheet) -> list[str]:
    """The groups in the cells of perturbed crossings, in the order of their conditions."""
    present = {name for cell in cells for name in (cell or "").split(SEPARATOR)}
    names = []
    for group in group_conditions(sheet):
        names += [group, *(with_direction(group, each) for each in (DOWN, UP))]
    return [name for name in names if name in present]


def group_conditions(sheet: Sheet) -> dict[str, Cells]:
    """The conditions of each group, by its name, sorted by them."""
    keys = split_keys(sheet)
    perturbed = [cells for cells in sheet.values() if cells["perturbed"]]
    conditions = [{key: cells[key] for key in keys} for cells in perturbed]
    return {label(cells): cells for cells in sorted(conditions, key=sorting_key)}


def sorting_key(conditions: Cells) -> list[tuple[bool, object]]:
    """Conditions, of which numbers go before words."""
    return [(isinstance(cell, str), cell) for cell in conditions.values()]


def is_of_group(cells: Cells, conditions: Cells) -> bool:
    """Whether a row of the sheet belongs to a group: an empty cell matches every value."""
    return all(cells.get(key) in (None, value) for key, value in conditions.items())


def onset_phases(crossings: Sequence[Crossing]) -> dict[str, float]:
    """Onsets of one group's perturbed crossings, as shares of the unperturbed ones' mean stance.

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
