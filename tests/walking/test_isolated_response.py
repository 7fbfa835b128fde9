# SPDX-License-Identifier: Apache-2.0
"""Stance, onset and the phase of gait; a response is isolated and predicted, its impedance is the
one that made it."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from conftest import refused_with
from walking_crossings import LEAD, RISE, TURN, crossing
from walking_synthetic import RATE, bump

from osl_analysis.base.errors import IdentifiabilityError
from osl_analysis.walking.impedance_fit import (
    fit_response,
    mean_response,
)
from osl_analysis.walking.isolated_response import (
    DRIFT_ORDERS,
    PHASES,
    aligned_gait,
    isolate_response,
    matched_scales,
    unperturbed_gait,
)
from osl_analysis.walking.plate import Stance, find_stances
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


def walked(name, scale=1.0, onset=None):
    """A crossing at a pace."""
    plain = crossing(name, onset, 0.72 * scale, (K, B, I))
    turn = plain.theta - crossing(name, stance=0.72 * scale).theta
    theta = angle((plain.time - 0.3) / (0.72 * scale)) + turn
    return replace(plain, theta=theta)


def usual():
    return unperturbed_gait([walked(f"u{k}", 1 + 0.02 * np.sin(k)) for k in range(10)], 3)


def mean_gait():
    return unperturbed_gait([crossing(f"u{k}", stance=0.68 + 0.02 * k) for k in range(4)], 3)


def test_a_response_is_zero_on_average_over_the_baseline():
    plain = crossing("w", ONSET)
    shifted = replace(plain, theta=plain.theta + 0.02, torque=plain.torque + 3.0)

    response = response_of(shifted, mean_gait())

    baseline = (response.time >= -0.1 - 1e-9) & (response.time < -0.04 - 1e-9)
    assert np.mean(response.motion.theta[baseline]) == pytest.approx(0, abs=1e-9)
    assert np.mean(response.torque[baseline]) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("onset", [0.6, 0.6017])
def test_the_window_is_a_tenth_of_a_second_from_an_onset_between_frames(
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
        (0.8, (600.0, 12.0, 0.2)),
        (0.66, (340.0, 5.0, -0.03)),
    ],
)
def test_the_impedance_comes_out_whatever_the_pace(stance, truth):
    perturbed_crossings = [
        crossing(f"p{k}", 0.3 + 0.4 * (stance + k / 100), stance + k / 100, impedance=truth)
        for k in range(3)
    ]
    responses = [response_of(c, mean_gait()) for c in perturbed_crossings]

    single = fit_response(responses[0])
    ensemble = fit_response(mean_response(responses))

    assert single.estimates == pytest.approx(truth, rel=1e-3, abs=2e-3)
    assert ensemble.estimates == pytest.approx(truth, rel=1e-3, abs=2e-3)
    assert single.vaf > 99.999


@pytest.mark.parametrize(("onset", "told"), [(None, "onset"), (0.96, "baseline.*window.*0-1")])
def test_no_onset_and_a_response_that_leaves_stance_are_refused(onset, told):
    with refused_with(f"trial p:.*{told}"):
        response_of(crossing("p", onset), mean_gait())


def test_a_response_whose_columns_are_one_is_refused_by_name():
    """Of an exponential, angle, velocity and acceleration are one column."""
    response = response_of(crossing("p0", ONSET), mean_gait())
    exponential = replace(response, thetas=0 * response.thetas + np.exp(20 * response.time))

    with pytest.raises(IdentifiabilityError, match=r"trial p0:.*apart"):
        fit_response(exponential)


def test_plate_errors_that_a_crossing_shares_with_the_mean_gait_cancel():
    def with_errors(plain, size):
        errors = size * np.vander(plain.stance.phase(plain.time), 3).T
        return replace(plain, changes=errors)

    perturbed_crossing = with_errors(crossing("p", 0.6), 2)
    gait = unperturbed_gait(
        [with_errors(crossing(f"u{size}"), size) for size in (1, 2, 3)], fewest=3
    )

    response = response_of(perturbed_crossing, gait)

    np.testing.assert_allclose(response.changes, 0, atol=1e-9)


def trapezoid(start, end):
    """A vertical force [N] that rises and falls by 8 N/ms from and to zero at `start` and `end`
    [s]."""
    return np.clip(np.minimum(TIME - start, end - TIME) * 8000, 0, 800)


def stances(force):
    return [(s.heel_strike, s.toe_off) for s in find_stances(TIME, force, 40, 20, 0.3)]


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
    curves = mean[None, : len(EARLY)]

    scales = [matched_scales(EARLY, curves, mean, order) for order in DRIFT_ORDERS]

    assert np.isnan(scales).all()


def test_a_crossing_without_a_pace_is_refused():
    far = replace(walked("p", onset=0.6), stance=Stance(0.3, 0.3 + 0.45))
    at_heel_strike = replace(walked("p", onset=0.6), onset=0.33)

    for walk in (far, at_heel_strike):
        with refused_with(r"trial p:.*angle.*onset"):
            response_of(walk, usual())
