"""Sums of products of columns and torque, in groups of rows: of these every fit is made.

One pass over the samples sums the products of all columns, of the model and of every effect, in
each group. All else is small algebra on these sums: the fit to a label or to all (group_fit.py),
its interval (group_interval.py), and each effect (effects.py).

Words of this and the modules that use it:

* A *group* is a few consecutive rows, such as the third cycle of 2 Hz at 5 deg.
* A *stratum* is a set of groups that repeat one another: all cycles of 2 Hz at 5 deg.
* A *label* is what has a fit of its own: 5 deg. None stands for the whole recording.
* A *unit* is what is left out at a time to see the scatter: a stratum, or a group where strata are
  few.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.record import Record
from osl_analysis.bench.row_groups import Groups, Label
from osl_analysis.measured import check_measured
from osl_analysis.stats import regression
from osl_analysis.stats.covariance import products_between
from osl_analysis.trial import Array

SMALLEST_DIRECTION = 1e-13  # eigenvalue over the largest one, below which it is rounding
# of the largest one: rounding can make the smallest 0 or negative; its condition number is then
# 1e15, above every limit
LEAST_EIGENVALUE = 1e-30
# largest scaled condition number with effects, whose columns may be nearly collinear
EFFECTS_LIMIT = 1e5


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

    def over(self, keep: Label | NDArray[np.bool_]) -> Array:
        """The sums of the groups of a label, or of those to `keep` (m,)."""
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
        rate_hz=record.rate_hz,
        seconds=float(groups.stop.max() - groups.first.min()) / record.rate_hz,
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

    def residual_square(self, estimates: Array) -> float:
        """Sum of the squares that these estimates (p,) leave of the filtered torque."""
        A, b = self.left_side, self.right_side
        return max(float(self.square - 2 * estimates @ b + estimates @ A @ estimates), 0.0)

    def residual_mean(self, estimates: Array) -> float:
        """Mean of what they leave."""
        of_model = self.total[self.offset, : self.size] @ estimates
        return float(self.sum_of_torque - of_model) / self.samples


def normal_equations(
    s: Sums, columns: Sequence[str], keep: NDArray[np.bool_] | Label
) -> NormalEquations:
    """The normal equations of some columns, over a label's groups or those to keep (m,)."""
    kept = keep if isinstance(keep, np.ndarray) else s.groups.of(keep)
    groups = np.flatnonzero(kept)
    used = np.array([*s.index(columns), s.torque, s.torque + 1])
    p = len(columns)
    offset = columns.index("one")
    centring = np.eye(p + 2)
    products = s.gram[:, used[:, None], used][groups]
    if "ramp" in columns:
        along = products[:, offset].sum(axis=0)
        ramp = columns.index("ramp")
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
) -> Identified:
    """Solve the normal equations of a model, A (p, p) and b (p,).

    Raises
    ------
    IdentifiabilityError
        The condition number is above the limit, or a column is 0.
    """
    estimates, inverse = solved(A, b)
    varies = [k for k, column in enumerate(model.values()) if column != "one"]
    about_means = inverse[np.ix_(varies, varies)]
    scale = np.sqrt(regression.check_not_zero(tuple(model), np.diag(A)))
    values, vectors = np.linalg.eigh(A / np.outer(scale, scale))
    condition = float(np.sqrt(values[-1] / max(values[0], LEAST_EIGENVALUE * values[-1])))
    if len(about_means) > 1 and condition < regression.ROUNDED:
        condition = regression.scaled_condition(about_means)
    if condition > limit:
        regression.refuse_unidentifiable(tuple(model), vectors[:, 0], condition)
    return Identified(estimates, inverse, about_means, condition)
