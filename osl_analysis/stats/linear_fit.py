# SPDX-License-Identifier: Apache-2.0
"""Least squares: estimates with a covariance, refusal of columns that look alike, and VAF.

The estimates solve X'X x = X'y. `linear_fit` has the covariance of white noise. Fits on the bench
take theirs from the spread between repeated cycles or from blocks that are left out
(bench/regression.py), fits of walking from gait and plate (walking/impedance_fit.py).

Example: `linear_fit(torque, {"K": theta, "B": omega})["K"]`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.errors import IdentifiabilityError, InputError
from osl_analysis.base.measured import EXACT_FIT_ROUNDING, check_finite, check_measured
from osl_analysis.base.trial import Array
from osl_analysis.stats.budget import (
    PART_AND_BASIS,
    SOURCES_OF_ONE_TRIAL,
    Budget,
    Contribution,
    scatter,
    welch_satterthwaite,
)
from osl_analysis.stats.sources import Source

CONDITION_LIMIT = 1e3
"""Largest scaled condition number that is accepted. At this limit an error of 0.1 % in a column can
cause an error of 100 % in an estimate."""
FALSE_ALARM = 1e-3  # probability of a false alarm for one effect
DIRECTION_ROUNDING = 1e-13  # eigenvalue over the largest one, below which it is rounding
ROW_ROUNDING = 1e-9  # of a row, within which an edge lies on it


@dataclass(frozen=True)
class LinearFit:
    """A least-squares fit of p columns to y (n,)."""

    names: tuple[str, ...]  # names of the p columns
    estimates: Array  # estimates (p,) [unit of y per unit of the column]
    covariance: Array  # of the estimates (p, p), as the scatter of these data shows it
    vaf: float  # 100 (1 - var(residual)/var(y)) [percent]. An offset does not change it.
    interval_method: str
    """Source of the covariance: `white noise`, or the source that its own fit names."""
    # degrees of freedom (p,) of the variances in the covariance
    degrees_of_freedom: Array
    # errors that no scatter shows (type B), as source and change (p,) of the estimates by one
    # standard uncertainty
    known_errors: tuple[tuple[Source, Array], ...] = ()

    def __getitem__(self, name: str) -> float:
        return float(self.estimates[self.names.index(name)])

    def budget(self, name: str) -> Budget:
        """One estimate with the contributions to its uncertainty: scatter and known errors."""
        k = self.names.index(name)
        standard = float(np.sqrt(self.covariance[k, k]))
        contributions = [scatter(standard, float(self.degrees_of_freedom[k]))]
        for source, change in self.known_errors:
            part, basis = PART_AND_BASIS.get(source, ("bench", "stated"))
            contributions.append(
                Contribution(
                    source=source,
                    standard=abs(float(change[k])),
                    basis=basis,
                    part=part,
                    shared=source not in SOURCES_OF_ONE_TRIAL,
                )
            )
        return Budget(self[name], tuple(contributions))

    def se(self, name: str) -> float:
        """Standard error of one estimate, in its unit."""
        return self.budget(name).spread()[0]

    def half_width(self, name: str) -> float:
        """Half of the 95 % interval of one estimate, in its unit."""
        return self.budget(name).half_width()

    def interval(self, name: str) -> tuple[float, float]:
        """Bounds of the 95 % interval of one estimate, in its unit."""
        half = self.half_width(name)
        return self[name] - half, self[name] + half

    def with_known_error(self, source: Source, change: Array) -> "LinearFit":
        """The fit with an error that no scatter shows.

        Parameters
        ----------
        source : Source
            What makes it.
        change : Array (p,)
            Effect on the estimates of one standard uncertainty of a known quantity, such as a
            calibration, with infinite degrees of freedom (type B).
        """
        if not np.any(change):
            return self
        return replace(self, known_errors=(*self.known_errors, (source, change)))

    def beyond_interval(self, name: str, expected: float = 0.0) -> float:
        """Difference of an estimate from what is expected, less the half-width of its interval; 0
        within the interval."""
        difference = self[name] - expected
        return float(np.sign(difference)) * max(abs(difference) - self.half_width(name), 0.0)

    def derived(self, functions: Mapping[str, tuple[float, Mapping[str, float]]]) -> "LinearFit":
        """Functions of the estimates, to first order.

        Parameters
        ----------
        functions
            By name its value and its derivatives by the estimates. The degrees of freedom of its
            scatter are those of the first of these estimates.
        """
        gradients = [gradient for _, gradient in functions.values()]
        J = np.array([[gradient.get(name, 0.0) for name in self.names] for gradient in gradients])
        firsts = [self.names.index(next(iter(gradient))) for gradient in gradients]
        return replace(
            self,
            names=tuple(functions),
            estimates=np.array([value for value, _ in functions.values()]),
            covariance=J @ self.covariance @ J.T,
            degrees_of_freedom=self.degrees_of_freedom[firsts],
            known_errors=tuple((source, J @ change) for source, change in self.known_errors),
        )

    def certain(self, name: str) -> bool:
        """Whether an estimate differs from 0 by a two-sided test at the level `FALSE_ALARM`."""
        standard, freedom = self.budget(name).spread()
        quantile = float(scipy.special.stdtrit(freedom, 1 - FALSE_ALARM / 2))
        return abs(self[name]) > quantile * standard


def linear_fit(y: Array, columns: Mapping[str, Array]) -> LinearFit:
    """Fit columns to y by least squares, with standard errors for white noise.

    Parameters
    ----------
    y : Array (n,)
        The explained signal.
    columns : Mapping of Array (n,)
        The explaining signals, by name.

    Raises
    ------
    InputError
        A value cannot be measured (`check_measured`), or there are not more samples than columns.
    IdentifiabilityError
        The scaled condition number exceeds `CONDITION_LIMIT`; the message names the two columns
        that look alike.
    """
    names = tuple(columns)
    for name, column in {**columns, "y": y}.items():
        check_measured(f"column '{name}'", column)
    if len(y) <= len(names):
        raise InputError(
            f"{len(y)} samples cannot determine {len(names)} parameters", "use a longer window"
        )
    X = np.column_stack([*columns.values()])
    A = X.T @ X
    varies = [k for k, column in enumerate(X.T) if np.ptp(column)]
    estimates, inverse = solved(A, X.T @ y, names, varies, CONDITION_LIMIT)
    residual = y - X @ estimates
    freedom = len(y) - len(names)
    return LinearFit(
        names=names,
        estimates=estimates,
        covariance=inverse * (residual @ residual) / freedom,
        vaf=variance_accounted_for(y, residual),
        interval_method="white noise",
        degrees_of_freedom=np.full(len(names), float(freedom)),
    )


def solved(
    A: Array,
    b: Array,
    names: Sequence[str] = (),
    varies: Sequence[int] = (),
    limit: float = np.inf,
    noise: Array | float = 0.0,
) -> tuple[Array, Array]:
    """Solve normal equations A x = b, (p, p) and (p,), for the estimates (p,) and the inverse of A.

    Directions of A that hold rounding alone are left out. Columns that have names are refused where
    they can hardly be told apart.

    Parameters
    ----------
    A, b
        Products of the columns with one another, and with the explained signal.
    names
        Names of the estimates.
    varies
        Columns that are no offset. Beside an offset their condition number is that about their
        means, so that the zero of an angle does not matter.
    limit
        Largest condition number of the columns, each scaled to unit length.
    noise
        Noise of the columns that has been taken off A (p, p).

    Raises
    ------
    IdentifiabilityError
        The condition number is above the limit, or a column with a name is 0, or noise alone.
    """
    # below 0 where the noise of the angle, which is taken off, is more than its derivative
    if names and np.diag(A).min() <= 0:
        raise IdentifiabilityError(
            f"'{names[int(np.argmin(np.diag(A)))]}' cannot be estimated: its column is zero"
            " throughout, or no more than noise"
        )
    sizes = np.sqrt(np.maximum(np.diag(A), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(A / np.outer(sizes, sizes))
    parts = vectors / sizes[:, None]
    is_known = values > DIRECTION_ROUNDING * values[-1]
    weights = np.divide(1, values, out=np.zeros_like(values), where=is_known)
    inverse = parts * weights @ parts.T
    estimates = inverse @ b
    # one step of refinement takes off what rounding of the inverse has added
    estimates = estimates + inverse @ (b - A @ estimates)
    if names and scaled_condition(A, varies) > limit:
        worst = sorted(np.argsort(np.abs(vectors[:, 0]))[-2:])
        first, second = (names[k] for k in worst)
        condition_with_noise = scaled_condition(A + noise, varies)
        if condition_with_noise <= limit:
            raise IdentifiabilityError(
                f"{first} and {second} cannot be told apart behind noise of the angle, which is as"
                " large as what tells them apart",
                "move the joint by more or faster, and check the unit of theta in the source file",
            )
        raise IdentifiabilityError(
            f"{first} and {second} cannot be told apart in these data (scaled condition number"
            f" {condition_with_noise:.3g})",
            "excite more frequencies, lengthen the window or fix one of them",
        )
    return estimates, inverse


def scaled_condition(A: Array, varies: Sequence[int] = ()) -> float:
    """Condition number of columns, each scaled to unit length, by their products A (p, p).

    Beside an offset it is that of the other columns about their means.
    """
    tiny = np.finfo(float).tiny
    sizes = np.sqrt(np.maximum(np.diag(A), tiny))
    values, vectors = np.linalg.eigh(A / np.outer(sizes, sizes))
    if len(varies) > 1 and values[0] > DIRECTION_ROUNDING * values[-1]:
        parts = vectors / sizes[:, None]
        inverse = parts / values @ parts.T
        inverse_of_varying = np.linalg.inv(inverse[np.ix_(varies, varies)])
        lengths = np.sqrt(np.maximum(np.diag(inverse_of_varying), tiny))
        values = np.linalg.eigvalsh(inverse_of_varying / np.outer(lengths, lengths))
    return float(np.sqrt(values[-1] / max(values[0], DIRECTION_ROUNDING * values[-1])))


def between_cycles(sums: Array, stratum: NDArray[np.intp]) -> tuple[Array, Array]:
    """Find the covariance from the spread of repeated cycles.

    A bootstrap that draws cycles within each stratum converges to it, but for the factor m/(m - 1):
    the mean was estimated from the m cycles of the stratum, two or more.

    Parameters
    ----------
    sums : Array (m, p)
        Sums of scores of each cycle.
    stratum : Array (m,)
        Which cycles repeat one another; rising.

    Returns
    -------
    covariance : Array (p, p)
        From the spread about the mean of each stratum.
    degrees_of_freedom : Array (p,)
        Of its variances.
    """
    _, begins, number, members = np.unique(
        stratum, return_index=True, return_inverse=True, return_counts=True
    )
    mean = np.add.reduceat(sums, begins) / members[:, None]
    for_mean = np.sqrt(members / (members - 1))
    spread = (sums - mean[number]) * for_mean[number][:, None]
    variances = np.add.reduceat(spread**2, begins)
    return spread.T @ spread, welch_satterthwaite(variances, members - 1)


def products_between(X: Array, Y: Array, first: Array, stop: Array) -> Array:
    """Sum the products of columns over groups of rows that may begin and end between two rows.

    A fraction of a row is read from the cubic through the four cumulative sums around it, so that
    all cycles of a fractional period have equal sums. Beyond the ends there is nothing to sum.

    Parameters
    ----------
    X : Array (n, p)
        Columns.
    Y : Array (n, q)
        Further columns.
    first, stop : Array (m,)
        Rows at which the m groups begin and end.

    Returns
    -------
    Array (m, p, q)
        X'Y of each.
    """
    edges = np.stack([first, stop], axis=1).ravel()
    row = np.clip(np.floor(edges + ROW_ROUNDING).astype(np.intp), 0, len(Y))
    sums_of_whole_rows = np.array([X[a:b].T @ Y[a:b] for a, b in row.reshape(-1, 2)])

    share = np.maximum(edges - row, 0.0)
    x = np.where(share < ROW_ROUNDING, 0.0, share)
    around = row + np.array([[-1], [0], [1]])
    inside = np.clip(around, 0, len(Y) - 1)
    lagrange = np.array([x * (x - 1) * (x - 2), x * (x + 1) * (5 - 2 * x), x * (x + 1) * (x - 1)])
    weights = lagrange / 6 * (around == inside)
    weighted = weights[:, :, None] * X[inside]
    sums_to_edge = weighted.transpose(1, 2, 0) @ Y[inside].transpose(1, 0, 2)
    return sums_of_whole_rows + sums_to_edge[1::2] - sums_to_edge[::2]


def variance_accounted_for(y: Array, residual: Array) -> float:
    """VAF = 100 (1 - var(residual)/var(y)) [percent], of y and residual (n,); NaN without samples.

    Where y does not vary beyond rounding, VAF is 100 if the residual does not vary either, else 0.
    Raises InputError: a value is not finite or cannot be measured.
    """
    check_measured("y", y)
    check_finite("the residual", residual)
    if not len(y):
        return float("nan")
    return vaf_by_moments(float(np.var(residual)), float(np.var(y)), float(np.mean(y**2)))


def vaf_by_moments(unexplained: float, variance: float, mean_square: float) -> float:
    """`variance_accounted_for` [percent] by the variance of the residual, and the variance and the
    mean square of y."""
    rounding = EXACT_FIT_ROUNDING * mean_square
    if variance > rounding:
        return 100 * (1 - unexplained / variance)
    return 0.0 if unexplained > rounding else 100.0
