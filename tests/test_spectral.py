"""The period of a motion that repeats itself, its realisations, and the frequency response of any
motion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim, lti

from osl_analysis.bench.frequency_response import RESPONSE_COLUMNS, impedance_over_frequency
from osl_analysis.bench.record import record_of, stretches_of
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

RATE, PERIOD, LOW_PASS = 250.0, 4.0, LowPass(15)
LINES, K, B, I = np.array([3, 5, 9, 11, 13, 17, 21, 23, 27, 29]), 200.0, 4.0, 0.05


def multisine(seed: int, periods: float = 5, ppm: float = 0.0, lines=LINES):
    """theta, omega, alpha (n,) of a random-phase multisine on a clock that is fast by ppm;
    derivatives by hand."""
    t = np.arange(round(periods * PERIOD * RATE)) / RATE * (1 + 1e-6 * ppm)
    w, phase = (
        2 * np.pi * lines / PERIOD,
        np.random.default_rng(seed).uniform(0, 2 * np.pi, len(lines)),
    )
    turn, size = np.outer(t, w) + phase, 0.05 / np.sqrt(len(lines))
    return np.array(
        [size * np.cos(turn).sum(1), -size * np.sin(turn) @ w, -size * np.cos(turn) @ w**2]
    )


def record(seed: int, *motions, noise: float = 0.0):
    """Angle and torque (n,) of motions one after another, each after a second of rest and a ramp of
    a second."""
    rest, parts = np.zeros((3, round(RATE))), []
    for motion in motions:
        parts += [rest, np.minimum(np.arange(motion.shape[1]) / RATE, 1.0) * motion]
    theta, omega, alpha = np.hstack([*parts, rest])
    rng = np.random.default_rng(seed)
    torque = K * theta + B * omega + I * alpha + noise * rng.standard_normal(len(theta))
    return theta + 1e-5 * rng.standard_normal(len(theta)), torque


@pytest.mark.parametrize("ppm", [0.0, 100.0, -100.0])
def test_the_period_is_found_on_a_clock_that_is_off_to_less_than_a_millionth(ppm):
    found = [
        periodic_motion(*record(seed, multisine(seed, 6, ppm)), RATE, 10.0) for seed in range(1, 9)
    ]
    assert [r.periods for r in found[0].realisations] == [5]
    errors = [1e6 * (one.period / PERIOD * (1 + 1e-6 * ppm) - 1) for one in found]
    assert np.abs(errors).max() < 0.4


def test_a_record_of_several_motions_with_one_period_has_as_many_realisations():
    once, other = multisine(1), multisine(2)
    found = periodic_motion(*record(3, once, other, np.roll(once, 300, axis=1)), RATE, 10.0)
    assert [r.periods for r in found.realisations] == [4, 4, 4]
    # after a second of rest, and a ramp within the first period
    starts = [r.start for r in found.realisations]
    assert np.diff(starts) == pytest.approx([21, 21], abs=0.2)
    # what is over is left out
    assert [start + 4 * PERIOD for start in starts] == pytest.approx([21, 42, 63], abs=0.3)
    assert 2 < starts[0] < 1 + PERIOD + 0.1
    joined = distinct(found.realisations)
    assert [r.periods for r in joined] == [8, 4]
    theta = joined[0].spectra[0][:, LINES]
    assert np.abs(theta - theta.mean(0)).max() < 1e-3 * np.abs(theta).min()


@pytest.mark.parametrize("motion", ["chirp", "noise", "rest", "once", "by hand"])
def test_what_does_not_repeat_itself_has_no_period(motion):
    t, rng = np.arange(round(40 * RATE)) / RATE, np.random.default_rng(4)
    walk = np.convolve(rng.standard_normal(len(t)), np.hanning(60), "same")
    made = {
        "chirp": np.sin(np.pi * 0.1 * t**2),
        "noise": walk,
        "rest": np.zeros(len(t)),
        "once": multisine(5, 1.5)[0],
    }
    # a sine whose period changes by 5 %
    made["by hand"] = np.sin(2 * np.pi * 1.2 * t + 2e-2 * np.cumsum(walk) / RATE)
    assert periodic_motion(made[motion], made[motion], RATE, 10.0) is None


@pytest.mark.parametrize(("periods", "other_s", "size", "repeats"), [
    (5, 10.0, 0.6, True), (3, 22.0, 0.6, False), (3, 22.0, 0.05, True),
])  # fmt: skip
def test_a_motion_has_a_period_only_if_it_repeats_itself_in_half_of_the_time_in_which_it_moves(
    periods, other_s, size, repeats
):
    """A multisine, 20 s of 30 or 12 s of 34, and then noise that repeats nothing, of this part of
    its size. A twentieth is a rest."""
    repeated, _, _ = multisine(1, periods)
    noise = np.random.default_rng(2).standard_normal(round(other_s * RATE))
    smooth = np.convolve(noise, np.hanning(60), "same")
    smooth *= size * np.std(repeated) / np.std(smooth)
    theta = np.concatenate([repeated, smooth])

    found = periodic_motion(theta, theta, RATE, 10.0)

    assert (found is not None) == repeats
    if found is not None:
        assert found.period == pytest.approx(PERIOD, rel=1e-3)


def test_lines_are_those_that_were_excited_and_the_others_odd_and_even():
    lines = lines_of(periodic_motion(*record(6, multisine(1)), RATE, 10.0).realisations)
    assert (list(np.flatnonzero(lines.excited)), list(np.flatnonzero(lines.odd))) == (
        list(LINES),
        [7, 15, 19, 25],
    )
    assert lines.only_odd
    assert list(np.flatnonzero(lines.even)) == list(range(2, 29, 2))


def test_spectra_of_a_period_that_is_no_whole_number_of_samples_leak_nothing():
    samples, k = 333.37, np.array([2, 7])
    t = np.arange(2000)
    y = (
        3
        + 0.5 * np.cos(2 * np.pi * 2 * t / samples + 0.3)
        + 0.1 * np.sin(2 * np.pi * 7 * t / samples)
    )
    X = period_spectra(y, 100.6, samples, 4, 20)
    expected = np.array([0.5 * np.exp(0.3j), -0.1j]) * np.exp(2j * np.pi * k * 100.6 / samples)
    assert (X[0, k], X[:, 0]) == (pytest.approx(expected, abs=1e-6), pytest.approx(3, abs=1e-6))
    turns = np.exp(2j * np.pi * np.outer(np.arange(4), k))  # every period begins at the same phase
    assert X[:, k] == pytest.approx(expected * turns, abs=1e-6)


def test_drift_of_the_load_cell_does_not_reach_the_lines():
    theta, torque = record(7, multisine(1))
    drift = 0.2 * np.arange(len(torque)) / RATE
    found = (periodic_motion(theta, y, RATE, 10.0).realisations for y in (torque, torque + drift))
    still, moved = (one.mean_lines[1, LINES] for (one,) in found)
    assert moved == pytest.approx(still, rel=1e-6)


def recorded(name, theta, torque):
    groups = stretches_of([slice(0, len(theta))], RATE)
    made = record_of(name, np.arange(len(theta)) / RATE, theta, torque, LOW_PASS, groups)
    return replace(
        made, torque=torque, periodic=periodic_motion(theta, torque, RATE, LOW_PASS.cutoff_hz)
    )


def periodic(name, *seeds, size=1.0):
    return recorded(
        name, *record(sum(seeds), *(size * multisine(seed) for seed in seeds), noise=0.02)
    )


def eq15(frequency_hz):
    s = 2j * np.pi * frequency_hz.to_numpy()
    return K + B * s + I * s**2


def test_the_response_of_a_periodic_trial_has_a_row_per_line_beside_the_models_of_it(parameters):
    fit = {"K": K, "B": B, "I": I}
    table = impedance_over_frequency(
        periodic("M", 1, 2), fit, joint_admittance(20.0, 0.5, parameters, parameters.J_j)
    )
    assert dict(table.schema) == RESPONSE_COLUMNS
    Z = eq15(table["frequency_hz"])
    for end, at_most in (("", 2.0), ("_eq15", 1e-6)):
        magnitude, phase = (table[f"{name}{end}"].to_numpy() for name in ("magnitude", "phase_deg"))
        assert magnitude == pytest.approx(np.abs(Z), rel=1e-3 * at_most)
        assert phase == pytest.approx(np.rad2deg(np.angle(Z)), rel=1e-2 * at_most)
    assert table.select("method", "realisations").unique().rows() == [("robust", 2)]
    below_cut_off = LINES[LINES / PERIOD <= LOW_PASS.cutoff_hz] / PERIOD
    assert table["frequency_hz"].to_numpy() == pytest.approx(below_cut_off, rel=1e-5)
    K_s, n_T = parameters.K_s, parameters.n_T
    softest = 20.0 * n_T**2 * K_s / (20.0 * n_T**2 + K_s)  # both springs in series, at rest
    assert table["magnitude_eq9"][0] == pytest.approx(softest, rel=0.1)
    assert impedance_over_frequency(periodic("M", 1, 2))["magnitude_eq15"].is_null().all()


def test_a_motion_that_does_not_repeat_itself_has_the_local_polynomial_method():
    t = np.arange(round(30 * RATE)) / RATE
    # a chirp to 6.4 Hz
    turn, rate = 2 * np.pi * (0.4 * t + 0.1 * t**2), 2 * np.pi * (0.4 + 0.2 * t)
    theta, omega = 0.05 * np.sin(turn), 0.05 * rate * np.cos(turn)
    alpha = -(rate**2) * theta + 0.4 * np.pi * omega / rate
    noise = 0.02 * np.random.default_rng(1).standard_normal(len(t))
    response = impedance_over_frequency(
        recorded("C", theta, K * theta + B * omega + I * alpha + noise)
    )
    assert response.select("method", "odd_level").unique().rows() == [("local polynomial", None)]
    assert len(response) > 5
    assert response["magnitude"].to_numpy() == pytest.approx(
        np.abs(eq15(response["frequency_hz"])), rel=0.05
    )


def test_a_motion_without_a_response_has_no_row_and_the_reason_is_told():
    t = np.arange(round(30 * RATE)) / RATE
    theta = 0.05 * np.sin(2 * np.pi * (0.4 * t + 0.1 * t**2))
    noise = np.random.default_rng(1).standard_normal(len(t))

    with pytest.warns(UserWarning, match=r"^trial S: no frequency response: .* record for longer"):
        of_short = impedance_over_frequency(recorded("S", theta[:250], theta[:250]))
    with pytest.warns(UserWarning, match=r"^trial N: no frequency response: .* moves at no"):
        of_noise_alone = impedance_over_frequency(recorded("N", theta, noise))

    assert of_short.is_empty()
    assert of_noise_alone.is_empty()


COUNT, SAMPLES, SIZE = 60, 1024, 0.01
ODD = np.setdiff1d(np.arange(1, 40, 2), [3, 11, 19, 25, 33])


def in_time(X):
    return np.fft.irfft(X * SAMPLES / 2, SAMPLES)


def made(seed, noise=0.0, distortion=0.0, extra=None):
    """Lines of random phases, noise at all lines, distortion that repeats at odd ones, and torque
    `extra`(angle)."""
    rng, X, periods = np.random.default_rng(seed), np.zeros(COUNT, dtype=complex), 4
    X[ODD] = SIZE * np.exp(2j * np.pi * rng.uniform(size=len(ODD)))
    random = rng.standard_normal((2, periods, COUNT)) * noise / np.sqrt(2)
    repeated = rng.standard_normal((2, COUNT)) * distortion / np.sqrt(2) * (np.arange(COUNT) % 2)
    torque = (
        (200 + 4j * np.arange(COUNT)) * X
        + random[0]
        + 1j * random[1]
        + repeated[0]
        + 1j * repeated[1]
    )
    if extra is not None:
        torque += np.fft.rfft(extra(in_time(X)))[:COUNT] * 2 / SAMPLES
    torque[:, 0] = torque[:, 0].real
    return Realisation(PERIOD, np.array([np.tile(X, (periods, 1)), torque]), 0.0)


def rms(levels):
    return np.sqrt(np.mean(np.square(levels))) * SIZE


def test_noise_is_taken_off_the_levels():
    # noise in the mean of four periods as large as the distortion
    response = periodic_response([made(seed, 0.1, distortion=0.05) for seed in range(48)])
    assert rms(response["noise_level"]) == pytest.approx(0.05, rel=0.06)
    assert response["noise_sd"] == pytest.approx(0.05 / SIZE / np.sqrt(48), rel=0.25)
    assert response["total_sd"] * np.sqrt(48) == pytest.approx(response["total_level"])
    assert rms(response["odd_level"]) == pytest.approx(0.05, rel=0.15)
    assert rms(response["total_level"]) == pytest.approx(0.05 * np.sqrt(2), rel=0.1)


def test_levels_of_a_cube_are_odd_and_those_of_a_square_are_even():
    for power, seen, absent in ((3, "odd", "even"), (2, "even", "odd")):
        response = periodic_response(
            [made(k, extra=lambda theta, n=power: 1e4 * theta**n) for k in range(8)]
        )
        assert rms(response[f"{absent}_level"]) < 1e-6 * rms(response[f"{seen}_level"])


def test_one_realisation_tells_the_distortion_by_its_detection_lines():
    of_one = [
        periodic_response([made(seed, extra=lambda theta: 1e5 * theta**3)]) for seed in range(12)
    ]
    several = periodic_response(
        [made(seed, extra=lambda theta: 1e5 * theta**3) for seed in range(12)]
    )
    assert rms([one["odd_level"] for one in of_one]) == pytest.approx(
        rms(several["odd_level"]), rel=0.25
    )
    assert np.isnan(of_one[3]["total_level"]).all()
    assert rms(of_one[3]["total_sd"]) == pytest.approx(rms(of_one[3]["odd_level"]))


def test_the_local_polynomial_method_finds_the_response_of_a_simulated_system_within_its_noise():
    """30 s of noise below 8 Hz, by a second library's simulation of a damped system. It takes the
    torque for linear between its samples, four to one of the record: at 8 Hz that is 2e-4 of it."""
    squares, noise, finer, rate = [], [], 4, 256.0
    keep = slice(round(rate) * finer, round(31 * rate) * finer, finer)
    for seed in (1, 2, 3, 4):
        rng, t = np.random.default_rng(seed), np.arange(round(32 * rate) * finer) / (rate * finer)
        drive = 0.3 * np.convolve(rng.standard_normal(len(t)), np.hanning(200), "same")
        _, theta, _ = lsim(lti([1.0], [I, B, K]), drive, t, interp=True)  # torque/(I s^2 + B s + K)
        torque = drive[keep] + 0.02 * rng.standard_normal(len(drive[keep]))
        record = record_spectrum(theta[keep], torque, rate, 15.0)
        response = local_response(record)
        s = 2j * np.pi * response["frequency_hz"]
        error = response["Z_re"] + 1j * response["Z_im"] - (K + B * s + I * s**2)
        squares.extend(np.abs(error) ** 2 / response["noise_sd"] ** 2)
        noise.append(local_fit(record)[2])
    assert len(squares) > 120
    assert np.mean(squares) == pytest.approx(1, abs=0.3)  # 0.1 by theory
    assert np.mean(noise) == pytest.approx(4 * 0.02**2 / (30 * rate), rel=0.06)
