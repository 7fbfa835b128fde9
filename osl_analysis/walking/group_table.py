"""One row per group of crossings: who belongs to it, under which conditions, at which phase of stance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from osl_analysis.walking.conditions import ALL, STATED, Cells, Sheet, pooled
from osl_analysis.walking.direction import DOWN
from osl_analysis.walking.ensemble import EnsembleResponse
from osl_analysis.walking.response import window_samples
from osl_analysis.walking.settings import Timing
from osl_analysis.walking.unperturbed import UnperturbedGait


@dataclass(frozen=True)
class Group:
    """A group of perturbed crossings.

    name: its name.
    gait: name of its mean unperturbed gait.
    trials: its crossings that are used.
    directions: turn of each, `up`, `down` or None.
    phases: onset of each as a share of the gait's mean stance.
    cells: conditions in the sheet that all its crossings share.
    pooled: conditions in which they differ, as text.
    """

    name: str
    gait: str
    trials: tuple[str, ...]
    directions: tuple[str | None, ...]
    phases: tuple[float, ...]
    cells: Cells
    pooled: str


def groups_of(selection: pl.DataFrame, sheet: Sheet | None) -> list[Group]:
    """Groups of `walking_crossings.csv` in the order of their conditions, then of their timing.

    A gait none of whose perturbed crossings is used is a group without trials.
    """
    perturbed, sheet = selection.filter(pl.col("perturbed")), sheet or {}
    rows = {trial: sheet.get(trial, {}) for trial in perturbed["trial"]}
    used = perturbed.filter(pl.col("group").is_not_null())
    found = [group_of(members, rows) for members in used.partition_by("group", maintain_order=True)]
    missing = [gait for gait in perturbed["gait"].unique(maintain_order=True) if gait not in {g.gait for g in found}]
    for gait in missing:
        cells = shared_cells([rows[trial] for trial in perturbed.filter(pl.col("gait") == gait)["trial"]])
        found.append(Group(gait or ALL, gait or ALL, (), (), (), cells, ""))
    return sorted(found, key=sorting_key)


def group_of(members: pl.DataFrame, rows: Sheet) -> Group:
    """The group whose rows of `walking_crossings.csv` are `members`; `rows` are the sheet's."""
    trials = tuple(members["trial"])
    cells = shared_cells([rows[trial] for trial in trials])
    directions, phases = tuple(members["direction"]), tuple(members["onset_phase"])
    return Group(members["group"][0], members["gait"][0], trials, directions, phases, cells, pooled(trials, rows))


def shared_cells(rows: Sequence[Cells]) -> dict[str, object]:
    """The stated conditions that are the same in all rows; None where they differ."""
    values = {key: {row.get(key) for row in rows} for key in STATED}
    return {key: value.pop() if len(value) == 1 else None for key, value in values.items()}


def sorting_key(group: Group) -> tuple[object, ...]:
    """By conditions, numbers as numbers, then by direction where groups have one each, then by phase."""
    cells = [group.cells[key] for key in STATED]
    parts = [(value is None, isinstance(value, str), "" if value is None else value) for value in cells]
    turned = str(group.directions[0]) if "direction " in group.name else ""
    return (*parts, turned, float(np.mean(group.phases)) if group.phases else np.inf, group.name)


def group_row(group: Group, gait: UnperturbedGait | None, window: float) -> dict[str, object]:
    """Row of `walking_groups.csv`: conditions, numbers of crossings, phases of onset and end of the `window` [s].

    Phases are shares of the mean stance of the unperturbed gait; without one, they are null.
    """
    phases, down = np.array(group.phases, dtype=float), sum(d == DOWN for d in group.directions)
    stance = None if gait is None else float(np.mean(gait.stance))
    onset = float(np.mean(phases)) if len(phases) and stance else None
    return {
        "group": group.name,
        "gait": group.gait,
        **{("group_stated" if key == "group" else key): value for key, value in group.cells.items()},
        "pooled": group.pooled or None,
        "n": len(phases),
        "n_up": len(phases) - down,
        "n_down": down,
        "n_unperturbed": 0 if gait is None else len(gait.names),
        "stance_s": stance,
        "unperturbed_stance_sd": None if gait is None else stance_scatter(gait),
        "onset_phase": onset,
        "onset_phase_sd": float(np.std(phases, ddof=1)) if len(phases) > 1 else None,
        "end_phase": onset + window / stance if onset is not None and stance else None,
    }


def stance_scatter(gait: UnperturbedGait) -> float | None:
    """SD of the stances of the unperturbed crossings, as a share of their mean; None of a single one."""
    return float(np.std(gait.stance, ddof=1) / np.mean(gait.stance)) if len(gait.stance) > 1 else None


def fitted_time(ensemble: EnsembleResponse, timing: Timing) -> float:
    """Time [s] after the onset at which the fit reads a stiffness that changes linearly within the window.

    The fit's K is a sum of the torques with weights w, and w . theta = 1. With K(t) = K_0 + K_1 t it is K(t) at
    t = sum of w theta t. As the angle grows in the window, this is later than its middle.
    """
    rows, motion = window_samples(ensemble.time, timing), ensemble.motion
    columns = np.column_stack([motion.theta, motion.omega, motion.alpha])[rows]
    return float(np.linalg.pinv(columns)[0] @ (motion.theta[rows] * ensemble.time[rows]))


def commanded(cells: Mapping[str, object], quantity: str) -> object:
    """K_d or B_d of a group, for the quantity K or B; None if it is not stated, and for other quantities."""
    return cells.get(f"{quantity}_d")
