"""K, B and I of recordings as a student's script has them: no checks, no intervals, no page.

    python benchmarks/student.py FILE [FILE ...]

The measure of `doors.py`. The first three columns of a CSV file are time [s], angle [deg] and
torque [N*m].
"""

import sys

import numpy as np
import pandas as pd
from scipy.signal import butter, filtfilt

CUTOFF_HZ = 15.0


def read(path: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time [s], angle [rad] and torque [N*m]."""
    time, theta, torque = pd.read_csv(path).to_numpy().T[:3]
    return time, np.deg2rad(theta), torque


def fit(time: np.ndarray, theta: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """K, B, I and offset."""
    step = time[1] - time[0]
    b, a = butter(4, CUTOFF_HZ * 2 * step)
    theta, torque = filtfilt(b, a, theta), filtfilt(b, a, torque)
    omega = np.gradient(theta, step)
    alpha = np.gradient(omega, step)
    columns = np.column_stack([theta, omega, alpha, np.ones_like(theta)])
    return np.linalg.lstsq(columns, torque, rcond=None)[0]


if __name__ == "__main__":
    for path in sys.argv[1:]:
        K, B, I, _ = fit(*read(path))
        print(f"{path}: K {K:.1f}, B {B:.3f}, I {I:.4f}")
