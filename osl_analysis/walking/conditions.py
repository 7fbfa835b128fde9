"""Conditions of crossings, from the sample sheet: which split the results, and each trial's static trial."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Literal, Self

from pydantic import model_validator

from osl_analysis.errors import InputError, listing
from osl_analysis.yaml_settings import Positive, Settings

PoolKey = Literal["group", "subject", "session", "side", "speed", "K_d", "B_d", "timing"]
GroupKey = PoolKey | Literal["direction"]


class GroupSettings(Settings):
    """Which crossings have a result of their own."""

    group_by: tuple[GroupKey, ...] = ()
    """Conditions by which results are always split. A campaign that differs in another condition is split by it too,
    unless `pool` names it. Opposite directions are joined by half their difference, unless they are named here."""
    pool: tuple[PoolKey, ...] = ()  # Conditions in which crossings of one result may differ
    timing_scatter: Positive = 0.05  # Largest SD of the onset's phase, as a share of stance, of one timing

    @model_validator(mode="after")
    def _split_or_pooled(self) -> Self:
        both = sorted(set(self.group_by) & set(self.pool))
        if both:
            raise ValueError(f"'{both[0]}' stands in group_by and in pool; remove it from one of them")
        return self


STATED = ("group", "subject", "session", "side", "speed", "K_d", "B_d")
"""Columns of the sheet that can split results. Each value has a mean unperturbed gait of its own."""
OF_EVERY_CROSSING = ("subject", "session", "side", "speed")
"""Conditions that an unperturbed crossing has too. In the others, its empty cell means: it serves every value."""
ALL = "all"  # Name of the group and of the gait of a campaign that is not split

PERTURBED = "perturbed"

Cells = Mapping[str, object]  # Cells of one row of the sheet, by column: `STATED` and `PERTURBED`; None where empty
Sheet = Mapping[str, Cells]  # Cells of crossings, by trial


def split_keys(sheet: Sheet, settings: GroupSettings) -> list[str]:
    """Columns of the sheet by which a campaign is split, in the order of `STATED`: those that `group_by` names, and any
    other in which crossings differ and that `pool` does not name. Refused if such a column is empty in a crossing, or
    everywhere."""
    keys = []
    for key in STATED:
        concerned = [name for name, cells in sheet.items() if key in OF_EVERY_CROSSING or cells[PERTURBED]]
        values = {sheet[name].get(key) for name in concerned}
        stated = values - {None}
        if key in settings.pool or (len(values) < 2 and key not in settings.group_by):
            continue
        if not stated:
            raise InputError(
                f"walking.group_by names '{key}', but no crossing states it; fill in the column {key} of the sheet, or "
                "remove it from group_by"
            )
        empty = [name for name in concerned if sheet[name].get(key) is None]
        if empty:
            raise InputError(
                f"trial {empty[0]}: no {key} in the sheet, but other crossings state {written(stated)}; fill in the "
                f"cell, or add {key} to walking.pool"
            )
        keys.append(key)
    return keys


def written(values: Collection[object]) -> str:
    """Values in order, for a message."""
    numbers = sorted(value for value in values if isinstance(value, int | float))
    words = sorted(str(value) for value in values if not isinstance(value, int | float))
    return ", ".join([*map(shown, numbers), *words])


def shown(value: object) -> str:
    """One cell as text, a number without trailing zeros."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def label(parts: Mapping[str, object]) -> str:
    """Name of a group or gait from its conditions, such as `K_d 200, timing 41 %`; `ALL` without any."""
    named = (shown(value) if key == "group" else f"{key} {shown(value)}" for key, value in parts.items())
    return ", ".join(named) or ALL


def gaits_served(cells: Cells, gaits: Mapping[str, Cells], keys: Sequence[str]) -> list[str]:
    """Names of the `gaits` (name to cells) to which an unperturbed crossing belongs; an empty cell matches every
    value."""
    return [
        name
        for name, wanted in gaits.items()
        if all(cells.get(key) is None or cells.get(key) == wanted[key] for key in keys)
    ]


def statements(sheet: Sheet, settings: GroupSettings) -> list[str]:
    """One sentence per condition that splits results although the configuration does not ask for it."""
    return [
        f"crossings differ in {key} ({written({sheet[name].get(key) for name in sheet} - {None})}): each value has a "
        f"result of its own; write {key} under walking.group_by to keep that, or under walking.pool for one result"
        for key in split_keys(sheet, settings)
        if key not in settings.group_by
    ]


def pooled(names: Iterable[str], sheet: Sheet) -> str:
    """Conditions in which the crossings of one group differ, as text; empty if in none."""
    members = list(names)
    values = {key: {sheet[name].get(key) for name in members} for key in STATED}
    return "; ".join(f"{key} {written(v - {None})}" for key, v in values.items() if len(v - {None}) > 1)


SHARED = ("subject", "session", "side")
"""Conditions that a trial shares with its static trial. An empty cell matches every value."""
STATIC = "static"  # Column of the sheet that names the static trial of a trial


def static_of(trial: str, cells: Cells, statics: Mapping[str, Cells]) -> str:
    """Name of the static trial of a trial whose row is `cells`; `statics` are the rows of the static trials by name.
    The row's column `static` decides; without it, of the static trials that contradict no stated subject, session or
    side the one that agrees in the most. The only candidate of a sheet is taken even if nothing is stated."""
    named = cells.get(STATIC)
    if named is not None:
        if named not in statics:
            raise InputError(
                f"trial '{trial}', static: '{named}' is no trial of experiment 'static' that is used; the sheet has "
                f"{listing(list(statics))}"
            )
        return str(named)
    stated = {key: cells[key] for key in SHARED if cells.get(key) is not None}
    agreement = {}
    for name, other in statics.items():
        both = [(value, other[key]) for key, value in stated.items() if other.get(key) is not None]
        if all(a == b for a, b in both):
            agreement[name] = len(both)
    best = [name for name, count in agreement.items() if count == max(agreement.values())]
    if len(best) == 1:
        return best[0]
    said = ", ".join(f"{key} {shown(value)}" for key, value in stated.items())
    whose = f" ({said})" if said else ", which states no subject, session or side"
    if not best:
        raise InputError(
            f"trial '{trial}'{whose}: no static trial of the same conditions, the sheet has {listing(list(statics))}; "
            "record one, or name one in the column static"
        )
    raise InputError(
        f"trial '{trial}'{whose}: {len(best)} static trials could be its own ({listing(best)}); name one in the column "
        "static, or state subject, session or side of all of them"
    )


def side_of(static: str, cells: Cells, served: Mapping[str, Cells], otherwise: str) -> str:
    """Side of the leg that a static trial calibrates: of its own row, else of the trials that it serves, else
    `otherwise`."""
    sides = {row["side"]: name for name, row in served.items() if row.get("side") is not None}
    own = cells.get("side")
    wrong = [(side, name) for side, name in sides.items() if own is not None and side != own]
    if len(sides) > 1 or wrong:
        side, name = wrong[0] if wrong else list(sides.items())[1]
        raise InputError(
            f"static trial '{static}' serves trials of the sides {written({*sides, own} - {None})} (trial '{name}': "
            f"{side}); record a static trial for each side and state its side"
        )
    return str(own or next(iter(sides), otherwise))
