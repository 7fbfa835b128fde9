# SPDX-License-Identifier: Apache-2.0
"""Tables of the results: single perturbations, headlines, responses, figures, groups.

`walking_groups.csv` has what shows whether the result of a group can be trusted: fields of the
classes here are its columns, the dictionary says what each is, and limits may stand on them. The
residual of a fit is compared with what ordinary gait leaves: each unperturbed crossing's deviation
from their mean, fitted with the same columns. One that is a small share of the torque does not
count, however regular the gait.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.base.measured import rms
from osl_analysis.base.trial import Array
from osl_analysis.signals.filters import Motion
from osl_analysis.stats.budget import budget_rows
from osl_analysis.stats.repeats import doubtful_row
from osl_analysis.walking.contributions import GroupHeadline
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.ensemble import ESTIMATED, mean_gait_torque
from osl_analysis.walking.groups import MEASURED_IN_CROSSINGS, SEPARATOR
from osl_analysis.walking.impedance_fit import fit_response, gait_torque
from osl_analysis.walking.isolated_response import (
    PerturbationResponse,
    UnperturbedGait,
    isolate_response,
)
from osl_analysis.walking.plate_inertia import PlateModel
from osl_analysis.walking.plate_lag import PlateTiming
from osl_analysis.walking.walking_settings import TimingSettings

SMALLEST_RESIDUAL_SHARE = 0.03  # of the torque, for a residual to count


def residual_over_gait(motion: Motion, torque: Array, of_gait: Array) -> float | None:
    """RMS residual of Eq. 15 over that of ordinary gait (crossings, k).

    None below 3 % of the torque, or over 0.
    """
    residual = unexplained_rms(motion.columns, torque[None])
    usual = unexplained_rms(motion.columns, of_gait)
    if residual > SMALLEST_RESIDUAL_SHARE * rms(torque) and usual > 0:
        return residual / usual
    return None


def unexplained_rms(columns: Array, torques: Array) -> float:
    """RMS [N*m] of what the columns (k, 3) leave of torques (n, k)."""
    explained = (columns @ np.linalg.lstsq(columns, torques.T)[0]).T
    return rms(torques - explained)


def result_columns(conditions: Mapping[str, Any], headline: GroupHeadline) -> dict[str, Any]:
    """The estimates of a group, at which phase of stance the fit reads them, and how it agrees with
    single fits and with ordinary gait: columns of `walking_groups.csv` beside its `conditions`."""
    responses = headline.responses
    mean = headline.ensemble.response
    budgets = headline.ensemble.budgets
    K = budgets["K"].value
    of_offset = sum(each.standard or 0.0 for each in budgets["K"].of_source("offset"))
    estimates: dict[str, Any] = {}
    for name, budget in budgets.items():
        estimates.update(budget.columns(name))
    return {
        "fitted_phase": conditions["onset_phase"] + fitted_time(headline) / conditions["stance_s"],
        **estimates,
        "coherence": coherence_of(responses),
        "VAF": mean.fit.vaf,
        "residual_over_gait": residual_over_gait(
            mean.motion[mean.window],
            mean.torque[mean.window],
            mean_gait_torque(responses, mean.fit),
        ),
        "offset_share": 2 * of_offset / abs(K) if K else None,
        "pace_change": np.mean([response.pace_change for response in responses]),
    }


def coherence_of(responses: Sequence[PerturbationResponse]) -> float:
    """RMS angle of the mean response over that of single ones, without their gait.

    Equal turns cancel by nothing but gait: what it scatters in small ones is no other direction or
    onset.
    """
    window = responses[0].window
    angles = np.array([response.fitted_motion.theta for response in responses])
    of_mean = rms(angles.mean(axis=0))
    gait_variance = np.mean(
        [response.thetas[:, window].var(axis=0, ddof=1) for response in responses]
    )
    of_singles = max(rms(angles) ** 2 - gait_variance, of_mean**2)
    return of_mean / np.sqrt(of_singles)


def conditions_of(
    group: str,
    selection: pl.DataFrame,
    gait: UnperturbedGait | None,
    plate: PlateModel,
    timing: PlateTiming,
) -> dict[str, Any]:
    """Gather what is known of a group before any fit: columns of `walking_groups.csv`.

    Parameters
    ----------
    selection : DataFrame
        `walking_crossings.csv`.
    gait : UnperturbedGait or None
        The mean gait of the group, if there is one.
    plate, timing : PlateModel, PlateTiming
        Of the unloaded plate, and its lags in the crossings.
    """
    of_group = selection.filter(pl.col("group").str.split(SEPARATOR).list.contains(group))
    used = of_group.filter(pl.col("perturbed"), pl.col("reason").is_null())
    shares = (
        of_group.drop_nulls("perturbed")
        .group_by("perturbed")
        .agg(pl.col("reason").count() / pl.len())
    )
    phases = used["onset_phase"].cast(pl.Float64)
    stances = pl.Series(gait.stance if gait is not None else [], dtype=pl.Float64)
    stance = stances.mean()
    different, different_mm = set_up_difference(of_group)
    measured = ("pressure_outside_m", *MEASURED_IN_CROSSINGS)
    return {
        "group": group,
        "n": len(used),
        "n_unperturbed": len(stances),
        "stance_s": stance,
        "unperturbed_stance_sd": (stances / stance).std(),
        "onset_phase": phases.mean(),
        "onset_phase_sd": phases.std(),
        "left_out_share": shares["reason"].max(),
        "different": different,
        "different_mm": different_mm,
        **used.select(pl.col(measured).cast(pl.Float64).mean()).row(0, named=True),
        "plate_height_m": plate.certain_height,
        "plate_mass_kg": plate.mass,
        "plate_lag_s": timing.lag,
        "plate_lag_sd_s": timing.scatter,
        "plate_lag_change_s": timing.change,
        "plate_drift": timing.drift,
    }


def set_up_difference(crossings: pl.DataFrame) -> tuple[str | None, float | None]:
    """Find the largest difference [mm] from the static trial that half of the perturbed, or of the
    unperturbed, crossings agree in: rows of `walking_crossings.csv`."""
    largest: tuple[str | None, float | None] = None, None
    for of_kind in crossings.drop_nulls("different").partition_by("perturbed"):
        what = of_kind["different"].mode().min()
        distances = of_kind.filter(different=what)["different_mm"].cast(pl.Float64).to_numpy()
        if 2 * len(distances) >= len(of_kind) and distances.mean() > (largest[1] or 0.0):
            largest = str(what), distances.mean()
    return largest


def fitted_time(headline: GroupHeadline) -> float:
    """Time [s] after the onset at which the fit reads a stiffness that changes linearly.

    The fit's K is a sum of torques with weights w, where w . theta = 1. So it is K(t) at t = sum of
    w theta t, after the middle of the window.
    """
    response = headline.responses[0]
    motion = headline.ensemble.response.motion[response.window]
    w: Array = np.linalg.pinv(motion.columns)[0]
    return float(w @ (motion.theta * response.time[response.window]))


ENSEMBLE = "ensemble"
PREDICTED = "ensemble, predicted gait"


def perturbation_row(
    crossing: Crossing, gait: UnperturbedGait, settings: TimingSettings
) -> dict[str, object]:
    """Make the row of `walking.csv` of one crossing: Eq. 15 fitted to its isolated response."""
    response = isolate_response(crossing, gait, settings)
    fit = fit_response(response)
    return {
        "bridged": crossing.bridged,
        **{name: fit[name] for name in ESTIMATED},
        "residual_over_gait": residual_over_gait(
            response.fitted_motion,
            response.fitted_torque,
            gait_torque(response, fit)[:, response.window],
        ),
        "VAF": fit.vaf,
    }


def headline_rows(headline: GroupHeadline, fits: pl.DataFrame) -> list[dict[str, Any]]:
    """Make the rows of `walking_summary.csv` of one group, of which `fits` are the rows of
    `walking.csv`: the mean over perturbations, and the fits to the mean response."""
    n = {"n": len(fits)}
    rows: list[dict[str, Any]] = []
    for name in (*ESTIMATED, "VAF"):
        mean = {"mean": fits[name].mean(), "sd": fits[name].std()}
        rows.append(
            {"quantity": name, "estimator": "mean of perturbations", **n, **mean}
            | doubtful_row(fits)
        )
    for estimator, fit in ((ENSEMBLE, headline.ensemble), (PREDICTED, headline.predicted)):
        place = {"estimator": estimator, **n}
        for name, budget in fit.budgets.items():
            ends = {"mean": budget.value, "low": budget.low, "high": budget.high}
            rows.append({"quantity": name, **place, **ends})
        rows.append({"quantity": "VAF", **place, "mean": fit.response.fit.vaf})
    return rows


def budget_table(group: str, headline: GroupHeadline) -> pl.DataFrame:
    """Tabulate `walking_budget.csv`: what contributes to the estimates of a group."""
    estimates = dict(headline.ensemble.budgets)
    for name, budget in headline.predicted.budgets.items():
        estimates[f"{name}_predicted"] = budget
    table = pl.DataFrame(budget_rows({}, estimates), infer_schema_length=None)
    return table.drop("trial", "amplitude_deg").select(pl.lit(group).alias("group"), pl.all())


def response_table(group: str, headline: GroupHeadline) -> pl.DataFrame:
    """Tabulate `walking_responses.csv`: the isolated responses of a group, and their mean."""
    first = headline.responses[0]
    time = first.time
    window = first.window
    fitted = [
        (response.name, response.motion, response.torque, fit_response(response))
        for response in headline.responses
    ]
    mean = headline.ensemble.response
    frames = []
    for name, motion, torque, fit in [*fitted, (ENSEMBLE, mean.motion, mean.torque, mean.fit)]:
        model = np.full(len(time), np.nan)
        model[window] = motion.columns[window] @ fit.estimates
        frame = pl.DataFrame(
            {
                "trial": name,
                "time": time,
                "theta_deg": np.rad2deg(motion.theta),
                "torque": torque,
                "torque_model": model,
                "group": group,
            },
            nan_to_null=True,
        )
        frames.append(frame[: window.stop])
    return pl.concat(frames)
