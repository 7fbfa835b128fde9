"""Pace of crossings from the ankle's angle before the onset: the time scale at which it is most like the mean angle.

People differ from step to step in the size of a motion, and in its level, which drifts. Both look like pace. What they
cannot imitate is sharp: the ankle's turn from plantarflexion to dorsiflexion after heel strike. So size and drift are
fitted too, and the drift is the polynomial with which the unperturbed crossings' scales scatter least. Torque and load
are no help: the low-pass and the heel's impact act in time and not in phase, so that both misread a slower crossing by
a few per cent (docs/stance_phase.md).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from osl_analysis.measured import rounding_of
from osl_analysis.trial import Array

ORDERS = tuple(range(1, 9))
"""Orders of the polynomials among which that of the drift is chosen."""
STRIDE = 4
"""Every fourth phase is compared: a low-pass of 20 Hz leaves no more in an angle."""
SMALLEST, LARGEST = 0.75, 1.33
"""Bounds of a scale."""
STEPS, LONGEST_STEP, LAST_STEP = 15, 0.05, 1e-6
"""Largest number of steps to a scale, the longest step, and the step that ends the search."""


def steadiest_scales(phase: Array, curve: Array, curves: Array) -> tuple[float, Array]:
    """Scales of one curve (k,), and of the unperturbed `curves` (n, m), which are sampled at m uniform phases 0 to 1.

    `phase` (k,) are the first of these phases. The drift has the order at which the scales of the n curves scatter
    least, among those at which every curve has a scale. All are NaN if there is no such order.
    """
    both = np.vstack([curve, curves[:, : len(phase)]])[:, ::STRIDE]
    found = matched_scales(phase[::STRIDE], both, curves.mean(axis=0), ORDERS)
    scatters = np.where(np.isfinite(found).all(axis=1), np.std(found[:, 1:], axis=1), np.inf)
    best = int(np.argmin(scatters))
    if not np.isfinite(scatters[best]):
        return float("nan"), np.full(len(curves), np.nan)
    return float(found[best, 0]), found[best, 1:]


def matched_scales(phase: Array, curves: Array, mean: Array, orders: Sequence[int] = ORDERS) -> Array:
    """The scales r (orders, m) at which curves, as functions of r p, are most like the mean curve; NaN without one.

    phase: phases p (k,), from heel strike on.
    curves: (m, k), at p.
    mean: (n,), the mean curve at n uniform phases from 0 to 1.
    orders: of the drift.

    A curve is like the mean if it is a multiple of it plus a polynomial. The scale solves this nonlinear least-squares
    problem by the method of Gauss and Newton, from 1 on. There is none if the search ends at a bound or does not end,
    or if the mean is itself a polynomial, apart from rounding.
    """
    spline = make_interp_spline(np.linspace(0.0, 1.0, len(mean)), mean, k=3)
    slope, drift = spline.derivative(), Drift.of(phase, orders)
    nothing = len(phase) * rounding_of(mean)
    scales = np.ones((len(orders), len(curves)))
    step = np.full_like(scales, np.inf)
    for _ in range(STEPS):
        there = np.clip(scales[..., None] * phase, 0.0, 1.0)
        expected = spline(there)
        size, change, left = (drift.beside(v) for v in (expected, phase * slope(there), curves - expected))
        step = np.clip(second_coefficient(size, change, left, nothing), -LONGEST_STEP, LONGEST_STEP)
        scales = np.clip(scales + step, SMALLEST, LARGEST)
        if np.all(np.abs(step) < LAST_STEP):
            break
    settled = (np.abs(step) < LAST_STEP) & (scales > SMALLEST) & (scales < LARGEST)
    return np.where(settled, scales, np.nan)


@dataclass(frozen=True)
class Drift:
    """Polynomials of several orders over k phases.

    columns: orthonormal polynomials (k, p), of order 0, 1, ...
    used: 1 for those up to each order (orders, 1, p), else 0.
    """

    columns: Array
    used: Array

    @classmethod
    def of(cls, phase: Array, orders: Sequence[int]) -> "Drift":
        """Drifts of some orders at phases (k,)."""
        powers = np.vander(phase / phase[-1], max(orders) + 1, increasing=True)
        columns = np.linalg.qr(powers)[0]
        return cls(columns, (np.arange(columns.shape[1]) <= np.array(orders)[:, None])[:, None].astype(float))

    def beside(self, curves: Array) -> Array:
        """What the drift of each order leaves of curves (orders, m, k)."""
        return np.asarray(curves - ((curves @ self.columns) * self.used) @ self.columns.T)


def second_coefficient(first: Array, second: Array, values: Array, smallest: float) -> Array:
    """Coefficients (...) of `second` in the regressions of `values` on `first` and `second`, (..., k) each.

    NaN where the sum of squares of one of them, beside the other, is `smallest` or less.
    """
    ff, fs, ss = (np.sum(a * b, axis=-1) for a, b in ((first, first), (first, second), (second, second)))
    alone = ss * ff - fs**2
    some = (ff > smallest) & (ss > smallest) & (alone > smallest * ff)
    numerator = ff * np.sum(second * values, axis=-1) - fs * np.sum(first * values, axis=-1)
    return np.where(some, numerator, np.nan) / np.where(some, alone, 1.0)
