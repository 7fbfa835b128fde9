"""Conditions of crossings, as the sample sheet states them: which of them split the results, and names for them."""

from collections.abc import Collection, Iterable, Mapping, Sequence

from osl_analysis.errors import InputError
from osl_analysis.walking.group_settings import GroupSettings

STATED = ("group", "subject", "session", "side", "speed", "K_d", "B_d")
"""Columns of the sheet that can split results. Each value has a mean unperturbed gait of its own."""
OF_EVERY_CROSSING = ("subject", "session", "side", "speed")
"""Conditions that an unperturbed crossing has too. In the others, its empty cell means: it serves every value."""
ALL = "all"
"""Name of the group and of the gait of a campaign that is not split."""

PERTURBED = "perturbed"

Cells = Mapping[str, object]
"""Cells of one row of the sheet, by column: `STATED` and `PERTURBED`; None where empty."""
Sheet = Mapping[str, Cells]
"""Cells of crossings, by trial."""


def split_keys(sheet: Sheet, settings: GroupSettings) -> list[str]:
    """Columns of the sheet by which a campaign is split, in the order of `STATED`.

    A column that `group_by` names splits; one that `pool` names does not. Any other one splits if crossings differ.

    Raises
    ------
    InputError
        A column that splits is empty in a crossing, or everywhere.
    """
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


def gait_of(cells: Cells, keys: Sequence[str]) -> str:
    """Name of the gait of a crossing whose cells are all filled in."""
    return label({key: cells[key] for key in keys})


def gaits_served(cells: Cells, gaits: Mapping[str, Cells], keys: Sequence[str]) -> list[str]:
    """Names of the `gaits` (name to cells) to whose mean an unperturbed crossing belongs.

    An empty cell matches every value.
    """
    return [
        name
        for name, wanted in gaits.items()
        if all(cells.get(key) is None or cells.get(key) == wanted[key] for key in keys)
    ]


def gaits_of(sheet: Sheet, keys: Sequence[str]) -> dict[str, Cells]:
    """The conditions of each gait, by its name: one for each combination among perturbed crossings."""
    return {gait_of(cells, keys): {key: cells[key] for key in keys} for cells in sheet.values() if cells[PERTURBED]}


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
