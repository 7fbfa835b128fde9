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
    length = lengths_of(columns)
    unit = columns / length[:, None]
    normal = unit @ unit.T + RIDGE * np.eye(len(unit))
    estimates = np.linalg.solve(normal, unit @ torque)
    # one step of refinement takes off what rounding of the normal matrix has added
    estimates += np.linalg.solve(normal, unit @ (torque - estimates @ unit))
    return np.asarray(estimates / length)


class BesideShared:
    """Least squares of further columns beside shared ones (k, m).

    The shared columns are projected out (Frisch-Waugh-Lovell), so that a search over a hypothesis's
    own parameter solves for three columns. Of these only products are needed, not what the shared
    ones leave of each row.
    """

    def __init__(self, shared: Array) -> None:
        length = lengths_of(shared)
        self._shared = shared / length[:, None]
        normal = self._shared @ self._shared.T + RIDGE * np.eye(len(shared))
        self._inverse = np.linalg.inv(normal)

    def rest(self, torque: Array) -> Array:
        """What the shared columns leave of a torque (m,)."""
        of_shared = self._inverse @ (self._shared @ torque)
        return np.asarray(torque - of_shared @ self._shared)

    def fit(self, columns: Array, torque: Array) -> tuple[float, Array]:
        """Fit columns (k, m) to a torque (m,)."""
        return self.fit_rest(columns, self.rest(torque))

    def fit_rest(self, columns: Array, rest: Array) -> tuple[float, Array]:
        """Fit columns (k, m) to what the shared ones leave of a torque, `rest` (m,).

        Returns
        -------
        left : float
            Residual sum of squares.
        estimates : Array (k,)
            Coefficients of the columns.
        """
        products = columns @ columns.T
        scale = np.sqrt(np.diag(products)) + TINY
        of_shared = (columns @ self._shared.T) / scale[:, None]
        normal = products / np.outer(scale, scale)
        normal -= of_shared @ self._inverse @ of_shared.T
        # a column that the shared ones make up has nothing left but the rounding of its products
        left_of_columns = np.maximum(np.diag(normal), np.finfo(float).eps)
        unit = np.sqrt(left_of_columns)
        normal = normal / np.outer(unit, unit) + RIDGE * np.eye(len(columns))
        length = scale * unit
        product = columns @ rest / length
        estimates = np.linalg.solve(normal, product)
        left = float(rest @ rest - estimates @ product)
        return left, np.asarray(estimates / length)
