"""Least squares of whitened rows, alone and beside columns that all hypotheses share."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.trial import Array

RIDGE = 1e-11  # of scaled columns: far below any that a recording tells, keeps equal ones apart
EPSILON = np.finfo(float).eps
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


@dataclass(frozen=True)
class Products:
    """All that least squares beside shared columns needs of k columns, or of each of some sets.

    Attributes
    ----------
    columns : Array (..., k, k)
        Products of the columns with each other.
    shared : Array (..., k, s)
        Their products with the shared ones, which have length 1.
    rest : Array (..., k)
        Their products with what the shared ones leave of the torque.
    square : float
        Square of that rest.
    """

    columns: Array
    shared: Array
    rest: Array
    square: float


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
        """Fit columns (k, m) to what the shared ones leave of a torque, `rest` (m,)."""
        left, estimates = self.fit_products(self.products(columns, rest))
        return float(left), estimates

    def products(self, columns: Array, rest: Array) -> Products:
        """Multiply columns (..., k, m) by each other, by the shared ones, and by a `rest` (m,)."""
        return Products(
            columns=columns @ np.swapaxes(columns, -1, -2),
            shared=columns @ self._shared.T,
            rest=columns @ rest,
            square=float(rest @ rest),
        )

    def fit_products(self, products: Products) -> tuple[Array, Array]:
        """Fit the columns that have these products.

        Returns
        -------
        left : Array (...,)
            Residual sum of squares.
        estimates : Array (..., k)
            Coefficients of the columns.
        """
        diagonal = np.arange(products.columns.shape[-1])
        scale = np.sqrt(products.columns[..., diagonal, diagonal]) + TINY
        of_shared = products.shared / scale[..., None]
        normal = products.columns / (scale[..., :, None] * scale[..., None, :])
        normal -= of_shared @ self._inverse @ np.swapaxes(of_shared, -1, -2)
        # a column that the shared ones make up has nothing left but the rounding of its products
        left_of_columns = np.maximum(normal[..., diagonal, diagonal], EPSILON)
        unit = np.sqrt(left_of_columns)
        normal /= unit[..., :, None] * unit[..., None, :]
        normal[..., diagonal, diagonal] += RIDGE
        length = scale * unit
        product = products.rest / length
        estimates = np.linalg.solve(normal, product[..., None])[..., 0]
        left = products.square - np.sum(estimates * product, axis=-1)
        return left, np.asarray(estimates / length)
