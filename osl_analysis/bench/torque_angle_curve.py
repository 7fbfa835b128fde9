"""Curves of torque over angle: torque and slope at a grid of angles, energies, the straight line while loading."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.angle_cycles import Cycle, joined
from osl_analysis.errors import InputError
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.stats.slow_motion import fit_slow_motion
from osl_analysis.trial import Array

FEWEST_SAMPLES = 10
"""Samples around a point of a curve below which it stays empty."""
NORMAL = 1.96
"""Half-width of the 95 % interval, in standard errors, where the noise is known well."""
FEWEST_POINTS = 5
"""Points of a curve below which a trial is refused."""


@dataclass(frozen=True)
class Energies:
    """Energies of one cycle [J]: taken up from the bench, given back, and the difference."""

    stored: float
    returned: float

    @property
    def lost(self) -> float:
        """The area of the loop."""
        return self.stored - self.returned


@dataclass(frozen=True)
class Curve:
    """One branch, over the cycles: (m,) each at the angles of the grid; NaN where the branch does not reach."""

    torque: Array
    """Torque [N*m], mean of the cycles."""
    stiffness: Array
    """Slope of torque over angle [N*m/rad], mean of the cycles."""
    torque_half: Array
    """Half-width of the 95 % interval of the torque."""
    stiffness_half: Array
    """Half-width of the 95 % interval of the slope."""
    torques: Array
    """Torque of each cycle (cycles, m)."""


def energies(theta: Array, torque: Array, cycle: Cycle) -> Energies:
    """Energies of a cycle: the integral of torque [N*m] over angle [rad], piece by piece.

    A piece ends where the angle turns or the torque changes its sign, so that noise is not counted as energy to and
    fro.
    """
    angle, load = theta[cycle.rows], torque[cycle.rows]
    work = np.concatenate([[0.0], np.cumsum((load[1:] + load[:-1]) / 2 * np.diff(angle))])
    signs = np.flatnonzero(np.diff(np.signbit(load))) + 1
    edges = np.unique([0, *signs, *(turn - cycle.start for turn in cycle.turns), len(work) - 1])
    pieces = np.diff(work[edges])
    return Energies(float(pieces[pieces > 0].sum()), float(-pieces[pieces < 0].sum()))


def grid_deg(theta: Array, branches: Sequence[Sequence[NDArray[np.intp]]], step_deg: float) -> Array:
    """The angles [deg], multiples of a step, that every branch of every cycle passes.

    Raises
    ------
    InputError
        There are too few.
    """
    low = max(float(theta[rows].min()) for cycle in branches for rows in cycle)
    high = min(float(theta[rows].max()) for cycle in branches for rows in cycle)
    first, last = int(np.ceil(np.rad2deg(low) / step_deg)), int(np.floor(np.rad2deg(high) / step_deg))
    if last - first + 1 < FEWEST_POINTS:
        raise InputError(
            f"of the grid's angles {max(last - first + 1, 0)} lie within the motion ({np.rad2deg(low):.2f} to "
            f"{np.rad2deg(high):.2f} deg), expected {FEWEST_POINTS} or more; lower angle_step_deg from {step_deg:g} "
            f"deg to {np.rad2deg(high - low) / (2 * FEWEST_POINTS):.2g} deg or less"
        )
    return np.asarray(np.arange(first, last + 1) * step_deg, dtype=np.float64)


@dataclass(frozen=True)
class Smoothing:
    """How a point of a curve is fitted: samples within `window` [rad] to each side, of which noise is independent after
    `every` samples (`LowPass.independent_samples`).
    """

    window: float
    every: int


@dataclass(frozen=True)
class Point:
    """A point of a curve: torque [N*m] and slope [N*m/rad], with what their errors are made of.

    unit: squared standard errors (2,) of both if the noise has a spectral density of 1 [(N*m)^2 per sample].
    noise: the density that the samples around show. freedom: its degrees of freedom. All NaN without enough samples.
    """

    torque: float
    slope: float
    unit: tuple[float, float]
    noise: float
    freedom: float


EMPTY = Point(np.nan, np.nan, (np.nan, np.nan), np.nan, np.nan)


def local_line(theta: Array, torque: Array, at: float, smoothing: Smoothing) -> Point:
    """Torque and slope at an angle [rad] of the samples (n,) of one branch: a parabola through those around.

    The slope is NaN where they do not reach as far as the window on both sides. What a cubic describes is not noise.
    """
    window = smoothing.window
    near = np.abs(theta - at) <= window
    x = (theta[near] - at) / window
    if x.size < FEWEST_SAMPLES:
        return EMPTY
    columns = {"torque": np.ones_like(x), "slope": x, "curvature": x**2}
    fit = fit_slow_motion(torque[near], columns, {"cubic": x**3}, smoothing.every)
    solution = np.linalg.pinv(np.column_stack(list(columns.values())))
    unit = np.sum(solution[:2] ** 2, axis=1)
    reaches = theta.min() <= at - window and theta.max() >= at + window
    slope = fit["slope"] / window if reaches else np.nan
    noise, freedom = float(fit.covariance[0, 0] / unit[0]), float(fit.degrees_of_freedom[0])
    return Point(fit["torque"], slope, (float(unit[0]), float(unit[1]) / window**2), noise, freedom)


def branch_curve(
    theta: Array, torque: Array, branches: Sequence[NDArray[np.intp]], at: Array, smoothing: Smoothing
) -> Curve:
    """A branch at the angles `at` (m,) [rad], from its rows in each cycle.

    With two cycles or more the intervals are those of their scatter (Student), with one those of its noise.
    """
    points = [[local_line(theta[rows], torque[rows], a, smoothing) for a in at] for rows in branches]
    torques = np.array([[point.torque for point in cycle] for cycle in points])
    slopes = np.array([[point.slope for point in cycle] for cycle in points])
    if len(branches) == 1:
        halves = NORMAL * np.sqrt(usual_noise(points[0]) * np.array([point.unit for point in points[0]]))
        return Curve(torques[0], slopes[0], halves[:, 0], halves[:, 1], torques)
    scatter = [np.array([half_width(values[:, k]) for k in range(len(at))]) for values in (torques, slopes)]
    return Curve(torques.mean(axis=0), slopes.mean(axis=0), scatter[0], scatter[1], torques)


def usual_noise(points: Sequence[Point]) -> float:
    """Spectral density of the noise of a branch [(N*m)^2 per sample]: the median over its points.

    At a kink of the curve, what the cubic cannot describe would count as noise. The median of few degrees of freedom is
    below their mean by the factor of Wilson and Hilferty (1931).
    """
    found = np.array([(point.noise, point.freedom) for point in points if np.isfinite(point.noise)]).reshape(-1, 2)
    if not len(found):
        return np.nan
    density, freedom = np.median(found, axis=0)
    return float(density / (1 - 2 / (9 * freedom)) ** 3)


def half_width(values: Array) -> float:
    """Half-width of the 95 % interval of the mean of values (cycles,); NaN where one is."""
    if np.isnan(values).any():
        return np.nan
    repeats = over_repeats(values)
    return repeats.high - repeats.mean


def straight_line(theta: Array, torque: Array, pieces: Sequence[slice]) -> float:
    """Slope [N*m/rad] of the straight line through a branch by least squares over angle.

    Each sample counts by the angle that it covers, so that a rest on the way, or a slower end, does not weigh more.
    """
    rows = joined(pieces)
    weight = np.concatenate([np.abs(np.gradient(theta[piece])) for piece in pieces])
    angle, load = theta[rows], torque[rows]
    centred = angle - np.average(angle, weights=weight)
    return float(np.sum(weight * centred * load) / np.sum(weight * centred**2))


def secant(theta: Array, torque: Array, rows: NDArray[np.intp]) -> float:
    """Slope [N*m/rad] of the line between the lowest and the highest angle of a branch."""
    low, high = rows[np.argmin(theta[rows])], rows[np.argmax(theta[rows])]
    return float((torque[high] - torque[low]) / (theta[high] - theta[low]))
