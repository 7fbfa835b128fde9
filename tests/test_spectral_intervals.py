"""Standard errors, weights and tests of fits to lines, against the scatter of many fits and fits written by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim, lti
from scipy.special import ndtri

from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass
from osl_analysis.spectral import response as spectral
from osl_analysis.spectral.periods import Realisation

PERIOD, RATE, LOW_PASS, COUNT = 4.0, 256.0, LowPass(15), 60
SAMPLES = round(PERIOD * RATE)
LINES, S = np.setdiff1d(np.arange(1, 40, 2), [3, 11, 19, 25, 33]), 2j * np.pi * np.arange(COUNT) / PERIOD
Z, WHITE = 200 + 4 * S + 0.05 * S**2, 2 / np.sqrt(SAMPLES)  # of a line, by white noise of 1 N*m


def made(seed, noise=0.0, periods=4, excited=LINES, impedance=Z, distortion=0.0, extra=None):
    """Lines of random phases, noise at all lines, distortion that repeats at odd ones, and torque `extra`(angle)."""
    rng, X = np.random.default_rng(seed), np.zeros(COUNT, dtype=complex)
    X[excited] = 0.01 * np.exp(2j * np.pi * rng.uniform(size=len(excited)))
    random = rng.standard_normal((2, periods, COUNT)) * noise / np.sqrt(2)
    repeated = rng.standard_normal((2, COUNT)) * distortion / np.sqrt(2) * (np.arange(COUNT) % 2)
    torque = impedance * X + random[0] + 1j * random[1] + repeated[0] + 1j * repeated[1]
    if extra is not None:
        torque += spectrum(extra(in_time(X)))
    torque[:, 0] = torque[:, 0].real
    return Realisation(PERIOD, RATE, np.array([np.tile(X, (periods, 1)), torque]), 0.0)


def in_time(X):
    return np.fft.irfft(X * SAMPLES / 2, SAMPLES)


def spectrum(x):
    return np.fft.rfft(x)[..., :COUNT] * 2 / SAMPLES


def soft(theta):
    return 1e5 * theta**3


def fit_periodic(realisations, low_pass=LOW_PASS):
    return spectral.fit_by_power(spectral.SecondOrder(), spectral.lines_of_periods(realisations, low_pass), (200, 4))


def fitted(one):
    """Eq. 15 fitted to a realisation, and what the fit says of itself."""
    return spectral.fit_structure(spectral.SecondOrder(), spectral.lines_of_periods([one], LOW_PASS), (200, 4))


@pytest.mark.parametrize(("count", "excited", "distortion", "method"), [
    (1, LINES, 0.0, spectral.DETECTION), (2, LINES, 0.05, spectral.DETECTION),
    (1, np.arange(2, 14), 0.0, "excited lines"), (4, LINES, 0.05, spectral.REALISATIONS),
])  # fmt: skip
def test_standard_errors_are_the_scatter_of_many_fits(count, excited, distortion, method):
    seeds = (range(5 * trial, 5 * trial + count) for trial in range(160))
    fits = [fit_periodic([made(k, 0.02, 3, excited, distortion=distortion) for k in one]) for one in seeds]
    assert {f.interval_method for f in fits} == {method}
    se = np.sqrt(np.mean([np.diag(f.covariance)[:3] for f in fits], axis=0))
    of_scatter = np.mean(se / np.std([f.estimates[:3] for f in fits], axis=0))
    assert of_scatter == pytest.approx(1, abs=0.11)  # 160 fits of three estimates: 0.04
    if method == spectral.REALISATIONS:
        assert fits[0].degrees_of_freedom[:3] == pytest.approx(count - 1)


def test_lines_weigh_as_their_power_behind_the_filter_and_realisations_as_their_periods():
    third = Z + 2e-3 * S**3  # no second-order system: weights count
    realisations = [made(1, 0.0, 3, LINES[:9], third), made(2, 0.0, 6, LINES[4:], third)]
    low_pass, rows, y = LowPass(5.0, 3), [], []
    for one, periods in zip(realisations, (3, 6), strict=True):
        for k in np.union1d(LINES[:9], LINES[4:]):
            weight = np.sqrt(periods) * low_pass.gain(k / PERIOD)
            rows.append(weight * one.spectra[0, 0, k] * np.array([1, S[k], S[k] ** 2]))
            y.append(weight * one.spectra[1, 0, k])
    X, y = np.array(rows), np.array(y)
    by_hand = np.linalg.lstsq(np.vstack([X.real, X.imag]), np.concatenate([y.real, y.imag]), rcond=None)[0]
    assert fit_periodic(realisations, low_pass).estimates[:3] == pytest.approx(by_hand, rel=1e-9)


def test_noise_is_taken_off_the_levels():
    # noise in the mean of four periods as large as the distortion
    response, levels = spectral.periodic_response([made(seed, 0.1, distortion=0.05) for seed in range(48)])
    assert levels["noise"] == pytest.approx(0.05, rel=0.06)
    assert response["noise_sd"] == pytest.approx(0.05 / 0.01 / np.sqrt(48), rel=0.25)
    assert response["total_sd"] * np.sqrt(48) == pytest.approx(response["total_level"])
    for name in ("odd", "detection", "distortion"):
        assert levels[name] == pytest.approx(0.05, rel=0.2)
    both = ([made(k, distortion=0.05), made(k + 50, distortion=0.05)] for k in range(24))
    pairs = [spectral.periodic_response(one)[1] for one in both]
    assert np.mean([found["distortion"] ** 2 for found in pairs]) == pytest.approx(0.05**2, rel=0.2)
    assert np.mean(response["odd_level"] ** 2) == pytest.approx((0.05 / 0.01) ** 2, rel=0.25)
    assert np.mean(response["total_level"] ** 2) == pytest.approx(2 * (0.05 / 0.01) ** 2, rel=0.2)


def test_the_test_of_a_record_that_does_not_repeat_itself_has_the_spread_that_it_states():
    scores, m = [], 300
    f = np.arange(1, m + 1) / 20.0
    s = 2j * np.pi * f
    for seed in range(60):
        rng = np.random.default_rng(seed)
        theta, noise = (rng.standard_normal(m) + 1j * rng.standard_normal(m) for _ in range(2))
        record = spectral.lines_of_record((f, theta, (200 + 4 * s + 0.05 * s**2) * theta + noise), LOW_PASS)
        scores.append(ndtri(spectral.fit_structure(spectral.SecondOrder(), record, (200, 4))[1]["misfit_p"]))
    assert record.pooled_freedom == pytest.approx(2 * m * 11 / 17)  # two of each line; parabolas use 6 of 17
    assert (np.mean(scores), np.std(scores)) == (pytest.approx(0, abs=0.45), pytest.approx(1, abs=0.35))


def test_levels_of_a_cube_are_odd_and_those_of_a_square_are_even():
    for power, seen, absent in ((3, "odd", "even"), (2, "even", "odd")):
        _, levels = spectral.periodic_response([made(k, extra=lambda theta, n=power: 1e4 * theta**n) for k in range(8)])
        assert levels[absent] < 1e-6 * levels[seen]
    assert levels["distortion"] < 1e-6 * levels["even"]  # even distortion does not reach odd lines


def test_one_realisation_tells_the_distortion_by_its_detection_lines():
    several = [spectral.periodic_response([made(seed, extra=soft)])[1]["odd"] for seed in range(12)]
    _, levels = spectral.periodic_response([made(seed, extra=soft) for seed in range(12)])
    assert np.sqrt(np.mean(np.square(several))) == pytest.approx(levels["detection"], rel=1e-2)
    response, band = spectral.periodic_response([made(3, extra=soft)])
    assert np.isnan(band["distortion"])
    assert response["total_sd"].mean() * 0.01 == pytest.approx(band["odd"], rel=0.4)


def test_the_test_of_the_misfit_has_its_level_and_sees_a_third_order():
    def probabilities(impedance, periods):
        return np.array([fitted(made(k, 0.1 * WHITE, periods, impedance=impedance))[1]["misfit_p"] for k in range(60)])

    for periods in (2, 4):
        p = probabilities(Z, periods)
        assert np.mean(p < 0.05) < 0.15  # binomial: 3 of 60 expected, 9 once in 300
        assert np.mean(p < 0.5) == pytest.approx(0.5, abs=0.2)
    assert np.mean(probabilities(Z + 1e-3 * S**3, 4) < 0.05) > 0.95
    third = Z + 2e-4 * S**3
    still, *noisy = (fitted(made(k, n, impedance=third))[1] for k, n in enumerate([0.0] + 12 * [2 * WHITE]))
    assert np.mean([one["misfit"] for one in noisy]) == pytest.approx(still["misfit"], rel=0.1)  # else 25 % larger
    assert still["VAF"] == pytest.approx(100 - still["misfit"] ** 2 / 100)
    lines = spectral.lines_of_periods(
        [made(1, WHITE)], LOW_PASS
    )  # the mean of 1/x, x of n degrees, is 1 - 2/n too large
    both = (replace(lines, noise_freedom=np.full(lines.noise.shape, n)) for n in (8.0, np.inf))
    ratio = np.divide(*(spectral.fit_structure(spectral.SecondOrder(), x, (200, 4))[1]["misfit_ratio"] for x in both))
    assert ratio == pytest.approx(1 - 2 / 8)


@pytest.mark.parametrize("noise_steps", [0.0, 1.0])
def test_rounding_counts_where_every_period_repeats_it_and_nowhere_twice(noise_steps):
    # noise of a step makes the rounding differ from period to period: it is in the scatter then
    step, ratios = 4e-4, []
    for seed in range(40):
        one, rng = made(seed, 0.01 * WHITE), np.random.default_rng(1000 + seed)
        noise = noise_steps * rng.standard_normal((4, SAMPLES))
        read = np.round(in_time(one.spectra[0, 0]) / step + noise + rng.uniform()) * step
        rounded = replace(one, spectra=np.array([spectrum(read), one.spectra[1]]), steps=(step, None))
        ratios.append(fitted(rounded)[1]["misfit_ratio"])
    assert np.mean(ratios) == pytest.approx(1, abs=0.2)


def test_a_fit_that_passes_is_weighted_by_noise_and_one_that_fails_by_power():
    (fit, right), (_, wrong) = (fitted(made(1, 0.02 * WHITE, extra=extra)) for extra in (None, soft))
    assert (right["weights"], wrong["weights"]) == ("noise", "power")
    assert right["misfit"] < 0.2 < 2 < wrong["misfit"]
    assert fit.degrees_of_freedom[0] == 2 * 3 * (39 + 8)  # of the scatter of four periods, up to 8 lines away
    for value, name in ((200, "K"), (4, "B"), (0.05, "I")):
        assert abs(fit[name] - value) < 4 * fit.se(name) < 0.01 * value


def test_the_gains_that_made_the_torque_are_recovered_from_eq_9(parameters):
    p, K_1, B_1 = parameters, 24.0, 0.6
    actuator = np.polyval([p.J_m, p.B_m + B_1, K_1 + p.K_s / p.n_T**2], S)
    eq_9 = np.polyval([p.J_j, p.B_j, p.K_s], S) - (p.K_s / p.n_T) ** 2 / actuator
    lines = spectral.lines_of_periods([made(2, 1e-3 * WHITE, impedance=eq_9)], LOW_PASS)
    fit, found = spectral.fit_structure(spectral.RationalDrivetrain(p), lines, (280.0, 5.0))
    assert (fit["K_1"], fit["B_1"]) == (pytest.approx(K_1, rel=1e-3), pytest.approx(B_1, rel=2e-3))
    assert found["misfit_p"] > 0.01
    static = spectral.RationalDrivetrain(p).impedance(fit.estimates, np.zeros(1)).real
    assert static == pytest.approx([K_1 * p.K_s / (K_1 + p.K_s / p.n_T**2)], rel=1e-3)
    with pytest.raises(InputError, match=r"Eq\. 9 of this parameter file cannot render"):
        spectral.fit_structure(spectral.RationalDrivetrain(p), lines, (p.K_s, 5.0))


def test_the_local_polynomial_method_finds_the_response_of_a_simulated_system_within_its_noise():
    """30 s of noise below 8 Hz, by a second library's simulation of a damped system. It takes the torque for linear
    between its samples, four to one of the record: at 8 Hz that is 2e-4 of it."""
    squares, noise, finer = [], [], 4
    keep = slice(round(RATE) * finer, round(31 * RATE) * finer, finer)
    for seed in (1, 2, 3, 4):
        rng, t = np.random.default_rng(seed), np.arange(round(32 * RATE) * finer) / (RATE * finer)
        drive = 0.3 * np.convolve(rng.standard_normal(len(t)), np.hanning(200), "same")
        _, theta, _ = lsim(lti([1.0], [0.05, 4.0, 200.0]), drive, t, interp=True)  # torque/(I s^2 + B s + K)
        torque = drive[keep] + 0.02 * rng.standard_normal(len(drive[keep]))
        record = spectral.record_spectrum(theta[keep], torque, RATE, 15.0)
        response = spectral.local_response(record)
        s = 2j * np.pi * response["frequency_hz"]
        error = response["Z_re"] + 1j * response["Z_im"] - (200 + 4 * s + 0.05 * s**2)
        squares.extend(np.abs(error) ** 2 / response["noise_sd"] ** 2)
        noise.append(spectral.local_fit(record)[2])
    assert len(squares) > 120
    assert np.mean(squares) == pytest.approx(1, abs=0.3)  # 0.1 by theory
    assert np.mean(noise) == pytest.approx(4 * 0.02**2 / (30 * RATE), rel=0.06)
