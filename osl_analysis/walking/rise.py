"""When a mean rise starts: by a smooth step that is fitted to its first part. What noise and shape leave unknown."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from scipy.special import betainc

from osl_analysis.trial import Array

KINDS = (3, 1, 2, 4)
"""Smooth steps that a mean rise is compared with: I(x; p, p) is a straight ramp for p = 1, a cubic for 2, minimum jerk
for 3, of seventh degree for 4."""
PREFERRED = 30.0
"""Minimum jerk is used unless another step lowers chi-square by more than this. The starts of two steps that fit alike
differ by 6 to 10 % of the rise, so that a choice by less would scatter the onset by several ms."""
EXCLUDED = 9.0
"""A step is excluded if its chi-square is larger than the least by more than this: 1 in 400 by noise alone."""
FITTED = 0.7
"""Share of the rise that is fitted. The half of it tells the start a third less well. The end may overshoot."""
PLATEAU = 0.95
"""Share of the largest displacement from which a rise has ended."""


@dataclass(frozen=True)
class RiseStart:
    """The start of a mean rise.

    time: [s].
    se: its standard error [s] from noise.
    shape: largest change [s] of the start by another smooth step that fits as well, 0 if none does. Not in `se`.
    kind: the smooth step that was fitted, of `KINDS`.
    """

    time: float
    se: float
    shape: float
    kind: int


def start_of_rise(time: Array, coordinates: Array, noise: float) -> RiseStart:
    """The start of a mean motion (n, r) [m] from rest, along its largest displacement.

    A smooth step is fitted to `FITTED` of the rise. `noise` [m] is the standard deviation of each sample, as if it
    were independent of the others. The fitted step is that of minimum jerk, unless another one is far more likely.
    """
    size = np.linalg.norm(coordinates, axis=1)
    largest = int(np.argmax(size))
    turned = coordinates @ coordinates[largest] / size[largest]
    height = float(turned[turned > PLATEAU * turned[largest]].mean())
    half = int(np.argmax(turned >= height / 2))
    level = int(np.flatnonzero(turned[:half] < height / 10)[-1])
    quick = 2 * float(time[half] - time[level]) / 0.6
    guess = np.array([time[half] - quick / 2, quick, 0.0])
    end = int(np.argmax(turned >= FITTED * height)) + 1
    near, share = time[:end], turned[:end] / height
    found = {p: fitted_step(near, share, guess, noise / height, p) for p in KINDS}
    best = min(found, key=lambda p: found[p].cost)
    kind = best if 2 * (found[KINDS[0]].cost - found[best].cost) > PREFERRED else KINDS[0]
    fit = found[kind]
    alike = [one.x[0] for one in found.values() if 2 * (one.cost - found[best].cost) < EXCLUDED]
    shape = max((abs(float(start - fit.x[0])) for start in alike), default=0.0)
    return RiseStart(float(fit.x[0]), float(np.sqrt(np.linalg.inv(fit.jac.T @ fit.jac)[0, 0])), shape, kind)


def fitted_step(time: Array, share: Array, guess: Array, noise: float, p: int) -> OptimizeResult:
    """The step I(x; p, p) of some start [s] and duration [s], from some level, that fits a rise from 0 towards 1.

    `guess` (3,) are the three. Residuals are in units of the `noise` of a sample, so that `cost` is half of
    chi-square.
    """

    def difference(step: Array) -> Array:
        x = np.clip((time - step[0]) / step[1], 0, 1)
        return np.asarray((betainc(p, p, x) + step[2] - share) / noise)

    return least_squares(difference, guess, x_scale=[0.01, 0.05, 0.01], diff_step=[1e-4, 1e-4, 1e-4])
