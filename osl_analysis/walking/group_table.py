"""`walking_groups.csv`: what is known of each group of crossings, and the checks of its result."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.trial import Array
from osl_analysis.walking.ensemble import GroupHeadline
from osl_analysis.walking.group_checks import FitChecks
from osl_analysis.walking.groups import SEPARATOR
from osl_analysis.walking.plate_model import PlateModel
from osl_analysis.walking.unperturbed_gait import UnperturbedGait


@dataclass(frozen=True)
class GroupConditions:
    """What is known of a group before any fit; None where it is not."""

    group: str
    n: int  # number of perturbed crossings that are used
    n_unperturbed: int
    stance_s: float | None  # of the unperturbed ones
    unperturbed_stance_sd: float | None  # as a share
    onset_phase: float | None
    onset_phase_sd: float | None
    left_out_share: float | None  # of perturbed or unperturbed crossings, whichever is more
    # What stands most otherwise in the crossings than in the static trial, and by how much
    different: str | None
    different_mm: float | None
    pressure_outside_m: float | None  # mean of the perturbed crossings
    plate_height_m: float | None
    plate_lag_sd_s: float | None


@dataclass(frozen=True)
class GroupOutcome:
    """A row of `walking_groups.csv`."""

    conditions: GroupConditions
    fitted_phase: float | None = None  # of stance, that the fit reads
    reason: str | None = None  # why there is no result
    checks: FitChecks | None = None

    def row(self) -> dict[str, Any]:
        checks = {} if self.checks is None else asdict(self.checks)
        return {
            **asdict(self.conditions),
            "fitted_phase": self.fitted_phase,
            **checks,
            "reason": self.reason,
        }


def conditions_of(
    group: str,
    selection: pl.DataFrame,
    gait: UnperturbedGait | None,
    plate: PlateModel,
) -> GroupConditions:
    """Gather the conditions of a group.

    Parameters
    ----------
    selection : DataFrame
        `walking_crossings.csv`.
    gait : UnperturbedGait or None
        The mean gait of the group, if there is one.
    plate : PlateModel
        Of the unloaded plate.
    """
    of_group = selection.filter(pl.col("group").str.split(SEPARATOR).list.contains(group))
    used = of_group.filter(pl.col("perturbed"), pl.col("reason").is_null())
    shares = of_group.group_by("perturbed").agg(pl.col("reason").count() / pl.len())
    phases = used["onset_phase"].cast(pl.Float64).to_numpy()
    stances = gait.stance if gait is not None else np.zeros(0)
    stance = float(np.mean(stances)) if len(stances) else None
    different, different_mm = set_up_difference(of_group)
    outside = used["pressure_outside_m"].cast(pl.Float64)
    return GroupConditions(
        group=group,
        n=len(used),
        n_unperturbed=len(stances),
        stance_s=stance,
        unperturbed_stance_sd=float(np.std(stances, ddof=1)) / stance if stance else None,
        onset_phase=float(np.mean(phases)) if len(phases) and stance else None,
        onset_phase_sd=float(np.std(phases, ddof=1)) if len(phases) > 1 else None,
        left_out_share=shares["reason"].max(),  # type: ignore[arg-type]
        different=different,
        different_mm=different_mm,
        pressure_outside_m=outside.mean(),  # type: ignore[arg-type]
        plate_height_m=plate.certain_height,
        plate_lag_sd_s=plate.lag_sd,
    )


def set_up_difference(crossings: pl.DataFrame) -> tuple[str | None, float | None]:
    """Find the largest difference [mm] from the static trial that half of the perturbed, or of the
    unperturbed, crossings agree in: rows of `walking_crossings.csv`."""
    largest: tuple[str | None, float | None] = None, None
    for of_kind in crossings.drop_nulls("different").partition_by("perturbed"):
        for of_what in of_kind.partition_by("different"):
            mean_mm = float(of_what["different_mm"].cast(pl.Float64).to_numpy().mean())
            if 2 * len(of_what) >= len(of_kind) and mean_mm > (largest[1] or 0.0):
                largest = of_what["different"][0], mean_mm
    return largest


def fitted_time(headline: GroupHeadline) -> float:
    """Time [s] after the onset at which the fit reads a stiffness that changes linearly.

    The fit's K is a sum of torques with weights w, where w . theta = 1. So it is K(t) at t = sum of
    w theta t, after the middle of the window.
    """
    response = headline.responses[0]
    motion = headline.ensemble.motion[response.window]
    w: Array = np.linalg.pinv(motion.columns)[0]
    return float(w @ (motion.theta * response.time[response.window]))
