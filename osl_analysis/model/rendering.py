"""Properties of the linear joint under given gains: stability, passivity, range of frequencies, predicted K, B, I.

The joint's dynamic stiffness is Z = 1/Y = P - c/N, in the letters of `drivetrain.joint_admittance`. Arrays of gains
have shape (pairs,).

Passivity needs no test. At s = j w the joint takes in energy at the rate of Im Z = w (B_j + c x/|N|^2), positive for
every x > 0. The rendered impedance is therefore passive with every gain that Eq. 14 selects.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from osl_analysis.model.compensator import Gains
from osl_analysis.model.drivetrain import joint_admittance
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.trial import Array

TOLERANCE = 0.1
"""Largest |Z - Z_d|/|Z_d| at which the rendered impedance counts as the desired one."""


@dataclass(frozen=True)
class Rendering:
    """Properties of the rendered impedance, shape (pairs,) each.

    Attributes
    ----------
    decay_rate
        Decay rate [1/s] of the slowest mode of the free joint. It is negative where the joint is unstable.
    delay_margin
        Smallest delay [s] in the control loop that makes the actuator unstable while the joint is held. It is infinite
        if the actuator is stable with any delay.
    positive_real
        Whether Re Y >= 0 at every frequency, so that Y itself, and not only s Y, is positive real. This can only hold
        where J_j is neglected, as the paper does.
    faithful_to_hz
        Frequency [Hz] up to which Z stays within 10 % of Z_d. It is infinite where Z never leaves this range.
    """

    decay_rate: Array
    delay_margin: Array
    positive_real: NDArray[np.bool_]
    faithful_to_hz: Array


def rendering(K_1: ArrayLike, B_1: ArrayLike, K_d: ArrayLike, B_d: ArrayLike, p: DrivetrainParameters) -> Rendering:
    """Properties of the impedance that gains K_1, B_1 render for desired K_d, B_d, all of shape (pairs,).

    J_j is neglected, as in the paper.
    """
    K_1, B_1, K_d, B_d = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (K_1, B_1, K_d, B_d)))
    decay = [-np.max(joint_admittance(k, b, p).poles().real) for k, b in zip(K_1, B_1, strict=True)]
    return Rendering(
        np.array(decay),
        delay_margin(K_1, B_1, p),
        positive_real(K_1, B_1, p),
        faithful_frequency(K_1, B_1, K_d, B_d, p),
    )


def delay_margin(K_1: Array, B_1: Array, p: DrivetrainParameters) -> Array:
    """Delay [s] at which the held actuator, J_m s^2 + B_m s + K_s/n_T^2 under K_1 + B_1 s, becomes unstable.

    The loop gain is 1 where v = w^2 solves J_m^2 v^2 + (B_m^2 - B_1^2 - 2 J_m k) v + k^2 - K_1^2 = 0, k = K_s/n_T^2.
    """
    k = p.K_s / p.n_T**2
    half = (2 * p.J_m * k + B_1**2 - p.B_m**2) / (2 * p.J_m**2)
    root = np.sqrt(np.maximum(half**2 - (k**2 - K_1**2) / p.J_m**2, 0.0))
    real = half**2 >= (k**2 - K_1**2) / p.J_m**2
    margin = np.full(K_1.shape, np.inf)
    for v in (half + root, half - root):
        crosses = real & (v > 0)
        w = np.sqrt(np.where(crosses, v, 1.0))
        loop = (K_1 + 1j * w * B_1) / (k - p.J_m * w**2 + 1j * w * p.B_m)
        lead = np.mod(np.pi + np.angle(loop), 2 * np.pi)
        margin = np.where(crosses, np.minimum(margin, lead / w), margin)
    return margin


def positive_real(K_1: Array, B_1: Array, p: DrivetrainParameters) -> NDArray[np.bool_]:
    """Whether Re Y >= 0 for every w, with J_j = 0: whether a quadratic in w^2 is positive for every w^2 > 0."""
    kappa, x = K_1 + p.K_s / p.n_T**2, p.B_m + B_1
    square = p.K_s * p.J_m**2
    linear = p.K_s * (x**2 - 2 * kappa * p.J_m) + p.J_m * (p.K_s / p.n_T) ** 2
    constant = kappa * p.K_s * K_1
    return np.asarray(linear >= -2 * np.sqrt(square * constant))


def faithful_frequency(K_1: Array, B_1: Array, K_d: Array, B_d: Array, p: DrivetrainParameters) -> Array:
    """First frequency [Hz] at which |Z - Z_d| = 0.1 |Z_d|, a root of a polynomial in w^2. Infinite without a root."""
    frequency = np.full(K_1.shape, np.inf)
    for i, (k, b, stiffness, damping) in enumerate(zip(K_1, B_1, K_d, B_d, strict=True)):
        Y = joint_admittance(k, b, p)
        asked = np.convolve(Y.numerator, [damping, stiffness])
        size = max(len(asked), len(Y.denominator))
        asked, rendered = (np.pad(u, (size - len(u), 0)) for u in (asked, Y.denominator))
        excess = magnitude_squared(rendered - asked) - TOLERANCE**2 * magnitude_squared(asked)
        crossings = [v.real for v in np.roots(excess) if v.real > 0 and abs(v.imag) < 1e-9 * abs(v)]
        if crossings:
            frequency[i] = np.sqrt(min(crossings)) / (2 * np.pi)
    return frequency


def magnitude_squared(polynomial: Array) -> Array:
    """|u(j w)|^2 as a polynomial in w^2, highest power first."""
    ascending = polynomial[::-1]
    even = np.convolve(ascending, ascending * (-1.0) ** np.arange(len(ascending)))[::2]
    return np.asarray((even * (-1.0) ** np.arange(len(even)))[::-1])


def predicted_impedance(
    gains: Gains, p: DrivetrainParameters, frequencies_hz: Sequence[float]
) -> tuple[float, float, float]:
    """K [N*m/rad], B [N*m*s/rad], I [kg*m^2] that least squares estimates from a stepped sine on the linear drivetrain.

    A stepped sine has equally many cycles at each frequency f, so it spends 1/f of its samples there. The residual of
    1/Y against K + j w B - w^2 I is weighted accordingly. Friction is not included.
    """
    w = 2 * np.pi * np.asarray(frequencies_hz, dtype=float)
    Z = 1 / joint_admittance(gains.K_1, gains.B_1, p, p.J_j)(1j * w)
    weight = 1 / np.sqrt(w)
    storage = np.column_stack([np.ones_like(w), -(w**2)])
    (K, I), *_ = np.linalg.lstsq(storage * weight[:, None], Z.real * weight, rcond=None)
    B = np.sum(weight**2 * w * Z.imag) / np.sum(weight**2 * w**2)
    return float(K), float(B), float(I)
