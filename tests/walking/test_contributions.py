# SPDX-License-Identifier: Apache-2.0
"""The mean response has one budget: its interval is the sum of what is measured, and what is not is
listed with its size."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t
from walking_crossings import Walk, crossing, several, walked
from walking_synthetic import settings

from osl_analysis.walking.crossing import PER_UNIT
from osl_analysis.walking.impedance_fit import fit_response, mean_response
from osl_analysis.walking.isolated_response import isolate_response, unperturbed_gait
from osl_analysis.walking.plate_inertia import NO_CORRECTION
from osl_analysis.walking.plate_lag import PlateTiming
from osl_analysis.walking.tables import group_headline, headline_of_responses, result_columns

K, B, I = 340.0, 5.0, 0.03
UNKNOWN = PlateTiming({}, {})
ONSET = 0.6
TIMING = settings(window_s=0.1)


def responses(perturbed=8, unperturbed=8):
    """Isolated responses of crossings by formula, each with its own gait."""
    gait = [walked(name, walk) for name, walk in several("u", unperturbed, Walk()).items()]
    turned = [walked(name, walk) for name, walk in several("p", perturbed, Walk(0.4)).items()]
    mean = unperturbed_gait(gait, 3)
    return [isolate_response(crossing, mean, TIMING) for crossing in turned]


def contribution_from(budget, source):
    (headline_fit,) = budget.from_source(source)
    return headline_fit


def test_the_scatter_of_the_crossings_is_that_of_their_single_fits():
    isolated = responses()

    budget = headline_of_responses(isolated, NO_CORRECTION, UNKNOWN).ensemble.budgets["K"]

    singles = [fit_response(response)["K"] for response in isolated]
    crossings_row = contribution_from(budget, "crossings")
    assert crossings_row.standard == pytest.approx(np.std(singles, ddof=1) / np.sqrt(8), rel=0.05)
    assert crossings_row.freedom == 7


def test_the_scatter_of_the_mean_gait_is_that_of_unperturbed_crossings():
    """Of equal responses, whose torques without each unperturbed crossing Eq. 15 is fitted to."""
    (response,) = responses(1, 6)

    budget = headline_of_responses([response] * 2, NO_CORRECTION, UNKNOWN).ensemble.budgets["K"]

    gait_row = contribution_from(budget, "mean_gait")
    alike = np.ones((6, 1))
    singles = [
        fit_response(replace(response, thetas=theta * alike, torques=torque * alike))["K"]
        for theta, torque in zip(response.thetas, response.torques, strict=True)
    ]
    assert gait_row.standard == pytest.approx(np.std(singles, ddof=1) / np.sqrt(6), rel=0.05)
    assert gait_row.freedom == 5
    assert budget.half_width() == pytest.approx(t.ppf(0.975, 5) * gait_row.standard)


def test_the_trials_of_the_plate_count_as_leaving_out_each_does():
    (response,) = responses(1, 6)
    waves = np.sin(2 * np.pi * np.linspace(2, 8, 4)[:, None] * response.time)
    changed = replace(response, changes=np.vstack([waves, response.changes]))

    budget = headline_of_responses([changed] * 2, NO_CORRECTION, UNKNOWN).ensemble.budgets["K"]

    without = [
        fit_response(replace(response, torques=response.torques + wave))["K"] for wave in waves
    ]
    plate_row = contribution_from(budget, "plate_inertia")
    assert plate_row.freedom == 3
    assert plate_row.standard == pytest.approx(np.std(without) * np.sqrt(3))


def test_an_uncertain_lag_changes_the_damping_as_a_late_torque_does():
    (response,) = responses(1, 6)
    later = np.gradient(response.torque, response.time)
    changes = np.zeros((len(PER_UNIT), len(response.time)))
    changes[PER_UNIT.index("plate_lag")] = 1e-3 * later
    uncertain = replace(response, changes=changes)
    timing = replace(UNKNOWN, se=0.5e-3)

    budget = headline_of_responses([uncertain] * 2, NO_CORRECTION, timing).ensemble.budgets["B"]

    late = fit_response(replace(response, torques=response.torques + 0.5e-3 * later))
    assert contribution_from(budget, "plate_lag").standard == pytest.approx(
        abs(late["B"] - budget.value)
    )


def test_what_nobody_has_measured_is_listed_with_its_size_per_unit():
    (response,) = responses(1, 6)
    theta_changes = (
        np.ones((len(PER_UNIT), 1)) * response.motion.theta
    )  # a change of K by 1 N*m/rad
    changed = replace(response, changes=theta_changes)

    budgets = headline_of_responses([changed] * 2, NO_CORRECTION, UNKNOWN).ensemble.budgets

    assert [(row.source, row.per) for row in budgets["K"].unknown[1:]] == [
        ("walking_unseen", "1 N*m/rad per mm of the foot's place"),
        ("plate_unseen", "1 N*m/rad per kg"),
        ("plate_unseen", "1 N*m/rad per ms"),
        ("plate_unseen", "1 N*m/rad per mm"),
    ]


def test_a_window_and_an_offset_are_in_no_interval():
    budget = headline_of_responses(responses(), NO_CORRECTION, UNKNOWN).ensemble.budgets["K"]

    chosen = [row.source for row in budget.in_parts("motion")]
    assert chosen == ["window", "offset"]
    without_motion = replace(budget, contributions=tuple(budget.in_parts("repeatability", "bench")))
    assert budget.half_width() == without_motion.half_width()


def test_the_share_of_an_offset_is_what_it_changes_of_K():
    headline_fit = headline_of_responses(responses(), NO_CORRECTION, UNKNOWN)
    mean = headline_fit.ensemble.response
    columns = np.column_stack([mean.fitted_motion.columns, np.ones_like(mean.fitted_torque)])
    (K_with_offset, *_), *_ = np.linalg.lstsq(columns, mean.fitted_torque)
    K_alone = fit_response(mean)["K"]

    row = result_columns({"onset_phase": 0.4, "stance_s": 0.7}, headline_fit)

    assert row["offset_share"] == pytest.approx(abs(K_with_offset / K_alone - 1))


@pytest.mark.parametrize("frames", [1, 2])
def test_an_onset_that_is_uncertain_by_so_many_frames_moves_the_window(frames):
    timing = replace(UNKNOWN, onset_se=frames / 300)
    isolated = responses()

    budget = headline_of_responses(isolated, NO_CORRECTION, timing).ensemble.budgets["K"]

    mean = mean_response(isolated)
    later = slice(mean.window.start + frames, mean.window.stop + frames)
    moved = abs(fit_response(replace(mean, window=later))["K"] - budget.value)
    assert contribution_from(budget, "onset").standard == pytest.approx(moved, rel=0.5)


def deviating(seed, perturbed=False):
    """Deviations of angle and torque grow from heel strike."""
    random = np.random.default_rng(seed)
    plain = crossing(f"c{seed}", ONSET if perturbed else None)
    sizes, _ = random.standard_normal((2, 2))
    angle, torque = sizes[:, None] * (1 + 4 * (plain.time - 0.3))
    noise = 0.05 * random.standard_normal(len(plain.time))
    return replace(
        plain, theta=plain.theta + 0.004 * angle, torque=plain.torque + 2.0 * torque + noise
    )


def isolated_all(usual=10):
    gait = unperturbed_gait([deviating(seed) for seed in range(usual)], 3)
    walked = [deviating(100 + k, True) for k in range(6)]
    return [isolate_response(c, gait, TIMING) for c in walked]


def headline(isolated):
    return headline_of_responses(isolated, NO_CORRECTION, UNKNOWN)


def test_lasting_deviations_are_predicted():
    """They cost the mean baseline 2 % of K or more, noise is left. The interval is narrower and
    holds the truth."""
    headline_fit = headline(isolated_all())

    mean, predicted = headline_fit.ensemble.budgets["K"], headline_fit.predicted.budgets["K"]
    assert predicted.value == pytest.approx(K, rel=0.01)
    assert abs(mean.value / K - 1) > 2 * abs(predicted.value / K - 1)
    assert predicted.low < K < predicted.high
    assert predicted.half_width() < 0.5 * mean.half_width()


def test_predictors_cost_degrees_of_freedom():
    isolated = 2 * isolated_all()

    headline_fit = headline(isolated)

    freedom = contribution_from(headline_fit.predicted.budgets["K"], "mean_gait").freedom
    assert freedom in (9 - 1, 9 - 2)
    assert contribution_from(headline_fit.ensemble.budgets["K"], "mean_gait").freedom == 9


def test_six_unperturbed_crossings_predict_nothing():
    headline_fit = headline(isolated_all(usual=6))

    assert headline_fit.predicted.budgets["K"] == headline_fit.ensemble.budgets["K"]


@pytest.mark.parametrize(
    ("inertia", "has_drivetrain", "doubts"),
    [
        (-0.03, False, {"B", "I"}),
        (-0.03, True, set()),
        (0.03, False, set()),
    ],
)
def test_a_negative_inertia_without_a_drivetrain_is_a_doubt_about_the_lag(
    inertia, has_drivetrain, doubts
):
    gait = [walked(name, walk) for name, walk in several("u", 8, Walk()).items()]
    turn = Walk(0.4, impedance=(K, B, inertia))
    turned = [walked(name, walk) for name, walk in several("p", 8, turn).items()]
    mean = unperturbed_gait(gait, 3)

    headline_fit = group_headline(turned, mean, TIMING, NO_CORRECTION, UNKNOWN, has_drivetrain)

    verdicts = {
        name: budget.verdict(0.1 * abs(budget.value)).name
        for name, budget in headline_fit.ensemble.budgets.items()
    }
    assert {name for name, verdict in verdicts.items() if verdict == "late_torque"} == doubts
