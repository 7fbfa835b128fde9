"""What would explain the residuals of the predictions of all trials: a component that differs from
its measurement, the gain of the torque, or a late controller."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.group_sums import solved
from osl_analysis.bench.measured_components import COMPONENTS, Components
from osl_analysis.trial import Array

# ages [s] of the controller's inputs, which no component trial shows
DELAYS = ("angle_delay", "velocity_delay")
TERMS = ("left", *COMPONENTS, "torque_gain", *DELAYS)
"""Torques of a trial: the prediction's residual, and the effect of one unit of each component, gain
or delay."""
ALONG = ("along_theta", "along_omega", "along_alpha")
"""RMS of the parts of a torque that are proportional to the motion, over the RMS of the predicted
torque: they make up K, B and I, are similar in size, and independent."""
LEAST_SHARE = 0.5  # of the misfit that a named cause explains
CERTAIN_CHANGE = 4.0  # standard errors of the change of a named cause
# a cause is named beside the best one if it leaves at most this multiple of what that leaves
AS_GOOD = 1.5
LEAST_MISFIT = 5e-3  # share of the torque that the delays must leave; sound legs leave up to 0.0035
LEAST_CHANGE = {
    **dict.fromkeys(COMPONENTS, 0.05),
    "torque_gain": 0.02,
    "angle_delay": 1.5e-3,
    "velocity_delay": 5e-3,
}
"""Smallest named change, relative to a component, or of a delay [s]. A sampled loop acts half a
sample late or later (1 ms at 500 Hz); a velocity from a filtered difference is older still."""
HUBER = 1.5  # robust standard deviations up to which a residual counts as in least squares
MOST_ITERATIONS = 50  # of the robust fit
CONVERGED = 1e-13  # relative change of its coefficients


@dataclass(frozen=True)
class Explained:
    """Changes of some causes that explain most of all residuals.

    Attributes
    ----------
    changes : Mapping of Array (b,)
        By cause: of all trials, and then, from three trials on, without each.
    left : float
        Mean absolute value of what is left of all, as a share of the torque.
    """

    changes: Mapping[str, Array]
    left: float


def causes_table(
    each: Sequence[Mapping[str, Any]], components: Components, place: Mapping[str, Any]
) -> pl.DataFrame:
    """Find what would explain the residuals of all predictions.

    No trial measures the controller's delays, so that they explain first, and a component explains
    their residual. The component that explains most is named, with those that explain as much, if
    it explains `LEAST_SHARE` and its change is certain and not small. The regression is robust, so
    that trials that ring do not dominate.

    Parameters
    ----------
    each
        By trial: the rows of `prediction_terms`, by their `term`.
    components
        As they were measured.
    place
        Joint and side.

    Returns
    -------
    polars.DataFrame
        A row per component, for the gain of the torque, and per delay: the `change`, in its unit,
        that explains most of all residuals; its standard error, from leaving out one trial at a
        time and from the component; what is `left` with it and `left_without` it [% of the torque];
        and whether the recordings name it.
    """
    torques = np.array([[[of[term][along] for along in ALONG] for term in TERMS] for of in each])
    by_delays = explained_beside_delays(torques).left
    rows = [
        cause_row(name, explained_beside_delays(torques, name), by_delays, components, len(each))
        for name in (*components.values, "torque_gain")
    ]
    best = min(rows, key=lambda row: row["left"])
    explains_enough = best["left"] / 100 < (1 - LEAST_SHARE) * by_delays
    is_clear = best["named"] and by_delays > LEAST_MISFIT and explains_enough
    for row in rows:
        row["named"] &= is_clear and row["left"] <= AS_GOOD * best["left"]

    named = (best["component"],) if is_clear else ()
    with_delays = explained_beside_delays(torques, *named)
    without_delays = float(robust_fit(torques, named)[1][0])
    for name in DELAYS:
        row = cause_row(name, with_delays, without_delays, components, len(each))
        row["named"] &= with_delays.left < (1 - LEAST_SHARE) * without_delays
        rows.append(row)
    return pl.DataFrame([{**place, **row} for row in rows], infer_schema_length=None)


def cause_row(
    name: str, explained: Explained, left_without: float, components: Components, n: int
) -> dict[str, Any]:
    """The row of a cause, `named` where its change is certain and not small."""
    value = 1.0 if name == "torque_gain" else components.values.get(name)
    change, *without_a_trial = explained.changes[name].tolist()
    se = None
    if without_a_trial:
        of_trials = np.sqrt((n - 1) * np.var(without_a_trial))  # jackknife
        of_component = components.se(name) if name in COMPONENTS else 0.0
        se = float(np.hypot(of_trials, of_component))
    if name == "K_s" and value and change < value:
        # the torque is linear in the compliance of the belt
        change = value * change / (value - change)
    size = change if value is None else abs(change / value)
    is_large = size > LEAST_CHANGE[name]
    is_certain = se is not None and abs(change) > CERTAIN_CHANGE * se
    return {
        "component": name,
        "value": value,
        "change": change,
        "change_se": se,
        "left": 100 * explained.left,
        "left_without": 100 * left_without,
        "trials": n,
        "named": bool(is_large and is_certain),
    }


def explained_beside_delays(torques: Array, *names: str) -> Explained:
    """Explain the residuals (n, terms, 3) by some terms and the delays, none of which may be
    negative: no controller knows the future."""
    n = len(torques)
    names = (*names, *DELAYS)
    all_trials = np.ones((1, n))
    without_each = 1 - np.eye(n) if n > 2 else np.empty((0, n))
    trials = np.vstack([all_trials, without_each])
    used = np.ones((len(trials), len(names)))
    changes = np.zeros(used.shape)
    left = np.zeros(len(trials))
    is_early: NDArray[np.bool_] = np.ones(len(trials), dtype=np.bool_)
    while is_early.any():
        changes[is_early], left[is_early] = robust_fit(
            torques, names, used[is_early], trials[is_early]
        )
        most_negative = changes[:, -len(DELAYS) :].argmin(axis=1) - len(DELAYS)
        is_early = changes[range(len(changes)), most_negative] < 0
        used[is_early, most_negative[is_early]] = 0.0
    return Explained(dict(zip(names, changes.T, strict=True)), float(left[0]))


def robust_fit(
    torques: Array, names: Sequence[str], used: Array | None = None, trials: Array | None = None
) -> tuple[Array, Array]:
    """Fit terms to the residuals of the predictions by Huber's M-estimator, b times.

    Parameters
    ----------
    torques : Array (n, terms, 3)
        Torques of n trials by `TERMS` and `ALONG`, in shares of the predicted torque.
    names
        The k terms that explain.
    used : Array (b, k), optional
        1 where a fit uses a term, else 0.
    trials : Array (b, n), optional
        1 where a fit uses a trial, else 0.

    Returns
    -------
    coefficients : Array (b, k)
        Of the terms; 0 for those that are not used.
    left : Array (b,)
        Mean absolute value of what is left.

    Notes
    -----
    Iteratively reweighted least squares, with a scale by the median of the residuals (Huber, Robust
    Statistics, 1981).
    """
    used = np.ones((1, 1)) if used is None else used
    trials = np.ones((1, 1)) if trials is None else trials
    y = torques[:, 0].ravel()
    counts = np.repeat(np.broadcast_to(trials, (len(trials), len(torques))), 3, axis=1)
    at_terms = [TERMS.index(name) for name in names]
    X = torques[:, at_terms].transpose(0, 2, 1).reshape(len(y), -1)
    scale = np.maximum(np.abs(X).max(axis=0), np.finfo(float).tiny)
    X = X / scale
    products = X[:, :, None] * X[:, None]
    both_used = used[:, :, None] * used[:, None]
    ones_where_unused = np.eye(len(names)) * (1 - used[:, None])
    number = counts.sum(axis=1).astype(int)
    weight = counts
    coefficients = np.zeros((1, 1))
    for _ in range(MOST_ITERATIONS):
        normal = np.tensordot(weight, products, 1) * both_used + ones_where_unused
        before = coefficients
        coefficients = solved(normal, (weight * y) @ X * used)[0] * used
        left = np.abs(y - coefficients @ X.T)
        if (np.abs(coefficients - before) <= CONVERGED * np.abs(before)).all():
            break
        median = medians(left, counts, number)[:, None]
        scaled = HUBER * median / scipy.special.ndtri(0.75)
        huber = np.minimum(1, scaled / np.maximum(left, np.finfo(float).tiny))
        weight = np.where(median > 0, huber * counts, weight)  # at 0 half of the numbers are exact
    return coefficients / scale, (left * counts).sum(axis=1) / number


def medians(values: Array, counts: Array, number: NDArray[np.intp]) -> Array:
    """Medians (b,) of the values (b, m) that count, a `number` (b,) of each."""
    rising = np.sort(np.where(counts > 0, values, np.inf), axis=1)
    fits = range(len(rising))
    return np.asarray((rising[fits, (number - 1) // 2] + rising[fits, number // 2]) / 2)
