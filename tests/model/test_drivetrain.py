# SPDX-License-Identifier: Apache-2.0
"""Eqs. 1-4 and 8-14: equations solved anew, norm and minimum of Eq. 14, what gains render."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import refused_with
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from shipped import CONFIG
from shipped import LEG as P

from osl_analysis.base.errors import UnreachableImpedanceError
from osl_analysis.commands.gains import gain_table
from osl_analysis.model import compensator, drivetrain
from osl_analysis.model.compensator import PAPER_WEIGHT
from osl_analysis.model.drivetrain import (
    NOTHING_STATED,
    belt_deflection,
    delay_margin,
    dynamic_stiffness,
    known_parameters,
    linear_torque,
    passive_delay,
    predicted_impedance,
    read_parameters,
    stated_of_device,
)
from osl_analysis.simulator.two_mass_drivetrain import motor_current


def weight_of(cutoff_hz, order):
    return compensator.Weight(cutoff_hz=cutoff_hz, order=order)


# ---- Equations of actuator and joint


def test_the_linear_torque_is_that_of_a_spring_for_motion_below_a_frequency():
    time = (np.arange(4000) + 0.5) / 1000  # a cosine is its own mirror image there
    slow, fast = (np.cos(2 * np.pi * hz * time) for hz in (9, 11))

    torque = linear_torque(lambda s: 200 + 0 * s, slow + fast, 1000, 10)

    assert torque == pytest.approx(200 * slow, abs=1e-9)


def test_actuator_torque_is_the_sum_of_equation_1():
    driven = 4.0 * 0.1133 * 9
    friction = 0.377 + 0.0896 * 4.0
    by_hand = driven - friction - 5.6e-3 * 2.0 - 9.211e-3 * 30.0

    torque = drivetrain.actuator_torque(current=4.0, omega_m=2.0, alpha_m=30.0, p=P)

    assert torque == pytest.approx(by_hand)


@settings(max_examples=30)
@given(u=st.floats(-20, 20), s=st.floats(-1, 1))
def test_the_closed_form_of_equation_5_solves_the_implicit_equation(u, s):
    current = motor_current.py_func(u, s, P)

    friction = drivetrain.motor_friction(s, current, P)
    assert current * P.k_tau * P.n_m == pytest.approx(u + friction, abs=1e-12)


@pytest.mark.parametrize("frequency", [0.0, 0.3, 1.0, 5.0, 40.0])
@pytest.mark.parametrize(("J_j", "delay"), [(0.0, 0.0), (5e-3, 2e-3)])
@pytest.mark.parametrize(("K_1", "B_1"), [(25.0, 0.66), (5.5, -0.003), (45.0, 1.8)])
def test_the_admittance_solves_the_equations_of_motion(frequency, J_j, delay, K_1, B_1):
    """Eqs. 7 and 8 as a linear system in (theta_m, theta_s) for theta_j = 1."""
    s = 2j * np.pi * frequency
    late = (K_1 + B_1 * s) * np.exp(-s * delay)
    feedback = late + P.B_m * s + P.J_m * s**2
    equations = np.array([[1 / P.n_T, 1.0], [feedback, -P.K_s / P.n_T]])
    _, theta_s = np.linalg.solve(equations, [1.0, 0.0])
    torque = P.K_s * theta_s + P.B_j * s + J_j * s**2

    Y = 1 / dynamic_stiffness(s, K_1, B_1, replace(P, J_j=J_j), delay)

    assert Y == pytest.approx(1 / torque, rel=1e-10)


# ---- The norm of Eq. 14 and its minimum


# All minima B_1 of the default device by Sturm's theorem in rational arithmetic (release 0.2.0):
# K_d, B_d, W.
PROVED = [
    (300, 5, PAPER_WEIGHT, [0.664686846657257]),
    (250, 1e-7, weight_of(7, 3), [0.7027444066679175]),
    (1, 0, weight_of(50, 1), [16.83962680009294]),
    (600, 0, PAPER_WEIGHT, []),
]


def norm_by_quadrature(K_d, B_d, B_1, weight):
    """An integral over frequency; |W|^2 of a Butterworth filter needs no filter design."""
    K_1 = compensator.stiffness_gain(K_d, P)
    log_w = np.linspace(np.log(1e-6), np.log(1e13), 200_001)
    w = np.exp(log_w)
    Y = 1 / dynamic_stiffness(1j * w, K_1, B_1, replace(P, J_j=0.0))
    corner = 2 * np.pi * weight.cutoff_hz
    passed = 1 / (1 + (w / corner) ** (2 * weight.order))
    density = abs(Y - 1 / (K_d + 1j * w * B_d)) ** 2 * passed
    return np.sqrt(np.trapezoid(w * density, log_w) / np.pi)


@pytest.mark.parametrize("weight", [PAPER_WEIGHT, weight_of(0.1, 5), weight_of(50, 1)], ids=str)
@pytest.mark.parametrize(("K_d", "B_d"), [(300, 5), (100, 0), (340, 1e-7)])
def test_the_norm_is_the_integral_over_frequency(K_d, B_d, weight):
    optimum = compensator.optimal_damping(K_d, B_d, P, weight)

    by_quadrature = norm_by_quadrature(K_d, B_d, optimum.B_1, weight)
    assert optimum.error == pytest.approx(by_quadrature, rel=1e-6)


@pytest.mark.parametrize(("K_d", "B_d", "weight", "minima"), PROVED)
def test_minima_are_those_proved_in_rational_arithmetic(K_d, B_d, weight, minima):
    """None where the error falls towards no damping at all."""
    optimum = compensator.optimal_damping(K_d, B_d, P, weight)

    assert optimum.at_lower_bound == (not minima)
    assert optimum.B_1 + P.B_m > 0
    assert optimum.B_1 == pytest.approx(minima[0] if minima else -P.B_m, rel=1e-6)


# ---- What is refused


def test_a_request_for_a_locked_motor_is_refused():
    with pytest.raises(UnreachableImpedanceError, match=r"B_1.*motor"):
        compensator.compensated_gains(600.0, 0.0, P, weight_of(50, 3))


def test_a_locked_motor_leaves_other_rows_of_the_table_as_they_are_alone():
    weight = weight_of(50, 3)

    both = gain_table([600.0, 300.0], [0.0, 5.0], P, weight)

    alone = gain_table([300.0], [5.0], P, weight)
    assert both["unbounded"].to_list() == [True, False]
    assert both["K_predicted"][0] is None
    assert both.row(1) == pytest.approx(alone.row(0))


@pytest.mark.parametrize(
    ("cutoff_hz", "order"),
    [(1, 0), (1, 2.5), (1, 11), (1e-300, 3), (np.inf, 3)],
)
def test_a_weight_that_weighs_nothing_is_refused(cutoff_hz, order):
    with pytest.raises(ValidationError):
        weight_of(cutoff_hz, order)


@pytest.mark.parametrize(
    ("K_d", "B_d", "message"),
    [
        (685.6, 5, r"K_d = 685\.6.*685\.6.*less than K_s"),
        (0, 5, "K_d = 0 .*1e-09"),
        (float("nan"), 5, "K_d = nan"),
        (300, -1, "B_d = -1.*0"),
        (300, 1e300, r"B_d = 1e\+300 N\*m\*s/rad.*1e-09.*1e\+09 N"),
        (1e-300, 5, "K_d = 1e-300 N"),
    ],
)
def test_an_impossible_request_is_refused_with_the_reason(K_d, B_d, message):
    with pytest.raises(UnreachableImpedanceError, match=message):
        compensator.compensated_gains(K_d, B_d, P)


@pytest.mark.parametrize(("K_d", "B_d"), [(float("nan"), 5), (300, float("inf")), (-1, 5)])
def test_uncompensated_gains_of_no_impedance_are_refused(K_d, B_d):
    with pytest.raises(UnreachableImpedanceError, match=r"[KB]_d = (nan|inf|-1)"):
        compensator.uncompensated_gains(K_d, B_d, P)


def test_a_device_of_which_the_belt_s_ratio_alone_is_known_has_no_gains(tmp_path):
    """What needs the ratio has it, and what needs more says which parameter lacks."""
    file = tmp_path / "ours.yaml"
    ratio = 'n_T: {value: 83/18, unit: "1", source: "counted teeth"}'
    file.write_text(f"name: ours\ndescription: our ankle\nparameters:\n  {ratio}\n")

    assert known_parameters(file, ["n_T"]).n_T == 83 / 18
    assert known_parameters(file, ["n_T", "K_s"]) is None
    with refused_with(r"ours\.yaml:.*k_tau \[N\*m/A\]"):
        read_parameters(file)


def test_the_gains_of_another_controller_are_not_known():
    with refused_with(r"'compensatd'.*known.*compensated"):
        compensator.select_gains("compensatd", 300.0, 5.0, P)


# ---- What gains render


def test_uncompensated_gains_are_reflected_through_the_belt():
    gains = compensator.uncompensated_gains(300, 5, P)

    assert gains.K_1 * P.n_T**2 == pytest.approx(300)
    assert gains.B_1 * P.n_T**2 == pytest.approx(5)
    assert not gains.cancels_friction


def test_a_belt_is_wound_by_what_the_joint_turns_beyond_its_actuator():
    assert belt_deflection(0.1, 0.1 * P.n_T, P) == pytest.approx(0, abs=1e-15)
    assert belt_deflection(0.1, 0.05 * P.n_T, P) == pytest.approx(0.05)


def test_of_a_device_without_a_file_nothing_is_stated():
    assert stated_of_device(None) == NOTHING_STATED


@pytest.mark.parametrize(("K_d", "B_d"), [(300.0, 5.0), (100.0, 2.5)])
def test_a_slow_sine_has_the_stiffness_and_damping_of_the_request(K_d, B_d):
    gains = compensator.compensated_gains(K_d, B_d, P)
    slow = np.array([1e-3, 2e-3])
    Z = dynamic_stiffness(2j * np.pi * slow, gains.K_1, gains.B_1, P)

    K, B = predicted_impedance(gains.K_1, gains.B_1, P, slow)

    assert K == pytest.approx(K_d, rel=1e-6)
    assert B == pytest.approx(Z[0].imag / (2 * np.pi * slow[0]), rel=1e-3)


@pytest.mark.parametrize(("K_d", "B_d"), [(300.0, 5.0), (100.0, 2.5)])
def test_slow_motion_loses_no_energy_up_to_the_delay_of_its_damping(K_d, B_d):
    """A delay T turns K_1 into a negative damping K_1 T, which damper and joint make up for."""
    gains = compensator.compensated_gains(K_d, B_d, P)
    kappa = gains.K_1 + P.K_s / P.n_T**2
    of_joint = P.B_j * (kappa * P.n_T / P.K_s) ** 2

    delay = passive_delay(gains.K_1, gains.B_1, P, highest_hz=0.01)

    expected = (P.B_m + gains.B_1 + of_joint) / gains.K_1
    assert delay == pytest.approx(expected, abs=1.1e-4)


def test_energy_is_asked_for_up_to_twice_the_fastest_sine_of_the_protocol():
    gains = compensator.compensated_gains(300.0, 5.0, P)
    fastest_hz = max(CONFIG.dynamometer.frequencies_hz)

    delay = passive_delay(gains.K_1, gains.B_1, P)

    assert delay == passive_delay(gains.K_1, gains.B_1, P, highest_hz=2 * fastest_hz)


def test_the_delay_margin_is_where_a_pole_reaches_the_axis():
    """At the margin 1 + L(jw) exp(-jw delay) = 0 for some w, and for no w at a shorter delay."""
    gains = compensator.compensated_gains(300, 5, P)
    w = np.linspace(0.1, 500, 500_000)
    held_actuator = P.K_s / P.n_T**2 - P.J_m * w**2 + 1j * w * P.B_m
    loop = (gains.K_1 + 1j * w * gains.B_1) / held_actuator

    margin = delay_margin(gains.K_1, gains.B_1, P)

    def distance_from_the_axis(delay):
        return np.abs(1 + loop * np.exp(-1j * w * delay)).min()

    assert distance_from_the_axis(margin) < 1e-3
    assert min(distance_from_the_axis(share * margin) for share in (0.5, 0.9, 0.98)) > 5e-3
