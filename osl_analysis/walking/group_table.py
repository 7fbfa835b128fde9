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
    GroupChecks,
    MomentError,
    SetUpDifference,
    WitnessChecks,
    moment_error,
    set_up_difference,
)
from osl_analysis.walking.groups import ALL, SEPARATOR, STATED, Cells, Sheet, cell_listing
from osl_analysis.walking.unperturbed_gait import UnperturbedGait

SMALLEST_DIFFERENCES = {
    "stance_s": 0.01,
    "load_of_weight": 0.03,
    "foot_forward_m": 0.01,
    "foot_left_m": 0.01,
    "gait_deviation_deg": 0.5,
    "torque_deviation": 2.0,
}
"""Columns of `walking_crossings.csv` that may separate used from left-out crossings, with the least
difference."""
FEWEST_TO_PART = 3  # crossings on each side
PARTED_SHARE = 0.9  # of each, on its side of the middle
CERTAIN_SLOPE_SES = 2.0  # standard errors beyond which a slope of K is certain


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
    moments: MomentError
    set_up: SetUpDifference
    left_out_share: float | None  # of perturbed or unperturbed crossings, whichever is more
    left_out_by: str | None  # what parts them from the used ones

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
            **asdict(self.moments),
            **asdict(self.set_up),
            "left_out_share": self.left_out_share,
            "left_out_by": self.left_out_by,
        }


@dataclass(frozen=True)
class GroupOutcome:
    """A row of `walking_groups.csv`, without what other groups tell."""

    conditions: GroupConditions
    fitted_phase: float | None = None  # of stance, that the fit reads
    reason: str | None = None  # why there is no result
    checks: GroupChecks | None = None
    witnesses: WitnessChecks | None = None


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
    is_used = pl.col("reason").is_null()
    left_out = of_gait.filter(~is_used)
    shares = of_gait.group_by("perturbed").agg(pl.col("reason").count() / pl.len())
    rows = [sheet[trial] for trial in members["trial"]]
    stances = gaits[gait].stance if gait in gaits else np.zeros(0)
    return GroupConditions(
        group=name,
        gait=gait,
        cells=shared_cells(rows),
        pooled=pooled_words(rows) if len(used) else None,
        timing=group_timing(used, stances, window),
        moments=moment_error(of_gait),
        set_up=set_up_difference(of_gait),
        left_out_share=shares["reason"].max(),  # type: ignore[arg-type]
        left_out_by=parted_by(of_gait.filter(is_used), left_out, sheet) if len(left_out) else None,
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


def parted_by(used: pl.DataFrame, left_out: pl.DataFrame, sheet: Sheet) -> str:
    """Say what parts the crossings that are left out from the used ones.

    It is a column of the sheet, or the first of `SMALLEST_DIFFERENCES` in which nine tenths of each
    lie on their side of the middle of both medians.
    """
    for key in STATED:
        used_values = {sheet[trial].get(key) for trial in used["trial"]}
        left_values = {sheet[trial].get(key) for trial in left_out["trial"]}
        if used_values and left_values and not used_values & left_values:
            return f"{key}, {cell_listing(used_values)} and {cell_listing(left_values)}"
    for column, smallest in SMALLEST_DIFFERENCES.items():
        of_used = used[column].drop_nulls().cast(pl.Float64).to_numpy()
        of_left = left_out[column].drop_nulls().cast(pl.Float64).to_numpy()
        if min(len(of_used), len(of_left)) < FEWEST_TO_PART:
            continue
        used_median, left_median = float(np.median(of_used)), float(np.median(of_left))
        middle = (used_median + left_median) / 2
        direction = np.sign(left_median - used_median)
        used_share = np.mean(direction * (middle - of_used) > 0)
        left_share = np.mean(direction * (of_left - middle) > 0)
        is_parted = min(used_share, left_share) >= PARTED_SHARE
        if abs(left_median - used_median) > smallest and is_parted:
            return f"{column}, {used_median:.3g} and {left_median:.3g}"
    return "no column"


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


@dataclass(frozen=True)
class TimingPoint:
    """K and B of one group at the phase that its fit reads."""

    series: str  # of groups that differ in their timing only
    phase: float
    K: float
    K_se: float
    B: float
    B_per_slope: float  # what a slope of K over stance makes of B


@dataclass(frozen=True)
class TimingSlope:
    """The slope of K over stance between timings, and the share of B that it makes."""

    K_slope_timings: float | None = None
    slope_share_timings: float | None = None  # None where the slope is not certain
    B_without_slope: float | None = None


def timing_slope(point: TimingPoint, points: Sequence[TimingPoint]) -> TimingSlope:
    """Compute the slope of K between the neighbours of a point in its series."""
    in_series = [candidate for candidate in points if candidate.series == point.series]
    series = sorted(in_series, key=lambda candidate: candidate.phase)
    index = series.index(point)
    before, after = series[max(index - 1, 0)], series[min(index + 1, len(series) - 1)]
    span = after.phase - before.phase
    if not span > 0:
        return TimingSlope()
    slope = (after.K - before.K) / span
    se = np.hypot(before.K_se, after.K_se) / max(span, 1e-9)
    if abs(slope) <= CERTAIN_SLOPE_SES * se or not point.B:
        return TimingSlope(slope)
    share = slope * point.B_per_slope / point.B
    # a share of exactly 0 leaves nothing to take off
    return TimingSlope(slope, share, point.B * (1 - share) if share else share)


def timing_point(outcome: GroupOutcome) -> TimingPoint | None:
    """The point of a group; None without a result."""
    if outcome.checks is None or outcome.fitted_phase is None:
        return None
    fit = outcome.checks.fit
    return TimingPoint(
        series_of(outcome.conditions.group),
        outcome.fitted_phase,
        K=fit.K,
        K_se=fit.K * (fit.K_se_share or 0.0),
        B=fit.B,
        B_per_slope=outcome.checks.slope.B_per_slope,
    )


def group_rows(outcomes: Sequence[GroupOutcome]) -> list[dict[str, Any]]:
    """Make the rows of `walking_groups.csv`."""
    points = [timing_point(outcome) for outcome in outcomes]
    known_points = [point for point in points if point is not None]
    rows = []
    for outcome, point in zip(outcomes, points, strict=True):
        row = {
            **outcome.conditions.columns(),
            "fitted_phase": outcome.fitted_phase,
            "reason": outcome.reason,
        }
        if outcome.checks is not None and outcome.witnesses is not None and point is not None:
            slope = timing_slope(point, known_points)
            row = {
                **row,
                **outcome.checks.columns(),
                **asdict(outcome.witnesses),
                **asdict(slope),
            }
        rows.append(row)
    return rows
