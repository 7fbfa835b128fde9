"""A regression whose rows come part by part and are never there all at once, as those of a recording of hours."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from osl_analysis.measured import ROUNDING, check_all_measured, check_measured
from osl_analysis.stats.covariance import between_cycles, correlation_samples, with_repeated
from osl_analysis.stats.cycle_sums import Cycles
from osl_analysis.stats.least_squares import check_lengths, from_gram, largest_correlation, refuse_unidentifiable
from osl_analysis.stats.regression import CONDITION_LIMIT, LinearFit, accounted_for, variance
from osl_analysis.trial import Array


class Part(Protocol):
    """Rows of a fit that follow one another and repeat cycles, made each time that they are asked for."""

    @property
    def cycles(self) -> Cycles | None:
        """Their cycles, of one stratum; None: too few for an interval."""
        ...

    def rows(self) -> tuple[Array, Array, Array]:
        """The columns X (n, p), y (n,), and what a filter took away from y (n,)."""
        ...


@dataclass(frozen=True)
class Sums:
    """What the rows (X, y) of a part add up to, and what those of each of its cycles do. Sums of parts add."""

    samples: int
    """Number n of rows."""
    mean: Array
    """Their mean (p + 1,)."""
    apart: Array
    """Sum of their products (p + 1, p + 1) about the mean."""
    of_cycles: Array
    """X'(X, y) (m, p, p + 1) in each cycle, with y before the filter."""

    @property
    def about_zero(self) -> Array:
        """(X, y)'(X, y) (p + 1, p + 1)."""
        return self.apart + self.samples * np.outer(self.mean, self.mean)

    def variance(self, weights: Array) -> float:
        """Mean square about the mean of (X, y) times weights (p + 1,)."""
        return max(float(weights @ self.apart @ weights), 0.0) / self.samples

    def vaf(self, left: float) -> float:
        """VAF [percent] of a fit that leaves a variance `left` of y."""
        of_y = np.append(np.zeros(len(self.mean) - 1), 1.0)
        return accounted_for(left, self.variance(of_y), ROUNDING * self.about_zero[-1, -1] / self.samples)

    def left(self, estimates: Array) -> Array:
        """X'(y - X estimates) (m, p) in each cycle, with y before the filter."""
        return self.of_cycles @ misfit(estimates)

    def __add__(self, other: "Sums") -> "Sums":
        n, step = self.samples + other.samples, other.mean - self.mean
        between = np.outer(step, step) * (self.samples * other.samples / n)
        of_cycles = np.concatenate([self.of_cycles, other.of_cycles])
        return Sums(n, self.mean + step * (other.samples / n), self.apart + other.apart + between, of_cycles)


def misfit(estimates: Array) -> Array:
    """Weights (p + 1,) of (X, y) in y - X estimates."""
    return np.append(-estimates, 1.0)


def sums_of(names: Sequence[str], part: Part) -> Sums:
    """What a part adds up to; raises as `linear_fit` where a value cannot be measured."""
    X, y, filtered_off = part.rows()
    check_all_measured([f"column '{name}'" for name in names], X.T)
    check_measured("column 'y'", y)
    rows = np.array([*X.T, y])
    mean = rows.mean(axis=1)
    rows -= mean[:, None]
    apart = rows @ rows.T
    rows[:-1], rows[-1] = X.T, y + filtered_off
    of_cycles = np.empty((0, *apart[1:].shape)) if part.cycles is None else part.cycles.products(X, rows.T)
    return Sums(len(y), mean, apart, of_cycles)


def partwise_fit(
    names: tuple[str, ...],
    parts: Sequence[tuple[Part, Sums]],
    every: int,
    repeated: Sequence[Callable[[Array], Array]] = (),
) -> LinearFit | None:
    """`linear_fit` to the rows of all parts, each with its sums, with the covariance between their cycles.

    `every` is that of `ResidualCorrelation`; `repeated` give the covariance (p, p) of a `RepeatedError` for the inverse
    (p, p) of the normal equations. None where the columns are so alike that the normal
    equations do not do: fit all rows at once then.

    Raises
    ------
    InputError, IdentifiabilityError
        As `linear_fit`.
    """
    total = added(own for _, own in parts)
    stratum = np.repeat(np.arange(len(parts)), [len(own.of_cycles) for _, own in parts])
    about_zero = total.about_zero
    gram, moment = about_zero[:-1, :-1], about_zero[:-1, -1]
    scale = check_lengths(names, np.sqrt(np.diag(gram)))
    found = from_gram(gram, scale, total.samples)
    if found is None:
        return None
    singular, Vt = found
    condition = float(singular[0] / max(singular[-1], np.finfo(float).tiny))
    if condition > CONDITION_LIMIT:
        refuse_unidentifiable(names, Vt[-1], condition)
    inverse = (Vt.T / singular**2) @ Vt / np.outer(scale, scale)
    estimates = inverse @ moment
    estimates = estimates + inverse @ (moment - gram @ estimates)
    residual = np.concatenate([y - X @ estimates for X, y, _ in (part.rows() for part, _ in parts)])
    spread = between_cycles(total.left(estimates) @ inverse, stratum)
    covariance, degrees_of_freedom, method = with_repeated(spread, [covariance(inverse) for covariance in repeated])
    return LinearFit(
        names,
        estimates,
        covariance,
        total.vaf(variance(residual)),
        1 - float(residual @ residual) / max(about_zero[-1, -1], np.finfo(float).tiny),
        condition,
        correlation_samples(residual, every),
        total.samples,
        method,
        degrees_of_freedom,
        residual,
        largest_correlation(inverse),
    )


def partwise_vaf(fit: LinearFit, parts: Iterable[Sums]) -> float:
    """VAF [percent] of a fit on parts, by their sums, that it did not use."""
    total = added(parts)
    return total.vaf(total.variance(misfit(fit.estimates)))


def added(parts: Iterable[Sums]) -> Sums:
    """The sum of one part or more."""
    every = iter(parts)
    total = next(every)
    for part in every:
        total = total + part
    return total
