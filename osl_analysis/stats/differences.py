"""The difference between two campaigns in one quantity, B - A, with a 95 % interval; a verdict by such an interval."""

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy

from osl_analysis.errors import optional_module
from osl_analysis.measured import varies
from osl_analysis.stats.covariance import welch_satterthwaite
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.trial import Array

Sample = Mapping[Any, Sequence[float]]
"""The estimates of a campaign's trials by condition, as (K_d, B_d), all in one unit; no condition without a trial."""


class Difference(NamedTuple):
    """B - A and the ends of its interval in the unit of the samples; None where there is none."""

    estimate: float | None
    low: float | None
    high: float | None
    method: str  # where the interval comes from, or why there is none


def difference(a: Sample, b: Sample) -> Difference:
    """B - A by condition: paired where both have the same conditions with as many trials each, mixed effects where
    conditions overlap only in part or have unequal repeats (where these do not converge, paired over the shared ones),
    Welch's t over trials where one condition is shared. The trials of a condition count as their mean, so that what
    differs from condition to condition is scatter."""
    shared = [condition for condition in a if condition in b]
    x, y = (np.array([np.mean(one[condition]) for condition in shared]) for one in (a, b))
    if not shared:
        return Difference(None, None, None, "none: no condition in common")
    if len(shared) == 1:
        return welch(a[shared[0]], b[shared[0]], "Welch's t, trials")
    paired = over_repeats(y - x)
    found = Difference(paired.mean, paired.low, paired.high, "paired, Student")
    if {one: len(trials) for one, trials in a.items()} == {one: len(trials) for one, trials in b.items()}:
        return found
    return mixed_effects(a, b, y - x) or found._replace(method="paired, Student: the mixed model did not converge")


def student(estimate: float, se: float, freedom: float, method: str) -> Difference:
    half = float(scipy.special.stdtrit(freedom, 0.975)) * se
    return Difference(estimate, estimate - half, estimate + half, method)


def welch(a: Sequence[float] | Array, b: Sequence[float] | Array, method: str) -> Difference:
    """The difference of the means of two independent samples (Welch, Biometrika 34, 1947)."""
    estimate = float(np.mean(b) - np.mean(a))
    if min(len(a), len(b)) < 2:
        return Difference(estimate, None, None, "none: a single trial has no scatter")
    variances = [float(np.var(one, ddof=1)) / len(one) for one in (a, b)]
    freedom = float(welch_satterthwaite(variances, [len(a) - 1, len(b) - 1]))
    return student(estimate, float(np.sqrt(sum(variances))), freedom, method)


def mixed_effects(a: Sample, b: Sample, gaps: Array) -> Difference | None:
    """B - A of the means of conditions: campaign as fixed effect, condition as random effect (REML). `gaps` (n,) is B -
    A of the shared conditions, two or more. With n - 1 degrees of freedom it is the paired interval where no condition
    is missing. None where the model does not converge."""
    if not varies(gaps):  # the likelihood has no largest value
        return student(float(np.mean(gaps)), 0.0, len(gaps) - 1, "mixed effects")
    library = optional_module("statsmodels.regression.mixed_linear_model", "a comparison of unequal campaigns")
    cells = [(one, k, np.mean(trials)) for k, sample in enumerate((a, b)) for one, trials in sample.items()]
    names, campaign, y = zip(*cells, strict=True)
    known, unit = list(dict.fromkeys(names)), float(np.std(gaps))  # the optimiser needs numbers near 1
    X, groups = np.column_stack([np.ones(len(y)), campaign]), np.array([known.index(one) for one in names])
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # `converged` says it too; a variance of zero between conditions is no failure
        try:
            fit = library.MixedLM((np.array(y) - np.mean(y)) / unit, X, groups).fit(reml=True)
            estimate, se = unit * float(fit.fe_params[1]), unit * float(fit.bse_fe[1])
        except (np.linalg.LinAlgError, ValueError):
            return None
    known_error = fit.converged and np.isfinite(se) and se > 0
    return student(estimate, se, len(gaps) - 1, "mixed effects") if known_error else None


def of_intervals(a: Sample, b: Sample) -> Difference:
    """B - A of two independent numbers, each a sample of one condition with estimate, low and high of its own interval,
    which need not be symmetric: each end goes by the ends that it depends on (Zou and Donner, Stat. Med. 27, 2008)."""
    ((x, x_low, x_high),), ((y, y_low, y_high),) = a.values(), b.values()
    low, high = y - x - math.hypot(y - y_low, x_high - x), y - x + math.hypot(y_high - y, x - x_low)
    return Difference(y - x, low, high, "intervals of both")


def equivalence(low: float | None, high: float | None, target: float, margin: float | None) -> str | None:
    """'equivalent', 'different' or 'undecided' that a number with this 95 % interval is target +- margin, all in one
    unit; None without an interval or margin.

    It is equivalent where the whole interval lies within target +- margin, different where the whole interval lies
    beyond it on one side, and else undecided. Two one-sided tests at 5 % ask for the 90 % interval alone (Schuirmann,
    J. Pharmacokinet. Biopharm. 15, 1987); the 95 % interval is conservative: each test is at 2.5 %."""
    if low is None or high is None or margin is None or not all(map(math.isfinite, (low, high, target, margin))):
        return None
    if target - margin <= low and high <= target + margin:
        return "equivalent"
    return "different" if high < target - margin or low > target + margin else "undecided"
