"""Sums over the cycles of a recording, whose edges may lie between two samples."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.trial import Array


@dataclass(frozen=True)
class Cycles:
    """Division of the rows of a fit into cycles that the experiment repeats.

    The rows of a cycle follow one another; its edges may lie between two rows. The cycles of one stratum (one frequency
    at one amplitude) are repetitions: only the differences between them count as random error.
    """

    first: Array
    """Where each cycle begins, in rows of the fit, shape (m,)."""
    stop: Array
    """Where it ends, shape (m,)."""
    stratum: NDArray[np.intp]
    """Number of the stratum that each cycle belongs to, from 0 on and rising, shape (m,)."""

    def sums(self, X: Array, y: Array) -> Array:
        """Sums (m, p) of X times y in each cycle, for columns X (n, p) and y (n,) in the rows of the fit."""
        return self.products(X, y[:, None])[..., 0]

    def products(self, X: Array, Y: Array) -> Array:
        """X'Y (m, p, q) in each cycle, for columns X (n, p) and Y (n, q) in the rows of the fit.

        Where a cycle does not begin at the end of the one before, the rows on both sides are of different stretches of
        the recording: a fraction of a row is read there from rows of its own stretch.
        """
        apart = self.first[1:] != self.stop[:-1]
        begins, ends = np.append(True, apart), np.append(apart, True)
        inwards = np.stack([begins.astype(np.intp), -ends.astype(np.intp)], axis=1).ravel()
        return products_between(X, Y, self.first, self.stop, inwards)


def sums_between(values: Array, first: Array, stop: Array) -> Array:
    """Sums (m, p) of the rows of `values` (n, p) from `first` (m,) to `stop` (m,), which need not be whole numbers.

    The rows follow one another in one recording.
    """
    rows = np.ones((len(values), 1))
    return products_between(values, rows, first, stop, np.zeros(2 * len(first), dtype=np.intp))[..., 0]


def products_between(X: Array, Y: Array, first: Array, stop: Array, inwards: NDArray[np.intp]) -> Array:
    """X'Y (m, p, q) from each `first` (m,) to each `stop` (m,), which need not be whole numbers.

    A fraction of a row is read from the cubic through the four cumulative sums around it. A cycle whose period is not
    a whole number of rows then has the sum that every other cycle has. `inwards` (2 m,), 1 or -1, are the rows by which
    these four are moved to one side, for the begin and the end of each cycle in turn.
    """
    edges = np.stack([first, stop], axis=1).ravel()
    row = np.clip(np.floor(edges + 1e-9).astype(np.intp), 0, len(Y))
    whole = np.array([X[a:b].T @ Y[a:b] for a, b in row.reshape(-1, 2)])
    parts = fractions_of_rows(X, Y, row, np.maximum(edges - row, 0.0), inwards)
    return np.asarray(whole + parts[1::2] - parts[::2])


def fractions_of_rows(X: Array, Y: Array, row: NDArray[np.intp], share: Array, moved: NDArray[np.intp]) -> Array:
    """X'Y (m, p, q) in a `share` (m,) of each `row` (m,), by the cubic through the cumulative sums one row before it to
    two rows behind, or `moved` (m,) by some rows; beyond the ends there is nothing to sum."""
    at = row + moved + np.array([[-1], [0], [1]])
    inside = np.clip(at, 0, len(Y) - 1)
    weights = cubic_weights(np.where(share < 1e-9, 0.0, share) - moved) - cubic_weights(-moved)
    return np.asarray(np.einsum("km,kmp,kmq->mpq", weights * (at == inside), X[inside], Y[inside]))


def cubic_weights(x: Array | NDArray[np.intp]) -> Array:
    """Weights (3, m) of the rows before, at and behind a row in the sum from its begin over x (m,) rows.

    That sum is a cubic through the cumulative sums at -1, 0, 1 and 2 rows.
    """
    return np.array([x * (x - 1) * (x - 2), x * (x + 1) * (5 - 2 * x), x * (x + 1) * (x - 1)]) / 6
