# SPDX-License-Identifier: Apache-2.0
"""What gains render: the delays that it bears, and K and B that a fit will estimate.

The dynamic stiffness is Z = 1/Y = P - c/N, in the letters of `drivetrain.dynamic_stiffness`. At
s = j w the joint takes in energy at the rate of Im Z = w (B_j + c x/|N|^2), which is positive for
every x = B_m + B_1 > 0: without a delay it is passive with every gain that Eq. 14 selects.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.base.trial import Array
from osl_analysis.model.compensator import Gains
from osl_analysis.model.drivetrain import (
    DrivetrainParameters,
    dynamic_stiffness,
)

PASSIVE_TO_HZ = 10.0  # twice the fastest motion of the draft's protocol
DELAY_STEP = 1e-4  # s, to which a delay is told
LONGEST_DELAY = 0.05  # s; of a loop that is closed at 20 Hz
Spectrum = NDArray[np.complex128]
Stiffness = Callable[[Any], Any]
"""Torque over angle [N*m/rad] at frequencies s [rad/s]."""


def delay_margin(K_1: Array, B_1: Array, p: DrivetrainParameters) -> Array:
    """Smallest delay (pairs,) [s] of the control loop that makes the held actuator, J_m s^2 + B_m s
    + k under K_1 + B_1 s, unstable; infinite if it is stable with any delay.

    The loop gain is 1 where v = w^2 solves

        J_m^2 v^2 + (B_m^2 - B_1^2 - 2 J_m k) v + k^2 - K_1^2 = 0,   k = K_s/n_T^2.
    """
    k = p.K_s_at_actuator
    half = (2 * p.J_m * k + B_1**2 - p.B_m**2) / (2 * p.J_m**2)
    product = (k**2 - K_1**2) / p.J_m**2
    root = np.sqrt(np.maximum(half**2 - product, 0.0))
    has_roots = half**2 >= product
    margin = np.full(K_1.shape, np.inf)
    for v in (half + root, half - root):
        crosses = has_roots & (v > 0)
        w = np.sqrt(np.where(crosses, v, 1.0))
        loop = (K_1 + 1j * w * B_1) / (k - p.J_m * w**2 + 1j * w * p.B_m)
        phase_margin = np.mod(np.pi + np.angle(loop), 2 * np.pi)
        margin = np.where(crosses, np.minimum(margin, phase_margin / w), margin)
    return margin


def passive_delay(
    K_1: Array, B_1: Array, p: DrivetrainParameters, highest_hz: float = PASSIVE_TO_HZ
) -> Array:
    """Smallest delay T (pairs,) [s] of the control loop with which the joint gives away energy at
    some frequency up to `highest_hz`; infinite where none up to `LONGEST_DELAY` does.

    The joint takes in energy at s = j w where Im Z is positive.
    """
    w = 2 * np.pi * np.geomspace(highest_hz / 1e3, highest_hz, 60)
    s = 1j * w
    smallest = np.full(K_1.shape, np.inf)
    for delay in np.arange(LONGEST_DELAY, 0, -DELAY_STEP):
        Z = dynamic_stiffness(s, K_1[:, None], B_1[:, None], p, delay)
        gives_energy = (Z.imag < 0).any(axis=1)
        smallest[gives_energy] = delay
    return smallest


def predicted_impedance(
    gains: Gains, p: DrivetrainParameters, frequencies_hz: Sequence[float]
) -> tuple[float, float]:
    """Predict the fit of Eq. 15 to a stepped sine on the linear drivetrain without friction.

    Parameters
    ----------
    gains : Gains
    p : DrivetrainParameters
    frequencies_hz : Sequence of float
        Of the stepped sine [Hz], with the same number of cycles at each: the number of samples goes
        with 1/f.

    Returns
    -------
    K, B : float
        [N*m/rad] and [N*m*s/rad] by least squares.
    """
    w = 2 * np.pi * np.asarray(frequencies_hz, dtype=float)
    Z = dynamic_stiffness(1j * w, gains.K_1, gains.B_1, p)
    weight = 1 / np.sqrt(w)
    # Re Z = K - I w^2, Im Z = B w
    storage = np.column_stack([np.ones_like(w), -(w**2)])
    K = np.linalg.lstsq(storage * weight[:, None], Z.real * weight)[0][0]
    B = np.sum(weight**2 * w * Z.imag) / np.sum(weight**2 * w**2)
    return K, B


def linear_torque(
    stiffness: Stiffness,
    theta: Array,
    rate_hz: float,
    highest_hz: float,
) -> Array:
    """Find the torque of a joint of this dynamic stiffness for a motion without what is faster.

    Parameters
    ----------
    stiffness : Stiffness
    theta : Array
        Angle (n,) [rad]; its mean does not count. Its mirror image is added to make it periodic.
    rate_hz : float
    highest_hz : float
        Up to which the motion counts.

    Returns
    -------
    Array
        (n,) [N*m].
    """
    n = len(theta)
    spectrum = np.fft.rfft(np.concatenate([theta, theta[::-1]]))
    frequency_hz = np.fft.rfftfreq(2 * n, 1 / rate_hz)
    counts = (frequency_hz > 0) & (frequency_hz < highest_hz)
    torque = np.zeros_like(spectrum)
    torque[counts] = spectrum[counts] * stiffness(2j * np.pi * frequency_hz[counts])
    return np.fft.irfft(torque, 2 * n)[:n]
