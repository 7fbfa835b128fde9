# SPDX-License-Identifier: Apache-2.0
"""Stance, onset and the phase of gait; a response is isolated and predicted, its impedance is the
one that made it."""

import zlib
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from conftest import refused_with
from scipy.stats import norm, t
from walking_crossings import LEAD, RISE, TURN, crossing
from walking_synthetic import RATE, bump, settings

from osl_analysis.errors import IdentifiabilityError
from osl_analysis.walking.ensemble import (
    Bootstrap,
    Ensemble,
    group_headline,
    predictor_choice,
    resampling_weights,
    shared_errors,
)
from osl_analysis.walking.impedance_fit import fit_response, offset_share
from osl_analysis.walking.isolated_response import (
    BEHAVIOUR,
    PHASES,
    aligned_gait,
    isolate_response,
    matched_scales,
    unperturbed_gait,
)
from osl_analysis.walking.plate import Stance, find_stances
from osl_analysis.walking.tables import (
    check_fit,
)
from osl_analysis.walking.walking_settings import TimingSettings

K = 340.0
B = 5.0
I = 0.03
TIMING = TimingSettings(window_s=0.1, baseline_s=0.06, guard_s=0.04)
ONSET = 0.6
response_of = partial(isolate_response, timing=TIMING)
EARLY = PHASES[PHASES <= 0.36]
TIME = np.arange(900) / 300


def angle(phase):
    """Ankle angle [rad]: plantarflexion after heel strike, then slow dorsiflexion."""
    return 0.2 * np.sin(2.4 * phase) - 0.12 * np.exp(-(((phase - 0.09) / 0.06) ** 2))


def walked(
    name, scale = 1.0, slow = 0.0, onset = None,
    impedance = (K, B, I),
) :  # fmt: skip
    """A crossing at a pace; its name gives slow deviations: angle `slow` [rad] below 4 Hz, torque
    300 N*m/rad of it."""
    random = np.random.default_rng(zlib.crc32(name.encode()))
    plain = crossing(name, onset, 0.72 * scale, impedance)
    waves = random.uniform(0.3, 4.0, 4)[:, None] * plain.time + random.random((4, 1))
    deviation = slow * random.standard_normal(4) @ np.sin(2 * np.pi * waves) / np.sqrt(2)
    turn = plain.theta - crossing(name, stance=0.72 * scale).theta
    theta = angle((plain.time - 0.3) / (0.72 * scale)) + turn + deviation
    return replace(plain, theta=theta, torque=plain.torque + 300 * deviation)


def usual(slow=0.0, n=10):
    return unperturbed_gait([walked(f"u{k}", 1 + 0.02 * np.sin(k), slow) for k in range(n)], 3)


def mean_gait(n=4):
    return unperturbed_gait([crossing(f"u{k}", stance=0.68 + 0.02 * k) for k in range(n)], 3)


def test_a_response_is_zero_on_average_over_the_baseline():
    plain = crossing("w", ONSET)
    shifted = replace(plain, theta=plain.theta + 0.02, torque=plain.torque + 3.0)

    response = response_of(shifted, mean_gait())

    baseline = (response.time >= -0.1 - 1e-9) & (response.time < -0.04 - 1e-9)
    assert np.mean(response.motion.theta[baseline]) == pytest.approx(0, abs=1e-9)
    assert np.mean(response.torque[baseline]) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("onset", [0.6, 0.6017])
def test_the_window_is_a_tenth_of_a_second_from_the_onset_also_between_frames(
    onset,
):
    response = response_of(crossing("p", onset), mean_gait())

    window = response.time[response.window]
    assert len(window) == 30
    assert window[0] == 0.0
    assert window[-1] == pytest.approx(29 / RATE)
    turn = TURN * bump(window, LEAD, RISE)[0]
    np.testing.assert_allclose(response.fitted_motion.theta, turn, atol=1e-5)


@pytest.mark.parametrize(
    ("stance", "truth"),
    [
        (0.8, (100.0, 0.5, 0.0)),
        (0.66, (340.0, 5.0, -0.03)),
        (0.8, (600.0, 12.0, 0.2)),
    ],
)
def test_the_impedance_comes_out_whatever_the_pace(stance, truth):
    perturbed_crossings = [
        crossing(f"p{k}", 0.3 + 0.4 * (stance + k / 100), stance + k / 100, impedance=truth)
        for k in range(3)
    ]
    responses = [response_of(c, mean_gait()) for c in perturbed_crossings]

    single = fit_response(responses[0])
    ensemble = Ensemble(responses).fitted().fit

    assert single.estimates == pytest.approx(truth, rel=1e-3, abs=2e-3)
    assert ensemble.estimates == pytest.approx(truth, rel=1e-3, abs=2e-3)
    assert single.vaf > 99.999


def test_an_offset_of_the_fit_lowers_K_by_its_share():
    response = response_of(crossing("p", ONSET), mean_gait())

    share = offset_share(response.fitted_motion, response.fitted_torque + 3, 2 * K)

    assert share == pytest.approx(0.5, rel=2e-3)


@pytest.mark.parametrize(("onset", "told"), [(None, "onset"), (0.96, "baseline.*window.*0-1")])
def test_a_crossing_without_an_onset_and_a_response_that_leaves_stance_are_refused(onset, told):
    with refused_with(f"trial p:.*{told}"):
        response_of(crossing("p", onset), mean_gait())


def test_one_response_is_no_ensemble():
    with refused_with(r"ensemble: 1,.*2"):
        Ensemble([response_of(crossing("p0", ONSET), mean_gait())])


def test_a_response_whose_columns_are_one_is_refused_by_name():
    """Of an exponential, angle, velocity and acceleration are one column."""
    response = response_of(crossing("p0", ONSET), mean_gait())
    exponential = replace(response, thetas=np.exp(20 * response.time)[None])

    with pytest.raises(IdentifiabilityError, match=r"trial p0:.*apart"):
        fit_response(exponential)


def test_the_common_variance_is_what_drawing_the_unperturbed_crossings_anew_gives():
    """The bootstrap of the unperturbed crossings alone, of equal responses: the ensemble is then
    their mean. Six crossings leave a bootstrap of 2000 a Monte Carlo error of 3 %, and first order
    10 % of what is not."""
    response = response_of(walked("p", onset=ONSET), usual(2e-3, 6))
    equal = [response, response]

    of_gait, of_plate = shared_errors(equal).common["K"]
    drawn = Ensemble(equal).resampled(2000)

    variance, freedom = of_gait
    assert variance == pytest.approx(np.var(drawn.draws["K"]), rel=0.15)
    assert freedom == 5
    assert of_plate[0] == 0
    # s^2 (1 + 1/6) of a single one
    assert fit_response(response).se("K") ** 2 == pytest.approx(7 * variance)


def test_plate_errors_that_a_crossing_shares_with_the_mean_gait_cancel():
    def with_errors(plain, size):
        errors = size * np.vander(plain.stance.phase(plain.time), 3).T
        return replace(plain, plate_errors=errors)

    perturbed_crossing = with_errors(crossing("p", 0.6), 2)
    gait = unperturbed_gait(
        [with_errors(crossing(f"u{size}"), size) for size in (1, 2, 3)], fewest=3
    )

    response = response_of(perturbed_crossing, gait)

    np.testing.assert_allclose(response.plate_errors, 0, atol=1e-9)


def test_the_plate_s_share_is_the_same_in_every_interval():
    """One perturbation, one mean and the bootstrap's spread, without any scatter of gait. The
    errors are smooth."""
    random = np.random.default_rng(21)
    plain = response_of(crossing("p", 0.6), mean_gait(6))
    frequency = random.uniform(2, 8, (4, 1))
    phase = random.uniform(0, 6, (4, 1))
    errors = np.sin(2 * np.pi * frequency * plain.time + phase)
    response = replace(plain, plate_errors=errors)

    single = fit_response(response)
    variance, freedom = shared_errors([response, response]).common["K"][1]
    drawn = Ensemble([response, response]).resampled(3000)

    assert freedom == 3
    assert single.se("K") == pytest.approx(np.sqrt(variance), rel=0.01)
    assert single.interval_method == "unperturbed crossings + plate trials"
    assert single.degrees_of_freedom == pytest.approx(3, rel=0.05)
    assert np.std(drawn.draws["K"]) == pytest.approx(np.sqrt(variance), rel=0.05)


def test_resampled_means_spread_as_means_do():
    """Drawing n - 1 of n: the variance of a mean, s^2/n with the unbiased s^2; drawing n would give
    5/6 of it."""
    values = np.array([1.0, 4.0, 2.0, 8.0, 5.0, 7.0])

    weights = resampling_weights(np.random.default_rng(1), 50_000, len(values))

    np.testing.assert_allclose(weights.sum(axis=1), 1)
    assert np.var(weights @ values) == pytest.approx(np.var(values, ddof=1) / len(values), rel=0.04)


def test_the_interval_of_normal_draws_is_student_s():
    draws = norm.ppf((np.arange(20_000) + 0.5) / 20_000, loc=300, scale=2)

    interval = Bootstrap({"K": draws}, degrees_of_freedom=9).interval("K")

    assert interval == pytest.approx(300 + 2 * t.ppf([0.025, 0.975], 9), abs=0.01)


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
    return [response_of(c, gait) for c in walked]


def test_lasting_deviations_are_predicted():
    """They cost the mean baseline 2 % of K or more, noise is left. The interval is narrower and
    holds the truth."""
    isolated = isolated_all()
    ensemble = Ensemble(isolated)

    choice = predictor_choice(isolated, ensemble.fitted().fit)
    chosen = choice.of_all
    mean = ensemble.fitted().fit["K"]
    predicted = ensemble.fitted(chosen).fit["K"]
    mean_draws = ensemble.resampled(300)
    predicted_draws = ensemble.resampled(300, choice)

    assert predicted == pytest.approx(K, rel=0.01)
    assert abs(mean / K - 1) > 2 * abs(predicted / K - 1)
    low, high = predicted_draws.interval("K")
    assert low < K < high
    assert predicted_draws.se("K") < 0.5 * mean_draws.se("K")


def test_predictors_cost_degrees_of_freedom():
    isolated = 2 * isolated_all()
    ensemble = Ensemble(isolated)

    choice = predictor_choice(isolated, ensemble.fitted().fit)

    assert choice.of_all
    assert ensemble.resampled(100, choice).degrees_of_freedom == 9 - len(choice.of_all)


def test_two_unperturbed_crossings_predict_nothing():
    ensemble = Ensemble(isolated_all())
    two = np.eye(10)[:2].mean(axis=0)
    weights = np.full(6, 1 / 6)

    _, mean = ensemble.joined(weights, two)
    _, predicted = ensemble.joined(weights, two, BEHAVIOUR)

    np.testing.assert_allclose(mean, predicted, atol=1e-12)


def test_six_unperturbed_crossings_predict_nothing():
    isolated = isolated_all(usual=6)

    chosen = predictor_choice(isolated, Ensemble(isolated).fitted().fit).of_all

    assert chosen == ()


@pytest.fixture(scope="module")
def headline():
    """Of eight sound crossings."""
    perturbed = [walked(f"p{k}", 1.0, 2e-3, ONSET, (K, 3.0, 0.02)) for k in range(8)]
    return group_headline(perturbed, usual(2e-3, 8), settings(window_s=0.1))


@pytest.fixture(scope="module")
def sound(headline):
    return check_fit(headline)


def test_sound_crossings_are_far_from_every_limit(sound):
    assert sound.residual_over_gait is None
    assert abs(sound.offset_share) < 0.1
    assert sound.K_se_share < 0.1
    assert abs(sound.stance_change) < 0.015
    assert sound.coherence > 0.95
    assert sound.VAF > 99
    assert sound.B_high > 2


def trapezoid(start, end):
    """A vertical force [N] that rises and falls by 8 N/ms from and to zero at `start` and `end`
    [s]."""
    return np.clip(np.minimum(TIME - start, end - TIME) * 8000, 0, 800)


def stances(force, shortest=0.3):
    return [(s.heel_strike, s.toe_off) for s in find_stances(TIME, force, 40, 20, shortest)]


WHOLE = trapezoid(0.9, 1.6)
EARLY_STEP = trapezoid(-1.0, 0.6)
LATE_STEP = trapezoid(2.5, 4.0)
SHORT_STEP = trapezoid(2.2, 2.3)


def test_heel_strike_and_toe_off_lie_between_frames():
    """A rise of 8 N/ms passes 40 N 5 ms after contact, the fall passes 20 N 2.5 ms before it
    ends."""
    (stance,) = stances(trapezoid(0.9012, 1.6187))

    assert stance == pytest.approx((0.9062, 1.6162), abs=1e-9)


# Below `on` and above `off` the foot stays; above `off` and below `on` nobody steps there


@pytest.mark.parametrize(
    "force",
    [
        np.select([TIME == TIME[330], (TIME >= 2.0) & (TIME < 2.03)], [30.0, 35.0], WHOLE),
        WHOLE + SHORT_STEP,  # a short contact
        EARLY_STEP + WHOLE + LATE_STEP,  # cut stances
    ],
)
def test_one_whole_stance_is_found_among_what_is_none(force):
    (stance,) = stances(force)

    assert stance == pytest.approx((0.905, 1.5975), abs=1e-6)


def test_a_contact_that_is_long_enough_is_a_stance():
    assert len(stances(WHOLE + SHORT_STEP, shortest=0.05)) == 2


def stance_of(crossing):
    """The duration of stance of the crossing's pace on the mean gait."""
    return aligned_gait(crossing, usual(), crossing.onset - TIMING.guard_s).stance


@pytest.mark.parametrize(("slower", "lingers"), [(0.85, 1.08), (1.0, 0.92), (1.15, 1.0)])
def test_the_matched_stance_is_right_for_any_pace_and_any_end_of_stance(slower, lingers):
    """The crossing is slower throughout, its toe-off comes late, or both."""
    late = walked("p", slower, onset=0.3 + 0.42 * 0.72 * slower)
    late = replace(late, stance=Stance(0.3, 0.3 + lingers * 0.72 * slower))

    response = response_of(late, usual())

    assert stance_of(late) == pytest.approx(0.72 * slower, rel=1e-4)
    assert response.stance_change == pytest.approx(lingers - 1, abs=1e-3)
    assert fit_response(response).estimates[:2] == pytest.approx((K, B), rel=2e-3)


@pytest.mark.parametrize(("instant", "is_used"), [(-0.034, False), (-0.05, True)])
def test_the_guard_before_the_onset_is_not_used(instant, is_used):
    """The filter spreads the response into its 40 ms."""
    plain = walked("p", onset=0.3 + 0.42 * 0.72)
    bumped = plain.theta + 0.02 * bump(plain.time, plain.onset + instant, 0.003)[0]

    late = replace(plain, theta=bumped)
    response = response_of(plain, usual())
    other = response_of(late, usual())

    assert (abs(stance_of(late) / stance_of(plain) - 1) > 1e-4) == is_used
    assert (np.abs(other.behaviour - response.behaviour)[0].max() > 1e-5) == is_used


@pytest.mark.parametrize(
    "mean",
    [
        0 * PHASES,  # nothing
        0 * PHASES + 0.2,  # it stands still
        0.3 - 0.1 * PHASES,  # it drifts
    ],
)
def test_a_gait_that_tells_no_pace_has_no_scale(mean):
    curves = np.array([mean[: len(EARLY)]] * 3)

    assert np.isnan(matched_scales(EARLY, curves, mean)).all()


def test_a_crossing_without_a_pace_is_refused():
    far = replace(walked("p", onset=0.6), stance=Stance(0.3, 0.3 + 0.45))
    at_heel_strike = replace(walked("p", onset=0.6), onset=0.33)

    for walk in (far, at_heel_strike):
        with refused_with(r"trial p:.*angle.*onset"):
            response_of(walk, usual())
