"""Drivetrains in time, of simulator and analysis: against each other, linear and sampled-data
theory, and friction by hand."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT

from osl_analysis.model import compensator, drivetrain
from osl_analysis.model.actuator_in_time import Controller, belt_responses
from osl_analysis.model.drivetrain import read_parameters
from osl_analysis.simulator.two_mass_drivetrain import (
    IDEAL,
    belt_path,
    constants,
    simulate_drivetrain,
    turned_belt,
)

P = read_parameters(ROOT / "config/parameters/default.yaml")
RATE = 1000.0
WIDTH = 0.05  # velocity [rad/s] over which the sign is smoothed
WITH_FRICTION = {**IDEAL, "friction": True}


def commands_of(gains):
    """Constant gains about an equilibrium at 0."""
    return np.array([[gains.K_1], [gains.B_1], [0.0]])


# ---- Both integrators


@pytest.mark.parametrize("K_s2", [0.0, 14913.0])
@pytest.mark.parametrize(
    "controller", [compensator.compensated_gains, compensator.uncompensated_gains]
)
def test_two_integrators_that_share_nothing_agree(controller, K_s2):
    """The simulator's fine explicit steps against exact linear steps of a sample: 1 % of the
    torque."""
    p = replace(P, K_s2=K_s2)
    gains = controller(300, 5, p)
    w = 2 * np.pi * 2.0
    time = np.arange(6000) / RATE
    theta = 0.07 * (1 - np.cos(w * time)) / 2
    omega = 0.035 * w * np.sin(w * time)
    effects = {
        **WITH_FRICTION,
        "cancels_friction": gains.cancels_friction,
        "sign_width": WIDTH,
        "control_updates": 20,
    }

    simulated = simulate_drivetrain(RATE, theta, omega, commands_of(gains), effects, p)
    (predicted,) = belt_responses(theta, RATE, [(Controller(gains, p, WIDTH), p)])

    expected = simulated["belt_torque"]
    assert np.std(predicted - expected) < 0.01 * np.std(expected)


def test_a_joint_in_equilibrium_resists_with_the_desired_stiffness():
    law = Controller(compensator.compensated_gains(300, 5, P), P, WIDTH)

    (torque,) = belt_responses(np.full(50, 0.2), RATE, [(law, P)])

    np.testing.assert_allclose(torque, 300 * 0.2)


# ---- The sampled controller


def stiffness_by_simulation(frequency_hz, gains, effects):
    """Complex torque over angle from whole settled cycles of a simulated sine, without J_j."""
    w = 2 * np.pi * frequency_hz
    time = np.arange(int(8 * RATE)) / RATE
    theta = 0.07 * np.sin(w * time)
    omega = 0.07 * w * np.cos(w * time)
    leg = simulate_drivetrain(RATE, theta, omega, commands_of(gains), effects, P)
    torque = leg["belt_torque"] + P.B_j * omega
    settled = slice(int(4 * RATE), None)
    sine = np.exp(-1j * w * time[settled])
    return (torque[settled] @ sine) / (theta[settled] @ sine)


def stiffness_by_sampled_data_theory(frequency_hz, gains, delay, cutoff_hz, updates):
    """Independent formula: held and delayed feedback of angle and filtered difference, at one
    frequency."""
    s = 2j * np.pi * frequency_hz
    T = 1 / (RATE * updates)
    hold = (1 - np.exp(-s * T)) / (s * T) * np.exp(-s * T * delay)
    a = 1 - np.exp(-2 * np.pi * cutoff_hz * T)
    difference = (1 - np.exp(-s * T)) / T * a / (1 - (1 - a) * np.exp(-s * T))
    M = P.J_m * s**2 + P.B_m * s + hold * (gains.K_1 + gains.B_1 * difference)
    return P.B_j * s + P.K_s * M / (M + P.K_s / P.n_T**2)


@pytest.mark.parametrize(("delay", "updates"), [(0, 1), (1, 1), (4, 1), (0, 5), (6, 5)])
@pytest.mark.parametrize("frequency_hz", [1, 5])
def test_delays_shift_the_phase_as_sampled_data_theory_says(delay, updates, frequency_hz):
    gains = compensator.uncompensated_gains(300, 5, P)
    effects = {
        **IDEAL,
        "control_delay": delay,
        "velocity_cutoff_hz": 40.0,
        "control_updates": updates,
    }

    simulated = stiffness_by_simulation(frequency_hz, gains, effects)

    theory = stiffness_by_sampled_data_theory(frequency_hz, gains, delay, 40.0, updates)
    assert simulated == pytest.approx(theory, rel=5e-4)


def test_a_command_holds_from_its_own_sample():
    """With the equilibrium at k in sample k, an actuator that rests at 0 gets the current for a
    torque of K_1 k."""
    k = np.arange(6.0)
    heavy = replace(P, J_m=1e9)
    commands = np.array([np.full(6, 2.0), np.zeros(6), k])

    leg = simulate_drivetrain(RATE, np.zeros(6), np.zeros(6), commands, IDEAL, heavy)

    assert leg["current"] == pytest.approx(2.0 * k / (P.k_tau * P.n_m), rel=1e-9)


# ---- Friction


def pushed_with(torque, n, effects):
    """An actuator without damping or belt under a constant control torque, from rest."""
    free = replace(P, B_m=0.0, K_s=1e-9)
    commands = np.array([[1e-9], [0.0], [torque / 1e-9]])
    return simulate_drivetrain(RATE, np.zeros(n), np.zeros(n), commands, effects, free)


@pytest.mark.parametrize(("torque", "sign"), [(2.0, 1), (-2.0, -1)])
@pytest.mark.parametrize("scale", [1.0, 1.5])
def test_friction_brakes_by_coulomb_and_gear_friction(torque, sign, scale):
    friction = scale * (P.f_C + P.f_G * 2.0 / (P.k_tau * P.n_m))
    time = np.arange(201) / RATE

    leg = pushed_with(torque, 201, {**WITH_FRICTION, "friction_scale": scale})

    by_hand = sign * (2.0 - friction) / P.J_m * time
    assert leg["omega_m"] == pytest.approx(by_hand, rel=1e-9, abs=1e-12)


def test_the_actuator_sticks_below_the_breakaway_torque_and_moves_above_it():
    breakaway = P.f_C / (1 - P.f_G / (P.k_tau * P.n_m))

    below = pushed_with(0.999 * breakaway, 500, WITH_FRICTION)
    above = pushed_with(1.001 * breakaway, 500, WITH_FRICTION)

    assert not np.any(below["theta_m"])
    assert above["theta_m"][-1] > 0


def test_a_controller_that_cancels_friction_accelerates_the_bare_inertia():
    effects = {**WITH_FRICTION, "sign_width": 0.01, "cancels_friction": True}

    omega_m = pushed_with(3.0, 400, effects)["omega_m"]

    acceleration = (omega_m[-1] - omega_m[100]) * RATE / 299
    assert acceleration == pytest.approx(3.0 / P.J_m, rel=1e-7)


# ---- The belt


def test_a_belt_without_hysteresis_has_the_torque_of_the_model():
    p = replace(P, K_s2=14913.0)
    theta_s = np.linspace(-0.05, 0.08, 50)

    torque = belt_path(theta_s, constants(IDEAL, p))

    assert torque == pytest.approx(drivetrain.belt_torque(theta_s, p), rel=1e-14)


def test_the_series_of_a_short_turn_is_the_exponential():
    by_hand = 0.3 - 0.7 * np.expm1(-0.06)

    z = turned_belt(theta_s=0.0, z=0.3, turned_to=0.06, per_rad=1.0)

    assert z == pytest.approx(by_hand, rel=1e-14, abs=0)


UP = np.linspace(-0.05, 0.05, 20001)


@pytest.mark.parametrize("way_up", [UP, UP[::100]], ids=["fine", "coarse"])
def test_a_cycle_loses_the_energy_of_its_hysteresis_whatever_its_steps(way_up):
    cycle = np.concatenate([way_up, UP[-2::-1]])
    path = np.concatenate([cycle, cycle[1:]])
    effects = {**IDEAL, "hysteresis_torque": 2.0, "hysteresis_width": 0.002}

    torque = belt_path(path, constants(effects, P))

    second = slice(len(cycle) - 1, None)
    lost = np.trapezoid(torque[second], path[second])
    assert lost == pytest.approx(2.0 * (4 * 0.05 - 4 * 0.002), rel=2e-3)


def test_the_belt_of_a_leg_whose_actuator_stands_has_the_torque_of_its_path():
    """An actuator that is too heavy to move, so that all of the joint's angle deflects the belt."""
    heavy = replace(P, J_m=1e9)
    effects = {**IDEAL, "hysteresis_torque": 2.0, "hysteresis_width": 0.002}
    w = 2 * np.pi * 1.0
    time = np.arange(2000) / RATE
    theta = 0.05 * (1 - np.cos(w * time))
    omega = 0.05 * w * np.sin(w * time)

    leg = simulate_drivetrain(RATE, theta, omega, np.ones((3, 1)) * 1e-9, effects, heavy)

    of_path = belt_path(theta, constants(effects, heavy))
    assert leg["belt_torque"] == pytest.approx(of_path, abs=2e-3)
