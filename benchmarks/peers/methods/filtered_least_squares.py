# SPDX-License-Identifier: Apache-2.0
"""The usual script: a zero-phase low-pass of 15 Hz on both signals, differences at the stamps,
linear least squares.

https://docs.scipy.org/doc/scipy/reference/generated/scipy.signal.sosfiltfilt.html
https://numpy.org/doc/stable/reference/generated/numpy.linalg.lstsq.html
"""

import numpy as np
from scipy.signal import butter, sosfiltfilt

PACKAGES = ("scipy",)


def estimate(t, theta, torque, rate_hz=500.0, **known):
    low_pass = butter(4, 15.0, fs=rate_hz, output="sos")
    angle, measured = sosfiltfilt(low_pass, theta), sosfiltfilt(low_pass, torque)
    omega = np.gradient(angle, t)
    X = np.column_stack([angle, omega, np.gradient(omega, t), np.ones_like(t)])
    found, *_ = np.linalg.lstsq(X, measured, rcond=None)
    residual = measured - X @ found
    variance = residual @ residual / (len(t) - 4)
    half = 1.96 * np.sqrt(variance * np.diag(np.linalg.inv(X.T @ X)))
    intervals = {name: (found[k] - half[k], found[k] + half[k]) for k, name in enumerate("KBI")}
    return *found[:3], intervals, []
