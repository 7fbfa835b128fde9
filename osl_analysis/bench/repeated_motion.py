"""What repeats of one motion show for any joint: a changing stiffness, and clocks that drift apart.

Repeats have the same misfit, whatever the joint is, so that only what changes is left.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy

from osl_analysis.bench.effects import FALSE_ALARM, Model
from osl_analysis.bench.group_fit import GroupFit, fit_groups
from osl_analysis.bench.group_interval import combined
from osl_analysis.bench.group_sums import NEXT, Sums, solved
from osl_analysis.bench.record import Record
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.signals.clock_drift import NO_DRIFT, drift_row
from osl_analysis.stats.covariance import welch_satterthwaite
from osl_analysis.stats.table_rows import Row
from osl_analysis.trial import Array

FEWEST_REPEATS = 3  # of one motion, by which a change with time differs from noise


def changes_of_repeats(
    s: Sums, model: Model, effects: Mapping[str, Mapping[str, float]]
) -> GroupFit | None:
    """Sizes of effects that grow with time, from differences between repeats of one motion.

    Each stratum has its own misfit, whatever the joint is. Time is the group's. A score is the
    product of column and residual in a group, less the mean of its stratum.

    Parameters
    ----------
    s
        Sums of m groups.
    model
        Column of each estimate.
    effects
        Each as a combination of columns, by its name.

    Returns
    -------
    GroupFit or None
        Its estimates are sizes per time [1/s]. None if no stratum has three repeats.
    """
    stratum = s.groups.stratum
    members = np.bincount(stratum)
    if members.max() < FEWEST_REPEATS:
        return None
    base = fit_groups(s, model)
    q, one = s.torque, s.names.index("one")
    of_model = s.index(list(model.values()))
    combination = np.array([[part.get(name, 0.0) for part in effects.values()] for name in s.names])

    # a slow disturbance is an offset of a group
    mean = s.gram[:, one] / s.gram[:, one, one][:, None]
    about_mean = s.gram - mean[:, :, None] * s.gram[:, one][:, None]
    products = combination.T @ about_mean[:, :q, :q] @ combination
    modelled = about_mean[:, :q][:, :, of_model] @ base.estimates
    scores = (about_mean[:, :q, q + 1] - modelled) @ combination

    def by_stratum(values: Array) -> Array:
        """Sums (strata, ...) of values (m, ...)."""
        total = np.zeros((len(members), *values.shape[1:]))
        np.add.at(total, stratum, values)
        return total

    scores = scores - (by_stratum(scores).T / members).T[stratum]
    middle = (s.groups.first + s.groups.stop) / 2 / s.rate_hz
    since_mean = middle - (by_stratum(middle) / members)[stratum]
    weighted = products * (since_mean**2)[:, None, None]
    estimates, inverse = solved(weighted.sum(axis=0), since_mean @ scores)

    grown = np.einsum("mpq,q,m->mp", products, estimates, since_mean)
    rest = since_mean[:, None] * (scores - grown) @ inverse
    taken = np.einsum("spq,qp->s", by_stratum(weighted), inverse)  # freedom of the slopes
    free = members - 1 - taken
    rest *= np.sqrt(members / np.maximum(free, 0.5))[stratum, None]
    noise = rest.T @ rest
    freedom = welch_satterthwaite(by_stratum(rest**2), np.maximum(free, 0.5))
    sums = by_stratum(rest)
    misfit = sums.T @ sums * len(members) / max(len(members) - 1, 1)
    covariance, degrees = combined(noise, freedom, misfit, len(members))
    return replace(
        base,
        names=tuple(effects),
        estimates=estimates,
        covariance=covariance,
        degrees_of_freedom=degrees,
    )


def repeats_row(record: Record, s: Sums, model: Model) -> Row:
    """What repeats of one motion show for any joint.

    If the torque's clock gains, its torque gets later and later: at time t it is that of t - ppm (t
    - mean t), which to first order adds -ppm (t - mean t) dtorque/dt. A constant offset between
    clocks is not seen.

    Returns
    -------
    dict
        `K_drift`, the relative change of K from the first to the last fitted row beyond noise, and
        the drift of the torque's clock against the angle's [ppm]. Null if nothing repeats; the
        drift also if one device recorded both.

    Raises
    ------
    InputError
        The drift is certain and larger than the settings allow; the message names the trial.
    """
    row: Row = {"K_drift": None, **NO_DRIFT}
    fit = fit_groups(s, model)
    if not s.groups.repeat:
        return row
    slope = {NEXT[column]: -1e-6 * fit[name] for name, column in model.items() if column in NEXT}
    try:
        growing = changes_of_repeats(s, model, {"K_within": {"theta": 1.0}, "ppm": slope})
    except IdentifiabilityError:
        return row
    if growing is None:
        return row
    if "K" in model:
        change, se = s.seconds * growing["K_within"], s.seconds * growing.se("K_within")
        one_sided = float(scipy.special.stdtrit(growing.freedom("K_within"), 1 - FALSE_ALARM))
        beyond_noise = max(abs(change) - one_sided * se, 0.0)
        row["K_drift"] = float(np.sign(change)) * beyond_noise / fit["K"]
    if record.two_clocks:
        drift = clocks_row(record, growing["ppm"], growing.se("ppm"), growing.freedom("ppm"))
        row.update(drift)
    return row


def clocks_row(record: Record, ppm: float, error: float, freedom: float) -> Row:
    """The drift between the clocks of two devices [ppm].

    Raises
    ------
    InputError
        It certainly exceeds the settings' limit.
    """
    largest = record.settings.time_base.largest_drift_ppm if record.settings else np.inf
    try:
        return dict(drift_row(ppm, error, freedom, largest))
    except InputError as problem:
        raise InputError(f"trial {record.name}: {problem}") from problem
