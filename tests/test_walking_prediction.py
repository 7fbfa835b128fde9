"""A crossing's own behaviour before the onset predicts what it would have done, where gait varies that way."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from test_walking_response import TIMING, K, crossing
from walking_crossings import Walk, campaign, several
from walking_synthetic import settings

from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.ensemble import (
    bootstrap,
    cross_validated,
    ensemble_response,
    group_headline,
    left_out_error,
    predicting_weights,
)
from osl_analysis.walking.gait import UnperturbedGait, unperturbed_gait
from osl_analysis.walking.response import BEHAVIOUR, PerturbationResponse, isolate_response
from osl_analysis.walking.tables import headline_rows

ONSET = 0.6
FITS = pl.DataFrame({name: 6 * [1.0] for name in ("K", "B", "I", "VAF")})


def walked(seed: int, perturbed: bool = False, lasting: bool = True, sign: int = 1) -> Crossing:
    """A crossing with deviations of angle and torque from the mean that grow from heel strike on. Where they are not
    lasting, others take their place, with the same rate of growth, in the last 10 ms of the baseline."""
    random = np.random.default_rng(seed)
    plain, usual = crossing(f"c{seed}", ONSET if perturbed else None), crossing("usual")
    before, after = random.standard_normal((2, 2))
    changed = 0.0 if lasting else 0.5 * (1 + np.tanh((plain.time - ONSET + 0.02) / 0.01))
    angle, torque = (1 - changed) * before[:, None] + changed * after[:, None]
    growth = 1 + 4 * (plain.time - 0.3)
    theta = usual.theta + sign * (plain.theta - usual.theta) + 0.004 * angle * growth
    answer = usual.torque + sign * (plain.torque - usual.torque) + 2.0 * torque * growth
    noise = 0.05 * random.standard_normal(len(plain.time))
    return replace(plain, theta=theta, torque=answer + noise, turn=0.087 * sign if perturbed else None)


def gait(lasting: bool = True) -> UnperturbedGait:
    return unperturbed_gait([walked(seed, lasting=lasting) for seed in range(10)], 3)


def perturbed(signs: tuple[int, ...] = (1,), lasting: bool = True) -> list[Crossing]:
    return [walked(100 + k, True, lasting, signs[k % len(signs)]) for k in range(6)]


def responses(signs: tuple[int, ...] = (1,), lasting: bool = True) -> list[PerturbationResponse]:
    usual = gait(lasting)
    return [isolate_response(c, usual, TIMING) for c in perturbed(signs, lasting)]


@pytest.mark.parametrize("signs", [(1,), (1, 1, -1)])
def test_lasting_deviations_are_predicted_for_one_direction_and_for_both(signs: tuple[int, ...]) -> None:
    """They cost the mean baseline 2 % of K or more; what is left of them is the noise's."""
    isolated = responses(signs)
    found = cross_validated(isolated, ensemble_response(isolated).fit)
    assert found.predictors
    assert found.share > 0.9
    mean, predicted = (ensemble_response(isolated, names).fit.K for names in ((), found.predictors))
    assert predicted == pytest.approx(K, rel=0.01)
    assert abs(mean / K - 1) > 2 * abs(predicted / K - 1)


def test_the_interval_is_narrower_and_still_holds_the_truth() -> None:
    isolated = responses()
    names = cross_validated(isolated, ensemble_response(isolated).fit).predictors
    mean, predicted = (bootstrap(isolated, 300, chosen) for chosen in ((), names))
    low, high = predicted.interval("K")
    assert low < K < high
    assert predicted.se("K") < 0.5 * mean.se("K")
    assert bootstrap(2 * isolated, 100, names).degrees_of_freedom == 9 - len(names)


def test_deviations_that_begin_anew_are_not_predicted() -> None:
    isolated = responses(lasting=False)
    found = cross_validated(isolated, ensemble_response(isolated).fit)
    assert found.share < 0.35
    if found.predictors:  # ten crossings can look alike by chance: then the interval has to hold the truth
        low, high = bootstrap(isolated, 300, found.predictors).interval("K")
        assert low < K < high


def test_too_few_unperturbed_crossings_predict_nothing() -> None:
    few = unperturbed_gait([walked(seed) for seed in range(6)], 3)
    isolated = [isolate_response(c, few, TIMING) for c in perturbed()]
    found = cross_validated(isolated, ensemble_response(isolated).fit)
    assert (found.predictors, found.share) == ((), 0.0)


def test_the_weights_are_those_of_the_weighted_regression_at_no_difference() -> None:
    random = np.random.default_rng(1)
    behaviour, curves = random.standard_normal((2, 9)) + 0.4, random.standard_normal((9, 5))
    given = random.multinomial(8, np.full(9, 1 / 9)) / 8
    root = np.sqrt(given)[:, None]
    columns = np.column_stack([np.ones(9), behaviour.T])
    intercept = np.linalg.lstsq(root * columns, root * curves, rcond=None)[0][0]
    found = predicting_weights(behaviour, given)
    np.testing.assert_allclose(found @ curves, intercept, atol=1e-12)
    np.testing.assert_allclose([found.sum(), *(behaviour @ found)], [1, 0, 0], atol=1e-12)


def test_weights_stay_where_nothing_or_too_little_tells_the_crossings_apart() -> None:
    alike, two = np.full(9, 1 / 9), np.array([0.5, 0.5, 0, 0, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(predicting_weights(np.zeros((1, 9)), alike), alike, atol=1e-12)
    assert predicting_weights(np.empty((0, 9)), alike) is alike
    assert predicting_weights(np.arange(9.0)[None], two) is two


def test_the_error_left_out_is_that_of_regressions_without_each_crossing() -> None:
    random = np.random.default_rng(2)
    behaviour, curves = random.standard_normal((2, 8)), random.standard_normal((8, 4))
    errors = []
    for k in range(8):
        others = np.arange(8) != k
        columns = np.column_stack([np.ones(8), behaviour.T])
        fitted = np.linalg.lstsq(columns[others], curves[others], rcond=None)[0]
        errors.append(curves[k] - columns[k] @ fitted)
    assert left_out_error(behaviour, curves) == pytest.approx(np.mean(np.square(errors)), rel=1e-10)


def test_behaviour_is_what_the_crossing_did_up_to_30_ms_before_the_onset() -> None:
    """A crossing that differs by a constant angle and a torque that grows: the first is a level, the second a slope."""
    usual = unperturbed_gait([crossing(f"u{k}") for k in range(4)], 3)
    plain = crossing("p", ONSET, angle=0.05)
    tilted = replace(plain, torque=plain.torque + 30 * (plain.time - ONSET))
    found = dict(zip(BEHAVIOUR, isolate_response(tilted, usual, TIMING).behaviour, strict=True))
    np.testing.assert_allclose(found["angle"], 0.05, atol=1e-4)
    np.testing.assert_allclose(found["torque_slope"], 30, rtol=0.02)
    np.testing.assert_allclose(found["angle_slope"], 0, atol=2e-3)
    jump = replace(tilted, torque=tilted.torque + 50 * (tilted.time > ONSET - 0.02))
    np.testing.assert_allclose(
        isolate_response(jump, usual, TIMING).behaviour, list(found.values()), rtol=1e-6, atol=0.05
    )


def test_the_settings_choose_the_headline_and_the_table_has_both(tmp_path: Path) -> None:
    """The rows of the headline are equal to those of the baseline that the configuration names."""
    results = {
        b: group_headline(perturbed(), gait(), settings(baseline=b, window_s=0.1)) for b in ("mean", "predicted")
    }
    assert results["mean"].ensemble.fit.K == results["predicted"].mean_gait[0].fit.K
    assert results["predicted"].ensemble.fit.K == results["mean"].predicted_gait[0].fit.K
    assert results["predicted"].ensemble.fit.K != results["mean"].ensemble.fit.K
    rows = {b: [str(row["estimator"]) for row in headline_rows(r, FITS, {})] for b, r in results.items()}
    assert "ensemble, predicted gait" in rows["mean"]
    assert "ensemble, mean gait" in rows["predicted"]
    walks = several("p", 4, Walk(phase=0.4)) | several("u", 6, Walk())
    tables = campaign(tmp_path, walks, bootstrap_samples=100)
    assert tables.estimate("all")["mean"] == tables.estimate("all", estimator="ensemble, predicted gait")["mean"]
    assert tables["groups"]["predicted_share"][0] == 0
