# SPDX-License-Identifier: Apache-2.0
"""Recordings of an exoskeleton's knee on a bench, made by formula: three for docs/five_minutes.md,
whose columns are called as a laboratory calls them, and `k300.csv` for the README, whose columns
are named by signal and unit.

Each knee is 7 % softer than it was asked to be, with a damping of 1.4 N·m·s/rad where 1 was asked
for, and an inertia of 0.03 kg·m². The load cell counts the other way.
"""

from pathlib import Path

import numpy as np

RATE = 100  # Hz
AMPLITUDE = np.radians(5)
SINES = ((1, 1.0), (10, 2.0), (16, 3.0))  # start in s, frequency in Hz
CYCLES = 8
TRUE_SHARE_OF_K, B, I = 0.93, 1.4, 0.03

noise = np.random.default_rng(1)
time = np.arange(0, 20, 1 / RATE)
angle, velocity, acceleration = np.zeros((3, time.size))
for start, frequency in SINES:
    now = (time >= start) & (time < start + CYCLES / frequency)
    w = 2 * np.pi * frequency
    angle[now] = AMPLITUDE * np.sin(w * (time[now] - start))
    velocity[now] = AMPLITUDE * w * np.cos(w * (time[now] - start))
    acceleration[now] = -(w**2) * angle[now]
RECORDINGS = (  # file, stiffness that was asked for in N·m/rad, column of the angle
    ("knee_K100_B1.csv", 100, "knee_angle_deg"),
    ("knee_K150_B1.csv", 150, "knee_angle_deg"),
    ("knee_K200_B1.csv", 200, "knee_angle_deg"),
    ("k300.csv", 300, "theta_deg"),
)
for file, K, angle_column in RECORDINGS:
    resisting = TRUE_SHARE_OF_K * K * angle + B * velocity + I * acceleration
    torque = -resisting + noise.normal(0, 0.05, time.size)
    np.savetxt(
        Path(__file__).with_name(file),
        np.column_stack([time, np.degrees(angle), torque]),
        fmt=("%.2f", "%.4f", "%.3f"),
        delimiter=",",
        header=f"time_s,{angle_column},torque_Nm",
        comments="",
    )
