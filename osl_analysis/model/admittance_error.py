"""The squared norm of Eq. 14 as a function of the damping gain, with its first two derivatives, exactly.

With x = B_m + B_1, K_1 from Eq. 13 and Y = N/D (Eq. 9),

    W (Y - Y_d) = b(s; x)/a(s; x),   a = W_den D Q,   b = W_num (N Q - D),   Q = B_d s + K_d,

where a and b are affine in x. Astrom's recursion (Introduction to Stochastic Control Theory, 1970, ch. 5) turns
the norm into a sum of squares over the rows of a's Routh table. Here it carries derivatives along. Nothing is
subtracted that is nearly equal: N Q - D is formed without its constant term, which Eq. 12 cancels, and B_d = 0 needs
no case of its own, although it takes a's leading coefficient away.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import butter

from osl_analysis.errors import UnreachableImpedanceError
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.trial import Array

HIGHEST_ORDER = 10


@dataclass(frozen=True)
class Weight:
    """W of Eq. 14: a Butterworth low-pass of the given cut-off [Hz] and order (the paper's: 1 Hz = 2 pi rad/s, 3).

    Raises
    ------
    UnreachableImpedanceError
        The order is not a whole number from 1 to 10, or the cut-off is not positive and finite.
    """

    cutoff_hz: float = 1.0
    order: int = 3

    def __post_init__(self) -> None:
        if self.order not in range(1, HIGHEST_ORDER + 1):
            raise UnreachableImpedanceError(
                f"W of order {self.order} cannot weigh the error of Eq. 14; use a whole number from 1 to {HIGHEST_ORDER}"
            )
        if not 0 < self.cutoff_hz < np.inf:
            raise UnreachableImpedanceError(f"W cannot have its cut-off at {self.cutoff_hz:g} Hz; give one above 0")

    def polynomials(self) -> tuple[float, Array]:
        """Numerator, a constant, and denominator, highest power first, s in rad/s."""
        b, a = butter(self.order, 2 * np.pi * self.cutoff_hz, analog=True)
        return float(b[-1]), np.asarray(a, dtype=float)


@dataclass(frozen=True)
class AdmittanceError:
    """Coefficients of a = a0 + x a1 and b = b0 + x b1, a row per pair, highest power first, s in rad/s."""

    a0: Array
    a1: Array
    b0: Array
    b1: Array

    def squared(self, x: Array) -> tuple[Array, Array, Array]:
        """The squared norm J [(rad/(N*m))^2/s] at x [N*m*s/rad], shape (pairs,), and its derivatives J', J''."""
        z, zero = x[:, None], np.zeros_like(self.a0)
        a = Jet(self.a0 + z * self.a1, self.a1, zero)
        b = Jet(self.b0 + z * self.b1, self.b1, zero[:, 1:])
        total = Jet(*np.zeros((3, len(x))))
        while b.value.shape[1]:
            alpha, beta = a[:, 0] / a[:, 1], b[:, 0] / a[:, 1]
            total = total + halved_ratio(beta, alpha)
            a, b = next_row(a, b, alpha, beta)
        return total.value, total.slope, total.curvature

    def rows(self, which: Array) -> "AdmittanceError":
        """The pairs at these indices."""
        return AdmittanceError(self.a0[which], self.a1[which], self.b0[which], self.b1[which])


@dataclass(frozen=True)
class Jet:
    """A function of x by value and first two derivatives: arithmetic on it is the product and the quotient rule."""

    value: Array
    slope: Array
    curvature: Array

    def __getitem__(self, where: tuple[slice, slice | int]) -> "Jet":
        return Jet(self.value[where], self.slope[where], self.curvature[where])

    def __add__(self, other: "Jet") -> "Jet":
        return Jet(self.value + other.value, self.slope + other.slope, self.curvature + other.curvature)

    def __sub__(self, other: "Jet") -> "Jet":
        return Jet(self.value - other.value, self.slope - other.slope, self.curvature - other.curvature)

    def __mul__(self, other: "Jet") -> "Jet":
        slope = self.slope * other.value + self.value * other.slope
        curvature = self.curvature * other.value + 2 * self.slope * other.slope + self.value * other.curvature
        return Jet(self.value * other.value, slope, curvature)

    def __truediv__(self, other: "Jet") -> "Jet":
        value = self.value / other.value
        slope = (self.slope - value * other.slope) / other.value
        return Jet(value, slope, (self.curvature - 2 * slope * other.slope - value * other.curvature) / other.value)


def halved_ratio(beta: Jet, alpha: Jet) -> Jet:
    """beta^2/(2 alpha), the row's part of the norm: nothing where b has no such power, alpha = 0 or not."""
    absent = beta.value == 0
    one = np.where(absent, 1.0, 0.0)
    safe = Jet(np.where(absent, 1.0, alpha.value), alpha.slope * (1 - one), alpha.curvature * (1 - one))
    return beta * beta / (safe + safe)


def next_row(a: Jet, b: Jet, alpha: Jet, beta: Jet) -> tuple[Jet, Jet]:
    """The next rows of Astrom's tables: of degree one less, every other coefficient reduced."""
    n = b.value.shape[1]
    reduced, left = list_of(a, n), list_of(b, n - 1)
    for i in range(1, n - 1, 2):
        reduced[i] = reduced[i] - alpha * a[:, i + 2]
        left[i] = left[i] - beta * a[:, i + 2]
    return stack(reduced, a), stack(left, a)


def list_of(row: Jet, count: int) -> list[Jet]:
    """The `count` columns after the first."""
    return [row[:, i] for i in range(1, count + 1)]


def stack(columns: list[Jet], like: Jet) -> Jet:
    """Columns side by side; none at all is a row of degree -1."""
    if not columns:
        return like[:, 0:0]
    parts = zip(*((c.value, c.slope, c.curvature) for c in columns), strict=True)
    return Jet(*(np.column_stack(part) for part in parts))


def admittance_error(
    K_d: ArrayLike, B_d: ArrayLike, p: DrivetrainParameters, weight: Weight, J_j: float = 0.0
) -> AdmittanceError:
    """The error of every pair K_d [N*m/rad], B_d [N*m*s/rad], shape (pairs,), as a function of x = B_m + B_1.

    The paper drops the joint's inertia; `J_j` [kg*m^2] puts it back.
    """
    K_d, B_d = (np.asarray(v, dtype=float) for v in (K_d, B_d))
    K_1 = K_d * p.K_s / (p.n_T**2 * (p.K_s - K_d))
    gain, W = weight.polynomials()
    zero, one = np.zeros_like(K_d), np.ones_like(K_d)
    inertia = [J_j * one] if J_j else []
    joint = np.column_stack([*inertia, p.B_j * one, p.K_s * one])
    desired = np.column_stack([*(zero for _ in inertia), B_d, K_d])
    motor = np.column_stack([p.J_m * one, zero, K_1 + p.K_s / p.n_T**2])
    damper = np.column_stack([one, zero])
    D0, b0 = polymul(motor, joint), polymul(motor, desired - joint)
    D0[:, -1], b0[:, -1] = K_1 * p.K_s, 0.0
    lag = polymul(np.column_stack([B_d, K_d]), np.tile(W, (len(K_d), 1)))
    a0, a1 = polymul(D0, lag), polymul(polymul(damper, joint), lag)
    b1 = polymul(damper, desired - joint)
    n = a0.shape[1] - 1
    return AdmittanceError(a0, fill(a1, n + 1), gain * fill(b0, n), gain * fill(b1, n))


def polymul(u: Array, v: Array) -> Array:
    """Products of polynomials, row by row."""
    out = np.zeros((len(u), u.shape[1] + v.shape[1] - 1))
    for k in range(v.shape[1]):
        out[:, k : k + u.shape[1]] += u * v[:, k : k + 1]
    return out


def fill(u: Array, length: int) -> Array:
    """Rows filled up with zero coefficients of higher powers."""
    return np.pad(u, ((0, 0), (length - u.shape[1], 0)))
