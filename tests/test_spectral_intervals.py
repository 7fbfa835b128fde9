"""Standard errors, weights and tests of fits to lines, against the scatter of many fits and fits written by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, freqs
from scipy.special import ndtri
from test_spectral_period import LOW_PASS, RATE, multisine, record
from test_spectral_response import LINES, PERIOD

from osl_analysis.bench.moving_record import MovingRecord
from osl_analysis.bench.rendered import rendered_response
from osl_analysis.signals import LowPass
from osl_analysis.spectral.equation_error import DETECTION, EXCITED, PERIODS, REALISATIONS, fit_periodic
from osl_analysis.spectral.models import NOISE, SecondOrder, fit_structure, lines_of_periods, lines_of_record
from osl_analysis.spectral.realisations import Realisation
from osl_analysis.spectral.response import RecordSpectrum, periodic_response

COUNT = 60
S = 2j * np.pi * np.arange(COUNT) / PERIOD
Z = 200 + 4 * S + 0.05 * S**2


def lines(seed, noise, periods=4, excited=LINES, impedance=Z, distortion=0.0, mean=0.0, offset=0.0):
    """A realisation with lines of random phases, torque noise at all lines, and distortion that repeats at odd ones."""
    rng = np.random.default_rng(seed)
    X = np.zeros(COUNT, dtype=complex)
    X[excited] = 0.01 * np.exp(2j * np.pi * rng.uniform(size=len(excited)))
    X[0] = mean
    random = rng.standard_normal((2, periods, COUNT)) * noise / np.sqrt(2)
    repeated = rng.standard_normal((2, COUNT)) * distortion / np.sqrt(2) * (np.arange(COUNT) % 2)
    torque = impedance * X + random[0] + 1j * random[1] + repeated[0] + 1j * repeated[1]
    torque[:, 0] = impedance[0].real * mean + offset + random[0, :, 0]
    return Realisation(PERIOD, 250.0, np.tile(X, (periods, 1)), torque, 0.0)


def of_scatter(fits):
    """Standard errors over the scatter of the estimates, mean of K, B and I."""
    scatter = np.std([f.estimates[:3] for f in fits], axis=0)
    se = np.sqrt(np.mean([np.diag(f.covariance)[:3] for f in fits], axis=0))
    return float(np.mean(se / scatter))


@pytest.mark.parametrize(
    ("count", "excited", "distortion", "method"),
    [
        (1, LINES, 0.0, DETECTION),
        (2, LINES, 0.05, DETECTION),
        (1, np.arange(2, 14), 0.0, EXCITED),
        (4, LINES, 0.05, REALISATIONS),
    ],
)
def test_standard_errors_are_the_scatter_of_many_fits(count, excited, distortion, method):
    fits = [
        fit_periodic([lines(5 * seed + k, 0.02, 3, excited, distortion=distortion) for k in range(count)], LOW_PASS)
        for seed in range(160)
    ]
    assert {f.interval_method for f in fits} == {method}
    assert of_scatter(fits) == pytest.approx(1, abs=0.11)  # 160 fits of three estimates: 0.04
    if method == REALISATIONS:
        assert fits[0].degrees_of_freedom[:3] == pytest.approx(count - 1)


def test_a_fit_weighted_by_noise_has_standard_errors_that_are_its_scatter():
    fits = [fit_structure(SecondOrder(), lines_of_periods([lines(s, 0.02)], LOW_PASS), (200, 4)) for s in range(160)]
    passed = [f.fit for f in fits if f.weights == NOISE]
    assert len(passed) > 140
    assert of_scatter(passed) == pytest.approx(1, abs=0.11)


def test_lines_weigh_as_their_power_behind_the_filter_and_realisations_as_their_periods():
    third = Z + 2e-3 * S**3  # no second-order system: weights count
    made = [lines(1, 0.0, 3, LINES[:9], third), lines(2, 0.0, 6, LINES[4:], third)]
    low_pass = LowPass(5.0, 3)
    _, response = freqs(*butter(3, 5.0, analog=True), worN=np.arange(COUNT) / PERIOD)
    rows, y = [], []
    for one, periods in zip(made, (3, 6), strict=True):
        for k in np.union1d(LINES[:9], LINES[4:]):
            weight = np.sqrt(periods) * abs(response[k]) ** 2
            rows.append(weight * one.theta[0, k] * np.array([1, S[k], S[k] ** 2]))
            y.append(weight * one.torque[0, k])
    X, y = np.array(rows), np.array(y)
    by_hand = np.linalg.lstsq(np.vstack([X.real, X.imag]), np.concatenate([y.real, y.imag]), rcond=None)[0]
    assert fit_periodic(made, low_pass).estimates[:3] == pytest.approx(by_hand, rel=1e-9)


def test_the_offset_is_the_torque_at_angle_zero_and_shares_the_error_of_the_stiffness():
    fit = fit_periodic([lines(1, 0.02, mean=0.1, offset=3.0)], LOW_PASS)
    assert fit["offset"] == pytest.approx(3.0, abs=4 * fit.se("offset"))
    assert fit.cov("K", "offset") == pytest.approx(-0.1 * fit.cov("K", "K"))
    assert fit.se("offset") > 0.1 * fit.se("K")


def test_noise_is_taken_off_the_levels():
    # noise in the mean of four periods as large as the distortion
    made = [lines(seed, 0.1, distortion=0.05) for seed in range(48)]
    response, levels = periodic_response(made)
    assert levels.noise == pytest.approx(0.05, rel=0.06)
    for level in (levels.odd, levels.detection, levels.distortion):
        assert level == pytest.approx(0.05, rel=0.2)
    assert np.mean(response.odd_level**2) == pytest.approx((0.05 / 0.01) ** 2, rel=0.25)
    assert np.mean(response.total_level**2) == pytest.approx(2 * (0.05 / 0.01) ** 2, rel=0.2)


def test_a_motion_with_even_lines_shows_no_even_distortion_apart():
    some = np.array([2, 3, 5, 6, 8, 9, 12, 13, 15, 16])
    response, levels = periodic_response([lines(1, 0.01, excited=some, distortion=0.1)])
    assert np.isnan(levels.even)
    assert np.isnan(response.even_level).all()
    seen = [k for k in range(1, 17) if k not in some]
    only_odd = [k for k in seen if k % 2]
    assert levels.odd == pytest.approx(0.1 * np.sqrt(len(only_odd) / len(seen)), rel=0.6)
    assert np.isfinite(response.odd_level).all()


def test_noise_is_taken_off_the_misfit():
    third = Z + 4e-5 * S**3
    clean = fit_structure(SecondOrder(), lines_of_periods([lines(1, 1e-9, impedance=third)], LOW_PASS), (200, 4))
    noisy = [
        fit_structure(SecondOrder(), lines_of_periods([lines(s, 0.05, impedance=third)], LOW_PASS), (200, 4))
        for s in range(50)
    ]
    assert np.sqrt(np.mean([f.misfit**2 for f in noisy])) == pytest.approx(clean.misfit, rel=0.25)
    assert clean.misfit < 2.0  # as much as the noise


def test_the_test_of_a_record_that_does_not_repeat_itself_has_the_spread_that_it_states():
    scores, m = [], 300
    f = np.arange(1, m + 1) / 20.0
    s = 2j * np.pi * f
    for seed in range(60):
        rng = np.random.default_rng(seed)
        theta, noise = (rng.standard_normal(m) + 1j * rng.standard_normal(m) for _ in range(2))
        spectrum = RecordSpectrum(f, theta, (200 + 4 * s + 0.05 * s**2) * theta + noise)
        scores.append(ndtri(fit_structure(SecondOrder(), lines_of_record(spectrum, LOW_PASS), (200, 4)).p))
    assert np.mean(scores) == pytest.approx(0, abs=0.45)
    assert np.std(scores) == pytest.approx(1, abs=0.35)


def test_periods_beside_a_gap_are_not_in_the_response_of_a_trial():
    theta, torque = record(5, multisine(1, 9))
    usable = np.ones(len(theta), dtype=bool)
    signals = {"theta": theta, "torque": torque}

    def periods():
        facts = {"usable": usable, "trial": "gap", "rate_hz": RATE, "__getitem__": lambda self, name: signals[name]}
        whole, inside = (slice(0, len(theta)),), np.ones(len(theta), dtype=bool)
        trial = MovingRecord(type("Uniform", (), facts)(), theta, torque, None, torque, whole, inside, (0, 6), LOW_PASS)
        return rendered_response(trial, None).models["periods"][0]

    whole = periods()
    usable[round(20.2 * RATE) : round(21.4 * RATE)] = False
    assert (whole, periods()) == (8, 7)


def test_a_stiffness_that_changes_from_period_to_period_widens_the_interval_by_what_fits_of_periods_scatter():
    rng = np.random.default_rng(3)
    one = lines(4, 1e-3, periods=8)
    K = 200 + 10 * rng.standard_normal(8)
    changing = replace(one, torque=one.torque + (K - 200)[:, None] * one.theta)
    fit = fit_periodic([changing], LOW_PASS)
    each = [
        fit_periodic([replace(changing, theta=one.theta[[p, p]], torque=changing.torque[[p, p]])], LOW_PASS)["K"]
        for p in range(8)
    ]
    assert fit.interval_method == PERIODS
    assert fit.se("K") == pytest.approx(np.std(each, ddof=1) / np.sqrt(8), rel=0.01)
    low, high = fit.interval("K")
    assert low < 200 < high
    assert fit_periodic([one], LOW_PASS).interval_method == DETECTION
