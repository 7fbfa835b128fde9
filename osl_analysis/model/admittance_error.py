"""The squared norm of Eq. 14 as a function of the damping gain, with its first two derivatives, exactly.

In the letters of `drivetrain.joint_admittance`, with Q = B_d s + K_d and K_1 from Eq. 13,

    W (Y - Y_d) = b(s; x)/a(s; x),   a = W_den D Q,   b = W_num (N Q - D).

Both a and b are affine in x = B_m + B_1. Astrom's recursion (Introduction to Stochastic Control Theory, 1970, ch. 5)
turns the norm into a sum of squares over the rows of a's Routh table. `gain_kernel` has this recursion, on numbers that
carry their derivatives along.

N Q - D is computed as N (Q - P) + c, so that no nearly equal numbers are subtracted. Its constant term is 0 by Eq. 12
and is set to exactly 0. With B_d = 0 the leading coefficient of a is 0; the same formulas hold.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from osl_analysis.errors import UnreachableImpedanceError
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.trial import Array

HIGHEST_ORDER = 10
SLOWEST_HZ, FASTEST_HZ = 1e-3, 1e4
"""Lowest and highest accepted cut-off of W [Hz]. Both lie far outside the frequencies at which a leg moves."""


@dataclass(frozen=True)
class Weight:
    """W of Eq. 14: a Butterworth low-pass of the given cut-off [Hz] and order (the paper's: 1 Hz = 2 pi rad/s, 3).

    Raises
    ------
    UnreachableImpedanceError
        The order is not a whole number from 1 to 10, or the cut-off not from 0.001 to 10000 Hz.
    """

    cutoff_hz: float
    order: int

    def __post_init__(self) -> None:
        if self.order not in range(1, HIGHEST_ORDER + 1):
            raise UnreachableImpedanceError(
                f"the weight W of Eq. 14 has order {self.order}; use a whole number from 1 to {HIGHEST_ORDER}"
            )
        if not SLOWEST_HZ <= self.cutoff_hz <= FASTEST_HZ:
            raise UnreachableImpedanceError(
                f"the weight W has its cut-off at {self.cutoff_hz:g} Hz; use {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz"
            )

    def polynomials(self) -> tuple[float, Array]:
        """Numerator, a constant, and denominator, highest power first, s in rad/s."""
        b, a = scipy.signal.butter(self.order, 2 * np.pi * self.cutoff_hz, analog=True)
        return float(b[-1]), np.asarray(a, dtype=float)


@dataclass(frozen=True)
class AdmittanceError:
    """Coefficients of a = a0 + x a1 and b = b0 + x b1, shape (powers, pairs), highest power first, s in rad/s."""

    a0: Array
    a1: Array
    b0: Array
    b1: Array

    def by_pair(self) -> tuple[Array, Array, Array, Array]:
        """The coefficients with a row for each pair, shape (pairs, powers)."""
        a0, a1, b0, b1 = (np.ascontiguousarray(each.T) for each in (self.a0, self.a1, self.b0, self.b1))
        return a0, a1, b0, b1

    def squared(self, x: Array) -> "Jet":
        """The squared norm [(rad/(N*m))^2/s] at x [N*m*s/rad], shape (pairs,), with its derivatives."""
        from osl_analysis.model.gain_kernel import squared_norms

        return Jet(*squared_norms(*self.by_pair(), np.asarray(x, dtype=float)))


@dataclass(frozen=True)
class Jet:
    """A function of x: its value and first two derivatives."""

    value: Array
    slope: Array
    curvature: Array


def admittance_error(
    K_d: ArrayLike, B_d: ArrayLike, p: DrivetrainParameters, weight: Weight, J_j: float = 0.0
) -> AdmittanceError:
    """The error of every pair K_d [N*m/rad], B_d [N*m*s/rad], shape (pairs,), as a function of x = B_m + B_1.

    The paper neglects the joint's inertia. `J_j` [kg*m^2] includes it.
    """
    K_d, B_d = (np.asarray(v, dtype=float) for v in (K_d, B_d))
    K_1 = K_d * p.K_s / (p.n_T**2 * (p.K_s - K_d))
    gain, W = weight.polynomials()
    zero, one = np.zeros_like(K_d), np.ones_like(K_d)
    N0, N1 = [p.J_m * one, zero, K_1 + p.K_s / p.n_T**2], [one, zero]  # N = N0 + x N1
    P = [J_j * one] * bool(J_j) + [p.B_j * one, p.K_s * one]
    Q = [zero] * bool(J_j) + [B_d, K_d]
    difference = [q - j for q, j in zip(Q, P, strict=True)]
    D0, b0 = polynomial_product(N0, P), polynomial_product(N0, difference)
    D0[-1], b0[-1] = K_1 * p.K_s, zero  # kappa K_s - c, and kappa (K_d - K_s) + c = 0 (Eq. 12)
    fixed = polynomial_product([B_d, K_d], [w * one for w in W])
    a0 = polynomial_product(D0, fixed)
    a1 = polynomial_product(polynomial_product(N1, P), fixed)
    b1 = polynomial_product(N1, difference)
    n = len(a0) - 1
    return AdmittanceError(stack(a0, n + 1), stack(a1, n + 1), gain * stack(b0, n), gain * stack(b1, n))


def polynomial_product(u: list[Array], v: list[Array]) -> list[Array]:
    """Product of two polynomials whose coefficients are arrays."""
    out = [np.zeros_like(u[0])] * (len(u) + len(v) - 1)
    for i, ui in enumerate(u):
        for j, vj in enumerate(v):
            out[i + j] = out[i + j] + ui * vj
    return out


def stack(coefficients: list[Array], count: int) -> Array:
    """Coefficients as `count` rows; missing higher powers are rows of zeros."""
    return np.vstack([np.zeros((count - len(coefficients), len(coefficients[0]))), coefficients])
