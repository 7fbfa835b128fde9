"""How many stationary points Eq. 14 has, proved for one request in exact rational arithmetic.

The squared norm is J(x) = N(x)/D(x) with polynomials N, D in x = B_m + B_1. With every input taken as the rational
number that its float is, N and D follow exactly: J = X_{n-1}/a_n, where X solves the linear system of

    b(s) b(-s) = X(s) a(-s) + X(-s) a(s)

(a, b as in `admittance_error`), and D = a_n det, so N and D are interpolated from as many rational x as their degree
asks for. Sturm's theorem counts the positive roots of N'D - N D' without rounding. This route shares no formula with
the recursion that `gain_selection` minimises.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import gcd, lcm

import numpy as np

from osl_analysis.errors import UnreachableImpedanceError
from osl_analysis.model.admittance_error import Weight, admittance_error
from osl_analysis.parameters import DrivetrainParameters

Polynomial = list[Fraction]  # lowest power first


@dataclass(frozen=True)
class Certificate:
    """The stable stationary points of Eq. 14 for one request: all there are, in order, as B_1 [N*m*s/rad].

    `minima` and `maxima` hold those where the slope changes its sign upwards and downwards.
    """

    minima: tuple[float, ...]
    maxima: tuple[float, ...]

    @property
    def unique(self) -> bool:
        """Whether there is exactly one local minimum, and so no other to be trapped in."""
        return len(self.minima) == 1


def certify(K_d: float, B_d: float, p: DrivetrainParameters, weight: Weight, J_j: float = 0.0) -> Certificate:
    """Count and locate the stationary points of Eq. 14 with B_m + B_1 > 0.

    Raises
    ------
    UnreachableImpedanceError
        The error does not depend on B_1 at all: every gain is stationary.
    """
    slope = slope_numerator(K_d, B_d, p, weight, J_j)
    if not slope:
        raise UnreachableImpedanceError(f"the error for K_d = {K_d:g}, B_d = {B_d:g} does not depend on B_1")
    chain = sturm_chain(slope)
    minima: list[float] = []
    maxima: list[float] = []
    for low, high in isolating_intervals(chain):
        rising = sign(evaluate(slope, high)) - sign(evaluate(slope, low))
        root = float(bisected(slope, low, high) - Fraction(p.B_m))
        (minima if rising > 0 else maxima).append(root)
    return Certificate(tuple(minima), tuple(maxima))


def slope_numerator(K_d: float, B_d: float, p: DrivetrainParameters, weight: Weight, J_j: float) -> Polynomial:
    """N'D - N D', exact, with coprime integer coefficients: the sign of dJ/dx at every stable x."""
    error = admittance_error(np.array([K_d]), np.array([B_d]), p, weight, J_j)
    a0, a1, b0, b1 = ([Fraction(float(v)) for v in c[::-1, 0]] for c in (error.a0, error.a1, error.b0, error.b1))
    while not a0[-1] and not a1[-1]:
        a0, a1 = a0[:-1], a1[:-1]
    n = len(a0) - 1
    b0, b1 = b0[:n], b1[:n]
    nodes = [Fraction(k + 1) * scale_of(a0, a1) / (n + 3) for k in range(n + 3)]
    values = [norm_and_determinant(along(a0, a1, x), along(b0, b1, x)) for x in nodes]
    D = interpolated(nodes, [d for _, d in values])
    N = interpolated(nodes, [J * d for J, d in values])
    return primitive(subtract(multiply(derivative(N), D), multiply(N, derivative(D))))


def scale_of(a0: Polynomial, a1: Polynomial) -> Fraction:
    """A power of two near which a0 and x a1 balance: nodes there keep the integers short."""
    ratios = [abs(u / v) for u, v in zip(a0, a1, strict=True) if u and v]
    return Fraction(2.0 ** round(np.log2(float(min(ratios)))))


def along(c0: Polynomial, c1: Polynomial, x: Fraction) -> Polynomial:
    """c0 + x c1."""
    return [u + x * v for u, v in zip(c0, c1, strict=True)]


def norm_and_determinant(a: Polynomial, b: Polynomial) -> tuple[Fraction, Fraction]:
    """||b/a||_2^2 = X_{n-1}/a_n, and a_n det of the linear system for X."""
    n = len(a) - 1
    rows = []
    for e in range(n):
        signed = [2 * (-1) ** (2 * e - k) * a[2 * e - k] if 0 <= 2 * e - k <= n else Fraction(0) for k in range(n)]
        even = sum(((-1) ** j * b[2 * e - j] * b[j] for j in range(n) if 0 <= 2 * e - j < n), Fraction(0))
        rows.append([*signed, even])
    determinant = eliminate(rows)
    return rows[-1][-1] / rows[-1][-2] / a[-1], determinant * a[-1]


def eliminate(rows: list[Polynomial]) -> Fraction:
    """Gaussian elimination in place; the last row then holds the last unknown. Returns the determinant."""
    determinant = Fraction(1)
    for k, _ in enumerate(rows):
        pivot = next(i for i in range(k, len(rows)) if rows[i][k])
        if pivot != k:
            rows[k], rows[pivot] = rows[pivot], rows[k]
            determinant = -determinant
        determinant *= rows[k][k]
        for i in range(k + 1, len(rows)):
            factor = rows[i][k] / rows[k][k]
            if factor:
                rows[i] = [u - factor * v for u, v in zip(rows[i], rows[k], strict=True)]
    return determinant


def interpolated(nodes: Sequence[Fraction], values: Sequence[Fraction]) -> Polynomial:
    """The polynomial through the points (Newton's divided differences), its leading zeros dropped."""
    table, polynomial, basis = list(values), [Fraction(0)], [Fraction(1)]
    for k, node in enumerate(nodes):
        polynomial = add(polynomial, [table[0] * c for c in basis])
        basis = multiply(basis, [-node, Fraction(1)])
        table = [(v - u) / (nodes[i + k + 1] - nodes[i]) for i, (u, v) in enumerate(pairwise(table))]
    return trimmed(polynomial)


def sturm_chain(polynomial: Polynomial) -> list[Polynomial]:
    """Sturm's sequence; each member scaled by a positive number to coprime integers."""
    chain = [polynomial, primitive(derivative(polynomial))]
    while len(chain[-1]) > 1:
        remainder = primitive([-c for c in modulo(chain[-2], chain[-1])])
        if not remainder:
            break
        chain.append(remainder)
    return chain


def isolating_intervals(chain: Sequence[Polynomial]) -> list[tuple[Fraction, Fraction]]:
    """Intervals (low, high] that hold one distinct positive root each, in order; none of their ends is a root."""
    highest = Fraction(2) ** (1 + int(np.ceil(np.log2(float(largest_root_bound(chain[0]))))))
    waiting, found = [(Fraction(0), highest)], []
    while waiting:
        low, high = waiting.pop()
        count = variations(chain, low) - variations(chain, high)
        if count == 1 and low and evaluate(chain[0], low) and evaluate(chain[0], high):
            found.append((low, high))
        elif count:
            middle = high / 2**40 if not low else (low + high) / 2
            waiting += [(middle, high), (low, middle)]
    return sorted(found)


def largest_root_bound(polynomial: Polynomial) -> Fraction:
    """Cauchy's bound on the size of every root."""
    return 1 + max(abs(c / polynomial[-1]) for c in polynomial)


def variations(chain: Sequence[Polynomial], x: Fraction) -> int:
    """Changes of sign along the chain at x, zeros left out."""
    signs = [s for s in (sign(evaluate(member, x)) for member in chain) if s]
    return sum(u != v for u, v in pairwise(signs))


def bisected(polynomial: Polynomial, low: Fraction, high: Fraction) -> Fraction:
    """The root between low and high to 2^-60 of its size."""
    start = sign(evaluate(polynomial, low))
    while high - low > low / 2**60:
        middle = (low + high) / 2
        low, high = (middle, high) if sign(evaluate(polynomial, middle)) == start else (low, middle)
    return low


def sign(value: Fraction) -> int:
    return (value > 0) - (value < 0)


def evaluate(polynomial: Polynomial, x: Fraction) -> Fraction:
    value = Fraction(0)
    for coefficient in reversed(polynomial):
        value = value * x + coefficient
    return value


def derivative(polynomial: Polynomial) -> Polynomial:
    return [k * c for k, c in enumerate(polynomial)][1:]


def add(u: Polynomial, v: Polynomial) -> Polynomial:
    size = max(len(u), len(v))
    padded = [w + [Fraction(0)] * (size - len(w)) for w in (u, v)]
    return [x + y for x, y in zip(*padded, strict=True)]


def subtract(u: Polynomial, v: Polynomial) -> Polynomial:
    return add(u, [-c for c in v])


def multiply(u: Polynomial, v: Polynomial) -> Polynomial:
    out = [Fraction(0)] * (len(u) + len(v) - 1)
    for i, x in enumerate(u):
        for j, y in enumerate(v):
            out[i + j] += x * y
    return out


def modulo(u: Polynomial, v: Polynomial) -> Polynomial:
    """Remainder of u by v."""
    rest = list(u)
    while len(rest) >= len(v):
        factor = rest[-1] / v[-1]
        shift = len(rest) - len(v)
        rest = [c - factor * v[i - shift] if i >= shift else c for i, c in enumerate(rest)][:-1]
    return trimmed(rest)


def trimmed(polynomial: Polynomial) -> Polynomial:
    """Without leading zeros; the zero polynomial is empty."""
    size = next((k for k in range(len(polynomial), 0, -1) if polynomial[k - 1]), 0)
    return polynomial[:size]


def primitive(polynomial: Polynomial) -> Polynomial:
    """The same polynomial times a positive number, with coprime integer coefficients."""
    polynomial = trimmed(polynomial)
    if not polynomial:
        return []
    denominator = lcm(*(c.denominator for c in polynomial))
    integers = [int(c * denominator) for c in polynomial]
    return [Fraction(c // gcd(*integers)) for c in integers]
