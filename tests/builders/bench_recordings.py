# SPDX-License-Identifier: Apache-2.0
"""A sound recording of each experiment of the bench, by column."""

import numpy as np
from bench_synthetic import by_hand, schedule, second_order, stepped_sine

RATE = 500.0
NOISE = np.random.default_rng(4)


def driven(torque_of=second_order):
    record = stepped_sine(torque_of, noise=0.05)
    return {"time": record.time, "theta": record.theta, "torque": record.torque}


def losses(motion):
    return 0.452 * motion.omega + 0.005 * motion.alpha


def loaded_belt():
    time = np.arange(round(10 * RATE)) / RATE
    theta = np.deg2rad(5) / 2 * (1 - np.cos(2 * np.pi * np.clip((time - 1.5) / 7, 0, 1)))
    noise = 0.05 * NOISE.standard_normal(time.size)
    return {
        "time": time,
        "theta": theta,
        "theta_m": np.full(time.size, 0.1),
        "torque": 685.6 * theta + noise,
    }


def free_actuator():
    time, theta, omega, alpha, current = schedule()
    torque = by_hand(omega, alpha, current) + 0.05 * NOISE.standard_normal(time.size)
    samples = {"time": time, "theta_m": theta, "current": current, "torque_m": torque}
    return {name: signal[::2] for name, signal in samples.items()}


RECORDINGS = {
    "impedance": driven(),
    "transmission": driven(losses),
    "belt": loaded_belt(),
    "actuator": free_actuator(),
}
