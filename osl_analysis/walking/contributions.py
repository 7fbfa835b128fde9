# SPDX-License-Identifier: Apache-2.0
"""What contributes to K, B and I of a group of crossings: the walkway's rows of the budget.

| source | how large |
|---|---|
| crossings, mean gait | the jackknife: the fit without each perturbed, or unperturbed, crossing |
| plate inertia | the jackknife over the trials of the unloaded plate |
| plate lag, plate height | the torque of 1 ms or 1 mm through the fit, times standard errors |
| onset | the window a frame earlier and later, per frame, times its standard error |
| offset, window | what a fit with an offset, or a window 10 % shorter or longer, would change |

The last ones are a choice of the fit, as another motion is on the bench, and in no interval. What
nobody has measured is listed with its size per unit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.base.trial import Array
from osl_analysis.stats.budget import Budget, Contribution, unknown
from osl_analysis.walking.crossing import PER_UNIT, Crossing
from osl_analysis.walking.ensemble import (
    ESTIMATED,
    Ensemble,
    EnsembleResponse,
    PredictorChoice,
    mean_gait_torque,
    stacked,
)
from osl_analysis.walking.impedance_fit import (
    fitted_changes,
    jackknife_ses,
)
from osl_analysis.walking.isolated_response import (
    PerturbationResponse,
    UnperturbedGait,
    isolate_response,
)
from osl_analysis.walking.plate_inertia import PlateModel
from osl_analysis.walking.plate_lag import PlateTiming
from osl_analysis.walking.walking_settings import TimingSettings

Budgets = Mapping[str, Budget]
Contributions = dict[str, Contribution]
"""Of one source to K, B and I, as far as it has any."""


@dataclass(frozen=True)
class GroupFit:
    """Eq. 15 fitted to the mean response of a group, with the budgets of K, B and I."""

    response: EnsembleResponse
    budgets: Budgets


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
    group = stacked(responses)
    mean = group.fitted()
    curves = mean_gait_torque(responses, mean.fit)
    choice = PredictorChoice(curves, group.behaviour.mean(axis=0))
    changes = np.mean([response.changes for response in responses], axis=0)
    errors = [
        *of_set_up(mean, changes, plate, timing),
        of_onset(mean, timing, group.time[1] - group.time[0]),
    ]
    return GroupHeadline(
        responses,
        ensemble=with_budgets(group, mean, None, errors),
        predicted=with_budgets(group, group.fitted(choice.best()), choice, errors),
    )


def with_budgets(
    group: Ensemble,
    response: EnsembleResponse,
    choice: PredictorChoice | None,
    errors: Sequence[Contributions],
) -> GroupFit:
    """The fit of a group with the budgets of its estimates.

    With a `choice` gait is predicted, and predictors are chosen anew without each unperturbed
    crossing, since another campaign would. `errors` are those of the set-up.
    """
    n, crossings = group.theta.shape[:2]
    predictors = () if choice is None else choice.best()
    without_perturbed = [
        group.without(i, axis=0).fitted(predictors).fit.estimates for i in range(n)
    ]
    without_unperturbed = []
    for i in range(crossings):
        chosen = () if choice is None else choice.best(i)
        without_unperturbed.append(group.without(i, axis=1).fitted(chosen).fit.estimates)
    freedom = float(crossings - 1 - len(predictors))
    rows = [
        of_source("crossings", jackknife_ses(without_perturbed), replace(SCATTER, freedom=n - 1.0)),
        of_source(
            "mean_gait", jackknife_ses(without_unperturbed), replace(SCATTER, freedom=freedom)
        ),
        *errors,
        *of_choices(response),
    ]
    budgets = {}
    for name in ESTIMATED:
        found = tuple(row[name] for row in rows if name in row)
        budgets[name] = Budget(response.fit[name], found)
    return GroupFit(response, budgets)


def with_late_torque(fit: GroupFit) -> GroupFit:
    """The fit with the doubt that a negative inertia throws on the lag: a torque late by d lowers B
    by K d and I by B d, to first order."""
    K = fit.response.fit["K"]
    B = fit.response.fit["B"]
    lag_s = -fit.response.fit["I"] / B
    changes = of_source("late_torque", lag_s * np.array([0.0, K, B]), LATE)
    return replace(
        fit, budgets={name: each.plus(changes[name]) for name, each in fit.budgets.items()}
    )


SCATTER = Contribution("", None, basis="measured", part="repeatability")  # of this campaign
SHARED = Contribution("", None, basis="measured", shared=True)  # by all crossings
LATE = Contribution("", None, basis="measured", part="fault", detail="a lag that makes I negative")
CHOSEN = Contribution("", None, basis="assumed", part="motion")  # half of another choice's change


def of_source(source: str, standards: Array, row: Contribution = SHARED) -> Contributions:
    """A row for each of K, B and I, by the standard uncertainties (3,)."""
    sizes = zip(ESTIMATED, np.abs(standards), strict=True)
    return {name: replace(row, source=source, standard=float(size)) for name, size in sizes}


def of_set_up(
    response: EnsembleResponse, torques: Array, plate: PlateModel, timing: PlateTiming
) -> list[Contributions]:
    """What the plate's model, lag, height and gain, and the foot's place contribute, by the changes
    (m + 4, k) [N*m] of the mean response."""
    columns = response.motion[response.window].columns
    changes = fitted_changes(columns, torques, response.window)
    by_trial, by_unit = np.split(changes, [-len(PER_UNIT)])
    of_lag, of_height, of_place, of_mass = by_unit

    rows = [
        unknown("walking_unseen", "% of the plate's gain", K=response.fit["K"] / 100),
        unknown("walking_unseen", "mm of the foot's place", K=of_place[0]),
    ]
    if len(by_trial) > 1:
        ses = jackknife_ses(by_trial)
        rows.append(of_source("plate_inertia", ses, replace(SHARED, freedom=len(by_trial) - 1.0)))
    else:
        rows.append(in_units("plate_unseen", "kg", of_mass))
    if timing.se is None:
        rows.append(in_units("plate_unseen", "ms", of_lag))
    else:
        rows.append(of_source("plate_lag", 1e3 * timing.se * of_lag))
    if plate.height_se is None:
        rows.append(in_units("plate_unseen", "mm", of_height))
    else:
        rows.append(of_source("plate_height", 1e3 * plate.height_se * of_height))
    return rows


def in_units(source: str, unit: str, changes: Array) -> Contributions:
    """What nobody has measured, with the changes (3,) of K, B and I by a unit of it."""
    return unknown(source, unit, **dict(zip(ESTIMATED, changes, strict=True)))


def of_choices(response: EnsembleResponse) -> list[Contributions]:
    """Half of what an offset of the fit, and the length of the window, would change."""
    first = response.window.start
    last = response.window.stop
    step = round((last - first) / 10)
    shorter = response.estimates_in(slice(first, last - step))
    longer = response.estimates_in(slice(first, last + step))
    rows = [of_source("window", (longer - shorter) / 2, CHOSEN)]
    # far off if the response is not of second order
    columns = response.motion[response.window].columns
    X = np.column_stack([columns, np.ones(last - first)])
    with_offset = np.linalg.lstsq(X, response.torque[response.window])[0][:-1]
    rows.append(of_source("offset", (with_offset - response.fit.estimates) / 2, CHOSEN))
    return rows


def of_onset(response: EnsembleResponse, timing: PlateTiming, step_s: float) -> Contributions:
    """What an error of all onsets contributes."""
    first = response.window.start
    last = response.window.stop
    earlier = response.estimates_in(slice(first - 1, last - 1))
    later = response.estimates_in(slice(first + 1, last + 1))
    frames = timing.onset_se / step_s
    return of_source("onset", frames * (later - earlier) / 2)
