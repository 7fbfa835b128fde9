"""The drivetrain of Eq. 9 in time: its linear part is Eq. 9, its friction stops and never drives."""

import numpy as np
import pytest

from osl_analysis.model.compensator import Gains, compensated_gains, uncompensated_gains
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.model.drivetrain_response import Friction, belt_response
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.simulator.drivetrain_sim import IDEAL, ControlCommands, simulate_drivetrain

RATE = 1000.0
NONE, TRUE = Friction(0.0, 0.05), Friction(1.0, 0.05)


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
