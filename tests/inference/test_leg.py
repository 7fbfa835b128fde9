# SPDX-License-Identifier: Apache-2.0
"""The inference of a leg: two masses with friction that grows with the current, integrated here."""

from functools import cache

import numpy as np

from osl_analysis.inference import BenchSignals, frictionless_actuator

RATE = 500.0
K_S = 700.0  # belt, joint, ratio
B_J = 0.5
J_J = 0.005
N_T = 4.6
J_M = 0.009  # actuator and its controller
B_M = 0.006
K_1 = 14.0
B_1 = 0.2
# 1 N*m/A; friction [N*m], and its growth with the current [N*m/A]
CONSTANT = 0.4
OF_LOAD = 0.09
HYSTERESIS = 0.25  # N*m


LINES = 2j * np.pi * np.linspace(0.5, 5.0, 12)  # [rad/s]


def waves(time: np.ndarray) -> np.ndarray:
    """The sines (12, n) up to 5 Hz, whose imaginary parts make the joint's angle."""
    phases = np.random.default_rng(1).uniform(0, 6, 12)
    return 0.02 * np.exp(np.outer(LINES, time) + 1j * phases[:, None])


def joint_motion(time: np.ndarray) -> np.ndarray:
    """Angle, velocity and acceleration (3, n)."""
    sines = waves(time)
    return np.array([(LINES**k @ sines).imag for k in range(3)])


@cache
def leg() -> dict[str, np.ndarray]:
    """Signals of the leg, at five steps of integration per sample; friction never drives."""
    steps = 5
    step = 0.2 / RATE
    time = np.arange(round(40 * RATE * steps)) * step
    theta, omega, alpha = joint_motion(time)
    theta_m, omega_m, current, belt = np.zeros((4, len(time)))
    angle = N_T * theta[0] * 0.7
    speed = 0.0
    wound = 0.0
    deflection = theta[0] - angle / N_T
    for k in range(len(time)):
        before = deflection
        deflection = theta[k] - angle / N_T
        wound = min(max(wound + (deflection - before) / 1e-3, -1.0), 1.0)
        belt[k] = K_S * deflection + HYSTERESIS * wound
        current[k] = -(K_1 * angle + B_1 * speed)
        theta_m[k], omega_m[k] = angle, speed
        push = current[k] + belt[k] / N_T - B_M * speed
        free = speed + step / J_M * push
        lost = step / J_M * (CONSTANT + OF_LOAD * abs(current[k]))
        speed = np.sign(free) * max(abs(free) - lost, 0.0)
        angle += step * speed
    sampled = slice(None, None, steps)
    torque = belt + B_J * omega + J_J * alpha
    signals = {"theta": theta, "torque": torque, "theta_m": theta_m, "current": current}
    return {name: x[sampled] for name, x in signals.items()}


def signals(**changes: object) -> BenchSignals:
    recorded = leg()
    rng = np.random.default_rng(2)
    noisy = recorded["torque"] + 0.05 * rng.normal(size=len(recorded["torque"]))
    step = 2.4e-5
    step_m = 4.3e-5
    of_leg = {
        "theta": np.round(recorded["theta"] / step) * step,
        "torque": noisy,
        "rate_hz": RATE,
        "encoder_step": step,
        "sliding_angle": np.round(recorded["theta_m"] / step_m) * step_m,
        "load": recorded["current"],
    }
    return BenchSignals(**{**of_leg, **changes})


@cache
def found():
    return frictionless_actuator(signals())


def test_an_actuator_without_friction_moves_as_its_equation_says():
    """Against the sines that Eqs. 1, 2 and 7 answer without friction; the belt's hysteresis stays
    within a few percent."""
    time = np.arange(0, 40.0, 1 / RATE)
    of_actuator = J_M * LINES**2 + (B_M + B_1) * LINES + K_1 + K_S / N_T**2
    true = ((K_S / N_T / of_actuator) @ waves(time)).imag

    angle = found().angles(leg()["theta"], 0 * time, RATE)[0]

    inside = slice(2500, -2500)
    apart = (angle - angle.mean() - true + true.mean())[inside]
    recorded = leg()["theta_m"]
    by_friction = (recorded - recorded.mean() - true + true.mean())[inside]
    assert np.std(apart) < 0.15 * np.std(by_friction)


def test_the_friction_of_the_actuator_is_found():
    assert found().friction_probability > 0.99
