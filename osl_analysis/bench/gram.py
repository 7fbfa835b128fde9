"""One regression for every motion, from the Gram matrices of groups of rows.

One pass over the samples sums the products of all columns, of the model and of every effect, in
each group. All else is small algebra on these sums: the fit to a label or to all, its interval, the
VAF of held-out data, and each effect (effects.py).

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

from osl_analysis.bench.record import Groups, Label, Record
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
NEXT = {"theta": "omega", "omega": "alpha", "alpha": "jerk"}  # derivative of each column
# largest scaled condition number with effects, whose columns may be nearly collinear
EFFECTS_LIMIT = 1e5
BY_UNITS, BY_REPEATS = "units", "repeats"
"""Source of an interval: leave-one-out units, with the noise; or repeats, if there are too few
units."""


@dataclass(frozen=True)
class Sums:
    """Products of the columns and of the filtered and raw torque in each group, (m, q + 2, q +
    2)."""

    names: tuple[str, ...]  # names of the q columns; `one` is among them
    gram: Array
    groups: Groups
    # columns of the richest model, whose residual is noise if nothing repeats
    rich: tuple[str, ...]
    rate_hz: float  # sampling rate [Hz]
    seconds: float  # time [s] from the first to the last row that is fitted
    # angle [rad] at which the column `theta` is 0: verdicts do not depend on the encoder's zero
    centre: float
    columns: Mapping[str, Array]  # the columns (n,) themselves
    independent: float = 1.0  # rows after which filtered noise is independent
    # products (m, q, k) of the columns with the torques of `Record.rounded`
    rounded: Array | None = None
    # nearly collinear columns whose estimates nobody uses
    no_estimates: frozenset[str] = frozenset()

    def index(self, names: Sequence[str]) -> list[int]:
        return [self.names.index(name) for name in names]

    @cached_property
    def total(self) -> Array:
        """The sums of all groups."""
        return np.asarray(self.gram.sum(axis=0))

    @property
    def torque(self) -> int:
        return len(self.names)

    def over(self, keep: "Label | NDArray[np.bool_]") -> Array:
        """The sums of the groups of a label, or of those to `keep` (m,)."""
        if keep is None:
            return self.total
        chosen = keep if isinstance(keep, np.ndarray) else self.groups.of(keep)
        return np.asarray(self.gram[chosen].sum(axis=0))


@dataclass(frozen=True)
class GroupFit(LinearFit):
    """A fit whose interval holds for another motion of the same kind."""

    # covariance (p, p) of the repeatability; None where nothing repeats
    repeat: Array | None = None
    left: float = 0.0  # residual sum of squares
    units: int = 0  # number of units that were left out
    shared: Array | float = 0.0  # part (p,) of the variances that all trials on a bench share

    def repeat_se(self, name: str) -> float | None:
        """Standard error of an estimate by repeats of the same motion alone; None if nothing
        repeats."""
        k = self.names.index(name)
        return None if self.repeat is None else float(np.sqrt(self.repeat[k, k]))

    def se_bench(self, name: str) -> float:
        """Part of the standard error that all trials on a bench share: its calibration and
        stiffness."""
        return float(np.sqrt(np.broadcast_to(self.shared, len(self.names))[self.names.index(name)]))

    def freedom(self, name: str) -> float:
        return float(self.degrees_of_freedom[self.names.index(name)])

    def certain(self, name: str, once_in: float) -> bool:
        """Whether an estimate differs from 0 by a two-sided test at the level `once_in`."""
        return abs(self[name]) > float(
            scipy.special.stdtrit(self.freedom(name), 1 - once_in / 2)
        ) * self.se(name)


def gram_sums(
    record: Record,
    columns: Mapping[str, Array],
    rich: Sequence[str],
    centre: float = 0.0,
    no_estimates: frozenset[str] = frozenset(),
    rounded: Array | None = None,
) -> Sums:
    """The sums of columns (n,) and of the record's torque; the noise is read from the raw torque,
    before the filter. `rounded` (k, n) may be thinned. Raises InputError: a column cannot be
    measured."""
    Y = [record.filtered_torque, record.torque]
    Z = np.array([*columns.values(), *Y])
    for name, row in zip(
        [*(f"column '{name}'" for name in columns), "column 'y'", "the torque"], Z, strict=True
    ):
        check_measured(name, row)
    groups = record.groups
    gram = products_between(Z.T, Z.T, groups.first, groups.stop)
    seconds = float(groups.stop.max() - groups.first.min()) / record.rate_hz
    if rounded is not None:
        every = -(-len(record.time) // rounded.shape[1])
        edges = groups.first / every, groups.stop / every
        rounded = every * products_between(Z[: len(columns), ::every].T, rounded.T, *edges)
    return Sums(
        tuple(columns),
        gram,
        groups,
        tuple(rich),
        record.rate_hz,
        seconds,
        centre,
        columns,
        independent=max(record.rate_hz / (2 * record.low_pass.noise_bandwidth_hz), 1.0),
        rounded=rounded,
        no_estimates=no_estimates,
    )


def solved(A: Array, b: Array) -> tuple[Array, Array]:
    """Estimates (..., p) and the inverse (..., p, p) of normal equations."""
    scale = np.sqrt(np.maximum(np.diagonal(A, axis1=-2, axis2=-1), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(A / (scale[..., :, None] * scale[..., None, :]))
    parts, known = vectors / scale[..., :, None], values > 1e-13 * values[..., -1:]
    weights = np.divide(1, values, out=np.zeros_like(values), where=known)
    inverse, column = parts * weights[..., None, :] @ np.swapaxes(parts, -1, -2), b[..., None]
    estimates = inverse @ column
    return (estimates + inverse @ (column - A @ estimates))[..., 0], inverse


def least_left(total: Array) -> Array:
    """Residual sum of squares of the torque, the last column of sums (..., p + 1, p + 1), on the
    other columns."""
    b = total[..., :-1, -1]
    return np.asarray(total[..., -1, -1] - np.sum(b * solved(total[..., :-1, :-1], b)[0], axis=-1))


def estimates_of(total: Array, at: Sequence[int], q: int) -> Array:
    """Estimates (p,) of the columns `at` for the torque, column q, alone."""
    return solved(total[np.ix_(at, at)], total[at, q])[0]


def fit_groups(
    s: Sums,
    model: Mapping[str, str],
    keep: "NDArray[np.bool_] | Label" = None,
    limit: float = CONDITION_LIMIT,
) -> GroupFit:
    """Least squares of the torque on a model (Eq. 15), estimate -> column, over a label's groups or
    those to keep (m,).

    Raises IdentifiabilityError: a column is 0 throughout, or the scaled condition number is above
    the `limit`."""
    names, p, columns = tuple(model), len(model), list(model.values())
    groups = np.flatnonzero(keep if isinstance(keep, np.ndarray) else s.groups.of(keep))
    used, turn, one = (
        np.array([*s.index(columns), s.torque, s.torque + 1]),
        np.eye(p + 2),
        columns.index("one"),
    )
    own = s.gram[:, used[:, None], used][groups]
    if "ramp" in columns:  # centred, so that drift and offset are orthogonal
        along, ramp = own[:, one].sum(axis=0), columns.index("ramp")
        turn[one, ramp] = -along[ramp] / along[one]
        own = turn.T @ own @ turn
    total = own.sum(axis=0)
    n = float(total[one, one])
    # before the filter noise is independent from row to row; if nothing repeats, the filtered
    # torque is used, since else the part of the signal that the filter removes would count as noise
    A_g, b_g, raw_g = own[:, :p, :p], own[:, :p, p], own[:, :p, p + 1 if s.groups.repeat else p]
    A, b, square = total[:p, :p], total[:p, p], float(total[p, p])
    estimates, inverse, about_means, condition = identified(model, A, b, limit, s.no_estimates)
    if n <= len(names):
        raise InputError(
            f"{n:.0f} samples cannot determine {len(names)} parameters; record for longer"
        )
    left = max(float(square - 2 * estimates @ b + estimates @ A @ estimates), 0.0)
    level = float(total[one, p] - total[one, :p] @ estimates) / n
    stratum = s.groups.stratum[groups]
    stratum = (np.cumsum(np.bincount(stratum) > 0) - 1)[stratum]  # numbered without gaps
    scores = (raw_g - A_g @ estimates) @ inverse
    repeats = s.groups.repeat and int(np.bincount(stratum).min()) > 1
    if repeats:
        noise, freedom = between_cycles(scores, stratum)
    # too few scores: takes slow columns in noise that is white after the filter
    elif len(stratum) < FEWEST_GROUPS:
        left_free = max(n / s.independent - len(names), 1.0)
        noise, freedom = inverse * left / left_free, np.full(len(names), left_free)
    else:
        rich = np.array(s.index(list(dict.fromkeys([*s.rich, *columns]))))
        # its columns with the model's and both torques
        across = s.gram[np.ix_(groups, rich, used)] @ turn
        of_rich = solved(s.over(keep)[np.ix_(rich, rich)], across[:, :, -2].sum(axis=0))[0]
        modelled = np.einsum("mrp,r->mp", across[:, :, :-2], of_rich)
        noise, freedom = noise_of_scores(np.asarray((raw_g - modelled) @ inverse), len(rich))
    unit = stratum if stratum.max() + 1 >= FEWEST_UNITS else np.arange(len(stratum))
    units = int(unit.max()) + 1
    told = repeats or unit is stratum or len(stratum) >= FEWEST_GROUPS
    misfit = jackknife(A_g, b_g, A, b, unit) if told else np.zeros_like(inverse)
    known, draws = np.zeros_like(inverse), 0
    if s.rounded is not None:
        made = turn[:p, :p].T @ s.rounded[np.ix_(groups, used[:p])]
        draws, change, seen = made.shape[2], inverse @ made.sum(axis=0), np.zeros(p)
        if repeats or len(stratum) >= FEWEST_GROUPS:
            each = np.moveaxis(inverse @ made, 2, 0)
            by_groups = [
                between_cycles(x, stratum) if repeats else noise_of_scores(x, len(rich))
                for x in each
            ]
            seen = np.mean([np.diag(own) for own, _ in by_groups], axis=0)
        known = less(change @ change.T / draws, seen)
        if told:
            shown = jackknife(A_g, made, A, made.sum(axis=0), unit).mean(axis=0)
            misfit = less(misfit, np.diag(shown) - seen)
    covariance, freedom = combined(noise, freedom, misfit, units, known, draws)
    return GroupFit(
        names,
        estimates,
        covariance,
        accounted_for(left / n - level**2, square / n - (total[one, p] / n) ** 2, square / n),
        1 - left / max(float(square), np.finfo(float).tiny),
        condition,
        max(round(float(np.median(s.groups.stop - s.groups.first))), 1),
        round(float(n)),
        BY_UNITS if unit is stratum or not s.groups.repeat else BY_REPEATS,
        freedom,
        np.empty(0),
        regression.largest_correlation(about_means),
        noise if repeats else None,
        left,
        units,
    )


def identified(
    model: Mapping[str, str],
    A: Array,
    b: Array,
    limit: float,
    no_estimates: frozenset[str] = frozenset(),
) -> tuple[Array, Array, Array, float]:
    """Estimates (p,) of a model, the inverse (p, p) of its normal equations, the part of the
    inverse for columns about their means (without the offset), and the scaled condition number.
    Raises IdentifiabilityError: this is above the limit, or a column is 0."""
    estimates, inverse = solved(A, b)
    varies = [
        k
        for k, column in enumerate(model.values())
        if column != "one" and column not in no_estimates
    ]
    about_means = inverse[np.ix_(varies, varies)]
    scale = np.sqrt(regression.check_not_zero(tuple(model), np.diag(A)))
    values, vectors = np.linalg.eigh(A / np.outer(scale, scale))
    condition = float(np.sqrt(values[-1] / max(values[0], 1e-30 * values[-1])))
    if len(about_means) > 1 and condition < regression.ROUNDED:
        condition = regression.scaled_condition(about_means)
    if condition > limit:
        regression.refuse_unidentifiable(tuple(model), vectors[:, 0], condition)
    return estimates, inverse, about_means, condition


def accounted_for(left: float, varied: float, square: float) -> float:
    """VAF [percent] of a variance of which some is left; as `variance_accounted_for` if the signal
    is constant."""
    rounding = rounding_of(np.array([square**0.5])) if square > 0 else 0.0
    if varied > rounding:
        return float(100 * (1 - max(left, 0.0) / varied))
    return 100.0 if left <= rounding else 0.0


def jackknife(A_g: Array, b_g: Array, A: Array, b: Array, unit: NDArray[np.intp]) -> Array:
    """Covariance (p, p) of the estimates by leaving out one unit at a time: noise and misfit, with
    leverage. For k torques, b (p, k), it is (k, p, p)."""
    m, p = int(unit.max()) + 1, len(b)
    own = np.asarray(unit == np.arange(m)[:, None], dtype=np.float64)
    A_u = A - (own @ A_g.reshape(len(unit), -1)).reshape(m, p, p)
    b_u = (b - (own @ b_g.reshape(len(unit), -1)).reshape(m, *b.shape)).reshape(m, p, -1)
    scale = np.sqrt(np.diag(A))
    A_u = A_u / np.outer(scale, scale) + 1e-13 * np.eye(p)
    found = np.linalg.solve(A_u, b_u / scale[:, None]) / scale[:, None]
    apart = np.moveaxis(found - found.mean(axis=0), 2, 0)
    covariance = np.swapaxes(apart, 1, 2) @ apart * (m - 1) / m
    return np.asarray(covariance if b.ndim > 1 else covariance[0])


def combined(
    noise: Array,
    freedom: Array,
    misfit: Array,
    units: int,
    known: Array | float = 0.0,
    draws: int = 0,
) -> tuple[Array, Array]:
    """Covariance (p, p) of noise and misfit together, and its degrees of freedom (p,). The misfit
    is the scatter of units in excess of the noise. Correlations are those of the sum of both. A
    `known` covariance (p, p), from a number of `draws`, is added as type B."""
    random = np.maximum(np.diag(noise), 0.0)
    excess = np.maximum(np.diag(misfit) - random, 0.0)
    both = noise + misfit
    size = np.sqrt(np.maximum(np.diag(both), np.finfo(float).tiny))
    error = np.sqrt(random + excess)
    covariance = both / np.outer(size, size) * np.outer(error, error) + known
    parts = [random, excess, np.diag(covariance) - random - excess]
    of_each = [
        freedom,
        np.full_like(random, max(units - 1.0, 1.0)),
        np.full_like(random, max(draws - 1.0, 1.0)),
    ]
    degrees = welch_satterthwaite(parts, of_each)
    return covariance, np.maximum(degrees, 1.0)


def noise_of_scores(scores: Array, columns: int) -> tuple[Array, Array]:
    """Covariance (p, p) of estimates and its degrees of freedom (p,), from the scores (m, p) of
    consecutive groups and half the products of neighbours. Each column of the fit has used up half
    a group."""
    m, p = scores.shape
    used = min(columns, m - 2)
    near = scores[1:].T @ scores[:-1]
    covariance = scores.T @ scores + 0.5 * (near + near.T)
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    raised = m / max(m - used / 2, 1.0)
    found = (vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(size, size) * raised
    return np.asarray(found), np.full(p, max(m / 1.5 - used / 2, 1.0))


def held_out_vaf(
    s: Sums, model: Mapping[str, str], label: Label = None, interleaved: bool = False
) -> float | None:
    """Lowest VAF [percent] of groups that a fit did not use, each with its own offset; None without
    such groups or fit.

    Of a label: of the other labels, by its fit. Of all: of each label by the fit to the others.
    With one label: of each third of the groups by the fit to the rest; thirds are interleaved if
    something may change over the record."""
    labels, at, q, one = (
        s.groups.labels,
        s.index(list(model.values())),
        s.torque,
        s.index(["one"])[0],
    )
    if label is not None:
        pairs = [(s.groups.of(label), [s.groups.of(other) for other in labels if other != label])]
    elif len(labels) > 1:
        pairs = [(~s.groups.of(x), [s.groups.of(x)]) for x in labels]
    else:
        place = np.argsort(np.argsort(s.groups.first, kind="stable"), kind="stable")
        part = place % 3 if interleaved else 3 * place // len(place)
        pairs = [(part != k, [part == k]) for k in np.unique(part)] if len(place) > 1 else []
    found = []
    for fitted, held in pairs:
        total = s.over(fitted)
        if total[one, one] <= len(model):
            return None
        try:
            x, *_ = identified(
                model, total[np.ix_(at, at)], total[at, q], CONDITION_LIMIT, s.no_estimates
            )
        except IdentifiabilityError:
            return None
        for own in map(s.over, held):
            n, square = own[one, one], own[q, q]
            level = (own[one, q] - own[one, at] @ x) / n
            left = square - 2 * x @ own[at, q] + x @ own[np.ix_(at, at)] @ x
            found.append(
                accounted_for(left / n - level**2, square / n - (own[one, q] / n) ** 2, square / n)
            )
    return min(found, default=None)
