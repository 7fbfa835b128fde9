"""Curves of torque over angle: torque and slope at a grid of angles, energies, the straight line while loading."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.angle_cycles import Cycle, joined
from osl_analysis.errors import InputError
from osl_analysis.stats.regression import linear_fit
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.trial import Array

FEWEST_SAMPLES = 10
"""Samples around a point of a curve below which it stays empty."""
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


def local_line(theta: Array, torque: Array, at: float, window: float) -> tuple[float, float, float, float]:
    """Torque [N*m] and slope [N*m/rad] at an angle [rad], and the half-widths of their 95 % intervals.

    A parabola is fitted to the samples (n,) within `window` [rad] to each side; the slope is NaN where the samples do
    not reach that far on both sides. The intervals are those of one cycle's noise (Newey and West).
    """
    near = np.abs(theta - at) <= window
    x = (theta[near] - at) / window
    if x.size < FEWEST_SAMPLES:
        return (np.nan,) * 4
    columns = {"torque": np.ones_like(x), "slope": x, "curvature": x**2}
    fit = linear_fit(torque[near], columns)
    halves = [fit.interval(name)[1] - fit[name] for name in ("torque", "slope")]
    reaches = theta.min() <= at - window and theta.max() >= at + window
    slope, half = (fit["slope"] / window, halves[1] / window) if reaches else (np.nan, np.nan)
    return fit["torque"], slope, halves[0], half


def branch_curve(theta: Array, torque: Array, branches: Sequence[NDArray[np.intp]], at: Array, window: float) -> Curve:
    """A branch at the angles `at` (m,) [rad], from its rows in each cycle.

    With two cycles or more the intervals are those of their scatter (Student), with one those of its noise.
    """
    fits = np.array([[local_line(theta[rows], torque[rows], a, window) for a in at] for rows in branches])
    torques, slopes = fits[:, :, 0], fits[:, :, 1]
    if len(branches) == 1:
        return Curve(torques[0], slopes[0], fits[0, :, 2], fits[0, :, 3], torques)
    halves = [[half_width(values[:, k]) for k in range(len(at))] for values in (torques, slopes)]
    return Curve(torques.mean(axis=0), slopes.mean(axis=0), np.array(halves[0]), np.array(halves[1]), torques)


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
