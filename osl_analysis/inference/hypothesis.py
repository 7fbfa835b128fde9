"""What one rival explanation of a torque is, and how it is fitted.

Each hypothesis is a class: its family, its name, and how its columns are made. The first three
columns multiply K, B and I:

    torque = K x_1 + B x_2 + I x_3 + further columns + offset and drift
             (+ dry friction) + noise

A path, for example, delays or filters what the load cell sees of the joint's torque: its x_k are
the delayed angle, velocity and acceleration. `hypotheses.py` lists all of them.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy

from osl_analysis.inference.whitening import BesideShared, Whitened
from osl_analysis.trial import Array

Family = Literal["", "path", "time", "speed", "size", "direction", "clipping"]
PLAIN = "nothing"  # the hypothesis that is Eq. 15 alone
# nats that a grid must gain: below it a weight stays near its small prior, unless B or I of Eq. 15
# alone is negative, which a path may explain although it gains nothing
WORTH_REFINING = 2.0
# residual sum of squares of white noise of variance 1 that it is: nats are half a sum of squares
SQUARES_WORTH_REFINING = 2 * WORTH_REFINING
REFINEMENTS = 12  # evaluations of Brent's method about a minimum of the grid


@dataclass(frozen=True)
class Candidate:
    """A hypothesis at a value of its own parameter, ready to be fitted and to predict.

    Attributes
    ----------
    hypothesis : Hypothesis
        What it is of.
    columns : Array (k, m)
        Whitened columns; the first three multiply K, B and I.
    torque : Array (m,)
        Whitened torque that they explain.
    slope : Array (m,) or None
        Derivative of the modelled torque by its own parameter.
    impedance_matrices : tuple of Array (3, k)
        Matrices that turn the coefficients into K, B and I. There are several where K is not one
        number: at the beginning and at the end, on this and on the other side.
    """

    hypothesis: "Hypothesis"
    columns: Array
    torque: Array
    slope: Array | None = None
    impedance_matrices: tuple[Array, ...] = ()

    def to_impedance(self, width: int) -> tuple[Array, ...]:
        """The matrices (3, width); without any of its own, that of the motion."""
        if self.impedance_matrices:
            return self.impedance_matrices
        of_motion = self.hypothesis.data.impedance_matrix
        others = np.zeros((3, width - of_motion.shape[1]))
        return (np.hstack([of_motion, others]),)


class Search:
    """Fits of columns to the torque of a joint with or without friction, beside offset and drift.

    Attributes
    ----------
    data : Whitened
        The recording.
    has_friction : bool
        Whether the joint has friction.
    left : float
        What Eq. 15 alone leaves of the torque.
    coefficients : Array (3,) or (4,)
        Those of its motion's columns.
    impedance : Array (3,)
        Its K, B, I.
    """

    def __init__(self, data: Whitened, has_friction: bool) -> None:
        self.data = data
        self.has_friction = has_friction
        self._beside = BesideShared(data.shared(has_friction))
        self.left, self.coefficients = self.fit(data.motion)
        self.impedance = data.impedance_matrix @ self.coefficients

    def fit(self, columns: Array, torque: Array | None = None) -> tuple[float, Array]:
        """Residual sum of squares and coefficients (k,) of columns (k, m)."""
        return self._beside.fit(columns, self.data.torque if torque is None else torque)

    def rest(self, columns: Array, torque: Array) -> Array:
        """What columns (k, m) and the shared ones leave of a torque (m,)."""
        _, estimates = self.fit(columns, torque)
        return self._beside.rest(torque - estimates @ columns)

    @cached_property
    def may_be_path(self) -> bool:
        """Whether jerk and snap beside the motion gain anything, as they do for any path: to first
        order in its delay or compliance a path adds multiples of them to Eq. 15."""
        left, _ = self.fit(self.data.higher_motion)
        return not self.is_body or self.left - left >= SQUARES_WORTH_REFINING

    @property
    def is_body(self) -> bool:
        """Whether B and I of Eq. 15 alone are positive."""
        return float(self.impedance[1:].min()) > 0.0

    def minima(self, left: Callable[[float], float], grid: Array, values: Array) -> list[float]:
        """Up to two minima of what is left over a parameter, the lower one first; `values` (g,) are
        those on its grid (g,).

        A delay has a false minimum beside the true one.
        """
        if self.is_body and self.left - values.min() < SQUARES_WORTH_REFINING:
            return []
        minima = []
        for k in np.argsort(values).tolist():
            before, after = max(k - 1, 0), min(k + 1, len(grid) - 1)
            if values[k] > min(values[before], values[after]):
                continue
            ends = float(grid[before]), float(grid[after])
            refined = scipy.optimize.minimize_scalar(
                left,
                bounds=ends,
                method="bounded",
                options={"maxiter": REFINEMENTS, "xatol": 1e-4 * (ends[1] - ends[0])},
            )
            minima.append((float(refined.fun), float(refined.x)))
        return [parameter for _, parameter in sorted(minima)[:2]]


@dataclass(frozen=True, eq=False)
class Hypothesis(ABC):
    """One explanation of a recording's torque; an instance serves one recording."""

    data: Whitened
    family: Family
    name: str

    @abstractmethod
    def candidates(self, search: Search) -> list[Candidate]:
        """Find values of its own parameter that may be; none if it gains nothing."""


class OneParameter(Hypothesis):
    """A hypothesis with one parameter of its own, sought on a grid and then refined."""

    @property
    @abstractmethod
    def grid(self) -> Array:
        """Values (g,) of the parameter, ascending."""

    def columns(self, values: Array) -> Array:
        """Those whitened columns (v, j, m) that depend on the parameter, at values (v,) of it."""
        raise NotImplementedError

    @cached_property
    def columns_on_grid(self) -> Array:
        """The `columns` (g, j, m) at the values of the grid, which serve every kind of joint."""
        return self.columns(self.grid)

    def with_others(self, columns: Array) -> Array:
        """All columns (v, k, m): those that depend on the parameter stand in place of the first
        ones of the motion."""
        of_all = np.empty((len(columns), *self.data.motion.shape))
        of_all[:] = self.data.motion
        of_all[:, : columns.shape[1]] = columns
        return of_all

    def model(self, value: float, search: Search) -> tuple[Array, Array]:
        """Columns (k, m) at a value, and the torque (m,) that they explain."""
        return self.with_others(self.columns(np.array([value])))[0], search.data.torque

    def left_on_grid(self, search: Search) -> Array:
        """What the model leaves of the torque at each value of the grid (g,)."""
        columns_on_grid = self.with_others(self.columns_on_grid)
        return np.array([search.fit(columns)[0] for columns in columns_on_grid])

    def candidates(self, search: Search) -> list[Candidate]:

        def left(value: float) -> float:
            return search.fit(*self.model(value, search))[0]

        minima = search.minima(left, self.grid, self.left_on_grid(search))
        return [self._candidate(value, search) for value in minima]

    def _candidate(self, value: float, search: Search) -> Candidate:
        columns, torque = self.model(value, search)
        estimates = search.fit(columns, torque)[1]
        # derivative of the modelled torque, from a small step of the parameter
        step = 1e-3 * abs(value) + 1e-9
        columns_then, torque_then = self.model(value + step, search)
        slope = (estimates @ (columns_then - columns) - (torque_then - torque)) / step
        return Candidate(self, columns, torque, slope)
