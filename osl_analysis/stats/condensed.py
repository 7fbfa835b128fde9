"""Few rows in place of the many of a regression: they have the same sums of products, and so the same estimates."""

from collections.abc import Callable, Iterable

import numpy as np
from scipy.linalg import solve_triangular

from osl_analysis.stats.least_squares import GRAM_LIMIT
from osl_analysis.trial import Array

Parts = Callable[[], Iterable[tuple[Array, Array]]]
"""Makes the rows of a regression, columns X (k, p) and y (k,), some at a time."""


def condensed(parts: Parts) -> tuple[Array, Array]:
    """Columns (p + 1, p) and y (p + 1,) with the sums of squares and products of all the rows of `parts`.

    Least squares of these few are those of all: lengths, condition and inverse are the same. They are the triangle of
    a QR decomposition, with what y has beyond the columns as its last row. Columns that are not alike get it from their
    sums of products; others are decomposed part by part, for 50 times the work (Golub and Van Loan, Matrix
    Computations, 2013, sec. 5.3).
    """
    moments = sum(np.column_stack([X, y]).T @ np.column_stack([X, y]) for X, y in parts())
    products, square = np.asarray(moments)[:-1], float(np.asarray(moments)[-1, -1])
    gram, moment = products[:, :-1], products[:, -1]
    scale = np.sqrt(np.diag(gram))
    apart = np.linalg.eigvalsh(gram / np.outer(scale, scale)) if (scale > 0).all() else np.zeros(1)
    if not apart[-1] < GRAM_LIMIT**2 * apart[0]:
        return by_rotation(parts, len(gram))
    R = np.linalg.cholesky(gram / np.outer(scale, scale)).T * scale
    z = solve_triangular(R, moment, trans=1)
    return np.vstack([R, np.zeros(len(R))]), np.append(z, np.sqrt(max(square - float(z @ z), 0.0)))


def by_rotation(parts: Parts, columns: int) -> tuple[Array, Array]:
    """`condensed` rows by orthogonal transformations, part by part."""
    R = np.zeros((columns + 1, columns + 1))
    for X, y in parts():
        R = np.asarray(np.linalg.qr(np.vstack([R, np.column_stack([X, y])]), mode="r"))
    return R[:, :-1], R[:, -1]
