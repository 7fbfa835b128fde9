"""Eqs. 1-4 and 8-11 solved independently; both drivetrains in time, against linear and sampled-data theory."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import given
from hypothesis import strategies as st

from osl_analysis.model.compensator import (
    Gains,
    compensated_gains,
    motor_current,
    uncompensated_gains,
)
from osl_analysis.model.drivetrain import (
    actuator_torque,
    belt_torque,
    desired_admittance,
    joint_admittance,
    motor_friction,
)
from osl_analysis.model.drivetrain_response import belt_response
from osl_analysis.model.parameters import read_parameters
from osl_analysis.simulator.drivetrain import (
    IDEAL,
    belt_path,
    constants,
    simulate_drivetrain,
)

FREQUENCIES = np.array([0.0, 0.3, 1.0, 5.0, 40.0])
RATE = 1000.0
TRUE = (1.0, 0.05)  # friction and sign_width
P = read_parameters(ROOT / "config/parameters/default.yaml")
CONTINUOUS = IDEAL | {"substeps": 100, "control_updates": 100}


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
        assert desired_admittance(200, B_1)(s) == pytest.approx(1 / (200 + max(B_1, 0) * s))


def constant(n, K_1, B_1=0.0, theta_eq=0.0):
    return np.outer([K_1, B_1, theta_eq], np.ones(n))


def test_it_starts_at_rest_in_equilibrium(parameters):
    gains = uncompensated_gains(300, 5, parameters)
    torque = belt_response(np.full(500, 0.1), RATE, gains, parameters, *TRUE)
    series = 1 / (1 / parameters.K_s + 1 / (gains.K_1 * parameters.n_T**2))
    assert torque == pytest.approx(np.full(500, 0.1 * series), rel=1e-9)


def test_friction_holds_up_to_its_limit_and_no_further(parameters):
    """A joint that creeps away: the motor stays until the belt pulls with f_C n_T, then follows."""
    gains, still = Gains(40.0, 1.0, cancels_friction=False), replace(parameters, f_G=0.0)
    theta = np.linspace(0, 0.05, 20_000)
    torque = belt_response(theta, RATE, gains, still, *TRUE)
    locked = parameters.K_s * theta
    broke_away = int(np.argmax(torque < locked - 1e-9))
    assert locked[broke_away] == pytest.approx(parameters.f_C * parameters.n_T, rel=0.01)
    series = 1 / (1 / parameters.K_s + 1 / (gains.K_1 * parameters.n_T**2))
    assert np.polyfit(theta[10_000:], torque[10_000:], 1)[0] == pytest.approx(series, rel=0.05)


@pytest.mark.parametrize("K_s2", [0.0, 14913.0])
@pytest.mark.parametrize("controller", [compensated_gains, uncompensated_gains])
def test_two_integrators_that_share_nothing_agree(parameters, controller, K_s2):
    """The simulator's fine explicit steps against exact linear steps of a sample: 1 % of the torque."""
    p = replace(parameters, K_s2=K_s2)
    gains = controller(300, 5, p)
    t = np.arange(6000) / RATE
    w = 2 * np.pi * 2.0
    theta, omega = 0.07 * (1 - np.cos(w * t)) / 2, 0.035 * w * np.sin(w * t)
    commands = constant(len(t), gains.K_1, gains.B_1)
    own = {"cancels_friction": gains.cancels_friction, "sign_width": 0.05, "control_updates": 20}
    effects = IDEAL | {"friction": True} | own
    expected = simulate_drivetrain(RATE, theta, omega, commands, effects, p)["belt_torque"]
    found = belt_response(theta, RATE, gains, p, *TRUE)
    assert np.std(found - expected) < 0.01 * np.std(expected)


def joint_stiffness_at(frequency_hz, gains, effects, p=P):
    """Complex torque over angle from whole settled cycles of a simulated sine, without J_j."""
    w, t = 2 * np.pi * frequency_hz, np.arange(int(8 * RATE)) / RATE
    theta, omega = 0.07 * np.sin(w * t), 0.07 * w * np.cos(w * t)
    commands = constant(len(t), gains.K_1, gains.B_1)
    effects = effects | {"cancels_friction": gains.cancels_friction}
    motion = simulate_drivetrain(RATE, theta, omega, commands, effects, p)
    settled = slice(int(4 * RATE), None)
    turn = np.exp(-1j * w * t[settled])
    return ((motion["belt_torque"] + p.B_j * omega)[settled] @ turn) / (theta[settled] @ turn)


@pytest.mark.parametrize("frequency_hz", [1, 3, 5])
@pytest.mark.parametrize("gains", [compensated_gains(300, 5, P), uncompensated_gains(300, 5, P)])
def test_without_imperfections_the_joint_is_the_admittance_of_eq_9(frequency_hz, gains):
    Y = joint_admittance(gains.K_1, gains.B_1, P)(2j * np.pi * frequency_hz)
    assert abs(joint_stiffness_at(frequency_hz, gains, CONTINUOUS) * Y - 1) < 3e-4


def sampled_data_stiffness(frequency_hz, gains, delay, cutoff_hz, updates):
    """Independent formula: held and delayed feedback of angle and filtered difference, at one frequency."""
    s, T = 2j * np.pi * frequency_hz, 1 / (RATE * updates)
    hold = (1 - np.exp(-s * T)) / (s * T) * np.exp(-s * T * delay)
    a = 1 - np.exp(-2 * np.pi * cutoff_hz * T)
    difference = (1 - np.exp(-s * T)) / T * a / (1 - (1 - a) * np.exp(-s * T))
    control = hold * (gains.K_1 + gains.B_1 * difference)
    M = P.J_m * s**2 + P.B_m * s + control
    return P.B_j * s + P.K_s * M / (M + P.K_s / P.n_T**2)


@pytest.mark.parametrize(("delay", "updates"), [(0, 1), (1, 1), (4, 1), (0, 5), (6, 5)])
@pytest.mark.parametrize("frequency_hz", [1, 5])
def test_hold_delay_and_velocity_filter_shift_the_phase_as_sampled_data_theory_says(delay, updates, frequency_hz):
    gains = uncompensated_gains(300, 5, P)
    effects = IDEAL | {"control_delay": delay, "velocity_cutoff_hz": 40.0, "control_updates": updates}
    found = joint_stiffness_at(frequency_hz, gains, effects)
    assert found == pytest.approx(sampled_data_stiffness(frequency_hz, gains, delay, 40.0, updates), rel=5e-4)


def pushed_with(torque, n, effects):
    """An actuator without damping or belt under a constant control torque, from rest."""
    p = replace(P, B_m=0.0, K_s=1e-9)
    commands = constant(n, 1e-9, theta_eq=torque / 1e-9)
    return simulate_drivetrain(RATE, np.zeros(n), np.zeros(n), commands, effects, p)


@pytest.mark.parametrize(("torque", "sign"), [(2.0, 1), (-2.0, -1)])
@pytest.mark.parametrize("scale", [1.0, 1.5])
def test_friction_brakes_by_coulomb_and_gear_friction(torque, sign, scale):
    motion = pushed_with(torque, 201, IDEAL | {"friction": True, "friction_scale": scale})
    friction = scale * (P.f_C + P.f_G * 2.0 / (P.k_tau * P.n_m))
    t = np.arange(201) / RATE
    assert motion["omega_m"] == pytest.approx(sign * (2.0 - friction) / P.J_m * t, rel=1e-9, abs=1e-12)


def test_the_actuator_sticks_below_the_breakaway_torque_and_moves_above_it():
    friction = IDEAL | {"friction": True}
    breakaway = P.f_C / (1 - P.f_G / (P.k_tau * P.n_m))
    assert not np.any(pushed_with(0.999 * breakaway, 500, friction)["theta_m"])
    assert pushed_with(1.001 * breakaway, 500, friction)["theta_m"][-1] > 0


def test_friction_never_reverses_a_motion_that_it_stops():
    n = 4000
    gains = constant(n, 2.0)
    theta = np.full(n, 0.05)
    motion = simulate_drivetrain(RATE, theta, np.zeros(n), gains, IDEAL | {"friction": True}, P)
    assert np.any(motion["omega_m"] != 0)
    assert np.all(motion["omega_m"][-1000:] == 0)


def test_a_controller_that_cancels_friction_accelerates_the_bare_inertia():
    motion = pushed_with(3.0, 400, IDEAL | {"friction": True, "sign_width": 0.01, "cancels_friction": True})
    gained = (motion["omega_m"][-1] - motion["omega_m"][100]) * RATE / 299
    assert gained == pytest.approx(3.0 / P.J_m, rel=1e-7)


def test_without_friction_the_controller_has_none_to_cancel():
    gains = compensated_gains(300, 5, P)
    cancelling = joint_stiffness_at(2, gains, IDEAL)
    assert cancelling == joint_stiffness_at(2, replace(gains, cancels_friction=False), IDEAL)


def test_a_belt_without_hysteresis_is_the_models_belt():
    p, theta_s = replace(P, K_s2=14913.0), np.linspace(-0.05, 0.08, 50)
    assert belt_path(theta_s, constants(IDEAL, p)) == pytest.approx(belt_torque(theta_s, p), rel=1e-14)


def test_hysteresis_costs_the_area_of_its_loop_whatever_the_speed():
    effects = IDEAL | {"hysteresis_torque": 2.0, "hysteresis_width": 0.002}
    up = np.linspace(-0.05, 0.05, 20001)
    for cycle in (np.concatenate([up, up[-2::-1]]), np.concatenate([up[::100], up[-2::-1]])):
        path = np.concatenate([cycle, cycle[1:]])
        torque = belt_path(path, constants(effects, P))[len(cycle) - 1 :]
        area = np.trapezoid(torque, path[len(cycle) - 1 :])
        assert area == pytest.approx(2.0 * (4 * 0.05 - 4 * 0.002), rel=2e-3)


def test_a_command_holds_from_its_own_sample():
    """With the equilibrium at k in sample k, an actuator that rests at 0 gets the current for a torque of K_1 k."""
    commands = np.array([np.full(6, 2.0), np.zeros(6), np.arange(6.0)])
    heavy = replace(P, J_m=1e9)
    motion = simulate_drivetrain(RATE, np.zeros(6), np.zeros(6), commands, IDEAL, heavy)
    assert motion["current"] == pytest.approx(2.0 * np.arange(6.0) / (P.k_tau * P.n_m), rel=1e-9)
