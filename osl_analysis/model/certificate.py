"""Proof of the number of stationary points of Eq. 14 for one request, in exact rational arithmetic.

The squared norm is J(x) = N(x)/D(x) with polynomials N and D in x = B_m + B_1. Every float is converted to the rational
number that it represents exactly. J = X_{n-1}/a_n, where the coefficients of the polynomial X solve the linear system

    b(s) b(-s) = X(s) a(-s) + X(-s) a(s)

with a and b as in `admittance_error`. D = a_n det, where det is the determinant of this system. N and D are
interpolated without rounding from their values at n + 3 rational x, which determine their degree. The positive roots of
N'D - N D' are the stationary points. Sturm's theorem counts them. This route shares no formula with the recursion that
`gain_selection` minimises.

numpy's polynomial functions accept fractions. sympy is not used: its Sturm chain is 5 to 13 times
slower than this one (W of order 3 and 5), and its root isolation takes more than 10 s near K_d = K_s.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import gcd, lcm
from typing import Any

import numpy as np
from numpy.polynomial.polynomial import polyadd, polyder, polydiv, polymul, polysub, polyval
from numpy.typing import ArrayLike, NDArray

from osl_analysis.errors import UnreachableImpedanceError
from osl_analysis.model.admittance_error import Weight, admittance_error
from osl_analysis.model.compensator import check_request
from osl_analysis.parameters import DrivetrainParameters

Polynomial = NDArray[Any]
"""Coefficients as fractions, shape (powers,), lowest power first."""


@dataclass(frozen=True)
class Certificate:
    """All stable stationary points of Eq. 14 for one request, in ascending order.

    Attributes
    ----------
    minima
        Damping gains B_1 [N*m*s/rad] at which the slope changes from negative to positive.
    maxima
        Damping gains B_1 [N*m*s/rad] at which the slope changes from positive to negative.
    """

    minima: tuple[float, ...]
    maxima: tuple[float, ...]

    @property
    def unique(self) -> bool:
        """Whether there is exactly one local minimum, so that no search can end in a worse one."""
        return len(self.minima) == 1


def certify(K_d: float, B_d: float, p: DrivetrainParameters, weight: Weight, J_j: float = 0.0) -> Certificate:
    """Count and locate the stationary points of Eq. 14 with B_m + B_1 > 0.

    Raises
    ------
    UnreachableImpedanceError
        As `check_request`, or the error does not depend on B_1 at all: every gain is stationary.
    """
    check_request(K_d, B_d, p)
    slope = slope_numerator(K_d, B_d, p, weight, J_j)
    if not slope.any():
        raise UnreachableImpedanceError(
            f"the error of Eq. 14 for K_d = {K_d:g} N*m/rad, B_d = {B_d:g} N*m*s/rad does not depend on B_1; ask for "
            "another impedance"
        )
    minima: list[float] = []
    maxima: list[float] = []
    for low, high in isolating_intervals(sturm_chain(slope)):
        before, after = sign(polyval(low, slope)), sign(polyval(high, slope))
        root = float(bisected(slope, low, high) - Fraction(p.B_m))
        if before != after:
            (minima if before < after else maxima).append(root)
    return Certificate(tuple(minima), tuple(maxima))


def slope_numerator(K_d: float, B_d: float, p: DrivetrainParameters, weight: Weight, J_j: float) -> Polynomial:
    """The polynomial N'D - N D' in x, exact. It has the sign of dJ/dx at every stable x."""
    error = admittance_error(np.array([K_d]), np.array([B_d]), p, weight, J_j)
    a0, a1, b0, b1 = (exact(c[::-1, 0]) for c in (error.a0, error.a1, error.b0, error.b1))
    while not a0[-1] and not a1[-1]:
        a0, a1 = a0[:-1], a1[:-1]
    n = len(a0) - 1
    nodes = [Fraction(k + 1) * balance(a0, a1) / (n + 3) for k in range(n + 3)]
    values = [norm_and_determinant(a0 + x * a1, b0[:n] + x * b1[:n]) for x in nodes]
    D = interpolated(nodes, [d for _, d in values])
    N = interpolated(nodes, [J * d for J, d in values])
    return primitive(polysub(polymul(polyder(N), D), polymul(N, polyder(D))))


def exact(coefficients: ArrayLike) -> Polynomial:
    """Floats as the rational numbers that they represent exactly."""
    return np.array([Fraction(c) for c in np.asarray(coefficients, dtype=float).tolist()], dtype=object)


def balance(a0: Polynomial, a1: Polynomial) -> Fraction:
    """A power of two near the x at which a0 and x a1 are equally large. Nodes there keep the integers short."""
    ratios = [abs(u / v) for u, v in zip(a0, a1, strict=True) if u and v]
    return Fraction(2.0 ** round(np.log2(float(min(ratios)))))


def norm_and_determinant(a: Polynomial, b: Polynomial) -> tuple[Fraction, Fraction]:
    """The squared norm ||b/a||_2^2 = X_{n-1}/a_n, and a_n times the determinant of the linear system for X."""
    n = len(a) - 1
    system = np.full((n, n + 1), Fraction(0), dtype=object)
    for e in range(n):
        for k in range(max(0, 2 * e - n), min(n, 2 * e + 1)):
            system[e, k] = 2 * (-1) ** k * a[2 * e - k]
        for k in range(max(0, 2 * e - n + 1), min(n, 2 * e + 1)):
            system[e, n] += (-1) ** k * b[2 * e - k] * b[k]
    determinant = eliminate(system)
    return system[-1, -1] / system[-1, -2] / a[-1], determinant * a[-1]


def eliminate(system: NDArray[Any]) -> Fraction:
    """Gaussian elimination in place, shape (n, n + 1): the last row then holds the last unknown.

    Returns the determinant.
    """
    determinant = Fraction(1)
    for k in range(len(system)):
        pivot = next(i for i in range(k, len(system)) if system[i, k])
        if pivot != k:
            system[[k, pivot]] = system[[pivot, k]]
            determinant = -determinant
        determinant *= system[k, k]
        for i in range(k + 1, len(system)):
            if system[i, k]:
                system[i] = system[i] - system[i, k] / system[k, k] * system[k]
    return determinant


def interpolated(nodes: Sequence[Fraction], values: Sequence[Fraction]) -> Polynomial:
    """The polynomial through the points, by Newton's divided differences."""
    table, polynomial, basis = list(values), exact([0]), np.array([Fraction(1)], dtype=object)
    for k, node in enumerate(nodes):
        polynomial = polyadd(polynomial, table[0] * basis)
        basis = polymul(basis, np.array([-node, Fraction(1)], dtype=object))
        table = [(v - u) / (nodes[i + k + 1] - nodes[i]) for i, (u, v) in enumerate(pairwise(table))]
    return polynomial


def sturm_chain(polynomial: Polynomial) -> list[Polynomial]:
    """Sturm's sequence. Each member is scaled by a positive number to coprime integers."""
    chain = [polynomial, primitive(polyder(polynomial))]
    while len(chain[-1]) > 1:
        remainder = primitive(-polydiv(chain[-2], chain[-1])[1])
        if not remainder.any():
            break
        chain.append(remainder)
    return chain


def isolating_intervals(chain: Sequence[Polynomial]) -> list[tuple[Fraction, Fraction]]:
    """Intervals (low, high] that hold one distinct positive root each, in ascending order. No end is a root."""
    polynomial = chain[0]
    cauchy = 1 + max(abs(c / polynomial[-1]) for c in polynomial)
    waiting, isolated = [(Fraction(0), Fraction(2) ** (1 + int(np.ceil(np.log2(float(cauchy))))))], []
    while waiting:
        low, high = waiting.pop()
        count = variations(chain, low) - variations(chain, high)
        if count == 1 and low and polyval(low, polynomial) and polyval(high, polynomial):
            isolated.append((low, high))
        elif count:
            middle = high / 2**40 if not low else (low + high) / 2
            waiting += [(middle, high), (low, middle)]
    return sorted(isolated)


def variations(chain: Sequence[Polynomial], x: Fraction) -> int:
    """Changes of sign along the chain at x. Zeros do not count."""
    signs = [s for s in (sign(polyval(x, member)) for member in chain) if s]
    return sum(u != v for u, v in pairwise(signs))


def bisected(polynomial: Polynomial, low: Fraction, high: Fraction) -> Fraction:
    """The root between low and high, to 2^-60 of its size."""
    start = sign(polyval(low, polynomial))
    while high - low > low / 2**60:
        middle = (low + high) / 2
        low, high = (middle, high) if sign(polyval(middle, polynomial)) == start else (low, middle)
    return low


def sign(value: Any) -> int:
    """-1, 0 or 1."""
    return int(value > 0) - int(value < 0)


def primitive(polynomial: Polynomial) -> Polynomial:
    """The same polynomial times a positive number, with coprime integer coefficients."""
    shortest: Polynomial = np.trim_zeros(polynomial, "b")
    if not len(shortest):
        return exact([0])
    denominator = lcm(*(c.denominator for c in shortest))
    integers = [int(c * denominator) for c in shortest]
    return np.array([Fraction(c // gcd(*integers)) for c in integers], dtype=object)
