"""Eqs. 1-4 and 8-11: each function against the paper's equations, solved independently."""

import numpy as np
import pytest
from conftest import multisine
from hypothesis import given
from hypothesis import strategies as st

from osl_analysis.model.compensator import motor_current, smooth_sign
from osl_analysis.model.drivetrain import (
    actuator_torque,
    belt_deflection,
    desired_admittance,
    joint_admittance,
    motor_friction,
    resisting_torque,
)

FREQUENCIES = np.array([0.0, 0.3, 1.0, 5.0, 40.0])


def test_actuator_torque_is_the_sum_of_equation_1(parameters):
    p = parameters
    by_hand = 4.0 * 0.1133 * 9 - (0.377 + 0.0896 * 4.0) - 5.6e-3 * 2.0 - 9.211e-3 * 30.0
    assert actuator_torque(4.0, 2.0, 30.0, p) == pytest.approx(by_hand)


def test_friction_opposes_motion_and_grows_with_the_magnitude_of_the_current(parameters):
    assert motor_friction(-1.0, -10.0, parameters) == pytest.approx(-(0.377 + 0.896))
    assert motor_friction(0.0, 5.0, parameters) == 0


@given(u=st.floats(-20, 20), s=st.floats(-1, 1))
def test_closed_form_of_equation_5_solves_the_implicit_equation(parameters, u, s):
    p = parameters
    current = float(motor_current(u, s, p))
    assert current * p.k_tau * p.n_m == pytest.approx(u + float(motor_friction(s, current, p)), abs=1e-12)


def test_friction_cancelled_leaves_equation_6(parameters):
    omega_m, alpha_m, u = 0.7, 12.0, -3.0
    current = motor_current(u, np.sign(omega_m), parameters)
    linear = u - parameters.B_m * omega_m - parameters.J_m * alpha_m
    assert actuator_torque(current, omega_m, alpha_m, parameters) == pytest.approx(linear)


def test_smooth_sign_saturates_and_is_odd():
    assert smooth_sign([-10.0, 0.0, 10.0], 0.1) == pytest.approx([-1, 0, 1])


@pytest.mark.parametrize("J_j", [0.0, 5e-3])
@pytest.mark.parametrize(("K_1", "B_1"), [(25.0, 0.66), (5.5, -0.003), (45.0, 1.8)])
def test_admittance_solves_the_equations_of_motion(parameters, K_1, B_1, J_j):
    """Eqs. 7 and 8 as a linear system in (theta_m, theta_s) for theta_j = 1, per frequency."""
    p = parameters
    for f in FREQUENCIES:
        s = 2j * np.pi * f
        feedback = K_1 + (p.B_m + B_1) * s + p.J_m * s**2
        equations = np.array([[1 / p.n_T, 1.0], [feedback, -p.K_s / p.n_T]])
        _, theta_s = np.linalg.solve(equations, [1.0, 0.0])
        torque = p.K_s * theta_s + p.B_j * s + J_j * s**2
        assert joint_admittance(K_1, B_1, p, J_j)(s) == pytest.approx(1 / torque, rel=1e-10)


def test_admittance_without_joint_inertia_is_equation_10_term_by_term(parameters):
    p, K_1, B_1 = parameters, 25.0, 0.66
    B, K = p.B_m + B_1, K_1 + p.K_s / p.n_T**2
    d = [p.J_m * p.B_j, B * p.B_j + p.K_s * p.J_m, p.K_s * B + K * p.B_j, K_1 * p.K_s]
    assert joint_admittance(K_1, B_1, p).denominator == pytest.approx(d)


def test_resisting_torque_at_rest_is_two_springs_in_series(parameters):
    p, K_1, theta = parameters, 25.0, 0.1
    theta_m = theta * p.n_T * p.K_s / (p.K_s + p.n_T**2 * K_1)
    torque = resisting_torque(belt_deflection(theta, theta_m, p), 0.0, 0.0, p)
    assert torque / theta == pytest.approx(1 / (1 / p.K_s + 1 / (p.n_T**2 * K_1)))


def test_resisting_torque_adds_damping_and_inertia_of_the_joint(parameters):
    motion = multisine(1.3)
    torque = resisting_torque(0 * motion.theta, motion.omega, motion.alpha, parameters)
    assert torque == pytest.approx(0.452 * motion.omega + 5e-3 * motion.alpha)


def test_desired_admittance_is_a_spring_and_a_damper():
    assert desired_admittance(200, 7.5)(2j) == pytest.approx(1 / (200 + 15j))
    assert desired_admittance(200, 0)(2j) == pytest.approx(1 / 200)
