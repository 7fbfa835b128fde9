"""One regression for every motion on the bench, from the sums of groups of rows (group_sums.py).

`fit_groups` fits a model to a label or to the whole recording; `held_out_vaf` tells how well a fit
predicts groups that it has not seen. The interval is group_interval.py's.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.group_interval import interval_of
from osl_analysis.bench.group_sums import Sums, identified, normal_equations
from osl_analysis.bench.row_groups import Groups, Label
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.measured import rounding_of
from osl_analysis.stats import regression
from osl_analysis.stats.regression import CONDITION_LIMIT, LinearFit
from osl_analysis.trial import Array


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

    def freedom(self, name: str) -> float:
        return float(self.degrees_of_freedom[self.names.index(name)])

    def certain(self, name: str, once_in: float) -> bool:
        """Whether an estimate differs from 0 by a two-sided test at the level `once_in`."""
        quantile = float(scipy.special.stdtrit(self.freedom(name), 1 - once_in / 2))
        return abs(self[name]) > quantile * self.se(name)


def fit_groups(
    s: Sums,
    model: Mapping[str, str],
    keep: NDArray[np.bool_] | Label = None,
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
    names, columns = tuple(model), list(model.values())
    equations = normal_equations(s, columns, keep)
    solution = identified(model, equations.left_side, equations.right_side, limit)
    estimates = solution.estimates
    n = equations.samples
    if n <= len(names):
        raise InputError(
            f"{n:.0f} samples cannot determine {len(names)} parameters; record for longer"
        )

    rich = list(dict.fromkeys([*s.rich, *columns]))
    interval = interval_of(s, equations, estimates, solution.inverse, rich, keep)
    residual_square = equations.residual_square(estimates)
    residual_mean = equations.residual_mean(estimates)
    torque_mean = equations.sum_of_torque / n
    vaf = accounted_for(
        left=residual_square / n - residual_mean**2,
        varied=equations.square / n - torque_mean**2,
        square=equations.square / n,
    )
    rows_of_group = float(np.median(s.groups.stop - s.groups.first))
    return GroupFit(
        names=names,
        estimates=estimates,
        covariance=interval.covariance,
        vaf=vaf,
        condition_number=solution.condition,
        correlation_samples=max(round(rows_of_group), 1),
        samples=round(n),
        interval_method=interval.source.interval_method,
        degrees_of_freedom=interval.degrees_of_freedom,
        residual=np.empty(0),  # the sums have no rows
        largest_correlation=regression.largest_correlation(solution.about_means),
        repeat=interval.of_repeats,
    )


HeldOut = list[tuple[NDArray[np.bool_], list[NDArray[np.bool_]]]]
"""Groups (m,) that are fitted, and the parts that this fit predicts."""


def accounted_for(left: float, varied: float, square: float) -> float:
    """VAF [percent] of a variance of which some is left; as `variance_accounted_for` if the signal
    is constant."""
    rounding = rounding_of(np.array([square**0.5])) if square > 0 else 0.0
    if varied > rounding:
        return float(100 * (1 - max(left, 0.0) / varied))
    return 100.0 if left <= rounding else 0.0


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
    one = s.index(["one"])[0]
    found = []
    for fitted, held_out in parts:
        total = s.over(fitted)
        if total[one, one] <= len(model):
            return None
        A, b = total[np.ix_(columns, columns)], total[columns, s.torque]
        try:
            estimates = identified(model, A, b, CONDITION_LIMIT).estimates
        except IdentifiabilityError:
            return None
        for groups in held_out:
            sums = s.over(groups)
            found.append(vaf_of_groups(sums, columns, one, s.torque, estimates))
    return min(found, default=None)


def every_third(groups: Groups) -> HeldOut:
    """Two of three groups in their order in time, such as cycles, and the third."""
    place = np.argsort(np.argsort(groups.first, kind="stable"), kind="stable") % 3
    return [(place != k, [place == k]) for k in np.unique(place)]


def other_amplitudes(groups: Groups, label: Label) -> HeldOut:
    """Of a label: itself, and each other label. Of all: the other labels, and each label. With one
    label: the rest, and each third of the groups, one after the other."""
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
