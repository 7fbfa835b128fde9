"""The numerics of a regression: decomposition and checks of its columns, estimates from the normal equations."""

from collections.abc import Mapping, Sequence

import numpy as np

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.measured import check_all_measured
from osl_analysis.trial import Array

GRAM_LIMIT, TALL = 100.0, 50
"""Largest condition number, and rows per column from which it is worth while, with which the normal equations are
solved. Their own condition number is its square: rounding enters with 1e-12 at most, and a step of refinement takes it
off the estimates (Bjorck, Numerical Methods for Least Squares Problems, 1996, sec. 2.9)."""


def decomposed(X: Array, scale: Array) -> tuple[Array | None, Array, Array]:
    """Left singular vectors (n, p), singular values (p,), the largest first, and right singular vectors, a row each (p,
    p), of the columns X (n, p), each divided by its length `scale` (p,). Many rows make one pass over X, for its Gram
    matrix, if the columns are not alike (`GRAM_LIMIT`): the left vectors are None then."""
    n, p = X.shape
    if n > TALL * p:
        squares, V = np.linalg.eigh(X.T @ X / np.outer(scale, scale))
        if squares[-1] < GRAM_LIMIT**2 * squares[0]:
            return None, np.sqrt(squares[::-1]), V.T[::-1]
    return np.linalg.svd(X / scale, full_matrices=False)


def refined(X: Array, y: Array, inverse: Array) -> Array:
    """Estimates (p,) from the inverse (p, p) of the normal equations of X (n, p), with a step of refinement."""
    estimates = inverse @ (X.T @ y)
    return np.asarray(estimates + inverse @ (X.T @ (y - X @ estimates)))


def beside_offset(X: Array, inverse: Array) -> Array:
    """Inverse of the normal equations of the columns X (n, p) about their means, where one is constant: the part of the
    others in `inverse` (p, p). It does not depend on the zeros of the signals."""
    varies = [k for k, column in enumerate(X.T) if column[0] != column[-1] or np.ptp(column)]
    return inverse[np.ix_(varies, varies)]


def scaled_condition(inverse: Array) -> float:
    """Condition number of columns scaled to unit length, from the inverse (p, p) of their normal equations."""
    gram = np.linalg.inv(inverse)
    squares = np.linalg.eigvalsh(gram / np.sqrt(np.outer(np.diag(gram), np.diag(gram))))
    return float(np.sqrt(squares[-1] / max(squares[0], np.finfo(float).tiny)))


def largest_correlation(covariance: Array) -> float:
    """Largest absolute correlation in a covariance (p, p); 0 for a single estimate."""
    if len(covariance) < 2:
        return 0.0
    scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    correlation = np.abs(covariance / np.outer(scale, scale))
    np.fill_diagonal(correlation, 0.0)
    return float(np.max(correlation))


def check_not_zero(names: Sequence[str], X: Array) -> Array:
    """Lengths (p,) of the columns X (n, p); a column that is zero throughout is refused."""
    lengths = np.sqrt([column @ column for column in X.T])
    if not (lengths > 0).all():
        raise IdentifiabilityError(
            f"'{names[int(np.argmin(lengths))]}' cannot be estimated: its column is zero throughout"
        )
    return lengths


def refuse_unidentifiable(names: tuple[str, ...], direction: Array, condition: float) -> None:
    """Raise an error that names the two columns with the largest weights in `direction`, which cannot be estimated."""
    worst = sorted(np.argsort(np.abs(direction))[-2:])
    first, second = (names[i] for i in worst)
    raise IdentifiabilityError(
        f"{first} and {second} cannot be told apart in these data (scaled condition number {condition:.3g}); "
        "excite more frequencies, lengthen the window or fix one of them"
    )


def checked_columns(shape: tuple[int, ...], columns: Mapping[str, Array]) -> Array:
    """The columns as a matrix (n, p), after checks of their lengths, their values and the number of samples. `shape`
    (n,) is that of y."""
    for name, column in columns.items():
        if np.shape(column) != shape:
            raise InputError(f"column '{name}' has shape {np.shape(column)}, expected {shape} like y")
    X = np.array([np.asarray(c, dtype=float) for c in columns.values()])
    check_all_measured([f"column '{name}'" for name in columns], X)
    if shape[0] <= len(columns):
        raise InputError(f"{shape[0]} samples cannot determine {len(columns)} parameters; use a longer window")
    return X.T
