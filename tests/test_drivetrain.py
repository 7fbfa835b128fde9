"""Eqs. 1-4 and 8-11 against the paper's equations, solved independently; the drivetrain of Eq. 9 in time."""

import numpy as np
import pytest
from conftest import multisine
from hypothesis import given
from hypothesis import strategies as st

from osl_analysis.model import drivetrain_response
from osl_analysis.model.compensator import (
    Gains,
    compensated_gains,
    motor_current,
    smooth_sign,
    uncompensated_gains,
)
from osl_analysis.model.drivetrain import (
    actuator_torque,
    belt_deflection,
    desired_admittance,
    joint_admittance,
    motor_friction,
    resisting_torque,
)
from osl_analysis.model.drivetrain_response import Friction, belt_response
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.simulator.drivetrain import IDEAL, ControlCommands, simulate_drivetrain

FREQUENCIES = np.array([0.0, 0.3, 1.0, 5.0, 40.0])
RATE = 1000.0
NONE, TRUE = Friction(0.0, 0.05), Friction(1.0, 0.05)


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


def sine(frequency_hz, cycles=20, amplitude=0.05):
    t = np.arange(round(cycles / frequency_hz * RATE)) / RATE
    return t, amplitude * np.sin(2 * np.pi * frequency_hz * t)


def changed(p, **values):
    return DrivetrainParameters(**{**p.__dict__, **values})


@pytest.mark.parametrize("frequency_hz", [1.0, 5.0, 10.0])
def test_without_friction_a_sine_is_answered_by_equation_9(parameters, frequency_hz):
    """Belt torque is the joint's without B_j and J_j: 1/Y - B_j s. Straight lines lose 4e-4 of a sine at 10 Hz."""
    gains = uncompensated_gains(300, 5, parameters)
    t, theta = sine(frequency_hz)
    torque = belt_response(theta, RATE, gains, parameters, NONE)
    settled = t > t[-1] / 2
    w = 2 * np.pi * frequency_hz
    phasor = 2j * np.mean((torque * np.exp(-1j * w * t))[settled]) / 0.05
    expected = 1 / joint_admittance(gains.K_1, gains.B_1, parameters)(1j * w) - 1j * w * parameters.B_j
    assert phasor == pytest.approx(complex(expected), rel=2e-3)


def test_it_starts_at_rest_in_equilibrium(parameters):
    gains = uncompensated_gains(300, 5, parameters)
    torque = belt_response(np.full(500, 0.1), RATE, gains, parameters, TRUE)
    series = 1 / (1 / parameters.K_s + 1 / (gains.K_1 * parameters.n_T**2))
    assert torque == pytest.approx(np.full(500, 0.1 * series), rel=1e-9)


def test_friction_beyond_every_torque_locks_the_motor(parameters):
    """One torque per step brings the velocity back to 0 at its end; within it the motor gives way by 3e-4."""
    stuck = changed(parameters, f_C=1e4)
    _, theta = sine(3.0)
    torque = belt_response(theta, RATE, uncompensated_gains(300, 5, stuck), stuck, TRUE)
    assert torque == pytest.approx(parameters.K_s * theta, abs=5e-4 * np.max(torque))


def test_friction_holds_up_to_its_limit_and_no_further(parameters):
    """A joint that creeps away: the motor stays until the belt pulls with f_C n_T, then follows."""
    gains, still = Gains(40.0, 1.0, cancels_friction=False), changed(parameters, f_G=0.0)
    theta = np.linspace(0, 0.05, 20_000)
    torque = belt_response(theta, RATE, gains, still, TRUE)
    locked = parameters.K_s * theta
    broke_away = int(np.argmax(torque < locked - 1e-9))
    assert locked[broke_away] == pytest.approx(parameters.f_C * parameters.n_T, rel=0.01)
    series = 1 / (1 / parameters.K_s + 1 / (gains.K_1 * parameters.n_T**2))
    assert np.polyfit(theta[10_000:], torque[10_000:], 1)[0] == pytest.approx(series, rel=0.05)


def test_friction_takes_energy_and_cancelling_gives_most_of_it_back(parameters):
    _, theta = sine(2.0)
    last = slice(-500, None)

    def work(gains, friction):
        torque = belt_response(theta, RATE, gains, parameters, friction)
        return np.sum(torque[last] * np.gradient(theta)[last])

    plain = compensated_gains(200, 5, parameters)
    linear = work(Gains(plain.K_1, plain.B_1, False), NONE)
    lost = work(Gains(plain.K_1, plain.B_1, False), TRUE) - linear
    left = work(plain, TRUE) - linear
    assert lost > 0.1
    assert abs(left) < 0.25 * lost


@pytest.mark.parametrize("K_s2", [0.0, 14913.0])
@pytest.mark.parametrize("controller", [compensated_gains, uncompensated_gains])
def test_two_integrators_that_share_nothing_agree(parameters, controller, K_s2):
    """The simulator's fine explicit steps against exact linear steps of a sample: 1 % of the torque."""
    p = changed(parameters, K_s2=K_s2)
    gains = controller(300, 5, p)
    t = np.arange(6000) / RATE
    w = 2 * np.pi * 2.0
    theta, omega = 0.07 * (1 - np.cos(w * t)) / 2, 0.035 * w * np.sin(w * t)
    one = np.ones_like(t)
    commands = ControlCommands(gains.K_1 * one, gains.B_1 * one, 0 * one, gains.cancels_friction)
    effects = IDEAL.__class__(**{**IDEAL.__dict__, "friction": True, "sign_width": 0.05, "control_updates": 20})
    expected = simulate_drivetrain(RATE, theta, omega, commands, effects, p).belt_torque
    found = belt_response(theta, RATE, gains, p, TRUE)
    assert np.std(found - expected) < 0.01 * np.std(expected)


def test_more_friction_means_more_torque_on_the_way_up(parameters):
    gains = uncompensated_gains(200, 5, parameters)
    theta = np.linspace(0, 0.1, 3000)
    ends = [belt_response(theta, RATE, gains, parameters, Friction(scale, 0.05))[-1] for scale in (0, 0.5, 1, 2)]
    assert np.all(np.diff(ends) > 0.1)


def test_without_a_compiler_plain_python_gives_the_same_numbers(parameters, monkeypatch):
    _, theta = sine(2.0, cycles=1)
    gains = compensated_gains(200, 5, parameters)
    fast = belt_response(theta, RATE, gains, parameters, TRUE)
    monkeypatch.setattr(drivetrain_response, "numba", None)
    monkeypatch.setattr(drivetrain_response, "actuator_path", drivetrain_response.actuator_path.py_func)
    assert (belt_response(theta, RATE, gains, parameters, TRUE) == fast).all()
