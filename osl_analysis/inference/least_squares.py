"""Least squares of whitened rows, alone and beside columns that all hypotheses share."""

import numpy as np

from osl_analysis.trial import Array

RIDGE = 1e-11  # of scaled columns: far below any that a recording tells, keeps equal ones apart


def lengths_of(columns: Array) -> Array:
    """Lengths (k,) of columns (k, m); none is 0."""
    return np.asarray(np.linalg.norm(columns, axis=-1) + 1e-300)


def solve_scaled(columns: Array, torque: Array) -> Array:
    """Estimate the coefficients (k,) of columns (k, m) for a torque (m,)."""
    length = lengths_of(columns)
    unit = columns / length[:, None]
    normal = unit @ unit.T + RIDGE * np.eye(len(unit))
    estimates = np.linalg.solve(normal, unit @ torque)
    # one step of refinement takes off what rounding of the normal matrix has added
    estimates += np.linalg.solve(normal, unit @ (torque - estimates @ unit))
    return np.asarray(estimates / length)


class BesideShared:
    """Least squares of further columns beside shared ones (k, m).

    The shared columns are projected out of everything once (Frisch-Waugh-Lovell), so that a search
    over a hypothesis's own parameter solves for three columns.
    """

    def __init__(self, shared: Array) -> None:
        length = lengths_of(shared)
        self._shared = shared / length[:, None]
        normal = self._shared @ self._shared.T + RIDGE * np.eye(len(shared))
        self._inverse = np.linalg.inv(normal)

    def rest(self, x: Array) -> Array:
        """What the shared columns leave of signals (..., m)."""
        return np.asarray(x - (x @ self._shared.T) @ self._inverse @ self._shared)

    def fit(self, columns: Array, torque: Array) -> tuple[float, Array]:
        """Fit columns (k, m) to a torque (m,).

        Returns
        -------
        left : float
            Residual sum of squares.
        estimates : Array (k,)
            Coefficients of the columns.
        """
        own = self.rest(columns)
        length = lengths_of(own)
        own = own / length[:, None]
        rest = self.rest(torque)
        normal = own @ own.T + RIDGE * np.eye(len(own))
        product = own @ rest
        estimates = np.linalg.solve(normal, product)
        left = float(rest @ rest - estimates @ product)
        return left, np.asarray(estimates / length)
