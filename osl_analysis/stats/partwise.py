"""A regression whose rows come part by part and are never there all at once, as those of a recording of hours."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from osl_analysis.measured import ROUNDING, check_all_measured, check_measured
from osl_analysis.stats.covariance import RepeatedError, between_cycles, correlation_samples, with_repeated
from osl_analysis.stats.cycle_sums import Cycles
from osl_analysis.stats.least_squares import check_lengths, from_gram, largest_correlation, refuse_unidentifiable
from osl_analysis.stats.regression import CONDITION_LIMIT, LinearFit, accounted_for
from osl_analysis.trial import Array


class Part(Protocol):
    """Rows of a fit that follow one another and repeat cycles, made each time that they are asked for."""

    @property
    def cycles(self) -> Cycles:
        """Their cycles, of one stratum."""
        ...

    def rows(self) -> tuple[Array, Array, Array]:
        """The columns X (n, p), y (n,), and what a filter took away from y (n,)."""
        ...


@dataclass(frozen=True)
class Sums:
    """What a part adds to the normal equations. Sums of parts add."""

    samples: int
    """Number n of rows."""
    gram: Array
    """X'X (p, p)."""
    moment: Array
    """X'y (p,)."""

    def __add__(self, other: "Sums") -> "Sums":
        return Sums(self.samples + other.samples, self.gram + other.gram, self.moment + other.moment)


@dataclass(frozen=True)
class Spread:
    """Mean and sums of squares of a signal that comes part by part. Those of parts add."""

    samples: int
    mean: float
    apart: float
    """Sum of squares about the mean."""
    squares: float
    """Sum of squares about 0."""

    @property
    def variance(self) -> float:
        """Mean square about the mean."""
        return self.apart / self.samples

    @property
    def rounding(self) -> float:
        """Mean square of what rounding alone leaves of an exact fit (`rounding_of`)."""
        return ROUNDING * self.squares / self.samples

    def __add__(self, other: "Spread") -> "Spread":
        n, step = self.samples + other.samples, other.mean - self.mean
        mean = self.mean + step * other.samples / n
        between = step**2 * self.samples * other.samples / n
        return Spread(n, mean, self.apart + other.apart + between, self.squares + other.squares)


Summand = TypeVar("Summand", Sums, Spread)


def spread_of(values: Array) -> Spread:
    """The spread of a signal (n,)."""
    mean = float(values.mean())
    apart = values - mean
    return Spread(len(values), mean, float(apart @ apart), float(values @ values))


def sums_of(names: Sequence[str], part: Part) -> Sums:
    """What a part adds; raises as `linear_fit` where a value cannot be measured."""
    X, y, _ = part.rows()
    check_all_measured([f"column '{name}'" for name in names], X.T)
    check_measured("column 'y'", y)
    return Sums(len(y), X.T @ X, X.T @ y)


def partwise_fit(
    names: tuple[str, ...],
    parts: Sequence[tuple[Part, Sums]],
    every: int,
    repeated: Sequence[RepeatedError] = (),
) -> LinearFit | None:
    """`linear_fit` to the rows of all parts, each with its sums, with the covariance between their cycles.

    `every` and `repeated` are those of `ResidualCorrelation`. None where the columns are so alike that the normal
    equations do not do: fit all rows at once then.

    Raises
    ------
    InputError, IdentifiabilityError
        As `linear_fit`.
    """
    total = added(own for _, own in parts)
    scale = check_lengths(names, np.sqrt(np.diag(total.gram)))
    found = from_gram(total.gram, scale, total.samples)
    if found is None:
        return None
    singular, Vt = found
    condition = float(singular[0] / max(singular[-1], np.finfo(float).tiny))
    if condition > CONDITION_LIMIT:
        refuse_unidentifiable(names, Vt[-1], condition)
    inverse = (Vt.T / singular**2) @ Vt / np.outer(scale, scale)
    estimates = inverse @ total.moment
    estimates = estimates + inverse @ np.sum([moment_left(part, estimates) for part, _ in parts], axis=0)
    residual, sums, varied, left, used = np.empty(total.samples), [], [], [], 0
    for part, own in parts:
        X, y, filtered_off = part.rows()
        rest = y - X @ estimates
        residual[used : used + own.samples] = rest
        varied.append(spread_of(y))
        left.append(spread_of(rest))
        rest += filtered_off
        sums.append(part.cycles.sums(X, rest) @ inverse)
        used += own.samples
    stratum = np.repeat(np.arange(len(parts)), [len(one) for one in sums])
    spread = between_cycles(np.concatenate(sums), stratum)
    covariance, degrees_of_freedom, method = with_repeated(*spread, [e.covariance(X, inverse) for e in repeated])
    of_y, of_residual = added(varied), added(left)
    return LinearFit(
        names,
        estimates,
        covariance,
        accounted_for(of_residual.variance, of_y.variance, of_y.rounding),
        1 - of_residual.squares / max(of_y.squares, np.finfo(float).tiny),
        condition,
        correlation_samples(residual, every),
        total.samples,
        method,
        degrees_of_freedom,
        residual,
        largest_correlation(inverse),
    )


def moment_left(part: Part, estimates: Array) -> Array:
    """X'(y - X estimates) (p,) of a part: a step of refinement takes it off the estimates (p,)."""
    X, y, _ = part.rows()
    return np.asarray(X.T @ (y - X @ estimates))


def partwise_vaf(fit: LinearFit, parts: Iterable[Part]) -> float:
    """VAF [percent] of a fit on parts that it did not use."""
    rows = ((y, y - X @ fit.estimates) for X, y, _ in (part.rows() for part in parts))
    both = [(spread_of(y), spread_of(residual)) for y, residual in rows]
    of_y, of_residual = added([one for one, _ in both]), added([other for _, other in both])
    return accounted_for(of_residual.variance, of_y.variance, of_y.rounding)


def added(parts: Iterable[Summand]) -> Summand:
    """The sum of one part or more."""
    every = iter(parts)
    total = next(every)
    for part in every:
        total = total + part
    return total
