# SPDX-License-Identifier: Apache-2.0
"""Step 9, tables: estimates and budgets of groups of crossings, and rows of result tables.

A budget has the scatter of perturbed and unperturbed crossings (jackknife), errors of the set-up
that all crossings share, and half of the change by another window or an offset.

The residual of a fit is compared with that of ordinary gait: the deviation of each unperturbed
crossing from their mean, fitted with the same columns.

Example: `group_headline(perturbed, gait, settings, plate, timing).ensemble.budgets["K"].low`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.base.measured import rms
from osl_analysis.base.trial import Array
from osl_analysis.signals.filters import sampling_rate
from osl_analysis.stats.budget import QUANTITIES, Budget, Contribution, budget_rows, unknown
from osl_analysis.stats.sources import Source
from osl_analysis.walking.crossing import PER_UNIT, Crossing
from osl_analysis.walking.groups import MEASURED_IN_CROSSINGS, SEPARATOR
from osl_analysis.walking.impedance_fit import (
    ENSEMBLE,
    best_predictors,
    fit_response,
    gait_torque,
    jackknife_ses,
    mean_response,
    predictor_sets,
)
from osl_analysis.walking.isolated_response import (
    PerturbationResponse,
    Predictors,
    UnperturbedGait,
    isolate_response,
)
from osl_analysis.walking.plate_inertia import PlateModel
from osl_analysis.walking.plate_lag import PlateTiming
from osl_analysis.walking.walking_settings import TimingSettings

NAMES = (*QUANTITIES, "VAF")  # of all results of a fit
Contributions = dict[str, Contribution]
"""The contributions of one source, by estimate."""


@dataclass(frozen=True)
class GroupFit:
    """Eq. 15 fitted to the mean response of a group, with the budgets of K, B and I, and of the
    variance accounted for [%]."""

    response: PerturbationResponse
    budgets: Mapping[str, Budget]


@dataclass(frozen=True)
class GroupHeadline:
    """The result of one group of perturbed crossings."""

    responses: Sequence[PerturbationResponse]
    ensemble: GroupFit  # minus the mean unperturbed gait
    predicted: GroupFit  # minus predicted gait


def group_headline(
    perturbed: Sequence[Crossing],
    gait: UnperturbedGait,
    settings: TimingSettings,
    plate: PlateModel,
    timing: PlateTiming,
    has_drivetrain: bool = True,
) -> GroupHeadline:
    """Compute the result of the perturbed crossings of one group, with its unperturbed `gait`.

    `plate` and `timing` have the errors of the plate's height, of its lag and of the onsets. A leg
    without a drivetrain has no negative inertia: a fit that gives one is doubtful.

    Raises
    ------
    InputError
        A response cannot be isolated, or there are too few.
    """
    responses = [isolate_response(crossing, gait, settings) for crossing in perturbed]
    headline = headline_of_responses(responses, plate, timing)
    if has_drivetrain or headline.ensemble.budgets["I"].high >= 0:
        return headline
    return replace(headline, ensemble=with_late_torque(headline.ensemble))


def headline_of_responses(
    responses: Sequence[PerturbationResponse], plate: PlateModel, timing: PlateTiming
) -> GroupHeadline:
    """Fit Eq. 15 to the mean of two or more responses, minus mean and minus predicted gait."""
    mean = mean_response(responses)
    errors = [*set_up_rows(mean, plate, timing), onset_rows(mean, timing)]
    return GroupHeadline(
        responses,
        ensemble=group_fit(responses, [()], errors),
        predicted=group_fit(responses, predictor_sets(len(mean.thetas)), errors),
    )


def group_fit(
    responses: Sequence[PerturbationResponse],
    choices: Sequence[Predictors],
    errors: Sequence[Contributions],
) -> GroupFit:
    """The fit of a group with the budgets of its estimates.

    Predictors of gait are among the `choices`. They are chosen anew without each unperturbed
    crossing, as they would be in another campaign. `errors` are those of the set-up.
    """
    mean = mean_response(responses)
    mean_fit = fit_response(mean)
    predictors = best_predictors(mean, mean_fit, choices)
    without_perturbed = []
    for i in range(len(responses)):
        without_one = mean_response([*responses[:i], *responses[i + 1 :]])
        without_perturbed.append(estimates_and_vaf(replace(without_one, predictors=predictors)))
    crossings = len(mean.thetas)
    without_unperturbed = []
    for i in range(crossings):
        without_one = mean.without(i)
        chosen = best_predictors(without_one, mean_fit, choices)
        without_unperturbed.append(estimates_and_vaf(replace(without_one, predictors=chosen)))

    response = replace(mean, predictors=predictors)
    rows = [
        scatter_rows(Source.CROSSINGS, without_perturbed, freedom=len(responses) - 1.0),
        scatter_rows(
            Source.MEAN_GAIT, without_unperturbed, freedom=crossings - 1.0 - len(predictors)
        ),
        *errors,
        *choice_rows(response),
    ]
    budgets = {}
    for name, value in zip(NAMES, estimates_and_vaf(response), strict=True):
        contributions = tuple(row[name] for row in rows if name in row)
        budgets[name] = Budget(float(value), contributions)
    return GroupFit(response, budgets)


def estimates_and_vaf(response: PerturbationResponse) -> Array:
    """`NAMES` (4,)."""
    fit = fit_response(response)
    return np.append(fit.estimates, fit.vaf)


def estimates_of(response: PerturbationResponse, window: slice | None = None) -> Array:
    """K, B and I (3,), also in another window."""
    return fit_response(replace(response, window=window or response.window)).estimates


def with_late_torque(fit: GroupFit) -> GroupFit:
    """The fit with the lag that would explain its negative inertia, as a fault.

    To first order a torque that is late by d lowers B by K d, and I by B d.
    """
    budgets = dict(fit.budgets)
    K = budgets["K"].value
    B = budgets["B"].value
    lag_s = -budgets["I"].value / B
    late_plate = Contribution(
        Source.LATE_TORQUE,
        None,
        basis="measured",
        part="fault",
        detail="a lag that makes I negative",
    )
    for name, row in by_estimate(late_plate, lag_s * np.array([0.0, K, B])).items():
        budgets[name] = budgets[name].plus(row)
    return replace(fit, budgets=budgets)


def by_estimate(contribution: Contribution, standards: Array) -> Contributions:
    """The contribution to each of K, B, I (3,), or of `NAMES` (4,), with its standard
    uncertainty."""
    sizes = zip(NAMES[: len(standards)], np.abs(standards), strict=True)
    return {name: replace(contribution, standard=float(size)) for name, size in sizes}


def scatter_rows(source: Source, without_one: Sequence[Array], freedom: float) -> Contributions:
    """The contributions of the scatter of crossings, by the estimates without each of them."""
    scatter = Contribution(source, None, freedom, basis="measured", part="repeatability")
    return by_estimate(scatter, jackknife_ses(without_one))


def shared_rows(source: Source, standards: Array, freedom: float | None = None) -> Contributions:
    """The contributions of an error that all crossings of a campaign share."""
    shared = Contribution(source, None, freedom, basis="measured", shared=True)
    return by_estimate(shared, standards)


def half_changes(source: Source, changes: Array) -> Contributions:
    """The contributions of another choice of the analysis: half of its changes (3,)."""
    return by_estimate(Contribution(source, None, basis="assumed", part="motion"), changes / 2)


def set_up_rows(
    response: PerturbationResponse, plate: PlateModel, timing: PlateTiming
) -> list[Contributions]:
    """The contributions of the plate's model, lag, height and gain, and of the foot's place.

    They follow from the changes (m + 4, k) [N*m] of the mean response's torque.
    """
    torques = response.changes[:, response.window]
    changes = np.linalg.lstsq(response.fitted_motion.columns, torques.T)[0].T
    by_trial, by_unit = np.split(changes, [-len(PER_UNIT)])
    by_lag, by_height, by_place, by_mass = by_unit

    rows = [
        unknown(
            Source.WALKING_UNSEEN, "% of the plate's gain", K=fit_response(response)["K"] / 100
        ),
        unknown(Source.WALKING_UNSEEN, "mm of the foot's place", K=by_place[0]),
    ]
    if len(by_trial) > 1:
        ses = jackknife_ses(by_trial)
        rows.append(shared_rows(Source.PLATE_INERTIA, ses, freedom=len(by_trial) - 1.0))
    else:
        rows.append(error_rows(Source.PLATE_INERTIA, "kg", by_mass, None))
    rows.append(error_rows(Source.PLATE_LAG, "ms", by_lag, timing.se))
    rows.append(error_rows(Source.PLATE_HEIGHT, "mm", by_height, plate.height_se))
    return rows


def error_rows(source: Source, unit: str, changes: Array, standard: float | None) -> Contributions:
    """The contributions of an error.

    `changes` (3,) are those of K, B and I per ms or mm; `standard` is its uncertainty [s] or [m].
    Where nobody has measured it (None), the rows have the changes per unit alone.
    """
    if standard is None:
        return unknown(Source.PLATE_UNSEEN, unit, **dict(zip(QUANTITIES, changes, strict=True)))
    return shared_rows(source, 1e3 * standard * changes)


def choice_rows(response: PerturbationResponse) -> list[Contributions]:
    """The contributions of an offset in the fit, and of another length of the window."""
    first = response.window.start
    last = response.window.stop
    step = round((last - first) / 10)
    shorter = estimates_of(response, slice(first, last - step))
    longer = estimates_of(response, slice(first, last + step))
    # an offset changes much if the response is not of second order
    X = np.column_stack([response.fitted_motion.columns, np.ones(last - first)])
    with_offset = np.linalg.lstsq(X, response.fitted_torque)[0][:-1]
    return [
        half_changes(Source.WINDOW, longer - shorter),
        half_changes(Source.OFFSET, with_offset - estimates_of(response)),
    ]


def onset_rows(response: PerturbationResponse, timing: PlateTiming) -> Contributions:
    """The contributions of an error that all onsets share."""
    first = response.window.start
    last = response.window.stop
    earlier = estimates_of(response, slice(first - 1, last - 1))
    later = estimates_of(response, slice(first + 1, last + 1))
    frames = timing.onset_se * sampling_rate(response.time)
    return shared_rows(Source.ONSET, frames * (later - earlier) / 2)


SMALLEST_RESIDUAL_SHARE = 0.03  # of the torque, for a residual to count


def residual_over_gait(response: PerturbationResponse) -> float | None:
    """RMS residual of Eq. 15 over that of the ordinary gait of each unperturbed crossing.

    It is None where the residual is below 3 % of the torque, or gait leaves none.
    """
    columns = response.fitted_motion.columns
    torque = response.fitted_torque
    gait_torques = gait_torque(response, fit_response(response))[:, response.window]
    residual = unexplained_rms(columns, torque[None])
    usual = unexplained_rms(columns, gait_torques)
    if residual > SMALLEST_RESIDUAL_SHARE * rms(torque) and usual > 0:
        return residual / usual
    return None


def unexplained_rms(columns: Array, torques: Array) -> float:
    """RMS [N*m] of torques (n, k) that the columns (k, 3) do not explain."""
    explained = (columns @ np.linalg.lstsq(columns, torques.T)[0]).T
    return rms(torques - explained)


def result_columns(conditions: Mapping[str, Any], headline: GroupHeadline) -> dict[str, Any]:
    """The estimates of a group, the phase of stance that they belong to, and measures of the fit:
    columns of `walking_groups.csv` beside its `conditions`."""
    mean = headline.ensemble.response
    budgets = headline.ensemble.budgets
    predicted = {
        budget_name(name, PREDICTED): budget.value
        for name, budget in headline.predicted.budgets.items()
        if name in QUANTITIES
    }
    K = budgets["K"].value
    (offset_row,) = budgets["K"].from_source(Source.OFFSET)
    estimates: dict[str, Any] = {}
    for name in QUANTITIES:
        estimates.update(budgets[name].columns(name))
    return {
        "fitted_phase": conditions["onset_phase"] + fitted_time(mean) / conditions["stance_s"],
        **estimates,
        "VAF": budgets["VAF"].value,
        "residual_over_gait": residual_over_gait(mean),
        "offset_share": 2 * offset_row.size / abs(K) if K else None,
        "pace_change": mean.pace_change,
        **predicted,
    }


def conditions_of(
    group: str,
    selection: pl.DataFrame,
    gait: UnperturbedGait | None,
    plate: PlateModel,
    timing: PlateTiming,
) -> dict[str, Any]:
    """The facts of a group before any fit: columns of `walking_groups.csv`.

    Parameters
    ----------
    selection : DataFrame
        `walking_crossings.csv`.
    gait : UnperturbedGait or None
        The mean gait of the group, if there is one.
    plate, timing : PlateModel, PlateTiming
        Model of the unloaded plate, and the plate's lags in the crossings.
    """
    group_crossings = selection.filter(pl.col("group").str.split(SEPARATOR).list.contains(group))
    used = group_crossings.filter(pl.col("perturbed"), pl.col("reason").is_null())
    shares = (
        group_crossings.drop_nulls("perturbed")
        .group_by("perturbed")
        .agg(pl.col("reason").count() / pl.len())
    )
    phases = used["onset_phase"].cast(pl.Float64)
    stances = pl.Series(gait.stance if gait is not None else [], dtype=pl.Float64)
    stance = stances.mean()
    different, different_mm = set_up_difference(group_crossings)
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
        **used.select(pl.col(MEASURED_IN_CROSSINGS).cast(pl.Float64).mean()).row(0, named=True),
        "plate_height_m": plate.certain_height,
        "plate_mass_kg": plate.mass,
        "plate_lag_s": timing.lag,
        "plate_lag_sd_s": timing.scatter,
        "plate_lag_change_s": timing.change,
        "plate_drift": timing.drift,
    }


def set_up_difference(crossings: pl.DataFrame) -> tuple[str | None, float | None]:
    """Find the largest difference [mm] from the static trial in rows of `walking_crossings.csv`.

    It counts where half of the perturbed, or half of the unperturbed, crossings have the same one.
    """
    largest: tuple[str | None, float | None] = None, None
    for alike in crossings.drop_nulls("different").partition_by("perturbed"):
        place = alike["different"].mode().min()
        distances = alike.filter(different=place)["different_mm"].cast(pl.Float64).to_numpy()
        if 2 * len(distances) >= len(alike) and distances.mean() > (largest[1] or 0.0):
            largest = str(place), distances.mean()
    return largest


def fitted_time(response: PerturbationResponse) -> float:
    """Time [s] after the onset at which the fit reads a stiffness that changes linearly.

    The fit's K is a sum of torques with weights w, where w . theta = 1. So it is K(t) at t = sum of
    w theta t, after the middle of the window.
    """
    motion = response.fitted_motion
    w: Array = np.linalg.pinv(motion.columns)[0]
    return float(w @ (motion.theta * response.time[response.window]))


PREDICTED = "ensemble, predicted gait"
MEAN_OF_PERTURBATIONS = "mean of perturbations"


def budget_name(quantity: str, estimator: str) -> str:
    """The name of an estimate of a group in `walking_budget.csv`."""
    return f"{quantity}_predicted" if estimator == PREDICTED else quantity


def perturbation_row(
    crossing: Crossing, gait: UnperturbedGait, settings: TimingSettings
) -> dict[str, object]:
    """Make the row of `walking.csv` of one crossing: Eq. 15 fitted to its isolated response."""
    response = isolate_response(crossing, gait, settings)
    fit = fit_response(response)
    return {
        "bridged": crossing.bridged,
        **{name: fit[name] for name in QUANTITIES},
        "residual_over_gait": residual_over_gait(response),
        "VAF": fit.vaf,
    }


def headline_rows(headline: GroupHeadline, fits: pl.DataFrame) -> list[dict[str, Any]]:
    """Make the rows of `walking_summary.csv` of one group.

    They are the mean over perturbations, by the rows `fits` of `walking.csv`, and the fits to the
    mean response.
    """
    n = {"n": len(fits)}
    rows: list[dict[str, Any]] = []
    for name in NAMES:
        mean = {"mean": fits[name].mean(), "sd": fits[name].std()}
        rows.append({"quantity": name, "estimator": MEAN_OF_PERTURBATIONS, **n, **mean})
    for estimator, fit in ((ENSEMBLE, headline.ensemble), (PREDICTED, headline.predicted)):
        place = {"estimator": estimator, **n}
        for name, budget in fit.budgets.items():
            high = min(budget.high, 100.0) if name == "VAF" else budget.high
            ends = {"mean": budget.value, "low": budget.low, "high": high}
            rows.append({"quantity": name, **place, **ends})
    return rows


def budget_table(group: str, headline: GroupHeadline) -> pl.DataFrame:
    """Tabulate `walking_budget.csv`: the contributions to the estimates of a group."""
    estimates = dict(headline.ensemble.budgets)
    for name, budget in headline.predicted.budgets.items():
        estimates[budget_name(name, PREDICTED)] = budget
    table = pl.DataFrame(budget_rows({}, estimates), infer_schema_length=None)
    return table.drop("trial", "amplitude_deg").select(pl.lit(group).alias("group"), pl.all())


def response_table(group: str, headline: GroupHeadline) -> pl.DataFrame:
    """Tabulate `walking_responses.csv`: the isolated responses of a group, and their mean."""
    frames = []
    for response in [*headline.responses, headline.ensemble.response]:
        motion = response.motion
        window = response.window
        model = np.full(len(response.time), np.nan)
        model[window] = motion.columns[window] @ estimates_of(response)
        frame = pl.DataFrame(
            {
                "trial": response.name,
                "time": response.time,
                "theta_deg": np.rad2deg(motion.theta),
                "torque": response.torque,
                "torque_model": model,
                "group": group,
            },
            nan_to_null=True,
        )
        frames.append(frame[: window.stop])
    return pl.concat(frames)
