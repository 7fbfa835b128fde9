"""A model fitted to a torque that is late."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from osl_analysis.bench.effects import Model
from osl_analysis.bench.record import Record
from osl_analysis.bench.regression import EFFECTS_LIMIT, GroupFit, fit_groups, gram_sums
from osl_analysis.trial import Array

NEXT = {"theta": "omega", "omega": "alpha", "alpha": "jerk"}  # derivative of each column
LONGEST_LAG = 0.02  # s; the largest lag that is sought
LAG_FOUND = 1e-6  # s; last step of a search that has come to its end
LAG_CONVERGED = 1e-9  # s; the step after it would be a thousand times smaller
# Of a search for a lag: one without it, and four that shrink from 20 ms below `LAG_CONVERGED`, as
# each is about a thousandth of the one before; one is to spare.
MOST_STEPS = 6


@dataclass(frozen=True)
class LateFit:
    """A model with a lag of the torque.

    Attributes
    ----------
    fit : GroupFit
        Its last estimate is the lag, `lag_s` [s].
    last_step_s : float
        Last step of the search [s].
    """

    fit: GroupFit
    last_step_s: float

    @property
    def has_ended(self) -> bool:
        """Whether the search has come to its end."""
        return abs(self.last_step_s) <= LAG_FOUND


def late_fit(
    few: Record,
    columns: Mapping[str, Array],
    model: Model,
    centre: float = 0.0,
    prompt_torque: Array | float = 0.0,
    lag_s: float = 0.0,
) -> LateFit:
    """Fit a model to a torque that is late (Gauss-Newton).

    In each step the torque is advanced by the lag that is known so far. The slope of the torque is
    a column, which gives the lag that remains. The slope is the model's, as far as its derivatives
    are columns: that of a noisy torque would pull the lag to 0. It needs estimates, so that the
    first step is a fit without a lag. A model without derivatives uses the torque's own slope.

    Parameters
    ----------
    few : Record
        A coarse record of n rows.
    columns : Mapping of Array (n,)
        Columns by name.
    model : Mapping
        Column of each estimate.
    centre : float
        As `gram_sums` takes it.
    prompt_torque : Array (n,) or float
        Part of the torque that is not late, and is subtracted [N*m].
    lag_s : float
        Where the search starts [s].

    Raises
    ------
    InputError, IdentifiabilityError
        As `fit_groups`.
    """
    torque_at = scipy.interpolate.make_interp_spline(few.time, few.filtered_torque, 5)
    derivatives = {
        name: columns[NEXT[column]] for name, column in model.items() if NEXT.get(column) in columns
    }
    fit: GroupFit | None = None
    step_s = 0.0
    for _ in range(MOST_STEPS):
        then = np.clip(few.time + lag_s, few.time[0], few.time[-1])
        torque = torque_at(then) - prompt_torque
        advanced = replace(few, filtered_torque=torque, torque=torque)
        if not derivatives:
            slope = torque_at(then, 1)
        elif fit is None:  # the next step takes the slope of this fit
            sums = gram_sums(advanced, columns, list(columns), centre)
            fit = fit_groups(sums, model, limit=EFFECTS_LIMIT)
            continue
        else:
            terms = [fit[name] * column for name, column in derivatives.items()]
            slope = np.sum(terms, axis=0)

        sums = gram_sums(advanced, {**columns, "late": -slope}, list(columns), centre)
        fit = fit_groups(sums, {**model, "lag_s": "late"}, limit=EFFECTS_LIMIT)
        step_s = fit["lag_s"]
        lag_s = float(np.clip(lag_s + step_s, -LONGEST_LAG, LONGEST_LAG))
        if abs(step_s) < LAG_CONVERGED:
            break
    assert fit is not None
    with_lag = np.append(fit.estimates[:-1], lag_s)
    return LateFit(replace(fit, estimates=with_lag), step_s)
