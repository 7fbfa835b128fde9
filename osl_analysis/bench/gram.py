"""One regression for every motion, from the Gram matrices of groups of rows.

One pass over the samples sums the products of all columns, of the model and of every effect, in
each group. All else is small algebra on these sums: the fit to a label or to all, its interval, the
VAF of held-out data, and each effect (effects.py).

A group is a few rows, such as the third cycle of 2 Hz at 5 deg. A stratum is a set of groups that
repeat one another: all cycles of 2 Hz at 5 deg. A label is what has a fit of its own: 5 deg. A unit
is what is left out at a time to see the scatter: a stratum, or a group where strata are few.

The interval of a fit covers the estimate from another motion of this kind on this joint
(docs/method.md). It comes from leaving out one unit at a time: a stratum (a frequency at an
amplitude, a part of the period), or a stretch. Their scatter contains the model's misfit, and
rounding that every cycle repeats. The repeatability is the spread of groups that repeat one
another, alone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.record import Record
from osl_analysis.bench.row_groups import Groups, Label
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.measured import check_measured, rounding_of
from osl_analysis.stats import regression
from osl_analysis.stats.regression import (
    CONDITION_LIMIT,
    LinearFit,
    between_cycles,
    less,
    products_between,
    welch_satterthwaite,
)
from osl_analysis.trial import Array

FEWEST_UNITS = 4  # with fewer strata the groups are left out instead
FEWEST_GROUPS = 8  # fewest groups without repeats whose scores give an interval
NEIGHBOURS_WEIGHT = 0.5  # of products of neighbouring scores
NEXT = {"theta": "omega", "omega": "alpha", "alpha": "jerk"}  # derivative of each column
SMALLEST_DIRECTION = 1e-13  # eigenvalue over the largest one, below which it is rounding
# largest scaled condition number with effects, whose columns may be nearly collinear
EFFECTS_LIMIT = 1e5
BY_UNITS, BY_REPEATS, BY_NOISE = "units", "repeats", "white noise"
"""Source of an interval: leave-one-out units, with the noise; or repeats, if there are too few
units."""


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
    rate_hz : float
        Sampling rate [Hz].
    seconds : float
        Time from the first to the last row that is fitted [s].
    centre : float
        Angle [rad] at which the column `theta` is 0: verdicts do not depend on the encoder's zero.
    columns : Mapping of Array (n,)
        The columns themselves.
    independent : float
        Rows after which filtered noise is independent.
    rounded : Array (m, q, k) or None
        Products of the columns with the torques of `Record.rounded`.
    no_estimates : frozenset of str
        Nearly collinear columns whose estimates nobody uses.
    """

    names: tuple[str, ...]
    gram: Array
    groups: Groups
    rich: tuple[str, ...]
    rate_hz: float
    seconds: float
    centre: float
    columns: Mapping[str, Array]
    independent: float = 1.0
    rounded: Array | None = None
    no_estimates: frozenset[str] = frozenset()

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

    def over(self, keep: "Label | NDArray[np.bool_]") -> Array:
        """The sums of the groups of a label, or of those to `keep` (m,)."""
        if keep is None:
            return self.total
        chosen = keep if isinstance(keep, np.ndarray) else self.groups.of(keep)
        return np.asarray(self.gram[chosen].sum(axis=0))


@dataclass(frozen=True)
class GroupFit(LinearFit):
    """A fit whose interval holds for another motion of the same kind.

    Attributes
    ----------
    repeat : Array (p, p) or None
        Covariance of the repeatability; None where nothing repeats.
    left : float
        Residual sum of squares.
    units : int
        Number of units that were left out.
    shared : Array (p,) or float
        Part of the variances that all trials on a bench share.
    """

    repeat: Array | None = None
    left: float = 0.0
    units: int = 0
    shared: Array | float = 0.0

    def repeat_se(self, name: str) -> float | None:
        """Standard error of an estimate by repeats of the same motion alone; None if nothing
        repeats."""
        if self.repeat is None:
            return None
        k = self.names.index(name)
        return float(np.sqrt(self.repeat[k, k]))

    def se_bench(self, name: str) -> float:
        """Part of the standard error that all trials on a bench share: its calibration and
        stiffness."""
        shared = np.broadcast_to(self.shared, len(self.names))
        return float(np.sqrt(shared[self.names.index(name)]))

    def freedom(self, name: str) -> float:
        return float(self.degrees_of_freedom[self.names.index(name)])

    def certain(self, name: str, once_in: float) -> bool:
        """Whether an estimate differs from 0 by a two-sided test at the level `once_in`."""
        quantile = float(scipy.special.stdtrit(self.freedom(name), 1 - once_in / 2))
        return abs(self[name]) > quantile * self.se(name)


def gram_sums(
    record: Record,
    columns: Mapping[str, Array],
    rich: Sequence[str],
    centre: float = 0.0,
    no_estimates: frozenset[str] = frozenset(),
    rounded: Array | None = None,
) -> Sums:
    """Sum the products of columns (n,) and of the record's torque, in each group.

    The noise is read from the raw torque, before the filter. `rounded` (k, n) may be thinned.

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
    products_with_rounded = None
    if rounded is not None:
        every = -(-len(record.time) // rounded.shape[1])
        thinned = rows[: len(columns), ::every].T
        edges = groups.first / every, groups.stop / every
        products_with_rounded = every * products_between(thinned, rounded.T, *edges)
    return Sums(
        names=tuple(columns),
        gram=products_between(rows.T, rows.T, groups.first, groups.stop),
        groups=groups,
        rich=tuple(rich),
        rate_hz=record.rate_hz,
        seconds=float(groups.stop.max() - groups.first.min()) / record.rate_hz,
        centre=centre,
        columns=columns,
        independent=max(record.rate_hz / (2 * record.low_pass.noise_bandwidth_hz), 1.0),
        rounded=products_with_rounded,
        no_estimates=no_estimates,
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
class NormalEquations:
    """The normal equations of a model of p columns, in each of m groups and in all.

    Attributes
    ----------
    groups : Array (m,)
        Numbers of the groups among those of the sums.
    stratum : Array (m,)
        Number of the stratum of each, from 0 without gaps.
    used : Array (p + 2,)
        Where the columns, the filtered and the raw torque stand in the sums.
    centring : Array (p + 2, p + 2)
        What centres the column `ramp`, so that drift and offset are orthogonal.
    left_sides : Array (m, p, p)
        Products of the columns with each other.
    right_sides : Array (m, p)
        Products of the columns with the filtered torque.
    for_scores : Array (m, p)
        The same with the raw torque, whose noise is independent from row to row; with the filtered
        one if nothing repeats.
    total : Array (p + 2, p + 2)
        The sums of all groups.
    offset : int
        Place of the column `one`.
    """

    groups: NDArray[np.intp]
    stratum: NDArray[np.intp]
    used: NDArray[np.intp]
    centring: Array
    left_sides: Array
    right_sides: Array
    for_scores: Array
    total: Array
    offset: int

    @property
    def size(self) -> int:
        """Number p of columns."""
        return len(self.used) - 2

    @property
    def left_side(self) -> Array:
        return np.asarray(self.total[: self.size, : self.size])

    @property
    def right_side(self) -> Array:
        return np.asarray(self.total[: self.size, self.size])

    @property
    def square(self) -> float:
        """Sum of the squares of the filtered torque."""
        return float(self.total[self.size, self.size])

    @property
    def sum_of_torque(self) -> float:
        return float(self.total[self.offset, self.size])

    @property
    def samples(self) -> float:
        return float(self.total[self.offset, self.offset])


def normal_equations(
    s: Sums, columns: Sequence[str], keep: "NDArray[np.bool_] | Label"
) -> NormalEquations:
    """The normal equations of some columns, over a label's groups or those to keep (m,)."""
    kept = keep if isinstance(keep, np.ndarray) else s.groups.of(keep)
    groups = np.flatnonzero(kept)
    used = np.array([*s.index(columns), s.torque, s.torque + 1])
    p, offset = len(columns), columns.index("one")
    centring = np.eye(p + 2)
    products = s.gram[:, used[:, None], used][groups]
    if "ramp" in columns:
        along, ramp = products[:, offset].sum(axis=0), columns.index("ramp")
        centring[offset, ramp] = -along[ramp] / along[offset]
        products = centring.T @ products @ centring

    stratum = s.groups.stratum[groups]
    numbers = np.cumsum(np.bincount(stratum) > 0) - 1
    # before the filter noise is independent from row to row; if nothing repeats, the filtered
    # torque is used, since else the part of the signal that the filter removes would count as noise
    raw = p + 1 if s.groups.repeat else p
    return NormalEquations(
        groups=groups,
        stratum=numbers[stratum],
        used=used,
        centring=centring,
        left_sides=products[:, :p, :p],
        right_sides=products[:, :p, p],
        for_scores=products[:, :p, raw],
        total=products.sum(axis=0),
        offset=offset,
    )


def fit_groups(
    s: Sums,
    model: Mapping[str, str],
    keep: "NDArray[np.bool_] | Label" = None,
    limit: float = CONDITION_LIMIT,
) -> GroupFit:
    """Fit the torque by least squares (Eq. 15), with an interval for another motion of this kind.

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
    names, columns = tuple(model), list(model.values())
    equations = normal_equations(s, columns, keep)
    A, b = equations.left_side, equations.right_side
    square, n = equations.square, equations.samples
    solution = identified(model, A, b, limit, s.no_estimates)
    estimates, inverse = solution.estimates, solution.inverse
    if n <= len(names):
        raise InputError(
            f"{n:.0f} samples cannot determine {len(names)} parameters; record for longer"
        )
    left = max(float(square - 2 * estimates @ b + estimates @ A @ estimates), 0.0)
    mean_left = (
        float(equations.sum_of_torque - equations.total[equations.offset, : len(names)] @ estimates)
        / n
    )

    stratum = equations.stratum
    number = len(stratum)
    repeats = s.groups.repeat and int(np.bincount(stratum).min()) > 1
    has_many_groups = number >= FEWEST_GROUPS
    rich = list(dict.fromkeys([*s.rich, *columns]))
    if repeats:
        scores = (equations.for_scores - equations.left_sides @ estimates) @ inverse
        noise, freedom = between_cycles(scores, stratum)
    elif has_many_groups:
        scores = scores_beside(s, equations, rich, keep, inverse)
        noise, freedom = noise_of_scores(scores, len(rich))
    else:  # too few scores: takes slow columns in noise that is white after the filter
        left_free = max(n / s.independent - len(names), 1.0)
        noise, freedom = inverse * left / left_free, np.full(len(names), left_free)

    by_strata = int(stratum.max()) + 1 >= FEWEST_UNITS
    unit = stratum if by_strata else np.arange(number)
    units = int(unit.max()) + 1
    tells_misfit = repeats or by_strata or has_many_groups
    misfit = np.zeros_like(inverse)
    if tells_misfit:
        misfit = jackknife(equations.left_sides, equations.right_sides, A, b, unit)

    of_rounding, draws = np.zeros_like(inverse), 0
    if s.rounded is not None:
        products = draw_products(s, equations)
        draws = products.shape[2]
        in_noise = np.zeros(len(names))
        if repeats or has_many_groups:
            in_noise = rounding_in_noise(products, inverse, stratum, repeats, len(rich))
        change = inverse @ products.sum(axis=0)
        of_rounding = less(change @ change.T / draws, in_noise)
        if tells_misfit:
            total = products.sum(axis=0)
            in_misfit = jackknife(equations.left_sides, products, A, total, unit).mean(axis=0)
            misfit = less(misfit, np.diag(in_misfit) - in_noise)

    interval_method = BY_NOISE
    if by_strata or (has_many_groups and not repeats):
        interval_method = BY_UNITS
    elif repeats:
        interval_method = BY_REPEATS
    covariance, freedom = combined(noise, freedom, misfit, units, of_rounding, draws)
    mean_torque = equations.sum_of_torque / n
    rows_of_group = float(np.median(s.groups.stop - s.groups.first))
    return GroupFit(
        names=names,
        estimates=estimates,
        covariance=covariance,
        vaf=accounted_for(left / n - mean_left**2, square / n - mean_torque**2, square / n),
        r_squared=1 - left / max(square, np.finfo(float).tiny),
        condition_number=solution.condition,
        correlation_samples=max(round(rows_of_group), 1),
        samples=round(n),
        interval_method=interval_method,
        degrees_of_freedom=freedom,
        residual=np.empty(0),
        largest_correlation=regression.largest_correlation(solution.about_means),
        repeat=noise if repeats else None,
        left=left,
        units=units,
    )


def draw_products(s: Sums, equations: NormalEquations) -> Array:
    """Products (m, p, k) of the columns with each of the k torques that rounding makes."""
    assert s.rounded is not None
    p = equations.size
    of_columns = s.rounded[np.ix_(equations.groups, equations.used[:p])]
    return np.asarray(equations.centring[:p, :p].T @ of_columns)


def rounding_in_noise(
    products: Array, inverse: Array, stratum: NDArray[np.intp], repeats: bool, columns: int
) -> Array:
    """Variances (p,) of the estimates that rounding has among those of noise: the scatter of its
    own scores, the mean over the draws.

    Parameters
    ----------
    products : Array (m, p, k)
        `draw_products`.
    inverse : Array (p, p)
        Of the normal equations.
    stratum : Array (m,)
        Number of the stratum of each group.
    repeats
        Whether the groups of a stratum repeat one another.
    columns
        Number of columns of the richest model.
    """
    variances = []
    for scores in np.moveaxis(inverse @ products, 2, 0):
        if repeats:
            covariance, _ = between_cycles(scores, stratum)
        else:
            covariance, _ = noise_of_scores(scores, columns)
        variances.append(np.diag(covariance))
    return np.asarray(np.mean(variances, axis=0))


def scores_beside(
    s: Sums,
    equations: NormalEquations,
    rich: Sequence[str],
    keep: "NDArray[np.bool_] | Label",
    inverse: Array,
) -> Array:
    """What each group (m, p) adds to the estimates by what the richest model leaves of its
    torque."""
    at = np.array(s.index(rich))
    across = s.gram[np.ix_(equations.groups, at, equations.used)] @ equations.centring
    of_rich = solved(s.over(keep)[np.ix_(at, at)], across[:, :, -2].sum(axis=0))[0]
    modelled = np.einsum("mrp,r->mp", across[:, :, :-2], of_rich)
    return np.asarray((equations.for_scores - modelled) @ inverse)


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


def identified(
    model: Mapping[str, str],
    A: Array,
    b: Array,
    limit: float,
    no_estimates: frozenset[str] = frozenset(),
) -> Identified:
    """Solve the normal equations of a model, A (p, p) and b (p,).

    Raises
    ------
    IdentifiabilityError
        The condition number is above the limit, or a column is 0.
    """
    estimates, inverse = solved(A, b)
    left_out = {"one", *no_estimates}
    varies = [k for k, column in enumerate(model.values()) if column not in left_out]
    about_means = inverse[np.ix_(varies, varies)]
    scale = np.sqrt(regression.check_not_zero(tuple(model), np.diag(A)))
    values, vectors = np.linalg.eigh(A / np.outer(scale, scale))
    condition = float(np.sqrt(values[-1] / max(values[0], 1e-30 * values[-1])))
    if len(about_means) > 1 and condition < regression.ROUNDED:
        condition = regression.scaled_condition(about_means)
    if condition > limit:
        regression.refuse_unidentifiable(tuple(model), vectors[:, 0], condition)
    return Identified(estimates, inverse, about_means, condition)


def accounted_for(left: float, varied: float, square: float) -> float:
    """VAF [percent] of a variance of which some is left; as `variance_accounted_for` if the signal
    is constant."""
    rounding = rounding_of(np.array([square**0.5])) if square > 0 else 0.0
    if varied > rounding:
        return float(100 * (1 - max(left, 0.0) / varied))
    return 100.0 if left <= rounding else 0.0


def jackknife(A_g: Array, b_g: Array, A: Array, b: Array, unit: NDArray[np.intp]) -> Array:
    """Covariance of the estimates by leaving out one unit at a time: noise, misfit and leverage.

    Parameters
    ----------
    A_g, b_g : Array (m, p, p), (m, p) or (m, p, k)
        Normal equations of each group; those of k torques at once have k right sides.
    A, b : Array (p, p), (p,) or (p, k)
        Their sums.
    unit : Array (m,)
        Number of the unit of each group.

    Returns
    -------
    Array (p, p) or (k, p, p)

    References
    ----------
    Miller, Biometrika 61, 1974.
    """
    units, p = int(unit.max()) + 1, len(b)
    belongs = np.asarray(unit == np.arange(units)[:, None], dtype=np.float64)
    of_units = (belongs @ A_g.reshape(len(unit), -1)).reshape(units, p, p)
    right_sides = (belongs @ b_g.reshape(len(unit), -1)).reshape(units, *b.shape)
    A_without, b_without = A - of_units, (b - right_sides).reshape(units, p, -1)
    scale = np.sqrt(np.diag(A))
    scaled = A_without / np.outer(scale, scale) + SMALLEST_DIRECTION * np.eye(p)
    estimates = np.linalg.solve(scaled, b_without / scale[:, None]) / scale[:, None]
    scatter = np.moveaxis(estimates - estimates.mean(axis=0), 2, 0)
    covariance = np.swapaxes(scatter, 1, 2) @ scatter * (units - 1) / units
    return np.asarray(covariance if b.ndim > 1 else covariance[0])


def combined(
    noise: Array,
    freedom: Array,
    misfit: Array,
    units: int,
    known: Array | float = 0.0,
    draws: int = 0,
) -> tuple[Array, Array]:
    """Combine what noise, misfit and rounding do to p estimates.

    The misfit is the scatter of units in excess of the noise. Correlations are those of the sum of
    both.

    Parameters
    ----------
    noise : Array (p, p)
        Covariance by noise, with `freedom` (p,) degrees of freedom.
    misfit : Array (p, p)
        Covariance by the scatter of `units`.
    known : Array (p, p)
        A covariance that is added as it is (type B of the GUM), from a number of `draws`.

    Returns
    -------
    covariance : Array (p, p)
    freedom : Array (p,)
        Degrees of freedom, at least 1.
    """
    random = np.maximum(np.diag(noise), 0.0)
    excess = np.maximum(np.diag(misfit) - random, 0.0)
    both = noise + misfit
    size = np.sqrt(np.maximum(np.diag(both), np.finfo(float).tiny))
    error = np.sqrt(random + excess)
    covariance = both / np.outer(size, size) * np.outer(error, error) + known

    added = np.diag(covariance) - random - excess
    of_misfit = np.full_like(random, max(units - 1.0, 1.0))
    of_draws = np.full_like(random, max(draws - 1.0, 1.0))
    degrees = welch_satterthwaite([random, excess, added], [freedom, of_misfit, of_draws])
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
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    raised = m / max(m - used / 2, 1.0)
    positive = (vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(size, size) * raised
    freedom = max(m / (1 + 2 * NEIGHBOURS_WEIGHT**2) - used / 2, 1.0)
    return np.asarray(positive), np.full(p, freedom)


def held_out_vaf(s: Sums, model: Mapping[str, str], label: Label = None) -> float | None:
    """Lowest VAF [percent] of groups that a fit did not use, each with its own offset.

    Returns
    -------
    float or None
        None without such groups, or where a fit to the others tells nothing.
    """
    columns = s.index(list(model.values()))
    one = s.index(["one"])[0]
    found = []
    for fitted, held_out in held_out_groups(s.groups, label):
        total = s.over(fitted)
        if total[one, one] <= len(model):
            return None
        A, b = total[np.ix_(columns, columns)], total[columns, s.torque]
        try:
            estimates = identified(model, A, b, CONDITION_LIMIT, s.no_estimates).estimates
        except IdentifiabilityError:
            return None
        for groups in held_out:
            sums = s.over(groups)
            found.append(vaf_of_groups(sums, columns, one, s.torque, estimates))
    return min(found, default=None)


def held_out_groups(
    groups: Groups, label: Label
) -> list[tuple[NDArray[np.bool_], list[NDArray[np.bool_]]]]:
    """Groups (m,) that are fitted, and the parts that this fit predicts.

    Of a label: itself, and each other label. Of all: the other labels, and each label. With one
    label: the rest, and each third of the groups, one after the other.
    """
    labels = groups.labels
    if label is not None:
        return [(groups.of(label), [groups.of(other) for other in labels if other != label])]
    if len(labels) > 1:
        return [(~groups.of(each), [groups.of(each)]) for each in labels]
    place = np.argsort(np.argsort(groups.first, kind="stable"), kind="stable")
    if len(place) < 2:
        return []
    part = 3 * place // len(place)
    return [(part != k, [part == k]) for k in np.unique(part)]


def vaf_of_groups(
    sums: Array, columns: Sequence[int], one: int, torque: int, estimates: Array
) -> float:
    """VAF [percent] of the torque of some groups by estimates that did not see it."""
    n, square = sums[one, one], sums[torque, torque]
    with_torque = sums[columns, torque]
    mean_left = (sums[one, torque] - sums[one, columns] @ estimates) / n
    modelled_square = estimates @ sums[np.ix_(columns, columns)] @ estimates
    left = square - 2 * estimates @ with_torque + modelled_square
    mean = sums[one, torque] / n
    return accounted_for(left / n - mean_left**2, square / n - mean**2, square / n)
