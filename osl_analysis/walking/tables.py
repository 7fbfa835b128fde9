# SPDX-License-Identifier: Apache-2.0
"""Tables of the results: single perturbations, headlines, responses, figures, groups.

`walking_groups.csv` has what shows whether the result of a group can be trusted: fields of the
classes here are its columns, the dictionary says what each is, and limits may stand on them. The
residual of a fit is compared with what ordinary gait leaves: each unperturbed crossing's deviation
from their mean, fitted with the same columns. One that is a small share of the torque does not
count, however regular the gait.
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

NAMES = (*QUANTITIES, "VAF")  # of all that a fit tells
Contributions = dict[str, Contribution]
"""Of one source to these, as far as it has any."""


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
    """Compute the result of the perturbed crossings of one group, whose unperturbed gait is `gait`.

    `plate` and `timing` tell how well its height, its lag and the onsets are known. The inertia of
    a leg without a drivetrain is not negative.

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
    errors = [*of_set_up(mean, plate, timing), of_onset(mean, timing)]
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

    Predictors of gait, of the `choices`, are chosen anew without each unperturbed crossing, since
    another campaign would. `errors` are those of the set-up.
    """
    mean = mean_response(responses)
    of_mean = fit_response(mean)
    predictors = best_predictors(mean, of_mean, choices)
    without_perturbed = []
    for i in range(len(responses)):
        others = mean_response([*responses[:i], *responses[i + 1 :]])
        without_perturbed.append(estimates_and_vaf(replace(others, predictors=predictors)))
    crossings = len(mean.thetas)
    without_unperturbed = []
    for i in range(crossings):
        others = mean.without(i)
        chosen = best_predictors(others, of_mean, choices)
        without_unperturbed.append(estimates_and_vaf(replace(others, predictors=chosen)))

    response = replace(mean, predictors=predictors)
    rows = [
        of_scatter(Source.CROSSINGS, without_perturbed, freedom=len(responses) - 1.0),
        of_scatter(
            Source.MEAN_GAIT, without_unperturbed, freedom=crossings - 1.0 - len(predictors)
        ),
        *errors,
        *of_choices(response),
    ]
    budgets = {}
    for name, value in zip(NAMES, estimates_and_vaf(response), strict=True):
        found = tuple(row[name] for row in rows if name in row)
        budgets[name] = Budget(float(value), found)
    return GroupFit(response, budgets)


def estimates_and_vaf(response: PerturbationResponse) -> Array:
    """`NAMES` (4,)."""
    fit = fit_response(response)
    return np.append(fit.estimates, fit.vaf)


def estimates_of(response: PerturbationResponse, window: slice | None = None) -> Array:
    """K, B and I (3,), also in another window."""
    return fit_response(replace(response, window=window or response.window)).estimates


def with_late_torque(fit: GroupFit) -> GroupFit:
    """The fit with the doubt that a negative inertia throws on the lag: a torque late by d lowers B
    by K d and I by B d, to first order."""
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
    for name, row in of_estimates(late_plate, lag_s * np.array([0.0, K, B])).items():
        budgets[name] = budgets[name].plus(row)
    return replace(fit, budgets=budgets)


def of_estimates(contribution: Contribution, standards: Array) -> Contributions:
    """A contribution to each of K, B and I, or of `NAMES`, by the standard uncertainties (3,) or
    (4,)."""
    sizes = zip(NAMES[: len(standards)], np.abs(standards), strict=True)
    return {name: replace(contribution, standard=float(size)) for name, size in sizes}


def of_scatter(source: Source, without_one: Sequence[Array], freedom: float) -> Contributions:
    """What the scatter of crossings contributes, by the estimates without each of them."""
    scatter = Contribution(source, None, freedom, basis="measured", part="repeatability")
    return of_estimates(scatter, jackknife_ses(without_one))


def by_all_crossings(
    source: Source, standards: Array, freedom: float | None = None
) -> Contributions:
    """What all crossings of a campaign tell of an error that they share."""
    shared = Contribution(source, None, freedom, basis="measured", shared=True)
    return of_estimates(shared, standards)


def by_choice(source: Source, changes: Array) -> Contributions:
    """Half of the changes (3,) by another choice of the analysis."""
    return of_estimates(Contribution(source, None, basis="assumed", part="motion"), changes / 2)


def of_set_up(
    response: PerturbationResponse, plate: PlateModel, timing: PlateTiming
) -> list[Contributions]:
    """What the plate's model, lag, height and gain, and the foot's place contribute, by the changes
    (m + 4, k) [N*m] of the mean response."""
    torques = response.changes[:, response.window]
    changes = np.linalg.lstsq(response.fitted_motion.columns, torques.T)[0].T
    by_trial, by_unit = np.split(changes, [-len(PER_UNIT)])
    of_lag, of_height, of_place, of_mass = by_unit

    rows = [
        unknown(
            Source.WALKING_UNSEEN, "% of the plate's gain", K=fit_response(response)["K"] / 100
        ),
        unknown(Source.WALKING_UNSEEN, "mm of the foot's place", K=of_place[0]),
    ]
    if len(by_trial) > 1:
        ses = jackknife_ses(by_trial)
        rows.append(by_all_crossings(Source.PLATE_INERTIA, ses, freedom=len(by_trial) - 1.0))
    else:
        rows.append(of_error(Source.PLATE_INERTIA, "kg", of_mass, None))
    rows.append(of_error(Source.PLATE_LAG, "ms", of_lag, timing.se))
    rows.append(of_error(Source.PLATE_HEIGHT, "mm", of_height, plate.height_se))
    return rows


def of_error(source: Source, unit: str, changes: Array, standard: float | None) -> Contributions:
    """What an error contributes, by the changes (3,) of K, B and I per ms or mm and its standard
    uncertainty [s] or [m]; where nobody has measured it (None), these changes."""
    if standard is None:
        return unknown(Source.PLATE_UNSEEN, unit, **dict(zip(QUANTITIES, changes, strict=True)))
    return by_all_crossings(source, 1e3 * standard * changes)


def of_choices(response: PerturbationResponse) -> list[Contributions]:
    """Half of what an offset of the fit, and the length of the window, would change."""
    first = response.window.start
    last = response.window.stop
    step = round((last - first) / 10)
    shorter = estimates_of(response, slice(first, last - step))
    longer = estimates_of(response, slice(first, last + step))
    # far off if the response is not of second order
    X = np.column_stack([response.fitted_motion.columns, np.ones(last - first)])
    with_offset = np.linalg.lstsq(X, response.fitted_torque)[0][:-1]
    return [
        by_choice(Source.WINDOW, longer - shorter),
        by_choice(Source.OFFSET, with_offset - estimates_of(response)),
    ]


def of_onset(response: PerturbationResponse, timing: PlateTiming) -> Contributions:
    """What an error of all onsets contributes."""
    first = response.window.start
    last = response.window.stop
    earlier = estimates_of(response, slice(first - 1, last - 1))
    later = estimates_of(response, slice(first + 1, last + 1))
    frames = timing.onset_se * sampling_rate(response.time)
    return by_all_crossings(Source.ONSET, frames * (later - earlier) / 2)


SMALLEST_RESIDUAL_SHARE = 0.03  # of the torque, for a residual to count


def residual_over_gait(response: PerturbationResponse) -> float | None:
    """RMS residual of Eq. 15 over that of the ordinary gait of each unperturbed crossing.

    None below 3 % of the torque, or over 0.
    """
    columns = response.fitted_motion.columns
    torque = response.fitted_torque
    of_gait = gait_torque(response, fit_response(response))[:, response.window]
    residual = unexplained_rms(columns, torque[None])
    usual = unexplained_rms(columns, of_gait)
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
    mean = headline.ensemble.response
    budgets = headline.ensemble.budgets
    predicted = {
        budget_name(name, PREDICTED): budget.value
        for name, budget in headline.predicted.budgets.items()
        if name in QUANTITIES
    }
    K = budgets["K"].value
    (of_offset,) = budgets["K"].from_source(Source.OFFSET)
    estimates: dict[str, Any] = {}
    for name in QUANTITIES:
        estimates.update(budgets[name].columns(name))
    return {
        "fitted_phase": conditions["onset_phase"] + fitted_time(mean) / conditions["stance_s"],
        **estimates,
        "VAF": budgets["VAF"].value,
        "residual_over_gait": residual_over_gait(mean),
        "offset_share": 2 * of_offset.size / abs(K) if K else None,
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
    """Find the largest difference [mm] from the static trial that half of the perturbed, or of the
    unperturbed, crossings agree in: rows of `walking_crossings.csv`."""
    largest: tuple[str | None, float | None] = None, None
    for of_kind in crossings.drop_nulls("different").partition_by("perturbed"):
        what = of_kind["different"].mode().min()
        distances = of_kind.filter(different=what)["different_mm"].cast(pl.Float64).to_numpy()
        if 2 * len(distances) >= len(of_kind) and distances.mean() > (largest[1] or 0.0):
            largest = str(what), distances.mean()
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
    """Make the rows of `walking_summary.csv` of one group, of which `fits` are the rows of
    `walking.csv`: the mean over perturbations, and the fits to the mean response."""
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
    """Tabulate `walking_budget.csv`: what contributes to the estimates of a group."""
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
