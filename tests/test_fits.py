"""Every fit recovers what made its data; the traps of the design page are shown to be traps."""

import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import multisine
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import curve_fit

from osl_analysis.bench.belt import fit_belt_stiffness
from osl_analysis.bench.diagnostics import check_resists
from osl_analysis.bench.protocol import SteppedSineProtocol, find_blocks, unit_block
from osl_analysis.bench.transmission import fit_transmission, fit_transmission_with_coulomb
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.second_order import fit_impedance, impedance_torque
from osl_analysis.signals import LowPass, differentiate, filtered_motion
from osl_analysis.stats.complex_estimate import (
    complex_from_row,
    complex_mean,
    complex_quotient,
    complex_row,
    polar_row,
)
from osl_analysis.stats.covariance import welch_satterthwaite
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.stats.sinusoid import fit_sinusoid

PROTOCOL = SteppedSineProtocol(amplitudes=(0.03, 0.06, 0.1), frequencies_hz=(2.0, 4.0), cycles=6)
RATE = 500.0


@given(st.floats(1, 500), st.floats(-2, 10), st.floats(-0.2, 0.5), st.floats(-10, 10))
def test_recovers_the_impedance_that_made_the_torque(K, B, I, offset):
    motion = multisine(0.7, 2.3, 5.9)
    fit = fit_impedance(motion, impedance_torque(K, B, I, motion) + offset)
    assert (fit.K, fit.B, fit.I, fit.offset) == pytest.approx((K, B, I, offset), rel=1e-8, abs=1e-9)


def test_refuses_a_single_sine_because_stiffness_and_inertia_look_alike():
    motion = multisine(2.0)
    with pytest.raises(IdentifiabilityError, match="K and I"):
        fit_impedance(motion, impedance_torque(100, 1, 0.1, motion))


def test_mirrored_motion_gives_the_same_impedance():
    motion, mirrored = multisine(0.7, 2.3, 5.9), multisine(0.7, 2.3, 5.9, amplitude=-0.1)
    torque = impedance_torque(120, 3, 0.05, motion)
    here, there = fit_impedance(motion, torque), fit_impedance(mirrored, -torque)
    assert (here.K, here.B, here.I) == pytest.approx((there.K, there.B, there.I))


def test_a_late_torque_costs_damping_at_the_rate_of_the_stiffness():
    """B shifts by -K delay to first order while the VAF stays blind (design.md, section 5)."""
    K, B, delay, rate = 340.0, 3.0, 1 / 300, 3000.0
    motion = multisine(0.7, 2.3, 3.9, rate=rate)
    late = round(delay * rate)
    torque = impedance_torque(K, B, 0.02, motion)
    fit = fit_impedance(motion[late:], torque[:-late])
    assert fit.B - B == pytest.approx(-K * delay, rel=0.1)
    assert fit.fit.vaf > 99.9


def test_filtering_only_the_angle_spoils_the_damping_and_filtering_both_does_not():
    t = np.arange(0, 20, 1e-3)
    motion = multisine(0.7, 2.3, 5.9, 9.1, duration=20, rate=1000)
    torque = impedance_torque(100, 3, 0.02, motion)
    low_pass = LowPass(cutoff_hz=10)
    both = fit_impedance(*filtered_motion(t, motion.theta, torque, low_pass))
    only_angle = fit_impedance(differentiate(t, low_pass(motion.theta, 1000.0)), torque)
    assert (both.K, both.B, both.I) == pytest.approx((100, 3, 0.02), rel=5e-3)
    assert abs(only_angle.B - 3) > 0.3


@given(st.floats(0.05, 2), st.floats(0, 0.1), st.floats(-1, 1))
def test_recovers_the_losses_of_the_transmission(B_j, J_j, offset):
    motion = multisine(1.0, 3.0, 5.0)
    fit = fit_transmission(motion, B_j * motion.omega + J_j * motion.alpha + offset)
    assert (fit["B_j"], fit["J_j"], fit["offset"]) == pytest.approx((B_j, J_j, offset), rel=1e-8, abs=1e-9)


def test_coulomb_friction_is_told_from_viscous():
    motion = multisine(1.0, 3.0, 5.0)
    torque = 0.45 * motion.omega + 0.005 * motion.alpha + 0.2 * np.tanh(motion.omega / 0.05)
    fit = fit_transmission_with_coulomb(motion, torque)
    assert (fit["B_j"], fit["J_j"], fit["T_C"]) == pytest.approx((0.45, 0.005, 0.2), rel=1e-8)
    assert fit_transmission(motion, torque)["B_j"] > 0.46


def belt_cycle(K_s=685.6, K_s2=0.0, coulomb=0.0, peak=0.0873):
    rest, way = np.zeros(200), peak * (1 - np.cos(np.linspace(0, np.pi, 1500))) / 2
    theta_s = np.concatenate([rest, way, way[::-1], rest])
    direction = np.concatenate([0 * rest, 0 * way + 1, 0 * way - 1, 0 * rest])
    return theta_s, K_s * theta_s + K_s2 * theta_s * np.abs(theta_s) + coulomb * direction + 2.0


@given(st.floats(100, 2000), st.sampled_from([-1, 1]))
def test_recovers_the_stiffness_of_the_belt_in_both_directions(K_s, sign):
    theta_s, torque = belt_cycle(K_s)
    assert fit_belt_stiffness(sign * theta_s, sign * torque).K_s == pytest.approx(K_s, rel=1e-8)


def test_belt_loop_encloses_the_work_of_its_friction():
    theta_s, torque = belt_cycle(coulomb=0.5)
    assert fit_belt_stiffness(theta_s, torque).hysteresis_area == pytest.approx(2 * 0.5 * 0.0873, rel=1e-3)


def test_quadratic_belt_is_recovered_where_the_line_is_not():
    fit = fit_belt_stiffness(*belt_cycle(K_s=876, K_s2=14913))
    assert (fit.quadratic["K_s"], fit.quadratic["K_s2"]) == pytest.approx((876, 14913), rel=1e-6)
    assert fit.K_s > 1500


def test_belt_refuses_a_joint_that_hardly_moved_and_a_record_that_ends_loaded():
    theta_s, torque = belt_cycle()
    with pytest.raises(InputError, match=r"deflects by 0\.050 deg"):
        fit_belt_stiffness(theta_s / 100, torque)
    with pytest.raises(InputError, match="ends while the belt is still loaded"):
        fit_belt_stiffness(theta_s[:2000], torque[:2000])


def test_belt_refuses_a_motion_that_goes_there_and_back_more_than_once():
    once, torque = belt_cycle()
    with pytest.raises(InputError, match="no single loading"):
        fit_belt_stiffness(np.concatenate([0.9 * once, once]), np.concatenate([torque, torque]))


def stepped_record(start=3.0, rests=(1.0, 1.0, 2.0), unit=1.0, protocol=PROTOCOL):
    pieces = [np.zeros(round(start * RATE))]
    for amplitude, rest in zip(protocol.amplitudes, rests, strict=True):
        pieces += [amplitude * unit * unit_block(protocol, RATE), np.zeros(round(rest * RATE))]
    theta = np.concatenate(pieces)
    return np.arange(len(theta)) / RATE, theta


@pytest.mark.parametrize("start", [0.0, 3.0, 7.7])
def test_finds_every_segment_wherever_the_record_starts(start):
    blocks = find_blocks(*stepped_record(start), PROTOCOL)
    starts = [start, start + 4.5 + 1.0, start + 2 * (4.5 + 1.0)]
    assert [b.segments[0].start / RATE for b in blocks] == pytest.approx(starts, abs=1.5 / RATE)
    assert [(s.stop - s.start) / RATE for b in blocks for s in b.segments] == pytest.approx([3, 1.5] * 3)


def test_a_protocol_that_is_not_in_the_record_is_refused():
    with pytest.raises(InputError, match=r"amplitude of 98\.\d+ deg, the protocol says 1\.7"):
        find_blocks(*stepped_record(unit=57.3), PROTOCOL)
    time, theta = stepped_record()
    with pytest.raises(InputError, match=r"amplitude of 0\.00 deg"):
        find_blocks(time, 0 * theta, PROTOCOL)
    with pytest.raises(InputError, match="the trial lasts"):
        find_blocks(time[:3000], theta[:3000], PROTOCOL)


@pytest.mark.parametrize("frequencies_hz", [(2.0, 4.0), (1.0, 2.0, 3.0, 4.0, 5.0), (3.0,), (4.0, 4.4, 5.0)])
@pytest.mark.parametrize("really", [6, 7, 9, 12])
def test_a_configuration_with_fewer_cycles_than_were_recorded_is_refused_with_both_counts(frequencies_hz, really):
    """At rest, at another frequency (a tenth higher at least) and at another amplitude a sine does not go on."""
    configured = replace(PROTOCOL, frequencies_hz=frequencies_hz, cycles=6)
    time, theta = stepped_record(rests=(1.0, 0.0, 0.0), protocol=replace(configured, cycles=really))
    theta += 1e-4 * np.random.default_rng(1).standard_normal(len(theta)) + 0.02
    if really == 6:
        assert len(find_blocks(time, theta, configured)) == len(configured.amplitudes)
    else:
        with pytest.raises(InputError, match="the protocol says 6; correct `cycles`") as caught:
            find_blocks(time, theta, configured)
        assert int(re.search(r"about (\d+) cycles", str(caught.value))[1]) in (really - 1, really, really + 1)


def test_phasor_agrees_with_a_nonlinear_least_squares_fit():
    t = np.arange(0, 5, 1e-3)
    rng = np.random.default_rng(3)
    y = 0.4 * np.cos(2 * np.pi * 2 * t + 0.7) + 1.0 + rng.normal(0, 0.05, len(t))
    phasor = fit_sinusoid(t, y, 2.0)

    def sine(t, a, phase, offset):
        return a * np.cos(2 * np.pi * 2 * t + phase) + offset

    (a, phase, _), covariance = curve_fit(sine, t, y, p0=(0.3, 0.5, 0.0))
    assert (abs(phasor.value), np.angle(phasor.value)) == pytest.approx((a, phase), rel=2e-3)
    assert np.sqrt(np.trace(phasor.covariance) / 2) == pytest.approx(np.sqrt(covariance[0, 0]), rel=0.3)


def test_distortion_is_the_share_of_the_harmonics():
    t = np.arange(0, 4, 1e-3)
    y = np.cos(2 * np.pi * t) + 0.03 * np.cos(6 * np.pi * t) + 0.04 * np.sin(10 * np.pi * t)
    assert fit_sinusoid(t, y, 1.0).distortion == pytest.approx(0.05)


def test_response_is_the_complex_admittance_and_its_error_follows_the_noise():
    t = np.arange(0, 20, 2e-3)
    w, Z, rng = 2 * np.pi, 200 + 40j, np.random.default_rng(5)
    found = []
    for _ in range(60):
        theta = 0.05 * np.sin(w * t)
        torque = 0.05 * abs(Z) * np.sin(w * t + np.angle(Z)) + rng.normal(0, 0.5, len(t))
        found.append(complex_quotient(fit_sinusoid(t, theta, 1.0), fit_sinusoid(t, torque, 1.0)))
    values = np.array([r.value for r in found])
    assert np.mean(values) == pytest.approx(1 / Z, rel=2e-3)
    scatter = np.std(np.abs(values), ddof=1)
    assert np.mean([r.magnitude_se for r in found]) == pytest.approx(scatter, rel=0.35)
    assert np.mean([r.phase_se for r in found]) == pytest.approx(np.std(np.angle(values), ddof=1), rel=0.35)
    assert complex_mean(found).magnitude_se == pytest.approx(scatter / np.sqrt(60), rel=0.35)


def test_intervals_of_a_response_and_of_its_mean_over_amplitudes_cover_with_few_cycles():
    """95 % of 500 seeded records of six cycles, amplitudes of unequal noise; a normal quantile would reach 90 %."""
    t, w, rng, true, covered = np.arange(0, 6, 1e-2), 2 * np.pi, np.random.default_rng(6), 1 / (200 + 40j), []
    for _ in range(500):
        pair = []
        for noise in (0.5, 2.0):
            theta = 0.05 * np.sin(w * t)
            torque = 0.05 * np.abs(1 / true) * np.sin(w * t - np.angle(true)) + rng.normal(0, noise, len(t))
            pair.append(complex_quotient(fit_sinusoid(t, theta, 1.0), fit_sinusoid(t, torque, 1.0)))
        rows = [polar_row(found) for found in (pair[1], complex_mean(pair))]
        covered.append([
            (row["magnitude_low"] <= abs(true) <= row["magnitude_high"])
            + 1j * (row["phase_low_deg"] <= np.rad2deg(np.angle(true)) <= row["phase_high_deg"])
            for row in rows
        ])  # fmt: skip
    share = np.mean(covered, axis=0)
    assert ((share.real > 0.925) & (share.real < 0.975)).all()
    assert ((share.imag > 0.925) & (share.imag < 0.975)).all()


def test_degrees_of_freedom_of_a_sum_are_those_of_welch_and_satterthwaite():
    assert welch_satterthwaite([1.0, 1.0], [5, 5]) == pytest.approx(10)
    assert welch_satterthwaite([1.0, 2.0], [5, 10]) == pytest.approx(9 / (1 / 5 + 4 / 10))
    np.testing.assert_allclose(welch_satterthwaite([[1.0, 0.0], [0.0, 3.0]], [5, 90]), [5, 90])
    np.testing.assert_array_equal(welch_satterthwaite([[2.0, 0.0]], [5]), [5, np.inf])


def test_a_phasor_survives_its_row_of_a_table():
    t = np.arange(0, 8, 1e-2)
    found = fit_sinusoid(t, np.sin(7 * t) + np.random.default_rng(7).normal(0, 0.1, len(t)), 1.0)
    again = complex_from_row("theta", complex_row("theta", found))
    assert (again.value, again.degrees_of_freedom) == (found.value, found.degrees_of_freedom)
    np.testing.assert_array_equal(again.covariance, found.covariance)


def test_sinusoid_refuses_too_short_a_record_and_too_slow_a_sampling():
    t = np.arange(0, 1, 1e-3)
    with pytest.raises(InputError, match=r"less than one cycle at 0\.5 Hz"):
        fit_sinusoid(t, np.sin(t), 0.5)
    with pytest.raises(InputError, match="too long for harmonic 5 of 60 Hz"):
        fit_sinusoid(np.arange(0, 1, 2e-3), np.zeros(500), 60.0)


def test_repeats_give_students_interval():
    values = [1.0, 2.0, 4.0]
    summary = over_repeats(values)
    half = 4.302652729911275 * np.std(values, ddof=1) / np.sqrt(3)
    assert (summary.mean, summary.high - summary.mean) == pytest.approx((7 / 3, half))
    with pytest.raises(InputError, match="repeat the experiment"):
        over_repeats([1.0])


def test_a_torque_of_the_wrong_sign_is_refused_and_one_of_the_right_sign_is_not():
    check_resists("belt_1", "K_s", 685.6)
    with pytest.raises(InputError, match=r"trial belt_1: K_s = -685\.6 is negative.*`sign`"):
        check_resists("belt_1", "K_s", -685.6)
