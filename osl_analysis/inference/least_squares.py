"""Least squares of whitened rows, alone and beside columns that all hypotheses share."""

import numpy as np

from osl_analysis.trial import Array

RIDGE = 1e-11  # of scaled columns: far below any that a recording tells, keeps equal ones apart
TINY = 1e-150  # length of a column of zeros, whose square is a number, too


def lengths_of(columns: Array) -> Array:
    """Lengths (k,) of columns (k, m); none is 0."""
    return np.asarray(np.sqrt(np.einsum("...m,...m->...", columns, columns)) + TINY)


def solve_scaled(columns: Array, torque: Array) -> Array:
    """Estimate the coefficients (k,) of columns (k, m) for a torque (m,)."""
    products = columns @ columns.T
    length = np.sqrt(products.diagonal()) + TINY
    normal = products / np.outer(length, length) + RIDGE * np.eye(len(length))
    estimates = np.linalg.solve(normal, columns @ torque / length) / length
    # one step of refinement takes off what rounding of the normal matrix has added
    left = torque - estimates @ columns
    return np.asarray(estimates + np.linalg.solve(normal, columns @ left / length) / length)


class BesideShared:
    """Least squares of further columns beside shared ones (k, m).

    The shared columns are projected out (Frisch-Waugh-Lovell), so that a search over a hypothesis's
    own parameter solves for three columns.
    """

    def __init__(self, shared: Array) -> None:
        self._shared = shared / lengths_of(shared)[:, None]
        normal = self._shared @ self._shared.T + RIDGE * np.eye(len(shared))
        self._inverse = np.linalg.inv(normal)

    def rest(self, signals: Array) -> Array:
        """What the shared columns leave of signals (..., m)."""
        of_shared = (signals @ self._shared.T) @ self._inverse
        return np.asarray(signals - of_shared @ self._shared)

    def fit(self, columns: Array, torque: Array) -> tuple[float, Array]:
        """Residual sum of squares and coefficients (k,) of columns (k, m) for a torque (m,)."""
        rest_of_torque = self.rest(torque)
        rest_of_columns = self.rest(columns)
        estimates = solve_scaled(rest_of_columns, rest_of_torque)
        residual = rest_of_torque - estimates @ rest_of_columns
        return float(residual @ residual), estimates
