"""The interval of a fit to groups: noise and misfit.

For each estimate the variance is the larger of noise and misfit, with the degrees of freedom of the
larger. The interval covers the estimate from this motion on this joint (docs/method.md).

* *Noise* is what another recording of the same motion would change.
* *Misfit* is the scatter when one unit is left out at a time (jackknife). It holds the noise, too,
  and what the model misses from unit to unit. Amplitudes and frequencies are chosen, not drawn: it
  need not hold the estimate at others.
* Rounding by the sensors is part of the noise, with a variance of q^2/12 for steps of q.

What tells noise and misfit depends on the groups:

| groups | noise | misfit |
|---|---|---|
| repeat one another | spread of the repeats | strata, or groups where these are few |
| 8 or more that do not | neighbouring groups, beside the richest model | the same |
| fewer | the residual, as if its noise were white | strata, if there are 4 or more |

The *score* of a group is by how much it moves the estimates: the products of its residual with the
columns, times the inverse of the normal equations.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.group_sums import SMALLEST_DIRECTION, NormalEquations, Sums, solved
from osl_analysis.bench.row_groups import Groups, Label
from osl_analysis.stats.covariance import between_cycles
from osl_analysis.trial import Array

FEWEST_UNITS = 4  # with fewer strata the groups are left out instead
FEWEST_GROUPS = 8  # fewest groups without repeats whose scores give an interval
LEAST_VARIANCE = 1e-300  # so that estimates without scatter are not divided by 0
NEIGHBOURS_WEIGHT = 0.5  # of products of neighbouring scores
BY_UNITS = "units"
BY_REPEATS = "repeats"
BY_NOISE = "white noise"


class NoiseSource(Enum):
    """What tells the noise of a fit."""

    REPEATS = auto()  # groups that repeat one another
    NEIGHBOURS = auto()  # groups that do not, beside the richest model
    WHITE = auto()  # the residual, as if its noise were white before the low-pass filter


@dataclass(frozen=True)
class ScatterSource:
    """What tells noise and misfit of a fit to m groups.

    Attributes
    ----------
    noise : NoiseSource
        What tells the noise.
    unit : Array (m,)
        Which unit each group is of.
    tells_misfit : bool
        Whether leaving out units tells the misfit.
    interval_method : str
        The name of it in tables.
    """

    noise: NoiseSource
    unit: NDArray[np.intp]
    tells_misfit: bool
    interval_method: str

    @property
    def units(self) -> int:
        """Number of units."""
        return int(self.unit.max()) + 1


def scatter_source(groups: Groups, stratum: NDArray[np.intp]) -> ScatterSource:
    """Choose what tells noise and misfit of groups whose strata (m,) are numbered without gaps."""
    has_strata = int(stratum.max()) + 1 >= FEWEST_UNITS
    unit = stratum if has_strata else np.arange(len(stratum))
    if groups.repeat and int(np.bincount(stratum).min()) > 1:
        method = BY_UNITS if has_strata else BY_REPEATS
        return ScatterSource(NoiseSource.REPEATS, unit, True, method)
    if len(stratum) >= FEWEST_GROUPS:
        return ScatterSource(NoiseSource.NEIGHBOURS, unit, True, BY_UNITS)
    method = BY_UNITS if has_strata else BY_NOISE
    return ScatterSource(NoiseSource.WHITE, unit, has_strata, method)


@dataclass(frozen=True)
class Interval:
    """The interval of p estimates.

    Attributes
    ----------
    covariance : Array (p, p)
    degrees_of_freedom : Array (p,)
    of_repeats : Array (p, p) or None
        Covariance by repeats of the same motion alone; None where nothing repeats.
    source : ScatterSource
        What told it.
    """

    covariance: Array
    degrees_of_freedom: Array
    of_repeats: Array | None
    source: ScatterSource


def interval_of(
    s: Sums,
    equations: NormalEquations,
    estimates: Array,
    inverse: Array,
    rich: Sequence[str],
    keep: NDArray[np.bool_] | Label,
) -> Interval:
    """Compute the interval of the solution of normal equations.

    Parameters
    ----------
    s : Sums
        Sums of the recording.
    equations : NormalEquations
        Those of the model, of p columns in m groups.
    estimates : Array (p,)
        Their solution.
    inverse : Array (p, p)
        Of their left side.
    rich : sequence of str
        Columns of the richest model, whose residual is noise if nothing repeats.
    keep : Array (m,) or label
        The groups that are fitted.
    """
    source = scatter_source(s.groups, equations.stratum)
    noise, freedom = noise_covariance(s, equations, source, estimates, inverse, rich, keep)
    misfit = np.zeros_like(inverse)
    if source.tells_misfit:
        misfit = jackknife(
            equations.left_sides,
            equations.right_sides,
            equations.left_side,
            equations.right_side,
            source.unit,
        )
    covariance, freedom = combined(noise, freedom, misfit, source.units)
    of_repeats = noise if source.noise is NoiseSource.REPEATS else None
    return Interval(covariance, freedom, of_repeats, source)


def noise_covariance(
    s: Sums,
    equations: NormalEquations,
    source: ScatterSource,
    estimates: Array,
    inverse: Array,
    rich: Sequence[str],
    keep: NDArray[np.bool_] | Label,
) -> tuple[Array, Array]:
    """Covariance (p, p) of the estimates by noise, and its degrees of freedom (p,). The arguments
    are those of `interval_of`."""
    if source.noise is NoiseSource.REPEATS:
        scores = (equations.for_scores - equations.left_sides @ estimates) @ inverse
        return between_cycles(scores, equations.stratum)
    if source.noise is NoiseSource.NEIGHBOURS:
        scores = scores_beside_richest(s, equations, rich, keep, inverse)
        return noise_of_scores(scores, len(rich))
    # too few scores. Noise that is white before the filter is independent every few rows behind it
    independent_rows = equations.samples / s.independent
    freedom = max(independent_rows - len(estimates), 1.0)
    covariance = inverse * equations.residual_square(estimates) / freedom
    return covariance, np.full(len(estimates), freedom)


def scores_beside_richest(
    s: Sums,
    equations: NormalEquations,
    rich: Sequence[str],
    keep: NDArray[np.bool_] | Label,
    inverse: Array,
) -> Array:
    """What each group (m, p) adds to the estimates by what the richest model leaves of its
    torque."""
    at = np.array(s.index(rich))
    across = s.gram[np.ix_(equations.groups, at, equations.used)] @ equations.centring
    of_rich = solved(s.over(keep)[np.ix_(at, at)], across[:, :, -2].sum(axis=0))[0]
    modelled = np.einsum("mrp,r->mp", across[:, :, :-2], of_rich)
    return np.asarray((equations.for_scores - modelled) @ inverse)


def jackknife(A_g: Array, b_g: Array, A: Array, b: Array, unit: NDArray[np.intp]) -> Array:
    """Covariance of the estimates by leaving out one unit at a time: noise, misfit and leverage.

    Parameters
    ----------
    A_g, b_g : Array (m, p, p), (m, p)
        Normal equations of each group.
    A, b : Array (p, p), (p,)
        Their sums.
    unit : Array (m,)
        Number of the unit of each group.

    Returns
    -------
    Array (p, p)

    References
    ----------
    Miller, Biometrika 61, 1974.
    """
    units = int(unit.max()) + 1
    p = len(b)
    belongs = np.asarray(unit == np.arange(units)[:, None], dtype=np.float64)
    of_units = (belongs @ A_g.reshape(len(unit), -1)).reshape(units, p, p)
    right_sides = belongs @ b_g
    A_without = A - of_units
    b_without = b - right_sides
    scale = np.sqrt(np.diag(A))
    scaled = A_without / np.outer(scale, scale) + SMALLEST_DIRECTION * np.eye(p)
    estimates = np.linalg.solve(scaled, (b_without / scale)[..., None])[..., 0] / scale
    scatter = estimates - estimates.mean(axis=0)
    return np.asarray(scatter.T @ scatter * (units - 1) / units)


def combined(
    noise: Array,
    freedom: Array,
    misfit: Array,
    units: int,
) -> tuple[Array, Array]:
    """Combine what noise and misfit do to p estimates: the larger of both.

    Correlations are those of the sum of noise and misfit.

    Parameters
    ----------
    noise : Array (p, p)
        Covariance by noise, with `freedom` (p,) degrees of freedom.
    misfit : Array (p, p)
        Covariance by the scatter of `units`.

    Returns
    -------
    covariance : Array (p, p)
    freedom : Array (p,)
        Degrees of freedom of the larger, at least 1.
    """
    of_noise = np.maximum(np.diag(noise), 0.0)
    of_misfit = np.diag(misfit)
    error = np.sqrt(np.maximum(of_noise, of_misfit))
    both = noise + misfit
    size = np.sqrt(np.maximum(np.diag(both), np.finfo(float).tiny))
    correlation = both / np.outer(size, size)
    covariance = correlation * np.outer(error, error)
    # The misfit holds the noise: the larger of both is one source, with the freedom of its own.
    degrees = np.where(of_misfit > of_noise, units - 1.0, freedom)
    return covariance, np.maximum(degrees, 1.0)


def noise_of_scores(scores: Array, columns: int) -> tuple[Array, Array]:
    """Covariance (p, p) of estimates and its degrees of freedom (p,), from the scores (m, p) of
    consecutive groups that do not repeat one another.

    Neighbours are correlated: half of their products count (Newey and West, Econometrica 55, 1987,
    with one lag). That makes a variance of m scores as uncertain as one of m/1.5 independent ones.
    Each column of the fit has used up half a group.
    """
    m, p = scores.shape
    used = min(columns, m - 2)
    neighbours = scores[1:].T @ scores[:-1]
    covariance = scores.T @ scores + NEIGHBOURS_WEIGHT * (neighbours + neighbours.T)
    size = np.sqrt(np.maximum(np.diag(covariance), LEAST_VARIANCE))
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    raised = m / max(m - used / 2, 1.0)
    positive = (vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(size, size) * raised
    freedom = max(m / (1 + 2 * NEIGHBOURS_WEIGHT**2) - used / 2, 1.0)
    return np.asarray(positive), np.full(p, freedom)
