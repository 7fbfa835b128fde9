"""One regression for every motion on the bench, from sums over groups of rows.

One pass over the samples sums the products of all columns, of the model and of every effect, in
each group. All else is small algebra on these sums: the fit to a label or to all, its interval, how
well it predicts what it has not seen, and each effect (effects.py).

* A *group* is a few consecutive rows, such as the third cycle of 2 Hz at 5 deg.
* A *stratum* is a set of groups that repeat one another: all cycles of 2 Hz at 5 deg.
* A *label* is what has a fit of its own: 5 deg. None stands for the whole recording.
* A *unit* is what is left out at a time to see the scatter: a stratum, or a group where strata are
  few.

The interval covers the estimate from this motion on this joint (docs/method.md). For each estimate
the variance is the larger of noise and misfit, with the degrees of freedom of the larger.

* *Noise* is what another recording of the same motion would change.
* *Misfit* is the scatter when one unit is left out at a time (jackknife). It holds the noise, too,
  and what the model misses from unit to unit. Amplitudes and frequencies are chosen, not drawn: it
  need not hold the estimate at others.

| groups | noise | misfit |
|---|---|---|
| repeat one another | spread of the repeats | strata, or groups where these are few |
| 8 or more that do not | neighbouring groups, beside the richest model | the same |
| fewer | the residual, as if its noise were white | strata, if there are 4 or more |

The *score* of a group is by how much it moves the estimates: the products of its residual with the
columns, times the inverse of the normal equations.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.record import Groups, Label, Record
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.measured import check_measured
from osl_analysis.stats import linear_fit as rules
from osl_analysis.stats.covariance import between_cycles, products_between
from osl_analysis.stats.linear_fit import CONDITION_LIMIT, LinearFit
from osl_analysis.trial import Array

SMALLEST_DIRECTION = 1e-13  # eigenvalue over the largest one, below which it is rounding
# of the largest one: rounding can make the smallest 0 or negative; its condition number is then
# 1e15, above every limit
LEAST_EIGENVALUE = 1e-30
# largest scaled condition number with effects, whose columns may be nearly collinear
EFFECTS_LIMIT = 1e5
FEWEST_UNITS = 4  # with fewer strata the groups are left out instead
FEWEST_GROUPS = 8  # fewest groups without repeats whose scores give an interval
LEAST_VARIANCE = 1e-300  # so that estimates without scatter are not divided by 0
NEIGHBOURS_WEIGHT = 0.5  # of products of neighbouring scores
BY_UNITS = "units"
BY_REPEATS = "repeats"
BY_NOISE = "white noise"

Keep = NDArray[np.bool_] | Label
"""The groups to keep (m,), those of a label, or all (None)."""


@dataclass(frozen=True)
class Sums:
    """Products of q columns, of the filtered and of the raw torque, in each of m groups.

    Attributes
    ----------
    names : tuple of str
        Names of the columns; `one` is among them.
    gram : Array (m, q + 2, q + 2)
        The products.
    groups : Groups
        Rows, labels and strata of the groups.
    rich : tuple of str
        Columns of the richest model, whose residual is noise if nothing repeats.
    centre : float
        Angle [rad] at which the column `theta` is 0: verdicts do not depend on the encoder's zero.
    columns : Mapping of Array (n,)
        The columns themselves.
    independent : float
        Rows after which filtered noise is independent.
    """

    names: tuple[str, ...]
    gram: Array
    groups: Groups
    rich: tuple[str, ...]
    centre: float
    columns: Mapping[str, Array]
    independent: float = 1.0

    def index(self, names: Sequence[str]) -> list[int]:
        return [self.names.index(name) for name in names]

    @cached_property
    def total(self) -> Array:
        """The sums of all groups."""
        return np.asarray(self.gram.sum(axis=0))

    @property
    def torque(self) -> int:
        """Where the filtered torque stands in the sums."""
        return len(self.names)

    def over(self, keep: Keep) -> Array:
        """The sums of some groups."""
        if keep is None:
            return self.total
        chosen = keep if isinstance(keep, np.ndarray) else self.groups.of(keep)
        return np.asarray(self.gram[chosen].sum(axis=0))


def gram_sums(
    record: Record,
    columns: Mapping[str, Array],
    rich: Sequence[str],
    centre: float = 0.0,
) -> Sums:
    """Sum the products of columns (n,) and of the record's torque, in each group.

    The noise is read from the raw torque, before the filter.

    Raises
    ------
    InputError
        A column cannot be measured.
    """
    names = [*(f"column '{name}'" for name in columns), "column 'y'", "the torque"]
    rows = np.array([*columns.values(), record.filtered_torque, record.torque])
    for name, row in zip(names, rows, strict=True):
        check_measured(name, row)
    groups = record.groups
    return Sums(
        names=tuple(columns),
        gram=products_between(rows.T, rows.T, groups.first, groups.stop),
        groups=groups,
        rich=tuple(rich),
        centre=centre,
        columns=columns,
        independent=max(record.rate_hz / (2 * record.low_pass.noise_bandwidth_hz), 1.0),
    )


def solved(A: Array, b: Array) -> tuple[Array, Array]:
    """Solve normal equations A x = b, (..., p, p) and (..., p).

    Directions of A that rounding alone fills are left out.

    Returns
    -------
    estimates : Array (..., p)
    inverse : Array (..., p, p)
    """
    scale = np.sqrt(np.maximum(np.diagonal(A, axis1=-2, axis2=-1), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(A / (scale[..., :, None] * scale[..., None, :]))
    parts = vectors / scale[..., :, None]
    is_known = values > SMALLEST_DIRECTION * values[..., -1:]
    weights = np.divide(1, values, out=np.zeros_like(values), where=is_known)
    inverse = parts * weights[..., None, :] @ np.swapaxes(parts, -1, -2)
    column = b[..., None]
    estimates = inverse @ column
    # one step of refinement takes off what rounding of the inverse has added
    estimates = estimates + inverse @ (column - A @ estimates)
    return estimates[..., 0], inverse


def estimates_of(total: Array, at: Sequence[int], q: int) -> Array:
    """Estimates (p,) of the columns `at` for the torque, column q, alone."""
    return solved(total[np.ix_(at, at)], total[at, q])[0]


@dataclass(frozen=True)
class Identified:
    """What the normal equations of a model of p columns tell.

    Attributes
    ----------
    estimates : Array (p,)
    inverse : Array (p, p)
        Of the normal equations.
    about_means : Array (r, r)
        The part of the inverse for columns about their means, without the offset.
    condition : float
        Scaled condition number.
    """

    estimates: Array
    inverse: Array
    about_means: Array
    condition: float


def identified(model: Mapping[str, str], A: Array, b: Array, limit: float) -> Identified:
    """Solve the normal equations of a model, A (p, p) and b (p,).

    Raises
    ------
    IdentifiabilityError
        The condition number is above the limit, or a column is 0.
    """
    estimates, inverse = solved(A, b)
    varies = [k for k, column in enumerate(model.values()) if column != "one"]
    about_means = inverse[np.ix_(varies, varies)]
    scale = np.sqrt(rules.check_not_zero(tuple(model), np.diag(A)))
    values, vectors = np.linalg.eigh(A / np.outer(scale, scale))
    condition = float(np.sqrt(values[-1] / max(values[0], LEAST_EIGENVALUE * values[-1])))
    if len(about_means) > 1 and condition < rules.ROUNDED:
        condition = rules.scaled_condition(about_means)
    if condition > limit:
        rules.refuse_unidentifiable(tuple(model), vectors[:, 0], condition)
    return Identified(estimates, inverse, about_means, condition)


@dataclass(frozen=True)
class GroupFit(LinearFit):
    """A fit whose interval covers the estimate from this motion (docs/method.md).

    Attributes
    ----------
    repeat : Array (p, p) or None
        Covariance of the repeatability; None where nothing repeats.
    bench_variance : Array (p,) or float
        Part of the variances that all trials on a bench share.
    """

    repeat: Array | None = None
    bench_variance: Array | float = 0.0

    def se_bench(self, name: str) -> float:
        """Part of the standard error that all trials on a bench share: its calibration and
        stiffness."""
        variances = np.broadcast_to(self.bench_variance, len(self.names))
        return float(np.sqrt(variances[self.names.index(name)]))

    def derived(
        self,
        names: tuple[str, ...],
        estimates: Array,
        gradients: Sequence[Mapping[str, float]],
        freedom_of: Sequence[str],
    ) -> "GroupFit":
        """Functions of the estimates, to first order.

        Parameters
        ----------
        names, estimates
            Of k functions.
        gradients
            Derivatives of each by the estimates that it is of.
        freedom_of
            The estimate whose degrees of freedom each has.
        """
        J = np.array([[each.get(name, 0.0) for name in self.names] for each in gradients])
        return replace(
            self,
            names=names,
            estimates=estimates,
            covariance=J @ self.covariance @ J.T,
            degrees_of_freedom=np.array([self.freedom(name) for name in freedom_of]),
            repeat=None,
            bench_variance=0.0,
        )

    def freedom(self, name: str) -> float:
        return float(self.degrees_of_freedom[self.names.index(name)])

    def certain(self, name: str, once_in: float) -> bool:
        """Whether an estimate differs from 0 by a two-sided test at the level `once_in`."""
        quantile = float(scipy.special.stdtrit(self.freedom(name), 1 - once_in / 2))
        return abs(self[name]) > quantile * self.se(name)


def fit_groups(
    s: Sums,
    model: Mapping[str, str],
    keep: Keep = None,
    limit: float = CONDITION_LIMIT,
) -> GroupFit:
    """Fit the torque by least squares (Eq. 15), with an interval that covers this motion.

    Parameters
    ----------
    s
        Sums of the recording.
    model
        Column of each of p estimates, by the estimate's name, as `K: theta`.
    keep
        A label, or which groups (m,) to fit; None: all.
    limit
        Largest scaled condition number.

    Raises
    ------
    IdentifiabilityError
        A column is 0 throughout, or the condition number is above the limit.
    InputError
        There are not more samples than estimates.
    """
    columns = list(model.values())
    p = len(columns)
    groups = np.flatnonzero(keep if isinstance(keep, np.ndarray) else s.groups.of(keep))
    used = np.array([*s.index(columns), s.torque, s.torque + 1])
    offset = columns.index("one")
    products = s.gram[:, used[:, None], used][groups]
    centring = np.eye(p + 2)
    if "ramp" in columns:  # drift and offset are then orthogonal
        of_ones = products[:, offset].sum(axis=0)
        ramp = columns.index("ramp")
        centring[offset, ramp] = -of_ones[ramp] / of_ones[offset]
        products = centring.T @ products @ centring
    total = products.sum(axis=0)
    solution = identified(model, total[:p, :p], total[:p, p], limit)
    n = float(total[offset, offset])
    if n <= p:
        raise InputError(f"{n:.0f} samples cannot determine {p} parameters; record for longer")

    interval = interval_of(s, groups, used, centring, products, solution)
    torque, residual = np.zeros(p + 1), np.append(-solution.estimates, 1.0)
    torque[p] = 1.0
    sums = total[: p + 1, : p + 1]
    return GroupFit(
        names=tuple(model),
        estimates=solution.estimates,
        covariance=interval.covariance,
        vaf=accounted_for(sums, offset, residual, torque),
        condition_number=solution.condition,
        correlation_samples=max(round(float(np.median(s.groups.stop - s.groups.first))), 1),
        samples=round(n),
        interval_method=interval.method,
        degrees_of_freedom=interval.degrees_of_freedom,
        residual=np.empty(0),  # the sums have no rows
        largest_correlation=rules.largest_correlation(solution.about_means),
        repeat=interval.of_repeats,
    )


@dataclass(frozen=True)
class Interval:
    """The interval of p estimates.

    Attributes
    ----------
    covariance : Array (p, p)
    degrees_of_freedom : Array (p,)
    of_repeats : Array (p, p) or None
        Covariance by repeats of the same motion alone; None where nothing repeats.
    method : str
        What told it, as tables name it.
    """

    covariance: Array
    degrees_of_freedom: Array
    of_repeats: Array | None
    method: str


def interval_of(
    s: Sums,
    groups: NDArray[np.intp],
    used: NDArray[np.intp],
    centring: Array,
    products: Array,
    solution: Identified,
) -> Interval:
    """Compute the interval of the solution of normal equations.

    Parameters
    ----------
    s : Sums
        Sums of the recording.
    groups : Array (m,)
        Numbers of the fitted groups among those of the sums.
    used : Array (p + 2,)
        Where the columns, the filtered and the raw torque stand in the sums.
    centring : Array (p + 2, p + 2)
        What centres the column `ramp`.
    products : Array (m, p + 2, p + 2)
        Sums of these, in each group.
    solution : Identified
    """
    p = len(used) - 2
    left, right = products[:, :p, :p], products[:, :p, p]
    A, b = left.sum(axis=0), right.sum(axis=0)
    inverse = solution.inverse
    m = len(groups)
    stratum = np.unique(s.groups.stratum[groups], return_inverse=True)[1]
    has_strata = int(stratum.max()) + 1 >= FEWEST_UNITS
    unit = stratum if has_strata else np.arange(m)
    has_repeats = s.groups.repeat and int(np.bincount(stratum).min()) > 1
    method = BY_UNITS
    tells_misfit = True
    if has_repeats:
        # before the filter noise is independent from row to row
        scores = (products[:, :p, p + 1] - left @ solution.estimates) @ inverse
        noise, freedom = between_cycles(scores, stratum)
        if not has_strata:
            method = BY_REPEATS
    elif m >= FEWEST_GROUPS:
        rich = [*s.rich, *(s.names[k] for k in used[:p] if s.names[k] not in s.rich)]
        at = np.array(s.index(rich))
        across = s.gram[np.ix_(groups, at, used)] @ centring
        kept = s.gram[np.ix_(groups, at, at)].sum(axis=0)
        of_rich = solved(kept, across[:, :, p].sum(axis=0))[0]
        modelled = np.einsum("mrp,r->mp", across[:, :, :p], of_rich)
        # of the filtered torque, since else the part of the signal that the filter removes would
        # count as noise
        target = products[:, :p, p + 1] if s.groups.repeat else right
        noise, freedom = noise_of_scores((target - modelled) @ inverse, len(rich))
    else:
        # too few scores: noise that is white before the filter is independent every few rows
        columns = [s.names[k] for k in used[:p]]
        offset = columns.index("one")
        n = float(A[offset, offset])
        square = products[:, p, p].sum() - 2 * solution.estimates @ b
        square = max(float(square + solution.estimates @ A @ solution.estimates), 0.0)
        of_noise = max(n / s.independent - p, 1.0)
        noise, freedom = inverse * square / of_noise, np.full(p, of_noise)
        tells_misfit = has_strata
        if not has_strata:
            method = BY_NOISE
    misfit = jackknife(left, right, A, b, unit) if tells_misfit else np.zeros_like(inverse)
    covariance, freedom = combined(noise, freedom, misfit, int(unit.max()) + 1)
    return Interval(covariance, freedom, noise if has_repeats else None, method)


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


HeldOut = list[tuple[NDArray[np.bool_], list[NDArray[np.bool_]]]]
"""Groups (m,) that are fitted, and the parts that this fit predicts."""


def accounted_for(sums: Array, one: int, residual: Array, torque: Array) -> float:
    """VAF [percent] by sums of products (q, q), of which the one with the ones is at `one`. Weights
    (q,) make the residual and the torque of the columns. As `variance_accounted_for` if the torque
    is constant."""
    n = float(sums[one, one])
    square, left = (
        float(weights @ sums @ weights) / n - (float(sums[one] @ weights) / n) ** 2
        for weights in (torque, residual)
    )
    mean_square = max(float(torque @ sums @ torque) / n, 0.0)
    return float(rules.vaf_by_moments(max(left, 0.0), square, mean_square))


def held_out_vaf(s: Sums, model: Mapping[str, str], parts: HeldOut) -> float | None:
    """Lowest VAF [percent] of groups that a fit did not use, each part with its own offset.

    Parameters
    ----------
    s : Sums
        Sums of the recording.
    model : Mapping
        Column of each estimate.
    parts : HeldOut
        `every_third`, or `other_amplitudes` of a label.

    Returns
    -------
    float or None
        None without such groups, or where a fit to the others tells nothing.
    """
    columns = s.index(list(model.values()))
    one = s.names.index("one")
    torque, residual = np.zeros(len(s.names) + 2), np.zeros(len(s.names) + 2)
    torque[s.torque] = residual[s.torque] = 1.0
    vafs = []
    for fitted, held_out in parts:
        total = s.over(fitted)
        if total[one, one] <= len(model):
            return None
        A, b = total[np.ix_(columns, columns)], total[columns, s.torque]
        try:
            residual[columns] = -identified(model, A, b, CONDITION_LIMIT).estimates
        except IdentifiabilityError:
            return None
        vafs += [accounted_for(s.over(part), one, residual, torque) for part in held_out]
    return min(vafs, default=None)


def every_third(groups: Groups) -> HeldOut:
    """Two of three groups in their order in time, such as cycles, and the third."""
    place = np.argsort(np.argsort(groups.first, kind="stable"), kind="stable") % 3
    return [(place != k, [place == k]) for k in np.unique(place)]


def other_amplitudes(groups: Groups, label: Label) -> HeldOut:
    """Of a label: itself, and each other label. Of all: the other labels, and each label; with one
    label, two of three groups and the third."""
    labels = groups.labels
    if label is not None:
        return [(groups.of(label), [groups.of(other) for other in labels if other != label])]
    if len(labels) > 1:
        return [(~groups.of(each), [groups.of(each)]) for each in labels]
    return every_third(groups)
