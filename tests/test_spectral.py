"""The period of a motion that repeats itself, its realisations, and the frequency response of any
motion."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from any_motion import chirp
from scipy.signal import lsim, lti

from osl_analysis.bench.frequency_response import RESPONSE_COLUMNS, impedance_over_frequency
from osl_analysis.bench.record import record_of
from osl_analysis.bench.row_groups import stretches_of
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.signals import LowPass
from osl_analysis.spectral.periods import (
    Realisation,
    distinct,
    lines_of,
    period_spectra,
    periodic_motion,
)
from osl_analysis.spectral.response import (
    local_fit,
    local_response,
    periodic_response,
    record_spectrum,
)

RATE = 250.0
PERIOD = 4.0
LINES = np.array([3, 5, 9, 11, 13, 17, 21, 23, 27, 29])
LOW_PASS = LowPass(15)
HIGHEST_HZ = 10.0
K = 200.0
B = 4.0
I = 0.05


# ---- Records of a joint in closed form


def multisine(seed: int, periods: float = 5, ppm: float = 0.0):
    """theta, omega, alpha (3, n) of a random-phase multisine on a clock that is fast by ppm;
    derivatives by hand."""
    time = np.arange(round(periods * PERIOD * RATE)) / RATE * (1 + 1e-6 * ppm)
    w = 2 * np.pi * LINES / PERIOD
    phase = np.outer(time, w) + np.random.default_rng(seed).uniform(0, 2 * np.pi, len(LINES))
    size = 0.05 / np.sqrt(len(LINES))
    theta = size * np.cos(phase).sum(axis=1)
    omega = -size * np.sin(phase) @ w
    alpha = -size * np.cos(phase) @ w**2
    return np.array([theta, omega, alpha])


def record(seed: int, *motions, noise: float = 0.0):
    """Angle and torque (n,) of motions one after another, each after a second of rest and a ramp of
    a second."""
    rest = np.zeros((3, round(RATE)))
    parts = []
    for motion in motions:
        ramp = np.minimum(np.arange(motion.shape[1]) / RATE, 1.0)
        parts.extend([rest, ramp * motion])
    theta, omega, alpha = np.hstack([*parts, rest])
    random = np.random.default_rng(seed)
    torque = K * theta + B * omega + I * alpha + noise * random.standard_normal(len(theta))
    return theta + 1e-5 * random.standard_normal(len(theta)), torque


def eq15(frequency_hz):
    s = 2j * np.pi * np.asarray(frequency_hz)
    return K + B * s + I * s**2


def smooth_noise(seed, n):
    return np.convolve(np.random.default_rng(seed).standard_normal(n), np.hanning(60), "same")


# ---- The period


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("ppm", [100.0, -100.0])
def test_the_period_on_a_wrong_clock_is_found_to_less_than_a_millionth(ppm, seed):
    theta, torque = record(seed, multisine(seed, 6, ppm))

    motion = periodic_motion(theta, torque, RATE, HIGHEST_HZ)

    assert [r.periods for r in motion.realisations] == [5]
    error_ppm = 1e6 * (motion.period / PERIOD * (1 + 1e-6 * ppm) - 1)
    assert abs(error_ppm) < 0.4


T = np.arange(round(40 * RATE)) / RATE
WITHOUT_PERIOD = {
    "chirp": np.sin(np.pi * 0.1 * T**2),
    "noise": smooth_noise(4, len(T)),
    "rest": np.zeros(len(T)),
    "once": multisine(5, 1.5)[0],
    # a sine whose period changes by 5 %
    "by hand": np.sin(2 * np.pi * 1.2 * T + 2e-2 * np.cumsum(smooth_noise(4, len(T))) / RATE),
}


@pytest.mark.parametrize("theta", WITHOUT_PERIOD.values(), ids=WITHOUT_PERIOD)
def test_what_does_not_repeat_itself_has_no_period(theta):
    assert periodic_motion(theta, theta, RATE, HIGHEST_HZ) is None


@pytest.mark.parametrize(("periods", "other_s", "size", "repeats"), [
    (5, 10.0, 0.6, True), (3, 22.0, 0.6, False), (3, 22.0, 0.05, True),
])  # fmt: skip
def test_a_motion_has_a_period_if_it_repeats_itself_half_of_its_time(
    periods, other_s, size, repeats
):
    """A multisine, 20 s of 30 or 12 s of 34, and then noise that repeats nothing, of this part of
    its size. A twentieth is a rest."""
    repeated, _, _ = multisine(1, periods)
    noise = smooth_noise(2, round(other_s * RATE))
    noise *= size * np.std(repeated) / np.std(noise)
    theta = np.concatenate([repeated, noise])

    found = periodic_motion(theta, theta, RATE, HIGHEST_HZ)

    assert (found is not None) == repeats
    if found is not None:
        assert found.period == pytest.approx(PERIOD, rel=1e-3)


# ---- Realisations


@pytest.fixture(scope="module")
def three_motions():
    """Two motions of one period, the first of them again, shifted."""
    first = multisine(1)
    theta, torque = record(3, first, multisine(2), np.roll(first, 300, axis=1))
    return periodic_motion(theta, torque, RATE, HIGHEST_HZ).realisations


def test_several_motions_of_one_period_are_as_many_realisations(three_motions):
    assert [r.periods for r in three_motions] == [4, 4, 4]


def test_a_realisation_begins_after_the_rest_and_ends_with_its_motion(three_motions):
    """After a second of rest, and a ramp within the first period; what is over is left out."""
    starts = np.array([r.start for r in three_motions])

    assert np.diff(starts) == pytest.approx([21, 21], abs=0.2)
    assert starts + 4 * PERIOD == pytest.approx([21, 42, 63], abs=0.3)
    assert 2 < starts[0] < 1 + PERIOD + 0.1


def test_a_motion_recorded_twice_counts_once_with_the_periods_of_both(three_motions):
    joined = distinct(three_motions)

    assert [r.periods for r in joined] == [8, 4]
    theta = joined[0].spectra[0][:, LINES]
    deviation = np.abs(theta - theta.mean(axis=0))
    assert deviation.max() < 1e-3 * np.abs(theta).min()


# ---- Lines


def test_lines_are_those_that_were_excited_and_the_others_odd_and_even():
    theta, torque = record(6, multisine(1))

    lines = lines_of(periodic_motion(theta, torque, RATE, HIGHEST_HZ).realisations)

    assert lines.only_odd
    assert np.flatnonzero(lines.excited).tolist() == LINES.tolist()
    assert np.flatnonzero(lines.odd).tolist() == [7, 15, 19, 25]
    assert np.flatnonzero(lines.even).tolist() == list(range(2, 29, 2))


def test_spectra_of_a_period_that_is_no_whole_number_of_samples_leak_nothing():
    samples = 333.37
    first = 100.6
    k = np.array([2, 7])
    w = 2 * np.pi * k / samples
    t = np.arange(2000)
    signal = 3 + 0.5 * np.cos(w[0] * t + 0.3) + 0.1 * np.sin(w[1] * t)

    X = period_spectra(signal, first, samples, periods=4, lines=20)

    # every period begins at the same phase
    expected = np.array([0.5 * np.exp(0.3j), -0.1j]) * np.exp(1j * w * first)
    assert X[:, 0] == pytest.approx(3, abs=1e-6)
    for period in X:
        assert period[k] == pytest.approx(expected, abs=1e-6)


def test_drift_of_the_load_cell_does_not_reach_the_lines():
    theta, torque = record(7, multisine(1))
    drift = 0.2 * np.arange(len(torque)) / RATE

    (still,) = periodic_motion(theta, torque, RATE, HIGHEST_HZ).realisations
    (drifting,) = periodic_motion(theta, torque + drift, RATE, HIGHEST_HZ).realisations

    assert drifting.mean_lines[1, LINES] == pytest.approx(still.mean_lines[1, LINES], rel=1e-6)


# ---- The table of a trial


def recorded(name, theta, torque):
    """A record of a trial, with its periodic motion."""
    groups = stretches_of([slice(0, len(theta))], RATE)
    time = np.arange(len(theta)) / RATE
    trial = record_of(name, time, theta, torque, LOW_PASS, groups)
    periodic = periodic_motion(theta, torque, RATE, LOW_PASS.cutoff_hz)
    return replace(trial, torque=torque, periodic=periodic)


@pytest.fixture(scope="module")
def of_two_motions():
    theta, torque = record(3, multisine(1), multisine(2), noise=0.02)
    return recorded("M", theta, torque)


def test_the_response_of_a_periodic_trial_has_a_row_per_excited_line(of_two_motions):
    table = impedance_over_frequency(of_two_motions)

    frequency = table["frequency_hz"].to_numpy()
    below_cut_off = LINES[LINES / PERIOD <= LOW_PASS.cutoff_hz] / PERIOD
    assert dict(table.schema) == RESPONSE_COLUMNS
    assert frequency == pytest.approx(below_cut_off, rel=1e-5)
    assert table.select("method", "realisations").unique().rows() == [("robust", 2)]
    assert table["magnitude"].to_numpy() == pytest.approx(np.abs(eq15(frequency)), rel=2e-3)
    phase = np.rad2deg(np.angle(eq15(frequency)))
    assert table["phase_deg"].to_numpy() == pytest.approx(phase, rel=2e-2)


def test_the_models_stand_beside_the_response(of_two_motions, parameters):
    fit = {"K": K, "B": B, "I": I}
    leg = joint_admittance(20.0, 0.5, parameters, parameters.J_j)

    table = impedance_over_frequency(of_two_motions, fit, leg)

    magnitude = np.abs(eq15(table["frequency_hz"].to_numpy()))
    assert table["magnitude_eq15"].to_numpy() == pytest.approx(magnitude, rel=1e-9)
    # both springs in series, at rest
    K_1_at_joint = 20.0 * parameters.n_T**2
    softest = K_1_at_joint * parameters.K_s / (K_1_at_joint + parameters.K_s)
    assert table["magnitude_eq9"][0] == pytest.approx(softest, rel=0.1)


def test_a_motion_without_a_period_has_the_local_polynomial_method():
    time, (theta, omega, alpha) = chirp(np.random.default_rng(1), band=(0.4, 6.4))
    noise = 0.02 * np.random.default_rng(1).standard_normal(len(time))
    torque = K * theta + B * omega + I * alpha + noise

    response = impedance_over_frequency(recorded("C", theta, torque))

    assert response.select("method", "odd_level").unique().rows() == [("local polynomial", None)]
    assert len(response) > 5
    magnitude = np.abs(eq15(response["frequency_hz"].to_numpy()))
    assert response["magnitude"].to_numpy() == pytest.approx(magnitude, rel=0.07)


CHIRP = 0.05 * np.sin(2 * np.pi * (0.4 * T + 0.1 * T**2))[: round(30 * RATE)]


def test_a_record_that_is_too_short_has_no_response_and_the_reason_is_told():
    short = recorded("S", CHIRP[:250], CHIRP[:250])

    with pytest.warns(UserWarning, match=r"^trial S: no frequency response: .* record for longer"):
        response = impedance_over_frequency(short)

    assert response.is_empty()


def test_noise_alone_has_no_response_and_the_reason_is_told():
    noise = np.random.default_rng(1).standard_normal(len(CHIRP))

    with pytest.warns(UserWarning, match=r"^trial N: no frequency response: .* moves at no"):
        response = impedance_over_frequency(recorded("N", CHIRP, noise))

    assert response.is_empty()


# ---- Levels of noise and distortion


COUNT = 60  # lines
SAMPLES = 1024
SIZE = 0.01  # of the excited lines [rad]
EXCITED = np.setdiff1d(np.arange(1, 40, 2), [3, 11, 19, 25, 33])


class Levels(NamedTuple):
    """RMS of the torque's lines [N*m] that is not Z theta."""

    noise: float = 0.0  # at all lines
    odd: float = 0.0  # at odd ones, repeated in every period


def realisation_of(seed, levels=Levels(), extra=None):  # noqa: B008
    """Four periods with lines of random phases, and a torque `extra`(angle) beside Z theta."""
    periods = 4
    random = np.random.default_rng(seed)
    theta = np.zeros(COUNT, dtype=complex)
    theta[EXCITED] = SIZE * np.exp(2j * np.pi * random.uniform(size=len(EXCITED)))
    noise = random.standard_normal((2, periods, COUNT)) * levels.noise / np.sqrt(2)
    is_odd = np.arange(COUNT) % 2
    repeated = random.standard_normal((2, COUNT)) * levels.odd / np.sqrt(2) * is_odd
    torque = (200 + 4j * np.arange(COUNT)) * theta
    torque = torque + noise[0] + 1j * noise[1] + repeated[0] + 1j * repeated[1]
    if extra is not None:
        angle = np.fft.irfft(theta * SAMPLES / 2, SAMPLES)
        torque += np.fft.rfft(extra(angle))[:COUNT] * 2 / SAMPLES
    torque[:, 0] = torque[:, 0].real
    return Realisation(PERIOD, np.array([np.tile(theta, (periods, 1)), torque]), 0.0)


def in_torque(levels):
    """RMS of levels of Z [N*m/rad] as those of the torque [N*m]."""
    return np.sqrt(np.mean(np.square(levels))) * SIZE


@pytest.fixture(scope="module")
def noisy_response():
    """48 realisations; the noise in the mean of four periods is as large as the distortion."""
    levels = Levels(noise=0.1, odd=0.05)
    return periodic_response([realisation_of(seed, levels) for seed in range(48)])


def test_the_noise_level_is_that_of_the_mean_over_periods(noisy_response):
    assert in_torque(noisy_response["noise_level"]) == pytest.approx(0.05, rel=0.06)
    of_mean = 0.05 / SIZE / np.sqrt(48)
    assert noisy_response["noise_sd"] == pytest.approx(of_mean, rel=0.25)


def test_noise_is_taken_off_the_level_of_distortion(noisy_response):
    assert in_torque(noisy_response["odd_level"]) == pytest.approx(0.05, rel=0.15)


def test_the_total_holds_noise_and_distortion(noisy_response):
    total = noisy_response["total_level"]

    assert in_torque(total) == pytest.approx(0.05 * np.sqrt(2), rel=0.1)
    assert noisy_response["total_sd"] * np.sqrt(48) == pytest.approx(total)


def test_the_total_of_two_realisations_is_that_of_many():
    """Two that share a mean scatter half as much: their level must be twice that."""
    totals = []
    for first in range(0, 100, 2):
        pair = [realisation_of(seed, Levels(odd=0.05)) for seed in (first, first + 1)]
        totals.append(periodic_response(pair)["total_level"])

    assert in_torque(totals) == pytest.approx(0.05, rel=0.07)


@pytest.mark.parametrize(("power", "seen", "absent"), [(3, "odd", "even"), (2, "even", "odd")])
def test_levels_of_a_cube_are_odd_and_those_of_a_square_are_even(power, seen, absent):
    realisations = [realisation_of(seed, extra=lambda x: 1e4 * x**power) for seed in range(8)]

    response = periodic_response(realisations)

    of_absent = in_torque(response[f"{absent}_level"])
    assert of_absent < 1e-6 * in_torque(response[f"{seen}_level"])


def test_one_realisation_tells_the_distortion_by_its_detection_lines():
    realisations = [realisation_of(seed, extra=lambda x: 1e5 * x**3) for seed in range(12)]

    single = [periodic_response([realisation])["odd_level"] for realisation in realisations]
    several = periodic_response(realisations)["odd_level"]

    assert in_torque(single) == pytest.approx(in_torque(several), rel=0.25)


def test_the_total_of_one_realisation_is_its_distortion():
    response = periodic_response([realisation_of(3, extra=lambda x: 1e5 * x**3)])

    assert np.isnan(response["total_level"]).all()
    assert in_torque(response["total_sd"]) == pytest.approx(in_torque(response["odd_level"]))


# ---- The local polynomial method


def spectrum_of_noise_motion(seed, noise_sd, rate):
    """Spectrum of 30 s of noise below 8 Hz, by a second library's simulation of a damped system.

    The library takes the torque for linear between its samples, four to one of the record: at 8 Hz
    that is 2e-4 of it.
    """
    finer = 4
    random = np.random.default_rng(seed)
    time = np.arange(round(32 * rate) * finer) / (rate * finer)
    drive = 0.3 * np.convolve(random.standard_normal(len(time)), np.hanning(200), "same")
    joint = lti([1.0], [I, B, K])  # torque/(I s^2 + B s + K)
    _, theta, _ = lsim(joint, drive, time, interp=True)
    kept = slice(round(rate) * finer, round(31 * rate) * finer, finer)
    torque = drive[kept] + noise_sd * random.standard_normal(len(drive[kept]))
    return record_spectrum(theta[kept], torque, rate, 15.0)


@pytest.fixture(scope="module")
def noise_spectra():
    return [spectrum_of_noise_motion(seed, noise_sd=0.02, rate=256.0) for seed in (1, 2)]


def test_local_polynomials_find_the_response_within_its_noise(noise_spectra):
    squares = []
    for spectrum in noise_spectra:
        response = local_response(spectrum)
        Z = response["magnitude"] * np.exp(1j * np.deg2rad(response["phase_deg"]))
        error = np.abs(Z - eq15(response["frequency_hz"]))
        squares.extend(error**2 / response["noise_sd"] ** 2)

    assert len(squares) > 60
    assert np.mean(squares) == pytest.approx(1, abs=0.3)  # 0.14 by theory


def test_the_local_polynomial_method_finds_the_noise_of_the_torque(noise_spectra):
    noise = [local_fit(spectrum).noise for spectrum in noise_spectra]

    samples = 30 * 256.0
    assert np.mean(noise) == pytest.approx(4 * 0.02**2 / samples, rel=0.08)
