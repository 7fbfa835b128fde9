"""Phasors of a stepped sine: their errors, their quotient, and their mean over amplitudes."""

import numpy as np
import pytest

from osl_analysis.bench.complex_estimate import (
    BenchError,
    ComplexEstimate,
    complex_mean,
    complex_quotient,
    polar_row,
)
from osl_analysis.bench.frequency_response import damping_row, frequency_response_table
from osl_analysis.bench.phasors import (
    FittedCycles,
    SegmentPhasors,
    fit_sinusoids,
    phasor_table,
)
from osl_analysis.errors import InputError

FREQUENCY_HZ = 1.0
W = 2 * np.pi * FREQUENCY_HZ


def test_a_phasor_is_of_the_given_cycles_alone():
    time = np.arange(0, 6, 1e-3)
    in_third_second = (time > 2) & (time < 3)
    signal = np.cos(W * time + 0.3) + np.where(in_third_second, 5.0, 0.0)
    first = np.array([0.0, 1000, 3000, 4000, 5000])

    (phasor,) = fit_sinusoids(time, FREQUENCY_HZ, signal, cycles=FittedCycles(first, first + 1000))

    assert phasor.magnitude == pytest.approx(1)
    assert phasor.phase == pytest.approx(0.3)
    assert phasor.interval_method == "cycles"


def test_distortion_is_the_share_of_the_harmonics():
    time = np.arange(0, 6, 1e-3)
    signal = np.cos(W * time) + 0.03 * np.cos(3 * W * time) + 0.04 * np.sin(5 * W * time)

    (phasor,) = fit_sinusoids(time, FREQUENCY_HZ, signal)

    assert phasor.distortion == pytest.approx(0.05)
    assert np.abs(phasor.harmonics[[2, 4]]) == pytest.approx([0.03, 0.04])


def test_few_cycles_cover_the_response_and_its_mean_over_amplitudes():
    """95 % of 200 records of six cycles, amplitudes of unequal noise; a normal quantile would reach
    90 %."""
    time, rng = np.arange(0, 6, 1e-2), np.random.default_rng(6)
    Y = 1 / (200 + 40j)
    theta = 0.05 * np.sin(W * time)
    torque = 0.05 / np.abs(Y) * np.sin(W * time - np.angle(Y))
    covered = []

    for _ in range(200):
        responses = []
        for noise in (0.5, 2.0):
            noisy = torque + rng.normal(0, noise, len(time))
            responses.append(complex_quotient(*fit_sinusoids(time, FREQUENCY_HZ, theta, noisy)))
        for number in (responses[1], complex_mean(responses)):
            row = polar_row(number)
            phase_deg = np.rad2deg(np.angle(Y))
            covered.append(row["magnitude_low"] <= np.abs(Y) <= row["magnitude_high"])
            covered.append(row["phase_deg_low"] <= phase_deg <= row["phase_deg_high"])

    of_each = np.reshape(covered, (200, 4)).mean(axis=0)
    assert ((of_each > 0.91) & (of_each < 0.98)).all(), of_each


@pytest.mark.parametrize(("seconds", "rate_hz", "frequency_hz", "message"), [
    (1.0, 1000.0, 0.5, r"less than one cycle at 0\.5 Hz"),
    (1.0, 500.0, 60.0, "too long for harmonic 5 of 60 Hz"),
    (1.0, 11.0, 1.0, "11 samples cannot determine a sine .* 11 unknowns"),
])  # fmt: skip
def test_too_few_samples_are_refused(seconds, rate_hz, frequency_hz, message):
    time = np.arange(round(seconds * rate_hz)) / rate_hz

    with pytest.raises(InputError, match=message):
        fit_sinusoids(time, frequency_hz, np.sin(W * time))


def test_amplitudes_that_differ_between_cycles_leave_the_phase_certain():
    """A phasor at 40 degrees then scatters along itself: errors of its real and imaginary part have
    the same sign."""
    rng, time = np.random.default_rng(9), np.arange(0, 40, 1e-2)
    amplitude = 1 + 0.1 * np.repeat(rng.standard_normal(40), 100)
    signal = amplitude * np.cos(W * time + np.deg2rad(40))

    (phasor,) = fit_sinusoids(time, 1.0, signal + 1e-3 * rng.standard_normal(len(time)))

    assert phasor.magnitude_se == pytest.approx(0.1 / np.sqrt(40), rel=0.3)
    assert phasor.phase_se < 0.02 * phasor.magnitude_se


def segment(amplitude_deg, seed, bench_error):
    """Six noisy cycles of Y = 1/(200 + 40 j)."""
    time, rng = np.arange(0, 6, 1e-2), np.random.default_rng(seed)
    theta = 0.05 * np.sin(W * time)
    torque = 0.05 * (200 * np.sin(W * time) + 40 * np.cos(W * time))
    noisy = (theta, torque + rng.normal(0, 0.5, len(time)))
    phasors = fit_sinusoids(time, FREQUENCY_HZ, *noisy)
    return SegmentPhasors(amplitude_deg, FREQUENCY_HZ, *phasors, bench_error)


def test_the_mean_over_amplitudes_has_the_freedom_of_its_own_noise():
    """The error of the bench is known: beside it the freedom of a single Y is larger than that of
    its noise, which the mean is to be made of."""
    bench_error = BenchError(compliance=2e-5, gain=0.003, phase=0.002)
    segments = [segment(2.0, 1, bench_error), segment(4.0, 2, bench_error)]
    of_noise = complex_mean([complex_quotient(s.theta, s.torque) for s in segments])
    with_bench = bench_error.added_to(of_noise)
    expected = polar_row(with_bench)
    table = phasor_table("made", segments).with_columns(doubtful=None)

    (row,) = frequency_response_table(table).to_dicts()

    assert {name: row[name] for name in expected} == pytest.approx(expected, rel=1e-9)
    assert with_bench.degrees_of_freedom > 1.1 * of_noise.degrees_of_freedom


def test_the_bench_error_turns_and_stretches_a_response():
    Y = 3 * np.exp(0.5j)
    covariance = BenchError(gain=0.01, phase=0.02).covariance(Y)

    number = ComplexEstimate(Y, covariance, np.inf)

    assert number.magnitude_se == pytest.approx(0.01 * 3)
    assert number.phase_se == pytest.approx(0.02)
    assert BenchError(compliance=0.1).covariance(Y).tolist() == [[pytest.approx(0.01), 0], [0, 0]]


def test_the_damping_of_a_response_is_the_real_part_of_the_impedance_with_its_scatter():
    w, rng = 2 * np.pi * 2.0, np.random.default_rng(1)
    Z = 300 + 5j * w
    covariance = np.array([[4e-10, 1e-10], [1e-10, 2e-10]])

    row = damping_row(ComplexEstimate(1 / Z, covariance, np.inf), 2.0)

    errors = rng.multivariate_normal([0, 0], covariance, 20_000) @ [1, 1j]
    drawn = (1 / (1 / Z + errors)).imag / w
    half_width = (row["damping_high"] - row["damping_low"]) / 2
    assert row["damping"] == pytest.approx(5.0)
    assert half_width == pytest.approx(1.96 * drawn.std(), rel=0.03)
