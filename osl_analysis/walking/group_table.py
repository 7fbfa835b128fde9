"""`walking_groups.csv`: under which conditions each group of crossings walked, and its checks."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.trial import Array
from osl_analysis.walking.crossing import DOWN
from osl_analysis.walking.ensemble import GroupHeadline
from osl_analysis.walking.group_checks import (
    FitChecks,
)
from osl_analysis.walking.groups import ALL, SEPARATOR, STATED, Cells, Sheet, cell_listing
from osl_analysis.walking.unperturbed_gait import UnperturbedGait


@dataclass(frozen=True)
class GroupTiming:
    """Numbers of crossings that are used, and phases of stance."""

    n: int
    n_up: int
    n_down: int
    n_unperturbed: int
    stance_s: float | None  # of the unperturbed ones
    unperturbed_stance_sd: float | None  # as a share
    onset_phase: float | None
    onset_phase_sd: float | None
    end_phase: float | None  # of the window


@dataclass(frozen=True)
class GroupConditions:
    """What is known of a group before any fit."""

    group: str
    gait: str
    cells: Mapping[str, object]  # of the sheet, by `STATED`; None where crossings differ
    pooled: str | None  # the columns with several values
    timing: GroupTiming
    left_out_share: float | None  # of perturbed or unperturbed crossings, whichever is more

    def columns(self) -> dict[str, object]:
        stated = {
            "group_stated" if key == "group" else key: value for key, value in self.cells.items()
        }
        return {
            "group": self.group,
            "gait": self.gait,
            **stated,
            "pooled": self.pooled,
            **asdict(self.timing),
            "left_out_share": self.left_out_share,
        }


@dataclass(frozen=True)
class GroupOutcome:
    """A row of `walking_groups.csv`, without what other groups tell."""

    conditions: GroupConditions
    fitted_phase: float | None = None  # of stance, that the fit reads
    reason: str | None = None  # why there is no result
    checks: FitChecks | None = None


def group_conditions(
    selection: pl.DataFrame, sheet: Sheet, gaits: Mapping[str, UnperturbedGait], window: float
) -> list[GroupConditions]:
    """Find the groups, sorted by shared conditions (numbers as numbers), direction and phase.

    A gait without a used perturbed crossing is a group without crossings.

    Parameters
    ----------
    selection : DataFrame
        `walking_crossings.csv`.
    gaits : mapping
        The mean gaits that were computed.
    window : float
        Fitted time after the onset [s].
    """
    perturbed = selection.filter(pl.col("perturbed"))
    in_group = perturbed.drop_nulls("group").partition_by("group", maintain_order=True)
    with_group = {members["gait"][0] for members in in_group}
    no_group = perturbed.filter(~pl.col("gait").is_in(with_group))
    groups = [(members["group"][0], members) for members in in_group]
    for members in no_group.partition_by("gait", maintain_order=True):
        groups.append((members["gait"][0], members))

    keyed = []
    for name, members in groups:
        conditions = conditions_of(name, members, selection, sheet, gaits, window)
        keyed.append((sorting_key(conditions, members), conditions))
    return [conditions for _, conditions in sorted(keyed, key=lambda pair: pair[0])]


def conditions_of(
    name: str,
    members: pl.DataFrame,
    selection: pl.DataFrame,
    sheet: Sheet,
    gaits: Mapping[str, UnperturbedGait],
    window: float,
) -> GroupConditions:
    """The conditions of one group, whose perturbed crossings are `members`."""
    gait = members["gait"][0]
    used = members.drop_nulls("group")
    of_gait = selection.filter(pl.col("gait").str.split(SEPARATOR).list.contains(gait))
    shares = of_gait.group_by("perturbed").agg(pl.col("reason").count() / pl.len())
    rows = [sheet[trial] for trial in members["trial"]]
    stances = gaits[gait].stance if gait in gaits else np.zeros(0)
    return GroupConditions(
        group=name,
        gait=gait,
        cells=shared_cells(rows),
        pooled=pooled_words(rows) if len(used) else None,
        timing=group_timing(used, stances, window),
        left_out_share=shares["reason"].max(),  # type: ignore[arg-type]
    )


def sorting_key(conditions: GroupConditions, members: pl.DataFrame) -> tuple[object, ...]:
    """Cells, of which numbers go first and empty ones last; direction; phase; name."""
    cells = [
        (cell is None, isinstance(cell, str), "" if cell is None else cell)
        for cell in conditions.cells.values()
    ]
    used = members.drop_nulls("group")
    direction = str(used["direction"][0]) if "direction " in conditions.group else ""
    phase = np.inf
    if len(used):
        phase = float(used["onset_phase"].cast(pl.Float64).mean())  # type: ignore[arg-type]
    return (*cells, direction, phase, conditions.group)


def values_of(rows: Sequence[Cells]) -> dict[str, set[object]]:
    """The values of each stated column in rows of the sheet."""
    return {key: {row.get(key) for row in rows} for key in STATED}


def shared_cells(rows: Sequence[Cells]) -> dict[str, object]:
    """The cells in which all rows of the sheet agree; others are None."""
    return {
        key: next(iter(values)) if len(values) == 1 else None
        for key, values in values_of(rows).items()
    }


def pooled_words(rows: Sequence[Cells]) -> str | None:
    """The stated columns in which rows of the sheet have several values."""
    several = [
        f"{key} {cell_listing(values)}"
        for key, values in values_of(rows).items()
        if len(values - {None}) > 1
    ]
    return "; ".join(several) or None


def group_timing(used: pl.DataFrame, stances: Array, window: float) -> GroupTiming:
    """Count the `used` crossings of a group, and find its phases.

    `stances` are the durations [s] of the unperturbed ones, `window` is the fitted time [s].
    """
    phases = used["onset_phase"].cast(pl.Float64).to_numpy()
    down = int((used["direction"] == DOWN).sum())
    stance = float(np.mean(stances)) if len(stances) else None
    onset = float(np.mean(phases)) if len(phases) and stance else None
    stance_sd = None
    if len(stances) > 1:
        stance_sd = float(np.std(stances, ddof=1) / np.mean(stances))
    return GroupTiming(
        n=len(phases),
        n_up=len(phases) - down,
        n_down=down,
        n_unperturbed=len(stances),
        stance_s=stance,
        unperturbed_stance_sd=stance_sd,
        onset_phase=onset,
        onset_phase_sd=float(np.std(phases, ddof=1)) if len(phases) > 1 else None,
        end_phase=onset + window / stance if onset is not None and stance else None,
    )


def fitted_time(headline: GroupHeadline) -> float:
    """Time [s] after the onset at which the fit reads a stiffness that changes linearly.

    The fit's K is a sum of torques with weights w, where w . theta = 1. So it is K(t) at t = sum of
    w theta t, after the middle of the window.
    """
    response = headline.responses[0]
    motion = headline.ensemble.motion[response.window]
    w = np.linalg.pinv(motion.columns)[0]
    return float(w @ (motion.theta * response.time[response.window]))


def series_of(group: str) -> str:
    """The name of a group without its timing."""
    return re.sub(r"timing [-\d]+ %(, )?", "", group).removesuffix(", ") or ALL


def group_rows(outcomes: Sequence[GroupOutcome]) -> list[dict[str, Any]]:
    """Make the rows of `walking_groups.csv`."""
    rows = []
    for outcome in outcomes:
        row = {
            **outcome.conditions.columns(),
            "fitted_phase": outcome.fitted_phase,
            "reason": outcome.reason,
        }
        if outcome.checks is not None:
            row = {**row, **asdict(outcome.checks)}
        rows.append(row)
    return rows
