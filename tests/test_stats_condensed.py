"""Few rows in place of many: least squares of them are least squares of all."""

import numpy as np
import pytest

from osl_analysis.errors import IdentifiabilityError
from osl_analysis.pieces import pieces
from osl_analysis.stats.condensed import condensed
from osl_analysis.stats.regression import regressors
from osl_analysis.trial import Array


def rows(alike: float, seed: int = 3) -> tuple[Array, Array]:
    """Three columns of 1000 rows, of which the third is the first but for a share that is not `alike`, and y."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((1000, 3)) * [1.0, 1e4, 1e-3]
    X[:, 2] = 1e-3 * X[:, 0] + (1 - alike) * X[:, 2]
    return X, X @ [300.0, 5e-3, 2e4] + 0.1 * rng.standard_normal(1000)


def few(X: Array, y: Array) -> tuple[Array, Array]:
    return condensed(lambda: ((X[r], y[r]) for r in pieces(len(y), 130)))


@pytest.mark.parametrize("alike", [0.0, 0.999, 1 - 1e-7])
def test_least_squares_of_the_condensed_rows_are_those_of_all_rows_however_alike_the_columns_are(alike):
    X, y = rows(alike)
    A, b = few(X, y)
    assert A.shape == (4, 3)
    length = np.linalg.norm(X, axis=0)
    np.testing.assert_allclose(np.linalg.norm(A, axis=0), length, rtol=1e-12)
    X, A = X / length, A / length
    expected, found = (np.linalg.lstsq(columns, of, rcond=None)[0] for columns, of in ((X, y), (A, b)))
    np.testing.assert_allclose(found, expected, rtol=1e-15 * max(np.linalg.cond(X), 1e3))
    np.testing.assert_allclose(np.linalg.norm(b - A @ found), np.linalg.norm(y - X @ expected), rtol=1e-8)
    np.testing.assert_allclose(np.linalg.cond(A), np.linalg.cond(X), rtol=1e-6)


def test_columns_that_are_the_same_are_refused_by_their_condensed_rows_as_by_all():
    X, y = rows(1.0)
    messages = []
    for columns, of in ((X, y), few(X, y)):
        with pytest.raises(IdentifiabilityError, match=r"K and I cannot be told apart") as refused:
            regressors(dict(zip("KBI", columns.T, strict=True)), of.shape)
        messages.append(str(refused.value).partition("(")[0])
    assert messages[0] == messages[1]


def test_a_column_of_zeros_stays_one():
    X, y = rows(0.0)
    X[:, 1] = 0.0
    A, b = few(X, y)
    with pytest.raises(IdentifiabilityError, match=r"'B' cannot be estimated"):
        regressors(dict(zip("KBI", A.T, strict=True)), b.shape)
